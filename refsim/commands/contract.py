"""`refsim contract`: programs of your own against the reference, operation by operation."""

from __future__ import annotations

import argparse
import collections
import dataclasses
import math
import os
import re
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from refsim.commands import Command, CommandResult, in_time, register, table
from refsim.core.errors import InputError
from refsim.core.operation import BACKENDS, REGISTRY

WITHIN = 3.0  # widths of three runs of refsim; default of --within
TOLD = 8  # failed trials that the text names for each operation; --json has all


def configure(parser: argparse.ArgumentParser) -> None:
    """Arguments of `refsim contract`."""
    parser.add_argument(
        "names",
        nargs="*",
        metavar="PROGRAMS [OPERATION ...]",
        help="folder/file.py, package.module or the name of an entry point of refsim.contract, with :NAME for"
        f" another mapping than PROGRAMS, or refsim's own: {', '.join(BACKENDS)}; behind it operations to judge, all"
        " that the backend has by default",
    )
    parser.add_argument("--dtype", action="append", default=[], help="float32 or float64; both by default")
    parser.add_argument("--variant", action="append", default=[], type=int, help="number of a variant; all by default")
    parser.add_argument("--step", action="append", default=[], help="T1 to T7, T9 or T10; all by default")
    words = "seconds for the import of the programs and for each call of one (120)"
    parser.add_argument("--time-limit", type=float, default=120.0, metavar="S", help=words)
    parser.add_argument("--arguments", action="store_true", help="judge nothing; say what the operations take")
    words = "judge a trajectory: a folder of VTK or npz files, in place of PROGRAMS, against three runs of the scene"
    parser.add_argument("--run", metavar="SCENE", help=words)
    parser.add_argument("--at", type=float, metavar="T", help="with --run: time [s]; that of the last frame by default")
    words = "with --run: times the width of refsim's three runs that a measure may be away from their middle (3)"
    parser.add_argument("--within", type=float, metavar="N", help=words)
    parser.add_argument("--backend", help="with --run: numpy, cpu or cuda (cpu)")
    words = "judge nothing; write test vectors of the operations named, all by default, into a new folder"
    parser.add_argument("--export", metavar="FOLDER", help=words)
    words = "judge nothing; print a Python file with a stub for each of the operations named"
    parser.add_argument("--template", action="store_true", help=words)


def execute(options: argparse.Namespace) -> CommandResult:
    """Judge the programs and report."""
    from refsim.contract import apart
    from refsim.contract.programs import check_names

    if os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())  # modules are named relative to the current folder
    if not 0 < options.time_limit < math.inf:
        raise InputError(f"--time-limit = {options.time_limit:g} is not possible; give a positive number of seconds.")
    _check_modes(options)
    if options.run is not None:
        return _whole_run(options)
    if options.export is not None:
        return _export(options)
    if options.template:
        return _template(options.names)
    if options.arguments and (not options.names or options.names[0] in REGISTRY):
        return _arguments(options.names, "cpu")
    if not options.names:
        raise InputError("name the programs to judge: a file folder/file.py or a module; see refsim contract --help.")
    source, *operations = options.names
    check_names(operations, options.dtype, options.variant, options.step)
    request = apart.Request(
        source, tuple(operations), tuple(options.dtype), tuple(options.variant), tuple(options.step), options.time_limit
    )
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


MODES = ("run", "export", "template", "arguments")
OF_MODES: dict[str, tuple[str, ...]] = {"at": ("run",), "within": ("run",), "backend": ("run",), "step": ("",)}
OF_MODES |= {"dtype": ("", "export"), "variant": ("", "export")}


def _check_modes(options: argparse.Namespace) -> None:
    """InputError for two modes at a time, and for options that the mode does not have."""
    chosen = [mode for mode in MODES if getattr(options, mode)]
    if len(chosen) > 1:
        raise InputError(f"--{chosen[0]} and --{chosen[1]} exclude each other; give one of them.")
    mode = chosen[0] if chosen else ""
    if mode == "arguments" and options.names and options.names[0] not in REGISTRY:
        mode = ""  # of a library, whose request may name a part of the ladder
    for name, modes in OF_MODES.items():
        if getattr(options, name) not in (None, []) and mode not in modes:
            wanted = " or ".join(f"--{m}" if m else "programs to judge" for m in modes)
            raise InputError(f"--{name} goes with {wanted}, not with {f'--{mode}' if mode else 'programs to judge'}.")


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
    """An operation holds where there were trials and all of them passed; what is not judged counts as no trial."""
    left_out = [o for o in outcomes if o.not_judged]
    every, outcomes = outcomes, [o for o in outcomes if not o.not_judged]
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
        "not_judged": dict(collections.Counter(o.not_judged for o in left_out)),
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
                "not_judged": o.not_judged,
            }
            for o in every
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
    for name, outcomes in found.items():
        groups: dict[str, list[Any]] = {}
        for o in outcomes:
            if not o.passed and not o.not_judged:
                groups.setdefault(_alike(o.words), []).append(o)
        lines += ["", f"{name} fails:"] if groups else []
        lines += [_told(alike) for alike in list(groups.values())[:TOLD]]
        if len(groups) > TOLD:
            rest = sum(map(len, list(groups.values())[TOLD:]))
            lines.append(f"  and {rest} more failed trials; --json has all")
    reasons = _reasons(operations)
    if reasons:
        lines += ["", f"Not judged, as declared (trials or whole variants): {reasons}."]
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


def _told(alike: Sequence[Any]) -> str:
    """Failed trials with the same words: how many, and the first."""
    first = alike[0]
    where = f"{first.dtype}, variant {first.variant}" if first.dtype else "before the first trial"
    error = "" if not math.isfinite(first.error) else f", {first.error:.3g} of the bound"
    trials = "1 trial" if len(alike) == 1 else f"{len(alike)} trials, the first"
    return f"  {first.words or 'a wrong answer'}\n      {trials}: {first.step} {first.trial} ({where}{error})"


def _alike(words: str) -> str:
    """Words less their numbers, so that the same mistake on other particles is told once."""
    return re.sub(r"\d+", "#", words)


def _reasons(operations: Mapping[str, Any]) -> str:
    counts: collections.Counter[str] = collections.Counter()
    for o in operations.values():
        counts.update(o["not_judged"])
    return ", ".join(f"{reason} ({count})" for reason, count in counts.items())


# What an operation takes


def _known(names: Sequence[str]) -> list[Any]:
    """The operations of these names; InputError where there is none."""
    from refsim.core.checked import suggestion

    if not names:
        raise InputError("name an operation; `refsim list` has them all.")
    for name in names:
        if name not in REGISTRY:
            raise InputError(f"there is no operation {name!r}; {suggestion(name, REGISTRY)}")
    return [REGISTRY[name] for name in names]


def _arguments(names: Sequence[str], arrays: str) -> CommandResult:
    """Each argument with its type and meaning, as a program on `arrays` gets it, and each variant."""
    from refsim.contract import describe

    data, lines = {}, []
    for operation in _known(names):
        found = describe.arguments(operation, arrays)
        told = describe.variants(operation)
        rows = []
        for a in found:
            group, _, member = a.name.partition(".")
            optional = "or None" if a.optional else ""
            rows.append((f"  .{member}" if member else group, a.role, a.kind, optional, a.meaning))
        data[operation.name] = {
            "arguments": [dataclasses.asdict(a) for a in found],
            "variants": told,
        }
        lines += [f"{operation.name}: {operation.paper}, {operation.equation}", ""]
        lines += [table(rows, ("argument", "", "type in a float32 run, n particles", "", "meaning")), ""]
        lines += [f"variant {number}: {words}" for number, words in enumerate(told)]
        lines.append("")
    return CommandResult({"arrays": arrays, "operations": data}, "\n".join(lines).rstrip())


def _template(names: Sequence[str]) -> CommandResult:
    """A stub for the operations, which runs and computes nothing."""
    from refsim.contract import describe

    text = describe.template([operation.name for operation in _known(names)])
    return CommandResult({"template": text}, text)


def _whole_run(options: argparse.Namespace) -> CommandResult:
    """Hold a trajectory of another code to refsim's run of the same scene."""
    from pathlib import Path

    from refsim.contract import whole_runs
    from refsim.scene.files import load_scene

    if len(options.names) != 1:
        raise InputError("--run SCENE takes one folder, that of the trajectory.")
    for name in ("at", "within"):
        value = getattr(options, name)
        if value is not None and not 0 < value < math.inf:
            raise InputError(f"--{name} = {value:g} is not possible; give a positive number.")
    within = WITHIN if options.within is None else options.within
    time, found = whole_runs.compare(
        load_scene(options.run), Path(options.names[0]), options.at, options.backend or "cpu", within
    )
    holds = all(m.holds for m in found)
    rows = []
    for m in found:
        ours, width = 0.5 * (min(m.ours) + max(m.ours)), max(m.ours) - min(m.ours)
        verdict = "holds" if m.holds else "FAILS"
        rows.append((m.name, f"{m.theirs:.6g}", f"{ours:.6g}", f"{width:.2g}", f"{m.difference:.2g}", m.unit, verdict))
    head = ("measure", options.names[0], "refsim", "width of 3 runs", "difference", "unit", "verdict")
    lines = [
        f"{options.names[0]} against {options.run} at {time:g} s; allowed is {within:g} times the width of"
        " refsim's runs from three starts that differ by 1e-6 spacings",
        "",
        table(rows, head, (1, 2, 3, 4)),
        "",
        f"{sum(m.holds for m in found)} of {len(found)} measures hold.",
    ]
    if not any(m.name == "kinetic energy" for m in found):
        lines.append("Momentum and kinetic energy are not judged: the frames have no velocity.")
    data = {"scene": options.run, "time": time, "holds": holds, "within": within}
    return CommandResult(data | {"measures": whole_runs.report(found)}, "\n".join(lines), 0 if holds else 4)


def _export(options: argparse.Namespace) -> CommandResult:
    """Write test vectors."""
    from pathlib import Path

    import msgspec

    from refsim.contract.export import INDEX, SCHEMA, export
    from refsim.contract.programs import check_names

    check_names(options.names, options.dtype, options.variant)
    vectors = export(Path(options.export), options.names, options.dtype, options.variant)
    files = [file for operation in vectors.operations for file in operation.files]
    lines = [
        f"{options.export}: {sum(len(file.cases) for file in files)} test vectors of {len(vectors.operations)}"
        f" operations in {len(files)} npz files; {INDEX} names them, {SCHEMA} is its schema."
    ]
    if vectors.not_exported:
        lines.append(f"Not exported, as they take objects of refsim: {', '.join(vectors.not_exported)}.")
    return CommandResult(msgspec.to_builtins(vectors), "\n".join(lines))


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
