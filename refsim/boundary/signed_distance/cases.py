"""Inputs and closed forms of the signed distance: small bodies around a case's particles, and single shapes."""

import functools
import math

import numpy as np

from refsim.backends.arrays import choose
from refsim.boundary import signed_distance
from refsim.boundary.signed_distance import BandGrid, DistanceField, TriangleLists, Triangles, band_grid, operations
from refsim.core.cases import CASES, VARIATIONS, Case, Exact, Variation, at, closed_form, groups, hard_input, takes
from refsim.scene.surface_mesh import SurfaceMesh
from refsim.sparse_grid.tables import blocks_of, keys_at
from refsim.winding_number import clusters
from refsim.winding_number.cases import FACES, OCTAHEDRON

SHIFT = np.array([0.31, 0.17, 0.23])  # of the grid's spacing, from a case's first particle to the grid's nodes
BODIES = 8  # around the first particles of a case
QUERIES = 40


def bodies(case: Case) -> SurfaceMesh:
    """An octahedron around each of the first particles, relative to the first; coincident and remote ones left out."""
    place = case.position[:BODIES] - case.position[:1]
    place = place[np.sort(np.unique(np.round(1e6 * place / case.spacing), axis=0, return_index=True)[1])]
    place = place[np.abs(place).max(1, initial=0.0) < 1000 * case.spacing]
    corner = (place[:, None] + 0.45 * case.spacing * (OCTAHEDRON @ _turn().T)[None]).reshape(-1, 3) + _shift(case)
    faces = (6 * np.arange(len(place))[:, None, None] + FACES[None]).reshape(-1, 3)
    return SurfaceMesh(corner, faces, np.zeros(3))


def _shift(case: Case) -> np.ndarray:
    """Offset [m] of the first particle, so that particles of a lattice are not on nodes, where slopes jump."""
    return 0.25 * case.spacing * SHIFT


def _turn() -> np.ndarray:
    """A rotation that leaves no edge along an axis, so that few distances are equal."""
    a, b = 0.4, 0.7
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_z = np.array([[math.cos(b), -math.sin(b), 0], [math.sin(b), math.cos(b), 0], [0, 0, 1]])
    return about_x @ about_z


def needle() -> SurfaceMesh:
    """A pyramid 0.3 m long and 0.02 m wide: beyond its sharp tip the normal of the nearest face has the wrong sign."""
    corner = np.array([[0, 0.01, 0.01], [0, -0.01, 0.01], [0, -0.01, -0.01], [0, 0.01, -0.01], [0.3, 0.0, 0.0]])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [1, 0, 3], [1, 3, 2]], np.int64)
    return SurfaceMesh(corner, faces, np.zeros(3))


def plate() -> SurfaceMesh:
    """A box 0.4 m x 0.3 m x 0.01 m, thinner than the grid's spacing, rotated."""
    return _box(np.array([0.4, 0.3, 0.01]), _turn())


def _box(size: np.ndarray, turn: np.ndarray) -> SurfaceMesh:
    corner = (np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) - 0.5) * size @ turn.T
    faces = np.array(
        [
            [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
            [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
        ], np.int64,
    )  # fmt: skip
    return SurfaceMesh(corner, faces, np.zeros(3))


def crossed() -> SurfaceMesh:
    """Two boxes of which one pierces the other."""
    one, other = _box(np.array([0.3, 0.2, 0.25]), np.eye(3)), _box(np.array([0.6, 0.08, 0.07]), _turn())
    corner = np.concatenate([one.vertices, other.vertices])
    return SurfaceMesh(corner, np.concatenate([one.faces, other.faces + len(one.vertices)]), np.zeros(3))


SHAPES = {
    "needle": needle,
    "thin_plate": plate,
    "crossed_boxes": crossed,
    "thick_box": lambda: _box(np.array([1.3, 1.1, 0.9]), np.eye(3)),  # its centre is beyond the band and all blocks
    "unit_cube": lambda: _box(np.array([2.0, 2.0, 2.0]), np.eye(3)),  # from -1 m to 1 m, of known distance
}
SPACINGS = {"unit_cube": 0.5, "thick_box": 0.0625, "needle": 0.02, "thin_plate": 0.02, "crossed_boxes": 0.03}
BANDS = {"thick_box": 2.0}  # in spacings


for _name, _h in SPACINGS.items():
    hard_input(_name, 3, lambda: np.zeros((1, 3)), spacing=4 * _h, support_radius=8 * _h)


@functools.cache
def band_of(name: str, dtype: str) -> dict:
    """All intermediate arrays of the signed distance for a case, by the references."""
    case = CASES[name]()
    mesh = SHAPES[name]() if name in SHAPES else bodies(case)
    h = SPACINGS.get(name, 0.25 * case.spacing)
    grid = band_grid(h, BANDS.get(name, 2.5) * h, dtype)
    band = signed_distance.unfilled(choose("numpy"), mesh, grid)
    filled = operations.fill(grid, band["row_first"], band["closest"], band["distance"])
    band["inside_after"] = filled["inside_after"][0].astype(np.uint8)
    whole = band | {"distance": filled["distance"][0].astype(dtype)}
    origin = case.position[0] - _shift(case) if name not in SHAPES and case.count else np.zeros(3)
    return band | {
        "distance_field": signed_distance.field_of(whole, origin), "winding_clusters": clusters(mesh.corners, dtype),
        "unclear": case.random("unclear").integers(0, 2, (len(mesh.faces), 7)).astype(np.uint8),
        "query": (origin + queries(case, mesh, grid)).astype(dtype),
    }  # fmt: skip


def field_at(block: object, distance: np.ndarray) -> DistanceField:
    """Distances [m] at the nodes of blocks with integer coordinates (b, 3), h = 1 m, band 5 m, about the origin."""
    blocks, (zero, one) = blocks_of(keys_at(np.array(block, np.int64)), 3), map(np.float64, (0, 1))
    unknown = np.zeros(len(distance), np.int32), np.zeros(len(blocks.keys), np.uint8)
    return DistanceField(*blocks, distance, *unknown, one, one, np.float64(5), zero, zero, zero)


def queries(case: Case, mesh: SurfaceMesh, grid: BandGrid) -> np.ndarray:
    """Points [m] around the mesh relative to its origin: inside, outside, on nodes and outside all blocks."""
    random = case.random("query")
    if not len(mesh.faces):
        return np.zeros((0, 3))
    h = float(grid.spacing)
    corner = mesh.corners[random.integers(0, len(mesh.faces), QUERIES)]
    near = corner.mean(1) + random.normal(size=(QUERIES, 3)) * h
    on_nodes = h * np.round(near[:5] / h)
    middle = mesh.corners.mean((0, 1))[None]
    return np.concatenate([near, on_nodes, middle, middle + 100 * h])


@groups(
    "triangles", "band_grid", "block_count", "block_first", "pair_key", "pair_triangle", "band_blocks",
    "triangle_lists", "unsigned_distance", "closest", "distance", "row_first", "inside_after", "distance_field",
    "query", "unclear", "winding_clusters",
)  # fmt: skip
def _band(case, grid):
    return band_of(case.name, grid.dtype)


@groups("query_distance", "query_gradient", "projected", "projected_normal")
def _at_queries(case, grid):
    points = band_of(case.name, grid.dtype)["query"]
    flat, full = np.zeros(len(points), grid.dtype), np.zeros((len(points), 3), grid.dtype)
    return {"query_distance": flat, "query_gradient": full, "projected": full, "projected_normal": full}


_OF_THE_BLOCKS = "the case's blocks of nodes depend on it"
VARIATIONS[BandGrid] = Variation(
    held=dict.fromkeys(("spacing", "inverse_spacing", "half_diagonal"), _OF_THE_BLOCKS), usual=("band",)
)
VARIATIONS[DistanceField] = Variation(
    held=dict.fromkeys(("spacing", "inverse_spacing"), _OF_THE_BLOCKS),
    usual=("band", "origin_x", "origin_y", "origin_z"),
)
takes("signed_distance.signs", band_grid="")
takes("signed_distance.project", distance_field="origin_x origin_y origin_z")


def cube_distance(place: np.ndarray, half: float | np.ndarray = 1.0) -> np.ndarray:
    """Signed distance [m] of a box about the origin with half of its edges [m]; of the cube from -1 m to 1 m."""
    over = np.abs(place) - half
    return np.linalg.norm(np.maximum(over, 0), axis=1) + np.minimum(over.max(1), 0)


def _cube(name):
    """|phi| or phi at the unit cube's nodes by hand."""
    inputs = band_of("unit_cube", "float64")
    known, band = cube_distance(0.5 * operations.node_table(inputs["band_blocks"])), 1.25
    answers = {"unsigned_distance": np.minimum(np.abs(known), band), "distance": np.minimum(known, band)}
    return Exact(CASES["unit_cube"](), {}, {name: answers[name]})


# Distance of every node from the cube, at most the band of 5/4 m, h = 1/2 m; all of its inside lies in the band
closed_form("signed_distance.nearest", nodes_of_a_cube=lambda: _cube("unsigned_distance"))
closed_form("signed_distance.signs", signs_of_a_cube=lambda: _cube("distance"))


@closed_form("signed_distance.signs")
def signs_by_a_winding_number_above_one_half():
    """Three faces of a far cube, 1/6 each, and a small part of a fourth wind around all nodes 1/2 + 1/400 times."""
    far, unit = 1e4, np.array([[1.0, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]])
    faces = [np.roll(unit, axis, 1)[corners] for axis in range(3) for corners in ([0, 1, 2], [0, 2, 3])]
    corners = far * np.array([*faces, [[-1, 0, 0], [-1, 0, 0.25], [-1, 0.25, 0]]])
    inputs = band_of("unit_cube", "float64")
    given = {"winding_clusters": clusters(corners, "float64"), "unclear": np.ones_like(inputs["unclear"])}
    nodes = np.minimum(np.abs(cube_distance(0.5 * operations.node_table(inputs["band_blocks"]))), 1.25)
    return Exact(CASES["unit_cube"](), given, {"distance": np.where(inputs["closest"] >= 0, -nodes, nodes)})


@closed_form("signed_distance.fill")
def inside_of_a_thick_box():
    """Nodes deeper than the band of 1/8 m are at -1/8 m; blocks whose line ends inside are followed by inside."""
    inputs = band_of("thick_box", "float64")
    place = 0.0625 * operations.node_table(inputs["band_blocks"])
    known = cube_distance(place, np.array([0.65, 0.55, 0.45]))
    after = (known.reshape(-1, 64)[:, 3] < 0).astype(np.uint8)
    return Exact(CASES["thick_box"](), {}, {"distance": np.clip(known, -0.125, 0.125), "inside_after": after})


@closed_form("signed_distance.fill")
def sides_of_two_rows():
    """Two blocks and one, band 2 m: beyond the one known node of each line the side is that node's, before it outside.

    Lines 0, 3, 5 and 11 end inside; the next row begins outside all the same.
    """
    inside = np.isin(np.arange(16), (0, 3, 5, 11))
    closest, start = np.full((3, 16, 4), -1, np.int32), np.full((3, 16, 4), 7.0)
    closest[0, :, 1], start[0, :, 1] = 0, np.where(inside, -0.5, 0.5)
    wanted = np.full((3, 16, 4), 2.0)
    wanted[:2, inside] = -2.0
    wanted[0, :, 0], wanted[0, :, 1] = 2.0, start[0, :, 1]
    inputs = {
        "band_grid": band_grid(1.0, 2.0, "float64"), "row_first": [0, 2, 3],
        "closest": closest.ravel(), "distance": start.ravel(),
    }  # fmt: skip
    case = at("two_rows_of_blocks", [0, 0, 0])
    return Exact(case, inputs, {"distance": wanted.ravel(), "inside_after": [1, 1, 0]})


def speck() -> tuple[Case, dict]:
    """A tetrahedron of 1/1024 m in the centre of block 0, h = 1 m, band 2 m.

    The centres of blocks are 4 m apart and the limit is 2 + 3 sqrt(3)/2 = 4.598 m: the block itself and the six that
    share a face with it.
    """
    corner = 1.5 + np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) / 1024
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int64)
    inputs = {"triangles": signed_distance.triangle_table(SurfaceMesh(corner, faces, np.zeros(3)), "float64")}
    inputs["band_grid"] = band_grid(1.0, 2.0, "float64")
    inputs["block_first"] = 7 * np.arange(5, dtype=np.int32)
    return at("speck", [0, 0, 0]), inputs


@closed_form("signed_distance.count_blocks")
def seven_blocks():
    """Seven blocks for each of the four faces."""
    case, inputs = speck()
    return Exact(case, inputs, {"block_count": np.full(4, 7)})


@closed_form("signed_distance.list_blocks")
def their_keys():
    """The same blocks by key, z before y before x."""
    case, inputs = speck()
    steps = [(0, 0, -1), (0, -1, 0), (-1, 0, 0), (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    keys = np.tile(keys_at(np.array(steps)), 4)
    return Exact(case, inputs, {"pair_key": keys, "pair_triangle": np.repeat(np.arange(4), 7)})


def _apart(count: int) -> tuple[np.ndarray, ...]:
    """(owner, across, around) of triangles that share nothing."""
    itself = np.arange(count, dtype=np.int32)[:, None]
    return np.repeat(itself, 7, 1), np.repeat(itself, 3, 1), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


def _obtuse(order: list[int]) -> Exact:
    """Nodes of block 0 and a triangle with a corner of 166 degrees in the plane of two axes.

    Below the corner nodes are beyond two edges, of which one has the corner nearest to them and the other an inner
    point. From all other nodes the nearest point is on one of the same edges, too.
    """
    corner = np.array([[1.5, 1.5, 1.5], [1.5, 5.5, 1.5], [1.5, -2.5, 2.5]])
    blocks = blocks_of(keys_at(np.zeros((1, 3), int)), 3)
    node = operations.node_table(blocks).astype(float)
    distance = np.full(64, np.inf)
    for k in range(3):
        edge, away = corner[(k + 1) % 3] - corner[k], node - corner[k]
        along = np.clip(away @ edge / (edge @ edge), 0, 1)
        distance = np.minimum(distance, np.linalg.norm(away - along[:, None] * edge, axis=1))
    inner = np.cross(corner[1] - corner[0], node - corner[0])[:, 0] > 0
    for k in (1, 2):
        inner &= np.cross(corner[(k + 1) % 3] - corner[k], node - corner[k])[:, 0] > 0
    distance[inner] = np.abs(node[inner, 0] - 1.5)
    turned = corner[:, order]
    side = np.cross(turned[1] - turned[0], turned[2] - turned[0])
    normal = np.zeros((1, 21))
    normal[0, :3] = side / np.linalg.norm(side)
    inputs = {
        "triangles": Triangles(turned.reshape(1, 9), normal, *_apart(1)), "band_grid": band_grid(1.0, 9.0, "float64"),
        "band_blocks": blocks, "triangle_lists": TriangleLists(np.array([0, 1], np.int32), np.zeros(1, np.int32)),
    }  # fmt: skip
    wanted = distance.reshape(4, 4, 4)  # by z, y, x
    wanted = wanted.transpose([2 - order.index(2 - axis) for axis in range(3)]).ravel()
    case = at("obtuse", [0, 0, 0])
    return Exact(case, inputs, {"unsigned_distance": wanted, "closest": np.zeros(64)})


closed_form(
    "signed_distance.nearest",
    beyond_two_edges=lambda: _obtuse([0, 1, 2]),  # in the plane of y and z
    beyond_two_edges_upright=lambda: _obtuse([0, 2, 1]),  # in the plane of z and y
)


@closed_form("signed_distance.interpolate")
def above_a_cube():
    """Above and below the middle of a face phi is linear; far away it is the band, with slope 0."""
    points = np.array([[0.2, 0.1, 1.3], [0.2, 0.1, 0.8], [-1.7, 0.3, 0.2], [90.0, 0.0, 0.0]])
    slope = np.array([[0, 0, 1], [0, 0, 1], [-1, 0, 0], [0, 0, 0]], float)
    answer = {"query_distance": [0.3, -0.2, 0.7, 1.25], "query_gradient": slope}
    return Exact(CASES["unit_cube"](), {"query": points}, answer)


@closed_form("signed_distance.interpolate")
def sides_of_missing_blocks():
    """Blocks (0, 0, 0), (0, 1, 1) and (1, 1, 1) of nodes with phi = 3 m, h = 1 m, band 5 m; the liquid's side follows
    the last block before a node in its row: inside after the first and the third, outside elsewhere.

    Seven corners of the cell before node 0 have no block.
    """
    field = field_at([[0, 0, 0], [0, 1, 1], [1, 1, 1]], np.full(192, 3.0))
    field = field._replace(inside_after=np.array([1, 0, 1], np.uint8))
    answers = {
        (-0.5, -0.5, -0.5): (0.125 * (7 * 5 + 3), -0.5), (6.5, 1.5, 1.5): (-5.0, 0.0), (-6.5, 1.5, 1.5): (5.0, 0.0),
        (9.5, 5.5, 5.5): (-5.0, 0.0), (-2.5, 5.5, 5.5): (5.0, 0.0), (9.5, 1.5, 5.5): (5.0, 0.0),
        (1.5, 1.5, 1.5): (3.0, 0.0), (-1e9, 1.5, 1.5): (5.0, 0.0), (2.5, 9.5, 1.5): (5.0, 0.0),
        (2.5, 1.5, 9.5): (5.0, 0.0),
    }  # fmt: skip
    points, (value, slope) = np.array(list(answers)), np.array(list(answers.values())).T
    inputs, case = {"query": points, "distance_field": field}, at("missing_blocks", [0, 0, 0])
    return Exact(case, inputs, {"query_distance": value, "query_gradient": np.repeat(slope[:, None], 3, 1)})


@closed_form("signed_distance.project")
def onto_a_cube():
    """Onto a face, an edge and a corner of the cube, each with its pseudonormal."""
    points = np.array([[0.2, 0.1, 1.3], [1.2, -1.2, 0.1], [-1.1, 1.2, 1.3], [90.0, 0.0, 0.0]])
    onto = np.array([[0.2, 0.1, 1.0], [1.0, -1.0, 0.1], [-1.0, 1.0, 1.0], [90.0, 0.0, 0.0]])
    normal = np.array([[0, 0, 1], [math.sqrt(0.5), -math.sqrt(0.5), 0], [-1, 1, 1] / np.sqrt(3), [0, 0, 0]])
    return Exact(CASES["unit_cube"](), {"query": points}, {"projected": onto, "projected_normal": normal})


def _strip() -> Triangles:
    """Triangles 0 to 7: four unit squares along x at z = 0, each cut along a diagonal; triangle 8 is alone at z = 3 m.

    Triangles 2 k and 2 k + 1 make square k. Triangles 9 and 10 share a corner with triangle 0. Triangle 8 looks
    downwards, all others upwards.
    """
    cut = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0]]], float)
    at_corner = np.array([[[0, 1, 0], [-0.1, 1.5, 0], [-0.25, 1.5, 0]], [[-1, 2, 0], [-1, 1, 0], [0, 1, 0]]])
    corner = np.concatenate([*(cut + [k, 0, 0] for k in range(4)), cut[:1, ::-1] + [0, 0, 3], at_corner])
    normal = np.tile([0.0, 0.0, 1.0], (11, 7))
    normal[8] *= -1
    owner, across, around = _apart(11)
    around[0, 2], around[9, 0], around[10, 2] = 3 * 9, 3 * 10 + 2, 2
    for k in range(0, 8, 2):
        across[k, 1], across[k + 1, 2] = k + 1, k
    for k in range(1, 7, 2):
        across[k, 0], across[k + 1, 2] = k + 1, k
    return Triangles(corner.reshape(11, 9), normal, owner, across, around)


@closed_form("signed_distance.project")
def onto_a_strip():
    """One block of nodes, h = 1 m, of which few know a closest triangle, so that each query has few to begin with.

    From the first query the nearest triangle is six steps away. The second is halfway between triangles 0 and 8: the
    lower number wins. Triangle 8 is nearer to the third, but no corner of its cell knows it. The cells of the others
    begin outside the block and share one node with it that knows a triangle. The fifth goes across a corner.
    """
    known = {
        (3, 0, 1): 0, (0, 0, 1): 8, (1, 0, 1): 0, (0, 1, 3): 8, (0, 0, 0): 0, (0, 2, 2): 0, (2, 0, 2): 4, (2, 2, 0): 5,
    }  # fmt: skip
    closest = np.full((4, 4, 4), -1, np.int32)
    for (x, y, z), triangle in known.items():
        closest[z, y, x] = triangle
    field = field_at([[0, 0, 0]], np.zeros(64))._replace(closest=closest.ravel())
    answers = {
        (3.25, 0.25, 1.5): (3.25, 0.25, 0), (0.25, 0.25, 1.5): (0.25, 0.25, 0), (0.25, 1.25, 1.75): (0.25, 1, 0),
        (-0.5, -0.5, -0.5): (0, 0, 0), (-0.5, 2.5, 2.5): (-1, 2, 0), (2.5, -0.5, 2.5): (2.5, 0, 0),
        (2.5, 2.5, -0.5): (2.5, 1, 0),
    }  # fmt: skip
    points, onto = np.array(list(answers)), np.array(list(answers.values()), float)
    inputs, case = {"query": points, "triangles": _strip(), "distance_field": field}, at("strip", [0, 0, 0])
    return Exact(case, inputs, {"projected": onto, "projected_normal": np.tile([0.0, 0.0, 1.0], (len(points), 1))})
