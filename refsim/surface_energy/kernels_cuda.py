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
from refsim.surface_energy.recorded import level_set_cuda, pulls_cuda, samples_cuda, stages
from refsim.surface_energy.recorded.cells_cuda import COUNTS, MADE, VERTICES

SPARE = 3  # vertices and facets for which there is capacity beyond those that exist


def arrays(blocks, real, term=None, particles=0, vertices=0, facets=0):
    """Arrays of a reconstruction on the device; `counts` says how many vertices and facets there are."""
    dim = 3 if blocks.neighbour.shape[1] == 27 else 2
    a = stages.work_arrays(
        device.empty, dim, np.dtype(real), nodes(blocks), particles, vertices + SPARE, facets + SPARE
    )
    made = np.zeros(COUNTS, np.int32)
    made[VERTICES], made[MADE] = vertices, facets
    a["counts"] = a["sent"] = device.as_numba(device.cupy_or_numpy().asarray(made))
    for name in ("held_points", "held_samples", "members", "node_label", "first", "vertex_edge", "facets", "cut_sum"):
        device.fill(a[name], 0)
    for name in ("vertex_centre", "nearest"):  # where a search begins
        device.fill(a[name], -1)
    return a | {"blocks": blocks, "surface_term": term, "least": np.int32(0)}


def sorted_particles(position, blocks, term, vertices=0, facets=0):
    """`arrays` with the particles at `position` (n, 3) [m] sorted by cell; their numbers are those of their rows."""
    a = arrays(blocks, position.dtype, term, position.shape[0], vertices, facets) | {"position": position}
    sure = device.empty(blocks.keys.shape[0], np.uint8)
    device.fill(sure, 1)
    device.fill(a["cell"], -1)
    stages.sort_particles(a | {"sure": sure, "counts": device.empty(COUNTS, np.int32)})
    return a | {"number": device.as_numba(device.cupy_or_numpy().arange(position.shape[0], dtype=np.int32))}


def node_states(interior_position, cells, blocks, surface_term, node_state):
    """Algorithm 1, lines 5 to 9."""
    a = sorted_particles(interior_position, blocks, surface_term) | {"node_state": node_state}
    stages.launch(a, level_set_cuda.states_of_blocks)


def components(blocks, node_state, node_label):
    """The lowest node of each inside node's component: within blocks, then across them."""
    a = arrays(blocks, np.float32) | {"node_state": node_state, "node_label": node_label}
    stages.launch(a | {"placed": None}, level_set_cuda.states_of_blocks)
    stages.join_components(a)


def component_sizes(cells, node_label, blocks, component_size):
    """Particles in the component of each particle."""
    a = arrays(blocks, np.float32)
    label = device.empty(node_label.shape, np.int32)
    device.copy(node_label, label)
    stages.join_components(a | {"first": cells.first, "node_label": label})
    look_up_members(cells.cell, label, a["members"], component_size)


def classify(blocks, node_state, table, crossings, cell_case):
    """Cut edges and corner states, with the numbers of vertices and facets."""
    own = {"node_state": node_state, "table": table, "crossings": crossings, "cell_case": cell_case}
    stages.count_cuts(arrays(blocks, np.float32) | own)


def facets(blocks, node_state, table, vertex_edge, facets):
    """Vertices by their edges, facets by their vertices; numbered by block, then within each block."""
    own = {"node_state": node_state, "table": table, "vertex_edge": vertex_edge, "facets": facets}
    a = arrays(blocks, np.float32, vertices=vertex_edge.shape[0]) | own
    stages.count_cuts(a)
    stages.launch(a | {"spheres": None}, samples_cuda.place_vertices)


def exit_points(interior_position, cells, blocks, node_state, surface_term, vertex_edge, vertex_position):
    """Algorithm 1, lines 10 to 17."""
    own = {"node_state": node_state, "vertex_edge": vertex_edge, "vertex_position": vertex_position}
    a = sorted_particles(interior_position, blocks, surface_term, vertices=vertex_edge.shape[0])
    stages.launch(a | own | {"cut_cells": None}, samples_cuda.place_vertices)


def facet_samples(vertex_position, facets, blocks, surface_term, sample_position, sample_area, facet_normal):
    """Samples without an inset; a particle stands on each vertex, so that every sample has one."""
    a = sorted_particles(vertex_position, blocks, surface_term, vertex_position.shape[0], facets.shape[0])
    a |= {"vertex_position": vertex_position, "facets": facets, "facet_normal": facet_normal}
    stages.launch(a, samples_cuda.place_points)
    a |= {"inset_position": vertex_position, "sample_position": sample_position, "sample_area": sample_area}
    stages.launch(a, samples_cuda.place_samples)


def offsets(
    interior_position, interior_number, cells, blocks, surface_term, sample_position, sample_cells, nearest,
    offset_direction, fit_position,
):  # fmt: skip
    """Section 4.3.1, at facets without extent: directions and points of the fit, then the nearest particles.

    Without points of the fit the directions are those at vertices.
    """
    count = sample_position.shape[0]
    a = sorted_particles(interior_position, blocks, surface_term, count, count) | {"number": interior_number}
    xp, dim = device.cupy_or_numpy(), a["facets"].shape[1]
    corner = xp.repeat(xp.arange(count, dtype=np.int32)[:, None], dim, axis=1)
    a |= dict.fromkeys(("vertex_position", "inset_position"), sample_position) | {"facets": device.as_numba(corner)}
    a |= dict.fromkeys(("outward", "vertex_outward"), offset_direction) | {"nearest": nearest}
    if fit_position is None:
        stages.launch(a, samples_cuda.turn_vertices)
    else:
        stages.launch(a | {"fit_position": fit_position}, samples_cuda.place_points)
    stages.launch(a, samples_cuda.place_samples)


def _sorted_points(fit_position, fit_cells, blocks, term):
    a = arrays(blocks, fit_position.dtype, term, facets=fit_position.shape[0] // 2)
    a |= {"fit_position": fit_position, "fit_cell": fit_cells.cell}
    count_points(fit_cells.cell, a["held_points"], a["fit_place"])
    stages.sort_points(a)
    return a


def fit_weights(fit_position, fit_cells, blocks, surface_term, fit_splines, node_weight):
    """(3.7), and the splines, which the stage keeps cell by cell; 0 for points outside all blocks."""
    a = _sorted_points(fit_position, fit_cells, blocks, surface_term)
    stages.sweep(a | {"node_weight": node_weight})
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
    a = _sorted_points(fit_position, fit_cells, blocks, surface_term)
    xp, order = device.cupy_or_numpy(), device.cupy_or_numpy().argsort(_rows(a, fit_cells.cell))
    ordered = device.as_numba(xp.ascontiguousarray(device.as_cupy(fit_splines)[order].T))
    stages.sweep(a | {"fit_splines": ordered, "coefficients": coefficients})


def mls_normals(
    query_position, blocks, surface_term, coefficients, outward, surface_value, surface_gradient, sample_normal
):
    """(3.17) at samples; value and gradient stay in registers, so that there are no such outputs."""
    a = normal_arrays(query_position, blocks, surface_term, coefficients, outward, sample_normal)
    stages.launch(a | {"mls": np.int32(1)}, samples_cuda.find_normals)


def spline_normals(
    query_position, blocks, surface_term, coefficients, outward, surface_value, surface_gradient, sample_normal
):
    """(3.9) at samples; value and gradient stay in registers, so that there are no such outputs."""
    a = normal_arrays(query_position, blocks, surface_term, coefficients, outward, sample_normal)
    stages.launch(a | {"mls": None}, samples_cuda.find_normals)


def normal_arrays(position, blocks, term, coefficients, outward, normal):
    """Arrays of a reconstruction whose samples stand at `position` (s, 3) [m], for their normals alone."""
    a = arrays(blocks, position.dtype, term, facets=position.shape[0])
    return a | {"sample_place": position, "outward": outward, "coefficients": coefficients, "sample_normal": normal}


def surface_force(sample_position, sample_area, sample_normal, spline_cells, blocks, surface_term, scratch, node_force):
    """(4.18*): first over the samples of each cell, then over the cells that reach a node."""
    pulls = scratch.array("pulls", (pulls_cuda.SUMS, sample_area.shape[0] + 1), sample_area.dtype)
    pulls_cuda.sum_pulls(sample_position, sample_normal, sample_area, spline_cells, blocks, surface_term, pulls)
    pulls_cuda.pull_nodes(spline_cells, blocks, pulls, surface_term, node_force)


def recorded_force(sample_position, sample_area, sample_normal, spline_cells, blocks, surface_term, node_force):
    """As `surface_force`, where the samples of each cell are counted and not yet sorted."""
    a = arrays(blocks, sample_position.dtype, surface_term, facets=sample_position.shape[0])
    a |= {"sample_position": sample_position, "sample_area": sample_area, "sample_normal": sample_normal}
    count_points(spline_cells.cell, a["held_samples"], a["fit_place"])
    stages.pull(a | {"fit_cell": spline_cells.cell, "node_force": node_force})
