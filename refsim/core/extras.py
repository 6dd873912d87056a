"""Packages that only some uses need: they are imported where they are used, and a missing one is named."""

import importlib
from typing import Any

from refsim.core.errors import InputError

EXTRAS = {  # module: (package that brings it, the extra of refsim that has it)
    "distributed": ("distributed", "cluster"),
    "pandas": ("pandas", "results"),
    "pyvista": ("pyvista", "view"),
}


def extra(module: str, use: str) -> Any:
    """The module, imported; InputError, whose subject is `use`, says how to install one that is missing."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        package, name = EXTRAS[module]
        raise InputError(
            f"{use} needs the package {package}, which is not installed; run pip install {package} (it is one of"
            f" refsim's extra {name!r})."
        ) from None
