"""Inputs, hard cases and closed forms of the transfers.

The background grid of a case has cells of two spacings; samples are 1.3 cells from its particles.
"""

import itertools

import numpy as np

from refsim import mpm
from refsim.core import cases
from refsim.core.cases import Case, Exact, Variation, at, closed_form, derived, groups, hard_input, particles
from refsim.mpm.grid import SLACK, Background, MpmGrid
from refsim.sparse_grid.reference import node_table

cases.example(mpm.MpmLiquid(bulk_modulus=1e4), brings="affine cell step_extremes volume_ratio")
cases.example(mpm.MpmWalls(lower=(-0.2, 0.0, -0.2), upper=(0.8, 0.8, 0.8)))

EMBEDDED = ("carrier_first", "carrier_position", "carrier_owner", "cluster_share", "inverse_spread")


def liquid_of(case: Case) -> mpm.MpmLiquid:
    """The liquid of a case: c = 20 m/s, printed readings where the case is printed."""
    literal = ("M3", "M4", "M5", "M27") if case.literal else ()
    density = cases.REST_DENSITY
    viscosity = 0.05 * density * case.spacing
    return mpm.MpmLiquid(rest_density=density, bulk_modulus=400 * density, dynamic_viscosity=viscosity, literal=literal)


def _matrices(case, random, size):
    """Matrices of so large entries, row by row; in the plane where the case is."""
    values = random.normal(size=(case.count, 3, 3)) * size
    values[:, case.dim :, :] = 0
    values[:, :, case.dim :] = 0
    return values.reshape(-1, 9)


particles(
    # velocity gradients of about 0.3 m/s per spacing
    affine=lambda case, random: _matrices(case, random, 0.3) / case.spacing,
    # near the unit matrix
    deformation=lambda case, random: _matrices(case, random, 0.1) + np.eye(3).ravel(),
    # up to a tenth from one
    volume_ratio=lambda case, random: random.uniform(0.9, 1.1, case.count),
    # from 0.2, below the density at rest, to twice that density
    crowding=lambda case, random: random.uniform(0.2, 2.0, case.count),
)
groups("background", "liquid", "viscous_stress", "counting")(lambda case, grid: liquid_of(case).prepare(grid, {}))
groups(
    kernel_gradient=lambda case, grid: mpm.KernelGradient(np.int32(1)),
    embedding=lambda case, grid: mpm.Embedding(np.int32(1)),
    greatest_crowding=lambda case, grid: np.zeros(1, grid.dtype),
    step_extremes=lambda case, grid: np.zeros(4, grid.dtype),
)
as_printed, corrected = cases.other("embedding", reading=2), cases.other("embedding", reading=3)


def wall_nodes(*values) -> mpm.WallNodes:
    return mpm.WallNodes(*(np.array(row, np.int32) for row in values))


def _walls_of(case, shares, rules, least=0):
    """Walls with these rules at two quantiles of the particles' coordinates, `least` cells apart or more."""
    lower, upper = np.full(3, -mpm.OPEN), np.full(3, mpm.OPEN)
    for axis in range(case.dim if case.count else 0):
        low, high = np.quantile(case.position[:, axis] / (2 * case.spacing), shares).round()
        lower[axis], upper[axis] = low, max(high, low + least)
    return wall_nodes(lower, upper, rules)


# walls of every kind, each with a fifth to a quarter of the particles behind it
groups(planes=lambda case, grid: _walls_of(case, (0.25, 0.8), [3, 1, 2, 3, 3, 2]))


def wide_domain(case, grid):
    """Walls of every kind, eight cells apart or more, the lower ones a little inside the particles."""
    return _walls_of(case, (0.1, 0.9), [2, 1, 3, 2, 1, 3], 8)


_OF_THE_GRID = "the case's grid is made for it"
cases.VARIATIONS[Background] = Variation(
    held=dict.fromkeys(("cell_size", "inverse_cell", "inverse_moment", "layers", "width"), _OF_THE_GRID),
    other={"least_mass": lambda least: 0.2, "least_speed": lambda least: 0.5},  # [kg; m/s], of nodes at the edge
    usual=(),
)
cases.VARIATIONS[mpm.Embedding] = Variation(other={"reading": lambda reading: reading + 1})
cases.VARIATIONS[mpm.KernelGradient] = Variation(held={"on": "the group's presence is the reading"})
cases.codes(mpm.Embedding, reading={name: number for number, name in enumerate(mpm.READINGS)})
cases.codes(mpm.WallNodes, rules=mpm.RULES)
cases.readings(embedding="reading", liquid="linear_stress unit_volume timeless", kernel_gradient="")
cases.takes("mpm.grid_update", background="least_mass least_speed")
cases.takes("mpm.particle_to_grid", "mpm.carriers_to_grid", liquid="rest_density stress linear_stress unit_volume")
cases.takes("mpm.grid_to_particle", liquid="timeless")


@derived("surface_sample", "sample_owner")
def _samples(inputs, name):
    """Samples (s, 3) [m] on spheres around half of the case's particles, whatever the order of the inputs'; the owner
    of each is the nearest of all particles."""
    case, random = inputs.case, inputs.case.random("samples")
    count = (case.count + 1) // 2
    at = np.sort(random.choice(case.count, count, replace=False)) if count else np.zeros(0, int)
    directions = random.normal(size=(count, 3))
    directions[:, case.dim :] = 0
    directions /= np.sqrt((directions**2).sum(1, keepdims=True))
    position = (case.position[at] + 2.6 * case.spacing * directions).astype(inputs.dtype)
    if name == "surface_sample":
        return position
    x = inputs["position"].astype(float)
    return np.array([int(((x - s) ** 2).sum(1).argmin()) for s in position.astype(float)], np.int32)


@derived(*EMBEDDED)
def _embedded(inputs, name):
    """The embedded points of the operations."""
    given = [inputs[n] for n in ("position", "surface_sample", "sample_owner", "background")]
    value, _ = mpm.operations.embed(*given)[name]
    return value.astype(np.int32 if name in ("carrier_first", "carrier_owner") else inputs.dtype)


@derived("grid", "cell")
def _grid(inputs, name):
    """Blocks for the particles, their samples and embedded points."""
    grid = MpmGrid(inputs.case.dim, inputs.dtype, 2 * inputs.case.spacing)
    sets = [inputs[n] for n in ("position", "carrier_position", "surface_sample")]
    cell = mpm.operations.cells(*sets, grid)["cell"][0].astype(np.int32)
    return grid if name == "grid" else cell


derived(nodes=lambda inputs, name: node_table(inputs["grid"].blocks).astype(np.int32))
cases.STAND_INS["grid"] = "background", "nodes"


@derived("node_mass", "node_momentum", "node_pull", "node_velocity", "carrier_moment")
def _node_values(inputs, name):
    """Masses of particles on four nodes of five, and nothing on the others; velocities of about one."""
    case, random = inputs.case, inputs.case.random(name)
    if name == "carrier_moment":
        values = random.normal(size=(len(inputs["carrier_position"]), 12)) * np.repeat([1.0, case.spacing], [3, 9])
        if case.dim == 2:
            values[:, [2, 5, 8, 9, 10, 11]] = 0
        return values.astype(inputs.dtype)
    nodes = inputs["grid"].nodes
    mass = cases.REST_DENSITY * case.spacing**case.dim
    if name == "node_mass":
        return (mass * random.uniform(0.1, 1.0, nodes) * (random.uniform(size=nodes) < 0.8)).astype(inputs.dtype)
    size = {"node_momentum": mass, "node_pull": 100 * mass / case.spacing, "node_velocity": 1.0}[name]
    values = random.normal(size=(nodes, 3)) * size
    values[:, case.dim :] = 0
    return values.astype(inputs.dtype)


# Hard cases


# Exactly on nodes, on cell borders and on the borders of blocks, on both sides of the origin
ON_NODES = {"spacing": 0.125, "masses": (1, 1), "ties": True}
hard_input("on_nodes", 3, lambda: cases.lattice((7, 6, 5), 0.125) - 0.5, **ON_NODES)
hard_input("on_nodes_2d", 2, lambda: cases.lattice((12, 11, 1), 0.125, 2) - [0.75, 0.75, 0], **ON_NODES)
hard_input("many_in_a_cell", 3, lambda: 0.1 + 0.08 * np.random.default_rng(5).uniform(size=(300, 3)))
hard_input("one_in_each_block", 3, lambda: cases.lattice((3, 3, 3), 1.7) + 0.03)
# Near the end of the grid, where a block has neighbours on one side only
LAST = 0.2 * (2**20 - 60)
hard_input("near_the_last_cell", 2, lambda: cases.cloud("near_the_last_cell", 40, 2) + [-LAST, LAST, 0])


# Closed forms: h = 2 m. A particle at (2, 2, 2) m is on a node, with weights 1/8, 3/4, 1/8 along each axis.

LINE = np.array([0.125, 0.75, 0.125])


def alone(dim: int, where: tuple = (2.0, 2.0, 2.0), samples: np.ndarray | None = None):
    """(case, its grid, background) of one particle."""
    position = np.array([where])
    position[:, dim:] = 0
    case = at(f"alone_{dim}d", position, dim=dim)
    grid = MpmGrid(dim, "float64", 2.0)
    none = np.zeros((0, 3)) if samples is None else samples
    mpm.operations.cells(position, none, none, grid)
    background = mpm.MpmLiquid(bulk_modulus=1.0, cell_size=2.0).background(case.grid("float64"))
    return case, grid, background


def weight_of(grid) -> np.ndarray:
    """Weight of the particle on a node, for every node: products of 1/8, 3/4, 1/8 on nodes 0 to 2 of each axis."""
    weight = np.ones(grid.nodes)
    for c in range(grid.dim):
        j = node_table(grid.blocks)[:, c]
        weight *= np.where((j >= 0) & (j <= 2), LINE[np.clip(j, 0, 2)], 0.0)
    return weight


WATER = mpm.Liquid(1.0, 3.0, 0, 0, 0)
STEPS = np.array([0.25, 0.25])
TURN = np.array([[0.5, -1.0, 0.25], [1.0, 0.25, 0.0], [2.0, 0.0, -0.5]])


def velocity_gradient(dim: int) -> np.ndarray:
    """A velocity gradient."""
    return TURN * (np.arange(3) < dim)[:, None] * (np.arange(3) < dim)


def _located(case, kind, cell):
    """The cells of a case's particles in a grid of this kind."""
    inputs = {"grid": kind(case.dim, "float64", 2.0), "carrier_position": None, "surface_sample": None}
    mpm.operations.cells(case.position, None, None, inputs["grid"])
    return Exact(case, inputs, {"cell": np.array(cell)})


@closed_form("mpm.cells")
def first_cells():
    """Base nodes (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 3) of the first block have the numbers 0, 1, 4 and 48."""
    position = np.array([[2.0, 2.0, 2.0], [4.0, 2.0, 2.0], [2.0, 4.5, 2.0], [2.5, 1.5, 8.9]])
    return _located(at("first_cells", position), MpmGrid, [0, 1, 4, 48])


class Outgrown(MpmGrid):
    """A grid that on a CPU has the blocks of its first point alone; a GPU, which makes more of them, has them all."""

    def on_backend(self, backend):
        grid = super().on_backend(backend)
        if backend.name not in SLACK:
            first = MpmGrid(self.dim, self.dtype, self.cell_size)
            mpm.operations.cells(self._located["particles"][:1], None, None, first)
            grid.blocks, grid.complete = first.blocks, first.complete
        return grid


# Points in blocks (0, 0, 0), (1, 0, 0), (0, 1, 0) and (0, 0, 1), of numbers 0, 1, 3 and 8 among all in reach; in the
# plane in blocks (0, 0), (1, 0) and (0, 2), of numbers 0, 1 and 6.
FIRST = (
    (2, [[0, 0, 0], [9, 0, 0], [2, 17, 0], [7, 7, 0]], [0, 65, 6 * 64 + 10, 63]),
    (3, [[0, 0, 0], [4, 0, 0], [1, 6, 3], [0, 1, 5], [3, 0, 0]], [0, 64, 3 * 64 + 57, 8 * 64 + 20, 3]),
)


@closed_form("mpm.cells", over=FIRST)
def first_blocks(dim: int, node: list, cell: list) -> Exact:
    """Points over the middle of the stencil of each base node."""
    position = 2.0 * (np.array(node) + 1.0) * (np.arange(3) < dim)
    return _located(at(f"first_blocks_{dim}d", position, dim=dim), Outgrown, cell)


def _stencil(dim):
    """m B_j and m B_j (v + A (x_j - x)) - K B_j (x_j - x), K = dt lambda (J - 1) J m/rho0 = 1.125, 4/h^2 = 1."""
    case, grid, background = alone(dim)
    v = np.array([1.0, -2.0, 0.5]) * (np.arange(3) < dim)
    arm = 2.0 * node_table(grid.blocks) - case.position[0]
    weight = weight_of(grid)
    inputs = {
        "grid": grid, "background": background, "liquid": WATER, "timestep": STEPS, "mass": [2.0], "velocity": v[None],
        "affine": velocity_gradient(dim).reshape(1, 9), "volume_ratio": [1.5], "acceleration": None,
        "cluster_share": None, "inverse_spread": None, "embedding": None,
    }  # fmt: skip
    return case, inputs, weight, v, arm


@closed_form("mpm.particle_to_grid", over=(2, 3))
def one_stencil(dim):
    """Mass 2 kg, J = 3/2, by the affine field, on 3^dim nodes."""
    case, inputs, weight, v, arm = _stencil(dim)
    field = 2.0 * (v + arm @ velocity_gradient(dim).T) - 1.125 * arm
    inputs["kernel_gradient"] = None
    return Exact(case, inputs, {"node_mass": 2.0 * weight, "node_momentum": weight[:, None] * field})


@closed_form("mpm.particle_to_grid")
def force_through_the_gradient():
    """(4.17) as printed: -K grad B_j; along an axis h B' = -1/2, 0, 1/2, so that it is the weight times a slope."""
    case, inputs, weight, v, arm = _stencil(3)
    slope = np.where(arm == 0, 0.0, 0.25 * arm / LINE[0] * 0.5)  # B'/B on the outer nodes: -+ (1/2)/(1/8)/h
    field = 2.0 * (v + arm @ velocity_gradient(3).T)
    push = -1.125 * weight[:, None] * slope
    inputs["kernel_gradient"] = mpm.KernelGradient(1)
    return Exact(case, inputs, {"node_mass": 2.0 * weight, "node_momentum": weight[:, None] * field + push})


def _pair():
    """A particle on node (1, 1, 1) with one sample 2 m along x: share 1/3, E = diag(1 + 8/3, 1, 1)."""
    sample = np.array([[4.0, 2.0, 2.0]])
    points = np.array([[4.0, 2.0, 2.0], [0.0, 2.0, 2.0]])
    case, grid, background = alone(3, samples=points)
    inputs = {
        "grid": grid, "background": background, "liquid": WATER, "timestep": STEPS, "surface_sample": sample,
        "sample_owner": np.zeros(1, np.int32), "carrier_position": points, "carrier_owner": np.zeros(2, np.int32),
        "carrier_first": [0, 2], "cluster_share": [1 / 3],
        "inverse_spread": [[3 / 11, 0, 0, 1, 0, 1]], "embedding": mpm.Embedding(1),
    }  # fmt: skip
    return case, inputs


@closed_form("mpm.embed")
def one_sample():
    """x_o = 2 x_p - x_s, w = 1/3, D = (h^2/4) 1 + 2 w d d^T."""
    case, inputs = _pair()
    return Exact(case, inputs, {name: inputs.pop(name) for name in EMBEDDED})


@closed_form("mpm.carriers_to_grid")
def two_carriers():
    """w m B_j(x_q) (v + A (x_j - x_p)) B_j(x_q) the particle's weights shifted by a node each way."""
    case, inputs = _pair()
    v, grid = np.array([1.0, -2.0, 0.5]), inputs["grid"]
    arm = 2.0 * node_table(grid.blocks) - case.position[0]
    weight = np.zeros(grid.nodes)
    for shift in (1, -1):
        moved = node_table(grid.blocks) - [shift, 0, 0]
        inside = ((moved >= 0) & (moved <= 2)).all(1)
        weight += np.where(inside, LINE[np.clip(moved, 0, 2)].prod(1), 0.0)
    pressed = 1.125 / 3 * arm * [3 / 11, 1, 1]
    field = 2 / 3 * (v + arm @ TURN.T) - pressed
    inputs |= {"mass": [2.0], "velocity": v[None], "affine": TURN.reshape(1, 9)}
    inputs |= {"acceleration": None, "volume_ratio": [1.5]}
    return Exact(case, inputs, {"node_mass": 2 / 3 * weight, "node_momentum": weight[:, None] * field})


def _walls(field, planes):
    case, grid, background = alone(3)
    table = node_table(grid.blocks)
    mass = np.where(table[:, 2] == 1, 2.0, 0.0)
    momentum = np.broadcast_to([2.0, -4.0, 1.0], (grid.nodes, 3)).copy()
    inputs = {"grid": grid, "background": background, "timestep": STEPS, "node_mass": mass, "node_momentum": momentum}
    inputs |= {"node_pull": None, "field": field, "planes": planes}
    return case, inputs, table, mass > 0


def _falling(after, pull):
    case, inputs, _, heavy = _walls(np.array([0.0, -4.0, 8.0]), None)
    inputs["node_pull"] = None if pull is None else np.broadcast_to(pull, inputs["node_momentum"].shape).copy()
    return Exact(case, inputs, {"node_velocity": np.where(heavy[:, None], after, 0.0)})


closed_form(
    "mpm.grid_update",
    falling_nodes=lambda: _falling([1.0, -3.0, 2.5], None),  # (1, -2, 1/2) + dt (0, -4, 8) on nodes with mass
    pulled_nodes=lambda: _falling([2.0, -3.0, 2.0], [8.0, 0.0, -4.0]),  # the same + dt (8, 0, -4)/2
)


@closed_form("mpm.grid_update")
def walls_on_nodes():
    """Sticky at x <= 0, separating at y <= 1 and y >= 3, slip at z >= 1; the velocity is (1, -2, 1/2)."""
    planes = wall_nodes([0, 1, -9], [9, 3, 1], [1, 0, 3, 3, 0, 2])
    case, inputs, table, heavy = _walls(None, planes)
    v = np.where(heavy[:, None], [1.0, -2.0, 0.0], 0.0)
    v[table[:, 1] <= 1, 1] = 0
    v[table[:, 0] <= 0] = 0
    return Exact(case, inputs, {"node_velocity": v})


FACES_AND_RULES = tuple(itertools.product(range(6), (1, 2, 3)))


@closed_form("mpm.grid_update", over=FACES_AND_RULES)
def one_wall_on_nodes(face: int, rule: int) -> Exact:
    """v = (1, -2, 1/2) m/s on all nodes. Behind a sticky wall it is 0; of a slip wall its component along the axis is,
    and of a separating one if it points into the wall.

    Of nodes 0 to 7, a lower wall is at 5 and an upper one at 2; the other faces are at 0, 7 or where the wall is, and
    have no rule.
    """
    axis, (lower, upper) = face // 2, (0, 2) if face % 2 else (5, 7)
    planes = wall_nodes([lower] * 3, [upper] * 3, rule * np.eye(6, dtype=int)[face])
    case, inputs, table, _ = _walls(None, planes)
    side = 2 - table[:, axis] if face % 2 else table[:, axis] - 5  # nodes before the wall
    inputs["node_mass"] = np.full(len(side), 2.0)
    v = np.broadcast_to([1.0, -2.0, 0.5], (len(side), 3)).copy()
    into = v[0, axis] * (1 if face % 2 else -1) > 0
    if rule == mpm.RULES["sticky"]:
        v[side <= 0] = 0
    elif rule == mpm.RULES["slip"] or into:
        v[side <= 0, axis] = 0
    return Exact(case, inputs, {"node_velocity": v})


def _taken(dim, deformation):
    """Of nodes with the velocity c + G x APIC takes c + G x_p and G."""
    case, grid, background = alone(dim)
    c = np.array([1.0, -2.0, 0.5]) * (np.arange(3) < dim)
    v = c + 2.0 * node_table(grid.blocks) @ velocity_gradient(dim).T
    a, trace = velocity_gradient(dim), np.trace(velocity_gradient(dim))
    velocity, ratio = c + a @ case.position[0], 1.5 * (1 + 0.25 * trace)
    inputs = {
        "grid": grid, "background": background, "liquid": WATER, "timestep": STEPS, "node_velocity": v,
        "volume_ratio": [1.5], "build_position": None, "cluster_share": None, "inverse_spread": None,
        "embedding": None, "carrier_first": None, "carrier_position": None, "carrier_moment": None,
        "displacement": np.zeros(3), "step_extremes": np.zeros(4), "deformation": deformation,
    }  # fmt: skip
    expected = {
        "velocity": velocity[None], "affine": a.reshape(1, 9), "position": case.position + 0.25 * velocity,
        "displacement": [(0.0625 * velocity**2).sum(), 0.0, 0.0],
    }  # fmt: skip
    if deformation is None:
        expected |= {"volume_ratio": [ratio], "step_extremes": [ratio, ratio, abs(trace), (0.0625 * velocity**2).sum()]}
    else:
        f = (np.eye(3) + 0.25 * a) @ deformation.reshape(3, 3)
        expected |= {"deformation": f.reshape(1, 9), "volume_ratio": [np.linalg.det(f)]}
    return Exact(case, inputs, expected)


DEFORMED = np.array([[1.0, 0.25, 0.0, 0.0, 1.0, 0.0, 0.5, 0.0, 2.0]])
# A = G, v = c + G x, J = 3/2 (1 + dt tr G), x + dt v; F = (1 + dt G) F
closed_form("mpm.grid_to_particle", over=(2, 3), affine_field=lambda dim: _taken(dim, None))
closed_form("mpm.grid_to_particle", deformed=lambda: _taken(3, DEFORMED))


@closed_form("mpm.grid_to_carriers")
def affine_field_about_a_carrier():
    """sum B v = c + G x_q, sum B v (x_j - x_q)^T = (h^2/4) G = G, h = 2 m."""
    case, inputs = _pair()
    v = np.array([1.0, -2.0, 0.5]) + 2.0 * node_table(inputs["grid"].blocks) @ TURN.T
    inputs["node_velocity"] = v
    velocity = np.array([1.0, -2.0, 0.5]) + inputs["carrier_position"] @ TURN.T
    return Exact(case, inputs, {"carrier_moment": np.hstack([velocity, np.tile(TURN.ravel(), (2, 1))])})


@closed_form("mpm.viscosity")
def sheared_cluster():
    """dt J factor = 1/4 * 3/2 * 2/3 = 1/4; A - (A + A^T) E^-1/4 with E^-1 = diag(3/11, 1, 1)."""
    case, inputs = _pair()
    inputs |= {"volume_ratio": [1.5], "viscous_stress": mpm.ViscousStress(2 / 3), "timestep": [0.0, 0.25]}
    inputs["affine"] = np.array([[1.0, 4.0, 0.0, 0.0, -2.0, 1.0, 3.0, 1.0, 0.0]])
    share = np.array([3 / 11, 1, 1]) / 4
    strain = np.array([[2.0, 4.0, 3.0], [4.0, -4.0, 2.0], [3.0, 2.0, 0.0]])
    after = inputs["affine"].reshape(3, 3) - strain * share
    return Exact(case, inputs, {"affine": after.reshape(1, 9)})


@closed_form("mpm.count")
def counted_alone():
    """A particle of 6 kg on a node, J = 3/2, in cells of 4 kg: sum_j B_j^2 = (13/32 + 3/16)^2 = (19/32)^2 of 6 kg."""
    case, grid, background = alone(2)
    inputs = {
        "grid": grid, "background": background, "volume_ratio": [1.5], "node_mass": 6 * weight_of(grid),
        "counting": mpm.Counting(4.0),
    }  # fmt: skip
    q = np.array([1.5 * 6 / 4 * (19 / 32) ** 2])
    return Exact(case, inputs, {"crowding": q, "greatest_crowding": q})
