"""Seconds of a run: its parts add up, and all that is waited for is in one of them."""

import json
import os
import time
import types

import pytest

from refsim.engine import driver
from refsim.engine.timings import Timings
from tests.running import python
from tests.tank_file import tank

PARTS = ("start", "compiling", "steps", "writing")


def add_up(seconds):
    for each in (seconds, seconds["processor"]):
        assert all(each[name] >= -1e-9 for name in PARTS)
        assert sum(each[name] for name in PARTS) == pytest.approx(each["total"], abs=1e-9)


@pytest.mark.parametrize("name", ["numpy", "cuda"])
def test_a_profile_has_the_seconds_of_the_loop_and_on_a_gpu_a_note(name, monkeypatch):
    """Also those that a run counted before it was resumed."""
    monkeypatch.setattr(driver, "time", types.SimpleNamespace(perf_counter=lambda: 107.0))
    timings = Timings(wait=lambda: None)
    timings.run("density", lambda: None)
    timings.run("density", lambda: None)
    backend = types.SimpleNamespace(name=name)
    loop = types.SimpleNamespace(
        simulation=types.SimpleNamespace(timings=timings, backend=backend), loop_began=100.0, counted_before=2.0
    )
    found = driver._Run._profile(loop)
    assert ("one by one" in found["note"]) == (name == "cuda")
    assert sum(stage["seconds"] + stage["first"] for stage in found["stages"]) == pytest.approx(9.0)
    timings.wait = None
    assert driver._Run._profile(loop) is None


@pytest.mark.skipif(os.name != "posix", reason="children's seconds are read by getrusage")
def test_the_parts_of_a_process(tmp_path):
    """They are its wall time and its processor seconds, less its end; the reference compiles nothing."""
    import resource

    (tmp_path / "tank.toml").write_text(tank(0.002))
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    told = python("-m", "refsim", "run", "tank.toml", "--backend", "numpy", "--quiet", folder=tmp_path).stdout
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    seconds = json.loads((tmp_path / "tank_run" / "report.json").read_bytes())["seconds"]
    add_up(seconds)
    assert seconds["compiling"] == 0
    assert 0.6 * wall < seconds["total"] < wall
    assert 0.6 * used < seconds["processor"]["total"] < used
    assert 0.6 * used < seconds["processor"]["start"]  # Python, refsim's modules and the plan
    assert all(f"{name} " in told.splitlines()[1] for name in PARTS)
