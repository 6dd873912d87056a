"""Gauges: what a scene measures while it runs, each as a series in time.

A kind is an entry of `KINDS`, which says what it takes, needs and gives. What a run does with them is
`refsim.engine.gauges`, where they may stand is `refsim.gauges.checks`.
"""

import io
import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim.core.checked import Checked, NotNegative, given_keys, suggestion
from refsim.core.effect import Discretisation, Field
from refsim.core.errors import InputError
from refsim.core.writing import write_file

FILL = Field("fill", "-", "share of the space around a point that the liquid fills", rows="walls")
FLOW = Field("flow", "m/s", "volume of liquid that passes a point, per time and area", 3, rows="walls")

Vector = tuple[float, float, float]
Places = tuple[Vector | None, Vector | None, Vector | None]  # `at`, `lower` and `upper` of a gauge
FINER = 4  # points of a level in a spacing
MOST_POINTS = 10**6  # of a gauge
SURFACE = 0.5  # fill at a surface; where it is less, no pressure is below 0


class Points(NamedTuple):
    """Points of a gauge."""

    place: NDArray[np.float64]  # (m, 3) [m]
    area: float = 0.0  # of each point of a patch [m^(dim - 1)]; 0 of a point and a line
    axis: int = -1  # across the patch, or along the line; -1 of a point


def point(at: Vector, grid: Discretisation) -> Points:
    """One point."""
    return Points(_flat(np.array([at]), grid))


def line(owner: str, given: Places, grid: Discretisation) -> Points:
    """Points along a line, several a spacing. Raises InputError where there is none along one axis."""
    low, high, wide, form = _corners(owner, given, grid)
    if len(wide) != 1:
        raise InputError(f"{form} line along one axis; let lower and upper differ along the axis of the level.")
    (axis,) = wide
    count = max(2, math.ceil(FINER * (high - low)[axis] / grid.spacing - 1e-9) + 1)
    _check_number(owner, count)
    place = np.repeat(low[None, :], count, axis=0)
    place[:, axis] = np.linspace(low[axis], high[axis], count)
    return Points(_flat(place, grid), 0.0, axis)


def patch(owner: str, given: Places, grid: Discretisation) -> Points:
    """Points of a patch, one a spacing. Raises InputError where there is none that is flat along one axis."""
    low, high, wide, form = _corners(owner, given, grid)
    if len(wide) != grid.dim - 1:
        raise InputError(f"{form} patch; let lower and upper be equal along one axis, and differ along the others.")
    cells = [max(1, math.ceil(width / grid.spacing - 1e-9)) for width in high - low]
    _check_number(owner, math.prod(cells))
    axes = [low[a] + (high - low)[a] * (np.arange(n) + 0.5) / n for a, n in enumerate(cells)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, grid.dim)
    across = next(a for a in range(grid.dim) if a not in wide)
    return Points(_flat(place, grid), math.prod((high - low)[a] / cells[a] for a in wide), across)


def _corners(
    owner: str, given: Places, grid: Discretisation
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[int], str]:
    """Lower and upper corner (dim,) [m], the axes along which they differ, and how a sentence on them begins."""
    _, lower, upper = given
    assert lower is not None
    assert upper is not None
    low, high = np.array(lower)[: grid.dim], np.array(upper)[: grid.dim]
    if (high < low).any():
        raise InputError(f"{owner}: lower is above upper along {'xyz'[int((high < low).argmax())]}.")
    wide = [axis for axis in range(grid.dim) if high[axis] > low[axis]]
    return low, high, wide, f"{owner}: from {list(lower)} to {list(upper)} m is no"


def _check_number(owner: str, count: int) -> None:
    if count > MOST_POINTS:
        raise InputError(f"{owner}: it has {count:,} points, one a spacing; make it smaller.")


def _flat(place: NDArray[np.float64], grid: Discretisation) -> NDArray[np.float64]:
    """Places (m, 3) [m], with z = 0 in 2D."""
    whole = np.zeros((len(place), 3))
    whole[:, : grid.dim] = place[:, : grid.dim]
    return whole


def crossing(height: NDArray[np.float64], fill: NDArray[np.float64]) -> float:
    """Height [m] of the highest crossing of `SURFACE`; the lowest height where it is below everywhere.

    height  (m,) [m], rising; fill (m,) of the liquid there
    """
    full = np.flatnonzero(fill >= SURFACE)
    if not len(full):
        return float(height[0])
    k = int(full[-1])
    if k == len(height) - 1:
        return float(height[-1])
    share = (fill[k] - SURFACE) / (fill[k] - fill[k + 1])
    return float(height[k] + share * (height[k + 1] - height[k]))


class Gauge(Checked, frozen=True, kw_only=True):
    """What is measured while a scene runs.

    name          of the series: letters, digits, "_" and "-"
    kind          "force" (on a wall or a solid, with its torque), "pressure" (at a point, or the mean over a patch),
                  "level" (height of the liquid on a line) or "flux" (volume per second through a patch)
    every         simulated time between two values [s]; 0 for every step
    instants      from one value to the next, equally far apart, at which it is read, too; their mean and scatter stand
                  beside the value, in columns with _mean and _scatter; 0 for none
    on            what a force acts on: a face of box_walls ("-y"), "box_walls", "mesh_boundary" or "solid 1", which is
                  the first [[solid]]
    about         point about which the torque is taken [m]; left out, the origin, or the centre of mass of a solid
    at            point of a pressure [m]
    lower, upper  corners of a patch, which is flat along one axis, or ends of the line of a level [m]
    """

    name: str
    kind: Literal["force", "pressure", "level", "flux"]
    every: NotNegative = 0.0
    instants: Annotated[int, msgspec.Meta(ge=0)] = 0
    on: str = ""
    about: Vector | None = None
    at: Vector | None = None
    lower: Vector | None = None
    upper: Vector | None = None

    def check(self) -> None:
        """Raise InputError, in one sentence, for keys that do not belong together."""
        if not re.fullmatch(r"[A-Za-z0-9_-]{1,80}", self.name):
            raise InputError(
                f"gauge {self.name!r}: the name is not possible; take letters, digits, '_' and '-', 80 of them at most."
            )
        owner = f"gauge {self.name}"
        given = given_keys(self, owner, {name: kind.takes for name, kind in KINDS.items()})
        if ("lower" in given) != ("upper" in given):
            lacking = "upper" if "lower" in given else "lower"
            raise InputError(f"{owner}: {lacking!r} is missing; give both corners.")
        if self.instants and not self.every:
            raise InputError(f"{owner}: instants lie between two values; give every [s], or leave them out.")
        if not any(set(choice) <= set(given) for choice in self.does.choices) or {"at", "lower"} <= set(given):
            raise InputError(f"{owner}: {self.does.lacks}.")

    @property
    def does(self) -> "Kind":
        """What its kind reads."""
        return KINDS[self.kind]

    def columns(self, dim: int) -> tuple[tuple[str, str], ...]:
        """(name, unit) of each of its values in `dim` dimensions."""
        read = self.does.columns(dim)
        kinds = ("", "_mean", "_scatter") if self.instants else ("",)
        return tuple((f"{name}{kind}", unit) for kind in kinds for name, unit in read)

    def values(self, table: NDArray[np.float64]) -> NDArray[np.float64]:
        """(k, 1 + columns) times and values of what was read, (m, 1 + read): with instants those, and their mean and
        standard deviation since the value before."""
        if not self.instants or not len(table):
            return table
        interval = np.array([number(self.every, time) for time in table[:, 0]])
        last = np.flatnonzero(np.diff(interval, prepend=-1) > 0)  # rows that are values
        parts = [table[start + 1 : end + 1, 1:] for start, end in zip([-1, *last], last)]
        means, scatters = (np.array([function(part, 0) for part in parts]) for function in (np.mean, np.std))
        return np.hstack([table[last], means, scatters])

    def points(self, grid: Discretisation) -> Points:
        """The points at which it reads. Raises InputError where its corners make no patch or line."""
        return self.does.points(f"gauge {self.name}", (self.at, self.lower, self.upper), grid)


class Sampled(NamedTuple):
    """What is found at a gauge's points: pressure (m,) [Pa], share of the space that the liquid fills (m,) [-], and
    its flow (m, 3) [m/s]; empty where the gauge does not need it."""

    pressure: NDArray[np.float64]
    fill: NDArray[np.float64]
    flow: NDArray[np.float64]


@dataclass(frozen=True)
class Kind:
    """What a kind of gauge takes, needs and gives.

    takes    keys of a gauge of this kind
    choices  keys of which one set must be given; `lacks` is said where none is
    needs    what is found at its points ("pressure", "fill" or "flow"), or "force" on what it stands
    columns  (name, unit) of each value in so many dimensions
    points   its points from how an error begins, its `at`, `lower` and `upper`, and the grid
    read     the values, from points and what is found there; those of a force are the sums over what it stands on
    instant  whether it needs the pressure of an instant, which a solver of a step does not have
    """

    takes: tuple[str, ...]
    choices: tuple[tuple[str, ...], ...]
    lacks: str
    needs: str
    columns: Callable[[int], tuple[tuple[str, str], ...]]
    points: Callable[[str, Places, Discretisation], Points] = lambda owner, given, grid: Points(np.zeros((0, 3)))
    read: Callable[[Points, Sampled], list[float]] = lambda points, sampled: []
    instant: bool = False


def _force_columns(dim: int) -> tuple[tuple[str, str], ...]:
    if dim == 2:
        return (("force_x", "N/m"), ("force_y", "N/m"), ("torque_z", "N"))
    return (*((f"force_{c}", "N") for c in "xyz"), *((f"torque_{c}", "N m") for c in "xyz"))


CORNERS, NO_CORNERS = ("lower", "upper"), "its place is missing; give lower and upper"
KINDS = {
    "force": Kind(
        ("on", "about"), (("on",),), "it lacks 'on', what the force acts on; give a face such as \"-y\"", "force",
        _force_columns, instant=True,
    ),
    "pressure": Kind(
        ("at", *CORNERS), (("at",), CORNERS), "its place must be given exactly once; give at, or lower and upper",
        "pressure", lambda dim: (("pressure", "Pa"),),
        lambda owner, given, grid: patch(owner, given, grid) if given[0] is None else point(given[0], grid),
        lambda points, sampled: [float(sampled.pressure.mean())], instant=True,
    ),
    "level": Kind(
        CORNERS, (CORNERS,), NO_CORNERS, "fill", lambda dim: (("level", "m"),), line,
        lambda points, sampled: [crossing(points.place[:, points.axis], sampled.fill)],
    ),
    "flux": Kind(
        CORNERS, (CORNERS,), NO_CORNERS, "flow", lambda dim: (("flux", "m^3/s" if dim == 3 else "m^2/s"),), patch,
        lambda points, sampled: [float(sampled.flow[:, points.axis].sum() * points.area)],
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class GaugeSeries:
    """What a gauge has measured; `series["force_y"]` is one column (k,)."""

    name: str
    kind: str
    time: NDArray[np.float64]  # (k,) [s]
    values: NDArray[np.float64]  # (k, columns) in SI units, in 2D per metre of depth
    columns: tuple[str, ...]  # names of the values, such as "force_y"
    units: tuple[str, ...]  # of the columns

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        if column not in self.columns:
            raise InputError(f"gauge {self.name}: there is no column {column!r}; {suggestion(column, self.columns)}")
        return self.values[:, self.columns.index(column)]

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write a line for each time; the first line names the columns with their units.

        Raises InputError for a bad path, RunStopped where the disk refuses; a file that was there is then untouched.
        """
        import csv

        text = io.StringIO(newline="")
        lines = csv.writer(text)
        lines.writerow(["time [s]", *(f"{name} [{unit}]" for name, unit in zip(self.columns, self.units))])
        lines.writerows(np.column_stack([self.time, self.values]).tolist())
        write_file(path, text.getvalue(), "table")

    def __repr__(self) -> str:
        span = f", from {self.time[0]:.6g} to {self.time[-1]:.6g} s" if len(self) else ""
        named = ", ".join(f"{name} [{unit}]" for name, unit in zip(self.columns, self.units))
        return f"<gauge {self.name} ({self.kind}): {len(self)} values{span}; {named}>"


def due(every: float, time: float, last: float | None) -> bool:
    """Whether a gauge measures at `time`, after its last value at `last` [s]: once on each multiple of `every`."""
    if last is None or every == 0:
        return last is None or time > last
    return number(every, time) > number(every, last)


def number(every: float, time: float) -> int:
    """Number of the multiple of `every` that `time` has reached, both in s."""
    return math.floor(min(time / every * (1 + 1e-12), 2.0**53))
