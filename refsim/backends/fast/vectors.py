"""Settings of the compiler while it compiles: how loops become vectors, and what a kernel takes from its bodies."""

import contextlib
import functools
from collections.abc import Iterator
from typing import Any

import numba
from llvmlite import binding

from refsim.backends.fast.private import names

_compiling = 0  # compilations in progress: a kernel compiles the functions that it calls


def set_vectors(dispatcher: Any, packed: bool) -> None:
    """Let the compiler sum every loop in one chain of vectors, and with `packed` pack neighbouring operations.

    With AVX-512 the compiler vectorises loops over neighbours, and sums in two or four chains where registers are left:
    another output of a kernel then changed the last bits of the first. One chain takes the same time. Packing is for
    code that does the same with numbers that stand side by side; Numba leaves it out by default.
    """
    compile_plainly = dispatcher.compile
    private: Any = names("fast")

    @private.global_compiler_lock
    def compile_so(signature: Any) -> Any:
        global _compiling
        before = numba.config.SLP_VECTORIZE
        _compiling += 1
        try:
            if packed:
                numba.config.SLP_VECTORIZE = 1
            binding.set_option("refsim", "-force-vector-interleave=1")
            numba.get_num_threads()  # loads what `over_rows` calls
            with bodies_alone():
                return compile_plainly(signature)
        finally:
            numba.config.SLP_VECTORIZE = before
            _compiling -= 1
            if not _compiling:
                binding.set_option("refsim", "-force-vector-interleave=0")  # the compiler's own choice

    dispatcher.compile = compile_so


@contextlib.contextmanager
def bodies_alone() -> Iterator[None]:
    """Within it Numba makes machine code of what Python or C calls, and of nothing that compiled code alone calls."""
    private: Any = names("bodies")
    if private is None:
        yield
        return
    executable = private.CPUContext.get_executable

    def get_executable(self: Any, code: Any, described: Any, environment: Any) -> Any:
        wrappers = described.llvm_cpython_wrapper_name, described.llvm_cfunc_wrapper_name
        if code._finalized or any(function.name in wrappers for function in code._final_module.functions):
            return executable(self, code, described, environment)
        code._finalize_final_module = functools.partial(setattr, code, "_finalized", True)
        code.finalize()
        return private.make_function(described.lookup_module(), described.qualname, "", 0, environment, (code,))

    private.CPUContext.get_executable = get_executable
    try:
        yield
    finally:
        private.CPUContext.get_executable = executable
