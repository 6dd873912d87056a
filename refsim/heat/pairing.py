"""The order of the pair exchange (R3): cells and colours in which no two pairs of cells share a particle.

Cells of side h/2, about two particles each. Colour 0 is each cell with itself; then each cell with one of those around
it, 62 directions (12 in 2D), the farthest first; cells apart by an odd multiple of the direction's first step come in
another colour than those by an even one. Within two cells the pairs come in rounds, each particle at most once in a
round. Small cells matter: those of side h let a dozen neighbours settle among themselves before heat goes on to the
next cell, and triple the error of long steps.
"""

from __future__ import annotations

import itertools
from typing import Any

from refsim.backends.compile import formula
from refsim.core.errors import InputError
from refsim.heat.shapes import Conduction, Period

BITS = 21
OFFSET = 1 << 20
REACH = 2  # cells in a support radius
FORWARD = sorted(
    (d for d in itertools.product(range(-REACH, REACH + 1), repeat=3) if d > (0, 0, 0)),
    key=lambda d: (-sum(step * step for step in d), d),
)


@formula
def partner(place, turn, rounds, same):  # noqa: ANN001, ANN201  (types are Numba's)
    """Place in the other cell whom particle number `place` meets in round `turn`; `rounds` where there is nobody.

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
        if wraps:
            own = float(period[axis]) / wraps
            cell[:, axis] = xp.floor(position[:, axis] * (1.0 / own)).astype(xp.int64) % wraps
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
    found = [xp.stack((place, place), axis=1)]
    for way in FORWARD:
        if conduction.dim == 2 and way[2]:
            continue
        axis = next(a for a in range(3) if way[a])
        beside = cell + xp.asarray(way)
        for a, wraps in enumerate(number):
            if wraps:
                beside[:, a] %= wraps
        wanted = _key(beside)
        at = xp.minimum(xp.searchsorted(key, wanted), max(len(key) - 1, 0))
        there = key[at] == wanted
        parity = cell[:, axis] // abs(way[axis]) % 2
        for wanted in (0, 1):
            own = xp.flatnonzero(there & (parity == wanted))
            found.append(xp.stack((own, at[own]), axis=1))
    ends = xp.concatenate((first, xp.full(1, len(members), dtype=first.dtype)))
    whole = [xp.ascontiguousarray(pairs.astype(xp.int32)) for pairs in found if len(pairs)]
    return members.astype(xp.int32), ends.astype(xp.int32), whole


def cell_numbers(side: float, period: Period | None) -> tuple[int, int, int]:
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
