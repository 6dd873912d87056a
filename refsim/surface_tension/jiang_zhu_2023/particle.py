"""What one particle does in Jiang & Zhu 2023; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`.
"""

import math

from refsim.backends.compile import formula
from refsim.smoothing.formulas import kernel_slope, kernel_value, viscosity_laplacian
from refsim.sph.formulas import pressure_pair, viscosity_pair
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
def row_share(i, row, zero, surface_weight, surface, index, pairs):
    """(base, slope) of the pair weights in row i, base + slope * (w_j or s_j); (0, 0) where no listed pair acts.

    In the bulk this reads nothing but the neighbours' weights, and that is all that a particle of the bulk costs.
    """
    first, stride, count = row
    real = type(zero)
    one = real(1)
    weight_i, surface_i = zero, 0
    if surface_weight is not None:
        weight_i = surface_weight[i]
    if surface is not None:
        surface_i = surface[i]
    base, slope = formulas.pair_weight(pairs.mode, weight_i, surface_i)
    if base == zero and slope != zero:
        largest = zero
        for k in range(count):
            j = index[first + k * stride]
            if surface_weight is not None:
                largest = max(largest, zero if surface_weight[j] == zero else one)  # a NaN acts, to stay visible
            if surface is not None:
                largest = max(largest, real(surface[j]))
        if largest == zero:
            slope = zero
    return base, slope


@formula
def tension(
    i, row, position, mass, density, surface_weight, surface, area_normal, index, smoothing, pairs, cohesion, area
):
    """J(16) and J(21) or J(18), each unless None: acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    base, slope = row_share(i, row, real(0), surface_weight, surface, index, pairs)
    if base == real(0) and slope == real(0):
        return ax, ay, az
    bx, by, bz = real(0), real(0), real(0)
    nx, ny, nz = real(0), real(0), real(0)
    if area is not None:
        nx, ny, nz = area_normal[i, 0], area_normal[i, 1], area_normal[i, 2]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            share = base
            if surface_weight is not None:
                share += slope * surface_weight[j]
            if surface is not None:
                share += slope * real(surface[j])
            if cohesion is not None:
                r = math.sqrt(r2)
                f = share * formulas.cohesion_pair(mass[j], r * smoothing.inverse_radius, cohesion) / (r + tiny)
                ax += f * dx
                ay += f * dy
                az += f * dz
            if area is not None:
                g = share * formulas.area_pair(mass[j], density[j], area)
                bx += g * (nx - area_normal[j, 0])
                by += g * (ny - area_normal[j, 1])
                bz += g * (nz - area_normal[j, 2])
    if area is not None:
        strength = formulas.area_strength(density[i], area)
        ax -= strength * bx
        ay -= strength * by
        az -= strength * bz
    return ax, ay, az


@formula
def momentum(
    i, row, position, velocity, mass, density, pressure, area_normal, index, smoothing, fluid, viscosity, cohesion, area
):
    """J(16) between all pairs and J(21) or J(18), each unless None, with J(10) and J(11): acceleration [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    cx, cy, cz = real(0), real(0), real(0)
    bx, by, bz = real(0), real(0), real(0)
    nx, ny, nz = real(0), real(0), real(0)
    if area is not None:
        nx, ny, nz = area_normal[i, 0], area_normal[i, 1], area_normal[i, 2]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    rho, own = density[i], pressure[i]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            apart = r + tiny
            m, rho_j = mass[j], density[j]
            volume = m / (rho_j * apart)  # V_j/r
            f = pressure_pair(volume, own, pressure[j], kernel_slope(r, smoothing), fluid)
            ax += f * dx
            ay += f * dy
            az += f * dz
            if viscosity is not None:
                g = viscosity_pair(volume * apart, viscosity, viscosity_laplacian(r, smoothing))
                ax += g * (velocity[j, 0] - u)
                ay += g * (velocity[j, 1] - v)
                az += g * (velocity[j, 2] - w)
            if cohesion is not None:
                f = formulas.cohesion_pair(m, r * smoothing.inverse_radius, cohesion) / apart
                cx += f * dx
                cy += f * dy
                cz += f * dz
            if area is not None:
                g = formulas.area_pair(m, rho_j, area)
                bx += g * (nx - area_normal[j, 0])
                by += g * (ny - area_normal[j, 1])
                bz += g * (nz - area_normal[j, 2])
    if area is not None:
        strength = formulas.area_strength(rho, area)
        cx -= strength * bx
        cy -= strength * by
        cz -= strength * bz
    return ax / rho + cx, ay / rho + cy, az / rho + cz
