"""A reconstructed surface: its samples, which the transfers take, and the results of its reconstruction."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from refsim.isosurface import Mesh
from refsim.sparse_grid import Blocks, PointList


class Samples(NamedTuple):
    """The surface as the transfers take it: s samples."""

    position: Any  # (s, 3) [m]
    normal: Any  # (s, 3), unit, outward
    area: Any  # (s,) [m^(dim-1)], 0 on components without tension
    nearest: Any  # (s,) int32, nearest interior particle


class Liquid(NamedTuple):
    """Particles (n, 3) [m], the number of each (n,), blocks about them, and the particles of each cell."""

    position: Any
    number: Any
    blocks: Blocks
    cells: PointList


@dataclass
class Surface:
    """All that one reconstruction makes; arrays on the backend."""

    samples: Samples  # what the transfers take
    mesh: Mesh  # the level set's surface, before the inset
    inset_mesh: Mesh  # after it; the same mesh without an inset
    component_size: Any  # (particles,) int32, particles in the component of each
    blocks: Blocks
    cells: PointList
    coefficients: Any
    facet_normal: Any
    offset_direction: Any
    sample_place: Any
    seconds: dict[str, float] = field(default_factory=dict)  # time of each stage [s], if measured
    padded: Samples | None = None  # the samples with unused capacity, see `RecordedSurface`, or None
    most_in_a_cell: int | None = None  # largest number of particles in one cell, or None: not computed
    unfound: bool | None = None  # whether a sample has no particle, or None: not computed
