"""What one particle does in Akinci et al. 2013; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`; the wall's row likewise.
"""

import math

from refsim.backends.compile import formula
from refsim.smoothing.formulas import kernel_slope, viscosity_laplacian
from refsim.sph.formulas import pressure_pair, viscosity_pair
from refsim.surface_tension.akinci_2013 import formulas


@formula
def tension(i, row, position, mass, density, area_normal, index, smoothing, fluid, spline, area_term):
    """Cohesion and area term, each unless None: acceleration of particle i [m/s^2]."""
    first, stride, count = row
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
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            share = formulas.correction(own, density[j], fluid)
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
    return ax, ay, az


@formula
def momentum(
    i, row, position, velocity, mass, density, pressure, area_normal, index, smoothing, fluid, viscosity, spline,
    area_term,
):  # fmt: skip
    """Cohesion and area term together with J(10) and J(11): acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
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
            share = formulas.correction(rho, rho_j, fluid)
            if spline is not None:
                f = share * formulas.cohesion_pair(m, r * smoothing.inverse_radius, spline) / apart
                bx += f * dx
                by += f * dy
                bz += f * dz
            if area_term is not None:
                g = share * area_term.coefficient
                bx -= g * (nx - area_normal[j, 0])
                by -= g * (ny - area_normal[j, 1])
                bz -= g * (nz - area_normal[j, 2])
    return ax / rho + bx, ay / rho + by, az / rho + bz


@formula
def adhesion(i, row, position, walls, smoothing, fluid, adhesion):
    """Adhesion to the walls: acceleration of particle i [m/s^2]."""
    first, stride, count = row
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
    return ax, ay, az
