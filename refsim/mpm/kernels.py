"""What one point or one node does, and the geometry of stencils and clusters that the transfers share."""

import math

from refsim.backends.compile import formula, kernel
from refsim.backends.reductions import reduction
from refsim.backends.tuples import added, difference, nine, over, product, put, scaled, symmetric, three, transposed
from refsim.mpm import formulas
from refsim.mpm.groups import Nodes, Owned, Samples
from refsim.mpm.limits import FARTHEST, LOST, OUTSIDE
from refsim.sparse_grid.block_search import points_by_cell
from refsim.sparse_grid.formulas import BLOCK, block_key, find_node_near, node_coordinates, number, step_node

# Cells and stencils


@formula
def point_key(i, position, inverse_cell, bits):
    """Key (dimensionless) of the block of point i, x in b; -1 where it is too far or NaN."""
    jx = formulas.base_coordinate(position[i, 0], inverse_cell)
    jy = formulas.base_coordinate(position[i, 1], inverse_cell)
    jz = formulas.base_coordinate(position[i, 2], inverse_cell) if bits == 2 else 0
    lost = jx > FARTHEST or jy > FARTHEST or jz > FARTHEST
    return -1 if lost else block_key(jx, jy, jz, bits)


@formula
def cell_of(i, position, inverse_cell, blocks, complete, guess):
    """Number (dimensionless) of the base node of point i; block `guess` is looked at first.

    OUTSIDE where no block holds it, or one in whose reach blocks are missing; LOST where it is too far or NaN.
    """
    jx = formulas.base_coordinate(position[i, 0], inverse_cell)
    jy = formulas.base_coordinate(position[i, 1], inverse_cell)
    jz = formulas.base_coordinate(position[i, 2], inverse_cell) if blocks.neighbour.shape[1] == 27 else 0
    if jx > FARTHEST or jy > FARTHEST or jz > FARTHEST:
        return LOST
    node = find_node_near(blocks, jx, jy, jz, guess)
    return node if node >= 0 and complete[number(node >> 6)] != 0 else OUTSIDE


@formula
def place(i, position, cell, origin, background):
    """(offsets f of point i, coordinates of its base node in the block whose first node is `origin`)."""
    local = cell[i] & 63
    if background.layers == 3:
        x, y, z = local & 3, (local >> 2) & 3, local >> 4
        fx = formulas.fraction(position[i, 0], origin[0] + x, background)
        fy = formulas.fraction(position[i, 1], origin[1] + y, background)
        fz = formulas.fraction(position[i, 2], origin[2] + z, background)
        return (fx, fy, fz), (x, y, z)
    x, y = local & 7, local >> 3
    fx = formulas.fraction(position[i, 0], origin[0] + x, background)
    fy = formulas.fraction(position[i, 1], origin[1] + y, background)
    return (fx, fy, type(fx)(0)), (x, y, 0)


@formula
def stencil_weights(f, background):
    """Weights along x, y and z."""
    return formulas.spline_weights(f[0]), formulas.spline_weights(f[1]), layer_weights(f[2], background)


@formula
def stencil_slopes(f, background):
    """Slopes along x, y and z."""
    return formulas.spline_slopes(f[0]), formulas.spline_slopes(f[1]), layer_slopes(f[2], background)


@formula
def layer_weights(fz, background):
    """Weights along z; 1 for the one layer of nodes in the plane."""
    if background.layers == 3:
        return formulas.spline_weights(fz)
    real = type(fz)
    return real(1), real(0), real(0)


@formula
def layer_slopes(fz, background):
    """Slopes along z; 0 in the plane."""
    if background.layers == 3:
        return formulas.spline_slopes(fz)
    real = type(fz)
    return real(0), real(0), real(0)


# Clusters and viscosity


@formula
def round_spread(h):
    """E^-1 of a particle without embedded points: the unit matrix."""
    real = type(h)
    return real(1), real(0), real(0), real(1), real(0), real(1)


@formula
def spread_of(i, inverse_spread):
    """E^-1 of particle i's cluster."""
    return (
        inverse_spread[i, 0], inverse_spread[i, 1], inverse_spread[i, 2],
        inverse_spread[i, 3], inverse_spread[i, 4], inverse_spread[i, 5],
    )  # fmt: skip


@kernel
def viscosity(i, volume_ratio, inverse_spread, viscous_stress, timestep, affine):
    """A <- A - dt (4 mu J/(rho0 h^2)) (A + A^T) E^-1 [1/s], row by row: what the stress mu (A + A^T) adds to (4.10).

    As for the pressure, its force is -V (4/h^2) B_j stress E^-1 (x_j - x_p), linear in x_j - x_p as is the affine
    momentum.
    """
    factor = timestep[1] * viscous_stress.factor * volume_ratio[i]
    inverse = round_spread(factor)
    if inverse_spread is not None:
        inverse = spread_of(i, inverse_spread)
    a = nine(affine, i)
    strain = added(a, transposed(a))
    put(affine, i, difference(a, scaled(product(strain, symmetric(inverse)), factor)))


@kernel(rows_of="cluster_share")
def embed_samples(i, position, samples, cell_size, carriers, carrier_first, cluster_share, inverse_spread):
    """Samples x_s of particle i and their mirror images 2 x_p - x_s [m], w = 1/(2 C + 1), and E^-1, dimensionless."""
    real = type(cell_size)
    first = samples.first
    count = first[i + 1] - first[i]
    share = real(1) / real(2 * count + 1)
    xx, xy, xz, yy, yz, zz = real(1), real(0), real(0), real(1), real(0), real(1)
    for k in range(first[i], first[i + 1]):
        sample = three(samples.position, samples.order[k])
        d = difference(sample, three(position, i))
        put(carriers.carrier_position, 2 * k, sample)
        put(carriers.carrier_position, 2 * k + 1, difference(three(position, i), d))
        carriers.carrier_owner[2 * k] = i
        carriers.carrier_owner[2 * k + 1] = i
        two = real(8) * share / (cell_size * cell_size)
        xx += two * d[0] * d[0]
        xy += two * d[0] * d[1]
        xz += two * d[0] * d[2]
        yy += two * d[1] * d[1]
        yz += two * d[1] * d[2]
        zz += two * d[2] * d[2]
    carrier_first[i] = 2 * first[i]
    carrier_first[i + 1] = 2 * first[i + 1]  # the next particle writes the same number
    cluster_share[i] = share
    put(inverse_spread, i, formulas.inverse_spread(xx, xy, xz, yy, yz, zz))


def embed(
    position, surface_sample, sample_owner, background, scratch, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Embedded points [m] by owner, shares w = 1/(2 C + 1) and E^-1 of the clusters."""
    first, order, _ = points_by_cell(sample_owner, -(-position.shape[0] // BLOCK))  # an owner is a cell here
    samples, carriers = Samples(surface_sample, order, first), Owned(carrier_position, carrier_owner)
    embed_samples(position, samples, background.cell_size, carriers, carrier_first, cluster_share, inverse_spread)


# On the nodes


@kernel
def update_nodes(n, nodes, field, planes, background, timestep, blocks, node_velocity):
    """(4.19) and the walls: v_j [m/s]."""
    put(node_velocity, n, node_update(n, nodes, field, planes, background, timestep, blocks))


def grid_update(nodes: Nodes, field, planes, background, timestep, grid, node_velocity):
    """(4.19) v_j = ((mv)_j + dt f_j)/m_j + dt g [m/s], and the walls."""
    update_nodes(nodes, field, planes, background, timestep, grid.blocks, node_velocity)


@formula
def pushed(n, momentum, pull, step):
    """Row n of the momenta after the impulse of a force, of which there may be none; so for velocities."""
    p = three(momentum, n)
    if pull is not None:
        p = added(p, scaled(three(pull, n), step))
    return p


@formula
def accelerated(momentum, mass, field, step):
    """v = p/m + dt g [m/s]; there may be no g."""
    v = over(momentum, mass)
    if field is not None:
        v = added(v, scaled((field[0], field[1], field[2]), step))
    return v


@formula
def node_update(node, nodes, field, planes, background, timestep, blocks):
    """(4.19) with the walls: v_j [m/s]; zero on a node with at most `least_mass`, and along an axis of a slower one."""
    mass, zero, slow = nodes.node_mass[node], type(background.least_mass)(0), background.least_speed
    if not mass > background.least_mass:
        return zero, zero, zero
    v = accelerated(pushed(node, nodes.node_momentum, nodes.node_pull, timestep[1]), mass, field, timestep[1])
    v = v[0] if abs(v[0]) > slow else zero, v[1] if abs(v[1]) > slow else zero, v[2] if abs(v[2]) > slow else zero
    if planes is not None:
        v = at_walls(node_coordinates(blocks, node), v, planes)
    return v


@formula
def faces_of(planes):
    """(nodes of the lower walls along x, y and z, those of the upper ones, the rules of both)."""
    a, b, r = planes.lower, planes.upper, planes.rules
    low, high = (int(a[0]), int(a[1]), int(a[2])), (int(b[0]), int(b[1]), int(b[2]))
    return low, high, (int(r[0]), int(r[2]), int(r[4])), (int(r[1]), int(r[3]), int(r[5]))


@formula
def any_of(flags):
    """Whether one of three flags is set."""
    return flags[0] or flags[1] or flags[2]


@formula
def at_walls(j, v, planes):
    """Velocity of node j at the walls [m/s]: 0 in a sticky one, without the component into a slip or separating one."""
    low, high, below, above = faces_of(planes)
    if any_of(formulas.stuck(j, low, high, below, above)):
        zero = type(v[0])(0)
        return zero, zero, zero
    return formulas.wall_velocity(v, j, low, high, below, above)


# Density counted on the grid over that of the volume ratio, and its maximum


@reduction(into="greatest_crowding", how="largest", rows="crowding")
def count_all(i, position, volume_ratio, node_mass, cell, background, counting, blocks, crowding):
    """q = J sum_j B_j(x_p) m_j/(rho0 h^d), dimensionless: counted density over that of J_i; NaN is largest."""
    jx, jy, jz = node_coordinates(blocks, cell[i])
    x, y, z = three(position, i)
    f = formulas.fraction(x, jx, background), formulas.fraction(y, jy, background), formulas.fraction(z, jz, background)
    wx, wy, wz = stencil_weights(f, background)
    real = type(background.cell_size)
    total = real(0)
    for kz in range(background.layers):
        for ky in range(3):
            for kx in range(3):
                node = step_node(blocks, cell[i], kx, ky, kz)
                total += wz[kz] * wy[ky] * wx[kx] * (node_mass[node] / counting.cell_mass)
    ratio = volume_ratio[i] * total
    crowding[i] = ratio
    return ratio if ratio < real(math.inf) else real(math.inf)


def count(position, volume_ratio, node_mass, background, counting, grid, greatest_crowding, crowding):
    """Counted density over that of J for every particle, and the largest; dimensionless."""
    cell = grid.cells["particles"]
    count_all(position, volume_ratio, node_mass, cell, background, counting, grid.blocks, crowding, greatest_crowding)
