"""Particles and embedded points to nodes, on a GPU: one thread block for each block of nodes.

The threads bring points into shared memory, each as an affine field; three threads for each cell (one for each row of
its stencil) add up the cell's points in registers; then, in a fixed order, the sums of the cells go to the block's
nodes in shared memory, one node of the stencil at a time, so that no two threads write the same node. There is no
atomic addition of floats: results repeat bit for bit.
"""

import numpy as np

from refsim.backends.compile import cuda, cuda_kernel, formula
from refsim.mpm.kernels import place, stencil_slopes, stencil_weights
from refsim.mpm.particle_to_grid import carrier_field, particle_field
from refsim.sparse_grid.block_search_cuda import number
from refsim.sparse_grid.formulas import node_coordinates

ROWS = 192  # threads of a block that scatters: three for each of 64 cells
REACH = 216  # nodes in the reach of a block: 6 x 6 x 6, or 10 x 10 in the plane
SUMS = 4 * REACH  # mass and momentum of each
ALL_SUMS = 3 * SUMS  # one for each row of a stencil
APART = 75  # between points of a cell that are added in turn: those of eleven cells lie in different banks
IN_TURN = 3 * APART
RECORD = 17  # numbers of a point: offsets, mass, value and gradient of its field, moment of its stress


@formula
def quotient(at, width):
    """at // width for at >= 0; with a width known to the compiler this is a multiplication."""
    return np.int64(np.uint32(at) // np.uint32(width))


# A thread adds up the row j of a cell's stencil: nodes (i, j, k), the i-th of layer k at 3 k + i.


@formula
def chosen(j, three):
    """three[j], without an array that could not stay in registers."""
    if j == 0:
        return three[0]
    return three[1] if j == 1 else three[2]


@formula
def add_affine_row(total, j, layers, weights, mass, q, g):
    """Add B (mass, q + g (j - base)) of one point to the row's sums."""
    real = type(mass)
    wx, wy, wz = weights
    w_row = chosen(j, wy)
    x = q[0] + real(j) * g[1]
    y = q[1] + real(j) * g[4]
    z = q[2] + real(j) * g[7]
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
def add_gradient_row(total, j, background, weights, slopes, p):
    """Add p (h grad B) of one point to the row's sums."""
    wx, wy, wz = weights
    sx, sy, sz = slopes
    w_row, s_row = chosen(j, wy), chosen(j, sy)
    for k in range(3):
        if k < background.layers:
            for i in range(3):
                dx = sx[i] * w_row * wz[k]
                dy = wx[i] * s_row * wz[k]
                dz = wx[i] * w_row * sz[k]
                total[(3 * k + i) * 4 + 1] += p * dx
                total[(3 * k + i) * 4 + 2] += p * dy
                total[(3 * k + i) * 4 + 3] += p * dz


@formula
def deposit_reach(total, at, width, layers, shared):
    """Add the rows' sums to the nodes in shared memory from number `at` on, one node of the stencil after the other."""
    for k in range(layers):
        for i in range(3):
            n = at + k * width * width + i
            for c in range(4):
                shared[n + c * REACH] += total[(3 * k + i) * 4 + c]
            cuda.syncthreads()


@formula
def deposit(total, cell, row, background, shared, scratch, b):
    """Add the rows' sums of all cells of block b to its nodes.

    Each row of the stencils has its own copy of the nodes in shared memory, so that no two threads write the same one.
    A copy holds all masses, then all momenta along each axis, so that adjacent nodes lie in different banks.
    """
    thread = number(cuda.threadIdx.x)
    n = thread
    while n < ALL_SUMS:
        shared[n] = type(background.cell_size)(0)
        n += ROWS
    cuda.syncthreads()
    first = row * SUMS
    if background.layers == 3:
        deposit_reach(total, number(first + ((cell >> 4) * 6 + ((cell >> 2) & 3) + row) * 6 + (cell & 3)), 6, 3, shared)
    else:
        deposit_reach(total, number(first + ((cell >> 3) + row) * 10 + (cell & 7)), 10, 1, shared)
    n = thread
    while n < 4 * scratch.shape[1]:
        at = (n & 3) * REACH + (n >> 2)
        scratch[b, n >> 2, n & 3] = shared[at] + shared[at + SUMS] + shared[at + 2 * SUMS]
        n += ROWS


@formula
def keep_field(records, at, f, mass, q, g, moment):
    """Store a point at place `at` in shared memory."""
    records[3, at], records[16, at] = mass, moment
    for c in range(3):
        records[c, at], records[4 + c, at] = f[c], q[c]
    for c in range(9):
        records[7 + c, at] = g[c]


@formula
def add_kept_row(total, row, background, records, at, kernel_gradient):
    """Add the point at place `at` in shared memory to the row's sums."""
    f = (records[0, at], records[1, at], records[2, at])
    weights = stencil_weights(f, background)
    q = (records[4, at], records[5, at], records[6, at])
    g = (
        records[7, at], records[8, at], records[9, at], records[10, at], records[11, at], records[12, at],
        records[13, at], records[14, at], records[15, at],
    )  # fmt: skip
    if background.layers == 3:
        add_affine_row(total, row, 3, weights, records[3, at], q, g)
    else:
        add_affine_row(total, row, 1, weights, records[3, at], q, g)
    if kernel_gradient is not None:
        p = -records[16, at] / background.cell_size
        add_gradient_row(total, row, background, weights, stencil_slopes(f, background), p)


@cuda_kernel(block_for_each_row=True, threads=ROWS)
def scatter(places, position, carriers, particles, medium, cluster, kernel_gradient, scratch):
    """Sums of each block's points at `position` on the nodes in their reach; particles, unless there are carriers."""
    bins, background, b = places.bins, medium.background, number(cuda.blockIdx.x)
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
    origin = node_coordinates(places.blocks, b * 64)
    known = position.shape[1] == 3 and particles.velocity.shape[1] == 3  # to the compiler, too
    known = known and particles.affine.shape[1] == 9
    # Every thread loads one point, three of each cell, so that all threads have equally many to add up.
    cell_of, rank = quotient(thread, 3), thread - 3 * quotient(thread, 3)
    at, end = bins.first[64 * b + cell_of] + rank, bins.first[64 * b + cell_of + 1]
    while cuda.syncthreads_or(np.int32(first < last)) and known:
        if at < end:
            i = number(bins.point[number(at)])
            f, _ = place(i, position, places.cell, origin, background)
            if carriers is None:
                mass, q, g, moment = particle_field(i, f, particles, medium, cluster, kernel_gradient)
            else:
                mass, q, g = carrier_field(i, f, carriers, particles, medium, cluster)
                moment = mass
            keep_field(records, number(rank * APART + cell_of), f, mass, q, g, moment)
        cuda.syncthreads()
        for k in range(3):
            if first + k < last:
                add_kept_row(total, row, background, records, own_cell + k * APART, kernel_gradient)
        at += 3
        first += 3
    deposit(total, own_cell, row, background, shared, scratch, b)
