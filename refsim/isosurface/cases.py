"""Inputs and closed forms of isosurfaces: the signed distance from a union of spheres round a case's particles."""

import functools

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core.cases import CASES, VARIATIONS, Case, Exact, Variation, at, closed_form, cloud, groups, hard_input
from refsim.isosurface import BITS_SET, Contour, case_table, operations
from refsim.isosurface.table import CaseTable
from refsim.sparse_grid import SparseGrid, nodes
from refsim.sparse_grid.reference import node_table

REACH = (5, 6)  # nodes below and above each particle's cell that the blocks contain


def cell_size(case: Case) -> float:
    """h [m]: two spacings, 2^dim particles to a cell."""
    return 2 * case.spacing


@functools.cache
def covered(name: str, dtype: str):
    """(particle positions as rounded, blocks around them) of a case."""
    case = CASES[name]()
    position = case.position.astype(dtype)
    return position, SparseGrid(Backend("cpu"), case.dim, dtype, cell_size(case)).cover(position, *REACH)


@functools.cache
def extraction(name: str, dtype: str) -> dict:
    """All intermediate arrays of the extraction, by the references."""
    from scipy.spatial import cKDTree

    case = CASES[name]()
    position, blocks = covered(name, dtype)
    h = cell_size(case)
    place = np.dtype(dtype).type(h).astype(float) * node_table(blocks)
    nearest = cKDTree(position.astype(float)).query(place)[0] if case.count else np.zeros(0)
    value = (nearest - case.dim**0.5 * h).astype(dtype)
    state = (value < 0).astype(np.uint8)
    if name == "narrow_band":
        state[abs(value) > 0.9 * h] = 2
    inputs = {"blocks": blocks, "node_value": value, "node_state": state, "table": case_table(case.dim)}
    inputs["contour"] = Contour(np.dtype(dtype).type(h), np.dtype(dtype).type(0))
    return inputs | follow(inputs)


def follow(inputs: dict) -> dict:
    """Later arguments of the extraction from blocks, states, values, table and contour."""
    classified = {n: v for n, (v, _) in operations.classify(inputs["blocks"], inputs["node_state"]).items()}
    classified = {n: v.astype(np.uint8) for n, v in classified.items()}
    classified["edge_first"] = Backend("numpy").running_sum(BITS_SET[classified["crossings"]])
    classified["facet_first"] = Backend("numpy").running_sum(inputs["table"].count[classified["cell_case"]])
    cells = operations.facets(inputs["blocks"], *classified.values(), inputs["table"])
    classified |= {n: v.astype(np.int32) for n, (v, _) in cells.items()}
    points = operations.edge_points(
        inputs["blocks"], inputs["node_value"], inputs["contour"], classified["vertex_edge"]
    )
    classified["vertex_position"] = points["vertex_position"][0].astype(inputs["node_value"].dtype)
    return classified


@groups(
    "blocks", "node_value", "node_state", "table", "contour", "crossings", "cell_case", "edge_first", "facet_first",
    "vertex_edge", "facets", "vertex_position",
)  # fmt: skip
def _extraction(case, grid):
    return extraction(case.name, grid.dtype)


VARIATIONS[CaseTable] = Variation(held={"merged": "the table's rows are made for it"})
VARIATIONS[Contour] = Variation(other={"level": lambda level: 0.01})


# Values known only near the surface, which ends with them
hard_input("narrow_band", 3, 80)
# So sparse that its cells have many of the 256 states
hard_input("all_states", 3, lambda: cloud("all_states", 60, 3, 0.45))


def octahedron(dim: int) -> tuple[Case, dict]:
    """One node inside at the origin, -1 against 3 around it: a quarter of the way along every edge; h = 2 m.

    With the later arguments of the extraction.
    """
    name = f"octahedron_{dim}d"
    blocks = SparseGrid(Backend("cpu"), dim, "float64", 2.0).cover(np.zeros((1, 3)), 1, 1)
    value = np.where((node_table(blocks) == 0).all(1), -1.0, 3.0)
    inputs = {"blocks": blocks, "node_value": value, "node_state": (value < 0).astype(np.uint8)}
    inputs |= {"table": case_table(dim), "contour": Contour(2.0, 0.0)}
    return at(name, [0, 0, 0], dim=dim), inputs | follow(inputs)


def octahedron_counts(blocks, dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Cut edges and corner states: the node itself, and those a step back in each direction."""
    table = node_table(blocks)
    crossings, cell_case = np.zeros(nodes(blocks), np.uint8), np.zeros(nodes(blocks), np.uint8)
    for i, j in enumerate(table.tolist()):
        if set(j) <= {0, -1}:
            back = [c for c in range(dim) if j[c] == -1]
            cell_case[i] = 1 << sum(1 << c for c in back)
            crossings[i] = {0: 2**dim - 1, 1: sum(1 << c for c in back)}.get(len(back), 0)
    return crossings, cell_case


@closed_form("isosurface.classify", over=(2, 3))
def octahedron_counted(dim):
    case, inputs = octahedron(dim)
    crossings, cell_case = octahedron_counts(inputs["blocks"], dim)
    return Exact(case, inputs, {"crossings": crossings, "cell_case": cell_case})


@closed_form("isosurface.edge_points", over=(2, 3))
def octahedron_quarters(dim):
    """Vertices in the order of their edges: nodes by number, and at the origin x, y, z."""
    case, inputs = octahedron(dim)
    coordinates = node_table(inputs["blocks"])
    edge = inputs["vertex_edge"]
    start, axis = coordinates[edge // 3], edge % 3
    share = np.where((start == 0).all(1), 0.25, 0.75)
    return Exact(case, inputs, {"vertex_position": 2.0 * (start + share[:, None] * np.eye(3)[axis])})


@closed_form("isosurface.facets", over=(2, 3))
def octahedron_closed(dim):
    """Each orthant has one facet, whose corners lie on its three (two) half axes, ordered by its handedness."""
    case, inputs = octahedron(dim)
    coordinates = node_table(inputs["blocks"])
    on = {}
    for v, edge in enumerate(inputs["vertex_edge"]):
        sign = 1 if (coordinates[edge // 3] == 0).all() else -1
        on[(int(edge % 3), sign)] = v
    rows = []
    for i, j in enumerate(coordinates.tolist()):
        if not set(j) <= {0, -1}:
            continue
        signs = [1 if c == 0 else -1 for c in j[:dim]]
        ring = [on[(a, s)] for a, s in enumerate(signs)]
        turned = np.prod(signs) < 0
        # the lowest edge of a cell in space first: edges are numbered axis by axis
        rows.append((i, ring if not turned else [ring[0], ring[2], ring[1]] if dim == 3 else ring[::-1]))
    expected = {"vertex_edge": inputs["vertex_edge"], "facets": [row for _, row in sorted(rows)]}
    return Exact(case, inputs, expected)


@closed_form("isosurface.classify", over=(2, 3))
def unknown_corner(dim):
    """The octahedron with one unknown state, a step from the origin along every axis: its cell counts as outside."""
    case, inputs = octahedron(dim)
    crossings, cell_case = octahedron_counts(inputs["blocks"], dim)
    before = (node_table(inputs["blocks"])[:, :dim] == -1).all(1)
    answer = {"crossings": crossings, "cell_case": np.where(before, 0, cell_case)}
    inputs |= {"node_state": np.where(before, 2, inputs["node_state"]).astype(np.uint8)}
    return Exact(case, inputs, answer)
