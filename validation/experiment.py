"""What an experiment is: runs, whose results are stored, and checks of what they gave.

A folder of `validation/experiments/` whose module `runs` has an `EXPERIMENT` is one; its checks stand beside it in
`expected.toml` (`validation.checks`), its pictures in `pictures.py`, what it is made of in `scene.py`. Verdicts and
their pictures come from the runs of the experiment itself;
claims of a paper, hard cases and maps of what is stable bring runs of their own.
"""

import dataclasses
import difflib
import functools
import importlib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from refsim.core.errors import InputError
from validation import experiments as folder_of_experiments
from validation.checks import CLAIM, HARD_CASE, VALUE, VERDICT, Check, Checks, Family, families, map_words, read
from validation.results import Result, real
from validation.tables import Table, of_values
from validation.trials import StabilityMap

Results = Mapping[str, Result]
COMMANDS = {VERDICT: "run", CLAIM: "claims", HARD_CASE: "stability", VALUE: "verify"}
T = TypeVar("T")


@dataclass(frozen=True)
class Options:
    """The user's options.

    quick    the small sizes of `reproduce.py --quick`, otherwise the published ones
    peers    also run other programs on the same work
    fresh    compute anew what is stored
    threads  of the CPU; all without
    only     runs whose keys start like one of these; all without
    scheduler  address of a Dask scheduler, whose workers compute all runs that are not timed
    """

    quick: bool = False
    backend: str = "cpu"
    peers: bool = False
    fresh: bool = False
    threads: int | None = None
    results: Path = Path("results")
    figures: Path = Path("figures")
    only: tuple[str, ...] = ()
    scheduler: str | None = None


@dataclass(frozen=True)
class RunSpec:
    """One computation: `function(context, **parameters)`, stored under `key` and the digest of its parameters.

    estimate  seconds it may take, for the progress bar
    skip      why it is left out, if it is
    timed     its time is what it measures: it runs alone, on all threads; so does one with a parameter `threads`
    rough     its time is a rough one: it may run beside others all the same
    """

    key: str
    function: Callable[..., Result]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    estimate: float = 1.0
    skip: str = ""
    timed: bool = False
    rough: bool = False

    @property
    def alone(self) -> bool:
        """Whether nothing may run beside it."""
        return not self.rough and (self.timed or "threads" in self.parameters)


@dataclass(frozen=True)
class Picture:
    """A picture and the data it is drawn from: `collect` gives what JSON takes, `draw` makes a figure of that alone.

    `needs`: the runs whose results it shows. `shaded` pictures (rendered surfaces, thousands of particles) are stored
    as WebP, plots as PNG with a palette.
    """

    name: str
    collect: Callable[[Results], Mapping[str, Any]]
    draw: Callable[[Mapping[str, Any]], Any]
    needs: tuple[str, ...] = ()
    shaded: bool = False

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"{self.name}.webp" if self.shaded else f"{self.name}.png"


@dataclass(frozen=True)
class Part:
    """The runs of one kind of checks that an experiment has under the user's options.

    name    of the experiment or the claim
    folder  in which its results are kept, below the folder of results
    checks, tables   from the results that are there; pictures are drawn where all that they need is there
    """

    kind: str
    name: str
    folder: str
    runs: Sequence[RunSpec]
    checks: Callable[[Results], Sequence[Check]]
    pictures: Sequence[Picture] = ()
    tables: Callable[[Results], Sequence[Table]] = lambda results: ()

    @property
    def command(self) -> str:
        """The command that measures it."""
        return f"python -m validation {COMMANDS[self.kind]} {self.name}"


@dataclass(frozen=True)
class Measure:
    """How a claim is measured: runs whose results are stored, and the values that follow, one for each start.

    quick   whether the quick sizes can judge it
    timed   its runs are timed: they run alone, on all threads, after the others
    family  the claims that it is measured with, and model: the function that its null model is, if it has one
    """

    runs: Callable[[Options], Sequence[RunSpec]]
    values: Callable[[Results], Sequence[float]]
    quick: bool = True
    timed: bool = False
    family: Family | None = None
    model: Callable[..., Sequence[float]] | None = None

    def null(self) -> list[float]:
        """The values on the null model of its family, which must refute the claim; none without a family."""
        if self.family is None:
            return []
        return (
            [float(v) for v in self.model(self, **self.family.given)]
            if self.model
            else self.of({"": self.family.values})
        )

    def of(self, results: Mapping[str, Any], full: bool = True) -> list[float]:
        """The values that follow if the runs gave the numbers `results`, by key, or all the same ones under ""."""
        keys = [run.key for run in self.runs(Options(quick=not full))]
        return [float(v) for v in self.values({key: Result(results[key if key in results else ""]) for key in keys})]


def every(
    function: Callable[..., Result], runs: Mapping[str, Mapping[str, Any]], estimate: float = 1.0, **shared: Any
) -> Callable[[Options], list[RunSpec]]:
    """Plans a run of each key: its own parameters, those that all share, and the user's backend if it takes one."""
    takes = "backend" in inspect.signature(function).parameters

    def planned(options: Options) -> list[RunSpec]:
        given = {**shared, "backend": options.backend} if takes else shared
        return [RunSpec(key, function, {**options, **given}, estimate) for key, options in runs.items()]

    return planned


def each(value: str | Callable[[Mapping[str, Any]], float], over: str = "") -> Callable[[Results], list[float]]:
    """A number of each run: the name of a value, or a function of all; over the value named `over`, if it is given."""

    def number(values: Mapping[str, Any]) -> float:
        quantity = value(values) if callable(value) else real(values[value])
        return quantity / real(values[over]) if over else quantity

    return lambda results: [number(result.values) for result in results.values()]


@dataclass(frozen=True)
class Experiment:
    """One experiment.

    name        of its folder
    runs        what is to be computed under the options
    checks      calls `check(name, value)` for every quantity of the results that are there
    pictures    of the runs and of the hard cases
    tables      from the results that are there; by default their numbers
    claims      how each claim of its `expected.toml` is measured, by name
    trials      the functions that the hard cases of its `expected.toml` name
    maps        how far a setting can go, the words of a map from `expected.toml`
    """

    name: str
    title: str
    runs: Callable[[Options], Sequence[RunSpec]] = lambda options: ()
    checks: Callable[[Results, Checks], None] = lambda results, check: None
    pictures: tuple[Picture, ...] = ()
    tables: Callable[[Results], Sequence[Table]] = of_values
    claims: Mapping[str, Measure] = field(default_factory=dict)
    trials: Mapping[str, Callable[..., Result]] = field(default_factory=dict)
    maps: tuple[StabilityMap, ...] = ()

    def checked(self, results: Results) -> list[Check]:
        """The verdicts on what is there."""
        check = Checks(self.name)
        self.checks(results, check)
        return check.results

    def part(self, options: Options) -> Part:
        """Its own runs, with the verdicts on them."""
        hard = read(self.name, HARD_CASE).keys()
        drawn = tuple(p for p in self.pictures if not hard & set(p.needs))
        return Part(VERDICT, self.name, self.name, self.runs(options), self.checked, drawn, self.tables)


def measures(module: ModuleType, families: Iterable[Family]) -> dict[str, Measure]:
    """Every `Measure` of a module and of its table CLAIMS with its family, by the name of its claim in small letters.

    Raises ValueError for a family of what is no measure.
    """
    named = vars(module) | getattr(module, "CLAIMS", {})
    by_name = {name.lower(): value for name, value in named.items() if isinstance(value, Measure)}
    for family in families:
        if unknown := set(family.claims) - set(by_name):
            raise ValueError(f"{module.__name__}: families name {sorted(unknown)}, which are no measures")
        model = getattr(module, family.model) if family.model else None
        by_name |= {name: dataclasses.replace(by_name[name], family=family, model=model) for name in family.claims}
    return by_name


@functools.cache
def discover(folder: ModuleType = folder_of_experiments) -> dict[str, Experiment]:
    """The experiments by name, each with the pictures, claims and trials of its folder.

    `EXPERIMENT` of a module `runs` is that of the folder's name; `OTHER_EXPERIMENT` is one that shares its scenes.
    Pictures of the first are `PICTURES` of the module `pictures`, of the other `OTHER_PICTURES`; cells of its maps are
    `MAPS` of `runs`, by name. Raises ValueError for an experiment that is not called as its folder is.
    """
    experiments = {}
    for path in sorted(path for place in folder.__path__ for path in Path(place).glob("*/runs.py")):
        module = importlib.import_module(f"{folder.__name__}.{path.parent.name}.runs")
        drawn = (
            importlib.import_module(f"{module.__package__}.pictures")
            if path.with_name("pictures.py").exists()
            else None
        )
        if (name := module.EXPERIMENT.name) != path.parent.name:
            raise ValueError(f"the experiment in {path.parent} is called {name!r}")
        measured = measures(module, families(path.parent.name))
        for prefix in (key.removesuffix("EXPERIMENT") for key in vars(module) if key.endswith("EXPERIMENT")):
            experiment, maps = getattr(module, f"{prefix}EXPERIMENT"), getattr(module, f"{prefix}MAPS", {})
            experiments[experiment.name] = dataclasses.replace(
                experiment, pictures=getattr(drawn, f"{prefix}PICTURES", ()), trials=vars(module),
                claims={name: measured[name] for name in read(experiment.name, CLAIM) if name in measured},
                maps=tuple(StabilityMap(n, **map_words(path.parent.name, n), cells=c) for n, c in maps.items()),
            )  # fmt: skip
    return dict(sorted(experiments.items()))


def chosen(names: Iterable[str], known: Mapping[str, T], what: str) -> list[T]:
    """The named ones, or all without names. Raises InputError for a name that there is not."""
    names = list(names)
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            some = ", ".join([*known][:20]) + (", ..." if len(known) > 20 else "")
            hint = f"did you mean {near[0]!r}?" if near else f"choose from {some}."
            raise InputError(f"There is no {what} {name!r}; {hint}")
    return [known[name] for name in names or known]
