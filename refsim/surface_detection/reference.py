"""NumPy oracle of surface detection: all pairs, float64.

Answers are flags, so that each function returns {output: (flags, margin)}: margin (n,) >= 0 is the relative
distance of the decision from flipping. It is built like the decision: a comparison becomes a signed number (positive
where it holds), "and" the smaller, "or" the larger, "not" the negative of its parts.
"""

import numpy as np

from refsim.core.operation import operation
from refsim.neighbours.reference import other_particles, pair_blocks, rows_of
from refsim.surface_normal.reference import SHAPES

ENOUGH = 3


@operation(
    "J(12), improved by Jiang & Zhu E23", "surface_detection.candidates",
    paper="Jiang & Zhu 2023, with the first moment beside it", outputs="near_surface", exact="near_surface",
    invariants="reordering",
)  # fmt: skip
@operation(
    "J(12)", paper="Jiang & Zhu 2023", outputs="near_surface", exact="near_surface", optional="asymmetry",
    variants=("asymmetry",), invariants="reordering",
)  # fmt: skip
def near_surface(number_density, asymmetry, near_surface_limit, rows=None):
    """Near-surface flags (n,), number_density (n,) [1/m^dim]: J(12) delta_i <= lambda delta0.

    With asymmetry (n,) [m^(1 - dim)], the length of the first moment of J(8), also those with at
    least the limit (Jiang & Zhu E23).
    """
    margin = 1 - rows_of(number_density, rows) / float(near_surface_limit.number_density)
    if asymmetry is not None:
        margin = np.maximum(margin, rows_of(asymmetry, rows) / float(near_surface_limit.asymmetry) - 1)
    return {"near_surface": ((margin >= 0).astype(np.uint8), np.abs(margin))}


def _in_region(separation, distance, axis, fan_scan):
    """Signed margin, positive where J(13) puts a particle into the scan region.

    separation (b, m, 3) = x_i - x_j [m], distance (b, m) [m], axis (b, 3): outward unit vectors, or zero.
    """
    s = float(fan_scan.radius)
    beyond = distance / (np.sqrt(2) * s) - 1
    ball = 1 - np.linalg.norm(-separation - s * axis[:, None, :], axis=-1) / s
    there = distance > 0
    cosine = (-separation * axis[:, None, :]).sum(-1) / np.where(there, distance, 1.0)
    cone = cosine - np.sqrt(0.5)
    if fan_scan.printed:
        cone = np.where(there, -cone, -1.0)
    far, close = np.minimum(beyond, ball), np.minimum(-beyond, cone)
    # Where both lines agree, the distance sqrt2 s between them does not matter.
    return np.maximum(np.maximum(far, close), np.minimum(ball, cone))


def _thinness(position, walls, fan_scan, thin_feature, rows):
    """Signed margin (n,), positive for a thin neighbourhood, from the eigenvalues of its second moment.

    C_i = sum_j w_ij (x_j - m_i)(x_j - m_i)^T / sum_j w_ij [m^2] over particle i, particles and walls nearer than
    h, w = 1 - (r/h)^2, m_i = sum_j w_ij x_j / sum_j w_ij [m]; thin if the least eigenvalue is at most the limit. The
    margin is their difference relative to the sum of squares and divided by the number of terms, each of which is
    rounded.
    """
    h, dim = float(fan_scan.support_radius), int(thin_feature.dim)
    everyone = np.asarray(position, dtype=float)
    if walls is not None:
        everyone = np.concatenate([everyone, np.asarray(walls.position, dtype=float)])
    margin = np.full(len(position) if rows is None else len(rows), -np.inf)
    for place, separation, distance in pair_blocks(position, everyone, rows):
        for i, away, far in zip(range(place.start, place.stop), -separation[..., :dim], distance):
            near = far < h
            if not near.any():
                continue
            share = 1 - (far[near] / h) ** 2
            share /= share.sum()
            mean = share @ away[near]
            spread = away[near] - mean
            least = np.linalg.eigvalsh((share[:, None] * spread).T @ spread)[0] / h**2
            squares = share @ (far[near] / h) ** 2 + float(thin_feature.variance)
            margin[i] = (float(thin_feature.variance) - least) / squares / near.sum()
    return margin


@operation(
    "J(13) with Jiang & Zhu E5, E6, E20; least eigenvalue of the second moment",
    paper="Jiang & Zhu 2023, after Marrone et al. 2010", outputs="surface", exact="surface",
    optional="walls candidates thin_feature",
    variants=("walls candidates thin_feature", "", "walls candidates", "candidates thin_feature"), tolerance=16.0,
    reason="roundings of the distance, the unit normal and their product, relative to the distance; for each"
    " neighbour those of the second moment and its determinants, relative to the sum of squares",
    invariants="translation reordering", cases=SHAPES,
)  # fmt: skip
def fan_scan(position, surface_normal, candidates, walls, fan_scan, thin_feature, rows=None):
    """Surface flags (n,); position (n, 3) [m], surface_normal (n, 3) inward, candidates (n,) or None.

    J(13), a = -n/|n|: particle j is in the region of i where |x_ij| >= sqrt2 s and |x_j - x_i - s a| < s, or
    |x_ij| < sqrt2 s and a . (x_j - x_i) > sqrt(1/2) |x_ij| (Jiang & Zhu E5: printed "<"). i is surface if its region
    is empty, or if fewer than 3 particles are nearer than h; with a normal below `smallest_normal` the region counts as
    occupied (Jiang & Zhu E20). With `thin_feature` i is surface also if its neighbourhood is thin.
    """
    n = len(position)
    normal = rows_of(surface_normal, rows)
    length = np.linalg.norm(normal, axis=1)
    axis = -normal / np.where(length > 0, length, 1.0)[:, None]
    occupied = np.full(len(normal), -np.inf)
    nearest = np.full((len(normal), ENOUGH), np.inf)

    def look(place, separation, distance, allowed):
        inside = _in_region(separation, distance, axis[place], fan_scan)
        occupied[place] = np.maximum(occupied[place], np.where(allowed, inside, -np.inf).max(1, initial=-np.inf))
        ranked = np.hstack([nearest[place], np.where(allowed, distance, np.inf)])
        nearest[place] = np.sort(ranked, axis=1)[:, :ENOUGH]

    for place, separation, distance in pair_blocks(position, position, rows):
        look(place, separation, distance, other_particles(place, n, rows))
    if walls is not None:
        for place, separation, distance in pair_blocks(position, walls.position, rows):
            look(place, separation, distance, np.ones(distance.shape, dtype=bool))
    directed = length / float(fan_scan.smallest_normal) - 1
    sparse = nearest[:, -1] / float(fan_scan.support_radius) - 1
    surface = np.maximum(sparse, np.minimum(directed, -occupied))
    if thin_feature is not None:
        surface = np.maximum(surface, _thinness(position, walls, fan_scan, thin_feature, rows))
    if candidates is not None:
        surface = np.where(rows_of(candidates, rows) != 0, surface, -np.inf)
    return {"surface": ((surface > 0).astype(np.uint8), np.abs(surface))}


@operation(
    "p = 0 on S", paper="Koshizuka & Oka 1996, as cited by Jiang & Zhu 2023", outputs="pressure", tolerance=0.0,
    reason="a choice between a copy and zero", invariants="reordering",
)  # fmt: skip
def release_pressure(surface, pressure, rows=None):
    """Pressure (n,) [Pa]: p = 0 where surface (n,) is set, unchanged elsewhere."""
    own = rows_of(pressure, rows)
    return {"pressure": (np.where(rows_of(surface, rows) != 0, 0.0, own), np.abs(own))}
