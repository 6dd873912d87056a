"""Test inputs (cases) for every operation, and the functions that make an operation's arguments from a case.

A case is a set of particles with a property that is difficult for a kernel. Arguments are made by name:
arrays with one row for each particle by functions marked `@particles`, parameter groups by functions marked
`@groups`. A method folder adds its own, and its own cases and closed forms, in its `cases.py`, which is imported
when the contract is (`discover`).
"""

import functools
import importlib
import importlib.util
import math
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from refsim.core.effect import Discretisation, Effect
from refsim.core.operation import REGISTRY
from refsim.core.period import Period, period_group
from refsim.core.walls import WallParticles, planes

REST_DENSITY = 1000.0


@dataclass(frozen=True, eq=False)
class Case:
    """One hard input. Lengths in metres; 2D cases have z = 0."""

    name: str
    dim: int
    position: np.ndarray  # (n, 3) particle positions
    spacing: float = 0.1
    support_radius: float = 0.2
    wall_position: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (m, 3)
    masses: tuple[float, float] = (0.4, 2.5)  # least and greatest mass, in units of rho0 d^dim
    skin: float = 0.1  # share of the support radius by which the neighbour list reaches further
    kernels: str = "wendland"  # here and below settings of the effects whose parameter groups are taken
    state: str = "linear"
    clamp: bool = False
    literal: bool = False
    ties: bool = False  # True where decisions are drawn on purpose, so that few flags are certain

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.position)

    @property
    def list_radius(self) -> float:
        """Distance up to which neighbours are listed, skin left out; the printed fan scan reaches 2 h."""
        return self.support_radius * (2 if self.literal else 1)

    def grid(self, dtype: str) -> Discretisation:
        """Properties of the scene that effects may read."""
        return Discretisation(self.dim, dtype, self.spacing, self.support_radius, self.count)

    @functools.cached_property
    def effects(self) -> Mapping[str, Effect]:
        """Effects whose parameter groups the operations take: those of the methods that give one to every case."""
        discover()
        return {effect.name: effect for effect in (maker(self) for maker in EFFECTS_OF_CASES)}

    def random(self, name: str) -> np.random.Generator:
        """Random numbers for one argument of this case; always the same."""
        return np.random.default_rng(zlib.crc32(f"{self.name}/{name}".encode()))


# Makers by argument name.

Maker = Callable[[Case, np.random.Generator], np.ndarray]
GroupMaker = Callable[[Case, Discretisation], Mapping[str, Any]]
Made = TypeVar("Made", bound=Callable)
PARTICLES: dict[str, Maker] = {}
GROUPS: dict[str, GroupMaker] = {}
DERIVED: dict[str, Callable[[Any, str], Any]] = {}
EFFECTS_OF_CASES: list[Callable[[Case], Effect]] = []  # they make the effects that every case has


def _claim(name: str, maker: Callable, table: dict[str, Any]) -> None:
    """Put a maker into its table. Raises ValueError for a name that another function makes already.

    Two methods that call different arrays by one name would get each other's, with another number of rows.
    """
    for other in (known[name] for known in (PARTICLES, GROUPS, DERIVED) if name in known):
        if (other.__module__, other.__qualname__) != (maker.__module__, maker.__qualname__):
            raise ValueError(f"{name!r} is made twice, in {other.__module__} and in {maker.__module__}; rename one")
    table[name] = maker


def _makers_in(table: dict[str, Any], named: bool = False) -> Callable[..., Callable[[Made], Made]]:
    """What enters functions under names: a decorator with the names, or a call `name=function`.

    named  functions return values by name, but for those of a call, which return that of their name
    """

    def claim(*names: str, **made: Callable) -> Callable[[Made], Made]:
        for name, maker in made.items():
            by_name = functools.wraps(maker)(lambda *given, name=name, maker=maker: {name: maker(*given)})
            _claim(name, by_name if named else maker, table)

        def mark(maker: Made) -> Made:
            for name in names:
                _claim(name, maker, table)
            return maker

        return mark

    return claim


particles = _makers_in(PARTICLES)  # (case, random) -> an array with one row for each particle, in float64
groups = _makers_in(GROUPS, named=True)  # (case, grid) -> parameter groups, in the grid's dtype
derived = _makers_in(DERIVED)  # (inputs, name) -> an argument made from others, as they and their order are then


def prepared(names: str, effect: Callable[[Case], Effect]) -> None:
    """Parameter groups, named in one string, that the effect of a case prepares."""
    groups(*names.split())(lambda case, grid: effect(case).prepare(grid, case.effects))


def other(group: str, **members: Any) -> GroupMaker:
    """A function for an operation's variants: the case's own parameter group with other members."""

    def made(case: Case, grid: Discretisation) -> Any:
        group_of_case = GROUPS[group](case, grid)[group]
        return group_of_case._replace(
            **{name: type(getattr(group_of_case, name))(value) for name, value in members.items()}
        )

    return made


Members = Mapping[str, Any]


@dataclass(frozen=True)
class Variation:
    """How the contract changes the members of one type of parameter group, one at a time."""

    # (group, inputs, smoothing kernel) -> values of the members that follow from others, here or there
    follow: Callable[[Any, Any, Any], Members] = lambda group, inputs, kernel: {}
    held: Mapping[str, str] = field(default_factory=dict)  # members that are never changed alone, each with its reason
    # another legal value of a member, from its own; by default 0.9 of a number, of an integer 1 for 0, else one less
    other: Mapping[str, Callable[[Any], Any]] = field(default_factory=dict)
    usual: tuple[str, ...] | None = None  # members that act in an operation which does not say what it takes; None: all


VARIATIONS: dict[type, Variation] = {}


def following(**members: Callable[[Any, float, int], float]) -> Callable[[Any, Any, Any], Members]:
    """For `Variation.follow`: members that follow from (group, support radius [m], dim), by name."""
    return lambda group, inputs, kernel: {
        name: made(group, float(kernel.support_radius), int(kernel.dim)) for name, made in members.items()
    }


TAKES: dict[tuple[str, str], tuple[str, ...]] = {}


def takes(*operations: str, **members: str) -> None:
    """Say which members of a parameter group act in the operations: `fluid="rest_density clamp"`."""
    for operation in operations:
        TAKES.update({(operation, group): tuple(names.split()) for group, names in members.items()})


READINGS: dict[str, tuple[str, ...]] = {}


def readings(**members: str) -> None:
    """Say which members of a parameter group stand for a misprint, or for a reading of a paper beside the adopted one.

    `fluid="gradient_share wall_share"`; of a group that is there for such a reading alone "".
    """
    READINGS.update({group: tuple(names.split()) for group, names in members.items()})


STAND_INS: dict[str, tuple[str, ...]] = {}  # arguments that other programs get in place of an object of refsim
CODES: dict[tuple[type, str], Mapping[str, int]] = {}


def codes(group: type, **members: Mapping[str, int]) -> None:
    """Say what the integers of members of a parameter group stand for: `codes(Smoothing, shape=SHAPES)`."""
    CODES.update({(group, member): names for member, names in members.items()})


PLAIN_KEEPS: dict[str, Mapping[str, str]] = {}


def plain_keeps(*operations: str, **reasons: str) -> None:
    """Say which optional arguments the operations' plain variant, their first, has, and why.

    The plain variant leaves out all optional arguments, unless the answer were zero for every input.
    """
    for operation in operations:
        PLAIN_KEEPS[operation] = reasons


@dataclass(frozen=True, eq=False)
class Exact:
    """A case whose answer is known in closed form: inputs that matter, and expected outputs, by name.

    Lists become arrays; numbers take the types that the arguments have in a run when a program is given them.
    """

    case: Case
    inputs: Mapping[str, Any]
    expected: Mapping[str, Any]

    def __post_init__(self) -> None:
        for name in ("inputs", "expected"):
            arrays = {key: np.array(v) if isinstance(v, list) else v for key, v in getattr(self, name).items()}
            object.__setattr__(self, name, arrays)


def across_a_border(exact: Exact, length: float, **more: Any) -> Exact:
    """The same pair along y, the second `length` [m] further back in a periodic box of that length; `more` inputs."""
    position = exact.case.position - [[0.0, 0.0, 0.0], [0.0, length, 0.0]]
    case = replace(exact.case, name=f"{exact.case.name}_across", position=position)
    return replace(
        exact, case=case, inputs={**exact.inputs, "period": period_group((0.0, length, 0.0), "float64"), **more}
    )


class Example(NamedTuple):
    """An effect as tests of whole scenes take it: with others, without, with a coefficient of zero, on two backends."""

    effect: Effect
    brings: str  # fields, in one string, that a scene has for this effect and not for those that it needs
    constants: Mapping[str, Mapping[str, Any]]  # {parameter group: {member: value}}, where the paper computes them


EXAMPLES: dict[str, Example] = {}


def example(effect: Effect, brings: str = "", **constants: Mapping[str, Any]) -> None:
    """Enter an effect with the fields that it brings.

    constants: computed by hand in the plane in float64, with a spacing of 0.14 m and a support radius of 0.37 m.

    A member of a parameter group that is a parameter of the effect, of the same name, needs no entry.
    """
    EXAMPLES[effect.name] = Example(effect, brings, constants)


CLOSED_FORMS: dict[str, list[Callable[[], Exact]]] = {}


def closed_form(
    *operations: str, over: Iterable[Any] = (), across: float = 0.0, **named: Callable[[], Exact]
) -> Callable[[Callable[..., Exact]], Callable[..., Exact]]:
    """Mark a function that returns an exactly known case of the operations, or enter functions `name=function`.

    over    its arguments, for each of which it returns one; a tuple stands for several arguments
    across  length [m] of a periodic box across whose border the same pair is another one (`across_a_border`)
    """

    def enter(name: str, maker: Callable[..., Exact]) -> None:
        each = [value if isinstance(value, tuple) else (value,) for value in over] or [()]
        plain = all(isinstance(part, (int, str)) for values in each for part in values)
        parts = each if plain else [(number,) for number in range(len(each))]
        made = [_named(functools.partial(maker, *values), name, *part) for values, part in zip(each, parts)]
        if across:
            made.append(_named(lambda: across_a_border(maker(), across), name, "across"))
        for operation in operations:
            CLOSED_FORMS.setdefault(operation, []).extend(made)

    for name, maker in named.items():
        enter(name, maker)

    def mark(maker: Callable[..., Exact]) -> Callable[..., Exact]:
        enter(maker.__name__, maker)
        return maker

    return mark


def _named(form: Callable[[], Exact], *parts: Any) -> Callable[[], Exact]:
    form.__name__ = "_".join(map(str, parts))
    return form


def at(name: str, position: Any, walls: Any = (), dim: int = 3) -> Case:
    """A case of a closed form: particles, and wall particles, at these places [m], d = 1 m and h = 2 m."""
    places, wall = (np.array(p, float).reshape(-1, 3) for p in (position, walls))
    return Case(name, dim, places, spacing=1.0, support_radius=2.0, wall_position=wall)


def pair_case(name: str, r: float = 1.0) -> Case:
    """Two particles in space, `r` [m] apart along y, with h = 2 m."""
    return at(name, [[0.0, 0.0, 0.0], [0.0, r, 0.0]])


@functools.cache
def discover() -> None:
    """Import `cases.py` of every folder that has registered an operation."""
    for folder in sorted({operation.folder for operation in REGISTRY.values()}):
        if importlib.util.find_spec(f"{folder}.cases"):
            importlib.import_module(f"{folder}.cases")


# The cases.

CASES: dict[str, Callable[[], Case]] = {}
COMMON: list[str] = []


def case(maker: Callable[[], Case]) -> Callable[[], Case]:
    """Enter a case that only the operations meet which name it in `Operation.cases`."""
    CASES[maker.__name__] = functools.cache(maker)
    return CASES[maker.__name__]


def cloud(name: str, count: int, dim: int, spacing: float = 0.1) -> np.ndarray:
    """Random positions (count, 3), on average one particle to spacing^dim, around the origin."""
    side = spacing * count ** (1 / dim)
    position = np.random.default_rng(zlib.crc32(name.encode())).uniform(-0.5 * side, 0.5 * side, (count, 3))
    position[:, dim:] = 0
    return position


def lattice(cells: tuple[int, int, int], spacing: float = 0.1, dim: int = 3) -> np.ndarray:
    """Lattice positions (n, 3), the first particle at the origin."""
    axes = [spacing * np.arange(n if axis < dim else 1) for axis, n in enumerate(cells)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def cloud_with(name: str, count: int, places: Mapping[int, Any]) -> np.ndarray:
    """A random cloud (count, 3) in space, of which some particles, by number, stand at places [m] of their own."""
    position = cloud(name, count, 3)
    for number, place in places.items():
        position[number] = place
    return position


def floor_below(position: np.ndarray, dim: int, spacing: float) -> np.ndarray:
    """One layer of wall particles (m, 3), half a spacing below the lowest particle."""
    low, high = position.min(0), position.max(0)
    axes = [np.arange(low[c], high[c] + spacing, spacing) for c in range(dim - 1)]
    axes.append(np.array([low[dim - 1] - 0.5 * spacing]))
    axes += [np.zeros(1)] * (3 - dim)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def hard_input(
    name: str, dim: int, position: int | Callable[[], Any], floor: bool = False, common: bool = False, **more: Any
) -> None:
    """Enter a case, of a random cloud or at these positions, for every operation if `common`; `more` goes to Case."""

    def made() -> Case:
        spacing = more.get("spacing", 0.1)
        places = cloud(name, position, dim, spacing) if isinstance(position, int) else np.array(position(), float)
        walls = {"wall_position": floor_below(places, dim, spacing)} if floor else {}
        return Case(name, dim, places, **walls, **more)

    CASES[name] = functools.cache(made)
    COMMON.extend([name] * common)


_common = functools.partial(hard_input, common=True)
_common("cloud_3d", 3, 150, floor=True)
# the other set of smoothing kernels, Tait, clamped
_common("cloud_2d", 2, 130, floor=True, support_radius=0.26, kernels="mueller", state="tait", clamp=True)
_common("printed_readings", 2, 90, floor=True, support_radius=0.26, literal=True, kernels="mueller")  # of every erratum
# lattices in which the terms of every interior sum cancel
_common("lattice_3d", 3, lambda: lattice((5, 5, 5)), masses=(1, 1), ties=True)
_common("lattice_2d", 2, lambda: lattice((10, 10, 1), dim=2), floor=True, support_radius=0.27, masses=(1, 1), ties=True)
# exactly on the borders of the search's cells, on both sides of the origin: all numbers are exact in binary
_common(
    "on_cell_borders", 3, lambda: lattice((5, 5, 4), 0.3125) - 2 * 0.3125, spacing=0.3125, support_radius=0.5,
    skin=0.25, ties=True,
)  # fmt: skip
_common("no_particles", 3, lambda: np.zeros((0, 3)))
_common("one_particle", 3, lambda: [[0.3, -0.2, 0.1]])
# so near the edge of the support that its terms are badly conditioned
_common("two_particles", 2, lambda: [[0.0, 0.0, 0.0], [0.12, 0.15, 0.0]])
# the third reaches only one of the others
_common("three_particles", 3, lambda: [[0.0, 0.0, 0.0], [0.1, 0.02, 0.0], [-0.05, 0.03, 0.15]])
# two particles at exactly the same place, among others
_common("coincident_pair", 3, lambda: cloud("coincident_pair", 40, 3)[[0, 0, *range(2, 40)]])
# a pair 1e-12 spacings apart, where the precision of the coordinates distinguishes the two
_common("nearly_coincident", 3, lambda: cloud_with("nearly_coincident", 40, {0: 0.0, 1: [0.0, 1e-13, 0.0]}))
# 1e4 spacings from the origin, and 1e6: there coordinates in float32 come in steps of a sixteenth of a spacing
_common("far_away", 3, lambda: cloud("far_away", 80, 3) + [1000.0, -1000.0, 500.0], floor=True)
_common("very_far_away", 2, lambda: cloud("very_far_away", 60, 2) + [1e5, 6e4, 0.0], support_radius=0.26)
_common("tiny_lengths", 3, 60, floor=True, spacing=0.5e-6, support_radius=1e-6)
_common("huge_lengths", 3, 60, floor=True, spacing=500.0, support_radius=1e3)
_common("unequal_masses", 3, 80, masses=(0.1, 100.0))
# one layer in space, tilted; and a line
_common(
    "thin_sheet", 3, lambda: lattice((9, 9, 1)) @ np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]]).T,
    ties=True,
)  # fmt: skip
_common("filament", 3, lambda: np.linspace(0, 3, 41)[:, None] * np.array([0.6, 0.0, 0.8]), ties=True)
_common("flung_particle", 3, lambda: cloud_with("flung_particle", 60, {7: [1e5, -1e5, 3e4]}))  # by 1e6 spacings
_common("negative_coordinates", 3, lambda: cloud("negative_coordinates", 80, 3) - [7.3, 5.1, 9.9])
# for other values of the parameters; compared on sampled rows
for _name, _count in (("few", 60), ("large", 3000)):
    hard_input(_name, 3, _count, floor=True)
    hard_input(f"{_name}_2d", 2, _count, floor=True, support_radius=0.26)
# more particles than an index of 16 bits or one dimension of a launch counts; compared on sampled rows
MANY = 70_000
hard_input("many_particles", 3, MANY)
hard_input("thousand", 3, 1000, floor=True)
# particles with 300 neighbours, which are more than lists of a fixed length often hold
hard_input("dense_cluster", 3, lambda: 0.19 * cloud("dense_cluster", 310, 3))


def _flattened(name: str) -> Case:
    """A spatial case with z = 0, on a floor of its own where it stands on one."""
    spatial = CASES[name]()
    position = spatial.position * [1.0, 1.0, 0.0]
    floor = floor_below(position, 2, spatial.spacing) if len(spatial.wall_position) else spatial.wall_position
    return replace(spatial, name=f"{name}_2d", dim=2, position=position, wall_position=floor)


_SPATIAL = (
    "no_particles", "one_particle", "three_particles", "coincident_pair", "nearly_coincident", "far_away",
    "tiny_lengths", "huge_lengths", "unequal_masses", "filament", "flung_particle", "negative_coordinates",
)  # fmt: skip
IN_PLANE = {f"{name}_2d": functools.cache(functools.partial(_flattened, name)) for name in _SPATIAL}
CASES |= IN_PLANE


# What every method may name.


@particles("mass")
def _mass(case: Case, random: np.random.Generator) -> np.ndarray:
    low, high = np.log(case.masses)
    return REST_DENSITY * case.spacing**case.dim * np.exp(random.uniform(low, high, case.count))


particles(
    position=lambda case, random: case.position,
    velocity=lambda case, random: vectors(case, random),
    acceleration=lambda case, random: 5 * vectors(case, random),
    build_position=lambda case, random: case.position + 0.02 * case.spacing * vectors(case, random),
)


@particles("position_residual")
def _position_residual(case: Case, random: np.random.Generator) -> np.ndarray:
    """Up to half of the distance between two numbers of single precision; none in closed forms, of few particles."""
    apart = np.spacing(np.abs(case.position).astype(np.float32)).astype(float)
    return (case.count > 3) * random.uniform(-0.5, 0.5, case.position.shape) * apart * (case.position != 0)


def vectors(case: Case, random: np.random.Generator) -> np.ndarray:
    """Random vectors (n, 3) of length about one; in the plane where the case is."""
    values = random.normal(size=(case.count, 3))
    values[:, case.dim :] = 0
    return values


@groups("timestep", "displacement", "extremes")
def _run_values(case: Case, grid: Discretisation) -> Mapping[str, Any]:
    steps = np.array([0.011, 0.012], dtype=grid.dtype) * grid.real(case.spacing)
    return {"timestep": steps, "displacement": np.zeros(3, grid.dtype), "extremes": np.zeros(7, grid.dtype)}


@groups("bounds")
def _bounds(case: Case, grid: Discretisation) -> Mapping[str, Any]:
    """Planes that stop some of the particles, each in the widest gap of its neighbourhood, wider than any step.

    Those near the ends of the first axis are beyond the planes' ends.
    """
    sides = np.full((4, 3), [[-np.inf], [np.inf]] * 2)
    shares = (0.1, 0.3), (0.8, 0.95), (0.0, 0.1), (0.95, 1.0)
    for axis in range(case.dim if case.count > 3 else 0):
        places = np.sort(case.position[:, axis].astype(grid.dtype))
        for k in range(4 if axis == 0 else 2):
            sides[k, axis] = _gap(places, *shares[k])
    return {"bounds": planes(*sides, dtype=grid.dtype)}


def _gap(places: np.ndarray, begin: float, end: float) -> float:
    """Middle of the widest gap of sorted coordinates, between two shares of them."""
    some = places[int(begin * len(places)) : int(end * len(places)) + 2].astype(float)
    widest = int(np.argmax(np.diff(some)))
    return 0.5 * (some[widest] + some[widest + 1])


@groups("wall_particles")
def _wall_particles(case: Case, grid: Discretisation) -> Mapping[str, Any]:
    """Wall particles without a list, as references take them; volumes a little uneven."""
    count = len(case.wall_position)
    volume = 0.6 * case.spacing**case.dim * case.random("walls").uniform(0.8, 1.2, count)
    return {"wall_particles": WallParticles(case.wall_position.astype(grid.dtype), volume.astype(grid.dtype))}


RESOLVED = 1e4  # spacings; a rounding is a thousandth of a spacing there
BOX_GRID = 2.0**-12  # of the spacing's power of two: images on such a grid are shifted without rounding


groups(period=lambda case, grid: period_around(case, grid, 2.3 * case.list_radius * (1 + case.skin)))


def period_around(case: Case, grid: Discretisation, least: float) -> Period:
    """A periodic box half a spacing wider than the particles stand, not below `least` [m]; none along z in the plane.

    There is none along an axis where single precision resolves no spacing at the other end of the box.
    """
    step = BOX_GRID * 2.0 ** math.floor(math.log2(case.spacing))
    lengths = [0.0, 0.0, 0.0]
    for axis in range(case.dim):
        width = float(np.ptp(case.position[:, axis])) if case.count else 0.0
        if width < RESOLVED * case.spacing:
            lengths[axis] = math.ceil(max(width + 0.5 * case.spacing, least) / step) * step
    return period_group((lengths[0], lengths[1], lengths[2]), grid.dtype)


def _period_follows(group: Any, inputs: Any, kernel: Any) -> Members:
    made = period_group((float(group.x), float(group.y), float(group.z)), "float64")._asdict()
    return {name: made[name] for name in ("inverse_x", "inverse_y", "inverse_z")}


VARIATIONS[Period] = Variation(_period_follows, other=dict.fromkeys("xyz", lambda length: 0.9 * length or 1.2))
