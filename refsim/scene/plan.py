"""The plan that follows from a scene: the union of what its effects need.

Fields, passes in dependency order, one neighbour list.
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim.core.capabilities import BringsWalls, JudgesStart, NeedsCellOrder, having, settled
from refsim.core.effect import EFFECTS, Discretisation, Effect, InitialState, Pass
from refsim.core.errors import InputError
from refsim.core.fields import BASE, POSITION_RESIDUAL, Field
from refsim.core.period import period_group
from refsim.core.tables import Shown, in_bytes
from refsim.gauges.places import check_gauges
from refsim.motion import check_motions, turning_pass
from refsim.scene import checks
from refsim.scene.particles import initial_state
from refsim.scene.passes import accounts, merged_passes, motion_passes, ordered_passes
from refsim.scene.scene import Scene
from refsim.scene.shapes import Vector
from refsim.scene.solids import moved, voxelised

FINE = 1e-5  # [spacings] with a resolution of positions as fine as this a scene keeps its origin
FAR = 4.0  # times nearer must an origin of its own be to its farthest particle


@dataclass(frozen=True, repr=False)
class Plan(Shown):
    """What a scene needs: the fields, passes and lists of its effects and no others.

    Scene, effects, state and walls are where the user has placed them; what passes take (`shared`, `parameters`, and
    the fields of a run) is relative to `grid.origin`.

    start   once, when a simulation is made or resumed
    begin   at the beginning of every step, in order
    passes  forces, in order: before the step's length is known
    wall_rows  first row in `walls` of each effect that brings wall particles, and the row after its last
    motion  in order, once it is known; the leap-frog, which belongs to no effect, unless one brings another
    """

    scene: Scene
    grid: Discretisation
    effects: Mapping[str, Effect]
    state: InitialState
    fields: Mapping[str, Field]
    start: tuple[tuple[Effect, Pass], ...]
    begin: tuple[tuple[Effect, Pass], ...]
    passes: tuple[tuple[Effect, Pass], ...]
    motion: tuple[tuple[Effect | None, Pass], ...]
    list_radius: float
    shared: Mapping[str, Any]
    parameters: Mapping[str, Mapping[str, Any]]
    walls: Any = None
    wall_rows: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    notes: tuple[str, ...] = field(default_factory=tuple)

    def _facts(self) -> tuple[str, list[tuple[str, str]]]:
        return f"Plan of {self.scene.name!r}", [
            ("particles", f"{self.grid.count:,} in {self.grid.dim}D, {self.grid.dtype}"),
            ("spacing", f"{self.grid.spacing:g} m, support radius {self.grid.support_radius:g} m"),
            ("effects", ", ".join(self.effects) or "none"),
            ("fields", f"{len(self.fields)}, {in_bytes(sum(self.bytes_of_fields().values()))}"),
            ("operations in a step", str(len(self.launches()))),
            ("notes", "; ".join(self.notes) or "none"),
        ]

    def launches(self, on_demand: bool = False) -> tuple[str, ...]:
        """Names of the operations that one step launches, in order."""
        before = [p.operation for _, p in self.begin]
        own = [p.operation for effect, p in self.motion if effect is not None]
        return (*before, *(p.operation for _, p in self.passes if on_demand or not p.on_demand), *own)

    def all_passes(self) -> tuple[tuple[Effect | None, Pass], ...]:
        """Passes of every stage, in order."""
        return (*self.start, *self.begin, *self.passes, *self.motion)

    @property
    def particle_fields(self) -> dict[str, Field]:
        """Fields with a row for each particle."""
        return {name: f for name, f in self.fields.items() if f.rows is None}

    def bytes_of_fields(self) -> dict[str, int]:
        """Bytes of each field."""
        n, real = self.grid.count, self.grid.dtype
        return {name: math.prod(f.shape(n)) * f.numpy_dtype(real).itemsize for name, f in self.fields.items()}

    def field_bytes(self) -> dict[str, int]:
        """Bytes per particle of each field with a row for each."""
        return {n: b // self.grid.count for n, b in self.bytes_of_fields().items() if n in self.particle_fields}


def make_plan(scene: Scene) -> Plan:
    """Check the scene and work out its plan. Raises InputError, with one sentence, for bad input."""
    checks.check_numbers(scene)
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            return _planned(scene)
    except (ArithmeticError, OverflowError) as error:
        raise InputError(
            f"scene: its numbers differ by too many orders of magnitude for their products ({error}); check the units."
        ) from None


def _planned(scene: Scene) -> Plan:
    effects = _effects(scene)
    checks.check_periodic(scene, effects)
    empty = Discretisation(
        scene.dim, scene.dtype, scene.spacing, scene.support_radius, 0, scene.step, None, scene.period,
        scene.period_lower,
    )  # fmt: skip
    postponed = []
    for effect in effects.values():  # before the particles, whose masses follow from the effects
        try:
            effect.check(empty, effects)
        except InputError:
            raise
        except Exception:  # it may read an effect whose own check, which comes later, says what is wrong
            postponed.append(effect)
    for effect in postponed:
        effect.check(empty, effects)
    check_gauges(scene.gauge, len(scene.solid), empty, effects)
    check_motions(scene.motion, scene.end_time, scene.energy_audit is not None, empty, effects)
    solids = voxelised(scene.solid, empty) if scene.solid else None
    absolute = initial_state(scene, empty, effects, solids)
    given, grid = (
        effects,
        _placed(dataclasses.replace(empty, count=len(absolute.position), solids=solids), absolute, effects),
    )
    solids, effects = grid.solids, {name: effect.local(grid) for name, effect in given.items()}
    state = dataclasses.replace(absolute, position=grid.local(absolute.position))
    checks.check_coincident(state.position, scene.dtype)
    fields = {f.name: f for f in (*BASE, *((POSITION_RESIDUAL,) if scene.dtype == "float32" else ()))}
    shared: dict[str, Any] = {"walls": None, "period": None}
    if any(scene.period):
        shared["period"] = period_group(scene.period, scene.dtype)
    parameters = {}
    bringing: list[Any] = having(effects, BringsWalls)
    made = [effect.walls(grid, effects) for effect in bringing]
    walls = [part for part in made if part is not None]
    ends = np.cumsum([0 if part is None else len(part.volume) for part in made]).tolist()
    rows = {"solids": 0 if solids is None else len(solids.lattice.key), "walls": sum(len(w.volume) for w in walls)}
    for name, effect in effects.items():
        fields |= {f.name: _counted(f, rows) for f in effect.fields(effects)}
        shared |= effect.shares(grid, effects)
        parameters[name] = effect.prepare(grid, effects)
    if scene.energy_audit is not None:
        accounts(grid, effects)
    checks.check_fixed_step(scene, grid, effects)
    values = _initial_values(grid, state, effects, fields)
    state = dataclasses.replace(state, mass=values.pop("mass", state.mass), values=values)
    checks.check_places(state, shared.get("bounds"), solids)
    replaced = _replaced(effects)
    asked = [
        (e, p) for e in effects.values() for p in e.passes(effects) if p.operation not in replaced - set(e.replaces())
    ]
    for turn in turning_pass(scene.motion):
        asked.append((effects["gravity"], turn))
        parameters["gravity"] = {**parameters["gravity"], "turning": np.zeros(9, grid.dtype)}
    passes = ordered_passes(merged_passes([(e, p) for e, p in asked if p.stage == "forces"], parameters), fields)
    list_radius = max((e.list_radius(grid) for e in effects.values()), default=0.0)
    if list_radius > scene.support_radius:
        checks.check_neighbours(scene, "the radius of the neighbour list", list_radius)
    for axis, length in zip("xyz", scene.period):
        if 0 < length <= 2 * list_radius * (1 + scene.skin):
            raise InputError(
                f"scene: period = {length:g} m along {axis} is at most twice the {list_radius * (1 + scene.skin):.3g} m"
                " up to which the neighbour list reaches, so that two images of one particle would be neighbours; give"
                " a longer one."
            )
    merged = None
    if walls:
        merged = type(walls[0])(*(np.concatenate(parts) for parts in zip(*walls)))
        merged = merged._replace(position=grid.absolute(merged.position))
    return Plan(
        scene=scene,
        grid=grid,
        effects=given,
        state=dataclasses.replace(state, position=absolute.position),
        fields=fields,
        start=tuple((e, p) for e, p in asked if p.stage == "start"),
        begin=tuple((e, p) for e, p in asked if p.stage == "begin"),
        passes=passes,
        motion=motion_passes([(e, p) for e, p in asked if p.stage == "motion"], fields),
        list_radius=list_radius,
        shared=shared,
        parameters=parameters,
        walls=merged,
        wall_rows=dict(zip((effect.name for effect in bringing), zip([0, *ends], ends))),
        notes=(
            *checks.coarse_places(grid, state),
            *checks.unequal_masses(state, effects),
            *(note for e in having(effects, JudgesStart) for note in e.notes_on_start(grid, state, merged, effects)),
            *(f"[[solid]] number {k}: {note}" for k, body in enumerate(scene.solid, 1) for note in body.notes()),
            *(note for e in effects.values() for note in e.notes(grid, effects)),
        ),
    )


def _replaced(effects: Mapping[str, Effect]) -> frozenset[str]:
    """Operations in whose place an effect puts its own. Raises InputError where two effects replace one."""
    owner: dict[str, str] = {}
    for name, effect in effects.items():
        for operation in effect.replaces():
            if operation in owner:
                raise InputError(
                    f"Effects {owner[operation]!r} and {name!r} take the place of {operation!r}; keep one."
                )
            owner[operation] = name
    return frozenset(owner)


def _placed(grid: Discretisation, state: InitialState, effects: Mapping[str, Effect]) -> Discretisation:
    """The grid with its origin amid the particles, where they are far from the scene's compared with their extent.

    The origin is a whole number of spacings away, or of an effect's cells; solids and period are relative to it.
    """
    cell = max((e.sorting_cell(grid) for e in having(effects, NeedsCellOrder)), default=0.0)
    unit = cell if cell > 0 and grid.solids is None else grid.spacing
    middle = unit * np.rint(0.5 * (state.position.min(0) + state.position.max(0)) / unit) + 0.0  # no -0
    farthest, nearer = np.abs(state.position).max(), np.abs(state.position - middle).max()
    if checks.resolved(state.position, grid) <= FINE or farthest < FAR * nearer:
        return grid
    solids = grid.solids
    if solids is not None:
        solids = moved(solids, np.rint(middle / unit).astype(np.int32))
    origin: Vector = tuple(middle.tolist())
    lower: Vector = tuple((grid.period_lower - middle).tolist())
    return dataclasses.replace(grid, origin=origin, period_lower=lower, solids=solids)


def _effects(scene: Scene) -> dict[str, Effect]:
    effects: dict[str, Effect] = {}
    for effect in scene.effects:
        if not isinstance(effect, Effect):
            raise InputError(f"scene: {effect!r} is not an effect; choose from {', '.join(sorted(EFFECTS))}.")
        if effect.name in effects:
            raise InputError(f"scene: effect {effect.name!r} is listed twice; keep one.")
        effects[effect.name] = effect
    for effect in effects.values():
        for needed in effect.needs():
            if needed not in effects:
                raise InputError(f"Effect {effect.name!r} needs effect {needed!r}; add it to the scene.")
    return settled(effects.values())


def _counted(f: Field, rows: Mapping[str, int]) -> Field:
    """A field whose rows are counted, where it is a table of the nodes of solids or of the wall particles."""
    return dataclasses.replace(f, rows=rows[f.rows]) if isinstance(f.rows, str) else f


def _initial_values(
    grid: Discretisation, state: InitialState, effects: Mapping[str, Effect], fields: Mapping[str, Field]
) -> dict[str, np.ndarray]:
    """What the effects give their state fields, checked against the fields' shapes."""
    values = {}
    for effect in effects.values():
        for name, value in effect.initial(grid, state, effects).items():
            value = np.asarray(value)
            if name not in fields or not fields[name].state:
                raise ValueError(f"effect {effect.name!r} sets {name!r}, which is none of its state fields")
            if value.shape != fields[name].shape(grid.count):
                raise ValueError(f"effect {effect.name!r} gives {name!r} the shape {value.shape}")
            with np.errstate(over="ignore"):  # reported here
                rounded = value.astype(fields[name].numpy_dtype(grid.dtype))
            if rounded.dtype.kind == "f" and not np.isfinite(rounded).all():
                raise InputError(f"{effect.name}: the {name} of a particle is not finite in {grid.dtype}; correct it.")
            values[name] = value
    return values
