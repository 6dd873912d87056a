"""What one particle does in Akinci et al. 2013."""

import math

from refsim.backends.compile import kernel
from refsim.neighbours.rows import first_lane, over_lanes, row_of
from refsim.smoothing.formulas import kernel_slope, viscosity_laplacian
from refsim.sph.formulas import pressure_pair, viscosity_pair
from refsim.sph.kernels import wall_pressure
from refsim.surface_tension.akinci_2013 import formulas


@kernel(lanes=True)
def tension(
    i, lane, position, mass, density, area_normal, neighbours, smoothing, fluid, spline, area_term, acceleration
):
    """Cohesion and area term, each unless None, with K_ij; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    nx, ny, nz = real(0), real(0), real(0)
    if area_term is not None:
        nx, ny, nz = area_normal[i, 0], area_normal[i, 1], area_normal[i, 2]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    own = density[i]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            share = formulas.correction_factor(own, density[j], fluid)
            if spline is not None:
                r = math.sqrt(r2)
                f = share * formulas.cohesion_pair(mass[j], r * smoothing.inverse_radius, spline) / (r + tiny)
                ax += f * dx
                ay += f * dy
                az += f * dz
            if area_term is not None:
                g = share * area_term.coefficient
                ax -= g * (nx - area_normal[j, 0])
                ay -= g * (ny - area_normal[j, 1])
                az -= g * (nz - area_normal[j, 2])
    ax, ay, az = over_lanes(ax, lane), over_lanes(ay, lane), over_lanes(az, lane)
    if first_lane(lane):
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@kernel(lanes=True)
def tension_and_momentum(
    i, lane, position, velocity, mass, density, pressure, area_normal, neighbours, walls, gradient_smoothing, fluid,
    viscosity, spline, area_term, acceleration,
):  # fmt: skip
    """Cohesion and area term with J(10) and J(11), walls after Akinci 2012; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i, lane)
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    bx, by, bz = real(0), real(0), real(0)
    nx, ny, nz = real(0), real(0), real(0)
    if area_term is not None:
        nx, ny, nz = area_normal[i, 0], area_normal[i, 1], area_normal[i, 2]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    rho, own = density[i], pressure[i]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            apart = r + tiny
            m, rho_j = mass[j], density[j]
            volume = m / (rho_j * apart)  # V_j/r
            f = pressure_pair(volume, own, pressure[j], kernel_slope(r, gradient_smoothing), fluid)
            ax += f * dx
            ay += f * dy
            az += f * dz
            if viscosity is not None:
                g = viscosity_pair(volume * apart, viscosity, viscosity_laplacian(r, gradient_smoothing))
                ax += g * (velocity[j, 0] - u)
                ay += g * (velocity[j, 1] - v)
                az += g * (velocity[j, 2] - w)
            share = formulas.correction_factor(rho, rho_j, fluid)
            if spline is not None:
                f = share * formulas.cohesion_pair(m, r * gradient_smoothing.inverse_radius, spline) / apart
                bx += f * dx
                by += f * dy
                bz += f * dz
            if area_term is not None:
                g = share * area_term.coefficient
                bx -= g * (nx - area_normal[j, 0])
                by -= g * (ny - area_normal[j, 1])
                bz -= g * (nz - area_normal[j, 2])
    ax, ay, az = ax / rho + bx, ay / rho + by, az / rho + bz
    if walls is not None:
        bx, by, bz = wall_pressure(i, position, density, pressure, walls, gradient_smoothing, fluid, lane, None)
        ax += bx
        ay += by
        az += bz
    ax, ay, az = over_lanes(ax, lane), over_lanes(ay, lane), over_lanes(az, lane)
    if first_lane(lane):
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@kernel
def adhesion(i, position, walls, smoothing, fluid, adhesion, acceleration):
    """Adhesion to the wall particles; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(walls, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            wall_mass = fluid.rest_density * walls.volume[b]
            f = formulas.adhesion_pair(wall_mass, r * smoothing.inverse_radius, adhesion) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    acceleration[i, 0] += ax
    acceleration[i, 1] += ay
    acceleration[i, 2] += az
