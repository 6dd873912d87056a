"""Particles and embedded points to nodes, on a CPU.

The points of a block add to a copy of the nodes in their reach; each node then sums the copies of the blocks around it.

No two threads write the same place and the order of every sum is fixed, so that results do not depend on the number of
threads. `particle_to_grid_cuda` has the CUDA kernels.

A point gives node j the momentum B_j(x) (q + g (j - base)): an affine field with value q at the base node of its
stencil and gradient g, both times mass; g is a tuple, row by row, in units of momentum per node.
"""

from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import added, difference, less_times, nine, put, scaled, symmetric, three, times
from refsim.mpm.formulas import CLUSTER, stress_moment
from refsim.mpm.kernels import place, pushed, round_spread, spread_of, stencil_slopes, stencil_weights
from refsim.sparse_grid.formulas import node_coordinates, number


@formula
def of_cluster(i, mass, moment, cluster_share, inverse_spread, embedding):
    """(mass, K, E^-1) of particle i itself: in a cluster its share; E^-1 = (h^2/4) D^-1."""
    inverse = round_spread(mass)
    if cluster_share is not None:
        mass *= cluster_share[i]
        if embedding.reading == CLUSTER:
            moment *= cluster_share[i]
            inverse = spread_of(i, inverse_spread)
    return mass, moment, inverse


@formula
def affine_field(i, f, particles, medium, cluster, pressed):
    """(mass [kg], q, g [kg m/s], K [J s]) of particle i for a point with offset f: (4.10), (4.15).

    The stress, (4.17) as a MLS force, is part of g only if `pressed`: g = m h A - (4/h) K E^-1; q = m v - g f.
    """
    h = medium.background.cell_size
    step = medium.timestep[1]
    v = pushed(i, particles.velocity, particles.acceleration, step)
    mass = particles.mass[i]
    moment = stress_moment(particles.volume_ratio[i], mass, medium.liquid, step)
    m_p, moment, inverse = of_cluster(i, mass, moment, cluster.cluster_share, cluster.inverse_spread, cluster.embedding)
    stress = moment * medium.background.inverse_moment * h if pressed else type(h)(0)
    g = difference(scaled(nine(particles.affine, i), m_p * h), scaled(symmetric(inverse), stress))
    return m_p, less_times(scaled(v, m_p), g, f), g, moment


@formula
def particle_field(i, f, particles, medium, cluster, kernel_gradient):
    """`affine_field` of particle i about itself; with thesis M6 as printed K is not part of g."""
    return affine_field(i, f, particles, medium, cluster, kernel_gradient is None)


@formula
def carrier_field(c, f, carriers, particles, medium, cluster):
    """(mass, q, g) of an embedded point: the field of its owner, with its share of the owner's mass."""
    p, whole = carriers.carrier_owner[c], cluster.embedding.reading == CLUSTER
    mass, q, g, _ = affine_field(p, f, particles, medium, cluster, whole)
    if whole:  # centred on the owner
        d = difference(three(carriers.carrier_position, c), three(particles.position, p))
        h = medium.background.cell_size
        q = added(q, times(g, (d[0] / h, d[1] / h, d[2] / h)))
    return mass, q, g


# Sums on the nodes. The four numbers of a node, mass and momentum, are adjacent in memory and take the same operations
# in straight code, so that the compiler packs them into one register.


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
    q1 = added(q, gx)
    add_node(nodes, n, w * wx[0], q)
    add_node(nodes, n + 1, w * wx[1], q1)
    add_node(nodes, n + 2, w * wx[2], added(q1, gx))


@formula
def add_layer(nodes, n, width, w, wx, wy, q, gx, gy):
    """Add w B_j(x) B_j(y) (q + i gx + j gy) to the layer of nine nodes that begins at n."""
    q1 = added(q, gy)
    add_row(nodes, n, w * wy[0], wx, q, gx)
    add_row(nodes, n + width, w * wy[1], wx, q1, gx)
    add_row(nodes, n + 2 * width, w * wy[2], wx, added(q1, gy), gx)


@formula
def add_affine(nodes, at, background, weights, mass, q, g):
    """Add B_j (mass, q + g (j - base)) to the nodes of a stencil that begins at node `at`."""
    zero, width = type(mass)(0), background.width
    wx, wy, wz = weights
    moments = (mass, q[0], q[1], q[2])
    gx, gy, gz = (zero, g[0], g[3], g[6]), (zero, g[1], g[4], g[7]), (zero, g[2], g[5], g[8])
    add_layer(nodes, at, width, wz[0], wx, wy, moments, gx, gy)
    if background.layers == 3:
        second = added(moments, gz)
        deep = width * width
        add_layer(nodes, at + deep, width, wz[1], wx, wy, second, gx, gy)
        add_layer(nodes, at + 2 * deep, width, wz[2], wx, wy, added(second, gz), gx, gy)


@formula
def add_gradient(nodes, at, background, weights, slopes, p):
    """Add p (h grad B_j) to the momentum of a stencil."""
    zero = type(p)(0)
    wx, wy, wz = weights
    sx, sy, sz = slopes
    for k in range(3):
        if k < background.layers:
            for j in range(3):
                for i in range(3):
                    dx = sx[i] * wy[j] * wz[k]
                    dy = wx[i] * sy[j] * wz[k]
                    dz = wx[i] * wy[j] * sz[k]
                    n = at + (k * background.width + j) * background.width + i
                    add_node(nodes, n, type(p)(1), (zero, p * dx, p * dy, p * dz))


@formula
def clear(scratch, b):
    """Zeros on the nodes in the reach of block b."""
    for n in range(scratch.shape[1]):
        for c in range(4):
            scratch[b, n, c] = type(scratch[b, n, c])(0)


@kernel(ordered=True, packed=True)
def scatter(b, places, position, carriers, particles, medium, cluster, kernel_gradient, scratch):
    """Sums of the points of block b at `position` on the nodes in their reach; particles, unless there are carriers."""
    bins, background = places.bins, medium.background
    if bins.first[b] == bins.first[b + 1]:
        return
    origin = node_coordinates(places.blocks, b * 64)
    clear(scratch, b)
    nodes = scratch[b]
    for k in range(bins.first[b], bins.first[b + 1]):
        i = bins.point[k]
        f, (x, y, z) = place(i, position, places.cell, origin, background)
        if carriers is None:
            mass, q, g, moment = particle_field(i, f, particles, medium, cluster, kernel_gradient)
        else:
            mass, q, g = carrier_field(i, f, carriers, particles, medium, cluster)
        weights = stencil_weights(f, background)
        at = (z * background.width + y) * background.width + x
        add_affine(nodes, at, background, weights, mass, q, g)
        if kernel_gradient is not None:
            slopes = stencil_slopes(f, background)
            add_gradient(nodes, at, background, weights, slopes, -moment / background.cell_size)


@formula
def collect_node(n, bits, each, bins, blocks, scratch):
    """(m, mv) of node n from the copies of its block and of those below it; `each` bins belong to a block."""
    rest, width, deep = (1 << bits) - 1, (1 << bits) + 2, 2 if bits == 2 else 1
    b, node = n >> 6, n & 63
    x, y, z = node & rest, (node >> bits) & rest, node >> (2 * bits)
    zero = type(scratch[0, 0, 0])(0)
    m, px, py, pz = zero, zero, zero, zero
    for dz in range(deep):
        for dy in range(2):
            for dx in range(2):
                if (dx == 0 or x < 2) and (dy == 0 or y < 2) and (dz == 0 or z < 2):
                    s = blocks.neighbour[b, blocks.neighbour.shape[1] // 2 - dx - 3 * dy - 9 * dz]
                    if s >= 0 and bins.first[each * number(s) + each] > bins.first[each * number(s)]:
                        at = ((z + (dz << bits)) * width + y + (dy << bits)) * width + x + (dx << bits)
                        m += scratch[number(s), at, 0]
                        px += scratch[number(s), at, 1]
                        py += scratch[number(s), at, 2]
                        pz += scratch[number(s), at, 3]
    return m, (px, py, pz)


@kernel(rows_of="node_mass")
def collect(n, bins, each, blocks, add, scratch, node_momentum, node_mass):
    """m_j [kg] and (mv)_j [kg m/s] of node n, of its own block's copy and those below; added to them if `add`."""
    if blocks.neighbour.shape[1] == 27:  # widths that the compiler knows
        m, p = collect_node(n, 2, each, bins, blocks, scratch)
    else:
        m, p = collect_node(n, 3, each, bins, blocks, scratch)
    if add:
        m += node_mass[n]
        p = added(p, three(node_momentum, n))
    node_mass[n] = m
    put(node_momentum, n, p)
