"""What one point does in the transfers; shared by the CPU and the CUDA kernels.

A point gives node j the momentum B_j(x) (q + g (j - base)): an affine field with its value q at the base node of its
stencil and its gradient g, both times mass; g is a tuple, row by row, in units of momentum a node.
"""

import math

from refsim.backends.compile import formula
from refsim.mpm.formulas import (
    IMAGED_ROWS,
    NOWHERE,
    STICKY,
    buried,
    canonical,
    determinant,
    dilation,
    fraction,
    image,
    on_mirror,
    reflection,
    spline_slopes,
    spline_weights,
    stress_moment,
    wall_velocity,
)
from refsim.mpm.formulas import inverse_spread as inverted
from refsim.sparse_grid.formulas import find_node, node_coordinates, step_node
from refsim.surface_energy.formulas import grid_offset, spline_weight

CLUSTER, THESIS, CORRECTED = 1, 2, 3  # readings of the embedding; 0 is none


@formula
def place(i, position, cell, origin, background):
    """(fractions of point i along x, y, z, local coordinates of its base node) in the block that begins at `origin`."""
    local = cell[i] & 63
    if background.layers == 3:
        x, y, z = local & 3, (local >> 2) & 3, local >> 4
        fx = fraction(position[i, 0], origin[0] + x, background)
        fy = fraction(position[i, 1], origin[1] + y, background)
        fz = fraction(position[i, 2], origin[2] + z, background)
        return fx, fy, fz, x, y, z
    x, y = local & 7, local >> 3
    fx = fraction(position[i, 0], origin[0] + x, background)
    fy = fraction(position[i, 1], origin[1] + y, background)
    return fx, fy, type(fx)(0), x, y, 0


@formula
def layer_weights(fz, background):
    """Weights along z; the plane has one layer, with weight one."""
    if background.layers == 3:
        return spline_weights(fz)
    real = type(fz)
    return real(1), real(0), real(0)


@formula
def layer_slopes(fz, background):
    """Slopes along z, where the plane has none."""
    if background.layers == 3:
        return spline_slopes(fz)
    real = type(fz)
    return real(0), real(0), real(0)


@formula
def affine_momentum(mass, vx, vy, vz, g, fx, fy, fz):
    """q: the momentum mass v less what the gradient adds from the base node to the point."""
    qx = mass * vx - g[0] * fx - g[1] * fy - g[2] * fz
    qy = mass * vy - g[3] * fx - g[4] * fy - g[5] * fz
    qz = mass * vz - g[6] * fx - g[7] * fy - g[8] * fz
    return qx, qy, qz


@formula
def gradient(i, affine, scale, pressed, inverse):
    """g = scale A - pressed E^-1: velocity gradient and stress of particle i, both taken through the affine field.

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
def round_spread(h):
    """E^-1 of a particle that nothing is embedded around: the unit matrix."""
    real = type(h)
    return real(1), real(0), real(0), real(1), real(0), real(1)


@formula
def spread_of(i, inverse_spread):
    """E^-1 of particle i's cluster."""
    return (
        inverse_spread[i, 0], inverse_spread[i, 1], inverse_spread[i, 2],
        inverse_spread[i, 3], inverse_spread[i, 4], inverse_spread[i, 5],
    )  # fmt: skip


@formula
def viscous_row(ax, ay, az, sx, sy, sz, inverse, factor):
    """A row of A - factor S E^-1: (ax, ay, az) of A, (sx, sy, sz) of S = A + A^T."""
    xx, xy, xz, yy, yz, zz = inverse
    return (
        ax - factor * (sx * xx + sy * xy + sz * xz),
        ay - factor * (sx * xy + sy * yy + sz * yz),
        az - factor * (sx * xz + sy * yz + sz * zz),
    )


@formula
def viscosity(i, affine, volume_ratio, inverse_spread, viscous_stress, timestep):
    """A - dt (4 mu J/(rho0 h^2)) (A + A^T) E^-1 of particle i, row by row: what the stress mu (A + A^T) adds to (4.10).

    As the pressure's, its force is -V (4/h^2) B_j stress E^-1 (x_j - x_p), linear in x_j - x_p as the affine momentum.
    """
    factor = timestep[1] * viscous_stress.factor * volume_ratio[i]
    inverse = round_spread(factor)
    if inverse_spread is not None:
        inverse = spread_of(i, inverse_spread)
    xx, xy, xz = affine[i, 0], affine[i, 1], affine[i, 2]
    yx, yy, yz = affine[i, 3], affine[i, 4], affine[i, 5]
    zx, zy, zz = affine[i, 6], affine[i, 7], affine[i, 8]
    first = viscous_row(xx, xy, xz, xx + xx, xy + yx, xz + zx, inverse, factor)
    second = viscous_row(yx, yy, yz, yx + xy, yy + yy, yz + zy, inverse, factor)
    third = viscous_row(zx, zy, zz, zx + xz, zy + yz, zz + zz, inverse, factor)
    return first, second, third


@formula
def particle_field(
    i, fx, fy, fz, velocity, mass, affine, volume_ratio, acceleration, liquid, background, timestep,
    cluster_share, inverse_spread, embedding, kernel_gradient,
):  # fmt: skip
    """(mass, q, g, K) of particle i itself: (4.10), (4.15), and (4.17) as MLS force, or K of its own for M6."""
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
    """(mass, q, g) of an embedded point: its owner's field, with its share of the owner's mass."""
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
    if embedding.reading == CLUSTER:  # the field is the owner's, about the owner
        dx = (carrier_position[c, 0] - position[p, 0]) / h
        dy = (carrier_position[c, 1] - position[p, 1]) / h
        dz = (carrier_position[c, 2] - position[p, 2]) / h
        qx += g[0] * dx + g[1] * dy + g[2] * dz
        qy += g[3] * dx + g[4] * dy + g[5] * dz
        qz += g[6] * dx + g[7] * dy + g[8] * dz
    return own, qx, qy, qz, g


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
def component_moments(at, width, layers, wx, wy, wz, c, values):
    """Sums over the stencil from node `at` on: B v, B v i, B v j, B v k of the component c; the plane has one layer."""
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
def moments(at, width, layers, wx, wy, wz, values):
    """Sums over the stencil's nodes: B v (3) and B v (j - base)^T (9, row by row); values (nodes, 3) [m/s]."""
    vx, xx, xy, xz = component_moments(at, width, layers, wx, wy, wz, 0, values)
    vy, yx, yy, yz = component_moments(at, width, layers, wx, wy, wz, 1, values)
    vz, zx, zy, zz = component_moments(at, width, layers, wx, wy, wz, 2, values)
    return vx, vy, vz, xx, xy, xz, yx, yy, yz, zx, zy, zz


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
    """Section 5: v_p and sum of B v (x_j - x_p)^T of a cluster, from its particle's own (v, m) and its points' moments.

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
    """(4.16) F <- (I + dt A) F, with M5 dt = 1 s; returns J = det F, and leaves J^(1/d) I where F is forgotten."""
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


@formula
def gather(
    i, row, sums, fx, fy, fz, background, liquid, timestep, cluster_share, inverse_spread, embedding, carrier_first,
    carrier_position, carrier_moment, build_position, position, volume_ratio, deformation, velocity, affine, moved,
):  # fmt: skip
    """(4.12), (4.13) or the cluster's, (4.16), (4.8) of particle i; v, A, x go to `row` of velocity, affine, moved.

    Returns (squared way since the list was built [m^2], J, |tr A| [1/s], squared way of the step [m^2]).
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
        way = step * v[c]
        moved[row, c] = position[i, c] + way
        jump += way * way
        if build_position is not None:
            way = moved[row, c] - build_position[i, c]
        squared += way * way
    # A maximum over the particles would pass over what is no number.
    if not (squared >= real(0) and abs(volume_ratio[i]) < real(math.inf)):
        squared = real(math.inf)
    return squared, volume_ratio[i], abs(a[0] + a[4] + a[8]), jump


@formula
def embed(
    i, position, surface_sample, order, first, cell_size, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Section 5 for particle i: its samples and their mirror images, its share, and E^-1."""
    real = type(cell_size)
    count = first[i + 1] - first[i]
    share = real(1) / real(2 * count + 1)
    xx, xy, xz, yy, yz, zz = real(1), real(0), real(0), real(1), real(0), real(1)
    for k in range(first[i], first[i + 1]):
        s = order[k]
        d = (
            surface_sample[s, 0] - position[i, 0],
            surface_sample[s, 1] - position[i, 1],
            surface_sample[s, 2] - position[i, 2],
        )
        for c in range(3):
            carrier_position[2 * k, c] = surface_sample[s, c]
            carrier_position[2 * k + 1, c] = position[i, c] - d[c]
        carrier_owner[2 * k] = i
        carrier_owner[2 * k + 1] = i
        two = real(8) * share / (cell_size * cell_size)
        xx += two * d[0] * d[0]
        xy += two * d[0] * d[1]
        xz += two * d[0] * d[2]
        yy += two * d[1] * d[1]
        yz += two * d[1] * d[2]
        zz += two * d[2] * d[2]
    carrier_first[i] = 2 * first[i]
    carrier_first[i + 1] = 2 * first[i + 1]  # also written by the next particle, with the same number
    cluster_share[i] = share
    inverse = inverted(xx, xy, xz, yy, yz, zz)
    for c in range(6):
        inverse_spread[i, c] = inverse[c]


@formula
def crowding(i, position, volume_ratio, node_mass, cell, background, counting, blocks):
    """Density counted on the grid at particle i over the one that its J tells: J sum_j B_j(x_p) m_j/(rho0 h^d)."""
    jx, jy, jz = node_coordinates(blocks, cell[i])
    real = type(background.cell_size)
    wx = spline_weights(fraction(position[i, 0], jx, background))
    wy = spline_weights(fraction(position[i, 1], jy, background))
    wz = real(1), real(0), real(0)
    if background.layers == 3:
        wz = spline_weights(fraction(position[i, 2], jz, background))
    total = real(0)
    for kz in range(background.layers):
        for ky in range(3):
            for kx in range(3):
                node = step_node(blocks, cell[i], kx, ky, kz)
                total += wz[kz] * wy[ky] * wx[kx] * (node_mass[node] / counting.cell_mass)
    return volume_ratio[i] * total


@formula
def recount(i, crowding, recounting, timestep, background, deformation, volume_ratio):
    """J <- J (1 - min(1, dt/tau) (1 - q0/q)) of particle i where its crowding q is above q0, and F with it."""
    real = type(background.cell_size)
    if not crowding[i] <= recounting.limit:  # what is no number makes J none
        share = min(real(1), timestep[1] / recounting.time)
        change = real(1) - share * (real(1) - recounting.limit / crowding[i])
        volume_ratio[i] *= change
        if deformation is not None:
            size = change ** (real(1) / real(3) if background.layers == 3 else real(0.5))
            for c in range(9):
                if background.layers == 3 or c < 8:  # F_zz stays one in the plane
                    deformation[i, c] *= size


@formula
def node_update(node, mass, mx, my, mz, blocks, least_mass, node_pull, field, planes, timestep):
    """(4.19) with the walls of section 9: v_j [m/s]; zero on a node without mass."""
    real = type(mass)
    zero = real(0)
    if not mass > least_mass:
        return zero, zero, zero
    step = timestep[1]
    if node_pull is not None:
        mx += step * node_pull[node, 0]
        my += step * node_pull[node, 1]
        mz += step * node_pull[node, 2]
    vx, vy, vz = mx / mass, my / mass, mz / mass
    if field is not None:
        vx += step * field[0]
        vy += step * field[1]
        vz += step * field[2]
    if planes is not None:
        jx, jy, jz = node_coordinates(blocks, node)
        vx, vy, vz = at_walls(jx, jy, jz, vx, vy, vz, planes)
    return vx, vy, vz


@formula
def at_walls(jx, jy, jz, vx, vy, vz, planes):
    """Section 9 for the node j: v = 0 in a sticky wall, and no part into a slip or separating one."""
    lx, ux = jx <= planes.lower[0], jx >= planes.upper[0]
    ly, uy = jy <= planes.lower[1], jy >= planes.upper[1]
    lz, uz = jz <= planes.lower[2], jz >= planes.upper[2]
    r = planes.rules
    if (
        (lx and r[0] == STICKY) or (ux and r[1] == STICKY) or (ly and r[2] == STICKY)
        or (uy and r[3] == STICKY) or (lz and r[4] == STICKY) or (uz and r[5] == STICKY)
    ):  # fmt: skip
        zero = type(vx)(0)
        return zero, zero, zero
    return (
        wall_velocity(vx, lx, ux, r[0], r[1]),
        wall_velocity(vy, ly, uy, r[2], r[3]),
        wall_velocity(vz, lz, uz, r[4], r[5]),
    )


@formula
def within_rows(j, low, high, low_rule, high_rule):
    """Whether the rows behind a wall of an axis, or their images, hold coordinate j."""
    return (low_rule > 0 and j <= low + IMAGED_ROWS) or (high_rule > 0 and j >= high - IMAGED_ROWS)


@formula
def mirrored_update(
    node, node_mass, node_momentum, blocks, least_mass, node_pull, field, planes, timestep,
):  # fmt: skip
    """(4.19) of a node beside walls that mirror the liquid: masses, momenta and forces of its images are its own.

    The velocity is found for the node on the liquid's side, and a node behind the wall moves as its image.
    """
    jx, jy, jz = node_coordinates(blocks, node)
    low = int(planes.lower[0]), int(planes.lower[1]), int(planes.lower[2])
    high = int(planes.upper[0]), int(planes.upper[1]), int(planes.upper[2])
    r = planes.rules
    near_x = within_rows(jx, low[0], high[0], r[0], r[1])
    near_y = within_rows(jy, low[1], high[1], r[2], r[3])
    near_z = within_rows(jz, low[2], high[2], r[4], r[5])
    if not (near_x or near_y or near_z):
        mass = node_mass[node]
        return node_update(
            node, mass, node_momentum[node, 0], node_momentum[node, 1], node_momentum[node, 2], blocks, least_mass,
            node_pull, field, None, timestep,
        )  # fmt: skip
    real = type(least_mass)
    if (
        buried(jx, low[0], high[0], r[0], r[1]) or buried(jy, low[1], high[1], r[2], r[3])
        or buried(jz, low[2], high[2], r[4], r[5])
    ):  # fmt: skip
        return real(0), real(0), real(0)
    ax = canonical(jx, low[0], high[0], r[0] > 0, r[1] > 0)
    ay = canonical(jy, low[1], high[1], r[2] > 0, r[3] > 0)
    az = canonical(jz, low[2], high[2], r[4] > 0, r[5] > 0)
    mass, mx, my, mz = real(0), real(0), real(0), real(0)
    for kz in range(3):
        iz = image(az, kz, low[2], high[2], r[4] > 0, r[5] > 0)
        for ky in range(3):
            iy = image(ay, ky, low[1], high[1], r[2] > 0, r[3] > 0)
            for kx in range(3):
                ix = image(ax, kx, low[0], high[0], r[0] > 0, r[1] > 0)
                if ix == NOWHERE or iy == NOWHERE or iz == NOWHERE:
                    continue
                n = find_node(blocks, ix, iy, iz)
                if n < 0:
                    continue
                sx, sy, sz = signs(kx, ky, kz, r)
                mass += node_mass[n]
                px, py, pz = node_momentum[n, 0], node_momentum[n, 1], node_momentum[n, 2]
                if node_pull is not None:
                    px += timestep[1] * node_pull[n, 0]
                    py += timestep[1] * node_pull[n, 1]
                    pz += timestep[1] * node_pull[n, 2]
                mx += real(sx) * px
                my += real(sy) * py
                mz += real(sz) * pz
    if not mass > least_mass:
        return real(0), real(0), real(0)
    vx, vy, vz = mx / mass, my / mass, mz / mass
    if field is not None:
        vx += timestep[1] * field[0]
        vy += timestep[1] * field[1]
        vz += timestep[1] * field[2]
    stuck_x, rests_x = on_mirror(ax, low[0], high[0], r[0], r[1])
    stuck_y, rests_y = on_mirror(ay, low[1], high[1], r[2], r[3])
    stuck_z, rests_z = on_mirror(az, low[2], high[2], r[4], r[5])
    if stuck_x or stuck_y or stuck_z:
        return real(0), real(0), real(0)
    vx = real(0) if rests_x else vx
    vy = real(0) if rests_y else vy
    vz = real(0) if rests_z else vz
    sx, sy, sz = signs(
        0 if ax == jx else (1 if jx < low[0] else 2),
        0 if ay == jy else (1 if jy < low[1] else 2),
        0 if az == jz else (1 if jz < low[2] else 2),
        r,
    )
    return real(sx) * vx, real(sy) * vy, real(sz) * vz


@formula
def signs(kx, ky, kz, rules):
    """Signs of a velocity's three parts after the mirrors kx, ky, kz (0 none, 1 lower, 2 upper) of the three axes."""
    xn, xt = reflection(kx, rules[0], rules[1])
    yn, yt = reflection(ky, rules[2], rules[3])
    zn, zt = reflection(kz, rules[4], rules[5])
    return xn * yt * zt, xt * yn * zt, xt * yt * zn


@formula
def contact_pull(i, sample_position, sample_line, spline_cells, blocks, surface_term, contact):
    """Young's force on node i [N]: k cos(theta) sum_s B_i(x_s) l_s, l the outward normals of the wetted area's edge,
    in the wall, times length."""
    real = type(surface_term.cell_size)
    fx, fy, fz = real(0), real(0), real(0)
    space = blocks.neighbour.shape[1] == 27
    for kz in range(3 if space else 1):
        for ky in range(3):
            for kx in range(3):
                cell = step_node(blocks, i, -kx, -ky, -kz)
                if cell < 0:
                    continue
                for k in range(spline_cells.first[cell], spline_cells.first[cell + 1]):
                    s = spline_cells.point[k]
                    lx, ly, lz = sample_line[s, 0], sample_line[s, 1], sample_line[s, 2]
                    if lx == real(0) and ly == real(0) and lz == real(0):
                        continue
                    jx, jy, jz = node_coordinates(blocks, cell)
                    weight = spline_weight(grid_offset(sample_position[s, 0], jx, surface_term), kx)
                    weight *= spline_weight(grid_offset(sample_position[s, 1], jy, surface_term), ky)
                    if space:
                        weight *= spline_weight(grid_offset(sample_position[s, 2], jz, surface_term), kz)
                    fx += weight * lx
                    fy += weight * ly
                    fz += weight * lz
    return contact.pull * fx, contact.pull * fy, contact.pull * fz
