"""Inputs and closed forms of the reconstruction: each step's input comes from the references of earlier steps."""

import functools
import itertools
import math

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core import cases
from refsim.core.cases import CASES, VARIATIONS, Case, Exact, Variation, closed_form, groups, hard_input
from refsim.isosurface.cases import cell_size, extraction
from refsim.sparse_grid import Blocks, SparseGrid, nodes
from refsim.sparse_grid.reference import node_table
from refsim.sparse_grid.tables import blocks_of, keys_at
from refsim.surface_energy import Dice, SurfaceTerm, Tension, operations, reference, surface_term
from refsim.surface_energy.effect import SurfaceEnergy
from refsim.surface_energy.reconstruction import area_before

cases.example(
    SurfaceEnergy(surface_tension=5.0, enclose_volume=True, iterations=2, smallest=8),
    brings="cluster_share crowding greatest_crowding inverse_spread",
)


def tension_of(case) -> Tension:
    """Parameters of a case: few sweeps, so that errors are not smoothed; errata as printed if the case says so."""
    return Tension(surface_tension=0.07, iterations=4, literal=("M1", "M31") if case.literal else ())


without_sweeps = cases.other("surface_term", iterations=0)  # the fit of thesis M14
relaxed_further = cases.other("surface_term", relaxation=1.9, iterations=3)
printed_sign = cases.other("surface_term", tension=-0.07)  # the force of thesis M1


def listed(case, position, dtype, shift=0.0):
    """Points by cell on the case's blocks."""
    grid = SparseGrid(Backend("cpu"), case.dim, dtype, cell_size(case))
    return grid.by_cell(position.astype(dtype), extraction(case.name, dtype)["blocks"], shift)


@functools.cache
def reconstruction(name: str, dtype: str) -> dict:
    """All intermediate results of the reconstruction, by the references."""
    case = CASES[name]()
    position = case.position.astype(dtype)
    before = extraction(name, dtype)
    h, dim, blocks = cell_size(case), case.dim, before["blocks"]
    arrays = {
        "interior_position": position,
        "interior_number": case.random("interior_number").permutation(case.count).astype(np.int32),
        "cells": listed(case, position, dtype),
        "surface_term": surface_term(tension_of(case), dim, dtype, h),
    }

    def work_out(function, *names, **inputs):
        scope = {**before, **arrays, **inputs}
        answer = getattr(operations, function)(*(scope[n] for n in names))
        return {n: v.astype(dtype) if v.dtype.kind == "f" else v.astype(np.int32) for n, (v, _) in answer.items()}

    arrays |= work_out("facet_samples", "vertex_position", "facets")
    arrays["area_before"] = area_before(arrays["sample_area"], h, dim)
    arrays["dice"] = Dice(np.int64(7), np.int64(min(4 * len(before["facets"]), 300)))
    arrays |= work_out("candidates", "vertex_position", "facets", "area_before", "dice")
    arrays["candidate_cells"] = listed(case, arrays["candidate_position"], dtype)
    arrays["accepted"] = np.zeros(len(arrays["candidate_position"]), np.uint8)
    arrays["sample_cells"] = listed(case, arrays["sample_position"], dtype)
    arrays |= work_out(
        "offsets", "interior_position", "interior_number", "cells", "blocks", "surface_term", "sample_position",
        "sample_cells",
    )  # fmt: skip
    arrays["fit_cells"] = listed(case, arrays["fit_position"], dtype, 0.5)
    arrays |= work_out("fit_weights", "fit_position", "fit_cells", "blocks", "surface_term")
    arrays["active"] = np.flatnonzero(arrays["node_weight"]).astype(np.int32)
    names = ("fit_splines", "fit_cells", "blocks", "surface_term", "node_weight", "active")
    arrays |= work_out("fit", *names)
    arrays["query_position"], arrays["outward"] = arrays["sample_position"], arrays["offset_direction"]
    arrays["spline_cells"] = listed(case, arrays["query_position"], dtype, 0.5)
    names = ("query_position", "spline_cells", "blocks", "surface_term", "coefficients", "outward")
    arrays |= work_out("mls_normals", *names)
    random = case.random("vertex_normal")
    normal = random.normal(size=before["vertex_position"].shape)
    arrays["vertex_normal"] = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(dtype)
    arrays["inset_position"] = 0 * before["vertex_position"]
    arrays["node_force"] = np.full((nodes(blocks), 3), 0.01, dtype)  # so that adding differs from assigning
    arrays |= work_out("components", "blocks", "node_state")
    arrays["component_size"] = np.zeros(case.count, np.int32)
    return arrays


@groups(
    "interior_position", "interior_number", "cells", "sample_position", "sample_area", "facet_normal",
    "area_before", "dice", "candidate_facet", "candidate_position", "candidate_cells", "accepted", "sample_cells",
    "nearest", "offset_direction", "fit_position", "fit_cells", "fit_splines", "node_weight", "active",
    "residual", "coefficients", "query_position", "outward", "spline_cells", "surface_value", "surface_gradient",
    "sample_normal", "vertex_normal", "inset_position", "node_force", "node_label", "component_size",
)  # fmt: skip
def _reconstruction(case, grid):
    return reconstruction(case.name, grid.dtype)


groups(surface_term=lambda case, grid: surface_term(tension_of(case), case.dim, grid.dtype, cell_size(case)))
VARIATIONS[SurfaceTerm] = Variation(
    held=dict.fromkeys(("cell_size", "inverse_cell"), "the case's nodes and cells belong to it"), usual=()
)
VARIATIONS[Dice] = Variation(held={"candidates": "the case's tables have as many rows"})
cases.takes("surface_energy.node_states", "surface_energy.exit_points", surface_term="radius_squared")
cases.takes("surface_energy.poisson_disk", surface_term="disk")
cases.takes("surface_energy.offsets", surface_term="offset")
cases.takes("surface_energy.fit", surface_term="offset relaxation iterations")
cases.takes("surface_energy.inset", surface_term="inset")
cases.takes("surface_energy.surface_force", surface_term="tension")


# Shapes


def cut_ball(radius: float, dim: int, spacing: float = 0.1) -> np.ndarray:
    """A jittered lattice cut by a sphere around the origin."""
    count = 2 * math.ceil(radius / spacing) + 3
    position = cases.lattice((count, count, count), spacing, dim)
    position[:, :dim] += spacing * (
        np.random.default_rng(5).uniform(-0.25, 0.25, (len(position), dim)) - (count - 1) / 2
    )
    return position[np.linalg.norm(position, axis=1) < radius]


def shuffled(position: np.ndarray) -> np.ndarray:
    return position[np.random.default_rng(8).permutation(len(position))]


def close_drops() -> np.ndarray:
    """Two discs 2.5 cells apart: nearer than twice the level set's radius: they share one surface."""
    ball = cut_ball(0.45, 2)
    return np.vstack([ball, ball + [1.4, 0.02, 0.0]])


def narrow_cavity() -> np.ndarray:
    """A disc with a hole of 2 cells across: narrower than twice the level set's radius, it has no surface."""
    ball = cut_ball(0.9, 2)
    return ball[np.linalg.norm(ball, axis=1) > 0.2]


def spray() -> np.ndarray:
    """A drop and lone particles about it."""
    far = 1.3 * np.array([[1.0, 0.3, 0.2], [-1.0, 0.8, 0.1], [0.2, -1.1, 0.9], [0.0, 0.1, -1.4], [0.1, 0.1, -1.4]])
    return np.vstack([cut_ball(0.35, 3), far])


shape = functools.partial(hard_input, masses=(1, 1), ties=True)
shape("drop", 3, lambda: cut_ball(0.4, 3) + [0.03, -0.02, 0.01])  # two cells' radius
shape("disc", 2, lambda: cut_ball(0.8, 2) + [0.03, -0.02, 0.0])  # four cells' radius
# half a cell apart, oblique to the axes; volume ratios do not show its contraction
shape("filament_row", 3, lambda: 0.1 * np.arange(30)[:, None] * (np.array([2.0, 3.0, 6.0]) / 7) + 0.013)
shape("two_rows", 2, lambda: cases.lattice((25, 2, 1), 0.1, 2) + [0.02, 0.03, 0.0])
# exactly on the grid's nodes, where cell size and coordinates are exact in binary
shape("on_nodes", 3, lambda: cases.lattice((4, 4, 3), 0.25) - [0.5, 0.0, 0.0], spacing=0.25, support_radius=0.5)
# two particles to a cell, in a random order: most samples are equally near to two or more of them
shape("block_of_lattice", 3, lambda: shuffled(cases.lattice((5, 4, 4), 0.1) + 0.05))
shape("sheet_of_lattice", 2, lambda: shuffled(cases.lattice((8, 6, 1), 0.1, 2) + [0.05, 0.05, 0.0]))
shape("close_drops", 2, close_drops)
shape("narrow_cavity", 2, narrow_cavity)
shape("spray", 3, spray)


# Closed forms, h = 2 m


H = 2.0


def one_block(dim: int) -> Blocks:
    """Block 0 alone: 4 x 4 x 4 nodes, 8 x 8 in the plane, with cell 0 in one corner and the last cell in the other."""
    return blocks_of(keys_at(np.zeros((1, 3), int)), dim)


def lone(dim: int, where: float = 0.5, blocks: Blocks | None = None, **parameters):
    """(case, inputs) of one particle in the middle of cell 0 (or elsewhere in it)."""
    place = np.zeros((1, 3))
    place[0, :dim] = where * H
    case = Case(f"lone_{dim}d", dim, place, spacing=H / 2, support_radius=H)
    grid = SparseGrid(Backend("cpu"), dim, "float64", H)
    blocks = blocks or grid.cover(place, 4, 5)
    inputs = {"interior_position": place, "blocks": blocks, "cells": grid.by_cell(place, blocks)}
    inputs["interior_number"] = np.zeros(1, np.int32)
    inputs["surface_term"] = surface_term(Tension(surface_tension=3.0, **parameters), dim, "float64", H)
    inputs["node_state"] = np.zeros(nodes(blocks), np.uint8)
    return case, grid, inputs


def near_centre(blocks, dim):
    """Nodes nearer than r to the middle of cell 0: (j - 1/2)^2 sums to 3/4 or, with one 9/4, 11/4 < 3 in space; in the
    plane only to 1/2 < 2."""
    return ((node_table(blocks)[:, :dim] - 0.5) ** 2).sum(1) < dim


@closed_form("surface_energy.node_states", over=(2, 3))
def lone_particle(dim):
    """The corners of its own cell and, in space, those a step further along one axis, 8 + 24; not sqrt(2.5) h away."""
    case, _, inputs = lone(dim)
    state = near_centre(inputs["blocks"], dim).astype(np.uint8)
    assert state.sum() == {2: 4, 3: 32}[dim]
    return Exact(case, inputs, {"node_state": state})


@closed_form("surface_energy.exit_points")
def edges_of_one_sphere():
    """From (1, 1, 1) + x: the particle stands 1/2 back; l = -1/2 + sqrt(3 - 1/4 - 1/4), and so for the mirror edge."""
    case, _, inputs = lone(3)
    node = {tuple(j): i for i, j in enumerate(node_table(inputs["blocks"]).tolist())}
    # from a corner of the outer ring, (2, 1, 1) -> (3, 1, 1): a = -3/2, q^2 = 1/2
    length = -1.5 + math.sqrt(2.5)
    edges = [3 * node[2, 1, 1], 3 * node[-2, 1, 1], 3 * node[1, 0, -2] + 2]
    state = near_centre(inputs["blocks"], 3).astype(np.uint8)
    inputs |= {"node_state": state, "vertex_edge": np.array(edges, np.int32)}
    place = np.array([[2 + length, 1, 1], [-1 - length, 1, 1], [1, 0, -1 - length]])
    return Exact(case, inputs, {"vertex_position": H * place})


def _facet(dim, corners, centroid, area, normal):
    case, _, inputs = lone(dim)
    inputs |= {"vertex_position": np.array(corners), "facets": np.arange(dim, dtype=np.int32)[None]}
    expected = {"sample_position": centroid, "sample_area": area, "facet_normal": normal}
    return Exact(case, inputs, {name: np.array([value]) for name, value in expected.items()})


closed_form(
    "surface_energy.facet_samples",
    # sides 3 and 4 m at a right angle in the plane z = 5 m: area 6 m^2, normal +z
    right_triangle=lambda: _facet(3, [[0.0, 0, 5], [3, 0, 5], [0, 4, 5]], [1.0, 4 / 3, 5.0], 6.0, [0.0, 0, 1]),
    # from (0, 0) to (3, 4): length 5, the outside on the right
    segment=lambda: _facet(2, [[0.0, 0, 0], [3, 4, 0]], [1.5, 2.0, 0.0], 5.0, [0.8, -0.6, 0.0]),
)


def _candidates(x, facets, before, dice, expected, place):
    case, _, inputs = lone(2)
    inputs |= {"vertex_position": [[a, 7.0, 0.0] for a in x], "facets": np.array(facets, np.int32)}
    inputs |= {"area_before": np.array(before, np.int64), "dice": Dice(*map(np.int64, dice))}
    position = np.array([[a, 7.0, 0.0] for a in place])
    return Exact(case, inputs, {"candidate_facet": np.array(expected), "candidate_position": position})


@closed_form("surface_energy.candidates")
def candidates_on_two_segments():
    """Areas 1 : 3: of four candidates, one to each quarter, the first falls on the first segment; all on the line."""
    hashes = [reference.hash_word(1, k, 1) >> 8 for k in range(4)]
    x = [hashes[0] / 2**24] + [1 + 3 * w / 2**24 for w in hashes[1:]]
    return _candidates([0, 1, 4], [[0, 1], [1, 2]], [0, 1 << 20, 4 << 20], (1, 4), [0, 1, 1, 1], x)


closed_form(
    "surface_energy.candidates",
    # two segments of one unit each, and a candidate on each
    candidates_of_one_unit_of_area=lambda: _candidates(
        [0, 1, 2],
        [[0, 1], [1, 2]],
        [0, 1, 2],
        (1, 2),
        [0, 1],
        [k + (reference.hash_word(1, k, 1) >> 8) / 2**24 for k in range(2)],
    ),
    # facets without area: all candidates on the last of them
    candidates_without_area=lambda: _candidates([3, 3], [[0, 1], [1, 0]], [0, 0, 0], (1, 2), [1, 1], [3, 3]),
)


def _darts(x, accepted, blocks=None):
    """Candidates at x [m] with disks of 1 m; `accepted` of their turns."""
    case, grid, inputs = lone(2, blocks=blocks)
    place = np.array([[a, b, 0] for a, b in x])
    inputs |= {"candidate_position": place, "candidate_cells": grid.by_cell(place, inputs["blocks"])}
    inputs |= {"dice": Dice(np.int64(4), np.int64(3))}
    return Exact(case, inputs, {"accepted": np.array(accepted([reference.hash_word(4, k, 3) for k in range(3)]), int)})


closed_form(
    "surface_energy.poisson_disk",
    # three in a row, 0.8 m apart, with disks of 1 m: the one in the middle, or the two others
    three_darts=lambda: _darts(((0.5, 1), (1.3, 1), (2.1, 1)), lambda t: [0, 1, 0] if t[1] == min(t) else [1, 0, 1]),
    # two in cell 0, 0.8 m apart, of which the one drawn first is taken, and one in the last cell
    darts_at_both_ends=lambda: _darts(
        ((0.5, 1), (1.3, 1), (15, 15)), lambda t: [t[0] < t[1], t[1] < t[0], 1], one_block(2)
    ),
)


@closed_form("surface_energy.offsets")
def sample_beside_a_particle():
    """The particle stands at (1, 1, 1) m, the sample 0.9 m beside it along the diagonal (2, 1, 2)/3; epsilon = h/2."""
    case, grid, inputs = lone(3)
    direction = np.array([[2.0, 1.0, 2.0]]) / 3
    sample = inputs["interior_position"] + 0.9 * direction
    inputs |= {"sample_position": sample, "sample_cells": grid.by_cell(sample, inputs["blocks"])}
    points = np.vstack([sample, sample + direction])
    return Exact(case, inputs, {"nearest": np.zeros(1, int), "offset_direction": direction, "fit_position": points})


def _nearest(number, apart, nearest, direction):
    """Samples 6 m apart, each with particles that stand `apart` from it [m], h = 2 m, and their numbers."""
    case, grid, inputs = lone(2)
    sample = np.array([[1.5, 1.0 + 6 * k, 0.0] for k in range(len(number))])
    place = (sample[:, None] + apart).reshape(-1, 3)
    blocks = grid.cover(place, 4, 5)
    inputs |= {
        "interior_position": place, "interior_number": np.ravel(number).astype(np.int32), "blocks": blocks,
        "cells": grid.by_cell(place, blocks), "sample_position": sample, "sample_cells": grid.by_cell(sample, blocks),
        "fit_position": None,
    }  # fmt: skip
    return Exact(case, inputs, {"nearest": nearest, "offset_direction": np.array(direction)})


@closed_form("surface_energy.offsets")
def sample_between_two_particles():
    """Equally far from both: the particle with the lower number, of equal numbers the first.

    A particle 1e-4 m farther than the nearest is equally near, one 4e-4 m farther is not.
    """
    number = [[7, 4, 4, 0, 9], [5, 4, 3, 0, 9], [3, 4, 3, 0, 9], [3, 4, 3, 0, 1]]
    apart = [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [-0.5, 0.0, 0.0], [0.0, 0.5004, 0.0], [0.0, -0.5001, 0.0]]
    return _nearest(number, np.array(apart), [1, 7, 10, 19], [[-1.0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0]])


@closed_form("surface_energy.offsets")
def sample_beside_three_particles():
    """0.5, 0.50015 and 0.5003 m away, numbered 2, 1, 0, in each order: the last is not as near as the first."""
    order = np.array(list(itertools.permutations(range(3))))
    apart = np.array([[0.0, 0.5, 0.0], [0.0, -0.50015, 0.0], [-0.5003, 0.0, 0.0]])
    return _nearest(2 - order, apart[order], np.flatnonzero(order == 1), [[0.0, 1.0, 0.0]] * len(order))


def spline_at(j: np.ndarray) -> np.ndarray:
    """B of the nodes j steps from a point that is on a node."""
    return np.where(j == 0, 0.75, np.where(np.abs(j) == 1, 0.125, 0.0))


def fitted(dim: int, node: int, point: np.ndarray, half: int, shares, blocks: Blocks | None = None):
    """(case, inputs, weights of a point on node (node, ..), of one half a cell beyond) for points of the fit [h].

    half    row of the point that is half a cell beyond the node along x
    shares  how many points are on the node and beyond it, for the nodes' weights
    """
    case, grid, inputs = lone(dim, blocks=blocks)
    inputs |= {"fit_position": H * point, "fit_cells": grid.by_cell(H * point, inputs["blocks"], 0.5)}
    j = node_table(inputs["blocks"])[:, :dim] - node
    on = spline_at(j).prod(1)
    beyond = spline_at(j[:, 1:]).prod(1) * np.where((j[:, 0] == 0) | (j[:, 0] == 1), 0.5, 0.0)
    splines = np.array([[0.125, 0.75, 0.125] * 3] * len(point))
    splines[half, :3] = [0.5, 0.5, 0.0]
    splines[:, 3 * dim :] = [1.0, 0.0, 0.0] * (3 - dim)
    total = shares[0] * on + shares[1] * beyond
    inputs |= {"fit_splines": splines, "node_weight": np.where(total > 0, 1 / np.where(total > 0, total, 1), 0)}
    inputs["active"] = np.flatnonzero(inputs["node_weight"]).astype(np.int32)
    return case, inputs, on, beyond


def middle_fit(dim: int):
    """A sample on node (2, ..), its second point half a cell beyond along x: 1/8, 3/4, 1/8 and 1/2, 1/2."""
    point = np.zeros((2, 3))
    point[:, :dim] = 2
    point[1, 0] += 0.5
    return fitted(dim, 2, point, 1, (1, 1))


def end_fit(dim: int):
    """Points of the fit in one block: x half a cell beyond node (1, ..), one outside, and twice q on that node.

    The lowest node of the splines of q is node 0.
    """
    point = np.zeros((4, 3))
    point[:, :dim] = 1.0
    point[:2, 0] = 1.5, 99.0
    fit = fitted(dim, 1, point, 0, (2, 1), one_block(dim))
    fit[1]["fit_splines"][1] = 0.0
    return fit


def _weights(inputs):
    return Exact(inputs[0], inputs[1], {name: inputs[1][name] for name in ("fit_splines", "node_weight")})


closed_form(
    "surface_energy.fit_weights",
    weights_of_one_sample=lambda: _weights(middle_fit(3)),  # Lambda_j = 1/(B_j(x) + B_j(q))
    # Lambda_j = 1/(B_j(x) + 2 B_j(q)); the splines of the point outside are 0
    weights_at_the_first_node=lambda: _weights(end_fit(3)),
)


@closed_form("surface_energy.fit", over=(2, 3))
def one_sweep_of_one_sample(dim):
    """From C = 0 the residuals are 0 and epsilon: C_j = epsilon B_j(q)/(B_j(x) + B_j(q))."""
    case, inputs, _, second = middle_fit(dim)
    inputs["surface_term"] = surface_term(Tension(surface_tension=3.0, iterations=1), dim, "float64", H)
    value = 0.5 * second * inputs["node_weight"]
    return Exact(case, inputs, {"residual": [0.0, 0.5], "coefficients": value})


@closed_form("surface_energy.fit", over=(2, 3))
def two_sweeps_at_the_first_node(dim):
    """C = 2 epsilon Lambda B(q), and then with its residuals r: C += Lambda (B(x) r_x + 2 B(q) r_q); outside r = 0."""
    case, inputs, second, first = end_fit(dim)
    inputs["surface_term"] = surface_term(Tension(surface_tension=3.0, iterations=2), dim, "float64", H)
    weight = inputs["node_weight"]
    once = 0.5 * 2 * second * weight
    x, q = -(first @ once), 0.5 - second @ once
    twice = once + weight * (first * x + 2 * second * q)
    return Exact(case, inputs, {"residual": [x, 0.0, q, q], "coefficients": twice})


def plane(place, outward, blocks: Blocks | None = None):
    """Coefficients of the plane f = 0.6 x + 0.8 y - 0.3 h in space: every reading finds its gradient.

    A normal that would point against what was handed in, or outside all blocks, is what was handed in.
    """
    case, grid, inputs = lone(3, blocks=blocks)
    place, outward, j = np.array(place), np.array(outward), node_table(inputs["blocks"])
    inputs |= {
        "query_position": place, "spline_cells": grid.by_cell(place, inputs["blocks"], 0.5),
        "coefficients": 0.6 * j[:, 0] + 0.8 * j[:, 1] - 0.3, "outward": outward,
    }  # fmt: skip
    there = place[:, 0] < 90
    slope = there[:, None] * [0.6, 0.8, 0.0]
    value = np.where(there, place @ [0.6, 0.8, 0.0] / H - 0.3, 0.0)
    normal = np.where((slope * outward).sum(1, keepdims=True) > 0, slope, outward)
    return Exact(case, inputs, {"surface_value": value, "surface_gradient": slope, "sample_normal": normal})


closed_form(
    "surface_energy.mls_normals", "surface_energy.spline_normals",
    plane_in_the_middle=lambda: plane([[1.1, 2.3, 0.7], [0.2, 0.1, 2.9]], [[1.0, 0, 0], [-1.0, 0, 0]]),
    # where splines begin at node 0; and outside all blocks
    plane_at_the_first_node=lambda: plane(
        [[1.1, 2.3, 1.7], [1.2, 1.1, 2.9], [99.0, 1.0, 1.0]], [[1.0, 0, 0]] * 3, one_block(3)
    ),
)  # fmt: skip


@closed_form("surface_energy.inset")
def vertex_pulled_back():
    """By (sqrt(3) - 1/4) h along its normal."""
    case, _, inputs = lone(3)
    inputs |= {"vertex_position": [[1.0, 2.0, 3.0]], "vertex_normal": [[0.0, 0.6, 0.8]]}
    back = (math.sqrt(3) - 0.25) * H
    return Exact(case, inputs, {"inset_position": [[1.0, 2 - 0.6 * back, 3 - 0.8 * back]]})


@closed_form("surface_energy.surface_force", over=((2, 2), (3, 2), (3, 1)))
def one_sample_pulls(dim, node):
    """A sample on node (node, ..), normal along y: it pulls across y only, -k A B'(u_x) B(u_y) .. on the nodes.

    The splines of one on node (1, ..) begin at node 0 of one block.
    """
    case, grid, inputs = lone(dim, blocks=one_block(3) if node == 1 else None)
    place = np.zeros((1, 3))
    place[:, :dim] = node * H
    inputs |= {
        "sample_position": place, "sample_area": [0.5], "sample_normal": [[0.0, 1.0, 0.0]],
        "spline_cells": grid.by_cell(place, inputs["blocks"], 0.5),
    }  # fmt: skip
    j = node_table(inputs["blocks"])[:, :dim] - node
    slope = np.where(np.abs(j) == 1, 0.5 * j, 0.0) / H  # dB/dx_sample of the node to the right is +1/2 /h
    force = np.zeros((len(j), 3))
    for c in range(0, dim, 2):
        force[:, c] = -3.0 * 0.5 * slope[:, c] * np.delete(spline_at(j), c, axis=1).prod(1)
    return Exact(case, inputs, {"node_force": force})


@closed_form("surface_energy.components", "surface_energy.component_sizes", over=(2, 3))
def two_separate_particles(dim):
    """Eight cells apart: a component of one particle, and another of two."""
    case, grid, inputs = lone(dim)
    place = H * np.array([[0.5, 0.5, 0.5], [8.5, 0.5, 0.5], [8.6, 0.4, 0.5]])
    place[:, dim:] = 0
    blocks = grid.cover(place, 4, 5)
    j = node_table(blocks)
    number = {tuple(c): i for i, c in enumerate(j.tolist())}
    label = np.full(len(j), -1)
    for corner in (0, 8):
        component = [number[corner + a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)[: dim - 1]]
        label[component] = min(component)
    inputs |= {"blocks": blocks, "cells": grid.by_cell(place, blocks), "interior_position": place}
    inputs |= {"node_label": label.astype(np.int32), "node_state": (label >= 0).astype(np.uint8)}
    return Exact(case, inputs, {"node_label": label, "component_size": [1, 2, 2]})


@closed_form("surface_energy.components", over=(2, 3))
def full_and_half_blocks(dim):
    """A path from node 0 over three blocks, a lone node, and a component of three full blocks and a half of a fourth.

    The path reaches the corner of block (1, 1) from (1, 0), and two nodes of block (0, 1) reach it from there. Beside
    it block (2, 1) is full, so are (3, 1) and (3, 2), the last; half of (2, 2) stands on (2, 1). 64 blocks are empty.
    """
    case, _, inputs = lone(dim)
    rows = ((0, 0), (1, 0), *((k, 0) for k in range(3, 67)), *((k, 1) for k in range(4)), (2, 2), (3, 2))
    blocks, w = blocks_of(keys_at(np.array([(*row, 0) for row in rows])), dim), 4 if dim == 3 else 8
    j = node_table(blocks)
    x, y, _ = j.T
    number = {tuple(place): i for i, place in enumerate(j.tolist())}
    path = [(k, 0, 0) for k in range(w + 1)] + [(w, k, 0) for k in range(w + 1)] + [(w - 1, w, 0), (w - 2, w, 0)]
    half = (x >= 2.25 * w) & (x < 2.75 * w)
    label = np.full(len(j), -1)
    label[[number[place] for place in path]] = 0
    label[number[0, w + 1, 0]] = number[0, w + 1, 0]
    label[(y >= w) & (x >= 2 * w) & ((y < 2 * w) | (x >= 3 * w) | half)] = number[2 * w, w, 0]
    inputs |= {"blocks": blocks, "node_state": (label >= 0).astype(np.uint8), "node_label": label.astype(np.int32)}
    return Exact(case, inputs, {"node_label": label})


@closed_form("surface_energy.component_sizes")
def particles_outside_of_components():
    """Three particles in the component of node 0, one in that of node 9, one in none, one outside of all blocks."""
    case, grid, inputs = lone(3)
    blocks = inputs["blocks"]
    label = np.full(len(inputs["node_state"]), -1, np.int32)
    label[[0, 1, 9]] = 0, 0, 9
    place = H * np.concatenate([node_table(blocks)[[0, 0, 1, 9, 20]] + 0.5, [[99.0, 0.0, 0.0]]])
    inputs |= {"interior_position": place, "cells": grid.by_cell(place, blocks)}
    inputs["node_label"] = label
    return Exact(case, inputs, {"component_size": [3, 3, 3, 1, 0, 0]})


# One block alone: points in its first and last cells, and what lies outside


def both_ends(dim: int):
    """(case, grid, inputs, middles [h]) of particles in the middle of the first and of the last cell of a block."""
    case, grid, inputs = lone(dim, blocks=one_block(dim))
    middle = np.zeros((2, 3))
    middle[:, :dim] = [[0.5], [3.5 if dim == 3 else 7.5]]
    inputs["interior_position"] = H * middle
    inputs["cells"] = grid.by_cell(H * middle, inputs["blocks"])
    away = node_table(inputs["blocks"])[None, :, :dim] - middle[:, None, :dim]
    inputs["node_state"] = ((away**2).sum(2) < dim).any(0).astype(np.uint8)
    return case, grid, inputs, middle


@closed_form("surface_energy.node_states", over=(2, 3))
def spheres_at_both_ends(dim):
    """Nodes nearer than sqrt(dim) h to one of the two particles."""
    case, _, inputs, _ = both_ends(dim)
    return Exact(case, inputs, {"node_state": inputs.pop("node_state")})


@closed_form("surface_energy.exit_points", over=(2, 3))
def exits_at_both_ends(dim):
    """Along x out of each sphere: l = -1/2 + sqrt(2 - 1/4) from a corner of the cell, in space -3/2 + sqrt(3 - 1/2)."""
    case, _, inputs, _ = both_ends(dim)
    node = {tuple(j): i for i, j in enumerate(node_table(inputs["blocks"]).tolist())}
    edges = [3 * node[1, 1, 0], 3 * node[6, 7, 0]] if dim == 2 else [3 * node[2, 1, 1], 3 * node[1, 3, 3]]
    inputs["vertex_edge"] = np.array(edges, np.int32)
    a, b = -0.5 + math.sqrt(1.75), -1.5 + math.sqrt(2.5)
    ends = [[1 + a, 1, 0], [7 - a, 7, 0]] if dim == 2 else [[2 + b, 1, 1], [2 - b, 3, 3]]
    return Exact(case, inputs, {"vertex_position": H * np.array(ends)})


@closed_form("surface_energy.offsets", over=(2, 3))
def samples_near_and_far(dim):
    """Four samples: on a particle, 2.1 h from any, near the last, and between two 1.1 h and 1.25 h away.

    The first two have no direction. Of the two particles the nearer one is two cells away, the other one cell.
    """
    case, grid, inputs, middle = both_ends(dim)
    z = 1.5 if dim == 3 else 0.0
    y = 3.5 if dim == 3 else 4.5
    place = np.vstack([middle, [[0.95, y, z], [3.3, y, z]]])
    far = middle[0] + np.eye(3)[2 if dim == 3 else 0] * 2.1
    sample = np.array([middle[0], far, middle[1] - [0.3, 0.0, 0.0], [2.05, y, z]])
    direction = np.array([[0.0, 0, 0], [0, 0, 0], [-1, 0, 0], [1, 0, 0]])
    inputs |= {
        "interior_position": H * place, "interior_number": np.arange(4, dtype=np.int32),
        "cells": grid.by_cell(H * place, inputs["blocks"]), "sample_position": H * sample,
        "sample_cells": grid.by_cell(H * sample, inputs["blocks"]),
    }  # fmt: skip
    fitted = H * np.vstack([sample, sample + 0.5 * direction])
    answer = {"nearest": [0, -1, 1, 2], "offset_direction": direction, "fit_position": fitted}
    return Exact(case, inputs, answer)
