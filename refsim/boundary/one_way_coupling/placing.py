"""Placing of a solid, on the host: mesh read and moved, boundary particles on it, signed distances around it."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from refsim.boundary.adami_2012 import LEAST_SHARE
from refsim.boundary.sampling import sample, sample_beneath
from refsim.boundary.signed_distance import NarrowBand, signed_distance
from refsim.core.errors import InputError
from refsim.scene.meshes import written_at
from refsim.scene.solids import countable
from refsim.scene.surface_mesh import SurfaceMesh, placed_mesh

HALF_DIAGONAL = 0.5 * 3**0.5  # of a cell, in its edges
PARTS = 4  # of a cell's edge, where the surface cuts the cell
BAND = 4.0  # width of the band in its spacings
PROBE = 0.5  # depth under a boundary particle, in spacings of the band, where the field must be negative


@dataclass(frozen=True)
class PlacedSolid:
    """A solid in a scene.

    mesh       in its position
    position   boundary particles on the surface (m, 3) [m]
    normal     outward (m, 3)
    beneath    those of each further layer below it, (k, 3) [m]
    band       signed distances, float64
    notes      warnings for the user, one sentence each
    """

    mesh: SurfaceMesh
    position: np.ndarray
    normal: np.ndarray
    beneath: tuple[np.ndarray, ...]
    band: NarrowBand
    notes: tuple[str, ...]

    def filled(self, points: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
        """Share (n,) that the solid fills of cells of edge `spacing` [m] about points (n, 3) [m]; its centre (n, 3)."""
        distance = self.distance(points)
        share, centre = (distance < 0).astype(float), np.array(points, dtype=float)
        cut = np.flatnonzero(np.abs(distance) < HALF_DIAGONAL * spacing)
        steps = ((np.indices((PARTS,) * 3).reshape(3, -1).T + 0.5) / PARTS - 0.5) * spacing
        for few in np.array_split(cut, 1 + len(cut) // 4096):
            inner = points[few, None, :] + steps
            depth = -self.distance(inner.reshape(-1, 3)).reshape(inner.shape[:2])
            part = np.clip(0.5 + depth * PARTS / spacing, 0, 1)
            share[few] = part.mean(1)
            centre[few] = (part[..., None] * inner).sum(1) / np.maximum(part.sum(1), 1e-300)[:, None]
        return share, centre

    def cells(self, spacing: float, layers: int) -> tuple[np.ndarray, np.ndarray]:
        """Shares (m,) that the solid fills of cells of the lattice, `layers` deep, and their centres (m, 3) [m]."""
        from scipy.ndimage import distance_transform_edt

        corners = self.mesh.vertices + self.mesh.origin
        low, high = np.floor(corners.min(0) / spacing) - 2, np.ceil(corners.max(0) / spacing) + 2
        size = (high - low).astype(int)
        countable(
            f"mesh_boundary: the cells of {self.mesh.source!r} at a spacing of {spacing} m", size.tolist(), each=1
        )
        points = (np.indices(size).reshape(3, -1).T + low + 0.5) * spacing
        distance = self.distance(points)
        deep = distance_transform_edt((distance < 0).reshape(size)).ravel()
        wanted = ((deep > 0) & (deep <= layers)) | (np.abs(distance) < HALF_DIAGONAL * spacing)
        share, centre = self.filled(points[wanted], spacing)
        return share[share > LEAST_SHARE], centre[share > LEAST_SHARE]

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distances (n,) [m] of points (n, 3) [m], negative inside, clamped to the band."""
        return self.band.at(np.ascontiguousarray(points, dtype=float))[0]


def placed_solid(
    file: str, center: tuple[float, float, float] | None, size: float, rotation: tuple[float, float, float],
    radius: float, field_spacing: float, seed: int, layers: int, apart: float,
) -> PlacedSolid:  # fmt: skip
    """The solid of a mesh file; cached while the file is unchanged, so that a plan reads and samples it once.

    layers  of boundary particles, `apart` [m] apart; 0 for none

    Raises InputError for a mesh that cannot be read, has no interior, or is smaller than the given spacing.
    """
    written = written_at(file)
    with np.errstate(over="warn", divide="warn", invalid="warn"):  # degenerate triangles are handled below
        return _placed(file, written, center, size, rotation, radius, field_spacing, seed, layers, apart)


@functools.lru_cache(maxsize=8)
def _placed(
    file: str, written: tuple[int, ...], center: Any, size: float, rotation: Any, radius: float, field_spacing: float,
    seed: int, layers: int, apart: float,
) -> PlacedSolid:  # fmt: skip
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
