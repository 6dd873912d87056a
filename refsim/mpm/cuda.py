"""CUDA transfers of MPM: one thread block for each block of nodes, sums in registers and in shared memory.

Particle to grid: the block's threads bring points into shared memory, each as an affine field; three threads for
each cell (one for each row of its stencil) add up the cell's points in registers; then, in an order that never
changes, the cells' sums go to the block's nodes in shared memory, one node of the stencil at a time, so that no two
threads meet. No atomic addition of floats: results repeat bit for bit.
"""

import math

import numpy as np

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_kernel, formula
from refsim.backends.runtime import simulated
from refsim.mpm import particle
from refsim.mpm.formulas import spline_slopes, spline_weights
from refsim.mpm.grid import DEEP, FARTHEST
from refsim.neighbours.formulas import BITS, OFFSET, lower_bound
from refsim.sparse_grid.block_search_cuda import SUMMING, fill_cells, number, sort_cells, sorted_points
from refsim.sparse_grid.formulas import COORDINATE, node_coordinates

FAR = 2.0 * FARTHEST
ROWS = 192  # threads of a block that scatters: three for each of 64 cells
REACH = 216  # nodes in the reach of a block: 6 x 6 x 6, or 10 x 10 in the plane
SUMS = 4 * REACH  # mass and momentum of each
ALL_SUMS = 3 * SUMS  # one for each row of a stencil
CHUNK = 256  # points of a block in shared memory at a time
PADDED = CHUNK + CHUNK // 8  # one place more after eight, so that the points of cells in a row lie in different banks
APART = 75  # between particles of a cell that are added in turn: those of eleven cells lie in different banks
IN_TURN = 3 * APART
RECORD = 17  # numbers of a point: fractions, mass, value and gradient of its field, moment of its stress
GATHERING = 16 if simulated() else 128  # threads; more than a row of the affine matrices has numbers

EIGHT = 8  # numbers of which a thread finds the largest


@formula
def quotient(at, width):
    """at // width of numbers that are not negative: a known width costs the compiler a multiplication."""
    return np.int64(np.uint32(at) // np.uint32(width))


# Cells, blocks and bins


@formula
def base_coordinate(x, inverse_cell):
    """Base node j = floor(x/h - 1/2) of x [m], in float64; one beyond the last where x is too far or no number."""
    halves = float(x) * (inverse_cell + inverse_cell)
    if halves > -FAR and halves < FAR:
        return (int(math.floor(halves)) - 1) >> 1  # noqa: RUF046  (in CUDA floor gives a float)
    return FARTHEST + 1


@formula
def key_of(jx, jy, jz, bits):
    """Key of the block with node j; in the plane jz is 0 and not divided."""
    bz = jz >> 2 if bits == 2 else jz
    return ((bz + OFFSET) << (2 * BITS)) | (((jy >> bits) + OFFSET) << BITS) | ((jx >> bits) + OFFSET)


@cuda_kernel
def write_keys(position, inverse_cell, bits, keys):
    """Key of each point's block, -1 for a point at no possible place."""
    i = cuda.grid(1)
    if i < keys.shape[0]:
        jx = base_coordinate(position[i, 0], inverse_cell)
        jy = base_coordinate(position[i, 1], inverse_cell)
        jz = base_coordinate(position[i, 2], inverse_cell) if bits == 2 else 0
        lost = jx > FARTHEST or jy > FARTHEST or jz > FARTHEST
        keys[i] = -1 if lost else key_of(jx, jy, jz, bits)


@cuda_kernel
def write_cells(position, inverse_cell, keys, complete, bits, counts, cell):
    """Cell of each point: number of its base node; -1 in no block or lost. counts = (missing, lost)."""
    i = cuda.grid(1)
    if i < cell.shape[0]:
        jx = base_coordinate(position[i, 0], inverse_cell)
        jy = base_coordinate(position[i, 1], inverse_cell)
        jz = base_coordinate(position[i, 2], inverse_cell) if bits == 2 else 0
        if jx > FARTHEST or jy > FARTHEST or jz > FARTHEST:
            cuda.atomic.add(counts, 1, 1)
            cell[i] = -1
        else:
            rest = (1 << bits) - 1
            key = key_of(jx, jy, jz, bits)
            b = lower_bound(keys, key)
            if b == keys.shape[0] or keys[b] != key or complete[b] == 0:
                cuda.atomic.add(counts, 0, 1)
                cell[i] = -1
            else:
                local = ((jy & rest) << bits) | (jx & rest)
                if bits == 2:
                    local |= (jz & rest) << 4
                cell[i] = b * 64 + local


def bits_of(blocks):
    """Bits that number a block's nodes along an axis."""
    return 2 if blocks.neighbour.shape[1] == 27 else 3


def block_keys(position, inverse_cell, dim):
    """Keys (n,) of the points' blocks."""
    keys = device.empty(position.shape[0], np.int64)
    write_keys(position, inverse_cell, 2 if dim == 3 else 3, keys)
    return keys


def find_cells(position, inverse_cell, blocks, complete, cell):
    """Write the points' cells; (points in no block, points at no possible place)."""
    counts = device.wrapped(device.library().zeros(2, np.int32))
    write_cells(position, inverse_cell, blocks.keys, complete, bits_of(blocks), counts, cell)
    missing, lost = device.seen(counts).tolist()
    return missing, lost


def sorted_bins(cell, blocks):
    """Points by cell."""
    return sorted_points(cell, 64 * blocks)


# The same without the host, so that it can be recorded: the blocks are known to be there.


@formula
def block_beside(hint, x, y, z, keys, neighbour):
    """Number of the block with these integer coordinates, which the block `hint` touches; -1 where it does not."""
    if hint < 0 or hint >= keys.shape[0]:
        return np.int32(-1)
    base = keys[number(hint)]
    dx = np.int32(x - np.int32(base & COORDINATE) + (OFFSET + 1))
    dy = np.int32(y - np.int32((base >> BITS) & COORDINATE) + (OFFSET + 1))
    dz = np.int32(z - np.int32(base >> (2 * BITS)) + (OFFSET + 1))
    if dx < 0 or dx > 2 or dy < 0 or dy > 2 or dz < 0 or dz > 2:
        return np.int32(-1)
    if neighbour.shape[1] == 27:
        return neighbour[number(hint), number(dx + 3 * dy + 9 * dz)]
    return neighbour[number(hint), number(dx + 3 * dy)] if dz == 1 else np.int32(-1)


@formula
def find_place(jx, jy, jz, bits, hint, blocks):
    """(block, number in it) of node j; the block is -1 where there is none. `hint` is where to look first."""
    x, y, z = np.int32(jx), np.int32(jy), np.int32(jz)
    rest = (1 << bits) - 1
    local = np.int32(((y & rest) << bits) | (x & rest))
    if bits == 2:
        local |= np.int32((z & rest) << 4)
        z = np.int32(z >> 2)
    b = block_beside(hint, np.int32(x >> bits), np.int32(y >> bits), z, blocks.keys, blocks.neighbour)
    if b < 0:
        key = key_of(jx, jy, jz, bits)
        found = lower_bound(blocks.keys, key)
        if found < blocks.keys.shape[0] and blocks.keys[found] == key:
            b = np.int32(found)
    return b, local


@cuda_kernel
def count_cells(position, inverse_cell, blocks, complete, held, place, cell):
    """Cell of each particle, and how many of its cell were counted before it; -1 in no block.

    The cell of the step before, or whatever stands there, says where to look first. Behind the counts of the nodes
    `held` counts the particles that are not deep in the blocks, and those at no possible place.
    """
    i = number(cuda.grid(1))
    if i < cell.shape[0]:
        nodes = 64 * complete.shape[0]
        deep = blocks.neighbour.shape[1] == 27
        jx = base_coordinate(position[i, 0], inverse_cell)
        jy = base_coordinate(position[i, 1], inverse_cell)
        jz = base_coordinate(position[i, 2], inverse_cell) if deep else 0
        found = np.int32(-1)
        if jx <= FARTHEST and jy <= FARTHEST and jz <= FARTHEST:
            if deep:
                b, local = find_place(jx, jy, jz, 2, cell[i] >> 6, blocks)
            else:
                b, local = find_place(jx, jy, jz, 3, cell[i] >> 6, blocks)
            state = complete[number(b)] if b >= 0 else 0
            if state != 0:
                found = np.int32(b * 64 + local)
                place[i] = cuda.atomic.add(held, number(found), 1)
            if state != DEEP:
                cuda.atomic.add(held, nodes, 1)
        else:
            cuda.atomic.add(held, nodes + 1, 1)
        cell[i] = found


@cuda_kernel(rows_of="point")
def count_gaps(point, held):
    """The last of `held` <- particles that do not stand in memory right behind the one before them in the lists."""
    i = cuda.grid(1)
    if i + 1 < point.shape[0] and point[i + 1] != point[i] + 1:
        cuda.atomic.add(held, held.shape[0] - 1, 1)


def sort_particles(position, grid, cell, gaps=False):
    """Cells and bins of the particles, whose blocks are there; and, if asked for, how many are out of order."""
    bins, held, sums, place, unsorted, _ = grid.sorting
    device.fill(held, 0)
    blocks = grid.blocks
    count_cells(position, grid.inverse_cell, blocks, grid.complete, held, place, cell)
    sums()
    fill_cells(cell, place, bins.first, unsorted)
    sort_cells(cell, bins.first, unsorted, bins.point)
    if gaps:
        count_gaps(bins.point, held)


def cells(position, carrier_position, surface_sample, grid, cell):
    """Cell of every particle, with the blocks and bins of all point sets brought up to date."""
    if grid.sorting is not None:
        grid.cells["particles"] = cell
        sort_particles(position, grid, cell)
        return
    sets = {"particles": position, "carriers": carrier_position, "samples": surface_sample}
    grid.locate(sets, cell, find_cells, block_keys, sorted_bins)


@cuda_kernel
def weights(position, background, base_node, spline_weight, spline_slope):
    """Section 3: base node, B and h B' of each particle, three for each axis."""
    i = cuda.grid(1)
    if i < base_node.shape[0]:
        for c in range(3):
            j = base_coordinate(position[i, c], background.inverse_cell)
            base_node[i, c] = j
            f = type(background.cell_size)(float(position[i, c]) * background.inverse_cell - float(j))
            w, s = spline_weights(f), spline_slopes(f)
            spline_weight[i, 3 * c], spline_slope[i, 3 * c] = w[0], s[0]
            spline_weight[i, 3 * c + 1], spline_slope[i, 3 * c + 1] = w[1], s[1]
            spline_weight[i, 3 * c + 2], spline_slope[i, 3 * c + 2] = w[2], s[2]


# Points to nodes. A thread adds up the row j of a cell's stencil: nodes (i, j, k), the k-th layer's i-th at 3 k + i.


@formula
def chosen(j, three):
    """three[j], without an array that could not stay in registers."""
    if j == 0:
        return three[0]
    return three[1] if j == 1 else three[2]


@formula
def add_affine_row(total, j, layers, wx, wy, wz, mass, qx, qy, qz, g):
    """Add B (mass, q + g (j - base)) of one point to the row's sums."""
    real = type(mass)
    w_row = chosen(j, wy)
    x = qx + real(j) * g[1]
    y = qy + real(j) * g[4]
    z = qz + real(j) * g[7]
    for k in range(3):
        if k < layers:
            w = w_row * wz[k]
            for i in range(3):
                far = real(i)
                share = w * wx[i]
                total[(3 * k + i) * 4] += share * mass
                total[(3 * k + i) * 4 + 1] += share * (x + far * g[0])
                total[(3 * k + i) * 4 + 2] += share * (y + far * g[3])
                total[(3 * k + i) * 4 + 3] += share * (z + far * g[6])
            x += g[2]
            y += g[5]
            z += g[8]


@formula
def add_gradient_row(total, j, background, wx, wy, wz, sx, sy, sz, t):
    """Add T (h grad B) of one point to the row's sums."""
    w_row, s_row = chosen(j, wy), chosen(j, sy)
    for k in range(3):
        if k < background.layers:
            for i in range(3):
                dx = sx[i] * w_row * wz[k]
                dy = wx[i] * s_row * wz[k]
                dz = wx[i] * w_row * sz[k]
                total[(3 * k + i) * 4 + 1] += t[0] * dx + t[1] * dy + t[2] * dz
                total[(3 * k + i) * 4 + 2] += t[1] * dx + t[3] * dy + t[4] * dz
                total[(3 * k + i) * 4 + 3] += t[2] * dx + t[4] * dy + t[5] * dz


@formula
def deposit_reach(total, at, width, layers, shared):
    """The rows' sums to the nodes in shared memory, from number `at` on, one node of the stencil after the other."""
    for k in range(layers):
        for i in range(3):
            n = at + k * width * width + i
            for c in range(4):
                shared[n + c * REACH] += total[(3 * k + i) * 4 + c]
            cuda.syncthreads()


@formula
def deposit(total, cell, row, background, shared, scratch, b):
    """The rows' sums of all cells of block b to its nodes.

    Each row of the stencils has nodes of its own in shared memory, so that no two threads meet; they hold all masses,
    then all momenta along each axis, so that nodes side by side lie in different banks.
    """
    thread = number(cuda.threadIdx.x)
    n = thread
    while n < ALL_SUMS:
        shared[n] = type(background.cell_size)(0)
        n += ROWS
    cuda.syncthreads()
    own = row * SUMS
    if background.layers == 3:
        deposit_reach(total, number(own + ((cell >> 4) * 6 + ((cell >> 2) & 3) + row) * 6 + (cell & 3)), 6, 3, shared)
    else:
        deposit_reach(total, number(own + ((cell >> 3) + row) * 10 + (cell & 7)), 10, 1, shared)
    n = thread
    while n < 4 * scratch.shape[1]:
        at = (n & 3) * REACH + (n >> 2)
        scratch[b, n >> 2, n & 3] = shared[at] + shared[at + SUMS] + shared[at + 2 * SUMS]
        n += ROWS


@formula
def keep_field(records, at, fx, fy, fz, mass, qx, qy, qz, g, moment):
    """A point as the numbers at place `at` in shared memory."""
    records[0, at], records[1, at], records[2, at], records[3, at] = fx, fy, fz, mass
    records[4, at], records[5, at], records[6, at] = qx, qy, qz
    records[7, at], records[8, at], records[9, at] = g[0], g[1], g[2]
    records[10, at], records[11, at], records[12, at] = g[3], g[4], g[5]
    records[13, at], records[14, at], records[15, at] = g[6], g[7], g[8]
    records[16, at] = moment


@formula
def add_kept_row(total, row, background, records, at, kernel_gradient):
    """Add the point at place `at` in shared memory to the row's sums."""
    wx, wy = spline_weights(records[0, at]), spline_weights(records[1, at])
    wz = particle.layer_weights(records[2, at], background)
    g = (
        records[7, at], records[8, at], records[9, at], records[10, at], records[11, at], records[12, at],
        records[13, at], records[14, at], records[15, at],
    )  # fmt: skip
    mass, qx, qy, qz = records[3, at], records[4, at], records[5, at], records[6, at]
    if background.layers == 3:
        add_affine_row(total, row, 3, wx, wy, wz, mass, qx, qy, qz, g)
    else:
        add_affine_row(total, row, 1, wx, wy, wz, mass, qx, qy, qz, g)
    if kernel_gradient is not None:
        p = -records[16, at] / background.cell_size
        zero = type(p)(0)
        sx, sy = spline_slopes(records[0, at]), spline_slopes(records[1, at])
        sz = particle.layer_slopes(records[2, at], background)
        add_gradient_row(total, row, background, wx, wy, wz, sx, sy, sz, (p, zero, zero, p, zero, p))


@cuda_kernel(block_for_each_row=True, threads=ROWS)
def scatter_particles(
    bins, position, velocity, mass, affine, volume_ratio, acceleration, cell, liquid, background, timestep,
    cluster_share, inverse_spread, embedding, kernel_gradient, blocks, scratch,
):  # fmt: skip
    """What each block's particles give to the nodes in their reach."""
    b = number(cuda.blockIdx.x)
    if bins.first[64 * b] == bins.first[64 * b + 64]:
        return
    thread = number(cuda.threadIdx.x)
    own_cell, row = thread & 63, thread >> 6
    first, last = number(bins.first[64 * b + own_cell]), number(bins.first[64 * b + own_cell + 1])
    shared = cuda.shared.array(ALL_SUMS, scratch.dtype)
    records = cuda.shared.array((RECORD, IN_TURN), scratch.dtype)
    total = cuda.local.array(36, scratch.dtype)
    for n in range(36):
        total[n] = type(background.cell_size)(0)
    origin = node_coordinates(blocks, b * 64)
    known = position.shape[1] == 3 and velocity.shape[1] == 3 and affine.shape[1] == 9  # the compiler should, too
    # Every thread brings one particle, three of each cell, so that all threads have as many to add up.
    cell_of, rank = quotient(thread, 3), thread - 3 * quotient(thread, 3)
    at, end = bins.first[64 * b + cell_of] + rank, bins.first[64 * b + cell_of + 1]
    while cuda.syncthreads_or(np.int32(first < last)) and known:
        if at < end:
            i = number(bins.point[number(at)])
            fx, fy, fz, _, _, _ = particle.place(i, position, cell, origin, background)
            own, qx, qy, qz, g, moment = particle.particle_field(
                i, fx, fy, fz, velocity, mass, affine, volume_ratio, acceleration, liquid, background, timestep,
                cluster_share, inverse_spread, embedding, kernel_gradient,
            )  # fmt: skip
            keep_field(records, number(rank * APART + cell_of), fx, fy, fz, own, qx, qy, qz, g, moment)
        cuda.syncthreads()
        for k in range(3):
            if first + k < last:
                add_kept_row(total, row, background, records, own_cell + k * APART, kernel_gradient)
        at += 3
        first += 3
    deposit(total, own_cell, row, background, shared, scratch, b)


@cuda_kernel(block_for_each_row=True, threads=ROWS)
def scatter_carriers(
    bins, carrier_position, carrier_owner, carrier_cell, position, velocity, mass, affine, volume_ratio, acceleration,
    liquid, background, timestep, cluster_share, inverse_spread, embedding, blocks, scratch,
):  # fmt: skip
    """What each block's embedded points give to the nodes in their reach."""
    b = cuda.blockIdx.x
    start, end = bins.first[64 * b], bins.first[64 * b + 64]
    if start == end:
        return
    thread = cuda.threadIdx.x
    own_cell, row = thread & 63, thread >> 6
    first, last = bins.first[64 * b + own_cell], bins.first[64 * b + own_cell + 1]
    shared = cuda.shared.array(ALL_SUMS, scratch.dtype)
    records = cuda.shared.array((RECORD, PADDED), scratch.dtype)
    total = cuda.local.array(36, scratch.dtype)
    for n in range(36):
        total[n] = type(background.cell_size)(0)
    origin = node_coordinates(blocks, b * 64)
    while start < end:
        stop = min(start + CHUNK, end)
        for at in range(start + thread, stop, ROWS):
            c = bins.point[at]
            fx, fy, fz, _, _, _ = particle.place(c, carrier_position, carrier_cell, origin, background)
            own, qx, qy, qz, g = particle.carrier_field(
                c, fx, fy, fz, carrier_position, carrier_owner, position, velocity, mass, affine, volume_ratio,
                acceleration, liquid, background, timestep, cluster_share, inverse_spread, embedding,
            )  # fmt: skip
            keep_field(records, at - start + ((at - start) >> 3), fx, fy, fz, own, qx, qy, qz, g, own)
        cuda.syncthreads()
        for at in range(max(first, start), min(last, stop)):
            add_kept_row(total, row, background, records, at - start + ((at - start) >> 3), None)
        cuda.syncthreads()
        start = stop
    deposit(total, own_cell, row, background, shared, scratch, b)


@formula
def collect_node(n, bits, width, layers, bins, blocks, scratch):
    """(m, mv) of node n from the points of its block and of those below it, which reach it."""
    rest = (1 << bits) - 1
    b, node = n >> 6, n & 63
    x, y, z = node & rest, (node >> bits) & rest, node >> (2 * bits)
    zero = type(scratch[0, 0, 0])(0)
    m, px, py, pz = zero, zero, zero, zero
    for dz in range(2 if layers == 3 else 1):
        for dy in range(2):
            for dx in range(2):
                if (dx == 0 or x < 2) and (dy == 0 or y < 2) and (dz == 0 or z < 2):
                    s = blocks.neighbour[b, blocks.neighbour.shape[1] // 2 - dx - 3 * dy - 9 * dz]
                    if s >= 0 and bins.first[64 * number(s) + 64] > bins.first[64 * number(s)]:
                        at = ((z + (dz << bits)) * width + y + (dy << bits)) * width + x + (dx << bits)
                        m += scratch[number(s), at, 0]
                        px += scratch[number(s), at, 1]
                        py += scratch[number(s), at, 2]
                        pz += scratch[number(s), at, 3]
    return m, px, py, pz


@cuda_kernel
def collect(bins, blocks, add, scratch, node_momentum, node_mass):
    """m_j and (mv)_j from what the blocks' points gave; added to what stands there where `add`."""
    n = number(cuda.grid(1))
    if n < node_mass.shape[0]:
        if blocks.neighbour.shape[1] == 27:
            m, px, py, pz = collect_node(n, 2, 6, 3, bins, blocks, scratch)
        else:
            m, px, py, pz = collect_node(n, 3, 10, 1, bins, blocks, scratch)
        if add:
            m += node_mass[n]
            px += node_momentum[n, 0]
            py += node_momentum[n, 1]
            pz += node_momentum[n, 2]
        node_mass[n] = m
        node_momentum[n, 0] = px
        node_momentum[n, 1] = py
        node_momentum[n, 2] = pz


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
    collect(bins, grid.blocks, False, scratch, node_momentum, node_mass)


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
    collect(bins, grid.blocks, True, scratch, node_momentum, node_mass)


# On the nodes


@cuda_kernel
def update_nodes(
    node_mass, node_momentum, node_pull, field, planes, mirrors, least_mass, timestep, blocks, node_velocity
):
    """(4.19) and the walls, for every node."""
    n = cuda.grid(1)
    if n < node_velocity.shape[0]:
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


# Nodes to points: the velocities in the reach of a block go to shared memory, then a thread takes a particle.


@formula
def load_reach(b, blocks, width, bits, deep, node_velocity, values):
    """`load_block` for a block's width and depth that the compiler knows, so that it need not divide."""
    rest = (1 << bits) - 1
    middle = 13 if deep > 1 else 4
    at = number(cuda.threadIdx.x)
    while at < width * width * deep:
        line, z = quotient(at, width), quotient(at, width * width)
        x, y = at - line * width, line - z * width
        s = number(blocks.neighbour[b, number(middle + (x >> bits) + 3 * (y >> bits) + 9 * (z >> bits))])
        n = 64 * s + (((z & rest) << (2 * bits)) | ((y & rest) << bits) | (x & rest))
        for c in range(3):
            values[at, c] = node_velocity[n, c]
        at += GATHERING


@formula
def load_block(b, blocks, background, node_velocity, values):
    """values (width^dim, 3): velocities of the nodes in the reach of block b."""
    if background.layers == 3:
        load_reach(b, blocks, 6, 2, 6, node_velocity, values)
    else:
        load_reach(b, blocks, 10, 3, 1, node_velocity, values)
    cuda.syncthreads()


@formula
def moments(x, y, z, fx, fy, fz, background, values):
    """`particle.moments` at node (x, y, z) of the block, with widths that the compiler knows."""
    wx, wy = spline_weights(fx), spline_weights(fy)
    if background.layers == 3:
        return particle.moments((z * 6 + y) * 6 + x, 6, 3, wx, wy, spline_weights(fz), values)
    return particle.moments(y * 10 + x, 10, 1, wx, wy, particle.layer_weights(fz, background), values)


@formula
def largest_of_block(values):
    """values[c, 0] <- largest of the row, a number for each of the block's threads, which have just written it."""
    thread = number(cuda.threadIdx.x)
    parts = values.shape[1] // EIGHT
    cuda.syncthreads()
    most = values[0, 0]
    row = quotient(thread, parts)
    if row < values.shape[0]:
        most = values[row, thread - row * parts]
        for k in range(1, EIGHT):
            most = max(most, values[row, thread - row * parts + k * parts])
    cuda.syncthreads()
    if row < values.shape[0]:
        values[row, thread - row * parts] = most
    cuda.syncthreads()
    if thread < values.shape[0]:
        most = values[thread, 0]
        for k in range(1, parts):
            most = max(most, values[thread, k])
        values[thread, 0] = most
    cuda.syncthreads()


@formula
def put_rows(numbers, count, width, rows, out):
    """The first rows of `width` numbers in shared memory to the points with these numbers, in their order in memory."""
    for k in range(width):
        at = number(cuda.threadIdx.x) + k * GATHERING
        row = quotient(at, width)
        if row < count:
            c = number(at - row * width)
            out[number(numbers[row]), c] = rows[row, c]


@cuda_kernel(block_for_each_row=True, threads=GATHERING, rows_of="block_extremes", registers=64)
def gather(
    bins, node_velocity, cell, liquid, background, timestep, blocks, cluster_share, inverse_spread, embedding,
    carrier_first, carrier_position, carrier_moment, build_position, block_extremes, velocity, affine, volume_ratio,
    deformation, position,
):  # fmt: skip
    """Every particle takes its velocity, gradient, volume and place from the nodes.

    block_extremes (b, 5): largest squared way, -J, J, |tr A| and squared jump of each block's particles.
    """
    b, thread = number(cuda.blockIdx.x), number(cuda.threadIdx.x)
    real = type(background.cell_size)
    far, least, most, fast, jump = real(0), real(-math.inf), real(-math.inf), real(0), real(0)
    begin, end = number(bins.first[64 * b]), number(bins.first[64 * b + 64])
    # The widths, so that the compiler knows them.
    known = node_velocity.shape[1] == 3 and velocity.shape[1] == 3 and position.shape[1] == 3 and affine.shape[1] == 9
    if begin < end and known:
        values = cuda.shared.array((REACH, 3), velocity.dtype)
        best = cuda.shared.array((5, GATHERING), velocity.dtype)
        matrix = cuda.shared.array((GATHERING, 9), velocity.dtype)
        speed = cuda.shared.array((GATHERING, 3), velocity.dtype)
        moved = cuda.shared.array((GATHERING, 3), velocity.dtype)
        numbers = cuda.shared.array(GATHERING, np.int32)
        origin = node_coordinates(blocks, b * 64)
        load_block(b, blocks, background, node_velocity, values)
        while begin < end:
            if begin + thread < end:
                i = number(bins.point[begin + thread])
                numbers[thread] = i
                fx, fy, fz, x, y, z = particle.place(i, position, cell, origin, background)
                sums = moments(x, y, z, fx, fy, fz, background, values)
                way, ratio, rate, leap = particle.gather(
                    i, thread, sums, fx, fy, fz, background, liquid, timestep, cluster_share, inverse_spread, embedding,
                    carrier_first, carrier_position, carrier_moment, build_position, position, volume_ratio,
                    deformation, speed, matrix, moved,
                )  # fmt: skip
                far, least, most, fast = max(far, way), max(least, -ratio), max(most, ratio), max(fast, rate)
                jump = max(jump, leap)
            cuda.syncthreads()
            # Rows of numbers, written by all threads together: neighbours in memory by neighbours in the block.
            count = min(GATHERING, end - begin)
            put_rows(numbers, count, 9, matrix, affine)
            put_rows(numbers, count, 3, speed, velocity)
            put_rows(numbers, count, 3, moved, position)
            cuda.syncthreads()
            begin += GATHERING
        best[0, thread], best[1, thread], best[2, thread] = far, least, most
        best[3, thread], best[4, thread] = fast, jump
        largest_of_block(best)
        far, least, most, fast, jump = best[0, 0], best[1, 0], best[2, 0], best[3, 0], best[4, 0]
    if thread == 0:
        block_extremes[b, 0] = far
        block_extremes[b, 1] = least
        block_extremes[b, 2] = most
        block_extremes[b, 3] = fast
        block_extremes[b, 4] = jump


@cuda_kernel(block_for_each_row=True, threads=SUMMING, rows_of="step_extremes")
def reduce_extremes(block_extremes, displacement, step_extremes):
    """Extremes of all blocks; each of the thread blocks finds one, the first one two."""
    real = displacement.dtype.type
    best = cuda.shared.array((1, SUMMING), displacement.dtype)
    for c in range(cuda.blockIdx.x, 5, 4):
        mine = real(-math.inf)
        for b in range(cuda.threadIdx.x, block_extremes.shape[0], SUMMING):
            mine = max(mine, block_extremes[b, c])
        cuda.syncthreads()
        best[0, cuda.threadIdx.x] = mine
        largest_of_block(best)
        mine = best[0, 0]
        if cuda.threadIdx.x == 0:
            some = mine > real(-math.inf)
            if c == 0:
                displacement[0] = mine if some else real(0)
                displacement[1] = real(0)
            elif c == 1:
                step_extremes[0] = -mine if some else real(1)
            elif c == 2:
                step_extremes[1] = mine if some else real(1)
            else:
                step_extremes[c - 1] = mine if some else real(0)


def grid_to_particle(
    node_velocity, liquid, background, timestep, cluster_share, inverse_spread, embedding, carrier_first,
    carrier_position, carrier_moment, build_position, grid, displacement, step_extremes, velocity, affine,
    volume_ratio, deformation, position,
):  # fmt: skip
    """(4.12), (4.13) or the cluster's, (4.16), (4.8): velocity, affine matrix, volume ratio and position."""
    extremes = grid.block_extremes
    gather(
        grid.bins["particles"], node_velocity, grid.cells["particles"], liquid, background, timestep, grid.blocks,
        cluster_share, inverse_spread, embedding, carrier_first, carrier_position, carrier_moment, build_position,
        extremes,
        velocity, affine, volume_ratio, deformation, position,
    )  # fmt: skip
    reduce_extremes(extremes, displacement, step_extremes)


@cuda_kernel(block_for_each_row=True, threads=GATHERING, rows_of="complete")
def gather_carriers(bins, node_velocity, carrier_position, carrier_cell, background, blocks, complete, carrier_moment):
    """Moments of the nodes' velocities about every embedded point; a thread block for each row of `complete`."""
    b = cuda.blockIdx.x
    if bins.first[64 * b + 64] == bins.first[64 * b]:
        return
    values = cuda.shared.array((REACH, 3), node_velocity.dtype)
    origin = node_coordinates(blocks, b * 64)
    load_block(b, blocks, background, node_velocity, values)
    for at in range(bins.first[64 * b] + cuda.threadIdx.x, bins.first[64 * b + 64], cuda.blockDim.x):
        i = bins.point[at]
        fx, fy, fz, x, y, z = particle.place(i, carrier_position, carrier_cell, origin, background)
        sums = moments(x, y, z, fx, fy, fz, background, values)
        m = particle.centred(sums, fx, fy, fz, background.cell_size)
        carrier_moment[i, 0], carrier_moment[i, 1], carrier_moment[i, 2] = sums[0], sums[1], sums[2]
        for c in range(9):
            carrier_moment[i, 3 + c] = m[c]


def grid_to_carriers(node_velocity, carrier_position, background, grid, carrier_moment):
    """Sums of B v and B v (x_j - x_q)^T about every embedded point."""
    cell = grid.cells["carriers"]
    gather_carriers(
        grid.bins["carriers"], node_velocity, carrier_position, cell, background, grid.blocks, grid.complete,
        carrier_moment,
    )  # fmt: skip


# Embedding


@cuda_kernel
def embed_all(
    position, surface_sample, order, first, cell_size, carrier_first, carrier_position, carrier_owner,
    inverse_spread, cluster_share,
):  # fmt: skip
    """Section 5 for every particle."""
    i = cuda.grid(1)
    if i < cluster_share.shape[0]:
        particle.embed(
            i, position, surface_sample, order, first, cell_size, carrier_first, carrier_position, carrier_owner,
            cluster_share, inverse_spread,
        )  # fmt: skip


def embed(
    position, surface_sample, sample_owner, background, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Section 5: embedded points by owner, the clusters' shares and inverse moments."""
    xp = device.library()
    nearest, n = device.seen(sample_owner), position.shape[0]
    order = xp.argsort(nearest, kind="stable").astype(np.int32) if len(nearest) else xp.zeros(0, np.int32)
    first = xp.searchsorted(nearest[order], xp.arange(n + 1, dtype=np.int32)).astype(np.int32)
    order, first = device.wrapped(order), device.wrapped(first)
    embed_all(
        position, surface_sample, order, first, background.cell_size, carrier_first, carrier_position, carrier_owner,
        inverse_spread, cluster_share,
    )  # fmt: skip


@cuda_kernel
def contact(sample_position, sample_line, spline_cells, blocks, surface_term, contact, node_force):
    """Young's force on the nodes, added to the surface's [N]."""
    i = cuda.grid(1)
    if i < node_force.shape[0]:
        fx, fy, fz = particle.contact_pull(i, sample_position, sample_line, spline_cells, blocks, surface_term, contact)
        node_force[i, 0] += fx
        node_force[i, 1] += fy
        node_force[i, 2] += fz


@cuda_kernel
def viscosity(volume_ratio, inverse_spread, viscous_stress, timestep, affine):
    """Affine matrices after the viscous stress of a step."""
    i = cuda.grid(1)
    if i < affine.shape[0]:
        rows = particle.viscosity(i, affine, volume_ratio, inverse_spread, viscous_stress, timestep)
        for c in range(3):
            affine[i, c], affine[i, 3 + c], affine[i, 6 + c] = rows[0][c], rows[1][c], rows[2][c]


@cuda_kernel
def count_all(position, volume_ratio, node_mass, cell, background, counting, blocks, greatest_crowding, crowding):
    """Counted over known density of every particle, and the largest; what is no number counts as infinite."""
    i = cuda.grid(1)
    real = type(background.cell_size)
    own = real(0)
    if i < crowding.shape[0]:
        own = particle.crowding(i, position, volume_ratio, node_mass, cell, background, counting, blocks)
        crowding[i] = own
        if not own < real(math.inf):
            own = real(math.inf)
    # What was read too early costs a look at the block and no more: the largest only grows.
    if cuda.syncthreads_or(np.int32(own > greatest_crowding[0])) == 0:
        return
    shared = cuda.shared.array(THREADS_PER_BLOCK, crowding.dtype)
    thread = cuda.threadIdx.x
    shared[thread] = own
    half = cuda.blockDim.x // 2
    while half > 0:
        cuda.syncthreads()
        if thread < half:
            shared[thread] = max(shared[thread], shared[thread + half])
        half //= 2
    if thread == 0:
        cuda.atomic.max(greatest_crowding, 0, shared[0])


def count(position, volume_ratio, node_mass, background, counting, grid, greatest_crowding, crowding):
    """Counted over known density of every particle, and the largest."""
    device.fill(greatest_crowding, 0)
    count_all(
        position, volume_ratio, node_mass, grid.cells["particles"], background, counting, grid.blocks,
        greatest_crowding, crowding,
    )  # fmt: skip


@cuda_kernel
def recount(crowding, recounting, timestep, background, deformation, volume_ratio):
    """Volume ratios that follow the counted density."""
    i = cuda.grid(1)
    if i < volume_ratio.shape[0]:
        particle.recount(i, crowding, recounting, timestep, background, deformation, volume_ratio)
