"""How a kernel's loops become vectors: settings of the compiler while it compiles."""

from typing import Any

import numba
from llvmlite import binding

from refsim.backends.fast.bodies import bodies_alone
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
