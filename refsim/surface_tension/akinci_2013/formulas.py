"""Scalar formulas of Akinci, Akinci & Teschner 2013: cohesion, adhesion."""

import math

from refsim.backends.compile import formula


@formula
def force_shape(q):
    """Cohesion spline without its factor: C(r) = 32/(pi h^dim) shape(r/h); dimensionless, > 0 attracts.

    shape = (1 - q)^3 q^3 for q > 1/2, 2 (1 - q)^3 q^3 - 1/64 up to there.
    """
    real = type(q)
    a = (real(1) - q) * q
    a = a * a * a
    if q > real(0.5):
        return a
    return real(2) * a - real(1 / 64)


@formula
def adhesion_pair(wall_mass, q, adhesion):
    """Adhesion a_ib = -beta Psi_b A(r) e_ib: the factor of e_ib [m/s^2].

    A = 0.007/h^3.25 (-4 r^2/h + 6 r - 2 h)^(1/4) = 0.007/h^3 ((2 q - 1)(2 - 2 q))^(1/4) for h/2 < r < h; 0 elsewhere.
    """
    real = type(q)
    if q <= real(0.5) or q >= real(1):
        return real(0)
    inside = (q + q - real(1)) * (real(2) - q - q)
    return -wall_mass * adhesion.amplitude * math.sqrt(math.sqrt(inside))
