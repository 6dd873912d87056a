"""Signed distance from a triangle mesh in a narrow band (patent CN104318598A, claim 2: patent P1 with E26).

Nodes lie at h j relative to the mesh's origin. They are stored in blocks of 64, only near the surface, in a table of
sorted keys. The distance is negative inside.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from refsim.backends.arrays import Backend, choose
from refsim.core.checked import plainly
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY
from refsim.scene.overlaps import across_edges, edge_numbers
from refsim.scene.solids import countable
from refsim.scene.surface_mesh import SurfaceMesh, areas
from refsim.sparse_grid import Blocks, inverse_cell, nodes
from refsim.sparse_grid.tables import blocks_of
from refsim.winding_number import Clusters, clusters

LEAST_BAND = 2.0  # band over spacing: a cell that the surface meets has all its corners nearer than sqrt(3) spacings
NODE_BYTES = 40  # memory for a node while the band is built
FARTHEST = 1 << 20  # spacings that fit on either side of the origin
SLENDER = 1e-6  # height of a face over the mesh's size, below which its normal gives no sign where triangles meet


class Triangles(NamedTuple):
    """The triangles as the kernels take them, relative to the mesh's origin."""

    corner: Any  # (t, 9) [m], corners a, b, c
    normal: Any  # (t, 21) unit pseudonormals: of the face, of the edges ab, bc, ca, of the corners a, b, c
    owner: Any  # (t, 7) int32, the lowest triangle that shares the face, the edge or the corner
    across: Any  # (t, 3) int32, the triangle across each edge
    around: Any  # (t, 3) int32, 3 t + k of another triangle's corner at the same vertex, one after another in a circle


class BandGrid(NamedTuple):
    """The grid of the band as the kernels take it."""

    spacing: float  # h [m]
    inverse_spacing: Any  # 1/h [1/m], float64
    band: float  # [m]
    half_diagonal: float  # from a block's middle to its corner nodes [m]


class TriangleLists(NamedTuple):
    """Triangles by block: those of block b are triangle[first[b] : first[b + 1]], ascending."""

    first: Any  # (blocks + 1,) int32
    triangle: Any  # (pairs,) int32


class DistanceField(NamedTuple):
    """A narrow band as the kernels take it; `trilinear` in `formulas` gives value and slope at a point."""

    keys: Any  # (b,) int64, ascending: blocks of 64 nodes
    neighbour: Any  # (b, 27) int32, number of the adjacent block, -1 for none
    distance: Any  # (64 b,) phi [m], negative inside, clamped to the band
    closest: Any  # (64 b,) int32 closest triangle, -1 beyond the band
    inside_after: Any  # (b,) uint8, 1 if nodes that follow the block along x are inside
    spacing: float  # h [m]
    inverse_spacing: Any  # 1/h [1/m], float64
    band: float  # [m]
    origin_x: Any  # of the mesh in the scene [m], float64
    origin_y: Any  # of the mesh in the scene [m], float64
    origin_z: Any  # of the mesh in the scene [m], float64


@dataclass(frozen=True)
class NarrowBand:
    """The signed distance from a mesh near its surface, and the side of the mesh for all other points."""

    mesh: SurfaceMesh
    backend: Backend  # where the arrays are
    grid: BandGrid  # spacing and band
    triangles: Triangles  # the kernels' triangles
    field: DistanceField  # the kernels' field, in the scene's frame

    @property
    def spacing(self) -> float:
        """h [m]."""
        return float(self.grid.spacing)

    @property
    def band(self) -> float:
        """[m]."""
        return float(self.grid.band)

    @property
    def local(self) -> "NarrowBand":
        """The same in the mesh's own frame, whose origin is 0."""
        origin = dict.fromkeys(("origin_x", "origin_y", "origin_z"), np.float64(0))
        return replace(self, field=self.field._replace(**origin))

    def at(self, points: Any) -> tuple[Any, Any]:
        """(distance (n,) [m], slope (n, 3)) at points (n, 3) [m] of the scene, arrays of the backend.

        Beyond the band the distance is -band inside and +band outside, and the slope is 0.
        """
        dtype = self.field.distance.dtype
        value, slope = self.backend.empty(points.shape[0], dtype), self.backend.empty((points.shape[0], 3), dtype)
        _compute(
            self.backend, "interpolate",
            query=points, distance_field=self.field, query_distance=value, query_gradient=slope,
        )  # fmt: skip
        return value, slope

    def project(self, points: Any) -> tuple[Any, Any]:
        """(nearest points of the mesh (n, 3) [m], unit normals there (n, 3)) for points (n, 3) [m] near its surface.

        The search begins with the triangles that are closest to the corners of the point's cell, and goes across edges
        and corners to neighbours as long as these are nearer. A point whose cell has no triangle keeps its position,
        with normal 0.
        """
        dtype = self.field.distance.dtype
        place, normal = (self.backend.empty((points.shape[0], 3), dtype) for _ in range(2))
        _compute(
            self.backend, "project",
            query=points, triangles=self.triangles, distance_field=self.field, projected=place, projected_normal=normal,
        )  # fmt: skip
        return place, normal


def _compute(backend: Backend, name: str, **given: Any) -> None:
    """Run operation signed_distance.`name` on values by the names of its arguments and outputs."""
    REGISTRY[f"signed_distance.{name}"].bind(backend.name, given.__getitem__)()


def triangle_table(mesh: SurfaceMesh, dtype: str) -> Triangles:
    """The kernels' triangles on the host, with angle-weighted pseudonormals (patent E26) computed in float64."""
    corners = mesh.corners.astype(dtype).astype(float)  # rounded as the kernels see them
    sides = np.roll(corners, -1, axis=1) - corners
    face = _units(np.cross(sides[:, 0], sides[:, 1]))
    directions = _units(sides)
    angle = np.arccos(np.clip(-(directions * np.roll(directions, 1, axis=1)).sum(2), -1.0, 1.0))
    vertex = np.zeros((len(mesh.vertices), 3))
    for k in range(3):
        for c in range(3):
            vertex[:, c] += np.bincount(mesh.faces[:, k], angle[:, k] * face[:, c], len(vertex))
    place = edge_numbers(mesh.faces)[0]
    lowest = np.unique(place, return_index=True)[1] // 3
    one, other = across_edges(place, np.ones(len(lowest), bool))
    itself = np.repeat(np.arange(len(face)), 3)
    across = itself.copy()
    across[one], across[other] = itself[other], itself[one]
    edge = np.stack([np.bincount(place.ravel(), np.repeat(face[:, c], 3)) for c in range(3)], axis=1)
    normal = np.concatenate([face[:, None], _units(edge)[place], _units(vertex)[mesh.faces]], axis=1)
    _, lowest_corner, corner_place = np.unique(mesh.faces, return_index=True, return_inverse=True)
    owners = itself[::3, None], lowest[place], (lowest_corner // 3)[corner_place.reshape(-1, 3)]
    tables = np.concatenate(owners, axis=1), across.reshape(-1, 3), around_vertices(mesh.faces)
    numbers = (each.astype(np.int32) for each in tables)
    return Triangles(corners.reshape(-1, 9).astype(dtype), normal.reshape(-1, 21).astype(dtype), *numbers)


def around_vertices(faces: np.ndarray) -> np.ndarray:
    """(t, 3): after corner k of triangle t comes corner 3 t' + k' at the same vertex, after the last one the first."""
    order = np.argsort(faces, axis=None, kind="stable")
    first = np.flatnonzero(np.diff(faces.ravel()[order], prepend=-1))
    after = np.roll(order, -1)
    after[np.roll(first, -1) - 1] = order[first]
    around = np.empty_like(order)
    around[order] = after
    return around.reshape(-1, 3)


def unclear_features(mesh: SurfaceMesh) -> np.ndarray | None:
    """(t, 7) uint8: 1 for a face, edge or corner beside which the winding number gives the sign; None if none is.

    These are edges that not exactly two faces share, edges of faces whose triangles met others, corners of both, and
    faces too slender for a normal.
    """
    edge, direction, ends = edge_numbers(mesh.faces)
    doubtful = (np.bincount(edge.ravel()) != 2) | (np.bincount(edge.ravel(), direction.ravel()) != 0)
    if len(mesh.meeting):
        doubtful[edge[mesh.meeting]] = True
    if not doubtful.any():
        return None
    corner = np.zeros(len(mesh.vertices), bool)
    corner[ends[doubtful]] = True
    sides = mesh.corners - np.roll(mesh.corners, 1, axis=1)
    height = 2 * areas(mesh.corners) / np.linalg.norm(sides, axis=2).max(1)
    thin = height < SLENDER * float(mesh.extent.max())
    return np.concatenate([thin[:, None], doubtful[edge], corner[mesh.faces]], axis=1).astype(np.uint8)


def _units(vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) of length 1, or 0 where they are 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1)


def band_grid(spacing: float, band: float, dtype: str) -> BandGrid:
    """The kernels' grid: spacing and band [m] in the dtype."""
    real = np.dtype(dtype).type
    h = real(spacing)
    return BandGrid(h, inverse_cell(spacing, dtype), real(band), real(1.5 * 3**0.5 * float(h)))


@plainly
def signed_distance(
    mesh: SurfaceMesh, spacing: float, band: float | None = None, backend: str | Backend = "cpu",
    dtype: str = "float32",
) -> NarrowBand:  # fmt: skip
    """The signed distance from a mesh on nodes `spacing` [m] apart, up to `band` [m] (3 spacings by default).

    mesh  as `surface_mesh` makes it, which resolves triangles that cross

    Raises InputError if the spacing is not positive, larger than the mesh or too small for it, or if the band is
    narrower than 2 spacings.
    """
    backend = choose(backend) if isinstance(backend, str) else backend
    size = float(mesh.extent.max())
    if not (np.isfinite(spacing) and spacing > 0):
        raise InputError(f"signed distance: spacing = {spacing} m is not possible; give a positive number.")
    if spacing >= size:
        raise InputError(
            f"signed distance: {mesh.source!r} is {size:.4g} m across, no more than the grid's spacing of"
            f" {spacing:.4g} m; give a smaller spacing."
        )
    band = 3 * spacing if band is None else band
    if not (np.isfinite(band) and band >= LEAST_BAND * spacing):
        raise InputError(
            f"signed distance: band = {band} m is too narrow; give at least {LEAST_BAND:g} spacings,"
            f" {LEAST_BAND * spacing:.4g} m."
        )
    if 0.5 * size + band > (FARTHEST - 16) * spacing:
        raise InputError(
            f"signed distance: {mesh.source!r} is {size:.4g} m across, more than 2^21 spacings of {spacing:.4g} m;"
            " give a larger spacing."
        )
    count = mesh.area * 2 * band / spacing**3
    what = f"signed distance: {mesh.source!r} at a spacing of {spacing:.4g} m"
    countable(what, [count], NODE_BYTES, "nodes", "give a larger spacing")
    grid = band_grid(spacing, band, dtype)
    made = unfilled(backend, mesh, grid, unclear_features(mesh))
    made["inside_after"] = backend.zeros(made["band_blocks"].keys.shape[0], np.uint8)
    _compute(backend, "fill", **made)
    return NarrowBand(mesh, backend, grid, made["triangles"], field_of(made, mesh.origin))


def field_of(made: Mapping[str, Any], origin: np.ndarray) -> DistanceField:
    """The kernels' field of arrays that are `made`, about an origin (3,) [m]."""
    blocks, grid = made["band_blocks"], made["band_grid"]
    return DistanceField(
        blocks.keys, blocks.neighbour, made["distance"], made["closest"], made["inside_after"], grid.spacing,
        grid.inverse_spacing, grid.band, *map(np.float64, origin),
    )  # fmt: skip


def unfilled(
    backend: Backend, mesh: SurfaceMesh, grid: BandGrid, unclear: np.ndarray | None = None
) -> dict[str, Any]:  # fmt: skip
    """Arrays of a band by the names of the kernels' arguments; beyond the band `distance` has no sign yet."""
    dtype = np.dtype(type(grid.band)).name
    triangles = Triangles(*map(backend.asarray, triangle_table(mesh, dtype)))
    made: dict[str, Any] = {"triangles": triangles, "band_grid": grid, "unclear": None, "winding_clusters": None}
    if unclear is not None:
        made["unclear"] = backend.asarray(unclear)
        made["winding_clusters"] = Clusters(*map(backend.asarray, clusters(mesh.corners, dtype)))
    count = len(mesh.faces)
    made["block_count"] = backend.empty(count, np.int32)
    _compute(backend, "count_blocks", **made)
    made["block_first"] = backend.running_sum(made["block_count"])
    pairs = int(backend.host(made["block_first"][count:])[0])
    made |= {"pair_key": backend.empty(pairs, np.int64), "pair_triangle": backend.empty(pairs, np.int32)}
    _compute(backend, "list_blocks", **made)
    blocks, made["triangle_lists"] = by_block(backend, made["pair_key"], made["pair_triangle"])
    made["band_blocks"], count = blocks, nodes(blocks)
    made |= {"unsigned_distance": backend.empty(count, dtype), "closest": backend.empty(count, np.int32)}
    _compute(backend, "nearest", **made)
    made["distance"] = backend.empty(count, dtype)
    _compute(backend, "signs", **made)
    made["row_first"] = backend.asarray(block_rows(backend.host(blocks.keys)))
    return made


def by_block(backend: Backend, key: Any, triangle: Any) -> tuple[Blocks, TriangleLists]:
    """Blocks within the band of a triangle, and the triangles near each block, of pairs of both."""
    xp, to_xp, from_xp = backend.array_library()
    key, triangle = to_xp(key), to_xp(triangle)
    order = xp.argsort(key, kind="stable")
    key, triangle = key[order], triangle[order]
    begins = xp.ones(len(key), dtype=bool)
    begins[1:] = key[1:] != key[:-1]
    place = xp.flatnonzero(begins)
    keys = key[place]
    ends = xp.full(1, len(key), np.int32)
    lists = TriangleLists(from_xp(xp.concatenate([place.astype(np.int32), ends])), from_xp(triangle))
    return Blocks(*map(from_xp, blocks_of(keys, 3, xp))), lists


def block_rows(keys: np.ndarray) -> np.ndarray:
    """(rows + 1,) int32 first block of each row of blocks along x, and their number."""
    begins = np.flatnonzero(np.diff(keys >> 21)) + 1
    return np.concatenate([[0], begins, [len(keys)]] if len(keys) else [[0]]).astype(np.int32)
