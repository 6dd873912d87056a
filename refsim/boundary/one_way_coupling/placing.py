"""Placing of a solid, on the host: mesh read and moved, boundary particles on it, signed distances around it."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from refsim.boundary.adami_2012 import LEAST_SHARE
from refsim.boundary.sampling import sample, sample_beneath
from refsim.boundary.signed_distance import NarrowBand, signed_distance
from refsim.core.errors import InputError
from refsim.scene.meshes import while_unchanged
from refsim.scene.solids import countable
from refsim.scene.surface_mesh import SurfaceMesh, placed_mesh

HALF_DIAGONAL = 0.5 * 3**0.5  # of a cell, in its edges
PARTS = 4  # of a cell's edge, where the surface cuts the cell
BAND = 4.0  # width of the band in its spacings
TIED = 1e-6  # spacings, or share of the largest area, that decide nothing
AROUND, STRAIGHT = 125, 0.9  # cells beside one that tell an edge; cosine of the angle between normals that is none
PROBE = 0.5  # depth under a boundary particle, in spacings of the band, where the field must be negative


@dataclass(frozen=True)
class PlacedSolid:
    """A solid in a scene."""

    mesh: SurfaceMesh  # in its position
    position: np.ndarray  # boundary particles on the surface (m, 3) [m]
    normal: np.ndarray  # outward (m, 3)
    beneath: tuple[np.ndarray, ...]  # those of each further layer below it, (k, 3) [m]
    band: NarrowBand  # signed distances, float64
    notes: tuple[str, ...]  # warnings for the user, one sentence each

    def filled(self, points: np.ndarray, size: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Share (n,) that the solid fills of cells of edges `size` [m] about points (n, 3) [m]; its centre (n, 3).

        size  of all edges, or (n, 3)
        """
        distance, size = self.distance(points), np.broadcast_to(size, points.shape)
        share, centre = (distance < 0).astype(float), np.array(points, dtype=float)
        cut = np.flatnonzero(np.abs(distance) < HALF_DIAGONAL * size.max(1))
        steps = (np.indices((PARTS,) * 3).reshape(3, -1).T + 0.5) / PARTS - 0.5
        for few in np.array_split(cut, 1 + len(cut) // 4096):
            inner = points[few, None, :] + steps * size[few, None, :]
            depth = self._depth(inner.reshape(-1, 3)).reshape(inner.shape[:2])
            part = np.clip(0.5 + depth * PARTS / size[few].min(1)[:, None], 0, 1)
            share[few] = part.mean(1)
            centre[few] = (part[..., None] * inner).sum(1) / np.maximum(part.sum(1), 1e-300)[:, None]
        return share, centre

    def cells(self, spacing: float, layers: int) -> tuple[np.ndarray, np.ndarray]:
        """Volumes (m,) of the solid in cells `layers` deep, over spacing^3, and their centres (m, 3) [m].

        The cells begin at large flat faces or at the mesh's ends, wherever it stands.
        """
        from scipy.ndimage import distance_transform_edt

        corners = self.mesh.vertices
        middle = 0.5 * (corners.min(0) + corners.max(0))
        around = np.ceil(0.5 * np.ptp(corners, axis=0) / spacing) + 2
        countable(
            f"mesh_boundary: the cells of {self.mesh.source!r} at a spacing of {spacing} m",
            (2 * around).astype(int).tolist(), each=1,
        )  # fmt: skip
        edges = [
            cell_edges(planes, -around[k] * spacing, around[k] * spacing, spacing) + (self.mesh.origin + middle)[k]
            for k, planes in enumerate(flat_faces(corners[self.mesh.faces] - middle, spacing))
        ]
        points = np.stack(np.meshgrid(*(0.5 * (e[1:] + e[:-1]) for e in edges), indexing="ij"), -1)
        sizes = np.stack(np.meshgrid(*map(np.diff, edges), indexing="ij"), -1).reshape(-1, 3)
        shape, points = points.shape[:3], points.reshape(-1, 3)
        distance = self.distance(points)
        deep = distance_transform_edt((distance < 0).reshape(shape)).ravel()
        wanted = ((deep > 0) & (deep <= layers)) | (np.abs(distance) < HALF_DIAGONAL * sizes.max(1))
        share, centre = self.filled(points[wanted], sizes[wanted])
        kept = share > LEAST_SHARE
        return (share * (sizes[wanted] / spacing).prod(1))[kept], centre[kept]

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distances (n,) [m] of points (n, 3) [m], negative inside, clamped to the band."""
        return self.band.at(np.ascontiguousarray(points, dtype=float))[0]

    def normals(self, points: np.ndarray, reach: float) -> np.ndarray:
        """Unit normals (n, 3) of the surface near points (n, 3) [m], far from it those of the nearest that is near; 0
        at edges, where those of some of the nearest points, within `reach` [m], differ.
        """
        from scipy.spatial import cKDTree

        _, normal = self.band.project(np.ascontiguousarray(points, dtype=float))
        near = normal.any(1)
        normal = normal[near][cKDTree(points[near]).query(points)[1]]
        tree, found = cKDTree(points), normal.copy()
        for few in np.array_split(np.arange(len(points)), 1 + len(points) // 4096):
            apart, beside = tree.query(points[few], range(1, 1 + min(AROUND, len(points))))
            alike = np.abs(np.einsum("nc,nkc->nk", normal[few], normal[beside]))
            found[few[((alike < STRAIGHT) & (apart < reach)).any(1)]] = 0
        return found

    def _depth(self, points: np.ndarray) -> np.ndarray:
        """Depths (n,) [m] of points (n, 3) [m] below the surface, exact at edges, where the band's are rounded off."""
        nearest, normal = self.band.project(points)
        away, rough = points - nearest, -self.distance(points)
        side = np.where(np.abs(rough) < 0.5 * self.band.spacing, -(away * normal).sum(1), rough)
        return np.where(normal.any(1), np.copysign(np.linalg.norm(away, axis=1), side), rough)


def flat_faces(triangles: np.ndarray, spacing: float) -> list[np.ndarray]:
    """Coordinates [m] of the flat faces of triangles (f, 3, 3) [m] across each axis, at least half a spacing apart.

    An axis with less than half the area of the axis with the most has the mesh's ends instead. Of near faces the larger
    stays, of equal ones the one farther from 0; two as far from it are one at 0.
    """
    across = 0.5 * np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(across, axis=1)
    flat = np.abs(across) > (1 - 1e-6) * area[:, None]
    most = max(float(area[flat[:, axis]].sum()) for axis in range(3))
    faces = []
    for axis in range(3):
        facing = flat[:, axis]
        planes: list[float] = []
        if not 2 * area[facing].sum() >= (1 - TIED) * most > 0:
            planes = [triangles[..., axis].min() / spacing, triangles[..., axis].max() / spacing]
        else:
            place = triangles[facing, :, axis].mean(1) / spacing
            _, member = np.unique(np.round(place, 6), return_inverse=True)
            each = np.bincount(member, area[facing])
            key = np.bincount(member, area[facing] * place) / each
            sizes, away = -np.round(each / most, 6), -np.round(np.abs(key), 6)
            for k in np.lexsort(np.stack([away, sizes])):
                near = [j for j, other in enumerate(planes) if abs(key[k] - other) < 0.5 - TIED]
                if not near:
                    planes.append(float(key[k]))
                elif abs(planes[near[0]] + key[k]) < TIED:
                    planes[near[0]] = 0.0
        faces.append(spacing * np.sort(np.array(planes)))
    return faces


def cell_edges(planes: np.ndarray, low: float, high: float, spacing: float) -> np.ndarray:
    """Edges of cells [m] from `low` to `high` [m] or beyond, whole but for one or two in the middle between planes."""
    parts = [planes[0] - spacing * np.arange(math.ceil((planes[0] - low) / spacing), 0, -1), planes[:1]]
    for start, end in itertools.pairwise(planes):
        count = max(1, round((end - start) / spacing - TIED))
        whole = spacing * np.arange(1, (count - 1) // 2 + 1)
        parts += [start + whole, [] if count % 2 else [0.5 * (start + end)], end - whole[::-1], [end]]
    parts.append(planes[-1] + spacing * np.arange(1, math.ceil((high - planes[-1]) / spacing) + 1))
    return np.concatenate(parts)


@while_unchanged
@np.errstate(over="warn", divide="warn", invalid="warn")  # degenerate triangles are handled
def placed_solid(
    file: str, center: tuple[float, float, float] | None, size: float, rotation: tuple[float, float, float],
    radius: float, field_spacing: float, seed: int, layers: int, apart: float,
) -> PlacedSolid:  # fmt: skip
    """The solid of a mesh file; cached while the file is unchanged, so that a plan reads and samples it once.

    layers  of boundary particles, `apart` [m] apart; 0 for none

    Raises InputError for a mesh that cannot be read, has no interior, or is smaller than the given spacing.
    """
    mesh = placed_mesh(file, center, size, rotation)
    extent = float(mesh.extent.max())
    if 2 * radius > extent:
        raise InputError(
            f"mesh_boundary: the solid of {file!r} is {extent:.3g} m across, smaller than the boundary particles'"
            f" spacing of {2 * radius:.3g} m; enlarge it, or reduce radius."
        )
    wide = max(BAND * field_spacing, 0.0 if layers else apart)
    band = signed_distance(mesh, field_spacing, wide, dtype="float64")
    if layers == 0:
        return PlacedSolid(mesh, np.zeros((0, 3)), np.zeros((0, 3)), (), band, tuple(mesh.notes))
    sampled = sample(mesh, radius, seed=seed)
    position, normal = np.asarray(sampled.position, dtype=float), np.asarray(sampled.normal, dtype=float)
    below, _ = band.at(np.ascontiguousarray(position - PROBE * field_spacing * normal))
    unseen = int((below >= 0).sum())
    notes = list(mesh.notes)
    if unseen:
        notes.append(
            f"the signed distances do not resolve the solid under {unseen} of {len(position)} boundary particles, where"
            f" it is thinner or sharper than about {field_spacing:.3g} m: particles may slip through there; reduce"
            " field_spacing"
        )
    beneath = tuple(sample_beneath(mesh, radius, k * apart, field_spacing, seed + k) for k in range(1, layers))
    return PlacedSolid(mesh, position, normal, beneath, band, tuple(notes))
