"""Triangle meshes as boundaries: read by trimesh, repaired where that is safe, otherwise refused with an InputError.

Vertices are relative to the mesh's own origin, the centre of its bounding box, so that float32 resolves them at any
distance from the scene's origin.
"""

import dataclasses
import functools
import math
import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim.core.errors import InputError
from refsim.scene.meshes import check_triangles, read_mesh, written_at
from refsim.scene.overlaps import (
    BESIDE,
    across_edges,
    areas,
    boundary,
    connected,
    edge_numbers,
    joined,
    meeting_pairs,
    unit_normals,
    winding,
)

ZERO_AREA = 1e-12  # height of a triangle over its longest side, below which it is a line
SAME_PLACE = 1e-12  # fraction of the mesh's size below which vertices are merged
WIDEST_GAP = 1e-4  # fraction of the mesh's size up to which corners of open edges are joined
ROUNDINGS = 4.0  # of float32 coordinates between a corner and the plane of another triangle
COPLANAR = 1e-7  # fraction of the mesh's size; no grid has more than 2^21 = 1/4.8e-7 spacings across a mesh
LIKE_TODAY = 4  # edges of a hole that is filled whatever its size
SHEET = 0.25  # share of a body's surface, fills included, above which it counts as a sheet and is not filled
LARGEST_FILL = 0.05  # share of the surface by which larger holes may be filled
MOST_PATCHES = 256  # whose winding is settled across edges of more than two triangles


@dataclass(frozen=True)
class SurfaceMesh:
    """The surface of a solid: outward oriented triangles, with a solid on one side of each.

    vertices  (v, 3) float64 [m] relative to `origin`
    faces     (t, 3) int64, counterclockwise as seen from outside
    origin    (3,) float64 [m]
    source    its name in messages
    notes     one sentence for each repair
    meeting   (t,) whether a face comes of a triangle that met others, so that the sign beside its edges and corners is
              that of the winding number; empty if none does
    """

    vertices: np.ndarray
    faces: np.ndarray
    origin: np.ndarray
    source: str = "mesh"
    notes: tuple[str, ...] = ()
    meeting: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    @property
    def corners(self) -> np.ndarray:
        """(t, 3, 3) corner positions [m] relative to the origin."""
        return self.vertices[self.faces]

    @property
    def area(self) -> float:
        """Surface area [m^2]."""
        return float(areas(self.corners).sum())

    @property
    def volume(self) -> float:
        """Enclosed volume [m^3]."""
        return signed_volume(self.corners)

    @property
    def extent(self) -> np.ndarray:
        """(3,) edges of its bounding box [m]."""
        return np.ptp(self.vertices, axis=0)


def load_mesh(path: str | os.PathLike[str], what: str = "mesh") -> SurfaceMesh:
    """The mesh in a file that trimesh reads (.obj, .stl, .ply, .off, .glb, ...), repaired as by `surface_mesh`.

    what  first words of the messages

    Raises InputError for a file that cannot be read, has no triangles or has no inside.
    """
    read = read_mesh(path, what)
    return surface_mesh(read.vertices, read.faces, str(path), what)


def placed_mesh(
    file: str, center: tuple[float, float, float] | None, size: float, rotation: tuple[float, float, float],
    what: str = "mesh",
) -> SurfaceMesh:  # fmt: skip
    """The mesh of a file, turned by `rotation` [degrees] about x, then y, then z, scaled to `size` [m] unless that is
    0, and moved to `center` [m] unless None; cached while the file is unchanged."""
    written = written_at(file)
    return _placed(file, written, center, size, rotation, what)


@functools.lru_cache(maxsize=8)
def _placed(file: str, written: tuple[int, ...], center: Any, size: float, rotation: Any, what: str) -> SurfaceMesh:
    mesh = load_mesh(file, what)
    vertices = mesh.vertices
    for axis, angle in enumerate(rotation):
        if angle:
            vertices = vertices @ _rotation(axis, math.radians(angle)).T
    middle = 0.5 * (vertices.min(0) + vertices.max(0))
    vertices = vertices - middle
    origin = mesh.origin + middle
    if size > 0:
        vertices = vertices * (size / float(np.ptp(vertices, axis=0).max()))
    if center is not None:
        origin = np.array(center, dtype=float)
    return dataclasses.replace(mesh, vertices=vertices, origin=origin)


def _rotation(axis: int, angle: float) -> np.ndarray:
    """(3, 3) matrix of a rotation by `angle` [rad] about an axis."""
    c, s = math.cos(angle), math.sin(angle)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[a, a], turn[a, b], turn[b, a], turn[b, b] = c, -s, s, c
    return turn


def surface_mesh(vertices: np.ndarray, faces: np.ndarray, source: str = "mesh", what: str = "mesh") -> SurfaceMesh:
    """A mesh from vertices (v, 3) [m] and faces (t, 3), repaired where that is safe.

    Repaired, with a note each: faces that stand twice, triangles without area, corners of open edges less than 1e-4 of
    the size apart, holes, faces wound against their neighbours, bodies wound inside out. Where triangles meet, cross or
    lie in one plane, inside is where the winding number exceeds 1/2, and what does not bound it is left out.

    Raises InputError for a mesh that is empty, not finite, one-sided or without an inside, whose holes would be filled
    by more than 5 % of its surface, or with a body inside another that is not wound as a cavity.
    """
    vertices, faces = np.array(vertices, dtype=float), np.array(faces, dtype=np.int64)
    check_triangles(vertices, faces, source, what)
    name = f"{what}: {source!r}"
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    origin = 0.5 * (vertices.min(0) + vertices.max(0))
    rounded = float(np.abs(vertices).max()) if (vertices == vertices.astype(np.float32)).all() else 0.0
    vertices -= origin
    size = float(np.ptp(vertices, axis=0).max())
    same_plane = COPLANAR * size + ROUNDINGS * float(np.finfo(np.float32).eps) * rounded
    if not size > 0:
        raise InputError(f"{name} has no extent; give a closed triangle mesh.")
    notes: list[str] = []
    vertices, faces = _merged(vertices, faces, size)
    vertices, faces = _welded(vertices, _once(faces, notes), size, notes)
    faces = _without_slivers(vertices, faces, notes)
    if not len(faces):
        raise InputError(f"{name} has no triangle with an area; give a closed triangle mesh.")
    faces = _wound_alike(vertices, faces, name, notes)
    edge, direction, _ = edge_numbers(faces)
    open_edges = int(np.count_nonzero(np.bincount(edge.ravel(), direction.ravel())))
    filled = np.zeros(len(faces), np.int64)
    holes: list[tuple[float, np.ndarray]] = []
    if open_edges:
        vertices, faces, filled, holes = _filled(vertices, faces)
        faces, filled = _without_sheets(vertices, faces, filled, notes)
        edge, _, _ = edge_numbers(faces)
    pairs = meeting_pairs(vertices, faces, same_plane, WIDEST_GAP * size, 1)
    if len(pairs):  # then nearly parallel triangles without a common corner count, too
        pairs = meeting_pairs(vertices, faces, same_plane, WIDEST_GAP * size, 0)
    faces = _turned_outwards(vertices, faces, pairs, same_plane, name, notes)
    if len(pairs) or (np.bincount(edge.ravel()) != 2).any():
        before, corners = faces, vertices[faces]
        vertices, faces, kept, meeting = boundary(vertices, faces, pairs, same_plane, WIDEST_GAP * size)
        _note_overlaps(
            corners, before, np.setdiff1d(np.flatnonzero(filled == 0), kept).size, pairs, open_edges, origin, notes
        )
    else:
        kept, meeting = np.arange(len(faces)), np.zeros(0, bool)
    share = float(areas(vertices[faces])[filled[kept] > LIKE_TODAY].sum())
    share = share / float(areas(vertices[faces]).sum()) if len(faces) else 1.0
    if share > LARGEST_FILL:
        raise InputError(
            f"{name} is open ({_counted(open_edges, 'edge')} where it ends), and a boundary needs a closed"
            " interior, but "
            + (
                f"{100 * share:.0f} % of its surface would be filled holes, more than {100 * LARGEST_FILL:.0f} %"
                if len(faces)
                else "its triangles enclose nothing"
            )
            + "; fill its holes, or give its walls a thickness."
        )
    _note_filled(vertices[faces], filled[kept], holes, open_edges, origin, notes)
    vertices, faces = _split_touching_vertices(vertices, faces, None if len(meeting) else notes)
    return SurfaceMesh(vertices, faces, origin, source, tuple(notes), meeting)


def signed_volume(corners: np.ndarray) -> float:
    """Volume [m^3] enclosed by triangles (t, 3, 3), negative if they are wound inside out."""
    return float(_volumes(corners).sum())


def _volumes(corners: np.ndarray) -> np.ndarray:
    """(t,) volumes [m^3] between triangles (t, 3, 3) and the origin."""
    return np.einsum("tc,tc->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6


def _counted(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _at(point: np.ndarray) -> str:
    return f"({', '.join(f'{x:.4g}' for x in np.round(point, 12) + 0.0)})"


def _merged(vertices: np.ndarray, faces: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Merge coincident vertices: files such as STL repeat them for each triangle."""
    cell = np.round(vertices / (SAME_PLACE * size))
    _, first, place = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    return vertices[first], place.reshape(-1)[faces]


def _once(faces: np.ndarray, notes: list[str]) -> np.ndarray:
    """Each face once; one that stands with both windings cancels if its edges are closed without it.

    If most faces stand with both windings, as in models drawn from two sides, one of each is kept.
    """
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]  # a face with a vertex twice has no area
    triple, first, place = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True)
    if len(first) == len(faces):
        return faces
    turn = np.argmin(faces, axis=1)[:, None]
    second, third = np.take_along_axis(faces, (turn + [[1, 2]]) % 3, axis=1).T
    ways = [np.bincount(place.reshape(-1), way, len(first)) > 0 for way in (second < third, second > third)]
    both = ways[0] & ways[1]
    cancels = np.zeros(len(first), bool)
    if both.any() and 2 * both.sum() <= len(first):
        edge, _, _ = edge_numbers(triple)
        cancels = both & (np.bincount(edge[~both].ravel(), minlength=int(edge.max()) + 1)[edge] % 2 == 0).all(1)
    kept = np.sort(first[~cancels])
    twice = len(faces) - len(kept) - int((np.bincount(place.reshape(-1))[cancels]).sum())
    if twice:
        notes.append(f"{_counted(twice, 'duplicated face')} left out")
    if cancels.any():
        notes.append(f"{_counted(int(cancels.sum()), 'pair')} of faces that stand twice with opposite winding left out")
    return faces[kept]


def _without_slivers(vertices: np.ndarray, faces: np.ndarray, notes: list[str]) -> np.ndarray:
    """Merge triangles without area into the neighbour across their longest side, whose corner they then share."""
    faces, flipped = faces.copy(), 0
    for _ in range(len(faces)):
        corners = vertices[faces]
        sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)  # side k leaves corner k
        flat = np.flatnonzero(2 * areas(corners) <= ZERO_AREA * sides.max(1) ** 2)
        if not len(flat):
            break
        owner: dict[tuple[int, int], list[int]] = {}
        for t, face in enumerate(faces.tolist()):
            for k in range(3):
                owner.setdefault(tuple(sorted((face[k], face[(k + 1) % 3]))), []).append(t)
        touched: set[int] = set()
        done = 0
        for t in flat.tolist():
            k = int(sides[t].argmax())
            a, c, b = (int(faces[t, (k + s) % 3]) for s in range(3))  # b lies between a and c
            others = [o for o in owner[min(a, c), max(a, c)] if o != t]
            if len(others) != 1 or {t, others[0]} & touched:
                continue
            other = others[0]
            d = int(next(v for v in faces[other] if v not in (a, c)))
            if d == b:
                continue
            row = faces[other].tolist()
            faces[other] = [b if v == c else v for v in row]
            faces[t] = [b if v == a else v for v in row]
            touched |= {t, other}
            done += 1
        flipped += done
        if not done:
            faces = np.delete(faces, flat, axis=0)
            flipped += len(flat)
            break
    if flipped:
        notes.append(f"{_counted(flipped, 'triangle')} without area taken into the neighbours")
    return faces


def _welded(vertices: np.ndarray, faces: np.ndarray, size: float, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Join corners of open edges, at the least distance (a power of ten) that leaves the fewest edges open.

    A distance is too large if a triangle would lose a corner.
    """

    def open_corners(faces: np.ndarray) -> tuple[int, np.ndarray]:
        edge, _, ends = edge_numbers(faces)
        alone = np.bincount(edge.ravel()) == 1
        return int(alone.sum()), np.unique(ends[alone])

    least, at = open_corners(faces)
    best = None
    for power in range(-11, round(np.log10(WIDEST_GAP)) + 1) if least else ():
        group = np.arange(len(vertices))
        _, first, place = np.unique(joined(vertices[at], 10.0**power * size), return_index=True, return_inverse=True)
        group[at] = at[first[place]]
        new = group[faces]
        if (new == np.roll(new, 1, axis=1)).any():
            break
        count, _ = open_corners(_once(new, []))
        if count < least:
            least, best = count, group
    if best is None:
        return vertices, faces
    number = np.bincount(best, minlength=len(vertices))
    sums = [np.bincount(best, vertices[:, c], len(vertices)) for c in range(3)]
    middle = np.stack(sums, axis=1) / np.maximum(number, 1)[:, None]
    apart = float(np.linalg.norm(vertices - middle[best], axis=1).max())
    notes.append(
        f"{int((number[best] > 1).sum())} corners of open edges joined, which lay up to {2 * apart / size:.2g} of the"
        f" mesh's size apart (limit {WIDEST_GAP:g})"
    )
    used, new = np.unique(best[faces], return_inverse=True)
    return middle[used], _once(new.reshape(-1, 3), notes)


def _wound_alike(vertices: np.ndarray, faces: np.ndarray, name: str, notes: list[str]) -> np.ndarray:
    """Faces wound as their neighbours across edges of two triangles; then patches so that other edges are closed."""
    edge, direction, _ = edge_numbers(faces)
    uses = np.bincount(edge.ravel())
    one, other = across_edges(edge, uses == 2)
    apart = len(faces) * (direction.ravel()[one] == direction.ravel()[other])  # one of both has to be turned
    one, other, count = one // 3, other // 3, len(faces)
    # Face f stands as f and, turned, as f + count: what is linked is wound alike.
    way = connected(
        2 * count,
        np.concatenate([one, one + count]),
        np.concatenate([other + apart, (other + count + apart) % (2 * count)]),
    ).reshape(2, count)
    if (way[0] == way[1]).any():
        raise InputError(f"{name} has one side only, like a Moebius strip, and so no interior; give a closed mesh.")
    number = np.bincount(way[0], minlength=int(way.max()) + 1)
    fewer = (number[way[0]] < number[way[1]]) | ((number[way[0]] == number[way[1]]) & (way[0] > way[1]))
    if fewer.any():
        notes.append(f"{_counted(int(fewer.sum()), 'face')} wound as the neighbours are")
        faces = np.where(fewer[:, None], faces[:, ::-1], faces)
        edge, direction, _ = edge_numbers(faces)
    if not (uses > 2).any():
        return faces
    a, b = across_edges(edge, uses == 2)
    patch = connected(len(faces), a // 3, b // 3)
    count, crowded = int(patch.max()) + 1, uses[edge] > 2
    if not 1 < count <= MOST_PATCHES:
        return faces
    place, owner = np.unique(edge[crowded], return_inverse=True)[1], np.repeat(patch, 3).reshape(-1, 3)[crowded]
    share = np.zeros((count, int(place.max()) + 1))
    np.add.at(share, (owner, place), direction[crowded])
    sign = np.ones(count)
    for _ in range(count):  # turn the patch that closes most edges, as long as one does
        total = sign @ share
        gain = np.abs(total).sum() - np.abs(total - 2 * sign[:, None] * share).sum(1)
        if gain.max() <= 0:
            break
        sign[gain.argmax()] *= -1
    if (sign < 0).any():
        wrong = sign[patch] < 0
        faces = faces.copy()
        faces[wrong] = faces[wrong][:, ::-1]
        notes.append(f"{_counted(int(wrong.sum()), 'face')} wound as those across edges of more than two triangles are")
    return faces


def _filled(
    vertices: np.ndarray, faces: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[tuple[float, np.ndarray]]]:
    """Close all loops of edges at which the surface ends: by one or two triangles, or by a fan around the middle.

    Returns (vertices, faces, edges of the hole that each face fills or 0 (t,), [width [m] and middle of each hole]).
    """
    edge, direction, ends = edge_numbers(faces)
    net = np.bincount(edge.ravel(), direction.ravel()).astype(int)
    leaving: dict[int, list[int]] = {}
    for e in np.flatnonzero(net).tolist():
        low, high = ends[e].tolist()
        start, end = (high, low) if net[e] > 0 else (low, high)  # against the triangle, as the fill runs
        leaving.setdefault(start, []).extend([end] * abs(net[e]))
    new: list[list[int]] = []
    filled: list[int] = []
    holes: list[tuple[float, np.ndarray]] = []
    added: list[np.ndarray] = []
    for start in sorted(leaving):
        while leaving[start]:
            path, place = [start], {start: 0}
            while True:
                following = leaving[path[-1]].pop()
                if following not in place:
                    place[following] = len(path)
                    path.append(following)
                    continue
                loop = path[place[following] :]
                for vertex in loop[1:]:
                    del place[vertex]
                path = path[: place[following] + 1]
                around = vertices[loop]
                if len(loop) == LIKE_TODAY and np.linalg.norm(around[0] - around[2]) > np.linalg.norm(
                    around[1] - around[3]
                ):
                    loop = [*loop[1:], loop[0]]
                if len(loop) <= LIKE_TODAY:
                    fan = [[loop[0], loop[k], loop[k + 1]] for k in range(1, len(loop) - 1)]
                else:
                    middle = len(vertices) + len(added)
                    added.append(around.mean(0))
                    fan = [[middle, u, v] for u, v in zip(loop, [*loop[1:], loop[0]])]
                    holes.append((float(np.ptp(around, axis=0).max()), around.mean(0)))
                new += fan
                filled += [len(loop)] * len(fan)
                if len(path) == 1:
                    break
    vertices = np.concatenate([vertices, np.reshape(added, (-1, 3))])
    fill = np.array(new, np.int64).reshape(-1, 3)
    corner = vertices[fill]
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(1, initial=0.0)
    wide = 2 * areas(corner) > ZERO_AREA * longest**2
    edges = np.concatenate([np.zeros(len(faces), np.int64), np.array(filled, np.int64)[wide]])
    return vertices, np.concatenate([faces, fill[wide]]), edges, holes


def _bodies(faces: np.ndarray) -> np.ndarray:
    """(t,) number of the body of each face: faces across edges of two triangles, and patches that close each other."""
    edge, direction, _ = edge_numbers(faces)
    uses = np.bincount(edge.ravel())
    a, b = across_edges(edge, uses == 2)
    patch = connected(len(faces), a // 3, b // 3)
    crowded = uses[edge] > 2
    if not crowded.any():
        return patch
    key, place = np.unique(
        np.stack([edge[crowded], np.repeat(patch, 3).reshape(-1, 3)[crowded]], 1), axis=0, return_inverse=True
    )
    key = key[np.bincount(place.reshape(-1), direction[crowded]) != 0]
    same = np.flatnonzero(key[1:, 0] == key[:-1, 0])
    return connected(int(patch.max()) + 1, key[same, 1], key[same + 1, 1])[patch]


def _without_sheets(
    vertices: np.ndarray, faces: np.ndarray, filled: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Faces and fills without open sheets, such as fins on an edge, unless there is nothing else."""
    body, area = _bodies(faces), areas(vertices[faces])
    sheet = (np.bincount(body, area * (filled > 0)) > SHEET * np.bincount(body, area))[body]
    if sheet.any() and not sheet.all():
        lost = _counted(int((sheet & (filled == 0)).sum()), "triangle")
        notes.append(f"{lost} of open sheets, which enclose nothing, left out")
        faces, filled = faces[~sheet], filled[~sheet]
    return faces, filled


def _turned_outwards(
    vertices: np.ndarray, faces: np.ndarray, pairs: np.ndarray, same_plane: float, name: str, notes: list[str]
) -> np.ndarray:
    """Bodies with a negative volume are turned, unless they are cavities of others."""
    body = _bodies(faces)
    count = int(body.max()) + 1
    corners = vertices[faces]
    inverted = np.bincount(body, _volumes(corners)) < 0
    meets = np.zeros(count, bool)
    meets[body[pairs][body[pairs[:, 0]] != body[pairs[:, 1]]]] = True
    hosts = _hosts(corners, body, count, meets)
    if (hosts % 2 * ~inverted * ~meets).any():
        raise InputError(
            f"{name} has a body inside another body, and neither is wound as a cavity; remove the"
            " inner one, or turn its faces round to make it a cavity."
        )
    for b in np.flatnonzero(inverted & meets).tolist():  # a pocket: what it bounds lies in the others
        own = corners[body == b]
        depth = winding(own.mean(1) + BESIDE * same_plane * unit_normals(own), corners[body != b])
        hosts[b] = np.average(depth > 0.5, weights=areas(own)) > 0.5
    wrong = inverted & (hosts % 2 == 0)
    if wrong.any():
        faces = faces.copy()
        faces[wrong[body]] = faces[wrong[body]][:, ::-1]
        notes.append(f"{_counted(int(wrong.sum()), 'body', 'bodies')} turned inside out")
    return faces


def _hosts(corners: np.ndarray, body: np.ndarray, count: int, meets: np.ndarray) -> np.ndarray:
    """(bodies,) number of other bodies that contain each one, by the winding number about one of its faces' middles."""
    hosts = np.zeros(count, int)
    if count == 1:
        return hosts
    order = np.argsort(body, kind="stable")
    first = np.searchsorted(body[order], np.arange(count + 1))
    middle = corners[order[first[:-1]]].mean(1)
    low = np.minimum.reduceat(corners[order].min(1), first[:-1], axis=0)
    high = np.maximum.reduceat(corners[order].max(1), first[:-1], axis=0)
    for b in range(count):
        inside = np.flatnonzero(((middle > low[b]) & (middle < high[b])).all(1))
        inside = inside[(inside != b) & ~meets[inside]]
        if len(inside):
            about = winding(middle[inside], corners[order[first[b] : first[b + 1]]])
            hosts[inside] += np.abs(np.round(about)).astype(int) % 2
    return hosts


def _note_overlaps(
    corners: np.ndarray, before: np.ndarray, lost: int, pairs: np.ndarray, open_edges: int, origin: np.ndarray,
    notes: list[str],
) -> None:  # fmt: skip
    """Say where triangles meet, what is taken for the inside, and what is left out."""
    edge, _, _ = edge_numbers(before)
    crowded = np.flatnonzero(np.bincount(edge.ravel()) > 2)
    where = []
    if len(crowded):
        t, k = np.argwhere(edge == crowded[0])[0].tolist()
        middle = 0.5 * (corners[t, k] + corners[t, (k + 1) % 3])
        words = _counted(len(crowded), "edge has", "edges have")
        where.append(f"{words} more than two triangles, the first near {_at(middle + origin)} of the file")
    if len(pairs):
        words = _counted(len(np.unique(pairs)), "triangle meets", "triangles meet")
        where.append(f"{words} others beyond common edges, the first near {_at(corners[pairs[0, 0]].mean(0) + origin)}")
    if open_edges:
        where.append(f"the surface ends at {_counted(open_edges, 'edge')}")
    notes.append(" and ".join(where) + ": inside is where the winding number exceeds 1/2")
    if lost:
        notes.append(f"{_counted(lost, 'triangle')} with the solid on both sides or on neither left out")


def _note_filled(
    corners: np.ndarray, filled: np.ndarray, holes: list[tuple[float, np.ndarray]], open_edges: int,
    origin: np.ndarray, notes: list[str],
) -> None:  # fmt: skip
    """Say which holes were filled, and where the widest is."""
    small = int(((filled > 0) & (filled <= LIKE_TODAY)).sum())
    if small:
        notes.append(f"holes filled with {_counted(small, 'triangle')}")
    large = float(areas(corners[filled > LIKE_TODAY]).sum())
    if large:
        width, middle = max(holes, key=lambda hole: hole[0])
        width /= float(np.ptp(corners, axis=(0, 1)).max())
        share = 100 * large / float(areas(corners).sum())
        notes.append(
            f"{_counted(len(holes), 'hole')} of {open_edges} open edges filled by a fan, the widest {width:.2g} of the"
            f" mesh's size wide at {_at(middle + origin)} of the file: {share:.2g} % of the surface"
        )


def _split_touching_vertices(
    vertices: np.ndarray, faces: np.ndarray, notes: list[str] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Give each fan of faces its own vertex, so that bodies which touch at a point keep separate normals."""
    edge, direction, _ = edge_numbers(faces)
    closed = (np.bincount(edge.ravel()) == 2) & (np.bincount(edge.ravel(), direction.ravel()) == 0)
    first, second = across_edges(edge, closed)
    corner = np.arange(3 * len(faces)).reshape(-1, 3)
    begin, end = corner.reshape(-1), np.roll(corner, -1, axis=1).reshape(-1)
    # consistently wound: one face begins where the other ends
    fan = connected(
        corner.size, np.concatenate([begin[first], end[first]]), np.concatenate([end[second], begin[second]])
    )
    fans = int(fan.max()) + 1
    if fans > len(vertices) and notes is not None:
        notes.append(f"{_counted(fans - len(vertices), 'vertex', 'vertices')} split where bodies touch at a point")
    placed = np.empty((fans, 3))
    placed[fan] = vertices[faces.reshape(-1)]
    return placed, fan.reshape(-1, 3).astype(np.int64)
