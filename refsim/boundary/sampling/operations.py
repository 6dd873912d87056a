"""Operations of boundary sampling: all pairs, float64."""

import numpy as np

from refsim.boundary.sampling import reference as ref
from refsim.boundary.signed_distance.operations import interpolate
from refsim.core.operation import operations
from refsim.neighbours.reference import other_particles, pair_blocks
from refsim.surface_energy.reference import area_vector, place_in_facet, share

operation = operations(paper="patent CN104318598A, 2014")


def over(a, b):
    """a/b [in the quotient of their units], 0 where b is 0."""
    return np.divide(a, b, out=np.zeros(np.broadcast_shapes(np.shape(a), np.shape(b))), where=b > 0)


@operation(
    "patent P2: area A of a facet", outputs="facet_area", entrywise=True, tolerance=8.0,
    reason="one rounding in each difference, product, sum and root",
)  # fmt: skip
def areas(facet_corner, facets_of_mesh):
    """Areas [m^2] of facets."""
    corner = np.asarray(facet_corner, dtype=float)[np.asarray(facets_of_mesh)]
    one, other = (np.linalg.norm(corner[:, k] - corner[:, 0], axis=1) for k in (1, 2))
    area = np.sqrt((area_vector(corner) ** 2).sum(1))
    return {"facet_area": (area, (one + np.abs(corner).max((1, 2), initial=0.0)) * other)}


@operation(
    "patent P2 with E25: g A/(pi r^2) particles by a running sum", outputs="placed", entrywise=True, tolerance=8.0,
    reason="one rounding in each share, difference, product and sum",
)  # fmt: skip
def place(facet_corner, facets_of_mesh, facet_last, sample_seed):
    """Particles [m], i in the facet f with N_(f-1) <= i < N_f."""
    corner, last = np.asarray(facet_corner, dtype=float)[np.asarray(facets_of_mesh)], np.asarray(facet_last)
    i = np.arange(int(last[-1]) if len(last) else 0)
    corners = corner[(last[None, :] <= i[:, None]).sum(1)] if len(i) else np.zeros((0, 3, 3))
    u, w = (np.array([share(sample_seed, k, c) for k in i]).reshape(-1, 1) for c in (1, 2))
    return {"placed": (place_in_facet(corners, u, w), np.abs(corners).sum(1))}


@operation(
    "patent P3 and P4 with E24: tangential repulsion and projection along the normal",
    outputs="relaxed_position step_length", variants=("", {"relaxation": "as_printed"}), tolerance=16.0,
    reason="one rounding in each of distance, exponential, product and sum, and those of the interpolated distance"
    " and slope", invariants="reordering", cases="piled_up",
)  # fmt: skip
def relax(position, distance_field, relaxation, rows=None):
    """Relaxed places and lengths of the steps, both [m]."""
    x = np.asarray(position, dtype=float)
    index = np.arange(len(x)) if rows is None else np.asarray(rows)
    push, pushes = np.zeros((len(index), 3)), np.zeros(len(index))
    for part, apart, distance in pair_blocks(position, position, rows):
        near = (distance**2 < float(relaxation.cutoff_squared)) & other_particles(part, len(x), rows)
        force = np.where(near, ref.repulsion(distance, float(relaxation.inverse_width)), 0)
        unit = over(apart, np.where(near, distance, 0)[..., None])
        for a, j in zip(*np.nonzero(near & (distance == 0))):
            unit[a, j] = ref.direction(index[part][a], j, relaxation.seed)
        push[part] += (force[..., None] * unit).sum(1)
        pushes[part] += force.sum(1)
    here = interpolate(x[index], distance_field)
    (phi, phi_size), (slope, slope_size) = here["query_distance"], here["query_gradient"]
    steep, step = np.linalg.norm(slope, axis=1), float(relaxation.step)
    n, unsure = over(slope, steep[:, None]), over(slope_size.max(1, initial=0.0), steep)
    along = step * (ref.tangential(push, n) if relaxation.tangential else push)
    move = ref.held(along, float(relaxation.longest)) - phi[:, None] * n
    size = (step * pushes + np.abs(phi)) * (1 + 4 * unsure) + phi_size
    return {
        "relaxed_position": (x[index] + move, (np.abs(x[index]).max(1, initial=0.0) + size)[:, None] * np.ones(3)),
        "step_length": (np.linalg.norm(move, axis=1), size),
    }
