"""What one neighbour and one particle do under the continuum surface force."""

import math

from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import added, difference, dot, over, scaled, three
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector, first_lane, set_vector
from refsim.smoothing.formulas import gradient_factor, kernel_slope, kernel_value, safe_distance
from refsim.sph.kernels import own_share
from refsim.surface_tension.csf_wang_2019 import formulas


@pair
def normal_pair(r, x_ij, mass_j, density_j, gradient_smoothing, smoothing):
    """V_j grad W_ij, inward [1/m], and V_j W_ij."""
    volume = mass_j / density_j
    f = volume * kernel_slope(r, gradient_smoothing) / safe_distance(r, gradient_smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2], volume * kernel_value(r, smoothing)


@pair
def wall_pair(r, x_ij, volume_j, gradient_smoothing, smoothing):
    """V_b grad W_ib [1/m], and V_b W_ib."""
    f = volume_j * gradient_factor(r, gradient_smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2], volume_j * kernel_value(r, smoothing)


@pair
def beyond_pair(r, x_ij, volume_j, smoothing, inward):
    """V_b W_ib |n.x_ib| of walls on the side from which n points, and of all; dimensionless."""
    height = dot(inward, x_ij)
    size = volume_j * kernel_value(r, smoothing) * abs(height)
    return size if height > type(r)(0) else type(r)(0), size


@kernel(lanes=True)
def normal(
    i, lane, position, mass, density, neighbours, walls, smoothing, gradient_smoothing, wetting, interface_normal
):
    """n_i = sum_j V_j grad W_ij / sum_k V_k W_ik, inward [1/m], with walls by the contact angle."""
    sums = neighbour_sum(normal_pair, i, lane, neighbours, position, None, mass, density, gradient_smoothing, smoothing)
    n, filled = sums[0:3], sums[3] + mass[i] / density[i] * own_share(smoothing)
    if walls is not None:
        at = neighbour_sum(wall_pair, i, lane, walls, position, None, walls.volume, gradient_smoothing, smoothing)
        n, filled = added(n, at[0:3]), filled + at[3]
        beyond, both = neighbour_sum(beyond_pair, i, lane, walls, position, None, walls.volume, smoothing, n)
        n, filled = formulas.at_walls(n, at[0:3], filled, at[3], beyond, both, wetting)
    set_vector(interface_normal, i, lane, over(n, filled))


@formula
def active(squared, continuum):
    """Whether |n|^2 [1/m^2] is above the threshold, squared; so is a NaN, so that it stays visible."""
    return not squared <= continuum.threshold * continuum.threshold


@pair
def curvature_pair(r, x_ij, mass_j, density_j, interface_normal_i, interface_normal_j, gradient_smoothing, continuum):
    """Terms of divergence and spread of the unit normals; none of a neighbour off the surface."""
    real = type(r)
    nx, ny, nz = interface_normal_i
    mx, my, mz = interface_normal_j
    squared = mx * mx + my * my + mz * mz
    divergence, spread = real(0), real(0)
    if active(squared, continuum):
        inverse, other = real(1) / math.sqrt(nx * nx + ny * ny + nz * nz), real(1) / math.sqrt(squared)
        nx, ny, nz = nx * inverse, ny * inverse, nz * inverse
        apart = safe_distance(r, gradient_smoothing)
        weight = mass_j / density_j * kernel_slope(r, gradient_smoothing)
        change = (mx * other - nx) * x_ij[0] + (my * other - ny) * x_ij[1] + (mz * other - nz) * x_ij[2]
        cosine = (nx * x_ij[0] + ny * x_ij[1] + nz * x_ij[2]) / apart
        divergence += weight * (change / apart)
        spread -= weight * r * formulas.tangential_share(cosine, continuum)
    return divergence, spread


@kernel(lanes=True)
def curvature(i, lane, position, mass, density, interface_normal, neighbours, gradient_smoothing, continuum, curvature):
    """Renormalised divergence of the unit normals over the active neighbours [1/m]; 0 off the surface."""
    n = three(interface_normal, i)
    kappa = type(n[0])(0)
    if active(dot(n, n), continuum):
        divergence, spread = neighbour_sum(
            curvature_pair, i, lane, neighbours, position, None, mass, density, interface_normal, gradient_smoothing,
            continuum,
        )  # fmt: skip
        kappa = formulas.curvature(divergence, spread, continuum)
    if first_lane(lane):
        curvature[i] = kappa


@pair
def marangoni_pair(r, x_ij, mass_j, density_j, gradient_smoothing, marangoni):
    """V_j (sigma_j - sigma_i) grad W_ij [N/m^2]."""
    rise = -(marangoni.x * x_ij[0] + marangoni.y * x_ij[1] + marangoni.z * x_ij[2])
    f = mass_j / density_j * rise * gradient_factor(r, gradient_smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def force(
    i, lane, position, mass, density, interface_normal, curvature, neighbours, gradient_smoothing, continuum,
    marangoni, acceleration,
):  # fmt: skip
    """Normal force sigma kappa n and, unless `marangoni` is None, tangential force; added to the acceleration [m/s^2].

    The tangential force is |n| (g - (g.n)n/|n|^2), g = sum_j V_j (sigma_j - sigma_i) grad W_ij.
    """
    n = three(interface_normal, i)
    squared = dot(n, n)
    if active(squared, continuum):
        strength = continuum.tension
        if marangoni is not None:
            strength += marangoni.x * position[i, 0] + marangoni.y * position[i, 1] + marangoni.z * position[i, 2]
        force = scaled(n, strength * curvature[i])
        if marangoni is not None:
            g = neighbour_sum(
                marangoni_pair, i, lane, neighbours, position, None, mass, density, gradient_smoothing, marangoni
            )
            force = added(force, scaled(difference(g, scaled(n, dot(g, n) / squared)), math.sqrt(squared)))
        add_vector(acceleration, i, lane, scaled(force, continuum.share / density[i]))
