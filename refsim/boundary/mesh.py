"""Triangle meshes as boundaries: read by trimesh, repaired where that is safe, otherwise refused with an InputError.

Vertices are relative to the mesh's own origin, the centre of its bounding box, so that float32 resolves them at any
distance from the scene's origin.
"""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from refsim.core.errors import InputError
from refsim.scene.meshes import check_triangles, read_mesh

ZERO_AREA = 1e-12  # height of a triangle over its longest side, below which it is a line
SAME_PLACE = 1e-12  # fraction of the mesh's size below which vertices are merged


@dataclass(frozen=True)
class SurfaceMesh:
    """A closed, manifold, outward oriented triangle mesh.

    vertices  (v, 3) float64 [m] relative to `origin`
    faces     (t, 3) int64, counterclockwise as seen from outside
    origin    (3,) float64 [m]
    source    its name in messages
    notes     one sentence for each repair
    """

    vertices: np.ndarray
    faces: np.ndarray
    origin: np.ndarray
    source: str = "mesh"
    notes: tuple[str, ...] = ()

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


def load_mesh(path: str | os.PathLike[str]) -> SurfaceMesh:
    """The mesh in a file that trimesh reads (.obj, .stl, .ply, .off, .glb, ...), repaired as by `surface_mesh`.

    Raises InputError for a file that cannot be read, has no triangles or cannot be repaired.
    """
    read = read_mesh(path)
    return surface_mesh(read.vertices, read.faces, str(path))


def surface_mesh(vertices: np.ndarray, faces: np.ndarray, source: str = "mesh") -> SurfaceMesh:
    """A mesh from vertices (v, 3) [m] and faces (t, 3), repaired where that is safe.

    Repaired, with a note each: duplicated faces, triangles without area, holes of one triangle or one quadrilateral,
    faces wound against their neighbours, bodies wound inside out. Raises InputError for a mesh that is empty, not
    finite, open or non-manifold, or has a body inside another that is not wound as a cavity. Triangles that cross are
    found by `refsim.boundary.signed_distance.signed_distance`, which has lists of the triangles near each other.
    """
    vertices, faces = np.array(vertices, dtype=float), np.array(faces, dtype=np.int64)
    check_triangles(vertices, faces, source)
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    origin = 0.5 * (vertices.min(0) + vertices.max(0))
    vertices -= origin
    size = float(np.ptp(vertices, axis=0).max())
    if not size > 0:
        raise InputError(f"mesh: {source!r} has no extent; give a closed triangle mesh.")
    notes: list[str] = []
    vertices, faces = _merged(vertices, faces, size)
    faces = _without_duplicates(faces, notes)
    faces = _without_slivers(vertices, faces, notes)
    if not len(faces):
        raise InputError(f"mesh: {source!r} has no triangle with an area; give a closed triangle mesh.")
    faces = _closed(vertices, faces, source, notes)
    faces = _oriented(vertices, faces, source, notes)
    vertices, faces = _split_touching_vertices(vertices, faces, notes)
    return SurfaceMesh(vertices, faces, origin, source, tuple(notes))


def areas(corners: np.ndarray) -> np.ndarray:
    """(t,) areas [m^2] of triangles (t, 3, 3)."""
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)


def signed_volume(corners: np.ndarray) -> float:
    """Volume [m^3] enclosed by triangles (t, 3, 3), negative if they are wound inside out."""
    return float(np.einsum("tc,tc->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


def _counted(number: int, one: str, many: str = "") -> str:
    return f"{number} {one if number == 1 else many or one + 's'}"


def _merged(vertices: np.ndarray, faces: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Merge coincident vertices: files such as STL repeat them for each triangle."""
    cell = np.round(vertices / (SAME_PLACE * size))
    _, first, place = np.unique(cell, axis=0, return_index=True, return_inverse=True)
    return vertices[first], place.reshape(-1)[faces]


def _without_duplicates(faces: np.ndarray, notes: list[str]) -> np.ndarray:
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]  # a face with a vertex twice has no area
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    if len(first) < len(faces):
        notes.append(f"{_counted(len(faces) - len(first), 'duplicated face')} left out")
    return faces[np.sort(first)]


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


def _edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """((e, 2) edges, (e,) number of faces of each)."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)


def _closed(vertices: np.ndarray, faces: np.ndarray, source: str, notes: list[str]) -> np.ndarray:
    import trimesh

    _, uses = _edges(faces)
    if (uses > 2).any():
        raise InputError(
            f"mesh: {source!r} is not manifold ({_counted(int((uses > 2).sum()), 'edge')} with more than two"
            " triangles), so inside and outside are not defined there; separate the parts that share them."
        )
    if (uses == 1).any():
        mended = trimesh.Trimesh(vertices, faces, process=False)
        mended.fix_normals(multibody=False)
        trimesh.repair.fill_holes(mended)
        new = np.array(mended.faces, dtype=np.int64)
        _, after = _edges(new)
        if len(mended.vertices) != len(vertices) or (after != 2).any():
            raise InputError(
                f"mesh: {source!r} is open ({_counted(int((uses == 1).sum()), 'edge')} with one triangle only), and a"
                " boundary needs a closed interior; fill its holes."
            )
        notes.append(f"holes filled with {_counted(len(new) - len(faces), 'triangle')}")
        faces = new
    return faces


def _components(faces: np.ndarray) -> np.ndarray:
    """(t,) number of the body of each face; faces that share an edge belong to one body."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 0], edges[:, 1]))
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(1)
    pairs = owner[:-1][same], owner[1:][same]
    graph = coo_matrix((np.ones(len(pairs[0])), pairs), shape=(len(faces), len(faces)))
    return connected_components(graph, directed=False)[1]


def _oriented(vertices: np.ndarray, faces: np.ndarray, source: str, notes: list[str]) -> np.ndarray:
    import trimesh

    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    if len(np.unique(directed, axis=0)) < len(directed):
        mended = trimesh.Trimesh(vertices, faces, process=False)
        trimesh.repair.fix_winding(mended)
        new = np.array(mended.faces, dtype=np.int64)
        directed = new[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        if len(np.unique(directed, axis=0)) < len(directed):
            raise InputError(
                f"mesh: {source!r} has one side only, like a Moebius strip, so it has no interior; give a closed mesh."
            )
        turned = int(np.count_nonzero((new != faces).any(1)))
        turned = min(turned, len(faces) - turned)
        notes.append(f"{_counted(turned, 'face')} wound as the neighbours are")
        faces = new
    body = _components(faces)
    count = int(body.max()) + 1
    corners = vertices[faces]
    inverted = [b for b in range(count) if signed_volume(corners[body == b]) < 0]
    if count > 1:
        hosts = _hosts(corners, body, count)
        for b in range(count):
            if hosts[b] % 2 and b not in inverted:
                raise InputError(
                    f"mesh: {source!r} has a body inside another body, and neither is wound as a cavity; remove the"
                    " inner one, or turn its faces round to make it a cavity."
                )
        inverted = [b for b in inverted if hosts[b] % 2 == 0]  # the others are cavities
    if inverted:
        wrong = np.isin(body, inverted)
        faces = faces.copy()
        faces[wrong] = faces[wrong][:, ::-1]
        notes.append(f"{_counted(len(inverted), 'body', 'bodies')} turned inside out")
    return faces


def _hosts(corners: np.ndarray, body: np.ndarray, count: int) -> np.ndarray:
    """(bodies,) number of other bodies that contain each one, by solid angles at one of its corners."""
    first = np.array([np.flatnonzero(body == b)[0] for b in range(count)])
    point = corners[first, 0]
    low = np.array([corners[body == b].min((0, 1)) for b in range(count)])
    high = np.array([corners[body == b].max((0, 1)) for b in range(count)])
    hosts = np.zeros(count, int)
    for b in range(count):
        inside = np.flatnonzero(((point > low[b]) & (point < high[b])).all(1))
        for other in inside[inside != b]:
            hosts[other] += abs(round(winding(point[other], corners[body == b]))) % 2
    return hosts


def winding(point: np.ndarray, corners: np.ndarray) -> float:
    """Winding number of triangles (t, 3, 3) about a point (3,): the sum of solid angles over 4 pi."""
    a, b, c = (corners[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    above = np.einsum("tc,tc->t", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("tc,tc->t", a, b) * lc
        + np.einsum("tc,tc->t", b, c) * la
        + np.einsum("tc,tc->t", c, a) * lb
    )
    return float(np.arctan2(above, below).sum() / (2 * np.pi))


def _split_touching_vertices(
    vertices: np.ndarray, faces: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Give each fan of faces its own vertex, so that bodies which touch at a point keep separate normals."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    corner = np.arange(3 * len(faces)).reshape(-1, 3)  # corners that share an edge at their vertex belong to one fan
    begin, end = corner.reshape(-1), np.roll(corner, -1, axis=1).reshape(-1)
    a, b = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key = np.stack([np.minimum(a, b), np.maximum(a, b)], axis=1)
    order = np.lexsort((key[:, 0], key[:, 1]))
    first, second = order[0::2], order[1::2]  # the two faces of each edge of a closed manifold mesh
    pairs = np.concatenate(
        [np.stack([begin[first], end[second]], 1), np.stack([end[first], begin[second]], 1)]
    )  # consistently wound: one face begins where the other ends
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(corner.size, corner.size))
    fans, fan = connected_components(graph, directed=False)
    if fans > len(vertices):
        notes.append(f"{_counted(fans - len(vertices), 'vertex', 'vertices')} split where bodies touch at a point")
    placed = np.empty((fans, 3))
    placed[fan] = vertices[faces.reshape(-1)]
    return placed, fan.reshape(-1, 3).astype(np.int64)
