"""CPU programs of the reconstruction of a surface and of its tension."""

import numpy as np

from refsim.backends.compile import cpu_kernel, prange
from refsim.surface_energy import node


@cpu_kernel
def node_states(interior_position, cells, blocks, surface_term, node_state):
    """Algorithm 1, lines 5 to 9: 1 inside, 0 outside."""
    for i in prange(node_state.shape[0]):
        node_state[i] = node.is_inside(i, interior_position, cells, blocks, surface_term)


@cpu_kernel
def exit_points(interior_position, cells, blocks, node_state, surface_term, vertex_edge, vertex_position):
    """Algorithm 1, lines 10 to 17: vertices on the union of spheres [m]."""
    for v in prange(vertex_position.shape[0]):
        x, y, z = node.exit_point(v, interior_position, cells, blocks, node_state, surface_term, vertex_edge)
        vertex_position[v, 0] = x
        vertex_position[v, 1] = y
        vertex_position[v, 2] = z


@cpu_kernel
def facet_samples(vertex_position, facets, sample_position, sample_area, facet_normal):
    """One sample to a facet: its centroid [m], area [m^(dim-1)] and normal."""
    for f in prange(sample_area.shape[0]):
        x, y, z, area, nx, ny, nz = node.facet_sample(f, vertex_position, facets)
        sample_position[f, 0] = x
        sample_position[f, 1] = y
        sample_position[f, 2] = z
        sample_area[f] = area
        facet_normal[f, 0] = nx
        facet_normal[f, 1] = ny
        facet_normal[f, 2] = nz


@cpu_kernel
def candidates(vertex_position, facets, area_before, dice, candidate_facet, candidate_position):
    """Candidates for samples, evenly over the area [m]."""
    for k in prange(candidate_position.shape[0]):
        one = vertex_position.dtype.type(1)
        f, x, y, z = node.candidate(k, vertex_position, facets, area_before, dice, one)
        candidate_facet[k] = f
        candidate_position[k, 0] = x
        candidate_position[k, 1] = y
        candidate_position[k, 2] = z


@cpu_kernel
def throw_darts(candidate_position, candidate_cells, blocks, dice, surface_term, accepted):
    """One round: candidates are taken or not where those drawn before them are known."""
    for k in prange(accepted.shape[0]):
        if accepted[k] == 2:
            accepted[k] = node.dart(k, candidate_position, candidate_cells, blocks, dice, surface_term, accepted)


def poisson_disk(candidate_position, candidate_cells, blocks, dice, surface_term, accepted):
    """Rounds until every candidate is known."""
    accepted[:] = 2
    while (accepted == 2).any():
        throw_darts(candidate_position, candidate_cells, blocks, dice, surface_term, accepted)


@cpu_kernel
def offsets(
    interior_position,
    cells,
    blocks,
    surface_term,
    sample_position,
    sample_cells,
    nearest,
    offset_direction,
    fit_position,
):
    """Section 4.3.1: nearest particles, directions away from them, and the points of the fit [m]."""
    for s in prange(nearest.shape[0]):
        p, nx, ny, nz = node.nearest_particle(
            sample_cells.cell[s], sample_position[s, 0], sample_position[s, 1], sample_position[s, 2],
            interior_position, cells, blocks, surface_term,
        )  # fmt: skip
        nearest[s] = p
        offset_direction[s, 0] = nx
        offset_direction[s, 1] = ny
        offset_direction[s, 2] = nz
        if fit_position is not None:
            way = surface_term.offset * surface_term.cell_size
            for c in range(3):
                fit_position[s, c] = sample_position[s, c]
                fit_position[nearest.shape[0] + s, c] = sample_position[s, c] + way * offset_direction[s, c]


def sample_counts(nearest, sample_count):
    """C_p: samples of each particle."""
    sample_count[:] = np.bincount(nearest[nearest >= 0], minlength=len(sample_count))


@cpu_kernel
def splines_of_points(fit_position, fit_cells, blocks, surface_term, fit_splines):
    """Splines of each point of the fit, axis by axis."""
    for r in prange(fit_splines.shape[0]):
        node.point_splines(r, fit_position, fit_cells, blocks, surface_term, fit_splines)


@cpu_kernel
def weights_of_nodes(fit_splines, fit_cells, blocks, surface_term, node_weight):
    """(3.7): the diagonal of Lambda."""
    for i in prange(node_weight.shape[0]):
        node_weight[i] = node.normalizing_weight(i, fit_splines, fit_cells, blocks, surface_term)


def fit_weights(fit_position, fit_cells, blocks, surface_term, fit_splines, node_weight):
    """Splines of the points, and (3.7)."""
    splines_of_points(fit_position, fit_cells, blocks, surface_term, fit_splines)
    weights_of_nodes(fit_splines, fit_cells, blocks, surface_term, node_weight)


@cpu_kernel
def fit_residuals(fit_splines, fit_cells, blocks, surface_term, coefficients, residual):
    """b - B C, in units of h."""
    for r in prange(residual.shape[0]):
        residual[r] = node.fit_residual(r, fit_splines, fit_cells, blocks, surface_term, coefficients)


@cpu_kernel
def fit_correct(fit_splines, fit_cells, blocks, surface_term, node_weight, active, residual, coefficients):
    """C <- C + w Lambda B^T (b - B C) on the active nodes."""
    for a in prange(active.shape[0]):
        i = active[a]
        change = node.fit_correction(i, fit_splines, fit_cells, blocks, surface_term, residual)
        coefficients[i] += surface_term.relaxation * node_weight[i] * change


def fit(fit_splines, fit_cells, blocks, surface_term, node_weight, active, residual, coefficients):
    """(3.6), Algorithm 2: `iterations` sweeps from C = 0, in units of h."""
    coefficients[:] = 0
    residual[:] = 0
    for _ in range(surface_term.iterations):
        fit_residuals(fit_splines, fit_cells, blocks, surface_term, coefficients, residual)
        fit_correct(fit_splines, fit_cells, blocks, surface_term, node_weight, active, residual, coefficients)


@cpu_kernel
def mls_normals(
    query_position,
    spline_cells,
    blocks,
    surface_term,
    coefficients,
    outward,
    surface_value,
    surface_gradient,
    sample_normal,
):
    """(3.8) and (3.17): value [h], gradient and unit normal of the implicit surface."""
    for q in prange(sample_normal.shape[0]):
        value, gx, gy, gz = node.mls_gradient(q, query_position, spline_cells, blocks, surface_term, coefficients)
        node.store_normal(q, value, gx, gy, gz, outward, surface_value, surface_gradient, sample_normal)


@cpu_kernel
def spline_normals(
    query_position,
    spline_cells,
    blocks,
    surface_term,
    coefficients,
    outward,
    surface_value,
    surface_gradient,
    sample_normal,
):
    """(3.8) and (3.9): value [h], gradient and unit normal of the implicit surface."""
    for q in prange(sample_normal.shape[0]):
        value, gx, gy, gz = node.spline_gradient(q, query_position, spline_cells, blocks, surface_term, coefficients)
        node.store_normal(q, value, gx, gy, gz, outward, surface_value, surface_gradient, sample_normal)


@cpu_kernel
def inset(vertex_position, vertex_normal, surface_term, inset_position):
    """Vertices moved back to the liquid's surface [m]."""
    for v in prange(inset_position.shape[0]):
        way = surface_term.inset * surface_term.cell_size
        for c in range(3):
            inset_position[v, c] = vertex_position[v, c] - way * vertex_normal[v, c]


@cpu_kernel
def surface_force(sample_position, sample_area, sample_normal, spline_cells, blocks, surface_term, node_force):
    """(4.18*): force on the nodes [N]."""
    for i in prange(node_force.shape[0]):
        fx, fy, fz = node.node_tension(
            i, sample_position, sample_area, sample_normal, spline_cells, blocks, surface_term
        )
        node_force[i, 0] = fx
        node_force[i, 1] = fy
        node_force[i, 2] = fz


def components(blocks, node_state, node_label):
    """The lowest node of each inside node's component; SciPy joins them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    from refsim.sparse_grid.cpu import neighbours_along

    inside = node_state == 1
    node_label[:] = -1
    pairs = []
    for axis in range(3 if blocks.neighbour.shape[1] == 27 else 2):
        other = neighbours_along(blocks, axis)
        joined = np.flatnonzero(inside & (other >= 0))
        joined = joined[inside[other[joined]]]
        pairs.append((joined, other[joined]))
    first, second = (np.concatenate(part) for part in zip(*pairs, strict=True))
    graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(len(inside),) * 2)
    count, label = connected_components(graph, directed=False)
    lowest = np.full(count, len(inside), np.int64)
    np.minimum.at(lowest, label, np.arange(len(inside)))
    node_label[inside] = lowest[label[inside]]


def component_sizes(cells, node_label, component_size):
    """Particles in the component of each particle."""
    label = np.where(cells.cell >= 0, node_label[cells.cell], -1) if len(node_label) else cells.cell
    held = np.bincount(label + 1, minlength=1)
    component_size[:] = np.where(label >= 0, held[label + 1], 0)


@cpu_kernel
def extents(interior_position, cells, blocks, surface_term, extent):
    """Along how many axes the particles around each particle spread."""
    for p in prange(extent.shape[0]):
        extent[p] = node.extent(p, interior_position, cells, blocks, surface_term)
