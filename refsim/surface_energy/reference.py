"""NumPy oracle of the reconstruction of a surface and of its tension: all pairs, matrices, scatter; float64.

Each function returns {output: (value, scale)}; scale is the sum of the absolute terms behind the value times their
number, for an integer the relative distance of the decision from flipping. Lengths in m unless they are divided by h.
"""

import math

import numpy as np

from refsim.core.operation import Program, operations, without
from refsim.neighbours.reference import pair_blocks
from refsim.sparse_grid.reference import Lookup, dimension

operation = operations(paper="thesis on surface tension in MPM, 2019")
_SHAPES = "drop disc filament_row two_rows on_nodes block_of_lattice sheet_of_lattice close_drops narrow_cavity spray"
_ON_GPU = {"cuda": "kernels_cuda"}
_COUNTED = {"cpu": "components", **_ON_GPU}
_FITS = {}, {"surface_term": "without_sweeps"}, {"surface_term": "relaxed_further"}
_normals_of = operations(
    paper="thesis on surface tension in MPM, 2019", outputs="surface_value surface_gradient sample_normal",
    entrywise=True, optional="surface_value surface_gradient", tolerance=16.0,
    reason="splines, products, a sum of 27, and the quotient by the length",
    programs={"cuda": Program("kernels_cuda", variants=("surface_value surface_gradient",))},
)  # fmt: skip

LEAST_SUM = 1e-12  # of a node's splines; a node with a smaller sum is not active
EQUALLY_NEAR = 1e-4  # [h] by which particles farther than the nearest count as equally near
TIE = 1e-5  # relative; a sphere whose surface passes nearer than this to a node is not compared


def _in_cells(position, surface_term):
    """Positions in units of h, float64; h as rounded."""
    return np.asarray(position, dtype=float) / float(surface_term.cell_size)


def _far(coordinates, position):
    """1 + |u| k: how much finer u = x/h - j is rounded than u itself; k is float64's unit over that of the positions.

    coordinates (n, 3) in units of h, position the array that they come from.
    """
    finer = np.finfo(float).eps / np.finfo(np.asarray(position).dtype).eps
    return 1 + finer * np.abs(coordinates).max(axis=-1, initial=0)


def _stencil(place, surface_term, dim, width):
    """(nodes (n, width^dim, 3), place - node (n, width^dim, 3) in units of h) round each place."""
    u = _in_cells(place, surface_term)
    base = np.zeros((len(u), 3), int)
    base[:, :dim] = np.floor(u[:, :dim] - width / 2 + 1)
    axes = [np.arange(width) if c < dim else np.zeros(1, int) for c in range(3)]
    steps = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    node = base[:, None, :] + steps[None]
    apart = u[:, None, :] - node
    apart[..., dim:] = 0
    return node, apart


@operation(
    "Algorithm 1, lines 5 to 9", outputs="node_state", exact="node_state", tolerance=16.0,
    reason="three differences and their squares; compared exactly beyond it", cases=_SHAPES, programs=_ON_GPU,
)  # fmt: skip
def node_states(interior_position, cells, blocks, surface_term):
    """Algorithm 1, lines 5 to 9, a flag: s_g = 1 where |x_g - x_v| < r for some particle v; each marks its nodes."""
    dim = dimension(blocks)
    find = Lookup(blocks)
    radius = math.sqrt(float(surface_term.radius_squared))
    node, apart = _stencil(interior_position, surface_term, dim, 6)
    at = find(node)
    distance = np.sqrt((apart**2).sum(-1))
    state = np.zeros(len(find.coordinates), int)
    near = (at >= 0) & (distance < radius)
    state[at[near]] = 1
    # a node is decided by its nearest sphere, be it inside or outside
    nearest = np.full(len(find.coordinates), np.inf)
    np.minimum.at(nearest, at[at >= 0], distance[at >= 0])
    margin = np.abs(nearest / radius - 1) / _far(find.coordinates, interior_position)
    return {"node_state": (state, margin)}


def _edge_ends(blocks, node_state, vertex_edge):
    """(inside end (v, 3), axis (v,), sign (v,)) of cut edges."""
    find = Lookup(blocks)
    node, axis = np.divmod(np.asarray(vertex_edge, dtype=int), 3)
    start = find.coordinates[node]
    lower_inside = np.asarray(node_state)[node] == 1
    step = np.eye(3, dtype=int)[axis]
    return np.where(lower_inside[:, None], start, start + step), axis, np.where(lower_inside, 1, -1)


@operation(
    "Algorithm 1, lines 10 to 17", outputs="vertex_position", entrywise=True, tolerance=8.0,
    reason="three differences, squares, root and sum; the root's conditioning stands in the scale", cases=_SHAPES,
    programs=_ON_GPU,
)  # fmt: skip
def exit_points(interior_position, cells, blocks, node_state, surface_term, vertex_edge):
    """Algorithm 1, lines 10 to 17: x = x_g1 + s h max_v(a + sqrt(r^2/h^2 - q^2)) e_a [m] over |x_g1 - x_v| < r."""
    inside, axis, sign = _edge_ends(blocks, node_state, vertex_edge)
    h, limit = float(surface_term.cell_size), float(surface_term.radius_squared)
    farthest, loose = np.zeros(len(inside)), np.ones(len(inside))
    own = np.arange(len(inside))
    for place, apart, distance in pair_blocks(inside, _in_cells(interior_position, surface_term)):
        k = own[place]
        apart = -apart
        along = np.take_along_axis(apart, axis[k, None, None], axis=2)[..., 0] * sign[k, None]
        across = distance**2 - along**2
        near = distance**2 < limit
        root = np.sqrt(np.maximum(limit - across, 0))
        length = np.where(near, along + root, 0)
        farthest[place] = length.max(axis=1, initial=0)
        tie = (np.abs(distance**2 - limit) < TIE * limit).any(1)
        condition = np.where(near, np.abs(along) + (limit + across + along**2) / np.maximum(root, 1e-12), 0)
        best = length.argmax(axis=1) if length.shape[1] else np.zeros(len(k), int)
        chosen = condition[np.arange(len(k)), best] if length.shape[1] else np.zeros(len(k))
        loose[place] = np.where(tie, np.inf, 1 + chosen)
    step = sign * np.minimum(farthest, 1)
    direction = np.eye(3)[axis]
    value = h * (inside + step[:, None] * direction)
    scale = h * (np.abs(inside) + 1 + np.where(direction > 0, loose[:, None], 0))
    return {"vertex_position": (value, scale)}


@operation(
    "centroid and area of a facet, before (4.5)", outputs="sample_position sample_area facet_normal", entrywise=True,
    tolerance=8.0, reason="differences of vertices, products, sum of three squares and root", programs=_ON_GPU,
)  # fmt: skip
def facet_samples(vertex_position, facets):
    """Centroid x_s = mean of the corners [m], area A_s = |u x v|/2 (length in the plane) and normal of each facet."""
    corner = np.asarray(vertex_position, dtype=float)[np.asarray(facets)]
    count = corner.shape[1]
    side = corner[:, 1:] - corner[:, :1]
    if count == 3:
        vector = np.cross(side[:, 0], side[:, 1]) / 2
        size = np.prod(np.linalg.norm(side, axis=-1), axis=1)
    else:
        vector = side[:, 0] @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        size = np.linalg.norm(side[:, 0], axis=-1)
    area = np.linalg.norm(vector, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = np.where(area[:, None] > 0, vector / area[:, None], 0)
        doubt = np.where(area > 0, size / area, np.inf)
    # the direction of a facet without area is rounding error
    return {
        "sample_position": (corner.mean(axis=1), np.abs(corner).sum(axis=1)),
        "sample_area": (area, size),
        "facet_normal": (normal, np.repeat(doubt[:, None], 3, axis=1)),
    }


def hash_word(a, b, c):
    """hash(a, b, c): 32-bit words of two rounds of xor, shift and multiply."""
    mask = 0xFFFFFFFF
    word = (int(a) * 0x9E3779B1 + int(b) * 0x85EBCA77 + int(c) * 0xC2B2AE3D) & mask
    for _ in range(2):
        word ^= word >> 16
        word = word * 0x7FEB352D & mask
        word ^= word >> 15
        word = word * 0x846CA68B & mask
        word ^= word >> 16
    return word


@operation(
    "even candidates on the surface, for (4.5)", outputs="candidate_facet candidate_position", exact="candidate_facet",
    entrywise=True, tolerance=8.0, reason="root, differences, products and sums",
)  # fmt: skip
def candidates(vertex_position, facets, area_before, dice):
    """Place x = a + s (b - a) + t (c - a) [m] of each candidate, s = sqrt(u) (1 - w), t = sqrt(u) w, in the facet at
    which the running sum of areas passes its share."""
    corner = np.asarray(vertex_position, dtype=float)[np.asarray(facets)]
    before = [int(a) for a in area_before]
    count = int(dice.candidates)
    share = before[-1] // count if count else 0
    facet, place = [], []
    for k in range(count):
        mark = share * k + (share * (hash_word(dice.seed, k, 0) >> 16) >> 16)
        f = min(int(np.searchsorted(before[1:], mark, side="right")), len(before) - 2)
        u, w = ((hash_word(dice.seed, k, c) >> 8) / 2.0**24 for c in (1, 2))
        a, b = corner[f, 0], corner[f, 1]
        if corner.shape[1] == 2:
            place.append(a + u * (b - a))
        else:
            place.append((1 - math.sqrt(u)) * a + math.sqrt(u) * ((1 - w) * b + w * corner[f, 2]))
        facet.append(f)
    position = np.array(place).reshape(-1, 3)
    reach = np.abs(corner).sum(axis=1) if len(corner) else np.zeros((1, 3))
    return {
        "candidate_facet": (np.array(facet, dtype=int), np.full(count, np.inf)),
        "candidate_position": (position, reach[np.array(facet, dtype=int)] if count else position),
    }


@operation(
    "Poisson-disk samples, for (4.5)", outputs="accepted", exact="accepted", tolerance=16.0,
    reason="a distance; compared exactly beyond it",
)  # fmt: skip
def poisson_disk(candidate_position, candidate_cells, blocks, dice, surface_term):
    """Darts one after another: a = 1 (flag) where no taken candidate stands nearer than the disk's radius."""
    u = _in_cells(candidate_position, surface_term)
    turn = sorted(range(len(u)), key=lambda k: (hash_word(dice.seed, k, 3), k))
    taken = np.zeros(len(u), int)
    disk = float(surface_term.disk)
    held = np.zeros((0, 3))
    margin = np.inf
    for k in turn:
        distance = np.sqrt(((held - u[k]) ** 2).sum(-1))
        margin = min(margin, np.abs(distance / disk - 1).min(initial=np.inf))
        if (distance >= disk).all():
            taken[k] = 1
            held = np.vstack([held, u[k]])
    # one decision within rounding may reverse those that follow
    return {"accepted": (taken, np.full(len(u), margin))}


@operation(
    "section 4.3.1: p_s, n_s and the points of (3.4)", outputs="nearest offset_direction fit_position", exact="nearest",
    entrywise=True, optional="fit_position", tolerance=16.0,
    reason="two positions in float64, their difference, root, quotient, product and sum", cases=_SHAPES,
    programs=_ON_GPU,
)  # fmt: skip
def offsets(interior_position, interior_number, cells, blocks, surface_term, sample_position, sample_cells):
    """Section 4.3.1: p_s = argmin_v |x_s - x_v| < 2 h, else -1; n_s = (x_s - x_p)/|x_s - x_p|; q_s = x_s + epsilon n_s.

    Of particles less than 1e-4 h farther than the nearest the one with the lowest number, of equal numbers that of the
    lowest row. Points in [m], directions are dimensionless.
    """
    u, s = _in_cells(interior_position, surface_term), _in_cells(sample_position, surface_term)
    count, order = len(s), np.lexsort([np.arange(len(u)), np.asarray(interior_number)])
    nearest, margin = np.full(count, -1), np.full(count, np.inf)
    direction, doubt = np.zeros((count, 3)), np.zeros((count, 3))
    far = _far(s, sample_position)
    for place, apart, distance in pair_blocks(s, u):
        if not distance.shape[1]:
            continue
        rows = np.arange(distance.shape[0])
        limit = np.minimum(distance.min(axis=1) + EQUALLY_NEAR, 2.0)[:, None]
        ranked = distance[:, order]
        first = (ranked < limit).argmax(axis=1)
        best, least = order[first], ranked[rows, first]
        away = apart[rows, best]
        nearest[place] = best
        # another one is taken if the one taken leaves, or one that is ranked before it comes within the limit
        crossing = np.where(np.arange(len(u)) <= first[:, None], np.abs(ranked - limit) / (ranked + 1), np.inf)
        margin[place] = crossing.min(axis=1) / far[place]
        with np.errstate(invalid="ignore", divide="ignore"):
            direction[place] = np.where(least[:, None] > 0, away / least[:, None], 0)
        tie = margin[place] < TIE  # the directions of the two differ
        doubt[place] = np.where(tie, np.inf, (1 + 1 / np.maximum(least, 1e-12)) * far[place])[:, None]
        least = distance.min(axis=1)
        lost, edge = least >= 2, np.abs(least - 2) < TIE
        nearest[place][lost], direction[place][lost] = -1, 0
        margin[place][edge], doubt[place][edge] = 0, np.inf
    epsilon = float(surface_term.offset) * float(surface_term.cell_size)
    x = np.asarray(sample_position, dtype=float)
    return {
        "nearest": (nearest, margin),
        "offset_direction": (direction, doubt),
        "fit_position": (np.vstack([x, x + epsilon * direction]), np.vstack([np.abs(x), np.abs(x) + epsilon * doubt])),
    }


@operation(
    "C_p of section 4.3.1", outputs="sample_count", exact="sample_count", tolerance=0.0, reason="integers",
    programs=_COUNTED,
)  # fmt: skip
def sample_counts(nearest, sample_count):
    """C_p = number of samples s with p_s = p, dimensionless."""
    count = len(sample_count)
    value = np.array([(np.asarray(nearest) == p).sum() for p in range(count)], dtype=int)
    return {"sample_count": (value, np.full(count, np.inf))}


def spline(u):
    """B(u) = 3/4 - u^2 (|u| < 1/2), 1/2 (3/2 - |u|)^2 (|u| < 3/2), else 0; dimensionless."""
    u = np.abs(u)
    return np.where(u < 0.5, 0.75 - u**2, np.where(u < 1.5, 0.5 * (1.5 - u) ** 2, 0))


def spline_derivative(u):
    """dB/du = -2 u (|u| < 1/2), -sign(u) (3/2 - |u|) (|u| < 3/2), else 0; dimensionless."""
    size = np.abs(u)
    return np.where(size < 0.5, -2 * u, np.where(size < 1.5, -np.sign(u) * (1.5 - size), 0))


def _products(apart, dim):
    """(B_j (n, k), h grad B_j (n, k, 3)) of each place and node round it."""
    one = spline(apart[..., :dim])
    slope = spline_derivative(apart[..., :dim])
    weight = one.prod(-1)
    gradient = np.zeros(apart.shape)
    for c in range(dim):
        gradient[..., c] = slope[..., c] * np.prod(np.delete(one, c, axis=-1), axis=-1)
    return weight, gradient


def _matrix(place, blocks, surface_term):
    """(row, node, B_node(x_row)) of every node around every place; B may be 0."""
    dim = dimension(blocks)
    node, apart = _stencil(place, surface_term, dim, 4)
    weight, _ = _products(apart, dim)
    at = Lookup(blocks)(node)
    row = np.broadcast_to(np.arange(len(place))[:, None], at.shape)
    there = at >= 0
    return row[there], at[there], weight[there]


@operation(
    "(3.7)", outputs="fit_splines node_weight", entrywise=True, tolerance=8.0,
    reason="three splines of three roundings each, products, sum and quotient", programs=_ON_GPU,
)  # fmt: skip
def fit_weights(fit_position, fit_cells, blocks, surface_term):
    """B(x_r/h - j - k) for k = 0, 1, 2 along each axis; (3.7): Lambda_j = 1/sum_r B_j(x_r); dimensionless.

    j is the point's cell: of a point on the border of two, rounding decides which. Lambda is 0 where the sum is below
    1e-12 (thesis M16).
    """
    dim = dimension(blocks)
    find = Lookup(blocks)
    u = _in_cells(fit_position, surface_term)
    base = find.coordinates[np.asarray(fit_cells.cell, dtype=int)]
    splines = spline(u[:, :, None] - base[:, :, None] - np.arange(3))
    splines[:, dim:] = [1.0, 0.0, 0.0]
    _, node, weight = _matrix(fit_position, blocks, surface_term)
    count = 64 * len(blocks.keys)
    total = np.bincount(node, weight, count)
    value = np.where(total > LEAST_SUM, 1 / np.where(total > 0, total, 1), 0)
    # at the edge of its support B is the square of a small difference: the difference is what is rounded
    far = _far(find.coordinates, fit_position)
    finest = np.finfo(np.asarray(fit_position).dtype).eps
    loose = np.bincount(node, np.sqrt(weight) + weight, count) * far + finest * far**2
    terms = np.bincount(node, weight > 0, count)
    undecided = np.abs(total - LEAST_SUM) < 0.9 * LEAST_SUM
    return {
        "fit_splines": (splines.reshape(len(u), 9), np.repeat(_far(u, fit_position)[:, None], 9, axis=1)),
        "node_weight": (value, np.where(undecided, np.inf, (terms + 4) * loose * value**2)),
    }


@operation(
    "(3.5), (3.6), Algorithm 2 with thesis M14", outputs="residual coefficients", entrywise=True, variants=_FITS,
    tolerance=16.0, reason="splines, products and sums of two matrix products in each sweep",
    programs={"cuda": Program("kernels_cuda", variants=tuple(f | without("residual") for f in _FITS))},
)  # fmt: skip
def fit(fit_splines, fit_cells, blocks, surface_term, node_weight, active):
    """(3.6), Algorithm 2: C <- C + w Lambda B^T (b - B C) from C = 0, C and b in units of h, dimensionless.

    The residual is the last sweep's.
    """
    dim = dimension(blocks)
    find = Lookup(blocks)
    splines = np.asarray(fit_splines, dtype=float).reshape(-1, 3, 3)
    base = np.asarray(fit_cells.cell, dtype=int)
    count, rows = 64 * len(blocks.keys), len(splines)
    axes = [np.arange(3) if c < dim else np.zeros(1, int) for c in range(3)]
    steps = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    start = find.coordinates[base] if count else np.zeros((rows, 3), int)
    node = find(start[:, None, :] + steps[None])
    weight = np.prod([splines[:, c, steps[:, c]] for c in range(dim)], axis=0)
    row = np.broadcast_to(np.arange(rows)[:, None], node.shape)
    there = (node >= 0) & (base >= 0)[:, None]
    row, node, weight = row[there], node[there], weight[there]
    goal = np.zeros(rows)
    goal[(rows + 1) // 2 :] = float(surface_term.offset)
    step = np.zeros(count)
    listed = np.asarray(active, dtype=int)
    step[listed] = float(surface_term.relaxation) * np.asarray(node_weight, dtype=float)[listed]
    coefficient, scale = np.zeros(count), np.zeros(count)
    residual = np.zeros(rows)
    for _ in range(int(surface_term.iterations)):
        residual = goal - np.bincount(row, weight * coefficient[node], rows)
        size = np.abs(goal) + np.bincount(row, weight * np.abs(coefficient[node]), rows)
        coefficient = coefficient + step * np.bincount(node, weight * residual[row], count)
        scale = scale + step * np.bincount(node, weight * size[row], count)
    # following sweeps spread the rounding error of one, but do not enlarge it: the largest bounds all
    spread = scale.max(initial=0) * max(int(surface_term.iterations), 1)
    return {
        "residual": (residual, np.full(rows, 3 * spread + float(surface_term.offset))),
        "coefficients": (coefficient, np.where(step > 0, spread, 0)),
    }


@_normals_of("(3.8), (3.10) to (3.13), (3.17) to (3.19)")
def mls_normals(query_position, spline_cells, blocks, surface_term, coefficients, outward):
    """(3.8) f/h = sum_j C_j B_j; (3.17) c = (4/h^2) sum_j B_j C_j (x_j - y); n = c/|c|, or the direction handed in
    where c is 0 or points against it. C in units of h, all dimensionless.

    (3.17) is solved as the weighted least squares it comes from, (3.13), by its matrix.
    """
    return _normals(query_position, blocks, surface_term, coefficients, outward, True)


@_normals_of("(3.8), (3.9)")
def spline_normals(query_position, spline_cells, blocks, surface_term, coefficients, outward):
    """(3.8) f/h = sum_j C_j B_j; (3.9) g = sum_j C_j grad B_j; n = g/|g|, or the direction handed in where g is 0
    or points against it. C in units of h, all dimensionless."""
    return _normals(query_position, blocks, surface_term, coefficients, outward, False)


def _normals(query_position, blocks, surface_term, coefficients, outward, least_squares):
    dim = dimension(blocks)
    node, apart = _stencil(query_position, surface_term, dim, 4)
    weight, slope = _products(apart, dim)
    at = Lookup(blocks)(node)
    held = np.where(at >= 0, np.append(np.asarray(coefficients, dtype=float), 0)[at], 0)
    value = (weight * held).sum(1)
    if least_squares:
        towards = -apart
        moment = np.einsum("nk,nka,nkb->nab", weight, towards, towards) + np.diag([0.0] * dim + [1.0] * (3 - dim))
        side = np.einsum("nk,nk,nka->na", weight, held - value[:, None], towards)
        gradient = np.linalg.solve(moment, side[..., None])[..., 0]
    else:
        gradient = np.einsum("nk,nka->na", held, slope)
    terms = (
        4
        * (np.abs(held).sum(1) * _far(_in_cells(query_position, surface_term), query_position))[:, None]
        * (np.arange(3) < dim)
    )
    gradient[:, dim:] = 0
    length = np.linalg.norm(gradient, axis=1)
    outward = np.asarray(outward, dtype=float)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = gradient / length[:, None]
        doubt = np.linalg.norm(terms, axis=1) / length
    along = np.einsum("na,na->n", unit, outward)
    kept = (length > 0) & (along >= 0)
    unit = np.where(kept[:, None], unit, outward)
    sure = (np.abs(along) > TIE) & (length > TIE * np.linalg.norm(terms, axis=1)) | (length == 0) & (terms.sum(1) == 0)
    doubt = np.where(sure, np.where(kept, doubt, 1), np.inf)
    return {
        "surface_value": (value, terms[:, 0]),
        "surface_gradient": (gradient, terms),
        "sample_normal": (unit, np.repeat(doubt[:, None], 3, axis=1)),
    }


@operation("thesis M31", outputs="inset_position", entrywise=True, reason="two products and a sum")
def inset(vertex_position, vertex_normal, surface_term):
    """x <- x - (r - delta) n [m] of every vertex (thesis M31)."""
    x, n = np.asarray(vertex_position, dtype=float), np.asarray(vertex_normal, dtype=float)
    back = float(surface_term.inset) * float(surface_term.cell_size) * n
    return {"inset_position": (x - back, np.abs(x) + np.abs(back))}


@operation(
    "(4.18) with thesis M1", outputs="node_force", entrywise=True, variants=("", {"surface_term": "printed_sign"}),
    tolerance=8.0, reason="splines, projection, products and sum", cases=_SHAPES, programs=_ON_GPU,
)  # fmt: skip
def surface_force(sample_position, sample_area, sample_normal, spline_cells, blocks, surface_term):
    """(4.18*): f_j = -k sum_s A_s (I - n n^T) grad B_j(x_s) [N]; thesis M1 turns the sign of k."""
    dim = dimension(blocks)
    node, apart = _stencil(sample_position, surface_term, dim, 4)
    _, slope = _products(apart, dim)
    at = Lookup(blocks)(node)
    normal, area = np.asarray(sample_normal, dtype=float), np.asarray(sample_area, dtype=float)
    projector = np.eye(3)[None] - normal[:, :, None] * normal[:, None, :]
    strength = float(surface_term.tension) / float(surface_term.cell_size)
    force = -strength * area[:, None, None] * np.einsum("nab,nkb->nka", projector, slope)
    far = _far(_in_cells(sample_position, surface_term), sample_position)
    size = np.broadcast_to((abs(strength) * area * far)[:, None, None] * (np.arange(3) < dim), force.shape)
    count = 64 * len(blocks.keys)
    value, scale = np.zeros((count, 3)), np.zeros((count, 3))
    there = at >= 0
    np.add.at(value, at[there], force[there])
    np.add.at(scale, at[there], size[there])
    return {"node_force": (value, scale * np.bincount(at[there], minlength=count)[:, None])}


@operation(
    "connected inside nodes", outputs="node_label", exact="node_label", tolerance=0.0, reason="integers", cases=_SHAPES,
    programs=_COUNTED,
)  # fmt: skip
def components(blocks, node_state):
    """l_i = lowest number (dimensionless) of the inside nodes that edges between inside nodes join to i; -1 outside."""
    find = Lookup(blocks)
    inside = np.asarray(node_state) == 1
    label = np.where(inside, np.arange(len(inside)), -1)
    waiting = list(np.flatnonzero(inside)[::-1])
    steps = [np.eye(3, dtype=int)[a] * s for a in range(dimension(blocks)) for s in (1, -1)]
    around = [find(find.coordinates + step) for step in steps]
    seen = np.zeros(len(inside), bool)
    while waiting:
        start = waiting.pop()
        if seen[start]:
            continue
        front = [start]
        seen[start] = True
        while front:
            i = front.pop()
            label[i] = start
            for other in around:
                j = other[i]
                if j >= 0 and inside[j] and not seen[j]:
                    seen[j] = True
                    front.append(j)
    return {"node_label": (label, np.full(len(label), np.inf))}


@operation(
    "particles of each component", outputs="component_size", exact="component_size", tolerance=0.0, reason="integers",
    cases=_SHAPES, programs=_COUNTED,
)  # fmt: skip
def component_sizes(cells, node_label):
    """n_p = particles whose cell's lowest node has the label of p's, dimensionless; 0 outside all components."""
    label = [int(node_label[c]) if c >= 0 else -1 for c in np.asarray(cells.cell)]
    value = [sum(other == own for other in label) if own >= 0 else 0 for own in label]
    return {"component_size": (np.array(value, dtype=int), np.full(len(label), np.inf))}


@operation(
    "rank of the second moment", outputs="extent", exact="extent", tolerance=16.0,
    reason="moments of some ten particles and a determinant; compared exactly beyond it", cases=_SHAPES,
)  # fmt: skip
def extents(interior_position, cells, blocks, surface_term):
    """d_p = number (dimensionless) of eigenvalues l > (1/8)^2 of the second moment, in units of h, of the particles
    nearer than h to each particle p."""
    u = _in_cells(interior_position, surface_term)
    value, margin = np.zeros(len(u), int), np.full(len(u), np.inf)
    for place, apart, distance in pair_blocks(u, u):
        for row, (separation, far) in enumerate(zip(apart, distance, strict=True)):
            near = -separation[far < 1]
            moment = near.T @ near / len(near) - np.outer(near.mean(0), near.mean(0))
            found = np.linalg.eigvalsh(moment)
            value[place.start + row] = (found > 1 / 64).sum()
            edge = np.abs(far - 1).min()
            margin[place.start + row] = min(np.abs(64 * found - 1).min(), edge)
    # the sign of a determinant is decided by the product of all three
    return {"extent": (value, 0.02 * margin / _far(u, interior_position))}
