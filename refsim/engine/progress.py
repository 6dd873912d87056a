"""Progress of a run on a terminal and in Jupyter: a bar over simulated time, and one over the kernels to compile."""

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from refsim.core.tables import in_time
from refsim.engine.run import Run


def wanted() -> bool:
    """Whether a bar is seen: standard error is a terminal, or the program runs in Jupyter."""
    return in_jupyter() or sys.stderr.isatty()


def in_jupyter() -> bool:
    """Whether the program runs in the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell"


def bar_of(**options: Any) -> Any:
    """A bar of tqdm: a widget in Jupyter where ipywidgets is there, else text on standard error."""
    if in_jupyter() and importlib.util.find_spec("ipywidgets") is not None:
        from tqdm.notebook import tqdm as bar
    else:
        from tqdm import tqdm as bar  # type: ignore[assignment, unused-ignore]
    return bar(file=sys.stderr, mininterval=0.2 if wanted() else 10, **options)


def say(text: str) -> None:
    """A line on standard error."""
    print(text, file=sys.stderr, flush=True)


def compiling_bar(kernels: int, processes: int) -> Callable[[], Any]:
    """Begin a bar over the kernels that are compiled; what it returns is called after each."""
    bar = bar_of(
        total=kernels,
        desc=f"compiling {kernels} kernels on {processes} cores",
        bar_format="{desc}: {n_fmt} of {total_fmt}, {elapsed} gone",
    )

    def after_each() -> None:
        bar.update()
        if bar.n == kernels:
            bar.close()

    return after_each


class Progress:
    """A bar over simulated time with an estimate of what is left; compile time is reported separately before.

    until   end of the run [s]
    folder  of the run, named in the first line; None if nothing is written
    quiet   show the notes on the run and nothing else
    """

    def __init__(self, until: float, folder: Path | None, quiet: bool = False) -> None:
        self.until, self.folder, self.quiet = until, folder, quiet
        self.time: float | None = None
        self.bar: Any = None
        self.told = 0

    def __call__(self, simulation: Run) -> None:
        """Show the state of the simulation."""
        for note in simulation.notes[self.told :]:
            say(f"note: {note}")
        self.told = len(simulation.notes)
        if self.time is None:
            self._head(simulation)
        if self.quiet or simulation.time == self.time:
            return
        if self.bar is None:
            self._open(simulation)
            return
        assert self.time is not None
        limiter = simulation.last.limiter if simulation.last else ""
        self.bar.set_postfix_str(f"step {simulation.steps:,}, {limiter} limit", refresh=False)
        self.bar.update(min(simulation.time, self.until) - self.time)
        self.time = min(simulation.time, self.until)

    def _head(self, simulation: Run) -> None:
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

    def _open(self, simulation: Run) -> None:
        seconds = simulation.timings.account()["compiling"]
        if seconds > 1:
            from refsim.backends.cache import is_writable

            end = "finds them in the cache" if is_writable() else "compiles them again: its cache cannot be written"
            say(f"compiled the kernels in {in_time(seconds)}; the next run {end}")
        self.time = simulation.time
        self.bar = bar_of(
            total=self.until,
            initial=min(self.time, self.until),
            bar_format="{percentage:3.0f}%|{bar}| {n:.4g} of {total:.4g} s, {elapsed} gone, {remaining} left{postfix}",
        )

    def close(self) -> None:
        """Close the bar."""
        if self.bar is not None:
            self.bar.close()
            self.bar = None
