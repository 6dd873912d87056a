"""Two other couplings with a solid, small, on the same boundary particles: distance-based forces and direct forcing.

Mueller, Schirm, Teschner, Heidelberger & Gross 2004 push (and hold) particles with a polynomial shaped as
Lennard-Jones forces of the distance; here it only pushes, because its pull crowds liquid on the wall until it
passes. Becker, Tessendorf & Teschner 2009 let a step end without the solid, search the boundary particles near the
places reached, and correct velocities and places there (the correction of Ihmsen et al. 2010 for a solid at rest).
Neither puts the solid into the liquid's density.

The patent's third rival, impulses at the boundary (Oh, Kim & Roh 2009), is not here: what its description lacks
stands on docs/walls.md.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import refsim
from refsim.backends.arrays import Backend
from refsim.backends.compile import cpu_kernel
from refsim.neighbours import NeighbourSearch

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

    def __init__(self, simulation: refsim.Simulation, wall: NDArray, normal: NDArray) -> None:
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

    def __init__(self, simulation: refsim.Simulation, wall: NDArray, normal: NDArray, stiffness: float) -> None:
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
