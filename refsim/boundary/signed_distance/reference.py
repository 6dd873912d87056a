"""NumPy oracle of the signed distance: every node against every triangle, float64."""

import numpy as np

from refsim.core.operation import operations
from refsim.sparse_grid.reference import node_table
from refsim.winding_number.reference import winding

operation = operations(paper="patent CN104318598A, 2014", cases="needle thin_plate thick_box")
_PLACE = "node positions are rounded products of coordinate and spacing; differences of them add a few roundings"

BLOCK_BYTES = 2e6  # stays in the cache
OFFSET = 2**20


def _dot(a, b):
    """Scalar products of vectors (3, ...)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def segment_offset(p, a, b):
    """(p - c (3, ...) [m], t) for the closest point c = a + t (b - a), t in [0, 1], of segments."""
    along, w = b - a, p - a
    length = _dot(along, along)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(length > 0, _dot(w, along) / length, 0.0)
    t = np.clip(t, 0.0, 1.0)
    return w - t * along, t


def triangle_offset(p, corner):
    """(p - c (..., 3) [m], feature) for the closest point c of triangles (..., 3, 3), by barycentric coordinates.

    Points and triangles, of equally many axes, are broadcast against each other. Features: 0 face, 1 to 3 edges ab, bc,
    ca, 4 to 6 corners a, b, c.
    """
    a, b, c = np.moveaxis(corner, (-2, -1), (0, 1))
    p = np.moveaxis(p, -1, 0)
    u, v, w = b - a, c - a, p - a
    uu, uv, vv = _dot(u, u), _dot(u, v), _dot(v, v)
    wu, wv = _dot(w, u), _dot(w, v)
    det = uu * vv - uv * uv
    with np.errstate(invalid="ignore", divide="ignore"):
        s, t = (vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det
        offset = w - s * u - t * v
        ou, ov = _dot(offset, u), _dot(offset, v)  # 0 but for the rounding of a slender triangle's det
        offset -= (vv * ou - uv * ov) / det * u + (uu * ov - uv * ou) / det * v
    over = (det > 0) & (s > 0) & (t > 0) & (s + t < 1)
    offset = np.where(over, offset, np.inf)
    feature = np.zeros(over.shape, int)
    best = _dot(offset, offset)
    for k, (start, end) in enumerate(((a, b), (b, c), (c, a))):
        to_edge, place = segment_offset(p, start, end)
        squared = _dot(to_edge, to_edge)
        nearer = ~over & (squared < best)
        best = np.where(nearer, squared, best)
        offset = np.where(nearer, to_edge, offset)
        own = np.where(place <= 0, 4 + k, np.where(place >= 1, 4 + (k + 1) % 3, 1 + k))
        feature = np.where(nearer, own, feature)
    return np.moveaxis(offset, 0, -1), feature


def _corners(triangles):
    return np.asarray(triangles.corner, dtype=float).reshape(-1, 3, 3)


def _span(triangles):
    corners = _corners(triangles)
    return np.abs(corners).max((1, 2), initial=0.0) if len(corners) else np.zeros(0)


def _pairs(triangles, band_grid):
    """For each triangle (block coordinates (k, 3) within its band, margin of the nearest decision)."""
    h, band = float(band_grid.spacing), float(band_grid.band)
    reach = (band + float(band_grid.half_diagonal)) * 1.0001
    for corner in _corners(triangles):
        low = (np.floor((corner.min(0) - band) / h).astype(int)) // 4
        high = (np.floor((corner.max(0) + band) / h).astype(int) + 1) // 4
        axes = [np.arange(low[c], high[c] + 1) for c in range(3)]
        z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
        block = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        middle = h * (4 * block + 1.5)
        distance = np.linalg.norm(triangle_offset(middle, corner[None])[0], axis=1)
        margin = np.abs(distance - reach) / (reach + np.abs(corner).max())
        edges = np.concatenate([(corner.min(0) - band) / h, (corner.max(0) + band) / h]) / 4
        size = 1 + np.abs(corner).max() / h
        on_border = np.abs(edges - np.round(edges)).min() / size
        yield block[distance <= reach], min(margin.min(), on_border if (distance <= reach).any() else 1.0)


@operation(
    "patent P1: one bounding box for each triangle", outputs="block_count", exact="block_count", tolerance=32.0,
    reason="integers; a block whose distance is within rounding of the limit is undecided",
)  # fmt: skip
def count_blocks(triangles, band_grid):
    """Patent P1: n_t = number of blocks within the band of each triangle [dimensionless], out of its grown box."""
    found = list(_pairs(triangles, band_grid))
    count = np.array([len(blocks) for blocks, _ in found], dtype=float)
    return {"block_count": (count, np.array([margin for _, margin in found], dtype=float))}


@operation(
    "patent P1: sorted keys", outputs="pair_key pair_triangle", exact="pair_key pair_triangle", tolerance=32.0,
    reason="integers; as for signed_distance.count_blocks",
)  # fmt: skip
def list_blocks(triangles, band_grid, block_first):
    """Patent P1: key = (bz + 2^20) 2^42 + (by + 2^20) 2^21 + bx + 2^20 and triangle of each pair; dimensionless."""
    keys, owner, margins = [], [], []
    for t, (block, margin) in enumerate(_pairs(triangles, band_grid)):
        shifted = block + OFFSET
        keys += ((shifted[:, 2] * 2**21 + shifted[:, 1]) * 2**21 + shifted[:, 0]).tolist()
        owner += [t] * len(block)
        margins += [margin] * len(block)
    margins = np.array(margins)
    return {"pair_key": (np.array(keys), margins), "pair_triangle": (np.array(owner), margins)}


def _nearest(place, triangles):
    """(least distance, owner of the closest feature, least distance of a feature of any other owner), places (n, 3)."""
    corners, owner = _corners(triangles), np.asarray(triangles.owner)
    n, t = len(place), len(corners)
    least, which, other = np.full(n, np.inf), np.full(n, -1), np.full(n, np.inf)
    rows = max(1, int(BLOCK_BYTES / (max(t, 1) * 3 * 8 * 8)))
    for begin in range(0, n if t else 0, rows):
        offset, feature = triangle_offset(place[begin : begin + rows, None], corners[None])
        distance = np.sqrt((offset**2).sum(-1))
        owners = owner[np.arange(t)[None, :], feature]
        first = distance.argmin(1)
        here = np.arange(len(first))
        least[begin : begin + rows], which[begin : begin + rows] = distance[here, first], owners[here, first]
        other[begin : begin + rows] = np.where(owners == owners[here, first][:, None], np.inf, distance).min(1)
    return least, which, other


@operation(
    "patent P1: least |phi| in the band, ties to the lower triangle", outputs="unsigned_distance closest",
    exact="closest", entrywise=True, tolerance=16.0, reason=_PLACE,
)  # fmt: skip
def nearest(triangles, band_grid, band_blocks, triangle_lists):
    """Patent P1: |phi_j| = min_t |x_j - t| [m], at most the band; lowest triangle with the closest feature, or -1."""
    band = float(band_grid.band)
    place = float(band_grid.spacing) * node_table(band_blocks)
    least, which, other = _nearest(place, triangles)
    span = np.abs(place).max(1, initial=0.0) + _span(triangles).max(initial=0.0) + band
    within = least <= band
    margin = np.minimum(np.abs(least - band), np.where(within, other - least, np.inf)) / span
    return {"unsigned_distance": (np.minimum(least, band), span), "closest": (np.where(within, which, -1), margin)}


@operation(
    "patent P1 with E26: angle-weighted pseudonormal of the closest feature, or the winding number", outputs="distance",
    entrywise=True, optional="winding_clusters unclear", tolerance=16.0, reason=_PLACE,
)  # fmt: skip
def signs(triangles, band_grid, band_blocks, closest, unsigned_distance, winding_clusters, unclear):
    """Patent P1 with E26: phi = -|phi| [m] where (x - c).n < 0, n the pseudonormal of the closest feature.

    Where that feature is unclear, phi = -|phi| where the winding number exceeds 1/2.
    """
    place = float(band_grid.spacing) * node_table(band_blocks)
    value = np.array(unsigned_distance, dtype=float)
    scale = np.abs(place).max(1, initial=0.0) + float(band_grid.band)
    rows = np.flatnonzero(np.asarray(closest) >= 0)
    if len(rows):
        t = np.asarray(closest)[rows]
        offset, feature = triangle_offset(place[rows], _corners(triangles)[t])
        normal = np.asarray(triangles.normal, dtype=float).reshape(-1, 7, 3)[t, feature]
        inside = (offset * normal).sum(1) < 0
        if winding_clusters is not None:
            asked = np.asarray(unclear)[t, feature] != 0
            number, _ = winding(place[rows[asked]], winding_clusters)["winding_number"]
            inside[asked] = number > 0.5
            scale[rows[asked][np.abs(number - 0.5) < 1e-3]] = np.inf
        value[rows] = np.where(inside, -value[rows], value[rows])
    return {"distance": (value, scale)}


@operation(
    "patent E26: interior beyond the band", outputs="distance inside_after", exact="inside_after", entrywise=True,
    tolerance=1.0, reason="values are copied",
)  # fmt: skip
def fill(band_grid, row_first, closest, distance):
    """Patent E26: beyond the band phi = -band inside and +band outside [m], the side of the last node in it before."""
    value = np.array(distance, dtype=float)
    closest, first = np.asarray(closest), np.asarray(row_first)
    after = np.zeros(len(value) // 64)
    for row in range(len(first) - 1):
        begin, end = first[row], first[row + 1]
        line = value[64 * begin : 64 * end].reshape(-1, 16, 4).transpose(1, 0, 2).reshape(16, -1)
        known = closest[64 * begin : 64 * end].reshape(-1, 16, 4).transpose(1, 0, 2).reshape(16, -1) >= 0
        last = np.maximum.accumulate(np.where(known, np.arange(line.shape[1]), -1), axis=1)
        side = np.where(last >= 0, np.sign(np.take_along_axis(line, np.maximum(last, 0), axis=1)), 1)
        side[side == 0] = 1
        filled = np.where(known, line, side * float(band_grid.band))
        value[64 * begin : 64 * end] = filled.reshape(16, -1, 4).transpose(1, 0, 2).reshape(-1)
        after[begin:end] = side[0, 3::4] < 0
    return {"distance": (value, np.abs(value)), "inside_after": (after, np.ones(len(after)))}


def _node_values(field):
    """{(jx, jy, jz): place} of all nodes, and {(by, bz): [(bx, inside after)]} of all rows of blocks."""
    table = node_table(field)
    places = {tuple(j): n for n, j in enumerate(table.tolist())}
    rows = {}
    for b, (x, y, z) in enumerate((table[::64] // 4).tolist()):
        rows.setdefault((y, z), []).append((x, bool(field.inside_after[b])))
    return places, rows


@operation(
    "patent P1: trilinear value and slope", outputs="query_distance query_gradient", entrywise=True, tolerance=16.0,
    reason="one rounding in each difference, product and sum of three interpolations of values up to the band",
)  # fmt: skip
def interpolate(query, distance_field):
    """Patent P1: phi = sum_c w_c phi_c [m] over the corners of the cell, and its slope d phi/dx [dimensionless]."""
    field = distance_field
    h, band = float(field.spacing), float(field.band)
    places, rows = _node_values(field)
    origin = np.array([field.origin_x, field.origin_y, field.origin_z], dtype=float)
    points = np.asarray(query, dtype=float) - origin
    value, slope = np.zeros(len(points)), np.zeros((len(points), 3))
    jumps = np.zeros(len(points), bool)  # between two cells the slope jumps: either one's is right
    for i, point in enumerate(points):
        j = np.floor(point / h).astype(int)
        u = point / h - j
        jumps[i] = (np.minimum(u, 1 - u) < 1e-9 * (1 + np.abs(j))).any()
        for c in range(8):
            step = c & 1, c >> 1 & 1, c >> 2
            there = tuple((j + step).tolist())
            if there in places:
                phi = float(field.distance[places[there]])
            else:
                before = [inside for x, inside in rows.get((there[1] // 4, there[2] // 4), []) if x < there[0] // 4]
                phi = -band if before and before[-1] else band
            x, y, z = (t if s else 1 - t for s, t in zip(step, u.tolist()))
            value[i] += x * y * z * phi
            for axis, others in enumerate((y * z, x * z, x * y)):
                slope[i, axis] += (1 if step[axis] else -1) * others * phi / h
    size = 1 + np.abs(np.asarray(query, dtype=float)).max(1, initial=0.0) / h * 1e-6
    return {
        "query_distance": (value, band * size),
        "query_gradient": (slope, np.where(jumps, np.inf, band / h * size)[:, None] * np.ones(3)),
    }


def _walked(point, own, corners, across):
    """(distance, point - c, triangle, feature) of the nearest of `own`, then of neighbours as long as one is nearer."""

    def nearest_of(some):
        offset, feature = triangle_offset(point[None], corners[some])
        distance = np.linalg.norm(offset, axis=1)
        k = int(distance.argmin())
        return float(distance[k]), offset[k], int(some[k]), int(feature[k])

    best = nearest_of(own)
    while True:
        following = nearest_of(across[best[2]].tolist())
        if following[0] >= best[0]:
            return best
        best = following


@operation(
    "patent P1: exact closest triangle, from those of the cell's corners", outputs="projected projected_normal",
    entrywise=True, tolerance=16.0, reason=_PLACE,
)  # fmt: skip
def project(query, triangles, distance_field):
    """Nearest point c [m], |x - c| = min over the triangles closest to the corners of the cell and their neighbours."""
    field = distance_field
    h = float(field.spacing)
    places, _ = _node_values(field)
    corners = _corners(triangles)
    normals = np.asarray(triangles.normal, dtype=float).reshape(-1, 7, 3)
    origin = np.array([field.origin_x, field.origin_y, field.origin_z], dtype=float)
    points = np.asarray(query, dtype=float)
    place, normal, undecided = points.copy(), np.zeros(points.shape), np.zeros((len(points), 2), bool)
    moves = np.concatenate([np.zeros((1, 3)), 1e-4 * h * np.eye(3), -1e-4 * h * np.eye(3)])
    for i, point in enumerate(points - origin):
        j = np.floor(point / h).astype(int)
        near = [places.get(tuple((j + [c & 1, c >> 1 & 1, c >> 2]).tolist()), -1) for c in range(8)]
        own = sorted({int(field.closest[n]) for n in near if n >= 0} - {-1})
        around = []
        for move in moves if own else ():  # a result that jumps nearby, between two features or sides, is undecided
            best = _walked(point + move, own, corners, np.asarray(triangles.across))
            around.append((point + move - best[1], normals[best[2], best[3]]))
        if own:
            place[i], normal[i] = points[i] + around[0][0] - point, around[0][1]
            spread = np.ptp(np.array(around), axis=0).max(1)
            undecided[i] = spread[0] > 1e-3 * h, spread[1] > 0
    span = np.abs(points).max(1, initial=0.0) + _span(triangles).max(initial=0.0) + h
    return {
        "projected": (place, np.where(undecided[:, 0], np.inf, span)[:, None] * np.ones(3)),
        "projected_normal": (normal, np.where(undecided[:, 1], np.inf, 1.0)[:, None] * np.ones(3)),
    }
