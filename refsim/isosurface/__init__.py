"""Isosurfaces on a sparse grid: marching squares and marching cubes with faces that agree (Lorensen & Cline 1987).

The package has no effect.

A node inside has state 1, one outside 0, and one of unknown state 2: cells with such a corner have no facets, and the
surface ends there. Facets are triangles in space and segments in the plane; their normals point from inside to outside.
"""

from typing import Any, NamedTuple

import numpy as np

from refsim.backends.arrays import Backend, on_backend
from refsim.core.checked import plainly
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY
from refsim.isosurface import operations as operations  # of which `refsim.surface_energy` enters more programs
from refsim.isosurface.table import CaseTable, case_table
from refsim.sparse_grid import Blocks, SparseGrid, nodes
from refsim.sparse_grid.tables import OFFSET

__all__ = ["CaseTable", "Cells", "Contour", "Mesh", "case_table", "edges_and_facets", "extract"]


class Contour(NamedTuple):
    """Cell size and level as the kernels take them."""

    cell_size: float  # h [m]
    level: float  # value on the surface


class Mesh(NamedTuple):
    """A surface: arrays on the backend on which it was extracted."""

    vertices: Any  # (v, 3) [m]; z = 0 in the plane
    facets: Any  # (f, dim) int32: triangles counter-clockwise as seen from outside; segments with the inside left


class Cells(NamedTuple):
    """Vertices and facets by number, before the vertices have positions."""

    vertex_edge: Any  # (v,) int32, 3 node + axis of the edge on which each vertex stands
    facets: Any  # (f, dim) int32
    facet_first: Any  # (nodes + 1,) int32, first facet of each cell


def edges_and_facets(backend: Backend, blocks: Blocks, node_state: Any, dim: int, merged: bool = False) -> Cells:
    """Cut edges and facets of all cells, in the order of the nodes.

    node_state  (nodes,) uint8: 0 outside, 1 inside, 2 unknown
    merged      the classical table of 15 cases, which leaves holes
    """
    count = nodes(blocks)
    table, bits_set = case_tables(backend, dim, merged)
    crossings, cell_case = backend.empty(count, np.uint8), backend.empty(count, np.uint8)
    REGISTRY["isosurface.classify"].launch(backend.name, blocks, node_state, crossings, cell_case)
    _, to_xp, from_xp = backend.array_library()
    edge_first = backend.running_sum(from_xp(to_xp(bits_set)[to_xp(crossings)]))
    facet_first = backend.running_sum(from_xp(to_xp(table.count)[to_xp(cell_case)]))
    vertices, facets = (int(backend.host(first[count:])[0]) for first in (edge_first, facet_first))
    vertex_edge, facet = backend.empty(vertices, np.int32), backend.empty((facets, dim), np.int32)
    REGISTRY["isosurface.facets"].launch(
        backend.name, blocks, crossings, cell_case, edge_first, facet_first, table, vertex_edge, facet
    )
    return Cells(vertex_edge, facet, facet_first)


BITS_SET = np.array([0, 1, 1, 2, 1, 2, 2, 3], np.uint8)


_TABLES: dict[tuple[str, int, bool], tuple[CaseTable, Any]] = {}


def case_tables(backend: Backend, dim: int, merged: bool) -> tuple[CaseTable, Any]:
    """(table of cases, number of bits set in 0 to 7) on the backend, copied there once."""
    key = backend.name, dim, merged
    if key not in _TABLES:
        _TABLES[key] = on_backend(case_table(dim, merged), backend), backend.asarray(BITS_SET)
    return _TABLES[key]


@plainly
def extract(
    backend: Backend, coordinates: np.ndarray, values: np.ndarray, cell_size: float, dim: int,
    level: float = 0.0, merged: bool = False,
) -> Mesh:  # fmt: skip
    """The surface on which values given at some nodes of a grid equal `level`; values inside are below it.

    coordinates  (n, 3) integers j of the nodes x_j = h j with a value, in any order, each once; j_z = 0 in the plane
    values       (n,) values there, in the dtype of the mesh; NaN is unknown
    cell_size    h [m]
    merged       the classical table of 15 cases, which leaves holes

    The surface is closed wherever all cells that it crosses have values at all their corners. Raises InputError if
    shapes do not fit or coordinates repeat.
    """
    coordinates, values = np.asarray(coordinates), np.asarray(values)
    if coordinates.shape != (len(values), 3) or values.ndim != 1 or values.dtype.kind != "f":
        raise InputError(
            f"extract: coordinates of shape {coordinates.shape} and values of shape {values.shape} and type"
            f" {values.dtype} do not fit; give (n, 3) integers and (n,) floats."
        )
    if not (np.isfinite(cell_size) and cell_size > 0):
        raise InputError(f"extract: cell_size = {cell_size} is not possible; give a positive number.")
    place, grid = coordinates.astype(float), SparseGrid(Backend("cpu"), dim, "float64", 1.0)
    host = grid.cover(place, 1, 1)
    node = grid.cells_alone(place, host).cell
    if len(np.unique(node)) < len(node) or (np.abs(place) > OFFSET).any():
        raise InputError("extract: some coordinates are given twice, or lie beyond 2^20 cells; give each node once.")
    count = nodes(host)
    node_value, node_state = np.full(count, np.nan, values.dtype), np.full(count, 2, np.uint8)
    node_value[node] = values
    known = node[~np.isnan(values)]
    node_state[known] = node_value[known] < level
    blocks = host if backend.name != "cuda" else Blocks(*(backend.asarray(part) for part in host))
    cells = edges_and_facets(backend, blocks, backend.asarray(node_state), dim, merged)
    vertices = backend.empty((cells.vertex_edge.shape[0], 3), values.dtype)
    real = values.dtype.type
    REGISTRY["isosurface.edge_points"].program(backend.name)(
        blocks, backend.asarray(node_value), Contour(real(cell_size), real(level)), cells.vertex_edge, vertices
    )
    return Mesh(vertices, cells.facets)
