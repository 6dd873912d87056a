"""Settings of the compiler while it compiles: how loops become vectors, and what a kernel takes from its bodies."""

import contextlib
import functools
import weakref
from collections.abc import Iterator
from typing import Any

import numba
from llvmlite import binding

from refsim.backends.fast.private import names

_compiling = 0  # compilations in progress: a kernel compiles the functions that it calls
_called: Any = weakref.WeakKeyDictionary()  # what the code of each function calls
_alone = _whole = False


def set_vectors(dispatcher: Any, packed: bool, ordered: bool) -> None:
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
            with bodies_alone(whole=not ordered):
                return compile_plainly(signature)
        finally:
            numba.config.SLP_VECTORIZE = before
            _compiling -= 1
            if not _compiling:
                binding.set_option("refsim", "-force-vector-interleave=0")  # the compiler's own choice

    dispatcher.compile = compile_so


@contextlib.contextmanager
def bodies_alone(whole: bool) -> Iterator[None]:
    """Within it Numba makes machine code of what Python or C calls, and of nothing that compiled code alone calls.

    whole  a kernel is optimised once, with all that it calls; else its bodies are before, as packing wants them. Bodies
           with other flags are others, so that none depends on what was compiled before

    Numba's event for each call of LLVM, ten thousand of them, is off within it.
    """
    global _alone, _whole
    private: Any = names("bodies")
    if private is None:
        yield
        return
    _take_bodies()
    heard, before = private.lib._lock._cblist, (_alone, _whole)
    listeners, (_alone, _whole) = heard[:], (True, whole)
    heard.clear()
    try:
        yield
    finally:
        heard[:], (_alone, _whole) = listeners, before


@functools.cache
def _take_bodies() -> None:
    """Have Numba's code hold all that it calls, directly or not, and bodies be nothing but what is held."""
    private: Any = names("bodies")
    code_of, context = private.CPUCodeLibrary, private.CPUContext
    link, finalize, executable = code_of.add_linking_library, code_of.finalize, context.get_executable
    add = code_of.add_ir_module

    def add_linking_library(self: Any, called: Any) -> None:
        _called.setdefault(self, {})[called] = None

    def add_ir_module(self: Any, module: Any) -> None:
        for function in module.functions if _alone and module.name == "wrapper" else ():
            if not function.is_declaration:  # it only unpacks what Python gives, and is compiled in half the time
                function.attributes.add("optnone")
                function.attributes.add("noinline")
        add(self, module)

    def finalize_whole(self: Any) -> None:
        for called in _callers_first(self):
            called._finalized |= _alone and _whole
            link(self, called)
        finalize(self)

    def get_executable(self: Any, code: Any, described: Any, environment: Any) -> Any:
        wrappers = described.llvm_cpython_wrapper_name, described.llvm_cfunc_wrapper_name
        own = not _alone or code._finalized  # code that was loaded is
        if own or any(function.name in wrappers for function in code._final_module.functions):
            return executable(self, code, described, environment)
        code._finalized = _whole
        if not _whole:
            code._finalize_final_module = functools.partial(setattr, code, "_finalized", True)
            code.finalize()
        return private.make_function(described.lookup_module(), described.qualname, "", 0, environment, (code,))

    code_of.add_linking_library, code_of.finalize = add_linking_library, finalize_whole
    code_of.add_ir_module, context.get_executable = add_ir_module, get_executable


def _callers_first(code: Any) -> list[Any]:
    """All that some code calls, directly or not: LLVM takes a function in only behind a call of it."""
    met: dict[Any, None] = {}

    def meet(one: Any) -> None:
        for called in _called.get(one, ()):
            if called not in met:
                meet(called)
        met[one] = None

    meet(code)
    return [*met][-2::-1]
