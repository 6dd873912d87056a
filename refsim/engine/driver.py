"""A whole run: frames, checkpoints, progress, a report, and a post-mortem where it stops.

A run's folder holds `particles.pvd` with the folder `particles` (frames), `checkpoint.h5` and the one before it,
`report.json` (the run log, renewed with every checkpoint), of a scene with gauges `gauges.hdf5` and, after a stop,
`postmortem.json` and `postmortem.npz`.
"""

import functools
import json
import math
import os
import shlex
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.checked import plainly
from refsim.core.effect import POSITION_RESIDUAL
from refsim.core.errors import InputError, RunStopped
from refsim.core.period import wrapped
from refsim.core.tables import Shown, in_time
from refsim.core.terminal import Bar, say, wanted
from refsim.core.versions import versions
from refsim.core.writing import plain, write_file, writing
from refsim.engine.conserved_totals import check_particles, conserved_totals
from refsim.engine.counting import LOOKED
from refsim.engine.launching import refresh
from refsim.engine.postmortem import AFTER_THESE, POSTMORTEM, POSTMORTEM_FIELDS, write_postmortem
from refsim.engine.simulation import Simulation
from refsim.engine.state import State
from refsim.gauges import number
from refsim.io.checkpoint import CHECKPOINT, KEPT, previous_path
from refsim.io.frames import OLDER, Frame, ParticleWriter, origin_of
from refsim.io.results import GAUGES, PARTICLES, REPORT, write_series
from refsim.scene.plan import Plan
from refsim.scene.scene import Scene

ONE_BY_ONE = (
    "profiled on cuda: the passes were launched one by one with a wait after each, not as one CUDA graph; each launch"
    " took some 10 to 50 microseconds longer than in a run without a profile"
)
FRAMES = 100  # of a whole run, where the caller does not say how often
HELD_FOR, HELD_BYTES = 0.5, 2**26  # s and bytes until which frames are held, to be written in one go


@dataclass(repr=False)
class RunReport(Shown):
    """What a run did. SI units, in 2D per metre of depth; momenta and energies with velocities half a step behind.

    reason, message   why it stopped (one of `refsim.core.errors.REASONS`) and one sentence; None if it reached its end
    time, steps       reached, counted from the scene's start (so are all counts below)
    step_limiters     how many steps each limit has set
    search            neighbour list: rebuilds, audited_rows, missed_neighbours (0), most_neighbours,
                      list_bytes
    stopped_at_walls  how often the plane of a wall has stopped a particle
    density           told and counted inside the liquid at the end [kg/m^3, kg/m^2 in 2D], and the greatest difference
                      of both that was found; None where none is advanced (`refsim.engine.counting`)
    ledger            particles at the start and at the end: number, mass, momentum, energy, how many behind walls
    seconds           wall seconds since the simulation was made (of `refsim run`: since the process began): start,
                      compiling (the first call of each kernel, which loads or compiles it), steps and writing, their
                      sum total, and in `processor` those of all processors; in `stages` wall seconds of this process by
                      stage, without first calls
    profile           of a run that was profiled: `note`, and in `stages` what each stage took
                      (`refsim.engine.timings.StageCost`), the longest first; else None
    """

    scene: str
    backend: str
    dtype: str
    dim: int
    versions: dict[str, str]
    particles: int
    reason: str | None = None
    message: str | None = None
    time: float = 0.0
    steps: int = 0
    until: float = 0.0
    resumed_at_step: int | None = None
    step_limiters: dict[str, int] = field(default_factory=dict)
    last_step: dict[str, Any] | None = None
    search: dict[str, int] | None = None
    stopped_at_walls: int = 0
    density: dict[str, Any] | None = None
    ledger: dict[str, dict[str, Any]] = field(default_factory=dict)
    frames: int = 0
    checkpoints: int = 0
    seconds: dict[str, Any] = field(default_factory=dict)
    profile: dict[str, Any] | None = None
    files: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        return f"RunReport of {self.scene!r}", [
            ("ended with", "its end" if self.reason is None else self.reason),
            ("time", f"{self.time:.6g} s of {self.until:.6g} s in {self.steps:,} steps"),
            ("particles", f"{self.particles:,}, {self.dtype}, backend {self.backend}"),
            ("wall time", in_time(self.seconds["total"])),
            ("frames", str(self.frames)),
            ("files", ", ".join(self.files.values()) or "none"),
            ("notes", "; ".join(self.notes) or "none"),
        ]


@plainly
def simulate(
    scene: Scene | Plan | Simulation,
    until: float | None = None,
    *,
    backend: str = "cpu",
    threads: int | None = None,
    output: str | os.PathLike[str] | None = None,
    every: float | None = None,
    checkpoint_every: float = 60.0,
    overwrite: bool = False,
    profile: bool = False,
    progress: bool | Callable[[Simulation], None] | None = None,
    asked_to_stop: Callable[[], bool] = lambda: False,
) -> RunReport:
    """Run a scene, or go on with a simulation, and return the report.

    until             end [s], the scene's end_time by default; the first step that reaches it is the last one
    output            folder for frames, checkpoints and report; nothing is written where it is None
    every             simulated time between frames [s], a hundredth of the run by default
    checkpoint_every  wall time between checkpoints [s]; one more is written at the end
    overwrite         begin anew in a folder that holds an earlier run, unless that one is still running
    profile           time every pass to its end (see `Simulation`, which has the option where one is given)
    progress          True shows a bar, False none; None shows it on a terminal and in Jupyter. Or what is called before
                      the first step and after every step
    asked_to_stop     called after every step; if it is true, the run ends with reason "interrupted" and a checkpoint

    A simulation that was resumed from a checkpoint in `output` goes on there, with frames at the times that they would
    have had without the interruption.

    Raises InputError for bad input. Raises RunStopped where the run cannot go on: the last good checkpoint is
    then untouched, and the folder has a post-mortem.
    """
    shown = progress is True or (progress is None and wanted())
    simulation = scene if isinstance(scene, Simulation) else Simulation(scene, backend, threads, profile)
    run = _Run(simulation, until, output, every, checkpoint_every, overwrite, threads)
    bar = Progress(run.until, run.folder) if shown else None
    try:
        with simulation.at_work():
            run.go(bar or (progress if callable(progress) else None), asked_to_stop)
    except MemoryError:
        where = f"No memory was left in step {simulation.steps} at {simulation.time:.6g} s"
        stop = RunStopped("out_of_memory", f"{where}; take fewer particles or a larger machine.")
        raise run.stopped(stop) from None
    except RunStopped as stop:
        raise run.stopped(stop) from stop.__cause__
    finally:
        if bar is not None:
            bar.close()
        run.close()
    report = run.report()
    log().info("%s: reached %.6g s in %d steps", report.scene, report.time, report.steps)
    return report


class _Run:
    """The files and clocks of one call of `simulate`."""

    def __init__(
        self,
        simulation: Simulation,
        until: float | None,
        output: str | os.PathLike[str] | None,
        every: float | None,
        checkpoint_every: float,
        overwrite: bool,
        threads: int | None,
    ) -> None:
        self.simulation, self.threads = simulation, threads
        self.until = simulation.plan.scene.end_time if until is None else until
        for name, value in (("until", self.until), ("every", every), ("checkpoint_every", checkpoint_every)):
            if value is not None and not (math.isfinite(value) and (value > 0 or (value == 0 and name != "every"))):
                raise InputError(f"{name} = {value} is not possible; give a positive number of seconds.")
        self.every = every or self.until / FRAMES or math.inf
        self.checkpoint_every = checkpoint_every
        self.resumed_at = simulation.steps if simulation.steps or simulation.source is not None else None
        self.frames = self.checkpoints = self.logged = 0
        self.last_checkpoint: Path | None = None
        self.stop: RunStopped | None = None
        self.loop_began, self.counted_before = time.perf_counter(), simulation.timings.counted
        self.files: dict[str, str] = {}
        self.writer: ParticleWriter | None = None
        self.held: list[Frame] = []  # not yet written
        self.flushed = -math.inf  # clock when frames were last written
        self.folder = None if output is None else Path(output)
        if self.folder is not None:
            self._open(self.folder, overwrite)

    def _open(self, folder: Path, overwrite: bool) -> None:
        """Make or enter the folder, and hold its frames against other writers."""
        source, checkpoint = self.simulation.source, folder / CHECKPOINT
        same = source is None or (folder.exists() and source.parent.samefile(folder))
        goes_on = self.resumed_at is not None and same
        if not goes_on and not overwrite and any(map(os.path.lexists, (folder / REPORT, checkpoint))):
            raise InputError(
                f"folder {folder} holds an earlier run; resume that one (--resume), give another folder (--output)"
                " or allow it to be overwritten (--overwrite)."
            )
        if os.path.exists(folder) and not os.path.isdir(folder):
            raise InputError(f"{folder} is a file; give a folder for the output.")
        with writing("folder", folder, "nothing was changed"):
            folder.mkdir(parents=True, exist_ok=True)
        fields = {}
        for name, f in self.simulation.plan.particle_fields.items():
            if name not in ("position", POSITION_RESIDUAL.name):
                dtype = f.numpy_dtype(self.simulation.plan.grid.dtype)
                fields[name] = (f.components, "uint8" if dtype.kind == "b" else dtype)
        time = self.simulation.time if goes_on else None
        origin = origin_of(self.simulation.plan)
        self.writer = ParticleWriter(folder / PARTICLES, fields, resume_time=time, origin=origin)
        self.files["particles"] = str(folder / PARTICLES)
        if goes_on:
            self.last_checkpoint = source
            return
        others = (folder / name for name in (GAUGES, POSTMORTEM, POSTMORTEM_FIELDS, OLDER))
        try:
            for path in (checkpoint, previous_path(checkpoint), *others):
                with writing("folder", folder, f"{path.name} is still there"):
                    path.unlink(missing_ok=True)  # only under the writer's lock: another run may still need them
        except BaseException:
            self.close()
            raise

    def go(self, progress: Callable[[Simulation], None] | None, asked_to_stop: Callable[[], bool]) -> None:
        simulation, grid = self.simulation, self.simulation.plan.grid
        log().info(
            "%s: %d particles in %dD, %s, backend %s, from %.6g to %.6g s", simulation.plan.scene.name,
            simulation.count, grid.dim, grid.dtype, simulation.backend.name, simulation.time, self.until,
        )  # fmt: skip
        self._log_notes()
        if progress is not None:
            progress(simulation)
        clock = time.perf_counter()
        simulation.timings.begin_steps()
        if self.folder is not None:
            if self._begins_with_frame():
                self._frame()
            if self.last_checkpoint is None:
                self._checkpoint()  # so that a run that stops early can be replayed
        while simulation.time < self.until:
            frames = number(self.every, simulation.time)
            simulation.step()
            self._log_notes()
            if progress is not None:
                progress(simulation)
            if self.folder is not None:
                if number(self.every, simulation.time) > frames:
                    self._frame()
                self._flush(HELD_FOR)
                if time.perf_counter() - clock >= self.checkpoint_every:
                    self._checkpoint()
                    clock = time.perf_counter()
            if asked_to_stop() and simulation.time < self.until:
                if self.folder is not None:
                    self._checkpoint()
                raise RunStopped(
                    "interrupted", f"The run was interrupted after step {simulation.steps} at {simulation.time:.6g} s."
                )
        check_particles(simulation)
        simulation.balances.inspect(simulation)
        note = simulation.counting.judged(simulation)
        if note and LOOKED not in simulation.remarks:
            simulation.notes.append(note)
            self._log_notes()
        if self.folder is not None:
            assert self.writer is not None
            self._flush()
            if self.writer.last_time is None or simulation.time > self.writer.last_time:
                self._frame()
            self._checkpoint()

    def _log_notes(self) -> None:
        for note in self.simulation.notes[self.logged :]:
            log().warning("%s", note)
        self.logged = len(self.simulation.notes)

    def _begins_with_frame(self) -> bool:
        """Whether the state at the start is a frame that the file lacks: the first one, or one on the grid of times."""
        assert self.writer is not None
        simulation, last = self.simulation, self.writer.last_time
        if last is None and (simulation.steps == 0 or simulation.source is None):
            return True
        if last is not None and last >= simulation.time:
            return False
        return number(self.every, simulation.time - simulation.previous_length) < number(self.every, simulation.time)

    def _frame(self) -> None:
        simulation = self.simulation
        check_particles(simulation)
        with simulation.timings.of_host("frames"):
            refresh(simulation, on_demand=True)
            names = (name for name in simulation.plan.particle_fields if name != POSITION_RESIDUAL.name)
            values = {name: simulation.stored(name) for name in names}
            values = {name: v.view(np.uint8) if v.dtype.kind == "b" else v for name, v in values.items()}
            scene = simulation.plan.scene
            position = wrapped(values.pop("position"), scene.period, scene.period_lower)
            self.held.append(Frame(simulation.time, position, values))
        log().debug("frame at %.6g s", simulation.time)

    def _flush(self, held_for: float = 0.0) -> None:
        """Write the frames that are held, unless others were written less than `held_for` seconds ago."""
        held = sum(values.nbytes for frame in self.held for values in (frame.position, *frame.fields.values()))
        if not self.held or (time.perf_counter() < self.flushed + held_for and held < HELD_BYTES):
            return
        assert self.writer is not None
        with self.simulation.timings.of_host("writing"):
            self.writer.append(self.held)
        self.frames += len(self.held)
        self.held.clear()
        self.flushed = time.perf_counter()

    def _checkpoint(self) -> None:
        assert self.folder is not None
        path = self.folder / CHECKPOINT
        self._flush()
        check_particles(self.simulation)
        with self.simulation.timings.of_host("checkpoints"):
            self.simulation.checkpoint(path)
            self._write_gauges(self.folder)
        self.checkpoints += 1
        log().debug("checkpoint at %.6g s: %s", self.simulation.time, path)
        self.last_checkpoint = path
        self.files["checkpoint"] = str(path)
        self._write_report(self.folder)

    def _write_gauges(self, folder: Path) -> None:
        gauges, path = self.simulation.gauges, folder / GAUGES
        if gauges is not None:
            write_series(path, (gauges.series(gauge.name) for gauge in gauges.gauges))
            self.files["gauges"] = str(path)

    def _write_report(self, folder: Path) -> None:
        path = folder / REPORT
        self.files["report"] = str(path)
        write_file(path, json.dumps(plain(asdict(self.report())), indent=1) + "\n", "report", KEPT)

    def stopped(self, stop: RunStopped) -> RunStopped:
        """Note why the run stopped, in a post-mortem and in the report; the error to raise, with the report."""
        self.stop = stop
        log().error("%s [%s]", stop, stop.reason)
        with suppress(InputError, RunStopped, OSError, MemoryError):  # a full disk must not hide the first reason
            self._flush()
        with suppress(InputError, RunStopped, OSError, MemoryError):
            if self.folder is not None:
                self._write_gauges(self.folder)
                if stop.reason in AFTER_THESE:
                    path = write_postmortem(self.simulation, stop, self.folder, self._replay(), self.last_checkpoint)
                    self.files["postmortem"] = str(path)
                self._write_report(self.folder)
            stop.report = self.report()
        return stop

    def _replay(self) -> str:
        """The command that runs from the last checkpoint into the same stop, in a folder of its own."""
        if self.last_checkpoint is None or self.folder is None:
            return "run the scene again: it stopped before its first checkpoint"
        threads = "" if self.threads is None else f" --threads {self.threads}"
        return (
            f"refsim run --resume {shlex.quote(str(self.last_checkpoint))} --backend {self.simulation.backend.name}"
            f" --until {self.until!r}{threads} --output {shlex.quote(str(self.folder / 'replay'))} --overwrite"
        )

    def report(self) -> RunReport:
        """The report as of now."""
        simulation = self.simulation
        plan, stop, timings = simulation.plan, self.stop, simulation.timings
        given: dict[str, Any] = {"reason": stop.reason, "message": str(stop)} if stop else {}
        given |= {name: getattr(simulation, name) for name in ("time", "steps", "stopped_at_walls")}
        given |= {name: getattr(self, name) for name in ("until", "frames", "checkpoints")}
        given |= {name: getattr(plan.grid, name) for name in ("dtype", "dim")}
        return RunReport(
            scene=plan.scene.name,
            backend=simulation.backend.name,
            versions=versions(),
            particles=simulation.count,
            resumed_at_step=self.resumed_at,
            step_limiters=dict(simulation.limiters),
            last_step=asdict(simulation.last) if simulation.last else None,
            search=asdict(simulation.search.log) if simulation.search else None,
            density=simulation.counting.report(),
            ledger={"start": conserved_totals(plan), "end": conserved_totals(simulation)},
            seconds={**timings.account(), "stages": dict(timings.stages)},
            profile=self._profile(),
            notes=list(simulation.notes),
            files=dict(self.files),
            **given,
        )

    def _profile(self) -> dict[str, Any] | None:
        timings = self.simulation.timings
        if timings.wait is None:
            return None
        elapsed = time.perf_counter() - self.loop_began + self.counted_before
        note = ONE_BY_ONE if self.simulation.backend.name == "cuda" else ""
        return {"note": note, "stages": [cost._asdict() for cost in timings.costs(elapsed)]}

    def close(self) -> None:
        if self.writer is not None:
            with suppress(InputError, RunStopped, OSError, MemoryError):
                self._flush()
            self.writer.close()


@functools.cache
def log() -> Any:
    """The logger `refsim`; it prints nothing unless the program sets up logging."""
    import logging  # here, because it takes a thirtieth of the time that importing refsim does

    logger = logging.getLogger("refsim")
    logger.addHandler(logging.NullHandler())
    return logger


class Progress:
    """A bar over simulated time with an estimate of what is left; compile time is reported separately before.

    until   end of the run [s]
    folder  of the run, named in the first line; None if nothing is written
    quiet   show the notes on the run and nothing else
    """

    def __init__(self, until: float, folder: Path | None, quiet: bool = False) -> None:
        self.until, self.folder, self.quiet = until, folder, quiet
        self.time: float | None = None
        self.bar: Bar | None = None
        self.notes_shown = 0

    def __call__(self, simulation: State) -> None:
        """Show the state of the simulation."""
        for note in simulation.notes[self.notes_shown :]:
            say(f"note: {note}")
        self.notes_shown = len(simulation.notes)
        if self.time is None:
            self._head(simulation)
        if self.quiet or simulation.time == self.time:
            return
        if self.bar is None:
            self._open(simulation)
            return
        limiter = simulation.last.limiter if simulation.last else ""
        self.time = simulation.time
        caption = f"{self.time:.4g} of {self.until:.4g} s, step {simulation.steps:,}, {limiter} limit"
        self.bar.to(self.time, caption)

    def _head(self, simulation: State) -> None:
        self.time = simulation.time
        if self.quiet:
            return
        plan = simulation.plan
        at = f", from step {simulation.steps:,} at {simulation.time:.6g} s" if simulation.steps else ""
        into = "" if self.folder is None else f", into {self.folder}"
        say(
            f"{plan.scene.name}: {plan.grid.count:,} particles in {plan.grid.dim}D, {plan.grid.dtype}, backend"
            f" {simulation.backend.name}{at}, to {self.until:g} s{into}"
        )

    def _open(self, simulation: State) -> None:
        seconds = simulation.timings.account()["compiling"]
        if seconds > 1:
            from refsim.backends.cache import is_writable

            end = "finds them in the cache" if is_writable() else "compiles them again: its cache cannot be written"
            say(f"compiled the kernels in {in_time(seconds)}; the next run {end}")
        self.time = simulation.time
        self.bar = Bar(self.until, self.time)

    def close(self) -> None:
        """Close the bar."""
        if self.bar is not None:
            self.bar.close()
            self.bar = None
