"""Formulas and kernels: the only module that names Numba's decorators.

A scalar formula is written once in plain Python and marked `@formula`. A kernel's body, marked `@kernel`, says what one
particle (node, sample, cell) does; the loop over particles is made for each backend. Compiled code is cached on disk
under a digest of every source behind a kernel, because Numba's own cache looks at one file only and would return old
numbers after an edit in another.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import hashlib
import inspect
import linecache
import os
import pathlib
import re
import shutil
import sys
import tempfile
import types
import warnings
from collections.abc import Callable
from typing import Any

import numba
from numba import njit
from numba import prange as prange
from numba.extending import register_jitable

from refsim.backends.cache_files import check_files, is_stored, refuse_foreign
from refsim.backends.launching import Launch, direct_launch, kinds_of
from refsim.backends.runtime import simulated, stream

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

THREADS_PER_BLOCK = 128
SIMULATED_THREADS = 8  # each is a Python thread
if "NUMBA_THREADING_LAYER" not in os.environ:
    # Starting a parallel loop costs about 20 microseconds in this layer; OpenMP's barrier takes a millisecond
    # where virtual cores are shared.
    numba.config.THREADING_LAYER = "workqueue"
_CACHES_KEPT = 200
_CACHE_NAME = re.compile("[0-9a-f]{16}")  # of the folders that `cache_folder` makes: it deletes no other
ANY_ORDER = {"reassoc", "contract", "arcp", "nsz"}


def formula(function: Callable | None = None, *, inlined: bool = False) -> Any:
    """Mark a scalar formula: plain Python when called from Python, compiled where a kernel calls it.

    `inlined` puts its code into every caller, however long it is. A call passes each array as seven words and each
    group as all of its members, which costs more than a look-up in a table.
    """
    if function is None:
        return functools.partial(formula, inlined=inlined)
    options = {"forceinline": True} if inlined else {}
    return register_jitable(error_model="numpy", no_cfunc_wrapper=True, **options)(function)  # C never calls it


def cuda_formula(function: Callable) -> Any:
    """Mark a formula that names `cuda`, for CUDA kernels of any module.

    The simulator replaces `cuda` in the module of a kernel or of a device function, and in no other.
    """
    return _load_cuda().jit(device=True)(function) if simulated() else formula(function)


_IMPORT = re.compile(r"^(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([\w.]+))", re.MULTILINE)


def sources_behind(path: pathlib.Path) -> list[pathlib.Path]:
    """The file and every source of its own package that it imports, directly or through others."""
    package = path.parent
    while (package.parent / "__init__.py").exists():
        package = package.parent
    found, waiting = set(), [path]
    while waiting:
        file = waiting.pop()
        if file in found or not file.exists():
            continue
        found.add(file)
        for module, names, plain in _IMPORT.findall(file.read_text()):
            target = (module or plain).split(".")
            if target[0] != package.name:
                continue
            stem = package.parent.joinpath(*target)
            inside = [stem / f"{name}.py" for name in re.findall(r"\w+", names)]
            only_modules = bool(inside) and all(p.exists() for p in inside)
            waiting += inside if only_modules else [*inside, stem.with_suffix(".py"), stem / "__init__.py"]
    return sorted(found)


@functools.cache
def source_digest(path: pathlib.Path) -> str:
    """Digest of a kernel file and of everything of its package behind it (names and contents)."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]}".encode())
    for source in sources_behind(path):
        digest.update(source.as_posix().encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def cache_root() -> pathlib.Path:
    """Folder of all caches: $REFSIM_CACHE_DIR, else the user's cache folder."""
    chosen = os.environ.get("REFSIM_CACHE_DIR")
    if chosen:
        return pathlib.Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache"
    return pathlib.Path(base) / "refsim"


@functools.cache
def cache_folder(path: pathlib.Path) -> str:
    """Cache folder for the kernels of a source file; the folders longest unused are cleared away.

    Raises InputError if a folder that can be written to belongs to another user or is open to all.
    """
    root = cache_root()
    folder = root / source_digest(path)
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        os.utime(folder)
        named = (p for p in root.iterdir() if _CACHE_NAME.fullmatch(p.name) and p.is_dir())
        for stale in sorted(named, key=lambda p: p.stat().st_mtime)[:-_CACHES_KEPT]:
            shutil.rmtree(stale, ignore_errors=True)
    except OSError:  # a read-only home still works: Numba then compiles in every process
        pass
    if os.access(folder, os.W_OK):
        refuse_foreign(root)
        refuse_foreign(folder)
    return str(folder)


def _cached(dispatcher: Any, function: Callable, apart: bool = False) -> Any:
    if not hasattr(dispatcher, "enable_caching"):  # plain Python under NUMBA_DISABLE_JIT and in the simulator
        return dispatcher
    path = pathlib.Path(function.__code__.co_filename)
    folder = str(path.parent) if path.parent.parent == cache_root() else cache_folder(path)  # a wrapper, or a source
    if not os.access(folder, os.W_OK):
        return dispatcher
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, folder
    mask = os.umask(0o077)  # Numba makes a folder of its own inside
    try:
        dispatcher.enable_caching()
    finally:
        os.umask(mask)
        numba.config.CACHE_DIR = before
    refuse_foreign(pathlib.Path(dispatcher._cache.cache_path))
    check_files(dispatcher._cache)
    lock = pathlib.Path(folder, f"{function.__qualname__}.lock")
    dispatcher.store = _in_turn(dispatcher.compile, lock)  # for a process that fills the cache and runs nothing
    if apart and hasattr(os, "fork"):
        _compile_apart(dispatcher)
    dispatcher.compile = _in_turn(dispatcher.compile, lock)
    return dispatcher


def _in_turn(compile_here: Callable, lock: pathlib.Path) -> Callable:
    """Let one process after the other compile a kernel, or load it.

    Numba names what it saves by what stands in the cache already: two processes that save one kernel for two types at
    once take the same name, and one of them then loads what the other compiled.
    """

    def compile_in_turn(signature: Any) -> Any:
        with contextlib.ExitStack() as held:
            if fcntl is not None:
                with contextlib.suppress(OSError):  # where the cache vanished meanwhile, no other process uses it
                    fcntl.flock(held.enter_context(lock.open("w")), fcntl.LOCK_EX)
            return compile_here(signature)

    return compile_in_turn


def _compile_apart(dispatcher: Any) -> None:
    """Let a child process fill the cache, so that the code that runs always comes out of it.

    A process that compiles a parallel loop holds its body twice, optimised differently. It runs one of them; a
    process that loads the loop from the cache runs the other. If the order of a sum is free, the last bits differ,
    and a run resumed in another process would not be the same bit for bit.
    """
    compile_here = dispatcher.compile

    def compile_apart(signature: Any) -> Any:
        if not is_stored(dispatcher, signature):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of forking beside threads: the child uses none of them
                child = os.fork()
            if child == 0:
                warnings.simplefilter("ignore")  # the parent says what the cache refuses
                try:
                    gc.disable()  # arrays of a GPU can be freed by the parent only
                    compile_here(signature)
                finally:
                    os._exit(0)  # without the parent's clean-up; what went wrong is found again below
            os.waitpid(child, 0)
        return compile_here(signature)

    dispatcher.compile = compile_apart


def _compile_packed(dispatcher: Any) -> None:
    """Let the compiler pack the same operation on neighbouring numbers of straight code into one instruction.

    Numba leaves that out by default, because it pays only where code is written for it.
    """
    compile_here = dispatcher.compile

    def compile_packed(signature: Any) -> Any:
        before, numba.config.SLP_VECTORIZE = numba.config.SLP_VECTORIZE, 1
        try:
            return compile_here(signature)
        finally:
            numba.config.SLP_VECTORIZE = before

    dispatcher.compile = compile_packed


def cpu_kernel(function: Callable | None = None, *, ordered: bool = False, packed: bool = False) -> Any:
    """Compile a kernel for the CPU; its loop over particles is a `prange`.

    Sums may be taken in another order and products fused, so that loops over neighbours vectorise. The
    contract's bound holds for any order of summation; NaN and infinity keep their meaning. `ordered` keeps the order
    as written, for sums of small differences of large numbers, which another order would take apart. `packed` is for
    code that does the same with each of four numbers that stand side by side in memory (see `_compile_packed`).
    """
    if function is None:
        return functools.partial(cpu_kernel, ordered=ordered, packed=packed)
    flags = ANY_ORDER - {"reassoc"} if ordered else ANY_ORDER
    dispatcher = njit(parallel=True, error_model="numpy", fastmath=set(flags))(function)
    if packed and hasattr(dispatcher, "compile"):
        _compile_packed(dispatcher)
    return _cached(dispatcher, function, apart=True)


class CudaKernel:
    """A CUDA kernel that launches itself over the rows of one of its arguments: the last one, or `rows_of`.

    A thread takes a row (with `lanes` so many threads: a number, or as many as share a column of the list of that name,
    True for `neighbours`), or, with `block_for_each_row`, a block, of `threads` threads where the kernel counts on
    their number. `registers` is the largest number for each thread: with fewer registers more threads run at a time,
    and some values are kept in local memory.
    """

    def __init__(
        self,
        function: Callable,
        fastmath: bool,
        rows_of: str | None,
        lanes: bool | str | int = False,
        block_for_each_row: bool = False,
        threads: int | None = None,
        registers: int | None = None,
    ) -> None:
        names = list(inspect.signature(function).parameters)
        self.function, self.fastmath, self.block_for_each_row = function, fastmath, block_for_each_row
        if isinstance(lanes, bool):
            lanes = "neighbours" if lanes else 1
        self.lanes = 1 if isinstance(lanes, str) else lanes
        self.list_at = names.index(lanes) if isinstance(lanes, str) else None
        self.rows_at = names.index(rows_of) if rows_of else len(names) - 1
        self.threads = threads or (SIMULATED_THREADS if simulated() else THREADS_PER_BLOCK)
        self.__name__ = function.__name__
        self.__doc__ = function.__doc__
        self.__wrapped__ = function
        self.__signature__ = inspect.signature(function)
        options: dict[str, Any] = {"fastmath": fastmath}
        if not simulated():  # the simulator takes None as it is and has no such options
            options["extensions"] = [_AbsentArgument()]
            if registers is not None:
                options["max_registers"] = registers
        self.dispatcher = _cached(_load_cuda().jit(**options)(function), function)
        self.launches: dict[tuple, Launch] | None = None if simulated() else {}

    def __call__(self, *arguments: Any) -> None:
        rows = arguments[self.rows_at].shape[0] * self.lanes
        if self.list_at is not None:
            rows *= len(arguments[self.list_at].lanes)
        if rows:
            blocks = rows if self.block_for_each_row else (rows + self.threads - 1) // self.threads
            kinds = None if self.launches is None else kinds_of(arguments)
            if kinds is None:
                self.dispatcher[blocks, self.threads, stream()](*arguments)
            elif kinds in self.launches:
                self.launches[kinds](blocks, self.threads, arguments)
            else:
                self.dispatcher[blocks, self.threads, stream()](*arguments)  # compiles
                launch = direct_launch(self.dispatcher, arguments)
                if launch is None:
                    self.launches = None
                else:
                    self.launches[kinds] = launch


class _AbsentArgument:
    """Lets `None` stand for an absent optional argument of a CUDA kernel: it travels as a null pointer."""

    def prepare_args(self, ty: Any, value: Any, **_: Any) -> tuple[Any, Any]:
        from numba import types

        if isinstance(ty, types.NoneType):
            return types.CPointer(types.void), 0
        return ty, value


def cuda_kernel(
    function: Callable | None = None,
    *,
    fastmath: bool = False,
    rows_of: str | None = None,
    lanes: bool | str | int = False,
    block_for_each_row: bool = False,
    threads: int | None = None,
    registers: int | None = None,
) -> Any:
    """Compile a kernel for CUDA (or for the CUDA simulator, if NUMBA_ENABLE_CUDASIM is set).

    It is launched with a thread (or a block) for each row of its last argument, or of the argument called `rows_of`.
    """
    if function is None:
        return functools.partial(
            cuda_kernel, fastmath=fastmath, rows_of=rows_of, lanes=lanes, block_for_each_row=block_for_each_row,
            threads=threads, registers=registers,
        )  # fmt: skip
    return CudaKernel(function, fastmath, rows_of, lanes, block_for_each_row, threads, registers)


_LOOPS = {
    "cpu": """\
def {name}({arguments}):
    for i in prange({rows}.shape[0]):
        body(i, {arguments})
""",
    "cuda": """\
def {name}({arguments}):
    i = cuda.grid(1)
    if i < {rows}.shape[0]:
        body(i, {arguments})
""",
}
_LOOPS_WITH_LANES = {
    "cpu": """\
def {name}({arguments}):
    for i in prange({rows}.shape[0]):
        body(i, None, {arguments})
""",
    "cuda": """\
def {name}({arguments}):
    lanes = {lanes}
    i, lane = cuda.grid(1) // lanes, cuda.grid(1) % lanes
    if i < {rows}.shape[0]:
        body(i, (lane, lanes), {arguments})
""",
}


class Kernel:
    """What one row does, written once, and the kernels made of it: a `prange` loop and a CUDA kernel.

    The body takes the row's number `i`, with `lanes` also `lane`, and then the arguments, outputs last. Rows are those
    of the last argument, or of `rows_of`. With `lanes` (the name of a list, True for `neighbours`, or a number) so many
    neighbouring CUDA threads share a row: `lane` is (number of the thread, number of threads), and None on a CPU.
    `ordered` and `packed` are options of `cpu_kernel`, `registers` and `fastmath` of `cuda_kernel`.

    Called itself, it runs the program for the backend on which the array of rows lives.
    """

    def __init__(
        self,
        function: Callable,
        rows_of: str | None,
        lanes: bool | str | int,
        ordered: bool,
        packed: bool,
        fastmath: bool,
        registers: int | None,
    ) -> None:
        names = list(inspect.signature(function).parameters)
        self.body = formula(function, inlined=True)
        self.arguments = names[2 if lanes else 1 :]
        self.rows = rows_of or names[-1]
        self.lanes = "neighbours" if lanes is True else lanes
        self.options: dict[str, dict[str, Any]] = {
            "cpu": {"ordered": ordered, "packed": packed},
            "cuda": {"rows_of": self.rows, "lanes": lanes, "fastmath": fastmath, "registers": registers},
        }
        self.__name__, self.__doc__, self.__module__ = function.__name__, function.__doc__, function.__module__
        self.__wrapped__ = function
        self._made: dict[str, Any] = {}

    def source(self, backend: str) -> str:
        """The loop around the body on `backend`, "cpu" or "cuda", as Python."""
        loops = _LOOPS_WITH_LANES if self.lanes else _LOOPS
        lanes = f"len({self.lanes}.lanes)" if isinstance(self.lanes, str) else self.lanes
        return loops[backend].format(
            name=self.__name__, arguments=", ".join(self.arguments), rows=self.rows, lanes=lanes
        )

    def on(self, backend: str) -> Any:
        """The kernel for `backend`, "cpu" or "cuda"; made at first use."""
        if backend not in self._made:
            function = self._wrapper(backend)
            make = {"cpu": cpu_kernel, "cuda": cuda_kernel}[backend]
            self._made[backend] = make(function, **self.options[backend])
        return self._made[backend]

    def __call__(self, *arguments: Any) -> None:
        rows = arguments[self.arguments.index(self.rows)]
        self.on("cuda" if hasattr(rows, "copy_to_host") else "cpu")(*arguments)

    def _wrapper(self, backend: str) -> Callable:
        """The loop as a function whose source is a file of the cache folder, where Numba's cache looks for it."""
        text = self.source(backend)
        module = types.ModuleType(f"{self.__module__}.{self.__name__}_{backend}")
        path = pathlib.Path(cache_folder(pathlib.Path(self.body.__code__.co_filename)), f"{self.__name__}_{backend}.py")
        _write_once(path, text)
        linecache.cache[str(path)] = (len(text), None, text.splitlines(keepends=True), str(path))
        module.__dict__.update(body=self.body, prange=prange, __file__=str(path))
        if backend == "cuda":
            module.__dict__["cuda"] = _load_cuda()
        sys.modules[module.__name__] = module  # Numba's cache finds the globals of a kernel by its module's name
        exec(compile(text, str(path), "exec"), module.__dict__)
        function = module.__dict__[self.__name__]
        function.__doc__ = self.__doc__
        return function


def _write_once(path: pathlib.Path, text: str) -> None:
    """Write a file unless it is there already: Numba takes its age for its version."""
    if path.exists():
        return
    with contextlib.suppress(OSError):  # of a read-only folder: nothing is cached then
        handle, draft = tempfile.mkstemp(dir=path.parent)
        try:
            with os.fdopen(handle, "w") as file:
                file.write(text)
            with contextlib.suppress(FileExistsError):  # another process was faster
                os.link(draft, path)
        finally:
            os.unlink(draft)


def kernel(
    function: Callable | None = None,
    *,
    rows_of: str | None = None,
    lanes: bool | str | int = False,
    ordered: bool = False,
    packed: bool = False,
    fastmath: bool = False,
    registers: int | None = None,
) -> Any:
    """Mark what one row does; its kernels for the CPU and for CUDA are made of it, see `Kernel`."""
    if function is None:
        return functools.partial(
            kernel, rows_of=rows_of, lanes=lanes, ordered=ordered, packed=packed, fastmath=fastmath,
            registers=registers,
        )  # fmt: skip
    return Kernel(function, rows_of, lanes, ordered, packed, fastmath, registers)


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
