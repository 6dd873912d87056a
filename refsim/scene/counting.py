"""How full places are of particles, counted on cells of two spacings with quadratic B-splines, on the host in float64.

A lattice fills every cell inside it with 1, however it lies to the cells: they are as wide as two of its spacings.
"""

import functools
import itertools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from refsim.core.effect import Discretisation
from refsim.sparse_grid.tables import distinct

WIDTH = 2.0  # of a cell [spacings]
REACH = 2  # cells around one inside the liquid that are full, too: its sums reach one and a half
AT_ONCE = 1 << 18  # particles whose weights are held in one array


class Cells:
    """The cells that hold particles at (n, 3) [m], and those beside them.

    own     (n,) cell of each particle
    near    (3^dim, cells) the cells around each, itself among them; the number of cells stands for others
    volume  of a cell [m^dim]

    `width` of a cell in spacings: a whole number, which a lattice fills evenly.
    """

    def __init__(self, position: np.ndarray, grid: Discretisation, width: float = WIDTH) -> None:
        self.wide = np.full(grid.dim, width * grid.spacing)
        around = np.zeros(grid.dim, np.int64)  # cells along a period
        for axis, length in enumerate(grid.period[: grid.dim]):
            if length > 0:
                around[axis] = max(1, round(length / self.wide[axis]))
                self.wide[axis] = length / around[axis]
        self.volume = float(self.wide.prod())
        self.place = position[:, : grid.dim]
        count, key = [], np.zeros(len(position), np.int64)
        for axis, periodic in enumerate(around.tolist()):
            number, n = _numbered(np.rint(self.place[:, axis] / self.wide[axis]).astype(np.int64), periodic)
            count.append(n)
            key *= n
            key += number
        stride = [math.prod(count[axis + 1 :]) for axis in range(grid.dim)]
        self.offsets = list(itertools.product((-1, 0, 1), repeat=grid.dim))

        def beside(key: np.ndarray, offset: tuple[int, ...]) -> np.ndarray:
            return np.sum([(key // s + o) % n * s for s, n, o in zip(stride, count, offset)], axis=0)

        held = distinct(key)
        cells = distinct(np.concatenate([beside(held, offset) for offset in self.offsets]))

        def at(key: np.ndarray) -> np.ndarray:
            index = np.minimum(np.searchsorted(cells, key), len(cells) - 1)
            return np.where(cells[index] == key, index, len(cells)).astype(np.int32)

        self.cell_of = at(key)
        self.near = np.stack([at(beside(cells, offset)) for offset in self.offsets])

    def filled(self, volume: np.ndarray, first: int = 0) -> np.ndarray:
        """Share of each cell that the particles from `first` on fill, of these volumes [m^dim]; dimensionless."""
        total = np.zeros(self.near.shape[1] + 1)
        for part, cell, weight in self._weights(first, len(volume)):
            total += np.bincount(cell, weight * volume[part], len(total))
        return total[:-1] / self.volume

    def at_particles(self, values: np.ndarray, count: int) -> np.ndarray:
        """Mean of the cells' values around each of the first particles (count,), weighted as they fill them."""
        share = np.zeros(count)
        for part, cell, weight in self._weights(0, count):
            share[part] += weight * values[cell]
        return share

    def inside(self, liquid: np.ndarray, solid: np.ndarray, whole: np.ndarray) -> np.ndarray:
        """Which cells lie in liquid and all others within REACH cells in liquid or in what is solid (cells,).

        liquid  numbers of its particles; a cell without any is in torn liquid if no cell beside it, solid or not, is
                two away from one, and none within REACH is whole: else it is air between surfaces, or below a lid
        whole   cells that liquid fills
        """

        def around(cells: Any) -> np.ndarray:
            return np.append(cells, False)[self.near]

        wet = np.bincount(self.cell_of[liquid], minlength=len(solid)) > 0
        near, air = around(wet).any(0), whole & ~solid
        deep = near & around(near | solid).all(0)
        for _ in range(REACH):
            air = around(air).any(0)
        deep &= wet | (around(near).all(0) & ~air)
        for _ in range(REACH):
            deep = deep & around(deep | solid).all(0)
        return deep & ~solid

    def _weights(self, first: int, count: int) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """(which of `count` particles from `first` on, a cell beside each, B-spline of its centre there)."""
        for begin in range(0, count, AT_ONCE):
            part = slice(begin, min(begin + AT_ONCE, count))
            rows = slice(first + part.start, first + part.stop)
            place = self.place[rows] / self.wide
            x = place - np.rint(place)
            along = 0.5 * (0.5 - x) ** 2, 0.75 - x**2, 0.5 * (0.5 + x) ** 2
            for near, offset in zip(self.near, self.offsets):
                share = functools.reduce(np.multiply, (along[o + 1][:, axis] for axis, o in enumerate(offset)))
                yield part, near[self.cell_of[rows]], share


def _numbered(number: np.ndarray, around: int) -> tuple[np.ndarray, int]:
    """(numbers of cells along an axis from 0 on, their count with two empty ones at each end); wide gaps are narrowed.

    Along a period of `around` cells they wrap.
    """
    if around:
        return number % around, around
    if int(number.max()) - int(number.min()) > 4 * len(number):
        distinct, inverse = np.unique(number, return_inverse=True)
        number = np.append(0, np.cumsum(np.minimum(np.diff(distinct), 2 * REACH + 2)))[inverse]
    number = number - number.min() + 2
    return number, int(number.max()) + 3
