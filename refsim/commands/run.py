"""`refsim run`: a scene file, or a checkpoint, to its end, with progress, frames, checkpoints and a report."""

import argparse
import dataclasses
import os
import shlex
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from refsim.commands import CommandResult, command, in_time, planned, table, takes
from refsim.core.effect import EFFECTS
from refsim.core.errors import InputError, RunStopped
from refsim.core.stopping import Interrupted, handling_signals
from refsim.core.tables import vector
from refsim.core.terminal import say
from refsim.engine.driver import Progress, RunReport, simulate
from refsim.engine.simulation import Simulation
from refsim.scene.files import load_scene
from refsim.study.observables import Watching, observable_of

DESCRIPTION = """Run a scene to its end. The folder of the run holds particles.pvd (open it in ParaView),
checkpoint.h5, report.json and, if the run stops, a post-mortem. Ctrl-C ends the run with a checkpoint."""

INTENSIVE = ("", "-", "m/s")  # units of effects' accounts that are the same in 2D; others are per metre of depth


@command("run", "run a scene, or go on from a checkpoint", DESCRIPTION)
@takes("scene", nargs="?", help="scene file (TOML); with --resume it may be left out")
@takes("--backend", help="numpy, cpu or cuda (cpu; with --resume that of the checkpoint)")
@takes("--until", type=float, metavar="T", help="end [s of simulated time] (end_time of the scene)")
@takes("--output", metavar="DIR",
       help="folder of the run (NAME_run for NAME.toml; with --resume that of the checkpoint)")  # fmt: skip
@takes("--every", type=float, metavar="S", help="simulated time between frames [s] (a hundredth of the run)")
@takes("--checkpoint-every", type=float, default=60.0, metavar="S", help="wall time between checkpoints [s] (60)")
@takes("--resume", metavar="FILE|DIR", help="go on from a checkpoint, or from that of a run's folder")
@takes("--overwrite", action="store_true", help="begin anew in a folder that holds an earlier run")
@takes("--threads", type=int, metavar="N", help="CPU threads (one for 1,024 particles, at most all)")
@takes("--observable", metavar="WHAT", help="print its value, as refsim study takes it (panel:NAME of refsim advise)")
@takes("--profile", action="store_true", help="time every pass to its end, and print the seconds by pass")
@takes("--quiet", action="store_true", help="no progress")
def execute(options: argparse.Namespace) -> CommandResult:
    """Run the scene, or go on from the checkpoint."""
    simulation, folder = _begin(options)
    simulation.timings.began = options.began
    until = simulation.plan.scene.end_time if options.until is None else options.until
    if simulation.source is not None and simulation.time >= until:
        simulation.notes.append(f"the checkpoint is already at {simulation.time:.6g} s: nothing was left to do")
    watch = _watch(options, simulation)
    progress = Progress(until, folder, options.quiet)

    def shown(run: Simulation) -> None:
        progress(run)
        if watch is not None:
            watch(run)

    try:
        with _asked_to_stop() as asked:
            given = {name: getattr(options, name) for name in ("threads", "every", "checkpoint_every", "overwrite")}
            report = simulate(
                simulation, options.until, output=folder, progress=shown, asked_to_stop=asked.is_set, **given
            )
    except RunStopped as stop:
        progress.close()
        stop.advice = _advice(stop, folder, options)
        raise
    finally:
        progress.close()
    data, text = dataclasses.asdict(report), _text(report)
    if watch is not None:
        name, value = watch.observable.name, watch.value(simulation)
        data["observable"] = {"name": name, "value": value}
        text += f"\n{name} = {value:.9g} {watch.observable.unit}".rstrip()
    return CommandResult(data, text)


def _watch(options: argparse.Namespace, simulation: Simulation) -> Watching | None:
    if options.observable is None:
        return None
    watching = Watching(observable_of(options.observable, simulation.plan), simulation.plan.scene)
    if simulation.source is not None and watching.due:
        raise InputError(f"run: {options.observable} is read during the whole run; leave --resume out.")
    return watching


def _begin(options: argparse.Namespace) -> tuple[Simulation, Path]:
    scene = None if options.scene is None else load_scene(options.scene)
    if options.resume is not None:
        source = Path(options.resume)
        simulation = Simulation.resume(options.resume, options.backend, options.threads, scene, options.profile)
        return simulation, Path(options.output or (source if os.path.isdir(source) else source.parent))
    if scene is None:
        raise InputError("there is nothing to run; give a scene file, or a checkpoint with --resume.")
    plan = planned(scene, options.scene, options.backend or "cpu")
    simulation = Simulation(plan, options.backend or "cpu", options.threads, options.profile)
    return simulation, Path(options.output or f"{Path(options.scene).stem}_run")


def _advice(stop: RunStopped, folder: Path, options: argparse.Namespace) -> tuple[str, ...]:
    files = stop.report.files if stop.report is not None else {}
    lines = []
    if "postmortem" in files:
        lines.append(f"what broke first, where, and the command that replays it: {files['postmortem']}")
    if stop.reason in ("interrupted", "disk_full", "write_failed", "out_of_memory") and "checkpoint" in files:
        lasting = {"until": options.until, "every": options.every}  # without them frames would have other times
        given = "".join(f" --{name} {value!r}" for name, value in lasting.items() if value is not None)
        lines.append(f"go on with: refsim run --resume {shlex.quote(str(folder))}{given}")
    elif "checkpoint" in files:
        lines.append(f"last good state: {files['checkpoint']}")
    return tuple(lines)


@contextmanager
def _asked_to_stop() -> Iterator[threading.Event]:
    """An event that Ctrl-C, SIGTERM or SIGHUP sets: the run ends between two steps; a second Ctrl-C ends it at once."""
    asked = threading.Event()

    def ask(number: int, frame: Any) -> None:
        if asked.is_set():
            raise Interrupted
        asked.set()
        with suppress(OSError):  # of a terminal that has closed
            say("\nstopping after this step, with a checkpoint; Ctrl-C again stops at once")

    with handling_signals(ask):
        yield asked


def _text(report: RunReport) -> str:
    start, end = report.ledger["start"], report.ledger["end"]
    mass, momentum, energy = ("kg/m", "kg/s", "J/m") if report.dim == 2 else ("kg", "kg m/s", "J")  # per metre of depth
    limiters = ", ".join(f"{name} {n:,}" for name, n in sorted(report.step_limiters.items(), key=lambda i: -i[1]))
    lines = [
        f"{report.scene}: reached {report.time:.6g} s in {report.steps:,} steps",
        seconds_told(report.seconds),
        f"step set by: {limiters}",
    ]
    if s := report.search:
        lines.append(
            f"neighbour list: {s['rebuilds']:,} rebuilds, {s['audited_rows']:,} rows audited,"
            f" {s['missed_neighbours']} neighbours missed, at most {s['most_neighbours']} for one particle"
        )
    lines += [
        f"particles: {end['particles']:,} of {start['particles']:,}, mass {end['mass']:.9g} of {start['mass']:.9g}"
        f" {mass}, {end['outside_walls']} behind walls, stopped by a wall's plane {report.stopped_at_walls:,} times",
        f"momentum: {vector(start['momentum'], '.3')} -> {vector(end['momentum'], '.3')} {momentum}",
        f"kinetic energy: {start['kinetic_energy']:.4g} -> {end['kinetic_energy']:.4g} {energy}",
    ]
    if "potential_energy" in end:
        lines.append(f"potential energy: {start['potential_energy']:.4g} -> {end['potential_energy']:.4g} {energy}")
    if (density := report.density) and "counted" in density:
        lines.append(
            f"density inside the liquid: {density['told']:.5g} kg/m^{report.dim} advanced, {density['counted']:.5g}"
            f" counted, {_beside(density['difference'])}; the 1 % of the cells with the least"
            f" {_beside(density['least'])}, with the largest {_beside(density['most'])}; farthest in the run"
            f" {_beside(density['greatest_difference'])}"
        )
    for effect, account in end.get("effects", {}).items():
        kind: Any = EFFECTS[effect]
        for name, value in account.items():
            before = start["effects"][effect][name]
            said = [f"{(value - before) / abs(before):+.3g} of it"] if before else []
            unit, expected = (of.get(name, "") for of in (kind.ledger_units, kind.ledger_expected))
            per = " per m" if report.dim == 2 and unit not in INTENSIVE else ""
            told = f"{effect}, {name}: {before:.9g} -> {value:.9g} {unit.removesuffix('-')}{per}".rstrip()
            said += [expected] if expected else []
            lines.append(f"{told} ({'; '.join(said)})" if said else told)
    lines += [f"{name}: {path}" for name, path in report.files.items()]
    if "report" in report.files:
        lines.append(f"next: refsim view {shlex.quote(os.path.dirname(report.files['report']))}")
    return "\n".join(lines) + ("" if report.profile is None else _profile(report.profile))


def seconds_told(seconds: dict[str, Any]) -> str:
    """What start, compiling, steps and writing took, of the clock and of all processors."""
    used = seconds["processor"]
    parts = (f"{name} {in_time(seconds[name])}" for name in used if name != "total")
    return f"{in_time(seconds['total'])}: {', '.join(parts)}; {in_time(used['total'])} of processors"


def _profile(profile: dict[str, Any]) -> str:
    """The seconds by stage, the longest first."""
    rows = []
    for cost in profile["stages"]:
        launches = f"{cost['launches']:,}" if cost["launches"] else "-"
        first = f"{cost['first']:.3g}" if cost["first"] else "-"
        rows.append((cost["stage"], f"{cost['seconds']:.4g}", f"{100 * cost['share']:.1f} %", launches, first))
    head = ("pass or part of the loop", "seconds", "share", "launches", "first launch [s]")
    note = f"\n{profile['note']}" if profile["note"] else ""
    return f"\n\n{table(rows, head, right=(1, 2, 3, 4))}{note}"


def _beside(difference: float) -> str:
    return f"{abs(difference):.2%} {'above' if difference > 0 else 'below'}"
