"""What a scene is refused for, or noted on: its numbers and effects, its particles, and what follows from both."""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import numpy as np

from refsim.core.capabilities import (
    BringsWalls,
    FollowsGrid,
    HasErrata,
    HasPlanes,
    KnowsParticleMass,
    LimitsMassRatio,
    effects_with,
    with_scene_defaults,
)
from refsim.core.effect import EFFECTS, Discretisation, Effect, Extremes, InitialState, Nodes
from refsim.core.errors import InputError
from refsim.core.reading import GREATEST, LONGEST
from refsim.core.tables import vector
from refsim.core.walls import WallParticles
from refsim.gauges.checks import check_gauges
from refsim.motion import check_motions, moves_tank
from refsim.neighbours import MOST_NEIGHBOURS
from refsim.scene.counting import Cells
from refsim.scene.files import describe, unit_of
from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud

COARSE = 1e-4  # [spacings] a coarser resolution of positions gives a note: accelerations are off by twice that share
LEAST = 1e-30  # smallest length [m] and time [s] that a scene may have
SMALLEST = 1e-100  # magnitude of any other number that is not zero
CROWDED, TWICE = 1.05, 1.2  # particles over those of a lattice, above which a start has a note and is refused
FLAT = {"position": ("z", "m"), "velocity": ("v_z", "m/s")}  # what is 0 in 2D
POSITIVE = {"mass": "kg", "rest_density": "kg/m^3", "heat_capacity": "J/(kg K)", "volume_ratio": "of the first volume"}
SHARED = 0.4  # of a cell of one spacing, filled by two parts: half a spacing between their faces gives 0.375
LATTICE = 1.02  # largest of the same in a lattice, turned or stretched, that is counted alone
ALONE, FEW = 1.05, 1.5  # spacings of a support below which a lattice's particle has no neighbour, few of them
APART = 3e-5  # of the support radius: 15 roundings of a place 100 spacings off, in float32
LONGEST_FIXED = 1.6  # stable steps that a fixed step may span; longer ones gained energy without diverging in tests


def _support_radius(scene: Scene, effects: Mapping[str, Effect]) -> float:
    """The support radius [m], less a part of `APART` where roundings would say which of a lattice's pairs act."""
    squared = (scene.support_radius / scene.spacing) ** 2  # an integer for distances of the lattice
    tied = abs(squared - round(squared)) < APART * squared
    abrupt = any(effect.ends_abruptly and effect.acts() for effect in effects.values())
    return scene.support_radius * (1 - APART * (tied and abrupt))


def checked(scene: Scene) -> tuple[Discretisation, dict[str, Effect]]:
    """(what effects may read of the scene, without particles; its effects by name) of a scene that may be planned.

    Raises InputError for numbers, effects, gauges and motions that are not possible, or not together.
    """
    _check_numbers(scene)
    listed = _effects(scene)
    grid = Discretisation(
        scene.dim, scene.dtype, scene.spacing, _support_radius(scene, listed), 0, scene.step, None, scene.period,
        scene.period_lower,
    )  # fmt: skip
    given = {name: effect.in_scene(grid) for name, effect in listed.items()}
    if moves_tank(scene.motion) and "gravity" not in given:
        given["gravity"] = EFFECTS["gravity"](acceleration=(0.0, 0.0, 0.0))
    effects = with_scene_defaults(effect for effect in given.values() if not _is_open(effect, grid))
    for name, effect in effects.items():
        if isinstance(effect, FollowsGrid):
            effects[name] = effect.on_grid(given[name], grid, effects)
    _check_support(grid, effects)
    postponed = []
    for effect in (given | effects).values():
        if isinstance(effect, HasErrata):
            effect.printed()
        try:
            effect.check(grid, effects)
        except InputError:
            raise
        except Exception:  # it may read an effect whose own check, which comes later, says what is wrong
            postponed.append(effect)
    for effect in postponed:
        effect.check(grid, effects)
    check_gauges(scene.gauge, len(scene.solid), grid, effects)
    check_motions(scene.motion, scene.end_time, grid, effects)
    return grid, effects


def _check_numbers(scene: Scene) -> None:
    """Raise InputError for numbers of the scene and its parts that no product may have."""
    if scene.support_radius < scene.spacing:
        raise InputError(
            f"scene: support_radius = {scene.support_radius} m is below one spacing ({scene.spacing} m), so that no"
            " particle would have a neighbour; give at least 1.5 spacings."
        )
    _check_magnitudes("scene", scene, LEAST)
    if scene.dim == 2 and scene.period[2] != 0:
        raise InputError("scene: period has a z part in a 2D scene; set it to 0.")
    _check_neighbours(scene, "support_radius", scene.support_radius)
    for kind in ("fluid", "solid", "motion", "gauge"):
        for number, part in enumerate(getattr(scene, kind), 1):
            _check_magnitudes(f"[[{kind}]] number {number}", part)
    for effect in scene.effects:
        _check_magnitudes(getattr(effect, "name", "scene"), effect)


def _check_magnitudes(place: str, part: Any, least: float = SMALLEST) -> None:
    if not isinstance(part, msgspec.Struct):
        return
    meanings = describe(type(part))
    for f in msgspec.structs.fields(part):
        values = getattr(part, f.name)
        if f.type is not Any:  # arrays of particles and cells are looked at where they are read
            most = LONGEST if unit_of(meanings.get(f.name, "")) == "m" else GREATEST
            several = isinstance(values, tuple)
            for axis, value in enumerate(values if several else (values,)):
                name = f"{f.name} along {'xyz'[axis]}" if several and len(values) == 3 else f.name
                _check_magnitude(place, name, value, 0.0 if "temperature" in f.name else least, most)


def _check_magnitude(place: str, name: str, value: Any, least: float = 0.0, most: float = GREATEST) -> None:
    """Raise InputError for a number that is not finite, or whose magnitude is outside the accepted range."""
    if not isinstance(value, int | float) or value == 0 or least <= abs(value) <= most:
        return
    number = f"{value:g}" if isinstance(value, float) else f"{str(value)[:12]}..."
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{place}: {name} = {number} is not possible; give a finite number.")
    kind = "small" if abs(value) < least else "large"
    raise InputError(f"{place}: {name} = {number} is too {kind} to be meant in SI units; correct it.")


def _effects(scene: Scene) -> dict[str, Effect]:
    effects: dict[str, Effect] = {}
    for effect in scene.effects:
        if not isinstance(effect, Effect):
            raise InputError(f"scene: {effect!r} is not an effect; choose from {', '.join(sorted(EFFECTS))}.")
        if effect.name in effects:
            raise InputError(f"scene: effect {effect.name!r} is listed twice; keep one.")
        effects[effect.name] = effect
    for name, effect in effects.items():
        for needed in effect.needs():
            if needed not in effects:
                raise InputError(f"Effect {name!r} needs effect {needed!r}; add it to the scene.")
        if any(scene.period) and not effect.periodic:
            able = ", ".join(sorted(other for other, kind in EFFECTS.items() if kind.periodic))
            raise InputError(
                f"{name}: this effect does not act across the border of a periodic box; leave out the scene's period or"
                f" the effect (with a period a scene can have {able})."
            )
    return effects


def _is_open(effect: Effect, grid: Discretisation) -> bool:
    """Whether it is a box of walls without any face: no part of the scene."""
    return (
        isinstance(effect, BringsWalls) and isinstance(effect, HasPlanes) and not np.isfinite(effect.domain(grid)).any()
    )


def summing(grid: Discretisation, effects: Mapping[str, Effect]) -> list[str]:
    """Names of the effects that sum over neighbours."""
    return [name for name, effect in effects.items() if effect.list_radius(grid) > 0]


def _check_support(grid: Discretisation, effects: Mapping[str, Effect]) -> None:
    """Raise InputError where an effect sums over neighbours and a lattice has none, or such as rounding takes."""
    ratio, names = grid.support_radius / grid.spacing, summing(grid, effects)
    if names and ratio < ALONE * (1 - 1e-9):
        raise InputError(
            f"scene: support_radius = {grid.support_radius:g} m is {ratio:.4g} spacings ({grid.spacing:g} m), so that"
            f" {names[0]} sums over no neighbour on the lattice, or one that rounding takes; give at least {FEW:g}"
            " spacings, 2 to 3 are common."
        )


def few_neighbours(grid: Discretisation, effects: Mapping[str, Effect]) -> tuple[str, ...]:
    """A note if effects sum over the nearest neighbours on the lattice alone."""
    ratio, names = grid.support_radius / grid.spacing, summing(grid, effects)
    if not names or ratio >= FEW * (1 - 1e-9):
        return ()
    return (
        f"support_radius = {grid.support_radius:g} m is {ratio:.3g} spacings, so that sums of {', '.join(names)} take"
        f" in the nearest neighbours alone: take at least {FEW:g} spacings, 2 to 3 are common",
    )


def check_list(scene: Scene, radius: float) -> None:
    """Raise InputError where a neighbour list of this radius [m] is too long, or wider than half of a period."""
    if radius > scene.support_radius:
        _check_neighbours(scene, "the radius of the neighbour list", radius)
    reach = radius * (1 + scene.skins[0])
    for axis, length in zip("xyz", scene.period):
        if 0 < length <= 2 * reach:
            raise InputError(
                f"scene: period = {length:g} m along {axis} is at most twice the {reach:.3g} m up to which the"
                " neighbour list reaches, so that two images of one particle would be neighbours; give a longer one."
            )


def _check_neighbours(scene: Scene, what: str, radius: float) -> None:
    """Raise InputError where a particle of the lattice has more neighbours within `radius` [m] than one may have."""
    reach = radius / scene.spacing * (1 + scene.skins[0])
    number = (math.pi if scene.dim == 2 else 4 / 3 * math.pi) * reach**scene.dim
    if number > MOST_NEIGHBOURS:
        raise InputError(
            f"scene: {what} = {radius:g} m with a skin of {scene.skins[0]:g} reaches over {reach:.3g} spacings"
            f" ({scene.spacing:g} m) and so over {number:.3g} neighbours, more than the {MOST_NEIGHBOURS:,} that a"
            " particle may have; check the units, 2 to 3 spacings are common."
        )


def check_fixed_step(scene: Scene, grid: Discretisation, effects: Mapping[str, Effect]) -> None:
    """Raise InputError for a fixed step far beyond what is stable with particles at rest."""
    limits = {name: limit for e in effects.values() for name, limit in e.step_limits(grid, effects).items()}
    at_rest = {name: limit.at(Extremes(0.0, 0.0)) for name, limit in limits.items()}
    if not at_rest:
        return
    name = min(at_rest, key=lambda limit: at_rest[limit])
    if not at_rest[name] >= LEAST:
        raise InputError(
            f"scene: the stable step of particles at rest is {at_rest[name]:g} s ({name}); check the units of the"
            " effects' parameters."
        )
    if scene.step > LONGEST_FIXED * at_rest[name]:
        raise InputError(
            f"scene: step = {scene.step:g} s is {scene.step / at_rest[name]:.3g} times the stable one at rest"
            f" ({at_rest[name]:.3g} s, {name}); give at most {LONGEST_FIXED:g} times that, or 0."
        )


def resolved(position: np.ndarray, grid: Discretisation) -> float:
    """Distance of two numbers of the run's dtype at the farthest coordinate [spacings]."""
    return float(np.spacing(np.abs(position).max().astype(grid.dtype))) / grid.spacing


def coarse_places(grid: Discretisation, state: InitialState) -> tuple[str, ...]:
    """A note if the dtype does not resolve distances well enough, because the particles' own extent is wide."""
    step = resolved(state.position, grid)
    if step <= COARSE:
        return ()
    return (
        f"the particles reach {np.abs(state.position).max():.4g} m from the place that positions are relative to, where"
        f" {grid.dtype} resolves distances to {step:.2g} spacings only, and accelerations to about twice that share:"
        " use float64",
    )


def crowded(
    grid: Discretisation, state: InitialState, walls: WallParticles | None, scene: Scene, effects: Mapping[str, Effect]
) -> Iterator[str]:
    """A note where more particles are counted than a lattice has, with those of walls; InputError above TWICE.

    Particles count with their volume, heavier ones than a lattice's as one of it. A cloud that is no lattice itself
    crowds in places; with one in the scene there is no note.
    """
    liquid = next((effect for effect in effects_with(effects, KnowsParticleMass) if effect.of_liquid), None)
    if liquid is None:
        return
    solid, lattice = 0 if grid.solids is None else len(grid.solids.lattice.key), grid.spacing**grid.dim
    volume = lattice * np.minimum(1.0, liquid.starting_share() * state.mass / liquid.particle_mass(grid))
    volume[:solid] = lattice
    place, wall_volume = state.position, np.zeros(0)
    if walls is not None:
        place = np.concatenate([place, grid.local(walls.position)])
        wall_volume = np.minimum(walls.volume, lattice)
    cells = Cells(place, grid)
    filled = cells.filled(volume) + np.minimum(1.0, cells.filled(wall_volume, grid.count))
    filling = cells.at_particles(filled, grid.count) if filled.max() > CROWDED else np.zeros(1)
    first = int(filling.argmax())
    if filling[first] <= CROWDED:
        yield from overlapping(grid, state, scene)
        return
    where = vector(grid.absolute(state.position[first])[: grid.dim], ".4")
    message = (
        f"{filling[first]:.3g} times the particles of a lattice of the spacing are counted at {where} m, those of"
        " walls and solids among them"
    )
    if filling[first] > TWICE:
        raise InputError(f"scene: {message}: parts of it fill one place twice; move them apart, or leave one out.")
    for part in _parts(scene, state, of_cloud=True):
        cells = Cells(state.position[part], dataclasses.replace(grid, period=(0.0, 0.0, 0.0)))
        if cells.at_particles(cells.filled(volume[part]), part.stop - part.start).max() > LATTICE:
            return
    yield f"{message}: parts that overlap press each other apart; leave a spacing between their particles"


def _parts(scene: Scene, state: InitialState, of_cloud: bool) -> Iterator[slice]:
    """The particles of each part of the fluid that has some and is a cloud, or is none."""
    ends = np.cumsum([0, *state.sizes])[-len(scene.fluid) - 1 :].tolist()
    for part, (begin, end) in zip(scene.fluid, itertools.pairwise(ends)):
        if end > begin and isinstance(part, Cloud) == of_cloud:
            yield slice(begin, end)


def overlapping(grid: Discretisation, state: InitialState, scene: Scene) -> Iterator[str]:
    """A note where parts of the liquid share an edge or a corner, which the wide splines of `crowded` do not see."""
    parts = list(_parts(scene, state, of_cloud=False))
    if len(parts) < 2:
        return
    cells, whole = Cells(state.position, grid, 1.0), np.full(len(state.position), grid.spacing**grid.dim)
    total, most = np.zeros((2, cells.near.shape[1]))
    for part in parts:
        filled = cells.filled(whole[part], part.start)
        total += filled
        most = np.maximum(most, filled)
    filled = np.where(total - most > SHARED, total, 0.0)
    if filled.max() > 1 + SHARED:
        place = state.position[cells.at_particles(filled, len(whole)).argmax()]
        where = vector(grid.absolute(place)[: grid.dim], ".4")
        yield (
            f"parts of the liquid fill the edge or the corner that they share {filled.max():.3g} times at {where} m and"
            " press each other apart there; leave a spacing between their particles"
        )


def unequal_masses(state: InitialState, effects: Mapping[str, Effect]) -> Iterator[str]:
    """A note where the ratio of masses is above what the forces of an effect were measured with."""
    ratio = float(state.mass.max() / state.mass.min())
    for name, effect in effects.items():
        if not isinstance(effect, LimitsMassRatio):
            continue
        largest = effect.largest_mass_ratio(effects)
        if ratio > largest * (1 + 1e-6):
            yield (
                f"{name}: the heaviest particle has {ratio:.4g} times the mass of the lightest; up to"
                f" {largest:g} times was measured to gain no energy: take masses that differ less"
            )


def check_places(state: InitialState, bounds: Any, solids: Nodes | None) -> None:
    """Raise InputError for solids outside the walls, or in the liquid."""
    if solids is None:
        return
    from scipy.spatial import cKDTree

    solid = state.position[: len(solids.lattice.key)]
    if bounds is not None:
        outside = np.flatnonzero(((solid < bounds.lower) | (solid > bounds.upper)).any(1))
        if len(outside):
            raise InputError(
                f"scene: [[solid]] number {solids.lattice.body[outside[0]] + 1} reaches outside the walls"
                f" ({len(outside)} of its particles); move it in or make the walls wider."
            )
    liquid = state.position[len(solid) :]
    if len(liquid) and len(solid):
        reach = 0.5 * solids.spacing
        near, _ = cKDTree(solid).query(liquid, distance_upper_bound=reach)
        inside = np.flatnonzero(near < reach * (1 - 1e-6))
        if len(inside):
            raise InputError(
                f"scene: {len(inside)} particles of the fluid are less than half a spacing from a solid's; set"
                " outside = 'bodies' in a box, or leave them out of the fluid."
            )


def check_particles(position: np.ndarray, velocity: np.ndarray, mass: np.ndarray, scene: Scene) -> None:
    for name, values in (("position", position), ("velocity", velocity), ("mass", mass)):
        check_values("scene", name, values, scene.dim, scene.dtype)
    for axis, length in enumerate(scene.period):
        x, low = position[:, axis], scene.period_lower[axis]
        outside = np.flatnonzero((length > 0) & ((x < low) | (x >= low + length)))
        if len(outside):
            raise InputError(
                f"scene: particle {outside[0]} starts at {'xyz'[axis]} = {x[outside[0]]:.6g} m, outside the periodic"
                f" box from {low:g} to {low + length:g} m ({len(outside)} such particles); move it in, or change period"
                " or period_lower."
            )


def check_values(place: str, name: str, values: np.ndarray, dim: int, dtype: str) -> None:
    """Raise InputError, beginning with `place`, for values of a particle field that no scene can have."""
    with np.errstate(over="ignore"):  # reported below
        rounded = values.astype(dtype, copy=False)
        most = LONGEST if name == "position" else GREATEST
        bad = np.flatnonzero(~(np.abs(rounded) <= most).reshape(len(values), -1).all(1))
    if len(bad):
        raise InputError(
            f"{place}: the {name} of particle {bad[0]} is not a finite number, in {dtype} and below"
            f" {most:g} ({len(bad)} such particles); correct the input."
        )
    if name in POSITIVE and (values <= 0).any():
        first = int(np.flatnonzero(values <= 0)[0])
        raise InputError(
            f"{place}: the {name} of particle {first} is {values[first]} {POSITIVE[name]}; give a positive {name}."
        )
    if name in FLAT and dim == 2 and values[:, 2].any():
        first, (z, unit) = int(np.flatnonzero(values[:, 2])[0]), FLAT[name]
        raise InputError(f"{place}: particle {first} has {z} = {values[first, 2]} {unit} in 2D; set {z} to 0.")


def check_coincident(position: np.ndarray, dtype: str, place: str = "scene") -> None:
    from refsim.neighbours import coincident_pairs

    same = coincident_pairs(position.astype(dtype))
    if same:
        a, b = same[0]
        raise InputError(
            f"{place}: particles {a} and {b} are at the same place ({len(same)} such pairs in {dtype});"
            " remove the duplicates or move them apart."
        )
