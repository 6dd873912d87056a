"""What one particle does for its surface normal."""

import math

from refsim.backends.compile import formula, kernel
from refsim.neighbours.rows import first_lane, over_lanes, row_of
from refsim.smoothing.formulas import kernel_slope, kernel_value
from refsim.sph.kernels import wall_sum
from refsim.surface_normal.formulas import color_gradient_pair, corrected_pair, neighbour_volume


@kernel(lanes=True)
def color_gradient(
    i, lane, position, mass, density, candidates, neighbours, walls, gradient_smoothing, normal_term, surface_normal
):  # fmt: skip
    """J(19) n_i = h sum_j V_j grad W_ij, walls included; dimensionless. Zero for a particle that is no candidate."""
    h = gradient_smoothing.support_radius
    real = type(h)
    nx, ny, nz = real(0), real(0), real(0)
    if candidates is None or candidates[i] != 0:
        first, stride, count = row_of(neighbours, i, lane)
        limit = h * h
        tiny = real(1e-9) * h
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        own = density[i]
        for k in range(count):
            j = neighbours.entries[first + k * stride]
            dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                r = math.sqrt(r2)
                volume = neighbour_volume(mass[j], own, density[j], normal_term.own_density)
                f = color_gradient_pair(volume, kernel_slope(r, gradient_smoothing), h) / (r + tiny)
                nx += f * dx
                ny += f * dy
                nz += f * dz
        if walls is not None:
            bx, by, bz = wall_color_gradient(i, position, walls, gradient_smoothing, lane)
            nx += bx
            ny += by
            nz += bz
        nx, ny, nz = over_lanes(nx, lane), over_lanes(ny, lane), over_lanes(nz, lane)
    if first_lane(lane):
        surface_normal[i, 0] = nx
        surface_normal[i, 1] = ny
        surface_normal[i, 2] = nz


@formula
def wall_color_gradient(i, position, walls, gradient_smoothing, lane):
    """J(19) over the wall particles, or over the lane's share of them: h sum_b V_b grad W_ib; dimensionless."""
    first, stride, count = row_of(walls, i, lane)
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    nx, ny, nz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            f = color_gradient_pair(walls.volume[b], kernel_slope(r, gradient_smoothing), h) / (r + tiny)
            nx += f * dx
            ny += f * dy
            nz += f * dz
    return nx, ny, nz


@kernel
def corrected(
    i, position, mass, density, number_density, candidates, neighbours, walls, smoothing, gradient_smoothing,
    normal_term, corrected_normal,
):  # fmt: skip
    """J(20), divided by sum_k V_k W_ik over particles, the own one and walls [1/m]; zero for one that is no
    candidate."""
    h = smoothing.support_radius
    real = type(h)
    nx, ny, nz, filled = real(0), real(0), real(0), real(1)
    if candidates is None or candidates[i] != 0:
        first, stride, count = row_of(neighbours, i)
        limit = h * h
        tiny = real(1e-9) * h
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        own, number = density[i], number_density[i]
        filled = mass[i] / own * kernel_value(real(0), smoothing)
        for k in range(count):
            j = neighbours.entries[first + k * stride]
            dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                r = math.sqrt(r2)
                filled += mass[j] / density[j] * kernel_value(r, smoothing)
                volume = neighbour_volume(mass[j], own, density[j], normal_term.own_density)
                slope = kernel_slope(r, gradient_smoothing)
                rest = normal_term.rest_number_density
                f = corrected_pair(number, number_density[j], rest, volume, slope) / (r + tiny)
                nx += f * dx
                ny += f * dy
                nz += f * dz
        if walls is not None:
            filled += wall_sum(i, None, position, walls, smoothing, None)
    corrected_normal[i, 0] = nx / filled
    corrected_normal[i, 1] = ny / filled
    corrected_normal[i, 2] = nz / filled
