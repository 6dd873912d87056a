"""Scalar formulas of Jiang & Zhu 2023, equations (14) to (18) and (21), and of the soft surface weight."""

from refsim.backends.compile import formula
from refsim.smoothing.formulas import value
from refsim.smoothing.shapes import POLY6
from refsim.surface_tension.jiang_zhu_2023.modes import ALL, CORRECTED, EITHER, ONE_SIDED, SOFT


@formula
def soft_weight(steepness, soft):
    """Jiang & Zhu E9, w = t^2 (3 - 2 t), t = (|h grad c| - lower)/(upper - lower) clipped to 0..1; dimensionless."""
    real = type(steepness)
    t = (steepness - soft.lower) * soft.inverse_width
    if t <= real(0):
        return real(0)
    if t >= real(1):
        return real(1)
    return t * t * (real(3) - real(2) * t)


@formula
def pair_weight(mode, weight_i, surface_i):
    """(base, slope) of the pair weights of particle i: a pair acts on i with base + slope * (w_j, or s_j by S).

    soft = (w_i + w_j)/2; all = 1; one_sided = s_i; either = s_i or s_j; both = s_i and s_j (Jiang & Zhu E9).
    Dimensionless.
    """
    real = type(weight_i)
    on = real(1) if surface_i != 0 else real(0)
    if mode == SOFT:
        return real(0.5) * weight_i, real(0.5)
    if mode == ALL:
        return real(1), real(0)
    if mode == ONE_SIDED:
        return on, real(0)
    if mode == EITHER:
        return on, real(1) - on
    return real(0), on


@formula
def force_shape(q, cohesion):
    """J(17) without its kernel's normalisation: C(r) = W_poly6(0, h) * shape(r/h); dimensionless, > 0 repels."""
    repulsion = cohesion.alpha * cohesion.inner_share * value(q * cohesion.inner_stretch, POLY6)
    return repulsion - cohesion.beta * value(q, POLY6)


@formula
def cohesion_pair(mass_j, q, cohesion):
    """J(16) for one neighbour with Jiang & Zhu E4: factor of e_ij in the acceleration of i [m/s^2], gamma m_j C(r)."""
    return mass_j * (cohesion.amplitude * force_shape(q, cohesion))


@formula
def area_pair(mass_j, density_j, area):
    """J(21) for one neighbour: factor of (n*_i - n*_j), its volume m_j/rho_j [m^dim]; 1 in J(18)."""
    if area.kind == CORRECTED:
        return mass_j / density_j
    return type(mass_j)(1)


@formula
def area_strength(density_i, area):
    """Minus the factor of the sum of `area_pair` terms: eps/rho_i in J(21), eps' [m/s^2] in J(18)."""
    if area.kind == CORRECTED:
        return area.coefficient / density_i
    return area.coefficient
