"""What one particle does in implicit incompressible SPH; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`; the wall's row likewise. Walls are at rest.
"""

import math

from refsim.backends.compile import formula
from refsim.smoothing.formulas import kernel_slope
from refsim.sph.iisph import formulas


@formula
def predict(i, row, position, velocity, mass, acceleration, index, smoothing, timestep):
    """(sum_j m_j grad W_ij [3], m_i sum_j m_j |grad W_ij|^2, sum_j m_j (v_i - v_j).grad W_ij), v with the kick done."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    kick = timestep[0]
    gx, gy, gz, squares, flow = real(0), real(0), real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u = velocity[i, 0] + kick * acceleration[i, 0]
    v = velocity[i, 1] + kick * acceleration[i, 1]
    w = velocity[i, 2] + kick * acceleration[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            slope = kernel_slope(r, smoothing) / (r + tiny)
            f = mass[j] * slope
            gx += f * dx
            gy += f * dy
            gz += f * dz
            # Each slope with a mass of its own: alone its square is beyond float32 where lengths are tiny.
            squares += (mass[i] * slope * r) * (f * r)
            flow += f * dx * (u - velocity[j, 0] - kick * acceleration[j, 0])
            flow += f * dy * (v - velocity[j, 1] - kick * acceleration[j, 1])
            flow += f * dz * (w - velocity[j, 2] - kick * acceleration[j, 2])
    return gx, gy, gz, squares, flow


@formula
def wall_gradient(i, row, position, walls, smoothing, fluid):
    """sum_b rho0 V_b grad W_ib [kg/m^4]."""
    first, stride, count = row
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
            f = fluid.rest_density * walls.volume[b] * kernel_slope(r, smoothing) / (r + tiny)
            gx += f * dx
            gy += f * dy
            gz += f * dz
    return gx, gy, gz


@formula
def displace(i, row, position, mass, density, pressure, index, smoothing):
    """-sum_j m_j p_j/rho_j^2 grad W_ij, so that times s it is sum_j d_ij p_j."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    sx, sy, sz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            f = mass[j] * pressure[j] / (density[j] * density[j]) * kernel_slope(r, smoothing) / (r + tiny)
            sx -= f * dx
            sy -= f * dy
            sz -= f * dz
    return sx, sy, sz


@formula
def compress(
    i, row, position, mass, density, pressure, own_displacement, pair_displacement, index, smoothing, square_step
):
    """sum_j m_j (s_i - d_jj p_j - s_j + d_ji p_i).grad W_ij [kg/m^dim], s_i = sum_j d_ij p_j."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    total = real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    sx, sy, sz = pair_displacement[i, 0], pair_displacement[i, 1], pair_displacement[i, 2]
    own = square_step * mass[i] / (density[i] * density[i]) * pressure[i]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            g = kernel_slope(r, smoothing) / (r + tiny)
            p = pressure[j]
            away = (sx - own_displacement[j, 0] * p - pair_displacement[j, 0] + own * g * dx) * dx
            away += (sy - own_displacement[j, 1] * p - pair_displacement[j, 1] + own * g * dy) * dy
            away += (sz - own_displacement[j, 2] * p - pair_displacement[j, 2] + own * g * dz) * dz
            total += mass[j] * g * away
    return total


@formula
def push(i, row, position, mass, density, pressure, index, smoothing):
    """Acceleration by the pressures [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    own, rho = pressure[i], density[i]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            slope = kernel_slope(r, smoothing)
            f = formulas.pressure_pair(mass[j], own, pressure[j], rho, density[j], slope) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    return ax, ay, az
