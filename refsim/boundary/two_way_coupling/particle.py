"""What one particle does in two-way coupling; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`; the wall's row likewise.
"""

import math

from refsim.backends.compile import formula
from refsim.boundary.two_way_coupling.formulas import (
    pressure_pair,
    relative_contribution,
    viscosity_pair,
    wall_pressure_pair,
    weighted_pressure,
)
from refsim.shape_matching.phases import FLUID, SURFACE
from refsim.smoothing.formulas import kernel_slope, kernel_value, viscosity_laplacian


@formula
def solid_sum(i, row, position, phase, index, smoothing, coupling):
    """Sum of W_ij over the solid particles around particle i of a solid's surface [1/m^dim]; 0 for all others."""
    first, stride, count = row
    h = smoothing.support_radius
    total = type(h)(0)
    if phase[i] == SURFACE:
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        for k in range(count):
            j = index[first + k * stride]
            counted = phase[j] == SURFACE if coupling.printed_volume else phase[j] != FLUID
            if counted:
                dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
                r2 = dx * dx + dy * dy + dz * dz
                if r2 < h * h:
                    total += kernel_value(math.sqrt(r2), smoothing)
    return total


@formula
def contribution(i, total, phase, smoothing, coupling):
    """Weight of particle i in (1), from its solid_sum: 1 in the liquid, phi_i at a solid's surface, 0 inside."""
    real = type(total)
    weight = real(0)
    if phase[i] == FLUID:
        weight = real(1)
    elif phase[i] == SURFACE:
        weight = relative_contribution(total + kernel_value(real(0), smoothing), coupling)
    return weight


@formula
def weighted_sum(i, row, position, weight, index, smoothing):
    """Sum of phi_j W_ij over the liquid and solids around particle i [1/m^dim]."""
    first, stride, count = row
    h = smoothing.support_radius
    limit = h * h
    total = type(h)(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            total += weight[j] * kernel_value(math.sqrt(r2), smoothing)
    return total


@formula
def force(
    i, row, position, velocity, mass, phase, pressure, volume, weight, index, smoothing, coupling, viscosity
):  # fmt: skip
    """(2), (3) and the liquid's own forces: F_i [N] on particle i, liquid or solid; a solid gathers the reaction."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    fx, fy, fz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    own_fluid = phase[i] == FLUID
    own_volume, own_weight = volume[i], weight[i]
    own_push = own_volume * own_volume * pressure[i]
    across = own_push / mass[i] if coupling.printed_pressure else own_push
    for k in range(count):
        j = index[first + k * stride]
        fluid = phase[j] == FLUID
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit and (own_fluid or fluid):
            r = math.sqrt(r2)
            size = volume[j]
            push = size * size * pressure[j]
            both = own_volume * size
            mine, weight_i, weight_j = own_push, real(1), real(1)
            if own_fluid and not fluid:
                mine, push, weight_j = across, real(0), weight[j]
                both = own_volume * weight_j
            elif not own_fluid:
                mine, weight_i = real(0), own_weight
                push = push / mass[j] if coupling.printed_pressure else push
                both = size * weight_i
            elif coupling.density_weighted:
                p = weighted_pressure(pressure[i], pressure[j], mass[i] / own_volume, mass[j] / size)
                mine, push = own_volume * own_volume * p, size * size * p
            f = pressure_pair(mine, push, weight_i, weight_j, kernel_slope(r, smoothing)) / (r + tiny)
            fx += f * dx
            fy += f * dy
            fz += f * dz
            if viscosity is not None:
                if own_fluid != fluid and not coupling.printed_viscosity:
                    both *= own_volume if own_fluid else size
                g = viscosity_pair(both, viscosity, viscosity_laplacian(r, smoothing))
                fx += g * (velocity[j, 0] - u)
                fy += g * (velocity[j, 1] - v)
                fz += g * (velocity[j, 2] - w)
    return fx, fy, fz


@formula
def wall_pressure(i, row, position, density, rest_density, pressure, walls, smoothing):
    """(2) at walls: acceleration [m/s^2] of particle i."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx = position[i, 0] - walls.position[b, 0]
        dy = position[i, 1] - walls.position[b, 1]
        dz = position[i, 2] - walls.position[b, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < h * h:
            r = math.sqrt(r2)
            wall_mass = rest_density[i] * walls.volume[b]
            f = wall_pressure_pair(wall_mass, pressure[i], density[i], kernel_slope(r, smoothing)) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    return ax, ay, az
