"""The stages of a recorded reconstruction: which kernels are launched on which arrays, in the order of the graph.

Each takes the arrays of `work_arrays` by name, the blocks and the parameters, launches kernels only, and does not
wait for the device. `refsim.surface_energy.recorded` records them; `programs` runs them one at a time.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from refsim.backends import device
from refsim.sparse_grid import PointList
from refsim.surface_energy.recorded import cells_cuda, fit_cuda, force_cuda, level_set_cuda, samples_cuda
from refsim.surface_energy.recorded.samples_cuda import Components, FitPoints, Samples, Spheres, Vertices

Arrays = Mapping[str, Any]


def work_arrays(
    empty: Callable[[Any, Any], Any], dim: int, real: np.dtype, nodes: int, particles: int, vertices: int, facets: int
) -> dict[str, Any]:
    """All arrays of a reconstruction, for `particles` particles on `nodes` nodes, with capacities for the others."""
    n, count, v, f, b = particles, nodes, vertices, facets, nodes // 64
    shapes = {
        "held": count, "first": count + 1, "cell": n, "place": n, "unsorted": n, "placed": ((n, 4), real),
        "node_state": (count, np.uint8), "node_label": count, "members": count, "crossings": (count, np.uint8),
        "cell_case": (count, np.uint8), "cut_total": (b, np.int64), "edge_first": count, "facet_first": count,
        "vertex_edge": v, "facets": ((f, dim), np.int32), "vertex_position": ((v, 3), real),
        "vertex_outward": ((v, 3), real), "vertex_centre": v, "sample_place": ((f, 3), real),
        "facet_normal": ((f, 3), real), "outward": ((f, 3), real), "fit_position": ((2 * f, 3), real),
        "fit_cell": 2 * f, "fit_place": 2 * f, "held_points": count, "fit_first": count, "fit_unsorted": 2 * f,
        "fit_splines": ((9, 2 * f), real), "fit_target": (2 * f, real), "node_weight": (count, real),
        "coefficients": (count, real), "rank": count, "filled": 2 * f, "held_in_block": b, "active_block": b,
        "active_columns": ((b, fit_cuda.REACHING), np.int32),
        "reached": ((27, 2 * f + 1), real), "change": ((27, 2 * f + 1), real), "pulls": ((81, f + 1), real),
        "rows": (force_cuda.ROWS * f, np.uint8), "sample_normal": ((f, 3), real), "vertex_normal": ((v, 3), real),
        "inset_position": ((v, 3), real), "sample_position": ((f, 3), real), "sample_area": (f, real), "nearest": f,
        "either": (f + v, np.uint8), "total": b, "cut_sum": (b // 64 + 1, np.int64),
        "totals": device.tiles(count), "counts": cells_cuda.COUNTS,
        "held_samples": count, "samples_first": count, "sample_point": f, "node_force": ((count, 3), real),
    }  # fmt: skip
    kinds = {name: shape if isinstance(shape, tuple) else (shape, np.int32) for name, shape in shapes.items()}
    arrays = {name: empty(shape, dtype) for name, (shape, dtype) in kinds.items()}
    for name in ("reached", "change", "pulls"):
        device.fill(arrays[name], 0)  # the last column stays so, for cells without points
    return arrays


def listed(a: Arrays) -> PointList:
    """The particles of each cell; within a cell in any order."""
    return PointList(a["first"], a["unsorted"], a["cell"])


def named(kind: Any, a: Arrays) -> Any:
    """A named tuple of the work arrays of its members' names."""
    return kind(*(a[name] for name in kind._fields))


def sort_particles(a: Arrays, position: Any, blocks: Any, term: Any, sure: Any) -> None:
    """Particles by cell, by counting; counters are set to 0."""
    counts, first = a["counts"], a["first"]
    cells_cuda.clear(a["held"], a["held_points"], a["held_samples"], a["members"], first, a["cut_sum"], counts)
    cells_cuda.count_particles(position, term, blocks, sure, a["held"], a["place"], a["cell"], counts)
    device.RunningSum(a["held"], first[1:], a["totals"])()
    by_cell = a["unsorted"], a["placed"]
    cells_cuda.place_particles(position, term, blocks, first, a["place"], a["cell"], *by_cell)


def mark_nodes(a: Arrays, blocks: Any, term: Any, given: bool = False) -> None:
    """States of nodes, unless they are `given`, and labels of inside nodes within each block."""
    placed = None if given else a["placed"]
    level_set_cuda.states_of_blocks(
        placed, listed(a), blocks, term, a["node_state"], a["node_label"], a["counts"], a["total"]
    )


def count_cuts(a: Arrays, blocks: Any, table: Any, sent: Any) -> None:
    """Cut edges and cell cases, and the numbers of vertices and facets, `sent` to the host."""
    cuts, sums = (a["crossings"], a["cell_case"]), (a["cut_sum"], a["cut_total"])
    made = (a["edge_first"], a["facet_first"]), a["vertex_edge"], a["facets"]
    level_set_cuda.classify_blocks(blocks, a["node_state"], table, *cuts, *sums)
    level_set_cuda.first_cuts(cuts, table, *made, a["counts"], sent, *sums)


def write_cuts(a: Arrays, blocks: Any, table: Any) -> None:
    """Edges of vertices and corners of facets."""
    cuts = a["crossings"], a["cell_case"], a["edge_first"], a["facet_first"]
    level_set_cuda.write_facets(blocks, a["counts"], *cuts, table, a["vertex_edge"], a["facets"])


def join_components(a: Arrays, blocks: Any) -> None:
    """Components joined across blocks, and their particles counted."""
    level_set_cuda.join_nodes(blocks, a["node_label"])
    level_set_cuda.add_members(a["first"], a["node_label"], a["members"], a["cut_total"])


def place_vertices(a: Arrays, position: Any, number: Any, blocks: Any, term: Any) -> None:
    """Vertices on the union of spheres [m] and the particles of these."""
    spheres, vertices = Spheres(position, number, a["placed"], listed(a)), named(Vertices, a)
    samples_cuda.place_vertices(spheres, blocks, a["node_state"], term, a["vertex_edge"], a["counts"], vertices)


def place_points(a: Arrays, position: Any, number: Any, blocks: Any, term: Any) -> None:
    """Samples of facets, unit vectors away from particles nearest to them, points of the fit [m]."""
    spheres, vertices = Spheres(position, number, a["placed"], listed(a)), named(Vertices, a)
    surface = a["vertex_edge"], vertices, a["facets"], a["counts"], named(Samples, a), named(FitPoints, a)
    samples_cuda.place_points(spheres, blocks, term, *surface)


def turn_vertices(a: Arrays, position: Any, number: Any, blocks: Any, term: Any) -> None:
    """Unit vectors at vertices away from the particles nearest to them."""
    spheres, vertices = Spheres(position, number, a["placed"], listed(a)), named(Vertices, a)
    samples_cuda.turn_vertices(spheres, blocks, term, a["vertex_edge"], a["counts"], vertices)


def sort_points(a: Arrays, blocks: Any, term: Any) -> None:
    """Splines and values of the fit's points, cell by cell."""
    number_cells(a, a["held_points"], a["fit_first"], cells_cuda.FILLED)
    fit_cuda.fill_points(a["fit_cell"], a["fit_place"], a["fit_first"], 2, a["counts"], a["fit_unsorted"])
    fit_cuda.sort_points(
        a["fit_position"], a["fit_cell"], (a["fit_first"], a["held_points"]), a["fit_unsorted"], blocks, term,
        a["counts"], a["fit_splines"], a["fit_target"],
    )  # fmt: skip


def sweep(a: Arrays, blocks: Any, term: Any) -> None:
    """(3.7), and Algorithm 2 from C = 0."""
    weight, coefficients, rank, change = a["node_weight"], a["coefficients"], a["rank"], a["change"]
    points = (a["fit_first"], a["held_points"]), a["fit_splines"], a["fit_target"], blocks
    fit_cuda.sum_fit(*points, None, a["counts"], a["reached"], change, a["filled"])
    active = named(fit_cuda.Active, a), a["total"]
    fit_cuda.begin_fit(a["held_in_block"], rank, blocks, a["reached"], change, term, weight, coefficients, *active)
    for _ in range(int(term.iterations) - 1):
        fit_cuda.sum_fit(*points, coefficients, a["counts"], None, change, a["filled"])
        fit_cuda.correct(blocks, change, term, weight, coefficients, *active)


def find_normals(a: Arrays, blocks: Any, term: Any, mls: Any) -> None:
    """Normals at samples and vertices, by (3.17) or, where `mls` is None, by (3.9); vertices after the inset [m]."""
    surface = named(Samples, a), named(Vertices, a), a["vertex_edge"], a["facets"]
    samples_cuda.find_normals(*surface, blocks, term, a["coefficients"], mls, a["counts"], a["either"])


def place_samples(a: Arrays, position: Any, number: Any, blocks: Any, term: Any, least: Any, sent: Any) -> None:
    """Samples after the inset and their cells; areas are 0 on components of fewer than `least` particles."""
    spheres, components = Spheres(position, number, a["placed"], listed(a)), (a["node_label"], a["members"], least)
    surface = a["vertex_edge"], a["inset_position"], a["facets"], Components(*components), named(Samples, a)
    bins = a["held_samples"], a["fit_place"], a["fit_cell"]  # the fit needs its own no more
    samples_cuda.place_samples(spheres, blocks, term, *surface, bins, (a["counts"], sent))


def locate_samples(a: Arrays, blocks: Any, term: Any) -> None:
    """The cells of samples that `place_samples` has not placed."""
    surface, bins = (a["vertex_edge"], a["facets"]), (a["held_samples"], a["fit_place"], a["fit_cell"])
    device.fill(a["held_samples"], 0)
    force_cuda.locate_samples(a["sample_position"], *surface, blocks, term, a["counts"], *bins)


def pull(a: Arrays, blocks: Any, term: Any) -> None:
    """The force of the samples on the nodes [N]."""
    counts, held, first = a["counts"], a["held_samples"], a["samples_first"]
    number_cells(a, held, first, cells_cuda.SAMPLED)
    fit_cuda.fill_points(a["fit_cell"], a["fit_place"], first, 1, counts, a["fit_unsorted"])
    force_cuda.sort_samples(a["fit_cell"], (first, held), a["fit_unsorted"], counts, a["sample_point"])
    bins = (first, held), a["sample_point"], a["filled"], counts
    force_cuda.sum_pulls(named(Samples, a), *bins, blocks, term, a["pulls"], a["rows"])
    nodes = a["held_in_block"], a["rank"], blocks, a["pulls"], term, a["node_force"]
    force_cuda.pull_nodes(*nodes, counts, a["total"])


def number_cells(a: Arrays, held: Any, first: Any, into: int) -> None:
    """first <- the first point of each cell that holds so many; cells with points are numbered."""
    fit_cuda.number_points(held, first, a["rank"], a["filled"], a["counts"], np.int32(into), a["held_in_block"])
