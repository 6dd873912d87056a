"""What one pair of particles and one particle do in particle shifting."""

import math

from refsim.backends.compile import kernel
from refsim.backends.tuples import added, difference, dot, put, scaled, three
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import first_lane
from refsim.particle_shifting.formulas import SMALLEST_NORMAL, shifting_pair
from refsim.smoothing.formulas import gradient_factor, kernel_value


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
def shift(
    i, lane, position, mass, density, near_surface, surface_normal, neighbours, walls, smoothing, shifting, period,
    extremes, timestep, shift,
):  # fmt: skip
    """Displacement of a step beside dt v [m]."""
    s = neighbour_sum(crowding_pair, i, lane, neighbours, position, period, mass, density, smoothing, shifting)
    if walls is not None:
        s = added(
            s, neighbour_sum(wall_crowding_pair, i, lane, walls, position, period, walls.volume, smoothing, shifting)
        )
    if first_lane(lane):
        zero = type(shifting.length)(0)
        longest = math.sqrt(extremes[0]) * timestep[1]
        s = scaled(s, -shifting.length * longest)
        if near_surface is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
            if near_surface[i]:
                n = three(surface_normal, i)
                length = math.sqrt(dot(n, n))
                if length < type(length)(SMALLEST_NORMAL):
                    s = zero, zero, zero
                else:
                    s = difference(s, scaled(n, dot(s, n) / (length * length)))
        size = math.sqrt(dot(s, s))
        most = shifting.largest * longest
        if size > most:
            s = scaled(s, most / size)
        put(shift, i, s)
