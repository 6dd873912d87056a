"""The compile cache: used again where nothing changed, and never after an edit, in whatever file it was made."""

import os
import pathlib
import subprocess
import sys

import pytest

from refsim.compile import sources_behind

FILES = {
    "__init__.py": "",
    "numbers.py": "FACTOR = 2.0\n",
    "formulas.py": """from refsim.compile import formula
from tiny.numbers import FACTOR


@formula
def scaled(x):
    return x * type(x)(FACTOR)
""",
    "particle.py": """from refsim.compile import formula
from tiny import formulas


@formula
def twice(x):
    return formulas.scaled(x) + formulas.scaled(x)
""",
    "cpu.py": """from refsim.compile import cpu_kernel, prange
from tiny import particle


@cpu_kernel
def kernel(values):
    for i in prange(values.shape[0]):
        values[i] = particle.twice(values[i])
""",
    "other.py": "UNRELATED = 1\n",
}
PROGRAM = """
import os, pathlib, time
import numpy as np
from numba.core.caching import IndexDataCacheFile
from tiny.cpu import kernel
def after(seconds, save):
    def late(*arguments):
        time.sleep(float(seconds))
        save(*arguments)
    return late
late = os.environ["LATE"].split()  # between reading and writing the cache's index, and before the code follows
IndexDataCacheFile._save_index = after(late[0], IndexDataCacheFile._save_index)
IndexDataCacheFile._save_data = after(late[1], IndexDataCacheFile._save_data)
def compiled():
    return len(list(pathlib.Path(os.environ["REFSIM_CACHE_DIR"]).glob("*/*.compiled")))
before = compiled()
values = np.ones(3, os.environ["KIND"])
kernel(values)
print(values[0], compiled() - before, sum(kernel.stats.cache_hits.values()))
"""
SUMS = """
import hashlib
import numpy as np
from refsim.neighbours.rows import NeighbourRows
from refsim.operation import REGISTRY
from refsim.smoothing import smoothing
from refsim.sph import Fluid

n, real, random = 300, np.float32, np.random.default_rng(3)
position = random.random((n, 3)).astype(real)
position[:, 2] = 0
values = {
    "position": position,
    "velocity": random.random((n, 3)).astype(real),
    "mass": random.random(n).astype(real),
    "density": (1 + random.random(n)).astype(real),
    "pressure": random.random(n).astype(real),
    "smoothing": smoothing("wendland_c2", 0.2, 2, "float32"),
    "fluid": Fluid(real(1), real(1), np.int32(7), np.int32(1)),
    "neighbours": NeighbourRows(
        np.arange(n) * n, np.full(n, n, np.int32), np.tile(np.arange(n, dtype=np.int32), n)
    ),
    "acceleration": np.zeros((n, 3), real),
}
REGISTRY["sph.pressure"].bind("cpu", values.get)()
print(hashlib.sha256(values["acceleration"].tobytes()).hexdigest())
"""


@pytest.fixture
def tiny(tmp_path):
    package = tmp_path / "tiny"
    package.mkdir()
    for name, text in FILES.items():
        (package / name).write_text(text)
    return package


def started(package, kind="float32", late="0 0"):
    """A process of its own that runs the kernel on numbers of a kind, and is late by some seconds in saving it."""
    environment = dict(os.environ, REFSIM_CACHE_DIR=str(package.parent / "cache"), KIND=kind, LATE=late)
    here = [str(package.parent), str(pathlib.Path(__file__).parents[1]), environment.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(here)
    return subprocess.Popen([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, text=True, env=environment)


def ended(process):
    """(result, kernels compiled, cache hits) of the kernel in a process."""
    words, _ = process.communicate()
    assert process.returncode == 0
    value, compiled, hits = words.split()
    return float(value), int(compiled), int(hits)


def run(package):
    return ended(started(package))


def edit(package, name, old, new):
    path = package / name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def test_edits_behind_a_kernel_are_seen_and_others_cost_nothing(tiny):
    assert run(tiny) == (4, 1, 1)
    assert run(tiny) == (4, 0, 1)
    edit(tiny, "other.py", "1", "2")  # a file that the kernel has nothing to do with
    assert run(tiny) == (4, 0, 1)
    edit(tiny, "formulas.py", "x * type(x)(FACTOR)", "x - type(x)(FACTOR)")  # called through a second file
    assert run(tiny) == (-2, 1, 1)
    edit(tiny, "numbers.py", "2.0", "3.0")  # a constant in a third
    assert run(tiny) == (-4, 1, 1)


def test_processes_that_compile_one_kernel_at_once_do_not_disturb_each_other(tiny):
    at_once = [started(tiny, "float32", late="1.2 0"), started(tiny, "float64", late="0.6 1.8")]
    assert [ended(p)[0] for p in at_once] == [4, 4]
    assert [ended(started(tiny, kind)) for kind in ("float32", "float64")] == [(4, 0, 1), (4, 0, 1)]


def test_sources_behind_a_kernel(tiny):
    found = {path.name for path in sources_behind(tiny / "cpu.py")}
    assert found >= {"cpu.py", "particle.py", "formulas.py", "numbers.py"}
    assert "other.py" not in found


def test_a_cache_that_cannot_be_written_does_no_harm(tiny):
    (tiny.parent / "cache").write_text("in the way")
    assert run(tiny) == (4, 0, 0)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there, the process that compiles runs code of its own")
def test_the_process_that_compiles_computes_the_same_bits(tmp_path):
    """Sums may be taken in any order, but in the same one before and after a resume."""
    environment = dict(os.environ, REFSIM_CACHE_DIR=str(tmp_path))
    environment["PYTHONPATH"] = os.pathsep.join(
        [str(pathlib.Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    )
    command = [sys.executable, "-c", SUMS]
    first, second = (
        subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout for _ in range(2)
    )
    assert first == second
