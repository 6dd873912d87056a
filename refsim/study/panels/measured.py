"""Panels measured here: every setting several times, in turns, until its seconds settle."""

import datetime
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import msgspec
import numpy as np

from refsim.backends.arrays import device_name, require_backend
from refsim.core.errors import InputError
from refsim.core.tables import in_bytes, table
from refsim.core.versions import versions
from refsim.scene.plan import make_plan
from refsim.study.choice import REPEATS, duration, middle, percent, unsettled
from refsim.study.observables import Observable, observable_of
from refsim.study.panels import OWN, Panel, Place, Point
from refsim.study.panels.scenes import scene_of
from refsim.study.runs import Reading, Setting, machine, measure

MOST = 3  # times REPEATS readings, after which seconds that have not settled are left
PATIENCE = 20.0  # seconds that a setting has taken, after which they are, too
MISSING = "missing: "  # how the reason begins of a program that is not installed
Read = Callable[[Point, int, int], Reading]
BARS = np.logspace(-4, -0.3, 75).tolist() + [0.1, 0.05, 0.01, 0.005, 0.001]  # errors of Point.reached


@dataclass(frozen=True)
class Measured:
    """A panel measured here, beside the stored one."""

    stored: Panel
    here: Panel
    left_out: tuple[str, ...]

    def rows(self) -> list[dict[str, Any]]:
        """One row for each setting, as plain values; `stored_...` are those on file."""
        rows = []
        for key, point in self.here.points.items():
            old = self.stored.points[key]
            rows.append(
                {
                    "key": key, "setting": point.words, "failed": point.failed,
                    "value": point.value, "value_mad": point.value_mad, "error": self.stored.error(point),
                    "seconds": middle(point.seconds)[0], "unsettled": unsettled(point.noise or point.seconds),
                    "bytes": point.bytes, "particles": point.particles, "steps": point.steps,
                    "stored_value": old.value, "stored_value_mad": old.value_mad,
                    "stored_error": self.stored.error(old), "stored_seconds": middle(old.seconds)[0],
                }
            )  # fmt: skip
        return rows

    def text(self) -> str:
        """The table for a terminal."""
        value, _, uncertainty = self.stored.reference()
        rows, failed = [], []
        for row in self.rows():
            if row["failed"]:
                failed.append(f"{row['setting']}: {row['failed']}")
                continue
            old = row["stored_value"]
            rows.append(
                (
                    row["setting"], f"{row['value']:.6g}", percent(row["error"]), "-" if old is None else f"{old:.6g}",
                    duration(row["seconds"]) + ("" if not row["unsettled"] else " (not settled)"),
                    duration(row["stored_seconds"]), "-" if row["bytes"] is None else in_bytes(row["bytes"]),
                    f"{row['particles']:,}",
                )
            )  # fmt: skip
        head = ("setting", "value", "error", "stored value", "seconds", "stored seconds", "memory", "particles")
        about = self.stored.about
        known = f" (± {percent(uncertainty)}: {about.uncertain})" if uncertainty else ""
        lines = [
            f"{about.words}: {about.observed}",
            f"reference {value:.6g}{known}: {about.reference}",
            "",
            table(rows, head, right=range(1, len(head))),
            *failed,
            *self.left_out,
        ]
        return "\n".join(lines)


def observable(name: str) -> str:
    """The panel's observable as `refsim study` takes it."""
    return f"panel:{name}"


def measured(
    panel: Panel, keys: Iterable[str] = (), *, backend: str = "cpu", threads: int = 1,
    readings: int = REPEATS, say: Callable[[str], None] = lambda text: None, read: Read | None = None,
) -> Measured:  # fmt: skip
    """Measure settings of a panel anew; all of this backend by default.

    Each has `readings` readings, in turns with the others, and more of them where its seconds have not settled. `read`
    gives the reading of a point by its number and threads, by default from the packaged scene; one that begins with
    "missing: " leaves the point out. Raises InputError for an unknown key and a backend that is not there.
    """
    require_backend(backend)
    own = (p for p in panel.points.values() if p.program == OWN)
    chosen = list(keys) or [p.key for p in own if p.knobs.get("backend", "cpu") == backend]
    if unknown := [key for key in chosen if key not in panel.points]:
        raise InputError(f"panel {panel.name!r} has no setting {unknown[0]!r}; it has {', '.join(panel.points)}.")
    read = read or partial(_reading, panel)
    runs: dict[str, list[Reading]] = {key: [] for key in chosen}
    order, waiting = np.random.default_rng(0), list(runs)
    for turn in range(readings * (MOST if readings >= REPEATS else 1)):
        for key in order.permutation(waiting).tolist():
            runs[key].append(read(panel.points[key], len(runs[key]) % readings, threads))
            last = runs[key][-1]
            say(f"{panel.points[key].words}: {last.failed or f'{last.value:.6g} in {duration(last.seconds)}'}")
        if turn + 1 >= readings:
            spent = {key: [run.seconds for run in runs[key]] for key in waiting}
            waiting = [
                key for key in waiting
                if unsettled(_noise(spent[key], readings) or spent[key]) and sum(spent[key]) < PATIENCE
            ]  # fmt: skip
        waiting = [key for key in waiting if not runs[key][-1].failed]
    places = (*panel.places, _here(backend, threads))
    refused = {key: why for key, (first, *_) in runs.items() if (why := first.failed.partition(MISSING)[2])}
    points = {
        key: _point(panel, panel.points[key], found, len(places) - 1, readings)
        for key, found in runs.items() if key not in refused
    }  # fmt: skip
    left_out = tuple(f"{panel.points[key].words} left out: {why}" for key, why in refused.items())
    return Measured(panel, replace(panel, places=places, points=points), left_out)


def merged(found: Measured) -> Panel:
    """The stored panel with what was measured here in place of what it had."""
    points = {key: found.here.points.get(key, point) for key, point in found.stored.points.items()}
    return replace(found.stored, places=found.here.places, points=points)


def _reading(panel: Panel, point: Point, number: int, threads: int) -> Reading:
    scene = scene_of(panel, point, number)
    assert scene is not None
    backend = str(point.knobs.get("backend", "cpu"))
    setting = Setting("panel", point.words, 1.0, scene, backend)
    try:
        reads: Observable = observable_of(observable(panel.name), make_plan(scene))
    except InputError as error:
        return Reading(math.nan, 0.0, 0.0, 0, 0, 0, 0.0, failed=str(error))
    return measure(setting, reads, panel.about.reaches, threads, repeats=1)


def _noise(seconds: Sequence[float], readings: int) -> list[float]:
    """Seconds over the median of the same reading's, whose start may cost more; empty where each was read once."""
    if len(seconds) < 2 * readings:
        return []
    return [spent / middle(seconds[k % readings :: readings])[0] for k, spent in enumerate(seconds)]


def _point(panel: Panel, point: Point, runs: Sequence[Reading], place: int, readings: int) -> Point:
    failed = next((run.failed for run in runs if run.failed), "")
    same = Point(
        point.key, point.words, place, point.knobs, setting=point.setting, particles=runs[0].particles,
        steps=runs[0].steps, program=point.program,
    )  # fmt: skip
    if failed:
        return msgspec.structs.replace(same, failed=failed, spent=runs[-1].seconds)
    value, scale, _ = panel.reference()
    curves = [[(s, abs(v - value) / scale) for s, v in run.curve] for run in runs] if panel.about.falls else []
    until = [run.seconds if not curves else _until(curve) for run, curve in zip(runs, curves or [[]] * len(runs))]
    scene = scene_of(panel, point)
    held = same.particles * sum(make_plan(scene).field_bytes().values()) if scene else runs[-1].bytes or None
    (middle_value, value_mad), (error, error_mad) = (
        middle([run.value for run in runs]), middle([abs(run.value - value) / scale for run in runs])
    )  # fmt: skip
    return msgspec.structs.replace(
        same, value=middle_value, value_mad=value_mad, error=error, error_mad=error_mad, seconds=until,
        noise=_noise(until, readings), bytes=held,
        step_seconds=middle([run.seconds / max(run.steps, 1) for run in runs])[0], reached=_reached(curves),
    )  # fmt: skip


def _first(curve: Sequence[tuple[float, float]], bar: float) -> float | None:
    """Seconds from which on no error is above `bar`; None where the last one is."""
    above = [k for k, (_, error) in enumerate(curve) if not error <= bar]
    first = above[-1] + 1 if above else 0
    return curve[first][0] if first < len(curve) else None


def _until(curve: Sequence[tuple[float, float]]) -> float:
    """Seconds to the error that the run keeps: its largest in the last third."""
    keeps = max(error for _, error in curve[int(2 / 3 * len(curve)) :])
    return _first(curve, keeps) or 0.0


def _reached(curves: Sequence[Sequence[tuple[float, float]]]) -> list[tuple[float, float]]:
    """(error, median seconds until all runs keep it for good), through all of the last third."""
    found = []
    for bar in sorted(BARS, reverse=True) if curves else ():
        late = max(error for curve in curves for _, error in curve[int(2 / 3 * len(curve)) :])
        if late <= bar:
            found.append((round(bar, 6), middle([_first(curve, bar) or 0.0 for curve in curves])[0]))
    return found


def _here(backend: str, threads: int) -> Place:
    today = datetime.date.today().isoformat()
    device = device_name() if backend == "cuda" else ""
    return Place(machine().partition(",")[0], threads, today, device=device, versions=dict(versions()))


def broken(panel: Panel) -> list[str]:
    """Bars of the panel that its points break, a sentence each."""
    said = []
    for key, (most, why) in panel.about.bars.items():
        point = panel.points.get(key)
        error = math.nan if point is None else panel.error(point)
        if not error <= most:
            said.append(f"{panel.name}, {key}: error {error:.3g} above {most:g} ({why})")
    return said
