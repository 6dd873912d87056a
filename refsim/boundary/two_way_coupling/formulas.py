"""Scalar formulas of two-way coupling."""

import math

from refsim.backends.compile import formula


@formula
def tait_pressure(density, rest_density, coupling):
    """Tait: p_i = (rho0_i c^2/g) ((rho_i/rho0_i)^g - 1) [Pa], zero where that is negative."""
    real = type(density)
    ratio = density / rest_density
    power = ratio
    for _ in range(1, coupling.exponent):
        power *= ratio
    pressure = rest_density * coupling.stiffness * (power - real(1))
    if pressure < real(0):  # max() on a GPU would replace NaN by 0
        return real(0)
    return pressure


@formula
def closeness(r, overlapping):
    """C = exp(2.5 (1 - r^2/d^2)), dimensionless; at the distance d of a particle, a row or a face 1 to 1.3."""
    real = type(r)
    q = r * overlapping.inverse_spacing
    return real(math.exp(real(2.5) * (real(1) - q * q)))


@formula
def pressed(close, allowed, growth, overlapping):
    """s_k = K (ln(C/C_0) + tau (dC/dt)/C) [Pa], at least 0, with growth = sum_s C_ks (v_k - v_s).x_ks [m^2/s]."""
    real = type(close)
    inverse = overlapping.inverse_spacing
    rate = real(-5) * inverse * (inverse * growth) / close
    push = real(math.log(close / allowed)) + overlapping.delay * rate
    return real(0) if push < real(0) else overlapping.stiffness * push
