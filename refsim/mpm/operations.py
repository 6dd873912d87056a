"""The transfers' operations: which equations make each, over all pairs in float64.

Nodes are those of `grid`, numbered by its blocks; each sum runs over all of them. The size of a spline holds its change
by the rounding of the particle's position in its cell.
"""

import numpy as np

from refsim.core.operation import operations, without
from refsim.core.terms import Terms, certain, trace
from refsim.mpm import reference as ref
from refsim.neighbours.sums import Fields, Pairs
from refsim.sparse_grid.reference import Lookup, node_table
from refsim.sph.operations import carried
from refsim.surface_energy.reference import spline, spline_derivative

BLOCK_BYTES = 2**26
FARTHEST = 2**20 - 16
CLUSTER, THESIS, CORRECTED = 1, 2, 3
SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # where (a, b) stands in (xx, xy, xz, yy, yz, zz)
UPPER = (0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2)

operation = operations(
    paper="thesis on reconstructed-surface tension in MPM",
    cases="on_nodes on_nodes_2d many_in_a_cell one_in_each_block near_the_last_cell",
)
_EMBEDDED = "cluster_share inverse_spread embedding"
_LONE = f"{_EMBEDDED} carrier_first carrier_position carrier_moment build_position position_residual"
_TRANSFERS = {"cpu": "transfers", "cuda": "transfers"}
_SUMS = "a few roundings for each of place, weights and field, and a sum over the 27 nodes or some ten points"


def _f(array):
    return np.asarray(array, dtype=float)


def _dim(background):
    return 3 if background.layers == 3 else 2


def _matrices(values):
    """Matrices from rows of 9, or of 6 for symmetric ones."""
    values = _f(values)
    return Terms(values[:, SYMMETRIC] if values.shape[1] == 6 else values.reshape(-1, 3, 3), rank=2)


def _ones(count):
    """Unit matrices."""
    return Terms(np.broadcast_to(np.eye(3), (count, 3, 3)), rank=2)


def _rows(matrices):
    return Terms(*(part.reshape(len(part), 9) for part in matrices))


def stencils(position, background, grid, centre=None):
    """(p, j, pj): pairs of a point and a node within one and a half cells along each axis, by comparing all.

    centre  of the points' velocity fields (n, 3) [m], by default their positions
    """
    x, nodes, h, dim = _f(position), node_table(grid.blocks), float(background.cell_size), _dim(background)
    pairs, step = [np.zeros((2, 0), int)], max(1, BLOCK_BYTES // (64 * max(len(nodes), 1)))
    for first in range(0, len(x), step):
        axes = zip(x[first : first + step, :dim].T / h, nodes.T)
        near = np.logical_and.reduce([np.abs(np.subtract.outer(u, j)) < 1.5 + 1e-6 for u, j in axes])
        pairs.append(np.argwhere(near).T + [[first], [0]])
    p, j = np.concatenate(pairs, axis=1)
    arm = h * nodes[j] - x[p]
    arm[:, dim:] = 0.0
    finer = np.finfo(float).eps / np.finfo(np.asarray(background.cell_size).dtype).eps  # in which differences are taken
    unsure = 2 + finer * np.abs(x[p]) / h
    b, s = spline(-arm / h), spline_derivative(-arm / h)
    wide, steep = b + unsure * np.abs(s) + 1e-6, np.abs(s) + unsure
    b[:, dim:], wide[:, dim:], s[:, dim:], steep[:, dim:] = 1, 1, 0, 0
    weight, slope = ref.spline_weight(b), ref.spline_slope(b, s, h)
    size, slope_size = ref.spline_weight(wide), ref.spline_slope(wide, steep, h)
    arm = arm if centre is None else arm + (x - _f(centre))[p]
    pj = Fields(weight=Terms(weight, size), slope=Terms(slope, slope_size, 1), arm=Terms(arm, np.abs(arm) + h, 1))
    return p, j, pj


def nodes_of(position, background, grid, nodes):
    """Sums over the nodes of each point; nodes: their fields."""
    p, j, pj = stencils(position, background, grid)
    return Pairs(Fields(place=np.arange(len(position))), len(position), nodes, p, j, pj)


# The grid


def _base(position, inverse_cell):
    """Base nodes, whether the place is possible, and the margin."""
    cells = _f(position) * inverse_cell
    with np.errstate(invalid="ignore"):
        possible = (np.abs(cells) < FARTHEST).all(1)
    base, margin = ref.base_node(np.where(possible[:, None], cells, 0.0))
    return base.astype(np.int64), possible, np.where(possible[:, None], margin, np.nan)


def find_cells(position, inverse_cell, blocks, complete, cell):
    """Write the points' cells; (points outside all blocks, points too far away or NaN)."""
    dim = 3 if blocks.neighbour.shape[1] == 27 else 2
    base, possible, _ = _base(_f(position)[:, :dim], inverse_cell)
    coordinates = np.zeros((len(base), 3), np.int64)
    coordinates[:, :dim] = base
    number = Lookup(blocks)(coordinates)
    held = (number >= 0) & possible
    held[held] = np.asarray(complete)[number[held] // 64] > 0
    cell[...] = np.where(held, number, -1)
    return int((possible & ~held).sum()), int((~possible).sum())


def block_keys(position, inverse_cell, dim):
    """Keys (n,) of the points' blocks, -1 for points too far away or NaN."""
    base, possible, _ = _base(_f(position)[:, :dim], inverse_cell)
    width = 4 if dim == 3 else 8
    key = sum((base[:, c] // width + 2**20) * 2 ** (21 * c) for c in range(dim))
    return np.where(possible, key + (2**20 * 2**42 if dim == 2 else 0), -1)


def sorted_bins(cell, blocks):
    """First place of each cell and the points by cell; unused by the references."""
    order = np.argsort(cell, kind="stable").astype(np.int32)
    return np.searchsorted(np.asarray(cell)[order], np.arange(64 * blocks + 1)).astype(np.int32), order


@operation(
    "base node floor(x/h - 1/2)", outputs="cell", exact="cell", optional="carrier_position surface_sample",
    reason="the position on the grid is computed in float64 with two roundings",
    programs={"cpu": "sorting", "cuda": "sorting_cuda"},
)  # fmt: skip
def cells(position, carrier_position, surface_sample, grid):
    """Number of the base node j = floor(x/h - 1/2) of each particle (n,), and its margin, dimensionless."""
    cell = np.empty(len(position), np.int32)
    grid.locate((position, carrier_position, surface_sample), cell, find_cells, block_keys, sorted_bins)
    return {"cell": (cell, _base(_f(position)[:, : grid.dim], grid.inverse_cell)[2].min(1))}


# From particles to nodes


def _stress(mass, volume_ratio, liquid):
    """What (4.17) takes of particles, with what was printed (thesis M3, M4)."""
    ratio, mass = _f(volume_ratio), _f(mass)
    volume = np.ones_like(mass) if liquid.unit_volume else mass / float(liquid.rest_density)
    dilation = np.ones_like(ratio) if liquid.linear_stress else ratio
    p = Fields(volume_ratio=ratio, rest_volume=volume, dilation=dilation)
    return ref.stress_of(p, float(liquid.stress))


def _transferred(pairs, grid, timestep, force, **fields):
    """Masses and momenta on the nodes, with the impulse of the liquid's stress where it acts through these points."""
    p, j, pj = pairs
    order = np.argsort(j, kind="stable")
    at_nodes = Pairs(Fields(), grid.nodes, Fields(**fields), j[order], p[order], pj.at(order))

    def momentum(j, p, jp, dt):
        momentum = ref.node_momentum(j, p, jp)
        momentum = momentum if force is None else momentum + dt * force(j, p, jp)
        reached = (jp.weight.value > 0)[:, None]  # a NaN stays within its stencil
        return Terms(np.where(reached, momentum.value, 0.0), momentum.size, 1)

    return {"node_mass": at_nodes(ref.node_mass), "node_momentum": at_nodes(momentum, dt=timestep[1])}


def _pushed(velocity, acceleration, timestep):
    """Velocity [m/s] after the kick by the forces of other effects."""
    return _f(velocity) if acceleration is None else _f(velocity) + float(timestep[1]) * _f(acceleration)


@operation(
    "(4.10), (4.15), (4.17) with thesis M3, M4, M6", outputs="node_mass node_momentum", entrywise=True,
    variants=(
        f"{_EMBEDDED} acceleration kernel_gradient", "kernel_gradient",
        without("acceleration", embedding="as_printed"), f"{_EMBEDDED} acceleration",
    ),
    tolerance=32.0, reason=_SUMS, invariants="reordering",
    programs=_TRANSFERS,
)  # fmt: skip
def particle_to_grid(
    position, velocity, mass, affine, volume_ratio, acceleration, liquid, background, timestep, cluster_share,
    inverse_spread, embedding, kernel_gradient, grid,
):  # fmt: skip
    """m_j [kg] and (mv)_j [kg m/s] of the particles' own points, with the impulse dt f_j of the liquid's stress."""
    clustered = cluster_share is not None and embedding.reading == CLUSTER
    p = Fields(mass=mass, share=np.ones(len(mass)) if cluster_share is None else cluster_share)
    inverse = _matrices(inverse_spread) if clustered else _ones(len(mass))
    stress = _stress(mass, volume_ratio, liquid)
    return _transferred(
        stencils(position, background, grid), grid, timestep,
        ref.stress_force if kernel_gradient is None else ref.printed_stress_force, mass=ref.split_mass(p),
        velocity=_pushed(velocity, acceleration, timestep), affine=_matrices(affine),
        stress=stress * p.share if clustered else stress,
        inverse_moment=ref.inverse_moment(inverse, float(background.cell_size)),
    )  # fmt: skip


@operation(
    "(4.15)", adds="node_mass node_momentum", entrywise=True,
    variants=(without("acceleration", embedding="as_printed"), ""), tolerance=32.0, reason=_SUMS,
    programs=_TRANSFERS,
)  # fmt: skip
def carriers_to_grid(
    carrier_position, carrier_owner, position, velocity, mass, affine, volume_ratio, acceleration, liquid, background,
    timestep, cluster_share, inverse_spread, embedding, grid,
):  # fmt: skip
    """m_j [kg], (mv)_j [kg m/s] of the embedded points, about their particle; as printed about each, without stress."""
    owner, clustered = np.asarray(carrier_owner), embedding.reading == CLUSTER
    p = Fields(mass=mass, share=cluster_share)
    pairs = stencils(carrier_position, background, grid, _f(position)[owner] if clustered else None)
    return _transferred(
        pairs, grid, timestep, ref.stress_force if clustered else None, mass=ref.split_mass(p).at(owner),
        velocity=_pushed(velocity, acceleration, timestep)[owner], affine=_matrices(affine).at(owner),
        stress=(_stress(mass, volume_ratio, liquid) * p.share).at(owner),
        inverse_moment=ref.inverse_moment(_matrices(inverse_spread).at(owner), float(background.cell_size)),
    )  # fmt: skip


# On the nodes


@operation(
    "(4.11), (4.19), and the walls", outputs="node_velocity",
    variants=("node_pull field planes", {"planes": "wide_domain"}),
    reason="one rounding in each of quotient, product and sum",
)  # fmt: skip
def grid_update(node_mass, node_momentum, node_pull, field, planes, background, timestep, grid):
    """v_j after forces and walls [m/s]."""
    nothing = np.zeros_like(_f(node_momentum))
    j = Fields(mass=node_mass, momentum=node_momentum, force=nothing if node_pull is None else node_pull)
    gravity = Terms(nothing if field is None else _f(field)[None], rank=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        v = ref.node_velocity(j, float(timestep[1]), float(background.least_mass), gravity)
    v.value[ref.slow(v.value, float(background.least_speed))] = 0.0
    if planes is not None:
        _hold(v.value, planes, node_table(grid.blocks))
    return {"node_velocity": v}


def _hold(v, planes, j):
    """Set to zero what the walls stop of the velocities of their nodes."""
    stuck = np.zeros(len(j), dtype=bool)
    for face in np.flatnonzero(planes.rules):
        c, inward, rule = face // 2, 1 - 2 * (face % 2), int(planes.rules[face])  # the liquid lies above if inward = 1
        plane = int((planes.lower if inward > 0 else planes.upper)[c])
        inside = ref.mirrored(j[:, c], plane, inward)[1] >= 0
        stuck |= inside & (rule == ref.STICKY)
        v[inside & ref.stopped(v[:, c], inward, rule), c] = 0.0
    v[stuck] = 0.0


# From nodes to particles


def _moments(position, background, grid, node_velocity):
    """(4.12), (4.13) of each point, before D_p: sum_j B v_j and sum_j B v_j (x_j - x)^T."""
    around = nodes_of(position, background, grid, Fields(velocity=node_velocity))
    return around(ref.gathered_velocity), around(ref.gathered_moment)


@operation(
    "(4.14): moments of the embedded points", outputs="carrier_moment", entrywise=True, tolerance=32.0, reason=_SUMS,
    programs=_TRANSFERS,
)  # fmt: skip
def grid_to_carriers(node_velocity, carrier_position, background, grid):
    """v = sum_j B v_j [m/s] and sum_j B v_j (x_j - x_q)^T [m^2/s], row by row, of every embedded point."""
    v, m = _moments(carrier_position, background, grid, node_velocity)
    return {"carrier_moment": Terms(*(np.hstack(parts) for parts in zip(v, _rows(m))))}


def _cluster(v, moment, x, share, first, carrier_position, carrier_moment, reading):
    """v_p and sum_j B v_j (x_j - x_p)^T of a particle with its embedded points."""
    rows, count = np.repeat(np.arange(len(x)), np.diff(first)), first[-1]
    values, arm = _f(carrier_moment)[:count], _f(carrier_position)[:count] - x[rows]
    q = Fields(velocity=values[:, :3], moment=_matrices(values[:, 3:]))
    points = Pairs(Fields(), len(x), q, rows, np.arange(count), Fields(arm=arm))
    about = points((lambda p, q, pq: q.moment) if reading == CORRECTED else ref.moment_about_the_particle)
    return share * (v + points(lambda p, q, pq: q.velocity)) if reading == CLUSTER else v, share * (moment + about)


@operation(
    "(4.8), (4.12), (4.13), (4.16) with thesis M5, M9, M10",
    outputs="displacement step_extremes velocity affine volume_ratio deformation position_residual position",
    variants=(
        f"{_LONE} deformation", "deformation position_residual", without("build_position", embedding="as_printed"),
        without("deformation build_position", embedding="corrected"), _LONE,
    ),
    tolerance=48.0, reason=_SUMS, programs=_TRANSFERS,
)  # fmt: skip
def grid_to_particle(
    node_velocity, liquid, background, timestep, cluster_share, inverse_spread, embedding, carrier_first,
    carrier_position, carrier_moment, build_position, grid, volume_ratio, deformation, position_residual, position,
):  # fmt: skip
    """Velocity [m/s], A [1/s], J, F and position [m] of every particle after the step; as printed (4.14)."""
    step, h, x = float(timestep[1]), float(background.cell_size), _f(position)
    v, moment = _moments(position, background, grid, node_velocity)
    inverse = _ones(len(x))
    if cluster_share is not None:
        points = np.asarray(carrier_first), carrier_position, carrier_moment, embedding.reading
        v, moment = _cluster(v, moment, x, Terms(cluster_share), *points)
        inverse = _matrices(inverse_spread) if embedding.reading == CLUSTER else inverse
    a = ref.velocity_gradient(moment, ref.inverse_moment(inverse, h))
    p, time, answer = Fields(affine=a, volume_ratio=volume_ratio), 1.0 if liquid.timeless else step, {}
    if deformation is None:
        ratio = ref.advanced_ratio(p, time)
    else:
        new, ratio = ref.advanced_deformation(Fields(affine=a, deformation=_matrices(deformation)), time)
        answer["deformation"] = _rows(new)
    drift, answer["position"] = step * v, ref.advected(Terms(x, rank=1), v, step)
    if position_residual is not None:
        parts = carried(position, position_residual, *drift)
        answer["position"], answer["position_residual"] = (Terms(*part, 1) for part in parts)
    if build_position is not None:
        drift = Terms(answer["position"].value - _f(build_position), np.abs(x) + drift.size, 1)
    squared = np.where(np.isfinite(ratio.value), (drift.value**2).sum(1), np.inf)
    far = ((np.abs(drift.value) + drift.size) ** 2).sum(1)
    least, most = (f(ratio.value) if len(x) else 1.0 for f in (np.min, np.max))
    rates, steps = trace(a), step**2 * (v @ v)
    values = least, most, np.abs(rates.value).max(initial=0), steps.value.max(initial=0)
    sizes = [part.size.max(initial=0) for part in (ratio, ratio, rates, steps)]
    return answer | {
        "displacement": ([squared.max(initial=0), 0.0, 0.0], [far.max(initial=0), 0.0, 0.0]),
        "step_extremes": (values, sizes), "velocity": v, "affine": _rows(a), "volume_ratio": ratio,
    }  # fmt: skip


@operation(
    "embedded points and their D_p, with thesis M11, M12",
    outputs="carrier_first carrier_position carrier_owner cluster_share inverse_spread",
    exact="carrier_first carrier_owner", entrywise="carrier_position", tolerance=16.0,
    reason="a few roundings for each product, and twenty in the inverse of a matrix whose entries are at most one",
    programs={"cuda": "sorting_cuda"},
)  # fmt: skip
def embed(position, surface_sample, sample_owner, background):
    """Points x_s and x_o by owner p [m], w, and E_p^-1 as (xx, xy, xz, yy, yz, zz), dimensionless."""
    x, s, p = _f(position), _f(surface_sample), np.asarray(sample_owner)
    order, count = np.argsort(p, kind="stable"), np.bincount(p, minlength=len(x))
    owner, w = np.repeat(p[order], 2), ref.share_of(Terms(count))
    images, points = ref.mirror_image(Fields(position=x).at(p), Fields(position=s)), np.empty((2 * len(s), 3))
    points[0::2], points[1::2] = s[order], images.value[order]
    around = Pairs(Fields(share=w), len(x), Fields(), owner, np.arange(len(owner)), Fields(arm=points - x[owner]))
    e = around(ref.spread, h=background.cell_size)
    # An error e of E changes E^-1 by E^-1 e E^-1, and all entries of E^-1 are at most one.
    bound = (1 + e.size.sum((1, 2)))[:, None] * np.ones(6)
    return {
        "carrier_first": certain(np.concatenate([[0], 2 * np.cumsum(count)])), "carrier_owner": certain(owner),
        "carrier_position": (points, np.abs(points) + np.abs(x[owner])), "cluster_share": w,
        "inverse_spread": (np.linalg.inv(np.eye(3) + e.value)[(..., *UPPER)], bound),
    }  # fmt: skip


# Beside the thesis


@operation(
    "none in the thesis; stress mu (A + A^T) through (4.10)", outputs="affine", entrywise=True,
    optional="inverse_spread", tolerance=16.0,
    reason="a few roundings for each sum, product and the product of two matrices", invariants="reordering",
)  # fmt: skip
def viscosity(volume_ratio, inverse_spread, viscous_stress, timestep, affine):
    """A after the step's viscous stress [1/s], row by row; E = 1 without embedded points."""
    inverse = _ones(1) if inverse_spread is None else _matrices(inverse_spread)
    p = Fields(affine=_matrices(affine), volume_ratio=volume_ratio, inverse_spread=inverse)
    return {"affine": _rows(ref.viscosity(p, float(viscous_stress.factor), float(timestep[1])))}


@operation(
    "none in the thesis; J sum_j B_j(x_p) m_j/(rho0 h^d), m_j of 4.2.4", outputs="greatest_crowding crowding",
    tolerance=32.0, reason=_SUMS, invariants="reordering",
)  # fmt: skip
def count(position, volume_ratio, node_mass, background, counting, grid):
    """q_p, dimensionless, and the largest."""
    around = nodes_of(position, background, grid, Fields(mass=node_mass))
    q = Terms(volume_ratio) * around(ref.counted_density, cell_mass=counting.cell_mass)
    greatest = np.where(np.isnan(q.value), np.inf, q.value).max(initial=0.0)
    return {"greatest_crowding": ([greatest], [q.size.max(initial=0.0)]), "crowding": q}
