"""Effects and operations of other packages, which the entry points `refsim.effects` and `refsim.operations` name."""

import importlib.metadata
import warnings

GROUPS = ("refsim.effects", "refsim.operations")


def open_doors() -> None:
    """Import what the entry points of installed packages name, which registers it; warn of what cannot be imported."""
    there = importlib.metadata.entry_points()  # which reads the metadata of every package
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
