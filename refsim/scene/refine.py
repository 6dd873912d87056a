"""The same scene at another spacing, or without an effect: what changes with it, and what must not."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

from refsim.core.capabilities import with_scene_defaults
from refsim.core.checked import suggestion
from refsim.core.effect import Discretisation, Effect, Extremes
from refsim.core.errors import InputError
from refsim.scene.files import place_of, scene_from_dict, scene_to_dict
from refsim.scene.particles import lattice_mass, solid_volume
from refsim.scene.scene import Scene
from refsim.scene.shapes import Ball, Box, Cloud
from refsim.scene.solids import Solid, SolidBox, SolidCells, body_cells

RATIO = 1.5  # of the spacings of two levels
WIDEST = 1.15  # by which a level's ratio may differ from the one that was chosen, so that edges consist of whole cells
LARGEST_MISFIT = 0.03  # share of an edge by which a box may differ from the scene's
EXACT = 1e-9


def refined(scene: Scene, factor: float, with_spacing: Sequence[str] = ()) -> Scene:
    """The scene with the spacing divided by `factor` and the same bodies, walls and times.

    Divided by `factor`: spacing, support radius, the lengths that an effect names in `with_spacing`, and the parameters
    named here (such as effects.weakly_compressible.dynamic_viscosity, where it is an artificial one). Multiplied by
    it: the cells of boxes, rounded; their particles fill the same edges. All parts keep their mass. A fixed step is
    divided by `factor`, or by more where the stable step of particles at rest falls faster. What is counted in cells
    (half_width of shape_matching, radii of surface_energy) stays.

    Raises InputError for particles or cells that are given one by one.
    """
    for kind, parts in (("fluid", scene.fluid), ("solid", scene.solid)):
        for number, part in enumerate(parts, 1):
            if isinstance(part, Cloud | SolidCells):
                what = "particles" if isinstance(part, Cloud) else "cells"
                raise InputError(
                    f"{scene.name}: it has no other spacing, because [[{kind}]] number {number} gives its {what} one by"
                    " one; describe it by boxes and balls."
                )
    if factor == 1:
        return scene
    spacing, support_radius = scene.spacing / factor, scene.support_radius / factor
    step = scene.step / factor
    if step > 0:
        rest = resting_step(scene, scene.spacing, scene.support_radius)
        stable = resting_step(scene, spacing, support_radius)
        step = min(step, scene.step * stable / rest) if math.isfinite(rest) else step
    fluid, solid = _with_masses(scene)
    parts = tuple(_box(part, factor, scene) if isinstance(part, Box) else part for part in fluid)
    effects = tuple(_effect(effect, factor) for effect in scene.effects)
    finer = msgspec.structs.replace(
        scene, spacing=spacing, support_radius=support_radius, step=step, fluid=parts, solid=solid, effects=effects
    )
    return _scaled(finer, factor, with_spacing) if with_spacing else finer


def _scaled(scene: Scene, factor: float, names: Sequence[str]) -> Scene:
    """The scene with these parameters divided by `factor`."""
    tables = scene_to_dict(scene)
    for name in names:
        place, last = place_of(tables, name, scene.name)
        if last not in place:
            raise InputError(f"{scene.name}: the scene has no parameter {name!r}; {suggestion(last, list(place))}")
        if not isinstance(place[last], float | int):
            raise InputError(f"{scene.name}: {name!r} is no number that could be in proportion to the spacing.")
        place[last] /= factor
    return scene_from_dict(tables, scene.name)


def without(scene: Scene, name: str) -> Scene:
    """The scene without an effect; what other effects choose by the scene stays as the whole scene has it.

    So the density of the liquid and the model of walls are the same with and without a tension.
    """
    return msgspec.structs.replace(
        scene, effects=tuple(e for e in with_scene_defaults(scene.effects).values() if e.name != name)
    )


def _with_masses(scene: Scene) -> tuple[tuple, tuple]:
    """The scene's parts of fluid, and its solids; those cut from the lattice with the mass that they have there."""
    grid = Discretisation(scene.dim, scene.dtype, scene.spacing, scene.support_radius, 0)
    effects = with_scene_defaults(scene.effects)

    def of_fluid(part: Any) -> Any:
        if not isinstance(part, Ball) or part.mass is not None:
            return part
        mass = len(part.positions(grid)) * lattice_mass(grid, effects)
        return msgspec.structs.replace(part, mass=mass or None)

    def of_solid(number: int, body: Solid) -> Any:
        if body.mass is not None:
            return body
        cells = len(body_cells(body, f"[[solid]] number {number}", grid))
        return msgspec.structs.replace(body, mass=cells * body.density * solid_volume(grid, effects))

    return tuple(map(of_fluid, scene.fluid)), tuple(of_solid(k, body) for k, body in enumerate(scene.solid, 1))


def _box(box: Box, factor: float, scene: Scene) -> Box:
    """The box with other cells and the same edges."""
    if box.cells is None:
        return box
    cells = [max(1, round(n * factor)) for n in box.cells[: scene.dim]]
    edges = box.size or tuple(n * scene.spacing for n in box.cells)
    exact = max(abs(now / (n * factor) - 1) for n, now in zip(box.cells, cells)) < EXACT
    size = box.size if exact else (*edges[: scene.dim], scene.spacing)[:3]
    return msgspec.structs.replace(box, cells=(*cells, 1)[:3], size=size)


def _effect(effect: Effect, factor: float) -> Effect:
    lengths = {name: getattr(effect, name) for name in effect.with_spacing}
    return msgspec.structs.replace(effect, **{name: value / factor for name, value in lengths.items() if value})


def resting_step(scene: Scene, spacing: float, support_radius: float) -> float:
    """Largest stable step [s] of particles at rest; infinite where nothing limits it."""
    factor = scene.spacing / spacing
    grid = Discretisation(scene.dim, scene.dtype, spacing, support_radius, 0, 0.0)
    effects = with_scene_defaults(_effect(effect, factor).in_scene(grid) for effect in scene.effects)
    limits = (limit for effect in effects.values() for limit in effect.step_limits(grid, effects).values())
    return min((limit.at(Extremes(0.0, 0.0)) for limit in limits), default=math.inf)


def spaced(scene: Scene, count: int, finer: int, ratio: float = RATIO) -> tuple[float, ...]:
    """Factors of `refined`, from the coarsest to the finest: `finer` of them are above 1, and 1 is one of them.

    Each is near a power of `ratio`, chosen so that the boxes keep their edges. Raises InputError where none does.
    """
    if count < 1 or not 0 <= finer < count:
        raise InputError(f"levels = {count} with {finer} of them finer is not possible; give at least one, and fewer.")
    if not 1.1 <= ratio <= 4:
        raise InputError(f"ratio = {ratio:g} of two spacings is not possible; give 1.1 to 4.")
    factors: dict[int, float] = {0: 1.0}
    for k in (*range(1, finer + 1), *range(-1, finer - count, -1)):
        wanted = factors[k - 1 if k > 0 else k + 1] * ratio ** math.copysign(1, k)
        factors[k] = best = fitting(scene, wanted)
        if misfit(scene, best) > LARGEST_MISFIT:
            raise InputError(
                f"{scene.name}: its boxes have no spacing near {scene.spacing / wanted:.3g} m at which they keep their"
                f" edges within {100 * LARGEST_MISFIT:g} % (the best, {scene.spacing / best:.3g} m, changes one by"
                f" {100 * misfit(scene, best):.2g} %); give the boxes numbers of cells with a common divisor, or"
                " another ratio of the spacings."
            )
    return tuple(factors[k] for k in sorted(factors))


def fitting(scene: Scene, wanted: float) -> float:
    """The factor near `wanted` at which the boxes keep their edges best. Raises InputError as `refined` does."""
    edges = sorted({n for n, _ in _edges(scene, 1.0)})
    least, most = wanted / WIDEST, wanted * WIDEST
    candidates = {m / n for n in edges for m in range(math.ceil(least * n), math.floor(most * n) + 1)} or {wanted}
    refined(scene, 1.0)

    def worse(factor: float) -> tuple[float, float]:
        off = misfit(scene, factor)
        return 0.0 if off < EXACT else round(off, 3), abs(math.log(factor / wanted))

    return min(candidates, key=worse)


def misfit(scene: Scene, factor: float) -> float:
    """Largest relative change of a box's edge at this factor."""
    return max((abs(now / (before * factor) - 1) for before, now in _edges(scene, factor)), default=0.0)


def _edges(scene: Scene, factor: float) -> Iterator[tuple[int, int]]:
    """Particles along each edge of each box: in the scene, and with the spacing divided by `factor`."""
    for part in (*scene.fluid, *scene.solid):
        if isinstance(part, Box):
            cells = part.counts(scene.dim, scene.spacing)[: scene.dim]
            yield from ((n, max(1, round(n * factor))) for n in cells)
        if isinstance(part, SolidBox):
            for low, high in zip(part.lower[: scene.dim], part.upper):
                yield _cells(low, high, scene.spacing), _cells(low, high, scene.spacing / factor)


def _cells(low: float, high: float, spacing: float) -> int:
    """Cells of the lattice whose centres lie between two planes [m]; at least one."""
    return max(1, math.ceil(high / spacing - 0.5 - EXACT) - math.floor(low / spacing - 0.5 + EXACT) - 1)


def notes(scene: Scene, factors: Sequence[float]) -> list[str]:
    """What a reader of the levels should know, one sentence each."""
    said = []
    for factor in factors:
        off = misfit(scene, factor)
        if off >= EXACT:
            said.append(
                f"at a spacing of {scene.spacing / factor:.4g} m the edges of a box are no whole cells: its particles"
                f" stand up to {100 * off:.2g} % closer or farther apart along one of them"
            )
    if any(isinstance(part, Ball) for part in scene.fluid) or scene.solid:
        said.append(
            "balls and solids keep the mass that they have in the scene, cut from its lattice: a ball's particles stand"
            " closer or farther apart for that, a solid's are lighter or heavier"
        )
    for effect in scene.effects:
        if getattr(effect, "surface_tension", 0.0) is None:
            said.append(
                f"{effect.name} has its own coefficients, whose tension may depend on the spacing; give surface_tension"
                " [N/m], so that all levels have the same"
            )
        if effect.name == "shape_matching":
            said.append("shape_matching's half_width is a number of cells and stays: finer bodies are softer")
    return said
