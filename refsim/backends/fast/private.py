"""Private names of Numba and numba-cuda. They stand in this module alone; each is looked up once.

A feature that needs such names takes them from `names`. Where one of them is gone it does without: kernels then run as
plain loops, are not kept, or are launched publicly. `lost` says what that costs, and `refsim doctor` prints it.
"""

import functools
import importlib
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any


@dataclass(frozen=True)
class Feature:
    """What private names serve for.

    names  "module:name", under whose last part `names` gives them; "module:name.member" is only looked up
    costs  what is lost without one of them, in a clause
    """

    names: tuple[str, ...]
    costs: str


def _of(module: str, names: str) -> list[str]:
    return [module + name for name in names.split()]


FEATURES = {
    "fast": Feature(
        ("numba.core:cgutils", "numba.core.compiler_lock:global_compiler_lock", *_of(
            "numba.core.cgutils:", "voidptr_t intp_t get_or_insert_function pack_struct alloca_once_value for_range"
            " unpack_tuple get_null_value")),
        "kernels run as plain loops, which take longer to compile and to run (see docs/guarantees.md)",
    ),
    "bodies": Feature(
        ("numba._dynfunc:make_function", *_of("numba.core.cpu:", "CPUContext CPUContext.get_executable"),
         "numba.core.codegen:CPUCodeLibrary", *_of(
             "numba.core.codegen:CPUCodeLibrary.",
             "add_ir_module add_linking_library finalize _finalize_final_module"),
         "llvmlite.binding.ffi:lib", "llvmlite.binding.ffi:lib._lock._cblist"),
        "kernels take a quarter longer to compile",
    ),
    "cache": Feature(
        ("numba.core.caching:Cache._index_key", "numba.core.caching:IndexDataCacheFile._dump"),
        "compiled kernels are not kept, and every process compiles them anew",
    ),
    "launch": Feature(
        ("numba.cuda.cudadrv.driver:_to_core_stream", *_of("numba.cuda.typing.typeof:", "Purpose typeof")),
        "CUDA kernels are launched through Numba's public call, about 0.1 ms slower each",
    ),
}  # fmt: skip
_lost: dict[str, str] = {}


@functools.cache
def names(feature: str) -> SimpleNamespace | None:
    """The names of a feature; None, noted in `lost`, where Numba lacks one of them."""
    looked_up = SimpleNamespace()
    for name in FEATURES[feature].names:
        module, _, path = name.partition(":")
        try:
            value: Any = importlib.import_module(module)
            for part in path.split("."):
                value = getattr(value, part)
        except (ImportError, AttributeError):
            disable_private(feature, name)
            return None
        if "." not in path:
            setattr(looked_up, path, value)
    return looked_up


def disable_private(feature: str, name: str) -> None:
    """Note that a feature is done without, because of a name that is gone."""
    _lost.setdefault(feature, f"This version of Numba lacks {name}: {FEATURES[feature].costs}.")


def lost() -> dict[str, str]:
    """What this process does without, a sentence for each feature."""
    return dict(_lost)
