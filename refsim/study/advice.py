"""What an accuracy costs in the panels: the cheapest measured setting for any error."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.core.tables import in_bytes
from refsim.scene.files import scene_to_toml
from refsim.scene.scene import Scene
from refsim.study.choice import NORMAL, Candidate, Choice, choose, duration, kinds, least_error, percent, physics
from refsim.study.panels import Panel, abouts, panel
from refsim.study.panels.scenes import scene_of

NOTABLE = 0.05  # share of an error from which on what is known of it is said


@dataclass(frozen=True)
class Advice:
    """The answer for an observable and a relative error.

    kind        "cpu" or "gpu"
    choice      what the rules say; None where the error has no meaning, or on a GPU that was not measured
    peer        the same of other programs, on a CPU; None where none was measured
    no_meaning  why the error has none; "" where it has
    """

    panel: Panel
    error: float
    kind: str = "cpu"
    choice: Choice | None = None
    peer: Choice | None = None
    no_meaning: str = ""

    @cached_property
    def scene(self) -> Scene | None:
        """Scene of the named setting; None where it has none. A drop is stirred for it, which takes seconds."""
        reached = None if self.choice is None else self.choice.advised or self.choice.read
        return None if reached is None else scene_of(self.panel, reached.point)

    @property
    def toml(self) -> str:
        """The scene as a file; "" without one."""
        return "" if self.scene is None else scene_to_toml(self.scene)


def answer(of: Panel, error: float, kind: str = "cpu") -> Advice:
    """The rules' answer for a relative error."""
    found, uncertainty = kinds(of), of.reference()[2]
    if error <= uncertainty:
        why = f"the reference is known to {percent(uncertainty)} ({of.about.uncertain})"
        return Advice(of, error, kind, no_meaning=why)
    chosen = choose(found[kind], error, physics(found)) if found[kind] else None
    peer = choose(found["peer"], error) if found["peer"] else None
    return Advice(of, error, kind, chosen, peer)


def find(observable: str, error: float, kind: str = "cpu") -> Advice:
    """`answer` of the panel of this name. Raises InputError for an unknown one, and for an impossible error."""
    known = abouts()
    if observable not in known:
        raise InputError(f"advise: there is no observable {observable!r}; {suggestion(observable, known)}")
    if not 0 < error < 1:
        raise InputError(f"advise: an error of {error:g} is not possible; give a share between 0 and 1, 0.01 for 1 %.")
    return answer(panel(observable), error, kind)


def within(observable: str, seconds: float, kind: str = "cpu") -> Advice:
    """The answer for the least error that can be had within so many seconds on the panels' machine.

    Raises InputError as `find` does, and where no setting is that fast.
    """
    if not 0 < seconds < math.inf:
        raise InputError(f"advise: {seconds:g} seconds are not possible; give a positive number.")
    of = find(observable, 0.5, kind).panel
    found = kinds(of)
    error = least_error(found[kind], seconds, physics(found))
    if error is None:
        raise InputError(f"advise: no measured setting of {observable} takes {duration(seconds)} or less; give more.")
    return answer(of, error, kind)


def own_error(of: Panel, candidate: Candidate, reached: bool = True) -> str:
    """The error of a setting; also in the observable's own unit, where its number is another one.

    "at most" with the reference's uncertainty added, if that is a twentieth of it or more; else with the standard
    deviation of its readings, if that is; "at least" where no setting has less.
    """
    about, scale = of.about, of.reference()[1]
    error, before, after = candidate.error, "" if reached else "at least ", ""
    if candidate.uncertainty >= NOTABLE * error:
        error, before = candidate.most, "at most "
    elif NORMAL * candidate.point.error_mad >= NOTABLE * error:
        after = f" ± {percent(NORMAL * candidate.point.error_mad)}"
    shown = about.unit and about.unit != "%" and (about.limit_of or scale > 1)
    own = f" ({error * scale:.2g} {about.unit})" if shown else ""
    return f"{before}{percent(error)}{after}{own}"


def text_of(advice: Advice) -> str:
    """The answer as text."""
    about, choice, gpu = advice.panel.about, advice.choice, advice.kind == "gpu"
    lines = [f"{about.words}: an error of {percent(advice.error)} {about.relative}"]
    if advice.no_meaning:
        return f"{lines[0]}\n  no meaning: {advice.no_meaning}"
    if choice is None:
        return f"{lines[0]}\n  not measured on a GPU; leave --gpu out."
    if choice.why:
        lines.append(f"  {choice.why}")
    setting = choice.advised or choice.read
    if setting is not None:
        took = duration(choice.seconds)
        if choice.advised is None:
            fast, slow = (duration(choice.seconds * share) for share in setting.scatter)
            took = f"{fast} to {slow}, not settled,"
        elif setting.starts:
            took += f" ({' to '.join(duration(choice.seconds * share) for share in setting.starts)} over the starts)"
        lines.append(f"  setting    {setting.point.words}; error {own_error(advice.panel, setting)}")
        lines.append(f"  measured   {took} on {advice.panel.where(gpu)}")
        if setting.point.bytes:
            lines.append(f"  memory     {in_bytes(setting.point.bytes)} in fields")
    if advice.peer is not None and not gpu:
        best = advice.peer
        said = best.why if best.advised is None else f"{duration(best.seconds)}, {best.advised.point.words}"
        lines.append(f"  best peer  {said}")
    lines += [f"  note       {note}" for note in choice.notes]
    if about.remark:
        lines.append(f"  note       {about.remark}")
    return "\n".join(lines)


def data_of(advice: Advice) -> dict[str, Any]:
    """The answer as plain values."""
    about, choice = advice.panel.about, advice.choice

    def plain(found: Choice | None) -> dict[str, Any] | None:
        if found is None:
            return None
        made: dict[str, Any] = {"why": found.why, "notes": list(found.notes)}
        if found.named is not None:
            point = found.named.point
            made |= {
                "key": point.key, "setting": point.words, "program": point.program, "error": found.named.most,
                "seconds": found.seconds if math.isfinite(found.seconds) else None, "bytes": point.bytes,
                "settled": not found.named.unsettled,
            }  # fmt: skip
        return made

    return {
        "observable": advice.panel.name,
        "words": about.words,
        "relative": about.relative,
        "reference": about.reference,
        "uncertainty": advice.panel.reference()[2],
        "error": advice.error,
        "no_meaning": advice.no_meaning or None,
        "backend": "cuda" if advice.kind == "gpu" else "cpu",
        "answer": plain(choice),
        "peer": plain(advice.peer),
        "measured_on": advice.panel.where(advice.kind == "gpu"),
        "scene": None,
    }
