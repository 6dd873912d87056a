"""Readings that take turns: how long one lasts, and when there are enough."""

import collections
import itertools

import numpy as np
import pytest

from validation.running import Context
from validation.turns import LASTS, MOST, PATIENCE, _noise, mean_parts, middle_third, rounds


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


def test_noise_is_that_of_the_readings_whatever_it_is_read_from():
    """Half the difference of two halves scatters as their mean does, so that one bar judges both."""
    random = np.random.default_rng(1)
    halves = 1.0 + 0.1 * random.standard_normal((20_000, 2))
    noise = _noise([[[a], [b]] for a, b in halves.tolist()], float)
    assert np.std(noise) == pytest.approx(np.std(halves.mean(1)), rel=0.02)


def test_a_setting_is_left_after_the_limits(monkeypatch):
    """What surrounds the timed part counts for the longest time that a setting may take."""
    now = [0.0]
    monkeypatch.setattr("validation.turns.time.perf_counter", lambda: now[0])
    first, second = (0.1, 0.2, 0.3, 0.1, 0.2), (0.5, 1.0, 1.5, 0.5, 1.0)  # every second round is slower
    seconds = {key: itertools.cycle(first + second) for key in ("short", "slow")}
    called = collections.Counter()

    def once(key, k):
        called[key] += 1
        now[0] += PATIENCE / 10 if key == "slow" else PATIENCE / (5 * MOST + 1)
        return next(seconds[key])

    rounds(Context(), seconds, once, float, 5)
    assert called == {"short": 5 * MOST, "slow": 10}


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


@pytest.mark.parametrize("repeats", [1, 2])
def test_fewer_repeats_are_no_statistics(repeats):
    found, _ = read({"short": itertools.repeat(1e-3)}, repeats)
    assert [len(runs) for runs in found["short"].runs] == [1] * repeats


def test_a_run_that_stopped_at_once_is_not_repeated_for_its_time():
    found, _ = read({"stopped": itertools.repeat(0.0)})
    assert [len(runs) for runs in found["stopped"].runs] == [1] * 5


def test_parts_of_a_reading_are_means():
    assert mean_parts([{"scan": 1.0, "sum": 3.0}, {"scan": 2.0}]) == {"scan": 1.5, "sum": 1.5}
