"""The plain road on a CPU: kernels as `refsim show` prints them, compiled by Numba's public decorators alone.

REFSIM_PLAIN=1 chooses it. It is also taken where this Numba lacks a private name that the fast road needs.
"""

import functools
import hashlib
import inspect
import os
import pathlib
import sys
import types
import warnings
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Any

import numba

from refsim.backends.cache import cache_folder, cached
from refsim.backends.fast.private import lost, names
from refsim.backends.written import function_of, is_fixed, kind_of, written
from refsim.core.writing import write_once


@functools.cache
def chosen() -> bool:
    """Whether this process takes the plain road; a warning says where a private name is the reason."""
    if os.environ.get("REFSIM_PLAIN", "0") not in ("", "0"):
        return True
    if names("fast") is None:
        warnings.warn(lost()["fast"], stacklevel=2)
        return True
    return False


def function_of_text(
    text: str, name: str, source: pathlib.Path, module: str, space: Mapping[str, Any] = MappingProxyType({})
) -> Any:
    """The function of this name of a text, which becomes a file of the cache folder, where Numba's cache looks.

    source  of the kernel; `space` is what the text names beside what it imports
    """
    path = pathlib.Path(cache_folder(source), f"{name}_{hashlib.sha256(text.encode()).hexdigest()[:8]}.py")
    with suppress(OSError):  # a folder that cannot be written
        write_once(path, text.encode())
    place = types.ModuleType(f"{module}.{path.stem}")
    place.__dict__.update(space, __file__=str(path))
    sys.modules[place.__name__] = place  # Numba's cache finds the globals of a kernel by its module's name
    return function_of(text, name, str(path), place.__dict__)


class PlainKernel:
    """A kernel's plain loop, written and compiled for each sort of arguments: `refsim.backends.written`.

    Where one thread works, it is compiled without `parallel=True`: Numba would wake that thread for each loop.

    wrapper  the loop over rows; `module` is that of the kernel
    """

    def __init__(self, wrapper: Callable, module: str, fast: Iterable[str]) -> None:
        self.wrapper, self.module, self.fast = wrapper, module, tuple(fast)
        self.__name__, self.__doc__, self.__wrapped__ = wrapper.__name__, wrapper.__doc__, wrapper
        self.__signature__ = inspect.signature(wrapper)
        self.programs: dict[Any, Any] = {}

    def __call__(self, *values: Any) -> None:
        program, given = self.program(values)
        program(*given)

    def program(self, values: tuple) -> tuple[Any, tuple]:
        """The compiled loop for these values, and those that it takes."""
        alone = numba.get_num_threads() == 1
        key = (alone, *map(_key, values))
        if key not in self.programs:
            kinds = tuple(map(kind_of, values))
            self.programs[key] = self.of(kinds, alone), [k for k, kind in enumerate(kinds) if not is_fixed(kind)]
        program, taken = self.programs[key]
        given = (values[k] for k in taken)  # Numba's parallel loops take no tuples of tuples
        return program, tuple([value.numbered() if hasattr(value, "numbered") else value for value in given])

    def of(self, kinds: tuple, alone: bool) -> Any:
        """The compiled loop for arguments of these kinds, for one thread (`alone`) or several."""
        text = written(self.wrapper, dict(zip(self.__signature__.parameters, kinds)), "cpu", self.fast)
        text = text.replace("parallel=True, ", "") if alone else text
        file = getattr(sys.modules[self.module], "__file__", None) or self.wrapper.__code__.co_filename
        loop = function_of_text(text, self.wrapper.__name__, pathlib.Path(file), self.module)
        return cached(loop, loop.py_func) if hasattr(loop, "py_func") else loop


def _key(value: Any) -> Any:
    """What tells sorts of arguments apart."""
    if isinstance(value, tuple):
        return (type(value), *map(_key, value))
    return None if value is None else getattr(value, "ndim", 0)
