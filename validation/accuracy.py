"""What accuracy costs: `python -m validation accuracy [PANEL ...]`, panels measured anew beside their stored points.

A panel is measured as `refsim study PANEL --points` does; other programs have runs in this repository. `--write` stores
what was measured and renews docs/accuracy_cost.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from refsim.core.errors import InputError
from refsim.study.choice import REPEATS
from refsim.study.panels import OWN, Panel, Place, Point, abouts, as_text, panel
from refsim.study.panels.measured import Measured, Read, broken, measured, merged
from refsim.study.runs import Reading
from validation import accuracy_page
from validation.reading import environment
from validation.running import on_threads

STORED = Path(__file__).resolve().parent.parent / "refsim" / "study" / "panels"
BOUNDARY, SURFACE = "validation.experiments.boundary.runs", "validation.experiments.surface_reconstruction.runs"
PEERS = {  # what gives a reading of another program's point, of its number and threads
    "front": "validation.panel_runs:front_by_splishsplash",
    "droplet": "validation.panel_runs:drop_by_splishsplash",
    "implicit_pressure": "validation.panel_runs:tank_by_pysph",
    "vortex_decay": "validation.panel_runs:vortices_by_pysph",
    "surface_normals": f"{SURFACE}:peer_normals",
    "boundary_sampling": f"{BOUNDARY}:quality_by_splishsplash",
    "signed_distance": f"{BOUNDARY}:distance_by_libigl",
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
    where = PEERS.get(of.name) if peers else None
    if where is None and peers:
        raise InputError(f"panel {of.name!r} has no points of other programs; leave --peers out.")
    keys = [
        p.key for p in of.points.values() if (p.program != OWN) == peers and p.knobs.get("backend", "cpu") == backend
    ]
    given = {} if where is None else {"keys": keys, "read": reader(where)}
    with on_threads(backend, threads):
        found = measured(of, backend=backend, threads=threads, readings=repeats, **given)
    places = (*of.places, _place(environment(threads, backend)))
    return replace(found, here=replace(found.here, places=places))


def reader(where: str) -> Read:
    """The function "module:name" that gives a reading of a point; the first one of refsim's own is thrown away."""
    module, _, name = where.partition(":")
    once: Read = getattr(import_module(module), name)
    compiled: set[str] = set()

    def read(point: Point, number: int, threads: int | None) -> Reading:
        if point.program == OWN and point.key not in compiled:
            compiled.add(point.key)
            once(point, number, threads)
        return once(point, number, threads)

    return read


def _place(where: Mapping[str, Any]) -> Place:
    """Where and with what a reading was taken, from `validation.reading.environment`."""
    device, load = where["device"] or {}, where["load"]
    return Place(
        where["processor"], where["threads"], where["date"], where["commit"], device.get("name", ""),
        device.get("driver_version", ""), where["cores"], None if load is None else [load, load], where["versions"],
    )  # fmt: skip
