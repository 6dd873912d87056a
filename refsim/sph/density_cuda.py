"""The density on CUDA: the sum of `kernels.density` over packed places and masses, each read ahead of its use."""

import math

import numpy as np

from refsim.backends.compile import kernel
from refsim.backends.primitives import four_of
from refsim.neighbours.formulas import to_nearest_image
from refsim.neighbours.rows import first_lane, over_lanes, row_of
from refsim.smoothing.formulas import kernel_value
from refsim.sph.kernels import own_share, wall_moment, wall_sum
from refsim.sph.packed_cuda import entry, places_with_masses


def density(position, mass, neighbours, walls, smoothing, fluid, period, scratch, number_density, asymmetry, density):
    """J(7) [kg/m^dim]; J(8) where `number_density` is requested, |sum W_ij x_ij| where `asymmetry` is."""
    placed = places_with_masses(position, mass, scratch)
    packed_density(placed, neighbours, walls, smoothing, fluid, period, number_density, asymmetry, density)


@kernel(lanes=True)
def packed_density(i, lane, placed, neighbours, walls, smoothing, fluid, period, number_density, asymmetry, density):
    """J(7) [kg/m^dim] and what else is requested. Rows of `placed`: x, m."""
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    limit = h * h
    real = type(h)
    rho, number = real(0), real(0)
    mx, my, mz = real(0), real(0), real(0)
    x, y, z, own_mass = four_of(placed, i)
    if count > 0:
        following = entry(neighbours, first, stride, count, 1)
        after = entry(neighbours, first, stride, count, 2)
        xj, yj, zj, m = four_of(placed, entry(neighbours, first, stride, count, 0))
        for k in range(count):
            xn, yn, zn, m_next = four_of(placed, following)
            following, after = after, entry(neighbours, first, stride, count, k + np.uint64(3))
            dx, dy, dz = to_nearest_image(x - xj, y - yj, z - zj, period)
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                w = kernel_value(math.sqrt(r2), smoothing)
                rho += m * w
                number += w
                if asymmetry is not None:
                    mx += w * dx
                    my += w * dy
                    mz += w * dz
            xj, yj, zj, m = xn, yn, zn, m_next
    if not number >= real(0):  # keeps the sum of W in every variant, so that the density has the same bits in all
        rho = number
    rho = over_lanes(rho, lane)
    if number_density is not None:
        number = over_lanes(number, lane)
    if asymmetry is not None:
        mx, my, mz = over_lanes(mx, lane), over_lanes(my, lane), over_lanes(mz, lane)
    if first_lane(lane):
        own = own_share(smoothing)
        rho += own_mass * own
        number += own
        if walls is not None:
            if asymmetry is None:
                filled = wall_sum(i, None, placed, walls, smoothing, period)
            else:
                filled, bx, by, bz = wall_moment(i, None, placed, walls, smoothing, period)
                weight = fluid.rest_density / own_mass
                mx += weight * bx
                my += weight * by
                mz += weight * bz
            filled *= fluid.rest_density
            rho += filled
            number += filled / own_mass
        density[i] = rho
        if number_density is not None:
            number_density[i] = number
        if asymmetry is not None:
            asymmetry[i] = math.sqrt(mx * mx + my * my + mz * mz)
