"""Scalar formulas of the transfers: splines, stress, volume ratio, walls; equation numbers are those of the thesis.

The argument of the spline is the offset f = x/h - j of a particle from its base node j, 1/2 <= f < 3/2.
"""

import math

from refsim.backends.compile import formula
from refsim.backends.tuples import entrywise
from refsim.mpm.limits import FARTHEST

STICKY, SLIP, SEPARATING = 1, 2, 3
CLUSTER, CORRECTED = 1, 3  # readings of the embedding; 0 is none, 2 the thesis's
FAR = 2.0 * FARTHEST


@formula
def base_coordinate(x, inverse_cell):
    """Base node j = floor(x/h - 1/2) of x [m], in float64; FARTHEST + 1 where x is too far or NaN.

    It is found from floor(2 x/h): fused multiplication and subtraction cannot round this differently.
    """
    halves = float(x) * (inverse_cell + inverse_cell)
    if halves > -FAR and halves < FAR:
        return (int(math.floor(halves)) - 1) >> 1  # noqa: RUF046  (in CUDA floor gives a float)
    return FARTHEST + 1


@formula
def fraction(x, base, background):
    """f = x/h - j, dimensionless, of x [m] over node j; the difference is taken in float64."""
    return type(background.cell_size)(float(x) * background.inverse_cell - float(base))


@formula
def spline_weights(f):
    """B at the three nodes of an axis, w = (1/2 (3/2 - f)^2, 3/4 - (f - 1)^2, 1/2 (f - 1/2)^2), dimensionless."""
    real = type(f)
    low, middle, high = real(1.5) - f, f - real(1), f - real(0.5)
    return real(0.5) * low * low, real(0.75) - middle * middle, real(0.5) * high * high


@formula
def spline_slopes(f):
    """h B' at the three nodes of an axis, w' = (f - 3/2, -2 (f - 1), f - 1/2), dimensionless."""
    real = type(f)
    return f - real(1.5), real(-2) * (f - real(1)), f - real(0.5)


@formula
def stress_moment(ratio, mass, liquid, step):
    """(4.17): K = dt V0 lambda (J - 1) J [J s]; as printed V0 = 1 (thesis M3), without the
    factor J (thesis M4), twice as much (thesis M27)."""
    real = type(ratio)
    volume = real(1) if liquid.unit_volume else mass / liquid.rest_density
    factor = real(1) if liquid.linear_stress else ratio
    return step * liquid.stress * (ratio - real(1)) * factor * volume


@formula
def dilation(trace, liquid, step):
    """(4.16) for the volume: J <- J (1 + dt tr A), the factor, dimensionless; thesis M5 as printed: dt = 1 s."""
    real = type(trace)
    return real(1) + (real(1) if liquid.timeless else step) * trace


@entrywise
def stuck(j, low, high, low_rule, high_rule):
    """Whether node j (dimensionless) is in a sticky wall, where v = 0: a low one reaches up to `low`."""
    return (j <= low and low_rule == STICKY) or (j >= high and high_rule == STICKY)


@entrywise
def wall_velocity(v, j, low, high, low_rule, high_rule):
    """Component v [m/s] of the velocity of node j along the normal of a wall: n.v >= 0 or n.v = 0 in the wall."""
    real = type(v)
    if j <= low and (low_rule == SLIP or (low_rule == SEPARATING and v < real(0))):
        return real(0)
    if j >= high and (high_rule == SLIP or (high_rule == SEPARATING and v > real(0))):
        return real(0)
    return v


@formula
def inverse_spread(xx, xy, xz, yy, yz, zz):
    """(h^2/4) D_p^-1 = E^-1, dimensionless, of the symmetric E = D_p/(h^2/4) = 1 + ...; (xx, xy, xz, yy, yz, zz)."""
    a = yy * zz - yz * yz
    b = xz * yz - xy * zz
    c = xy * yz - xz * yy
    det = xx * a + xy * b + xz * c
    return a / det, b / det, c / det, (xx * zz - xz * xz) / det, (xy * xz - xx * yz) / det, (xx * yy - xy * xy) / det
