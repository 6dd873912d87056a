"""What one facet and one boundary particle do in sampling."""

import math

from refsim.backends.compile import kernel
from refsim.backends.tuples import added, cross, difference, dot, over, put, scaled, three
from refsim.boundary.sampling.formulas import hashed_direction, repulsion
from refsim.boundary.signed_distance.formulas import trilinear
from refsim.neighbours.formulas import lower_bound
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
    """Patent P2: initial position [m] of particle i, uniform in facet f, N_(f-1) <= i < N_f of the cumulative counts:
    x = (1 - s) a + s ((1 - w) b + w c), s = sqrt(u)."""
    f = lower_bound(facet_last, i + 1)
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
    x = three(position, i)
    one = type(x[0])(1)
    move = one - one, one - one, one - one
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        apart = difference(x, three(position, j))
        squared = dot(apart, apart)
        if squared < relaxation.cutoff_squared:
            if squared > 0:
                move = added(move, scaled(apart, repulsion(squared, relaxation) / math.sqrt(squared)))
            else:
                move = added(move, hashed_direction(i, int(j), relaxation.seed, one))
    phi, n = trilinear(x, distance_field)
    steep = math.sqrt(dot(n, n))
    if steep > 0:
        n = over(n, steep)
        if relaxation.tangential != 0:
            move = difference(move, scaled(n, dot(move, n)))
    move = scaled(move, relaxation.step)
    length = math.sqrt(dot(move, move))
    if length > relaxation.longest:
        move = scaled(move, relaxation.longest / length)
    move = difference(move, scaled(n, phi))
    put(relaxed_position, i, added(x, move))
    step_length[i] = math.sqrt(dot(move, move))
