"""The layer that starts CPU threads, and how many there are by default."""

import os
import sys

import numba
import numpy as np
import pytest

from refsim import Cloud, Scene, Simulation, WeaklyCompressible
from refsim.backends import threads
from refsim.core.errors import InputError
from tests.running import ROOT, advanced, python, rows

STARTS = {
    "threads first": "from refsim.backends.arrays import Backend, threads_of; threads_of(Backend('cpu'), 1)",
    "kernels first": "import refsim.backends.compile",
}


@pytest.mark.parametrize("first, named", [("threads first", None), ("kernels first", None), ("threads first", "omp")])
def test_the_layer_does_not_depend_on_what_is_loaded_first(first, named):
    """The work queue, unless the environment names another: OpenMP waits in a busy loop where cores are shared."""
    set_layer = f"os.environ['NUMBA_THREADING_LAYER'] = {named!r}" if named else ""
    program = f"import os; os.environ.pop('NUMBA_THREADING_LAYER', None); {set_layer}\n{STARTS[first]}"
    program += "; import numba; numba.set_num_threads(1); print(numba.config.THREADING_LAYER)"
    assert python("-c", program).stdout.split() == [named or "workqueue"]


@pytest.mark.parametrize(("rows", "cores", "expected"), [(0, 8, 1), (2047, 8, 1), (2048, 8, 2), (10**6, 8, 8)])
def test_as_many_threads_as_a_loop_gains_from(rows, cores, expected, monkeypatch):
    """One for 1,024 rows, at least one, at most all."""
    monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", cores)
    assert threads.threads_for(rows) == expected


@pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one core: nothing to compare one thread with")
def test_a_small_scene_takes_one_thread_and_gives_the_same_bits():
    """By default; a number that is given is taken as it is."""
    random = np.random.default_rng(3)
    axis = 0.01 * np.arange(9)
    place = np.stack([*np.meshgrid(axis, axis), np.zeros((9, 9))], axis=-1).reshape(-1, 3)
    velocity = np.pad(0.1 * random.normal(size=(81, 2)), ((0, 0), (0, 1)))
    scene = Scene(
        dim=2, spacing=0.01, support_radius=0.026, fluid=(Cloud(position=place, velocity=velocity),),
        effects=(WeaklyCompressible(sound_speed=20.0, density="summation"),),
    )  # fmt: skip
    found = []
    for asked, used in ((None, 1), (2, 2)):
        run = Simulation(scene, backend="cpu", threads=asked)
        assert run.threads == used
        advanced(run, 5)
        found.append(run.field("position").tobytes())
    assert found[0] == found[1]


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or threads.cores() < 2, reason="one core, or none to choose")
def test_threads_stay_on_their_processors_while_nothing_else_computes():
    """The first look pins them; a processor that others take, or a loop of fewer threads, sets them free."""
    program = """
import os, time
from refsim.backends import threads
threads.LOOK, taken = 0.0, [0.0]
threads._busy = lambda processors: taken[0] + time.process_time()
threads.choose_layer()
places = threads.places
def where():
    return [sorted(os.sched_getaffinity(thread)) for thread in places.threads]
def look(number, seconds=0.0):
    with places.used(number):
        taken[0] += seconds
        places.keep()
        found = where()
    assert where() == free
    return found
mask = sorted(os.sched_getaffinity(0))
free, alone = [mask] * len(mask), [[one] for one in mask]
assert [look(len(mask)), look(len(mask), 9.0), look(len(mask)), look(1)] == [alone, free, alone, free]
look(len(mask))
with places.used(len(mask)):
    assert where() == alone, "without a look, as the last one found"
    with places.used(1), places.used(len(mask)):
        pass
    assert where() == alone
os.sched_setaffinity(0, mask[:1])
assert look(len(mask)) == free, "the process has one processor for all of them"
os.sched_setaffinity(0, mask)
os.sched_setaffinity(places.threads[0], mask[-1:])
free[0] = mask[-1:]
assert look(len(mask)) == free, "another program has chosen its place"
assert sorted(os.sched_getaffinity(0)) == mask
"""
    python("-c", program, seconds=100)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or threads.cores() < 2, reason="one core, or none to choose")
def test_a_simulation_leaves_the_process_as_it_was():
    """After import, start, steps, a run, an error in it and Ctrl-C, also where its threads were pinned meanwhile."""
    program = """
import gc, locale, logging, os, signal, sys, time, warnings
import matplotlib, numba, numpy as np
numba.config.THREADING_LAYER = "workqueue"
def tasks():
    return set(map(int, os.listdir("/proc/self/task")))
others = tasks()
numba.get_num_threads()  # starts them
started = tasks() - others
def state():
    return {
        "threads": numba.get_num_threads(), "processors": {one: os.sched_getaffinity(one) for one in started},
        "own": os.sched_getaffinity(0), "warnings": list(warnings.filters),
        "signals": [signal.getsignal(n) for n in sorted(signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP})],
        "hooks": (sys.unraisablehook, sys.excepthook, sys.getrecursionlimit()), "environment": dict(os.environ),
        "matplotlib": (dict(matplotlib.rcParams), matplotlib.get_backend(auto_select=False)),
        "numpy": (np.geterr(), np.get_printoptions(), np.random.get_state()[1].tobytes()),
        "logging": (logging.root.level, logging.root.handlers[:]),
        "others": (os.getcwd(), locale.setlocale(locale.LC_ALL), gc.isenabled()),
    }
def same(when):
    after = state()
    assert [name for name in before if before[name] != after[name]] == [], (when, after)
before = state()
import refsim
same("import")
from refsim.backends import threads
threads.LOOK, threads._busy = 0.0, lambda processors: time.process_time()
threads.places.threads = sorted(started)
place = 0.01 * np.indices((9, 9, 1)).reshape(3, -1).T
def meet(how):
    def progress(run):
        assert not run.steps or numba.get_num_threads() == run.threads
        pinned.append(threads.places.pinned)
        if how is not None and run.steps == 2:
            how()
    return progress
def fail():
    raise ZeroDivisionError
scene = refsim.Scene(dim=2, spacing=0.01, support_radius=0.026, fluid=(refsim.Cloud(position=place),),
                     effects=(refsim.WeaklyCompressible(sound_speed=20.0, density="summation"),))
for number in (None, len(os.sched_getaffinity(0))):
    pinned = []
    run = refsim.Simulation(scene, threads=number)
    same("start")
    end = 3 * run.step().length
    same("step")
    run.field("density")
    same("field")
    refsim.simulate(run, end, progress=meet(None))
    same("run")
    for how, kind in ((fail, ZeroDivisionError), (lambda: signal.raise_signal(signal.SIGINT), KeyboardInterrupt)):
        try:
            refsim.simulate(scene, end, threads=number, progress=meet(how))
        except kind:
            same(kind)
        else:
            raise AssertionError(kind)
    assert any(pinned) == (number is not None)
"""
    python("-W", "default", "-c", program, seconds=100)


@pytest.mark.parametrize("command, variable, value, words", rows(__file__, "impossible_threads"))
def test_threads_that_numba_cannot_have_are_told_in_one_sentence(command, variable, value, words):
    found = python(*command.split(), folder=ROOT, code=2, **{variable: value})
    assert words in found.stderr
    assert "Traceback" not in found.stderr


def test_a_layer_without_its_library_is_told(monkeypatch):
    monkeypatch.setenv("NUMBA_THREADING_LAYER", "tbb")
    monkeypatch.setitem(sys.modules, "numba.np.ufunc.tbbpool", None)
    with pytest.raises(InputError, match=r"NUMBA_THREADING_LAYER = tbb: its library cannot be loaded .*; install it"):
        threads.choose_layer()
