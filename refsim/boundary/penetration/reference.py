"""NumPy oracle of the penetration correction: float64, all particles at once, nodes by coordinates in one list."""

import numpy as np

from refsim.core.operation import operation, without
from refsim.sparse_grid.reference import Lookup
from refsim.sph.reference import at_planes, carried

CLEARANCE = 4
LONGEST = 4096
PUSHES, LEFT = 16, 128
ROUNDING = 4e-7  # of a position, relative, in float32


class Sampled:
    """Distances phi [m] and slopes between the nodes of a narrow band; +-band where no block holds a cell's corner."""

    def __init__(self, field):
        self.h, self.band = 1 / float(field.inverse_spacing), float(field.band)
        self.origin = np.array([field.origin_x, field.origin_y, field.origin_z], dtype=float)
        self.node = Lookup(field)
        self.value = np.asarray(field.distance, dtype=float)
        self.block = self.node.coordinates[::64] // 4
        self.after = np.asarray(field.inside_after) != 0

    def beyond(self, j):
        """+-band [m] at nodes (n, 3) of no block: the side of the last block before, in the same row along x."""
        value = np.full(len(j), self.band)
        for k, (x, y, z) in enumerate(j // 4):
            row = (self.block[:, 1] == y) & (self.block[:, 2] == z) & (self.block[:, 0] < x)
            if row.any():
                last = np.flatnonzero(row)[self.block[row, 0].argmax()]
                value[k] = -self.band if self.after[last] else self.band
        return value

    def nodes(self, j):
        """phi [m] at nodes (n, 3)."""
        n = self.node(j)
        value = np.where(n >= 0, self.value[np.maximum(n, 0)] if len(self.value) else 0.0, 0.0)
        if (n < 0).any():
            value[n < 0] = self.beyond(j[n < 0])
        return value

    def __call__(self, x, everywhere=False):
        """(phi (n,) [m], slope (n, 3)) at points (n, 3) [m]."""
        local = (np.asarray(x, dtype=float) - self.origin) / self.h
        j = np.clip(np.floor(np.nan_to_num(local, nan=-(2.0**20))), -(2**20), 2**20).astype(np.int64)
        u = local - j
        phi, slope = np.zeros(len(j)), np.zeros((len(j), 3))
        unmarked = (self.node(j) < 0) & (not everywhere)
        if unmarked.any():
            phi[unmarked] = self.beyond(j[unmarked])
        rest = np.flatnonzero(~unmarked)
        for c in range(8):
            step = np.array([c & 1, c >> 1 & 1, c >> 2])
            corner = self.nodes(j[rest] + step)
            weight = np.where(step == 1, u[rest], 1 - u[rest])
            phi[rest] += weight.prod(1) * corner
            for axis in range(3):
                others = [a for a in range(3) if a != axis]
                slope[rest, axis] += (1 if step[axis] else -1) * weight[:, others].prod(1) * corner / self.h
        return phi, slope


def rebound(identity, count, penetration):
    """D_r of patent P8 with E28 (n,), dimensionless: rebound times a hash of particle and count of corrections."""
    a = (np.asarray(identity, dtype=np.int64) * 1_000_003 + np.asarray(count, dtype=np.int64) * 7_919 + 12_345) % 2**31
    a = ((a ^ a // 2**15) * 73_856_093) % 2**31
    a = ((a ^ a // 2**13) * 19_349_663) % 2**31
    a = (a ^ a // 2**16) % 2**16
    return float(penetration.rebound) * a / 2**16


def in_box(x, penetration):
    """Which points (n, 3) [m] are in the box of the marked region."""
    low, high = np.asarray(penetration.lower, dtype=float), np.asarray(penetration.upper, dtype=float)
    return ((x >= low) & (x <= high)).all(1)


def entry(start, path, sampled, penetration):
    """(least t (n,) with phi(start + t path) < 0 by sphere tracing, inf for none; least |phi| on the path [m])."""
    length = np.sqrt((path**2).sum(1))
    low, high = np.asarray(penetration.lower, dtype=float), np.asarray(penetration.upper, dtype=float)
    with np.errstate(all="ignore"):
        a, b = (low - start) / path, (high - start) / path
        first, last = np.fmin(a, b), np.fmax(a, b)
    still = path == 0
    missed = (still & ((start < low) | (start > high))).any(1)
    first = np.maximum(np.where(still, 0.0, first).max(1), 0.0)
    last = np.minimum(np.where(still, 1.0, last).min(1), 1.0)
    t, found, least = first.copy(), np.full(len(start), np.inf), np.full(len(start), np.inf)
    going = np.flatnonzero((first <= last) & ~missed & (length > 0) & np.isfinite(length))
    clearance = sampled.h / CLEARANCE
    for _ in range(LONGEST):
        if not len(going):
            break
        phi, _ = sampled(start[going] + t[going, None] * path[going], penetration.everywhere)
        rounded = t[going] > 0  # the particle's own position is exact
        least[going] = np.minimum(least[going], np.where(rounded, np.abs(phi), np.inf))
        found[going] = np.where(phi < 0, t[going], np.inf)
        on = (phi >= 0) & (t[going] < last[going])
        step = np.maximum(phi - clearance, clearance) / length[going]
        t[going] = np.where(on, np.minimum(t[going] + step, last[going]), t[going])
        going = going[on]
    return found, least


@operation(
    "leap-frog and patent P8 with E26 to E28", paper="patent CN104318598A, 2014",
    outputs="corrections position_residual velocity position displacement", exact="corrections",
    optional="bounds position_residual",
    variants=(
        without("bounds position_residual", timestep="long_steps"), "", without("bounds", penetration="as_printed"),
        without("bounds", timestep="long_steps", penetration="everywhere"),
    ),
    reason="one rounding in each product and sum; the scale counts those of distance and normal",
    invariants="reordering", cases="towards_edges outside_the_grid",
)  # fmt: skip
def kick_drift(
    acceleration, identity, build_position, bounds, timestep, solid_field, penetration, corrections,
    position_residual, velocity, position,
):  # fmt: skip
    """Leap-frog: v += (dt_previous + dt)/2 a [m/s], x += dt v [m]; patent P8 where a particle would enter the solid.

    Swept: x becomes the first point of the path with phi < 0. P8 where phi < 0, n = grad phi/|grad phi|:
    v -= (1 + c_r)(v.n) n, unless v.n >= 0 (E27), x += (1 + D_r) |phi|/min(|grad phi|, 1) n (E28), the quotient at most
    2 |phi|; swept: repeated, up to 16 times in all, while phi < -h/128.
    position_residual, displacement: as `sph.kick_drift`; a corrected place has no residual.
    The scale is infinite where a distance on the path is within rounding of 0.
    """
    kick, drift = (float(t) for t in timestep)
    a = np.asarray(acceleration, dtype=float)
    old_v, old_x = np.asarray(velocity, dtype=float), np.asarray(position, dtype=float)
    count = np.asarray(corrections, dtype=np.int64)
    sampled = Sampled(solid_field)
    v = old_v + kick * a
    v_scale = np.abs(old_v) + np.abs(kick * a)
    x, x_scale = old_x + drift * v, np.abs(old_x) + np.abs(drift) * v_scale
    answer, rest = {}, None
    if position_residual is not None:
        (x, x_scale), rest = carried(position, position_residual, drift * v, np.abs(drift) * v_scale)
    hit = np.zeros(len(x), dtype=bool)
    margin, exact = np.full(len(x), np.inf), np.full(len(x), np.inf)
    if penetration.swept and len(x):
        begun, _ = sampled(old_x, penetration.everywhere)
        begun = np.where(in_box(old_x, penetration), begun, np.inf)
        share, least = entry(old_x, x - old_x, sampled, penetration)
        outside = begun >= 0
        margin = np.where(outside, least, np.inf)
        exact = np.abs(begun) / sampled.band
        hit = outside & (share < 1)
        x = np.where(hit[:, None], old_x + np.where(hit, share, 0.0)[:, None] * (x - old_x), x)
    # A normal is a difference of distances over a spacing: its error by rounding of the position, in units of 1/eps.
    size = np.abs(old_x).max(1, initial=0.0) + np.abs(np.asarray(penetration.upper)).max() + sampled.band
    tilt = 1e-3 + 2 * ROUNDING * np.abs(old_x).max(1, initial=0.0) / sampled.h  # of a normal, by rounding
    total = np.sqrt((v_scale**2).sum(1))
    share, doubt = 1 + rebound(identity, count, penetration), size / sampled.h
    jumped, grazing = np.zeros(len(x), dtype=bool), np.zeros(len(x), dtype=bool)
    looked = np.flatnonzero(in_box(x, penetration) | bool(penetration.everywhere))
    for push in range(PUSHES if penetration.swept else 1):
        if not len(looked):
            break
        phi, slope = sampled(x[looked], penetration.everywhere)
        short = phi + (sampled.h / LEFT if push else 0.0)  # a push may leave a little
        margin[looked] = np.minimum(margin[looked], np.abs(short))
        steep = np.sqrt((slope**2).sum(1))
        inside = (short < 0) & (steep > 0)
        looked, phi, steep = looked[inside], phi[inside], steep[inside]
        normal = slope[inside] / steep[:, None]
        along = (v[looked] * normal).sum(1)
        turned = (along < 0) | bool(penetration.printed)
        grazing[looked] |= (not penetration.printed) & (np.abs(along) < tilt[looked] * total[looked])
        v[looked] -= np.where(turned, (1 + float(penetration.restitution)) * along, 0.0)[:, None] * normal
        x[looked] += (share[looked] * np.abs(phi) / np.clip(steep, 0.5, 1.0))[:, None] * normal
        v_scale[looked] += (4 * doubt[looked] * (1 + 1 / steep) * total[looked])[:, None]
        x_scale[looked] += (8 * size[looked] * (1 + 1 / steep))[:, None]
        doubt[looked] *= 8 * (1 + 1 / steep)  # the next push depends on this one
        jumped[looked] = True
    margin = np.minimum(4 * margin / size, exact)  # a position is rounded by eps/2 in each coordinate
    certain = margin > 4 * ROUNDING
    v_scale = np.where((certain & ~grazing)[:, None] | np.isnan(v_scale), v_scale, np.inf)
    x_scale = np.where(certain[:, None] | np.isnan(x_scale), x_scale, np.inf)
    x, v, rest, stopped = at_planes(bounds, x, v, rest)
    if rest is not None:
        value, scale = (np.where((hit | jumped)[:, None], 0.0, part) for part in rest)
        answer["position_residual"] = (value, np.where(certain[:, None], scale, np.inf))
    moved = x - np.asarray(build_position, dtype=float)
    squared = (moved**2).sum(1)
    bound = ((np.abs(moved) + x_scale) ** 2).sum(1)
    return answer | {
        "corrections": (count + jumped, margin),
        "velocity": (v, v_scale),
        "position": (x, x_scale),
        "displacement": (
            np.array([squared.max(initial=0), stopped.sum()]),
            np.array([bound.max(initial=0), 0.0 if certain.all() else np.inf]),
        ),
    }
