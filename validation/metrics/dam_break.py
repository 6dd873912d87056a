"""The surge front of a collapsing column: published series, the front of a particle cloud, and how the two
are compared.

A column of width a and height n^2 a stands against a wall and is released at t = 0. The front is z/a, its
distance from that wall in column widths; time is T = t sqrt(2 g / a), the scale of the series of n^2 = 2 kept
here (t sqrt(g / a) is 1.41 times smaller). Bars are not tighter than what the experiments agree on among
themselves: ``data_spread``, ``data_tolerance``.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

__all__ = [
    "FRONT_DATA",
    "Front",
    "FrontData",
    "FrontDataset",
    "FrontError",
    "OffsetFit",
    "SeriesSpread",
    "data_spread",
    "data_tolerance",
    "dimensionless_time",
    "fit_time_offset",
    "front_error",
    "front_position",
    "load_front_data",
    "read_front_data",
    "ritter_front",
    "ritter_speed",
]

_PAPERS = Path(__file__).resolve().parent.parent / "papers"
_INCH = 0.0254


class FrontData(NamedTuple):
    """One series: time (k,) as T = t sqrt(2 g / a), increasing; front (k,) as z/a. Both dimensionless."""

    time: NDArray[np.float64]
    front: NDArray[np.float64]


@dataclass(frozen=True)
class FrontDataset:
    """Where a series comes from and in what units it is.

    aspect_ratio: column height / width, n^2. length_scale: column width [m], None where the digitised source
    does not state it.
    time_scale, front_scale: what the two columns of the file are. kind: "experiment" or "computation".
    """

    file: str
    kind: str
    aspect_ratio: float
    length_scale: float | None
    time_scale: str
    front_scale: str
    source: str
    doi: str
    digitised_by: str


_PYSPH = "PySPH project (data of its dam-break examples)"
_MARTIN_MOYCE = "Martin & Moyce 1952, Phil. Trans. R. Soc. A 244:312, figure 3"
_KOSHIZUKA_OKA = "Koshizuka & Oka 1996, Nucl. Sci. Eng. 123:421"

FRONT_DATA: dict[str, FrontDataset] = {
    "martin_moyce_1.125in": FrontDataset(
        "martin_moyce_1952_a1.125in.csv", "experiment", 2.0, 1.125 * _INCH, "t sqrt(2 g / a)", "z / a",
        _MARTIN_MOYCE, "10.1098/rsta.1952.0007", _PYSPH,
    ),
    "martin_moyce_2.25in": FrontDataset(
        "martin_moyce_1952_a2.25in.csv", "experiment", 2.0, 2.25 * _INCH, "t sqrt(2 g / a)", "z / a",
        _MARTIN_MOYCE, "10.1098/rsta.1952.0007", _PYSPH,
    ),
    "koshizuka_oka": FrontDataset(
        "koshizuka_oka_1996_experiment.csv", "experiment", 2.0, None, "t sqrt(2 g / L)", "z / L",
        _KOSHIZUKA_OKA, "10.13182/NSE96-A24205", _PYSPH,
    ),
    "koshizuka_oka_mps": FrontDataset(
        "koshizuka_oka_1996_mps.csv", "computation", 2.0, None, "t sqrt(2 g / L)", "z / L",
        _KOSHIZUKA_OKA, "10.13182/NSE96-A24205", _PYSPH,
    ),
}  # fmt: skip


def read_front_data(path: str | Path) -> FrontData:
    """Read a series from a CSV file of two columns, dimensionless time and front, under one line of headings.

    Raises ValueError when the file has another shape, a value that is not finite, or times that do not
    increase; OSError when it cannot be read.
    """
    try:
        table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except ValueError as error:
        raise ValueError(f"{path}: not a table of numbers: {error}") from error
    if table.shape[0] < 2 or table.shape[1] != 2 or not np.isfinite(table).all():
        raise ValueError(f"{path}: need at least two rows of two finite numbers, got shape {table.shape}")
    if not (np.diff(table[:, 0]) > 0).all():
        raise ValueError(f"{path}: the times do not increase")
    return FrontData(table[:, 0].copy(), table[:, 1].copy())


def load_front_data(name: str) -> FrontData:
    """The series called ``name`` in FRONT_DATA. Raises KeyError for another name."""
    if name not in FRONT_DATA:
        raise KeyError(f"no front data called {name!r}; there are {', '.join(FRONT_DATA)}")
    return read_front_data(_PAPERS / FRONT_DATA[name].file)


def dimensionless_time(time: ArrayLike, width: float, gravity: float = 9.81) -> NDArray[np.float64]:
    """T = t sqrt(2 g / a) for time t [s], column width a [m], gravity g [m/s^2].

    Raises ValueError unless width and gravity are positive.
    """
    if not (width > 0 and gravity > 0):
        raise ValueError(f"width and gravity must be positive, got {width} and {gravity}")
    return np.asarray(time, dtype=np.float64) * np.sqrt(2.0 * gravity / width)


class Front(NamedTuple):
    """How far the liquid reaches along one axis [m].

    connected: edge of the connected liquid; spray is left out.
    farthest: edge of the farthest particle, spray included.
    detached: number of particles that do not belong to the connected liquid.
    """

    connected: float
    farthest: float
    detached: int


def front_position(position: ArrayLike, spacing: float, *, axis: int = 0, link: float = 2.0) -> Front:
    """The surge front of a particle cloud along ``axis``, towards larger values, with and without spray.

    position: (n, dim) [m]. spacing: d [m]. link: longest distance / d at which two particles count as connected.
    Particles linked to each other form groups; the liquid is the largest group, and what has torn
    off (a drop, a particle shot ahead) counts only for ``farthest``. The edge lies half a spacing beyond the
    outermost centre, so a column of width a that begins at 0 has its front at a.
    Raises ValueError for another shape, no particles, non-finite positions, spacing or link not positive.
    """
    points = np.asarray(position, dtype=np.float64)
    if points.ndim != 2 or len(points) == 0 or not np.isfinite(points).all():
        raise ValueError(f"position must be a finite array of shape (n, dim) with n > 0, got {points.shape}")
    if not (spacing > 0 and link > 0):
        raise ValueError(f"spacing and link must be positive, got {spacing} and {link}")
    pairs = cKDTree(points).query_pairs(link * spacing, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    group = connected_components(graph, directed=False)[1]
    bulk = group == np.argmax(np.bincount(group))
    reach = points[:, axis]
    return Front(
        connected=float(reach[bulk].max()) + 0.5 * spacing,
        farthest=float(reach.max()) + 0.5 * spacing,
        detached=int(np.sum(~bulk)),
    )


class OffsetFit(NamedTuple):
    """The fitted shift between two clocks.

    offset: T to add to the data's clock to get the curve's. rms: root mean square misfit of z/a with it.
    points: data points used. at_limit: the best offset is the end of the allowed range, hence means nothing.
    """

    offset: float
    rms: float
    points: int
    at_limit: bool


def fit_time_offset(
    time: ArrayLike, front: ArrayLike, data: FrontData, *, max_offset: float = 0.5, from_rest: bool = True
) -> OffsetFit:
    """The one time offset that brings a front curve nearest to the data.

    Least squares of front(T_data + offset) - z_data, all dimensionless.
    time (k,), front (k,): the curve, dimensionless as the data, time increasing; linear between its points.
    max_offset: largest shift allowed. from_rest: the curve starts with the release, so before it the front
    stands still; otherwise the curve is not defined there. Only data points that the curve covers at every
    allowed offset are used, so all offsets are judged by the same points.
    Raises ValueError for curves of other shape, times that do not increase, fewer than two data points left.
    """
    time, front = _curve(time, front)
    usable = data.time + max_offset <= time[-1]
    if not from_rest:
        usable &= data.time - max_offset >= time[0]
    if usable.sum() < 2:
        raise ValueError(
            f"the curve from T = {time[0]:.3g} to {time[-1]:.3g} covers {usable.sum()} data points "
            f"at every offset up to {max_offset}; need 2"
        )
    at, wanted = data.time[usable], data.front[usable]

    def misfit(offset: float) -> float:
        return float(np.mean((np.interp(at + offset, time, front) - wanted) ** 2))

    trial = np.linspace(-max_offset, max_offset, 201)
    best = int(np.argmin([misfit(offset) for offset in trial]))
    bounds = trial[max(best - 1, 0)], trial[min(best + 1, len(trial) - 1)]
    found = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    offset = float(found.x) if found.fun <= misfit(trial[best]) else float(trial[best])
    return OffsetFit(
        offset=offset,
        rms=float(np.sqrt(misfit(offset))),
        points=int(usable.sum()),
        at_limit=abs(offset) > max_offset * (1.0 - 1e-4),
    )


class FrontError(NamedTuple):
    """Deviation (front - data) / data of a curve.

    largest: the one largest in size, with its sign. at: the data's T there. rms: root mean square.
    points: data points compared.
    """

    largest: float
    at: float
    rms: float
    points: int


def front_error(time: ArrayLike, front: ArrayLike, data: FrontData, offset: float = 0.0) -> FrontError:
    """Relative deviation of a front curve from the data, the fitted ``offset`` added to the data's times.

    time (k,), front (k,): dimensionless, time increasing. All data points within the curve's times count.
    Raises ValueError for curves of other shape or when no data point lies within the curve's times.
    """
    time, front = _curve(time, front)
    at = data.time + offset
    within = (at >= time[0]) & (at <= time[-1])
    if not within.any():
        raise ValueError(f"no data point lies within the curve's times {time[0]:.3g} to {time[-1]:.3g}")
    deviation = np.interp(at[within], time, front) / data.front[within] - 1.0
    worst = int(np.argmax(np.abs(deviation)))
    return FrontError(
        largest=float(deviation[worst]),
        at=float(data.time[within][worst]),
        rms=float(np.sqrt(np.mean(deviation**2))),
        points=int(within.sum()),
    )


class SeriesSpread(NamedTuple):
    """Deviation (series - against) / against at the points of ``series`` within the range of ``against``.

    offset: T added to the clock of ``series``. lowest, highest: extremes of the deviation.
    largest: the greater of their sizes. points: how many were compared.
    """

    series: str
    against: str
    offset: float
    lowest: float
    highest: float
    largest: float
    points: int


def data_spread(kind: str | None = "experiment", *, fit_offset: bool = False) -> tuple[SeriesSpread, ...]:
    """How far the published series deviate from each other, pair by pair, recomputed from the files.

    kind: "experiment", "computation", or None for all series. fit_offset: allow each pair the one fitted time
    offset that a simulation is allowed; without it the clocks are taken as published.
    The earlier entry of FRONT_DATA is the one deviated from; it is linear between its points and compared on
    the common range only.
    """
    names = [name for name, entry in FRONT_DATA.items() if kind in (None, entry.kind)]
    spread = []
    for against, series in combinations(names, 2):
        base, other = load_front_data(against), load_front_data(series)
        offset = fit_time_offset(*base, other, from_rest=False).offset if fit_offset else 0.0
        at = other.time + offset
        within = (at >= base.time[0]) & (at <= base.time[-1])
        deviation = other.front[within] / np.interp(at[within], *base) - 1.0
        lowest, highest = float(deviation.min()), float(deviation.max())
        largest = max(abs(lowest), abs(highest))
        spread.append(SeriesSpread(series, against, offset, lowest, highest, largest, int(within.sum())))
    return tuple(spread)


def data_tolerance() -> float:
    """The bar on a simulated front: the largest deviation between two experiments as published, 0.108."""
    return max(pair.largest for pair in data_spread("experiment"))


def ritter_speed(height: float, gravity: float = 9.81) -> float:
    """2 sqrt(g H) [m/s], the front speed of shallow water of depth H [m] on a dry bed.

    Source: Ritter 1892, Z. Ver. Dtsch. Ing. 36:947. Raises ValueError for a negative height or gravity.
    """
    if not (height >= 0 and gravity >= 0):
        raise ValueError(f"height and gravity must not be negative, got {height} and {gravity}")
    return 2.0 * float(np.sqrt(gravity * height))


def ritter_front(time: ArrayLike, aspect_ratio: float = 2.0) -> NDArray[np.float64]:
    """Upper bound z/a = 1 + sqrt(2 n^2) T of the front, for a column of height/width n^2.

    Ritter's front 2 sqrt(g n^2 a) t in these units; 1 + 2 T for n^2 = 2. Raises ValueError unless n^2 > 0.
    """
    if not aspect_ratio > 0:
        raise ValueError(f"aspect_ratio must be positive, got {aspect_ratio}")
    return 1.0 + np.sqrt(2.0 * aspect_ratio) * np.asarray(time, dtype=np.float64)


def _curve(time: ArrayLike, front: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    time, front = np.asarray(time, dtype=np.float64), np.asarray(front, dtype=np.float64)
    if time.ndim != 1 or time.shape != front.shape or len(time) < 2:
        raise ValueError(f"need equally long time and front of 2 or more, got {time.shape} and {front.shape}")
    if not (np.isfinite(time).all() and np.isfinite(front).all() and (np.diff(time) > 0).all()):
        raise ValueError("time and front must be finite, and time must increase")
    return time, front
