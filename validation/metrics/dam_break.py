"""The surge front of a collapsing column: published series, the front of a particle cloud, how they are compared.

A column of width a and height n^2 a stands against a wall and is released at t = 0. The front is z/a, its
distance from that wall in column widths; time is T = t sqrt(2 g / a), the scale of the series of n^2 = 2 kept
here (t sqrt(g / a) is 1.41 times smaller). Bars are not tighter than what the experiments agree on among
themselves: ``data_spread``, ``data_tolerance``.
"""

from collections.abc import Callable, Sequence
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

from validation.metrics.spread import groups

_PAPERS = Path(__file__).resolve().parent.parent / "papers"


class FrontData(NamedTuple):
    """One series: time (k,) as T = t sqrt(2 g / a), increasing; front (k,) as z/a. Both dimensionless."""

    time: NDArray[np.float64]
    front: NDArray[np.float64]


FRONT_DATA = {  # file in validation/papers, whose SOURCES.md says more, and kind of each series
    "martin_moyce_1.125in": ("martin_moyce_1952_a1.125in.csv", "experiment"),
    "martin_moyce_2.25in": ("martin_moyce_1952_a2.25in.csv", "experiment"),
    "koshizuka_oka": ("koshizuka_oka_1996_experiment.csv", "experiment"),
    "koshizuka_oka_mps": ("koshizuka_oka_1996_mps.csv", "computation"),
}


def load_front_data(name: str) -> FrontData:
    """The series called ``name`` in FRONT_DATA, from a file with one line of headings."""
    return FrontData(*np.loadtxt(_PAPERS / FRONT_DATA[name][0], delimiter=",", skiprows=1, unpack=True))


def experiments() -> dict[str, FrontData]:
    """The measured series."""
    return {name: load_front_data(name) for name, (_, kind) in FRONT_DATA.items() if kind == "experiment"}


def dimensionless_time(time: ArrayLike, width: float, gravity: float = 9.81) -> NDArray[np.float64]:
    """T = t sqrt(2 g / a) for time t [s], column width a [m], gravity g [m/s^2]."""
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
    """
    points = np.asarray(position, dtype=np.float64)
    group = groups(points, link * spacing)
    bulk = group == np.argmax(np.bincount(group))
    reach = points[:, axis]
    edges = (float(reach[some].max()) + 0.5 * spacing for some in (bulk, slice(None)))
    return Front(*edges, detached=int(np.sum(~bulk)))


def fit_time_offset(time: Sequence[float], front: ArrayLike, data: FrontData) -> tuple[float, float]:
    """(offset, root mean square misfit of z/a) with the time that brings a front curve nearest to the data.

    Least squares of front(T_data + offset) - z_data, all dimensionless.
    time (k,), front (k,): the curve, dimensionless as the data, time increasing; linear between its points.
    No shift exceeds 0.5. Before the release, with which the curve starts, the front stands still.
    Data points that the curve covers at every such offset are used; ValueError for fewer than two.
    """
    usable = data.time + 0.5 <= time[-1]
    if usable.sum() < 2:
        raise ValueError(f"the curve to T = {time[-1]:.3g} covers {usable.sum()} data points at every offset; need 2")
    at, wanted = data.time[usable], data.front[usable]

    def misfit(offset: float) -> float:
        return float(np.mean((np.interp(at + offset, time, front) - wanted) ** 2))

    trial = np.linspace(-0.5, 0.5, 201)
    best = int(np.argmin([misfit(offset) for offset in trial]))
    bounds = trial[max(best - 1, 0)], trial[min(best + 1, len(trial) - 1)]
    minimum = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    offset = min((float(minimum.x), float(trial[best])), key=misfit)
    return offset, float(np.sqrt(misfit(offset)))


def front_error(time: Sequence[float], front: ArrayLike, data: FrontData, offset: float) -> float:
    """The largest of (front - data)/data of a curve, with its sign, the fitted ``offset`` added to the data's times.

    time (k,), front (k,): dimensionless, time increasing. All data points within the curve's times count.
    """
    at = data.time + offset
    within = (at >= time[0]) & (at <= time[-1])
    deviation = np.interp(at[within], time, front) / data.front[within] - 1.0
    return float(deviation[np.argmax(np.abs(deviation))])


def data_tolerance() -> float:
    """The bar on a simulated front: the largest deviation of an experiment from one before it, 0.108."""
    largest = 0.0
    for base, other in combinations(experiments().values(), 2):
        within = (other.time >= base.time[0]) & (other.time <= base.time[-1])
        deviation = other.front[within] / np.interp(other.time[within], *base) - 1.0
        largest = max(largest, float(np.abs(deviation).max()))
    return largest


def ritter_front(time: ArrayLike) -> NDArray[np.float64]:
    """Upper bound 1 + 2 T of the front for n^2 = 2.

    Ritter's front 2 sqrt(g n^2 a) t of shallow water on a dry bed (1892, Z. Ver. Dtsch. Ing. 36:947) in these units.
    """
    return 1.0 + 2.0 * np.asarray(time, dtype=np.float64)


def neighbour_sums(position: np.ndarray, reach: float) -> tuple[Callable[[np.ndarray], np.ndarray], np.ndarray]:
    """(sum of values (n,) over the neighbours of each particle within `reach` [m], number of these)."""
    pairs = cKDTree(position).query_pairs(reach, output_type="ndarray")
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    count = len(position)
    return lambda values: np.bincount(one, values[other], minlength=count), np.bincount(one, minlength=count)
