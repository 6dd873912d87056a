"""NumPy oracle of the transfers: every particle against every node, float64.

Nodes are those of `grid`, numbered by its blocks; each sum runs over all of them, with the spline B(u) = 3/4 - u^2 for
|u| < 1/2 and 1/2 (3/2 - |u|)^2 for |u| < 3/2. Scales are sums of absolute terms, in which each weight includes its
change by the rounding of a particle's position in its cell.
"""

import numpy as np

from refsim.core.operation import operations, without
from refsim.sparse_grid.reference import Lookup, node_table
from refsim.sph.reference import carried
from refsim.surface_energy.reference import spline, spline_derivative

BLOCK_BYTES = 2**26
FARTHEST = 2**20 - 16
CLUSTER, THESIS, CORRECTED = 1, 2, 3
STICKY, SLIP, SEPARATING = 1, 2, 3
ROWS_BEHIND = 3  # of nodes behind a mirror that the liquid may reach
SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # where (a, b) stands in (xx, xy, xz, yy, yz, zz)

operation = operations(
    paper="thesis on reconstructed-surface tension in MPM",
    cases="on_nodes on_nodes_2d many_in_a_cell one_in_each_block near_the_last_cell",
)
_EMBEDDED = "cluster_share inverse_spread embedding"
_LONE = f"{_EMBEDDED} carrier_first carrier_position carrier_moment build_position position_residual"
_SUMS = "a few roundings for each of place, weights and field, and a sum over the 27 nodes or some ten points"


def _f(array):
    return np.asarray(array, dtype=float)


class Stencils:
    """All pairs of a point and a node within one and a half cells along each axis, found by comparing all with all.

    position (n, 3) [m]; nodes (N, 3) integer coordinates; h [m]
    p, j             numbers of the pairs' points and nodes
    weight, scale    B_j(x_p) and its scale
    slope, steep     h grad B_j(x_p) (pairs, 3) and its scale
    arm              x_j - x_p (pairs, 3) [m]
    """

    def __init__(self, position, nodes, background):
        self.position, self.nodes = _f(position), nodes
        self.h = float(background.cell_size)
        axes = range(3 if background.layers == 3 else 2)
        rows, columns = [np.zeros(0, int)], [np.zeros(0, int)]
        step = max(1, BLOCK_BYTES // (64 * max(len(nodes), 1)))
        for first in range(0, len(self.position), step):
            x = self.position[first : first + step]
            near = np.ones((len(x), len(nodes)), dtype=bool)
            for c in axes:
                near &= np.abs(x[:, None, c] / self.h - nodes[None, :, c]) < 1.5 + 1e-6
            point, node = np.nonzero(near)
            rows.append(point + first)
            columns.append(node)
        self.p, self.j = np.concatenate(rows), np.concatenate(columns)
        self.arm = self.h * nodes[self.j] - self.position[self.p]
        self.arm[:, len(axes) :] = 0.0
        rounding = np.finfo(float).eps / np.finfo(np.asarray(background.cell_size).dtype).eps
        shape = (len(self.p), 3)
        b, wide = np.ones(shape), np.ones(shape)
        s, steep = np.zeros(shape), np.zeros(shape)
        for c in axes:
            u = -self.arm[:, c] / self.h
            unsure = 2 + rounding * np.abs(self.position[self.p, c]) / self.h
            b[:, c], s[:, c] = spline(u), spline_derivative(u)
            wide[:, c] = b[:, c] + unsure * np.abs(s[:, c]) + 1e-6
            steep[:, c] = np.abs(s[:, c]) + unsure
        self.weight, self.scale = b.prod(1), wide.prod(1)
        others = ([1, 2], [0, 2], [0, 1])
        self.slope = np.stack([s[:, c] * b[:, others[c]].prod(1) for c in range(3)], axis=-1)
        self.steep = np.stack([steep[:, c] * wide[:, others[c]].prod(1) for c in range(3)], axis=-1)

    def on_nodes(self, values):
        """Sums (N, ...) over the points of each node."""
        return _sums(values, self.j, len(self.nodes))

    def on_points(self, values):
        """Sums (n, ...) over the nodes of each point."""
        return _sums(values, self.p, len(self.position))


def _sums(values, owner, count):
    flat = values.reshape(len(values), int(np.prod(values.shape[1:])))
    columns = [np.bincount(owner, weights=flat[:, k], minlength=count) for k in range(flat.shape[1])]
    return np.stack(columns, axis=-1).reshape(count, *values.shape[1:])


def _base(position, inverse_cell):
    """floor(x/h - 1/2), and how far from flipping it is."""
    with np.errstate(invalid="ignore"):
        halves = _f(position) * (2 * inverse_cell)
        possible = (np.abs(halves) < 2 * FARTHEST).all(1)
    whole = np.floor(np.where(possible[:, None], halves, 0.0))
    base = np.floor((whole - 1) / 2)
    margin = np.minimum(halves / 2 - 0.5 - base, base + 1.5 - halves / 2)
    return base.astype(np.int64), possible, margin


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
    sets = {"particles": position, "carriers": carrier_position, "samples": surface_sample}
    grid.locate(sets, cell, find_cells, block_keys, sorted_bins)
    margin = _base(_f(position)[:, : grid.dim], grid.inverse_cell)[2].min(1)
    return {"cell": (cell.astype(float), margin)}


@operation(
    "quadratic B-spline, (3.16) with thesis M19", outputs="base_node spline_weight spline_slope", exact="base_node",
    tolerance=8.0, reason="one rounding of the position in the cell, and a few of the polynomial",
    invariants="reordering",
)  # fmt: skip
def weights(position, background):
    """Base node j = floor(x/h - 1/2), and B and h B' at j, j + 1, j + 2 along each axis, dimensionless."""
    x = _f(position) * background.inverse_cell
    base, _, margin = _base(position, background.inverse_cell)
    u = x[:, :, None] - (base[:, :, None] + np.arange(3))
    sure = 1 + np.finfo(float).eps / np.finfo(np.asarray(background.cell_size).dtype).eps * np.abs(x)
    shape = (len(x), 9)
    unsure = np.repeat(2 * sure, 3, axis=1)
    value, slope = spline(u).reshape(shape), spline_derivative(u).reshape(shape)
    return {
        "base_node": (base, margin),
        "spline_weight": (value, value + unsure),
        "spline_slope": (slope, np.abs(slope) + unsure),
    }


def _stress_moment(ratio, mass, liquid, step):
    """(4.17): K_p = dt V0 lambda (J - 1) J [J s], and its scale."""
    ratio, mass = _f(ratio), _f(mass)
    volume = np.ones_like(mass) if liquid.unit_volume else mass / float(liquid.rest_density)
    factor = np.ones_like(ratio) if liquid.linear_stress else ratio
    front = step * float(liquid.stress) * volume * factor
    return front * (ratio - 1), np.abs(front) * (np.abs(ratio) + 1)


def _matrices(values):
    """(n, 3, 3) from rows of 9, or of 6 for symmetric ones."""
    values = _f(values)
    return values[:, SYMMETRIC] if values.shape[1] == 6 else values.reshape(-1, 3, 3)


def _spread(stencils, mass, field, gradient, centre):
    """Sum over points of B (mass, field + gradient (x_j - centre)) on the nodes, and sum of its absolute terms."""
    p = stencils.p
    arm = stencils.arm + (stencils.position - centre)[p]
    terms = np.einsum("kab,kb->ka", gradient[p], arm)
    sizes = np.einsum("kab,kb->ka", np.abs(gradient[p]), np.abs(arm) + stencils.h)
    columns = np.hstack([mass[p][:, None], field[p] + terms])
    bounds = np.hstack([mass[p][:, None], np.abs(field[p]) + sizes])
    reached = stencils.weight > 0  # a NaN stays within its stencil
    total = np.where(reached[:, None], stencils.weight[:, None] * columns, 0.0)
    return stencils.on_nodes(total), stencils.on_nodes(stencils.scale[:, None] * bounds)


def _nodes(total, bound):
    return {"node_mass": (total[:, 0], bound[:, 0]), "node_momentum": (total[:, 1:], bound[:, 1:])}


def _pushed(velocity, acceleration, timestep):
    """Velocity [m/s] after the kick by the forces of other effects."""
    velocity = _f(velocity)
    return velocity if acceleration is None else velocity + float(timestep[1]) * _f(acceleration)


@operation(
    "(4.10), (4.15), (4.17) with thesis M3, M4, M6", outputs="node_mass node_momentum", entrywise=True,
    optional=f"acceleration {_EMBEDDED} kernel_gradient",
    variants=(
        f"{_EMBEDDED} acceleration kernel_gradient", "kernel_gradient",
        without("acceleration", embedding="as_printed"), f"{_EMBEDDED} acceleration",
    ),
    tolerance=32.0, reason=_SUMS, invariants="reordering",
    programs={"cpu": "particle_to_grid", "cuda": "particle_to_grid_cuda"},
)  # fmt: skip
def particle_to_grid(
    position, velocity, mass, affine, volume_ratio, acceleration, liquid, background, timestep, cluster_share,
    inverse_spread, embedding, kernel_gradient, grid,
):  # fmt: skip
    """m_j [kg] and (mv)_j [kg m/s] with the impulse of the liquid's stress.

    (4.10), (4.15) (mv)_j = sum_p m_p B_j(x_p) (v_p + A_p (x_j - x_p)); MLS force
    dt f_j = -sum_p K_p B_j(x_p) D_p^-1 (x_j - x_p), or (4.17) as printed, -sum_p K_p grad B_j(x_p) (thesis M6).
    """
    mass, h = _f(mass), float(background.cell_size)
    stencils = Stencils(position, node_table(grid.blocks), background)
    moment, moment_scale = _stress_moment(volume_ratio, mass, liquid, float(timestep[1]))
    own = mass.copy()
    inverse = np.broadcast_to(np.eye(3), (len(mass), 3, 3))
    if cluster_share is not None:
        own *= _f(cluster_share)
        if embedding.reading == CLUSTER:
            moment, moment_scale = moment * _f(cluster_share), moment_scale * _f(cluster_share)
            inverse = _matrices(inverse_spread)
    v = _pushed(velocity, acceleration, timestep)
    gradient = own[:, None, None] * _matrices(affine)
    pressure = (4 / h**2) * moment[:, None, None] * inverse
    pressure_scale = (4 / h**2) * moment_scale[:, None, None] * np.abs(inverse)
    if kernel_gradient is not None:
        pressure = pressure_scale = np.zeros_like(pressure)
    centre = stencils.position
    total, _ = _spread(stencils, own, own[:, None] * v, gradient - pressure, centre)
    _, bound = _spread(stencils, own, own[:, None] * np.abs(v), np.abs(gradient) + pressure_scale, centre)
    if kernel_gradient is not None:
        total[:, 1:] -= stencils.on_nodes(moment[stencils.p][:, None] * stencils.slope / h)
        bound[:, 1:] += stencils.on_nodes(moment_scale[stencils.p][:, None] * stencils.steep / h)
    return _nodes(total, bound)


@operation(
    "(4.15)", adds="node_mass node_momentum", entrywise=True, optional="acceleration",
    variants=(without("acceleration", embedding="as_printed"), ""), tolerance=32.0, reason=_SUMS,
    programs={"cpu": "particle_to_grid", "cuda": "particle_to_grid_cuda"},
)  # fmt: skip
def carriers_to_grid(
    carrier_position, carrier_owner, position, velocity, mass, affine, volume_ratio, acceleration, liquid, background,
    timestep, cluster_share, inverse_spread, embedding, grid,
):  # fmt: skip
    """Contribution of the embedded points: m_j [kg], (mv)_j [kg m/s].

    (mv)_j += sum_q w m_p B_j(x_q) (v_p + A_p (x_j - x_p)) - w K_p B_j(x_q) D_p^-1 (x_j - x_p); (4.15)
    as in the thesis has x_q in the first term and no second one.
    """
    h, p = float(background.cell_size), np.asarray(carrier_owner)
    stencils = Stencils(carrier_position, node_table(grid.blocks), background)
    mass, share = _f(mass), _f(cluster_share)
    own = (mass * share)[p]
    v = _pushed(velocity, acceleration, timestep)[p]
    gradient = own[:, None, None] * _matrices(affine)[p]
    centre, size = stencils.position, np.abs(gradient)
    if embedding.reading == CLUSTER:
        moment, moment_scale = _stress_moment(volume_ratio, mass, liquid, float(timestep[1]))
        inverse = _matrices(inverse_spread)[p]
        gradient = gradient - (4 / h**2) * (moment * share)[p][:, None, None] * inverse
        size = size + (4 / h**2) * (moment_scale * share)[p][:, None, None] * np.abs(inverse)
        centre = _f(position)[p]
    total, _ = _spread(stencils, own, own[:, None] * v, gradient, centre)
    _, bound = _spread(stencils, own, own[:, None] * np.abs(v), size, centre)
    return _nodes(total, bound)


def _reflected(j, planes):
    """Every node j (n, 3) as the image of one on the liquid's side: (coordinates of those (n, 3), signs (n, 3) of the
    velocity, whether the liquid may reach node j (n,), which components of the velocity are zero (n, 3)).

    A slip or separating face reverses the normal component, a sticky one all.
    """
    place, sign, there = j.copy(), np.ones(j.shape), np.ones(len(j), dtype=bool)
    faces = [
        (c, int(plane[c]), inward, int(planes.rules[2 * c + side]))
        for c in range(3)
        for side, (plane, inward) in enumerate(((planes.lower, 1), (planes.upper, -1)))
        if planes.rules[2 * c + side]
    ]
    for c, plane, inward, rule in faces:
        depth = inward * (plane - j[:, c])
        hidden = depth > 0
        place[hidden, c] = 2 * plane - j[hidden, c]
        turned = np.ones(3) if rule == STICKY else np.arange(3) == c
        sign[hidden] *= np.where(turned, -1, 1)
        there &= depth <= ROWS_BEHIND
    still, flat = np.zeros(len(j), dtype=bool), np.zeros(j.shape, dtype=bool)
    for c, plane, _, rule in faces:
        on = place[:, c] == plane
        flat[on, c] = True
        still |= on & (rule == STICKY)
    return place, sign, there, still[:, None] | flat


def _with_images(mass, momentum, size, planes, blocks):
    """Masses, momenta and scales of nodes with those of their images, in the frame of the node on the liquid's side;
    signs of a velocity from there to the node, and which components are zero."""
    place, sign, there, none = _reflected(node_table(blocks), planes)
    _, group = np.unique(place, axis=0, return_inverse=True)
    group = group.ravel()
    count = group.max(initial=-1) + 1
    whole = np.bincount(group[there], mass[there], count)

    def added(values):
        return np.stack([np.bincount(group[there], values[there, c], count) for c in range(3)], axis=1)[group]

    return np.where(there, whole[group], 0.0), added(sign * momentum), added(size), sign, none


@operation(
    "(4.11), (4.19), and the walls", outputs="node_velocity", optional="node_pull field planes mirrors",
    variants=("node_pull field planes mirrors", "mirrors", {"planes": "wide_domain"}),
    reason="one rounding in each of quotient, product and sum, the sum of a node and its images",
)  # fmt: skip
def grid_update(node_mass, node_momentum, node_pull, field, planes, mirrors, background, timestep, grid):
    """(4.19) v_j = ((mv)_j + dt f_j)/m_j + dt g [m/s], f the surface's force, and the walls.

    Nodes with at most `least_mass` have v = 0. With mirrors, masses, momenta and forces of a node's images are added to
    its own, and a node behind a wall moves as the image of that in front of it.
    """
    mass, momentum = _f(node_mass), _f(node_momentum)
    size = np.abs(momentum)
    if node_pull is not None:
        pull = float(timestep[1]) * _f(node_pull)
        momentum, size = momentum + pull, size + np.abs(pull)
    sign, none = 1.0, None
    if mirrors is not None:
        mass, momentum, size, sign, none = _with_images(mass, momentum, size, planes, grid.blocks)
    heavy = mass > float(background.least_mass)
    with np.errstate(divide="ignore", invalid="ignore"):
        v = np.where(heavy[:, None], momentum / mass[:, None], 0.0)
        scale = np.where(heavy[:, None], size / mass[:, None], 0.0)
    if field is not None:
        push = np.where(heavy[:, None], float(timestep[1]) * _f(field)[None, :], 0.0)
        v, scale = v + push, scale + np.abs(push)
    if none is not None:
        v[none] = 0.0
    elif planes is not None:
        j = node_table(grid.blocks)
        stuck = np.zeros(len(j), dtype=bool)
        for c in range(3):
            for inside, rule, inward in (
                (j[:, c] <= planes.lower[c], planes.rules[2 * c], -1),
                (j[:, c] >= planes.upper[c], planes.rules[2 * c + 1], 1),
            ):
                stuck |= inside & (rule == STICKY)
                gone = inside & ((rule == SLIP) | ((rule == SEPARATING) & (inward * v[:, c] > 0)))
                v[gone, c] = 0.0
        v[stuck] = 0.0
    return {"node_velocity": (sign * v, scale)}


def _moments(position, background, grid, node_velocity):
    """sum_j B v_j (n, 3) and sum_j B v_j (x_j - x)^T (n, 3, 3), with their scales."""
    stencils = Stencils(position, node_table(grid.blocks), background)
    v, h = _f(node_velocity)[stencils.j], stencils.h
    weight, scale = stencils.weight[:, None], stencils.scale[:, None]
    arm = stencils.arm[:, None, :]
    return (
        stencils.on_points(weight * v),
        stencils.on_points(scale * np.abs(v)),
        stencils.on_points((weight * v)[:, :, None] * arm),
        stencils.on_points((scale * np.abs(v))[:, :, None] * (np.abs(arm) + h)),
    )


@operation(
    "(4.14): moments of the embedded points", outputs="carrier_moment", entrywise=True, tolerance=32.0, reason=_SUMS,
    programs={"cpu": "grid_to_particle", "cuda": "grid_to_particle_cuda"},
)  # fmt: skip
def grid_to_carriers(node_velocity, carrier_position, background, grid):
    """v = sum_j B v_j [m/s] and sum_j B v_j (x_j - x_q)^T [m^2/s], row by row, of every embedded point."""
    v, v_scale, m, m_scale = _moments(carrier_position, background, grid, node_velocity)
    value, bound = (np.hstack([a, b.reshape(len(a), 9)]) for a, b in ((v, m), (v_scale, m_scale)))
    return {"carrier_moment": (value, bound)}


@operation(
    "(4.8), (4.12), (4.13), (4.16) with thesis M5, M9, M10",
    outputs="displacement step_extremes velocity affine volume_ratio deformation position_residual position",
    optional=f"{_EMBEDDED} carrier_first carrier_position carrier_moment build_position deformation position_residual",
    variants=(
        f"{_LONE} deformation", "deformation position_residual", without("build_position", embedding="as_printed"),
        without("deformation build_position", embedding="corrected"), _LONE,
    ),
    tolerance=48.0, reason=_SUMS, programs={"cpu": "grid_to_particle", "cuda": "grid_to_particle_cuda"},
)  # fmt: skip
def grid_to_particle(
    node_velocity, liquid, background, timestep, cluster_share, inverse_spread, embedding, carrier_first,
    carrier_position, carrier_moment, build_position, grid, volume_ratio, deformation, position_residual, position,
):  # fmt: skip
    """Velocity [m/s], A [1/s], J, F and position [m] of every particle after the step.

    (4.12) v_p = sum_j B v_j; (4.13) A_p = (4/h^2) sum_j B v_j (x_j - x_p)^T; in a cluster the weighted
    sums over its points, with D_p^-1; as printed (4.14). (4.16) J <- J (1 + dt tr A) or F <- (1 + dt A) F;
    (4.8) x <- x + dt v, with a residual x + residual, of which the rest of its rounding is the new one.
    """
    step, h, x = float(timestep[1]), float(background.cell_size), _f(position)
    v, v_scale, m, m_scale = _moments(position, background, grid, node_velocity)
    n = len(x)
    inverse = np.broadcast_to(np.eye(3), (n, 3, 3))
    if cluster_share is not None:
        first, share = np.asarray(carrier_first), _f(cluster_share)
        owner = np.repeat(np.arange(n), np.diff(first))
        moment = _f(carrier_moment)[: first[-1]]
        u, own = moment[:, :3], moment[:, 3:].reshape(-1, 3, 3)
        d = _f(carrier_position)[: first[-1]] - x[owner]
        terms, sizes = own, np.abs(own)
        if embedding.reading != CORRECTED:
            terms = own + u[:, :, None] * d[:, None, :]
            sizes = sizes + np.abs(u[:, :, None] * d[:, None, :])
        total, bound, total_v, bound_v = np.array(m), np.array(m_scale), np.array(v), np.array(v_scale)
        np.add.at(total, owner, terms)
        np.add.at(bound, owner, sizes)
        np.add.at(total_v, owner, u)
        np.add.at(bound_v, owner, np.abs(u))
        m, m_scale = share[:, None, None] * total, share[:, None, None] * bound
        if embedding.reading == CLUSTER:
            v, v_scale = share[:, None] * total_v, share[:, None] * bound_v
            inverse = _matrices(inverse_spread)
    a = (4 / h**2) * m @ inverse
    a_scale = (4 / h**2) * m_scale @ np.abs(inverse)
    time = 1.0 if liquid.timeless else step
    trace = np.einsum("paa->p", a)
    ratio = _f(volume_ratio)
    answer = {}
    if deformation is None:
        ratio_new = ratio * (1 + time * trace)
        ratio_scale = np.abs(ratio) * (1 + time * np.einsum("paa->p", a_scale))
    else:
        f = _matrices(deformation)
        new = f + time * a @ f
        new_scale = np.abs(f) + time * a_scale @ np.abs(f)
        ratio_new, ratio_scale = np.linalg.det(new), _permanent(new_scale)
        if liquid.forgets_shear:
            dim = 3 if background.layers == 3 else 2
            with np.errstate(invalid="ignore"):
                root = ratio_new ** (1 / dim)
                root_scale = np.abs(root) * (1 + ratio_scale / np.abs(ratio_new))
            new, new_scale = np.zeros_like(new), np.zeros_like(new)
            for c in range(3):
                new[:, c, c] = root if c < dim else 1.0
                new_scale[:, c, c] = root_scale if c < dim else 1.0
        answer["deformation"] = (new.reshape(n, 9), new_scale.reshape(n, 9))
    least, most = (ratio_new.min(), ratio_new.max()) if n else (1.0, 1.0)
    x_new, x_scale = x + step * v, np.abs(x) + step * v_scale
    if position_residual is not None:
        (x_new, x_scale), answer["position_residual"] = carried(position, position_residual, step * v, step * v_scale)
    shift = x_new - _f(build_position) if build_position is not None else step * v
    squared = np.where(np.isfinite(ratio_new), (shift**2).sum(1), np.inf)
    shift_scale = (np.abs(x) if build_position is not None else 0) + step * v_scale
    far = ((np.abs(shift) + shift_scale) ** 2).sum(1)
    return answer | {
        "displacement": (np.array([squared.max(initial=0), 0.0]), np.array([far.max(initial=0), 0.0])),
        "step_extremes": (
            np.array([least, most, np.abs(trace).max(initial=0), (step**2 * (v**2).sum(1)).max(initial=0)]),
            np.array(
                [
                    ratio_scale.max(initial=0), ratio_scale.max(initial=0), np.einsum("paa->p", a_scale).max(initial=0),
                    4 * (step**2 * (v_scale**2).sum(1)).max(initial=0),
                ],
            ),
        ),
        "velocity": (v, v_scale), "affine": (a.reshape(n, 9), a_scale.reshape(n, 9)),
        "volume_ratio": (ratio_new, ratio_scale), "position": (x_new, x_scale),
    }  # fmt: skip


def _permanent(m):
    """Sum of the absolute terms of a determinant."""
    a = m[:, 0, 0] * (m[:, 1, 1] * m[:, 2, 2] + m[:, 1, 2] * m[:, 2, 1])
    b = m[:, 0, 1] * (m[:, 1, 0] * m[:, 2, 2] + m[:, 1, 2] * m[:, 2, 0])
    return a + b + m[:, 0, 2] * (m[:, 1, 0] * m[:, 2, 1] + m[:, 1, 1] * m[:, 2, 0])


@operation(
    "embedded points and their D_p, with thesis M11, M12",
    outputs="carrier_first carrier_position carrier_owner cluster_share inverse_spread",
    exact="carrier_first carrier_owner", entrywise="carrier_position", tolerance=16.0,
    reason="a few roundings for each product, and twenty in the inverse of a matrix whose entries are at most one",
    programs={"cpu": "embedding", "cuda": "embedding_cuda"},
)  # fmt: skip
def embed(position, surface_sample, sample_owner, background):
    """Points x_s and x_o = 2 x_p - x_s [m] by owner p, w = 1/(2 C_p + 1), and E_p^-1, dimensionless.

    E = 1 + (4/h^2) w sum_q (x_q - x_p)(x_q - x_p)^T, so that D = (h^2/4) E.
    """
    x, s, p = _f(position), _f(surface_sample), np.asarray(sample_owner)
    order = np.argsort(p, kind="stable")
    count = np.bincount(p, minlength=len(x))
    owner = np.repeat(p[order], 2)
    points = np.empty((2 * len(s), 3))
    points[0::2], points[1::2] = s[order], 2 * x[p[order]] - s[order]
    share = 1 / (2 * count + 1)
    spread, size = np.broadcast_to(np.eye(3), (len(x), 3, 3)).copy(), np.zeros((len(x), 3, 3))
    d = points - x[owner]
    d_scale = np.abs(points) + np.abs(x[owner])
    front = (4 / float(background.cell_size) ** 2) * share[owner]
    np.add.at(spread, owner, front[:, None, None] * d[:, :, None] * d[:, None, :])
    np.add.at(size, owner, front[:, None, None] * np.abs(d[:, :, None] * d[:, None, :]))
    inverse = np.linalg.inv(spread)
    # An error e of E changes E^-1 by E^-1 e E^-1, and all entries of E^-1 are at most one.
    bound = (1 + size.sum((1, 2)))[:, None] * np.ones(6)
    six = np.stack([inverse[:, a, b] for a, b in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))], axis=-1)
    first = np.concatenate([[0], 2 * np.cumsum(count)])
    return {
        "carrier_first": (first, np.ones(len(first))), "carrier_position": (points, d_scale),
        "carrier_owner": (owner, np.ones(len(owner))), "cluster_share": (share, share), "inverse_spread": (six, bound),
    }  # fmt: skip


@operation(
    "k_wall = -k cos(theta) at the edge of the wetted area (Young)", adds="node_force", tolerance=8.0,
    reason="splines, products and sum", cases="",
)  # fmt: skip
def contact(sample_position, sample_line, spline_cells, blocks, surface_term, contact):
    """f_j = k cos(theta) sum_s B_j(x_s) l_s [N], added to the force on node j; l_s [m^(d-2)] are the outward normals of
    the edge of the wetted area."""
    j, line = node_table(blocks), _f(sample_line)
    u = _f(sample_position) * float(surface_term.inverse_cell)
    dim = 3 if blocks.neighbour.shape[1] == 27 else 2
    value, scale = np.zeros((len(j), 3)), np.zeros((len(j), 3))
    # a difference in float64 has the rounding error of the position in float64
    far = np.abs(u).max(1, initial=0) * np.finfo(float).eps / np.finfo(np.asarray(sample_position).dtype).eps
    for s in np.flatnonzero((line != 0).any(1)):
        apart = u[s, :dim] - j[:, :dim]
        weight = spline(apart).prod(1)
        # at the edge of its spline rounding decides whether a node has a share
        loose = (np.abs(apart) < 1.5 + 1e-3).all(1) * (1 + far[s])
        value += float(contact.pull) * weight[:, None] * line[s]
        scale += abs(float(contact.pull)) * loose[:, None] * np.abs(line[s])
    return {"node_force": (value, scale)}


@operation(
    "none in the thesis; stress mu (A + A^T) through (4.10)", outputs="affine", entrywise=True,
    optional="inverse_spread", tolerance=16.0,
    reason="a few roundings for each sum, product and the product of two matrices", invariants="reordering",
)  # fmt: skip
def viscosity(volume_ratio, inverse_spread, viscous_stress, timestep, affine):
    """A - dt J (4 mu/(rho0 h^2)) (A + A^T) E^-1 [1/s], row by row; E = 1 without embedded points."""
    a, ratio = _f(affine).reshape(-1, 3, 3), _f(volume_ratio)
    inverse = np.eye(3)
    if inverse_spread is not None:
        inverse = _f(inverse_spread)[:, SYMMETRIC]
    factor = (float(timestep[1]) * float(viscous_stress.factor) * ratio)[:, None, None]
    turned = np.swapaxes(a, 1, 2)
    value = a - factor * ((a + turned) @ inverse)
    scale = np.abs(a) + np.abs(factor) * ((np.abs(a) + np.abs(turned)) @ np.abs(inverse))
    return {"affine": (value.reshape(-1, 9), scale.reshape(-1, 9))}


@operation(
    "none in the thesis; J sum_j B_j(x_p) m_j/(rho0 h^d), m_j of 4.2.4", outputs="greatest_crowding crowding",
    tolerance=32.0, reason=_SUMS, invariants="reordering", programs=dict.fromkeys(("cpu", "cuda"), "crowding"),
)  # fmt: skip
def count(position, volume_ratio, node_mass, background, counting, grid):
    """q_p = J_p rho_p/rho0, dimensionless, with the counted density rho_p = sum_j B_j(x_p) m_j/h^d; and the largest."""
    stencils = Stencils(position, node_table(grid.blocks), background)
    mass, ratio = _f(node_mass)[stencils.j] / float(counting.cell_mass), _f(volume_ratio)
    q = ratio * stencils.on_points(stencils.weight * mass)
    scale = np.abs(ratio) * stencils.on_points(stencils.scale * np.abs(mass))
    greatest = np.where(np.isnan(q), np.inf, q).max(initial=0.0)
    return {"greatest_crowding": (np.array([greatest]), np.array([scale.max(initial=0.0)])), "crowding": (q, scale)}


@operation(
    "none in the thesis; J <- J (1 - min(1, dt/tau) (1 - q0/q))", outputs="deformation volume_ratio", entrywise=True,
    optional="deformation", tolerance=16.0, reason="two quotients, two products, two differences, and a root",
    invariants="reordering", cases="",
)  # fmt: skip
def recount(crowding, recounting, timestep, background, deformation, volume_ratio):
    """Where q > q0: J <- J + s (J q0/q - J), s = min(1, dt/tau), dimensionless; F is stretched
    equally along all axes to the same J."""
    q, ratio = _f(crowding), _f(volume_ratio)
    with np.errstate(divide="ignore", invalid="ignore"):
        target = np.where(q <= float(recounting.limit), ratio, ratio * float(recounting.limit) / q)
        new = ratio + min(1.0, float(timestep[1]) * float(recounting.rate)) * (target - ratio)
        dim = 3 if background.layers == 3 else 2
        stretch = np.where(new == ratio, 1.0, (new / ratio) ** (1 / dim))
    answer = {"volume_ratio": (new, 2 * np.abs(ratio))}
    if deformation is not None:
        f = _f(deformation) * np.stack([stretch] * 8 + [stretch if dim == 3 else np.ones_like(stretch)], axis=-1)
        answer = {"deformation": (f, 2 * np.abs(_f(deformation)))} | answer
    return answer
