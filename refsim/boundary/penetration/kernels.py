"""What one particle does at a solid's surface.

`solid_field` is the narrow band of signed distances, negative inside; `penetration` holds the correction's parameters.
"""

import math

from refsim.backends.compile import formula
from refsim.backends.reductions import reduction
from refsim.backends.tuples import added, difference, dot, over, scaled, three
from refsim.boundary.penetration.formulas import pushed, rebound, reflected
from refsim.boundary.signed_distance.formulas import place_in_field, trilinear, value_beyond
from refsim.neighbours.formulas import longest_of
from refsim.sparse_grid.formulas import find_node
from refsim.sph.formulas import between_ends
from refsim.sph.kernels import squared_shift, stepped_along

LONGEST = 4096  # samples along one path
# h/CLEARANCE is subtracted from interpolated distances and is the least step along a path; h: band's spacing
CLEARANCE = 4
PUSHES = 16  # at most, in one step; each is at most two depths long, and halves the depth on rounded edges
LEFT = 128  # a push that leaves the particle less deep than h/LEFT is the last one


@formula
def marked_distance(x, solid_field):
    """(phi [m], its slope along x, y, z) at a point: interpolated in a marked cell, +-band and slope 0 in others."""
    _, (jx, jy, jz) = place_in_field(x, solid_field)
    if find_node(solid_field, jx, jy, jz) < 0:
        flat = type(x[0])(0)
        return value_beyond(solid_field, jx, jy, jz), (flat, flat, flat)
    return trilinear(x, solid_field)


@formula
def clipped(x, path, penetration):
    """Interval (first, last) of t for which x + t path [m], 0 <= t <= 1, is in the band's box; first > last if none."""
    real = type(x[0])
    first, last = real(0), real(1)
    for c in range(3):
        low, high = penetration.lower[c], penetration.upper[c]
        if path[c] == real(0):
            if x[c] < low or x[c] > high:
                last = real(-1)
        else:
            a, b = (low - x[c]) / path[c], (high - x[c]) / path[c]
            first = max(first, min(a, b))
            last = min(last, max(a, b))
    return first, last


@formula
def entry(x, path, solid_field, penetration):
    """Least t in [0, 1] for which sphere tracing finds a negative distance at x + t path [m]; 2 if there is none.

    The path is clipped to the band's box first, so that it may begin anywhere.
    """
    real = type(x[0])
    never = real(2)
    length = math.sqrt(dot(path, path))
    if not (length > real(0) and length < real(math.inf)):
        return never
    first, last = clipped(x, path, penetration)
    if not first <= last:
        return never
    clearance = solid_field.spacing / real(CLEARANCE)
    t = first
    for _ in range(LONGEST):
        d, _ = marked_distance(added(x, scaled(path, t)), solid_field)
        if d < real(0):
            return t
        if t >= last:
            return never
        t = min(t + max(d - clearance, clearance) / length, last)
    return never


@formula
def outside_box(x, penetration):
    """Whether a point [m] is outside the marked region's box, where no distance is needed."""
    low, high = penetration.lower, penetration.upper
    return not (
        x[0] >= low[0] and x[0] <= high[0] and x[1] >= low[1] and x[1] <= high[1] and x[2] >= low[2] and x[2] <= high[2]
    )


@reduction(into="displacement", how="largest count largest", rows="position")
def kick_drift(
    i, acceleration, identity, build_position, bounds, timestep, way, longest_shift, drawn_body, solid_field,
    penetration, corrections, position_residual, velocity, position,
):  # fmt: skip
    """Leap-frog step v += (dt_previous + dt)/2 a, x += dt v + s, with patent P8 where it would enter the solid.

    Where there is a residual, x + residual is advanced; a corrected place has none.

    Returns (squared displacement since the list was built [m^2], whether a plane stopped it, squared shift [m^2]).
    """
    real = type(timestep[0])
    start = three(position, i)
    longest = longest_of(i, longest_shift, drawn_body, real(0))
    factors = timestep[0], timestep[1], longest
    given = position, position_residual, velocity, acceleration, build_position, None, factors, way
    u, x, a, _, _ = stepped_along(0, i, *given)
    v, y, b, _, _ = stepped_along(1, i, *given)
    w, z, c, _, _ = stepped_along(2, i, *given)
    v, x, residual = (u, v, w), (x, y, z), (a, b, c)
    corrected = False
    if penetration.swept:
        begun = real(1)
        if not outside_box(start, penetration):
            begun, _ = marked_distance(start, solid_field)
        if begun >= real(0):  # otherwise the particle is inside already, and only the end of its step counts
            path = difference(x, start)
            t = entry(start, path, solid_field, penetration)
            if t < real(1):
                x = added(start, scaled(path, t))
                corrected = True
    if not outside_box(x, penetration):
        share = rebound(identity[i], corrections[i], penetration)
        allowed = real(0)
        for push in range(PUSHES if penetration.swept else 1):
            depth, n = marked_distance(x, solid_field)
            steep = math.sqrt(dot(n, n))
            if not (depth < allowed and steep > real(0)):
                break
            n = over(n, steep)
            v = added(v, scaled(n, reflected(dot(v, n), penetration)))
            x = added(x, scaled(n, pushed(depth, steep, share)))
            corrected = True
            if push == 0:
                corrections[i] += 1
                allowed = -solid_field.spacing / real(LEFT)
    stopped, squared = False, real(0)
    for c in range(3):
        place, speed, rest = x[c], v[c], real(0) if corrected else residual[c]
        if bounds is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
            if (place < bounds.lower[c] or place > bounds.upper[c]) and between_ends(start, bounds):
                place = min(max(place, bounds.lower[c]), bounds.upper[c])
                speed, rest, stopped = real(0), real(0), True
        velocity[i, c] = speed
        position[i, c] = place
        if position_residual is not None:
            position_residual[i, c] = rest
        moved = place - build_position[i, c]
        squared += moved * moved
    if not squared >= real(0):  # NaN: a maximum over the particles would ignore it
        squared = real(math.inf)
    return squared, stopped, squared_shift(i, way, longest)
