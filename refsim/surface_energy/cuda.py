"""CUDA programs of the reconstruction of a surface and of its tension."""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel, formula
from refsim.sparse_grid.formulas import step_node
from refsim.surface_energy import node


@cuda_kernel
def node_states(interior_position, cells, blocks, surface_term, node_state):
    """Algorithm 1, lines 5 to 9: 1 inside, 0 outside."""
    i = cuda.grid(1)
    if i < node_state.shape[0]:
        node_state[i] = node.is_inside(i, interior_position, cells, blocks, surface_term)


@cuda_kernel
def exit_points(interior_position, cells, blocks, node_state, surface_term, vertex_edge, vertex_position):
    """Algorithm 1, lines 10 to 17: vertices on the union of spheres [m]."""
    v = cuda.grid(1)
    if v < vertex_position.shape[0]:
        x, y, z = node.exit_point(v, interior_position, cells, blocks, node_state, surface_term, vertex_edge)
        vertex_position[v, 0] = x
        vertex_position[v, 1] = y
        vertex_position[v, 2] = z


@cuda_kernel
def facet_samples(vertex_position, facets, sample_position, sample_area, facet_normal):
    """One sample to a facet: its centroid [m], area [m^(dim-1)] and normal."""
    f = cuda.grid(1)
    if f < facet_normal.shape[0]:
        x, y, z, area, nx, ny, nz = node.facet_sample(f, vertex_position, facets)
        sample_position[f, 0] = x
        sample_position[f, 1] = y
        sample_position[f, 2] = z
        sample_area[f] = area
        facet_normal[f, 0] = nx
        facet_normal[f, 1] = ny
        facet_normal[f, 2] = nz


@cuda_kernel
def candidates(vertex_position, facets, area_before, dice, candidate_facet, candidate_position):
    """Candidates for samples, evenly over the area [m]."""
    k = cuda.grid(1)
    if k < candidate_position.shape[0]:
        one = vertex_position.dtype.type(1)
        f, x, y, z = node.candidate(k, vertex_position, facets, area_before, dice, one)
        candidate_facet[k] = f
        candidate_position[k, 0] = x
        candidate_position[k, 1] = y
        candidate_position[k, 2] = z


@cuda_kernel
def throw_darts(candidate_position, candidate_cells, blocks, dice, surface_term, unknown, accepted):
    """One round: candidates are taken or not where those drawn before them are known; the others are counted."""
    k = cuda.grid(1)
    if k < accepted.shape[0] and accepted[k] == 2:
        verdict = node.dart(k, candidate_position, candidate_cells, blocks, dice, surface_term, accepted)
        accepted[k] = verdict
        if verdict == 2:
            unknown[0] = 1


def poisson_disk(candidate_position, candidate_cells, blocks, dice, surface_term, accepted):
    """Rounds until every candidate is known."""
    unknown = device.empty(1, np.int32)
    device.fill(accepted, 2)
    while True:
        device.fill(unknown, 0)
        throw_darts(candidate_position, candidate_cells, blocks, dice, surface_term, unknown, accepted)
        if not device.largest(unknown):
            return


@cuda_kernel(rows_of="nearest")
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
    s = cuda.grid(1)
    if s < nearest.shape[0]:
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
    device.fill(sample_count, 0)
    count_samples(nearest, sample_count)


@cuda_kernel(rows_of="nearest")
def count_samples(nearest, sample_count):
    """One more for the nearest particle of each sample; sums of integers do not depend on their order."""
    s = cuda.grid(1)
    if s < nearest.shape[0] and nearest[s] >= 0:
        cuda.atomic.add(sample_count, nearest[s], 1)


@cuda_kernel
def splines_of_points(fit_position, fit_cells, blocks, surface_term, fit_splines):
    """Splines of each point of the fit, axis by axis."""
    r = cuda.grid(1)
    if r < fit_splines.shape[0]:
        node.point_splines(r, fit_position, fit_cells, blocks, surface_term, fit_splines)


@cuda_kernel
def weights_of_nodes(fit_splines, fit_cells, blocks, surface_term, node_weight):
    """(3.7): the diagonal of Lambda."""
    i = cuda.grid(1)
    if i < node_weight.shape[0]:
        node_weight[i] = node.normalizing_weight(i, fit_splines, fit_cells, blocks, surface_term)


def fit_weights(fit_position, fit_cells, blocks, surface_term, fit_splines, node_weight):
    """Splines of the points, and (3.7)."""
    splines_of_points(fit_position, fit_cells, blocks, surface_term, fit_splines)
    weights_of_nodes(fit_splines, fit_cells, blocks, surface_term, node_weight)


@cuda_kernel
def fit_residuals(fit_splines, fit_cells, blocks, surface_term, coefficients, residual):
    """b - B C, in units of h."""
    r = cuda.grid(1)
    if r < residual.shape[0]:
        residual[r] = node.fit_residual(r, fit_splines, fit_cells, blocks, surface_term, coefficients)


@cuda_kernel(rows_of="active")
def fit_correct(fit_splines, fit_cells, blocks, surface_term, node_weight, active, residual, coefficients):
    """C <- C + w Lambda B^T (b - B C) on the active nodes."""
    a = cuda.grid(1)
    if a < active.shape[0]:
        i = active[a]
        change = node.fit_correction(i, fit_splines, fit_cells, blocks, surface_term, residual)
        coefficients[i] += surface_term.relaxation * node_weight[i] * change


def fit(fit_splines, fit_cells, blocks, surface_term, node_weight, active, residual, coefficients):
    """(3.6), Algorithm 2: `iterations` sweeps from C = 0, in units of h."""
    device.fill(coefficients, 0)
    device.fill(residual, 0)
    for _ in range(surface_term.iterations):
        fit_residuals(fit_splines, fit_cells, blocks, surface_term, coefficients, residual)
        fit_correct(fit_splines, fit_cells, blocks, surface_term, node_weight, active, residual, coefficients)


@cuda_kernel
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
    q = cuda.grid(1)
    if q < sample_normal.shape[0]:
        value, gx, gy, gz = node.mls_gradient(q, query_position, spline_cells, blocks, surface_term, coefficients)
        node.store_normal(q, value, gx, gy, gz, outward, surface_value, surface_gradient, sample_normal)


@cuda_kernel
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
    q = cuda.grid(1)
    if q < sample_normal.shape[0]:
        value, gx, gy, gz = node.spline_gradient(q, query_position, spline_cells, blocks, surface_term, coefficients)
        node.store_normal(q, value, gx, gy, gz, outward, surface_value, surface_gradient, sample_normal)


@cuda_kernel
def inset(vertex_position, vertex_normal, surface_term, inset_position):
    """Vertices moved back to the liquid's surface [m]."""
    v = cuda.grid(1)
    if v < inset_position.shape[0]:
        way = surface_term.inset * surface_term.cell_size
        for c in range(3):
            inset_position[v, c] = vertex_position[v, c] - way * vertex_normal[v, c]


@cuda_kernel
def surface_force(sample_position, sample_area, sample_normal, spline_cells, blocks, surface_term, node_force):
    """(4.18*): force on the nodes [N]."""
    i = cuda.grid(1)
    if i < node_force.shape[0]:
        fx, fy, fz = node.node_tension(
            i, sample_position, sample_area, sample_normal, spline_cells, blocks, surface_term
        )
        node_force[i, 0] = fx
        node_force[i, 1] = fy
        node_force[i, 2] = fz


@cuda_kernel
def begin_labels(node_state, node_label):
    """Each inside node is its own component."""
    i = cuda.grid(1)
    if i < node_label.shape[0]:
        node_label[i] = i if node_state[i] == 1 else -1


@formula
def lowest(node_label, i):
    """The node at the end of i's chain of labels."""
    label = node_label[i]
    while label != i:
        i, label = label, node_label[label]
    return i


@cuda_kernel
def join_labels(blocks, node_label):
    """Of two components that touch, the one with the higher number joins the lower one.

    A label only ever falls, and a chain that another thread has just lengthened still leads into the same component: a
    join that comes too late is seen by its comparison and tried again farther down.
    """
    i = cuda.grid(1)
    if i < node_label.shape[0] and node_label[i] >= 0:
        for axis in range(3 if blocks.neighbour.shape[1] == 27 else 2):
            other = step_node(blocks, i, 1 if axis == 0 else 0, 1 if axis == 1 else 0, 1 if axis == 2 else 0)
            if other >= 0 and node_label[other] >= 0:
                own, met = lowest(node_label, i), lowest(node_label, other)
                while own != met:
                    high, low = max(own, met), min(own, met)
                    found = cuda.atomic.cas(node_label, high, high, low)
                    if found == high:
                        break
                    own, met = lowest(node_label, found), lowest(node_label, low)


@cuda_kernel
def shorten_labels(node_label):
    """Each node takes the label of the node that it is labelled with, down to the last."""
    i = cuda.grid(1)
    if i < node_label.shape[0]:
        label = node_label[i]
        if label >= 0:
            while node_label[label] != label:
                label = node_label[label]
            node_label[i] = label


def components(blocks, node_state, node_label):
    """The lowest node of each inside node's component."""
    begin_labels(node_state, node_label)
    join_labels(blocks, node_label)
    shorten_labels(node_label)


@cuda_kernel(rows_of="cell")
def count_members(cell, node_label, held):
    """Particles of each component, at its lowest node."""
    p = cuda.grid(1)
    if p < cell.shape[0] and cell[p] >= 0 and node_label[cell[p]] >= 0:
        cuda.atomic.add(held, node_label[cell[p]], 1)


@cuda_kernel
def look_up_members(cell, node_label, held, component_size):
    """Particles in the component of each particle."""
    p = cuda.grid(1)
    if p < component_size.shape[0]:
        component_size[p] = held[node_label[cell[p]]] if cell[p] >= 0 and node_label[cell[p]] >= 0 else 0


def component_sizes(cells, node_label, component_size):
    """Particles in the component of each particle."""
    held = device.empty(node_label.shape[0], np.int32)
    device.fill(held, 0)
    count_members(cells.cell, node_label, held)
    look_up_members(cells.cell, node_label, held, component_size)


@cuda_kernel
def extents(interior_position, cells, blocks, surface_term, extent):
    """Along how many axes the particles around each particle spread."""
    p = cuda.grid(1)
    if p < extent.shape[0]:
        extent[p] = node.extent(p, interior_position, cells, blocks, surface_term)
