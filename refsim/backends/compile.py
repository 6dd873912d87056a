"""Formulas and kernels: the only module that names Numba's decorators.

A scalar formula is written once in plain Python and marked `@formula`. A kernel's body, marked `@kernel`, says what one
particle (node, sample, cell) does; the loop over particles is made for each backend. Compiled code is cached on disk
(`refsim.backends.cache`).
"""

import atexit
import functools
import gc
import inspect
import os
import pathlib
import sys
from collections.abc import Callable
from typing import Any

import numba
from numba import njit
from numba.core import event
from numba.extending import overload

from refsim.backends import plain
from refsim.backends.cache import cached
from refsim.backends.fast.rows import over_rows
from refsim.backends.fast.vectors import set_vectors
from refsim.backends.launching import direct_launch, kinds_of
from refsim.backends.runtime import simulated, stream
from refsim.backends.threads import choose_layer
from refsim.core.clock import Compiling

THREADS_PER_BLOCK = 128
RESIDENT_THREADS = 2048  # that a multiprocessor runs at a time, or fewer
SIMULATED_THREADS = 8  # each is a Python thread
choose_layer()
TOLD = type("Told", (event.Listener,), {"on_start": Compiling.begin, "on_end": Compiling.end})
event.register("numba:compiler_lock", TOLD())
if 0 < gc.get_threshold()[0] < 50_000:  # 0 is never
    gc.set_threshold(50_000)  # of the many objects that Numba makes few are garbage
atexit.register(gc.freeze)  # or Python looks for cycles among all that Numba holds, for 0.2 s, only to end
ANY_ORDER = {"reassoc", "contract", "arcp", "nsz"}
COMPILE_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}  # C never calls them


def marks(made: Callable) -> Callable[..., Any]:
    """`made(function, **options)` as a decorator, which is written with options or without any."""

    @functools.wraps(made, updated=())
    def mark(function: Callable | None = None, **options: Any) -> Any:
        return functools.partial(made, **options) if function is None else made(function, **options)

    return mark


@marks
def formula(function: Callable, *, inlined: bool = False, ordered: bool = False) -> Any:
    """Mark a scalar formula: plain Python when called from Python, compiled where a kernel calls it.

    On a CPU its code stands in every caller: a process that compiles would call the formula's own machine code, one
    that loads the caller's copy, which may round otherwise. `inlined` does so on a GPU, too, however long the formula
    is: a call passes each array as seven words and each group as all of its members. `ordered` keeps its operations
    as written in every kernel: for what algebra would cancel.
    """
    exactly: dict[str, Any] = {"fastmath": False} if ordered else {}
    function.ordered = ordered  # type: ignore[attr-defined]
    for target, forced in (("cpu", True), ("cuda", inlined)):
        overloaded(function, lambda *types: function, (target,), forceinline=forced, **exactly)
    return function


def overloaded(
    function: Callable, chosen: Callable, targets: tuple[str, ...] = ("cpu", "cuda"), **options: Any
) -> Callable:
    """Let kernels for the targets call what `chosen` gives for the types of the arguments, where they call `function`.

    `options` are those of `numba.jit`, beside those of all kernels. Returns the function.
    """
    for target in targets:
        overload(function, target=target, jit_options=COMPILE_OPTIONS | options, strict=False)(chosen)
    return function


def cuda_formula(function: Callable) -> Any:
    """Mark a formula that names `cuda`, for CUDA kernels of any module.

    The simulator replaces `cuda` in the module of a kernel or of a device function, and in no other.
    """
    return _load_cuda().jit(device=True)(function) if simulated() else formula(function)


@marks
def cpu_kernel(function: Callable, *, ordered: bool = False, packed: bool = False, module: str | None = None) -> Any:
    """Compile a kernel for the CPU; its module may be another than that of the loop.

    Sums may be taken in another order and products fused, so that loops over neighbours vectorise. The
    contract's bound holds for any order of summation; NaN and infinity keep their meaning. `ordered` keeps the order
    as written, for sums of small differences of large numbers, which another order would take apart. `packed` is for
    code that does the same with each of four numbers that stand side by side in memory (see `set_vectors`).
    """
    flags = ANY_ORDER - {"reassoc"} if ordered else ANY_ORDER
    if plain.chosen():
        return plain.PlainKernel(function, module or function.__module__, flags)
    dispatcher = njit(**COMPILE_OPTIONS, fastmath=set(flags), nogil=True)(function)
    if hasattr(dispatcher, "compile"):
        set_vectors(dispatcher, packed, ordered)
    return cached(dispatcher, function)


class CudaKernel:
    """A CUDA kernel that launches itself over the rows of one of its arguments: the last one, or `rows_of`, an argument
    or "group.member".

    A thread takes a row (with `lanes` so many threads: a number, or as many as share a column of the list of that name,
    True for `neighbours`), or, with `block_for_each_row`, a block, of `threads` threads where the kernel counts on
    their number. `registers` is the largest number for each thread: with fewer registers more threads run at a time,
    and some values are kept in local memory. With `looping` there are no more threads than run at a time, and the
    kernel takes its rows in a loop; with `resident` it has one block for each multiprocessor, and they may wait for
    each other. An `early` one begins while the kernel launched before it ends, where the device can.
    """

    # What keeps an early kernel safe: its first block always calls `wait_for_last`, so that kernels end in their order.
    # It begins once every block of the kernel before has left that call or has ended: then all before that one have
    # ended. Ahead of its own call it may read what they wrote, not what the last one does, and write what that one
    # neither reads nor writes, in every program that launches both. It pays where there is work ahead of the call.
    def __init__(
        self, function: Callable, *, rows_of: str | None = None, lanes: str | int = 1,
        block_for_each_row: bool = False, threads: int | None = None, registers: int | None = None,
        looping: bool = False, resident: bool = False, early: bool = False,
    ) -> None:  # fmt: skip
        names = list(inspect.signature(function).parameters)
        self.block_for_each_row, self.looping, self.resident = block_for_each_row, looping, resident
        self.early = early
        self.lanes = 1 if isinstance(lanes, str) else lanes
        self.list_at = names.index(lanes) if isinstance(lanes, str) else None
        of, _, self.member = (rows_of or names[-1]).partition(".")
        self.rows_at = names.index(of)
        self.threads = threads or (SIMULATED_THREADS if simulated() else THREADS_PER_BLOCK)
        self.__wrapped__ = self.function = function
        self.__name__, self.__doc__ = function.__name__, function.__doc__
        self.__signature__ = inspect.signature(function)
        options: dict[str, Any] = {}
        if not simulated():  # the simulator takes None as it is and has no such options
            options["extensions"] = [_AbsentArgument()]
            if registers is not None:
                options["max_registers"] = registers
        self.dispatcher = cached(_load_cuda().jit(**options)(function), function)
        self.launches: Any = None if simulated() else {}

    def __call__(self, *arguments: Any) -> None:
        of = arguments[self.rows_at]
        listed = getattr(of, self.member) if self.member else of
        rows = multiprocessors() * self.threads if self.resident else listed.shape[0] * self.lanes
        if self.list_at is not None:
            rows *= len(arguments[self.list_at].lanes)
        if rows:
            blocks = rows if self.block_for_each_row else (rows + self.threads - 1) // self.threads
            if self.looping:
                blocks = min(blocks, multiprocessors() * (RESIDENT_THREADS // self.threads))
            kinds = None if self.launches is None else kinds_of(arguments)
            if kinds is not None and kinds in self.launches:
                self.launches[kinds](blocks, self.threads, arguments, self.early and begins_early())
                return
            self.dispatcher[blocks, self.threads, stream()](*arguments)  # compiles
            if kinds is not None:
                launch = direct_launch(self.dispatcher, arguments)
                self.launches = launch and self.launches | {kinds: launch}


@functools.cache
def multiprocessors() -> int:
    """Number of the device's multiprocessors; one in the simulator."""
    return 1 if simulated() else _load_cuda().get_current_device().MULTIPROCESSOR_COUNT


@functools.cache
def begins_early() -> bool:
    """Whether the device can begin a kernel before the last one has ended; where there is none, kernels are for one."""
    there = _load_cuda()
    if not there.is_available():
        return True
    version = there.cudadrv.driver.get_version()
    return there.get_current_device().compute_capability >= (9, 0) and version >= (12, 3)


class _AbsentArgument:
    """Lets `None` stand for an absent optional argument of a CUDA kernel: it travels as a null pointer."""

    def prepare_args(self, ty: Any, value: Any, **_: Any) -> tuple[Any, Any]:
        from numba import types

        if isinstance(ty, types.NoneType):
            return types.CPointer(types.void), 0
        return ty, value


cuda_kernel = marks(CudaKernel)  # for CUDA, or for the CUDA simulator if NUMBA_ENABLE_CUDASIM is set


def on_device(array: Any) -> bool:
    """Whether an array is a GPU's, or the CUDA simulator's."""
    return hasattr(array, "copy_to_host")


class Kernel:
    """What one row does, written once, and the kernels made of it: a loop (`over_rows`) and a CUDA kernel.

    The body takes the row's number `i`, with `lanes` also `lane`, and then the arguments, outputs last. Rows are those
    of the last argument, or of `rows_of`. With `lanes` (the name of a list, True for `neighbours`, or a number) so many
    neighbouring CUDA threads share a row: `lane` is (number of the thread, number of threads), and None on a CPU.
    `ordered` and `packed` are options of `cpu_kernel`, `registers` and `looping`, for bodies that do little, of
    `cuda_kernel`. Only with `allocates` may the body, or a formula that it calls, make an array on the CPU.

    Called itself, it runs the program for the backend on which the array of rows lives.
    """

    def __init__(
        self, function: Callable, *, rows_of: str | None = None, lanes: bool | str | int = False, ordered: bool = False,
        packed: bool = False, allocates: bool = False, registers: int | None = None, looping: bool = False,
    ) -> None:  # fmt: skip
        names = list(inspect.signature(function).parameters)
        function.shown_as = f"{function.__name__}_of_row"  # type: ignore[attr-defined]
        # Counting references to arrays costs time in each row, and serves only bodies that make arrays.
        self.body = overloaded(function, lambda *types: function, forceinline=True, _nrt=allocates)
        self.arguments = names[2 if lanes else 1 :]
        self.rows = rows_of or names[-1]
        self.lanes = "neighbours" if lanes is True else lanes
        self.options: dict[str, dict[str, Any]] = {
            "cpu": {"ordered": ordered, "packed": packed, "module": function.__module__},
            "cuda": {"rows_of": self.rows, "lanes": self.lanes or 1, "registers": registers, "looping": looping},
        }
        self.__name__, self.__doc__, self.__module__ = function.__name__, function.__doc__, function.__module__
        self.__wrapped__ = function
        self._made: dict[str, Any] = {}

    def source(self, backend: str) -> str:
        """The loop around the body on `backend`, "cpu" or "cuda", as Python; "plain" is a GPU's without lanes."""
        given, lane, row = ", ".join(self.arguments), "None, " if self.lanes else "", "i = cuda.grid(1)"
        if backend == "cpu":
            return f"def {self.__name__}({given}):\n    over_rows(body, {self.rows}.shape[0], ({lane}{given},))\n"
        if self.lanes and backend == "cuda":
            lanes = f"len({self.lanes}.lanes)" if isinstance(self.lanes, str) else self.lanes
            lane, row = "(lane, lanes), ", f"lanes = {lanes}\n    i, lane = cuda.grid(1) // lanes, cuda.grid(1) % lanes"
        taken = f"if i < {self.rows}.shape[0]"
        if self.options["cuda"]["looping"] and backend == "cuda":
            row, taken = "", f"for i in range(cuda.grid(1), {self.rows}.shape[0], cuda.gridsize(1))"
        return f"def {self.__name__}({given}):\n    {row}\n    {taken}:\n        body(i, {lane}{given})\n"

    def on(self, backend: str) -> Any:
        """The kernel for `backend`, "cpu" or "cuda"; made at first use."""
        if backend not in self._made:
            made = cuda_kernel if backend == "cuda" else cpu_kernel
            self._made[backend] = made(self.wrapper(backend), **self.options[backend])
        return self._made[backend]

    program = on  # what is called with the arguments on a backend: the kernel itself

    def __call__(self, *arguments: Any) -> None:
        rows = arguments[self.arguments.index(self.rows)]
        self.program("cuda" if on_device(rows) else "cpu")(*arguments)

    def _named(self, backend: str) -> dict[str, Any]:
        """What the loop names beside its arguments."""
        return {"body": self.body, "over_rows": over_rows} | ({} if backend == "cpu" else {"cuda": _load_cuda()})

    def wrapper(self, backend: str) -> Callable:
        """The loop as a function whose source is a file of the cache folder, where Numba's cache looks for it."""
        source = getattr(sys.modules[self.__module__], "__file__", None) or self.body.__code__.co_filename
        text, named = self.source(backend), self._named(backend)
        function = plain.function_of_text(text, self.__name__, pathlib.Path(source), self.__module__, named)
        function.__doc__ = self.__doc__
        return function


kernel = marks(Kernel)


@marks
def row_kernel(function: Callable, **options: Any) -> CudaKernel:
    """A CUDA kernel of what one row does, as a `Kernel` takes it; for what only a GPU does."""
    made = Kernel(function, **options)
    if simulated():  # which replaces `cuda` in the module of a device function
        made.body = _load_cuda().jit(device=True)(function)
    launched = made.on("cuda")
    launched.__wrapped__ = function
    return launched


@functools.cache
def _load_cuda() -> Any:
    from numba import cuda as module

    if "NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS" not in os.environ:
        numba.config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # small scenes are valid
    return module


def __getattr__(name: str) -> Any:
    if name == "cuda":
        return _load_cuda()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
