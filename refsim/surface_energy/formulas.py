"""Scalar formulas of the surface: thesis chapter 3 and (4.18); lengths inside a cell in units of h."""

import math

from refsim.backends.compile import formula
from refsim.backends.tuples import dot, three
from refsim.surface_energy import REACH

LEAST_SUM = 1e-12  # of a node's splines; a node with a smaller sum is not active
EQUALLY_NEAR = 1e-4  # [h] by which particles farther than the nearest count as equally near; float32 rounds less


@formula
def grid_offset(x, j, surface_term):
    """u = x/h - j of a position x [m] from node j, dimensionless; the difference is taken in float64."""
    return type(surface_term.cell_size)(float(x) * surface_term.inverse_cell - float(j))


@formula
def place_over(position, p, j, surface_term):
    """u = x/h - j of point p along the three axes, dimensionless."""
    return offsets_over(three(position, p), j, surface_term)


@formula
def offsets_over(x, j, surface_term):
    """u = x/h - j of a place x [m] along the three axes, dimensionless."""
    return (
        grid_offset(x[0], j[0], surface_term), grid_offset(x[1], j[1], surface_term),
        grid_offset(x[2], j[2], surface_term),
    )  # fmt: skip


@formula
def equally_near(squared):
    """Squared distance [h^2] below which particles are as near as the nearest, whose own is `squared` (before (3.4)).

    r_2 = (r + EQUALLY_NEAR)^2, of two distances that rounding makes differ.
    """
    far = math.sqrt(squared) + type(squared)(EQUALLY_NEAR)
    return min(far * far, type(squared)(REACH * REACH))


@formula
def comes_before(p, other, interior_number):
    """Whether particle p, of two equally near ones, has the lower number (before (3.4)), dimensionless.

    yes = (number[p], p) < (number[other], other), with one number for all images of a particle.
    """
    own, its = interior_number[p], interior_number[other]
    return own < its or (own == its and p < other)


@formula
def spline_weight(f, k):
    """Quadratic B-spline at node j + k of a point with f = x/h - j, 1/2 <= f < 3/2 (before (3.3)), dimensionless.

    B = (1/2 (3/2 - f)^2, 3/4 - (f - 1)^2, 1/2 (f - 1/2)^2) for k = 0, 1, 2.
    """
    real = type(f)
    if k == 1:
        return real(0.75) - (f - real(1)) * (f - real(1))
    near = real(1.5) - f if k == 0 else f - real(0.5)
    return real(0.5) * near * near


@formula
def spline_slope(f, k):
    """(3.9): h B' = (f - 3/2, -2 (f - 1), f - 1/2) for k = 0, 1, 2, dimensionless."""
    real = type(f)
    if k == 1:
        return real(-2) * (f - real(1))
    return f - real(1.5) if k == 0 else f - real(0.5)


@formula
def exit_length(along, across_squared, surface_term):
    """Algorithm 1, line 14: l = a + sqrt((r/h)^2 - q^2), the distance [h] along an edge to the exit from a sphere.

    along           a, where the sphere's centre stands along the edge from its inside end
    across_squared  q^2, squared distance of the centre from the edge
    """
    return along + math.sqrt(surface_term.radius_squared - across_squared)


@formula
def on_edge(j, axis, length, h):
    """Algorithm 1, line 16: x = h (j + l e) [m], at a distance l [h] from node j along an axis e."""
    real = type(h)
    x = real(j[0]) + real(axis[0]) * length
    y = real(j[1]) + real(axis[1]) * length
    z = real(j[2]) + real(axis[2]) * length
    return h * x, h * y, h * z


@formula
def tangential(n, g):
    """(I - n n^T) g, in the unit of g [1/m]: = g - n (n.g)."""
    along = dot(n, g)
    return g[0] - n[0] * along, g[1] - n[1] * along, g[2] - n[2] * along


@formula
def hash_word(a, b, c):
    """A well-mixed 32-bit integer h = h(a, b, c), dimensionless: two rounds of Wellons' lowbias32."""
    word = (int(a) * 0x9E3779B1 + int(b) * 0x85EBCA77 + int(c) * 0xC2B2AE3D) & 0xFFFFFFFF
    for _ in range(2):
        word ^= word >> 16
        word = (word * 0x7FEB352D) & 0xFFFFFFFF
        word ^= word >> 15
        word = (word * 0x846CA68B) & 0xFFFFFFFF
        word ^= word >> 16
    return word


@formula
def unit_share(word, one):
    """A share u = floor(word/2^8)/2^24 of one, 0 <= u < 1, dimensionless, in the type of `one`, exact in float32."""
    return type(one)(word >> 8) / type(one)(1 << 24)
