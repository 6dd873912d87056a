"""A scene: particles and a list of effects; and the plan that follows from it.

The plan is the union of what the effects need: fields, passes in dependency order, one neighbour list.
"""

from __future__ import annotations

import dataclasses
import io
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import msgspec
import numpy as np

from refsim.core.capabilities import (
    BringsWalls,
    JudgesStart,
    KnowsParticleMass,
    LimitsMassRatio,
    NeedsCellOrder,
    having,
)
from refsim.core.checked import Checked, suggestion
from refsim.core.effect import EFFECTS, Discretisation, Effect, Extremes, InitialState, Nodes, Pass, require
from refsim.core.energy import EnergyAudit
from refsim.core.errors import InputError
from refsim.core.fields import BASE, POSITION_RESIDUAL, Field
from refsim.core.operation import PROCEDURES, REGISTRY
from refsim.core.period import period_group
from refsim.core.reading import GREATEST, open_regular
from refsim.core.tables import html_table, in_bytes, table
from refsim.neighbours import MOST_NEIGHBOURS
from refsim.scene.accounts import accounts
from refsim.scene.solids import SolidBall, SolidBox, SolidCells, SolidMesh, SolidTorus, countable, moved, voxelised

Vector = tuple[float, float, float]

COARSE = 1e-4  # [spacings] a coarser resolution of positions gives a note: accelerations are off by twice that share
FINE = 1e-5  # [spacings] with a resolution of positions as fine as this a scene keeps its origin
FAR = 4.0  # times nearer must an origin of its own be to its farthest particle
LEAST = 1e-30  # smallest length [m] and time [s] that a scene may have
SMALLEST = 1e-100  # magnitude of any other number that is not zero
WIDEST_SHARE = 3.0  # factor by which a part's mass may differ from that of its lattice: bodies of a few cells
LONGEST_FIXED = 1.6  # stable steps that a fixed step may span; longer ones gained energy without diverging in tests


class Box(Checked, tag="box", tag_field="shape", frozen=True, kw_only=True):
    """Lattice block of `cells` particles per axis, each in the middle of its cell.

    lower     corner of the block [m]
    cells     particles along x, y and z (1 along z in 2D)
    velocity  of every particle [m/s]
    """

    lower: Vector = (0.0, 0.0, 0.0)
    cells: tuple[int, int, int]
    velocity: Vector = (0.0, 0.0, 0.0)

    def positions(self, grid: Discretisation) -> np.ndarray:
        """Positions (n, 3) [m]."""
        if min(self.cells) < 1 or (grid.dim == 2 and self.cells[2] != 1):
            raise InputError(
                f"fluid box: cells = {list(self.cells)} is not possible in {grid.dim}D; give at least 1 along each"
                " axis, and 1 along z in 2D."
            )
        countable(f"fluid box: cells = {list(self.cells)}", self.cells)
        axes = [(np.arange(n) + 0.5) * grid.spacing + low for n, low in zip(self.cells, self.lower)]
        if grid.dim == 2:
            axes[2] = np.zeros(1)
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


class Ball(Checked, tag="ball", tag_field="shape", frozen=True, kw_only=True):
    """Ball (disc in 2D) cut out of the lattice.

    center    [m]
    radius    [m]
    velocity  of every particle [m/s]
    mass      of the whole ball [kg; kg/m in 2D]; the distances of its particles follow, so that its density stays. Left
              out, each particle has the mass of the fluid's lattice
    """

    center: Vector = (0.0, 0.0, 0.0)
    radius: float
    velocity: Vector = (0.0, 0.0, 0.0)
    mass: float | None = None

    def positions(self, grid: Discretisation) -> np.ndarray:
        """Positions (n, 3) [m]."""
        require("fluid ball", radius=(self.radius, "positive"))
        reach = math.ceil(self.radius / grid.spacing) + 1
        countable(f"fluid ball: a radius of {self.radius} m at a spacing of {grid.spacing} m", [2 * reach] * grid.dim)
        steps = (np.arange(-reach, reach) + 0.5) * grid.spacing
        axes = [steps, steps, steps if grid.dim == 3 else np.zeros(1)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        return points[(points**2).sum(1) <= self.radius**2] + np.array(self.center)


class Cloud(Checked, tag="cloud", tag_field="shape", frozen=True, kw_only=True):
    """Particles given one by one.

    position  (n, 3) or (n, 2) coordinates [m]; from TOML a list of lists
    file      instead of `position`: a .npy file or a text file with one particle a line (comma separated)
    velocity  one for all [m/s], or (n, 3)
    mass      (n,) [kg; kg/m in 2D]; left out, the fluid's lattice mass
    """

    position: Any = None
    file: str = ""
    velocity: Any = (0.0, 0.0, 0.0)
    mass: Any = None

    def positions(self, grid: Discretisation) -> np.ndarray:
        """Positions (n, 3) [m]."""
        values = self.position
        if (values is None) == (not self.file):
            raise InputError("fluid cloud: positions must be given exactly once; give either position or file.")
        if self.file:
            try:
                with open_regular(self.file) as file, warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # an empty file is reported below
                    if self.file.endswith(".npy"):
                        values = np.lib.format.open_memmap(self.file, "r")  # which compares shape and size before
                    else:
                        with io.TextIOWrapper(file, encoding="utf-8") as lines:
                            values = np.loadtxt(lines, delimiter=",", ndmin=2)
            except OSError as error:
                why = error.strerror or error
                raise InputError(f"fluid cloud: cannot read {self.file!r} ({why}); give a readable file.") from None
            except Exception as error:  # a damaged header of a .npy file is parsed as Python, with any of its errors
                raise InputError(
                    f"fluid cloud: cannot read positions from {self.file!r} ({error}); give a .npy file or one line of"
                    " comma-separated numbers for each particle."
                ) from None
        try:
            points = _numbers(values)
        except (TypeError, ValueError):
            raise InputError("fluid cloud: position must be a list of coordinates; give (n, 3) numbers.") from None
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise InputError(
                f"fluid cloud: position has shape {points.shape}; give one row of 2 or 3 numbers for each particle."
            )
        if points.shape[1] == 2:
            points = np.hstack([points, np.zeros((len(points), 1))])
        return points


class Scene(Checked, frozen=True, kw_only=True):
    """Everything a run needs, in SI units.

    spacing         initial particle distance d [m]
    support_radius  radius h beyond which the smoothing kernels vanish [m]; at least one spacing
    fluid           boxes, balls and clouds of particles
    solid           boxes, balls, tori, meshes and cells that become bodies of particles; they come before the fluid's
    effects         what acts on them
    dim             2 (z = 0, masses per metre of depth) or 3
    dtype           "float32" or "float64"
    end_time        where `refsim run` stops [s]
    step            fixed step [s]; 0 lets the stable step decide
    step_factor     share of the stable step that is taken
    skin            share of the support radius by which the neighbour list reaches further
    period          lengths of a periodic box along x, y and z [m]; 0 along axes without a period
    period_lower    lower corner of that box [m]
    energy_audit    how often the energy is audited, and by how much it may grow; none by default
    name            title in reports
    """

    spacing: float
    support_radius: float
    fluid: tuple[Box | Ball | Cloud, ...]
    solid: tuple[SolidBox | SolidBall | SolidTorus | SolidMesh | SolidCells, ...] = ()
    effects: tuple[Any, ...] = ()
    dim: Literal[2, 3] = 3
    dtype: Literal["float32", "float64"] = "float32"
    end_time: float = 1.0
    step: float = 0.0
    step_factor: float = 1.0
    skin: float = 0.1
    period: Vector = (0.0, 0.0, 0.0)
    period_lower: Vector = (0.0, 0.0, 0.0)
    energy_audit: EnergyAudit | None = None
    name: str = "scene"

    def with_(self, **changes: Any) -> Scene:
        """This scene with other values, which are checked like those of a new one.

        changes  by name: a field of the scene, `spacing=0.01`; a parameter of an effect,
                 `gravity__acceleration=(0.0, -1.6, 0.0)`; of a part, counted from 0, `fluid__0__radius=0.1`;
                 `energy_audit__every=10`

        Raises InputError where there is no such field, effect, part or parameter.
        """
        values: dict[str, Any] = {name: getattr(self, name) for name in ("fluid", "solid", "effects")}
        for path, value in changes.items():
            place, _, inner = path.partition("__")
            if not inner:
                values[_known(path, place, [*self.__struct_fields__, *(f"{e.name}__" for e in self.effects)])] = value
            elif place == "energy_audit":
                audit = values.get(place, self.energy_audit) or EnergyAudit()
                values[place] = _changed(path, audit, inner, value)
            elif place in ("fluid", "solid"):
                number, _, name = inner.partition("__")
                parts = list(values[place])
                k = int(_known(path, number, [str(k) for k in range(len(parts))]))
                parts[k] = _changed(path, parts[k], name, value)
                values[place] = tuple(parts)
            else:
                effects = list(values["effects"])
                names = [effect.name for effect in effects]
                k = names.index(_known(path, place, names))
                effects[k] = _changed(path, effects[k], inner, value)
                values["effects"] = tuple(effects)
        return msgspec.structs.replace(self, **values)


def _known(path: str, name: str, names: Sequence[str]) -> str:
    """`name` if it is one of `names`. Raises InputError otherwise."""
    if name not in names:
        hint = suggestion(name, names) if names else "there are none."
        raise InputError(f"with_({path}=...): this scene has no {name!r} there; {hint}")
    return name


def _changed(path: str, part: Any, name: str, value: Any) -> Any:
    """A part of a scene with another value of its field `name`."""
    return msgspec.structs.replace(part, **{_known(path, name, part.__struct_fields__): value})


@dataclass(frozen=True, repr=False)
class Plan:
    """What a scene needs: the fields, passes and lists of its effects and no others.

    Scene, effects, state and walls are where the user has placed them; what passes take (`shared`, `parameters`, and
    the fields of a run) is relative to `grid.origin`.

    start   once, when a simulation is made or resumed
    begin   at the beginning of every step, in order
    passes  forces, in order: before the step's length is known
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
    notes: tuple[str, ...] = field(default_factory=tuple)

    def _facts(self) -> list[tuple[str, str]]:
        return [
            ("particles", f"{self.grid.count:,} in {self.grid.dim}D, {self.grid.dtype}"),
            ("spacing", f"{self.grid.spacing:g} m, support radius {self.grid.support_radius:g} m"),
            ("effects", ", ".join(self.effects) or "none"),
            ("fields", f"{len(self.fields)}, {in_bytes(sum(self.bytes_of_fields().values()))}"),
            ("operations in a step", str(len(self.launches()))),
            ("notes", "; ".join(self.notes) or "none"),
        ]

    def __repr__(self) -> str:
        return f"Plan of {self.scene.name!r}\n{table(self._facts())}"

    def _repr_html_(self) -> str:
        return html_table(f"Plan of {self.scene.name!r}", self._facts())

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
    _check_numbers(scene)
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            return _planned(scene)
    except (ArithmeticError, OverflowError) as error:
        raise InputError(
            f"scene: its numbers differ by too many orders of magnitude for their products ({error}); check the units."
        ) from None


def _check_numbers(scene: Scene) -> None:
    """Raise InputError for the scene's own numbers, and for numbers of its parts that no product may have."""
    require(
        "scene",
        spacing=(scene.spacing, "positive"),
        support_radius=(scene.support_radius, "positive"),
        end_time=(scene.end_time, "not negative"),
        step=(scene.step, "not negative"),
        step_factor=(scene.step_factor, "positive"),
        skin=(scene.skin, "not negative"),
    )
    if scene.step_factor > 1:
        raise InputError(
            f"scene: step_factor = {scene.step_factor} would take more than the stable step; give at most 1."
        )
    if scene.dim not in (2, 3):
        raise InputError(f"scene: dim = {scene.dim} is not possible; give 2 or 3.")
    if scene.dtype not in ("float32", "float64"):
        raise InputError(f"scene: dtype = {scene.dtype!r} is not possible; give 'float32' or 'float64'.")
    if scene.support_radius < scene.spacing:
        raise InputError(
            f"scene: support_radius = {scene.support_radius} m is below one spacing ({scene.spacing} m), so that no"
            " particle would have a neighbour; give at least 1.5 spacings."
        )
    if scene.energy_audit is not None:
        scene.energy_audit.check()
    for name in ("spacing", "support_radius", "end_time", "step", "step_factor", "skin"):
        _check_magnitude("scene", name, getattr(scene, name), LEAST)
    for name in ("period", "period_lower"):
        for axis, value in zip("xyz", getattr(scene, name)):
            rule = "not negative" if name == "period" else "finite"
            require("scene", **{f"{name} along {axis}": (value, rule)})
            _check_magnitude("scene", f"{name} along {axis}", value, LEAST)
    if scene.dim == 2 and scene.period[2] != 0:
        raise InputError("scene: period has a z part in a 2D scene; set it to 0.")
    _check_neighbours(scene, "support_radius", scene.support_radius)
    for kind, parts in (("fluid", scene.fluid), ("solid", scene.solid)):
        for number, part in enumerate(parts, 1):
            _check_magnitudes(f"[[{kind}]] number {number}", part)
    for effect in scene.effects:
        _check_magnitudes(getattr(effect, "name", "scene"), effect)


def _check_magnitudes(place: str, part: Any) -> None:
    for f in msgspec.structs.fields(part) if isinstance(part, msgspec.Struct) else ():
        values = getattr(part, f.name)
        if f.type is not Any:  # arrays of particles and cells are looked at where they are read
            several = isinstance(values, tuple)
            for axis, value in enumerate(values if several else (values,)):
                if f.name != "velocity":  # reported with its particle
                    name = f"{f.name} along {'xyz'[axis]}" if several and len(values) == 3 else f.name
                    _check_magnitude(place, name, value, 0.0 if "temperature" in f.name else SMALLEST)


def _check_magnitude(place: str, name: str, value: Any, least: float = 0.0) -> None:
    """Raise InputError for a number that is not finite, or whose magnitude is outside the accepted range."""
    if not isinstance(value, int | float) or value == 0 or least <= abs(value) <= GREATEST:
        return
    words = f"{value:g}" if isinstance(value, float) else f"{str(value)[:12]}..."
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{place}: {name} = {words} is not possible; give a finite number.")
    kind = "small" if abs(value) < least else "large"
    raise InputError(f"{place}: {name} = {words} is too {kind} to be meant in SI units; correct it.")


def _check_neighbours(scene: Scene, what: str, radius: float) -> None:
    """Raise InputError where a particle of the lattice has more neighbours within `radius` [m] than one may have."""
    reach = radius / scene.spacing * (1 + scene.skin)
    number = (math.pi if scene.dim == 2 else 4 / 3 * math.pi) * reach**scene.dim
    if number > MOST_NEIGHBOURS:
        raise InputError(
            f"scene: {what} = {radius:g} m with a skin of {scene.skin:g} reaches over {reach:.3g} spacings"
            f" ({scene.spacing:g} m) and so over {number:.3g} neighbours, more than the {MOST_NEIGHBOURS:,} that a"
            " particle may have; check the units, 2 to 3 spacings are common."
        )


def _planned(scene: Scene) -> Plan:
    effects = _effects(scene)
    _check_periodic(scene, effects)
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
    solids = voxelised(scene.solid, empty) if scene.solid else None
    absolute = _initial_state(scene, empty, effects, solids)
    given, grid = (
        effects,
        _placed(dataclasses.replace(empty, count=len(absolute.position), solids=solids), absolute, effects),
    )
    solids, effects = grid.solids, {name: effect.local(grid) for name, effect in given.items()}
    state = dataclasses.replace(absolute, position=grid.local(absolute.position))
    _check_coincident(state.position, scene.dtype)
    fields = {f.name: f for f in (*BASE, *((POSITION_RESIDUAL,) if scene.dtype == "float32" else ()))}
    shared: dict[str, Any] = {"walls": None, "period": None}
    if any(scene.period):
        shared["period"] = period_group(scene.period, scene.dtype)
    parameters = {}
    walls = []
    for name, effect in effects.items():
        fields |= {f.name: _counted(f, solids) for f in effect.fields(effects)}
        shared |= effect.shares(grid, effects)
        parameters[name] = effect.prepare(grid, effects)
        made = effect.walls(grid, effects) if isinstance(effect, BringsWalls) else None
        if made is not None:
            walls.append(made)
    if scene.energy_audit is not None:
        accounts(grid, effects)
    _check_fixed_step(scene, grid, effects)
    state = dataclasses.replace(state, values=_initial_values(grid, state, effects, fields))
    _check_places(state, shared.get("bounds"), solids)
    replaced = _replaced(effects)
    asked = [
        (e, p) for e in effects.values() for p in e.passes(effects) if p.operation not in replaced - set(e.replaces())
    ]
    passes = _ordered(_merged([(e, p) for e, p in asked if p.stage == "forces"], parameters), fields)
    list_radius = max((e.list_radius(grid) for e in effects.values()), default=0.0)
    if list_radius > scene.support_radius:
        _check_neighbours(scene, "the radius of the neighbour list", list_radius)
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
        motion=_motion([(e, p) for e, p in asked if p.stage == "motion"], fields),
        list_radius=list_radius,
        shared=shared,
        parameters=parameters,
        walls=merged,
        notes=(
            *_coarse_places(grid, state),
            *_unequal_masses(state, effects),
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
                    f"Effects {owner[operation]!r} and {name!r} would both take the place of {operation!r}; keep one of"
                    " them."
                )
            owner[operation] = name
    return frozenset(owner)


def _check_fixed_step(scene: Scene, grid: Discretisation, effects: Mapping[str, Effect]) -> None:
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


def _check_periodic(scene: Scene, effects: Mapping[str, Effect]) -> None:
    """Raise InputError for an effect that knows no nearest images in a scene with a period."""
    for name, effect in effects.items() if any(scene.period) else ():
        if not effect.periodic:
            able = ", ".join(sorted(other for other, kind in EFFECTS.items() if kind.periodic))
            raise InputError(
                f"{name}: this effect does not act across the border of a periodic box; leave out the scene's period or"
                f" the effect (with a period a scene can have {able})."
            )


def _resolved(position: np.ndarray, grid: Discretisation) -> float:
    """Distance of two numbers of the run's dtype at the farthest coordinate [spacings]."""
    return float(np.spacing(np.abs(position).max().astype(grid.dtype))) / grid.spacing


def _placed(grid: Discretisation, state: InitialState, effects: Mapping[str, Effect]) -> Discretisation:
    """The grid with its origin amid the particles, where they are far from the scene's compared with their extent.

    The origin is a whole number of spacings away, or of an effect's cells; solids and period are relative to it.
    """
    cell = max((e.sorting_cell(grid) for e in having(effects, NeedsCellOrder)), default=0.0)
    unit = cell if cell > 0 and grid.solids is None else grid.spacing
    middle = unit * np.rint(0.5 * (state.position.min(0) + state.position.max(0)) / unit) + 0.0  # no -0
    farthest, nearer = np.abs(state.position).max(), np.abs(state.position - middle).max()
    if _resolved(state.position, grid) <= FINE or farthest < FAR * nearer:
        return grid
    solids = grid.solids
    if solids is not None:
        solids = moved(solids, np.rint(middle / unit).astype(np.int32))
    origin: Vector = tuple(middle.tolist())
    lower: Vector = tuple((grid.period_lower - middle).tolist())
    return dataclasses.replace(grid, origin=origin, period_lower=lower, solids=solids)


def _coarse_places(grid: Discretisation, state: InitialState) -> tuple[str, ...]:
    """A note if the dtype does not resolve distances well enough, because the particles' own extent is wide."""
    step = _resolved(state.position, grid)
    if step <= COARSE:
        return ()
    return (
        f"the particles reach {np.abs(state.position).max():.4g} m from the place that positions are relative to, where"
        f" {grid.dtype} resolves distances to {step:.2g} spacings only, and accelerations to about twice that share:"
        " use float64",
    )


def _unequal_masses(state: InitialState, effects: Mapping[str, Effect]) -> Iterator[str]:
    """A note where the ratio of masses is above what the forces of an effect were measured with."""
    ratio = float(state.mass.max() / state.mass.min())
    for name, effect in effects.items():
        if not isinstance(effect, LimitsMassRatio):
            continue
        largest = effect.largest_mass_ratio(effects)
        if ratio > largest * (1 + 1e-6):
            yield (
                f"{name}: the heaviest particle has {ratio:.4g} times the mass of the lightest; up to"
                f" {largest:g} times was measured to gain no energy: take masses that differ less, or watch the energy"
                " by energy_audit"
            )


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
    return effects


def _counted(f: Field, solids: Nodes | None) -> Field:
    """A field whose rows are counted, where it is a table of the nodes of solids."""
    nodes = 0 if solids is None else len(solids.lattice.key)
    return dataclasses.replace(f, rows=nodes) if f.rows == "solids" else f


def _initial_state(
    scene: Scene, grid: Discretisation, effects: Mapping[str, Effect], solids: Nodes | None
) -> InitialState:
    positions, velocities, masses = [], [], []
    if solids is not None:
        positions, velocities, masses = map(list, zip(_solid_particles(solids, grid, effects)))
    for part in scene.fluid:
        points = part.positions(grid)
        mass = getattr(part, "mass", None)
        if mass is None:
            mass = lattice_mass(grid, effects)
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
    position, velocity, mass = map(np.concatenate, (positions, velocities, masses))
    _check_particles(position, velocity, mass, scene)
    bodies = [] if solids is None else np.diff(solids.lattice.first)
    sizes = (*map(int, bodies), *map(len, positions[solids is not None :]))
    return InitialState(position, velocity, mass, sizes)


def _solid_particles(
    solids: Nodes, grid: Discretisation, effects: Mapping[str, Effect]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and mass of the nodes of solids; each has the volume of a particle of the liquid in bulk."""
    if "shape_matching" not in effects:
        raise InputError("scene: nothing holds its solids together; add effect 'shape_matching'.")
    position = (solids.lattice.cell + 0.5) * grid.spacing
    mass = solids.of_bodies("density") * solid_volume(grid, effects)
    velocity = solids.of_bodies("velocity")
    for k, body in enumerate(solids.bodies):
        own = slice(*solids.lattice.first[k : k + 2])
        if body.mass is not None:
            mass[own] *= fitting_share(f"[[solid]] number {k + 1}", body.mass, mass[own].sum())
        velocity[own] += np.cross(body.spin, position[own] - position[own].mean(0))
    return position, velocity, mass


def _check_places(state: InitialState, bounds: Any, solids: Nodes | None) -> None:
    """Raise InputError for solids outside the walls, or in the liquid."""
    if solids is None:
        return
    from scipy.spatial import cKDTree

    own = state.position[: len(solids.lattice.key)]
    if bounds is not None:
        outside = np.flatnonzero(((own < bounds.lower) | (own > bounds.upper)).any(1))
        if len(outside):
            raise InputError(
                f"scene: [[solid]] number {solids.lattice.body[outside[0]] + 1} reaches outside the walls"
                f" ({len(outside)} of its particles); move it in or make the walls wider."
            )
    liquid = state.position[len(own) :]
    if len(liquid) and len(own):
        reach = 0.5 * solids.spacing
        near, _ = cKDTree(own).query(liquid, distance_upper_bound=reach)
        inside = np.flatnonzero(near < reach * (1 - 1e-6))
        if len(inside):
            raise InputError(
                f"scene: {len(inside)} particles of the fluid are less than half a spacing from a solid's; leave"
                " them out of the fluid."
            )


def fitting_share(place: str, mass: float, lattice: float) -> float:
    """A part's mass over that of its lattice particles [kg]. Raises InputError where the two do not fit."""
    require(place, mass=(mass, "positive"))
    share = mass / lattice if lattice > 0 else 1.0
    if not 1 / WIDEST_SHARE <= share <= WIDEST_SHARE:
        raise InputError(
            f"{place}: mass = {mass:g} kg is {share:.3g} times that of its particles at its density ({lattice:.4g} kg);"
            " correct its mass, size or density, or leave the mass out."
        )
    return share


def solid_volume(grid: Discretisation, effects: Mapping[str, Effect]) -> float:
    """Volume of a particle of a solid [m^dim]: that of a particle of the liquid in bulk."""
    liquid = next((e for e in having(effects, KnowsParticleMass) if e.of_liquid), None)
    return grid.spacing**grid.dim if liquid is None else liquid.particle_volume(grid)


def lattice_mass(grid: Discretisation, effects: Mapping[str, Effect]) -> float:
    """Mass of a lattice particle: the liquid's, else that of the first effect that gives one, else 1."""
    liquid_first = sorted(having(effects, KnowsParticleMass), key=lambda effect: not effect.of_liquid)
    return liquid_first[0].particle_mass(grid) if liquid_first else 1.0


def _per_particle(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """One value for all particles, or one for each, as an array of this shape."""
    try:
        found = _numbers(values)
        if found.shape not in (shape, shape[1:]):
            raise ValueError
        return np.broadcast_to(found, shape)
    except (TypeError, ValueError):
        each = "3 numbers" if len(shape) == 2 else "one number"
        raise InputError(
            f"fluid cloud: {name} does not fit {shape[0]} particles; give {each} for all, or for each of them."
        ) from None


def _numbers(values: Any) -> np.ndarray:
    """Numbers as an array of float64. Raises TypeError or ValueError for anything else."""
    found = np.asarray(values)
    if found.dtype.kind not in "iuf":
        raise TypeError(f"{found.dtype} are no numbers")
    return found.astype(float)


def _check_particles(position: np.ndarray, velocity: np.ndarray, mass: np.ndarray, scene: Scene) -> None:
    for name, values in (("position", position), ("velocity", velocity), ("mass", mass)):
        with np.errstate(over="ignore"):  # reported below
            rounded = values.astype(scene.dtype)
            bad = np.flatnonzero(~(np.abs(rounded) <= GREATEST).reshape(len(values), -1).all(1))
        if len(bad):
            raise InputError(
                f"scene: the {name} of particle {bad[0]} is not a finite number, in {scene.dtype} and below"
                f" {GREATEST:g} ({len(bad)} such particles); correct the input."
            )
    if (mass <= 0).any():
        first = int(np.flatnonzero(mass <= 0)[0])
        raise InputError(f"scene: the mass of particle {first} is {mass[first]} kg; give a positive mass.")
    for values, name, unit in ((position, "z", "m"), (velocity, "v_z", "m/s")) if scene.dim == 2 else ():
        if values[:, 2].any():
            first = int(np.flatnonzero(values[:, 2])[0])
            raise InputError(
                f"scene: particle {first} has {name} = {values[first, 2]} {unit} in a 2D scene; set {name} to 0."
            )
    for axis, length in enumerate(scene.period):
        x, low = position[:, axis], scene.period_lower[axis]
        outside = np.flatnonzero((length > 0) & ((x < low) | (x >= low + length)))
        if len(outside):
            raise InputError(
                f"scene: particle {outside[0]} starts at {'xyz'[axis]} = {x[outside[0]]:.6g} m, outside the periodic"
                f" box from {low:g} to {low + length:g} m ({len(outside)} such particles); move it in, or change period"
                " or period_lower."
            )


def _check_coincident(position: np.ndarray, dtype: str) -> None:
    from refsim.neighbours import coincident_pairs

    same = coincident_pairs(position.astype(dtype))
    if same:
        a, b = same[0]
        raise InputError(
            f"scene: particles {a} and {b} are at the same place ({len(same)} such pairs in {dtype});"
            " remove the duplicates or move them apart."
        )


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
                raise InputError(
                    f"{effect.name}: the {name} of a particle is not a finite number in {grid.dtype}; correct its"
                    " parameters."
                )
            values[name] = value
    return values


def _motion(
    asked: Sequence[tuple[Effect, Pass]], fields: Mapping[str, Field]
) -> tuple[tuple[Effect | None, Pass], ...]:
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
    return (*_ordered([(e, p) for e, p in asked if "position" not in p.updates], fields), *last)


def _merged(
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
    def bound(p: Pass) -> dict[str, str | None]:
        return {name: field_name for name, field_name in p.names.items() if name != "candidates"}

    if (p.operation, p.writes, p.updates, bound(p)) != (q.operation, q.writes, q.updates, bound(q)):
        return False
    names = {p.names.get(name, name) or "" for name in REGISTRY[p.operation].arguments("numpy")}
    own, its = parameters[effect.name], parameters[other.name]
    return all(_same(own.get(name), its.get(name)) for name in names)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return type(a) is type(b) and bool(np.array_equal(a, b))


def _ordered(passes: Sequence[tuple[Effect, Pass]], fields: Mapping[str, Field]) -> tuple[tuple[Effect, Pass], ...]:
    """Passes so that every field is written, then updated, then read; otherwise in the effects' order."""
    for _, p in passes:
        if p.operation not in REGISTRY and p.operation not in PROCEDURES:
            raise InputError(f"A pass names operation {p.operation!r}, which is not registered.")
    writers: dict[str, list[int]] = {}
    updaters: dict[str, list[int]] = {}
    for k, (_, p) in enumerate(passes):
        for name in p.writes:
            writers.setdefault(name, []).append(k)
        for name in p.updates:
            updaters.setdefault(name, []).append(k)
    after: list[set[int]] = [set() for _ in passes]
    for k, (_, p) in enumerate(passes):
        for name in p.reads:
            after[k].update(w for w in writers.get(name, []) if w != k)
            if name not in p.updates:
                after[k].update(u for u in updaters.get(name, []) if u != k)
        for name in p.updates:
            after[k].update(w for w in writers.get(name, []) if w != k)
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
