"""Two-way coupling on CUDA: the loops of `kernels` over fields that are read ahead of their use (`sph.packed_cuda`)."""

import math

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel, kernel
from refsim.backends.primitives import four_of, set_four
from refsim.boundary.two_way_coupling.formulas import (
    coupled_pressure_pair,
    coupled_viscosity_pair,
    tait_pressure,
    volume_ratio,
    weighted_pressure,
)
from refsim.boundary.two_way_coupling.kernels import wall_push
from refsim.neighbours.rows import first_lane, over_lanes, row_of
from refsim.shape_matching.phases import FLUID, INTERIOR, SURFACE
from refsim.smoothing.formulas import kernel_slope, kernel_value, safe_distance, viscosity_laplacian
from refsim.sph.kernels import own_share, wall_sum
from refsim.sph.packed_cuda import entry


@kernel(lanes=True)
def contribution(i, lane, position, phase, neighbours, smoothing, coupling, relative_contribution):
    """Weight of particle i in Shao & Song (1): 1 in the liquid, phi_i at a solid's surface, 0 inside; dimensionless."""
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    total = real(0)
    if phase[i] == SURFACE and count > 0:
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        j = entry(neighbours, first, stride, count, 0)
        following = entry(neighbours, first, stride, count, 1)
        after = entry(neighbours, first, stride, count, 2)
        kind, xj, yj, zj = phase[j], position[j, 0], position[j, 1], position[j, 2]
        for k in range(count):
            next_kind, xn, yn, zn = (
                phase[following],
                position[following, 0],
                position[following, 1],
                position[following, 2],
            )
            following, after = after, entry(neighbours, first, stride, count, k + np.uint64(3))
            counted = kind == SURFACE if coupling.printed_volume else kind != FLUID
            dx, dy, dz = x - xj, y - yj, z - zj
            r2 = dx * dx + dy * dy + dz * dz
            if counted and r2 < limit:
                total += kernel_value(math.sqrt(r2), smoothing)
            kind, xj, yj, zj = next_kind, xn, yn, zn
    total = over_lanes(total, lane)
    if first_lane(lane):
        weight = real(0)
        if phase[i] == FLUID:
            weight = real(1)
        elif phase[i] == SURFACE:
            weight = volume_ratio(total + own_share(smoothing), coupling)
        relative_contribution[i] = weight


def density(
    position, mass, rest_density, phase, relative_contribution, neighbours, walls, smoothing, coupling, scratch,
    density, pressure, volume,
):  # fmt: skip
    """Shao & Song (1) [kg/m^dim], Tait's pressure [Pa], V = m/rho [m^dim]; solids keep rho0 and have no pressure."""
    placed = scratch.array("placed", (position.shape[0], 4), position.dtype)
    device.packed((position,), (relative_contribution,), (placed,))
    packed_density(placed, mass, rest_density, phase, neighbours, walls, smoothing, coupling, density, pressure, volume)


@kernel(lanes=True)
def packed_density(
    i, lane, placed, mass, rest_density, phase, neighbours, walls, smoothing, coupling, density, pressure, volume
):  # fmt: skip
    """As `density`. Rows of `placed`: x, relative contribution."""
    rho = rest_density[i]
    p = type(rho)(0)
    if phase[i] == FLUID:
        first, stride, count = row_of(neighbours, i, lane)
        h = smoothing.support_radius
        limit = h * h
        total = type(h)(0)
        x, y, z, own = four_of(placed, i)
        if count > 0:
            following = entry(neighbours, first, stride, count, 1)
            after = entry(neighbours, first, stride, count, 2)
            xj, yj, zj, share = four_of(placed, entry(neighbours, first, stride, count, 0))
            for k in range(count):
                xn, yn, zn, next_share = four_of(placed, following)
                following, after = after, entry(neighbours, first, stride, count, k + np.uint64(3))
                dx, dy, dz = x - xj, y - yj, z - zj
                r2 = dx * dx + dy * dy + dz * dz
                if r2 < limit:
                    total += share * kernel_value(math.sqrt(r2), smoothing)
                xj, yj, zj, share = xn, yn, zn, next_share
        total = over_lanes(total, lane)
        rho = mass[i] * (total + own * own_share(smoothing))
        if walls is not None:
            rho += rest_density[i] * wall_sum(i, lane, placed, walls, smoothing, None)
        p = tait_pressure(rho, rest_density[i], coupling)
    if first_lane(lane):
        density[i] = rho
        pressure[i] = p
        volume[i] = mass[i] / rho


def forces(
    position, velocity, mass, density, rest_density, phase, pressure, volume, relative_contribution, neighbours, walls,
    smoothing, coupling, viscosity, scratch, acceleration,
):  # fmt: skip
    """Shao & Song (2), (3) and the forces between liquids, walls included; added to the acceleration [m/s^2].

    A solid's particle gathers the reaction of the liquid around it.
    """
    names = ("placed", "moving", "shared")
    rows = tuple(scratch.array(name, (position.shape[0], 4), position.dtype) for name in names)
    pack(position, velocity, mass, phase, pressure, volume, relative_contribution, *rows)
    packed_forces(
        *rows, mass, density, rest_density, phase, pressure, neighbours, walls, smoothing, coupling, viscosity,
        acceleration,
    )  # fmt: skip


@cuda_kernel
def pack(position, velocity, mass, phase, pressure, volume, relative_contribution, placed, moving, shared):
    """Rows (x, V), (v, p) and (m, relative contribution, 1 in the liquid or 0, 0)."""
    i = cuda.grid(1)
    if i < placed.shape[0]:
        real = placed.dtype.type
        set_four(placed, i, position[i, 0], position[i, 1], position[i, 2], volume[i])
        set_four(moving, i, velocity[i, 0], velocity[i, 1], velocity[i, 2], pressure[i])
        fluid = real(1) if phase[i] == FLUID else real(0)
        set_four(shared, i, mass[i], relative_contribution[i], fluid, real(0))


@kernel(lanes=True)
def packed_forces(
    i, lane, placed, moving, shared, mass, density, rest_density, phase, pressure, neighbours, walls, smoothing,
    coupling, viscosity, acceleration,
):  # fmt: skip
    """As `forces`. Rows of `placed`, `moving` and `shared`: as in `pack`."""
    if phase[i] == INTERIOR:
        return
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    fx, fy, fz = real(0), real(0), real(0)
    x, y, z, own_volume = four_of(placed, i)
    u, v, w, own_pressure = four_of(moving, i)
    own_mass, own_weight, _, _ = four_of(shared, i)
    own_fluid = phase[i] == FLUID
    own_push = own_volume * own_volume * own_pressure
    across = own_push / own_mass if coupling.printed_pressure else own_push
    if count > 0:
        j = entry(neighbours, first, stride, count, 0)
        following = entry(neighbours, first, stride, count, 1)
        after = entry(neighbours, first, stride, count, 2)
        xj, yj, zj, size = four_of(placed, j)
        uj, vj, wj, pressure_j = four_of(moving, j)
        mass_j, contribution_j, liquid_j, _ = four_of(shared, j)
        for k in range(count):
            xn, yn, zn, next_size = four_of(placed, following)
            un, vn, wn, next_pressure = four_of(moving, following)
            next_mass, next_contribution, next_liquid, _ = four_of(shared, following)
            following, after = after, entry(neighbours, first, stride, count, k + np.uint64(3))
            fluid = liquid_j != real(0)
            dx, dy, dz = x - xj, y - yj, z - zj
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit and (own_fluid or fluid):
                r = math.sqrt(r2)
                push = size * size * pressure_j
                both = own_volume * size
                mine, weight_i, weight_j = own_push, real(1), real(1)
                if own_fluid and not fluid:
                    mine, push, weight_j = across, real(0), contribution_j
                    both = own_volume * weight_j
                elif not own_fluid:
                    mine, weight_i = real(0), own_weight
                    push = push / mass_j if coupling.printed_pressure else push
                    both = size * weight_i
                elif coupling.density_weighted:
                    p = weighted_pressure(own_pressure, pressure_j, own_mass / own_volume, mass_j / size)
                    mine, push = own_volume * own_volume * p, size * size * p
                f = coupled_pressure_pair(mine, push, weight_i, weight_j, kernel_slope(r, smoothing)) / safe_distance(
                    r, smoothing
                )
                fx += f * dx
                fy += f * dy
                fz += f * dz
                if viscosity is not None:
                    if own_fluid != fluid and not coupling.printed_viscosity:
                        both *= own_volume if own_fluid else size
                    g = coupled_viscosity_pair(both, viscosity, viscosity_laplacian(r, smoothing))
                    fx += g * (uj - u)
                    fy += g * (vj - v)
                    fz += g * (wj - w)
            xj, yj, zj, size = xn, yn, zn, next_size
            uj, vj, wj, pressure_j = un, vn, wn, next_pressure
            mass_j, contribution_j, liquid_j = next_mass, next_contribution, next_liquid
    ax, ay, az = fx / own_mass, fy / own_mass, fz / own_mass
    ax, ay, az = over_lanes(ax, lane), over_lanes(ay, lane), over_lanes(az, lane)
    if walls is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if own_fluid:
            bx, by, bz = wall_push(i, lane, placed, density, rest_density, pressure, walls, smoothing)
            ax += bx
            ay += by
            az += bz
    if first_lane(lane):
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
