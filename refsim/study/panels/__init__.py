"""Panels: observables with a reference, and the settings that were measured of each, as plain files beside this one.

panels.toml says what each panel observes and against which reference; NAME.json holds its settings, one a line, with
what was measured of them and the machine, commit and date. The scene of a setting is made by `scenes`, the value is
read by the function NAME of `observables`, and `measured` measures them.
"""

import functools
import importlib.resources
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import msgspec

from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.study.convergence import converge

SCHEMA = "refsim panel, version 2"
OWN = "refsim"
FOLDER = importlib.resources.files("refsim") / "study" / "panels"


class About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a panel observes, against what.

    words         the observable
    relative      what an error of 1 is
    observed      how the value is read, with its unit
    reference     what the error is taken from, in words
    page          of docs/ that explains it
    base          key of the setting from which others differ in one thing
    value, scale  error = |value of a point - value|/scale
    uncertainty, uncertain  of the reference, relative, and why
    limit_of      keys of spacings whose Richardson limit is the reference
    unit          of the value where errors are given in it, too
    method        knob whose values are the picture's lines
    more          errors in the table beside those of all panels
    remark        what the reader must know, one sentence
    peer          what other programs have of it, where none was measured here
    with_spacing  parameters of the packaged scene, by name, that are in proportion to the spacing
    reaches       the value is the time at which the observable has this value
    shaken        whether each reading starts from particles displaced otherwise, so that errors have a noise
    bars          key of a setting -> (error that it keeps at most, why)
    """

    words: str
    relative: str
    observed: str
    reference: str
    page: str
    base: str
    value: float = 0.0
    scale: float = 1.0
    uncertainty: float = 0.0
    uncertain: str = "grid convergence index of the limit"
    limit_of: tuple[str, ...] | None = None
    unit: str = ""
    method: str = "backend"
    more: tuple[float, ...] = ()
    remark: str = ""
    peer: str = ""
    with_spacing: tuple[str, ...] = ()
    reaches: float | None = None
    shaken: bool = False
    bars: dict[str, tuple[float, str]] = {}


class Point(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One setting, and what was measured of it.

    key, words      name within the panel, and the setting in words
    program         "refsim", or another program
    knobs           what distinguishes it: spacing, step (share of the stable one), dtype, backend ...
    setting         what else its run takes
    place           number of the panel's place where it was measured
    value, error    median of the readings, and of their relative errors; `value_mad`, `error_mad`: median absolute
                    deviations
    seconds         of the whole run, one for each reading: of the processor, on a GPU of the clock
    bytes           of the fields
    failed          why the setting failed; "" if it did not
    """

    key: str
    words: str
    place: int
    knobs: dict[str, Any]
    program: str = OWN
    setting: dict[str, Any] = {}
    value: float | None = None
    value_mad: float = 0.0
    error: float | None = None
    error_mad: float = 0.0
    seconds: list[float] = []
    steps: int = 0
    particles: int = 0
    bytes: int | None = None
    failed: str = ""

    @property
    def gpu(self) -> bool:
        """Whether it was measured on a GPU."""
        return bool(self.knobs.get("backend") == "cuda")


class Place(msgspec.Struct, frozen=True):
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
    about: About
    places: tuple[Place, ...]
    points: Mapping[str, Point]

    def reference(self) -> tuple[float, float, float]:
        """(value, scale, relative uncertainty) of what errors are taken from.

        Of `limit_of`: the extrapolated value, twice, and the grid convergence index.
        """
        about = self.about
        if about.limit_of is None:
            return about.value, about.scale, about.uncertainty
        points = [self.points[key] for key in about.limit_of]
        found = converge([p.knobs["spacing"] for p in points], [p.value for p in points if p.value is not None])
        return found.value, abs(found.value), found.relative

    def error(self, point: Point) -> float:
        """Relative error of a point; infinite where it failed."""
        if point.failed or point.value is None or point.error is None:
            return math.inf
        if self.about.limit_of is None:
            return point.error
        value, scale, _ = self.reference()
        return abs(point.value - value) / scale

    def where(self, point: Point) -> str:
        """Where and when a point was measured, in words."""
        place = self.places[point.place]
        return f"{place.device or place.machine}{self.threads(point)}, {place.date}"

    def threads(self, point: Point) -> str:
        """More than one thread of a CPU, in words; "" for one and for a GPU."""
        count = 1 if point.gpu else self.places[point.place].threads
        return f", {count} threads" if count > 1 else ""


@functools.cache
def abouts() -> dict[str, About]:
    """What every panel observes, by name."""
    return msgspec.toml.decode((FOLDER / "panels.toml").read_bytes(), type=dict[str, About])


@functools.cache
def panel(name: str) -> Panel:
    """A panel with its points. Raises InputError for an unknown one."""
    known = abouts()
    if name not in known:
        raise InputError(f"there is no panel {name!r}; {suggestion(name, known)}")
    return parse((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def parse(text: str) -> Panel:
    """The panel of a file NAME.json. Raises InputError for another file."""
    try:
        data = json.loads(text)
        if data["schema"] != SCHEMA:
            raise ValueError(f"its schema is {data['schema']!r}, not {SCHEMA!r}")
        points = msgspec.convert(data["points"], list[Point])
        places = msgspec.convert(data["places"], tuple[Place, ...])
        return Panel(data["name"], abouts()[data["name"]], places, {p.key: p for p in points})
    except (KeyError, TypeError, ValueError) as error:  # msgspec.ValidationError is a ValueError
        raise InputError(f"this is no stored panel ({error}); measure it anew (refsim study).") from None


def as_text(panel: Panel) -> str:
    """The panel as its file: one point a line, without what is at its default."""
    head = {"schema": SCHEMA, "name": panel.name, "places": msgspec.to_builtins(panel.places)}
    lines = [json.dumps(msgspec.to_builtins(point), allow_nan=False) for point in panel.points.values()]
    return json.dumps(head)[:-1] + ', "points": [\n' + ",\n".join(lines) + "\n]}\n"
