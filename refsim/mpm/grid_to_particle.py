"""Nodes to particles and embedded points, on a CPU: block by block, from a copy of the velocities in the block's reach.

`grid_to_particle_cuda` has the CUDA kernels.
"""

import math

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import (
    added,
    determinant,
    difference,
    nine,
    outer,
    product,
    put,
    scaled,
    symmetric,
    three,
    three_of,
    trace,
    two_of,
)
from refsim.mpm.formulas import CLUSTER, CORRECTED, dilation
from refsim.mpm.kernels import place, spread_of, stencil_weights
from refsim.sparse_grid.formulas import node_coordinates
from refsim.sph.formulas import drifted

# What a particle takes from the moments of its stencil


@formula
def centred(v, moments, f, h):
    """Sum of B v (x_j - x)^T [m^2/s], from sums about the base node."""
    return scaled(difference(moments, outer(v, f)), h)


@formula
def with_carriers(i, v, m, position, carriers, share, embedding):
    """v_p [m/s] and sum of B v (x_j - x_p)^T [m^2/s] of a cluster, from those of its particle and points.

    The thesis takes v_p from the particle alone (4.12) and centres the moments on it (4.14).
    """
    whole, moment = v, carriers.carrier_moment
    for c in range(carriers.carrier_first[i], carriers.carrier_first[i + 1]):
        u = three(moment, c)
        whole = added(whole, u)
        m = added(m, (
            moment[c, 3], moment[c, 4], moment[c, 5], moment[c, 6], moment[c, 7], moment[c, 8], moment[c, 9],
            moment[c, 10], moment[c, 11],
        ))  # fmt: skip
        if embedding.reading != CORRECTED:
            m = added(m, outer(u, difference(three(carriers.carrier_position, c), three(position, i))))
    if embedding.reading == CLUSTER:
        v = scaled(whole, share)
    return v, scaled(m, share)


@formula
def velocity_and_gradient(i, v, m, moved, carriers, background, cluster_share, inverse_spread, embedding):
    """v_p [m/s] and A [1/s]: (4.12), (4.13), or those of the cluster."""
    if cluster_share is None:
        return v, scaled(m, background.inverse_moment)
    v, m = with_carriers(i, v, m, moved.position, carriers, cluster_share[i], embedding)
    if embedding.reading == CLUSTER:
        return v, scaled(product(m, symmetric(spread_of(i, inverse_spread))), background.inverse_moment)
    return v, scaled(m, background.inverse_moment)


@formula
def deform(i, a, liquid, step, deformation):
    """(4.16) F <- (I + dt A) F and J = det F, dimensionless. Thesis M5 as printed: dt = 1 s."""
    real = type(step)
    t = real(1) if liquid.timeless else step
    f = nine(deformation, i)
    f = added(f, scaled(product(a, f), t))
    put(deformation, i, f)
    return determinant(f)


@formula
def new_ratio(i, a, medium, volume_ratio, deformation):
    """J after the step, written as well; of F where that is followed."""
    if deformation is not None:
        volume_ratio[i] = deform(i, a, medium.liquid, medium.timestep[1], deformation)
    else:
        volume_ratio[i] *= dilation(trace(a), medium.liquid, medium.timestep[1])
    return volume_ratio[i]


@formula
def shifted(x, c, i, row, shift, residual, rest):
    """x + shift of component c; with a residual x + residual + shift, of which the new residual goes to `rest`."""
    if residual is not None:
        x, rest[row, c] = drifted(x, residual[i, c], shift)
        return x
    return x + shift


@formula(inlined=True)
def move_particle(i, row, sums, f, medium, cluster, carriers, build_position, moved, landed):
    """(4.12), (4.13) or A of the cluster, (4.16), (4.8) of particle i, whose fields before the step are in `moved`;
    its new v, A, x and residual go to `row` of those in `landed`.

    Where there is a residual, x + residual is advanced. sums: B v and B v (j - base)^T over the stencil.

    Returns (squared displacement since the list was built [m^2], J, |tr A| [1/s], squared displacement of the step
    [m^2]).
    """
    background = medium.background
    real = type(background.cell_size)
    m = centred(sums[0], sums[1], f, background.cell_size)
    v, a = velocity_and_gradient(
        i, sums[0], m, moved, carriers, background, cluster.cluster_share, cluster.inverse_spread, cluster.embedding
    )
    put(landed.affine, row, a)
    ratio = new_ratio(i, a, medium, moved.volume_ratio, moved.deformation)
    squared, jump = real(0), real(0)
    for c in range(3):
        landed.velocity[row, c] = v[c]
        shift = medium.timestep[1] * v[c]
        x = shifted(moved.position[i, c], c, i, row, shift, moved.position_residual, landed.position_residual)
        landed.position[row, c] = x
        jump += shift * shift
        if build_position is not None:
            shift = x - build_position[i, c]
        squared += shift * shift
    # A maximum over the particles would ignore a NaN.
    if not (squared >= real(0) and abs(ratio) < real(math.inf)):
        squared = real(math.inf)
    return squared, ratio, abs(trace(a)), jump


# Moments of a stencil. The components of a node's velocity, and a zero, are adjacent in memory and take the same
# operations in straight code, so that the compiler packs them into one register.


@formula
def four(values, n):
    """The four numbers of node n."""
    return values[n, 0], values[n, 1], values[n, 2], values[n, 3]


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
def moments(at, background, weights, values, sums):
    """Sums over the stencil at node `at`: B v (3) and B v (j - base)^T (9); `sums` (4, 4) is work space."""
    wx, wy, wz = weights
    width = background.width
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
    return three(sums, 0), (
        sums[1, 0], sums[2, 0], sums[3, 0], sums[1, 1], sums[2, 1], sums[3, 1], sums[1, 2], sums[2, 2], sums[3, 2]
    )  # fmt: skip


@kernel(ordered=True, packed=True, allocates=True)
def gather(b, places, node_velocity, medium, cluster, carriers, build_position, moved, extremes):
    """Velocity, gradient, volume ratio and position of the particles of block b from the nodes.

    extremes (blocks, 5): largest squared displacement, largest -J and J, largest |tr A|, largest squared displacement
    of the step
    """
    bins, background = places.bins, medium.background
    real = type(background.cell_size)
    far, least, most, fast, jump = real(0), real(-math.inf), real(-math.inf), real(0), real(0)
    if bins.first[b + 1] > bins.first[b]:
        origin = node_coordinates(places.blocks, b * 64)
        values = load_block(b, places.blocks, background, node_velocity)
        work = np.zeros((4, 4), node_velocity.dtype)
        for k in range(bins.first[b], bins.first[b + 1]):
            i = bins.point[k]
            f, (x, y, z) = place(i, moved.position, places.cell, origin, background)
            at = (z * background.width + y) * background.width + x
            sums = moments(at, background, stencil_weights(f, background), values, work)
            squared, ratio, rate, leap = move_particle(
                i, i, sums, f, medium, cluster, carriers, build_position, moved, moved
            )
            far, least, most, fast = max(far, squared), max(least, -ratio), max(most, ratio), max(fast, rate)
            jump = max(jump, leap)
    extremes[b, 0], extremes[b, 1], extremes[b, 2], extremes[b, 3], extremes[b, 4] = far, least, most, fast, jump


def reduce_extremes(extremes, displacement, step_extremes):
    """Extremes of all blocks."""
    far, least, *others = extremes.max(0, initial=-math.inf)
    displacement[:] = max(far, 0.0), 0.0, 0.0
    step_extremes[:] = (-least, *others) if least > -math.inf else (1.0, 1.0, 0.0, 0.0)


@formula
def put_moments(c, v, m, carrier_moment):
    """Write the moments of embedded point c."""
    carrier_moment[c, 0], carrier_moment[c, 1], carrier_moment[c, 2] = v[0], v[1], v[2]
    for k in range(9):
        carrier_moment[c, 3 + k] = m[k]


@kernel(rows_of="complete", ordered=True, packed=True, allocates=True)
def gather_carriers(b, places, node_velocity, carrier_position, background, complete, carrier_moment):
    """Moments of the nodes' velocities about the embedded points of block b."""
    bins = places.bins
    if bins.first[b] == bins.first[b + 1]:
        return
    origin = node_coordinates(places.blocks, b * 64)
    values = load_block(b, places.blocks, background, node_velocity)
    work = np.zeros((4, 4), node_velocity.dtype)
    for k in range(bins.first[b], bins.first[b + 1]):
        c = bins.point[k]
        f, (x, y, z) = place(c, carrier_position, places.cell, origin, background)
        at = (z * background.width + y) * background.width + x
        v, m = moments(at, background, stencil_weights(f, background), values, work)
        put_moments(c, v, centred(v, m, f, background.cell_size), carrier_moment)
