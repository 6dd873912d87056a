"""What one pair of particles and one particle do in particle shifting."""

import math

from refsim.backends.compile import formula, kernel
from refsim.backends.reductions import reduction
from refsim.backends.tuples import added, difference, dot, scaled, three
from refsim.neighbours.forces import joined
from refsim.neighbours.formulas import longest_of
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector, set_vector
from refsim.particle_shifting.formulas import FULL, THIN, near_share, shifting_pair
from refsim.smoothing.formulas import kernel_value, undivided_factor
from refsim.sph.formulas import volume_of
from refsim.sph.kernels import LIQUID_PHASE, central_momentum_pair, specific_volume


@pair
def crowding_pair(r, x_ij, volume_j, density_j, smoothing, shifting):
    """V_j (1 + 0.2 (W_ij/W(d))^4) grad W_ij and V_j grad W_ij [1/m], V_j as `volume_of` says."""
    volume, slope = volume_of(volume_j, density_j), undivided_factor(r, smoothing)
    f, g = shifting_pair(volume, kernel_value(r, smoothing), slope, shifting), volume * slope
    return f * x_ij[0], f * x_ij[1], f * x_ij[2], g * x_ij[0], g * x_ij[1], g * x_ij[2]


@kernel(lanes=True)
def crowding(i, lane, position, volume, density, filling, phase, neighbours, walls, smoothing, shifting, period, way):
    """Displacement over v_max dt [-], see `put_way`."""
    s = neighbour_sum(crowding_pair, i, lane, neighbours, position, period, volume, density, smoothing, shifting)
    put_way(i, lane, s, position, filling, phase, walls, (smoothing, shifting), period, way)


@formula(inlined=True)
def put_way(i, lane, sums, position, filling, phase, walls, groups, period, way):
    """Write what `crowding` says [-] with the neighbours' gradients [1/m]; the walls' are added. None of solids."""
    smoothing, shifting = groups
    if walls is not None:
        beside = neighbour_sum(crowding_pair, i, lane, walls, position, period, walls.volume, None, smoothing, shifting)
        sums = added(sums, beside)
    zero, g = type(shifting.length)(0), sums[0:3]
    if filling is not None:
        n, filled = sums[3:6], filling[i] * shifting.whole
        squared, across = dot(n, n), difference(g, n)
        if not squared < shifting.least * shifting.least:
            across = scaled(n, dot(across, n) / squared)
        g = difference(g, scaled(n, near_share(filled, THIN, FULL)))
        g = difference(g, scaled(across, near_share(filled, shifting.outer, shifting.within)))
    s = scaled(g, -shifting.length)
    if phase is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if phase[i] != LIQUID_PHASE:
            s = zero, zero, zero
    squared = dot(s, s)
    if squared > shifting.largest * shifting.largest:
        s = scaled(s, shifting.largest / math.sqrt(squared))
    set_vector(way, i, lane, s)


SMOOTHING = {"smoothing": "gradient_smoothing"}
fused_pair = joined("fused_pair", (central_momentum_pair, SMOOTHING), (crowding_pair, SMOOTHING))


@kernel(lanes=True, registers=48)
def crowding_and_momentum(
    i, lane, position, velocity, volume, mass, density, pressure, filling, phase, neighbours, walls, gradient_smoothing,
    fluid, central_viscosity, shifting, period, acceleration, way,
):  # fmt: skip
    """`crowding`, and J(10) with the viscosity along the line of centres, added to the acceleration [m/s^2]."""
    sums = neighbour_sum(
        fused_pair, i, lane, neighbours, position, period, velocity, volume, density, pressure, gradient_smoothing,
        fluid, central_viscosity, shifting,
    )  # fmt: skip
    add_vector(acceleration, i, lane, scaled(sums[0:3], specific_volume(i, volume, mass, density)))
    put_way(i, lane, sums[3:9], position, filling, phase, walls, (gradient_smoothing, shifting), period, way)


@reduction(into="velocity_range", how=" ".join(6 * ["largest"]), rows="velocity", looping=True, parted=True)
def velocity_range(i, velocity, drawn_body):
    """Body of a particle, and its velocity [m/s] along each axis, and against it."""
    x, y, z = three(velocity, i)
    return body_of(i, drawn_body), x, y, z, -x, -y, -z


@formula
def body_of(i, drawn_body):
    """Number of the body of a particle; 0 where none are told apart."""
    if drawn_body is None:
        return 0
    return int(drawn_body[i])


@kernel(looping=True)
def longest_shift(k, velocity_range, shifting, timestep, longest_shift):
    """(7) v_max dt [m] of body k."""
    u = velocity_range
    box = u[k, 0] + u[k, 3], u[k, 1] + u[k, 4], u[k, 2] + u[k, 5]
    v_max = type(shifting.length)(0.5) * math.sqrt(dot(box, box))
    longest_shift[k] = min(v_max * timestep[1], shifting.farthest)


@kernel(looping=True)
def shift(i, way, longest_shift, drawn_body, shift):
    """Displacement of a step beside dt v [m]."""
    set_vector(shift, i, None, scaled(three(way, i), longest_of(i, longest_shift, drawn_body, way[i, 0])))
