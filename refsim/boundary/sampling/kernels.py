"""What one facet and one boundary particle do in sampling."""

import math

from refsim.backends.compile import kernel
from refsim.backends.tuples import cross, difference, dot, three
from refsim.boundary.sampling.formulas import facet_of, hashed_direction, repulsion
from refsim.boundary.signed_distance.formulas import trilinear
from refsim.neighbours.rows import row_of
from refsim.surface_energy.formulas import hash_word, unit_share


@kernel
def areas(f, facet_corner, facets_of_mesh, facet_area):
    """Patent P2: area [m^2] of facet f, half the length of the cross product of two sides."""
    a = three(facet_corner, facets_of_mesh[f, 0])
    u = difference(three(facet_corner, facets_of_mesh[f, 1]), a)
    v = difference(three(facet_corner, facets_of_mesh[f, 2]), a)
    w = cross(u, v)
    facet_area[f] = math.sqrt(dot(w, w)) * type(u[0])(0.5)


@kernel
def place(i, facet_corner, facets_of_mesh, facet_last, sample_seed, placed):
    """Initial position [m] of particle i, uniform in its facet: x = (1 - s) a + s ((1 - w) b + w c), s = sqrt(u)."""
    f = facet_of(i, facet_last)
    a, b, c = facets_of_mesh[f, 0], facets_of_mesh[f, 1], facets_of_mesh[f, 2]
    one = type(facet_corner[a, 0])(1)
    root = math.sqrt(unit_share(hash_word(sample_seed, i, 1), one))
    w = unit_share(hash_word(sample_seed, i, 2), one)
    s, t = root * (one - w), root * w
    for k in range(3):
        x = facet_corner[a, k] + s * (facet_corner[b, k] - facet_corner[a, k])
        x += t * (facet_corner[c, k] - facet_corner[a, k])
        placed[i, k] = x


@kernel
def relax(i, position, neighbours, distance_field, relaxation, relaxed_position, step_length):
    """Patent P4 with E24: x += lambda r v_t - phi n [m], the tangential part at most r/2, and the step's length [m].

    v_t = (I - n n^T) sum_l Omega(|x - x_l|) (x - x_l)/|x - x_l|, n = grad phi/|grad phi|.
    """
    first, stride, count = row_of(neighbours, i)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    one = type(x)(1)
    tx, ty, tz = one - one, one - one, one - one
    for k in range(count):
        j = neighbours.entries[first + k * stride]
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
    phi, (nx, ny, nz) = trilinear((x, y, z), distance_field)
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
    relaxed_position[i, 0], relaxed_position[i, 1], relaxed_position[i, 2] = x + tx, y + ty, z + tz
    step_length[i] = math.sqrt(tx * tx + ty * ty + tz * tz)
