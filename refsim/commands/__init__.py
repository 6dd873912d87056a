"""One file, one command: a module in this folder that calls `register` at import is a subcommand of `refsim`."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from refsim.core.errors import InputError, RunStopped
from refsim.core.plain import plain as plain
from refsim.core.tables import in_bytes as in_bytes
from refsim.core.tables import in_time as in_time
from refsim.core.tables import table as table
from refsim.scene.plan import Plan, make_plan
from refsim.scene.scene import Scene


@dataclass(frozen=True)
class CommandResult:
    """Result of a command: data for --json, text for the terminal, exit code (0, or 4 if a verdict failed)."""

    data: Any = field(default_factory=dict)
    text: str = ""
    code: int = 0


@dataclass(frozen=True)
class Command:
    """A subcommand: how it reads its arguments and what it does with them."""

    name: str
    summary: str
    configure: Callable[[argparse.ArgumentParser], None]
    execute: Callable[[argparse.Namespace], CommandResult]
    description: str = ""


COMMANDS: dict[str, Command] = {}


def register(command: Command) -> Command:
    """Enter a command; a name is entered once."""
    if command.name in COMMANDS:
        raise ValueError(f"command {command.name!r} is registered twice")
    COMMANDS[command.name] = command
    return command


def discover() -> None:
    """Import every module of this folder; each registers its command."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")


def planned(scene: Scene, source: str) -> Plan:
    """The plan of a scene; an error names the file it comes from."""
    try:
        return make_plan(scene)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


@contextmanager
def kept_in(folder: Path) -> Iterator[None]:
    """Runs whose results are kept in a folder one by one; an interrupt and a scheduler that goes away say so."""
    try:
        yield
    except KeyboardInterrupt:
        raise RunStopped(
            "interrupted",
            f"Interrupted; the results of the finished runs are kept in {folder}, and the same command goes on from"
            " there.",
        ) from None
    except RunStopped as stopped:
        if stopped.reason != "scheduler_lost":
            raise
        raise RunStopped(stopped.reason, f"{str(stopped).rstrip('.')}, which are kept in {folder}.") from stopped
