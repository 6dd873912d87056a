"""Two other couplings, small, on the same boundary particles: distance-based forces and direct forcing.

Mueller, Schirm, Teschner, Heidelberger & Gross 2004 push (and hold) particles with a polynomial shaped as Lennard-Jones
forces of the distance; here it only pushes, because its pull crowds liquid on the wall until it passes. Becker,
Tessendorf & Teschner 2009 let a step end without the solid, search the boundary particles near the places reached, and
correct velocities and places there (the correction of Ihmsen et al. 2010 for a solid at rest). Neither puts the solid
into the liquid's density.

The patent's third rival, impulses at the boundary (Oh, Kim & Roh 2009), is not here: what its description lacks stands
on docs/one_way_coupling.md.
"""

from __future__ import annotations

import dataclasses
import math
import time
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim import MeshBoundary, Scene, Simulation
from refsim.backends.arrays import Backend
from refsim.backends.compile import cpu_kernel
from refsim.core.errors import RunStopped
from refsim.neighbours import NeighbourSearch
from refsim.scene.plan import Plan, make_plan
from validation.experiments.boundary.flow_runs import GRAVITY, inside_of, resting_cup, resting_scene
from validation.experiments.boundary.flow_shapes import SPACING, mesh_file
from validation.results import Result
from validation.running import Context

SKIN = 0.2  # of the lists of boundary particles, in support radii


@cpu_kernel
def distance_forces(
    position: Any, wall: Any, rows: Any, reach: float, rest: float, stiffness: float, acceleration: Any
) -> None:
    """a_i = k sum_b ((h - r)^4 - (h - r0)^2 (h - r)^2)/(h^2 r0 (2 h - r0)) e_ib [m/s^2], r < r0: k at 0, none at r0."""
    scale = stiffness / (reach**2 * rest * (2 * reach - rest))
    for i in range(acceleration.shape[0]):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        ax, ay, az = 0.0, 0.0, 0.0
        for k in range(rows.start[i], rows.start[i] + rows.count[i]):
            b = rows.entries[k]
            dx, dy, dz = x - wall[b, 0], y - wall[b, 1], z - wall[b, 2]
            r = math.sqrt(dx * dx + dy * dy + dz * dz)
            if 0 < r < rest:
                left = (reach - r) ** 2
                f = scale * left * (left - (reach - rest) ** 2) / r
                ax += f * dx
                ay += f * dy
                az += f * dz
        acceleration[i, 0], acceleration[i, 1], acceleration[i, 2] = ax, ay, az


@cpu_kernel
def direct_forcing(position: Any, velocity: Any, wall: Any, normal: Any, rows: Any, rest: float) -> None:
    """Where r < r0: w = (r0 - r)/r0, n = sum w n_b, x += (sum w (r0 - r)/sum w) n/|n|, v -= min(v.n, 0) n/|n|^2."""
    for i in range(position.shape[0]):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        weight, shift = 0.0, 0.0
        nx, ny, nz = 0.0, 0.0, 0.0
        for k in range(rows.start[i], rows.start[i] + rows.count[i]):
            b = rows.entries[k]
            dx, dy, dz = x - wall[b, 0], y - wall[b, 1], z - wall[b, 2]
            r = math.sqrt(dx * dx + dy * dy + dz * dz)
            if r < rest:
                w = (rest - r) / rest
                weight += w
                shift += w * (rest - r)
                nx += w * normal[b, 0]
                ny += w * normal[b, 1]
                nz += w * normal[b, 2]
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if weight > 0 and length > 0:
            nx, ny, nz = nx / length, ny / length, nz / length
            shift /= weight
            position[i, 0] += shift * nx
            position[i, 1] += shift * ny
            position[i, 2] += shift * nz
            inwards = min(velocity[i, 0] * nx + velocity[i, 1] * ny + velocity[i, 2] * nz, 0.0)
            velocity[i, 0] -= inwards * nx
            velocity[i, 1] -= inwards * ny
            velocity[i, 2] -= inwards * nz


class Rival:
    """A simulation without a solid, and what is done beside its steps; float64 on the CPU.

    queries  number of searches for boundary particles
    """

    def __init__(self, simulation: Simulation, wall: NDArray, normal: NDArray) -> None:
        self.simulation = simulation
        self.plan, self.backend = simulation.plan, simulation.backend
        simulation.lists.auditable = False  # its particles are moved by others, too
        grid = self.plan.grid
        self.search = NeighbourSearch(Backend("cpu"), 3, "float64", grid.support_radius, SKIN)
        self.static = self.search.static_set(wall)
        order = np.asarray(self.static.order)
        self.wall, self.normal = np.ascontiguousarray(wall[order]), np.ascontiguousarray(normal[order])
        self.built: NDArray | None = None
        self.rows: Any = None
        self.sorted_at = -1
        self.queries = 0

    def near(self, anew: bool) -> Any:
        """The boundary particles near every particle, searched where particles have left the skin, or `anew`."""
        place, sorted_at = self.simulation.fields["position"], self.simulation.search.log.rebuilds  # type: ignore
        stale = anew or self.built is None or sorted_at != self.sorted_at
        if stale or ((place - self.built) ** 2).sum(1).max() > self.search.allowed_displacement**2:
            self.built, self.sorted_at = place.copy(), sorted_at
            self.rows = self.search.build_against(self.built, self.static)
            self.queries += 1
        return self.rows

    def step(self) -> None:
        """One step; each rival has its own."""
        raise NotImplementedError

    def field(self, name: str) -> NDArray:
        """A field of the liquid."""
        return self.simulation.field(name)


class DistanceForces(Rival):
    """Mueller 2004: zero one spacing from a boundary particle, stiff enough for the liquid to fall from its height."""

    def __init__(self, simulation: Simulation, wall: NDArray, normal: NDArray, stiffness: float) -> None:
        super().__init__(simulation, wall, normal)
        self.stiffness = stiffness
        self.acceleration = np.zeros((simulation.count, 3))

    def step(self) -> None:
        fields, grid = self.simulation.fields, self.plan.grid
        rows = self.near(anew=False)
        given = (fields["position"], self.wall, rows, grid.support_radius, grid.spacing, self.stiffness)
        distance_forces(*given, self.acceleration)
        length = self.plan.scene.step
        fields["velocity"] += (0.5 if self.simulation.steps == 0 else 1.0) * length * self.acceleration
        self.simulation.step()


class DirectForcing(Rival):
    """Becker 2009: no particle ends a step nearer than a spacing to a boundary particle."""

    def step(self) -> None:
        self.simulation.step()
        fields = self.simulation.fields
        rows = self.near(anew=True)  # at the places reached
        direct_forcing(fields["position"], fields["velocity"], self.wall, self.normal, rows, self.plan.grid.spacing)


# What is measured of all three

CELLS = (7, 7, 9)  # of the first tank in which they are compared
SHARES = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)  # of the runner's step
SECONDS = 0.6  # simulated
CALM = 0.15  # [m/s], root mean square speed at the end, of a tank that holds
COUPLINGS = {"own": "one-way coupling", "distance": "distance-based forces", "forcing": "direct forcing"}


def tank(coupling: str, file: str, cells: tuple[int, int, int], share: float) -> Scene:
    """The tank at rest with a fixed step; only the project's own coupling puts the solid into the scene."""
    scene = resting_scene(file, cells)
    if coupling != "own":
        scene = msgspec.structs.replace(scene, effects=scene.effects[:-1])
    sound = scene.effects[0].sound_speed  # type: ignore[attr-defined]
    return msgspec.structs.replace(scene, step=share * 0.4 * scene.support_radius / sound)


def planned(scene: Scene) -> Plan:
    """The plan with the scene's step, also where the runner would refuse it as too long."""
    stable = make_plan(msgspec.structs.replace(scene, step=0.0))
    return dataclasses.replace(stable, scene=scene)


def stiffness_of(cells: tuple[int, int, int]) -> float:
    """k [m/s^2] for which a tenth of a spacing stops what has fallen from the liquid's height: g H/(d/10)."""
    return GRAVITY * cells[2] * SPACING / (0.1 * SPACING)


def coupled(coupling: str, simulation: Simulation, solid: Any, cells: tuple[int, int, int]) -> Any:
    """The simulation, or a rival around it."""
    if coupling == "distance":
        return DistanceForces(simulation, solid.position, solid.normal, stiffness_of(cells))
    return DirectForcing(simulation, solid.position, solid.normal) if coupling == "forcing" else simulation


def rest(
    context: Context, coupling: str, share: float, backend: str, seconds: float = SECONDS,
    cells: tuple[int, int, int] = CELLS,
) -> Result:  # fmt: skip
    """A tank at rest for a while: does it hold, and how much does the wall's force vary?

    The wall's force is the rate of the liquid's momentum, plus its weight.
    """
    with mesh_file(resting_cup(cells)) as file:
        scene = tank(coupling, file, cells, share)
        simulation = context.simulation(planned(scene), backend)
        solid = MeshBoundary(file=file).placed(simulation.plan.grid)
        run = coupled(coupling, simulation, solid, cells)
        mass = simulation.field("mass")
        weight = float(mass.sum() * GRAVITY)
        momentum, forces, speed, reason = 0.0, [], math.nan, ""
        steps = round(seconds / scene.step)
        try:
            for k in range(steps):
                run.step()
                now = float(mass @ simulation.field("velocity")[:, 2])
                forces.append((now - momentum) / scene.step + weight)
                momentum = now
                if k % 20 == 0:
                    context.progress(k / steps)
        except RunStopped as stop:
            reason = stop.reason
        position = simulation.field("position")
        inner = inside_of(cells)
        outside = (position < 0) | (position > np.array(inner))
        lost = int((outside.any(1) | ~np.isfinite(position).all(1)).sum())
        speed = float(np.sqrt((simulation.field("velocity") ** 2).sum(1).mean()))
    last = np.array(forces[-len(forces) // 5 :])
    noise = float(last.std() / weight) if len(last) else math.inf
    searches = simulation.search.log.rebuilds + getattr(run, "queries", 0)  # type: ignore[union-attr]
    return Result(
        {
            "step": scene.step, "share": share, "lost": lost, "speed": speed, "noise": noise, "reason": reason,
            "force": float(last.mean() / weight) if len(last) else math.nan,
            "searches": searches / max(simulation.steps, 1),
            "holds": bool(not reason and lost == 0 and speed < CALM),
        }
    )  # fmt: skip


def cost(context: Context, cells: tuple[int, int, int], steps: int, backend: str) -> Result:
    """Milliseconds a step without a solid and with each coupling, in turn; what it adds, in fifths."""
    with mesh_file(resting_cup(cells)) as file:
        runs = {}
        for coupling in ("bare", *COUPLINGS):
            scene = tank(coupling, file, cells, 0.25)
            simulation = context.simulation(scene, backend)
            solid = MeshBoundary(file=file).placed(simulation.plan.grid)
            runs[coupling] = coupled(coupling, simulation, solid, cells)
            for _ in range(3):
                runs[coupling].step()
        spent: dict[str, list[float]] = {coupling: [] for coupling in runs}
        for k in range(steps):
            for coupling, run in runs.items():
                began = time.perf_counter()
                run.step()
                spent[coupling].append(time.perf_counter() - began)
            context.progress((k + 1) / steps)
    fifths = {c: [float(np.median(part)) for part in np.array_split(np.array(each), 5)] for c, each in spent.items()}
    shares = {c: [(t - b) / t for t, b in zip(fifths[c], fifths["bare"])] for c in COUPLINGS}
    milliseconds = {c: 1e3 * float(np.median(each)) for c, each in spent.items()}
    return Result({"milliseconds": milliseconds, "shares": shares, "particles": simulation.count})
