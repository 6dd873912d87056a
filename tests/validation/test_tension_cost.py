"""Which model for which accuracy: errors and advice from drops that are made up."""

import json
import math

import pytest

from validation.experiments.laplace import runs as tension_cost
from validation.measure import drop_seconds
from validation.measure.drops import Point


def row(radius, laplace, rayleigh, steps, model="akinci", stopped="", kernels="mueller", seed=1):
    base = {"dim": 3, "support": 2.6, "stiffness": 0.01, "kernels": kernels, "model": model, "radius": radius}
    return {
        **base, "dtype": "float32", "backend": "cpu", "stopped": stopped, "laplace": laplace, "rayleigh": rayleigh,
        "misfit": 0.1, "roughness": 0.01, "steps": steps, "particles": 100,
        "key": f"{model}.{kernels}.{radius:g}.{seed}",
    }  # fmt: skip


def timings(*rows):
    """A tenth of a second a step for each."""
    made = [{"key": r["key"], "seconds_per_step": 0.1} for r in rows]
    return {"cpu": {"machine": "a processor", "date": "2026-01-01", "rows": made}}


@pytest.fixture
def promise(monkeypatch):
    monkeypatch.setattr(tension_cost, "promised", lambda model, kernels, rows: (4.0, 0.02))


def points(*rows):
    return tension_cost.points(rows, timings(*rows))


def test_errors_are_those_off_the_promised_tension(promise):
    first, second = row(10.0, 4.4, 4.0 * 1.1**2, 90), row(10.0, 3.6, 4.0 * 0.9**2, 70, seed=2)
    (point,) = tension_cost.points([first, second], timings(first))  # one of the seeds is timed
    assert (point["sigma"], point["frequency"]) == (pytest.approx(0.1), pytest.approx(0.1))
    assert (point["seconds"], point["seeds"]) == (pytest.approx(8.0), 2)
    (gone,) = points(row(10.0, 4.0, 4.0, 9), row(10.0, math.nan, math.nan, 1, stopped="dispersed", seed=2))
    assert gone["stopped"] == "dispersed"
    (untimed,) = tension_cost.points([first], {})
    assert math.isnan(untimed["seconds"])
    assert tension_cost.timed([untimed, gone]) == []


def test_advice_is_the_cheapest_that_stays_within_the_bar_at_every_larger_size(promise):
    rows = [row(7.0, 4.0, 4.0, 10), row(10.0, 4.3, 4.0, 50), row(14.0, 4.1, 4.0, 200)]
    found = dict(tension_cost.advice(points(*rows)))
    assert found[0.1]["radius"] == 7.0
    assert found[0.05]["radius"] == 14.0  # at 7 d it is luck: 10 d is 7.5 % off
    assert found[0.025]["radius"] == 14.0
    assert tension_cost.advice(points(row(10.0, 8.0, 4.0, 10)))[0][1] is None


def test_steps_are_timed_in_turns_and_kept_beside_those_of_another_machine(tmp_path, monkeypatch):
    monkeypatch.setattr(drop_seconds, "WARM", (2, 1.0))
    monkeypatch.setitem(drop_seconds.MOST, "cpu", 2)
    (timed,) = drop_seconds.timed([Point("akinci", 3, radius=3.0)])
    assert timed["blocks"] == drop_seconds.ROUNDS
    assert 1e-6 < timed["seconds_per_step"] < 1.0
    path = tmp_path / "seconds.json"
    for kind in ("cuda", "cpu"):
        drop_seconds.write(kind, [timed], {"machine": kind, "date": "2026-01-01", "load": 0.0}, path)
    found = drop_seconds.read(path)
    assert found["cuda"]["rows"] == [timed] == json.loads(path.read_text())["cpu"]["rows"]
    assert tension_cost.by_key(found) == {timed["key"]: timed["seconds_per_step"]}
    assert tension_cost.machines(found) == "one thread of cpu, 2026-01-01; one cuda, 2026-01-01"
