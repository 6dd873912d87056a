"""The plan that follows from a scene: the union of what its effects need.

Fields, passes in dependency order, one neighbour list.
"""

import dataclasses
import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import msgspec
import numpy as np

from refsim.core.capabilities import BringsWalls, FollowsStart, JudgesStart, effects_with
from refsim.core.checked import plainly
from refsim.core.effect import BASE, POSITION_RESIDUAL, Discretisation, Effect, Field, InitialState, Pass
from refsim.core.errors import InputError
from refsim.core.operation import PROCEDURES, REGISTRY
from refsim.core.period import period_group
from refsim.core.tables import Shown, in_bytes
from refsim.motion import frame_passes
from refsim.scene import checks
from refsim.scene.particles import placed
from refsim.scene.scene import Scene
from refsim.scene.solids import off_the_lattice


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

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
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
        motion = [p.operation for effect, p in self.motion if effect is not None]
        return (*before, *(p.operation for _, p in self.passes if on_demand or not p.on_demand), *motion)

    def all_passes(self) -> tuple[tuple[Effect | None, Pass], ...]:
        """Passes of every stage, in order."""
        return (*self.start, *self.begin, *self.passes, *self.motion)

    @property
    def particle_fields(self) -> dict[str, Field]:
        """Fields with a row for each particle."""
        return {name: f for name, f in self.fields.items() if f.rows is None}

    def is_of_steps(self, name: str) -> bool:
        """Whether only a step writes a field, which does not outlive it."""
        first = any(name in p.written for _, p in self.start)
        in_step = any(name in p.written for _, p in (*self.begin, *self.motion))
        return in_step and not first and not self.fields[name].state

    @property
    def ordered_fields(self) -> tuple[str, ...]:
        """Particle fields whose rows follow a new order of the particles: nothing computes them anew before a step."""
        return tuple(name for name, f in self.particle_fields.items() if f.state or self.is_of_steps(name))

    def bytes_of_fields(self) -> dict[str, int]:
        """Bytes of each field."""
        n, real = self.grid.count, self.grid.dtype
        return {name: math.prod(f.shape(n)) * f.numpy_dtype(real).itemsize for name, f in self.fields.items()}

    def field_bytes(self) -> dict[str, int]:
        """Bytes per particle of each field with a row for each."""
        return {n: b // self.grid.count for n, b in self.bytes_of_fields().items() if n in self.particle_fields}


@plainly
def make_plan(scene: Scene) -> Plan:
    """Check the scene and work out its plan. Raises InputError, with one sentence, for bad input."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            empty, effects = checks.checked(scene)
            grid, state = placed(scene, empty, effects)
            adapted = [effect.with_start_defaults(grid, effects) for effect in effects_with(effects, FollowsStart)]
            if any(effect is not effects[effect.name] for effect in adapted):
                named = {effect.name: effect for effect in (*scene.effects, *adapted)}
                effects = checks.checked(msgspec.structs.replace(scene, effects=tuple(named.values())))[1]
            return _planned(scene, grid, effects, state)
    except (ArithmeticError, OverflowError) as error:
        raise InputError(
            f"scene: its numbers differ by too many orders of magnitude for their products ({error}); check the units."
        ) from None


def _planned(scene: Scene, grid: Discretisation, given: Mapping[str, Effect], absolute: InitialState) -> Plan:
    """The plan of a scene that was checked and whose particles are placed; its effects and state as the user gave them.

    What its effects need comes first, then the values of their fields, then the order of their passes.
    """
    effects = {name: effect.local(grid) for name, effect in given.items()}
    fields = {f.name: f for f in (*BASE, *((POSITION_RESIDUAL,) if scene.dtype == "float32" else ()))}
    period = period_group(scene.period, scene.dtype) if any(scene.period) else None
    shared: dict[str, Any] = {"walls": None, "wall_normal": None, "period": period}
    parameters: dict[str, dict[str, Any]] = {}
    bringing: list[Any] = effects_with(effects, BringsWalls)
    brought = [effect.walls(grid, effects) for effect in bringing]
    walls = [part for part in brought if part is not None]
    ends = np.cumsum([0 if part is None else len(part.volume) for part in brought]).tolist()
    solids = 0 if grid.solids is None else len(grid.solids.lattice.key)
    bodies = max(grid.bodies, default=0) + 1
    rows = {"solids": solids, "walls": sum(len(w.volume) for w in walls), "bodies": bodies}
    for name, effect in effects.items():
        for f in effect.fields(effects):
            fields[f.name] = dataclasses.replace(f, rows=rows[f.rows]) if isinstance(f.rows, str) else f
        shared |= effect.shares(grid, effects)
        parameters[name] = effect.prepare(grid, effects)
    list_radius = max((e.list_radius(grid) for e in effects.values()), default=0.0)
    checks.check_fixed_step(scene, grid, effects)
    checks.check_list(scene, list_radius)

    state = dataclasses.replace(absolute, position=grid.local(absolute.position))
    values = _initial_values(grid, state, effects, fields)
    state = dataclasses.replace(state, mass=values.pop("mass", state.mass), values=values)
    checks.check_places(state, shared.get("bounds"), grid.solids)

    replaced = _replaced(effects)
    every = ((e, p) for e in effects.values() for p in e.passes(effects))
    asked = [(e, with_reads(p, fields)) for e, p in every if p.operation not in replaced - set(e.replaces())]
    for moving in frame_passes(scene.motion, effects):
        asked.append((effects["gravity"], with_reads(moving, fields)))
        shared["turning"] = np.zeros(9, grid.dtype)
    of = {stage: [(e, p) for e, p in asked if p.stage == stage] for stage in ("start", "begin", "forces", "motion")}
    merged = None
    if walls:
        merged = type(walls[0])(*(np.concatenate(parts) for parts in zip(*walls)))
        merged = merged._replace(position=grid.absolute(merged.position))
        if any(effect.extrapolates() for effect in bringing):
            across = [e.normals(grid, part.position) for e, part in zip(bringing, brought) if part is not None]
            shared["wall_normal"] = np.concatenate(across).astype(grid.dtype)
    passes = ordered_passes(merged_passes(of["forces"], parameters)), motion_passes(of["motion"])
    judging = effects_with(effects, JudgesStart)
    notes = (
        *checks.few_neighbours(grid, effects),
        *checks.coarse_places(grid, state),
        *checks.crowded(grid, state, merged, scene, effects),
        *checks.unequal_masses(state, effects),
        *(note for e in judging for note in e.notes_on_start(grid, state, merged, effects)),
        *(() if grid.solids is None else off_the_lattice(grid.solids)),
        *(f"[[solid]] number {k}: {note}" for k, body in enumerate(scene.solid, 1) for note in body.notes()),
        *(note for e in effects.values() for note in e.notes(grid, effects)),
    )
    stages = tuple(of["start"]), tuple(of["begin"]), *passes
    wall_rows = dict(zip((effect.name for effect in bringing), zip([0, *ends], ends)))
    state = dataclasses.replace(state, position=absolute.position)
    prepared: dict[str, Any] = {"list_radius": list_radius, "shared": shared, "parameters": parameters}
    prepared |= {"walls": merged, "wall_rows": wall_rows, "notes": notes}
    return Plan(scene, grid, given, state, fields, *stages, **prepared)


def _replaced(effects: Mapping[str, Effect]) -> frozenset[str]:
    """Operations in whose place an effect puts its own. Raises InputError where two effects replace one."""
    owner: dict[str, str] = {}
    for name, effect in effects.items():
        for operation in effect.replaces():
            if operation in owner:
                both = f"{owner[operation]!r} and {name!r}"
                raise InputError(f"Effects {both} take the place of {operation!r}; keep one.")
            owner[operation] = name
    return frozenset(owner)


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


# The order of the passes


Owner = TypeVar("Owner")


def motion_passes(asked: Sequence[tuple[Effect, Pass]]) -> tuple[tuple[Effect | None, Pass], ...]:
    """Passes once the step's length is known, ordered by what they touch, the integrator last.

    Raises InputError where there are two integrators.
    """
    moving = [(e, p) for e, p in asked if "position" in p.updates]
    if len({e.name for e, _ in moving}) > 1:
        raise InputError(
            f"Effects {' and '.join(sorted({repr(e.name) for e, _ in moving}))} would both move the particles; keep"
            " one of them."
        )
    last: list[tuple[Effect | None, Pass]] = list(moving)
    if not moving:
        last = [(None, Pass("sph.kick_drift", updates=("velocity", "position"), stage="motion"))]
    return (*ordered_passes([(e, p) for e, p in asked if "position" not in p.updates]), *last)


def with_reads(p: Pass, fields: Container[str]) -> Pass:
    """A pass that names no reads with the fields that its operation's reference takes and that it does not write."""
    if p.reads or p.operation not in REGISTRY:
        return p
    taken = dict.fromkeys(p.names.get(name, name) for name in REGISTRY[p.operation].arguments("numpy"))
    reads = tuple(name for name in taken if name is not None and name in fields and name not in p.written)
    return dataclasses.replace(p, reads=reads)


def merged_passes(
    passes: Sequence[tuple[Effect, Pass]], parameters: Mapping[str, Mapping[str, Any]]
) -> list[tuple[Effect, Pass]]:
    """Passes with one launch for equal passes of two effects; it is on demand only if both effects take it on demand.

    A pass over every row also serves an effect that needs it for its `candidates` only. Raises InputError if two
    effects would write one field differently.
    """
    kept: list[tuple[Effect, Pass]] = []
    for effect, p in passes:
        rivals = [k for k, (_, q) in enumerate(kept) if set(p.writes) & set(q.writes)]
        for k in rivals:
            other, q = kept[k]
            if not _same_but_candidates(effect, p, other, q, parameters):
                field_name = sorted(set(p.writes) & set(q.writes))[0]
                raise InputError(
                    f"Effects {other.name!r} and {effect.name!r} compute field {field_name!r} in different ways; give"
                    " them the same settings or remove one."
                )
            first, second = q.names.get("candidates"), p.names.get("candidates")
            names = {**q.names, **p.names}
            if first != second:
                names["candidates"] = None
            reads = tuple(dict.fromkeys(q.reads + p.reads))
            kept[k] = (other, dataclasses.replace(q, reads=reads, names=names, on_demand=q.on_demand and p.on_demand))
        if not rivals:
            kept.append((effect, p))
    return kept


def _same_but_candidates(
    effect: Effect, p: Pass, other: Effect, q: Pass, parameters: Mapping[str, Mapping[str, Any]]
) -> bool:
    def names_of(p: Pass) -> dict[str, str | None]:
        return {name: field_name for name, field_name in p.names.items() if name != "candidates"}

    if (p.operation, p.writes, p.updates, names_of(p)) != (q.operation, q.writes, q.updates, names_of(q)):
        return False
    names = {p.names.get(name, name) or "" for name in REGISTRY[p.operation].arguments("numpy")}
    ours, its = parameters[effect.name], parameters[other.name]
    return all(_same(ours.get(name), its.get(name)) for name in names)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return type(a) is type(b) and bool(np.array_equal(a, b))


def ordered_passes(passes: Sequence[tuple[Owner, Pass]]) -> tuple[tuple[Owner, Pass], ...]:
    """Passes, each with its owner, so that every field is written, then updated, then read; else in the same order."""
    for _, p in passes:
        if p.operation not in REGISTRY and p.operation not in PROCEDURES:
            raise InputError(f"A pass names operation {p.operation!r}, which is not registered.")
    after: list[set[int]] = [set() for _ in passes]
    for k, (_, p) in enumerate(passes):
        for j, (_, q) in enumerate(passes):
            written_first = {*p.reads, *p.updates} & {*q.writes}
            if j != k and (written_first or ({*p.reads} - {*p.updates}) & {*q.updates}):
                after[k].add(j)
    done: list[int] = []
    waiting = list(range(len(passes)))
    while waiting:
        ready = next((k for k in waiting if after[k] <= set(done)), None)
        if ready is None:
            names = ", ".join(passes[k][1].operation for k in waiting)
            raise InputError(f"scene: the passes {names} wait for each other; one effect must not need the other.")
        done.append(ready)
        waiting.remove(ready)
    return tuple(passes[k] for k in done)
