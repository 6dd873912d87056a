"""M(4) for both particles of each pair at once (R3), in an order of the pairs that can be taken in parallel.

Cells have side h/2 and about two particles each. A colour is a set of pairs of cells no two of which share a particle.
Colour 0 is each cell with itself; then each cell with one of those around it, 62 directions (12 in 2D), the farthest
first. Cells apart by an odd multiple of the direction's first step come in another colour than those by an even one.
Within two cells the pairs come in rounds, each particle at most once in a round. In cells of side h a dozen neighbours
would equalise among themselves before heat goes on to the next cell, which triples the error of long steps.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np

from refsim.backends.compile import cpu_kernel, formula, kernel
from refsim.backends.fast.rows import over_rows
from refsim.core.errors import InputError
from refsim.core.period import Period
from refsim.heat.formulas import pair_share
from refsim.heat.kernels import inverse_capacity, weight
from refsim.heat.shapes import Conduction

BITS = 21
OFFSET = 1 << 20
REACH = 2  # cells in a support radius
FORWARD = sorted(
    (d for d in itertools.product(range(-REACH, REACH + 1), repeat=3) if d > (0, 0, 0)),
    key=lambda d: (-sum(step * step for step in d), d),
)


class Exchanging(NamedTuple):
    """What pairs of particles exchange heat by, and their temperatures."""

    position: Any
    volume: Any
    conductivity: Any
    inverse: Any
    timestep: Any
    conduction: Any
    period: Any
    temperature: Any


def pair_exchange(
    position, mass, volume, heat_capacity, conductivity, reservoir, timestep, conduction, period, scratch, temperature
):
    """M(4) for both particles of each pair (R3), in coloured order, forwards and backwards [degrees C]."""
    inverse = scratch.array("heat inverse", volume.shape[0], volume.dtype)
    invert_capacities(mass, volume, heat_capacity, reservoir, conduction, inverse)
    given = Exchanging(position, volume, conductivity, inverse, timestep, conduction, period, temperature)
    xp, to_xp, from_xp = scratch.backend.array_library()
    members, first, cell_pairs = colours(xp, to_xp(position), conduction, period)
    if scratch.backend.name == "cuda":
        members, first, cell_pairs = from_xp(members), from_xp(first), list(map(from_xp, cell_pairs))
        for backwards, order in ((0, cell_pairs), (1, cell_pairs[::-1])):
            for cells in order:
                exchange_cells(cells, members, first, np.int32(backwards), given)
    else:
        cells, ends = joined(cell_pairs)
        for backwards in (0, 1):
            exchange_colours(cells, ends, members, first, np.int32(backwards), given)


@kernel
def invert_capacities(i, mass, volume, heat_capacity, reservoir, conduction, inverse):
    """1/C_i [K/J]."""
    inverse[i] = inverse_capacity(i, mass, volume, heat_capacity, reservoir, conduction)


@kernel(rows_of="cells")
def exchange_cells(i, cells, members, first, backwards, given):
    """M(4) for all pairs of the cells of one colour; a GPU launches it for each colour [degrees C]."""
    exchange_two_cells(cells[i, 0], cells[i, 1], members, first, backwards, given)


exchange_cells_of = exchange_cells.body


@cpu_kernel
def exchange_colours(cells, ends, members, first, backwards, given):
    """M(4) for all pairs of the cells of one colour after the other: one launch on a CPU [degrees C]."""
    for n in range(ends.shape[0] - 1):
        colour = ends.shape[0] - 2 - n if backwards else n
        pairs = cells[ends[colour] : ends[colour + 1]]
        over_rows(exchange_cells_of, pairs.shape[0], (pairs, members, first, backwards, given))


@formula
def exchange_two_cells(a, b, members, first, backwards, given):
    """M(4) for all pairs of cells a and b, or of one cell, in rounds; backwards the last round first."""
    here, other = first[a + 1] - first[a], first[b + 1] - first[b]
    rounds = max(here, other)
    for n in range(rounds):
        k = rounds - 1 - n if backwards else n
        for m in range(here):
            p = partner(m, k, rounds, a == b)
            if p < other:
                exchange(members[first[a] + m], members[first[b] + p], given)


@formula
def exchange(i, j, given):
    """M(4) for both particles of one pair (R3): what one gains the other loses."""
    conduction, inverse, temperature = given.conduction, given.inverse, given.temperature
    seconds = conduction.sweep_share * given.timestep[1]
    g = weight(i, j, given.position, given.volume, given.conductivity, seconds, conduction, given.period)
    if g != type(g)(0):
        moved = pair_share(g, inverse[i], inverse[j]) * (temperature[j] - temperature[i])
        temperature[i] += inverse[i] * moved
        temperature[j] -= inverse[j] * moved


@formula
def partner(place, turn, rounds, same):
    """Place in the other cell that particle number `place` meets in round `turn`; `rounds` for none.

    (place + turn) mod rounds; in one cell with itself the one that makes both places sum to turn mod rounds.
    """
    if not same:
        return (place + turn) % rounds
    other = (turn - place + rounds) % rounds
    return other if place < other else rounds


def colours(xp: Any, position: Any, conduction: Conduction, period: Period | None) -> tuple[Any, Any, list[Any]]:
    """(particles sorted by cell, first of each cell and the end, [pairs of cells (p, 2) of each colour]).

    xp  NumPy or CuPy, the library of `position` (n, 3) [m]
    """
    if not len(position):
        nothing = xp.zeros(0, dtype=xp.int32)
        return nothing, xp.zeros(1, dtype=xp.int32), []
    side = float(conduction.support_radius) / REACH
    number = cell_numbers(side, period)
    position = xp.asarray(position, dtype=xp.float64)
    cell = xp.empty((len(position), 3), dtype=xp.int64)
    for axis, wraps in enumerate(number):
        if period is not None and wraps:
            width = float(period[axis]) / wraps
            cell[:, axis] = xp.floor(position[:, axis] * (1.0 / width)).astype(xp.int64) % wraps
        else:
            least, most = REACH - OFFSET, OFFSET - 1 - REACH
            cell[:, axis] = xp.clip(xp.floor(position[:, axis] * (1.0 / side)), least, most).astype(xp.int64)
    key = _key(cell)
    members = xp.argsort(key, kind="stable")
    key, cell = key[members], cell[members]
    begins = xp.ones(len(key), dtype=bool)
    begins[1:] = key[1:] != key[:-1]
    first = xp.flatnonzero(begins)
    key, cell = key[first], cell[first]
    place = xp.arange(len(key))
    cell_pairs = [xp.stack((place, place), axis=1)]
    for step in FORWARD:
        if conduction.dim == 2 and step[2]:
            continue
        axis = next(a for a in range(3) if step[a])
        beside = cell + xp.asarray(step)
        for a, wraps in enumerate(number):
            if wraps:
                beside[:, a] %= wraps
        wanted = _key(beside)
        at = xp.minimum(xp.searchsorted(key, wanted), max(len(key) - 1, 0))
        there = key[at] == wanted
        parity = cell[:, axis] // abs(step[axis]) % 2
        for wanted in (0, 1):
            here = xp.flatnonzero(there & (parity == wanted))
            cell_pairs.append(xp.stack((here, at[here]), axis=1))
    ends = xp.concatenate((first, xp.full(1, len(members), dtype=first.dtype)))
    whole = [xp.ascontiguousarray(pairs.astype(xp.int32)) for pairs in cell_pairs if len(pairs)]
    return members.astype(xp.int32), ends.astype(xp.int32), whole


def joined(colours_of_pairs: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(pairs of cells of all colours (p, 2), first of each colour and the end)."""
    cells = np.concatenate(colours_of_pairs) if colours_of_pairs else np.zeros((0, 2), np.int32)
    return cells, np.cumsum([0, *map(len, colours_of_pairs)])


def cell_numbers(side: float, period: Period | None) -> tuple[int, ...]:
    """Cells along each axis of a periodic box, of at least `side` [m]; 0 where there is no period.

    A multiple of twice the reach, so that the colours close. Raises InputError for a period below four support radii,
    in which cells would meet twice.
    """
    if period is None:
        return (0, 0, 0)
    even = 2 * REACH
    numbers = [int(float(length) / side * (1 + 1e-6)) // even * even for length in period[:3]]
    for length, number in zip(period, numbers):
        if length and number < 2 * even:
            raise InputError(f"pair exchange: a period of {length} m is below four support radii; give a longer one.")
    return tuple(numbers)


def _key(cell: Any) -> Any:
    return ((cell[:, 0] + OFFSET) << (2 * BITS)) | ((cell[:, 1] + OFFSET) << BITS) | (cell[:, 2] + OFFSET)
