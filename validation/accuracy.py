"""What accuracy costs: `python -m validation accuracy [PANEL ...]`, panels measured anew beside their stored points.

A panel with a packaged scene is measured as `refsim study PANEL --points` does; the others, and other programs, have
runs in this repository. `--write` stores what was measured and renews docs/accuracy_cost.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim.core.errors import InputError
from refsim.study.choice import REPEATS
from refsim.study.panels import OWN, Panel, Place, Point, abouts, as_text, panel
from refsim.study.panels.measured import Measured, broken, measured, merged
from refsim.study.panels.scenes import packaged
from validation import accuracy_page
from validation.reading import environment
from validation.results import Result, finite
from validation.running import Context

STORED = Path(__file__).resolve().parent.parent / "refsim" / "study" / "panels"
BOUNDARY = "validation.experiments.boundary"
RUNS = {  # panel: its run, called with (context, settings, backend, threads, repeats)
    "contact_angle": "validation.panel_runs.drops:angles",
    "surface_tension_jump": "validation.panel_runs.drops:tensions",
    "surface_tension_frequency": "validation.panel_runs.drops:tensions",
    "surface_normals": "validation.experiments.surface_reconstruction.runs:normals",
    "boundary_sampling": f"{BOUNDARY}.runs:quality",
    "signed_distance": f"{BOUNDARY}.runs:distance",
}
PEERS = {  # panel: its run by another program, called with (context, settings, threads, repeats)
    "front": "validation.panel_peers:fronts",
    "droplet": "validation.panel_peers:drops",
    "surface_normals": "validation.experiments.surface_reconstruction.runs:peer_normals",
    "boundary_sampling": f"{BOUNDARY}.runs:quality_by_splishsplash",
    "signed_distance": f"{BOUNDARY}.runs:distance_by_libigl",
}


def perform(
    names: Sequence[str], backend: str = "cpu", threads: int | None = None, repeats: int = REPEATS,
    peers: bool = False, write: bool = False,
) -> int:  # fmt: skip
    """Measure panels, all by default, print each beside its stored points, and say which bars it breaks (code 4)."""
    failed = False
    for name in names or abouts():
        found = measure(panel(name), backend, threads, repeats, peers)
        print(found.text(), flush=True)
        judged = merged(found)
        for sentence in broken(judged):
            print(sentence, flush=True)
            failed = True
        if write:
            (STORED / f"{name}.json").write_text(as_text(judged))
    if write:
        panel.cache_clear()
        accuracy_page.write()
    return 4 if failed else 0


def measure(of: Panel, backend: str, threads: int | None, repeats: int, peers: bool = False) -> Measured:
    """All settings of a panel on a backend; with `peers` those of other programs instead."""
    if not peers and packaged(of.name) is not None:
        found = measured(of, backend=backend, threads=threads, readings=repeats)
        places = (*of.places, _place(environment(threads, backend)))
        return replace(found, here=replace(found.here, places=places))
    where = (PEERS if peers else RUNS).get(of.name)
    if where is None:
        raise InputError(f"panel {of.name!r} has no points of other programs; leave --peers out.")
    chosen = [p for p in of.points.values() if (p.program != OWN) == peers and p.knobs.get("backend", "cpu") == backend]
    settings = {p.key: {"knobs": p.knobs, **p.setting} for p in chosen}
    run = _run(where)
    result = run(Context(), settings, threads or 2, repeats) if peers else run(
        Context(), settings, backend, threads, repeats
    )  # fmt: skip
    return beside(of, result)


def _run(where: str) -> Callable[..., Result]:
    module, _, name = where.partition(":")
    made: Callable[..., Result] = getattr(import_module(module), name)
    return made


def beside(of: Panel, result: Result) -> Measured:
    """What a run gave, as points beside the stored ones; what is not installed is left out with its reason."""
    places = (*of.places, _place(result.values["where"]))
    points, left_out = {}, []
    for reading in result.values["readings"]:
        old = of.points[reading["key"]]
        if reading["stopped"].startswith("missing: "):
            left_out.append(f"{old.words} left out: {reading['stopped'].removeprefix('missing: ')}")
        else:
            points[old.key] = _point(of, old, finite(reading), len(of.places))
    return Measured(of, replace(of, places=places, points=points), tuple(left_out))


def _place(where: Mapping[str, Any]) -> Place:
    """Where and with what a reading was taken, from `validation.reading.environment`."""
    device, load = where["device"] or {}, where["load"]
    return Place(
        where["processor"], where["threads"], where["date"], where["commit"], device.get("name", ""),
        device.get("driver_version", ""), where["cores"], None if load is None else [load, load], where["versions"],
    )  # fmt: skip


def _point(of: Panel, old: Point, reading: Mapping[str, Any], place: int) -> Point:
    """A reading as a point; its error is relative."""
    kept = msgspec.structs.replace(
        Point(old.key, old.words, place, old.knobs), program=old.program, setting=old.setting, shown=old.shown,
        speaks_against=old.speaks_against, against=old.against, particles=reading["particles"],
    )  # fmt: skip
    if reading["stopped"]:
        return msgspec.structs.replace(kept, failed=reading["stopped"], spent=float(np.mean(reading["seconds"])))
    value, scale, _ = of.reference()
    own = reading["bytes"]
    return msgspec.structs.replace(
        kept, value=reading["value"], seconds=reading["seconds"], noise=list(reading["noise"]),
        error=math.nan if reading["value"] is None else abs(reading["value"] - value) / scale, steps=reading["steps"],
        step_seconds=sorted(reading["per_step"])[len(reading["per_step"]) // 2],
        bytes=None if own is None else own * reading["particles"],
    )  # fmt: skip
