"""The particles that a scene starts with, of its shapes and solids, and the origin of their places."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.core.capabilities import KnowsParticleMass, NeedsCellOrder, effects_with
from refsim.core.effect import Discretisation, Effect, InitialState, Nodes
from refsim.core.errors import InputError
from refsim.scene.checks import check_coincident, check_particles, resolved
from refsim.scene.scene import Scene
from refsim.scene.shapes import Ball, Box, FluidMesh, Vector, as_floats, filled
from refsim.scene.solids import countable, moved, voxelised

WIDEST_SHARE = 3.0  # factor by which a part's mass may differ from that of its lattice: bodies of a few cells
MOST_BODIES = 8  # that a pass tells apart; the last number stands for all further ones
FINE = 1e-5  # [spacings] with a resolution of positions as fine as this a scene keeps its origin
FAR = 4.0  # times nearer must an origin of its own be to its farthest particle


def placed(
    scene: Scene, empty: Discretisation, effects: Mapping[str, Effect]
) -> tuple[Discretisation, InitialState]:  # fmt: skip
    """(the grid `empty` with the scene's particles, their state at the start) of a scene that was checked.

    The origin of the grid is amid the particles where they are far from the scene's compared with their extent: a whole
    number of spacings away, or of an effect's cells. Solids and period are relative to it; the state is absolute.
    """
    solids = voxelised(scene.solid, empty) if scene.solid else None
    state = _initial_state(scene, empty, effects, solids)
    radius = _drop_radius(state, 0 if solids is None else len(solids.bodies), empty)
    bodies = tuple(np.minimum(np.unique(_touching(state, 0, empty), return_inverse=True)[1], MOST_BODIES - 1).tolist())
    grid = dataclasses.replace(empty, count=len(state.position), solids=solids, bodies=bodies, drop_radius=radius)
    cell = max((e.sorting_cell(grid) for e in effects_with(effects, NeedsCellOrder)), default=0.0)
    unit = cell if cell > 0 and solids is None else grid.spacing
    middle = unit * np.rint(0.5 * (state.position.min(0) + state.position.max(0)) / unit) + 0.0  # no -0
    farthest, nearer = np.abs(state.position).max(), np.abs(state.position - middle).max()
    if resolved(state.position, grid) > FINE and farthest >= FAR * nearer:
        if solids is not None:
            solids = moved(solids, np.rint(middle / unit).astype(np.int32))
        origin: Vector = tuple(middle.tolist())
        lower: Vector = tuple((grid.period_lower - middle).tolist())
        grid = dataclasses.replace(grid, origin=origin, period_lower=lower, solids=solids)
    check_coincident(grid.local(state.position), scene.dtype)
    return grid, state


def _drop_radius(state: InitialState, bodies: int, grid: Discretisation) -> float:
    """Radius of a ball (disc) as large as the smallest body of liquid [m]."""
    sizes, whole = np.array(state.sizes[bodies:], int), _touching(state, bodies, grid)
    volume = min((sizes[whole == k].sum() for k in whole[sizes > 0]), default=0) * grid.spacing**grid.dim
    return math.sqrt(volume / math.pi) if grid.dim == 2 else (0.75 * volume / math.pi) ** (1 / 3)


def _touching(state: InitialState, first: int, grid: Discretisation) -> np.ndarray:
    """Number of the body of each part from the first on: parts whose boxes touch are one, and what is empty is in 0."""
    ends = np.cumsum([0, *state.sizes])
    filled = first + np.flatnonzero(state.sizes[first:])
    boxes = [(x.min(0), x.max(0)) for k in filled for x in [state.position[ends[k] : ends[k + 1]]]]
    low, high = (np.array(bound).reshape(-1, 3) for bound in zip(*boxes)) if boxes else np.zeros((2, 0, 3))
    near = (low[:, None] <= high + 1.5 * grid.spacing).all(2)
    whole, before = np.arange(len(filled)), None
    while before is None or (whole != before).any():  # the lowest number spreads over parts that touch
        before, whole = whole, np.where(near & near.T, whole, len(filled)).min(1, initial=len(filled))
    numbers = np.zeros(len(state.sizes) - first, int)
    numbers[filled - first] = whole
    return numbers


def _initial_state(
    scene: Scene, grid: Discretisation, effects: Mapping[str, Effect], solids: Nodes | None
) -> InitialState:
    positions, velocities, masses = [], [], []
    if solids is not None:
        positions, velocities, masses = map(list, zip(_solid_particles(solids, grid, effects)))
    for part in scene.fluid:
        if isinstance(part, FluidMesh) or (isinstance(part, Box) and part.outside):
            points = filled(part.cell_shares(grid), grid, effects, solids)
        else:
            points = part.positions(grid)
        mass = getattr(part, "mass", None)
        if mass is None:
            share = math.prod(part.shares(grid)) if isinstance(part, Box) else 1.0
            mass = share * lattice_mass(grid, effects)
        elif isinstance(part, Ball):
            share = fitting_share("fluid ball", mass, len(points) * lattice_mass(grid, effects))
            points = np.array(part.center) + share ** (1 / grid.dim) * (points - np.array(part.center))
            mass = mass / max(1, len(points))
        positions.append(points)
        velocities.append(_per_particle("velocity", part.velocity, points.shape))
        masses.append(_per_particle("mass", mass, (len(points),)))
        countable("scene: its parts together", [sum(map(len, positions))])
    if not sum(map(len, positions)):
        raise InputError("scene: there are no particles; add a fluid box, ball or cloud, or a solid.")
    parts = (positions, velocities, masses)  # of one part the arrays themselves, in which equal values may stand once
    position, velocity, mass = (each[0] if len(each) == 1 else np.concatenate(each) for each in parts)
    check_particles(position, velocity, mass, scene)
    bodies = [] if solids is None else np.diff(solids.lattice.first)
    sizes = (*map(int, bodies), *map(len, positions[solids is not None :]))
    return InitialState(position, velocity, mass, sizes)


def _solid_particles(
    solids: Nodes, grid: Discretisation, effects: Mapping[str, Effect]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and mass of the nodes of solids; each has the volume of a particle of the liquid in bulk."""
    if "shape_matching" not in effects:
        raise InputError("scene: nothing holds its solids together; add effect 'shape_matching'.")
    position = solids.position()
    mass = solids.of_bodies("density") * solid_volume(grid, effects)
    velocity = solids.of_bodies("velocity")
    for k, body in enumerate(solids.bodies):
        rows = slice(*solids.lattice.first[k : k + 2])
        if body.mass is not None:
            mass[rows] *= fitting_share(f"[[solid]] number {k + 1}", body.mass, mass[rows].sum())
        velocity[rows] += np.cross(body.spin, position[rows] - position[rows].mean(0))
    return position, velocity, mass


def fitting_share(place: str, mass: float, lattice: float) -> float:
    """A part's mass over that of its lattice particles [kg]. Raises InputError where the two do not fit."""
    share = mass / lattice if lattice > 0 else 1.0
    if not 1 / WIDEST_SHARE <= share <= WIDEST_SHARE:
        raise InputError(
            f"{place}: mass = {mass:g} kg is {share:.3g} times that of its particles at its density ({lattice:.4g} kg);"
            " correct its mass, size or density, or leave the mass out."
        )
    return share


def solid_volume(grid: Discretisation, effects: Mapping[str, Effect]) -> float:
    """Volume of a particle of a solid [m^dim]: that of a particle of the liquid in bulk."""
    liquid = next((e for e in effects_with(effects, KnowsParticleMass) if e.of_liquid), None)
    return grid.spacing**grid.dim if liquid is None else liquid.particle_volume(grid)


def lattice_mass(grid: Discretisation, effects: Mapping[str, Effect]) -> float:
    """Mass of a lattice particle: the liquid's, else that of the first effect that gives one, else 1."""
    liquid_first = sorted(effects_with(effects, KnowsParticleMass), key=lambda effect: not effect.of_liquid)
    return liquid_first[0].particle_mass(grid) if liquid_first else 1.0


def _per_particle(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """One value for all particles, or one for each, as an array of this shape."""
    try:
        array = as_floats(values)
        if array.shape not in (shape, shape[1:]):
            raise ValueError
        return np.broadcast_to(array, shape)
    except (TypeError, ValueError):
        each = "3 numbers" if len(shape) == 2 else "one"
        raise InputError(
            f"fluid cloud: {name} does not fit {shape[0]} particles; give {each} for all or for each."
        ) from None
