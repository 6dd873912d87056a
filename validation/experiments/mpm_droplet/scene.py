"""Scenes of the MPM droplet. Lengths in cells; rho = 1, k = 1, lambda = 1000 in cells of 1/64 m in the plane and 1/32 m
in space."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import MpmLiquid, MpmWalls, Scene, SurfaceEnergy
from refsim.scene.shapes import Cloud

CELLS = {2: 1 / 64, 3: 1 / 32}  # h [m]
STEPS = {2: 2e-4, 3: 4e-4}  # s: 1.4 stable steps with lambda = 1000
TENSION, MODULUS, DENSITY = 1.0, 1000.0, 1.0
SHIFT = np.array([0.13, -0.21, 0.07])  # of lattices against the grid, so that nothing is symmetric by chance
Array = NDArray[np.float64]


def lattice(half: float, dim: int, shift: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    """A lattice of 2^dim particles to a cell in [-half, half]^dim, moved by `shift` [cells]: (n, dim)."""
    n = math.ceil(2 * half) + 2
    axis = 0.5 * (np.arange(-n, n) + 0.5)
    place = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    return place + np.asarray(shift)[:dim]


def turned(place: Array, seed: int) -> Array:
    """Places turned about the origin by a random angle or rotation."""
    random = np.random.default_rng(seed)
    if place.shape[1] == 2:
        a = random.uniform(0, 2 * math.pi)
        return place @ np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]]).T
    frame, upper = np.linalg.qr(random.normal(size=(3, 3)))
    frame = frame * np.sign(np.diag(upper))
    frame[:, 0] *= np.linalg.det(frame)
    return place @ frame.T


def ellipsoid(radius: float, dim: int, stretch: float = 0.0, seed: int | None = None) -> Array:
    """A lattice cut by an ellipse or a spheroid of the volume of a ball of `radius`, longer along x by `stretch`.

    seed  of a random place and rotation of the lattice; None takes SHIFT and no rotation
    """
    long = 1.0 + stretch
    semi = radius * np.array([long, *[long ** (-1 / (dim - 1))] * (dim - 1)])
    if seed is None:
        place = lattice(semi.max(), dim, SHIFT)
    else:
        shift = np.random.default_rng(seed).uniform(-0.25, 0.25, 3)
        place = turned(lattice(2 * semi.max(), dim, shift), seed)
    return place[((place / semi) ** 2).sum(1) < 1]


def pair(radius: float, dim: int, speed: float = 1.0) -> tuple[Array, Array]:
    """Places [cells] and velocities [m/s] of two discs or balls that meet along x, each at `speed`.

    They begin four cells from touching, off their axis.
    """
    single = ellipsoid(radius, dim)
    shift = np.array((radius + 2.0, 0.25 * radius, 0.0))[:dim]
    velocity = np.zeros((2 * len(single), 3))
    velocity[: len(single), 0], velocity[len(single) :, 0] = speed, -speed
    return np.vstack([single - shift, single + shift]), velocity


def box(sides: Sequence[float], seed: int | None = None, per: int = 2) -> Array:
    """A lattice block of the given sides [cells], `per` particles along a cell, its middle near the origin; turned off
    the axes by `seed`."""
    axes = [(np.arange(round(per * side)) + 0.5) / per - 0.5 * side for side in sides]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(sides))
    return (place if seed is None else turned(place, seed)) + SHIFT[: len(sides)]


def radius_of(count: int, dim: int, per: int = 2) -> float:
    """Radius of the ball (disc) of the volume of `count` particles, `per` along a cell [cells]."""
    volume = count / per**dim
    return math.sqrt(volume / math.pi) if dim == 2 else (3 * volume / (4 * math.pi)) ** (1 / 3)


def drop_scene(
    place: Array, dim: int, *, velocity: Any = (0.0, 0.0, 0.0), step: float | None = None,
    liquid: dict[str, Any] | None = None, tension: dict[str, Any] | None = None, balanced: bool = False,
    walls: dict[str, Any] | None = None, cell: float | None = None, per: int = 2,
) -> Scene:  # fmt: skip
    """A scene of particles at `place` (n, dim) [cells].

    step      [s], fixed; by default STEPS; 0 lets the runner decide
    balanced  start pressed together by as much as holds the pressure of a round drop
    walls     parameters of `MpmWalls`, corners in cells
    cell      h [m]; None takes CELLS
    per       particles along a cell
    """
    h = cell or CELLS[dim]
    surface = {"surface_tension": TENSION, **(tension or {})}
    matter = {"rest_density": DENSITY, "bulk_modulus": MODULUS, "cell_size": h, **(liquid or {})}
    if balanced:
        pressure = (dim - 1) * surface["surface_tension"] / (h * radius_of(len(place), dim, per))
        matter["initial_ratio"] = 1 - pressure / matter["bulk_modulus"]
        place = place * matter["initial_ratio"] ** (1 / dim)
    position = np.pad(h * place, ((0, 0), (0, 3 - dim)))
    effects: list[Any] = [MpmLiquid(**matter), SurfaceEnergy(**surface)]
    if walls is not None:
        corners = {name: tuple(h * c for c in walls[name]) for name in ("lower", "upper")}
        effects.append(MpmWalls(**{**walls, **corners}))
    if step is None:
        step = STEPS[dim] * h / CELLS[dim] * math.sqrt(min(1.0, MODULUS / matter["bulk_modulus"]))
        if matter.get("dynamic_viscosity"):  # the runner's viscous limit
            step = min(step, DENSITY * h**2 / (16 * matter["dynamic_viscosity"]))
    return Scene(
        spacing=h / per, support_radius=3 * h / per, dim=dim, dtype="float64", step=step, effects=tuple(effects),
        fluid=(Cloud(position=position, velocity=velocity),),
    )  # fmt: skip
