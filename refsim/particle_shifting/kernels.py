"""What one pair of particles and one particle do in particle shifting."""

import math

from refsim.backends.compile import formula, kernel
from refsim.backends.reductions import reduction
from refsim.backends.tuples import added, difference, dot, over, scaled, three
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector, set_vector
from refsim.particle_shifting.formulas import FULL, THIN, near_share, shifting_pair
from refsim.smoothing.formulas import (
    gradient_factor,
    kernel_slope,
    kernel_value,
    safe_distance,
    viscosity_laplacian,
)
from refsim.sph.formulas import central_viscosity_pair, pressure_pair, volume_of
from refsim.sph.kernels import LIQUID_PHASE


@pair
def crowding_pair(r, x_ij, mass_j, density_j, smoothing, shifting):
    """V_j (1 + 0.2 (W_ij/W(d))^4) grad W_ij and V_j grad W_ij [1/m], V_j as `volume_of` says."""
    volume, slope = volume_of(mass_j, density_j), gradient_factor(r, smoothing)
    f, g = shifting_pair(volume, kernel_value(r, smoothing), slope, shifting), volume * slope
    return f * x_ij[0], f * x_ij[1], f * x_ij[2], g * x_ij[0], g * x_ij[1], g * x_ij[2]


@kernel(lanes=True)
def crowding(
    i, lane, position, mass, density, neighbours, walls, smoothing, shifting, period, filling_gradient,
    concentration_gradient,
):  # fmt: skip
    """Gradients of the concentration and of the filling [1/m]."""
    s = neighbour_sum(crowding_pair, i, lane, neighbours, position, period, mass, density, smoothing, shifting)
    put_gradients(i, lane, s, position, walls, smoothing, shifting, period, filling_gradient, concentration_gradient)


@formula(inlined=True)
def put_gradients(
    i, lane, sums, position, walls, smoothing, shifting, period, filling_gradient, concentration_gradient
):  # fmt: skip
    """Write what `crowding` says [1/m] with the neighbours' sums; the walls' are added."""
    if walls is not None:
        beside = neighbour_sum(crowding_pair, i, lane, walls, position, period, walls.volume, None, smoothing, shifting)
        sums = added(sums, beside)
    set_vector(concentration_gradient, i, lane, sums[0:3])
    if filling_gradient is not None:
        set_vector(filling_gradient, i, lane, sums[3:6])


@pair
def fused_pair(
    r, x_ij, velocity_i, velocity_j, mass_j, density_j, pressure_i, pressure_j, gradient_smoothing, fluid,
    central_viscosity, shifting,
):  # fmt: skip
    """J(10) and, unless `central_viscosity` is None, the viscosity along the line of centres [N/m^3]; gradients of
    concentration and filling [1/m]."""
    apart = safe_distance(r, gradient_smoothing)
    inverse = type(r)(1) / (density_j * apart)  # one division serves all terms
    share = mass_j * inverse  # V_j/r
    slope = kernel_slope(r, gradient_smoothing)
    p = pressure_pair(share, pressure_i, pressure_j, slope, fluid)
    if central_viscosity is not None:
        parting = dot(difference(velocity_j, velocity_i), x_ij)
        laplacian = viscosity_laplacian(r, gradient_smoothing)
        p += central_viscosity_pair(share, central_viscosity, laplacian) * (parting * (density_j * inverse))
    a = scaled(x_ij, p)
    f = shifting_pair(share, kernel_value(r, gradient_smoothing), slope, shifting)
    g = share * slope
    return a[0], a[1], a[2], f * x_ij[0], f * x_ij[1], f * x_ij[2], g * x_ij[0], g * x_ij[1], g * x_ij[2]


@kernel(lanes=True)
def crowding_and_momentum(
    i, lane, position, velocity, mass, density, pressure, neighbours, walls, gradient_smoothing, fluid,
    central_viscosity, shifting, period, acceleration, filling_gradient, concentration_gradient,
):  # fmt: skip
    """Gradients of concentration and filling [1/m], and J(10) with the viscosity along the line of centres; the latter
    are added to the acceleration [m/s^2]."""
    sums = neighbour_sum(
        fused_pair, i, lane, neighbours, position, period, velocity, mass, density, pressure, gradient_smoothing, fluid,
        central_viscosity, shifting,
    )  # fmt: skip
    add_vector(acceleration, i, lane, over(sums[0:3], density[i]))
    put_gradients(
        i, lane, sums[3:9], position, walls, gradient_smoothing, shifting, period, filling_gradient,
        concentration_gradient,
    )  # fmt: skip


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


@kernel
def shift(
    i, concentration_gradient, filling, filling_gradient, phase, drawn_body, shifting, velocity_range, timestep, shift
):  # fmt: skip
    """Displacement of a step beside dt v [m]; none of solids."""
    zero, u, k = type(shifting.length)(0), velocity_range, body_of(i, drawn_body)
    box = u[k, 0] + u[k, 3], u[k, 1] + u[k, 4], u[k, 2] + u[k, 5]
    longest = min(type(shifting.length)(0.5) * math.sqrt(dot(box, box)) * timestep[1], shifting.farthest)
    g = three(concentration_gradient, i)
    if filling is not None:
        n, filled = three(filling_gradient, i), filling[i] * shifting.whole
        length, across = math.sqrt(dot(n, n)), difference(g, n)
        if not length < shifting.least:
            across = scaled(n, dot(across, n) / (length * length))
        g = difference(g, scaled(n, near_share(filled, THIN, FULL)))
        g = difference(g, scaled(across, near_share(filled, shifting.outer, shifting.within)))
    s = scaled(g, -shifting.length * longest)
    if phase is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if phase[i] != LIQUID_PHASE:
            s = zero, zero, zero
    size = math.sqrt(dot(s, s))
    most = shifting.largest * longest
    if size > most:
        s = scaled(s, most / size)
    set_vector(shift, i, None, s)
