"""Where arrays live and programs run: "numpy" (references), "cpu" (Numba), "cuda" (numba-cuda).

A backend is chosen once and named in every report. Nothing ever falls back to another one.
"""

import contextlib
import functools
import importlib.util
import os
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from refsim.backends.runtime import simulated as simulated
from refsim.backends.threads import choose_layer, places, threads_for
from refsim.core.errors import InputError
from refsim.core.operation import BACKENDS


class Backend:
    """Arrays in host memory and the programs called `name`; base of the CUDA backend."""

    def __init__(self, name: str) -> None:
        self.name = name

    def asarray(self, values: np.ndarray) -> Any:
        """A contiguous copy of a host array on this backend."""
        return np.array(values, order="C")

    def empty(self, shape: Any, dtype: Any) -> Any:
        """An array whose values are not set."""
        return np.empty(shape, dtype)

    def zeros(self, shape: Any, dtype: Any) -> Any:
        """An array of zeros."""
        return np.zeros(shape, dtype)

    def host(self, array: Any) -> np.ndarray:
        """The array's values on the host (no copy where it is there already)."""
        return array

    def assign(self, target: Any, values: Any) -> None:
        """Copy `values` (a host array, an array of this backend or a number) into `target`."""
        target[...] = values

    def taken(self, array: Any, rows: Any) -> np.ndarray:
        """array[rows] on the host, of an array and of row numbers (m,) int32 of this backend."""
        return array[rows]

    def invert(self, order: Any, places: Any) -> None:
        """places[order[i]] = i for a permutation `order` (n,) int32."""
        places[order] = np.arange(len(order), dtype=places.dtype)

    def array_library(self) -> tuple[Any, Callable[[Any], Any], Callable[[Any], Any]]:
        """(NumPy or CuPy, what shows it an array of this backend, what makes one)."""
        return np, np.asarray, np.asarray

    def running_sum(self, values: Any) -> Any:
        """(n + 1,) int32 on this backend: sum of the integers that stand before each place, and of all at the end."""
        xp, to_xp, from_xp = self.array_library()
        total = xp.zeros(values.shape[0] + 1, np.int32)
        total[1:] = xp.cumsum(to_xp(values), dtype=np.int32)
        return from_xp(total)

    def synchronize(self) -> None:
        """Wait until everything launched has run."""


class CudaBackend(Backend):
    """Arrays on one CUDA device (or in the CUDA simulator)."""

    def __init__(self) -> None:
        super().__init__("cuda")
        from refsim.backends import device
        from refsim.backends.compile import cuda

        self.cuda, self.device = cuda, device

    def asarray(self, values: np.ndarray) -> Any:
        return self.cuda.to_device(np.ascontiguousarray(values))

    def empty(self, shape: Any, dtype: Any) -> Any:
        return self.device.empty(shape, dtype)

    def zeros(self, shape: Any, dtype: Any) -> Any:
        array = self.empty(shape, dtype)
        self.device.fill(array, 0)
        return array

    def host(self, array: Any) -> np.ndarray:
        return array.copy_to_host()

    def assign(self, target: Any, values: Any) -> None:
        if np.ndim(values) == 0:
            self.device.fill(target, values)
        elif isinstance(values, np.ndarray):
            target.copy_to_device(np.ascontiguousarray(np.broadcast_to(values, target.shape), target.dtype))
        else:
            target.copy_to_device(values)

    def taken(self, array: Any, rows: Any) -> np.ndarray:
        gathered = self.empty((rows.shape[0], *array.shape[1:]), array.dtype)
        if rows.shape[0]:
            self.device.gather(array, rows, gathered)
        return self.host(gathered)

    def invert(self, order: Any, places: Any) -> None:
        self.device.invert(order, places)

    def array_library(self) -> tuple[Any, Callable[[Any], Any], Callable[[Any], Any]]:
        return self.device.cupy_or_numpy(), self.device.as_cupy, self.device.as_numba

    def synchronize(self) -> None:
        self.cuda.synchronize()


CUDA_PACKAGES = {"numba_cuda": "numba-cuda[cu13]>=0.30", "cupy": "cupy-cuda13x>=14"}  # module: what pip installs
NUMPY_BELOW = "2.5"  # for numba-cuda, as the extra "cuda" requires


@functools.cache
def unavailable(name: str) -> str | None:
    """Why backend `name` cannot run here, or None if it can."""
    if name not in BACKENDS:
        return f"there is no such backend; choose one of {', '.join(BACKENDS)}"
    if name != "cuda" or simulated():
        return None
    missing = [package for module, package in CUDA_PACKAGES.items() if importlib.util.find_spec(module) is None]
    if missing:
        import ctypes.util  # here, because it brings processes along

        if ctypes.util.find_library("cuda") is None:
            return "no driver of an NVIDIA GPU was found"
        needed = " ".join(f'"{package}"' for package in missing)
        return f"the packages of the CUDA backend are not all installed; run pip install {needed}"
    installed, bound = ([int(part) for part in text.split(".")[:2]] for text in (np.__version__, NUMPY_BELOW))
    if installed >= bound:
        return f'numba-cuda does not run with NumPy {np.__version__}; run pip install "numpy<{NUMPY_BELOW}"'
    try:
        from refsim.backends.compile import cuda

        if not cuda.is_available():
            return "no CUDA device or driver was found"
    except Exception as error:  # a broken driver installation may raise anything; its message is passed on
        return f"CUDA does not start ({type(error).__name__}: {error})"
    return None


def device_name() -> str:
    """The GPU in words."""
    if simulated():
        return "CUDA simulator"
    import cupy

    return str(cupy.cuda.runtime.getDeviceProperties(0)["name"].decode())


def require_backend(name: str) -> None:
    """Raise InputError with the reason where the backend called `name` cannot run."""
    if (reason := unavailable(name)) is not None:
        raise InputError(f"Backend {name!r} cannot be used: {reason}.")


def choose(name: str) -> Backend:
    """The backend called `name`. Raises InputError with the reason where it cannot run."""
    require_backend(name)
    return CudaBackend() if name == "cuda" else Backend(name)


def threads_of(backend: Backend, threads: int | None, rows: int | None = None) -> int | None:
    """CPU threads for loops over `rows`; None where the backend has none.

    By default as many as the loops gain from, or all where their rows are not known. Raises InputError for fewer than
    one, and on the CPU backend for more than there are.
    """
    if threads is not None and threads < 1:
        raise InputError(f"threads = {threads} is not possible; give 1 or more.")
    if backend.name != "cpu":
        return None
    import numba

    choose_layer()
    most = numba.config.NUMBA_NUM_THREADS
    if threads is not None and not 1 <= threads <= most:
        raise InputError(f"threads = {threads} is not possible here; give 1 to {most}.")
    return threads or (most if rows is None else threads_for(rows))


def on_threads(number: int | None) -> AbstractContextManager[None]:
    """Have the loops of the block use so many CPU threads (see `threads_of`); after it all is as before."""
    return nullcontext() if number is None else places.used(number)


def host_memory() -> dict[str, int | None]:
    """Bytes of the machine's memory: "total", and "free" to take; None where the system does not say."""
    try:
        page = os.sysconf("SC_PAGE_SIZE")
        total, free = (page * os.sysconf(name) for name in ("SC_PHYS_PAGES", "SC_AVPHYS_PAGES"))
    except (AttributeError, ValueError, OSError):
        return {"total": None, "free": None}
    with contextlib.suppress(OSError, StopIteration, ValueError):  # pages that files only borrow are free to take, too
        lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
        free = 1024 * next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    limit = Path("/sys/fs/cgroup/memory.max")
    if limit.is_file() and (text := limit.read_text(encoding="utf-8").strip()).isdigit():
        total = min(total, int(text))
    return {"total": total, "free": min(free, total)}


def on_backend(value: Any, backend: Backend) -> Any:
    """A value with its arrays on the backend (a copy); of a parameter group those of its members."""
    if isinstance(value, np.ndarray):
        return backend.asarray(value)
    if isinstance(value, tuple) and hasattr(value, "_fields") and any(isinstance(v, np.ndarray) for v in value):
        return type(value)(*(on_backend(part, backend) for part in value))
    return value.on_backend(backend) if hasattr(value, "on_backend") else value


def fill(array: Any, value: float) -> None:
    """Set every element of an array of one or two dimensions, of either backend."""
    if isinstance(array, np.ndarray):
        array[...] = value
    else:
        from refsim.backends import device

        device.fill(array, value)


def largest(array: Any) -> int:
    """Largest of the integers in an array of either backend, 0 if there are none; waits for a CUDA device."""
    if isinstance(array, np.ndarray):
        return int(array.max(initial=0))
    from refsim.backends import device

    return device.largest(array)


class Scratch:
    """Named arrays on one backend, allocated at the first request and kept, so that later steps allocate nothing.

    An operation takes it as the argument `scratch`. The values in an array are those of its latest use.
    """

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self._arrays: dict[str, Any] = {}
        self._packed: tuple[Any, ...] | None = None

    def unchanged(self, held: bool) -> None:
        """From now on positions and masses do not change, or they may."""
        self._packed = () if held else None

    def packs(self, fields: tuple[Any, ...]) -> bool:
        """Note that the first packed row holds these fields, positions and masses; whether it holds them already."""
        before = self._packed
        if before is None:
            return False
        self._packed = fields
        return len(fields) > 0 and len(before) == len(fields) and all(a is b for a, b in zip(before, fields))

    def array(self, name: str, shape: Any, dtype: Any) -> Any:
        """The array called `name`, of this shape and dtype; its values are not set."""
        shape = (shape,) if isinstance(shape, int) else tuple(shape)
        held = self._arrays.get(name)
        if held is None or tuple(held.shape) != shape or held.dtype != np.dtype(dtype):
            held = self._arrays[name] = self.backend.empty(shape, dtype)
        return held

    def called(self, name: str) -> Callable[[str, Any, Any], Any]:
        """`array` for the parts of what is called `name`."""
        return lambda part, shape, dtype: self.array(f"{name} {part}", shape, dtype)

    def host(self, array: Any) -> np.ndarray:
        """An array's values on the host."""
        return self.backend.host(array)

    @property
    def bytes(self) -> int:
        """Memory held."""
        return sum(a.nbytes for a in self._arrays.values())


def capacity_of(rows: int) -> int:
    """Rows of an array that grows: a quarter more than were wanted when it had to be made."""
    return rows + rows // 4


class Growing:
    """Named arrays on one backend whose rows grow."""

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self.held: dict[str, Any] = {}
        self._views: dict[str, Any] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: Any) -> Any:
        """The first rows of the array called `name`, the same view while the shape stays; values are not set."""
        view = self._views.get(name)
        if view is None or view.shape != shape:
            held = self.held.get(name)
            if held is None or held.shape[0] < shape[0]:
                held = self.held[name] = self.backend.empty((capacity_of(shape[0]), *shape[1:]), np.dtype(dtype))
            view = self._views[name] = held[: shape[0]]
        return view


def growing(meaning: str, name: str, shape: Callable[[Any], tuple[int, ...]], dtype: str | None = None) -> Any:
    """A property: that array of the owner's `arrays`, of the shape that the owner gives now, and of its `dtype`."""
    return property(lambda owner: owner.arrays.array(name, shape(owner), dtype or owner.dtype), doc=meaning)
