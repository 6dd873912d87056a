"""What an accuracy costs: for each observable and error, the cheapest setting that was measured, and what rules choose.

`python -m validation accuracy --write` makes of the stored panels (`figures/accuracy_cost_*.json*`) the table and the
pictures of docs/accuracy_cost.md, and the table that `refsim advise` reads, refsim/study/answers.json.

The rules, for one observable, one error and one kind of machine:

1. A setting is a candidate if it keeps the error, was not stopped, computes the scene with all its effects and no more,
   and nothing speaks against it elsewhere (`validation.accuracy.elsewhere`).
2. A step beyond the stable one is no candidate: the runner gives a note on it.
3. float64 is no candidate where float32 with the same knobs has the same error within its noise, or 1 %.
4. Of the candidates whose timing has settled (`validation.work_precision.unsettled`) the fastest is advised. Where none
   has settled, none is advised.
   Timings are those of equal runs: where starts differ in what they cost, the range of the starts stands beside.
5. A settled candidate is not advised either where an unsettled one is faster beyond its scatter: where the slowest
   reading of that one is below the fastest reading of the settled one. The cheaper one is then named with its readings.
6. A setting that keeps an error which a finer spacing with the same other knobs does not keep is no candidate for it:
   errors of opposite sign cancel there.
7. An error below the uncertainty of the reference is marked as such.

Table, pictures, `refsim advise` and the sentence of a panel (`validation.accuracy.advice`) all ask `choose`.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from refsim.study.advice import percent as percent
from validation.reading import first_kept, kept_error
from validation.results import real
from validation.work_precision import SAME, error_verdict, middle, unsettled

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "figures"
SCHEMA = "refsim answers, version 1"
TARGETS = (0.1, 0.05, 0.01, 0.001)
TWO_GRIDS = 3.0  # safety factor of the grid convergence index where the order is assumed, not observed (Roache 1994)
Point = Mapping[str, Any]


@dataclass(frozen=True)
class Reference:
    """A converged value in place of the panel's own reference: Richardson's limit of two spacings, order assumed."""

    coarse: str
    fine: str
    order: float

    def among(self, points: Mapping[str, Point]) -> bool:
        """Whether both spacings were measured; --quick leaves them out."""
        return self.coarse in points and self.fine in points

    def limit(self, points: Mapping[str, Point]) -> tuple[float, float]:
        """(the limit, its uncertainty): v_f + (v_f - v_c)/(r^p - 1), and TWO_GRIDS times the last term."""
        coarse, fine = points[self.coarse], points[self.fine]
        ratio = coarse["knobs"]["spacing"] / fine["knobs"]["spacing"]
        change = (real(fine["value"]) - real(coarse["value"])) / (ratio**self.order - 1.0)
        return real(fine["value"]) + change, TWO_GRIDS * abs(change)


@dataclass(frozen=True)
class Observable:
    """How a panel is answered.

    words      the observable
    relative   what an error of 1 is
    scale      the panel's error that is a relative error of 1; the uncertainty of its band likewise
    unit       of the panel's own error, beside the relative one
    method     knob whose values are lines of the picture
    converged  a converged value that errors are taken from, in place of the panel's own reference
    more       errors in the table beside TARGETS
    remark     what the reader must know, one sentence
    meaning    why an error at most as large as this has no meaning: (error, why)
    scene      knobs -> a Scene; None where there is none
    page       of docs/ that explains it
    other_scenes  how the keys of settings begin that compute another scene: with an effect more, or one less
    stated     relative error that the panel's sentence is about; None for the panel's own
    """

    words: str
    relative: str
    scale: float = 1.0
    unit: str = ""
    method: str = "backend"
    converged: Reference | None = None
    more: tuple[float, ...] = ()
    remark: str = ""
    meaning: tuple[float, str] | None = None
    scene: Callable[[Mapping[str, Any]], Any] | None = None
    page: str = ""
    other_scenes: tuple[str, ...] = ()
    stated: float | None = None


def _front_scene(knobs: Mapping[str, Any]) -> Any:
    import msgspec

    from validation.experiments.dam_break.runs import GRAVITY, HEIGHT, column_scene

    scene = column_scene(round(0.5 * HEIGHT / knobs["spacing"]), 1, 15.0)
    end = 4.6 / math.sqrt(2 * GRAVITY / (0.5 * HEIGHT))
    return msgspec.structs.replace(scene, dtype=knobs["dtype"], step_factor=knobs["step"], end_time=end)


def _drop_scene(knobs: Mapping[str, Any]) -> Any:
    import msgspec

    from refsim import Box
    from validation.experiments.droplet.accuracy_runs import UNTIL, drop_scene

    side = round(1 / knobs["spacing"])
    scene = drop_scene(side, knobs["dtype"])
    block = Box(lower=(-0.5, -0.5, -0.5), cells=(side, side, side))
    return msgspec.structs.replace(scene, fluid=(block,), step_factor=knobs["step"], end_time=UNTIL)


def _floating_scene(knobs: Mapping[str, Any]) -> Any:
    import msgspec

    from validation.experiments.melting import float_runs

    cells = round(float_runs.EDGE / knobs["spacing"])
    scene = float_runs.scene(cells, knobs["half_width"], knobs["dtype"], knobs["step"])
    return msgspec.structs.replace(scene, end_time=float_runs.SETTLED + 1.0)


_PROBE = "which particles are surface depends on the radius of the probe (1.2 spacings, a convention)"
OBSERVABLES: dict[str, Observable] = {
    "front": Observable(
        "surge front of a 2D dam break",
        "of the front's position",
        unit="column widths",
        converged=Reference("d28", "d40", 1.0),
        remark="the position is the mean between t sqrt(2g/L) = 1 and 3, judged against refsim's own converged front;"
        " the experiments differ from each other by 10.8 %, and an error below that is none of the flow",
        scene=_front_scene,
        stated=0.05,
        other_scenes=("detection", "water"),
        page="sph.md",
    ),
    "droplet": Observable(
        "roundness of a drop that was a cube",
        "of the drop's radius",
        unit="radius variation",
        method="program",
        more=(0.005,),
        scene=_drop_scene,
        other_scenes=("effect_",),
        page="jiang_zhu_2023.md",
    ),
    "detection_2d": Observable(
        "surface detection, 2D splash of 7,200 particles",
        "of the surface particles (1 - F1)",
        unit="1 - F1",
        method="method",
        meaning=(0.01, _PROBE),
        page="surface_detection.md",
    ),
    "detection_3d": Observable(
        "surface detection, 3D collapse of 8,192 particles",
        "of the surface particles (1 - F1)",
        unit="1 - F1",
        method="method",
        meaning=(0.01, _PROBE),
        page="surface_detection.md",
    ),
    "heat": Observable(
        "temperature of a slab of 20 spacings",
        "of the range of temperatures",
        scale=100.0,
        unit="% rms",
        method="scheme",
        page="heat.md",
    ),
    "melt_front": Observable(
        "front of melting beside a hot wall, Stefan's problem",
        "of the melted depth",
        scale=100.0,
        unit="%",
        method="scheme",
        remark="the error is the largest of the last three quarters of the depth",
        page="heat.md",
    ),
    "melting": Observable(
        "time in which a ball of ice melts in warm water",
        "of the melt time",
        scale=100.0,
        unit="%",
        method="scheme",
        remark="particles stand still and conduct heat; for a block that melts, floats and flows see refsim study",
        page="heat.md",
    ),
    "spinning_body": Observable(
        "angular velocity of a shape-matched body, after two turns",
        "of its first angular velocity",
        method="scheme",
        page="shape_matching.md",
    ),
    "contact_angle": Observable(
        "contact angle of a 2D drop on a plane, 90 degrees requested",
        "of a right angle",
        scale=90.0,
        unit="degrees",
        method="model",
        more=(1 / 30,),
        meaning=(0.01, "the map of adhesion is known to 2.6 degrees"),
        page="contact_angle.md",
    ),
    "surface_tension_jump": Observable(
        "surface tension by the pressure jump of 2D drops",
        "of the model's flat tension",
        unit="R p/sigma - 1",
        method="model",
        meaning=(0.01, "Akinci's flat tension is known to 2.3 %"),
        page="sigma_map.md",
    ),
    "surface_tension_frequency": Observable(
        "surface tension by the frequency of 2D drops",
        "of Rayleigh's frequency with the flat tension",
        unit="f/f_Rayleigh - 1",
        method="model",
        meaning=(0.01, "Akinci's flat tension is known to 2.3 %, the frequency to half of that"),
        page="sigma_map.md",
    ),
    "tank_pressure": Observable(
        "pressure of a tank whose walls are a mesh",
        "of the pressure at the bottom, rho g H",
        unit="rms of p/(rho g H)",
        method="dtype",
        page="boundary_akinci_2012.md",
    ),
    "implicit_pressure": Observable(
        "pressure of a tank, implicit or weakly compressible",
        "of the pressure at the bottom, rho g H",
        unit="rms of p/(rho g H)",
        method="pressure",
        remark="farther than h from walls and surface; next to a wall the implicit pressure is two to three times as"
        " large",
        page="iisph.md",
    ),
    "coupling": Observable(
        "a box of half the water's density that floats",
        "of the box's edge",
        unit="height over the water's level in edges",
        method="scheme",
        meaning=(0.01, "the water's level is known to a fraction of a spacing"),
        scene=_floating_scene,
        page="two_way_coupling.md",
    ),
    "mpm_pressure": Observable(
        "pressure of an MPM disc at rest",
        "of Laplace's pressure k/R",
        unit="p/(k/R) - 1",
        method="way",
        page="mpm_droplet.md",
    ),
    "mpm_frequency": Observable(
        "frequency of an MPM disc that swings",
        "of Rayleigh's frequency",
        unit="f/f_Rayleigh - 1",
        method="way",
        meaning=(0.001, "its amplitude of 5 % and its compressibility lower the frequency by 0.3 %"),
        page="mpm_droplet.md",
    ),
    "surface_normals": Observable(
        "normals on a reconstructed sphere",
        "of a radian",
        scale=math.degrees(1.0),
        unit="degrees",
        method="normals",
        page="surface_energy.md",
    ),
    "boundary_sampling": Observable(
        "evenness of boundary particles on a mesh",
        "of the mean distance to the nearest particle",
        unit="variation",
        method="dtype",
        meaning=(0.001, "no even spread of particles exists on a closed curved surface"),
        page="boundary_sampling.md",
    ),
    "signed_distance": Observable(
        "signed distance from a ball of 82,000 triangles",
        "of the ball's radius of 1 m",
        unit="m rms",
        method="dtype",
        page="signed_distance.md",
    ),
}


def time_to(point: Mapping[str, Any], bar: float) -> dict[str, float] | None:
    """Median wall seconds (and their deviation) until the error is at most `bar` for good; None where it never is."""
    if point["stopped"]:
        return None
    if not point["curves"]:
        return {"seconds": point["seconds"], "mad": point["mad"]} if point["error"] <= bar else None
    found = []
    for curve in point["curves"]:
        error = [real(e) for e in curve["error"]]
        k = first_kept(error, bar)
        if k is None or not kept_error(error) <= bar:  # "for good" is through all of the last third
            return None
        found.append(curve["wall"][k])
    return dict(zip(("seconds", "mad"), middle(found)))


def is_peer(point: Mapping[str, Any]) -> bool:
    """Whether a point was measured with another program."""
    return str(point["knobs"].get("program", "refsim")) != "refsim"


def group_of(point: Mapping[str, Any], knob: str) -> str:
    """The name of another program, or the value of a knob."""
    return str(point["knobs"].get("program" if is_peer(point) else knob, ""))


def duration(seconds: float) -> str:
    """Seconds in words, three digits."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-6:.3g} us"


@dataclass(frozen=True)
class Candidate:
    """One point of a panel as the rules see it.

    error    relative
    own      the same in the observable's unit
    seconds  to a relative error; None where that is not reached
    """

    key: str
    point: Point
    error: float
    own: float
    seconds: Callable[[float], float | None]

    @property
    def unsettled(self) -> str:
        """Why the timing has not settled; "" where it has."""
        return unsettled(self.point["all_seconds"])

    @property
    def settled(self) -> bool:
        """Whether the timing has settled."""
        return not self.unsettled

    @property
    def scatter(self) -> tuple[float, float]:
        """Its fastest and slowest readings over the median."""
        return self._range(self.point["all_seconds"])

    @property
    def starts(self) -> tuple[float, float] | None:
        """The cheapest and the dearest start over the median, where starts differ by more than the timing."""
        seconds = self.point.get("starts")
        return self._range(seconds) if seconds and self.settled and unsettled(seconds) else None

    def _range(self, seconds: Sequence[float]) -> tuple[float, float]:
        median = real(self.point["seconds"])
        return (min(seconds) / median, max(seconds) / median) if seconds and median > 0 else (1.0, 1.0)


@dataclass(frozen=True)
class Choice:
    """What the rules say for one error.

    advised  the candidate, or None
    seconds  to the error
    why      why none is advised; "" for one
    notes    what was passed over, and what limits the answer
    read     where none is advised: the candidate that was read fastest; None where none reaches the error
    nearest  where none reaches the error: the one of the least error that is not kept by chance
    """

    advised: Candidate | None
    seconds: float = math.nan
    why: str = ""
    notes: tuple[str, ...] = field(default=())
    read: Candidate | None = None
    nearest: Candidate | None = None


def candidates(points: Mapping[str, Point], observable: Observable) -> list[Candidate]:
    """Points that came to an end, with relative errors."""
    made = []
    converged = observable.converged if observable.converged and observable.converged.among(points) else None
    limit = converged.limit(points)[0] if converged else math.nan
    for key, p in points.items():
        another = key.removeprefix("cuda_").startswith(observable.other_scenes)
        if another or not p["shown"] or p["stopped"] or p["error"] is None:
            continue
        if converged:
            error = abs(real(p["value"]) - limit) / abs(limit)
            wall = real(p["seconds"])
            own = error * abs(limit)
            made.append(Candidate(key, p, error, own, functools.partial(_whole, error, wall)))
        else:
            own = real(p["error"])
            made.append(Candidate(key, p, own / observable.scale, own, functools.partial(_to, p, observable.scale)))
    return made


def _whole(own: float, wall: float, error: float) -> float | None:
    """Seconds of a run that is judged at its end."""
    return wall if own <= error else None


def _to(point: Point, scale: float, error: float) -> float | None:
    """Seconds until a point keeps a relative error."""
    found = time_to(point, error * scale)
    return None if found is None else real(found["seconds"])


def uncertainty(points: Mapping[str, Point], observable: Observable, band: Mapping[str, Any] | None) -> float:
    """Relative uncertainty of the reference; 0 for an exact one."""
    if observable.converged and observable.converged.among(points):
        limit, spread = observable.converged.limit(points)
        return spread / abs(limit)
    return 0.0 if band is None else real(band["width"]) / observable.scale


def refused(candidate: Candidate, others: Sequence[Candidate]) -> str:
    """Why a candidate may not be advised, whatever its time; "" if it may."""
    p, knobs = candidate.point, candidate.point["knobs"]
    if p["elsewhere"]:
        return p["elsewhere"]
    if knobs.get("step", 1.0) > 1.0 and "scheme" not in knobs:
        return "the runner gives a note on a step beyond the stable one"
    if knobs.get("dtype") == "float64":
        same = {**knobs, "dtype": "float32"}
        for other in others:
            if other.point["knobs"] == same and error_verdict(other.point, p) == SAME:
                return "float32 has the same error"
    return ""


def observable_of(panel: str, title: str, group: str) -> Observable:
    """How a panel is answered; one without an entry in OBSERVABLES in its own unit."""
    return OBSERVABLES.get(panel) or Observable(title, "", method=group)


def by_chance(candidate: Candidate, error: float, others: Sequence[Candidate]) -> Candidate | None:
    """The candidate of a finer spacing, other knobs equal, that does not keep the error; None where there is none."""
    knobs = candidate.point["knobs"]
    for other in others:
        theirs = other.point["knobs"]
        finer = theirs.get("spacing", 0.0) < knobs.get("spacing", 0.0)
        if finer and {**theirs, "spacing": 0.0} == {**knobs, "spacing": 0.0} and other.error > error:
            return other
    return None


def choose(found: Sequence[Candidate], error: float, spread: float = 0.0) -> Choice:
    """The cheapest settled setting for a relative error; see the rules above."""
    allowed = [c for c in found if not refused(c, found)]
    if not found:
        return Choice(None, why="not measured")
    reach = [(seconds, c) for c in allowed if (seconds := c.seconds(error)) is not None]
    notes = []
    for pair in list(reach):
        finer = by_chance(pair[1], error, allowed)
        if finer is not None:
            reach.remove(pair)
            said = f"{pair[1].point['words']} keeps {percent(pair[1].error)} by chance"
            notes.append(f"passed over: {said}, {finer.point['words']} {percent(finer.error)}")
    if error < spread:
        notes.append(f"below the uncertainty of the reference ({percent(spread)})")
    if not reach:
        if not allowed:
            return Choice(None, why="not reached: no setting may be advised", notes=tuple(notes))
        best = min((c for c in allowed if by_chance(c, c.error, allowed) is None), key=lambda c: c.error)
        took = duration(real(best.point["seconds"]))
        why = f"not reached: {best.point['words']} keeps {percent(best.error)} after {took}"
        return Choice(None, why=why, notes=tuple(notes), nearest=best)
    settled = [(seconds, c) for seconds, c in reach if c.settled]
    least, nearest = min(reach, key=lambda pair: pair[0])
    fast, slow = (duration(least * share) for share in nearest.scatter)
    read = f"{nearest.point['words']} was read at {duration(least)} ({fast} to {slow}), but {nearest.unsettled}"
    if not settled:
        said = f"{len(reach)} settings reach it" if len(reach) > 1 else "one setting reaches it"
        return Choice(None, least, f"not advised: {said}, none in a settled time; {read}", tuple(notes), nearest)
    seconds, best = min(settled, key=lambda pair: pair[0])
    surely = [s * c.scatter[1] < seconds * best.scatter[0] for s, c in reach if not c.settled]
    if any(surely):
        later = f"{best.point['words']} in a settled {duration(seconds)} costs more"
        return Choice(None, least, f"not advised: {read}; {later}", tuple(notes), nearest)
    if least < seconds:
        notes.append(f"passed over: {read}")
    return Choice(best, seconds, notes=tuple(notes))


# The table


def report(panel: str, folder: Path = FIGURES) -> dict[str, Any]:
    """A stored panel. Raises OSError or ValueError where there is none."""
    from validation.drawing import read_data

    return read_data(folder, f"accuracy_cost_{panel}")


def answer(panel: str, data: Mapping[str, Any], observable: Observable) -> dict[str, Any]:
    """One observable's row, as plain values."""
    points = data["points"]
    found = candidates(points, observable)
    here = [c for c in found if "reported" not in c.point["knobs"] and not is_peer(c.point)]
    gpu = [c for c in found if "reported" in c.point["knobs"]]
    peers = [c for c in found if is_peer(c.point)]
    spread = uncertainty(points, observable, data["band"])
    cells = []
    for error in sorted({*TARGETS, *observable.more}, reverse=True):
        if observable.meaning and error <= observable.meaning[0]:
            cells.append({"error": error, "no_meaning": observable.meaning[1]})
            continue
        cells.append(
            {
                "error": error,
                "cpu": _cell(choose(here, error, spread), observable),
                "gpu": _cell(choose(gpu, error, spread), observable) if gpu else None,
                "peer": _peer(peers, error),
            }
        )
    return {
        "name": panel,
        "words": observable.words,
        "relative": observable.relative,
        "unit": observable.unit,
        "uncertainty": spread,
        "remark": observable.remark,
        "page": observable.page,
        "machine": _machines(data, False),
        "gpu": _machines(data, True),
        "dates": data["dates"],
        "answers": cells,
    }


def _machines(data: Mapping[str, Any], gpu: bool) -> str:
    found = []
    for place in data["where"]:
        if bool(place["device"]) != gpu:
            continue
        if gpu:
            found.append(f"{place['device'].get('name')}, {place.get('date')}")
        else:
            found.append(f"{place['processor']}, {place['threads']} threads")
    return "; ".join(dict.fromkeys(found))


def _cell(choice: Choice, observable: Observable) -> dict[str, Any]:
    if choice.advised is not None:
        return {**_setting(choice.advised, choice.seconds, observable), "notes": list(choice.notes)}
    made: dict[str, Any] = {"why": choice.why, "notes": list(choice.notes)}
    if choice.read is not None:
        fast, slow = (choice.seconds * share for share in choice.read.scatter)
        named = _setting(choice.read, choice.seconds, observable)
        made["read"] = {**named, "fastest": fast, "slowest": slow, "unsettled": choice.read.unsettled}
    if choice.nearest is not None:
        made["nearest"] = _named(choice.nearest, observable)
    return made


def _named(candidate: Candidate, observable: Observable) -> dict[str, Any]:
    return {
        "key": candidate.key,
        "setting": candidate.point["words"],
        "keeps": candidate.error,
        "keeps_own": f"{candidate.own:.2g} {observable.unit}".strip(),
    }


def _setting(chosen: Candidate, seconds: float, observable: Observable) -> dict[str, Any]:
    """A setting as plain values, with its scene where it has one."""
    p = chosen.point
    knobs = p["knobs"]
    made: dict[str, Any] = {
        **_named(chosen, observable),
        "seconds": seconds,
        "whole": real(p["per_step"]) * p["steps"] if p["curves"] else seconds,
        "bytes": None if p["bytes"] is None else p["bytes"] * p["particles"],
        "starts": [seconds * share for share in chosen.starts or ()],
    }
    if observable.scene and knobs.get("pair_mode", "all") == "all":
        from refsim.scene.files import scene_to_toml

        made["scene"] = scene_to_toml(observable.scene(knobs))
    return made


def _peer(peers: Sequence[Candidate], error: float) -> dict[str, Any] | None:
    """The fastest of other programs for the error; of times that have not settled, the range."""
    if not peers:
        return None
    choice = choose(peers, error)
    named = choice.advised or choice.read or choice.nearest
    program = {} if named is None else {"program": named.point["knobs"]["program"], "keeps": named.error}
    if choice.advised is None and choice.read is None:
        return {"why": choice.why, **program}
    if choice.advised is None:
        fast, slow = (choice.seconds * share for share in choice.read.scatter)
        return {"why": choice.why, "fastest": fast, "slowest": slow, **program}
    return {"setting": choice.advised.point["words"], "seconds": choice.seconds, **program}


def table(folder: Path = FIGURES) -> dict[str, Any]:
    """Everything that `refsim advise` knows."""
    rows = [answer(name, report(name, folder), observable) for name, observable in OBSERVABLES.items()]
    return {"schema": SCHEMA, "observables": rows}


def as_json(found: Mapping[str, Any]) -> str:
    """The packaged table."""
    return json.dumps(found, indent=1, allow_nan=False) + "\n"
