"""What one particle does in implicit incompressible SPH. Walls are at rest."""

import math

from refsim.backends.compile import kernel
from refsim.neighbours.rows import row_of
from refsim.smoothing.formulas import kernel_slope
from refsim.sph.iisph import formulas
from refsim.sph.kernels import wall_gradient


@kernel
def predict(
    i, position, velocity, mass, density, acceleration, neighbours, walls, smoothing, fluid, timestep,
    own_displacement, diagonal, advected_density,
):  # fmt: skip
    """d_ii [m/Pa], a_ii [kg/(m^dim Pa)] and rho_adv [kg/m^dim], with the velocities after the kick."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    kick, drift = timestep[0], timestep[1]
    gx, gy, gz, squares, flow = real(0), real(0), real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u = velocity[i, 0] + kick * acceleration[i, 0]
    v = velocity[i, 1] + kick * acceleration[i, 1]
    w = velocity[i, 2] + kick * acceleration[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            slope = kernel_slope(r, smoothing) / (r + tiny)
            f = mass[j] * slope
            gx += f * dx
            gy += f * dy
            gz += f * dz
            # A mass goes with each slope: the square of the slope alone overflows float32 at small lengths.
            squares += (mass[i] * slope * r) * (f * r)
            flow += f * dx * (u - velocity[j, 0] - kick * acceleration[j, 0])
            flow += f * dy * (v - velocity[j, 1] - kick * acceleration[j, 1])
            flow += f * dz * (w - velocity[j, 2] - kick * acceleration[j, 2])
    if walls is not None:
        bx, by, bz = wall_gradient(i, None, position, walls, smoothing, fluid.rest_density, None)
        flow += bx * u
        flow += by * v
        flow += bz * w
        gx += bx
        gy += by
        gz += bz
    rho = density[i]
    share = -kick * drift / (rho * rho)
    own_displacement[i, 0] = share * gx
    own_displacement[i, 1] = share * gy
    own_displacement[i, 2] = share * gz
    diagonal[i] = formulas.diagonal(gx * gx + gy * gy + gz * gz, squares, rho, kick * drift)
    advected_density[i] = rho + drift * flow


@kernel
def displace(i, position, mass, density, pressure, neighbours, smoothing, timestep, pair_displacement):
    """s_i = sum_j d_ij p_j = -s sum_j (m_j p_j/rho_j^2) grad W_ij [m]."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    sx, sy, sz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            f = mass[j] * pressure[j] / (density[j] * density[j]) * kernel_slope(r, smoothing) / (r + tiny)
            sx -= f * dx
            sy -= f * dy
            sz -= f * dz
    square = timestep[0] * timestep[1]
    pair_displacement[i, 0] = square * sx
    pair_displacement[i, 1] = square * sy
    pair_displacement[i, 2] = square * sz


@kernel
def relax(
    i, position, mass, density, pressure, own_displacement, pair_displacement, diagonal, advected_density, neighbours,
    walls, smoothing, fluid, implicit, timestep, density_error, new_pressure,
):  # fmt: skip
    """One Jacobi step p <- (1 - w) p + (w/a_ii) (rho0 - rho_adv - L_i) [Pa], L_i = sum_j m_j (s_i - d_jj p_j - s_j +
    d_ji p_i).grad W_ij, and the compression [kg/m^dim] that the pressures before it leave."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    square = timestep[0] * timestep[1]
    total = real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    sx, sy, sz = pair_displacement[i, 0], pair_displacement[i, 1], pair_displacement[i, 2]
    own = square * mass[i] / (density[i] * density[i]) * pressure[i]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            g = kernel_slope(r, smoothing) / (r + tiny)
            q = pressure[j]
            away = (sx - own_displacement[j, 0] * q - pair_displacement[j, 0] + own * g * dx) * dx
            away += (sy - own_displacement[j, 1] * q - pair_displacement[j, 1] + own * g * dy) * dy
            away += (sz - own_displacement[j, 2] * q - pair_displacement[j, 2] + own * g * dz) * dz
            total += mass[j] * g * away
    if walls is not None:
        bx, by, bz = wall_gradient(i, None, position, walls, smoothing, fluid.rest_density, None)
        total += bx * sx + by * sy + bz * sz
    missing = fluid.rest_density - advected_density[i]
    p, a = pressure[i], diagonal[i]
    left = total + a * p - missing
    density_error[i] = max(left, left - left)  # 0 at least; a NaN stays NaN
    new_pressure[i] = formulas.relaxed_pressure(p, missing, total, a, implicit, square)


@kernel
def push(i, position, mass, density, pressure, neighbours, walls, smoothing, fluid, acceleration):
    """-sum_j m_j (p_i/rho_i^2 + p_j/rho_j^2) grad W_ij, walls with p_b = 0; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    own, rho = pressure[i], density[i]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            slope = kernel_slope(r, smoothing)
            f = formulas.pressure_pair(mass[j], own, pressure[j], rho, density[j], slope) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    if walls is not None:
        bx, by, bz = wall_gradient(i, None, position, walls, smoothing, fluid.rest_density, None)
        share = own / (rho * rho)
        ax -= share * bx
        ay -= share * by
        az -= share * bz
    acceleration[i, 0] += ax
    acceleration[i, 1] += ay
    acceleration[i, 2] += az


@kernel
def halve(i, pressure):
    """p <- p/2 [Pa], the start of the next solution."""
    pressure[i] = pressure[i] / (pressure.dtype.type(1) + pressure.dtype.type(1))


@kernel
def keep(i, new_pressure, pressure):
    """p <- the relaxed p [Pa]."""
    pressure[i] = new_pressure[i]
