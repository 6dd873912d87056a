"""Scalar formulas of Jiang & Zhu 2023, equations (14) to (18) and (21), and of the soft surface weight."""

from refsim.compile import formula
from refsim.smoothing.formulas import value
from refsim.smoothing.shapes import POLY6
from refsim.surface_tension.jiang_zhu_2023.modes import ALL, BOTH, CORRECTED, EITHER, ONE_SIDED


@formula
def normalised_density(mass_sum, volume_sum):
    """J(14) with J(15): rho* = sum m_j W_ij / sum (m_k/rho_k) W_ik [kg/m^dim]; the weights W* share one denominator."""
    return mass_sum / volume_sum


@formula
def soft_weight(steepness, soft):
    """Soft surface weight of |h grad c| (spec 10.2): smoothstep from `lower` to `upper`; 0 in the bulk, 1 outside.

    Dimensionless.
    """
    real = type(steepness)
    t = (steepness - soft.lower) * soft.inverse_width
    if t <= real(0):
        return real(0)
    if t >= real(1):
        return real(1)
    return t * t * (real(3) - real(2) * t)


@formula
def pair_weight(mode, weight_i, weight_j, surface_i, surface_j):
    """Share of the pair force that acts on i; `weight` in 0..1, `surface` 0 or 1 (E9, spec 10.3). Dimensionless.

    It never falls with weight_j or surface_j: where it is 0 for the largest of both, the whole row is idle.
    """
    real = type(weight_i)
    acts = True
    if mode == ALL:
        acts = True
    elif mode == ONE_SIDED:
        acts = surface_i != 0
    elif mode == EITHER:
        acts = surface_i != 0 or surface_j != 0
    elif mode == BOTH:
        acts = surface_i != 0 and surface_j != 0
    else:
        return real(0.5) * (weight_i + weight_j)
    return real(1) if acts else real(0)


@formula
def force_shape(q, cohesion):
    """J(17) without its kernel's normalisation: C(r) = W_poly6(0, h) * shape(r/h); dimensionless, > 0 repels."""
    repulsion = cohesion.alpha * cohesion.inner_share * value(q * cohesion.inner_stretch, POLY6)
    return repulsion - cohesion.beta * value(q, POLY6)


@formula
def cohesion_pair(mass_j, q, cohesion):
    """J(16) for one neighbour (sign of E4): factor of e_ij in the acceleration of i [m/s^2], gamma m_j C(r)."""
    return mass_j * (cohesion.amplitude * force_shape(q, cohesion))


@formula
def area_pair(mass_j, density_i, density_j, area):
    """J(21) or J(18) for one neighbour: factor of (n_i - n_j) in the acceleration of i.

    J(21), "corrected": -eps m_j/(rho_i rho_j), eps [N/m^5], n* [1/m]; J(18), "color": -eps' [m/s^2], n dimensionless.
    """
    if area.kind == CORRECTED:
        return -(area.coefficient * (mass_j / density_j) / density_i)
    return -area.coefficient
