"""What one particle does in Akinci et al. 2013."""

import math

from refsim.backends.compile import kernel
from refsim.neighbours.rows import first_lane, over_lanes, row_of
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
