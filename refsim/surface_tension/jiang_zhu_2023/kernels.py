"""What one neighbour and one particle do in Jiang & Zhu 2023."""

import math

from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import added, difference, dot, scaled, three
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector, first_lane
from refsim.smoothing.formulas import kernel_value, safe_distance
from refsim.sph.kernels import own_share, wall_sum, with_momentum
from refsim.surface_normal.formulas import axial_part
from refsim.surface_tension.jiang_zhu_2023 import formulas


@pair
def corrected_density_pair(r, mass_j, density_j, smoothing):
    """Terms m_j W_ij [kg/m^dim] and (m_j/rho_j) W_ij of J(14)."""
    w = mass_j * kernel_value(r, smoothing)
    return w, w / density_j


@kernel(lanes=True)
def corrected_density(
    i, lane, position, mass, density, near_surface, neighbours, walls, smoothing, fluid, corrected_density
):
    """J(14), J(15) near the surface, everywhere if `near_surface` is None; else the density itself [kg/m^dim].

    rho* = sum m_j W_ij / sum (m_k/rho_k) W_ik: all W* have the same denominator.
    """
    rho = density[i]
    if near_surface is None or near_surface[i] != 0:
        mass_sum, volume_sum = neighbour_sum(
            corrected_density_pair, i, lane, neighbours, position, None, mass, density, smoothing
        )
        itself = mass[i] * own_share(smoothing)
        if walls is not None:
            itself += fluid.rest_density * wall_sum(i, lane, position, walls, smoothing, None)
        rho = (mass_sum + itself) / (volume_sum + itself / rho)
    if first_lane(lane):
        corrected_density[i] = rho


@kernel
def replace_density(i, corrected_density, density):
    """rho <- rho* [kg/m^dim]: whatever follows reads the corrected density."""
    density[i] = corrected_density[i]


@kernel
def soft_weight(i, surface_normal, soft, surface_weight):
    """Soft surface weight (Jiang & Zhu E9) of the length of J(19); dimensionless."""
    n = three(surface_normal, i)
    surface_weight[i] = formulas.soft_weight(math.sqrt(dot(n, n)), soft)


@pair
def tension_pair(
    r, x_ij, mass_j, density_i, density_j, surface_weight_j, surface_j, area_normal_i, area_normal_j, smoothing,
    base, slope, cohesion, area, axial,
):  # fmt: skip
    """J(16) with J(17), and J(21) or J(18), each unless None [m/s^2]."""
    real = type(r)
    a = real(0), real(0), real(0)
    share = base
    if surface_weight_j is not None:
        share += slope * surface_weight_j
    if surface_j is not None:
        share += slope * real(surface_j)
    if cohesion is not None:
        pull = formulas.cohesion_pair(mass_j, r * smoothing.inverse_radius, cohesion)
        f = share * pull / safe_distance(r, smoothing)
        a = added(a, scaled(x_ij, f))
    if area is not None:
        g = share * (formulas.area_strength(density_i, area) * formulas.area_pair(mass_j, density_j, area))
        n_ij = difference(area_normal_i, area_normal_j)
        if axial is not None:
            n_ij = axial_part(n_ij, x_ij, r, smoothing, axial)
        a = difference(a, scaled(n_ij, g))
    return a[0], a[1], a[2]


@kernel(lanes=True)
def tension(
    i, lane, position, mass, density, surface_weight, surface, area_normal, neighbours, smoothing, pairs, cohesion,
    area, axial, acceleration,
):  # fmt: skip
    """J(16) with J(17), and J(21) or J(18), each unless None; added to the acceleration [m/s^2]."""
    zero = type(smoothing.support_radius)(0)
    base, slope = row_weights(i, lane, zero, surface_weight, surface, neighbours, pairs)
    if base != zero or slope != zero:
        a = neighbour_sum(
            tension_pair, i, lane, neighbours, position, None, mass, density, surface_weight, surface, area_normal,
            smoothing, base, slope, cohesion, area, axial,
        )  # fmt: skip
        add_vector(acceleration, i, lane, a)


BETWEEN_ALL = {
    "smoothing": "gradient_smoothing", "surface_weight_j": "None", "surface_j": "None", "base": "type(r)(1)",
    "slope": "type(r)(0)",
}  # fmt: skip
tension_and_momentum_pair, tension_and_momentum, tension_and_central_momentum_pair, tension_and_central_momentum = (
    with_momentum(tension_pair, BETWEEN_ALL)
)


@pair
def marked_pair(surface_weight_j, surface_j, zero):
    """1 for a neighbour with a weight, a NaN or a mark, else 0."""
    marked = zero
    if surface_weight_j is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if surface_weight_j != zero:
            marked = type(zero)(1)
    if surface_j is not None:  # noqa: SIM102
        if surface_j != 0:
            marked = type(zero)(1)
    return marked


@formula
def row_weights(i, lane, zero, surface_weight, surface, neighbours, pairs):
    """(base, slope) of the pair weights in row i, base + slope * (w_j or s_j); (0, 0) where no listed pair acts.

    A particle of the bulk thus reads the weights of its neighbours and nothing else of them. Dimensionless.
    """
    weight_i, surface_i = zero, 0
    if surface_weight is not None:
        weight_i = surface_weight[i]
    if surface is not None:
        surface_i = surface[i]
    base, slope = formulas.pair_weight(pairs.mode, weight_i, surface_i)
    if base == zero and slope != zero:  # noqa: SIM102
        if neighbour_sum(marked_pair, i, lane, neighbours, None, None, surface_weight, surface, zero) == zero:
            slope = zero
    return base, slope
