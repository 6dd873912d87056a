"""The programs of a CUDA device: stages of the reconstruction, each of the operation whose outputs it computes.

Each program allocates what its stage needs, launches the stage's kernels and writes the operation's outputs. Particles
are sorted by the graph's own counting, so that the `cells` of the arguments are not used. No operation has areas that
are 0 on small components among its outputs, nor how many cells and points there are; these are judged in the whole
reconstruction (`tests/ladder/test_cuda_simulator.py`).
"""

import numpy as np

from refsim.backends import device
from refsim.sparse_grid import nodes
from refsim.sparse_grid.block_search_cuda import count_points
from refsim.surface_energy.kernels import look_up_members
from refsim.surface_energy.recorded import stages
from refsim.surface_energy.recorded.cells_cuda import COUNTS, MADE, VERTICES

SPARE = 3  # vertices and facets for which there is capacity beyond those that exist


def arrays(blocks, real, particles=0, vertices=0, facets=0):
    """Arrays of a reconstruction on the device; `counts` says how many vertices and facets there are."""
    dim = 3 if blocks.neighbour.shape[1] == 27 else 2
    a = stages.work_arrays(
        device.empty, dim, np.dtype(real), nodes(blocks), particles, vertices + SPARE, facets + SPARE
    )
    made = np.zeros(COUNTS, np.int32)
    made[VERTICES], made[MADE] = vertices, facets
    a["counts"] = device.as_numba(device.cupy_or_numpy().asarray(made))
    for name in ("held_points", "held_samples", "members", "node_label", "first", "vertex_edge", "facets", "cut_sum"):
        device.fill(a[name], 0)
    for name in ("vertex_centre", "nearest"):  # where a search begins
        device.fill(a[name], -1)
    return a


def sorted_particles(position, blocks, term, vertices=0, facets=0):
    """`arrays` with the particles at `position` (n, 3) [m] sorted by cell; their numbers are those of their rows."""
    a = arrays(blocks, position.dtype, position.shape[0], vertices, facets)
    sure = device.empty(blocks.keys.shape[0], np.uint8)
    device.fill(sure, 1)
    device.fill(a["cell"], -1)
    counts = a["counts"]
    a["counts"] = device.empty(COUNTS, np.int32)
    stages.sort_particles(a, position, blocks, term, sure)
    number = device.as_numba(device.cupy_or_numpy().arange(position.shape[0], dtype=np.int32))
    return a | {"counts": counts, "number": number}


def node_states(interior_position, cells, blocks, surface_term, node_state):
    """Algorithm 1, lines 5 to 9."""
    a = sorted_particles(interior_position, blocks, surface_term) | {"node_state": node_state}
    stages.mark_nodes(a, blocks, surface_term)


def components(blocks, node_state, node_label):
    """The lowest node of each inside node's component: within blocks, then across them."""
    a = arrays(blocks, np.float32) | {"node_state": node_state, "node_label": node_label}
    stages.mark_nodes(a, blocks, None, given=True)
    stages.join_components(a, blocks)


def component_sizes(cells, node_label, blocks, component_size):
    """Particles in the component of each particle."""
    a = arrays(blocks, np.float32)
    label = device.empty(node_label.shape, np.int32)
    device.copy(node_label, label)
    stages.join_components(a | {"first": cells.first, "node_label": label}, blocks)
    look_up_members(cells.cell, label, a["members"], component_size)


def classify(blocks, node_state, table, crossings, cell_case):
    """Cut edges and corner states, with the numbers of vertices and facets."""
    a = arrays(blocks, np.float32)
    a |= {"node_state": node_state, "crossings": crossings, "cell_case": cell_case}
    stages.count_cuts(a, blocks, table, a["counts"])


def facets(blocks, node_state, table, vertex_edge, facets):
    """Vertices by their edges, facets by their vertices; numbered by block, then within each block."""
    a = arrays(blocks, np.float32) | {"node_state": node_state, "vertex_edge": vertex_edge, "facets": facets}
    stages.count_cuts(a, blocks, table, a["counts"])
    stages.write_cuts(a, blocks, table)


def exit_points(interior_position, cells, blocks, node_state, surface_term, vertex_edge, vertex_position):
    """Algorithm 1, lines 10 to 17."""
    a = sorted_particles(interior_position, blocks, surface_term, vertices=vertex_edge.shape[0])
    a |= {"node_state": node_state, "vertex_edge": vertex_edge, "vertex_position": vertex_position}
    stages.place_vertices(a, interior_position, a["number"], blocks, surface_term)


def facet_samples(vertex_position, facets, blocks, surface_term, sample_position, sample_area, facet_normal):
    """Samples without an inset; a particle stands on each vertex, so that every sample has one."""
    a = sorted_particles(vertex_position, blocks, surface_term, vertex_position.shape[0], facets.shape[0])
    a |= {"vertex_position": vertex_position, "facets": facets, "facet_normal": facet_normal}
    stages.place_points(a, vertex_position, a["number"], blocks, surface_term)
    a |= {"inset_position": vertex_position, "sample_position": sample_position, "sample_area": sample_area}
    stages.place_samples(a, vertex_position, a["number"], blocks, surface_term, np.int32(0), a["counts"])


def _points_as_facets(a, position):
    """Facets without extent, whose samples stand at `position` (s, 3) [m]."""
    xp, dim = device.cupy_or_numpy(), a["facets"].shape[1]
    corner = xp.repeat(xp.arange(position.shape[0], dtype=np.int32)[:, None], dim, axis=1)
    a |= {"vertex_position": position, "inset_position": position, "facets": device.as_numba(corner)}


def offsets(
    interior_position, interior_number, cells, blocks, surface_term, sample_position, sample_cells, nearest,
    offset_direction, fit_position,
):  # fmt: skip
    """Section 4.3.1, at facets without extent: directions and points of the fit, then the nearest particles.

    Without points of the fit the directions are those at vertices.
    """
    count = sample_position.shape[0]
    a = sorted_particles(interior_position, blocks, surface_term, count, count)
    _points_as_facets(a, sample_position)
    a |= {"outward": offset_direction, "vertex_outward": offset_direction, "nearest": nearest}
    if fit_position is None:
        stages.turn_vertices(a, interior_position, interior_number, blocks, surface_term)
    else:
        a["fit_position"] = fit_position
        stages.place_points(a, interior_position, interior_number, blocks, surface_term)
    stages.place_samples(a, interior_position, interior_number, blocks, surface_term, np.int32(0), a["counts"])


def _sorted_points(fit_position, fit_cells, blocks, term):
    a = arrays(blocks, fit_position.dtype, facets=fit_position.shape[0] // 2)
    a |= {"fit_position": fit_position, "fit_cell": fit_cells.cell}
    count_points(fit_cells.cell, a["held_points"], a["fit_place"])
    stages.sort_points(a, blocks, term)
    return a


def fit_weights(fit_position, fit_cells, blocks, surface_term, fit_splines, node_weight):
    """(3.7), and the splines, which the stage keeps cell by cell; 0 for points outside all blocks."""
    a = _sorted_points(fit_position, fit_cells, blocks, surface_term) | {"node_weight": node_weight}
    stages.sweep(a, blocks, surface_term)
    xp, kept = device.cupy_or_numpy(), device.as_cupy(a["fit_splines"]).T
    kept = xp.concatenate([kept, xp.zeros((1, kept.shape[1]), kept.dtype)])
    device.gather(device.as_numba(kept), device.as_numba(_rows(a, fit_cells.cell)), fit_splines)


def _rows(a, cells):
    """Row of each point in the arrays by cell; behind all of them for points without a cell."""
    xp, cell, first = device.cupy_or_numpy(), device.as_cupy(cells), device.as_cupy(a["fit_first"])
    order = xp.argsort(cell, kind="stable")
    ordered = cell[order]
    rank = xp.arange(len(cell)) - xp.searchsorted(ordered, ordered)
    rows = xp.empty(len(cell), np.int64)
    rows[order] = xp.where(ordered < 0, len(a["fit_target"]), first[xp.maximum(ordered, 0)] + rank)
    return rows


def fit(fit_position, fit_splines, fit_cells, blocks, surface_term, residual, coefficients):
    """(3.6), Algorithm 2, from the given splines; residuals stay in registers, so that there is no such output."""
    a = _sorted_points(fit_position, fit_cells, blocks, surface_term) | {"coefficients": coefficients}
    xp, order = device.cupy_or_numpy(), device.cupy_or_numpy().argsort(_rows(a, fit_cells.cell))
    a["fit_splines"] = device.as_numba(xp.ascontiguousarray(device.as_cupy(fit_splines)[order].T))
    stages.sweep(a, blocks, surface_term)


def mls_normals(
    query_position, blocks, surface_term, coefficients, outward, surface_value, surface_gradient, sample_normal
):
    """(3.17) at samples; value and gradient stay in registers, so that there are no such outputs."""
    _normals(query_position, blocks, surface_term, coefficients, outward, sample_normal, np.int32(1))


def spline_normals(
    query_position, blocks, surface_term, coefficients, outward, surface_value, surface_gradient, sample_normal
):
    """(3.9) at samples; value and gradient stay in registers, so that there are no such outputs."""
    _normals(query_position, blocks, surface_term, coefficients, outward, sample_normal, None)


def _normals(position, blocks, term, coefficients, outward, normal, mls):
    stages.find_normals(normal_arrays(position, blocks, coefficients, outward, normal), blocks, term, mls)


def normal_arrays(position, blocks, coefficients, outward, normal):
    """Arrays of a reconstruction whose samples stand at `position` (s, 3) [m], for their normals alone."""
    a = arrays(blocks, position.dtype, facets=position.shape[0])
    return a | {"sample_place": position, "outward": outward, "coefficients": coefficients, "sample_normal": normal}


def surface_force(sample_position, sample_area, sample_normal, blocks, surface_term, node_force):
    """(4.18*): first over the samples of each cell, then over the cells that reach a node."""
    a = arrays(blocks, sample_position.dtype, facets=sample_position.shape[0])
    a |= {"sample_position": sample_position, "sample_area": sample_area, "sample_normal": sample_normal}
    stages.locate_samples(a, blocks, surface_term)
    stages.pull(a | {"node_force": node_force}, blocks, surface_term)
