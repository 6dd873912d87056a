"""Sums over the j of each i: a reference gives the term of one pair, `term(i, j, ij)`, in the paper's letters.

i and j are Fields, arrays by name (`i.mass`), ij is what lies between: for particles `Between`, x = x_i - x_j [m], r,
e = x/r, W, its slope and gradient. All are `Terms` (refsim/core/terms.py), numbers that carry their size.

    liquid = Fields(position=position, mass=mass)
    around = neighbours(liquid, liquid, smoothing)     # pairs with r < h, i itself included
    density = around(lambda i, j, ij: j.mass * ij.W)   # a Terms of every i; `around.others` leaves out i itself

What a term takes beside, is named in the call: `around.others(viscosity, mu=0.1)`. `Pairs` sums over any other pairs:
particles and nodes, bodies and members, triangles and corners; `ij` is then whatever lies between those.
"""

import functools

import numpy as np

from refsim.core.terms import Decision, Terms
from refsim.neighbours.reference import pair_blocks
from refsim.smoothing.reference import kernel_slope, kernel_value, viscosity_laplacian

CHUNK = 2**16  # pairs whose terms are computed at a time


class Fields:
    """Arrays by name, as Terms with a row for each particle (node, body, ...); those that are None are left out."""

    def __init__(self, **given):
        known = {name: value for name, value in given.items() if value is not None}
        vars(self).update(
            {n: v if isinstance(v, Terms) else Terms(v, rank=max(np.ndim(v) - 1, 0)) for n, v in known.items()}
        )

    def at(self, rows):
        """The fields of some rows; None for all."""
        return self if rows is None else Rows(self, rows)


class Rows:
    """Some rows of Fields; each is taken once."""

    def __init__(self, fields, rows):
        self._fields, self._rows = fields, rows

    def __getattr__(self, name):
        value = getattr(self._fields, name)
        value = value if value.value.ndim == value.rank else value.at(self._rows)  # one number for all
        setattr(self, name, value)
        return value

    def at(self, rows):
        return Rows(self, rows)


class Between:
    """x = x_i - x_j [m], r = |x|, e = x/r or 0; W [1/m^dim], W' (`slope`), W' e (`gradient`), viscosity's Laplacian."""

    def __init__(self, x, r, smoothing=None, gradient_smoothing=None):
        self.x, self.r = Terms(x, rank=1), Terms(r)
        self.smoothing, self.gradient_smoothing = smoothing, gradient_smoothing or smoothing
        if smoothing is not None:
            self.h, self.dim = float(smoothing.support_radius), int(smoothing.dim)

    def at(self, rows):
        return Between(self.x.value[rows], self.r.value[rows], self.smoothing, self.gradient_smoothing)

    @functools.cached_property
    def apart(self):
        """r, or 1 m for particles at one place."""
        return Terms(np.where(self.r.value > 0, self.r.value, 1.0))

    @functools.cached_property
    def depth(self):
        """h - r, or 0 beyond."""
        return Terms(np.maximum(self.h - self.r.value, 0))

    @functools.cached_property
    def e(self):
        return self.x / self.apart

    @functools.cached_property
    def W(self):
        return Terms(kernel_value(self.r.value, self.smoothing))

    @functools.cached_property
    def slope(self):
        return Terms(kernel_slope(self.r.value, self.gradient_smoothing))

    @functools.cached_property
    def gradient(self):
        return self.slope / self.apart * self.x

    @functools.cached_property
    def laplacian(self):
        return Terms(viscosity_laplacian(self.r.value, self.smoothing))


class Pairs:
    """Pairs of rows of i and of j, sorted by the row of i; called with a term, the sum of it over the j of each i.

    i        Fields of n rows
    between  what lies between each pair, an object with `at` (Fields, Between), or None
    """

    def __init__(self, i, count, j, row, column, between=None, same=None):
        if (row[1:] < row[:-1]).any():
            raise ValueError("Pairs must be sorted by their row of i.")
        cuts = [slice(k, k + CHUNK) for k in range(0, max(len(row), 1), CHUNK)]
        self.links = [(row[c], column[c], between and between.at(c)) for c in cuts]
        self.i, self.count, self.j, self.same = i, count, j, same  # same: rows of the i among the j

    def of(self, i, j):
        """The same pairs of other fields."""
        return self._copy(i=i, j=j)

    def _copy(self, **changed):
        made = object.__new__(Pairs)
        kept = ("links", "i", "count", "j", "same")
        vars(made).update({name: getattr(self, name) for name in kept} | changed)
        return made

    @functools.cached_property
    def parts(self):
        return [(row, self.i.at(row), self.j.at(column), between) for row, column, between in self.links]

    @functools.cached_property
    def others(self):
        """The pairs without those of a particle with itself."""
        apart = [np.flatnonzero(self.same[row] != column) for row, column, _ in self.links]
        links = [(row[k], column[k], between.at(k)) for k, (row, column, between) in zip(apart, self.links)]
        return self._copy(links=links)

    def __call__(self, term, **given):
        """sum_j term(i, j, ij, **given) for every i."""
        return self._reduced(np.add, 0.0, term, given)

    def most(self, term, **given):
        """The largest term(i, j, ij, **given) of the j of every i, -inf of none; sizes likewise."""
        return self._reduced(np.maximum, -np.inf, term, given)

    def any(self, decision, **given):
        """Whether decision(i, j, ij, **given) holds for any j, for every i."""
        return Decision(self.most(decision, **given).value)

    def at_least(self, least, decision, **given):
        """Whether decision(i, j, ij, **given) holds for so many j, for every i."""
        margins = [(row, decision(i, j, ij, **given).margin) for row, i, j, ij in self.parts]
        row, margin = (np.concatenate(parts) for parts in zip(*margins))
        order = np.lexsort((-margin, row))
        first = np.searchsorted(row, np.arange(self.count))
        enough = np.bincount(row, minlength=self.count) >= least
        ranked = np.full(self.count, -np.inf)
        ranked[enough] = margin[order[first[enough] + least - 1]]
        return Decision(ranked)

    def _reduced(self, reduce, start, term, given):
        given = {n: float(v) if isinstance(v, np.floating) else v for n, v in given.items()}
        value = size = None
        for row, i, j, ij in self.parts:
            terms = term(i, j, ij, **given)
            if isinstance(terms, Decision):
                terms = Terms(terms.margin)
            if value is None:
                value = np.full((self.count, *(3,) * terms.rank), start)
                size = value.copy()
            if not len(row):
                continue
            first = np.flatnonzero(np.concatenate(([True], row[1:] != row[:-1])))
            of, shape = row[first], (len(row), *value.shape[1:])
            for into, from_ in ((value, terms.value), (size, terms.size)):
                from_ = from_ if from_.shape == shape else np.broadcast_to(from_, shape)
                into[of] = reduce(into[of], reduce.reduceat(from_, first, axis=0))
        return Terms(value, size, terms.rank)


class NoPairs:
    """Sums over nothing, as over walls where there are none."""

    def of(self, i, j):
        return self

    def __call__(self, term, **given):
        return Terms(0.0)

    def any(self, decision, **given):
        return Decision(-np.inf)


def neighbours(i, j, smoothing=None, gradient_smoothing=None, period=None, rows=None, reach=None):
    """Pairs of `rows` of i and of j that are nearer than h or `reach`, by comparing all; no sums where j is None.

    i, j are Fields with `position`; W is of `smoothing`, its slope of `gradient_smoothing` or else of `smoothing`.
    """
    if j is None:
        return NoPairs()
    h = reach or max(float(s.support_radius) for s in (smoothing, gradient_smoothing or smoothing))
    none = np.zeros(0, dtype=int)
    blocks = [(none, none, np.zeros((0, 3)), np.zeros(0))]
    for place, separation, distance in pair_blocks(i.position.value, j.position.value, rows, period):
        near = np.nonzero(~(distance >= h))  # also a distance that is no number
        blocks.append((near[0] + place.start, near[1], separation[near], distance[near]))
    row, column, x, r = (np.concatenate(parts) for parts in zip(*blocks))
    count = len(i.position.value) if rows is None else len(rows)
    same = np.arange(count) if rows is None else np.asarray(rows)
    return Pairs(i.at(rows), count, j, row, column, Between(x, r, smoothing, gradient_smoothing), same)


def wall_particles(walls, fluid=None, **more):
    """Fields of wall particles, None without any: position, volume, and their mass rho0 V."""
    if walls is None:
        return None
    volume = Terms(walls.volume)
    mass = None if fluid is None else float(fluid.rest_density) * volume
    return Fields(position=walls.position, volume=volume, mass=mass, **more)
