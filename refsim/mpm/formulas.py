"""Scalar formulas of the transfers: splines, stress, volume ratio, walls; numbers are the thesis's, M marks its errata.

The spline's argument is the fraction f = x/h - j of a particle over its base node j, 1/2 <= f < 3/2.
"""

from refsim.backends.compile import formula

STICKY, SLIP, SEPARATING = 1, 2, 3
IMAGED_ROWS = 3  # of nodes behind a mirror that points of the liquid may reach
NOWHERE = 1 << 30


@formula
def fraction(x, base, background):
    """f = x/h - j, dimensionless, of x [m] over node j; the difference is taken in float64."""
    return type(background.cell_size)(float(x) * background.inverse_cell - float(base))


@formula
def spline_weights(f):
    """Section 3: B at the three nodes of an axis, w = (1/2 (3/2 - f)^2, 3/4 - (f - 1)^2, 1/2 (f - 1/2)^2),
    dimensionless."""
    real = type(f)
    low, middle, high = real(1.5) - f, f - real(1), f - real(0.5)
    return real(0.5) * low * low, real(0.75) - middle * middle, real(0.5) * high * high


@formula
def spline_slopes(f):
    """Section 3: h B' at the three nodes of an axis, w' = (f - 3/2, -2 (f - 1), f - 1/2), dimensionless."""
    real = type(f)
    return f - real(1.5), real(-2) * (f - real(1)), f - real(0.5)


@formula
def stress_moment(ratio, mass, liquid, step):
    """(4.17): K = dt V0 lambda (J - 1) J [J s]; with M3 V0 = 1, with M4 without J, with M27 twice as much."""
    real = type(ratio)
    volume = real(1) if liquid.unit_volume else mass / liquid.rest_density
    factor = real(1) if liquid.linear_stress else ratio
    return step * liquid.stress * (ratio - real(1)) * factor * volume


@formula
def dilation(trace, liquid, step):
    """(4.16) for the volume: J <- J (1 + dt tr A), the factor, dimensionless; with M5 dt = 1 s."""
    real = type(trace)
    return real(1) + (real(1) if liquid.timeless else step) * trace


@formula
def wall_velocity(v, below, above, low_rule, high_rule):
    """Section 9: the part v [m/s] of a node's velocity along a wall's normal, n.v >= 0 or = 0 in the wall.

    below, above  whether the node stands in the wall at the low and at the high end of the axis
    """
    real = type(v)
    if below and (low_rule == SLIP or (low_rule == SEPARATING and v < real(0))):
        return real(0)
    if above and (high_rule == SLIP or (high_rule == SEPARATING and v > real(0))):
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


@formula
def determinant(f0, f1, f2, f3, f4, f5, f6, f7, f8):
    """J = det F, dimensionless, F row by row."""
    return f0 * (f4 * f8 - f5 * f7) - f1 * (f3 * f8 - f5 * f6) + f2 * (f3 * f7 - f4 * f6)


@formula
def canonical(j, low, high, below, above):
    """Section 9: the node a on the liquid's side of mirrors at `low` and `high` that j is an image of, dimensionless:
    a = 2 low - j below, 2 high - j above, else j."""
    if below and j < low:
        return 2 * low - j
    if above and j > high:
        return 2 * high - j
    return j


@formula
def buried(j, low, high, low_rule, high_rule):
    """Section 9: whether node j (dimensionless) lies further behind a wall than anything of the liquid reaches, so that
    m_j = 0."""
    return (low_rule > 0 and j < low - IMAGED_ROWS) or (high_rule > 0 and j > high + IMAGED_ROWS)


@formula
def image(j, which, low, high, below, above):
    """Section 9: image i = 2 low - j (1) or 2 high - j (2) of node j, j itself (0), dimensionless; NOWHERE without one.

    Points reach no more than IMAGED_ROWS rows behind a mirror, and a node on it is its own image.
    """
    if which == 0:
        return j
    if which == 1 and below and 0 < j - low <= IMAGED_ROWS:
        return 2 * low - j
    if which == 2 and above and 0 < high - j <= IMAGED_ROWS:
        return 2 * high - j
    return NOWHERE


@formula
def on_mirror(j, low, high, low_rule, high_rule):
    """Section 9: (whether node j on a face stands still, v = 0, whether its velocity has no normal part, n.v = 0) [m/s]
    for two mirrors of an axis."""
    below, above = low_rule > 0 and j == low, high_rule > 0 and j == high
    stuck = (below and low_rule == STICKY) or (above and high_rule == STICKY)
    return stuck, below or above


@formula
def reflection(which, low_rule, high_rule):
    """Section 9: signs of v' = (-v_n, +-v_t), the image of a velocity in a face (dimensionless), which as for `image`.

    Slip and separating: -1, 1, for what wets a wall does not leave it but at its edge. Sticky: -1, -1, so that the
    velocity on the face is none.
    """
    if which == 0:
        return 1, 1
    rule = low_rule if which == 1 else high_rule
    return -1, -1 if rule == STICKY else 1
