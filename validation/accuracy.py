"""What accuracy costs: `python -m validation accuracy [PANEL ...]`, panels measured anew beside their stored points.

A panel is measured as `refsim study PANEL --points` does, on one thread; other programs have runs in this repository.
`--write` stores what was measured and renews docs/study.md (`validation.accuracy_page`).
"""

import io
import zipfile
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

import msgspec
import numpy as np

from refsim.core.errors import InputError
from refsim.core.writing import write_file
from refsim.scene.files import scene_to_toml
from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud
from refsim.study.advice import READINGS
from refsim.study.panels import OWN, Machine, Panel, Point, abouts, as_text, panel
from refsim.study.panels.measured import Read, broken, measured, merged, reading_of, text
from refsim.study.panels.scenes import PACKED, packed
from validation import accuracy_page
from validation.measure import drops, wetting
from validation.reading import environment
from validation.running import on_threads

STORED = Path(__file__).resolve().parent.parent / "refsim" / "study" / "panels"
DIGITS = 6  # of the places and velocities of stirred drops, whose spacing is 1


def perform(
    names: Sequence[str], backend: str = "cpu", readings: int = READINGS, peers: bool = False, write: bool = False
) -> int:
    """Measure panels, all by default, print each beside its stored points, and say which bars it breaks (code 4)."""
    failed = False
    for name in names or abouts():
        stored = panel(name)
        measurements = measure(stored, backend, readings, peers)
        print(text(stored, measurements), flush=True)
        judged = merged(stored, measurements)
        failed |= bool(sentences := broken(judged))
        print("".join(f"{sentence}\n" for sentence in sentences), end="", flush=True)
        if write:
            write_file(STORED / f"{name}.json", as_text(judged))
            if name in PACKED and not peers:
                write_file(STORED / f"{name}.zip", stirred(judged))
    if write:
        panel.cache_clear()
        accuracy_page.write()
    return 4 if failed else 0


def measure(of: Panel, backend: str, readings: int, peers: bool = False) -> Panel:
    """All settings of a panel on a backend; with `peers` those of other programs instead."""
    read: Read | None = getattr(import_module("validation.panel_runs"), of.name, None) if peers else None
    if peers and read is None:  # read by the function of `panel_runs` that is called as the panel
        raise InputError(f"panel {of.name!r} has no points of other programs; leave --peers out.")
    if not peers and of.name in PACKED:
        read = lambda point, number: reading_of(of, point, stirred_scene(of, point, number))  # noqa: E731
    points = (p for p in of.points.values() if (p.program != OWN) == peers)
    keys = [p.key for p in points if p.knobs["backend"] == backend]
    with on_threads(backend, 1):
        return measured(of, keys, backend=backend, readings=readings, read=read, place=_place(backend))


def stirred_scene(of: Panel, point: Point, number: int = 0) -> Scene:
    """The scene of a drop that is stirred anew."""
    made = getattr(wetting if of.name == "contact_angle" else drops, of.name)
    return made({**point.knobs, **point.setting}, number)  # type: ignore[no-any-return]


def stirred(of: Panel) -> bytes:
    """NAME.zip of a panel of stirred drops: the scene of each setting that runs on a CPU, made anew."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as scenes:
        for point in (point for point in of.points.values() if not point.gpu):
            scene = stirred_scene(of, point)
            short = {name: np.round(getattr(scene.fluid[0], name), DIGITS) for name in ("position", "velocity")}
            scene = msgspec.structs.replace(scene, name=of.name, fluid=(Cloud(**short),))
            scenes.writestr(zipfile.ZipInfo(packed(point)), scene_to_toml(scene), zipfile.ZIP_DEFLATED)
    return file.getvalue()


def _place(backend: str) -> Machine:
    """Where and with what a reading is taken."""
    where = environment(1, backend)
    device, load = where["device"] or {}, where["load"]
    return Machine(
        where["processor"], where["threads"], where["date"], where["commit"], device.get("name", ""),
        device.get("driver_version", ""), where["cores"], None if load is None else [load, load], where["versions"],
    )  # fmt: skip
