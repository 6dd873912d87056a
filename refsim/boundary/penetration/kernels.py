"""What one particle does at a solid's surface.

`solid_field` is the narrow band of signed distances, negative inside; `penetration` holds the correction's parameters.
"""

import math
from typing import Any, NamedTuple

from refsim.backends.compile import formula
from refsim.backends.tuples import added, scaled, three
from refsim.boundary.penetration.formulas import pushed, rebound, reflected
from refsim.boundary.signed_distance.formulas import beyond_inside, trilinear
from refsim.sparse_grid.formulas import cell_coordinate, find_node
from refsim.sph.formulas import drifted

LONGEST = 4096  # samples along one path
CLEARANCE = (
    4  # h/CLEARANCE is subtracted from interpolated distances and is the least step along a path; h: band's spacing
)
PUSHES = 16  # at most, in one step; each is at most two depths long, and halves the depth on rounded edges
LEFT = 128  # a push that leaves the particle less deep than h/LEFT is the last one


@formula
def marked_distance(x, y, z, solid_field, penetration):
    """(phi [m], its slope along x, y, z) at a point: interpolated in a marked cell, +-band and slope 0 in others."""
    real = type(x)
    if not penetration.everywhere:
        inverse = solid_field.inverse_spacing
        jx = cell_coordinate(float(x) - solid_field.origin_x, inverse, 0.0)
        jy = cell_coordinate(float(y) - solid_field.origin_y, inverse, 0.0)
        jz = cell_coordinate(float(z) - solid_field.origin_z, inverse, 0.0)
        if find_node(solid_field, jx, jy, jz) < 0:
            far = solid_field.band
            if beyond_inside(solid_field, jx, jy, jz):
                far = -far
            return far, real(0), real(0), real(0)
    return trilinear(x, y, z, solid_field)


@formula
def clipped(x, y, z, wx, wy, wz, penetration):
    """Interval (first, last) of t for which x + t w [m], 0 <= t <= 1, is in the band's box; first > last if none is."""
    real = type(x)
    first, last = real(0), real(1)
    for c in range(3):
        p, w = x, wx
        if c == 1:
            p, w = y, wy
        elif c == 2:
            p, w = z, wz
        low, high = penetration.lower[c], penetration.upper[c]
        if w == real(0):
            if p < low or p > high:
                last = real(-1)
        else:
            a, b = (low - p) / w, (high - p) / w
            first = max(first, min(a, b))
            last = min(last, max(a, b))
    return first, last


@formula
def entry(x, y, z, wx, wy, wz, solid_field, penetration):
    """Least t in [0, 1] for which sphere tracing finds a negative distance at x + t w [m]; 2 if there is none.

    The path is clipped to the band's box first, so that it may begin anywhere.
    """
    real = type(x)
    never = real(2)
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    if not (length > real(0) and length < real(math.inf)):
        return never
    first, last = clipped(x, y, z, wx, wy, wz, penetration)
    if not first <= last:
        return never
    clearance = solid_field.spacing / real(CLEARANCE)
    t = first
    for _ in range(LONGEST):
        d, _, _, _ = marked_distance(x + t * wx, y + t * wy, z + t * wz, solid_field, penetration)
        if d < real(0):
            return t
        if t >= last:
            return never
        t = min(t + max(d - clearance, clearance) / length, last)
    return never


@formula
def outside_box(x, y, z, penetration):
    """Whether a point [m] is outside the marked region's box, where no distance is needed."""
    low, high = penetration.lower, penetration.upper
    return not (x >= low[0] and x <= high[0] and y >= low[1] and y <= high[1] and z >= low[2] and z <= high[2])


class Moving(NamedTuple):
    """What the step writes; residuals may be None."""

    corrections: Any
    position_residual: Any
    velocity: Any
    position: Any


@formula
def advanced(i, position, position_residual, shift):
    """x + shift [m] of particle i; with a residual x + residual + shift, of which the new residual is written."""
    if position_residual is not None:
        x, position_residual[i, 0] = drifted(position[i, 0], position_residual[i, 0], shift[0])
        y, position_residual[i, 1] = drifted(position[i, 1], position_residual[i, 1], shift[1])
        z, position_residual[i, 2] = drifted(position[i, 2], position_residual[i, 2], shift[2])
        return x, y, z
    return added(three(position, i), shift)


@formula
def forget(i, c, held, position_residual):
    """No residual of component c where the place is `held`."""
    if position_residual is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
        if held:
            position_residual[i, c] = type(position_residual[i, c])(0)


@formula
def corrected_step(i, acceleration, identity, build_position, bounds, timestep, solid_field, penetration, moving):
    """Leap-frog step v += (dt_previous + dt)/2 a, x += dt v, with patent P8 for particles that would enter the solid.

    Where there is a residual, x + residual is advanced; a corrected place has none.

    Returns (squared displacement since the list was built [m^2], whether a wall's plane stopped the particle).
    """
    real = type(timestep[0])
    corrections, position_residual, velocity, position = moving
    x0, y0, z0 = three(position, i)
    u, v, w = added(three(velocity, i), scaled(three(acceleration, i), timestep[0]))
    x, y, z = advanced(i, position, position_residual, scaled((u, v, w), timestep[1]))
    corrected = False
    if penetration.swept:
        begun = real(1)
        if not outside_box(x0, y0, z0, penetration):
            begun, _, _, _ = marked_distance(x0, y0, z0, solid_field, penetration)
        if begun >= real(0):  # otherwise the particle is inside already, and only the end of its step counts
            t = entry(x0, y0, z0, x - x0, y - y0, z - z0, solid_field, penetration)
            if t < real(1):
                x, y, z = x0 + t * (x - x0), y0 + t * (y - y0), z0 + t * (z - z0)
                corrected = True
    if penetration.everywhere or not outside_box(x, y, z, penetration):
        share = rebound(identity[i], corrections[i], penetration)
        allowed = real(0)
        for push in range(PUSHES if penetration.swept else 1):
            depth, nx, ny, nz = marked_distance(x, y, z, solid_field, penetration)
            steep = math.sqrt(nx * nx + ny * ny + nz * nz)
            if not (depth < allowed and steep > real(0)):
                break
            nx, ny, nz = nx / steep, ny / steep, nz / steep
            jump = reflected(u * nx + v * ny + w * nz, penetration)
            u, v, w = u + jump * nx, v + jump * ny, w + jump * nz
            distance = pushed(depth, steep, share)
            x, y, z = x + distance * nx, y + distance * ny, z + distance * nz
            corrected = True
            if push == 0:
                corrections[i] += 1
                allowed = -solid_field.spacing / real(LEFT)
    stopped = False
    squared = real(0)
    for c in range(3):
        place, speed = x, u
        if c == 1:
            place, speed = y, v
        elif c == 2:
            place, speed = z, w
        held = corrected
        if bounds is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
            if place < bounds.lower[c] or place > bounds.upper[c]:
                place = min(max(place, bounds.lower[c]), bounds.upper[c])
                speed = real(0)
                stopped = held = True
        forget(i, c, held, position_residual)
        velocity[i, c] = speed
        position[i, c] = place
        moved = place - build_position[i, c]
        squared += moved * moved
    if not squared >= real(0):  # NaN: a maximum over the particles would ignore it
        squared = real(math.inf)
    return squared, stopped
