"""What one pair of particles and one particle do in particle shifting."""

import math

from refsim.backends.compile import kernel
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
    sx, sy, sz = neighbour_sum(crowding_pair, i, lane, neighbours, position, period, mass, density, smoothing, shifting)
    if walls is not None:
        wx, wy, wz = neighbour_sum(
            wall_crowding_pair, i, lane, walls, position, period, walls.volume, smoothing, shifting
        )
        sx, sy, sz = sx + wx, sy + wy, sz + wz
    if first_lane(lane):
        zero = type(shifting.length)(0)
        longest = math.sqrt(extremes[0]) * timestep[1]
        scale = -shifting.length * longest
        sx, sy, sz = scale * sx, scale * sy, scale * sz
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
        shift[i, 0] = sx
        shift[i, 1] = sy
        shift[i, 2] = sz
