"""Particles and embedded points to nodes, on a CPU.

The points of a block add to a copy of the nodes in their reach; each node then sums the copies of the blocks around it.

No two threads write the same place and the order of every sum is fixed, so that results do not depend on the number of
threads. `particle_to_grid_cuda` has the CUDA kernels.

A point gives node j the momentum B_j(x) (q + g (j - base)): an affine field with value q at the base node of its
stencil and gradient g, both times mass; g is a tuple, row by row, in units of momentum per node.
"""

from refsim.backends.compile import formula, kernel
from refsim.mpm.formulas import CLUSTER, spline_slopes, spline_weights, stress_moment
from refsim.mpm.kernels import layer_slopes, layer_weights, place, round_spread, spread_of
from refsim.sparse_grid.formulas import node_coordinates


@formula
def affine_momentum(mass, vx, vy, vz, g, fx, fy, fz):
    """q = m v - g f [kg m/s]: the field's value at the base node, f the offset of the point from it."""
    qx = mass * vx - g[0] * fx - g[1] * fy - g[2] * fz
    qy = mass * vy - g[3] * fx - g[4] * fy - g[5] * fz
    qz = mass * vz - g[6] * fx - g[7] * fy - g[8] * fz
    return qx, qy, qz


@formula
def gradient(i, affine, scale, pressed, inverse):
    """g = scale A - pressed E^-1: velocity gradient and stress of particle i as one affine field.

    inverse  (xx, xy, xz, yy, yz, zz) of E^-1 = (h^2/4) D^-1
    """
    return (
        scale * affine[i, 0] - pressed * inverse[0],
        scale * affine[i, 1] - pressed * inverse[1],
        scale * affine[i, 2] - pressed * inverse[2],
        scale * affine[i, 3] - pressed * inverse[1],
        scale * affine[i, 4] - pressed * inverse[3],
        scale * affine[i, 5] - pressed * inverse[4],
        scale * affine[i, 6] - pressed * inverse[2],
        scale * affine[i, 7] - pressed * inverse[4],
        scale * affine[i, 8] - pressed * inverse[5],
    )


@formula
def particle_field(
    i, fx, fy, fz, velocity, mass, affine, volume_ratio, acceleration, liquid, background, timestep,
    cluster_share, inverse_spread, embedding, kernel_gradient,
):  # fmt: skip
    """(mass [kg], q, g [kg m/s], K [J s]) of particle i: (4.10), (4.15), and (4.17) as a MLS force; with thesis M6 as
    printed K is not part of g."""
    h = background.cell_size
    real = type(h)
    step = timestep[1]
    vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    if acceleration is not None:
        vx += step * acceleration[i, 0]
        vy += step * acceleration[i, 1]
        vz += step * acceleration[i, 2]
    moment = stress_moment(volume_ratio[i], mass[i], liquid, step)
    own = mass[i]
    inverse = round_spread(h)
    if cluster_share is not None:
        own *= cluster_share[i]
        if embedding.reading == CLUSTER:
            moment *= cluster_share[i]
            inverse = spread_of(i, inverse_spread)
    pressed = moment * background.inverse_moment * h
    if kernel_gradient is not None:
        pressed = real(0)
    g = gradient(i, affine, own * h, pressed, inverse)
    qx, qy, qz = affine_momentum(own, vx, vy, vz, g, fx, fy, fz)
    return own, qx, qy, qz, g, moment


@formula
def carrier_field(
    c, fx, fy, fz, carrier_position, carrier_owner, position, velocity, mass, affine, volume_ratio, acceleration,
    liquid, background, timestep, cluster_share, inverse_spread, embedding,
):  # fmt: skip
    """(mass, q, g) of an embedded point: the field of its owner, with its share of the owner's mass."""
    h = background.cell_size
    real = type(h)
    step = timestep[1]
    p = carrier_owner[c]
    vx, vy, vz = velocity[p, 0], velocity[p, 1], velocity[p, 2]
    if acceleration is not None:
        vx += step * acceleration[p, 0]
        vy += step * acceleration[p, 1]
        vz += step * acceleration[p, 2]
    own = mass[p] * cluster_share[p]
    pressed = real(0)
    inverse = round_spread(h)
    if embedding.reading == CLUSTER:
        moment = cluster_share[p] * stress_moment(volume_ratio[p], mass[p], liquid, step)
        pressed = moment * background.inverse_moment * h
        inverse = spread_of(p, inverse_spread)
    g = gradient(p, affine, own * h, pressed, inverse)
    qx, qy, qz = affine_momentum(own, vx, vy, vz, g, fx, fy, fz)
    if embedding.reading == CLUSTER:  # the field of the owner, centred on the owner
        dx = (carrier_position[c, 0] - position[p, 0]) / h
        dy = (carrier_position[c, 1] - position[p, 1]) / h
        dz = (carrier_position[c, 2] - position[p, 2]) / h
        qx += g[0] * dx + g[1] * dy + g[2] * dz
        qy += g[3] * dx + g[4] * dy + g[5] * dz
        qz += g[6] * dx + g[7] * dy + g[8] * dz
    return own, qx, qy, qz, g


# Sums on the nodes. The four numbers of a node, mass and momentum, are adjacent in memory and take the same operations
# in straight code, so that the compiler packs them into one register.


@formula
def plus(a, b):
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]


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
    """Zeros on the nodes in the reach of block b."""
    for n in range(scratch.shape[1]):
        for c in range(4):
            scratch[b, n, c] = type(scratch[b, n, c])(0)


@kernel(ordered=True, packed=True)
def scatter_particles(
    b, bins, position, velocity, mass, affine, volume_ratio, acceleration, cell, liquid, background, timestep,
    cluster_share, inverse_spread, embedding, kernel_gradient, blocks, scratch,
):  # fmt: skip
    """Sums of the particles of block b on the nodes in their reach."""
    if bins.first[b] == bins.first[b + 1]:
        return
    width = background.width
    origin = node_coordinates(blocks, b * 64)
    clear(scratch, b)
    nodes = scratch[b]
    for k in range(bins.first[b], bins.first[b + 1]):
        i = bins.point[k]
        fx, fy, fz, x, y, z = place(i, position, cell, origin, background)
        own, qx, qy, qz, g, moment = particle_field(
            i, fx, fy, fz, velocity, mass, affine, volume_ratio, acceleration, liquid, background, timestep,
            cluster_share, inverse_spread, embedding, kernel_gradient,
        )  # fmt: skip
        wx, wy, wz = spline_weights(fx), spline_weights(fy), layer_weights(fz, background)
        at = (z * width + y) * width + x
        add_affine(nodes, at, width, background, wx, wy, wz, own, qx, qy, qz, g)
        if kernel_gradient is not None:
            zero = type(own)(0)
            p = -moment / background.cell_size
            t = (p, zero, zero, p, zero, p)
            slopes = layer_slopes(fz, background)
            add_gradient(nodes, at, width, background, wx, wy, wz, spline_slopes(fx), spline_slopes(fy), slopes, t)


@kernel(rows_of="scratch")
def collect(b, bins, blocks, add, scratch, node_mass, node_momentum):
    """m_j [kg] and (mv)_j [kg m/s] of the nodes of block b; added to the present values if `add`.

    Each node sums the copies of its own block and of those below it.
    """
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


@kernel(rows_of="scratch", ordered=True, packed=True)
def scatter_carriers(
    b, bins, carrier_position, carrier_owner, carrier_cell, position, velocity, mass, affine, volume_ratio,
    acceleration, liquid, background, timestep, cluster_share, inverse_spread, embedding, blocks, scratch,
):  # fmt: skip
    """Sums of the embedded points of block b on the nodes in their reach."""
    if bins.first[b] == bins.first[b + 1]:
        return
    width = background.width
    origin = node_coordinates(blocks, b * 64)
    clear(scratch, b)
    nodes = scratch[b]
    for k in range(bins.first[b], bins.first[b + 1]):
        c = bins.point[k]
        fx, fy, fz, x, y, z = place(c, carrier_position, carrier_cell, origin, background)
        own, qx, qy, qz, g = carrier_field(
            c, fx, fy, fz, carrier_position, carrier_owner, position, velocity, mass, affine, volume_ratio,
            acceleration, liquid, background, timestep, cluster_share, inverse_spread, embedding,
        )  # fmt: skip
        wx, wy, wz = spline_weights(fx), spline_weights(fy), layer_weights(fz, background)
        add_affine(nodes, (z * width + y) * width + x, width, background, wx, wy, wz, own, qx, qy, qz, g)


def carriers_to_grid(
    carrier_position, carrier_owner, position, velocity, mass, affine, volume_ratio, acceleration, liquid, background,
    timestep, cluster_share, inverse_spread, embedding, grid, node_mass, node_momentum,
):  # fmt: skip
    """(4.15) of the embedded points, added to m_j and (mv)_j."""
    bins, scratch = grid.bins["carriers"], grid.scratch
    scatter_carriers(
        bins, carrier_position, carrier_owner, grid.cells["carriers"], position, velocity, mass, affine, volume_ratio,
        acceleration, liquid, background, timestep, cluster_share, inverse_spread, embedding, grid.blocks, scratch,
    )  # fmt: skip
    collect(bins, grid.blocks, True, scratch, node_mass, node_momentum)
