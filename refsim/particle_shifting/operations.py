"""Operations of particle shifting: which equations make each, its kernels, variants, tolerance and why."""

import numpy as np

from refsim.core.operation import Program, operations
from refsim.core.terms import where
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.particle_shifting import reference as ref

operation = operations(paper="Sun et al. 2017")
_SURFACE = "filling filling_gradient"
FUSED = {
    name: Program(
        "kernels", "crowding_and_momentum", also=("sph.central_momentum",), names={"smoothing": "gradient_smoothing"},
        variants=("walls period", "walls filling_gradient central_viscosity", "period"), packed=packed,
    )
    for name, packed in (("cpu:fused", ""), ("cuda:fused", "fused_pair"))
}  # fmt: skip


@operation(
    "(7), gradients of concentration and filling", outputs="filling_gradient concentration_gradient",
    optional="walls period filling_gradient", tolerance=16.0,
    reason="one rounding in each of distance, kernel and slope, and four in the power",
    variants=("walls period filling_gradient", "period filling_gradient", "period", ""),
    invariants="translation reordering", programs=FUSED, packed="crowding_pair",
)  # fmt: skip
def crowding(position, mass, density, walls, smoothing, shifting, period, rows=None):
    """Gradients of the concentration and of the filling [1/m], over liquid and walls."""
    i = Fields(position=position, volume=np.asarray(mass, dtype=float) / np.asarray(density, dtype=float))
    around, at_walls = (neighbours(i, j, smoothing, period=period, rows=rows) for j in (i, wall_particles(walls)))
    inverse = float(shifting.inverse_neighbour)
    return {
        "concentration_gradient": around(ref.concentration_gradient, inverse=inverse)
        + at_walls(ref.concentration_gradient, inverse=inverse),
        "filling_gradient": around(ref.filling_gradient) + at_walls(ref.filling_gradient),
    }


@operation(
    "(7), largest v along and against each axis", outputs="velocity_range", optional="drawn_body",
    variants=("",), tolerance=0.0, reason="one of the numbers",
)  # fmt: skip
def velocity_range(velocity, drawn_body):
    """Largest velocities [m/s] along each axis, and against it, of each body; of all particles without bodies."""
    v = np.asarray(velocity, dtype=float)
    body = np.zeros(len(v), int) if drawn_body is None else np.asarray(drawn_body)
    ends, bodies = np.hstack([v, -v]), range(max(body, default=0) + 1)
    largest = np.array([ends[body == k].max(0, initial=-(2.0**100)) for k in bodies])
    return {"velocity_range": (largest, np.abs(largest))}


@operation(
    "(7), tangential at the surface", outputs="shift", optional=f"{_SURFACE} phase drawn_body", tolerance=12.0,
    reason="one rounding in each of a root, a length, products and sums of the projection, and the bound; beside a"
    " surface the size counts the filling 67 times, as its last 3 % decide",
    variants=(f"{_SURFACE} phase drawn_body", "phase", "drawn_body", _SURFACE),
    invariants="reordering",
)  # fmt: skip
def shift(
    concentration_gradient, filling, filling_gradient, phase, drawn_body, shifting, velocity_range, timestep, rows=None
):  # fmt: skip
    """Displacement [m] of a step beside dt v, no longer than `largest` v_max dt; none of solids (`phase` not 0).

    v_max is half of the diagonal of the box in which all velocities of a body lie; `timestep` has dt second.
    """
    liquid = None if phase is None else np.asarray(phase) == 0
    body = np.zeros(len(concentration_gradient), int) if drawn_body is None else np.asarray(drawn_body)
    of_bodies, dt = np.asarray(velocity_range, dtype=float).reshape(-1, 2, 3), float(timestep[1])
    longest = np.array([ref.largest_step(*ends, dt, float(shifting.farthest)) for ends in of_bodies])
    i = Fields(
        gradient=concentration_gradient, filling=filling, normal=filling_gradient, liquid=liquid, longest=longest[body]
    ).at(rows)  # fmt: skip
    g = i.gradient
    if filling is not None:
        outer, within = float(shifting.outer), float(shifting.within)
        g = ref.beside_surface(i, float(shifting.least), float(shifting.whole), outer, within)
    s = ref.shift(g, float(shifting.length), i.longest)
    if phase is not None:
        s = where(i.liquid, s, 0.0)
    return {"shift": ref.bounded(s, float(shifting.largest) * i.longest)}
