"""Placing of a solid, on the host: mesh read and moved, boundary particles on it, signed distances around it."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from refsim.boundary.sampling import sample, sample_beneath
from refsim.boundary.signed_distance import NarrowBand, signed_distance
from refsim.core.errors import InputError
from refsim.scene.meshes import written_at
from refsim.scene.surface_mesh import SurfaceMesh, placed_mesh

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

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distances (n,) [m] of points (n, 3) [m], negative inside, clamped to the band."""
        return self.band.at(np.ascontiguousarray(points, dtype=float))[0]


def placed_solid(
    file: str, center: tuple[float, float, float] | None, size: float, rotation: tuple[float, float, float],
    radius: float, field_spacing: float, seed: int, layers: int, apart: float,
) -> PlacedSolid:  # fmt: skip
    """The solid of a mesh file; cached while the file is unchanged, so that a plan reads and samples it once.

    layers  of boundary particles, `apart` [m] apart

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
    band = signed_distance(mesh, field_spacing, BAND * field_spacing, dtype="float64")
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
