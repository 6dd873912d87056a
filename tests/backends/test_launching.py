"""CUDA kernels are launched directly while numba-cuda has the private names for it, and publicly without them.

No GPU is needed: the dispatcher, the driver's stream and `cuda.core` are replaced by objects that record the calls.
"""

import pathlib
import sys
import types
import warnings

import numpy as np
import pytest

from refsim.backends import arrays, launching
from refsim.backends import compile as compiler
from refsim.backends.fast import private
from refsim.backends.runtime import simulated
from refsim.commands import doctor


class FakeArray:
    """What a launch reads of a device array of 4 numbers in float32."""

    dtype, ndim, shape, strides, size = np.dtype("float32"), 1, (4,), (4,), 4
    device_ctypes_pointer = types.SimpleNamespace(value=4096)

    def copy_to_host(self):
        raise AssertionError

    def is_c_contiguous(self):
        return True


class FakeDispatcher:
    """Compiles at the first public launch, as Numba's does."""

    def __init__(self, calls):
        function = types.SimpleNamespace(kernel="compiled")
        library = types.SimpleNamespace(get_cufunc=lambda: function)
        self.calls, self.overloads, self.compiled = calls, {}, types.SimpleNamespace(_codelibrary=library)

    def __getitem__(self, where):
        def launch(*arguments):
            self.overloads[tuple(map(type, arguments))] = self.compiled
            self.calls.append(("public", where, arguments))

        return launch


def scale(factor, out):
    """A kernel of two arguments; it never runs."""


@pytest.fixture
def kernel(monkeypatch):
    """A kernel on fakes; `kernel.calls` has what was launched."""
    from numba.cuda.cudadrv import driver

    calls = []
    core, typing = types.ModuleType("cuda.core"), types.ModuleType("numba.cuda.typing.typeof")
    core.LaunchConfig = lambda grid, block: (grid, block)
    core.launch = lambda stream, config, kernel, *values: calls.append((kernel, stream, config, values))
    typing.Purpose, typing.typeof = types.SimpleNamespace(argument=1), lambda value, purpose: type(value)
    monkeypatch.setitem(sys.modules, "cuda.core", core)
    monkeypatch.setitem(sys.modules, "numba.cuda.typing.typeof", typing)
    monkeypatch.setattr(driver, "_to_core_stream", lambda stream: f"core {stream}", raising=False)
    monkeypatch.setattr(launching, "stream", lambda: "stream")
    monkeypatch.setattr(compiler, "stream", lambda: "stream")
    monkeypatch.setattr(launching, "_warned", [])
    monkeypatch.setattr(private, "_lost", {})
    private.names.cache_clear()
    made = compiler.cuda_kernel(scale)
    made.dispatcher, made.launches, made.calls = FakeDispatcher(calls), {}, calls
    return made


def numbers(values):
    return [getattr(value, "value", value) for value in values]


def test_a_compiled_kernel_is_launched_directly(kernel):
    array = FakeArray()
    for _ in range(2):
        kernel(np.float32(2.5), array)
    first, second = kernel.calls
    assert first == ("public", (1, kernel.threads, "stream"), (np.float32(2.5), array))
    assert second[:3] == ("compiled", "core stream", ((1, 1, 1), (kernel.threads, 1, 1)))
    assert numbers(second[3]) == [2.5, 0, 0, 4, 4, 4096, 4, 4]
    assert not private.lost()


@pytest.mark.parametrize("remove", [
    lambda patch, kernel: patch.delattr("numba.cuda.cudadrv.driver._to_core_stream"),
    lambda patch, kernel: patch.delattr(kernel.dispatcher.compiled, "_codelibrary"),
    lambda patch, kernel: patch.setitem(sys.modules, "numba.cuda.typing.typeof", None),
    lambda patch, kernel: patch.setitem(sys.modules, "cuda.core", None),
])  # fmt: skip
def test_without_the_private_names_the_public_launch_is_taken_and_said_once(kernel, monkeypatch, remove):
    remove(monkeypatch, kernel)
    array = FakeArray()
    with pytest.warns(UserWarning, match="launched through Numba's public call"):
        kernel(np.float32(2.5), array)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kernel(np.float32(3.5), array)
        assert launching.direct_launch(kernel.dispatcher, (np.float32(1), array)) is None  # another kernel
    where = (1, kernel.threads, "stream")
    assert kernel.calls == [("public", where, (np.float32(x), array)) for x in (2.5, 3.5)]
    assert private.lost()["launch"].startswith("This version of Numba lacks ")
    private.names.cache_clear()


def test_a_kernel_that_loops_has_no_more_threads_than_run_at_a_time(kernel, monkeypatch):
    kernel.looping, kernel.launches = True, None
    monkeypatch.setattr(FakeArray, "shape", (20 * kernel.threads,))
    for multiprocessors in (1, 7):
        monkeypatch.setattr(compiler, "multiprocessors", lambda count=multiprocessors: count)
        kernel(np.float32(2.5), FakeArray())
    assert [where[0] for _, where, _ in kernel.calls] == [16, 20]


def test_doctor_says_why_launches_are_slower(monkeypatch):
    monkeypatch.setattr(doctor, "lost", lambda: {"launch": "Kernels are launched slowly."})
    monkeypatch.setattr(doctor, "unavailable", lambda name: None if name == "numpy" else "it is not tested")
    found = doctor.execute(None)
    assert found.data["private_names"]["launch"] == "Kernels are launched slowly."
    assert "Kernels are launched slowly." in found.text


def test_the_simulator_launches_publicly():
    assert (compiler.cuda_kernel(scale).launches is None) == simulated()


def test_a_numpy_that_numba_cuda_lacks_is_named(monkeypatch):
    monkeypatch.setattr(arrays, "simulated", lambda: False)
    monkeypatch.setattr(arrays.importlib.util, "find_spec", lambda name: name)
    monkeypatch.setattr(arrays.np, "__version__", "2.5.1")
    said = arrays.unavailable.__wrapped__("cuda")
    assert said == 'numba-cuda does not run with NumPy 2.5.1; run pip install "numpy<2.5"'
    assert f"    numpy<{arrays.NUMPY_BELOW}\n" in (pathlib.Path(__file__).parents[2] / "setup.cfg").read_text()
