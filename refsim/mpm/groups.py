"""What transfers take together: fields of particles and of embedded points, and what a step is made of."""

from typing import Any, NamedTuple

SETS = ("particles", "carriers", "samples")  # of points


class Particles(NamedTuple):
    """Fields of the particles before the step, as both transfers to the grid read them."""

    position: Any
    velocity: Any
    mass: Any
    affine: Any
    volume_ratio: Any
    acceleration: Any  # of other effects, or None


class Moved(NamedTuple):
    """Fields of the particles that the transfer from the grid writes."""

    velocity: Any
    affine: Any
    volume_ratio: Any
    deformation: Any  # or None
    position_residual: Any  # or None
    position: Any


class Medium(NamedTuple):
    """The liquid, its background grid and the step."""

    liquid: Any
    background: Any
    timestep: Any


class Cluster(NamedTuple):
    """Shares and spreads of the particles with embedded points, and their reading; or three times None."""

    cluster_share: Any
    inverse_spread: Any
    embedding: Any


class Owned(NamedTuple):
    """Embedded points and the particles that own them."""

    carrier_position: Any
    carrier_owner: Any


class Carriers(NamedTuple):
    """Embedded points by owner, and their moments; or three times None."""

    carrier_first: Any
    carrier_position: Any
    carrier_moment: Any


class Nodes(NamedTuple):
    """Nodes before the update."""

    node_mass: Any
    node_momentum: Any
    node_pull: Any  # or None


class Bins(NamedTuple):
    """Points by block (CPU) or by cell (GPU): those of bin i are point[first[i] : first[i + 1]]."""

    first: Any  # (bins + 1,) int32
    point: Any  # (points,) int32


class Places(NamedTuple):
    """Points sorted into blocks: their numbers by bin, their cells, and the blocks."""

    bins: Any
    cell: Any
    blocks: Any
