"""Frames of other codes: npz files, PySPH's npz, bgeo (SPlisHSPlasH, Partio), VTK files, runs of refsim."""

import gzip
import math
import pickle
import struct
import xml.etree.ElementTree
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.errors import InputError, extra
from refsim.io.results import PARTICLES, open_run


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

    Frames are npz files (`time`, `position`, and if there are `velocity` and `mass`; or PySPH's), bgeo files
    (SPlisHSPlasH, Partio), VTK files (.vtp, .vtu, .vtk) with point data of these names and the field data `TimeValue`
    or a .pvd file; or the folder is that of a run of refsim. Files without a time have theirs in `times.txt`, a line
    "FILE SECONDS" for each.
    Raises InputError for a folder without frames, and for frames that cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}; give the folder of the trajectory.")
    snapshots: list[Snapshot] = []
    if (folder / PARTICLES).exists():
        for frame in open_run(folder):
            given = {name: frame[name] for name in ("position", "velocity", "mass") if name in frame.fields}
            snapshots.append(replace(_checked(folder / PARTICLES, frame.time, given), behind=True))
        return snapshots
    times = _pvd(folder) | _listed(folder)
    for path in sorted(folder.iterdir()):
        if path.suffix == ".npz":
            snapshots.append(_npz(path))
        elif path.suffix == ".bgeo":
            snapshots.append(_bgeo(path, times.get(path.name)))
        elif path.suffix in (".vtp", ".vtu", ".vtk"):
            snapshots.append(_vtk(path, times.get(path.name)))
    if not snapshots:
        raise InputError(
            f"{folder} has no frames; give npz, bgeo, vtp, vtu or vtk files, or the folder of a run of refsim."
        )
    return sorted(snapshots, key=lambda frame: frame.time)


def _pvd(folder: Path) -> dict[str, float]:
    """{name of a file: time [s]} of the folder's collections."""
    times = {}
    for path in folder.glob("*.pvd"):
        try:
            for entry in xml.etree.ElementTree.parse(path).iter("DataSet"):
                times[Path(entry.attrib["file"]).name] = float(entry.attrib["timestep"])
        except (xml.etree.ElementTree.ParseError, KeyError, ValueError) as error:
            raise InputError(f"{path} is no collection of VTK files: {error}.") from None
    return times


def _listed(folder: Path) -> dict[str, float]:
    """{name of a file: time [s]} of `times.txt`."""
    path = folder / "times.txt"
    try:
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        return {name: float(seconds) for name, seconds in map(str.split, filter(str.strip, text.splitlines()))}
    except (OSError, ValueError) as error:
        raise InputError(f"{path} is no list of times: {error}; write a line 'FILE SECONDS' for each frame.") from None


def _npz(path: Path) -> Snapshot:
    try:
        with zipfile.ZipFile(path) as archive:
            if {"particles.npy", "solver_data.npy"} <= set(archive.namelist()):
                return _pysph(path, archive)
        with np.load(path, allow_pickle=False) as arrays:
            given = {name: np.array(arrays[name], dtype=float) for name in arrays.files if name in _NAMES}
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, pickle.UnpicklingError) as error:
        raise InputError(f"{path} cannot be read: {error}.") from None
    for name in ("time", "position"):
        if name not in given:
            raise InputError(f"{path} has no array {name!r}; it needs time [s] and position (n, 3) [m].")
    return _checked(path, float(given.pop("time")), given)


_NAMES = ("time", "position", "velocity", "mass")


# PySPH: npz files of pickled dictionaries, of which only numbers, strings and NumPy's arrays are accepted


class _Plain(pickle.Unpickler):
    """A reader that makes nothing but NumPy's arrays, so that a file runs no code."""

    def find_class(self, module: str, name: str) -> Any:
        if module.startswith("numpy") and name in ("_reconstruct", "_frombuffer", "ndarray", "dtype", "scalar"):
            return super().find_class(module, name)
        raise pickle.UnpicklingError(f"it holds {module}.{name}, which is no plain data")


def _pysph(path: Path, archive: zipfile.ZipFile) -> Snapshot:
    """The particle array "fluid", or the only one."""
    particles, solver = (_object(archive, name) for name in ("particles.npy", "solver_data.npy"))
    name = "fluid" if "fluid" in particles else next(iter(particles))
    arrays = {key: np.asarray(values, dtype=float) for key, values in particles[name]["arrays"].items()}
    given = {"position": _columns(arrays, "xyz"), "velocity": _columns(arrays, "uvw"), "mass": arrays["m"]}
    return _checked(path, float(solver["t"]), given)


def _object(archive: zipfile.ZipFile, name: str) -> Any:
    with archive.open(name) as file:
        np.lib.format.read_magic(file)
        np.lib.format.read_array_header_1_0(file)
        return _Plain(file).load().item()


def _columns(arrays: Mapping[str, np.ndarray], names: str) -> np.ndarray:
    return np.stack([arrays.get(name, np.zeros_like(arrays[names[0]])) for name in names], axis=1)


# bgeo: Houdini's binary points as Partio writes them, big-endian

_WORDS = {0: ">f4", 1: ">i4", 5: ">f4"}  # attributes: numbers, integers, vectors


def _bgeo(path: Path, time: float | None) -> Snapshot:
    data = gzip.decompress(path.read_bytes()) if path.read_bytes()[:2] == b"\x1f\x8b" else path.read_bytes()
    try:
        if data[:5] != b"BgeoV":
            raise ValueError("its first bytes are not BgeoV")
        points, _, _, _, attributes, *_ = struct.unpack_from(">8i", data, 9)
        kinds, place = [("position", ">f4", 4)], 41
        for _ in range(attributes):
            (length,) = struct.unpack_from(">H", data, place)
            name = data[place + 2 : place + 2 + length].decode()
            size, kind = struct.unpack_from(">Hi", data, place + 2 + length)
            place += 8 + length + 4 * size
            kinds.append((name, _WORDS[kind], size))
        rows = np.frombuffer(data, np.dtype([(n, k, (s,)) for n, k, s in kinds]), points, place)
    except (ValueError, KeyError, struct.error) as error:
        raise InputError(f"{path} is no bgeo file of particles: {error}.") from None
    if time is None:
        raise InputError(f"{path} has no time; write times.txt beside it, a line 'FILE SECONDS' for each frame.")
    given = {"position": rows["position"][:, :3]}
    names = rows.dtype.names or ()
    given |= {n: rows[n] if n == "velocity" else rows[n][:, 0] for n in ("velocity", "mass") if n in names}
    return _checked(path, time, given)


# VTK


def _vtk(path: Path, time: float | None) -> Snapshot:
    vista = extra("pyvista", f"{path}, a VTK file,")
    try:
        data = vista.read(path)
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None
    if not len(getattr(data, "points", ())):
        raise InputError(f"{path} has no points; give a file of particles.")
    given = {name.lower(): np.asarray(values) for name, values in data.point_data.items()}
    if time is None:
        stated = data.field_data.get("TimeValue", data.field_data.get("TIME"))
        if stated is None:
            raise InputError(
                f"{path} has no time; give the field data TimeValue [s], a .pvd file or times.txt beside it."
            )
        time = float(np.ravel(stated)[0])
    named = {name: given[name] for name in ("velocity", "mass") if name in given}
    return _checked(path, time, {"position": np.asarray(data.points), **named})


def _checked(path: Path, time: float, given: Mapping[str, np.ndarray]) -> Snapshot:
    count = len(given["position"])
    shapes = {"position": (count, 3), "velocity": (count, 3), "mass": (count,)}
    for name, values in given.items():
        if values.shape != shapes[name]:
            raise InputError(f"{path}: {name} has shape {values.shape}; it needs {shapes[name]}.")
        if not np.isfinite(values).all():
            raise InputError(f"{path}: {name} has values that are not finite.")
    if not count or not math.isfinite(time):
        raise InputError(f"{path}: {count} particles at {time:g} s; a frame needs particles and a time.")
    arrays: dict[str, Any] = {name: np.asarray(values, dtype=float) for name, values in given.items()}
    return Snapshot(time, **arrays)
