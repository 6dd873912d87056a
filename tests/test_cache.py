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
import numpy as np
from tiny.cpu import kernel
values = np.ones(3, np.float32)
kernel(values)
print(values[0], sum(kernel.stats.cache_hits.values()))
"""


@pytest.fixture
def tiny(tmp_path):
    package = tmp_path / "tiny"
    package.mkdir()
    for name, text in FILES.items():
        (package / name).write_text(text)
    return package


def run(package):
    """(result, cache hits) of the kernel in a process of its own."""
    environment = dict(os.environ, REFSIM_CACHE_DIR=str(package.parent / "cache"))
    here = [str(package.parent), str(pathlib.Path(__file__).parents[1]), environment.get("PYTHONPATH", "")]
    environment["PYTHONPATH"] = os.pathsep.join(here)
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, env=environment, check=True)
    value, hits = done.stdout.split()
    return float(value), int(hits)


def edit(package, name, old, new):
    path = package / name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def test_edits_behind_a_kernel_are_seen_and_others_cost_nothing(tiny):
    assert run(tiny) == (4, 0)
    assert run(tiny) == (4, 1)
    edit(tiny, "other.py", "1", "2")  # a file that the kernel has nothing to do with
    assert run(tiny) == (4, 1)
    edit(tiny, "formulas.py", "x * type(x)(FACTOR)", "x - type(x)(FACTOR)")  # called through a second file
    assert run(tiny) == (-2, 0)
    edit(tiny, "numbers.py", "2.0", "3.0")  # a constant in a third
    assert run(tiny) == (-4, 0)


def test_sources_behind_a_kernel(tiny):
    found = {path.name for path in sources_behind(tiny / "cpu.py")}
    assert found >= {"cpu.py", "particle.py", "formulas.py", "numbers.py"}
    assert "other.py" not in found


def test_a_cache_that_cannot_be_written_does_no_harm(tiny):
    (tiny.parent / "cache").write_text("in the way")
    assert run(tiny) == (4, 0)
