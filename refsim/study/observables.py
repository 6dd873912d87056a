"""Observables of a scene: one number of a simulation, now.

front, front:-y                   edge of the connected liquid along an axis [m]
kinetic_energy                    of all particles [J; J/m in 2D], with velocities half a step behind the positions
field:density@0.1,0.05,0          a field at a point [m], as an average weighted with a smoothing kernel
field:velocity.x@mean             a component of a field over all particles: mean, max or min
gauge:NAME, gauge:NAME.force_y@max  the last value of a scene's gauge, or its mean, max or min, of a column
panel:NAME                        that of a panel of docs/study.md
FILE.py:function                  function(simulation) -> float

A function of one's own may watch the run: with the attribute `times`, a function of the scene that gives moments [s],
it is read at each of them, and its attribute `reduce` makes one number of the moments and what was read. Where reading
is the work whose seconds count, its attribute `seconds` gives them of what was read.
"""

import hashlib
import os
import re
import runpy
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import refsim.core
from refsim.core.errors import InputError
from refsim.engine.simulation import Simulation
from refsim.neighbours.reference import nearest_image
from refsim.scene.files import suggestion
from refsim.scene.overlaps import connected
from refsim.scene.plan import Plan
from refsim.scene.scene import Scene
from refsim.study.panels import FOLDER, panel

OVER_ALL: dict[str, Callable[[np.ndarray], Any]] = {"mean": np.mean, "max": np.max, "min": np.min}
LINK = 2.0  # spacings up to which two particles of the liquid count as connected
Reader = Callable[[Simulation], float]


@dataclass(frozen=True)
class Observable:
    """A number of a simulation; what watches a run, see above, is None for a number that is read at the end."""

    name: str
    unit: str
    read: Reader
    digest: str  # of what reads it; "" of a function of Python, of whose source no file is known
    times: Callable[[Scene], Sequence[float]] | None = None
    reduce: Callable[[np.ndarray, list[Any]], float] | None = None
    seconds: Callable[[list[Any]], float] | None = None

    def __call__(self, simulation: Simulation) -> float:
        """Its value now. Raises InputError where it cannot be read."""
        return self.tried(lambda: float(self.read(simulation)))

    def tried(self, attempt: Callable[[], Any]) -> Any:
        """What an attempt to read it gives. Raises InputError where that fails."""
        try:
            return attempt()
        except InputError:
            raise
        except (Exception, SystemExit) as error:  # a user's own function may fail in any way, and end the program
            raise InputError(f"observable {self.name}: it cannot be read ({_words(error)}); correct it.") from error


class Watching:
    """An observable while a run goes on: called at its start and after every step, it reads what is due.

    times, values  moments [s] at which it was read, each the first step's end at or after one of its own, and what was
    """

    def __init__(self, observable: Observable, scene: Scene) -> None:
        self.observable, moments = observable, observable.times
        self.due = [] if moments is None else observable.tried(lambda: sorted(map(float, moments(scene))))
        self.times: list[float] = []
        self.values: list[Any] = []

    def __call__(self, simulation: Simulation) -> None:
        while self.due and simulation.time >= self.due[0]:
            self.due.pop(0)
            self.times.append(simulation.time)
            self.values.append(self.observable.tried(lambda: self.observable.read(simulation)))

    def value(self, simulation: Simulation) -> float:
        """The number that was read, or that of the present state. Raises InputError where no moment has come."""
        observable = self.observable
        if observable.times is None:
            return observable(simulation)
        if not self.times:
            raise InputError(f"observable {observable.name}: the run ended before it was read; give a later end.")
        reduce = observable.reduce or (lambda times, values: values[-1])
        return observable.tried(lambda: float(reduce(np.array(self.times), self.values)))


def observable_of(given: str | Callable[[Simulation], float] | Observable, plan: Plan) -> Observable:
    """The observable that a text or a function names, for scenes like this plan's.

    Raises InputError where there is no such observable or the scene lacks its field.
    """
    if isinstance(given, Observable):
        return given
    if callable(given):
        return Observable(getattr(given, "__name__", "observable"), "", given, "", *_watch(given))
    word, _, rest = given.partition(":")
    named = {"front": _front, "field": _field, "gauge": _gauge}
    if word in named:
        return named[word](given, rest, plan)
    if given == "kinetic_energy":
        return Observable(given, "J" if plan.grid.dim == 3 else "J/m", _kinetic_energy, _digest(given))
    if word == "panel":
        panel(rest)  # refuses an unknown one
        given = f"{FOLDER / 'observables.py'}:{rest}"
    path, _, function = given.rpartition(":")
    if path.endswith(".py"):
        return _from_file(given, Path(path), function)
    known = ("front", "kinetic_energy", "field:NAME@POINT", "gauge:NAME", "panel:NAME", "FILE.py:function")
    raise InputError(f"there is no observable {given!r}; {suggestion(word, known)}")


def _front(name: str, direction: str, plan: Plan) -> Observable:
    match = re.fullmatch(r"([+-]?)([xyz])", direction or "+x")
    if not match or (plan.grid.dim == 2 and match[2] == "z"):
        axes = "x, y" if plan.grid.dim == 2 else "x, y, z"
        raise InputError(f"observable {name!r}: {direction!r} is no direction; write front:+AXIS or -AXIS of {axes}.")
    axis, sign = "xyz".index(match[2]), -1.0 if match[1] == "-" else 1.0

    def front(simulation: Simulation) -> float:
        """Edge of the largest connected group of liquid, half a spacing beyond its outermost particle."""
        from scipy.spatial import cKDTree

        grid = simulation.plan.grid
        points = simulation.field("position")[_liquid(simulation)].astype(float)
        if not len(points):
            raise InputError(f"observable {name!r}: the scene has no liquid; choose another observable.")
        pairs = cKDTree(points).query_pairs(LINK * grid.spacing, output_type="ndarray")
        group = connected(len(points), *pairs.T)
        reach = sign * points[group == np.argmax(np.bincount(group)), axis]
        return sign * (float(reach.max()) + 0.5 * grid.spacing)

    return Observable(name, "m", front, _digest(name))


def _liquid(simulation: Simulation) -> np.ndarray:
    """Which particles are not nodes of solids."""
    liquid = np.ones(simulation.count, bool)
    solids = simulation.plan.grid.solids
    if solids is not None:
        liquid[: len(solids.lattice.key)] = False
    return liquid


def _kinetic_energy(simulation: Simulation) -> float:
    mass, velocity = (simulation.field(name).astype(float) for name in ("mass", "velocity"))
    return float(0.5 * (mass * (velocity**2).sum(1)).sum())


def _field(name: str, rest: str, plan: Plan) -> Observable:
    field, _, where = rest.partition("@")
    field, _, part = field.partition(".")
    if field not in plan.particle_fields:
        raise InputError(f"observable {name!r}: there is no field {field!r}; {suggestion(field, plan.particle_fields)}")
    about = plan.particle_fields[field]
    if (about.components > 1) != bool(part) or (part and part not in "xyz"[: about.components]):
        parts = " or ".join(f"field:{field}.{axis}" for axis in "xyz"[: about.components])
        wanted = parts if about.components > 1 else f"field:{field}"
        raise InputError(f"observable {name!r}: {field} has {about.components} components; write {wanted}.")
    point = None if where in OVER_ALL else _point(name, where, plan.grid.dim)

    def value(simulation: Simulation) -> float:
        values = simulation.field(field).astype(float)
        if part:
            values = values[:, "xyz".index(part)]
        if point is None:
            return float(OVER_ALL[where](values))
        return _at(name, simulation, values, point)

    return Observable(name, about.unit, value, _digest(name))


def _gauge(name: str, rest: str, plan: Plan) -> Observable:
    rest, _, where = rest.partition("@")
    gauge, _, column = rest.partition(".")
    known = {one.name: dict(one.columns(plan.grid.dim)) for one in plan.scene.gauge}
    if gauge not in known:
        hint = suggestion(gauge, known) if known else "add a [[gauge]] to the scene."
        raise InputError(f"observable {name!r}: there is no gauge {gauge!r}; {hint}")
    units = known[gauge]
    column = column or (next(iter(units)) if len(units) == 1 else "")
    if column not in units or where not in ("", *OVER_ALL):
        wanted = ", ".join(f"gauge:{gauge}.{each}" for each in units)
        raise InputError(f"observable {name!r}: write one of {wanted}, with nothing or one of @{', @'.join(OVER_ALL)}.")

    def value(simulation: Simulation) -> float:
        series = simulation.gauge(gauge)[column]
        return float(OVER_ALL[where](series) if where else series[-1])

    return Observable(name, units[column], value, _digest(name))


def _point(name: str, text: str, dim: int) -> np.ndarray:
    try:
        point = np.array([float(word) for word in text.split(",")])
    except ValueError:
        point = np.empty(0)
    if len(point) not in (dim, 3) or not np.isfinite(point).all():
        raise InputError(
            f"observable {name!r}: {text!r} is no point; write {dim} coordinates in metres with commas between, as in"
            f" @{','.join(['0.1'] * dim)}, or one of @{', @'.join(OVER_ALL)}."
        )
    return np.concatenate([point, np.zeros(3 - len(point))])


def _at(name: str, simulation: Simulation, values: np.ndarray, point: np.ndarray) -> float:
    """Average at a point [m], weighted with (1 - r^2/h^2)^3 within the support radius h."""
    h = simulation.plan.grid.support_radius
    apart = nearest_image(simulation.field("position").astype(float) - point, simulation.plan.grid.period)
    near = 1 - (apart**2).sum(1) / h**2
    weight = np.maximum(near, 0.0) ** 3
    if not weight.any():
        raise InputError(
            f"observable {name!r}: no particle is within the support radius of {h:.3g} m of that point at"
            f" {simulation.time:.4g} s; choose a point inside the material."
        )
    return float((weight * values).sum() / weight.sum())


def _from_file(name: str, path: Path, function: str) -> Observable:
    if not path.is_file():
        raise InputError(f"observable {name!r}: there is no file {path}; write the path of a Python file.")
    forget(local_modules(path))
    try:
        measure = runpy.run_path(str(path)).get(function)
    except (Exception, SystemExit) as error:  # the file is the user's program
        raise InputError(f"observable {name!r}: {path} cannot be run ({_words(error)}); correct it.") from error
    if not callable(measure):
        raise InputError(f"observable {name!r}: {path} has no function {function!r}; write FILE.py:function.")
    unit = str(getattr(measure, "unit", ""))
    return Observable(f"{path.stem}.{function}", unit, measure, digest_of(name), *_watch(measure))


def _watch(function: Callable[..., Any]) -> Iterator[Any]:
    """What a function says of how it watches a run; None for what it does not."""
    return (getattr(function, name, None) for name in ("times", "reduce", "seconds"))


def digest_of(name: str) -> str:
    """Digest of an observable that is a text: of what it is called, and of a file with the modules that it imports."""
    path, _, function = name.rpartition(":")
    if not path.endswith(".py"):
        return _digest(name)
    files = sorted(local_modules(Path(path)))
    digests = [(os.path.relpath(file, Path(path).resolve()), _digest(file.read_bytes())) for file in files]
    return _digest(repr((function, digests)))


def _words(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"


def _digest(content: str | bytes) -> str:
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


REFSIM = Path(refsim.core.__file__).resolve().parent.parent


def local_modules(path: Path) -> set[Path]:
    """A Python file and those of its folder and below that it may import, directly or through others.

    They are those whose names stand in the text, whatever for. What is installed and refsim itself do not count.
    """
    path = path.resolve()
    top, installed = path.parent, sys.prefix
    folders = {top, *(way for way in map(Path, sys.path) if top in way.parents and not way.is_relative_to(installed))}
    found, words, new = set[Path](), {"__init__"}, {path}
    while new:
        found |= new
        folders |= {place for place in new if place.is_dir()}
        texts = (place.read_bytes() for place in new - folders)
        words |= {word.decode() for text in texts for word in re.findall(rb"[A-Za-z_]\w*", text)}
        named = {place.resolve() for folder in folders for place in folder.glob("*") if place.stem in words}
        below = (place for place in named - found - folders if top in place.parents and place != REFSIM)
        new = {place for place in below if place.is_dir() or (place.suffix == ".py" and os.access(place, os.R_OK))}
    return found - folders


def forget(files: set[Path]) -> None:
    """Have these modules loaded anew when they are imported next: their text may have changed since."""
    places = files | {file.parent for file in files}  # a folder without __init__.py keeps its modules by name
    names = {place.stem for place in places}
    for name, module in list(sys.modules.items()):
        if name.rpartition(".")[2] in names and not name.startswith("refsim."):
            place = getattr(module, "__file__", None) or next(iter(getattr(module, "__path__", ())), "")
            if Path(place).resolve() in places:
                del sys.modules[name]
