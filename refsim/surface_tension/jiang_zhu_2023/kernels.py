"""What one particle does in Jiang & Zhu 2023."""

import math

from refsim.backends.compile import formula, kernel
from refsim.neighbours.rows import first_lane, over_lanes, row_of
from refsim.smoothing.formulas import kernel_value
from refsim.sph.kernels import wall_sum
from refsim.surface_tension.jiang_zhu_2023 import formulas


@kernel
def corrected_density(i, position, mass, density, near_surface, neighbours, walls, smoothing, fluid, corrected_density):
    """J(14), J(15) near the surface, everywhere if `near_surface` is None; else the density itself [kg/m^dim]."""
    rho = density[i]
    if near_surface is None or near_surface[i] != 0:
        # A function of its own keeps the order of the sums: inlined, the compiler would add the walls' share earlier.
        mass_sum, volume_sum = density_sums(i, position, mass, density, neighbours, smoothing)
        if walls is not None:
            filled = fluid.rest_density * wall_sum(i, None, position, walls, smoothing, None)
            mass_sum += filled
            volume_sum += filled / rho
        rho = formulas.normalised_density(mass_sum, volume_sum)
    corrected_density[i] = rho


@formula
def density_sums(i, position, mass, density, neighbours, smoothing):
    """(sum_j m_j W_ij [kg/m^dim], sum_k (m_k/rho_k) W_ik [-]) over the fluid, self included."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    limit = h * h
    own = mass[i] * kernel_value(type(h)(0), smoothing)
    mass_sum = own
    volume_sum = own / density[i]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            w = mass[j] * kernel_value(math.sqrt(r2), smoothing)
            mass_sum += w
            volume_sum += w / density[j]
    return mass_sum, volume_sum


@kernel
def replace_density(i, corrected_density, density):
    """rho <- rho* [kg/m^dim]: whatever follows reads the corrected density."""
    density[i] = corrected_density[i]


@kernel
def soft_weight(i, surface_normal, soft, surface_weight):
    """Soft surface weight (Jiang & Zhu E9) of the length of J(19); dimensionless."""
    x, y, z = surface_normal[i, 0], surface_normal[i, 1], surface_normal[i, 2]
    surface_weight[i] = formulas.soft_weight(math.sqrt(x * x + y * y + z * z), soft)


@kernel(lanes=True)
def tension(
    i, lane, position, mass, density, surface_weight, surface, area_normal, neighbours, smoothing, pairs, cohesion,
    area, acceleration,
):  # fmt: skip
    """J(16) with J(17), and J(21) or J(18), each unless None; added to the acceleration [m/s^2]."""
    ax, ay, az = pair_sums(
        i, lane, position, mass, density, surface_weight, surface, area_normal, neighbours, smoothing, pairs, cohesion,
        area,
    )  # fmt: skip
    ax, ay, az = over_lanes(ax, lane), over_lanes(ay, lane), over_lanes(az, lane)
    if first_lane(lane):
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@formula
def pair_sums(
    i, lane, position, mass, density, surface_weight, surface, area_normal, neighbours, smoothing, pairs, cohesion, area
):
    """Acceleration of particle i by the pairs of its row, or of the lane's share of them [m/s^2]."""
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    base, slope = row_weights(i, lane, real(0), surface_weight, surface, neighbours, pairs)
    if base == real(0) and slope == real(0):
        return ax, ay, az
    bx, by, bz = real(0), real(0), real(0)
    nx, ny, nz = real(0), real(0), real(0)
    if area is not None:
        nx, ny, nz = area_normal[i, 0], area_normal[i, 1], area_normal[i, 2]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
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
def row_weights(i, lane, zero, surface_weight, surface, neighbours, pairs):
    """(base, slope) of the pair weights in row i, base + slope * (w_j or s_j); (0, 0) where no listed pair acts.

    A particle of the bulk thus reads the weights of its neighbours and nothing else of them. Dimensionless.
    """
    first, stride, count = row_of(neighbours, i, lane)
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
            j = neighbours.entries[first + k * stride]
            if surface_weight is not None:  # a NaN counts as 1, so that it stays visible
                largest = max(largest, zero if surface_weight[j] == zero else one)
            if surface is not None:
                largest = max(largest, real(surface[j]))
        if largest == zero:
            slope = zero
    return base, slope
