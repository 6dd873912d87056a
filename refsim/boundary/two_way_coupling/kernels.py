"""What one particle does in two-way coupling."""

import math

from refsim.backends.compile import formula, kernel
from refsim.boundary.two_way_coupling.formulas import (
    coupled_pressure_pair,
    coupled_viscosity_pair,
    coupled_wall_pressure_pair,
    tait_pressure,
    volume_ratio,
    weighted_pressure,
)
from refsim.neighbours.rows import first_lane, over_lanes, row_of
from refsim.shape_matching.phases import FLUID, INTERIOR, SURFACE
from refsim.smoothing.formulas import kernel_slope, kernel_value, viscosity_laplacian
from refsim.sph.kernels import own_share, wall_sum


@kernel(lanes=True)
def contribution(i, lane, position, phase, neighbours, smoothing, coupling, relative_contribution):
    """Weight of particle i in Shao & Song (1): 1 in the liquid, phi_i at a solid's surface, 0 inside; dimensionless."""
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    real = type(h)
    total = real(0)
    if phase[i] == SURFACE:
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        for k in range(count):
            j = neighbours.entries[first + k * stride]
            counted = phase[j] == SURFACE if coupling.printed_volume else phase[j] != FLUID
            if counted:
                dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
                r2 = dx * dx + dy * dy + dz * dz
                if r2 < h * h:
                    total += kernel_value(math.sqrt(r2), smoothing)
    total = over_lanes(total, lane)
    if first_lane(lane):
        weight = real(0)
        if phase[i] == FLUID:
            weight = real(1)
        elif phase[i] == SURFACE:
            weight = volume_ratio(total + own_share(smoothing), coupling)
        relative_contribution[i] = weight


@kernel(lanes=True)
def density(
    i, lane, position, mass, rest_density, phase, relative_contribution, neighbours, walls, smoothing, coupling,
    density, pressure, volume,
):  # fmt: skip
    """Shao & Song (1) [kg/m^dim], Tait's pressure [Pa], V = m/rho [m^dim]; solids keep rho0 and have no pressure."""
    rho = rest_density[i]
    p = type(rho)(0)
    if phase[i] == FLUID:
        first, stride, count = row_of(neighbours, i, lane)
        h = smoothing.support_radius
        limit = h * h
        total = type(h)(0)
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        for k in range(count):
            j = neighbours.entries[first + k * stride]
            dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                total += relative_contribution[j] * kernel_value(math.sqrt(r2), smoothing)
        total = over_lanes(total, lane)
        rho = mass[i] * (total + relative_contribution[i] * own_share(smoothing))
        if walls is not None:
            rho += rest_density[i] * wall_sum(i, lane, position, walls, smoothing, None)
        p = tait_pressure(rho, rest_density[i], coupling)
    if first_lane(lane):
        density[i] = rho
        pressure[i] = p
        volume[i] = mass[i] / rho


@kernel(lanes=True)
def forces(
    i, lane, position, velocity, mass, density, rest_density, phase, pressure, volume, relative_contribution,
    neighbours, walls, smoothing, coupling, viscosity, acceleration,
):  # fmt: skip
    """Shao & Song (2), (3) and the forces between liquids, walls included; added to the acceleration [m/s^2].

    A solid's particle gathers the reaction of the liquid around it.
    """
    if phase[i] == INTERIOR:
        return
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    fx, fy, fz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    own_fluid = phase[i] == FLUID
    own_volume, own_weight = volume[i], relative_contribution[i]
    own_push = own_volume * own_volume * pressure[i]
    across = own_push / mass[i] if coupling.printed_pressure else own_push
    for k in range(count):
        j = neighbours.entries[first + k * stride]
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
                mine, push, weight_j = across, real(0), relative_contribution[j]
                both = own_volume * weight_j
            elif not own_fluid:
                mine, weight_i = real(0), own_weight
                push = push / mass[j] if coupling.printed_pressure else push
                both = size * weight_i
            elif coupling.density_weighted:
                p = weighted_pressure(pressure[i], pressure[j], mass[i] / own_volume, mass[j] / size)
                mine, push = own_volume * own_volume * p, size * size * p
            f = coupled_pressure_pair(mine, push, weight_i, weight_j, kernel_slope(r, smoothing)) / (r + tiny)
            fx += f * dx
            fy += f * dy
            fz += f * dz
            if viscosity is not None:
                if own_fluid != fluid and not coupling.printed_viscosity:
                    both *= own_volume if own_fluid else size
                g = coupled_viscosity_pair(both, viscosity, viscosity_laplacian(r, smoothing))
                fx += g * (velocity[j, 0] - u)
                fy += g * (velocity[j, 1] - v)
                fz += g * (velocity[j, 2] - w)
    ax, ay, az = fx / mass[i], fy / mass[i], fz / mass[i]
    if walls is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if phase[i] == FLUID:
            bx, by, bz = wall_push(i, lane, position, density, rest_density, pressure, walls, smoothing)
            ax += bx
            ay += by
            az += bz
    ax, ay, az = over_lanes(ax, lane), over_lanes(ay, lane), over_lanes(az, lane)
    if first_lane(lane):
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@formula
def wall_push(i, lane, position, density, rest_density, pressure, walls, smoothing):
    """Acceleration [m/s^2] of particle i by walls after Shao & Song (2), or the lane's share of it."""
    first, stride, count = row_of(walls, i, lane)
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
            f = coupled_wall_pressure_pair(wall_mass, pressure[i], density[i], kernel_slope(r, smoothing)) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    return ax, ay, az
