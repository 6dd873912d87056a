"""Triangles of one mesh that meet: found, cut along each other, and reduced to the pieces that bound the solid.

The solid is where the generalised winding number (Jacobson, Kavan & Sorkine-Hornung 2013) exceeds 1/2. A piece of a
triangle bounds it if this holds on one side of the piece only (Zhou, Grinspun, Zorin & Jacobson 2016); others, between
bodies in contact or where a sheet and its reverse cancel, are left out.
"""

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from refsim.core.operation import REGISTRY
from refsim.winding_number import by_halves, clusters

AT_ONCE = 1 << 19  # pairs of boxes or triangles compared in one array
PARALLEL = 0.01  # sine of the angle between planes of triangles that lie in one plane but for rounding
BESIDE = 4.0  # tolerances from a piece to the points on its two sides


def areas(corners: np.ndarray) -> np.ndarray:
    """(t,) areas [m^2] of triangles (t, 3, 3)."""
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def unit_normals(corners: np.ndarray) -> np.ndarray:
    """(t, 3) unit normals of triangles (t, 3, 3), 0 for those without area."""
    normal = _normal_of(corners)
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


def meeting_pairs(
    vertices: np.ndarray, faces: np.ndarray, tolerance: float, wide: float, least_common: int
) -> np.ndarray:
    """(k, 2) pairs of triangles, the lower first, that come within `tolerance` [m] of each other beyond shared corners.

    Nearly parallel triangles with at least `least_common` common corners meet if one lies within `wide` [m] over the
    other, as in folds.
    """
    corners, normal = vertices[faces], unit_normals(vertices[faces])
    found = [np.zeros((0, 2), np.int64)]
    for pairs in _near_pairs(corners, tolerance if least_common else wide):
        same = faces[pairs[:, 0], :, None] == faces[pairs[:, 1], None, :]  # (k, corner of one, corner of other)
        shared = same.sum((1, 2))
        parallel = np.einsum("kx,kx->k", normal[pairs[:, 0]], normal[pairs[:, 1]]) ** 2 >= 1 - PARALLEL**2
        parallel &= shared >= least_common
        allowed = np.where(parallel, wide, tolerance)
        near = np.ones(len(pairs), bool)
        for mine, theirs, common in ((0, 1, same), (1, 0, same.swapaxes(1, 2))):
            plane, least, most = normal[pairs[:, theirs]], np.inf, -np.inf
            base = np.einsum("kx,kx->k", corners[pairs[:, theirs], 0], plane)
            for c in range(3):  # unless all other corners are on one side of a plane
                height = np.einsum("kx,kx->k", corners[pairs[:, mine], c], plane) - base
                height[common[:, c, 0] | common[:, c, 1] | common[:, c, 2]] = np.nan
                least, most = np.fmin(least, height), np.fmax(most, height)
            near &= (shared > 2) | ~((least > allowed) | (most < -allowed))
        pairs, same, shared, flat = pairs[near], same[near], shared[near], parallel[near]
        one, other = corners[pairs[:, 0]], corners[pairs[:, 1]]
        meet = shared > 2
        rows = np.flatnonzero(shared == 0)
        meet[rows] = _over(one[rows], other[rows], normal[pairs[rows, 1]], flat[rows], tolerance)
        rows = np.flatnonzero(shared == 1)
        for mine, theirs, axis in ((0, 1, 2), (1, 0, 1)):  # the edge that does not touch the common corner
            corner = same[rows].any(axis).argmax(1)[:, None]
            edge = np.take_along_axis(corners[pairs[rows, mine]], (corner + [[1, 2]])[..., None] % 3, axis=1)
            plane = pairs[rows, theirs]
            meet[rows] |= _over(edge, corners[plane], normal[plane], flat[rows], tolerance)
        rows = np.flatnonzero(shared == 2)
        meet[rows] = _folded(one[rows], other[rows], same[rows], np.where(flat[rows], wide, tolerance))
        found.append(pairs[meet])
    pairs = np.sort(np.concatenate(found), axis=1)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


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


def _edges_of(corners: np.ndarray) -> np.ndarray:
    sides = np.roll(corners, -1, axis=1) - corners
    return sides if corners.shape[1] == 3 else sides[:, :1]


def _normal_of(corners: np.ndarray) -> np.ndarray:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _over(
    one: np.ndarray, other: np.ndarray, normal: np.ndarray, flat: np.ndarray, tolerance: float
) -> np.ndarray:  # fmt: skip
    """`_within`, for those that are `flat` (k,) after projection onto the other's plane."""
    height = np.einsum("kcx,kx->kc", one - other[:, :1], normal) * flat[:, None]
    return _within(one - height[..., None] * normal[:, None], other, tolerance)


def _within(one: np.ndarray, other: np.ndarray, tolerance: float) -> np.ndarray:
    """Whether triangles or segments (k, 3 or 2, 3) and triangles (k, 3, 3) have no gap wider than the tolerance.

    A gap shows along a normal, along the product of two edges, or across an edge in a triangle's plane.
    """
    meet = np.ones(len(one), bool)
    if not len(one):
        return meet
    origin = other[:, :1]
    one, other = one - origin, other - origin
    normals = [_normal_of(corners)[:, None] for corners in (one, other) if corners.shape[1] == 3]
    for part in range(3):
        rows = np.flatnonzero(meet)
        if part == 0:
            axes = np.concatenate(normals, axis=1)
        else:
            mine, theirs = _edges_of(one[rows]), _edges_of(other[rows])
            if part == 1:
                axes = np.cross(mine[:, :, None], theirs[:, None, :])
                axes = axes.reshape(len(rows), mine.shape[1] * 3, 3)
            else:
                sides = np.concatenate([mine, theirs], axis=1)
                axes = np.concatenate([np.cross(normal[rows], sides) for normal in normals], axis=1)
        length = np.linalg.norm(axes, axis=2, keepdims=True)
        axes = np.where(length > 0, axes / np.where(length > 0, length, 1), 0)
        a, b = one[rows] @ axes.transpose(0, 2, 1), other[rows] @ axes.transpose(0, 2, 1)  # (k, corners, axes)
        gap = np.maximum(a.min(1) - b.max(1), b.min(1) - a.max(1)).max(1)
        meet[rows[gap > tolerance]] = False
    return meet


def _folded(one: np.ndarray, other: np.ndarray, same: np.ndarray, tolerance: np.ndarray) -> np.ndarray:
    """Whether triangles (k, 3, 3) with a common edge lie on each other in one plane."""
    rows = np.arange(len(one))
    tips = [corners[rows, (~same.any(axis)).argmax(1)] for corners, axis in ((one, 2), (other, 1))]
    a = one[rows, ((~same.any(2)).argmax(1) + 1) % 3]
    b = one[rows, ((~same.any(2)).argmax(1) + 2) % 3]
    along = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
    away = [tip - a - ((tip - a) * along).sum(1)[:, None] * along for tip in tips]
    height = np.linalg.norm(np.cross(away[0], away[1]), axis=1)  # of a tip above the other's plane, times the other's
    least = np.minimum(*(np.linalg.norm(v, axis=1) for v in away))
    return ((away[0] * away[1]).sum(1) > 0) & (height <= tolerance * np.where(least > 0, least, np.inf))


def boundary(
    vertices: np.ndarray, faces: np.ndarray, pairs: np.ndarray, tolerance: float, wide: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The pieces of a mesh's triangles that bound the solid, wound counterclockwise as seen from outside.

    pairs      (k, 2) triangles that meet
    tolerance  [m] below which corners are one place and triangles lie in one plane
    wide       [m] the same for nearly parallel triangles that meet

    Returns (vertices (v, 3) [m], faces (t, 3), triangle each comes from (t,), whether that one meets another (t,)).
    """
    corners = vertices[faces]
    meeting = np.zeros(len(faces), bool)
    meeting[pairs] = True
    cuts, lower, reach = _cuts(corners, pairs, tolerance, wide)
    least = reach.copy()  # width of a piece, below which it bounds no more than the space between nearly equal planes
    for side in (0, 1):
        np.maximum.at(least, pairs[:, side], reach[pairs[:, 1 - side]])
    polygon, owner = [], []
    for t in np.flatnonzero(meeting).tolist():
        made = _cut(corners[t], cuts.get(t, ()), float(reach[t]))
        made = [points for points in made if _width(points) > BESIDE * least[t]]
        polygon += made
        owner += [t] * len(made)
    edge, direction, _ = edge_numbers(faces)
    clean = (np.bincount(edge.ravel()) == 2) & (np.bincount(edge.ravel(), direction.ravel()) == 0)
    clean[edge[meeting]] = False
    a, b = across_edges(edge, clean)
    part = connected(len(faces), a // 3, b // 3)
    alone = np.flatnonzero(~meeting)
    largest = alone[np.lexsort((-areas(corners[alone]), part[alone]))]  # each part's largest triangle speaks for it
    largest = largest[np.unique(part[largest], return_index=True)[1]]
    middle = np.concatenate([corners[largest].mean(1), *(points.mean(0)[None] for points in polygon)])
    own = np.concatenate([largest, np.array(owner, np.int64)])
    step = BESIDE * reach[own, None] * unit_normals(corners[own])
    out, within = (winding(place, corners) > 0.5 for place in (middle + step, middle - step))
    bounds = within.astype(int) - out  # 1: the solid lies behind the piece, -1: before it, 0: neither
    covered = np.array([_lies_on(point, corners[lower.get(t, [])], reach[t]) for point, t in zip(middle, own)], bool)
    bounds[covered] = 0
    of_part = np.zeros(int(part.max()) + 1, int)
    of_part[part[largest]] = bounds[: len(largest)]
    sign = of_part[part[alone]]
    triangles, sources, signs = [corners[alone[sign != 0]]], [alone[sign != 0]], [sign[sign != 0]]
    for points, t, s in zip(polygon, owner, bounds[len(largest) :].tolist()):
        if s:
            fan = np.stack([[points[0], points[k], points[k + 1]] for k in range(1, len(points) - 1)])
            triangles.append(fan)
            sources.append(np.full(len(fan), t))
            signs.append(np.full(len(fan), s))
    soup, source, back = np.concatenate(triangles), np.concatenate(sources), np.concatenate(signs) < 0
    soup[back] = soup[back][:, ::-1]
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


def _cuts(
    corners: np.ndarray, pairs: np.ndarray, tolerance: float, wide: float
) -> tuple[dict[int, list[np.ndarray]], dict[int, list[int]], np.ndarray]:
    """(segments (2, 3) [m] along which each triangle is cut, triangles of lower number in the same plane, (t,) distance
    [m] from each triangle within which others lie in its plane)."""
    one, other = corners[pairs[:, 0]], corners[pairs[:, 1]]
    normal, height = [unit_normals(one), unit_normals(other)], []
    for corner, plane, n in ((one, other, normal[1]), (other, one, normal[0])):
        height.append(((corner - plane[:, :1]) * n[:, None]).sum(2))
    apart = np.minimum(*(np.abs(h).max(1) for h in height))
    flat = apart <= np.where((normal[0] * normal[1]).sum(1) ** 2 >= 1 - PARALLEL**2, wide, tolerance)
    height = [np.where(np.abs(h) <= tolerance, 0.0, h) for h in height]
    reach = np.full(len(corners), tolerance)
    for side in (0, 1):
        np.maximum.at(reach, pairs[flat, side], apart[flat])
    line = np.cross(normal[0], normal[1])
    length = np.linalg.norm(line, axis=1)[:, None]
    line = line / np.where(length > 0, length, 1)
    base = one[:, 0]
    span, where = [], None
    for corner, above in ((one, height[0]), (other, height[1])):
        following, after = np.roll(corner, -1, axis=1), np.roll(above, -1, axis=1)
        between = above * after < 0
        share = np.where(between, above / np.where(between, above - after, 1), 0)
        point = np.concatenate([corner, corner + share[..., None] * (following - corner)], axis=1)
        on = np.concatenate([above == 0, between], axis=1)
        place = np.where(on, ((point - base[:, None]) * line[:, None]).sum(2), np.nan)
        low, high = np.where(on, place, np.inf), np.where(on, place, -np.inf)
        span.append((low.min(1), high.max(1)))
        if where is None:
            rows = np.arange(len(pairs))
            where = point[rows, low.argmin(1)], low.min(1)
    assert where is not None
    first, last = np.maximum(span[0][0], span[1][0]), np.minimum(span[0][1], span[1][1])
    cuts: dict[int, list[np.ndarray]] = {}
    lower: dict[int, list[int]] = {}
    with np.errstate(invalid="ignore"):
        crossing = np.flatnonzero(~flat & (last - first > tolerance))
    for k in crossing.tolist():
        ends = np.stack([where[0][k] + (s - where[1][k]) * line[k] for s in (first[k], last[k])])
        for t in pairs[k].tolist():
            cuts.setdefault(t, []).append(ends)
    for k in np.flatnonzero(flat).tolist():
        for t, s in itertools.permutations(pairs[k].tolist()):
            cuts.setdefault(t, []).extend(np.stack([corners[s, c], corners[s, (c + 1) % 3]]) for c in range(3))
        lower.setdefault(int(pairs[k, 1]), []).append(int(pairs[k, 0]))
    return cuts, lower, reach


def _cut(corner: np.ndarray, segments: Sequence[np.ndarray], tolerance: float) -> list[np.ndarray]:
    """Convex pieces (m, 3) of a triangle (3, 3), none of which a segment (2, 3) crosses."""
    x = corner[1] - corner[0]
    x = x / np.linalg.norm(x)
    normal = np.cross(x, corner[2] - corner[0])
    frame = np.stack([x, np.cross(normal / np.linalg.norm(normal), x)])
    pieces = [(corner - corner[0]) @ frame.T]
    for ends in segments:
        a, b = (ends - corner[0]) @ frame.T
        length = float(np.hypot(*(b - a)))
        if length <= tolerance:
            continue
        along = (b - a) / length
        across = np.array([-along[1], along[0]])
        kept = []
        for piece in pieces:
            s = (piece - a) @ across
            s = np.where(np.abs(s) <= tolerance, 0.0, s)
            if s.min() >= 0 or s.max() <= 0 or not _reaches(piece, a, along, length, tolerance):
                kept.append(piece)
                continue
            after, s_after = np.roll(piece, -1, axis=0), np.roll(s, -1)
            new: tuple[list, list] = ([], [])
            for p, q, sp, sq in zip(piece, after, s.tolist(), s_after.tolist()):
                for half, sign in zip(new, (1, -1)):
                    if sign * sp >= 0:
                        half.append(p)
                    if sp * sq < 0:
                        half.append(p + sp / (sp - sq) * (q - p))
            kept += [np.array(half) for half in new]
        pieces = kept
    return [corner[0] + piece @ frame for piece in pieces]


def _width(points: np.ndarray) -> float:
    """Area of a convex polygon (m, 3) over half its longest side [m]."""
    across = np.cross(points[1:-1] - points[0], points[2:] - points[0]).sum(0)
    return float(np.linalg.norm(across) / np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).max())


def _reaches(piece: np.ndarray, a: np.ndarray, along: np.ndarray, length: float, tolerance: float) -> bool:
    """Whether a segment from a (2,) runs through a convex polygon (m, 2), counterclockwise, for more than tolerance."""
    first, last = 0.0, length
    side = np.roll(piece, -1, axis=0) - piece
    size = np.hypot(side[:, 0], side[:, 1])
    for p, (ux, uy) in zip(piece[size > 0], side[size > 0] / size[size > 0, None]):
        inward = -uy * along[0] + ux * along[1]
        above = -uy * (a[0] - p[0]) + ux * (a[1] - p[1])
        if abs(inward) < 1e-12:
            if above <= tolerance:
                return False
        elif inward > 0:
            first = max(first, -above / inward)
        else:
            last = min(last, -above / inward)
    return last - first > tolerance


def _lies_on(point: np.ndarray, corners: np.ndarray, tolerance: float) -> bool:
    """Whether a point (3,) of the plane of triangles (t, 3, 3) lies in one of them."""
    if not len(corners):
        return False
    normal = _normal_of(corners)
    normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    sides = np.roll(corners, -1, axis=1) - corners
    inward = np.cross(normal[:, None], sides) / np.linalg.norm(sides, axis=2)[..., None]
    return bool((((point - corners) * inward).sum(2) >= -tolerance).all(1).any())
