"""What one particle does in weakly compressible SPH; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`; the wall's row likewise.
"""

import math

from refsim.backends.compile import formula
from refsim.smoothing.formulas import kernel_slope, kernel_value, viscosity_laplacian
from refsim.sph.formulas import central_viscosity_pair, pressure_pair, viscosity_pair, wall_pressure_pair


@formula
def kernel_sums(i, row, position, mass, index, smoothing, asymmetry):
    """J(7) and J(8) over the other particles: (sum m_j W_ij, sum W_ij, sum W_ij x_ij).

    The first moment is summed only where `asymmetry` is wanted, and zero otherwise.
    """
    first, stride, count = row
    h = smoothing.support_radius
    limit = h * h
    real = type(h)
    density, number = real(0), real(0)
    mx, my, mz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            w = kernel_value(math.sqrt(r2), smoothing)
            density += mass[j] * w
            number += w
            if asymmetry is not None:
                mx += w * dx
                my += w * dy
                mz += w * dz
    return density, number, (mx, my, mz)


@formula
def own_share(smoothing):
    """W(0) [1/m^dim]: the particle's own part in J(7) and J(8)."""
    return kernel_value(type(smoothing.support_radius)(0), smoothing)


@formula
def wall_sum(i, row, position, walls, smoothing):
    """Sum of V_b W_ib over the wall particles; dimensionless."""
    first, stride, count = row
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
def wall_moment(i, row, position, walls, smoothing):
    """Sum of V_b W_ib x_ib over the wall particles [m]."""
    first, stride, count = row
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
def momentum(i, row, position, velocity, mass, density, pressure, index, smoothing, fluid, viscosity):
    """J(10) and, unless `viscosity` is None, J(11): acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    own = pressure[i]
    for k in range(count):
        j = index[first + k * stride]
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
    return ax / rho, ay / rho, az / rho


@formula
def viscous(i, row, position, velocity, mass, density, index, smoothing, viscosity):
    """J(11) alone: acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            f = viscosity_pair(mass[j] / density[j], viscosity, viscosity_laplacian(math.sqrt(r2), smoothing))
            ax += f * (velocity[j, 0] - u)
            ay += f * (velocity[j, 1] - v)
            az += f * (velocity[j, 2] - w)
    rho = density[i]
    return ax / rho, ay / rho, az / rho


@formula
def central_viscous(i, row, position, velocity, mass, density, index, smoothing, central_viscosity):
    """Viscosity along the line of centres: acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = (real(1e-9) * h) * (real(1e-9) * h)
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    for k in range(count):
        j = index[first + k * stride]
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
    return ax / rho, ay / rho, az / rho


@formula
def wall_pressure(i, row, position, density, pressure, walls, smoothing, fluid):
    """Akinci 2012: acceleration [m/s^2] by the walls' mirrored pressure."""
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
            f = wall_pressure_pair(wall_mass, pressure[i], density[i], kernel_slope(r, smoothing), fluid) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    return ax, ay, az


@formula
def kick_drift(i, position, velocity, acceleration, build_position, bounds, timestep):
    """Leap-frog with a changing step: v += (dt_previous + dt)/2 a, x += dt v, stopped at the walls' planes.

    Returns (squared way since the list was built [m^2], whether a wall's plane stopped the particle).
    """
    squared = type(timestep[0])(0)
    stopped = False
    for c in range(3):
        v = velocity[i, c] + timestep[0] * acceleration[i, c]
        x = position[i, c] + timestep[1] * v
        if bounds is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
            if x < bounds.lower[c] or x > bounds.upper[c]:
                x = min(max(x, bounds.lower[c]), bounds.upper[c])
                v = type(v)(0)
                stopped = True
        velocity[i, c] = v
        position[i, c] = x
        way = x - build_position[i, c]
        squared += way * way
    if not squared >= type(squared)(0):  # no number: a maximum over the particles would pass over it
        squared = type(squared)(math.inf)
    return squared, stopped


@formula
def squares(i, velocity, acceleration, temperature, temperature_range, exchange_rate):
    """(|v|^2, |a|^2, rate, way of the temperature out of its range, whether a value is not finite) of particle i.

    Rate and way are 0 where there are none.
    """
    speed = velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2
    force = acceleration[i, 0] ** 2 + acceleration[i, 1] ** 2 + acceleration[i, 2] ** 2
    # Numba's isfinite(x) looks at x - x, which is nothing where sums may be taken in any order.
    beyond = type(speed)(math.inf)
    broken = not (speed < beyond and force < beyond)
    if temperature is not None:
        broken = broken or not abs(temperature[i]) < beyond
    rate, excess = type(speed)(0), type(speed)(0)
    if temperature_range is not None:
        excess = max(excess, max(temperature[i] - temperature_range[1], temperature_range[0] - temperature[i]))
    if exchange_rate is not None:
        rate = exchange_rate[i]
        broken = broken or not rate < beyond
    return speed, force, rate, excess, broken
