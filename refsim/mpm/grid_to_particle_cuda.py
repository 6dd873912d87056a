"""Nodes to particles and embedded points, on a GPU: one thread block for each block of nodes.

The velocities in the reach of the block go to shared memory; then a thread takes a particle.
"""

import math

import numpy as np

from refsim.backends.compile import cuda, cuda_kernel, formula
from refsim.backends.runtime import simulated
from refsim.mpm.grid_to_particle import centred, move_particle, put_moments
from refsim.mpm.groups import Moved
from refsim.mpm.kernels import place, stencil_weights
from refsim.mpm.particle_to_grid_cuda import REACH, quotient
from refsim.sparse_grid.block_search_cuda import SUMMING, number
from refsim.sparse_grid.formulas import node_coordinates

GATHERING = 16 if simulated() else 128  # threads; more than a row of the affine matrices has numbers
EIGHT = 8  # numbers of which a thread finds the largest


@formula
def row_moments(n, w0, w1, w2, c, values):
    """Sums over the nodes n, n + 1, n + 2 of a row: w v and w v i, i from 0, of the component c."""
    u1, u2 = w1 * values[n + 1, c], w2 * values[n + 2, c]
    return w0 * values[n, c] + u1 + u2, u1 + (u2 + u2)


@formula
def layer_moments(n, width, wx, wy, c, values):
    """Sums over a layer of the stencil from node n on: w v, w v i, w v j of the component c."""
    a0, b0 = row_moments(n, wx[0], wx[1], wx[2], c, values)
    a1, b1 = row_moments(n + width, wx[0], wx[1], wx[2], c, values)
    a2, b2 = row_moments(n + 2 * width, wx[0], wx[1], wx[2], c, values)
    a1 *= wy[1]
    a2 *= wy[2]
    return wy[0] * a0 + a1 + a2, wy[0] * b0 + wy[1] * b1 + wy[2] * b2, a1 + (a2 + a2)


@formula
def component_moments(at, width, layers, weights, c, values):
    """Sums over the stencil from node `at` on: B v, B v i, B v j, B v k of the component c; the plane has one layer."""
    wx, wy, wz = weights
    a0, x0, y0 = layer_moments(at, width, wx, wy, c, values)
    if layers == 1:
        return a0, x0, y0, type(a0)(0)
    a1, x1, y1 = layer_moments(at + width * width, width, wx, wy, c, values)
    a2, x2, y2 = layer_moments(at + 2 * width * width, width, wx, wy, c, values)
    a1 *= wz[1]
    a2 *= wz[2]
    x = wz[0] * x0 + wz[1] * x1 + wz[2] * x2
    y = wz[0] * y0 + wz[1] * y1 + wz[2] * y2
    return wz[0] * a0 + a1 + a2, x, y, a1 + (a2 + a2)


@formula
def stencil_moments(at, width, layers, weights, values):
    """Sums over the stencil's nodes: B v (3) and B v (j - base)^T (9); values (nodes, 3) [m/s]."""
    vx, xx, xy, xz = component_moments(at, width, layers, weights, 0, values)
    vy, yx, yy, yz = component_moments(at, width, layers, weights, 1, values)
    vz, zx, zy, zz = component_moments(at, width, layers, weights, 2, values)
    return (vx, vy, vz), (xx, xy, xz, yx, yy, yz, zx, zy, zz)


@formula
def load_reach(b, blocks, width, bits, deep, node_velocity, values):
    """`load_block` for a width and depth that the compiler knows, to avoid divisions."""
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
def moments(place, f, background, values):
    """`stencil_moments` at the node of this place in the block, with widths that the compiler knows."""
    x, y, z = place
    weights = stencil_weights(f, background)
    if background.layers == 3:
        return stencil_moments((z * 6 + y) * 6 + x, 6, 3, weights, values)
    return stencil_moments(y * 10 + x, 10, 1, weights, values)


@formula
def largest_of_rows(values):
    """values[c, 0] <- largest of row c, which has one number for each thread of the block, just written by it."""
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
    """Copy the first `count` rows of `width` values from shared memory to the points with these numbers, if asked."""
    if out is not None:
        for k in range(width):
            at = number(cuda.threadIdx.x) + k * GATHERING
            row = quotient(at, width)
            if row < count:
                c = number(at - row * width)
                out[number(numbers[row]), c] = rows[row, c]


@formula
def shared_rest(position_residual, ends):
    """Shared memory for the residuals of the threads' positions, if there are any."""
    if position_residual is not None:
        return cuda.shared.array((GATHERING, 3), ends.dtype)
    return None


@cuda_kernel(block_for_each_row=True, threads=GATHERING, registers=64)
def gather(places, node_velocity, medium, cluster, carriers, build_position, moved, block_extremes):
    """Velocity, gradient, volume ratio and position of every particle; extremes as on a CPU."""
    b, thread = number(cuda.blockIdx.x), number(cuda.threadIdx.x)
    bins, background = places.bins, medium.background
    real = type(background.cell_size)
    far, least, most, fast, jump = real(0), real(-math.inf), real(-math.inf), real(0), real(0)
    begin, end = number(bins.first[64 * b]), number(bins.first[64 * b + 64])
    # Tells the compiler the widths.
    known = node_velocity.shape[1] == 3 and moved.velocity.shape[1] == 3
    known = known and moved.position.shape[1] == 3 and moved.affine.shape[1] == 9
    if begin < end and known:
        values = cuda.shared.array((REACH, 3), node_velocity.dtype)
        best = cuda.shared.array((5, GATHERING), node_velocity.dtype)
        matrix = cuda.shared.array((GATHERING, 9), node_velocity.dtype)
        speed = cuda.shared.array((GATHERING, 3), node_velocity.dtype)
        ends = cuda.shared.array((GATHERING, 3), node_velocity.dtype)
        rest = shared_rest(moved.position_residual, ends)
        landed = Moved(speed, matrix, None, None, rest, ends)
        numbers = cuda.shared.array(GATHERING, np.int32)
        origin = node_coordinates(places.blocks, b * 64)
        load_block(b, places.blocks, background, node_velocity, values)
        while begin < end:
            if begin + thread < end:
                i = number(bins.point[begin + thread])
                numbers[thread] = i
                f, base = place(i, moved.position, places.cell, origin, background)
                sums = moments(base, f, background, values)
                squared, ratio, rate, leap = move_particle(
                    i, thread, sums, f, medium, cluster, carriers, build_position, moved, landed
                )
                far, least, most, fast = max(far, squared), max(least, -ratio), max(most, ratio), max(fast, rate)
                jump = max(jump, leap)
            cuda.syncthreads()
            # All threads write the rows together: neighbouring threads write contiguous memory.
            count = min(GATHERING, end - begin)
            put_rows(numbers, count, 9, matrix, moved.affine)
            put_rows(numbers, count, 3, speed, moved.velocity)
            put_rows(numbers, count, 3, ends, moved.position)
            put_rows(numbers, count, 3, rest, moved.position_residual)
            cuda.syncthreads()
            begin += GATHERING
        best[0, thread], best[1, thread], best[2, thread] = far, least, most
        best[3, thread], best[4, thread] = fast, jump
        largest_of_rows(best)
        far, least, most, fast, jump = best[0, 0], best[1, 0], best[2, 0], best[3, 0], best[4, 0]
    if thread == 0:
        block_extremes[b, 0], block_extremes[b, 1], block_extremes[b, 2] = far, least, most
        block_extremes[b, 3], block_extremes[b, 4] = fast, jump


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
        largest_of_rows(best)
        mine = best[0, 0]
        if cuda.threadIdx.x == 0:
            some = mine > real(-math.inf)
            if c == 0:
                displacement[0] = mine if some else real(0)
                displacement[1] = displacement[2] = real(0)
            elif c == 1:
                step_extremes[0] = -mine if some else real(1)
            elif c == 2:
                step_extremes[1] = mine if some else real(1)
            else:
                step_extremes[c - 1] = mine if some else real(0)


@cuda_kernel(block_for_each_row=True, threads=GATHERING, rows_of="complete")
def gather_carriers(places, node_velocity, carrier_position, background, complete, carrier_moment):
    """Moments of the nodes' velocities about every embedded point; a thread block for each row of `complete`."""
    bins, b = places.bins, cuda.blockIdx.x
    if bins.first[64 * b + 64] == bins.first[64 * b]:
        return
    values = cuda.shared.array((REACH, 3), node_velocity.dtype)
    origin = node_coordinates(places.blocks, b * 64)
    load_block(b, places.blocks, background, node_velocity, values)
    for at in range(bins.first[64 * b] + cuda.threadIdx.x, bins.first[64 * b + 64], cuda.blockDim.x):
        c = bins.point[at]
        f, base = place(c, carrier_position, places.cell, origin, background)
        v, m = moments(base, f, background, values)
        put_moments(c, v, centred(v, m, f, background.cell_size), carrier_moment)
