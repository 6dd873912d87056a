"""A trajectory of another code against refsim's run of the same scene, with the scene's own chaos as the yardstick.

What is compared are measures of the whole liquid, as single particles of two correct codes part soon. Three runs of
refsim, from the scene's start and from two starts that are shaken, say how far such a measure is determined at all.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from refsim.contract.trajectories import Snapshot, trajectory
from refsim.core.errors import InputError
from refsim.engine.simulation import Simulation
from refsim.io.results import SAME_TIME
from refsim.scene.scene import Scene

SHAKEN = 1e-6  # of the particle spacing; of the coordinates' precision where that is coarser
SEEDS = (1, 2)
AXES = "xyz"
MASS_ROUNDING = 1e-5  # share of the mass that sums in single precision may be off


@dataclass(frozen=True)
class Measure:
    """One measure as a curve over the frames up to the time of the comparison, told where it is farthest off.

    theirs   of the trajectory at `time` [s]
    ours     of refsim's three runs at that time, the unshaken first
    allowed  largest distance of the curve from the middle of refsim's: so many times their largest width, or as given
    """

    name: str
    unit: str
    time: float
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


# Measures


def measures(found: Snapshot, dim: int, gravity: np.ndarray | None) -> dict[str, tuple[float, str]]:
    """{name: (value, unit)}: number, mass, centre, spread and extent, momentum and energies, as far as known."""
    mass = np.ones(len(found.position)) if found.mass is None else found.mass
    x, total = found.position, mass.sum()
    centre = (mass[:, None] * x).sum(0) / total
    spread = np.sqrt((mass[:, None] * (x - centre) ** 2).sum(0) / total)
    values: dict[str, tuple[float, str]] = {"particles": (len(x), "-"), "mass": (total, "kg" if dim == 3 else "kg/m")}
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
    scene: Scene, folder: Path, at: float | None = None, backend: str = "cpu", within: float = 3.0,
    allowed: Mapping[str, float] | None = None,
) -> tuple[float, list[Measure]]:  # fmt: skip
    """(time [s], measures) of the trajectory in a folder up to a time, and of three runs of refsim.

    at       time of the comparison [s], the last frame's by default; frames up to the one nearest to it are taken
    within   how many times the largest width of refsim's three runs a measure may be away from their middle
    allowed  largest distance by the name of a measure, in place of `within`

    The number of particles and, up to single precision, the mass are those of the scene. The frames' velocities belong
    to the frames' time; refsim's, which are half a step behind, are interpolated. Where the frames have no masses, all
    particles have the same share of the scene's.
    Raises InputError for bad input and RunStopped where refsim's run stops.
    """
    frames = trajectory(folder)
    wanted = frames[-1].time if at is None else at
    time = min((frame.time for frame in frames), key=lambda t: abs(t - wanted))
    gaps = [later.time - earlier.time for earlier, later in itertools.pairwise(frames)]
    if abs(time - wanted) > 0.5 * max(gaps, default=0.0) + SAME_TIME * abs(wanted):
        raise InputError(f"{folder} has no frame at {wanted:.9g} s; the nearest is at {time:.9g} s.")
    if time <= 0:
        raise InputError(f"{folder}: the frame at {time:g} s is the start; give a later time with --at.")
    frames = [frame for frame in frames if 0 <= frame.time <= time]
    simulation = Simulation(scene, backend)
    gravity, total = _gravity(simulation), float(np.asarray(simulation.field("mass"), dtype=float).sum())
    runs = [_run(scene, seed, [frame.time for frame in frames], backend) for seed in (None, *SEEDS)]
    theirs = [measures(_with_mass(frame, total), scene.dim, gravity) for frame in frames]
    names = [name for name in theirs[-1] if all(name in values for values in theirs)]
    unknown = ", ".join(set(allowed or {}) - set(names))
    if unknown:
        raise InputError(f"--allow: there is no measure {unknown}; there are {', '.join(names)}.")
    found = []
    for name in names:
        curves = [tuple(run[k][name] for run in runs) for k in range(len(frames))]
        width = max(max(ours) - min(ours) for ours in curves)
        limit = {"particles": 0.0, "mass": MASS_ROUNDING * total}.get(name, within * width)
        limit = (allowed or {}).get(name, limit)
        points = [
            Measure(name, theirs[k][name][1], frames[k].time, theirs[k][name][0], ours, limit)
            for k, ours in enumerate(curves)
        ]
        found.append(max(points, key=lambda point: (point.difference, point.time)))
    return time, found


def _with_mass(frame: Snapshot, total: float) -> Snapshot:
    """The frame with equal shares of the mass [kg] where it has none."""
    if frame.mass is not None:
        return frame
    return replace(frame, mass=np.full(len(frame.position), total / len(frame.position)))


def _gravity(simulation: Simulation) -> np.ndarray | None:
    effect: Any = simulation.plan.effects.get("gravity")
    return None if effect is None else np.array(effect.acceleration, dtype=float)


def _run(scene: Scene, seed: int | None, times: Sequence[float], backend: str) -> list[dict[str, float]]:
    """Measures at times [s] of a run from the scene's start, or from a shaken one."""
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
    found = []
    for until in times:
        while min(after.time, after.velocity_time) < until:
            simulation.step()
            before, after = after, _state(simulation)
        position = _between(before.time, before.position, after.time, after.position, until)
        velocity = _between(before.velocity_time, before.velocity, after.velocity_time, after.velocity, until)
        told = measures(Snapshot(until, position, velocity, after.mass), scene.dim, _gravity(simulation))
        found.append({name: value for name, (value, _) in told.items()})
    return found


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
        {"name": m.name, "unit": m.unit, "time": m.time, "theirs": m.theirs, "refsim": list(m.ours),
         "difference": m.difference, "allowed": m.allowed, "holds": m.holds}
        for m in found
    ]  # fmt: skip
