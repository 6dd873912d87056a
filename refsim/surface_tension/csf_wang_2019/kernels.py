"""What one particle does under the continuum surface force."""

import math

from refsim.backends.compile import kernel
from refsim.neighbours.rows import row_of
from refsim.smoothing.formulas import kernel_slope, kernel_value
from refsim.sph.kernels import wall_gradient, wall_sum
from refsim.surface_tension.csf_wang_2019 import formulas


@kernel
def normal(i, position, mass, density, neighbours, walls, smoothing, gradient_smoothing, interface_normal):
    """n_i = sum_j V_j grad W_ij / sum_k V_k W_ik, walls as liquid, inward [1/m]."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    nx, ny, nz = real(0), real(0), real(0)
    filled = mass[i] / density[i] * kernel_value(real(0), smoothing)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            volume = mass[j] / density[j]
            filled += volume * kernel_value(r, smoothing)
            f = formulas.normal_pair(volume, kernel_slope(r, gradient_smoothing)) / (r + tiny)
            nx += f * dx
            ny += f * dy
            nz += f * dz
    if walls is not None:
        bx, by, bz = wall_gradient(i, None, position, walls, gradient_smoothing, real(1), None)
        nx += bx
        ny += by
        nz += bz
        filled += wall_sum(i, None, position, walls, smoothing, None)
    interface_normal[i, 0] = nx / filled
    interface_normal[i, 1] = ny / filled
    interface_normal[i, 2] = nz / filled


@kernel
def curvature(i, position, mass, density, interface_normal, neighbours, gradient_smoothing, continuum, curvature):
    """Renormalised divergence of the unit normals over the active neighbours [1/m]; 0 off the surface."""
    first, stride, count = row_of(neighbours, i)
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    nx, ny, nz = interface_normal[i, 0], interface_normal[i, 1], interface_normal[i, 2]
    own = nx * nx + ny * ny + nz * nz
    if own <= continuum.threshold * continuum.threshold:
        curvature[i] = real(0)
        return
    own = real(1) / math.sqrt(own)
    nx, ny, nz = nx * own, ny * own, nz * own
    divergence, spread = real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            mx, my, mz = interface_normal[j, 0], interface_normal[j, 1], interface_normal[j, 2]
            length = mx * mx + my * my + mz * mz
            if not length <= continuum.threshold * continuum.threshold:  # also for NaN, so that it stays visible
                length = real(1) / math.sqrt(length)
                r = math.sqrt(r2)
                apart = r + tiny
                weight = mass[j] / density[j] * kernel_slope(r, gradient_smoothing)
                change = ((mx * length - nx) * dx + (my * length - ny) * dy + (mz * length - nz) * dz) / apart
                divergence += weight * change
                cosine = (nx * dx + ny * dy + nz * dz) / apart
                spread -= weight * r * formulas.tangential_share(cosine, continuum)
    curvature[i] = formulas.curvature(divergence, spread, continuum)


@kernel
def force(
    i, position, mass, density, interface_normal, curvature, neighbours, gradient_smoothing, continuum, marangoni,
    acceleration,
):  # fmt: skip
    """Normal force sigma kappa n and, unless `marangoni` is None, tangential force; added to the acceleration [m/s^2].

    The tangential force is |n| (g - (g.n)n/|n|^2), g = sum_j V_j (sigma_j - sigma_i) grad W_ij.
    """
    nx, ny, nz = interface_normal[i, 0], interface_normal[i, 1], interface_normal[i, 2]
    squared = nx * nx + ny * ny + nz * nz
    if squared <= continuum.threshold * continuum.threshold:
        return
    strength = continuum.tension
    if marangoni is not None:
        strength += marangoni.x * position[i, 0] + marangoni.y * position[i, 1] + marangoni.z * position[i, 2]
    f = strength * curvature[i]
    ax, ay, az = f * nx, f * ny, f * nz
    if marangoni is not None:
        first, stride, count = row_of(neighbours, i)
        h = gradient_smoothing.support_radius
        real = type(h)
        limit = h * h
        tiny = real(1e-9) * h
        gx, gy, gz = real(0), real(0), real(0)
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        for k in range(count):
            j = neighbours.entries[first + k * stride]
            dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                r = math.sqrt(r2)
                rise = -(marangoni.x * dx + marangoni.y * dy + marangoni.z * dz)
                f = mass[j] / density[j] * rise * kernel_slope(r, gradient_smoothing) / (r + tiny)
                gx += f * dx
                gy += f * dy
                gz += f * dz
        along = (gx * nx + gy * ny + gz * nz) / squared
        length = math.sqrt(squared)
        ax += length * (gx - along * nx)
        ay += length * (gy - along * ny)
        az += length * (gz - along * nz)
    scale = continuum.share / density[i]
    acceleration[i, 0] += scale * ax
    acceleration[i, 1] += scale * ay
    acceleration[i, 2] += scale * az
