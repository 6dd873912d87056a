"""The loop over neighbours against sums over all pairs, as Python and compiled; what a pair function may say."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from refsim.backends.compile import kernel
from refsim.core.period import Period
from refsim.neighbours.pair_functions import given_to, layout, terms
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import NeighbourRows

N, H = 131, 0.9  # more neighbours than are staged at a time
LENGTHS = np.array([1.0, 2.0, 0.0])


class Radius(NamedTuple):
    support_radius: float


class Others(NamedTuple):
    """A list of other particles, with positions of their own."""

    start: Any
    count: Any
    entries: Any
    position: Any
    volume: Any


class Weighted(NamedTuple):
    start: Any
    count: Any
    entries: Any
    weight: Any


@pair
def every_kind(r, x_ij, mass_i, mass_j, velocity_i, velocity_j, kind_j, radius, factor, extra):
    dx, dy, dz = x_ij
    share = mass_i * mass_j * (radius.support_radius - r) * factor
    if kind_j == 2:
        share = -share
    if extra is not None:
        share += extra.no_such_member
    return share * dx, share * (velocity_j[1] - velocity_i[1]), share * dz, share * dy


@pair
def volume_near(r, volume_j, radius):
    return volume_j * r


@pair
def flow(weight_ij, heat_i, heat_j):
    return weight_ij * (heat_j - heat_i)


@kernel
def sum_every_kind(i, position, mass, velocity, kind, neighbours, radius, period, out):
    sums = neighbour_sum(every_kind, i, None, neighbours, position, period, mass, velocity, kind, radius, mass[i], None)
    for c in range(4):
        out[i, c] = sums[c]


@kernel
def sum_others(i, position, others, radius, heat, weighted, out):
    out[i, 0] = neighbour_sum(volume_near, i, None, others, position, None, others.volume, radius)
    out[i, 1] = neighbour_sum(flow, i, None, weighted, None, None, heat)


def run(compiled, body, *arguments):
    out = np.zeros((N, 4))
    if compiled:
        body(*arguments, out)
    else:
        for i in range(N):
            body.__wrapped__(i, *arguments, out)
    return out


def rows(kind, entries, *more):
    """A list in which every row has the same entries."""
    return kind(np.arange(N) * len(entries), np.full(N, len(entries), np.int32), np.tile(entries, N), *more)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("periodic", [False, True])
def test_sums_are_those_over_all_pairs(compiled, periodic):
    random = np.random.default_rng(5)
    position, velocity = random.random((2, N, 3))
    position *= 2
    mass, kind = random.random(N), random.integers(0, 3, N).astype(np.int8)
    radius = Radius(H)
    inverse = np.divide(1, LENGTHS, out=np.zeros(3), where=LENGTHS > 0)
    period = Period(*LENGTHS, *inverse) if periodic else None
    neighbours = rows(NeighbourRows, np.arange(N, dtype=np.uint32))
    out = run(compiled, sum_every_kind, position, mass, velocity, kind, neighbours, radius, period)
    x = position[:, None] - position[None]
    if periodic:
        x -= LENGTHS * np.round(x * inverse)
    r = np.linalg.norm(x, axis=2)
    share = mass[:, None] ** 2 * mass * (H - r) * np.where(kind == 2, -1, 1) * (r < H)
    change = velocity[None, :, 1] - velocity[:, None, 1]
    expected = np.stack([(share * part).sum(1) for part in (x[..., 0], change, x[..., 2], x[..., 1])], axis=1)
    assert np.abs(expected).min() > 0
    assert np.abs(out - expected).max() < 1e-13 * np.abs(share).sum(1).max()


@pytest.mark.parametrize("compiled", [False, True])
def test_a_list_may_hold_positions_and_weights_of_its_own(compiled):
    random = np.random.default_rng(6)
    position, walls, volume, heat = random.random((N, 3)), random.random((7, 3)), random.random(7), random.random(N)
    weight = random.random(N * 7)
    others = rows(Others, np.arange(7, dtype=np.uint32), walls, volume)
    weighted = rows(Weighted, np.arange(7, dtype=np.uint32), weight)
    out = run(compiled, sum_others, position, others, Radius(H), heat, weighted)
    r = np.linalg.norm(position[:, None] - walls[None], axis=2)
    assert np.allclose(out[:, 0], (volume * r * (r < H)).sum(1), rtol=1e-13)
    assert np.allclose(out[:, 1], (weight.reshape(N, 7) * (heat[:7] - heat[:, None])).sum(1), rtol=1e-12)


def test_what_a_pair_function_takes_and_returns():
    assert [terms(f) for f in (every_kind, volume_near, flow)] == [4, 1, 1]
    assert list(given_to(every_kind, (None,) * 6)) == ["mass", "velocity", "kind", "radius", "factor", "extra"]
    with pytest.raises(TypeError, match="pair function flow takes heat; 2 values are given"):
        given_to(flow, (None, None))


def test_fields_are_packed_in_rows_of_four():
    """A scalar behind each vector, the position first; then scalars together; one that is left, and integers, alone."""
    kinds = {"mass": "scalar", "velocity": "vector", "kind": "integer"}
    assert layout(every_kind, tuple(kinds.values())) == (["", "velocity"], ["mass"], [], ["kind"])

    assert layout(volume_near, (None,)) == ([], [], [], [])

    def many(r, a_j, b_j, c_j, d_j, e_j, f_j, absent_j, radius):
        return a_j

    assert layout(many, ("scalar",) * 3 + (None,) * 4) == ([""], ["a"], [["b", "c"]], [])
    assert layout(many, ("scalar",) * 6 + (None,)) == ([""], ["a"], [["b", "c", "d", "e"]], ["f"])


def test_return_statements_write_equally_many_terms():
    def uneven(r, mass_j, radius):
        if mass_j > r:
            return r, r
        return r

    with pytest.raises(TypeError, match="uneven: its return statements write different numbers of terms"):
        terms(uneven)
