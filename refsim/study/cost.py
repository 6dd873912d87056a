"""Seconds of a run before it is run: those of ten steps of the scene itself, times the steps to its end.

The scene is started and compiled, its neighbour list is built, and then ten steps are timed. The run has as many steps
to its end as the length of the tenth one, which the scene's step limits set. List builds after the first one and frames
are not counted.
"""

import dataclasses
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from refsim.core.capabilities import HoldsOtherMemory, effects_with
from refsim.core.errors import InputError
from refsim.engine.binding import fused
from refsim.engine.simulation import Simulation
from refsim.neighbours.limits import NEIGHBOUR_CAPACITY, PARTICLES_PER_CELL, WALL_CAPACITY, with_margin
from refsim.scene.plan import Plan, make_plan
from refsim.scene.refine import refined
from refsim.scene.scene import Scene
from refsim.scene.shapes import Box
from refsim.scene.solids import LAID_OUT, MOST_CELLS, countable

WARM = 2  # steps before, which build the list and compile
STEPS = 10


@dataclass(frozen=True)
class Cost:
    """What a run takes on a backend, with one thread of a CPU."""

    backend: str
    particles: int
    bytes: int  # of fields, lists and walls, from the plan
    start: float  # wall seconds in which the scene was started, its kernels compiled or loaded
    each: float  # processor seconds of a step
    ratio: float  # wall seconds over processor seconds of the timed steps: above 1 on a GPU, and beside other programs
    steps: int  # to the scene's end, of the `length` [s] of the last timed one
    length: float

    @property
    def processor(self) -> float:
        """Processor seconds of all steps."""
        return self.steps * self.each

    @property
    def wall(self) -> float:
        """Wall seconds of all steps on a machine that is as busy as it was."""
        return self.ratio * self.processor


def measured(plan: Plan, backend: str = "cpu") -> Cost:
    """What a run of the plan's scene to its end takes.

    Raises InputError where the scene cannot be run on this backend, and RunStopped where it stops in its first steps.
    """
    began = time.perf_counter()
    simulation = Simulation(plan, backend, 1)
    _steps(simulation, WARM)
    start, before = time.perf_counter() - began, sum(simulation.timings.first_calls.values())
    processor, wall = time.process_time(), time.perf_counter()
    _steps(simulation, STEPS)
    processor, wall = time.process_time() - processor, time.perf_counter() - wall
    compiled = (sum(simulation.timings.first_calls.values()) - before) / wall  # its share: stages that are first called
    assert simulation.last is not None
    length = simulation.last.length
    return Cost(
        backend, plan.grid.count, bytes_of(plan, backend)["total"], start, (1 - compiled) * processor / STEPS,
        wall / processor, math.ceil(plan.scene.end_time / length * (1 - 1e-9)), length,
    )  # fmt: skip


def _steps(simulation: Simulation, count: int) -> None:
    for _ in range(count):
        simulation.step()
    simulation.backend.synchronize()


# Memory of a scene on a backend, from its plan, before anything is allocated

MANY, FEW = 5_000_000, 20_000  # particles in boxes from which on they are counted first, by a plan of about so many


def bytes_of(plan: Plan, backend: str) -> dict[str, int]:
    """Bytes of fields, positions at the last list build, walls, neighbour list, background grid, and their "total".

    The list is that of the undisturbed lattice; it grows where particles are denser. The grid is that of the first
    step, without points of a surface.
    """
    grid, n = plan.grid, plan.grid.count
    listed = neighbour_list(plan, backend)
    walls = 0 if plan.walls is None else len(plan.walls.position)
    parts = {
        "fields": sum(plan.bytes_of_fields().values()),
        "positions_at_list_build": 3 * n * np.dtype(grid.dtype).itemsize,
        "walls": walls * 4 * np.dtype(grid.dtype).itemsize,
        "neighbour_list": listed["bytes"] if listed else 0,
    }
    if walls and listed:
        parts["walls"] += n * (WALL_CAPACITY * 4 + 12)  # the list of walls near each particle
    for effect in effects_with(plan.effects, HoldsOtherMemory):
        parts |= effect.bytes_at_start(grid, plan.grid.local(plan.state.position), plan.effects, backend)
    return parts | {"total": sum(parts.values())}


def check_memory(plan: Plan, backend: str) -> None:
    """Raises InputError where a run takes more memory than the machine has, with the spacing that fits.

    On a GPU the host holds the fields alone: what the device has no memory for stops the run.
    """
    needed = bytes_of(plan, backend)
    each = (needed["fields"] if backend == "cuda" else needed["total"]) / plan.grid.count
    countable("scene: a run of it", [plan.grid.count], each, "particles", grid=plan.grid)


def check_boxes(scene: Scene, backend: str) -> None:
    """`check_memory` of a scene of many particles in boxes, before it is laid out: by a plan with a larger spacing."""
    count = sum(math.prod(part.cells) for part in scene.fluid if isinstance(part, Box) and part.cells)
    if not MANY <= count <= MOST_CELLS:  # more is refused by the numbers alone
        return
    try:
        plan = make_plan(refined(scene, (FEW / count) ** (1 / scene.dim)))
    except InputError:  # which the scene's own plan has, or no other has
        return
    listed, each = neighbour_list(plan, backend), float(sum(plan.field_bytes().values()))
    if backend != "cuda":
        each += 3 * np.dtype(scene.dtype).itemsize + (listed["bytes"] / plan.grid.count if listed else 0.0)
    grid = dataclasses.replace(plan.grid, spacing=scene.spacing)
    countable("scene: a run of it", [count], max(each, LAID_OUT), "particles", grid=grid)


def neighbour_list(plan: Plan, backend: str) -> dict[str, Any] | None:
    """Estimate from the undisturbed lattice; the list grows where particles are denser."""
    if not plan.list_radius or backend == "numpy":
        return None
    grid = plan.grid
    skin = plan.scene.skins[0]
    reach = plan.list_radius * (1 + skin)
    k = math.ceil(reach / grid.spacing)
    axis = np.arange(-k, k + 1) ** 2
    squares = axis[:, None] + axis[None, :]
    if grid.dim == 3:
        squares = squares[:, :, None] + axis
    each = int((squares * grid.spacing**2 < reach**2).sum()) - 1
    told = {"radius": plan.list_radius, "reach": reach, "neighbours_on_a_lattice": each}
    return told | {"bytes": _list_bytes(plan, backend, each), "built_anew_after": 0.5 * skin * plan.list_radius}


def _list_bytes(plan: Plan, backend: str, each: int) -> int:
    """Bytes of the list of particles with `each` neighbours, of what builds it and, on a GPU, of the packed fields.

    Sums over a GPU's list read packed rows of four numbers: places and masses for the density, places and volumes for
    heat, two or three rows for forces in one loop, three for the coupling with solids.
    """
    n = plan.grid.count
    if backend != "cuda":
        return n * (4 * max(NEIGHBOUR_CAPACITY, each) + 12)  # entries; first entry and count of each row
    rows = 3 if plan.grid.dim == 2 else 9  # of three cells around each
    entries, cells = 4 * with_margin(each), (12 + 8 * rows) / PARTICLES_PER_CELL
    state = [plan.fields[name] for name in plan.ordered_fields]
    moved = sum(f.components * f.numpy_dtype(plan.grid.dtype).itemsize for f in state)  # through spare arrays
    forces = [p for _, p in fused(plan.passes, backend) if p.algorithm == "fused"]
    launched = {p.operation for _, p in (*plan.passes, *plan.motion)}
    coupled = not launched.isdisjoint({"two_way_coupling.forces", "two_way_coupling.pressure"})
    placed = coupled or bool(forces) or any(name == "sph.density" or name.startswith("heat.") for name in launched)
    vectors = (sum(plan.fields[name].components == 3 for name in p.reads) for p in forces)
    packed = 1 + max(placed, *vectors, 0)  # 1: of the list
    packed += 2 * coupled
    packed *= 4 * np.dtype(plan.grid.dtype).itemsize
    counted = 20  # cells, buckets and sums that order the particles
    return int(n * (entries + 4 + cells + 16 + 16 + moved + counted + packed))  # count; keys and runs; keys and order
