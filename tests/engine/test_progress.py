"""What a run shows by itself: a bar where one is seen, messages to Python's logging, seconds that add up."""

import json
import logging
import os
import sys
import time
import types

import pytest

from refsim import Ball, RunStopped, simulate
from refsim.core import terminal
from refsim.engine import driver
from refsim.scene.files import parse_scene
from tests.running import python
from tests.tank_file import GRAVITY, tank


def scene(**changes):
    return parse_scene(tank(1e-3, 4, 4, GRAVITY), "tank.toml").with_(name="block", step=2e-4, **changes)


def run(**options):
    return simulate(scene(), backend="numpy", **options)


def test_no_bar_where_standard_error_is_a_file(capfd):
    run()
    assert capfd.readouterr() == ("", "")


def test_a_bar_on_a_terminal_unless_it_is_switched_off(capfd, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    run()
    shown = capfd.readouterr().err
    assert "block: 16 particles in 2D, float32, backend numpy, to 0.001 s\n" in shown
    assert "100%" in shown
    assert "into" not in shown
    run(progress=False)
    run(progress=lambda simulation: None)
    assert capfd.readouterr().err == ""


def test_a_bar_in_jupyter(capfd, monkeypatch):
    """A kernel's standard error is no terminal; its shell is known by its class."""
    shell = type("ZMQInteractiveShell", (), {})()
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setattr(terminal.importlib.util, "find_spec", lambda name: None)  # no ipywidgets
    run()
    assert "100%" in capfd.readouterr().err
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: None))
    run()
    assert capfd.readouterr().err == ""


def test_the_run_is_logged(caplog, tmp_path):
    with caplog.at_level(logging.DEBUG, logger="refsim"):
        simulate(scene(dtype="float32", fluid=(Ball(radius=0.03),)), backend="numpy", output=tmp_path, every=5e-4)
    messages = [(record.levelname, record.getMessage()) for record in caplog.records]
    assert messages[0][0] == "INFO"
    assert messages[0][1].startswith("block: ")
    assert any(level == "WARNING" and "brakes free rotation" in text for level, text in messages)
    assert sum(text.startswith("frame at") for _, text in messages) == 3
    assert messages[-1] == ("INFO", "block: reached 0.001 s in 5 steps")


def test_a_stop_is_logged_with_its_reason(caplog):
    with pytest.raises(RunStopped):
        run(asked_to_stop=lambda: True)
    last = caplog.records[-1]
    assert (last.levelname, last.getMessage().endswith("[interrupted]")) == ("ERROR", True)


PARTS = ("start", "compiling", "steps", "writing")


@pytest.mark.skipif(os.name != "posix", reason="children's seconds are read by getrusage")
def test_the_parts_of_a_process(tmp_path):
    """They are its wall time and its processor seconds, less its end; the start holds what came before refsim."""
    import resource

    (tmp_path / "tank.toml").write_text(tank(0.002))
    program = "import time\nwhile time.process_time() < 0.3: pass\nimport sys, refsim.__main__ as r\nsys.exit(r.main())"
    words = ("run", "tank.toml", "--backend", "numpy", "--quiet")
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    told = python("-c", program, *words, folder=tmp_path).stdout
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    seconds = json.loads((tmp_path / "tank_run" / "report.json").read_bytes())["seconds"]
    for each in (seconds, seconds["processor"]):
        assert all(each[name] >= -1e-9 for name in PARTS)
        assert sum(each[name] for name in PARTS) == pytest.approx(each["total"], abs=1e-9)
    assert seconds["compiling"] == 0  # the reference compiles nothing
    assert 0.6 * used < seconds["total"] < wall
    assert 0.6 * used < seconds["processor"]["total"] < used
    assert min(seconds["start"], seconds["processor"]["start"]) > 0.3
    assert all(f"{name} " in told.splitlines()[1] for name in PARTS)


@pytest.mark.parametrize("seconds, said", [(0.9, 0), (1.1, 1), (1.9, 1)])
def test_compiling_is_told_of_above_a_second(seconds, said, monkeypatch):
    words = []
    monkeypatch.setattr(driver, "say", words.append)
    monkeypatch.setattr(driver, "Bar", lambda until, time: (until, time))
    run = type("Run", (), {"time": 0.25, "timings": type("T", (), {"account": lambda self: {"compiling": seconds}})()})
    shown = driver.Progress.__new__(driver.Progress)
    shown.until = 2.0
    shown._open(run)
    assert (len(words), shown.time, shown.bar) == (said, 0.25, (2.0, 0.25))
