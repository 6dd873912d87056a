"""What one facet and one boundary particle do in sampling; both kernels share it."""

import math

from refsim.backends.compile import formula
from refsim.boundary.sampling.formulas import facet_of, hashed_direction, repulsion
from refsim.boundary.signed_distance.formulas import trilinear_near
from refsim.surface_energy.formulas import hash_word, unit_share


@formula
def area(f, facet_corner, facets):
    """Area [m^2] of facet f: half the cross product of two sides."""
    a, b, c = facets[f, 0], facets[f, 1], facets[f, 2]
    ux, uy, uz = (
        facet_corner[b, 0] - facet_corner[a, 0],
        facet_corner[b, 1] - facet_corner[a, 1],
        facet_corner[b, 2] - facet_corner[a, 2],
    )
    vx, vy, vz = (
        facet_corner[c, 0] - facet_corner[a, 0],
        facet_corner[c, 1] - facet_corner[a, 1],
        facet_corner[c, 2] - facet_corner[a, 2],
    )
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return math.sqrt(x * x + y * y + z * z) * type(ux)(0.5)


@formula
def place(i, facet_corner, facets, facet_last, seed):
    """Place [m] of particle i, evenly at random in its facet: x = (1 - s) a + s ((1 - w) b + w c), s = sqrt(u)."""
    f = facet_of(i, facet_last)
    a, b, c = facets[f, 0], facets[f, 1], facets[f, 2]
    one = type(facet_corner[a, 0])(1)
    root = math.sqrt(unit_share(hash_word(seed, i, 1), one))
    w = unit_share(hash_word(seed, i, 2), one)
    s, t = root * (one - w), root * w
    x = facet_corner[a, 0] + s * (facet_corner[b, 0] - facet_corner[a, 0])
    y = facet_corner[a, 1] + s * (facet_corner[b, 1] - facet_corner[a, 1])
    z = facet_corner[a, 2] + s * (facet_corner[b, 2] - facet_corner[a, 2])
    x += t * (facet_corner[c, 0] - facet_corner[a, 0])
    y += t * (facet_corner[c, 1] - facet_corner[a, 1])
    z += t * (facet_corner[c, 2] - facet_corner[a, 2])
    return x, y, z


@formula(inlined=True)
def relax(i, row, position, index, field, relaxation, block):
    """New place [m] of particle i and its way [m]: x += lambda r v_t - phi n, the tangential part at most r/2.

    v_t = (I - n n^T) sum_l Omega(|x - x_l|) (x - x_l)/|x - x_l| (P4 with E24), n = grad phi/|grad phi|.
    `block` of the field is looked at first, -1 for none; the last number returned is the one in which the particle was.
    """
    first, stride, count = row
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    one = type(x)(1)
    tx, ty, tz = one - one, one - one, one - one
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        squared = dx * dx + dy * dy + dz * dz
        if squared < relaxation.cutoff_squared:
            if squared > 0:
                f = repulsion(squared, relaxation) / math.sqrt(squared)
                tx += f * dx
                ty += f * dy
                tz += f * dz
            else:
                ex, ey, ez = hashed_direction(i, int(j), relaxation.seed, one)
                tx += ex
                ty += ey
                tz += ez
    phi, nx, ny, nz, found = trilinear_near(x, y, z, field, block)
    steep = math.sqrt(nx * nx + ny * ny + nz * nz)
    if steep > 0:
        nx, ny, nz = nx / steep, ny / steep, nz / steep
        if relaxation.tangential != 0:
            along = tx * nx + ty * ny + tz * nz
            tx, ty, tz = tx - along * nx, ty - along * ny, tz - along * nz
    tx, ty, tz = relaxation.step * tx, relaxation.step * ty, relaxation.step * tz
    length = math.sqrt(tx * tx + ty * ty + tz * tz)
    if length > relaxation.longest:
        shorter = relaxation.longest / length
        tx, ty, tz = shorter * tx, shorter * ty, shorter * tz
    tx, ty, tz = tx - phi * nx, ty - phi * ny, tz - phi * nz
    return x + tx, y + ty, z + tz, math.sqrt(tx * tx + ty * ty + tz * tz), found
