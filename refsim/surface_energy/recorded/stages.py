"""The stages of a recorded reconstruction: which kernels are launched on which arrays, in the order of the graph.

A stage takes the arrays of `work_arrays` by name, with `position` and `number` of the particles, `blocks`,
`surface_term` and what else its kernels name. It launches kernels only and does not wait for the device.
`refsim.surface_energy.recorded` records the stages; `kernels_cuda` runs them one at a time.
"""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from refsim.backends import device
from refsim.sparse_grid import PointList
from refsim.surface_energy.recorded import cells_cuda, fit_cuda, force_cuda, level_set_cuda, samples_cuda

Arrays = Mapping[str, Any]
GROUPS: dict[str, Any] = {  # arguments of kernels that are made of several arrays: a named tuple, or their names
    "cells": PointList, "spheres": samples_cuda.Spheres, "vertices": samples_cuda.Vertices,
    "samples": samples_cuda.Samples, "points": samples_cuda.FitPoints, "components": samples_cuda.Components,
    "active": fit_cuda.Active, "bins": ("first", "held"), "of_cells": ("held_samples", "fit_place", "fit_cell"),
    "told": ("counts", "sent"), "cuts": ("crossings", "cell_case"), "firsts": ("edge_first", "facet_first"),
    "cut_cells": ("crossings", "cell_case", "edge_first", "facet_first", "table"),
}  # fmt: skip


def work_arrays(
    empty: Callable[[Any, Any], Any], dim: int, real: np.dtype, nodes: int, particles: int, vertices: int, facets: int
) -> dict[str, Any]:
    """All arrays of a reconstruction, for `particles` particles on `nodes` nodes, with capacities for the others."""
    n, count, v, f, b = particles, nodes, vertices, facets, nodes // 64
    shapes = {
        "held": count, "first": count + 1, "cell": n, "place": n, "point": n, "placed": ((n, 4), real),
        "node_state": (count, np.uint8), "node_label": count, "members": count, "crossings": (count, np.uint8),
        "cell_case": (count, np.uint8), "cut_total": (b, np.int64), "edge_first": count, "facet_first": count,
        "vertex_edge": v, "facets": ((f, dim), np.int32), "vertex_position": ((v, 3), real),
        "vertex_outward": ((v, 3), real), "vertex_centre": v, "sample_place": ((f, 3), real),
        "facet_normal": ((f, 3), real), "outward": ((f, 3), real), "fit_position": ((2 * f, 3), real),
        "fit_cell": 2 * f, "fit_place": 2 * f, "held_points": count, "fit_first": count, "unsorted": 2 * f,
        "fit_splines": ((9, 2 * f), real), "fit_target": (2 * f, real), "node_weight": (count, real),
        "coefficients": (count, real), "rank": count, "filled": 2 * f, "held_in_block": b, "active_block": b,
        "active_columns": ((b, fit_cuda.REACHING), np.int32),
        "reached": ((27, 2 * f + 1), real), "change": ((27, 2 * f + 1), real), "pulls": ((81, f + 1), real),
        "rows": (force_cuda.ROWS * f, np.uint8), "sample_normal": ((f, 3), real), "vertex_normal": ((v, 3), real),
        "inset_position": ((v, 3), real), "sample_position": ((f, 3), real), "sample_area": (f, real), "nearest": f,
        "either": (f + v, np.uint8), "searching": (samples_cuda.EXIT_LANES * v + count, np.uint8), "total": b,
        "cut_sum": (b // 64 + 1, np.int64),
        "totals": device.tiles(count), "counts": cells_cuda.COUNTS,
        "held_samples": count, "samples_first": count, "sample_point": f, "node_force": ((count, 3), real),
    }  # fmt: skip
    kinds = {name: shape if isinstance(shape, tuple) else (shape, np.int32) for name, shape in shapes.items()}
    arrays = {name: empty(shape, dtype) for name, (shape, dtype) in kinds.items()}
    for name in ("reached", "change", "pulls"):
        device.fill(arrays[name], 0)  # the last column stays so, for cells without points
    return arrays


def named(a: Arrays, name: str) -> Any:
    """The array of this name, or the group of arrays."""
    if name in a:
        return a[name]
    kind = GROUPS[name]
    members = (named(a, member) for member in getattr(kind, "_fields", kind))
    return tuple(members) if isinstance(kind, tuple) else kind(*members)


def launch(a: Arrays, *kernels: Any) -> None:
    """Launch kernels, each on the arrays that its arguments name."""
    for kernel in kernels:
        kernel(*(named(a, name) for name in inspect.signature(kernel).parameters))


def sort_particles(a: Arrays) -> None:
    """Particles by cell, by counting; counters are set to 0."""
    launch(a, cells_cuda.clear, cells_cuda.count_particles)
    device.RunningSum(a["held"], a["first"][1:], a["totals"])()
    launch(a, cells_cuda.place_particles)


def count_cuts(a: Arrays) -> None:
    """Cut edges and cell cases, and the numbers of vertices and facets, `sent` to the host."""
    launch(a, level_set_cuda.classify_blocks, level_set_cuda.first_cuts)


def join_components(a: Arrays) -> None:
    """Components joined across blocks, and their particles counted."""
    launch(a, level_set_cuda.join_nodes, level_set_cuda.add_members)


def points_of_fit(a: Arrays) -> Arrays:
    """The arrays with those of the fit's points by cell, two to a sample."""
    own = {"held": a["held_points"], "first": a["fit_first"], "into": np.int32(cells_cuda.FILLED), "each": 2}
    return {**a, **own}


def sort_points(a: Arrays) -> None:
    """Splines and values of the fit's points, cell by cell."""
    launch(points_of_fit(a), fit_cuda.number_points, fit_cuda.fill_points, fit_cuda.sort_points)


def sweep(a: Arrays) -> None:
    """(3.7), and Algorithm 2 from C = 0."""
    a = points_of_fit(a)
    launch({**a, "coefficients": None}, fit_cuda.sum_fit)
    launch(a, fit_cuda.begin_fit)
    for _ in range(int(a["surface_term"].iterations) - 1):
        launch({**a, "reached": None}, fit_cuda.sum_fit, fit_cuda.correct)


def pull(a: Arrays) -> None:
    """The force of the samples on the nodes [N]."""
    own = {"held": a["held_samples"], "first": a["samples_first"], "into": np.int32(cells_cuda.SAMPLED), "each": 1}
    a = {**a, **own, "point": a["sample_point"]}
    launch(a, fit_cuda.number_points, fit_cuda.fill_points, force_cuda.sort_samples)
    launch(a, force_cuda.sum_pulls, force_cuda.pull_nodes)
