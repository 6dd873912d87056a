"""Seconds of a run: its parts add up, and all that is waited for is in one of them."""

import json
import os
import time

import pytest

from tests.running import python
from tests.tank_file import tank

PARTS = ("start", "compiling", "steps", "writing")


def add_up(seconds):
    for each in (seconds, seconds["processor"]):
        assert all(each[name] >= -1e-9 for name in PARTS)
        assert sum(each[name] for name in PARTS) == pytest.approx(each["total"], abs=1e-9)


@pytest.mark.skipif(os.name != "posix", reason="children's seconds are read by getrusage")
def test_the_parts_of_a_process(tmp_path):
    """They are its wall time and its processor seconds, less its end; the start holds what came before refsim."""
    import resource

    (tmp_path / "tank.toml").write_text(tank(0.002))
    program = "import time\nwhile time.process_time() < 1: pass\nimport sys, refsim.__main__ as r\nsys.exit(r.main())"
    words = ("run", "tank.toml", "--backend", "numpy", "--quiet")
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    told = python("-c", program, *words, folder=tmp_path).stdout
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    seconds = json.loads((tmp_path / "tank_run" / "report.json").read_bytes())["seconds"]
    add_up(seconds)
    assert seconds["compiling"] == 0  # the reference compiles nothing
    assert 0.6 * used < seconds["total"] < wall
    assert 0.6 * used < seconds["processor"]["total"] < used
    assert min(seconds["start"], seconds["processor"]["start"]) > 1
    assert all(f"{name} " in told.splitlines()[1] for name in PARTS)
