"""Functions that only kernels call, without machine code of their own: each kernel holds their bodies."""

import contextlib
import functools
from collections.abc import Iterator
from typing import Any

from refsim.backends.fast.private import names


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
