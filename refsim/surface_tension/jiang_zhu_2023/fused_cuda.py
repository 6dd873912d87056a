"""Jiang & Zhu 2023 on CUDA: tension, pressure and viscosity in one loop over packed fields, read ahead."""

import math

import numpy as np

from refsim.backends.compile import kernel
from refsim.backends.primitives import four_of
from refsim.neighbours.rows import first_lane, over_lanes, row_of
from refsim.smoothing.formulas import kernel_slope, safe_distance, viscosity_laplacian
from refsim.sph.formulas import pressure_pair, viscosity_pair
from refsim.sph.kernels import wall_pressure
from refsim.sph.packed_cuda import entry, packed_fields
from refsim.surface_tension.jiang_zhu_2023 import formulas


def tension_and_momentum(
    position, velocity, mass, density, pressure, area_normal, neighbours, walls, gradient_smoothing, fluid, viscosity,
    cohesion, area, scratch, acceleration,
):  # fmt: skip
    """J(16) between all pairs and J(21) or J(18), each unless None, with J(10) and J(11), walls after Akinci 2012.

    Added to the acceleration [m/s^2].
    """
    normal = None if area is None else area_normal
    placed, moving, directed = packed_fields(position, velocity, mass, density, pressure, normal, scratch)
    packed_sums(
        placed, moving, directed, density, pressure, neighbours, walls, gradient_smoothing, fluid, viscosity,
        cohesion, area, acceleration,
    )  # fmt: skip


@kernel(lanes=True)
def packed_sums(
    i, lane, placed, moving, directed, density, pressure, neighbours, walls, gradient_smoothing, fluid,
    viscosity, cohesion, area, acceleration,
):  # fmt: skip
    """J(16) between all pairs and J(21) or J(18), each unless None, with J(10) and J(11), walls after Akinci 2012.

    Added to the acceleration [m/s^2]. Rows of `placed`, `moving` and `directed`: x, m; v, p; normal, density.
    """
    first, stride, count = row_of(neighbours, i, lane)
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    ax, ay, az = real(0), real(0), real(0)
    cx, cy, cz = real(0), real(0), real(0)
    bx, by, bz = real(0), real(0), real(0)
    nx, ny, nz = real(0), real(0), real(0)
    if area is not None:
        nx, ny, nz = directed[i, 0], directed[i, 1], directed[i, 2]
    x, y, z, _ = four_of(placed, i)
    u, v, w, own = four_of(moving, i)
    rho = density[i]
    if count > 0:
        j = entry(neighbours, first, stride, count, 0)
        following = entry(neighbours, first, stride, count, 1)
        after = entry(neighbours, first, stride, count, 2)
        xj, yj, zj, m = four_of(placed, j)
        uj, vj, wj, pressure_j = four_of(moving, j)
        if area is None:
            rho_j = density[j]
        else:
            nxj, nyj, nzj, rho_j = four_of(directed, j)
        for k in range(count):
            xn, yn, zn, m_next = four_of(placed, following)
            un, vn, wn, pressure_next = four_of(moving, following)
            if area is None:
                rho_next = density[following]
            else:
                nxn, nyn, nzn, rho_next = four_of(directed, following)
            following, after = after, entry(neighbours, first, stride, count, k + np.uint64(3))
            dx, dy, dz = x - xj, y - yj, z - zj
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                r = math.sqrt(r2)
                apart = safe_distance(r, gradient_smoothing)
                volume = m / (rho_j * apart)  # V_j/r
                f = pressure_pair(volume, own, pressure_j, kernel_slope(r, gradient_smoothing), fluid)
                ax += f * dx
                ay += f * dy
                az += f * dz
                if viscosity is not None:
                    g = viscosity_pair(volume * apart, viscosity, viscosity_laplacian(r, gradient_smoothing))
                    ax += g * (uj - u)
                    ay += g * (vj - v)
                    az += g * (wj - w)
                if cohesion is not None:
                    f = formulas.cohesion_pair(m, r * gradient_smoothing.inverse_radius, cohesion) / apart
                    cx += f * dx
                    cy += f * dy
                    cz += f * dz
                if area is not None:
                    g = formulas.area_pair(m, rho_j, area)
                    bx += g * (nx - nxj)
                    by += g * (ny - nyj)
                    bz += g * (nz - nzj)
            xj, yj, zj, m = xn, yn, zn, m_next
            uj, vj, wj, pressure_j, rho_j = un, vn, wn, pressure_next, rho_next
            if area is not None:
                nxj, nyj, nzj = nxn, nyn, nzn
    if area is not None:
        strength = formulas.area_strength(rho, area)
        cx -= strength * bx
        cy -= strength * by
        cz -= strength * bz
    ax, ay, az = ax / rho + cx, ay / rho + cy, az / rho + cz
    ax, ay, az = over_lanes(ax, lane), over_lanes(ay, lane), over_lanes(az, lane)
    if walls is not None:
        bx, by, bz = wall_pressure(i, lane, placed, density, pressure, walls, gradient_smoothing, fluid, None)
        ax += bx
        ay += by
        az += bz
    if first_lane(lane):
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
