"""Effects and operations of other packages, which the entry points `refsim.effects` and `refsim.operations` name."""

import os
import sys
import warnings
from contextlib import suppress
from importlib.machinery import PathFinder

GROUPS = ("refsim.effects", "refsim.operations")
METADATA = (".dist-info", ".egg-info")  # folders that say what a package next to them has


def open_doors() -> None:
    """Import what the entry points of installed packages name, which registers it; warn of what cannot be imported."""
    if not _named():
        return
    import importlib.metadata  # here, because it and what it reads take a fifth of the time that importing refsim does

    there = importlib.metadata.entry_points()
    for group in GROUPS:
        for entry in there.select(group=group):
            try:
                entry.load()
            except Exception as error:  # a package of others may raise whatever it likes
                warnings.warn(
                    f"the entry point {entry.name} of {group} cannot be imported ({entry.value}):"
                    f" {type(error).__name__}: {error}",
                    stacklevel=2,
                )


def _named() -> bool:
    """Whether an installed package may name a group; also where its metadata stands in an archive or elsewhere."""
    if any(hasattr(finder, "find_distributions") for finder in sys.meta_path if finder is not PathFinder):
        return True
    for folder in sys.path:
        try:
            names = os.listdir(folder or ".")
        except FileNotFoundError:
            continue
        except OSError:  # an archive
            return True
        if folder.lower().endswith(".egg"):
            return True
        for name in names:
            if name.lower().endswith(METADATA):
                with suppress(OSError), open(os.path.join(folder, name, "entry_points.txt"), "rb") as file:
                    text = file.read()
                    if any(f"[{group}]".encode() in text for group in GROUPS):
                        return True
    return False
