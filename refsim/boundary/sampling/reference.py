"""NumPy oracle of boundary sampling: all pairs, float64."""

import math

import numpy as np

from refsim.boundary.signed_distance.reference import interpolate
from refsim.core.operation import operations
from refsim.neighbours.reference import other_particles, pair_blocks
from refsim.surface_energy.reference import hash_word

operation = operations(paper="patent CN104318598A, 2014")


def _share(a, b, c):
    return (hash_word(a, b, c) >> 8) / 2.0**24


@operation(
    "patent P2: area A of a facet", outputs="facet_area", entrywise=True, tolerance=8.0,
    reason="one rounding in each difference, product, sum and root",
)  # fmt: skip
def areas(facet_corner, facets_of_mesh):
    """Patent P2: A = |(b - a) x (c - a)|/2 [m^2] of each facet."""
    corner = np.asarray(facet_corner, dtype=float)[np.asarray(facets_of_mesh)]
    one, other = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    cross = np.cross(one, other)
    size = (np.linalg.norm(one, axis=1) + np.abs(corner).max((1, 2), initial=0.0)) * np.linalg.norm(other, axis=1)
    return {"facet_area": (np.sqrt((cross**2).sum(1)) / 2, size)}


@operation(
    "patent P2 with E25: g A/(pi r^2) particles by a running sum", outputs="placed", entrywise=True, tolerance=8.0,
    reason="one rounding in each share, difference, product and sum",
)  # fmt: skip
def place(facet_corner, facets_of_mesh, facet_last, sample_seed):
    """Patent P2 with E25: x = (1 - s) a + s ((1 - w) b + w c) [m] in the facet f with N_(f-1) <= i < N_f."""
    corner = np.asarray(facet_corner, dtype=float)[np.asarray(facets_of_mesh)]
    last = np.asarray(facet_last)
    count = int(last[-1]) if len(last) else 0
    value, scale = np.zeros((count, 3)), np.zeros((count, 3))
    for i in range(count):
        f = int(np.count_nonzero(last <= i))
        s, w = math.sqrt(_share(sample_seed, i, 1)), _share(sample_seed, i, 2)
        value[i] = (1 - s) * corner[f, 0] + s * ((1 - w) * corner[f, 1] + w * corner[f, 2])
        scale[i] = np.abs(corner[f]).sum(0)
    return {"placed": (value, scale)}


def _direction(i, j, seed):
    z = 2 * _share(min(i, j), max(i, j), 2 * int(seed)) - 1
    turn = 2 * math.pi * _share(min(i, j), max(i, j), 2 * int(seed) + 1)
    away = math.sqrt(1 - z * z)
    return (1 if i < j else -1) * np.array([away * math.cos(turn), away * math.sin(turn), z])


@operation(
    "patent P3 and P4 with E24: tangential repulsion and projection along the normal",
    outputs="relaxed_position step_length", variants=("", {"relaxation": "as_printed"}), tolerance=16.0,
    reason="one rounding in each of distance, exponential, product and sum, and those of the interpolated distance"
    " and slope", invariants="reordering", cases="piled_up",
)  # fmt: skip
def relax(position, distance_field, relaxation, rows=None):
    """Patent P3 and P4 with E24: x <- x + lambda r v_t - phi n, and the length of that step, both [m].

    v_t = (I - n n^T) sum_l Omega(|x - x_l|) (x - x_l)/|x - x_l|.
    """
    x = np.asarray(position, dtype=float)
    own = np.arange(len(x)) if rows is None else np.asarray(rows)
    push, pushes = np.zeros((len(own), 3)), np.zeros(len(own))
    for part, apart, distance in pair_blocks(position, position, rows):
        near = (distance**2 < float(relaxation.cutoff_squared)) & other_particles(part, len(x), rows)
        with np.errstate(invalid="ignore", divide="ignore"):
            force = np.where(near, np.exp(-(distance**2) * float(relaxation.inverse_width)), 0)
            unit = np.where((near & (distance > 0))[..., None], apart / distance[..., None], 0)
        for a, j in zip(*np.nonzero(near & (distance == 0))):
            unit[a, j] = _direction(own[part][a], j, relaxation.seed)
        push[part] += (force[..., None] * unit).sum(1)
        pushes[part] += force.sum(1)
    here = interpolate(x[own], distance_field)
    phi, slope = here["query_distance"][0], here["query_gradient"][0]
    steep = np.linalg.norm(slope, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        n = np.where(steep[:, None] > 0, slope / steep[:, None], 0)
        unsure = np.where(steep > 0, here["query_gradient"][1].max(1, initial=0.0) / steep, 0)
    if relaxation.tangential:
        push = push - (push * n).sum(1)[:, None] * n
    move = float(relaxation.step) * push
    length = np.linalg.norm(move, axis=1)
    longest = float(relaxation.longest)
    move = np.where((length > longest)[:, None], move * (longest / np.maximum(length, longest))[:, None], move)
    move = move - phi[:, None] * n
    size = (float(relaxation.step) * pushes + np.abs(phi)) * (1 + 4 * unsure) + here["query_distance"][1]
    return {
        "relaxed_position": (x[own] + move, (np.abs(x[own]).max(1, initial=0.0) + size)[:, None] * np.ones(3)),
        "step_length": (np.linalg.norm(move, axis=1), size),
    }
