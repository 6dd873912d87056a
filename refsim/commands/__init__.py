"""One file, one command: the function in a module of this folder that `command` marks is a subcommand of `refsim`."""

import argparse
import importlib
import os
import pkgutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from refsim.core.errors import InputError, RunStopped
from refsim.core.tables import columns, fitted, in_bytes, in_time, table
from refsim.core.writing import plain, replace_file, writing
from refsim.scene.plan import Plan, make_plan
from refsim.scene.scene import Scene
from refsim.study.cost import check_boxes, check_memory

__all__ = ["columns", "fitted", "in_bytes", "in_time", "plain", "table"]


@dataclass(frozen=True)
class CommandResult:
    """Result of a command: data for --json, text for the terminal, exit code (0, or 4 if a verdict failed)."""

    data: Any = field(default_factory=dict)
    text: str = ""
    code: int = 0
    verbatim: bool = False  # the text is a document or a program: on a terminal, too, its lines are left as they are


Execute = Callable[[argparse.Namespace], CommandResult]


@dataclass(frozen=True)
class Command:
    """A subcommand: the function that executes it, which `takes` its arguments."""

    name: str
    summary: str
    execute: Execute
    description: str = ""

    def configure(self, parser: argparse.ArgumentParser) -> None:
        """Enter its arguments."""
        groups: dict[str, Any] = {"": parser}
        for names, group, settings in ARGUMENTS.get(self.execute, ()):
            if group not in groups:
                groups[group] = parser.add_mutually_exclusive_group()
            groups[group].add_argument(*names, **settings)


COMMANDS: dict[str, Command] = {}
ARGUMENTS: dict[Execute, list[tuple[tuple[str, ...], str, dict[str, Any]]]] = {}


def command(name: str, summary: str, description: str = "") -> Callable[[Execute], Execute]:
    """Enter the function that a command executes; a name is entered once."""

    def enter(execute: Execute) -> Execute:
        if name in COMMANDS:
            raise ValueError(f"command {name!r} is registered twice")
        COMMANDS[name] = Command(name, summary, execute, description)
        return execute

    return enter


def takes(*names: str, group: str = "", **settings: Any) -> Callable[[Execute], Execute]:
    """An argument of the command that a function executes, as `argparse` has it, in the order of the decorators.

    group  of arguments that exclude each other
    """

    def enter(execute: Execute) -> Execute:
        ARGUMENTS.setdefault(execute, []).insert(0, (names, group, settings))
        return execute

    return enter


def discover() -> None:
    """Import every module of this folder; each registers its command."""
    for module in pkgutil.iter_modules(__path__):
        importlib.import_module(f"{__name__}.{module.name}")


def planned(scene: Scene, source: str, backend: str = "cpu") -> Plan:
    """The plan of a scene whose run the machine can hold; an error names the file it comes from."""
    try:
        check_boxes(scene, backend)
        plan = make_plan(scene)
        check_memory(plan, backend)
        return plan
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def write_new(files: Mapping[Path, bytes], option: str, overwrite: bool, what: str, kept: str) -> list[str]:
    """Write files; their paths. Raises InputError where another one is there and may not be replaced.

    option  with which another place is given; what, kept  as `writing` takes them
    """
    for path, content in () if overwrite else files.items():
        if os.path.lexists(path) and not (path.is_file() and path.read_bytes() == content):
            raise InputError(f"{path} is there already; give another {option} or --overwrite.")
    for path, content in files.items():
        with writing(what, path, kept):
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, content)
    return list(map(str, files))


def results_folder(given: str | None, source: str, kind: str) -> Path:
    """The folder of results, NAME_kind for a source NAME.toml unless another is given."""
    folder = Path(given or f"{Path(source).stem}_{kind}")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; give a folder for the output.")
    return folder


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
