"""Patent P8 with E26 to E28: where a particle's path enters a solid, and how it is put out of it."""

import numpy as np

CLEARANCE = 4
LONGEST = 4096


def rebound(identity, count, largest):
    """E28: D_r = rebound times a hash of particle and count of corrections (n,), dimensionless."""
    a = (np.asarray(identity, dtype=np.int64) * 1_000_003 + np.asarray(count, dtype=np.int64) * 7_919 + 12_345) % 2**31
    a = ((a ^ a // 2**15) * 73_856_093) % 2**31
    a = ((a ^ a // 2**13) * 19_349_663) % 2**31
    return largest * ((a ^ a // 2**16) % 2**16) / 2**16


def in_box(x, lower, upper):
    """lower <= x <= upper, the box of the marked region; flags of points (n, 3) [m]."""
    return ((x >= lower) & (x <= upper)).all(1)


def path_in_box(start, path, lower, upper):
    """[t_0, t_1] of x = start + t path within the box, t in [0, 1], dimensionless; t_0 > t_1 where it misses it."""
    with np.errstate(all="ignore"):
        a, b = (lower - start) / path, (upper - start) / path
        first, last = np.fmin(a, b), np.fmax(a, b)
    still = path == 0
    first = np.maximum(np.where(still, 0.0, first).max(1), 0.0)
    last = np.minimum(np.where(still, 1.0, last).min(1), 1.0)
    return first, np.where((still & ((start < lower) | (start > upper))).any(1), -1.0, last)


def samples(start, path, sampled, lower, upper):
    """Sphere tracing, t <- t + max(phi - h/4, h/4)/|path|: yields (rows, t dimensionless, phi [m]), sample by sample.

    A row's samples end within the solid, phi < 0, or where its path leaves the box.
    """
    length = np.sqrt((path**2).sum(1))
    t, last = path_in_box(start, path, lower, upper)
    going = np.flatnonzero((t <= last) & (length > 0) & np.isfinite(length))
    for _ in range(LONGEST):
        if not len(going):
            return
        phi, _ = sampled(start[going] + t[going, None] * path[going])
        yield going, t[going], phi
        on = (phi >= 0) & (t[going] < last[going])
        step = np.maximum(phi - sampled.h / CLEARANCE, sampled.h / CLEARANCE) / length[going]
        t[going] = np.where(on, np.minimum(t[going] + step, last[going]), t[going])
        going = going[on]


def entry(start, path, sampled, lower, upper):
    """Swept: (least t of a sample with phi < 0, inf for none, dimensionless; least |phi| on the path [m]).

    The particle's own position, t = 0, is exact and does not count in the second.
    """
    share, least = np.full((2, len(start)), np.inf)
    for rows, t, phi in samples(start, path, sampled, lower, upper):
        least[rows] = np.minimum(least[rows], np.where(t > 0, np.abs(phi), np.inf))
        share[rows] = np.where(phi < 0, t, np.inf)
    return share, least


def reflected(v, n, restitution, printed):
    """P8: v <- v - (1 + c_r)(v.n) n [m/s], unless v.n >= 0 (E27); n = grad phi/|grad phi|."""
    along = (v * n).sum(1)
    return v - np.where((along < 0) | printed, (1 + restitution) * along, 0.0)[:, None] * n


def pushed(x, n, phi, steep, rebound):
    """P8: x <- x + (1 + D_r) |phi|/min(|grad phi|, 1) n [m] (E28), the quotient at most 2 |phi|."""
    return x + ((1 + rebound) * np.abs(phi) / np.clip(steep, 0.5, 1.0))[:, None] * n
