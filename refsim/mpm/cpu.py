"""CPU transfers of MPM: a block's points add to the nodes in their reach, each node then collects from the blocks.

No two threads write the same place and every sum has its own order, so that a result does not depend on the number
of threads.
"""

import math

import numpy as np

from refsim.backends.compile import cpu_kernel, formula, prange
from refsim.mpm import particle
from refsim.mpm.formulas import spline_slopes, spline_weights
from refsim.mpm.grid import FARTHEST
from refsim.neighbours.formulas import BITS, OFFSET, lower_bound
from refsim.sparse_grid.formulas import node_coordinates

CHUNKS = 64
FAR = 2.0 * FARTHEST

# Cells, blocks and bins


@formula
def base_coordinate(x, inverse_cell):
    """Base node j = floor(x/h - 1/2) of x [m], in float64; one beyond the last where x is too far or no number.

    It is found from floor(2 x/h), which no compiler can round otherwise by fusing product and difference.
    """
    halves = float(x) * (inverse_cell + inverse_cell)
    if halves > -FAR and halves < FAR:
        return (int(math.floor(halves)) - 1) >> 1  # noqa: RUF046
    return FARTHEST + 1


@formula
def key_of(jx, jy, jz, bits):
    """Key of the block with node j; in the plane jz is 0 and not divided."""
    bz = jz >> 2 if bits == 2 else jz
    return ((bz + OFFSET) << (2 * BITS)) | (((jy >> bits) + OFFSET) << BITS) | ((jx >> bits) + OFFSET)


@cpu_kernel
def write_keys(position, inverse_cell, bits, keys):
    """Key of each point's block, -1 for a point at no possible place."""
    for i in prange(keys.shape[0]):
        jx = base_coordinate(position[i, 0], inverse_cell)
        jy = base_coordinate(position[i, 1], inverse_cell)
        jz = base_coordinate(position[i, 2], inverse_cell) if bits == 2 else 0
        lost = jx > FARTHEST or jy > FARTHEST or jz > FARTHEST
        keys[i] = -1 if lost else key_of(jx, jy, jz, bits)


@formula
def find_chunk(begin, end, position, inverse_cell, keys, complete, bits, cell):
    """`write_cells` for the points from `begin` to `end`; (missing, lost)."""
    missing, lost = 0, 0
    last, block = np.int64(-1), np.int64(0)
    rest = (1 << bits) - 1
    for i in range(begin, end):
        jx = base_coordinate(position[i, 0], inverse_cell)
        jy = base_coordinate(position[i, 1], inverse_cell)
        jz = base_coordinate(position[i, 2], inverse_cell) if bits == 2 else 0
        if jx > FARTHEST or jy > FARTHEST or jz > FARTHEST:
            lost += 1
            cell[i] = -1
            continue
        key = key_of(jx, jy, jz, bits)
        if key != last:
            last = key
            block = np.int64(lower_bound(keys, key))
            if block == keys.shape[0] or keys[block] != key or complete[block] == 0:
                block = np.int64(-1)
        if block < 0:
            missing += 1
            cell[i] = -1
        else:
            local = ((jy & rest) << bits) | (jx & rest)
            if bits == 2:
                local |= (jz & rest) << 4
            cell[i] = block * 64 + local
    return missing, lost


@cpu_kernel
def write_cells(position, inverse_cell, keys, complete, bits, counts, cell):
    """Cell of each point: number of its base node; -1 in no block or lost. counts[chunk] = (missing, lost)."""
    n = cell.shape[0]
    for chunk in prange(CHUNKS):
        counts[chunk, 0], counts[chunk, 1] = find_chunk(
            chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS, position, inverse_cell, keys, complete, bits, cell
        )


@cpu_kernel
def expand_runs(first, run_first, begin, at, point):
    """point: the numbers of block b's points, from its runs of consecutive ones."""
    for b in prange(first.shape[0] - 1):
        for r in range(run_first[b], run_first[b + 1]):
            size = (at[r + 1] if r + 1 < at.shape[0] else point.shape[0]) - at[r]
            for k in range(size):
                point[at[r] + k] = begin[r] + k


def bits_of(blocks):
    """Bits that number a block's nodes along an axis."""
    return 2 if blocks.neighbour.shape[1] == 27 else 3


def block_keys(position, inverse_cell, dim):
    """Keys (n,) of the points' blocks."""
    keys = np.empty(len(position), np.int64)
    write_keys(position, inverse_cell, 2 if dim == 3 else 3, keys)
    return keys


def find_cells(position, inverse_cell, blocks, complete, cell):
    """Write the points' cells; (points in no block, points at no possible place)."""
    counts = np.zeros((CHUNKS, 2), np.int64)
    write_cells(position, inverse_cell, blocks.keys, complete, bits_of(blocks), counts, cell)
    missing, lost = counts.sum(0)
    return int(missing), int(lost)


def sorted_bins(cell, blocks):
    """Points by block. Runs of points in the same block are sorted, which are few where particles are in order."""
    block = cell >> 6
    n = len(block)
    begin = np.concatenate(([0], np.flatnonzero(block[1:] != block[:-1]) + 1))[: n or 0].astype(np.int32)
    owner = block[begin]
    size = np.diff(np.append(begin, n))
    order = np.argsort(owner, kind="stable")
    first = np.zeros(blocks + 1, np.int32)
    run_first = np.zeros(blocks + 1, np.int32)
    first[1:] = np.cumsum(np.bincount(owner, weights=size, minlength=blocks))
    run_first[1:] = np.cumsum(np.bincount(owner, minlength=blocks))
    begin, size = begin[order], size[order]
    point = np.empty(n, np.int32)
    expand_runs(first, run_first, begin, (np.cumsum(size) - size).astype(np.int32), point)
    return first, point


def cells(position, carrier_position, surface_sample, grid, cell):
    """Cell of every particle, with the blocks and bins of all point sets brought up to date."""
    sets = {"particles": position, "carriers": carrier_position, "samples": surface_sample}
    grid.locate(sets, cell, find_cells, block_keys, sorted_bins)


@cpu_kernel
def weights(position, background, base_node, spline_weight, spline_slope):
    """Section 3: base node, B and h B' of each particle, three for each axis."""
    for i in prange(base_node.shape[0]):
        for c in range(3):
            j = base_coordinate(position[i, c], background.inverse_cell)
            base_node[i, c] = j
            f = type(background.cell_size)(float(position[i, c]) * background.inverse_cell - float(j))
            w, s = spline_weights(f), spline_slopes(f)
            for k in range(3):
                spline_weight[i, 3 * c + k] = w[k]
                spline_slope[i, 3 * c + k] = s[k]


# Points to nodes


# Four numbers of a node stand side by side, mass and momentum or velocity and nothing, and take the same path through
# straight code, so that the compiler packs them into one register.


@formula
def four(values, n):
    """The four numbers of node n."""
    return values[n, 0], values[n, 1], values[n, 2], values[n, 3]


@formula
def plus(a, b):
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


@formula
def two_of(u, a, v, b):
    """u a + v b."""
    return u * a[0] + v * b[0], u * a[1] + v * b[1], u * a[2] + v * b[2], u * a[3] + v * b[3]


@formula
def three_of(u, a, v, b, w, c):
    """u a + v b + w c."""
    return (
        u * a[0] + v * b[0] + w * c[0], u * a[1] + v * b[1] + w * c[1],
        u * a[2] + v * b[2] + w * c[2], u * a[3] + v * b[3] + w * c[3],
    )  # fmt: skip


@formula
def add_node(nodes, n, w, a):
    """nodes[n] += w a."""
    nodes[n, 0] += w * a[0]
    nodes[n, 1] += w * a[1]
    nodes[n, 2] += w * a[2]
    nodes[n, 3] += w * a[3]


@formula
def add_row(nodes, n, w, wx, q, gx):
    """Add w B_j(x) (q + i gx) to the row of three nodes that begins at n."""
    q1 = plus(q, gx)
    add_node(nodes, n, w * wx[0], q)
    add_node(nodes, n + 1, w * wx[1], q1)
    add_node(nodes, n + 2, w * wx[2], plus(q1, gx))


@formula
def add_layer(nodes, n, width, w, wx, wy, q, gx, gy):
    """Add w B_j(x) B_j(y) (q + i gx + j gy) to the layer of nine nodes that begins at n."""
    q1 = plus(q, gy)
    add_row(nodes, n, w * wy[0], wx, q, gx)
    add_row(nodes, n + width, w * wy[1], wx, q1, gx)
    add_row(nodes, n + 2 * width, w * wy[2], wx, plus(q1, gy), gx)


@formula
def add_affine(nodes, at, width, background, wx, wy, wz, mass, qx, qy, qz, g):
    """Add B_j (mass, q + g (j - base)) to the nodes of a stencil that begins at node `at`."""
    zero = type(mass)(0)
    q = (mass, qx, qy, qz)
    gx, gy, gz = (zero, g[0], g[3], g[6]), (zero, g[1], g[4], g[7]), (zero, g[2], g[5], g[8])
    add_layer(nodes, at, width, wz[0], wx, wy, q, gx, gy)
    if background.layers == 3:
        q1 = plus(q, gz)
        deep = width * width
        add_layer(nodes, at + deep, width, wz[1], wx, wy, q1, gx, gy)
        add_layer(nodes, at + 2 * deep, width, wz[2], wx, wy, plus(q1, gz), gx, gy)


@formula
def add_gradient(nodes, at, width, background, wx, wy, wz, sx, sy, sz, t):
    """Add T (h grad B_j) to the momentum of a stencil; T symmetric, (xx, xy, xz, yy, yz, zz)."""
    zero = type(background.cell_size)(0)
    for k in range(3):
        if k < background.layers:
            for j in range(3):
                for i in range(3):
                    dx = sx[i] * wy[j] * wz[k]
                    dy = wx[i] * sy[j] * wz[k]
                    dz = wx[i] * wy[j] * sz[k]
                    n = at + (k * width + j) * width + i
                    x = t[0] * dx + t[1] * dy + t[2] * dz
                    y = t[1] * dx + t[3] * dy + t[4] * dz
                    z = t[2] * dx + t[4] * dy + t[5] * dz
                    add_node(nodes, n, type(x)(1), (zero, x, y, z))


@formula
def clear(scratch, b):
    """Nothing on the nodes in the reach of block b."""
    for n in range(scratch.shape[1]):
        for c in range(4):
            scratch[b, n, c] = type(scratch[b, n, c])(0)


@formula
def scatter_particles_of(
    b, bins, position, velocity, mass, affine, volume_ratio, acceleration, cell, liquid, background, timestep,
    cluster_share, inverse_spread, embedding, kernel_gradient, blocks, scratch,
):  # fmt: skip
    """One block of `scatter_particles`."""
    width = background.width
    origin = node_coordinates(blocks, b * 64)
    clear(scratch, b)
    nodes = scratch[b]
    for k in range(bins.first[b], bins.first[b + 1]):
        i = bins.point[k]
        fx, fy, fz, x, y, z = particle.place(i, position, cell, origin, background)
        own, qx, qy, qz, g, moment = particle.particle_field(
            i, fx, fy, fz, velocity, mass, affine, volume_ratio, acceleration, liquid, background, timestep,
            cluster_share, inverse_spread, embedding, kernel_gradient,
        )  # fmt: skip
        wx, wy, wz = spline_weights(fx), spline_weights(fy), particle.layer_weights(fz, background)
        at = (z * width + y) * width + x
        add_affine(nodes, at, width, background, wx, wy, wz, own, qx, qy, qz, g)
        if kernel_gradient is not None:
            zero = type(own)(0)
            p = -moment / background.cell_size
            t = (p, zero, zero, p, zero, p)
            slopes = particle.layer_slopes(fz, background)
            add_gradient(nodes, at, width, background, wx, wy, wz, spline_slopes(fx), spline_slopes(fy), slopes, t)


@cpu_kernel(ordered=True, packed=True)
def scatter_particles(
    bins, position, velocity, mass, affine, volume_ratio, acceleration, cell, liquid, background, timestep,
    cluster_share, inverse_spread, embedding, kernel_gradient, blocks, scratch,
):  # fmt: skip
    """What each block's particles give to the nodes in their reach."""
    for b in prange(scratch.shape[0]):
        if bins.first[b + 1] > bins.first[b]:
            scatter_particles_of(
                b, bins, position, velocity, mass, affine, volume_ratio, acceleration, cell, liquid, background,
                timestep, cluster_share, inverse_spread, embedding, kernel_gradient, blocks, scratch,
            )  # fmt: skip


@formula
def collect_block(b, bins, blocks, add, scratch, node_mass, node_momentum):
    """One block of `collect`: each node adds up what it got from its own block and from those below."""
    bits, width = (2, 6) if blocks.neighbour.shape[1] == 27 else (3, 10)
    rest = (1 << bits) - 1
    middle = blocks.neighbour.shape[1] // 2
    for node in range(64):
        n = 64 * b + node
        x, y, z = node & rest, (node >> bits) & rest, node >> (2 * bits)
        zero = type(scratch[0, 0, 0])(0)
        m, px, py, pz = zero, zero, zero, zero
        for dz in range(2 if bits == 2 and z < 2 else 1):
            for dy in range(2 if y < 2 else 1):
                for dx in range(2 if x < 2 else 1):
                    s = blocks.neighbour[b, middle - dx - 3 * dy - 9 * dz]
                    if s >= 0 and bins.first[s + 1] > bins.first[s]:
                        at = ((z + (dz << bits)) * width + y + (dy << bits)) * width + x + (dx << bits)
                        m += scratch[s, at, 0]
                        px += scratch[s, at, 1]
                        py += scratch[s, at, 2]
                        pz += scratch[s, at, 3]
        if add:
            m += node_mass[n]
            px += node_momentum[n, 0]
            py += node_momentum[n, 1]
            pz += node_momentum[n, 2]
        node_mass[n] = m
        node_momentum[n, 0] = px
        node_momentum[n, 1] = py
        node_momentum[n, 2] = pz


@cpu_kernel
def collect(bins, blocks, add, scratch, node_mass, node_momentum):
    """m_j and (mv)_j from what the blocks' points gave; added to what stands there where `add`."""
    for b in prange(scratch.shape[0]):
        collect_block(b, bins, blocks, add, scratch, node_mass, node_momentum)


def particle_to_grid(
    position, velocity, mass, affine, volume_ratio, acceleration, liquid, background, timestep, cluster_share,
    inverse_spread, embedding, kernel_gradient, grid, node_mass, node_momentum,
):  # fmt: skip
    """(4.10), (4.15), (4.17): m_j and (mv)_j with the impulse of the liquid's stress."""
    bins, scratch = grid.bins["particles"], grid.scratch
    scatter_particles(
        bins, position, velocity, mass, affine, volume_ratio, acceleration, grid.cells["particles"], liquid,
        background, timestep, cluster_share, inverse_spread, embedding, kernel_gradient, grid.blocks, scratch,
    )  # fmt: skip
    collect(bins, grid.blocks, False, scratch, node_mass, node_momentum)


@formula
def scatter_carriers_of(
    b, bins, carrier_position, carrier_owner, carrier_cell, position, velocity, mass, affine, volume_ratio,
    acceleration, liquid, background, timestep, cluster_share, inverse_spread, embedding, blocks, scratch,
):  # fmt: skip
    """One block of `scatter_carriers`."""
    width = background.width
    origin = node_coordinates(blocks, b * 64)
    clear(scratch, b)
    nodes = scratch[b]
    for k in range(bins.first[b], bins.first[b + 1]):
        c = bins.point[k]
        fx, fy, fz, x, y, z = particle.place(c, carrier_position, carrier_cell, origin, background)
        own, qx, qy, qz, g = particle.carrier_field(
            c, fx, fy, fz, carrier_position, carrier_owner, position, velocity, mass, affine, volume_ratio,
            acceleration, liquid, background, timestep, cluster_share, inverse_spread, embedding,
        )  # fmt: skip
        wx, wy, wz = spline_weights(fx), spline_weights(fy), particle.layer_weights(fz, background)
        add_affine(nodes, (z * width + y) * width + x, width, background, wx, wy, wz, own, qx, qy, qz, g)


@cpu_kernel(ordered=True, packed=True)
def scatter_carriers(
    bins, carrier_position, carrier_owner, carrier_cell, position, velocity, mass, affine, volume_ratio, acceleration,
    liquid, background, timestep, cluster_share, inverse_spread, embedding, blocks, scratch,
):  # fmt: skip
    """What each block's embedded points give to the nodes in their reach."""
    for b in prange(scratch.shape[0]):
        if bins.first[b + 1] > bins.first[b]:
            scatter_carriers_of(
                b, bins, carrier_position, carrier_owner, carrier_cell, position, velocity, mass, affine,
                volume_ratio, acceleration, liquid, background, timestep, cluster_share, inverse_spread, embedding,
                blocks, scratch,
            )  # fmt: skip


def carriers_to_grid(
    carrier_position, carrier_owner, position, velocity, mass, affine, volume_ratio, acceleration, liquid, background,
    timestep, cluster_share, inverse_spread, embedding, grid, node_mass, node_momentum,
):  # fmt: skip
    """Section 5: the embedded points' share of mass and momentum, added."""
    bins, scratch = grid.bins["carriers"], grid.scratch
    scatter_carriers(
        bins, carrier_position, carrier_owner, grid.cells["carriers"], position, velocity, mass, affine, volume_ratio,
        acceleration, liquid, background, timestep, cluster_share, inverse_spread, embedding, grid.blocks, scratch,
    )  # fmt: skip
    collect(bins, grid.blocks, True, scratch, node_mass, node_momentum)


# On the nodes


@cpu_kernel
def update_nodes(
    node_mass, node_momentum, node_pull, field, planes, mirrors, least_mass, timestep, blocks, node_velocity
):
    """(4.19) and the walls, for every node."""
    for b in prange(node_velocity.shape[0] // 64):
        for n in range(64 * b, 64 * b + 64):
            if mirrors is not None:
                v = particle.mirrored_update(
                    n, node_mass, node_momentum, blocks, least_mass, node_pull, field, planes, timestep
                )
            else:
                v = particle.node_update(
                    n, node_mass[n], node_momentum[n, 0], node_momentum[n, 1], node_momentum[n, 2], blocks, least_mass,
                    node_pull, field, planes, timestep,
                )  # fmt: skip
            node_velocity[n, 0] = v[0]
            node_velocity[n, 1] = v[1]
            node_velocity[n, 2] = v[2]


def grid_update(node_mass, node_momentum, node_pull, field, planes, mirrors, background, timestep, grid, node_velocity):
    """(4.19) and section 9: velocities of the nodes."""
    update_nodes(
        node_mass, node_momentum, node_pull, field, planes, mirrors, background.least_mass, timestep, grid.blocks,
        node_velocity,
    )  # fmt: skip


# Nodes to points


@formula
def load_block(b, blocks, background, node_velocity):
    """Velocities (width^dim, 4), with a zero, of the nodes in the reach of block b."""
    bits = 2 if background.layers == 3 else 3
    rest = (1 << bits) - 1
    width = background.width
    deep = width if background.layers == 3 else 1
    middle = blocks.neighbour.shape[1] // 2
    values = np.zeros((deep * width * width, 4), node_velocity.dtype)
    for z in range(deep):
        for y in range(width):
            for x in range(width):
                s = blocks.neighbour[b, middle + (x >> bits) + 3 * (y >> bits) + 9 * (z >> bits)]
                n = 64 * s + (((z & rest) << (2 * bits)) | ((y & rest) << bits) | (x & rest))
                at = (z * width + y) * width + x
                for c in range(3):
                    values[at, c] = node_velocity[n, c]
    return values


@formula
def row_sums(values, n, w0, w1, w2, d2):
    """Sums over the row of three nodes at n: B v and i B v; d2 = 2 w2."""
    b, c = four(values, n + 1), four(values, n + 2)
    return three_of(w0, four(values, n), w1, b, w2, c), two_of(w1, b, d2, c)


@formula
def layer_sums(values, n, width, wx, wy):
    """Sums over the layer of nine nodes at n: B v, i B v and j B v."""
    w0, w1, w2 = wx
    y0, y1, y2 = wy
    d2 = w2 + w2
    a, s = row_sums(values, n, w0, w1, w2, d2)
    b, t = row_sums(values, n + width, w0, w1, w2, d2)
    c, u = row_sums(values, n + 2 * width, w0, w1, w2, d2)
    return three_of(y0, a, y1, b, y2, c), three_of(y0, s, y1, t, y2, u), two_of(y1, b, y2 + y2, c)


@formula
def moments(at, width, background, wx, wy, wz, values, sums):
    """`particle.moments` of a stencil at node `at`; sums (4, 4) is room for B v and B v (j - base) along each axis."""
    if background.layers == 3:
        deep = width * width
        z0, z1, z2 = wz
        a, s, r = layer_sums(values, at, width, wx, wy)
        b, t, q = layer_sums(values, at + deep, width, wx, wy)
        c, u, p = layer_sums(values, at + 2 * deep, width, wx, wy)
        sums[0, 0], sums[0, 1], sums[0, 2], sums[0, 3] = three_of(z0, a, z1, b, z2, c)
        sums[1, 0], sums[1, 1], sums[1, 2], sums[1, 3] = three_of(z0, s, z1, t, z2, u)
        sums[2, 0], sums[2, 1], sums[2, 2], sums[2, 3] = three_of(z0, r, z1, q, z2, p)
        sums[3, 0], sums[3, 1], sums[3, 2], sums[3, 3] = two_of(z1, b, z2 + z2, c)
    else:
        a, s, r = layer_sums(values, at, width, wx, wy)
        sums[0, 0], sums[0, 1], sums[0, 2], sums[0, 3] = a
        sums[1, 0], sums[1, 1], sums[1, 2], sums[1, 3] = s
        sums[2, 0], sums[2, 1], sums[2, 2], sums[2, 3] = r
    return (
        sums[0, 0], sums[0, 1], sums[0, 2], sums[1, 0], sums[2, 0], sums[3, 0], sums[1, 1], sums[2, 1], sums[3, 1],
        sums[1, 2], sums[2, 2], sums[3, 2],
    )  # fmt: skip


@formula
def gather_block(
    b, bins, node_velocity, cell, liquid, background, timestep, blocks, cluster_share, inverse_spread, embedding,
    carrier_first, carrier_position, carrier_moment, build_position, velocity, affine, volume_ratio, deformation,
    position,
):  # fmt: skip
    """One block of `gather`; (largest squared way, least J, largest J, largest |tr A|, largest squared jump)."""
    real = type(background.cell_size)
    width = background.width
    origin = node_coordinates(blocks, b * 64)
    values = load_block(b, blocks, background, node_velocity)
    room = np.zeros((4, 4), node_velocity.dtype)
    far, least, most, fast, jump = real(0), real(math.inf), real(-math.inf), real(0), real(0)
    for k in range(bins.first[b], bins.first[b + 1]):
        i = bins.point[k]
        fx, fy, fz, x, y, z = particle.place(i, position, cell, origin, background)
        sums = moments(
            (z * width + y) * width + x, width, background, spline_weights(fx), spline_weights(fy),
            particle.layer_weights(fz, background), values, room,
        )  # fmt: skip
        way, ratio, rate, leap = particle.gather(
            i, i, sums, fx, fy, fz, background, liquid, timestep, cluster_share, inverse_spread, embedding,
            carrier_first, carrier_position, carrier_moment, build_position, position, volume_ratio,
            deformation, velocity, affine, position,
        )  # fmt: skip
        far, least, most, fast = max(far, way), min(least, ratio), max(most, ratio), max(fast, rate)
        jump = max(jump, leap)
    return far, least, most, fast, jump


@cpu_kernel(ordered=True, packed=True)
def gather(
    bins, node_velocity, cell, liquid, background, timestep, blocks, cluster_share, inverse_spread, embedding,
    carrier_first, carrier_position, carrier_moment, build_position, displacement, step_extremes, velocity, affine,
    volume_ratio, deformation, position,
):  # fmt: skip
    """Every particle takes its velocity, gradient, volume and place from the nodes."""
    real = type(background.cell_size)
    far, least, most, fast, jump = real(0), real(math.inf), real(-math.inf), real(0), real(0)
    for b in prange(blocks.keys.shape[0]):
        if bins.first[b + 1] > bins.first[b]:
            f, low, high, rate, leap = gather_block(
                b, bins, node_velocity, cell, liquid, background, timestep, blocks, cluster_share, inverse_spread,
                embedding, carrier_first, carrier_position, carrier_moment, build_position, velocity, affine,
                volume_ratio, deformation, position,
            )  # fmt: skip
            far = max(far, f)
            least = min(least, low)
            most = max(most, high)
            fast = max(fast, rate)
            jump = max(jump, leap)
    if least > most:  # there is no particle
        least, most = real(1), real(1)
    displacement[0] = far
    displacement[1] = real(0)
    step_extremes[0] = least
    step_extremes[1] = most
    step_extremes[2] = fast
    step_extremes[3] = jump


def grid_to_particle(
    node_velocity, liquid, background, timestep, cluster_share, inverse_spread, embedding, carrier_first,
    carrier_position, carrier_moment, build_position, grid, displacement, step_extremes, velocity, affine,
    volume_ratio, deformation, position,
):  # fmt: skip
    """(4.12), (4.13) or the cluster's, (4.16), (4.8): velocity, affine matrix, volume ratio and position."""
    gather(
        grid.bins["particles"], node_velocity, grid.cells["particles"], liquid, background, timestep, grid.blocks,
        cluster_share, inverse_spread, embedding, carrier_first, carrier_position, carrier_moment, build_position,
        displacement,
        step_extremes, velocity, affine, volume_ratio, deformation, position,
    )  # fmt: skip


@formula
def gather_carriers_of(b, bins, node_velocity, carrier_position, carrier_cell, background, blocks, carrier_moment):
    """One block of `gather_carriers`."""
    width = background.width
    origin = node_coordinates(blocks, b * 64)
    values = load_block(b, blocks, background, node_velocity)
    room = np.zeros((4, 4), node_velocity.dtype)
    for k in range(bins.first[b], bins.first[b + 1]):
        i = bins.point[k]
        fx, fy, fz, x, y, z = particle.place(i, carrier_position, carrier_cell, origin, background)
        sums = moments(
            (z * width + y) * width + x, width, background, spline_weights(fx), spline_weights(fy),
            particle.layer_weights(fz, background), values, room,
        )  # fmt: skip
        m = particle.centred(sums, fx, fy, fz, background.cell_size)
        carrier_moment[i, 0], carrier_moment[i, 1], carrier_moment[i, 2] = sums[0], sums[1], sums[2]
        for c in range(9):
            carrier_moment[i, 3 + c] = m[c]


@cpu_kernel(ordered=True, packed=True)
def gather_carriers(bins, node_velocity, carrier_position, carrier_cell, background, blocks, carrier_moment):
    """Moments of the nodes' velocities about every embedded point."""
    for b in prange(blocks.keys.shape[0]):
        if bins.first[b + 1] > bins.first[b]:
            gather_carriers_of(
                b, bins, node_velocity, carrier_position, carrier_cell, background, blocks, carrier_moment
            )


def grid_to_carriers(node_velocity, carrier_position, background, grid, carrier_moment):
    """Sums of B v and B v (x_j - x_q)^T about every embedded point."""
    cell = grid.cells["carriers"]
    gather_carriers(
        grid.bins["carriers"], node_velocity, carrier_position, cell, background, grid.blocks, carrier_moment
    )


# Embedding


@cpu_kernel
def embed_all(
    position, surface_sample, order, first, cell_size, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Section 5 for every particle."""
    for i in prange(cluster_share.shape[0]):
        particle.embed(
            i, position, surface_sample, order, first, cell_size, carrier_first, carrier_position, carrier_owner,
            cluster_share, inverse_spread,
        )  # fmt: skip


def embed(
    position, surface_sample, sample_owner, background, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Section 5: embedded points by owner, the clusters' shares and inverse moments."""
    order = np.argsort(sample_owner, kind="stable").astype(np.int32)
    first = np.zeros(len(position) + 1, np.int32)
    first[1:] = np.cumsum(np.bincount(sample_owner, minlength=len(position)))
    embed_all(
        position, surface_sample, order, first, background.cell_size, carrier_first, carrier_position, carrier_owner,
        cluster_share, inverse_spread,
    )  # fmt: skip


@cpu_kernel
def contact(sample_position, sample_line, spline_cells, blocks, surface_term, contact, node_force):
    """Young's force on the nodes, added to the surface's [N]."""
    for i in prange(node_force.shape[0]):
        fx, fy, fz = particle.contact_pull(i, sample_position, sample_line, spline_cells, blocks, surface_term, contact)
        node_force[i, 0] += fx
        node_force[i, 1] += fy
        node_force[i, 2] += fz


@cpu_kernel
def viscosity(volume_ratio, inverse_spread, viscous_stress, timestep, affine):
    """Affine matrices after the viscous stress of a step."""
    for i in prange(affine.shape[0]):
        rows = particle.viscosity(i, affine, volume_ratio, inverse_spread, viscous_stress, timestep)
        for c in range(3):
            affine[i, c], affine[i, 3 + c], affine[i, 6 + c] = rows[0][c], rows[1][c], rows[2][c]


@cpu_kernel
def count_all(position, volume_ratio, node_mass, cell, background, counting, blocks, greatest_crowding, crowding):
    """Counted over known density of every particle, and the largest; what is no number counts as infinite."""
    real = type(background.cell_size)
    greatest = real(0)
    for i in prange(crowding.shape[0]):
        own = particle.crowding(i, position, volume_ratio, node_mass, cell, background, counting, blocks)
        crowding[i] = own
        greatest = max(greatest, own if own < real(math.inf) else real(math.inf))
    greatest_crowding[0] = greatest


def count(position, volume_ratio, node_mass, background, counting, grid, greatest_crowding, crowding):
    """Counted over known density of every particle, and the largest."""
    count_all(
        position, volume_ratio, node_mass, grid.cells["particles"], background, counting, grid.blocks,
        greatest_crowding, crowding,
    )  # fmt: skip


@cpu_kernel
def recount(crowding, recounting, timestep, background, deformation, volume_ratio):
    """Volume ratios that follow the counted density."""
    for i in prange(volume_ratio.shape[0]):
        particle.recount(i, crowding, recounting, timestep, background, deformation, volume_ratio)
