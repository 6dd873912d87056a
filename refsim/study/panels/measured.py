"""Panels measured here: every setting several times, in turns, on one thread."""

import datetime
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from refsim.backends.arrays import device_name, require_backend
from refsim.core.errors import InputError
from refsim.core.tables import in_bytes, table
from refsim.core.versions import versions
from refsim.scene.plan import make_plan
from refsim.scene.scene import Scene
from refsim.study.advice import READINGS, duration
from refsim.study.panels import GIVEN, OWN, Machine, Panel, Point
from refsim.study.panels.scenes import scene_of
from refsim.study.result import percent
from refsim.study.runs import Reading, Setting, machine, measure

MISSING = "missing: "  # how the reason begins of a program that is not installed
Read = Callable[[Point, int], Reading]


def measured(
    panel: Panel, keys: Iterable[str] = (), *, backend: str = "cpu", readings: int = READINGS,
    say: Callable[[str], None] = lambda text: None, read: Read | None = None, place: Machine | None = None,
) -> Panel:  # fmt: skip
    """The panel with settings measured anew, all of this backend by default, and no others.

    Each has `readings` readings, in turns with the others. `read` gives the reading of a point by its number, by
    default from the packaged scene; one that begins with "missing: " leaves the point out. `place` is where.
    Raises InputError for an unknown key and a backend that is not there.
    """
    require_backend(backend)
    of_refsim = (p for p in panel.points.values() if p.program == OWN)
    chosen = list(keys) or [p.key for p in of_refsim if p.knobs["backend"] == backend]
    if unknown := [key for key in chosen if key not in panel.points]:
        raise InputError(f"panel {panel.name!r} has no setting {unknown[0]!r}; it has {', '.join(panel.points)}.")
    read = read or (lambda point, number: reading_of(panel, point, scene_of(panel, point, number)))
    runs: dict[str, list[Reading]] = {key: [] for key in chosen}
    order, waiting = np.random.default_rng(0), list(runs)
    for number in range(readings):
        for key in order.permutation(waiting).tolist():
            runs[key].append(read(panel.points[key], number))
            last = runs[key][-1]
            say(f"{panel.points[key].words}: {last.failed or f'{last.value:.6g} in {duration([last.seconds])}'}")
        waiting = [key for key in waiting if not runs[key][-1].failed]
    places = (*panel.places, place or _here(backend))
    points = {
        key: _point(panel, panel.points[key], readings_of, len(places) - 1)
        for key, readings_of in runs.items() if not readings_of[0].failed.startswith(MISSING)
    }  # fmt: skip
    return replace(panel, places=places, points=points)


def merged(stored: Panel, measured_panel: Panel) -> Panel:
    """The stored panel with what was measured in place of what it had."""
    return replace(stored, places=measured_panel.places, points={**stored.points, **measured_panel.points})


def reading_of(panel: Panel, point: Point, scene: Scene) -> Reading:
    """What the panel's observable reads in one run of a point's scene."""
    setting = Setting("panel", point.words, 1.0, scene, point.knobs["backend"])
    return measure(setting, f"panel:{panel.name}", panel.about.reaches, 1, repeats=1)


def _point(panel: Panel, point: Point, runs: Sequence[Reading], place: int) -> Point:
    """The point with what its runs gave; nothing else that was measured of it stays."""
    found: dict[str, Any] = {"place": place, "particles": runs[0].particles, "steps": runs[0].steps}
    found |= {"seconds": [run.seconds for run in runs], "failed": next((run.failed for run in runs if run.failed), "")}
    if not found["failed"]:
        values = np.array([run.value for run in runs])
        for name, given in (("value", values), ("error", panel.reference().error(values))):
            found[name] = middle = float(np.median(given))
            found[f"{name}_mad"] = float(np.median(np.abs(given - middle)))
        held = sum(make_plan(scene_of(panel, point)).field_bytes().values()) if point.program == OWN else 0
        found["bytes"] = runs[0].particles * held if held else runs[-1].bytes or None
    return Point(**{name: getattr(point, name) for name in ("key", *GIVEN)}, **found)


def _here(backend: str) -> Machine:
    today = datetime.date.today().isoformat()
    device = device_name() if backend == "cuda" else ""
    return Machine(machine().partition(",")[0], 1, today, device=device, versions=dict(versions()))


def rows(stored: Panel, measured_panel: Panel) -> list[dict[str, Any]]:
    """One row for each setting that was measured, as plain values; `stored_...` are those on file."""
    told = ("key", "failed", "value", "value_mad", "seconds", "bytes", "particles", "steps")
    return [
        {name: getattr(point, name) for name in told} | {
            "setting": point.words, "error": stored.error(point), "stored_value": before.value,
            "stored_error": stored.error(before), "stored_seconds": before.seconds,
        }
        for point in measured_panel.points.values() for before in [stored.points[point.key]]
    ]  # fmt: skip


def text(stored: Panel, measured_panel: Panel) -> str:
    """The same as a table for a terminal."""
    about, of, cells, failed = stored.about, stored.reference(), [], []
    for row in rows(stored, measured_panel):
        if row["failed"]:
            failed.append(f"{row['setting']}: {row['failed']}")
            continue
        old, before = row["stored_value"], row["stored_seconds"]
        found = row["setting"], f"{row['value']:.6g}", percent(row["error"]), "-" if old is None else f"{old:.6g}"
        took = duration(row["seconds"]), duration(before) if before else "-"
        cells.append((*found, *took, "-" if row["bytes"] is None else in_bytes(row["bytes"]), f"{row['particles']:,}"))
    head = ("setting", "value", "error", "stored value", "seconds", "stored seconds", "memory", "particles")
    known = f" (± {percent(of.uncertainty)}: {about.uncertain})" if of.uncertainty else ""
    lines = [f"{about.words}: {about.observed}", f"reference {of.value:.6g}{known}: {of.words}", ""]
    return "\n".join([*lines, table(cells, head, right=range(1, len(head))), *failed])


def broken(panel: Panel) -> list[str]:
    """Bars of the panel that its points break, a sentence each."""
    return [
        f"{panel.name}, {key}: error {panel.error(panel.points[key]):.3g} above {most:g} ({why})"
        for key, (most, why) in panel.about.bars.items()
        if not panel.error(panel.points[key]) <= most
    ]
