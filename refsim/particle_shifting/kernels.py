"""What one pair of particles and one particle do in particle shifting."""

import math

from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import added, over, scaled
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector, set_vector
from refsim.particle_shifting.formulas import SMALLEST_NORMAL, shifting_pair
from refsim.smoothing.formulas import gradient_factor, kernel_value
from refsim.sph.kernels import central_momentum_pair


@pair
def crowding_pair(r, x_ij, mass_j, density_j, smoothing, shifting):
    """Gradient of the concentration by a neighbour [1/m]."""
    f = shifting_pair(mass_j / density_j, kernel_value(r, smoothing), gradient_factor(r, smoothing), shifting)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@pair
def wall_crowding_pair(r, x_ij, volume_j, smoothing, shifting):
    """Gradient of the concentration by a wall particle [1/m]."""
    f = shifting_pair(volume_j, kernel_value(r, smoothing), gradient_factor(r, smoothing), shifting)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def crowding(
    i, lane, position, mass, density, neighbours, walls, smoothing, shifting, period, concentration_gradient
):  # fmt: skip
    """Gradient of the concentration [1/m]."""
    s = neighbour_sum(crowding_pair, i, lane, neighbours, position, period, mass, density, smoothing, shifting)
    set_vector(concentration_gradient, i, lane, with_walls(s, i, lane, position, walls, smoothing, shifting, period))


@formula
def with_walls(gradient, i, lane, position, walls, smoothing, shifting, period):
    """The gradient of the concentration [1/m] with the wall particles' part."""
    if walls is None:
        return gradient
    return added(
        gradient, neighbour_sum(wall_crowding_pair, i, lane, walls, position, period, walls.volume, smoothing, shifting)
    )


@pair
def fused_pair(
    r, x_ij, velocity_i, velocity_j, mass_j, density_j, pressure_i, pressure_j, gradient_smoothing, fluid,
    central_viscosity, shifting,
):  # fmt: skip
    """J(10) and the viscosity along the line of centres [N/m^3], gradient of the concentration [1/m]."""
    a = central_momentum_pair(
        r, x_ij, velocity_i, velocity_j, mass_j, density_j, pressure_i, pressure_j, gradient_smoothing, fluid,
        central_viscosity,
    )  # fmt: skip
    s = crowding_pair(r, x_ij, mass_j, density_j, gradient_smoothing, shifting)
    return a[0], a[1], a[2], s[0], s[1], s[2]


@kernel(lanes=True)
def crowding_and_momentum(
    i, lane, position, velocity, mass, density, pressure, neighbours, walls, gradient_smoothing, fluid,
    central_viscosity, shifting, period, acceleration, concentration_gradient,
):  # fmt: skip
    """Gradient of the concentration [1/m], and J(10) with the viscosity along the line of centres; the latter are
    added to the acceleration [m/s^2]."""
    sums = neighbour_sum(
        fused_pair, i, lane, neighbours, position, period, velocity, mass, density, pressure, gradient_smoothing, fluid,
        central_viscosity, shifting,
    )  # fmt: skip
    add_vector(acceleration, i, lane, over(sums[0:3], density[i]))
    s = with_walls(sums[3:6], i, lane, position, walls, gradient_smoothing, shifting, period)
    set_vector(concentration_gradient, i, lane, s)


@kernel
def shift(i, concentration_gradient, near_surface, surface_normal, shifting, extremes, timestep, shift):
    """Displacement of a step beside dt v [m]."""
    zero = type(shifting.length)(0)
    longest = math.sqrt(extremes[0]) * timestep[1]
    scale = -shifting.length * longest
    sx, sy, sz = scaled(
        (concentration_gradient[i, 0], concentration_gradient[i, 1], concentration_gradient[i, 2]), scale
    )
    if near_surface is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if near_surface[i]:
            nx, ny, nz = surface_normal[i, 0], surface_normal[i, 1], surface_normal[i, 2]
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            if length < type(length)(SMALLEST_NORMAL):
                sx, sy, sz = zero, zero, zero
            else:
                along = (sx * nx + sy * ny + sz * nz) / (length * length)
                sx, sy, sz = sx - along * nx, sy - along * ny, sz - along * nz
    size = math.sqrt(sx * sx + sy * sy + sz * sz)
    most = shifting.largest * longest
    if size > most:
        sx, sy, sz = sx * (most / size), sy * (most / size), sz * (most / size)
    set_vector(shift, i, None, (sx, sy, sz))
