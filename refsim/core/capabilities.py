"""What some effects do beside the hooks of `Effect`: each class here is one capability.

An effect names its capabilities among its bases, `class BoxWalls(Effect, BringsWalls, ...)`, and defines their methods.
`effects_with` finds the effects of a scene with a capability.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple, TypeVar, get_args

import msgspec
import numpy as np

from refsim.core.checked import Printed
from refsim.core.effect import EFFECTS, Discretisation, Effect, InitialState, Pass, literal_errata
from refsim.core.errors import InputError
from refsim.core.walls import WallParticles


class HasErrata:
    """Has numbered deviations from its source, whose printed reading the parameter `literal` can switch on.

    A deviation is the correction of a misprint, which the source contradicts elsewhere, or an improvement on the
    source's own choice (docs/errata.md). `literal = "paper"` takes the source's own choices and keeps the corrections;
    "all" takes every printed text.
    """

    name: ClassVar[str]
    source: ClassVar[str] = ""  # as an erratum is cited: "Jiang & Zhu"
    errata: ClassVar[tuple[str, ...]] = ()  # those that can be switched
    improvements: ClassVar[tuple[str, ...]] = ()  # those of them that are the source's own choice
    paper: ClassVar[Mapping[str, Any]] = {}  # the source's own choice of other parameters that refsim chooses otherwise
    literal: Printed

    def settle_literal(self) -> None:
        """Called when the effect is made: with "paper" in `literal` the parameters of `paper` take its values.

        Raises InputError where a parameter is given that is neither refsim's default nor the paper's.
        """
        given = (self.literal,) if isinstance(self.literal, str) else tuple(self.literal)
        msgspec.structs.force_setattr(self, "literal", given)  # type: ignore[arg-type]
        if "paper" not in self.literal:
            return
        defaults = {f.name: f.default for f in msgspec.structs.fields(self)}  # type: ignore[arg-type]
        for name, printed in self.paper.items():
            value = getattr(self, name)
            if value not in (printed, defaults[name]):
                raise InputError(
                    f"{self.name}: literal 'paper' sets {name} = {printed!r}, but {name} = {value!r} is given; leave"
                    " one of them out."
                )
            msgspec.structs.force_setattr(self, name, printed)  # type: ignore[arg-type]

    def printed(self) -> frozenset[str]:
        """Errata that are taken as printed. Raises InputError for one that is not among `errata`."""
        return literal_errata(self.name, self.literal, self.errata, self.improvements, self.source)

    def cited(self, errata: Iterable[str]) -> str:
        """Errata with their source, for messages: "Shao & Song M2, M4"."""
        return f"{self.source} {', '.join(sorted(errata))}"


class FollowsScene:
    """Has parameters that follow the scene where they are None."""

    in_papers: ClassVar[Mapping[str, Any]] = {}  # what the papers have for them

    def with_scene_defaults(self, others: Mapping[str, Effect]) -> Effect:
        raise NotImplementedError  # an effect with this capability defines it


class FollowsGrid:
    """Has parameters that follow the grid and the effects as the scene has them, where they are None."""

    def on_grid(self, given: Any, grid: Discretisation, others: Mapping[str, Effect]) -> Any:
        """This effect with those parameters that are None in the `given` one."""
        raise NotImplementedError  # an effect with this capability defines it


class FollowsStart:
    """Has parameters that follow the particles of the start where they are None."""

    def with_start_defaults(self, grid: Discretisation, others: Mapping[str, Effect]) -> Effect:
        """This effect with those of its parameters that are None as the particles of `grid` have them."""
        raise NotImplementedError  # an effect with this capability defines it

    def start_defaults(self, scene_effects: Iterable[Effect]) -> Iterator[str]:
        """Sentences on the parameters chosen so; `scene_effects` are the effects as the scene file has them."""
        raise NotImplementedError  # an effect with this capability defines it


class Joins:
    """May act in a scene that does not name it, with its usual parameters."""

    @classmethod
    def joins(cls, others: Mapping[str, Effect]) -> bool:
        raise NotImplementedError  # an effect with this capability defines it


class HasTension:
    """Has a surface tension, which acts on the liquid that it needs first."""

    def acting_tension(self, grid: Discretisation, others: Mapping[str, Effect]) -> tuple[float, str]:
        """sigma [N/m] of the surface, as far as it is known, and what it follows from."""
        raise NotImplementedError  # an effect with this capability defines it


class PullsAtLines:
    """Has a pass of forces without opposites: walls bear their sum where the surface ends at them."""

    unopposed: ClassVar[str] = ""  # the operation


class SumsDensity:
    """May need a liquid whose density is summed."""

    def sums_density(self, standing: bool) -> bool:
        """Whether it does so with these parameters; `standing`: under gravity, between walls."""
        return True


class PullsParticles(SumsDensity):
    """Draws particles together, which an advanced density sees only where it is restored from the summed one."""

    coefficient_name: ClassVar[str] = ""  # the coefficient that may be given instead of surface_tension

    def sums_density(self, standing: bool) -> bool:
        """Not where the liquid stands on walls, whose weight a summed density does not carry, nor in measured drops.

        Everywhere where the source's reading, its own coefficient or adhesion is given, which belong to a summed one.
        """
        given = (getattr(self, name, None) for name in ("literal", "adhesion", self.coefficient_name) if name)
        return not (standing or self.keeps_drops()) or any(given)

    def keeps_drops(self) -> bool:
        """Whether free drops of the default liquid are known to have the tension that is given."""
        return False


class ReturnsDensity:
    """Wants an advanced density to return to the counted one at a rate of its own."""

    def return_rate(self, grid: Discretisation, others: Mapping[str, Effect]) -> float:
        """Least rate [c/h]; 0 where it wants none."""
        return 0.0


class BringsWalls:
    """Brings static boundary particles into the scene."""

    wall_share: ClassVar[float] = 2.0  # times the particle's pressure with which they push; the least of a scene counts

    def extrapolates(self) -> bool:
        """Whether its particles take a pressure that is extrapolated from the liquid (`adami_2012`)."""
        return False

    def filled(self, grid: Discretisation, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Share (n,) that its particles fill of cells of the lattice about points (n, 3) [m]; its centre (n, 3) [m]."""
        return np.zeros(len(points)), points

    def taken(self, grid: Discretisation, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same of the body that its particles stand for, which no liquid enters."""
        return np.zeros(len(points)), points

    def walls(self, grid: Discretisation, others: Mapping[str, Effect]) -> WallParticles | None:
        """Positions and volumes of the boundary particles; None if there are none."""
        raise NotImplementedError  # an effect with this capability defines it

    def normals(self, grid: Discretisation, points: np.ndarray) -> np.ndarray:
        """Unit vectors (m, 3) across the wall at its particles (m, 3) [m], of either sign; 0 at its edges."""
        raise NotImplementedError  # as above, where its particles take an extrapolated pressure


Face = Literal["-x", "+x", "-y", "+y", "-z", "+z"]
FACES: tuple[Face, ...] = get_args(Face)


class HasPlanes:
    """Holds the particles in a box by planes, on its faces that are not open."""

    name: ClassVar[str]
    lower: tuple[float, float, float]  # corners of the box [m]
    upper: tuple[float, float, float]
    open_faces: tuple[Face, ...]

    def domain(self, grid: Discretisation) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (3,) of the box [m]; infinite where it is open, and along z in 2D."""
        ends = np.array([self.lower, self.upper], dtype=float).T.ravel()
        for number, face in enumerate(FACES):
            if face in self.open_faces or number >= 2 * grid.dim:
                ends[number] = (-math.inf, math.inf)[number % 2]
        return ends[::2], ends[1::2]

    def check_inside(self, grid: Discretisation, position: np.ndarray, slack: float, first: int = 0) -> None:
        """Raise InputError if one of these positions (n, 3) [m] is behind a plane, by more than `slack` [m].

        first  number of the first one among the scene's particles
        """
        lower, upper = self.domain(grid)
        out = np.flatnonzero(((position < lower - slack) | (position > upper + slack)).any(1))
        if len(out):
            where = ", ".join(f"{x:.6g}" for x in grid.absolute(position[out[0]])[: grid.dim])
            raise InputError(
                f"{self.name}: particle {first + out[0]} at ({where}) m is behind a wall ({len(out)} such particles);"
                " move the liquid or the wall, or open that face."
            )

    def wall_speed(self) -> float:
        """Speed of its fastest wall [m/s]."""
        return 0.0


def open_axis(grid: Discretisation, others: Mapping[str, Effect]) -> str:
    """The first axis along which a scene has neither a period nor planes on both sides; "" where it is closed."""
    return next((axis for axis, length in zip("xyz", closed_box(grid, others)) if length == math.inf), "")


def closed_box(grid: Discretisation, others: Mapping[str, Effect]) -> list[float]:
    """Lengths [m] of the box that a period or planes on both sides close along each axis; infinite where none do."""
    lengths = []
    for axis in range(grid.dim):
        between = [np.subtract(*effect.domain(grid)[::-1])[axis] for effect in effects_with(others, HasPlanes)]
        period = [grid.period[axis]] if grid.period[axis] > 0 else []
        lengths.append(float(min([*period, *between], default=math.inf)))
    return lengths


class FindsSurface:
    """Marks the particles near the free surface in field `near_surface`, for other effects."""

    def near_passes(self) -> tuple[Pass, ...]:
        """Passes that an effect lists which reads `near_surface`."""
        raise NotImplementedError  # an effect with this capability defines it

    def near_groups(self, grid: Discretisation, others: Mapping[str, Effect]) -> dict[str, Any]:
        """Parameter groups of these passes."""
        raise NotImplementedError


class JudgesStart:
    """Has notes that follow from the particles at the start."""

    def notes_on_start(
        self, grid: Discretisation, state: InitialState, walls: WallParticles | None, others: Mapping[str, Effect]
    ) -> Iterator[str]:
        """Limitations of its parameters with these particles, one sentence each; shown before the run."""
        raise NotImplementedError  # an effect with this capability defines it


class CorrectsPositions:
    """Moves particles by other displacements than dt v."""

    def corrects_positions(self) -> bool:
        """Whether it does so with these parameters; unless by the field `way`, the neighbour list is not audited."""
        return True

    def parts_from_density(self) -> bool:
        """Whether the particles part from an advanced density by it."""
        return False


class BalancesCohesion:
    """Has cohesion whose pressure [Pa] in the undisturbed bulk the equation of state is to balance."""

    def balanced_pressure(self, grid: Discretisation, others: Mapping[str, Effect]) -> float:
        raise NotImplementedError  # an effect with this capability defines it


class KnowsParticleMass:
    """Gives the mass of a particle of the lattice."""

    of_liquid: ClassVar[bool] = False  # the liquid's mass counts before that of other effects

    def particle_mass(self, grid: Discretisation) -> float:
        """Mass of a particle of the lattice [kg; kg/m in 2D]."""
        raise NotImplementedError  # an effect with this capability defines it

    def particle_volume(self, grid: Discretisation) -> float:
        """Volume of a particle in the bulk [m^dim]."""
        return grid.spacing**grid.dim

    def starting_share(self) -> float:
        """Share of that volume that a particle is told to have at the start."""
        return 1.0


class LimitsSpeed:
    """Has equations that hold up to some speed [m/s] of the particles: a faster one ends the run."""

    def greatest_speed(self, grid: Discretisation) -> float:
        raise NotImplementedError  # an effect with this capability defines it


class LimitsMassRatio:
    """Has forces that were measured to gain no energy up to some ratio of the largest to the smallest mass."""

    def largest_mass_ratio(self, others: Mapping[str, Effect]) -> float:
        raise NotImplementedError  # an effect with this capability defines it


class Margin(NamedTuple):
    """A setting beside the limit up to which runs were measured to hold (docs/stability.md)."""

    setting: str  # its name with its unit
    value: float  # in the scene
    limit: float  # the largest value that held, or with `least` the smallest
    least: bool = False
    beyond: str = ""  # note where the value is beyond the limit

    @property
    def factor(self) -> float:
        """Factor by which the value may change until it meets the limit; below 1 beyond it."""
        far, near = (self.value, self.limit) if self.least else (self.limit, self.value)
        return far / near if near > 0 else math.inf


class KnowsLimits:
    """Has settings of which it was measured how far they can go; a note is given beyond."""

    name: ClassVar[str]

    def margins(self, grid: Discretisation, others: Mapping[str, Effect]) -> Iterator[Margin]:
        """Those that act in this scene."""
        raise NotImplementedError  # an effect with this capability defines it

    def exceeded(self, grid: Discretisation, others: Mapping[str, Effect]) -> list[str]:
        """Notes of the margins whose value is beyond the limit."""
        return [f"{self.name}: {m.beyond}" for m in self.margins(grid, others) if m.beyond and m.factor < 1 - 1e-9]


class NeedsCellOrder:
    """Needs the particles sorted by cells of a size [m] at intervals, also without a neighbour list."""

    def sorting_cell(self, grid: Discretisation) -> float:
        raise NotImplementedError  # an effect with this capability defines it


class FollowsSettings:
    """Has fields that follow from another field when a user sets that one between two steps."""

    def after_setting(self, name: str, field: Callable[[str], np.ndarray]) -> Mapping[str, np.ndarray]:
        """New values of its fields after `name` was set; `field` gives a field's values by name."""
        raise NotImplementedError  # an effect with this capability defines it


class KeepsLedger:
    """Counts a quantity for the report of a run."""

    ledger_units: ClassVar[Mapping[str, str]] = {}  # of the quantities, in 3D
    ledger_expected: ClassVar[Mapping[str, str]] = {}  # what becomes of them in a right run

    def ledger(self, field: Callable[[str], np.ndarray]) -> dict[str, float]:
        """Quantities by name, in `ledger_units`; `field` gives a field's values by name."""
        raise NotImplementedError  # an effect with this capability defines it


class Balance(NamedTuple):
    """A total that is kept, in J (J/m in 2D)."""

    total: float
    size: float  # sum of the moduli of its parts, to which rounding is proportional
    exchangeable: float  # what can change places: half of the sum of |part - its share of the total|


class KeepsBalance:
    """Keeps a total while nothing enters or leaves; the run looks whether it does."""

    balanced: ClassVar[str] = ""  # the total, in a word
    stops_as: ClassVar[str] = ""  # reason of a run that stops because of a drift
    remedy: ClassVar[str] = ""  # what a user does about a drift
    largest_drift: float  # share of what can be exchanged above which the run stops

    def is_closed(self, grid: Discretisation, others: Mapping[str, Effect]) -> bool:
        """Whether nothing enters or leaves in this scene."""
        raise NotImplementedError  # an effect with this capability defines it

    def balance(self, field: Callable[[str], np.ndarray]) -> Balance:
        """The total of the present state; `field` gives a field's values by name."""
        raise NotImplementedError


class RunMonitor:
    """Checks small fields on the host after each step; it may stop the run or add a note to it."""

    watched: ClassVar[tuple[str, ...]] = ()  # names of those fields

    def verdict(self, grid: Discretisation, seen: Mapping[str, np.ndarray], length: float) -> tuple[str, str] | None:
        """(reason, sentence that goes on after "In step n") if the run must stop; `length` of the step [s]."""
        return None

    def warning(self, grid: Discretisation, seen: Mapping[str, np.ndarray]) -> str | None:
        """Sentence that goes on after "From step n on", if results are to be read with care from here on.

        The first one becomes a note of the run.
        """
        return None


class Inspects:
    """Looks at fields on the host from time to time and at the end of a run; it may stop it or add a note to it."""

    def inspected(self, grid: Discretisation, field: Callable[[str], np.ndarray]) -> tuple[str, str] | None:
        """(reason of a stop, or "" for a note; sentence that goes on after "In step n"); `field` as in `balance`."""
        raise NotImplementedError  # an effect with this capability defines it


class HoldsOtherMemory:
    """Holds arrays besides fields, lists and walls, whose size depends on the course of the run."""

    def other_memory(self) -> str:
        """Name of these arrays, for `refsim plan`; "" where there are none."""
        raise NotImplementedError  # an effect with this capability defines it

    def bytes_at_start(
        self, grid: Discretisation, position: np.ndarray, others: Mapping[str, Effect], backend: str
    ) -> dict[str, int]:
        """Bytes by name of those whose size follows from the particles' first places, `position` (n, 3) [m]."""
        return {}


Capability = TypeVar("Capability")


def effects_with(effects: Mapping[str, Effect] | Iterable[Effect], capability: type[Capability]) -> list[Capability]:
    """The effects with a capability, in their order."""
    each = effects.values() if isinstance(effects, Mapping) else effects
    return [effect for effect in each if isinstance(effect, capability)]


def with_scene_defaults(effects: Iterable[Effect]) -> dict[str, Effect]:
    """Effects by name that act or join the scene, with parameters that follow it; what they need is among them."""
    given = {effect.name: effect for effect in effects}
    acting = {name: effect for name, effect in given.items() if effect.acts()}
    absent = [kind for name, kind in EFFECTS.items() if name not in given and issubclass(kind, Joins)]
    acting |= {kind.name: kind() for kind in absent if kind.joins(acting)}
    return {name: e.with_scene_defaults(acting) if isinstance(e, FollowsScene) else e for name, e in acting.items()}
