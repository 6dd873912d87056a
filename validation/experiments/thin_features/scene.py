"""Clouds with and without thin features, in units of the spacing: films, filaments, bulk and tanks.

A family is a list of (positions (n, 3), wall faces that are open or None without walls); in 2D z = 0."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from refsim.core.effect import Discretisation
from refsim.scene.shapes import Box

Cloud = tuple[NDArray[np.float64], bool]  # positions, and whether they stand in a tank that is open above
JITTERS = (0.0, 0.1, 0.2)  # of the spacing, along every axis, uniformly to both sides
SIDE = {2: 30, 3: 12}  # of films, blocks and tanks
RELAXED = {2: 26, 3: 13}  # of the relaxed cloud, before it is cut
BEND = 8.0  # radius of bent filaments


def block(*sites: int) -> NDArray[np.float64]:
    """Sites (n, 3) of a lattice block with its corner half a spacing from the origin; z = 0 for one site along z."""
    cells = (*sites, 1, 1)[:3]
    dim = 2 if cells[2] == 1 and len(sites) == 2 else 3
    return Box(cells=cells).positions(Discretisation(dim, "float64", 1.0, 2.6, 0))


def turned(position: NDArray[np.float64], dim: int, random: np.random.Generator) -> NDArray[np.float64]:
    """The cloud turned at random as a whole."""
    if dim == 2:
        return position @ Rotation.from_rotvec([0, 0, random.uniform(0, 2 * np.pi)]).as_matrix().T
    return position @ Rotation.random(rng=random).as_matrix().T


def moved(position: NDArray[np.float64], dim: int, amount: float, random: np.random.Generator) -> NDArray[np.float64]:
    """Every particle off its place by up to `amount` along each axis."""
    shift = random.uniform(-amount, amount, position.shape)
    shift[:, dim:] = 0.0
    return position + shift


def relaxed(dim: int, side: int, random: np.random.Generator) -> NDArray[np.float64]:
    """A random cloud of unit density in a periodic box, whose particles have pushed each other apart 30 times."""
    x = random.uniform(0, side, (side**dim, dim))
    for _ in range(30):
        first, second = cKDTree(x, boxsize=side).query_pairs(1.3, output_type="ndarray").T
        apart = x[first] - x[second]
        apart -= side * np.round(apart / side)
        distance = np.linalg.norm(apart, axis=1)
        push = (0.15 * (1.3 - distance) / np.maximum(distance, 1e-9))[:, None] * apart
        np.add.at(x, first, push)
        np.add.at(x, second, -push)
        x %= side
    return np.pad(x, ((0, 0), (0, 3 - dim)))


def bent(position: NDArray[np.float64], radius: float = BEND) -> NDArray[np.float64]:
    """The cloud with its x axis laid on a circle in the plane of x and y."""
    angle, out = position[:, 0] / radius, radius + position[:, 1]
    return np.column_stack([out * np.sin(angle), out * np.cos(angle), position[:, 2]])


def lattice_slab(dim: int, normal: tuple[int, ...], thickness: float) -> NDArray[np.float64]:
    """Lattice sites between two planes across `normal`, as far as SIDE/2 along them."""
    sites = block(*[2 * SIDE[dim] + 1] * dim)
    sites = sites - sites[len(sites) // 2]
    axis = np.pad(np.array(normal, dtype=float), (0, 3 - len(normal))) / np.linalg.norm(normal)
    height = sites @ axis
    along = np.linalg.norm(sites - height[:, None] * axis, axis=1)
    return sites[(height > -1e-6) & (height < thickness - 1e-6) & (along < SIDE[dim] / 2)]


def sheet(dim: int, layers: int) -> NDArray[np.float64]:
    """A lattice film of a number of layers."""
    return block(*[SIDE[dim]] * (dim - 1), layers)


def films(dim: int, random: np.random.Generator) -> list[Cloud]:
    """Lattice films of one and two layers, and slices of a relaxed cloud 1 and 1.5 spacings thick; turned."""
    lattices = [moved(sheet(dim, layers), dim, jitter, random) for layers in (1, 2) for jitter in JITTERS]
    cloud, middle = relaxed(dim, RELAXED[dim], random), RELAXED[dim] / 2
    slices = [cloud[np.abs(cloud[:, dim - 1] - middle) < thickness / 2] for thickness in (1.0, 1.5)]
    return [(turned(position, dim, random), False) for position in (*lattices, *slices)]


def filaments(dim: int, random: np.random.Generator) -> list[Cloud]:
    """Straight and bent filaments: one and two particles wide in 2D; one, two by one and two by two in 3D."""
    sections = ((1,), (2,)) if dim == 2 else ((1, 1), (2, 1), (2, 2))
    made = []
    for section in sections:
        for jitter in JITTERS:
            straight = moved(block(SIDE[2], *section), dim, jitter, random)
            made += [(turned(position, dim, random), False) for position in (straight, bent(straight))]
    return made


def three_layers(dim: int, random: np.random.Generator) -> list[Cloud]:
    """Lattice films of three layers, of which the middle one is covered."""
    return [(turned(moved(sheet(dim, 3), dim, jitter, random), dim, random), False) for jitter in JITTERS]


def close_layers(dim: int, random: np.random.Generator) -> list[Cloud]:
    """Films 1.5 spacings thick of three lattice planes that stand less than a spacing apart; the middle is covered."""
    normals = ((1, 1),) if dim == 2 else ((1, 1, 0), (1, 1, 1))
    return [
        (turned(moved(lattice_slab(dim, normal, 1.5), dim, jitter, random), dim, random), False)
        for normal in normals
        for jitter in JITTERS
    ]


def bulk(dim: int, random: np.random.Generator) -> list[Cloud]:
    """Lattice blocks, one of them without its middle particle, a block and a drop of a relaxed cloud; turned."""
    cloud, middle = relaxed(dim, RELAXED[dim], random), RELAXED[dim] / 2
    drop = cloud[np.linalg.norm(cloud[:, :dim] - middle, axis=1) < RELAXED[dim] / 3]
    whole = block(*[SIDE[dim]] * dim)
    hollow = np.delete(whole, np.argmin(np.linalg.norm(whole - whole.mean(0), axis=1)), axis=0)
    blocks = [moved(whole, dim, jitter, random) for jitter in JITTERS]
    return [(turned(position, dim, random), False) for position in (*blocks, hollow, cloud, drop)]


def tanks(dim: int, random: np.random.Generator) -> list[Cloud]:
    """A tank filled to its rim, open above."""
    return [(moved(block(*[SIDE[dim]] * dim), dim, jitter, random), True) for jitter in JITTERS]


CLOUDS: dict[str, tuple[str, Callable[[int, np.random.Generator], list[Cloud]]]] = {
    "films": ("films of 1 and 2 layers", films), "filaments": ("filaments", filaments),
    "three_layers": ("films of 3 layers", three_layers), "close_layers": ("3 close layers, 1.5 d", close_layers),
    "bulk": ("bulk, drops, a cavity", bulk), "tanks": ("tanks with walls", tanks),
}  # fmt: skip
