"""Nodes to particles and embedded points, on a CPU: block by block, from a copy of the velocities in the block's reach.

`grid_to_particle_cuda` has the CUDA kernels.
"""

import math

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.mpm.formulas import CLUSTER, CORRECTED, determinant, dilation, spline_weights
from refsim.mpm.kernels import layer_weights, place, spread_of
from refsim.sparse_grid.formulas import node_coordinates
from refsim.sph.formulas import drifted

# What a particle takes from the moments of its stencil


@formula
def centred(sums, fx, fy, fz, h):
    """Sum of B v (x_j - x)^T [m^2/s], row by row, from sums about the base node."""
    vx, vy, vz = sums[0], sums[1], sums[2]
    return (
        h * (sums[3] - fx * vx), h * (sums[4] - fy * vx), h * (sums[5] - fz * vx),
        h * (sums[6] - fx * vy), h * (sums[7] - fy * vy), h * (sums[8] - fz * vy),
        h * (sums[9] - fx * vz), h * (sums[10] - fy * vz), h * (sums[11] - fz * vz),
    )  # fmt: skip


@formula
def with_carriers(i, v, m, position, carrier_first, carrier_position, carrier_moment, share, embedding):
    """v_p [m/s] and sum of B v (x_j - x_p)^T [m^2/s] of a cluster, from those of its particle and points.

    The thesis takes v_p from the particle alone (4.12) and centres the moments on it (4.14).
    """
    vx, vy, vz = v
    m0, m1, m2, m3, m4, m5, m6, m7, m8 = m
    for c in range(carrier_first[i], carrier_first[i + 1]):
        ux, uy, uz = carrier_moment[c, 0], carrier_moment[c, 1], carrier_moment[c, 2]
        vx += ux
        vy += uy
        vz += uz
        m0 += carrier_moment[c, 3]
        m1 += carrier_moment[c, 4]
        m2 += carrier_moment[c, 5]
        m3 += carrier_moment[c, 6]
        m4 += carrier_moment[c, 7]
        m5 += carrier_moment[c, 8]
        m6 += carrier_moment[c, 9]
        m7 += carrier_moment[c, 10]
        m8 += carrier_moment[c, 11]
        if embedding.reading != CORRECTED:
            dx = carrier_position[c, 0] - position[i, 0]
            dy = carrier_position[c, 1] - position[i, 1]
            dz = carrier_position[c, 2] - position[i, 2]
            m0 += ux * dx
            m1 += ux * dy
            m2 += ux * dz
            m3 += uy * dx
            m4 += uy * dy
            m5 += uy * dz
            m6 += uz * dx
            m7 += uz * dy
            m8 += uz * dz
    if embedding.reading == CLUSTER:
        v = (share * vx, share * vy, share * vz)
    return v, (
        share * m0, share * m1, share * m2, share * m3, share * m4, share * m5, share * m6, share * m7, share * m8
    )  # fmt: skip


@formula
def times_spread(m, s, scale):
    """scale M E^-1, row by row."""
    return (
        scale * (m[0] * s[0] + m[1] * s[1] + m[2] * s[2]),
        scale * (m[0] * s[1] + m[1] * s[3] + m[2] * s[4]),
        scale * (m[0] * s[2] + m[1] * s[4] + m[2] * s[5]),
        scale * (m[3] * s[0] + m[4] * s[1] + m[5] * s[2]),
        scale * (m[3] * s[1] + m[4] * s[3] + m[5] * s[4]),
        scale * (m[3] * s[2] + m[4] * s[4] + m[5] * s[5]),
        scale * (m[6] * s[0] + m[7] * s[1] + m[8] * s[2]),
        scale * (m[6] * s[1] + m[7] * s[3] + m[8] * s[4]),
        scale * (m[6] * s[2] + m[7] * s[4] + m[8] * s[5]),
    )


@formula
def scaled(m, scale):
    """scale M, row by row."""
    return (
        scale * m[0], scale * m[1], scale * m[2], scale * m[3], scale * m[4], scale * m[5], scale * m[6], scale * m[7],
        scale * m[8],
    )  # fmt: skip


@formula
def deform(i, a, liquid, step, layers, deformation):
    """(4.16) F <- (I + dt A) F, then F <- J^(1/d) I if `forgets_shear`; returns J = det F.

    Thesis M5 as printed: dt = 1 s.
    """
    real = type(step)
    t = real(1) if liquid.timeless else step
    for c in range(3):
        f0, f1, f2 = deformation[i, c], deformation[i, 3 + c], deformation[i, 6 + c]
        deformation[i, c] = f0 + t * (a[0] * f0 + a[1] * f1 + a[2] * f2)
        deformation[i, 3 + c] = f1 + t * (a[3] * f0 + a[4] * f1 + a[5] * f2)
        deformation[i, 6 + c] = f2 + t * (a[6] * f0 + a[7] * f1 + a[8] * f2)
    ratio = determinant(
        deformation[i, 0], deformation[i, 1], deformation[i, 2], deformation[i, 3], deformation[i, 4],
        deformation[i, 5], deformation[i, 6], deformation[i, 7], deformation[i, 8],
    )  # fmt: skip
    if liquid.forgets_shear:
        size = ratio ** (real(1) / real(3) if layers == 3 else real(0.5))
        for c in range(9):
            deformation[i, c] = real(0)
        deformation[i, 0] = size
        deformation[i, 4] = size
        deformation[i, 8] = size if layers == 3 else real(1)
    return ratio


@formula(inlined=True)
def move_particle(
    i, row, sums, fx, fy, fz, background, liquid, timestep, cluster_share, inverse_spread, embedding, carrier_first,
    carrier_position, carrier_moment, build_position, position, position_residual, volume_ratio, deformation, velocity,
    affine, moved, rest,
):  # fmt: skip
    """(4.12), (4.13) or A of the cluster, (4.16), (4.8) of particle i; v, A, x go to `row` of velocity, affine, moved.

    Where there is a residual, x + residual is advanced, and the new residual goes to `row` of `rest`.

    Returns (squared displacement since the list was built [m^2], J, |tr A| [1/s], squared displacement of the step
    [m^2]).
    """
    h = background.cell_size
    real = type(h)
    step = timestep[1]
    v = (sums[0], sums[1], sums[2])
    m = centred(sums, fx, fy, fz, h)
    if cluster_share is not None:
        v, m = with_carriers(
            i, v, m, position, carrier_first, carrier_position, carrier_moment, cluster_share[i], embedding
        )
    a = scaled(m, background.inverse_moment)
    if cluster_share is not None and embedding.reading == CLUSTER:
        a = times_spread(m, spread_of(i, inverse_spread), background.inverse_moment)
    for c in range(9):
        affine[row, c] = a[c]
    if deformation is not None:
        volume_ratio[i] = deform(i, a, liquid, step, background.layers, deformation)
    else:
        volume_ratio[i] *= dilation(a[0] + a[4] + a[8], liquid, step)
    squared, jump = real(0), real(0)
    for c in range(3):
        velocity[row, c] = v[c]
        shift = step * v[c]
        if position_residual is not None:
            moved[row, c], rest[row, c] = drifted(position[i, c], position_residual[i, c], shift)
        else:
            moved[row, c] = position[i, c] + shift
        jump += shift * shift
        if build_position is not None:
            shift = moved[row, c] - build_position[i, c]
        squared += shift * shift
    # A maximum over the particles would ignore a NaN.
    if not (squared >= real(0) and abs(volume_ratio[i]) < real(math.inf)):
        squared = real(math.inf)
    return squared, volume_ratio[i], abs(a[0] + a[4] + a[8]), jump


# Moments of a stencil. The components of a node's velocity, and a zero, are adjacent in memory and take the same
# operations in straight code, so that the compiler packs them into one register.


@formula
def four(values, n):
    """The four numbers of node n."""
    return values[n, 0], values[n, 1], values[n, 2], values[n, 3]


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
    """Sums over the stencil at node `at`: B v (3) and B v (j - base)^T (9, row by row); `sums` (4, 4) is work space."""
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


@kernel(ordered=True, packed=True, allocates=True)
def gather(
    b, bins, node_velocity, cell, liquid, background, timestep, blocks, cluster_share, inverse_spread, embedding,
    carrier_first, carrier_position, carrier_moment, build_position, velocity, affine, volume_ratio, deformation,
    position_residual, position, extremes,
):  # fmt: skip
    """Velocity, gradient, volume ratio and position of the particles of block b from the nodes.

    extremes (blocks, 5): largest squared displacement, least J, largest J, largest |tr A|, largest squared displacement
    of the step
    """
    real = type(background.cell_size)
    far, least, most, fast, jump = real(0), real(math.inf), real(-math.inf), real(0), real(0)
    if bins.first[b + 1] > bins.first[b]:
        width = background.width
        origin = node_coordinates(blocks, b * 64)
        values = load_block(b, blocks, background, node_velocity)
        work = np.zeros((4, 4), node_velocity.dtype)
        for k in range(bins.first[b], bins.first[b + 1]):
            i = bins.point[k]
            fx, fy, fz, x, y, z = place(i, position, cell, origin, background)
            sums = moments(
                (z * width + y) * width + x, width, background, spline_weights(fx), spline_weights(fy),
                layer_weights(fz, background), values, work,
            )  # fmt: skip
            squared, ratio, rate, leap = move_particle(
                i, i, sums, fx, fy, fz, background, liquid, timestep, cluster_share, inverse_spread, embedding,
                carrier_first, carrier_position, carrier_moment, build_position, position, position_residual,
                volume_ratio, deformation, velocity, affine, position, position_residual,
            )  # fmt: skip
            far, least, most, fast = max(far, squared), min(least, ratio), max(most, ratio), max(fast, rate)
            jump = max(jump, leap)
    extremes[b, 0], extremes[b, 1], extremes[b, 2], extremes[b, 3], extremes[b, 4] = far, least, most, fast, jump


def grid_to_particle(
    node_velocity, liquid, background, timestep, cluster_share, inverse_spread, embedding, carrier_first,
    carrier_position, carrier_moment, build_position, grid, displacement, step_extremes, velocity, affine,
    volume_ratio, deformation, position_residual, position,
):  # fmt: skip
    """(4.12), (4.13) or A of the cluster, (4.16), (4.8): velocity, affine matrix, volume ratio and position."""
    extremes = np.empty((len(grid.blocks.keys), 5), step_extremes.dtype)
    gather(
        grid.bins["particles"], node_velocity, grid.cells["particles"], liquid, background, timestep, grid.blocks,
        cluster_share, inverse_spread, embedding, carrier_first, carrier_position, carrier_moment, build_position,
        velocity, affine, volume_ratio, deformation, position_residual, position, extremes,
    )  # fmt: skip
    largest = extremes.max(0, initial=-math.inf)
    displacement[:] = max(largest[0], 0.0), 0.0
    any_particle = largest[2] > -math.inf
    step_extremes[:] = (extremes[:, 1].min(), *largest[2:]) if any_particle else (1.0, 1.0, 0.0, 0.0)


@kernel(rows_of="keys", ordered=True, packed=True, allocates=True)
def gather_carriers(
    b, bins, node_velocity, carrier_position, carrier_cell, background, blocks, keys, carrier_moment
):  # fmt: skip
    """Moments of the nodes' velocities about the embedded points of block b."""
    if bins.first[b] == bins.first[b + 1]:
        return
    width = background.width
    origin = node_coordinates(blocks, b * 64)
    values = load_block(b, blocks, background, node_velocity)
    work = np.zeros((4, 4), node_velocity.dtype)
    for k in range(bins.first[b], bins.first[b + 1]):
        i = bins.point[k]
        fx, fy, fz, x, y, z = place(i, carrier_position, carrier_cell, origin, background)
        sums = moments(
            (z * width + y) * width + x, width, background, spline_weights(fx), spline_weights(fy),
            layer_weights(fz, background), values, work,
        )  # fmt: skip
        m = centred(sums, fx, fy, fz, background.cell_size)
        carrier_moment[i, 0], carrier_moment[i, 1], carrier_moment[i, 2] = sums[0], sums[1], sums[2]
        for c in range(9):
            carrier_moment[i, 3 + c] = m[c]


def grid_to_carriers(node_velocity, carrier_position, background, grid, carrier_moment):
    """Sums of B v and B v (x_j - x_q)^T about every embedded point."""
    cell = grid.cells["carriers"]
    gather_carriers(
        grid.bins["carriers"], node_velocity, carrier_position, cell, background, grid.blocks, grid.blocks.keys,
        carrier_moment,
    )  # fmt: skip
