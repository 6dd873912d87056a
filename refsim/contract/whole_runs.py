"""A trajectory of another code against refsim's run of the same scene, with the scene's own chaos as the yardstick.

What is compared are measures of the whole liquid, as single particles of two correct codes part soon. Three runs of
refsim, from the scene's start and from two starts that are shaken, say how far such a measure is determined at all.
"""

from __future__ import annotations

import itertools
import math
import xml.etree.ElementTree
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from refsim.core.errors import InputError
from refsim.engine.simulation import Simulation
from refsim.io.frames import read_particles
from refsim.io.results import SAME_TIME
from refsim.scene.scene import Scene

SHAKEN = 1e-6  # of the particle spacing; of the coordinates' precision where that is coarser
SEEDS = (1, 2)
AXES = "xyz"


@dataclass(frozen=True)
class Snapshot:
    """Particles at one time [s]: position (n, 3) [m]; velocity (n, 3) [m/s] and mass (n,) [kg] unless None."""

    time: float
    position: np.ndarray
    velocity: np.ndarray | None = None
    mass: np.ndarray | None = None


@dataclass(frozen=True)
class Measure:
    """One measure at the time of the comparison.

    theirs  of the trajectory
    ours    of refsim's three runs, the unshaken first
    allowed largest distance of `theirs` from the middle of `ours`: so many times the width of `ours`
    """

    name: str
    unit: str
    theirs: float
    ours: tuple[float, ...]
    allowed: float

    @property
    def difference(self) -> float:
        """Distance from the middle of refsim's runs."""
        return abs(self.theirs - 0.5 * (min(self.ours) + max(self.ours)))

    @property
    def holds(self) -> bool:
        """Whether the difference is at most what is allowed."""
        return self.difference <= self.allowed


# Trajectories


def trajectory(folder: Path) -> list[Snapshot]:
    """Every frame in a folder, by time.

    Frames are npz files (`time`, `position`, and if there are `velocity` and `mass`), VTK files (.vtp, .vtu, .vtk) with
    point data of these names and the field data `TimeValue` or a .pvd file, or one particle file of refsim (.vtkhdf).
    Raises InputError for a folder without frames, and for frames that cannot be read.
    """
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}; give the folder of the trajectory.")
    found: list[Snapshot] = []
    times = _pvd(folder)
    for path in sorted(folder.iterdir()):
        if path.suffix == ".npz":
            found.append(_npz(path))
        elif path.suffix == ".vtkhdf":
            for frame in read_particles(path):
                given = {"position": frame.position}
                given |= {name: frame.fields[name] for name in ("velocity", "mass") if name in frame.fields}
                found.append(_checked(path, frame.time, given))
        elif path.suffix in (".vtp", ".vtu", ".vtk"):
            found.append(_vtk(path, times.get(path.name)))
    if not found:
        raise InputError(f"{folder} has no frames; give npz, vtp, vtu or vtk files, or a particle file of refsim.")
    return sorted(found, key=lambda frame: frame.time)


def _pvd(folder: Path) -> dict[str, float]:
    """{name of a file: time [s]} of the folder's collections."""
    found = {}
    for path in folder.glob("*.pvd"):
        try:
            for entry in xml.etree.ElementTree.parse(path).iter("DataSet"):
                found[Path(entry.attrib["file"]).name] = float(entry.attrib["timestep"])
        except (xml.etree.ElementTree.ParseError, KeyError, ValueError) as error:
            raise InputError(f"{path} is no collection of VTK files: {error}.") from None
    return found


def _npz(path: Path) -> Snapshot:
    try:
        with np.load(path, allow_pickle=False) as arrays:
            given = {name: np.array(arrays[name], dtype=float) for name in arrays.files if name in _NAMES}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} cannot be read: {error}.") from None
    for name in ("time", "position"):
        if name not in given:
            raise InputError(f"{path} has no array {name!r}; it needs time [s] and position (n, 3) [m].")
    return _checked(path, float(given.pop("time")), given)


_NAMES = ("time", "position", "velocity", "mass")


def _vtk(path: Path, time: float | None) -> Snapshot:
    try:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkIOLegacy import vtkGenericDataObjectReader
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLUnstructuredGridReader
    except ImportError:
        raise InputError(f"{path}: VTK files are read by the package vtk; `pip install vtk`, or give npz.") from None
    readers = {".vtp": vtkXMLPolyDataReader, ".vtu": vtkXMLUnstructuredGridReader, ".vtk": vtkGenericDataObjectReader}
    reader: Any = readers[path.suffix]()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    points = data.GetPoints() if data is not None and hasattr(data, "GetPoints") else None
    if points is None:
        raise InputError(f"{path} has no points; give a file of particles.")
    arrays, fields = data.GetPointData(), data.GetFieldData()
    names = {arrays.GetArrayName(k).lower(): k for k in range(arrays.GetNumberOfArrays())}
    given = {name: vtk_to_numpy(arrays.GetArray(names[name])) for name in ("velocity", "mass") if name in names}
    if time is None:
        stated = fields.GetArray("TimeValue") or fields.GetArray("TIME")
        if stated is None:
            raise InputError(f"{path} has no time; give the field data TimeValue [s], or a .pvd file beside it.")
        time = float(stated.GetTuple1(0))
    return _checked(path, time, {"position": vtk_to_numpy(points.GetData()), **given})


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
    return Snapshot(time, **{name: np.asarray(values, dtype=float) for name, values in given.items()})


# Measures


def measures(found: Snapshot, dim: int, gravity: np.ndarray | None) -> dict[str, tuple[float, str]]:
    """{name: (value, unit)}: centre, spread and extent of the liquid, momentum and energies, as far as known."""
    mass = np.ones(len(found.position)) if found.mass is None else found.mass
    x, total = found.position, mass.sum()
    centre = (mass[:, None] * x).sum(0) / total
    spread = np.sqrt((mass[:, None] * (x - centre) ** 2).sum(0) / total)
    values: dict[str, tuple[float, str]] = {}
    for c in range(dim):
        values[f"centre {AXES[c]}"] = centre[c], "m"
        values[f"spread {AXES[c]}"] = spread[c], "m"
        values[f"largest {AXES[c]}"] = x[:, c].max(), "m"
        values[f"smallest {AXES[c]}"] = x[:, c].min(), "m"
    if gravity is not None:
        values["potential energy"] = -(mass * (x @ gravity)).sum(), "J"
    if found.velocity is not None:
        for c in range(dim):
            values[f"momentum {AXES[c]}"] = (mass * found.velocity[:, c]).sum(), "kg m/s"
        values["kinetic energy"] = 0.5 * (mass * (found.velocity**2).sum(1)).sum(), "J"
    return {name: (float(value), unit) for name, (value, unit) in values.items()}


def compare(
    scene: Scene, folder: Path, at: float | None = None, backend: str = "cpu", within: float = 3.0
) -> tuple[float, list[Measure]]:
    """(time [s], measures) of the trajectory in a folder and of three runs of refsim.

    at      time of the comparison [s], the last frame's by default; the frame nearest to it is taken
    within  how many times the width of refsim's three runs a measure may be away from their middle

    The frames' velocities belong to the frames' time; refsim's, which are half a step behind, are interpolated. Where
    the frames have no masses, all particles have the same share of the scene's.
    Raises InputError for bad input and RunStopped where refsim's run stops.
    """
    frames = trajectory(folder)
    wanted = frames[-1].time if at is None else at
    snapshot = min(frames, key=lambda frame: abs(frame.time - wanted))
    time = snapshot.time
    gaps = [later.time - earlier.time for earlier, later in itertools.pairwise(frames)]
    if abs(time - wanted) > 0.5 * max(gaps, default=0.0) + SAME_TIME * abs(wanted):
        raise InputError(f"{folder} has no frame at {wanted:.9g} s; the nearest is at {time:.9g} s.")
    if time <= 0:
        raise InputError(f"{folder}: the frame at {time:g} s is the start; give a later time with --at.")
    runs = [_run(scene, seed, time, backend) for seed in (None, *SEEDS)]
    simulation = runs[0][1]
    if snapshot.mass is None:
        total = float(np.asarray(simulation.field("mass"), dtype=float).sum())
        share = np.full(len(snapshot.position), total / len(snapshot.position))
        snapshot = Snapshot(snapshot.time, snapshot.position, snapshot.velocity, share)
    theirs = measures(snapshot, scene.dim, _gravity(simulation))
    found = []
    for name, (value, unit) in theirs.items():
        ours = tuple(run[0][name] for run in runs)
        found.append(Measure(name, unit, value, ours, within * (max(ours) - min(ours))))
    return time, found


def _gravity(simulation: Simulation) -> np.ndarray | None:
    effect: Any = simulation.plan.effects.get("gravity")
    return None if effect is None else np.array(effect.acceleration, dtype=float)


def _run(scene: Scene, seed: int | None, until: float, backend: str) -> tuple[dict[str, float], Simulation]:
    """(measures at a time [s], the simulation behind it) of a run from the scene's start, or from a shaken one."""
    simulation = Simulation(scene, backend)
    if seed is not None:
        position = simulation.field("position")
        grid = simulation.plan.grid
        coarse = 2 * float(np.finfo(grid.dtype).eps) * float(np.abs(grid.local(position)).max(initial=0.0))
        amount = max(SHAKEN * scene.spacing, coarse)
        shift = np.random.default_rng(seed).uniform(-amount, amount, position.shape)
        shift[:, scene.dim :] = 0
        simulation.set_field("position", (position + shift).astype(position.dtype))
    before = after = _state(simulation)
    while min(after.time, after.velocity_time) < until:
        simulation.step()
        before, after = after, _state(simulation)
    position = _between(before.time, before.position, after.time, after.position, until)
    velocity = _between(before.velocity_time, before.velocity, after.velocity_time, after.velocity, until)
    found = measures(Snapshot(until, position, velocity, after.mass), scene.dim, _gravity(simulation))
    return {name: value for name, (value, _) in found.items()}, simulation


class _State(NamedTuple):
    """Times [s] of the positions and of the velocities, and the fields in the particles' first order."""

    time: float
    velocity_time: float
    position: np.ndarray
    velocity: np.ndarray
    mass: np.ndarray


def _state(simulation: Simulation) -> _State:
    fields = (np.asarray(simulation.field(name), dtype=float) for name in ("position", "velocity", "mass"))
    return _State(simulation.time, simulation.time - 0.5 * simulation.previous_length, *fields)


def _between(start: float, first: np.ndarray, end: float, last: np.ndarray, time: float) -> np.ndarray:
    """Values at a time, by a straight line through those of two times."""
    return last if end == start else first + (last - first) * (time - start) / (end - start)


def report(found: list[Measure]) -> list[dict[str, Any]]:
    """The measures as plain data."""
    return [
        {"name": m.name, "unit": m.unit, "theirs": m.theirs, "refsim": list(m.ours), "difference": m.difference,
         "allowed": m.allowed, "holds": m.holds}
        for m in found
    ]  # fmt: skip
