"""`refsim contract`: programs of your own against the reference, operation by operation."""

import argparse
import dataclasses
import math
import os
import sys
import time
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from refsim.commands import CommandResult, command, in_time, table, takes
from refsim.core.errors import InputError
from refsim.core.operation import BACKENDS, REGISTRY
from refsim.core.terminal import say, wanted

WITHIN = 3.0  # widths of three runs of refsim; default of --within
REPLAYED = "replay.npz"  # what --replay writes, in the current folder
EXAMPLE = "sph.density:float32:0:wendland_c2:T2:cloud_3d"
DESCRIPTION = (
    "Climbs the ladder of tests with every program of a backend: closed forms, hard inputs, conservation,"
    " symmetries, repeatability, bad input. The programs run in a process of their own. Exit code 4 if a trial"
    " failed, 2 for bad input."
)


@command("contract", "judge programs of your own against the reference", DESCRIPTION)
@takes("names", nargs="*", metavar="PROGRAMS [OPERATION ...]",
       help="folder/file.py, package.module or the name of an entry point of refsim.contract, with :NAME for"
            f" another mapping than PROGRAMS, or refsim's own: {', '.join(BACKENDS)}; behind it operations to judge,"
            " all that the backend has by default")  # fmt: skip
@takes("--dtype", action="append", default=[], help="float32 or float64; both by default")
@takes("--variant", action="append", default=[], type=int, help="number of a variant; all by default")
@takes("--step", action="append", default=[], help="T1 to T7, T9 to T11; all by default")
@takes("--seed", type=int, metavar="N", help="of the inputs that are drawn at random, T11 (0)")
@takes("--time-limit", type=float, default=120.0, metavar="S",
       help="seconds for the import of the programs and for each call of one (120)")  # fmt: skip
@takes("--allow-untried", action="store_true",
       help="exit code 0 also where a trial was not tried, for the time that a call would take")  # fmt: skip
@takes("--arguments", group="mode", action="store_true", help="judge nothing; say what the operations named take")
@takes("--run", group="mode", metavar="SCENE", help="judge a folder of npz or VTK files against runs of the scene")
@takes("--at", type=float, metavar="T", help="with --run: time [s]; that of the last frame by default")
@takes("--within", type=float, metavar="N",
       help="with --run: times the width of refsim's three runs that a measure may be away from their"
            " middle (3)")  # fmt: skip
@takes("--chaos-only", action="store_true",
       help="with --run: no coarser run; for a code with the same equations, spacing and steps as refsim")  # fmt: skip
@takes("--without-sensitivity", action="store_true",
       help="with --run: no further runs that say which errors of parameters it would have noticed")  # fmt: skip
@takes("--allow", action="append", default=[], metavar="MEASURE=VALUE",
       help="with --run: largest difference of a measure, in place of both bands; may be repeated")  # fmt: skip
@takes("--backend", help="with --run: numpy, cpu or cuda; with --arguments and --template: cpu or cuda (cpu)")
@takes("--export", group="mode", metavar="FOLDER",
       help="judge nothing; write test vectors of the operations named, all by default, into a new folder")  # fmt: skip
@takes("--template", group="mode", action="store_true",
       help="judge nothing; print a Python file with a stub for each of the operations named")  # fmt: skip
@takes("--header", group="mode", choices=("c", "fortran"),
       help="judge nothing; print the declaration of the operation's function in a compiled library")  # fmt: skip
@takes("--replay", group="mode", metavar="TRIAL",
       help="run one trial by the name that a report gives, or by the file of a drawn input that failed, and write"
            f" its inputs and answers into {REPLAYED}")  # fmt: skip
@takes("-j", "--jobs", type=int, metavar="N", help="processes that share the operations (1; 2 for refsim's own)")
@takes("--guide", group="mode", action="store_true", help="judge nothing; print how to bring your own code")
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
    for mode in ("template", "header", "guide"):
        if getattr(options, mode):
            text = _printed(options)
            return CommandResult({mode: text}, text, verbatim=True)
    if options.arguments:
        return _arguments(options.names, options.backend or "cpu")
    if not options.names:
        raise InputError("name the programs to judge: a file folder/file.py or a module; see refsim contract --help.")
    source, *operations = options.names
    if source in REGISTRY:
        raise InputError(f"{source} is an operation; name the programs before it: refsim contract mine.py {source}.")
    check_names(operations, options.dtype, options.variant, options.step)
    if options.jobs is not None and options.jobs < 1:
        raise InputError(f"--jobs = {options.jobs} is not possible; give a number of processes from 1 on.")
    request = apart.Request(
        source, tuple(operations), tuple(options.dtype), tuple(options.variant), tuple(options.step),
        options.time_limit, options.allow_untried, seed=options.seed,
        processes=options.jobs or (apart.PROCESSES if source in BACKENDS else 1),
    )  # fmt: skip
    if options.replay is not None:
        request = _replayed(request, options.replay)
    return _judged(request, options)


def _judged(request: Any, options: argparse.Namespace) -> CommandResult:
    """Climb the ladder, with progress on a terminal, and report."""
    from refsim.contract import apart, report

    began = time.perf_counter()
    about, outcomes = apart.judge(request)
    outcomes_of: dict[str, list[Any]] = {name: [] for name in about.names}
    for outcome in outcomes:
        if not outcomes_of[outcome.operation] and wanted():
            number, seconds = sum(map(bool, outcomes_of.values())) + 1, time.perf_counter() - began
            say(f"{number} of {len(about.names)}, {in_time(seconds)}: {outcome.operation}")
        outcomes_of[outcome.operation].append(outcome)
    if request.replay and not any(outcomes_of.values()):
        raise InputError(f"--replay {request.replay}: {about.name} has no such trial; take a name that --json gives.")
    data = report.report(about, request, outcomes_of, time.perf_counter() - began)
    text = report.text(data, outcomes_of)
    if request.replay:
        (outcome,) = (o for outcomes in outcomes_of.values() for o in outcomes)
        data, text = {"outcome": dataclasses.asdict(outcome), "inputs": REPLAYED}, f"{outcome}\nInputs: {REPLAYED}."
        return CommandResult(data, text, 0 if outcome.passed else 4)
    return CommandResult(data, text, 0 if data["holds"] else 4)


def _replayed(request: Any, name: str) -> Any:
    """The request for one trial by its name, OPERATION:DTYPE:VARIANT:KERNEL:STEP:TRIAL."""
    from refsim.contract.drawn import read
    from refsim.contract.programs import check_names

    seed, file = request.seed, name
    if name.endswith(".json"):
        seed, name = name, read(Path(name))[0]
    parts = name.split(":", 5)
    if len(parts) != 6 or not parts[2].isdecimal():
        raise InputError(f"--replay {name} is no trial; take a name that the report gives: {EXAMPLE}.")
    operation, dtype, variant, _, step, trial = parts
    if step == "T11" and file == name and trial[6:].partition(".")[0].isdecimal():
        seed = int(trial[6:].partition(".")[0])
    check_names((operation,), (dtype,), (int(variant),), (step,))
    chosen = {"operations": (operation,), "dtypes": (dtype,), "variants": (int(variant),), "steps": (step,)}
    return dataclasses.replace(request, replay=name, seed=seed, **chosen)


MODES = ("run", "export", "template", "header", "arguments", "replay", "guide")
OF_MODES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("at", "within", "allow", "chaos_only", "without_sensitivity"), ("run",)),
    "backend": ("run", "arguments", "template"),
    **dict.fromkeys(("step", "seed", "jobs", "allow_untried"), ("",)),
    **dict.fromkeys(("dtype", "variant"), ("", "export")),
}


def _check_modes(options: argparse.Namespace) -> None:
    """InputError for options that the mode does not have."""
    mode = next((mode for mode in MODES if getattr(options, mode)), "")
    for name, modes in OF_MODES.items():
        if getattr(options, name) not in (None, [], False) and mode not in modes:
            option = name.replace("_", "-")
            wanted, got = (
                " or ".join(f"--{m}" if m else "programs to judge" for m in names) for names in (modes, [mode])
            )
            raise InputError(f"--{option} goes with {wanted}, not with {got}.")


# What an operation takes


def _known(names: Sequence[str], arrays: str) -> list[Any]:
    """The operations of these names; InputError where there is none, or where no program has such arrays."""
    from refsim.contract.programs import ARRAYS, among, check_names

    if not names:
        raise InputError("name an operation; `refsim list` has them all.")
    check_names(names)
    among((arrays,), ARRAYS, "--backend: there are no arrays of")
    return [REGISTRY[name] for name in names]


def _arguments(names: Sequence[str], arrays: str) -> CommandResult:
    """Each argument with its type and meaning, as a program on `arrays` gets it, and each variant."""
    from refsim.contract import describe
    from refsim.contract.answers import extended

    data, lines = {}, []
    for operation in _known(names, arrays):
        described = describe.arguments(operation, arrays)
        told = describe.variants(extended(operation.name))
        rows = []
        for a in described:
            group, _, member = a.name.partition(".")
            optional = "or None" if a.optional else ""
            rows.append((f"  .{member}" if member else group, a.role, a.kind, optional, a.meaning))
        data[operation.name] = {"arguments": [dataclasses.asdict(a) for a in described], "variants": told}
        listed = table(rows, ("argument", "", "type in a float32 run, n particles", "", "meaning"))
        lines += [f"{operation.name}: {operation.paper}, {operation.equation}", "", listed, ""]
        lines += [*(f"variant {number}: {meaning}" for number, meaning in enumerate(told)), ""]
    return CommandResult({"arrays": arrays, "operations": data}, "\n".join(lines).rstrip())


def _printed(options: argparse.Namespace) -> str:
    """The guide, the operations' declarations in C or Fortran, or stubs of them, which run and compute nothing."""
    from refsim.contract import describe, native

    if options.guide:
        return resources.files("refsim.contract").joinpath("guide.md").read_text(encoding="utf-8")
    arrays = options.backend or "cpu"
    operations = _known(options.names, arrays)
    if options.template:
        return describe.template([operation.name for operation in operations], arrays)
    return "\n".join(map(native.header if options.header == "c" else native.module, operations))


def _allowed(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise InputError(f"--allow {text} is no measure with a number; write --allow 'centre x=0.01'.") from None


def _whole_run(options: argparse.Namespace) -> CommandResult:
    """Hold a trajectory of another code to refsim's run of the same scene."""
    from refsim.contract import whole_runs
    from refsim.scene.files import load_scene

    if len(options.names) != 1:
        raise InputError("--run SCENE takes one folder, that of the trajectory.")
    for name in ("at", "within"):
        value = getattr(options, name)
        if value is not None and not 0 < value < math.inf:
            raise InputError(f"--{name} = {value:g} is not possible; give a positive number.")
    within, backend = WITHIN if options.within is None else options.within, options.backend or "cpu"
    scene, folder = options.run, options.names[0]
    loaded, allowed = load_scene(scene), dict(map(_allowed, options.allow))
    compared = whole_runs.compare(loaded, Path(folder), options.at, backend, within, allowed, options.chaos_only)
    time, compared_measures, coarser = compared[:3]
    rows = [
        (m.name, f"{m.time:.4g}", f"{m.theirs:.6g}", f"{m.middle:.6g}",
         *(f"{value:.2g}" for value in (m.difference, m.chaos, m.resolution)), m.unit, m.verdict)
        for m in compared_measures
    ]  # fmt: skip
    head = ("measure", "at [s]", folder, "refsim", "difference", "chaos", "resolution", "unit", "verdict")
    with_coarser = not isinstance(coarser, str)
    resolution = f", resolution the difference to one with a spacing of {coarser:.4g} m" if with_coarser else ""
    lines = [
        f"{folder} against {scene} up to {time:g} s, each measure where it is farthest off; chaos is {within:g} times"
        f" the largest width of refsim's runs from three starts that differ by 1e-6 spacings{resolution}. The larger of"
        " the two is allowed.",
        "",
        table(rows, head, (1, 2, 3, 4, 5, 6)),
        "",
        f"{sum(m.holds for m in compared_measures)} of {len(compared_measures)} measures hold.",
    ]
    if any(m.verdict == "within resolution" for m in compared_measures):
        lines.append("Within resolution is right for another discretisation; for the same, judge with --chaos-only.")
    if isinstance(coarser, str) and coarser:
        lines.append(f"There is no coarser run: {coarser}")
    if not any(m.name == "kinetic energy" for m in compared_measures):
        lines.append("Momentum and kinetic energy are not judged: the frames have no velocity.")
    decides, by = compared.decides
    if options.chaos_only:
        until = f"up to {decides:.4g} s: from there on it is more than 5 % of the range of {by}"
        lines.append(f"The chaos decides {until if decides <= time else f'up to {time:.4g} s, the last frame'}.")
    holds = all(m.holds for m in compared_measures)
    data = {"scene": scene, "time": time, "holds": holds, "within": within, "coarser": coarser}
    data["decides_until"] = min(decides, time)
    if not options.without_sensitivity:
        noticed = list(whole_runs.sensitivities(loaded, compared, backend))
        idle = whole_runs.untouched(loaded, compared, {s.parameter: s.error for s in noticed})
        data |= {"sensitivity": {s.parameter: s.error if s.by else None for s in noticed}, "untouched": idle}
        rows = [(s.parameter, f"{s.error:.2g}" if s.by else "none", s.by or "-") for s in noticed]
        lines += ["", table(rows, ("parameter", "least error noticed", "by"), (1,))]
        acted = f"Never touched up to {time:g} s: {', '.join(idle)}." if idle else "Every wall, gauge and effect acted."
        lines += ["Errors are shares of the parameter.", acted]
    data["measures"] = whole_runs.report(compared_measures)
    return CommandResult(data, "\n".join(lines), 0 if data["holds"] else 4)


def _export(options: argparse.Namespace) -> CommandResult:
    """Write test vectors."""
    import msgspec

    from refsim.contract.export import INDEX, READER, SCHEMA, export
    from refsim.contract.programs import check_names

    check_names(options.names, options.dtype, options.variant)
    begins = say if wanted() else lambda name: None
    vectors = export(Path(options.export), options.names, options.dtype, options.variant, begins)
    files = [file for operation in vectors.operations for file in operation.files]
    told = f"{sum(len(file.cases) for file in files)} test vectors of {len(vectors.operations)} operations"
    in_files = f"in {len(files)} npz files; {INDEX} names them, {SCHEMA} is its schema, {READER} reads them in C++."
    return CommandResult(msgspec.to_builtins(vectors), f"{options.export}: {told} {in_files}")
