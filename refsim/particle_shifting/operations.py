"""Operations of particle shifting: which equations make each, its kernels, variants, tolerance and why."""

import numpy as np

from refsim.core.operation import Program, operations
from refsim.core.terms import where
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.particle_shifting import reference as ref
from refsim.sph.operations import shifts, volume_of

operation = operations(paper="Sun et al. 2017")
FUSED = {
    name: Program(
        "kernels", "crowding_and_momentum", also=("sph.central_momentum",), names={"smoothing": "gradient_smoothing"},
        variants=(
            "density walls period phase", "walls filling central_viscosity velocity", "density period phase"
        ),
        packed=packed,
    )
    for name, packed in (("cpu:fused", ""), ("cuda:fused", "fused_pair"))
}  # fmt: skip


@operation(
    "(7), gradients of concentration and filling; tangential at the surface", outputs="way", tolerance=16.0,
    reason="one rounding in each of distance, kernel, slope, a root, a length, products and sums of the projection, and"
    " the bound, and four in the power; beside a surface the size counts the filling 67 times, as its last 3 % decide",
    variants=("walls period filling density phase", "period filling", "density period phase", "density"),
    invariants="translation reordering", programs=FUSED, packed="crowding_pair",
)  # fmt: skip
def crowding(position, volume, density, filling, phase, walls, smoothing, shifting, period, rows=None):
    """Displacement of a step beside dt v over v_max dt [-], at most `largest`; none of solids (`phase` not 0).

    volume  V [m^dim], or m [kg] where a density is given
    """
    own = Fields(
        position=position, volume=volume_of(volume, density), filling=filling,
        liquid=None if phase is None else np.asarray(phase) == 0,
    )  # fmt: skip
    around, at_walls = (neighbours(own, j, smoothing, period=period, rows=rows) for j in (own, wall_particles(walls)))
    inverse = float(shifting.inverse_neighbour)
    g = around(ref.concentration_gradient, inverse=inverse) + at_walls(ref.concentration_gradient, inverse=inverse)
    if filling is not None:
        n = around(ref.filling_gradient) + at_walls(ref.filling_gradient)
        g = ref.beside_surface(g, n, around.i.filling, *map(float, shifting[3:7]))
    s = ref.shift(g, float(shifting.length))
    if phase is not None:
        s = where(around.i.liquid, s, 0.0)
    return {"way": ref.bounded(s, float(shifting.largest))}


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
    "(7), v_max dt", outputs="longest_shift", tolerance=8.0,
    reason="one rounding in each of a root and its terms, and the products",
)  # fmt: skip
def longest_shift(velocity_range, shifting, timestep):
    """v_max dt [m] of each body, v_max half of the diagonal of the box of its velocities; `timestep` has dt second."""
    of_bodies, dt = np.asarray(velocity_range, dtype=float).reshape(-1, 2, 3), float(timestep[1])
    longest = np.array([ref.largest_step(*ends, dt, float(shifting.farthest)) for ends in of_bodies])
    return {"longest_shift": (longest, longest)}


@operation(
    "(7)", outputs="shift", reason="one rounding in the product", variants=("drawn_body", ""), invariants="reordering",
)  # fmt: skip
def shift(way, longest_shift, drawn_body, rows=None):
    """Displacement [m] of a step beside dt v: `way` v_max dt."""
    return {"shift": Fields(s=shifts(way, longest_shift, drawn_body)).at(rows).s}
