"""A body is written once: the loops around it, their files in the cache folder, and the line that an error names."""

import pathlib
import textwrap

import numba
import numpy as np
import pytest

from refsim.backends.arrays import Backend
from refsim.sph import kernels
from tests.backends.launched import launch
from tests.running import python

BODY = """
from refsim.backends.compile import kernel

@kernel
def doubled(i, values, out):
    out[i] = 2 * values[i]

@kernel
def broken(i, values, out):
    out[i] = values.nowhere
"""
PROGRAM = """
import numpy as np, sys
from tiny import body
out = np.zeros(5)
body.doubled(np.arange(5.0), out)
assert list(out) == [0, 2, 4, 6, 8]
print(body.doubled.on("cpu").__code__.co_filename, sum(body.doubled.on("cpu").stats.cache_hits.values()))
try:
    body.broken(np.arange(5.0), out)
except Exception as error:
    print("body.py" in str(error), "values.nowhere" in str(error))
"""


@pytest.fixture
def run(tmp_path):
    (tmp_path / "tiny").mkdir()
    (tmp_path / "tiny" / "__init__.py").touch()
    (tmp_path / "tiny" / "body.py").write_text(BODY)

    def again():
        code, out, err = launch(tmp_path, PROGRAM).ended()
        assert code == 0, err
        return out.split()

    return tmp_path / "cache", again


def test_loops_are_files_of_the_cache_folder_and_found_again(run):
    cache, again = run
    place, hits, *error = again()
    assert pathlib.Path(place).parent.parent == cache
    assert "over_rows(body, out.shape[0], (values, out,))" in pathlib.Path(place).read_text()
    assert error == ["True", "True"], "a typing error does not point at the body"
    stamp = pathlib.Path(place).stat().st_mtime_ns
    _, hits, *_ = again()
    assert (int(hits), pathlib.Path(place).stat().st_mtime_ns) == (1, stamp)


def test_a_kernel_runs_where_its_rows_are():
    field, acceleration = np.array([1.0, 2.0, 3.0]), np.zeros((4, 3))
    kernels.gravity(field, acceleration)
    assert (acceleration == field).all()
    assert kernels.gravity.on("cpu") is kernels.gravity.on("cpu")
    if not numba.config.DISABLE_JIT:
        assert textwrap.dedent(kernels.gravity.source("cpu")).startswith("def gravity(field, acceleration):")


@pytest.mark.parametrize("count", [0, 5, 64, 1000])
def test_running_sums_of_all_threads_are_numpys(count):
    values = np.random.default_rng(count).integers(0, 5, count).astype(np.uint8)
    own, other = (Backend(name).running_sum(values) for name in ("cpu", "numpy"))
    assert own.dtype == other.dtype
    assert own.tolist() == other.tolist()


def test_running_sums_of_bytes_pass_256_where_kernels_are_python():
    """A sum of NumPy's bytes stays a byte, which Numba's does not."""
    script = (
        'import numpy as n; from refsim.backends.reductions import *; print(running_sum(n.full(200, 200, "B"))[-1])'
    )
    assert python("-c", script, NUMBA_DISABLE_JIT="1", PYTHONWARNINGS="error").stdout.strip() == "40000"
