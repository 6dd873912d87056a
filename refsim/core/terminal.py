"""What is told on standard error while work goes on: lines, and a bar, which Rich draws where it can be renewed."""

import functools
import importlib.util
import math
import os
import sys
import time
from contextlib import suppress
from typing import Any, ClassVar

from refsim.core.tables import in_time

RENEWED, TOLD = 0.2, 10.0  # seconds between two states of a bar: of a line that is renewed, of lines in a pipe
LENGTH = 12  # of a bar, in letters


def in_jupyter() -> bool:
    """Whether the program runs in the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell"


def on_terminal() -> bool:
    """Whether standard error is a terminal."""
    return sys.stderr is not None and sys.stderr.isatty()


def wanted() -> bool:
    """Whether a bar is seen: standard error is a terminal, or the program runs in Jupyter."""
    return in_jupyter() or on_terminal()


@functools.cache
def _console(notebook: bool) -> Any:
    from rich.console import Console

    renewed = None if notebook else True  # a notebook has a widget, whose content is replaced
    return Console(stderr=True, force_terminal=not notebook, force_jupyter=notebook, force_interactive=renewed)


def say(text: str, style: str = "") -> None:
    """Lines on standard error; on a terminal wrapped between words, in a style of Rich, and above a bar."""
    if on_terminal():
        from rich.text import Text

        _console(False).print(Text(text, style))
    else:
        print(text, file=sys.stderr, flush=True)


class Bar:
    """What is done of a whole: on a terminal and in Jupyter one line that is renewed, in a pipe one in ten seconds."""

    line: ClassVar[Any] = None  # that is renewed, by one bar at a time

    def __init__(self, whole: float, done: float = 0.0, shown: bool = True) -> None:
        self.whole, self.first, self.done, self.shown, self.caption = whole, done, done, shown, ""
        self.renewed = wanted() and os.environ.get("TERM") not in ("dumb", "unknown")
        self.began = time.perf_counter()
        self.last_shown = -math.inf if self.renewed else self.began

    def to(self, done: float, words: str) -> None:
        """So much is done now, and this is said of it."""
        self.done, self.caption = min(max(done, self.done), self.whole), words
        now = time.perf_counter()
        if self.shown and now - self.last_shown >= (RENEWED if self.renewed else TOLD):
            self.last_shown = now
            self._show()

    def close(self) -> None:
        """Show the last state, once."""
        if self.shown:
            self._show()
            self.shown = False
            self.end_line()

    @classmethod
    def end_line(cls) -> None:
        """Leave the line that is renewed as it is; what follows stands below."""
        line, cls.line = cls.line, None
        with suppress(OSError):  # of a terminal that has closed
            if line is not None:
                line.stop()

    def _show(self) -> None:
        share, gone = self.done / self.whole if self.whole else 1.0, time.perf_counter() - self.began
        elapsed = f"{in_time(gone)} gone"
        if self.first < self.done < self.whole:
            elapsed += f", {in_time(gone * (self.whole - self.done) / (self.done - self.first))} left"
        elapsed += f": {self.caption}" if self.caption else ""
        with suppress(OSError):  # of a terminal that has closed
            if self.renewed:
                self._renew(share, elapsed)
            else:
                say(f"{share:4.0%} {elapsed}")

    def _renew(self, share: float, caption: str) -> None:
        from rich.live import Live
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        if Bar.line is None:
            console = _console(in_jupyter() and importlib.util.find_spec("ipywidgets") is not None)
            Bar.line = Live(console=console, auto_refresh=False, redirect_stdout=False, redirect_stderr=False)
            Bar.line.start()
            console.show_cursor(True)  # also where the process is killed
        state, said = Table.grid(padding=(0, 1)), Text(caption)
        said.truncate(max(Bar.line.console.width - LENGTH - 7, 1), overflow="ellipsis")
        state.add_row(f"{share:4.0%}", ProgressBar(1.0, share, width=LENGTH), said)
        Bar.line.update(state, refresh=True)
