"""Readings that take turns: how long one lasts, and when there are enough."""

import collections
import itertools

import pytest

from validation.reading import Reading, measured
from validation.running import Context
from validation.turns import LASTS, MOST, PATIENCE, mean_parts, middle_third, repeated, rounds


def read(seconds, repeats=5):
    """(readings, order of the calls) of settings with these seconds; an iterator gives each call its own."""
    called = []

    def once(key, k):
        called.append((k, key))
        return next(seconds[key])

    return rounds(Context(), seconds, once, float, repeats), called


def test_a_short_run_is_repeated_within_its_round():
    found, called = read({"short": itertools.repeat(LASTS / 4), "long": itertools.repeat(3 * LASTS)})
    assert [len(reading) for reading in found["short"]] == [2] * 5  # of four runs
    assert len([key for _, key in called if key == "short"]) == 20
    assert [len(reading) for reading in found["long"]] == [1] * 5


def test_rounds_go_on_until_a_time_settles():
    late = itertools.chain((1.0, 1.3, 1.6, 1.0, 1.3), itertools.cycle((1.6, 1.3, 1.0, 1.6, 1.3)))
    found, _ = read({"calm": itertools.repeat(0.1), "late": late})
    assert [len(reading) for reading in found["calm"]] == [1] * 5
    assert [len(reading) for reading in found["late"]] == [2] * 5
    assert [sum(reading) for reading in found["late"]] == pytest.approx([2.6] * 5)


def test_a_setting_is_left_after_the_limits(monkeypatch):
    """What surrounds the timed part counts for the longest time that a setting may take."""
    now = [0.0]
    monkeypatch.setattr("validation.turns.time.perf_counter", lambda: now[0])
    seconds = {key: itertools.cycle((0.1, 0.2, 0.3, 0.4, 0.5)) for key in ("short", "slow")}
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
    assert {run for reading in found["short"] for run in reading} == {0.010, 0.011}
    assert middle_third([3.0], float) == [3.0]
    assert middle_third([3.0, 1.0], float) == [1.0, 3.0]
    assert middle_third([5.0, 1.0, 3.0], float) == [3.0]


def test_of_the_runs_of_one_start_that_in_the_middle_is_the_reading():
    """Each number is a start of its own; the first run of a setting says what compiling took."""
    speed, first = itertools.cycle((0.03, 0.01, 0.02)), iter([7.0])

    def once(setting, repeat):
        seconds = next(speed)
        made = Reading(
            setting["key"], "words", {}, error=0.1 * repeat, seconds=[seconds], per_step=[seconds / 10], steps=10,
            compile=next(first, None),
        )  # fmt: skip
        return measured([made], 1, "cpu")

    found = repeated(Context(), {"one": {"key": "one"}}, once, 1, 5).values["readings"]
    assert [r["error"] for r in found] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert {r["compile"] for r in found} == {7.0}
    assert all(r["seconds"] == [0.02] for r in found)


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
    assert [len(reading) for reading in found["stopped"]] == [1] * 5


def test_parts_of_a_reading_are_means():
    assert mean_parts([{"scan": 1.0, "sum": 3.0}, {"scan": 2.0}]) == {"scan": 1.5, "sum": 1.5}
