"""Readings that take turns: how long one lasts, and when there are enough."""

import itertools

import pytest

from validation.running import Context
from validation.turns import LASTS, MOST, mean_parts, rounds


def read(seconds, repeats=5):
    """(readings, order of the calls) of settings with these seconds; an iterator gives each call its own."""
    called = []

    def once(key, k):
        called.append((k, key))
        return next(seconds[key])

    return rounds(Context(), seconds, once, float, repeats), called


def test_short_runs_are_repeated_within_a_reading():
    found, _ = read({"short": itertools.repeat(LASTS / 4), "long": itertools.repeat(3 * LASTS)})
    assert [len(reading) for reading in found["short"]] == [4] * 5
    assert [len(reading) for reading in found["long"]] == [1] * 5


def test_a_time_is_read_until_it_settles():
    calm, wild = itertools.repeat(1.0), itertools.cycle((1.0, 2.0))
    late = itertools.chain((1.0, 1.2, 1.1, 1.3, 1.15), itertools.repeat(1.0))
    found, called = read({"calm": calm, "wild": wild, "late": late})
    assert len(found["calm"]) == 5
    assert len(found["wild"]) == MOST * 5
    assert 5 < len(found["late"]) < MOST * 5
    assert {key for k, key in called if k == MOST * 5 - 1} == {"wild"}


def test_settings_take_turns_in_an_order_that_changes():
    _, called = read({key: itertools.repeat(1.0) for key in "abcd"})
    orders = [[key for k, key in called if k == number] for number in range(5)]
    assert all(sorted(order) == list("abcd") for order in orders)
    assert len({*map(tuple, orders)}) > 1


@pytest.mark.parametrize("repeats", [1, 2])
def test_fewer_repeats_are_no_statistics(repeats):
    found, _ = read({"short": itertools.repeat(1e-3)}, repeats)
    assert [len(reading) for reading in found["short"]] == [1] * repeats


def test_a_run_that_stopped_at_once_is_not_repeated_for_its_time():
    found, _ = read({"stopped": itertools.repeat(0.0)})
    assert len(found["stopped"]) == 5


def test_parts_of_a_reading_are_means():
    assert mean_parts([{"scan": 1.0, "sum": 3.0}, {"scan": 2.0}]) == {"scan": 1.5, "sum": 1.5}
