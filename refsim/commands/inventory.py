"""`refsim list`: every operation with its paper and programs, every effect with its parameters."""

from __future__ import annotations

import argparse
import ast
import functools
import importlib.util
import inspect
from pathlib import Path
from typing import Any

import msgspec

from refsim.commands import Command, CommandResult, register, table
from refsim.core.effect import EFFECTS, Effect
from refsim.core.operation import REGISTRY, Operation
from refsim.scene.files import describe


@functools.cache
def _functions(module: str) -> frozenset[str]:
    """Names that a module defines, read from its source: nothing is imported but its package."""
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        return frozenset()
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    names = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
    for node in tree.body:
        if isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        if isinstance(node, ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
    return frozenset(names)


def programs_of(operation: Operation) -> list[str]:
    """Names of the programs that the operation has: backends, and backend:algorithm where there are more."""
    entries = {name: operation.entry(name) for name in operation.names()}
    return [
        name
        for name, entry in entries.items()
        if (entry.function or operation.function) in _functions(f"{entry.folder or operation.folder}.{entry.module}")
    ]


def _parameters(effect: type[Effect]) -> list[dict[str, Any]]:
    meanings = describe(effect)
    found = []
    for f in msgspec.structs.fields(effect):
        default = None if f.default is msgspec.NODEFAULT else f.default
        if f.default_factory is not msgspec.NODEFAULT:
            default = f.default_factory()
        found.append(
            {"name": f.name, "default": default, "required": f.required, "meaning": meanings.get(f.name, "")},
        )
    return found


def configure(parser: argparse.ArgumentParser) -> None:
    """No arguments of its own."""


def execute(options: argparse.Namespace) -> CommandResult:
    """List the registry and the effects."""
    operations = {
        o.name: {"paper": o.paper, "equation": o.equation, "programs": programs_of(o)} for o in REGISTRY.values()
    }
    effects = {
        name: {"summary": (inspect.getdoc(effect) or "").split("\n")[0], "parameters": _parameters(effect)}
        for name, effect in sorted(EFFECTS.items())
    }
    lines = [f"{len(operations)} operations", ""]
    lines.append(
        table(
            [(n, o["paper"], o["equation"], " ".join(o["programs"])) for n, o in operations.items()],
            ("operation", "paper", "equation", "programs"),
        )
    )
    lines += ["", f"{len(effects)} effects, as tables [effects.NAME] of a scene file"]
    for name, effect in effects.items():
        lines += ["", f"{name}: {effect['summary']}"]
        rows = [
            ("", p["name"], "required" if p["required"] else f"= {_shown(p['default'])}", p["meaning"])
            for p in effect["parameters"]
        ]
        lines.append(table(rows))
    return CommandResult({"operations": operations, "effects": effects}, "\n".join(lines))


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_shown, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)


register(Command("list", "list operations and effects", configure, execute))
