"""Operations of the signed distance: every node against every triangle, float64."""

import numpy as np

from refsim.boundary.signed_distance import reference as ref
from refsim.core.operation import operations
from refsim.sparse_grid.reference import node_table
from refsim.winding_number.operations import winding

operation = operations(paper="patent CN104318598A, 2014", cases="needle thin_plate thick_box")
_PLACE = "node positions are rounded products of coordinate and spacing; differences of them add a few roundings"

BLOCK_BYTES = 2e6  # stays in the cache


def corners_of(triangles):
    """Corners (t, 3, 3) [m]."""
    return np.asarray(triangles.corner, dtype=float).reshape(-1, 3, 3)


def pseudonormals(triangles):
    """Pseudonormals (t, 7, 3) of the features, dimensionless."""
    return np.asarray(triangles.normal, dtype=float).reshape(-1, 7, 3)


def extent(triangles):
    """Largest coordinate of a corner [m]."""
    return np.abs(corners_of(triangles)).max(initial=0.0)


def pairs(triangles, band_grid):
    """For each triangle (block coordinates (k, 3) within its band, margin of the nearest decision [dimensionless])."""
    h, band = float(band_grid.spacing), float(band_grid.band)
    reach = (band + float(band_grid.half_diagonal)) * 1.0001
    for corner in corners_of(triangles):
        edges = np.stack([corner.min(0) - band, corner.max(0) + band]) / h
        low, high = np.floor(edges).astype(int) + [[0], [1]]
        axes = [np.arange(a, b + 1) for a, b in zip(low // 4, high // 4)]
        block = np.stack([a.ravel() for a in np.meshgrid(*axes[::-1], indexing="ij")][::-1], axis=1)
        distance = np.linalg.norm(ref.triangle_offset(h * (4 * block + 1.5), corner[None])[0], axis=1)
        largest, within = np.abs(corner).max(), distance <= reach
        margin = (np.abs(distance - reach) / (reach + largest)).min()
        on_border = np.abs(edges / 4 - np.round(edges / 4)).min() / (1 + largest / h)
        yield block[within], min(margin, on_border if within.any() else 1.0)


def closest_of_all(place, triangles):
    """(least distance [m], owner of the closest feature, least distance of any other owner's) of places (n, 3)."""
    corners, owner = corners_of(triangles), np.asarray(triangles.owner)
    n, t = len(place), len(corners)
    least, which, other = np.full(n, np.inf), np.full(n, -1), np.full(n, np.inf)
    rows = max(1, int(BLOCK_BYTES / (max(t, 1) * 3 * 8 * 8)))
    for part in [slice(begin, begin + rows) for begin in range(0, n if t else 0, rows)]:
        offset, feature = ref.triangle_offset(place[part, None], corners[None])
        distance, owners = np.sqrt((offset**2).sum(-1)), owner[np.arange(t)[None, :], feature]
        best = np.arange(len(distance)), distance.argmin(1)
        least[part], which[part] = distance[best], owners[best]
        other[part] = np.where(owners == owners[best][:, None], np.inf, distance).min(1)
    return least, which, other


@operation(
    "patent P1: one bounding box for each triangle", outputs="block_count", exact="block_count", tolerance=32.0,
    reason="integers; a block whose distance is within rounding of the limit is undecided",
)  # fmt: skip
def count_blocks(triangles, band_grid):
    """Numbers of blocks within the band of each triangle [dimensionless], out of its grown box."""
    pairs_found = list(pairs(triangles, band_grid))
    count, margin = (
        np.array(part, dtype=float) for part in ([len(b) for b, _ in pairs_found], [m for _, m in pairs_found])
    )
    return {"block_count": (count, margin)}


@operation(
    "patent P1: sorted keys", outputs="pair_key pair_triangle", exact="pair_key pair_triangle", tolerance=32.0,
    reason="integers; as for signed_distance.count_blocks",
)  # fmt: skip
def list_blocks(triangles, band_grid, block_first):
    """Key and triangle of each pair; dimensionless."""
    listed = [(ref.block_key(b), np.full(len(b), t), np.full(len(b), m))
             for t, (b, m) in enumerate(pairs(triangles, band_grid))]  # fmt: skip
    key, owner, margin = (np.concatenate([p[k] for p in listed]) if listed else np.zeros(0) for k in range(3))
    return {"pair_key": (key, margin), "pair_triangle": (owner, margin)}


@operation(
    "patent P1: least |phi| in the band, ties to the lower triangle", outputs="unsigned_distance closest",
    exact="closest", entrywise=True, tolerance=16.0, reason=_PLACE,
)  # fmt: skip
def nearest(triangles, band_grid, band_blocks, triangle_lists):
    """Distances [m], at most the band, and the lowest triangle with the closest feature, or -1."""
    band, place = float(band_grid.band), float(band_grid.spacing) * node_table(band_blocks)
    least, which, other = closest_of_all(place, triangles)
    span = np.abs(place).max(1, initial=0.0) + extent(triangles) + band
    margin = np.minimum(np.abs(least - band), np.where(least <= band, other - least, np.inf)) / span
    return {
        "unsigned_distance": (np.minimum(least, band), span),
        "closest": (np.where(least <= band, which, -1), margin),
    }


@operation(
    "patent P1 with E26: angle-weighted pseudonormal of the closest feature, or the winding number", outputs="distance",
    entrywise=True, optional="winding_clusters unclear", tolerance=16.0, reason=_PLACE,
)  # fmt: skip
def signs(triangles, band_grid, band_blocks, closest, unsigned_distance, winding_clusters, unclear):
    """Signed distances [m]; where the closest feature is unclear, by the winding number."""
    place, value = float(band_grid.spacing) * node_table(band_blocks), np.array(unsigned_distance, dtype=float)
    scale = np.abs(place).max(1, initial=0.0) + float(band_grid.band)
    rows = np.flatnonzero(np.asarray(closest) >= 0)
    if len(rows):
        t = np.asarray(closest)[rows]
        offset, feature = ref.triangle_offset(place[rows], corners_of(triangles)[t])
        inside = ref.inside(offset, pseudonormals(triangles)[t, feature])
        if winding_clusters is not None:
            asked = np.asarray(unclear)[t, feature] != 0
            number, _ = winding(place[rows[asked]], winding_clusters)["winding_number"]
            inside[asked] = ref.enclosed(number)
            scale[rows[asked][np.abs(number - 0.5) < 1e-3]] = np.inf
        value[rows] = np.where(inside, -value[rows], value[rows])
    return {"distance": (value, scale)}


@operation(
    "patent E26: interior beyond the band", outputs="distance inside_after", exact="inside_after", entrywise=True,
    tolerance=1.0, reason="values are copied",
)  # fmt: skip
def fill(band_grid, row_first, closest, distance):
    """Distances [m] with the side of the liquid beyond the band, and on which side each block ends."""
    value, closest, first = np.array(distance, dtype=float), np.asarray(closest), np.asarray(row_first)
    after = np.zeros(len(value) // 64)
    for begin, end in np.stack([first[:-1], first[1:]], axis=1):
        nodes = slice(64 * begin, 64 * end)  # a row of blocks; as 16 lines along x
        line, known = (v[nodes].reshape(-1, 16, 4).transpose(1, 0, 2).reshape(16, -1) for v in (value, closest >= 0))
        side = ref.side_before(line, known)
        filled = np.where(known, line, side * float(band_grid.band))
        value[nodes] = filled.reshape(16, -1, 4).transpose(1, 0, 2).reshape(-1)
        after[begin:end] = side[0, 3::4] < 0
    return {"distance": (value, np.abs(value)), "inside_after": (after, np.ones(len(after)))}


@operation(
    "patent P1: trilinear value and slope", outputs="query_distance query_gradient", entrywise=True, tolerance=16.0,
    reason="one rounding in each difference, product and sum of three interpolations of values up to the band",
)  # fmt: skip
def interpolate(query, distance_field):
    """Distance [m] and slope [dimensionless]; between two cells the slope jumps, and either one's is right."""
    h, band = float(distance_field.spacing), float(distance_field.band)
    sampled, points = ref.Sampled(distance_field, h), np.asarray(query, dtype=float)
    value, slope = sampled(points, True)
    u = (points - sampled.origin) / h
    j = np.floor(u)
    jumps = (np.minimum(u - j, 1 - (u - j)) < 1e-9 * (1 + np.abs(j))).any(1)
    size = 1 + np.abs(points).max(1, initial=0.0) / h * 1e-6
    loose = np.where(jumps, np.inf, band / h * size)[:, None] * np.ones(3)
    return {"query_distance": (value, band * size), "query_gradient": (slope, loose)}


@operation(
    "patent P1: exact closest triangle, from those of the cell's corners", outputs="projected projected_normal",
    entrywise=True, tolerance=16.0, reason=_PLACE,
)  # fmt: skip
def project(query, triangles, distance_field):
    """Nearest points [m] and their normals; a result that jumps nearby, between two features or sides, is undecided."""
    h, points = float(distance_field.spacing), np.asarray(query, dtype=float)
    sampled, corners, normals = ref.Sampled(distance_field, h), corners_of(triangles), pseudonormals(triangles)
    place, normal, undecided = points.copy(), np.zeros(points.shape), np.zeros((len(points), 2), bool)
    moves = np.concatenate([np.zeros((1, 3)), 1e-4 * h * np.eye(3), -1e-4 * h * np.eye(3)])
    for i, point in enumerate(points - sampled.origin):
        near = sampled.node(np.floor(point / h).astype(int) + ref.CORNERS)
        near_triangles = sorted({int(distance_field.closest[n]) for n in near if n >= 0} - {-1})
        if near_triangles:
            around = point + moves
            ends = [ref.walk(x, near_triangles, corners, np.asarray(triangles.across)) for x in around]
            offset, t, feature = map(np.array, zip(*ends))
            closest, normals_there = around - offset, normals[t, feature]
            place[i], normal[i] = points[i] + closest[0] - point, normals_there[0]
            undecided[i] = np.ptp(closest, axis=0).max() > 1e-3 * h, np.ptp(normals_there, axis=0).max() > 0
    span = np.abs(points).max(1, initial=0.0) + extent(triangles) + h
    return {
        "projected": (place, np.where(undecided[:, 0], np.inf, span)[:, None] * np.ones(3)),
        "projected_normal": (normal, np.where(undecided[:, 1], np.inf, 1.0)[:, None] * np.ones(3)),
    }
