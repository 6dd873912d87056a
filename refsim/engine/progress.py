"""Progress of a run on a terminal and in Jupyter: a bar over simulated time."""

from pathlib import Path

from refsim.core.tables import in_time
from refsim.core.terminal import Bar, say
from refsim.engine.state import State


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
