"""What accuracy costs: `python -m validation accuracy [PANEL ...]`, panels measured anew beside their stored points.

A panel is measured as `refsim study PANEL --points` does, on one thread; other programs have runs in this repository.
`--write` stores what was measured and renews docs/accuracy_cost.md (`validation.accuracy_page`).
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from refsim.core.errors import InputError
from refsim.core.writing import write_file
from refsim.study.advice import READINGS
from refsim.study.panels import OWN, Panel, Place, abouts, as_text, panel
from refsim.study.panels.making import STIRRED
from refsim.study.panels.measured import Read, broken, measured, merged, text
from refsim.study.panels.scenes import stirred
from validation import accuracy_page
from validation.reading import environment
from validation.running import on_threads

STORED = Path(__file__).resolve().parent.parent / "refsim" / "study" / "panels"
PEERS = {  # the function of `panel_runs` that gives a reading of another program's point, of its number and threads
    "front": "front_by_splishsplash", "droplet": "drop_by_splishsplash", "implicit_pressure": "tank_by_pysph",
    "vortex_decay": "vortices_by_pysph", "surface_normals": "peer_normals",
    "boundary_sampling": "quality_by_splishsplash", "signed_distance": "distance_by_libigl",
}  # fmt: skip


def perform(
    names: Sequence[str], backend: str = "cpu", readings: int = READINGS, peers: bool = False, write: bool = False
) -> int:
    """Measure panels, all by default, print each beside its stored points, and say which bars it breaks (code 4)."""
    failed = False
    for name in names or abouts():
        stored = panel(name)
        found = measure(stored, backend, readings, peers)
        print(text(stored, found), flush=True)
        judged = merged(stored, found)
        for sentence in broken(judged):
            print(sentence, flush=True)
            failed = True
        if write:
            write_file(STORED / f"{name}.json", as_text(judged))
            if name in STIRRED and not peers:
                write_file(STORED / f"{name}.zip", stirred(judged))
    if write:
        panel.cache_clear()
        accuracy_page.write()
    return 4 if failed else 0


def measure(of: Panel, backend: str, readings: int, peers: bool = False) -> Panel:
    """All settings of a panel on a backend; with `peers` those of other programs instead."""
    read = reader(PEERS[of.name]) if peers and of.name in PEERS else None
    if peers and read is None:
        raise InputError(f"panel {of.name!r} has no points of other programs; leave --peers out.")
    points = (p for p in of.points.values() if (p.program != OWN) == peers)
    keys = [p.key for p in points if p.knobs["backend"] == backend]
    with on_threads(backend, 1):
        return measured(of, keys, backend=backend, readings=readings, read=read, place=_place(backend))


def reader(name: str) -> Read:
    """The reading of a point by a function of `panel_runs`, on one thread."""
    return lambda point, number: getattr(import_module("validation.panel_runs"), name)(point, number, 1)  # type: ignore


def _place(backend: str) -> Place:
    """Where and with what a reading is taken."""
    where = environment(1, backend)
    device, load = where["device"] or {}, where["load"]
    return Place(
        where["processor"], where["threads"], where["date"], where["commit"], device.get("name", ""),
        device.get("driver_version", ""), where["cores"], None if load is None else [load, load], where["versions"],
    )  # fmt: skip
