"""What one particle does in weakly compressible SPH."""

import math

from refsim.backends.compile import formula, kernel
from refsim.neighbours.rows import first_lane, over_lanes, row_of
from refsim.smoothing.formulas import kernel_slope, kernel_value, viscosity_laplacian
from refsim.sph import formulas
from refsim.sph.formulas import central_viscosity_pair, pressure_pair, viscosity_pair, wall_pressure_pair


@kernel(lanes=True)
def density(i, lane, position, mass, neighbours, walls, smoothing, fluid, number_density, asymmetry, density):
    """J(7) [kg/m^dim]; J(8) where `number_density` is requested, |sum W_ij x_ij| where `asymmetry` is."""
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    limit = h * h
    real = type(h)
    rho, number = real(0), real(0)
    mx, my, mz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            w = kernel_value(math.sqrt(r2), smoothing)
            rho += mass[j] * w
            number += w
            if asymmetry is not None:
                mx += w * dx
                my += w * dy
                mz += w * dz
    if not number >= real(0):  # keeps the sum of W in every variant, so that the density has the same bits in all
        rho = number
    rho = over_lanes(rho, lane)
    if number_density is not None:
        number = over_lanes(number, lane)
    if asymmetry is not None:
        mx, my, mz = over_lanes(mx, lane), over_lanes(my, lane), over_lanes(mz, lane)
    if first_lane(lane):
        own = own_share(smoothing)
        rho += mass[i] * own
        number += own
        if walls is not None:
            filled = fluid.rest_density * wall_sum(i, position, walls, smoothing)
            rho += filled
            number += filled / mass[i]
            if asymmetry is not None:
                bx, by, bz = wall_moment(i, position, walls, smoothing)
                weight = fluid.rest_density / mass[i]
                mx += weight * bx
                my += weight * by
                mz += weight * bz
        density[i] = rho
        if number_density is not None:
            number_density[i] = number
        if asymmetry is not None:
            asymmetry[i] = math.sqrt(mx * mx + my * my + mz * mz)


@formula
def own_share(smoothing):
    """W(0) [1/m^dim]: the particle's own part in J(7) and J(8)."""
    return kernel_value(type(smoothing.support_radius)(0), smoothing)


@formula
def wall_sum(i, position, walls, smoothing, lane=None):
    """Sum of V_b W_ib over the wall particles, or over the lane's share of them; dimensionless."""
    first, stride, count = row_of(walls, i, lane)
    h = smoothing.support_radius
    limit = h * h
    total = type(h)(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            total += walls.volume[b] * kernel_value(math.sqrt(r2), smoothing)
    return total


@formula
def wall_moment(i, position, walls, smoothing):
    """Sum of V_b W_ib x_ib over the wall particles [m]."""
    first, stride, count = row_of(walls, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    mx, my, mz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            w = walls.volume[b] * kernel_value(math.sqrt(r2), smoothing)
            mx += w * dx
            my += w * dy
            mz += w * dz
    return mx, my, mz


@formula
def wall_gradient(i, position, walls, smoothing, weight):
    """Sum of w V_b grad W_ib over the wall particles [1/m, times the unit of the weight w]."""
    first, stride, count = row_of(walls, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    gx, gy, gz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            f = weight * walls.volume[b] * kernel_slope(r, smoothing) / (r + tiny)
            gx += f * dx
            gy += f * dy
            gz += f * dz
    return gx, gy, gz


@kernel
def state(i, density, fluid, pressure):
    """J(9) or Tait's equation of state [Pa]."""
    pressure[i] = formulas.state_pressure(density[i], fluid)


@kernel(lanes=True)
def momentum(
    i, lane, position, velocity, mass, density, pressure, neighbours, walls, smoothing, fluid, viscosity, acceleration
):  # fmt: skip
    """J(10) and, unless `viscosity` is None, J(11), walls after Akinci 2012; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    own = pressure[i]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            apart = r + tiny
            share = mass[j] / (density[j] * apart)  # V_j/r: one division serves both terms
            f = pressure_pair(share, own, pressure[j], kernel_slope(r, smoothing), fluid)
            ax += f * dx
            ay += f * dy
            az += f * dz
            if viscosity is not None:
                g = viscosity_pair(share * apart, viscosity, viscosity_laplacian(r, smoothing))
                ax += g * (velocity[j, 0] - u)
                ay += g * (velocity[j, 1] - v)
                az += g * (velocity[j, 2] - w)
    rho = density[i]
    ax, ay, az = over_lanes(ax / rho, lane), over_lanes(ay / rho, lane), over_lanes(az / rho, lane)
    if first_lane(lane):
        if walls is not None:
            bx, by, bz = wall_pressure(i, position, density, pressure, walls, smoothing, fluid)
            ax += bx
            ay += by
            az += bz
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@formula
def wall_pressure(i, position, density, pressure, walls, smoothing, fluid, lane=None):
    """Akinci 2012: acceleration of particle i by the walls' mirrored pressure, or the lane's share of it [m/s^2]."""
    first, stride, count = row_of(walls, i, lane)
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
            f = wall_pressure_pair(wall_mass, pressure[i], density[i], kernel_slope(r, smoothing), fluid) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    return ax, ay, az


@kernel
def viscous(i, position, velocity, mass, density, neighbours, smoothing, viscosity, acceleration):
    """J(11) alone; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            f = viscosity_pair(mass[j] / density[j], viscosity, viscosity_laplacian(math.sqrt(r2), smoothing))
            ax += f * (velocity[j, 0] - u)
            ay += f * (velocity[j, 1] - v)
            az += f * (velocity[j, 2] - w)
    rho = density[i]
    acceleration[i, 0] += ax / rho
    acceleration[i, 1] += ay / rho
    acceleration[i, 2] += az / rho


@kernel(lanes=True)
def central_viscous(
    i, lane, position, velocity, mass, density, neighbours, smoothing, central_viscosity, acceleration
):  # fmt: skip
    """Viscosity along the line of centres; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i, lane)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = (real(1e-9) * h) * (real(1e-9) * h)
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            laplacian = viscosity_laplacian(math.sqrt(r2), smoothing)
            g = central_viscosity_pair(mass[j] / density[j], central_viscosity, laplacian)
            parting = (velocity[j, 0] - u) * dx + (velocity[j, 1] - v) * dy + (velocity[j, 2] - w) * dz
            f = g * parting / (r2 + tiny)  # a product with 1/r^2 may overflow: its factors are taken in any order
            ax += f * dx
            ay += f * dy
            az += f * dz
    rho = density[i]
    ax, ay, az = over_lanes(ax / rho, lane), over_lanes(ay / rho, lane), over_lanes(az / rho, lane)
    if first_lane(lane):
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@kernel
def gravity(i, field, acceleration):
    """Uniform acceleration [m/s^2]."""
    for c in range(3):
        acceleration[i, c] += field[c]
