"""Shapes from which droplets start: particles of a simple cubic lattice, centred on the origin.

The spacing is the unit of length unless given. Every shape is the same for the same arguments on every
machine up to rounding.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


class LatticeCut(NamedTuple):
    """Particles of a rotated lattice inside an axis-aligned cube.

    position: (count, 3) [m]. side: edge of the cube [m]. rotation: (3, 3), columns are the lattice axes.
    """

    position: NDArray[np.float64]
    side: float
    rotation: NDArray[np.float64]


class LatticeBox(NamedTuple):
    """A lattice box turned as a whole.

    position: (n, 3) [m]. shape: particles along each of the box's axes. rotation: (3, 3), columns are the
    box's axes.
    """

    position: NDArray[np.float64]
    shape: tuple[int, int, int]
    rotation: NDArray[np.float64]


def lattice_cube(n: int, spacing: float = 1.0) -> NDArray[np.float64]:
    """Positions (n^3, 3) [m] of a cube of n particles a side."""
    return _block((n,) * 3) * spacing


def lattice_ball(count: int, spacing: float = 1.0) -> NDArray[np.float64]:
    """Positions (count, 3) [m] of the lattice sites nearest to one site: a ball cut from the lattice.

    The last shell is rarely complete; of its sites those farthest along an axis come first, then by x, y, z.
    The incomplete shell moves the centre of mass off the origin by a few hundredths of the spacing.
    """
    half = int(np.ceil((3.0 * count / (4.0 * np.pi)) ** (1.0 / 3.0))) + 1
    site = _block((2 * half + 1,) * 3).astype(int)
    key = (site[:, 2], site[:, 1], site[:, 0], -np.abs(site).max(axis=1), np.sum(site**2, axis=1))
    return site[np.lexsort(key)[:count]] * spacing


LATTICES = {"ball": lattice_ball, "cube": lattice_cube}


def rotated_lattice_cube(count: int, seed: int, spacing: float = 1.0) -> LatticeCut:
    """Exactly ``count`` particles of a randomly turned and shifted lattice inside an axis-aligned cube.

    Any count is possible, primes too (5,039). The cube is centred on the origin and its side lies halfway
    between the one that would let the next particle in and the one that would lose the last, about
    count^(1/3) spacings.
    Raises ValueError where two particles enter the cube at once (other seed).
    """
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(rng=rng).as_matrix()
    shift = rng.random(3)
    half = int(np.ceil(0.5 * np.sqrt(3.0) * (count ** (1.0 / 3.0) + 3.0))) + 1
    site = (_block((2 * half + 1,) * 3) + shift) @ rotation.T
    reach = np.abs(site).max(axis=1)
    order = np.argsort(reach, kind="stable")
    last, following = reach[order[count - 1]], reach[order[count]]
    if following - last < 1e-12:
        raise ValueError(f"no cube holds exactly {count} particles of the lattice of seed {seed}")
    inside = np.sort(order[:count])
    return LatticeCut(site[inside] * spacing, float(last + following) * spacing, rotation)


def rotated_box(
    count: int, aspect: tuple[float, float, float] = (1.3, 1.0, 0.8), seed: int = 0, spacing: float = 1.0
) -> LatticeBox:
    """About ``count`` particles: a lattice box of about the given aspect, turned off the coordinate axes.

    The particles along each axis are the aspect scaled to the count and rounded: 22 x 17 x 13 = 4,862 for
    4,913. The rotation is random, from the seed.
    """
    sides = np.asarray(aspect, dtype=np.float64)
    scale = (count / np.prod(sides)) ** (1.0 / 3.0)
    shape = tuple(max(1, round(side * scale)) for side in sides)
    rotation = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    return LatticeBox(_block(shape) @ rotation.T * spacing, shape, rotation)


def jittered(position: NDArray[np.float64], spacing: float, seed: int, share: float = 0.01) -> NDArray[np.float64]:
    """Positions (n, 3) [m], each moved at random along the axes in which they differ, by `share` of the spacing (rms).

    It takes from a lattice the symmetry that nothing in the world has: rounding alone would break it, later in float64
    than in float32.
    """
    moved = np.random.default_rng(seed).normal(0.0, share * spacing, position.shape)
    return position + np.where(np.ptp(position, axis=0) > 0.0, moved, 0.0)


def _block(shape: tuple[int, int, int]) -> NDArray[np.float64]:
    """Sites (n, 3) of a lattice block of unit spacing about the origin."""
    axes = [np.arange(sites) - 0.5 * (sites - 1) for sites in shape]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
