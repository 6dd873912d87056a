"""Triangle meshes as boundaries: read by trimesh, repaired where that is safe, otherwise refused with an InputError.

Vertices are relative to the mesh's own origin, the centre of its bounding box, so that float32 resolves them at any
distance from the scene's origin.
"""

import dataclasses
import itertools
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim.core.checked import plainly
from refsim.core.errors import InputError
from refsim.core.tables import vector
from refsim.scene.meshes import check_triangles, read_mesh, while_unchanged
from refsim.scene.overlaps import (
    BESIDE,
    across_edges,
    areas,
    boundary,
    connected,
    edge_numbers,
    joined,
    meetings,
    unit_normals,
    winding,
)

ZERO_AREA = 1e-12  # height of a triangle over its longest side, below which it is a line
SAME_PLACE = 1e-12  # fraction of the mesh's size below which vertices are merged
WIDEST_GAP = 1e-4  # fraction of the mesh's size up to which corners of open edges are joined
ROUNDINGS = 4.0  # of float32 coordinates between a corner and the plane of another triangle
WITHIN = 0.1  # of a usual edge: farther apart, triangles that lie beside each other would count as meeting
COPLANAR = 1e-7  # fraction of the mesh's size; no grid has more than 2^21 = 1/4.8e-7 spacings across a mesh
LIKE_TODAY = 4  # edges of a hole that is filled whatever its size
SHEET = 0.25  # share of a patch, fills included, above which it counts as a sheet and is left out
LARGEST_FILL = 0.05  # share of the surface by which larger holes may be filled
LARGEST_GAP = 1e-2  # share of the surface by which what bounds a body may fail to close
GENERIC = np.array([0.2679, 0.3178, 0.4143])  # a place in a triangle that few other planes go through
TIE = 1e-9  # share of a volume or a surface


@dataclass(frozen=True)
class SurfaceMesh:
    """The surface of a solid: outward oriented triangles, with a solid on one side of each."""

    vertices: np.ndarray  # (v, 3) float64 [m] relative to `origin`
    faces: np.ndarray  # (t, 3) int64, counterclockwise as seen from outside
    origin: np.ndarray  # (3,) float64 [m]
    source: str = "mesh"  # its name in messages
    notes: tuple[str, ...] = ()  # one sentence that says what was assumed of a damaged mesh, or none
    # (t,) whether a face comes of a triangle that met others: beside its edges the winding number gives the sign
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


@plainly
def load_mesh(path: str | os.PathLike[str], what: str = "mesh") -> SurfaceMesh:
    """The mesh in a file (.obj, .off, .ply, .stl), repaired as by `surface_mesh`.

    what  first words of the messages

    Raises InputError for a file that cannot be read, has no triangles or has no inside.
    """
    read = read_mesh(path, what)
    return surface_mesh(read.vertices, read.faces, str(path), what)


@while_unchanged
def placed_mesh(
    file: str, center: tuple[float, float, float] | None, size: float, rotation: tuple[float, float, float],
    what: str = "mesh",
) -> SurfaceMesh:  # fmt: skip
    """The mesh of a file, turned by `rotation` [degrees] about x, then y, then z, scaled to `size` [m] unless that is
    0, and moved to `center` [m] unless None; cached while the file is unchanged."""
    from scipy.spatial.transform import Rotation

    mesh = load_mesh(file, what)
    turn = Rotation.from_euler("xyz", rotation, degrees=True)
    vertices = turn.apply(mesh.vertices) if any(rotation) else mesh.vertices
    middle = 0.5 * (vertices.min(0) + vertices.max(0))
    vertices = vertices - middle
    origin = mesh.origin + middle
    if size > 0:
        vertices = vertices * (size / float(np.ptp(vertices, axis=0).max()))
    if center is not None:
        origin = np.array(center, dtype=float)
    return dataclasses.replace(mesh, vertices=vertices, origin=origin)


def surface_mesh(vertices: np.ndarray, faces: np.ndarray, source: str = "mesh", what: str = "mesh") -> SurfaceMesh:
    """A mesh from vertices (v, 3) [m] and faces (t, 3), repaired where that is safe.

    Faces that stand twice and triangles without area are left out, corners of open edges less than 1e-4 of the size
    apart are joined, faces are wound as their neighbours, holes are filled, bodies are wound outwards. Where triangles
    meet, cross or lie in one plane, inside is where the winding number exceeds 1/2, and what does not bound it is left
    out. A note says what was assumed.

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
    if not size > 0:
        raise InputError(f"{name} has no extent; give a closed triangle mesh.")
    side = float(np.median(np.linalg.norm(np.diff(vertices[faces[:, :2]], axis=1), axis=2)))
    near = COPLANAR * size + min(ROUNDINGS * float(np.finfo(np.float32).eps) * rounded, WITHIN * side)
    said: list[str] = []
    cell = np.round(vertices / (SAME_PLACE * size))  # files such as STL repeat vertices for each triangle
    _, once, place = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    vertices, faces, apart = _welded(vertices[once], place.reshape(-1)[faces], size, said)
    lines = _lines(vertices[faces])
    if lines.any():
        said.append(f"{_counted(int(lines.sum()), 'triangle')} without area left out")
    faces, patch = _wound_alike(faces[~lines], name, said)
    vertices, faces, patch, hole, open_edges = _closed(vertices, faces, patch, said)
    meet = meetings(vertices, faces, near, max(near, BESIDE * apart))
    if len(meet.pairs):  # then nearly parallel triangles lie in one plane at once
        meet = meetings(vertices, faces, near, WIDEST_GAP * size)
    faces = _turned_outwards(vertices, faces, patch, meet.pairs, near, name, said)
    kept, meeting = np.arange(len(faces)), np.zeros(0, bool)
    if len(meet.pairs) or (np.bincount(edge_numbers(faces)[0].ravel()) != 2).any():
        said.append("inside is where the winding number exceeds 1/2")
        if len(meet.pairs):
            first = _at(vertices[faces[meet.pairs[0, 0]]].mean(0) + origin)
            many = _counted(len(np.unique(meet.pairs)), "triangle meets", "triangles meet")
            said[-1] += f" ({many} others, the first near {first} of the file)"
        vertices, faces, kept, meeting = boundary(vertices, faces, meet, near, name)
        lost = np.setdiff1d(np.flatnonzero(hole == 0), kept).size
        if lost:
            said.append(f"{_counted(lost, 'triangle')} with the solid on both sides or on neither left out")
    corners, hole = vertices[faces], hole[kept]
    area, across = areas(corners), np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(0)
    closed = signed_volume(corners) > 0 and np.linalg.norm(across) < 2 * LARGEST_GAP * area.sum()
    share = float(area[hole > LIKE_TODAY].sum() / area.sum()) if closed else 1.0
    if share > LARGEST_FILL:
        why = f"{100 * share:.0f} % of its surface would be filled holes, more than {100 * LARGEST_FILL:.0f} %"
        why = why if closed else "its triangles enclose nothing"
        raise InputError(
            f"{name} is open ({_counted(open_edges, 'edge')} where it ends), and a boundary needs a closed"
            f" interior, but {why}; fill its holes, or give its walls a thickness."
        )
    if (hole > 0).any():
        fills, part = _counted(int((hole > 0).sum()), "triangle"), 100 * area[hole > 0].sum() / area.sum()
        largest = _at(vertices[faces[hole.argmax()]].mean(0) + origin)
        said.append(f"holes filled with {fills}, {part:.2g} % of the surface, the largest near {largest} of the file")
    notes = (f"assumed of the mesh: {', '.join(said)}",) if said else ()
    return SurfaceMesh(*_fans_apart(vertices, faces), origin, source, notes, meeting)


def signed_volume(corners: np.ndarray) -> float:
    """Volume [m^3] enclosed by triangles (t, 3, 3), negative if they are wound inside out."""
    return float(_volumes(corners).sum())


def _volumes(corners: np.ndarray) -> np.ndarray:
    """(t,) volumes [m^3] between triangles (t, 3, 3) and the origin."""
    return np.einsum("tc,tc->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6


def _counted(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _at(point: np.ndarray) -> str:
    return vector(np.round(point, 12) + 0.0, ".4")


def _once(faces: np.ndarray, said: list[str]) -> np.ndarray:
    """Each face once; one that stands with both windings cancels if its edges are closed without it.

    If most faces stand with both windings, as in models drawn from two sides, one of each is kept.
    """
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]  # a face with a vertex twice has no area
    triple, first, place, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    even = (np.roll(faces, 1, axis=1) > faces).sum(1) == 1  # wound as the sorted numbers
    both = np.abs(np.bincount(place.reshape(-1), np.where(even, 1, -1), len(first))) < count
    cancels = np.zeros(len(first), bool)
    if both.any() and 2 * both.sum() <= len(first):
        edge, _, _ = edge_numbers(triple)
        cancels = both & (np.bincount(edge[~both].ravel(), minlength=int(edge.max()) + 1)[edge] % 2 == 0).all(1)
    kept = np.sort(first[~cancels])
    if len(kept) < len(faces):
        said.append(f"{_counted(len(faces) - len(kept), 'face')} that stand twice left out")
    return faces[kept]


def _lines(corners: np.ndarray) -> np.ndarray:
    """(t,) whether triangles (t, 3, 3) are lines."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1, initial=0.0)
    return 2 * areas(corners) <= ZERO_AREA * longest**2


def _welded(
    vertices: np.ndarray, faces: np.ndarray, size: float, said: list[str]
) -> tuple[np.ndarray, np.ndarray, float]:
    """(vertices, faces, greatest distance between joined corners [m]): corners of open edges are joined at the least
    distance (a power of ten) that leaves the fewest edges open.

    A distance is too large if a triangle would lose a corner.
    """

    def ends_alone(faces: np.ndarray) -> np.ndarray:
        edge, _, ends = edge_numbers(faces)
        return ends[np.bincount(edge.ravel(), minlength=len(ends)) == 1]

    faces = _once(faces, said)
    alone = ends_alone(faces)
    at, least, best = np.unique(alone), len(alone), np.arange(len(vertices))
    for power in range(-11, -3) if least else ():
        group = np.arange(len(vertices))
        _, first, place = np.unique(joined(vertices[at], 10.0**power * size), return_index=True, return_inverse=True)
        group[at] = at[first[place]]
        new = group[faces]
        if (new == np.roll(new, 1, axis=1)).any():
            break
        if len(ends_alone(_once(new, []))) < least:
            least, best = len(ends_alone(_once(new, []))), group
    if least == len(alone):
        return vertices, faces, 0.0
    number = np.bincount(best, minlength=len(vertices))
    sums = [np.bincount(best, vertices[:, c], len(vertices)) for c in range(3)]
    middle = np.stack(sums, axis=1) / np.maximum(number, 1)[:, None]
    apart = 2 * float(np.linalg.norm(vertices - middle[best], axis=1).max())
    many = _counted(int((number[best] > 1).sum()), "corner")
    said.append(f"{many} of open edges joined, which lay up to {apart / size:.2g} of the mesh's size apart")
    return middle, _once(best[faces], said), apart


def _wound_alike(faces: np.ndarray, name: str, said: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """(faces wound as their neighbours across edges of two triangles, (t,) number of the patch that these make)."""
    if not len(faces):
        raise InputError(f"{name} has no triangle with an area; give a closed triangle mesh.")
    edge, direction, _ = edge_numbers(faces)
    one, other = across_edges(edge, np.bincount(edge.ravel()) == 2)
    count = len(faces)
    apart = count * (direction.ravel()[one] == direction.ravel()[other])  # one of both has to be turned
    one, other = one // 3, other // 3
    # Face f stands as f and, turned, as f + count: what is linked is wound alike.
    linked = np.concatenate([other + apart, (other + count + apart) % (2 * count)])
    way = connected(2 * count, np.concatenate([one, one + count]), linked).reshape(2, count)
    if (way[0] == way[1]).any():
        raise InputError(f"{name} has one side only, like a Moebius strip, and so no interior; give a closed mesh.")
    number = np.bincount(way[0], minlength=int(way.max()) + 1)
    fewer = (number[way[0]] < number[way[1]]) | ((number[way[0]] == number[way[1]]) & (way[0] > way[1]))
    if fewer.any():
        said.append(f"{_counted(int(fewer.sum()), 'face')} wound as the neighbours are")
    return np.where(fewer[:, None], faces[:, ::-1], faces), np.unique(way.min(0), return_inverse=True)[1]


def _loops(following: dict[Any, list[Any]]) -> Iterator[list[Any]]:
    """Closed walks that meet no corner twice, which use each step from a corner to one that follows it once."""
    for start in sorted(following):
        while following[start]:
            path, place = [start], {start: 0}
            while len(path) > 1 or following[start]:
                corner = following[path[-1]].pop()
                if corner not in place:
                    place[corner] = len(path)
                    path.append(corner)
                    continue
                loop = path[place[corner] :]
                for passed in loop[1:]:
                    del place[passed]
                path = path[: place[corner] + 1]
                yield loop


def _closed(
    vertices: np.ndarray, faces: np.ndarray, patch: np.ndarray, said: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
    """Each patch with its holes filled, by one or two triangles or by a fan around the middle.

    Open sheets, such as fins on an edge, are left out unless there is nothing else.

    Returns (vertices, faces, patch (t,), edges of the hole that each face fills or 0 (t,), edges of one triangle).
    """
    edge, direction, ends = edge_numbers(faces)
    uses = np.bincount(edge.ravel())
    hole, alone = np.zeros(len(faces), np.int64), set(map(tuple, ends[uses == 1].tolist()))
    if (uses == 2).all():
        return vertices, faces, patch, hole, 0
    owner, side = np.nonzero(uses[edge] == 1)  # patches that end at one corner have a hole in common
    at, owner = ends[edge[owner, side]].ravel(), np.repeat(patch[owner], 2)
    order = np.argsort(at, kind="stable")
    same = np.flatnonzero(at[order[1:]] == at[order[:-1]])
    patch = connected(int(patch.max()) + 1, owner[order[same]], owner[order[same + 1]])[patch]
    key, place = np.unique(np.repeat(patch, 3) * len(ends) + edge.ravel(), return_inverse=True)
    net = np.bincount(place.reshape(-1), direction.ravel()).astype(int)
    following: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for k in np.flatnonzero(net).tolist():
        p, e = divmod(int(key[k]), len(ends))
        start, end = ends[e].tolist()[:: -1 if net[k] > 0 else 1]  # against the triangle, as the fill runs
        following.setdefault((p, start), []).extend([(p, end)] * abs(int(net[k])))
    new, added = [], []  # (three corners, patch, edges of the hole, whether the patch ends there)
    for edges in _loops(following):
        p, loop = edges[0][0], [v for _, v in edges]
        ends_here = any((min(u, v), max(u, v)) in alone for u, v in zip(loop, [*loop[1:], loop[0]]))
        around = vertices[loop]
        if len(loop) == LIKE_TODAY and np.diff(np.linalg.norm(around[:2] - around[2:], axis=1)) < 0:
            loop = [*loop[1:], loop[0]]  # along the shorter diagonal
        if len(loop) > LIKE_TODAY:
            added.append(around.mean(0))
            fan = [(len(vertices) + len(added) - 1, u, v) for u, v in zip(loop, [*loop[1:], loop[0]])]
        else:
            fan = [(loop[0], u, v) for u, v in itertools.pairwise(loop[1:])]
        new += [(*face, p, len(loop), ends_here) for face in fan]
    vertices = np.concatenate([vertices, np.reshape(added, (-1, 3))])
    fill = np.array(new, np.int64).reshape(-1, 6)
    fill = fill[~_lines(vertices[fill[:, :3]])]
    faces, patch = np.concatenate([faces, fill[:, :3]]), np.concatenate([patch, fill[:, 3]])
    hole, beyond = np.concatenate([hole, fill[:, 4]]), np.concatenate([hole, fill[:, 5]])
    area = areas(vertices[faces])
    sheet = (np.bincount(patch, area * beyond) > SHEET * np.bincount(patch, area))[patch]
    if sheet.any() and not sheet.all():
        lost = _counted(int((sheet & (hole == 0)).sum()), "triangle")
        said.append(f"{lost} of open sheets, which enclose nothing, left out")
        faces, hole, patch = faces[~sheet], hole[~sheet], np.unique(patch[~sheet], return_inverse=True)[1]
    return vertices, faces, patch, hole, len(alone)


def _turned_outwards(
    vertices: np.ndarray, faces: np.ndarray, patch: np.ndarray, pairs: np.ndarray, near: float, name: str,
    said: list[str],
) -> np.ndarray:  # fmt: skip
    """Patches with a negative volume are turned, unless they are cavities of others, or pockets: what such a one bounds
    lies in others."""
    volumes = _volumes(vertices[faces])
    inverted = np.bincount(patch, volumes) < -TIE * np.bincount(patch, np.abs(volumes))
    outwards = np.where(inverted[patch, None], faces[:, ::-1], faces)
    _, first = np.unique(patch, return_index=True)
    meets = np.zeros(len(first), bool)
    meets[patch[pairs][patch[pairs[:, 0]] != patch[pairs[:, 1]]]] = True
    corners, deep = vertices[outwards], np.zeros(len(first), bool)
    middle, step = np.tensordot(corners, GENERIC, (1, 0)), BESIDE * near * unit_normals(corners)
    if len(first) > 1:  # just outside of a patch the others count alone
        deep = np.round(winding((middle + step)[first], corners)) % 2 == 1
    for k in np.flatnonzero(inverted & meets).tolist():
        facets = patch == k
        about = winding((middle - step)[facets], vertices[faces[~facets]])
        deep[k] = np.average(about > 0.5, weights=areas(corners[facets])) > 0.5 + TIE
    if (deep & ~inverted & ~meets).any():
        both = "has a body inside another body, and neither is wound as a cavity"
        raise InputError(f"{name} {both}; remove the inner one, or turn its faces round to make it a cavity.")
    wrong = int((inverted & ~deep).sum())
    if wrong:
        said.append(f"{_counted(wrong, 'body', 'bodies')} turned inside out")
    return np.where((inverted & ~deep)[patch, None], outwards, faces)


def _fans_apart(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each fan of faces with its own vertex, so that bodies which touch at a point keep separate normals."""
    edge, direction, _ = edge_numbers(faces)
    closed = (np.bincount(edge.ravel()) == 2) & (np.bincount(edge.ravel(), direction.ravel()) == 0)
    one, other = across_edges(edge, closed)  # corners 3 t + k at which edges begin
    after = np.roll(np.arange(3 * len(faces)).reshape(-1, 3), -1, axis=1).reshape(-1)  # at which they end
    fan = connected(len(after), np.concatenate([one, after[one]]), np.concatenate([after[other], other]))
    _, first = np.unique(fan, return_index=True)
    return vertices[faces.reshape(-1)[first]], fan.reshape(-1, 3).astype(np.int64)
