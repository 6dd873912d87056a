"""Panels: observables with a reference, and the settings that were measured of each, as plain files beside this one.

NAME.toml holds the scene of the base setting, where NAME.zip does not hold all, and in its table [panel] what is
observed, against which reference, and the settings. The function NAME of `observables` reads the value, `measured`
measures the settings, and NAME.json holds what was measured, one setting a line, with the machine, commit and date.
"""

import functools
import importlib.resources
import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.study.convergence import Reference, converge

SCHEMA = "refsim panel, version 3"
OWN = "refsim"
GIVEN = ("words", "knobs", "setting", "program", "on")  # of a point, by NAME.toml
FOLDER = importlib.resources.files("refsim") / "study" / "panels"


class Point(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One setting on a backend, and what was measured of it."""

    key: str = ""  # name within the panel; on "cuda" it begins with "cuda_"
    place: int = -1  # number of the panel's place where it was measured; -1 where it was not
    value: float | None = None  # median of the readings
    value_mad: float = 0.0  # median absolute deviation
    error: float | None = None  # median of the readings' relative errors
    error_mad: float = 0.0
    seconds: list[float] = []  # of the whole run, one for each reading: of the processor, on a GPU of the clock
    steps: int = 0
    particles: int = 0
    bytes: int | None = None  # of the fields
    failed: str = ""  # why the setting failed; "" if it did not
    words: str = ""  # the setting in words
    knobs: dict[str, Any] = {}  # spacing, step (share of the stable one), dtype, backend ...; no two have the same
    setting: dict[str, Any] = {}  # what else its run takes
    program: str = OWN  # or another program, which runs on a CPU
    on: tuple[str, ...] = ("cpu", "cuda")  # backends on which it is measured

    @property
    def gpu(self) -> bool:
        """Whether it was measured on a GPU."""
        return bool(self.knobs.get("backend") == "cuda")


class PanelSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a panel observes, against what."""

    words: str  # the observable
    relative: str  # what an error of 1 is
    observed: str  # how the value is read, with its unit
    reference: str  # what the error is taken from, in words
    page: str  # of docs/ that explains it
    base: str  # key of the setting from which others differ in one thing
    value: float = 0.0  # error = |value of a point - value|/scale
    scale: float = 1.0
    uncertainty: float = 0.0  # of the reference, relative
    uncertain: str = "grid convergence index of the limit"  # why it is
    limit_of: tuple[str, ...] | None = None  # keys of spacings whose Richardson limit is the reference
    unit: str = ""  # of the value where errors are given in it, too
    method: str = "backend"  # knob whose values are the picture's lines
    more: tuple[float, ...] = ()  # errors in the table beside those of all panels
    remark: str = ""  # what the reader must know, one sentence
    peer: str = ""  # what other programs have of it, where none was measured here
    with_spacing: tuple[str, ...] = ()  # parameters of the packaged scene, by name, in proportion to the spacing
    reaches: float | None = None  # the value is the time at which the observable has this value
    start: str = ""  # function of `scenes.STARTS` that gives a reading's particles; "shaken" ones give errors a noise
    bars: dict[str, tuple[float, str]] = {}  # key of a setting -> (error that it keeps at most, why)
    settings: dict[str, Point] = {}  # by key


class Machine(msgspec.Struct, frozen=True):
    """Where and when points were measured; `device` is the GPU, "" on a CPU."""

    machine: str
    threads: int
    date: str
    commit: str | None = None
    device: str = ""
    driver: str = ""
    cores: int | None = None
    load: list[float] | None = None
    versions: dict[str, str] = {}


@dataclass(frozen=True)
class Panel:
    """An observable, what it is held against, and its measured points by key."""

    name: str
    about: PanelSpec
    places: tuple[Machine, ...]
    points: Mapping[str, Point]

    def reference(self) -> Reference:
        """What errors are taken from; of `limit_of` the extrapolated value and the grid convergence index."""
        about = self.about
        if about.limit_of is None:
            return Reference(about.value, about.scale, about.uncertainty, about.reference)
        points = [self.points[key] for key in about.limit_of]
        limit = converge([p.knobs["spacing"] for p in points], [p.value for p in points if p.value is not None])
        return Reference(limit.value, abs(limit.value), limit.relative, about.reference)

    def error(self, point: Point) -> float:
        """Relative error of a point; infinite where it failed."""
        if point.failed or point.value is None or point.error is None:
            return math.inf
        return point.error if self.about.limit_of is None else self.reference().error(point.value)

    def where(self, point: Point) -> str:
        """Where and when a point was measured, in words."""
        return f"{self.machine(point)}{self.threads(point)}, {self.places[point.place].date}"

    def machine(self, point: Point) -> str:
        """The GPU, or the processor, on which a point was measured."""
        place = self.places[point.place]
        return place.device or place.machine

    def threads(self, point: Point) -> str:
        """More than one thread of a CPU, in words; "" for one and for a GPU."""
        count = 1 if point.gpu else self.places[point.place].threads
        return f", {count} threads" if count > 1 else ""


@functools.cache
def abouts() -> dict[str, PanelSpec]:
    """What every panel observes, by name, in the order of their pages."""
    texts = {file.name: file.read_text(encoding="utf-8") for file in FOLDER.iterdir() if file.name.endswith(".toml")}
    known = {name[:-5]: msgspec.convert(tomllib.loads(text)["panel"], PanelSpec) for name, text in texts.items()}
    return dict(sorted(known.items(), key=lambda item: (item[1].page, item[0])))


@functools.cache
def panel(name: str) -> Panel:
    """A panel with its points. Raises InputError for an unknown one."""
    known = abouts()
    if name not in known:
        raise InputError(f"there is no panel {name!r}; {suggestion(name, known)}")
    file = FOLDER / f"{name}.json"
    if not file.is_file():
        return Panel(name, known[name], (), _points(known[name]))
    return parse(file.read_text(encoding="utf-8"))


def _points(about: PanelSpec) -> dict[str, Point]:
    """The panel's points by key, nothing measured."""
    points = {}
    for name, given in about.settings.items():
        for backend in given.on if given.program == OWN else ("cpu",):
            gpu, knobs = backend == "cuda", {**given.knobs, "backend": backend}
            key, words = "cuda_" * gpu + name, given.words + ", on a GPU" * gpu
            points[key] = msgspec.structs.replace(given, key=key, words=words, knobs=knobs)
    return points


def parse(text: str) -> Panel:
    """The panel of a file NAME.json. Raises InputError for another file."""
    try:
        data = json.loads(text)
        if data["schema"] != SCHEMA:
            raise ValueError(f"its schema is {data['schema']!r}, not {SCHEMA!r}")
        about = abouts()[data["name"]]
        points = _points(about)
        for row in data["points"]:
            points[row["key"]] = msgspec.structs.replace(points[row["key"]], **row)
        return Panel(data["name"], about, msgspec.convert(data["places"], tuple[Machine, ...]), points)
    except (KeyError, TypeError, ValueError) as error:  # msgspec.ValidationError is a ValueError
        raise InputError(f"this is no stored panel ({error}); measure it anew (refsim study).") from None


def as_text(panel: Panel) -> str:
    """What was measured of the panel as its file: one point a line, without what is at its default."""
    head = {"schema": SCHEMA, "name": panel.name, "places": msgspec.to_builtins(panel.places)}
    rows = (msgspec.to_builtins(point) for point in panel.points.values() if point.place >= 0)
    lines = [json.dumps({k: v for k, v in one.items() if k not in GIVEN}, allow_nan=False) for one in rows]
    return json.dumps(head)[:-1] + ', "points": [\n' + ",\n".join(lines) + "\n]}\n"
