"""Readings that take turns: how long one lasts, and when there are enough."""

import itertools

import pytest

from validation.running import Context
from validation.turns import LASTS, middle_third, rounds


def read(seconds, repeats=5):
    """(readings, order of the calls) of settings with these seconds; an iterator gives each call its own."""
    called = []

    def once(key, k):
        called.append((k, key))
        return next(seconds[key])

    return rounds(Context(), seconds, once, float, repeats), called


def test_a_short_run_is_repeated_within_its_round():
    found, called = read({"short": itertools.repeat(LASTS / 4), "long": itertools.repeat(3 * LASTS)})
    assert [len(runs) for runs in found["short"].runs] == [2] * 5  # of four runs
    assert len([key for _, key in called if key == "short"]) == 20
    assert [len(runs) for runs in found["long"].runs] == [1] * 5


def test_rounds_go_on_until_a_time_settles():
    first, then = (1.0, 1.3, 1.6, 1.0, 1.3), (1.6, 1.3, 1.0, 1.6, 1.3)
    late = itertools.chain(first, then, then, first, itertools.cycle(then))
    found, _ = read({"calm": itertools.repeat(0.1), "late": late})
    assert [len(runs) for runs in found["calm"].runs] == [1] * 5
    assert [len(runs) for runs in found["late"].runs] == [2] * 5  # of four
    assert found["late"].noise == pytest.approx([1.0] * 10)


def test_starts_of_unequal_cost_settle_where_each_repeats():
    """The second round tells what differs between starts from what disturbs the machine."""
    starts = (1.0, 1.3, 1.6, 1.1, 2.0)
    found, called = read({"start": itertools.cycle(starts)})
    assert len(called) == 10
    assert found["start"].means(float) == pytest.approx(starts)
    assert found["start"].noise == pytest.approx([1.0] * 10)


def test_the_middle_third_of_a_readings_runs_counts():
    disturbed = itertools.cycle((0.010, 0.009, 0.010, 0.011, 0.050))
    found, _ = read({"short": disturbed})
    assert {run for runs in found["short"].runs for run in runs} == {0.010, 0.011}
    assert middle_third([3.0], float) == [3.0]
    assert middle_third([3.0, 1.0], float) == [1.0, 3.0]
    assert middle_third([5.0, 1.0, 3.0], float) == [3.0]


def test_settings_take_turns_in_an_order_that_changes():
    _, called = read({key: itertools.repeat(1.0) for key in "abcd"})
    orders = [[key for k, key in called if k == number] for number in range(5)]
    assert all(sorted(order) == list("abcd") for order in orders)
    assert len({*map(tuple, orders)}) > 1
