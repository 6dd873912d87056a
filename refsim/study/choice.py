"""Which measured setting is advised for an error: the rules, for one panel and one kind of machine.

1. A setting is a candidate if its error and the uncertainty of the reference together are within the error, and it
   was not stopped.
2. float64 is no candidate where float32 with the same knobs has the same error within its noise, or 1 %.
3. Of the candidates whose timing has settled (`unsettled`) the fastest is advised. Where none has settled, none is.
   Timings are those of equal runs: where starts differ in what they cost, the range of the starts stands beside.
4. A settled candidate is not advised either where an unsettled one is faster beyond its scatter: where the slowest
   reading of that one is below the fastest reading of the settled one. The cheaper one is then named with its readings.
5. A setting that has an error which a finer spacing with the same other knobs exceeds is no candidate for it:
   errors of opposite sign cancel there. Nor is one whose finer spacing stops in one of its runs.
6. Physics decides once: the error of a setting that was measured on a CPU and on a GPU is the larger one on both, and
   rules 2 and 5 hold for both machines by the settings that either has: what differs is seconds.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from refsim.study.panels import OWN, Panel, Point

REPEATS = 5  # fewer are no statistics
SCATTER = 0.05  # robust standard deviation over the median, above which a time is called unstable
SPREAD = 1.5  # the slow end (90 %) over the fast end (10 %) of the repeats, above which it is, too
NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
SURE = 3.0  # standard deviations that a difference must exceed
LEAST_ERROR = 0.01  # relative difference of two errors that does not matter


def middle(values: Sequence[float]) -> tuple[float, float]:
    """Median and median absolute deviation; NaN for no values."""
    if not len(values):
        return math.nan, math.nan
    median = float(np.median(values))
    return median, float(np.median(np.abs(np.asarray(values, dtype=float) - median)))


def instability(seconds: Sequence[float]) -> str:
    """Why a median of these times is not to be trusted; "" where it is."""
    if len(seconds) < REPEATS:
        return f"only {len(seconds)} of {REPEATS} repeats"
    median, deviation = middle(seconds)
    if not median > 0:
        return "no time passed"
    if NORMAL * deviation > SCATTER * median:
        return f"scatters by {100 * NORMAL * deviation / median:.0f} %"
    fast, slow = np.quantile(seconds, (0.1, 0.9))
    if slow > SPREAD * fast:
        return f"slow repeats take {slow / fast:.1f} times the fast ones"
    return ""


def unsettled(seconds: Sequence[float]) -> str:
    """Why a time is not advised: `instability`, or an interquartile range of SCATTER of the median or more; "" if
    neither."""
    why = instability(seconds)
    if why:
        return why
    low, median, high = np.quantile(seconds, (0.25, 0.5, 0.75))
    return "" if high - low < SCATTER * median else f"interquartile range {100 * (high - low) / median:.0f} %"


@dataclass(frozen=True, eq=False)
class Candidate:
    """One point of a panel as the rules see it; `error` and the `uncertainty` of its reference are relative."""

    point: Point
    error: float
    uncertainty: float = 0.0

    @property
    def most(self) -> float:
        """The largest error that the setting may have."""
        return self.error + self.uncertainty

    @property
    def wall(self) -> float:
        """Median seconds to the error that it keeps."""
        return middle(self.point.seconds)[0]

    def seconds(self, error: float) -> float | None:
        """Median seconds until it keeps a relative error; None where it does not."""
        if self.most > error:
            return None
        if self.point.reached:
            within = error * (1 + 1e-9) - self.uncertainty
            return next((s for bar, s in self.point.reached if bar <= within), None)
        return self.wall

    @property
    def unsettled(self) -> str:
        """Why the timing has not settled; "" where it has."""
        return unsettled(self.point.noise or self.point.seconds)

    @property
    def scatter(self) -> tuple[float, float]:
        """Its fastest and slowest readings over the median."""
        return self._range(self.point.noise or self.point.seconds)

    @property
    def starts(self) -> tuple[float, float] | None:
        """The cheapest and the dearest start over the median, where starts differ by more than the timing."""
        seconds = self.point.seconds
        return self._range(seconds) if not self.unsettled and unsettled(seconds) else None

    def _range(self, seconds: Sequence[float]) -> tuple[float, float]:
        median = middle(seconds)[0]
        return (min(seconds) / median, max(seconds) / median) if len(seconds) and median > 0 else (1.0, 1.0)


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
    notes: tuple[str, ...] = ()
    read: Candidate | None = None
    nearest: Candidate | None = None

    @property
    def named(self) -> Candidate | None:
        """The setting that the answer names."""
        return self.advised or self.read or self.nearest


def candidates(panel: Panel) -> list[Candidate]:
    """Points of the panel that came to an end."""
    uncertainty = panel.reference()[2]
    made = (Candidate(point, panel.error(point), uncertainty) for point in panel.points.values())
    return [candidate for candidate in made if math.isfinite(candidate.error)]


def kinds(panel: Panel) -> dict[str, list[Candidate]]:
    """Candidates by where they are advised, "cpu", "gpu" and "peer", with the larger error of both machines; "stopped":
    settings of which a run stopped, with an infinite error."""
    made: dict[str, list[Candidate]] = {"cpu": [], "gpu": [], "peer": []}
    made["stopped"] = [Candidate(p, math.inf) for p in panel.points.values() if p.failed and p.program == OWN]
    found = candidates(panel)
    largest: dict[str, float] = {}
    for c in found:
        largest[_setting(c)] = max(c.error, largest.get(_setting(c), 0.0))
    for c in found:
        kind = "peer" if c.point.program != OWN else "gpu" if c.point.gpu else "cpu"
        made[kind].append(Candidate(c.point, largest[_setting(c)], c.uncertainty))
    return made


def physics(found: Mapping[str, Sequence[Candidate]]) -> list[Candidate]:
    """Each setting of `kinds` once, whatever it ran on."""
    return list({_setting(c): c for kind in ("stopped", "gpu", "cpu") for c in found[kind]}.values())


def sound(found: Sequence[Candidate], known: Sequence[Candidate]) -> dict[Candidate, Candidate]:
    """Candidates that are not refused, each with what it is judged by: the same setting among those `known`."""
    same = {_setting(c): c for c in known}
    pairs = ((c, same.get(_setting(c), c)) for c in found)
    return {c: judged for c, judged in pairs if not refused(judged, known)}


def _setting(candidate: Candidate) -> str:
    """The key of a setting, whatever it ran on."""
    return candidate.point.key.removeprefix("cuda_")


def refused(candidate: Candidate, others: Sequence[Candidate]) -> str:
    """Why a candidate may not be advised, whatever its time; "" if it may."""
    point, knobs = candidate.point, candidate.point.knobs
    if knobs.get("dtype") == "float64":
        same = {**knobs, "dtype": "float32"}
        for other in others:
            noise = SURE * NORMAL * math.hypot(point.error_mad, other.point.error_mad)
            if other.point.knobs == same and abs(other.error - candidate.error) <= max(
                noise, LEAST_ERROR * other.error
            ):
                return "float32 has the same error"
    return ""


def by_chance(candidate: Candidate, error: float, others: Sequence[Candidate]) -> Candidate | None:
    """The candidate of a finer spacing, other knobs equal, that does not keep the error; None where there is none."""
    knobs = candidate.point.knobs
    for other in others:
        theirs = other.point.knobs
        finer = theirs.get("spacing", 0.0) < knobs.get("spacing", 0.0)
        if finer and {**theirs, "spacing": 0.0} == {**knobs, "spacing": 0.0} and other.most > error:
            return other
    return None


def choose(found: Sequence[Candidate], error: float, known: Sequence[Candidate] | None = None) -> Choice:
    """The cheapest settled setting for a relative error; see the rules above.

    known  `physics`; those found, if left out
    """
    allowed = sound(found, found if known is None else known)
    judges = list(allowed.values()) if known is None else list(sound(known, known))
    if not found:
        return Choice(None, why="not measured")
    reach = [(seconds, c) for c in allowed if (seconds := c.seconds(error)) is not None]
    notes = []
    for pair in list(reach):
        finer = by_chance(allowed[pair[1]], error, judges)
        if finer is not None:
            reach.remove(pair)
            said = f"{pair[1].point.words} has an error of {percent(pair[1].error)} by chance"
            found_there = "stops" if finer.point.failed else f"of {percent(finer.error)}"
            notes.append(f"passed over: {said}, {finer.point.words} {found_there}")
    if not reach:
        if not allowed:
            return Choice(None, why="not reached: no setting may be advised", notes=tuple(notes))
        lasting = [c for c, by in allowed.items() if by_chance(by, c.most, judges) is None]
        if not lasting:
            return Choice(None, why="not reached: all settings have their errors by chance", notes=tuple(notes))
        best = min(lasting, key=lambda c: c.error)
        why = f"not reached: {best.point.words} has an error of {percent(best.most)} after {duration(best.wall)}"
        return Choice(None, why=why, notes=tuple(notes), nearest=best)
    settled = [(seconds, c) for seconds, c in reach if not c.unsettled]
    least, nearest = min(reach, key=lambda pair: pair[0])
    fast, slow = (duration(least * share) for share in nearest.scatter)
    read = f"{nearest.point.words} was read at {duration(least)} ({fast} to {slow}), but {nearest.unsettled}"
    if not settled:
        said = f"{len(reach)} settings reach it" if len(reach) > 1 else "one setting reaches it"
        return Choice(None, least, f"not advised: {said}, none in a settled time; {read}", tuple(notes), nearest)
    seconds, best = min(settled, key=lambda pair: pair[0])
    if any(s * c.scatter[1] < seconds * best.scatter[0] for s, c in reach if c.unsettled):
        later = f"{best.point.words} in a settled {duration(seconds)} costs more"
        return Choice(None, least, f"not advised: {read}; {later}", tuple(notes), nearest)
    if least < seconds:
        notes.append(f"passed over: {read}")
    return Choice(best, seconds, notes=tuple(notes))


def least_error(found: Sequence[Candidate], seconds: float, known: Sequence[Candidate]) -> float | None:
    """The least error for which a settled setting is advised within so many seconds; None where there is none."""
    allowed, judges = sound(found, known), list(sound(known, known))
    least: list[float] = []
    for c, by in allowed.items():
        curve = c.point.reached or [(c.error, c.wall)]
        kept = [max(error, c.error) + c.uncertainty for error, spent in curve if spent <= seconds]
        if kept and not c.unsettled and by_chance(by, min(kept), judges) is None:
            least.append(min(kept))
    return min(least, default=None)


def percent(value: float) -> str:
    """A share in per cent, two digits."""
    return f"{float(f'{100 * value:.2g}'):g} %"


def duration(seconds: float) -> str:
    """Seconds in words, three digits."""
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-6:.3g} us"
