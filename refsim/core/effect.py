"""What an effect is: parameters with units, the fields it needs, its passes and its stable step.

A scene is a list of effects. What no effect needs is neither allocated nor launched.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, NamedTuple, TypeVar

import msgspec
import numpy as np

from refsim.core.checked import Checked, Printed
from refsim.core.errors import InputError
from refsim.core.period import Lengths


@dataclass(frozen=True)
class Field:
    """A named particle array."""

    name: str
    unit: str
    meaning: str
    components: int = 1  # 1 for a scalar (n,), 3 for a vector (n, 3)
    dtype: str = "real"  # "real" (the run's dtype) or a NumPy dtype name
    state: bool = False  # True where the value outlives the step: it is reordered with the particles and checkpointed
    # number of rows where it is not that of the particles, which are never reordered; until the plan has counted the
    # nodes of the scene's solids, its wall particles or its bodies "solids", "walls" or "bodies"
    rows: int | str | None = None

    def shape(self, count: int) -> tuple[int, ...]:
        """Array shape for `count` particles."""
        rows = self.rows if isinstance(self.rows, int) else count
        return (rows,) if self.components == 1 else (rows, self.components)

    def unit_in(self, dim: int) -> str:
        """The unit in `dim` dimensions, where `unit` has both: "kg (kg/m in 2D)"."""
        in_space, _, in_plane = self.unit.removesuffix(" in 2D)").partition(" (")
        return in_plane if in_plane and dim == 2 else in_space

    def numpy_dtype(self, real: str) -> np.dtype:
        """NumPy dtype in a run of dtype `real`."""
        return np.dtype(real if self.dtype == "real" else self.dtype)


POSITION = Field("position", "m", "particle position x", 3, state=True)
POSITION_RESIDUAL = Field(
    "position_residual", "m", "what rounding takes from the position: x lies at position + residual", 3, state=True
)
VELOCITY = Field("velocity", "m/s", "velocity v, half a step behind the position", 3, state=True)
ACCELERATION = Field("acceleration", "m/s^2", "sum of all accelerations", 3)
MASS = Field("mass", "kg (kg/m in 2D)", "particle mass m", state=True)
IDENTITY = Field("identity", "-", "the particle's number at the start; never changes", dtype="int32", state=True)
PLACE = Field("place", "-", "row that holds the particle of this number; for tables in the first order", dtype="int32")

BASE = (POSITION, VELOCITY, ACCELERATION, MASS, IDENTITY)


@dataclass(frozen=True)
class Pass:
    """One launch of one operation; `names` says what its arguments are called here where names differ.

    stage  "start": once, when a simulation is made or resumed, for tables that follow from its state. "begin": at the
           beginning of every step, in the effects' order; not when `evaluate` is called. "forces": before the
           step's length is known, ordered by what passes touch. "motion": once it is known, in the effects' order,
           those that update the position last; one of these replaces the leap-frog. They may take `timestep` =
           [(dt_previous + dt)/2, dt] [s], which is zero where the run is about to stop, `build_position` and
           `displacement`, which an integrator writes as `sph.kick_drift` does.
    """

    operation: str
    reads: tuple[str, ...] = ()  # where it names none, those among the arguments of the operation's reference
    writes: tuple[Any, ...] = ()  # names; given as Fields where its effect has them for it
    updates: tuple[str, ...] = ()  # changed in place: after every writer, before every reader
    on_demand: bool = False  # run by `Simulation.evaluate`, not in every step
    names: Mapping[str, str | None] = field(default_factory=dict)
    algorithm: str = "packed"  # of the program, where the backend has it; else the plain program runs ("plain": always)
    stage: Literal["start", "begin", "forces", "motion"] = "forces"
    fields: tuple[Field, ...] = field(default=(), repr=False, compare=False)  # more that its effect has for it

    def __post_init__(self) -> None:
        made = (each for each in self.writes if isinstance(each, Field))
        object.__setattr__(self, "fields", (*self.fields, *made))
        object.__setattr__(self, "writes", tuple(getattr(each, "name", each) for each in self.writes))

    @property
    def written(self) -> frozenset[str]:
        """What it writes or updates."""
        return frozenset((*self.writes, *self.updates))


class Lattice(NamedTuple):
    """Cells of the nodes; nodes of one body stand together, sorted by key."""

    cell: Any  # (S, 3) int32 cell of each node in the one global lattice
    key: Any  # (S,) int64 the cell as a sortable key
    body: Any  # (S,) int32 body of each node
    first: Any  # (bodies + 1,) int32 first node of each body, and S
    dim: Any = np.int32(3)  # in 2D its third axis has one cell


@dataclass(frozen=True)
class Nodes:
    """The nodes of all bodies of a scene: their lattice, and the bodies that they belong to."""

    lattice: Lattice
    bodies: tuple[Any, ...]
    spacing: float  # [m]

    def position(self) -> np.ndarray:
        """Centres of the nodes' cells (S, 3) [m]; z = 0 in 2D."""
        return self.spacing * (self.lattice.cell + 0.5) * (1, 1, self.lattice.dim == 3)

    def of_bodies(self, name: str) -> np.ndarray:
        """One of the bodies' numbers for every node (S,), or (S, 3)."""
        values = np.array([getattr(body, name) for body in self.bodies], dtype=float)
        return values[self.lattice.body]


@dataclass(frozen=True)
class InitialState:
    """Particles at the start, on the host in float64."""

    position: np.ndarray
    velocity: np.ndarray
    mass: np.ndarray
    sizes: tuple[int, ...]  # number of particles of each solid, then of each part of the fluid
    values: Mapping[str, np.ndarray] = field(default_factory=dict)  # those of the effects' own state fields, by name


@dataclass(frozen=True)
class Discretisation:
    """Properties of the scene that every effect may read: lengths in metres, dtype as a NumPy name."""

    dim: int
    dtype: str
    spacing: float
    support_radius: float
    count: int
    step: float = 0.0  # fixed step [s]; 0 where the stable step decides
    solids: Nodes | None = field(default=None, compare=False)  # the first particles, where the scene has solid bodies
    period: Lengths = (0.0, 0.0, 0.0)  # lengths of the periodic box [m]; 0 along axes without a period
    period_lower: Lengths = (0.0, 0.0, 0.0)  # its lower corner [m]
    origin: Lengths = (0.0, 0.0, 0.0)  # place in the scene [m] to which all that passes take is relative
    bodies: tuple[int, ...] = ()  # number of the body that each solid, then each part of the liquid belongs to
    drop_radius: float = 0.0  # of a ball (disc) as large as the smallest body of liquid [m]; 0: not known

    def local(self, places: Any) -> Any:
        """Places (..., 3) [m] of the scene relative to the origin, in float64; as they are where it is zero."""
        return np.asarray(places, dtype=float) - self.origin if any(self.origin) else places

    def absolute(self, places: Any) -> Any:
        """Places in the scene (..., 3) [m] from those relative to the origin; like `local`."""
        return np.asarray(places, dtype=float) + self.origin if any(self.origin) else places

    def real(self, value: float) -> Any:
        """`value` in the run's dtype."""
        return np.dtype(self.dtype).type(value)


@dataclass(frozen=True)
class Extremes:
    """Largest values over the particles in the present step, and how many are too dense."""

    speed: float  # [m/s]
    acceleration: float  # [m/s^2]
    rate: float = 0.0  # of exchange [1/s]
    excess: float = 0.0  # of a temperature over the range that it must keep [K]
    dense: float = 0.0  # number of the liquid's particles above the first bound of the density
    crushed: float = 0.0  # and above the second one


class StepLimit(NamedTuple):
    """A largest stable step [s] that follows from the particles' largest speed, acceleration and rate of exchange.

    length / (speed + speed_share |v|max + acceleration_share sqrt(length |a|max) + rate_share rate_max): one form, so
    that the device can choose the step as the host does.
    """

    length: float  # [m]
    speed: float = 0.0  # [m/s]
    speed_share: float = 0.0
    acceleration_share: float = 0.0
    rate_share: float = 0.0  # [m]

    @classmethod
    def constant(cls, seconds: float) -> StepLimit:
        """The same step at all speeds and accelerations."""
        return cls(seconds, 1.0)

    @classmethod
    def crossing(cls, length: float, speed: float = 0.0) -> StepLimit:
        """The time in which the fastest particle, with `speed` [m/s] added, crosses `length` [m]."""
        return cls(length, speed, 1.0)

    def at(self, extremes: Extremes) -> float:
        """The step [s]; infinite where nothing limits it."""
        rate = self.speed + self.speed_share * extremes.speed
        rate += self.acceleration_share * math.sqrt(self.length * extremes.acceleration)
        rate += self.rate_share * extremes.rate
        return self.length / rate if rate > 0 else math.inf


def int32(value: Any) -> Any:
    """`value` as a 32-bit integer: the whole numbers of parameter groups."""
    return np.int32(value)


EFFECTS: dict[str, type[Effect]] = {}
Others = Mapping[str, "Effect"]  # all effects of a scene by name
Kind = TypeVar("Kind", bound="Effect")


class Effect(Checked, frozen=True, kw_only=True):
    """Base of all effects. Parameters are the struct's fields, in SI units.

    Hooks that get a grid with particles see the scene relative to the grid's origin, and so are their own `places`.

    Hooks of a few effects only are capabilities, in `refsim.core.capabilities`.
    """

    name: ClassVar[str] = ""
    host_in_step: ClassVar[bool] = False  # its passes need the host, so that a step cannot be one CUDA graph
    host_passes: ClassVar[tuple[str, ...]] = ()  # passes that need the host, between which others are CUDA graphs
    periodic: ClassVar[bool] = False  # whether its passes take separations to the nearest image in a periodic box
    with_spacing: ClassVar[tuple[str, ...]] = ()  # its lengths [m] that follow the spacing if a scene is refined
    ends_abruptly: ClassVar[bool] = False  # whether pairs just within the support radius have a part in its forces
    places: ClassVar[tuple[str, ...]] = ()  # its parameters that are places in the scene [m]
    virial: ClassVar[str] = ""  # why its forces between particles at rest need no `PairCohesion`, which every other has
    scales: ClassVar[tuple[str, ...]] = ()  # with all of these at zero, or off, it is no part of the scene (`acts`)
    sums: ClassVar[bool] = False  # over the neighbours within the support radius
    needed: ClassVar[tuple[str, ...]] = ()  # `needs`, and below `replaces`, whatever its parameters are
    replaced: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if cls.name:
            EFFECTS[cls.name] = cls

    def __post_init__(self) -> None:
        super().__post_init__()
        if settle := getattr(self, "settle_literal", None):  # of the capability HasErrata
            settle()

    def local(self: Kind, grid: Discretisation) -> Kind:
        """This effect with its `places` relative to the grid's origin."""
        moved = {name: tuple(map(float, grid.local(getattr(self, name)))) for name in self.places}
        return msgspec.structs.replace(self, **moved) if any(grid.origin) and moved else self

    def in_scene(self, grid: Discretisation) -> Effect:
        """This effect with those of its parameters that follow the scene's dimension and lengths as these have them."""
        return self

    def acts(self) -> bool:
        """Whether it is a part of the scene: one of its `scales` is not zero, or it `replaces` what others do."""
        given = [value for name in self.scales if (value := getattr(self, name)) is not None]
        return not given or any(np.any(value) for value in given) or bool(self.replaces())

    def needs(self) -> tuple[str, ...]:
        """Names of effects without which this one cannot work."""
        return self.needed

    def fields(self, others: Others) -> tuple[Field, ...]:
        """Fields it reads or writes beside the base fields: those of its passes, unless it says more."""
        return tuple(dict.fromkeys(made for p in self.passes(others) for made in p.fields))

    def passes(self, others: Others) -> tuple[Pass, ...]:
        """Its passes; the plan orders the passes of all effects by the fields that they read and write."""
        return ()

    def replaces(self) -> tuple[str, ...]:
        """Operations of other effects whose passes its own passes replace."""
        return self.replaced

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        """Limitations of these parameters in this scene, one sentence each; shown before the run."""
        return ()

    def list_radius(self, grid: Discretisation) -> float:
        """Distance [m] up to which it needs neighbours; 0 if it needs none."""
        return grid.support_radius if self.sums else 0.0

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        """Parameter groups that its passes take by name, computed once on the host in float64."""
        return {}

    def shares(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        """Parameter groups that passes of every effect may take by name."""
        return {}

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        """Values at the start of the state fields that it owns, in the particles' first order; zero by default."""
        return {}

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        """Largest stable steps by the name of what limits them."""
        return {}

    def check(self, grid: Discretisation, others: Others) -> None:
        """Raise InputError where the parameters do not fit the scene, whose particles are not yet counted."""


def literal_errata(
    owner: str, literal: Printed, switchable: tuple[str, ...], improvements: tuple[str, ...], source: str
) -> frozenset[str]:
    """Errata of `source` whose printed reading `literal` selects.

    "all" in it means every one of `switchable`, "paper" those that are `improvements` on the source's own choice.
    Raises InputError, naming the effect `owner` and the source, for anything else.
    """
    chosen = {literal} if isinstance(literal, str) else set(literal)
    unknown = chosen - set(switchable) - {"all", "paper"}
    if unknown:
        raise InputError(
            f"{owner}: literal has {', '.join(sorted(unknown))}; only {', '.join((*switchable, 'paper'))} or all can be"
            f" given here (printed readings of {source})."
        )
    if "all" in chosen:
        return frozenset(switchable)
    return frozenset(chosen - {"paper"} | (set(improvements) if "paper" in chosen else set()))
