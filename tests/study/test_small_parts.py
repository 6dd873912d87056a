"""Small parts of studies and panels, and of what a run says: orders, radii, machines, steps, stages and bars."""

import math
import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from refsim import InputError, study
from refsim.engine import progress
from refsim.engine.timings import Timings
from refsim.study import runs
from refsim.study.convergence import Reference, _doubt, observed_order
from refsim.study.panels import Machine, drops, measured, panel
from refsim.study.panels.scenes import scene_of
from refsim.study.result import percent
from tests.running import rows
from tests.study.test_cost import tank


@pytest.mark.parametrize("order", [0.002, 0.5, 1.0, 2.0, 7.3, 39.0])
def test_an_order_is_found_up_to_forty(order):
    h = np.array([1.0, 1.01, 1.02])
    assert observed_order(h, 3.0 - 0.2 * h**order) == pytest.approx(order, rel=1e-5)
    assert np.isnan(observed_order(h, 3.0 - 0.2 * h ** (order + 41)))
    assert np.isnan(observed_order(h, 3.0 - 0.2 * h ** (-order)))
    assert math.isnan(observed_order((1.0, 2.0, 4.0), (1.0, 1.0, 2.0)))
    assert observed_order((1.0, 2.0, 4.0), (1.0, 2.0, 1.0 + 1 + 2**order)) == pytest.approx(order)


def test_a_drop_has_the_radius_of_its_volume_and_a_stage_of_no_seconds_no_cost():
    for r in (0.2, 1.7):
        assert drops.radius_of(np.pi * r**2, 2) == pytest.approx(r)
        assert drops.radius_of(4 / 3 * np.pi * r**3, 3) == pytest.approx(r)
    of = Timings()
    of.launches.update(a=3, b=1)
    of.stages.update(a=0.75)
    costs = {cost.stage: (cost.seconds, cost.share, cost.launches) for cost in of.costs(1.0)}
    assert costs["b"] == (0.0, 0.0, 1)
    assert costs["a"][0] == 0.75
    assert sum(share for _, share, _ in costs.values()) == pytest.approx(1.0)


def test_what_is_measured_is_told_of_its_machine_threads_and_steps(monkeypatch):
    of = panel("front")
    point = next(p for p in of.points.values() if not p.gpu)
    for threads, words in ((1, ""), (2, ", 2 threads"), (16, ", 16 threads")):
        places = [Machine("here", threads, "2020-01-01")] * len(of.places)
        assert replace(of, places=tuple(places)).threads(point) == words
    of = panel("front")
    base = of.points[of.about.base]
    for steps, share in (((1.0, 1.0), 1.0), ((1.0, 0.5), 0.5), ((0.5, 0.25), 0.5), ((0.8, 0.4), 0.5)):
        points = [msgspec.structs.replace(base, knobs=base.knobs | {"step": step}) for step in steps]
        made = replace(of, points=of.points | {of.about.base: points[0]})
        usual, found = scene_of(of, base), scene_of(made, points[1])
        name = "step" if usual.step > 0 else "step_factor"
        assert getattr(found, name) == pytest.approx(share * getattr(usual, name))
    monkeypatch.setattr(measured, "machine", lambda: "a processor, 8 cores")
    found = measured._here("numpy")
    assert (found.machine, found.threads, found.device) == ("a processor", 1, "")


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


@pytest.mark.parametrize("share, words", [
    (0.012345, "1.2 %"), (0.984, "98 %"), (0.9951, "100 %"), (1.0, "100 %"), (1.256, "126 %"), (-3.17, "-317 %"),
    (None, "-"), (np.inf, "-"), (-0.0456, "-4.6 %"),
])  # fmt: skip
def test_shares_have_two_digits_and_whole_per_cents_from_one_on(share, words):
    assert percent(share) == words
    if words != "-":
        assert percent(share, signed=True) == ("+" if share > 0 else "") + words


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


def test_errors_are_relative_to_the_value_or_to_the_scale_of_a_reference(monkeypatch):
    made = lambda settings, *_: [(s, SimpleNamespace(value=4 + 1 / s.factor, failed="")) for s in settings]  # noqa: E731
    monkeypatch.setattr(sys.modules["refsim.study"], "_measured", made)
    for reference, scale in ((None, 0.0), (Reference(4.0, 7.0, 0.0, "known"), 7.0)):
        found = study(tank(), "front", knobs=("spacing",), reference=reference, backend="numpy")
        assert (found.convergence.scale, found.convergence.value) == (scale, pytest.approx(4.0))


@pytest.mark.parametrize("error", [0.0, -0.1, 1.0, 1.5, math.nan])
def test_a_study_is_asked_for_a_share_as_error(error):
    with pytest.raises(InputError, match=r"error = .* is not possible"):
        study(tank(), "front", error=error, backend="numpy")
