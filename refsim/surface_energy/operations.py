"""Operations of the reconstruction of a surface and of its tension: all pairs, matrices, scatter; float64.

Each returns {output: (value, scale)}; scale is the sum of the absolute terms behind the value times their number, for
an integer the relative distance of the decision from flipping. Lengths in m unless they are divided by h.
"""

import math

import numpy as np

from refsim.core.operation import Program, operations, without
from refsim.neighbours.reference import pair_blocks
from refsim.sparse_grid.reference import Lookup, dimension
from refsim.surface_energy import reference as ref

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

EQUALLY_NEAR = 1e-4  # [h] by which particles farther than the nearest count as equally near
TIE = 1e-5  # relative; a sphere whose surface passes nearer than this to a node is not compared


def in_cells(position, surface_term):
    """Positions in units of h, float64; h as rounded."""
    return np.asarray(position, dtype=float) / float(surface_term.cell_size)


def far(coordinates, position):
    """1 + |u| k: how much finer u = x/h - j is rounded than u itself; k is float64's unit over that of the positions.

    coordinates (n, 3) in units of h, position the array that they come from.
    """
    finer = np.finfo(float).eps / np.finfo(np.asarray(position).dtype).eps
    return 1 + finer * np.abs(coordinates).max(axis=-1, initial=0)


def stencil(place, surface_term, blocks, width):
    """(numbers (n, width^dim) of the nodes round each place, -1 where there is none, u = x/h - j, dim)."""
    dim, u = dimension(blocks), in_cells(place, surface_term)
    base = np.zeros((len(u), 3), int)
    base[:, :dim] = np.floor(u[:, :dim] - width / 2 + 1)
    node = base[:, None, :] + corners(width, dim)
    apart = u[:, None, :] - node
    apart[..., dim:] = 0
    return Lookup(blocks)(node), apart, dim


def corners(width, dim):
    """Steps (width^dim, 3) from 0 to width - 1 along each axis, [cells]."""
    axes = [np.arange(width) if c < dim else np.zeros(1, int) for c in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def matrix(place, blocks, surface_term):
    """(row, node, B_node(x_row)) of every node around every place, dimensionless; B may be 0."""
    node, apart, dim = stencil(place, surface_term, blocks, 4)
    row, there = np.broadcast_to(np.arange(len(place))[:, None], node.shape), node >= 0
    return row[there], node[there], ref.basis(apart, dim)[there]


def unit(vectors, length):
    """Vectors over their lengths, 0 where these are 0; dimensionless."""
    return np.divide(vectors, length[..., None], out=np.zeros_like(vectors), where=length[..., None] > 0)


def over(size, value):
    """size/value where the value is not 0, else infinite: a direction without a length is rounding; dimensionless."""
    return np.divide(size, value, out=np.full(np.shape(value), np.inf), where=value > 0)


@operation(
    "Algorithm 1, lines 5 to 9", outputs="node_state", exact="node_state", tolerance=16.0,
    reason="three differences and their squares; compared exactly beyond it", cases=_SHAPES, programs=_ON_GPU,
)  # fmt: skip
def node_states(interior_position, cells, blocks, surface_term):
    """Flags of nodes nearer than r to a particle; a node is decided by its nearest sphere, be it inside or outside."""
    radius = math.sqrt(float(surface_term.radius_squared))
    node, apart, _ = stencil(interior_position, surface_term, blocks, 6)
    coordinates = Lookup(blocks).coordinates
    nearest = np.full(len(coordinates), np.inf)
    np.minimum.at(nearest, node[node >= 0], np.sqrt((apart**2).sum(-1))[node >= 0])
    margin = np.abs(nearest / radius - 1) / far(coordinates, interior_position)
    return {"node_state": (ref.inside(nearest, radius).astype(int), margin)}


@operation(
    "Algorithm 1, lines 10 to 17", outputs="vertex_position", entrywise=True, tolerance=8.0,
    reason="three differences, squares, root and sum; the root's conditioning stands in the scale", cases=_SHAPES,
    programs=_ON_GPU,
)  # fmt: skip
def exit_points(interior_position, cells, blocks, node_state, surface_term, vertex_edge):
    """Vertices [m] where edges leave the union of spheres, undecided where a sphere passes by the edge's inside end."""
    coordinates = Lookup(blocks).coordinates
    node, axis = np.divmod(np.asarray(vertex_edge, dtype=int), 3)
    lower_inside, direction = np.asarray(node_state)[node] == 1, np.eye(3, dtype=int)[axis]
    inside, sign = coordinates[node] + np.where(lower_inside[:, None], 0, direction), np.where(lower_inside, 1, -1)
    h, limit = float(surface_term.cell_size), float(surface_term.radius_squared)
    farthest, loose = np.zeros(len(inside)), np.ones(len(inside))
    for place, apart, distance in pair_blocks(inside, in_cells(interior_position, surface_term)):
        if not distance.shape[1]:
            continue
        along = -np.take_along_axis(apart, axis[place, None, None], axis=2)[..., 0] * sign[place, None]
        across = distance**2 - along**2
        near = ref.inside(distance**2, limit)
        length = np.where(near, ref.exit_length(along, across, limit), 0)
        best = length.argmax(axis=1)[:, None]
        farthest[place] = np.take_along_axis(length, best, 1)[:, 0]
        root = np.sqrt(np.maximum(limit - across, 0))
        condition = np.where(near, np.abs(along) + (limit + across + along**2) / np.maximum(root, 1e-12), 0)
        tie = (np.abs(distance**2 - limit) < TIE * limit).any(1)
        loose[place] = np.where(tie, np.inf, 1 + np.take_along_axis(condition, best, 1)[:, 0])
    value = ref.on_edge(inside, direction, sign[:, None], farthest[:, None], h)
    return {"vertex_position": (value, h * (np.abs(inside) + 1 + np.where(direction > 0, loose[:, None], 0)))}


@operation(
    "centroid and area of a facet, before (4.5)", outputs="sample_position sample_area facet_normal", entrywise=True,
    tolerance=8.0, reason="differences of vertices, products, sum of three squares and root", programs=_ON_GPU,
)  # fmt: skip
def facet_samples(vertex_position, facets):
    """Centroids [m], areas [m^(dim-1)] and normals of facets; the direction of one without area is rounding error."""
    corner = np.asarray(vertex_position, dtype=float)[np.asarray(facets)]
    vector = ref.area_vector(corner)
    area = np.linalg.norm(vector, axis=-1)
    size = np.prod(np.linalg.norm(corner[:, 1:] - corner[:, :1], axis=-1), axis=1)
    return {
        "sample_position": (ref.centroid(corner), np.abs(corner).sum(axis=1)),
        "sample_area": (area, size),
        "facet_normal": (unit(vector, area), np.repeat(over(size, area)[:, None], 3, axis=1)),
    }


@operation(
    "even candidates on the surface, for (4.5)", outputs="candidate_facet candidate_position", exact="candidate_facet",
    entrywise=True, tolerance=8.0, reason="root, differences, products and sums",
)  # fmt: skip
def candidates(vertex_position, facets, area_before, dice):
    """Places [m] in the facets at which the running sum of areas passes the candidates' shares."""
    corner = np.asarray(vertex_position, dtype=float)[np.asarray(facets)]
    before, count = [int(a) for a in area_before], int(dice.candidates)
    share = before[-1] // count if count else 0
    marks = [share * k + (share * (ref.hash_word(dice.seed, k, 0) >> 16) >> 16) for k in range(count)]
    facet = np.minimum(np.searchsorted(before[1:], np.array(marks, int), side="right"), max(len(before) - 2, 0))
    u, w = (np.array([[ref.share(dice.seed, k, c)] for k in range(count)]).reshape(-1, 1) for c in (1, 2))
    place = ref.place_in_facet(corner[facet], u, w) if count else np.zeros((0, 3))
    return {
        "candidate_facet": (facet, np.full(count, np.inf)),
        "candidate_position": (place, np.abs(corner[facet]).sum(axis=1) if count else place),
    }


@operation(
    "Poisson-disk samples, for (4.5)", outputs="accepted", exact="accepted", tolerance=16.0,
    reason="a distance; compared exactly beyond it",
)  # fmt: skip
def poisson_disk(candidate_position, candidate_cells, blocks, dice, surface_term):
    """Flags of the darts that are taken, in turn; one decision within rounding may reverse all that follow."""
    u, disk = in_cells(candidate_position, surface_term), float(surface_term.disk)
    taken, margin = np.zeros(len(u), int), np.inf
    for k in sorted(range(len(u)), key=lambda k: (ref.hash_word(dice.seed, k, 3), k)):
        distance = np.sqrt(((u[taken == 1] - u[k]) ** 2).sum(-1))
        margin = min(margin, np.abs(distance / disk - 1).min(initial=np.inf))
        taken[k] = ref.accepted(distance, disk)
    return {"accepted": (taken, np.full(len(u), margin))}


@operation(
    "section 4.3.1: p_s, n_s and the points of (3.4)", outputs="nearest offset_direction fit_position", exact="nearest",
    entrywise=True, optional="fit_position", tolerance=16.0,
    reason="two positions in float64, their difference, root, quotient, product and sum", cases=_SHAPES,
    programs=_ON_GPU,
)  # fmt: skip
def offsets(interior_position, interior_number, cells, blocks, surface_term, sample_position, sample_cells):
    """Nearest particle, -1 if none is within 2 h, direction away from it, and points of the fit [m].

    Of particles less than 1e-4 h farther than the nearest the one with the lowest number, of equal numbers that of the
    lowest row.
    """
    u, s = in_cells(interior_position, surface_term), in_cells(sample_position, surface_term)
    count, order = len(s), np.lexsort([np.arange(len(u)), np.asarray(interior_number)])
    nearest, margin = np.full(count, -1), np.full(count, np.inf)
    direction, doubt = np.zeros((count, 3)), np.zeros((count, 3))
    loose = far(s, sample_position)
    for place, apart, distance in pair_blocks(s, u):
        if not distance.shape[1]:
            continue
        least = distance.min(axis=1)
        limit, ranked = np.minimum(least + EQUALLY_NEAR, 2.0)[:, None], distance[:, order]
        first = (ranked < limit).argmax(axis=1)
        rows = np.arange(len(first))
        best, length = order[first], ranked[rows, first]
        # another one is taken if the one taken leaves, or one that is ranked before it comes within the limit
        crossing = np.where(np.arange(len(u)) <= first[:, None], np.abs(ranked - limit) / (ranked + 1), np.inf)
        edge, lost = np.abs(least - 2) < TIE, least >= 2
        margin[place] = np.where(edge, 0, crossing.min(axis=1) / loose[place])
        nearest[place], direction[place] = np.where(lost, -1, best), unit(apart[rows, best], length)
        direction[place][lost] = 0
        tie = edge | (margin[place] < TIE)  # the directions of the two differ
        doubt[place] = np.where(tie, np.inf, (1 + 1 / np.maximum(length, 1e-12)) * loose[place])[:, None]
    epsilon, x = float(surface_term.offset) * float(surface_term.cell_size), np.asarray(sample_position, dtype=float)
    points = np.vstack([x, ref.second_point(x, direction, epsilon)])
    return {
        "nearest": (nearest, margin), "offset_direction": (direction, doubt),
        "fit_position": (points, np.vstack([np.abs(x), np.abs(x) + epsilon * doubt])),
    }  # fmt: skip


@operation(
    "(3.7)", outputs="fit_splines node_weight", entrywise=True, tolerance=8.0,
    reason="three splines of three roundings each, products, sum and quotient", programs=_ON_GPU,
)  # fmt: skip
def fit_weights(fit_position, fit_cells, blocks, surface_term):
    """Splines of the points at three nodes from the point's cell on along each axis, and (3.7); dimensionless.

    Of a point on the border of two cells rounding decides the cell. The weight is 0 where the sum is below 1e-12
    (thesis M16).
    """
    dim, coordinates = dimension(blocks), Lookup(blocks).coordinates
    u = in_cells(fit_position, surface_term)
    base = coordinates[np.asarray(fit_cells.cell, dtype=int)]
    splines = ref.spline(u[:, :, None] - base[:, :, None] - np.arange(3))
    splines[:, dim:] = [1.0, 0.0, 0.0]
    _, node, weight = matrix(fit_position, blocks, surface_term)
    total, terms = (np.bincount(node, w, len(coordinates)) for w in (weight, weight > 0))
    value = ref.diagonal(total)
    # at the edge of its support B is the square of a small difference: the difference is what is rounded
    loose, finest = far(coordinates, fit_position), np.finfo(np.asarray(fit_position).dtype).eps
    size = np.bincount(node, np.sqrt(weight) + weight, len(coordinates)) * loose + finest * loose**2
    undecided = np.abs(total - ref.LEAST_SUM) < 0.9 * ref.LEAST_SUM
    return {
        "fit_splines": (splines.reshape(len(u), 9), np.repeat(far(u, fit_position)[:, None], 9, axis=1)),
        "node_weight": (value, np.where(undecided, np.inf, (terms + 4) * size * value**2)),
    }


@operation(
    "(3.5), (3.6), Algorithm 2 with thesis M14", outputs="residual coefficients", entrywise=True, variants=_FITS,
    tolerance=16.0, reason="splines, products and sums of two matrix products in each sweep",
    programs={"cuda": Program("kernels_cuda", variants=tuple(f | without("residual") for f in _FITS))},
)  # fmt: skip
def fit(fit_splines, fit_cells, blocks, surface_term, node_weight, active):
    """Coefficients C of the splines and the last sweep's residual, in units of h, dimensionless.

    Following sweeps spread the rounding error of one, but do not enlarge it: the largest bounds all.
    """
    splines, base = np.asarray(fit_splines, dtype=float).reshape(-1, 3, 3), np.asarray(fit_cells.cell, dtype=int)
    find, dim = Lookup(blocks), dimension(blocks)
    count, rows, steps = len(find.coordinates), len(splines), corners(3, dim)
    node = find((find.coordinates[base] if count else np.zeros((rows, 3), int))[:, None, :] + steps)
    weight = np.prod([splines[:, c, steps[:, c]] for c in range(dim)], axis=0)
    there = (node >= 0) & (base >= 0)[:, None]
    row, node, weight = np.broadcast_to(np.arange(rows)[:, None], node.shape)[there], node[there], weight[there]
    goal = np.where(np.arange(rows) < (rows + 1) // 2, 0.0, float(surface_term.offset))
    step = np.zeros(count)
    step[np.asarray(active, dtype=int)] = np.asarray(node_weight, dtype=float)[np.asarray(active, dtype=int)]
    step *= float(surface_term.relaxation)
    coefficient, scale, residual = np.zeros(count), np.zeros(count), np.zeros(rows)
    for _ in range(int(surface_term.iterations)):
        residual = ref.residual(goal, np.bincount(row, weight * coefficient[node], rows))
        size = ref.residual(np.abs(goal), -np.bincount(row, weight * np.abs(coefficient[node]), rows))
        coefficient, scale = (
            ref.corrected(c, step, np.bincount(node, weight * r[row], count))
            for c, r in ((coefficient, residual), (scale, size))
        )
    spread = scale.max(initial=0) * max(int(surface_term.iterations), 1)
    return {
        "residual": (residual, np.full(rows, 3 * spread + float(surface_term.offset))),
        "coefficients": (coefficient, np.where(step > 0, spread, 0)),
    }


@_normals_of("(3.8), (3.10) to (3.13), (3.17) to (3.19)")
def mls_normals(query_position, spline_cells, blocks, surface_term, coefficients, outward):
    """Value [h] and gradient of the surface, and its unit normal, or the direction handed in; dimensionless."""
    return normals(query_position, blocks, surface_term, coefficients, outward, ref.mls_gradient)


@_normals_of("(3.8), (3.9)")
def spline_normals(query_position, spline_cells, blocks, surface_term, coefficients, outward):
    """As `mls_normals`, by the spline's gradient; dimensionless."""
    return normals(query_position, blocks, surface_term, coefficients, outward, ref.spline_gradient)


def normals(query_position, blocks, surface_term, coefficients, outward, gradient_of):
    """Outputs of both, dimensionless: the direction handed in where the gradient is 0 or points against it."""
    node, apart, dim = stencil(query_position, surface_term, blocks, 4)
    held = np.where(node >= 0, np.append(np.asarray(coefficients, dtype=float), 0)[node], 0)
    value, gradient = ref.value(held, apart, dim), gradient_of(held, apart, dim)
    loose = far(in_cells(query_position, surface_term), query_position)
    terms = (4 * np.abs(held).sum(1) * loose)[:, None] * (np.arange(3) < dim)
    length, size = np.linalg.norm(gradient, axis=1), np.linalg.norm(terms, axis=1)
    outward = np.asarray(outward, dtype=float)
    along = np.einsum("na,na->n", unit(gradient, length), outward)
    kept = (length > 0) & (along >= 0)
    sure = (np.abs(along) > TIE) & (length > TIE * size) | (length == 0) & (terms.sum(1) == 0)
    doubt = np.where(sure, np.where(kept, over(size, length), 1), np.inf)
    return {
        "surface_value": (value, terms[:, 0]),
        "surface_gradient": (gradient, terms),
        "sample_normal": (
            np.where(kept[:, None], unit(gradient, length), outward), np.repeat(doubt[:, None], 3, axis=1)
        ),
    }  # fmt: skip


@operation("thesis M31", outputs="inset_position", entrywise=True, reason="two products and a sum")
def inset(vertex_position, vertex_normal, surface_term):
    """Vertices [m] moved back to the liquid's surface."""
    x, n = np.asarray(vertex_position, dtype=float), np.asarray(vertex_normal, dtype=float)
    back = float(surface_term.inset) * float(surface_term.cell_size)
    return {"inset_position": (ref.inset(x, n, back), np.abs(x) + np.abs(back * n))}


@operation(
    "(4.18) with thesis M1", outputs="node_force", entrywise=True, variants=("", {"surface_term": "printed_sign"}),
    tolerance=8.0, reason="splines, projection, products and sum", cases=_SHAPES,
    programs={**_ON_GPU, "cuda:recorded": Program("kernels_cuda", function="recorded_force")},
)  # fmt: skip
def surface_force(sample_position, sample_area, sample_normal, spline_cells, blocks, surface_term):
    """Force of the tension on the nodes [N]."""
    node, apart, dim = stencil(sample_position, surface_term, blocks, 4)
    normal, area = np.asarray(sample_normal, dtype=float), np.asarray(sample_area, dtype=float)
    k = float(surface_term.tension) / float(surface_term.cell_size)
    force = ref.pull(area[:, None, None], normal[:, None, :], ref.basis_gradient(apart, dim), k)
    loose = far(in_cells(sample_position, surface_term), sample_position)
    size = np.broadcast_to((abs(k) * area * loose)[:, None, None] * (np.arange(3) < dim), force.shape)
    value, scale = np.zeros((2, 64 * len(blocks.keys), 3))
    there = node >= 0
    np.add.at(value, node[there], force[there])
    np.add.at(scale, node[there], size[there])
    return {"node_force": (value, scale * np.bincount(node[there], minlength=len(value))[:, None])}


@operation(
    "connected inside nodes", outputs="node_label", exact="node_label", tolerance=0.0, reason="integers", cases=_SHAPES,
    programs=_COUNTED,
)  # fmt: skip
def components(blocks, node_state):
    """Lowest inside node that edges between inside nodes join to each, dimensionless; -1 outside."""
    find = Lookup(blocks)
    steps = [np.eye(3, dtype=int)[a] * s for a in range(dimension(blocks)) for s in (1, -1)]
    around = [find(find.coordinates + step) for step in steps]
    label = ref.lowest_joined(np.asarray(node_state) == 1, around)
    return {"node_label": (label, np.full(len(label), np.inf))}


@operation(
    "particles of each component", outputs="component_size", exact="component_size", tolerance=0.0, reason="integers",
    cases=_SHAPES, programs=_COUNTED,
)  # fmt: skip
def component_sizes(cells, node_label):
    """Particles of each particle's component, by the lowest node of its cell, dimensionless; 0 outside all."""
    cell = np.asarray(cells.cell, dtype=int)
    label = np.where(cell >= 0, np.append(np.asarray(node_label, dtype=int), -1)[cell], -1)
    return {"component_size": (ref.component_size(label), np.full(len(label), np.inf))}
