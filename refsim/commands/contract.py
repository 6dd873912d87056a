"""`refsim contract`: programs of your own against the reference, operation by operation."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from refsim.commands import Command, CommandResult, in_time, register, table
from refsim.core.errors import InputError
from refsim.core.operation import BACKENDS, REGISTRY

TOLD = 8  # failed trials that the text names for each operation; --json has all
SHOWN_IN = "cloud_3d"  # the case whose arguments are shown


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `refsim contract`."""
    parser.add_argument(
        "programs",
        help="folder/file.py, package.module or the name of an entry point of refsim.contract, with :NAME for"
        f" another mapping than PROGRAMS; or refsim's own: {', '.join(BACKENDS)}",
    )
    words = "operations to judge; all that the backend has by default"
    parser.add_argument("operation", nargs="*", default=[], help=words)
    parser.add_argument("--dtype", action="append", default=[], help="float32 or float64; both by default")
    parser.add_argument("--variant", action="append", default=[], type=int, help="number of a variant; all by default")
    parser.add_argument("--step", action="append", default=[], help="T1 to T7, T9 or T10; all by default")
    words = "seconds for the import of the programs and for each call of one (120)"
    parser.add_argument("--time-limit", type=float, default=120.0, metavar="S", help=words)
    parser.add_argument("--arguments", action="store_true", help="judge nothing; say what the operations take")


def execute(options: argparse.Namespace) -> CommandResult:
    """Judge the programs and report."""
    from refsim.contract import apart
    from refsim.contract.programs import check_names

    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())  # modules are named relative to the current folder
    if not 0 < options.time_limit < math.inf:
        raise InputError(f"--time-limit = {options.time_limit:g} is not possible; give a positive number of seconds.")
    if options.arguments and options.programs in REGISTRY:
        return _arguments([options.programs, *options.operation], "cpu")
    check_names(options.operation, options.dtype, options.variant, options.step)
    selected = (options.operation, options.dtype, options.variant, options.step)
    request = apart.Request(options.programs, *map(tuple, selected), options.time_limit)
    if options.arguments:
        about = apart.describe(request)
        return _arguments(about.names, about.arrays)
    began = time.perf_counter()
    about, outcomes = apart.judge(request)
    found: dict[str, list[Any]] = {name: [] for name in about.names}
    for outcome in outcomes:
        if not found[outcome.operation] and sys.stderr.isatty():
            print(f"{outcome.operation} ...", file=sys.stderr)
        found[outcome.operation].append(outcome)
    data = _report(about, found, time.perf_counter() - began)
    return CommandResult(data, _text(data, found), 0 if data["holds"] else 4)


def _report(about: Any, found: Mapping[str, Sequence[Any]], seconds: float) -> dict[str, Any]:
    operations = {name: _judged(outcomes) for name, outcomes in found.items()}
    return {
        "programs": about.name,
        "arrays": about.arrays,
        "holds": all(operation["holds"] for operation in operations.values()),
        "seconds": round(seconds, 1),
        "operations": operations,
        "not_offered": [] if about.offered is None else [n for n in REGISTRY if n not in about.offered],
    }


def _judged(outcomes: Sequence[Any]) -> dict[str, Any]:
    """An operation holds where there were trials and all of them passed."""
    failed = [o for o in outcomes if not o.passed]
    steps: dict[str, dict[str, int]] = {}
    for o in outcomes:
        counts = steps.setdefault(o.step, {"trials": 0, "failed": 0})
        counts["trials"] += 1
        counts["failed"] += not o.passed
    return {
        "holds": bool(outcomes) and not failed,
        "trials": len(outcomes),
        "failed": len(failed),
        "largest_error": max((o.error for o in outcomes), default=0.0),
        "steps": steps,
        "outcomes": [
            {
                "step": o.step,
                "trial": o.trial,
                "dtype": o.dtype,
                "variant": o.variant,
                "passed": o.passed,
                "error": o.error,
                "words": o.words,
            }
            for o in outcomes
        ],
    }


def _text(data: Mapping[str, Any], found: Mapping[str, Sequence[Any]]) -> str:
    from refsim.contract import STEPS

    operations = data["operations"]
    used = [step for step in STEPS if any(step in o["steps"] for o in operations.values())]
    rows = []
    for name, o in operations.items():
        cells = [_share(o["steps"].get(step)) for step in used]
        verdict = "holds" if o["holds"] else "FAILS" if o["trials"] else "no trial"
        rows.append((name, *cells, _error(o["largest_error"]), verdict))
    lines = [f"{data['programs']}, arrays of {data['arrays']}: trials passed, by step of the ladder", ""]
    right = tuple(range(1, len(used) + 2))
    lines.append(table(rows, ("operation", *used, "largest error", "verdict"), right))
    for outcomes in found.values():
        failed = [o for o in outcomes if not o.passed]
        lines += ["", *(_told(o) for o in failed[:TOLD])] if failed else []
        if len(failed) > TOLD:
            lines.append(f"  and {len(failed) - TOLD} more; --json has all")
    trials, bad = (sum(o[key] for o in operations.values()) for key in ("trials", "failed"))
    holding = sum(o["holds"] for o in operations.values())
    lines += [
        "",
        f"{holding} of {len(operations)} operations hold; {trials - bad} of {trials} trials passed in"
        f" {in_time(data['seconds'])}. Errors are shares of the bound on rounding.",
    ]
    if data["not_offered"]:
        lines.append(f"{len(data['not_offered'])} of refsim's {len(REGISTRY)} operations have no program here.")
    return "\n".join(lines)


def _share(counts: Mapping[str, int] | None) -> str:
    return "-" if counts is None else f"{counts['trials'] - counts['failed']}/{counts['trials']}"


def _error(error: float) -> str:
    return f"{error:.3g}" if math.isfinite(error) else "no number"


def _told(outcome: Any) -> str:
    words = f"; {outcome.words}" if outcome.words else ""
    where = f"{outcome.dtype}, variant {outcome.variant}" if outcome.dtype else "before the first trial"
    error = "" if not math.isfinite(outcome.error) else f": {outcome.error:.3g} of the bound"
    return f"  FAIL {outcome.operation} {outcome.step} {outcome.trial} ({where}){error}{words}"


# What an operation takes


def _arguments(names: Sequence[str], arrays: str) -> CommandResult:
    """Each argument with its type and meaning, as a program on `arrays` gets it."""
    from refsim import contract
    from refsim.core import cases

    cases.discover()
    count = cases.CASES[SHOWN_IN]().count
    data, lines = {}, []
    for name in names:
        if name not in REGISTRY:
            from refsim.scene.files import suggestion

            raise InputError(f"there is no operation {name!r}; {suggestion(name, REGISTRY)}")
        operation = REGISTRY[name]
        values = contract.bindings(name, arrays, "float32", SHOWN_IN)
        rows = []
        for argument, value in values.items():
            role = "out" if argument in operation.outputs else "in"
            if argument in operation.adds:
                role = "add to"
            optional = "or None" if argument in operation.optional else ""
            rows.append((argument, role, _kind(value, count), optional, _meaning(argument, value)))
            if hasattr(value, "_fields"):
                rows += [(f"  .{f}", "", _kind(v, count), "", "") for f, v in zip(value._fields, value)]
        data[name] = [
            {"name": r[0].strip(), "role": r[1], "type": r[2], "optional": bool(r[3]), "meaning": r[4]} for r in rows
        ]
        many = len(operation.variants)
        head = f"{name}: {operation.paper}, {operation.equation}; {many} variant{'s' if many > 1 else ''}"
        lines += [head, "", table(rows, ("argument", "", "type in a float32 run, n particles", "", "meaning")), ""]
    return CommandResult({"arrays": arrays, "operations": data}, "\n".join(lines).rstrip())


def _kind(value: Any, count: int) -> str:
    if value is None:
        return "None"
    if hasattr(value, "_fields"):
        return type(value).__name__
    if hasattr(value, "shape") and hasattr(value, "dtype") and np.ndim(value):
        shape = ", ".join("n" if size == count else str(size) for size in value.shape)
        return f"{value.dtype} ({shape})"
    return type(value).__name__


def _meaning(name: str, value: Any) -> str:
    from refsim.contract.inputs import fields

    if hasattr(value, "_fields"):
        return f"{type(value).__module__}.{type(value).__name__}"
    found = fields().get(name)
    return f"{found.meaning} [{found.unit}]" if found else ""


register(
    Command(
        "contract",
        "judge programs of your own against the reference",
        configure,
        execute,
        "Climbs the ladder of tests with every program of a backend: closed forms, hard inputs, conservation,"
        " symmetries, repeatability, bad input. The programs run in a process of their own. Exit code 4 if a trial"
        " failed, 2 for bad input.",
    )
)
