"""What one particle does in Jiang & Zhu 2023; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`.
"""

import math

from refsim.compile import formula
from refsim.smoothing.formulas import kernel_value
from refsim.surface_tension.jiang_zhu_2023 import formulas


@formula
def density_sums(i, row, position, mass, density, index, smoothing):
    """J(14), J(15) over the fluid, self included: (sum m_j W_ij, sum (m_k/rho_k) W_ik)."""
    first, stride, count = row
    h = smoothing.support_radius
    limit = h * h
    own = mass[i] * kernel_value(type(h)(0), smoothing)
    mass_sum = own
    volume_sum = own / density[i]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            w = mass[j] * kernel_value(math.sqrt(r2), smoothing)
            mass_sum += w
            volume_sum += w / density[j]
    return mass_sum, volume_sum


@formula
def soft_weight(i, surface_normal, soft):
    """Soft surface weight of particle i from its color-gradient normal J(19)."""
    x, y, z = surface_normal[i, 0], surface_normal[i, 1], surface_normal[i, 2]
    return formulas.soft_weight(math.sqrt(x * x + y * y + z * z), soft)


@formula
def tension(
    i, row, position, mass, density, surface_weight, surface, area_normal, index, smoothing, pairs, cohesion, area
):
    """J(16) and J(21) or J(18), each unless None: acceleration of particle i [m/s^2].

    Whether a pair acts at all is asked first, because the weight is all that most rows of the bulk have to read.
    """
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    zero, one = real(0), real(1)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = zero, zero, zero
    weight_i, weight_j = zero, zero
    surface_i, surface_j = 0, 0
    if surface_weight is not None:
        weight_i = surface_weight[i]
    if surface is not None:
        surface_i = surface[i]
    if formulas.pair_weight(pairs.mode, weight_i, one, surface_i, 1) <= zero:
        return ax, ay, az
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        if surface_weight is not None:
            weight_j = surface_weight[j]
        if surface is not None:
            surface_j = surface[j]
        share = formulas.pair_weight(pairs.mode, weight_i, weight_j, surface_i, surface_j)
        if share <= zero:  # a NaN goes on and stays visible
            continue
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            if cohesion is not None:
                r = math.sqrt(r2)
                f = share * formulas.cohesion_pair(mass[j], r * smoothing.inverse_radius, cohesion) / (r + tiny)
                ax += f * dx
                ay += f * dy
                az += f * dz
            if area is not None:
                g = share * formulas.area_pair(mass[j], density[i], density[j], area)
                ax += g * (area_normal[i, 0] - area_normal[j, 0])
                ay += g * (area_normal[i, 1] - area_normal[j, 1])
                az += g * (area_normal[i, 2] - area_normal[j, 2])
    return ax, ay, az
