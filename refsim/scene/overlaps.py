"""Triangles of one mesh that meet: found, cut along each other, and reduced to the pieces that bound the solid.

The solid is where the generalised winding number (Jacobson, Kavan & Sorkine-Hornung 2013) exceeds 1/2. A piece of a
triangle bounds it if this holds on one side of the piece only (Zhou, Grinspun, Zorin & Jacobson 2016); others, between
bodies in contact or where a sheet and its reverse cancel, are left out.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY
from refsim.winding_number import by_halves, clusters

AT_ONCE = 1 << 19  # pairs of boxes or triangles compared in one array
PARALLEL = 0.01  # sine of the angle between planes of triangles that lie in one plane but for rounding
PIECES, PIECES_EACH = 1_000, 50  # into which triangles that meet may be cut: in all, and more for each of them
BESIDE = 4.0  # tolerances from a piece to the points on its two sides


class Meetings(NamedTuple):
    """Pairs of triangles that cross, or that lie on each other in one plane."""

    pairs: np.ndarray  # (k, 2), the lower first
    flat: np.ndarray  # (k,) whether they lie in one plane
    apart: np.ndarray  # (k,) distance from one to the other's plane, the lesser of both [m]
    ends: np.ndarray  # (k, 2, 3) of the segment along which they cross [m]


def areas(corners: np.ndarray) -> np.ndarray:
    """(t,) areas [m^2] of triangles (t, 3, 3)."""
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def unit_normals(corners: np.ndarray) -> np.ndarray:
    """(t, 3) unit normals of triangles (t, 3, 3), 0 for those without area."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normal / np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)[:, None]


def connected(count: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(count,) number of the connected part of each of `count` things, of which `one` and `other` (k,) are linked."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(one), bool), (one, other)), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def edge_numbers(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """((t, 3) number of the edge that leaves each corner, (t, 3) its direction +-1, (e, 2) vertices of the edges)."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)
    low, high = ends.min(2), ends.max(2)
    _, first, edge = np.unique(low * (int(faces.max(initial=0)) + 1) + high, return_index=True, return_inverse=True)
    pairs = np.stack([low.ravel()[first], high.ravel()[first]], axis=1)
    return edge.reshape(-1, 3), np.where(ends[:, :, 0] == low, 1, -1), pairs


def across_edges(edge: np.ndarray, usable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of corners (k,), (k,), numbered 3 t + corner, whose edges (t, 3) are the same; of `usable` (e,) edges."""
    order = np.argsort(edge.ravel(), kind="stable")
    number = edge.ravel()[order]
    same = np.flatnonzero((number[1:] == number[:-1]) & usable[number[1:]])
    return order[same], order[same + 1]


def meetings(vertices: np.ndarray, faces: np.ndarray, tolerance: float, wide: float) -> Meetings:
    """Triangles that share a segment longer than `tolerance` [m] or an area wider than that, beyond common edges.

    Triangles lie in one plane within `tolerance`, nearly parallel ones within `wide` [m].
    """
    corners, normals = vertices[faces], unit_normals(vertices[faces])
    met = []
    for pairs in _near_pairs(corners, wide):
        pairs = np.sort(pairs, axis=1)
        one, other = corners[pairs[:, 0]], corners[pairs[:, 1]]
        a, b = normals[pairs[:, 0]], normals[pairs[:, 1]]
        # Heights of each one's corners over the other's plane.
        high = [((x - y[:, :1]) * n[:, None]).sum(2) for x, y, n in ((one, other, b), (other, one, a))]
        apart = np.minimum(*(np.abs(h).max(1) for h in high))
        flat = apart <= np.where((a * b).sum(1) ** 2 >= 1 - PARALLEL**2, wide, tolerance)
        same = faces[pairs[:, 0], :, None] == faces[pairs[:, 1], None, :]  # (k, corner of one, corner of other)
        beside = same.sum((1, 2)) > 1
        for h, common in zip(high, (same.any(2), same.any(1))):
            free = np.where(common, np.nan, h)  # all on one side of the other's plane: no more than a common corner
            beside |= (np.fmin.reduce(free, axis=1) > tolerance) | (np.fmax.reduce(free, axis=1) < -tolerance)
        rows = np.flatnonzero(flat | ~beside)
        pairs, one, other, apart, flat = pairs[rows], one[rows], other[rows], apart[rows], flat[rows]
        ends, length = _common_line(one, other, [h[rows] for h in high], a[rows], b[rows], tolerance)
        meet = ~flat & (length > tolerance)
        meet[flat] = _overlap(one[flat], other[flat], b[rows][flat]) > tolerance
        met.append((pairs[meet], flat[meet], apart[meet], ends[meet]))
    parts = [np.concatenate(part) for part in zip(*met)]
    order = np.lexsort(parts[0].T[::-1])
    return Meetings(*(part[order] for part in parts))


def _common_line(
    one: np.ndarray, other: np.ndarray, high: list[np.ndarray], a: np.ndarray, b: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """(ends (k, 2, 3), length (k,)) [m] of the segment in which triangles (k, 3, 3) with unit normals a, b cross; the
    length is negative where they do not."""
    line = np.cross(a, b)
    length = np.linalg.norm(line, axis=1)[:, None]
    line = line / np.where(length > 0, length, 1)
    first, last, base = np.full(len(one), -np.inf), np.full(len(one), np.inf), one[:, :1]
    start = base
    for corner, above in zip((one, other), high):
        above = np.where(np.abs(above) <= tolerance, 0.0, above)
        following, after = np.roll(corner, -1, axis=1), np.roll(above, -1, axis=1)
        between = above * after < 0
        share = np.where(between, above / np.where(between, above - after, 1), 0)
        point = np.concatenate([corner, corner + share[..., None] * (following - corner)], axis=1)
        on = np.concatenate([above == 0, between], axis=1)
        place = ((point - base) * line[:, None]).sum(2)
        low, high_end = np.where(on, place, np.inf), np.where(on, place, -np.inf)
        begins = low.argmin(1)
        rows = np.arange(len(one))
        if corner is one:  # a point of the line
            start = point[rows, begins] - place[rows, begins, None] * line
        first, last = np.maximum(first, low.min(1)), np.minimum(last, high_end.max(1))
    met = last > first
    span = np.where(met[:, None], np.stack([first, last], axis=1), 0)
    return start[:, None] + span[..., None] * line[:, None], np.where(met, span[:, 1] - span[:, 0], -1.0)


def _overlap(one: np.ndarray, other: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(k,) least width [m] by which triangles (k, 3, 3) overlap in the plane of `normal` (k, 3), negative for a gap."""
    one, other = one - other[:, :1], other - other[:, :1]
    sides = np.concatenate([np.roll(corner, -1, axis=1) - corner for corner in (one, other)], axis=1)
    axes = np.cross(normal[:, None], sides)
    axes = axes / np.maximum(np.linalg.norm(axes, axis=2, keepdims=True), np.finfo(float).tiny)
    p, q = one @ axes.transpose(0, 2, 1), other @ axes.transpose(0, 2, 1)  # (k, corners, axes)
    return np.minimum(p.max(1) - q.min(1), q.max(1) - p.min(1)).min(1)


def _near_pairs(corners: np.ndarray, tolerance: float) -> Iterator[np.ndarray]:
    """Pairs (k, 2) of triangles whose boxes, grown by the tolerance, overlap: by descent in a tree of boxes."""
    order, _ = by_halves(corners.mean(1), 8)
    depth = max(0, int(len(corners) - 1).bit_length())
    low, high = np.full((3, 2 << depth), np.inf), np.full((3, 2 << depth), -np.inf)  # node n has children 2 n, 2 n + 1
    leaf = 1 << depth
    low[:, leaf : leaf + len(order)] = corners[order].min(1).T - 0.5 * tolerance
    high[:, leaf : leaf + len(order)] = corners[order].max(1).T + 0.5 * tolerance
    for level in range(depth - 1, -1, -1):
        part, left, right = slice(n := 1 << level, 2 * n), slice(2 * n, 4 * n, 2), slice(2 * n + 1, 4 * n, 2)
        low[:, part], high[:, part] = np.minimum(low[:, left], low[:, right]), np.maximum(high[:, left], high[:, right])
    stack = [np.ones((1, 2), np.int64)]
    while stack:
        nodes = stack.pop()
        if nodes[0, 0] >= leaf:
            yield order[nodes[nodes[:, 0] != nodes[:, 1]] - leaf]
            continue
        children = np.concatenate([2 * nodes + step for step in ((0, 0), (0, 1), (1, 0), (1, 1))])
        children = children[children[:, 0] <= children[:, 1]]
        for lows, highs in zip(low, high):
            a, b = children.T
            children = children[(lows[a] <= highs[b]) & (lows[b] <= highs[a])]
        stack += [children[k : k + AT_ONCE] for k in range(0, len(children), AT_ONCE)]


def boundary(
    vertices: np.ndarray, faces: np.ndarray, meet: Meetings, tolerance: float, name: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The pieces of a mesh's triangles that bound the solid, wound counterclockwise as seen from outside.

    tolerance  [m] below which corners are one place and triangles lie in one plane
    name       of the mesh, in messages

    Returns (vertices (v, 3) [m], faces (t, 3), triangle each comes from (t,), whether that one meets another (t,)).
    Raises InputError where triangles cut each other into too many pieces, as in a crumpled or flattened mesh.
    """
    corners, pairs = vertices[faces], meet.pairs
    meeting = np.zeros(len(faces), bool)
    meeting[pairs] = True
    reach = np.full(len(faces), tolerance)  # distance from each triangle within which others lie in its plane
    for side in (0, 1):
        np.maximum.at(reach, pairs[meet.flat, side], meet.apart[meet.flat])
    least = reach.copy()  # width of a piece, below which it bounds no more than the space between nearly equal planes
    for side in (0, 1):
        np.maximum.at(least, pairs[:, side], reach[pairs[:, 1 - side]])
    cuts: dict[int, list[np.ndarray]] = {t: [] for t in np.flatnonzero(meeting).tolist()}
    lower: dict[int, list[int]] = {t: [] for t in cuts}  # triangles of lower number in the same plane
    for (s, t), flat, ends in zip(pairs.tolist(), meet.flat.tolist(), meet.ends):
        for mesh, others in ((s, t), (t, s)):
            cuts[mesh] += list(corners[others][[[0, 1], [1, 2], [2, 0]]]) if flat else [ends]
        lower[t] += [s] * flat
    polygon: list[tuple[np.ndarray, int]] = []
    left = most = PIECES + PIECES_EACH * len(cuts)
    for t in cuts:
        pieces = _cut(corners[t], cuts[t], float(reach[t]), left)
        left -= len(pieces)
        if left < 0:
            raise InputError(
                f"{name} has {len(cuts):,} triangles that meet others, and these cut each other into more than {most:,}"
                " pieces; unite its bodies before it is exported."
            )
        polygon += [(points, t) for points in pieces if _width(points) > BESIDE * least[t]]
    edge, direction, _ = edge_numbers(faces)
    clean = (np.bincount(edge.ravel()) == 2) & (np.bincount(edge.ravel(), direction.ravel()) == 0)
    clean[edge[meeting]] = False
    a, b = across_edges(edge, clean)
    part = connected(len(faces), a // 3, b // 3)
    alone = np.flatnonzero(~meeting)
    largest = alone[np.lexsort((-areas(corners[alone]), part[alone]))]  # each part's largest triangle speaks for it
    largest = largest[np.unique(part[largest], return_index=True)[1]]
    middle = np.concatenate([corners[largest].mean(1), *(points.mean(0)[None] for points, _ in polygon)])
    mesh = np.concatenate([largest, np.array([t for _, t in polygon], np.int64)])
    step = BESIDE * reach[mesh, None] * unit_normals(corners[mesh])
    out, within = (winding(place, corners) > 0.5 for place in (middle + step, middle - step))
    bounds = within.astype(int) - out  # 1: the solid lies behind the piece, -1: before it, 0: neither
    for k, (t, point) in enumerate(zip(mesh.tolist(), middle)):
        if lower.get(t) and _lies_on(point, corners[lower[t]], reach[t]):
            bounds[k] = 0
    of_part = np.zeros(int(part.max()) + 1, int)
    of_part[part[largest]] = bounds[: len(largest)]
    triangles, sources, signs = [corners[alone]], [alone], [of_part[part[alone]]]
    for (points, t), sign in zip(polygon, bounds[len(largest) :].tolist()):
        triangles.append(np.stack([np.broadcast_to(points[0], points[2:].shape), points[1:-1], points[2:]], axis=1))
        sources.append(np.full(len(points) - 2, t))
        signs.append(np.full(len(points) - 2, sign))
    soup, source, way = np.concatenate(triangles), np.concatenate(sources), np.concatenate(signs)
    soup[way < 0] = soup[way < 0][:, ::-1]
    soup, source = soup[way != 0], source[way != 0]
    place = joined(soup.reshape(-1, 3), tolerance)
    _, first, number = np.unique(place, return_index=True, return_inverse=True)
    new = number.reshape(-1, 3)
    whole = (new != np.roll(new, 1, axis=1)).all(1)
    whole &= 2 * areas(soup) > tolerance * np.linalg.norm(soup - np.roll(soup, 1, axis=1), axis=2).max(1)
    return soup.reshape(-1, 3)[first], new[whole], source[whole], meeting[source[whole]]


def winding(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(n,) winding numbers of triangles (t, 3, 3) [m] about points (n, 3) [m]."""
    value = np.empty(len(points))
    REGISTRY["winding_number.winding"].program("cpu")(points, clusters(corners, "float64"), value)
    return value


def joined(points: np.ndarray, tolerance: float) -> np.ndarray:
    """(n,) number of the group of each point (n, 3) [m]; points within the tolerance of each other are one group."""
    from scipy.spatial import cKDTree

    _, first, place = np.unique(points, axis=0, return_index=True, return_inverse=True)
    pairs = cKDTree(points[first]).query_pairs(tolerance, output_type="ndarray")
    return connected(len(first), pairs[:, 0], pairs[:, 1])[place.reshape(-1)]


def _cut(corner: np.ndarray, segments: Sequence[np.ndarray], tolerance: float, most: int) -> list[np.ndarray]:
    """Convex pieces (m, 3) of a triangle (3, 3), none of which a segment (2, 3) crosses unless they are over `most`."""
    x = corner[1] - corner[0]
    x = x / np.linalg.norm(x)
    normal = np.cross(x, corner[2] - corner[0])
    frame = np.stack([x, np.cross(normal / np.linalg.norm(normal), x)])
    pieces = [(corner - corner[0]) @ frame.T]
    points, first = pieces[0], np.zeros(1, np.int64)  # of all pieces, and where each begins
    for ends in segments:
        a, b = (ends - corner[0]) @ frame.T
        length = float(np.hypot(*(b - a)))
        if length <= tolerance:
            continue
        s = (points - a) @ (np.array([a[1] - b[1], b[0] - a[0]]) / length)
        s = np.where(np.abs(s) <= tolerance, 0.0, s)
        crossed = np.flatnonzero((np.minimum.reduceat(s, first) < 0) & (np.maximum.reduceat(s, first) > 0)).tolist()
        crossed = [k for k in crossed if _runs_through(pieces[k], a, b, tolerance)]
        for k in reversed(crossed):
            piece = pieces[k]
            new: tuple[list, list] = ([], [])
            above = s[first[k] : first[k] + len(piece)]
            for p, q, sp, sq in zip(piece, np.roll(piece, -1, axis=0), above.tolist(), np.roll(above, -1).tolist()):
                for half, sign in zip(new, (1, -1)):
                    half += [p] * (sign * sp >= 0) + [p + sp / (sp - sq or 1) * (q - p)] * (sp * sq < 0)
            pieces[k : k + 1] = [np.array(half) for half in new]
        if crossed:
            points, sizes = np.concatenate(pieces), np.array([len(piece) for piece in pieces])
            first = np.cumsum(sizes) - sizes
        if len(pieces) > most:
            break
    return [corner[0] + piece @ frame for piece in pieces]


def _runs_through(piece: np.ndarray, a: np.ndarray, b: np.ndarray, tolerance: float) -> bool:
    """Whether a segment from a to b (2,) runs in a convex polygon (m, 2), counterclockwise, for more than tolerance."""
    side = np.roll(piece, -1, axis=0) - piece
    inward = np.stack([-side[:, 1], side[:, 0]], axis=1) / np.maximum(np.hypot(*side.T), np.finfo(float).tiny)[:, None]
    begin, length = ((a - piece) * inward).sum(1), float(np.hypot(*(b - a)))
    rate = inward @ ((b - a) / length)
    level = np.abs(rate) < 1e-12
    if (level & (begin <= tolerance) & (np.abs(inward).sum(1) > 0)).any():
        return False
    at = -begin / np.where(level, 1, rate)
    last, first = at[~level & (rate < 0)].min(initial=length), at[~level & (rate > 0)].max(initial=0.0)
    return bool(last - first > tolerance)


def _width(points: np.ndarray) -> float:
    """Area of a convex polygon (m, 3) over half its longest side [m]."""
    across = np.cross(points[1:-1] - points[0], points[2:] - points[0]).sum(0)
    return float(np.linalg.norm(across) / np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).max())


def _lies_on(point: np.ndarray, corners: np.ndarray, tolerance: float) -> bool:
    """Whether a point (3,) of the plane of triangles (t, 3, 3) lies in one of them."""
    sides = np.roll(corners, -1, axis=1) - corners
    inward = np.cross(unit_normals(corners)[:, None], sides) / np.linalg.norm(sides, axis=2)[..., None]
    return bool((((point - corners) * inward).sum(2) >= -tolerance).all(1).any())
