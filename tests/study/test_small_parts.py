"""Small parts of studies, and of what a run says."""

import math
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from refsim import InputError, study
from refsim.engine import progress
from refsim.engine.timings import Timings
from refsim.study import runs
from refsim.study.convergence import _doubt
from refsim.study.panels import measured
from tests.running import rows
from tests.study.test_cost import tank


@pytest.mark.parametrize("seconds, said", [(0.9, 0), (1.1, 1), (1.9, 1)])
def test_compiling_is_told_of_above_a_second(seconds, said, monkeypatch):
    words = []
    monkeypatch.setattr(progress, "say", words.append)
    monkeypatch.setattr(progress, "Bar", lambda until, time: (until, time))
    run = type("Run", (), {"time": 0.25, "timings": type("T", (), {"account": lambda self: {"compiling": seconds}})()})
    shown = progress.Progress.__new__(progress.Progress)
    shown.until = 2.0
    shown._open(run)
    assert (len(words), shown.time, shown.bar) == (said, 0.25, (2.0, 0.25))


@pytest.mark.parametrize("length, ends", [(0.3, (1.8, 2.1)), (0.25, (1.75, 2.0)), (5.0, (0.0, 5.0))])
def test_a_value_at_the_end_lies_between_two_steps(length, ends):
    """By a straight line; looked at where the end may be near, and not at the start."""
    looks, last = [], SimpleNamespace(length=length)
    run = SimpleNamespace(time=0.0, steps=0, last=None, plan=SimpleNamespace(scene=SimpleNamespace(end_time=2.0)))

    def step():
        run.time, run.steps, run.last = round(run.time + length, 9), run.steps + 1, last

    def observable(run):
        looks.append(run.time)
        return 3.0 - run.time**2

    found = runs._at_end(run, observable, SimpleNamespace(step=step))
    low, high = ends
    line = (3 - low**2) + (2.0 - low) / (high - low) * (low**2 - high**2)
    assert found == pytest.approx(line if low else 3 - high**2)
    assert looks[-1] == high
    assert all(look + 2 * length >= 2.0 for look in looks)
    assert len(looks) <= 3


def test_bytes_of_arrays_are_counted_once():
    """In containers and objects of refsim, of a view those of its owner; six containers deep."""
    one, two = np.zeros(10), np.zeros((4, 3), np.float32)
    held = Timings()
    held.kept = {"a": [one[2:], (two,)], "b": two}
    held.other, held.text, held.call = SimpleNamespace(far=np.zeros(99)), "text", lambda: np.zeros(99)
    seen = {}
    runs._count((held, one, {"again": one[:3]}), seen)
    assert sum(seen.values()) == 80 + 48
    deep = np.zeros(7)
    for depth in range(1, 9):
        deep, seen = [deep], {}
        runs._count(deep, seen)
        assert sum(seen.values()) == (56 if depth <= 6 else 0)


@pytest.mark.parametrize("values, words", rows(__file__, "values_without_order"))
def test_values_without_an_order_alternate_or_do_not_shrink(values, words):
    assert words in _doubt((1.0, 2.0, 4.0), values, math.nan)


@pytest.mark.parametrize("levels, given, finer", [(1, None, 0), (2, None, 1), (3, None, 1), (5, None, 2), (5, 4, 4)])
def test_half_of_the_levels_are_finer(levels, given, finer, monkeypatch):
    def asked(scene, *more):
        raise InputError(f"{more}")

    monkeypatch.setattr(sys.modules["refsim.study"], "spaced", asked)  # refsim.study is a function, too
    with pytest.raises(InputError, match=re.escape(f"({levels}, {finer}, 1.25)")):
        study(tank(), "front", levels=levels, finer=given, ratio=1.25, backend="numpy")


def test_what_is_measured_is_told_of_its_machine(monkeypatch):
    monkeypatch.setattr(measured, "machine", lambda: "a processor, 8 cores")
    found = measured._here("numpy")
    assert (found.machine, found.threads, found.device) == ("a processor", 1, "")
