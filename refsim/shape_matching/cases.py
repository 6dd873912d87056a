"""Inputs and closed forms of lattice shape matching: tables are in the first order, whatever that of the particles."""

import functools

import numpy as np

from refsim.core import cases
from refsim.core.cases import VARIATIONS, Case, Exact, Variation, at, closed_form, groups, hard_input, particles, takes
from refsim.core.effect import Lattice
from refsim.scene.solids import lattice_of
from refsim.shape_matching import Matching, ShapeMatching, operations
from refsim.shape_matching.boxes import boxes_of

cases.example(
    ShapeMatching(),
    brings="direct phase place region region_anchor region_center region_count region_share region_spin region_velocity"
    " rotation solid_position solid_velocity",
)


particles(identity=lambda case, random: np.arange(case.count, dtype=np.int32))


def half_width(case):
    """2, or 1 in the plane."""
    return case.dim - 1


def box(side):
    """Cells (side^3, 3) of a cube."""
    return cases.lattice((side,) * 3, 1.0).astype(int)


def bodies(case):
    """Lattice of the two bodies, and the random numbers that go on from there."""
    random = case.random("lattice")
    count = int(0.7 * case.count)
    cells, shift = [], 0
    for size in (count - count // 3, count // 3):
        side = int(np.ceil((1.3 * size) ** (1 / 3)))
        cells.append(random.permutation(box(side))[:size] + [shift, -1, 0])
        shift += side
    return lattice_of(cells), random


@functools.cache
def tables(case):
    """Two bodies that touch, full of holes, of the first 7/10 of the particles: lattice, direct, region and its count.

    `direct` is without the particles that are liquid; the regions are older, when only every tenth node had melted.
    """
    lattice, random = bodies(case)
    count = len(lattice.cell)
    place = np.arange(case.count)
    phase = cases.PARTICLES["phase"](case, case.random("phase"))
    before = np.where(random.random(case.count) < 0.1, 0, 1)
    direct = operations.direct_neighbours(phase, place, lattice)["direct"][0].astype(np.int32)
    older = operations.direct_neighbours(before, place, lattice)["direct"][0]
    empty = np.full((count, (2 * half_width(case) + 1) ** 3), -1)
    regions = operations.regions(older, None, lattice, empty, np.zeros(count, int))
    return lattice, direct, regions["region"][0].astype(np.int32), regions["region_count"][0].astype(np.int32)


@groups("lattice", "direct", "region", "region_count", "rebuild")
def _tables(case, grid):
    lattice, direct, region, count = tables(case)
    rebuild = (case.random("rebuild").random(len(count)) < 0.5).astype(np.int32)
    return {"lattice": lattice, "direct": direct, "region": region, "region_count": count, "rebuild": rebuild}


@groups(
    "solid_position", "solid_velocity", "region_share", "region_center", "region_anchor", "rotation", "region_velocity",
    "region_spin",
)  # fmt: skip
def _nodes(case, grid):
    _, _, _, count = tables(case)
    random, nodes = case.random("nodes"), len(count)
    position = case.position[:nodes]

    def vector(size):
        return size * random.normal(size=(nodes, 3))

    rotation = random.normal(size=(nodes, 4))
    mass = 1000 * grid.spacing**3 * random.uniform(0.2, 5, nodes)
    fields = {
        "solid_position": position, "solid_velocity": vector(1),
        "region_share": np.where(count > 0, mass / np.maximum(count, 1), 0),
        "region_center": vector(0.5 * grid.spacing), "region_anchor": vector(0.3 * grid.spacing),
        "rotation": rotation / np.linalg.norm(rotation, axis=1)[:, None], "region_velocity": vector(1),
        "region_spin": vector(0.1 / grid.spacing),
    }  # fmt: skip
    return {name: np.ascontiguousarray(values.astype(grid.dtype)) for name, values in fields.items()}


groups(boxes=lambda case, grid: boxes_of(tables(case)[0], half_width(case)))


groups(matching=lambda case, grid: ShapeMatching(half_width=half_width(case), stiffness=0.8).matching(grid))
_TABLES = "the case's tables are made for it"
_ROUNDING = "it decides on collapsed regions only, which the cases members_* hold"
_SOLVER = "how far a solver of eigenvectors goes; the reference's own goes to the end"
VARIATIONS[Matching] = Variation(
    held={"half_width": _TABLES, "precision": _SOLVER, "eps": _ROUNDING},
    other={"twist_floor": lambda floor: 1e4 * floor, "inertia_floor": lambda floor: 1e4 * floor},
)
VARIATIONS[Lattice] = Variation(other={"dim": lambda dim: 5 - dim})
takes("shape_matching.direct_neighbours", "shape_matching.regions", lattice="")
takes("shape_matching.match", matching="spacing twist_floor")
takes("shape_matching.pull", matching="spacing stiffness")
takes("shape_matching.region_motion", matching="inertia_floor")
takes("shape_matching.damp", matching="damping")


# Hard cases: bodies of whose regions many have collapsed, away from the body's middle


def _collapsed(name, shape, size):
    """Bodies in their shape, turned; cells from the second one along x on shrink into a point, a line or a plane."""
    blank = Case(name, 3, np.zeros((343, 3)))
    cell = bodies(blank)[0].cell.astype(float)
    random = blank.random("collapse")
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    place = cell.copy()
    far = cell[:, 0] >= 1
    kept = {"point": np.zeros((3, 3)), "line": np.diag([0.0, 1.0, 0.0]), "plane": np.diag([0.0, 1.0, 1.0])}[shape]
    place[far] = [2.0, 1.0, 1.0] + size * cell[far] @ kept
    position = blank.position + 40 * blank.spacing
    position[: len(cell)] = blank.spacing * (place @ (turn * np.sign(np.linalg.det(turn)))) + [1.0, -2.0, 0.5]
    return position


for _name, _shape, _size in (  # all members of many regions at one place, where nothing turns them, on a line, a plane
    ("members_in_a_point", "point", 1.0), ("members_on_a_line", "line", 1.0), ("members_on_a_short_line", "line", 1e-5),
    ("members_on_a_plane", "plane", 1.0), ("members_on_a_small_plane", "plane", 1e-5),
):  # fmt: skip
    hard_input(_name, 3, functools.partial(_collapsed, _name, _shape, _size))


# Closed forms


BLOCK = box(3)
CUBE = at("cube_of_27", BLOCK)
PAIR = cases.pair_case("pair_of_nodes", 2.0)
TWO = lattice_of([np.array([[0, 0, 0], [0, 0, 1]])])
NONE = np.full((2, 27), -1, np.int32)
DIRECT, ALONE = NONE.copy(), NONE.copy()
DIRECT[0, [13, 14]], DIRECT[1, [12, 13]] = [0, 1], [0, 1]
ALONE[:, 13] = 0, 1


def _around(lattice):
    """Nodes in the 27 slots around each node of a lattice, -1 for none."""
    number = {tuple(cell): s for s, cell in enumerate(lattice.cell.tolist())}
    return [[number.get(tuple(near), -1) for near in (cell + BLOCK - 1).tolist()] for cell in lattice.cell]


def _direct(case, lattice, phase, expected):
    place = np.arange(case.count, dtype=np.int32)
    inputs = {"phase": np.full(case.count, phase, np.int32), "place": place, "lattice": lattice}
    return Exact(case, inputs, {"direct": np.array(expected)})


@closed_form("shape_matching.direct_neighbours")
def cube_of_27():
    """In a cube of 27 nodes each has those in its slots; nodes of a cell below, of another body, are no members."""
    lattice = lattice_of([BLOCK])
    return _direct(CUBE, lattice, 2, _around(lattice))


@closed_form("shape_matching.direct_neighbours")
def touching_bodies():
    """Two bodies in adjacent cells are not welded (Shao & Song M19)."""
    return _direct(PAIR, lattice_of([np.array([[0, 0, 0]]), np.array([[0, 0, 1]])]), 1, ALONE)


@closed_form("shape_matching.regions")
def chain_of_four():
    """w = 2 in a chain along z: the ends do not reach each other."""
    direct = np.full((4, 27), -1, np.int32)
    region = np.full((4, 125), -1, np.int32)
    for s in range(4):
        for k in range(4):
            if abs(k - s) <= 1:
                direct[s, 13 + k - s] = k
            if abs(k - s) <= 2:
                region[s, 62 + k - s] = k
    chain = at("chain_of_four", cases.lattice((4, 1, 1), 1.0))
    inputs = {
        "direct": direct, "rebuild": None, "region": np.full((4, 125), 7, np.int32),
        "region_count": np.zeros(4, np.int32), "lattice": lattice_of([np.array([[0, 0, k] for k in range(4)])]),
    }  # fmt: skip
    return Exact(chain, inputs, {"region": region, "region_count": [3, 4, 4, 3]})


@closed_form("shape_matching.classify")
def middle_of_27():
    """Of a cube of 27 nodes only the middle one is inside; the last particle belongs to no body."""
    direct = np.full((27, 27), -1, np.int32)
    direct[:, 13] = np.arange(27)
    direct[5] = np.arange(27)
    direct[6] = -1
    more = at("cube_and_drop", np.concatenate([BLOCK, [[9.0, 0.0, 0.0]]]))
    expected = np.ones(28, int)
    expected[[5, 6, 27]] = [2, 0, 0]
    inputs = {"identity": np.arange(28, dtype=np.int32), "direct": direct, "phase": np.zeros(28, np.int32)}
    inputs["lattice"] = lattice_of([BLOCK])
    return Exact(more, inputs, {"phase": expected})


@closed_form("shape_matching.gather")
def shares():
    """m/cnt, in the first order: particle 0 stands in row 1."""
    inputs = {"mass": [6.0, 8.0], "place": [1, 0], "region_count": [2, 3]}
    return Exact(PAIR, inputs, {"region_share": [4.0, 2.0], "solid_position": PAIR.position[::-1]})


def _regions(region, lattice, half_width=1, **changes):
    """Regions, how many members they have, their boxes, and shape matching."""
    return {
        "region": region,
        "region_count": (region >= 0).sum(1).astype(np.int32),
        "matching": Matching(half_width, 1.0, 1.0, 0.1, 1e-9, 1e-9, 1e-17)._replace(**changes),
        "boxes": boxes_of(lattice, half_width),
    }


def _whole_region():
    """Nodes of a cube of 27 and the region of its middle; those of the other nodes are empty."""
    lattice = lattice_of([BLOCK])
    region = np.full((27, 27), -1, np.int32)
    region[13] = _around(lattice)[13]
    return region, lattice


def _cube(position, rotation, turn, **expected):
    """A cube at `position` with the region of its middle, of which `rotation` becomes `turn`."""
    turned = np.tile(rotation, (27, 1))
    turned[13] = turn
    inputs = {
        "solid_position": position, "region_share": np.full(27, 0.5), "rotation": np.tile(rotation, (27, 1)),
        "region_center": np.ones((27, 3)), "region_anchor": np.ones((27, 3)), **_regions(*_whole_region()),
    }  # fmt: skip
    return Exact(CUBE, inputs, {"rotation": turned, **expected})


@closed_form("shape_matching.match")
def quarter_turn():
    """A cube turned by 90 degrees about z around (5, 0, 0): x = 5 - y0, y = x0: its node is where it belongs."""
    x0, y0, z0 = (_whole_region()[1].cell.astype(float) - 1).T
    turn, none = np.sqrt(0.5) * np.array([1.0, 0.0, 0.0, 1.0]), np.zeros((27, 3))
    position = np.stack([5 - y0, x0, z0], axis=1)
    return _cube(position, [1.0, 0.0, 0.0, 0.0], turn, region_center=none, region_anchor=none)


def _about(axis, angle):
    """Quaternion of a turn [rad] about an axis."""
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * np.array(axis) / np.linalg.norm(axis)])


GENERAL = np.array([[1.3, 0.2, -0.1], [0.2, 0.9, 0.15], [-0.1, 0.15, 1.1]])
SKEWED = np.array([[1.2, 0.3, -0.2], [0.3, 0.7, 0.1], [-0.2, 0.1, 0.4]])
TURN = ([2, -1, 4], 1.1)
# axis and angle [rad] of the turn, those of the small turn since the rotation before, and the stretch
NEAR = (
    (*TURN, [1, 2, 3], 0.3, np.eye(3)), (*TURN, [-2, 1, 1], 0.45, GENERAL), (*TURN, [3, -1, 2], -0.2, np.eye(3)),
    (*TURN, [-1, -3, 2], 0.4, GENERAL), (*TURN, [1, 1, -2], 0.1, np.eye(3)), (*TURN, [2, -3, 1], 0.02, GENERAL),
    (*TURN, [1, 0, 0], 1e-9, np.eye(3)), (*TURN, [-1, 2, 2], 1e-3, GENERAL), ([2, 0, 1], 1.5, [1, -3, 3], 1e-9, SKEWED),
    ([0, 0, 1], 0.0, [-1, 3, 3], 1e-7, np.eye(3)), ([1, 3, 1], 2.2, [-3, -2, -2], 1e-7, np.diag([0.5, 1.5, 0.5])),
    ([0, 0, 1], 0.0, [1, 3, -1], 1e-3, np.diag([0.5, 0.5, 1.5])),
    ([2, 3, 2], 1.9, [1, 0, 0], 3.04, np.diag([1.5, 0.5, 0.5])),
    ([2, 3, 2], 1.9, [0, 1, 0], 3.04, np.diag([0.5, 1.5, 0.5])),
    ([1, 1, 0], 1.6, [0, 0, 1], 3.04, np.diag([0.5, 0.5, 1.5])),
)  # fmt: skip


@closed_form("shape_matching.match", over=range(len(NEAR)))
def near_the_last_turn(number: int) -> Exact:
    """x = R S x0 of a cube has the rotation R for a positive S; the one before is another turn off, small or large."""
    axis, angle, off, by, stretch = NEAR[number]
    turn, small = _about(axis, angle), _about(off, by)
    w, u = turn[0], turn[1:]
    v, more = small[0], small[1:]
    before = np.concatenate([[w * v - u @ more], w * more + v * u + np.cross(u, more)])
    cross = np.cross(np.eye(3), u)  # the matrix of u x
    matrix = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    rest = _whole_region()[1].cell.astype(float) - 1
    return _cube(rest @ (matrix @ stretch).T + [3.0, -2.0, 5.0], before, turn * np.sign(turn @ before))


def _crowd(half_width=1, place=(0.123, 0.456, 0.789), away=0.0):
    """(arguments, members, node): a body of 7 x 7 x 7 nodes whose outermost members of one region stand in one place.

    Only the node in the middle of those members has a region; they stand `away` [m] from it on their side.
    """
    lattice = lattice_of([box(7)])
    side = 2 * half_width + 1
    crowd = (lattice.cell < side).all(1)
    (middle,) = np.flatnonzero((lattice.cell == half_width).all(1))
    region = np.full((343, side**3), -1, np.int32)
    region[middle, lattice.cell[crowd] @ [side * side, side, 1]] = np.flatnonzero(crowd)
    position = lattice.cell + 0.1 * np.sin(np.arange(343.0))[:, None] * [1.0, -2.0, 3.0]
    position[crowd] = place + away * np.sign(lattice.cell[crowd] - half_width)
    inputs = {
        "solid_position": position, "region_share": 0.5 + np.arange(343) % 5,
        **_regions(region, lattice, half_width),
    }  # fmt: skip
    return inputs, crowd, middle


def _kept(inputs, crowd, middle, before=(0.48, 0.6, 0.0, 0.64)):
    """The crowd's region keeps its rotation, however it was turned before."""
    rotation = np.tile(before, (343, 1))
    share, none = inputs["region_share"][crowd], np.zeros((343, 3))
    half_width = inputs["matching"].half_width
    offset = box(2 * half_width + 1) - half_width
    order = inputs["region"][middle]
    rest = (inputs["region_share"][order][:, None] * offset).sum(0) / share.sum()
    w, u = rotation[0, 0], rotation[0, 1:]
    anchor = none.copy()
    anchor[middle] = -(rest + 2 * np.cross(u, np.cross(u, rest) + w * rest))
    inputs |= {"rotation": rotation, "region_center": none + 1, "region_anchor": none + 1}
    whole = at("body_of_343", inputs["solid_position"])
    return Exact(whole, inputs, {"rotation": rotation, "region_center": none, "region_anchor": anchor})


# Members in one place, away from their body's middle, do not turn their region
closed_form("shape_matching.match", members_in_one_place=lambda: _kept(*_crowd()))


@closed_form("shape_matching.match", over=range(3))
def rounded_off(axis: int) -> Exact:
    """The same 1,025 m from the origin along an axis, with the last digit of each member away from the node.

    What turns them is 3/5 of what rounding of the positions may do.
    """
    place, away = np.full(3, 33.0), np.zeros(3)
    place[axis], away[axis] = 1025.0, np.spacing(1025.0)
    return _kept(*_crowd(2, place, away))


@closed_form("shape_matching.match")
def rounded_off_everywhere():
    """The same along all axes at 2^40 m, where the rotation before is near the one that the last digits would give."""
    far = 2.0**40 + 1
    return _kept(*_crowd(2, np.full(3, far), np.spacing(far)), _about([1, 2, 3], 0.1))


@closed_form("shape_matching.match", over=range(3))
def beside_their_node(axis: int) -> Exact:
    """Members in one place do not turn the region of a melted node at the origin, 30 m from them along an axis.

    Nothing is lost by rounding of the node's position, and the sums cancel only up to their own rounding.
    """
    place = np.array([0.1, 0.1, 0.1])
    place[axis] = 30.1
    kept = _kept(*_melted(*_crowd(2, place)))
    return Exact(kept.case, kept.inputs, {"rotation": kept.expected["rotation"]})


def _melted(inputs, crowd, middle):
    """The crowd without the node itself, which is at the origin."""
    inputs["solid_position"][middle] = 0.0
    inputs["region"][middle, 62] = -1
    inputs["region_count"][middle] -= 1
    return inputs, crowd, middle


def _at_the_bound(share, axes=0):
    """Equal members 32 m from a melted node at the origin, `share` 2^-38 m to their side of it along x and z; the axes
    may be others.

    A = diag(a, 0, a), a = 150 share 2^-38 kg m; the rounding of the sums may make b = 2 w n eps 124 32 kg m. Above it
    the turn by 2 alpha about x that was there before becomes the one of the largest eigenvector of diag(2, 0) + f p
    p^T, f = 16 b/a, p = (cos alpha, sin alpha), twice: tan 2 phi = f sin 2 alpha/(2 + f cos 2 alpha).
    """
    away, alpha = share * 2.0**-38, 0.35
    place, aside, about = (np.roll(part, axes) for part in ([0.0, 32.0, 0.0], [away, 0.0, away], [1, 0, 0]))
    inputs, crowd, middle = _melted(*_crowd(2, place, aside))
    inputs["region_share"] = np.ones(343)
    exact = _kept(inputs, crowd, middle, _about(about, 2 * alpha))
    bound = 2 * 2 * 125 * 2.0**-52 * (124 * 32 + 200 * away)
    if 150 * away > bound:
        f = 16 * bound / (150 * away)
        for _ in range(2):
            alpha = 0.5 * np.arctan2(f * np.sin(2 * alpha), 2 + f * np.cos(2 * alpha))
    wanted = exact.expected["rotation"].copy()
    wanted[middle] = [np.cos(alpha), *(np.sin(alpha) * about)]
    return Exact(exact.case, exact.inputs, {"rotation": wanted})


closed_form(
    "shape_matching.match",
    turned_by_more_than_rounding=lambda: _at_the_bound(0.9),  # a tenth above: the region turns back a little
    turned_by_rounding=lambda: _at_the_bound(0.6),  # at three quarters of it: the region keeps its rotation
    turned_by_rounding_along_z=lambda: _at_the_bound(0.6, 1),
)


@closed_form("shape_matching.match")
def lone_node():
    """A region of one node keeps its rotation and takes the node's place."""
    rotation = np.array([[0.6, 0.0, 0.8, 0.0], [0.6, 0.0, 0.8, 0.0]])
    inputs = {
        "solid_position": PAIR.position, "region_share": [2.0, 3.0], "rotation": rotation,
        "region_center": np.ones((2, 3)), "region_anchor": np.ones((2, 3)), **_regions(ALONE, TWO),
    }  # fmt: skip
    expected = {"rotation": rotation, "region_center": np.zeros((2, 3)), "region_anchor": np.zeros((2, 3))}
    return Exact(PAIR, inputs, expected)


@closed_form("shape_matching.pull")
def stretched_pair():
    """Nodes 2 m apart that belong 1 m apart are drawn in by half a metre each; alpha = 1/2, t = 1/4 s, dt = 1/2 s."""
    turn = np.tile([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0], (2, 1))  # takes z to y
    anchor = np.array([[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]])
    inputs = {
        "velocity": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]], "solid_position": PAIR.position, "region_anchor": anchor,
        "rotation": turn, "place": [1, 0], "timestep": [0.25, 0.5], **_regions(DIRECT, TWO, stiffness=0.5),
    }  # fmt: skip
    pulled = np.array([[0.0, -2.0, 0.0], [0.0, 2.0, 0.0]])
    after = np.array([[0.0, 0.5, 0.0], [1.0, -0.5, 0.0]])
    return Exact(PAIR, inputs, {"acceleration": pulled, "solid_velocity": after})


@closed_form("shape_matching.region_motion")
def spinning_block():
    """A cube of 27 nodes that moves with 2 m/s along x and turns with 3/s about z."""
    region, lattice = _whole_region()
    r = lattice.cell.astype(float) - 1
    velocity = np.array([2.0, 0.0, 0.0]) + np.cross([0.0, 0.0, 3.0], r)
    inputs = {
        "solid_position": r, "solid_velocity": velocity, "region_share": np.full(27, 0.5),
        "region_center": np.zeros((27, 3)), **_regions(region, lattice),
    }  # fmt: skip
    expected_mean, expected_spin = velocity.copy(), np.zeros((27, 3))
    expected_mean[13], expected_spin[13] = [2.0, 0.0, 0.0], [0.0, 0.0, 3.0]
    return Exact(CUBE, inputs, {"region_velocity": expected_mean, "region_spin": expected_spin})


@closed_form("shape_matching.region_motion")
def crowd_in_one_place():
    """Members in one place, away from their body's middle, have a mean velocity and no spin."""
    inputs, crowd, middle = _crowd()
    velocity = np.sin(np.outer(np.arange(343.0), [1.0, 2.0, 3.0]))
    share = inputs["region_share"][crowd]
    mean = velocity.copy()
    mean[middle] = (share[:, None] * velocity[crowd]).sum(0) / share.sum()
    whole = at("body_of_343", inputs["solid_position"])
    inputs |= {"solid_velocity": velocity, "region_center": np.zeros((343, 3)), "region_spin": np.ones((343, 3))}
    return Exact(whole, inputs, {"region_velocity": mean, "region_spin": np.zeros((343, 3))})


@closed_form("shape_matching.damp")
def damped_pair():
    """Half the difference to the regions' velocity in t = 1/4 s: beta = 1/2, regions at rest but for a spin about x."""
    inputs = {
        "solid_position": PAIR.position, "solid_velocity": [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
        "region_center": [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]], "region_velocity": np.zeros((2, 3)),
        "region_spin": np.tile([4.0, 0.0, 0.0], (2, 1)), "place": [1, 0], "timestep": [0.25, 0.5],
        "acceleration": np.zeros((2, 3)), **_regions(DIRECT, TWO, damping=0.5),
    }  # fmt: skip
    return Exact(PAIR, inputs, {"acceleration": [[2.0, 0.0, 8.0], [-2.0, 0.0, -8.0]]})
