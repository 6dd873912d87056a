"""Tables of tests, runs that go on for some steps or to a time, and what other processes are waited for."""

import functools
import os
import pathlib
import subprocess
import sys
import tomllib
from time import monotonic, sleep

ROOT = pathlib.Path(__file__).parents[1]


@functools.cache
def tables(folder):
    return tomllib.loads((folder / "tables.toml").read_text(encoding="utf-8"))


def rows(file, name):
    """A table of `tables.toml` beside a test's file."""
    return tables(pathlib.Path(file).parent)[name]


def advanced(simulation, steps):
    """The simulation after so many further steps."""
    for _ in range(steps):
        simulation.step()
    return simulation


def run_to(simulation, time):
    """The simulation at the first step that reaches a time [s]."""
    while simulation.time < time:
        simulation.step()
    return simulation


def awaited(condition, process, within=120):
    """Waits until a condition holds; a process that ends before is a failure, and one that takes too long is ended."""
    until = monotonic() + within
    while not condition():
        if monotonic() > until:
            process.kill()
        assert process.poll() is None, process.communicate()
        sleep(0.02)


def answer_of(capture, words, code=0):
    """What a command of refsim, with that exit code, has written in this process."""
    from refsim.__main__ import main

    assert main(words) == code
    return capture.readouterr()


def python(*words, folder=None, code=0, given=None, seconds=None, **environment):
    """What a Python of its own has written, which finds the modules that this one finds; `code` is its exit code."""
    done = subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=folder,
        input=given,
        timeout=seconds,
        capture_output=True,
        text=not isinstance(given, bytes),
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | environment,
    )
    assert done.returncode == code, done.stderr[-3000:]
    return done
