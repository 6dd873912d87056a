"""`refsim list`: every operation with its paper and programs, every effect with its parameters."""

import argparse
import inspect
from typing import Any

import msgspec

from refsim.commands import CommandResult, columns, command, fitted, table, takes
from refsim.core.capabilities import HasErrata
from refsim.core.checked import suggestion
from refsim.core.effect import EFFECTS, Effect
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY
from refsim.scene.files import as_toml, describe

WIDTH = 100  # of a line at most, in a pipe, too


def _parameters(effect: type[Effect]) -> list[dict[str, Any]]:
    meanings, listed = describe(effect), []
    for f in msgspec.structs.fields(effect):
        made = f.default if f.default_factory is msgspec.NODEFAULT else f.default_factory()
        default = None if f.required else made
        meaning = meanings.get(f.name, "")
        listed.append({"name": f.name, "default": default, "required": f.required, "meaning": meaning})
    return listed


@command("list", "list operations and effects")
@takes("words", nargs="*", metavar="WORD", help="what to show: part of a name, a paper or an equation")
@takes("--all", action="store_true", help="show every operation and effect in full")
def execute(options: argparse.Namespace) -> CommandResult:
    """List the registry and the effects: by method, or in full those that the words name."""
    operations: dict[str, dict[str, Any]] = {
        o.name: {"paper": o.paper, "equation": o.equation, "programs": o.names()}
        | {"roundings": o.tolerance, "counts": o.reason}
        for o in REGISTRY.values()
    }
    effects: dict[str, dict[str, Any]] = {
        name: {
            "summary": (inspect.getdoc(effect) or "").split("\n")[0],
            "parameters": _parameters(effect),
            "paper": {"source": effect.source, "errata": list(effect.improvements), "parameters": dict(effect.paper)}
            if issubclass(effect, HasErrata)
            else None,  # what literal = "paper" takes
        }
        for name, effect in sorted(EFFECTS.items())
    }
    texts = {name: "\n".join((name, o["paper"], o["equation"])).lower() for name, o in operations.items()}
    texts |= {name: name.lower() for name in effects}
    for word in options.words:
        if not any(word.lower() in text for text in texts.values()):
            near = suggestion(word, [*EFFECTS, *dict.fromkeys(name.partition(".")[0] for name in REGISTRY), *REGISTRY])
            hint = near if near.startswith("did you mean") else "`refsim list` shows what there is."
            raise InputError(f"no operation or effect has {word!r} in its name, paper or equation; {hint}")
    if options.words:
        named = {name for name, text in texts.items() if any(word.lower() in text for word in options.words)}
        operations, effects = (
            {name: about for name, about in known.items() if name in named} for known in (operations, effects)
        )
    data = {"operations": operations, "effects": effects}
    width = min(columns(), WIDTH)
    full = "\n".join([*map(_operation, operations.items()), *map(_effect, effects.items())])
    text = full if options.words or options.all else _overview(operations, effects, width)
    return CommandResult(data, fitted(text, width))


def _overview(operations: dict[str, dict[str, Any]], effects: dict[str, dict[str, Any]], width: float) -> str:
    """Methods with the number of their operations, and effects."""
    methods: dict[str, list[str]] = {}
    for name, operation in operations.items():
        methods.setdefault(name.partition(".")[0], []).append(operation["paper"])
    plain = [method for method, papers in methods.items() if set(papers) == {"standard"}]
    rows = [(method, len(papers), "; ".join(_sources(papers))) for method, papers in sorted(methods.items())
            if method not in plain]  # fmt: skip
    also = f"; {' and '.join(plain)} have no paper" if plain else ""
    lines = [
        f"{len(operations)} operations; refsim list METHOD shows those of a method{also}",
        table(rows, right=(1,), width=width),
        f"{len(effects)} effects, tables [effects.NAME] of a scene file; refsim list NAME shows the parameters",
        table([(name, effect["summary"]) for name, effect in effects.items()], width=width),
    ]
    return "\n".join(lines)


def _sources(papers: list[str]) -> list[str]:
    """Each source once, without what is said of its use in an operation."""
    parts = dict.fromkeys(part for paper in papers for part in paper.split("; "))
    return [part for part in parts if not any(part.startswith(f"{other}, ") for other in parts)]


def _operation(entry: tuple[str, dict[str, Any]]) -> str:
    name, operation = entry
    return (
        f"{name}\n  {operation['paper']}: {operation['equation']}\n  programs: {' '.join(operation['programs'])}"
        f"\n  bound: c = {operation['roundings']:g}: {operation['counts']}"
    )


def _effect(entry: tuple[str, dict[str, Any]]) -> str:
    name, effect = entry
    lines = ["", f"[effects.{name}] {effect['summary']}"]
    for p in effect["parameters"]:
        value = "required" if p["required"] else "= None" if p["default"] is None else f"= {as_toml(p['default'])}"
        lines.append(f"  {p['name']} {value}  {p['meaning']}")
    if paper := effect["paper"]:
        taken = [*paper["errata"], *(f"{key} = {as_toml(value)}" for key, value in paper["parameters"].items())]
        listed = ", ".join(taken) or "nothing, no choice differs"
        lines.append(f'  literal = "paper" takes of {paper["source"]}: {listed}')
    return "\n".join(lines)
