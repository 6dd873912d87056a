"""One file, one command: a module in this folder that calls `register` at import is a subcommand of `refsim`."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from refsim.core.errors import InputError
from refsim.core.plain import plain as plain
from refsim.scene.scene import Plan, Scene, make_plan


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


def table(rows: Iterable[Sequence[Any]], head: Sequence[str] = (), right: Sequence[int] = ()) -> str:
    """Rows in aligned columns; the columns named in `right` are flush right."""
    lines = [tuple(str(cell) for cell in row) for row in ([head] if head else []) + list(rows)]
    if not lines:
        return ""
    widths = [max(len(line[c]) for line in lines) for c in range(len(lines[0]))]
    text = [
        "  ".join(cell.rjust(w) if c in right else cell.ljust(w) for c, (cell, w) in enumerate(zip(line, widths)))
        for line in lines
    ]
    if head:
        text.insert(1, "  ".join("-" * w for w in widths))
    return "\n".join(line.rstrip() for line in text)


def in_bytes(count: float) -> str:
    """A number of bytes as text with its unit."""
    for unit in ("B", "KiB", "MiB", "GiB"):
        if count < 1024 or unit == "GiB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1024
    raise AssertionError


def in_time(seconds: float) -> str:
    """A time span as text with its unit."""
    if seconds < 100:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"
