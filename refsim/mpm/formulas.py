"""Scalar formulas of the transfers: splines, stress, volume ratio, walls; equation numbers are those of the thesis.

The argument of the spline is the offset f = x/h - j of a particle from its base node j, 1/2 <= f < 3/2.
"""

import math

from refsim.backends.compile import formula
from refsim.backends.tuples import entrywise
from refsim.mpm.limits import FARTHEST, IMAGED_ROWS

STICKY, SLIP, SEPARATING = 1, 2, 3
CLUSTER, CORRECTED = 1, 3  # readings of the embedding; 0 is none, 2 the thesis's
NOWHERE = 1 << 30
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
    """(4.16) for the volume: J <- J (1 + dt tr A), the factor, dimensionless; thesis M5 as printed:
    dt = 1 s."""
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


# Mirrors of an axis, at nodes `low` and `high`, each there if its rule is not 0


@entrywise
def canonical(j, low, high, low_rule, high_rule):
    """The node a on the liquid's side of the mirrors of which j is an image, dimensionless: a = 2 low - j below,
    2 high - j above, else j."""
    if low_rule > 0 and j < low:
        return 2 * low - j
    if high_rule > 0 and j > high:
        return 2 * high - j
    return j


@entrywise
def within_rows(j, low, high, low_rule, high_rule):
    """Whether node j (dimensionless) is in the imaged rows behind a wall, or in their images."""
    return (low_rule > 0 and j <= low + IMAGED_ROWS) or (high_rule > 0 and j >= high - IMAGED_ROWS)


@entrywise
def buried(j, low, high, low_rule, high_rule):
    """Whether node j (dimensionless) is farther behind a wall than the liquid reaches, so that m_j = 0."""
    return (low_rule > 0 and j < low - IMAGED_ROWS) or (high_rule > 0 and j > high + IMAGED_ROWS)


@entrywise
def image(j, which, low, high, low_rule, high_rule):
    """Image i = 2 low - j (1) or 2 high - j (2) of node j, j itself (0), dimensionless; NOWHERE if there is none.

    Points reach at most IMAGED_ROWS rows behind a mirror, and a node on it is its own image.
    """
    if which == 0:
        return j
    if which == 1 and low_rule > 0 and 0 < j - low <= IMAGED_ROWS:
        return 2 * low - j
    if which == 2 and high_rule > 0 and 0 < high - j <= IMAGED_ROWS:
        return 2 * high - j
    return NOWHERE


@entrywise
def mirror_of(a, j, low):
    """Which mirror, as for `image`, makes node j of node `a` on the liquid's side, dimensionless; 0 if j = a."""
    if a == j:
        return 0
    return 1 if j < low else 2


@entrywise
def on_mirror(j, low, high, low_rule, high_rule):
    """(whether node j is on a sticky face, v = 0; whether it is on any, n.v = 0 [m/s])."""
    below, above = low_rule > 0 and j == low, high_rule > 0 and j == high
    return (below and low_rule == STICKY) or (above and high_rule == STICKY), below or above


@entrywise
def reflection(which, low_rule, high_rule):
    """Signs of v' = (-v_n, +-v_t), the image of a velocity in a face (dimensionless), `which` as for `image`.

    Slip and separating: -1, 1, since liquid that wets a wall leaves it at the edge only. Sticky: -1, -1, so that the
    velocity on the face is zero.
    """
    if which == 0:
        return 1, 1
    rule = low_rule if which == 1 else high_rule
    return -1, -1 if rule == STICKY else 1
