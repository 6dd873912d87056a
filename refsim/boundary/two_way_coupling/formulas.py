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
def nearness(r, overlapping):
    """n = 1 + 0.8 (1 - r^2/d^2), at least 0, dimensionless; C = n^3, 0.9 to 1 a spacing off a particle, row or face."""
    real = type(r)
    q = r * overlapping.inverse_spacing
    return max(real(1.8) - real(0.8) * q * q, real(0))


@formula
def steepness(r, overlapping):
    """4.8 n^2/d^2 [1/m^2]: grad C = -4.8 n^2/d^2 x."""
    real = type(r)
    q = overlapping.inverse_spacing * nearness(r, overlapping)
    return real(4.8) * q * q


@formula
def lightness(mass, fluid, overlapping):
    """l = m/(rho0 d^dim), at most 1, dimensionless: as stiff, a lighter particle would not bear the liquid's step."""
    return min(mass * overlapping.inverse_volume / fluid.rest_density, type(mass)(1))


@formula
def side(place, bounds):
    """(o_x, o_y, o_z, o) of a wall particle, dimensionless, sum 1: o_x = 1 beyond planes across x, o = 1 of meshes."""
    real = type(place[0])
    if bounds is None:
        return real(0), real(0), real(0), real(1)
    x, y, z = (
        real(place[0] < bounds.lower[0] or place[0] > bounds.upper[0]),
        real(place[1] < bounds.lower[1] or place[1] > bounds.upper[1]),
        real(place[2] < bounds.lower[2] or place[2] > bounds.upper[2]),
    )
    planes = x + y + z
    share = real(1) / max(planes, real(1))
    return x * share, y * share, z * share, real(1) - planes * share


@formula
def pressed(close, allowed, growth, total, overlapping):
    """s C/C_all, s = K (ln(C/C_0) + tau (dC/dt)/C) [Pa], at least 0; 0 where C <= C_0."""
    real = type(close)
    if close <= allowed:  # NaN goes on
        return real(0)
    push = close * real(math.log(close / allowed)) + overlapping.delay * growth
    return real(0) if push < real(0) else overlapping.stiffness * push / total
