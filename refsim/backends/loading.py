"""Compiled kernels from the cache in a process that compiles none."""

import functools
from typing import Any

from refsim.backends.private import names


@functools.cache
def load_without_rules() -> None:
    """Let Numba load kernels for the CPU without its rules for types and functions, from now on in this process.

    Numba imports the rules, and SciPy for them, before it loads the first kernel: 0.3 s. What it loads needs its memory
    system alone, and the compiler imports the rules itself.
    """
    numba = names("start")
    if numba is None:
        return
    with_rules = numba.Cache.load_overload

    def load(cache: Any, signature: Any, context: Any) -> Any:
        if not isinstance(context, numba.CPUContext):
            return with_rules(cache, signature, context)
        numba.rtsys.initialize(context)
        with cache._guard_against_spurious_io_errors():
            return cache._load_overload(signature, context)
        return None

    numba.Cache.load_overload = load
