"""Frames of other codes: npz files, VTK files, runs of refsim."""

import math
import xml.etree.ElementTree
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.errors import InputError, extra
from refsim.io.results import PARTICLES, open_run

ARRAYS = ("position", "velocity", "mass")
Read = tuple[float | None, Mapping[str, np.ndarray]]  # time [s] that a file states, arrays by name


@dataclass(frozen=True)
class Snapshot:
    """Particles at one time [s]: position (n, 3) [m]; velocity (n, 3) [m/s] and mass (n,) [kg] unless None."""

    time: float
    position: np.ndarray
    velocity: np.ndarray | None = None
    mass: np.ndarray | None = None
    behind: bool = False  # whether the velocity is that of half a step before, as refsim writes it


def trajectory(folder: Path) -> list[Snapshot]:
    """Every frame in a folder, by time.

    Frames are npz files (`time`, `position`, and if there are `velocity` and `mass`) or VTK files (.vtp, .vtu, .vtk)
    with point data of these names and the field data `TimeValue` or a .pvd file; or the folder is that of a run of
    refsim. Files without a time have theirs in `times.txt`, a line "FILE SECONDS" for each.
    Raises InputError for a folder without frames, and for frames that cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}; give the folder of the trajectory.")
    if (folder / PARTICLES).exists():
        return [
            replace(
                _checked(folder / PARTICLES, frame.time, {n: frame[n] for n in ARRAYS if n in frame.fields}),
                behind=True,
            )
            for frame in open_run(folder)
        ]
    times = _times(folder)
    snapshots = [_frame(path, times.get(path.name)) for path in sorted(folder.iterdir()) if path.suffix in READERS]
    if not snapshots:
        raise InputError(f"{folder} has no frames; give npz, vtp, vtu or vtk files, or the folder of a run of refsim.")
    return sorted(snapshots, key=lambda frame: frame.time)


def _frame(path: Path, listed: float | None) -> Snapshot:
    """The particles of a file; their time is that of the file, or of the lists beside it."""
    try:
        stated, given = READERS[path.suffix](path)
    except InputError:
        raise
    except Exception as error:  # another program's file may be damaged in any way
        raise InputError(f"{path} cannot be read: {error}.") from None
    if "position" not in given:
        raise InputError(f"{path} has no array 'position'; it needs position (n, 3) [m].")
    time = stated if listed is None else listed
    if time is None:
        lines = "a line 'FILE SECONDS' for each frame (VTK: or the field data TimeValue [s], or a .pvd file)"
        raise InputError(f"{path} has no time; write times.txt beside it, {lines}.")
    return _checked(path, time, given)


def _times(folder: Path) -> dict[str, float]:
    """{name of a file: time [s]} of the folder's .pvd collections and of `times.txt`."""
    times: dict[str, float] = {}
    for path in (*folder.glob("*.pvd"), *folder.glob("times.txt")):
        try:
            if path.suffix == ".pvd":
                sets = xml.etree.ElementTree.parse(path).iter("DataSet")
                times |= {Path(entry.attrib["file"]).name: float(entry.attrib["timestep"]) for entry in sets}
            else:
                lines = filter(str.strip, path.read_text(encoding="utf-8").splitlines())
                times |= {name: float(seconds) for name, seconds in map(str.split, lines)}
        except (OSError, xml.etree.ElementTree.ParseError, KeyError, ValueError) as error:
            raise InputError(f"{path} gives no times of frames: {error}.") from None
    return times


def _npz(path: Path) -> Read:
    with np.load(path, allow_pickle=False) as arrays:
        given = {name: np.array(arrays[name], dtype=float) for name in arrays.files if name in ("time", *ARRAYS)}
    return float(given["time"]) if "time" in given else None, given


def _vtk(path: Path) -> Read:
    data = extra("pyvista", f"{path}, a VTK file,").read(path)
    if not len(getattr(data, "points", ())):
        raise ValueError("it has no points; give a file of particles")
    given = {name.lower(): np.asarray(values) for name, values in data.point_data.items()}
    stated = data.field_data.get("TimeValue", data.field_data.get("TIME"))
    time = None if stated is None else float(np.ravel(stated)[0])
    return time, given | {"position": np.asarray(data.points)}


READERS: dict[str, Callable[[Path], Read]] = {".npz": _npz, ".vtp": _vtk, ".vtu": _vtk, ".vtk": _vtk}


def _checked(path: Path, time: float, given: Mapping[str, np.ndarray]) -> Snapshot:
    count, arrays = len(given["position"]), dict[str, Any]()
    for name, shape in {"position": (count, 3), "velocity": (count, 3), "mass": (count,)}.items():
        if name not in given:
            continue
        arrays[name] = values = np.asarray(given[name], dtype=float)
        if values.shape != shape:
            raise InputError(f"{path}: {name} has shape {values.shape}; it needs {shape}.")
        if not np.isfinite(values).all():
            raise InputError(f"{path}: {name} has values that are not finite.")
    if not count or not math.isfinite(time):
        raise InputError(f"{path}: {count} particles at {time:g} s; a frame needs particles and a time.")
    return Snapshot(time, **arrays)
