"""What ends a process from outside: Ctrl-C, SIGTERM, the terminal that closes (SIGHUP), and a parent that is gone."""

import _thread
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from multiprocessing.connection import Connection


def quiet_while_importing() -> None:
    """Let Ctrl-C end the command `refsim` without a traceback until `heeding` begins; other programs are left alone."""
    word = os.path.splitext(os.path.basename((getattr(sys, "argv", None) or [""])[0]))[0]
    as_module = word == "-m" and any(pair == ("-m", "refsim") for pair in zip(sys.orig_argv, sys.orig_argv[1:]))
    if (word == "refsim" or as_module) and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        with suppress(ValueError):  # not in the main thread
            signal.signal(signal.SIGINT, signal.SIG_DFL)


class Interrupted(KeyboardInterrupt):
    """A signal asks for the end.

    After a plain KeyboardInterrupt that passed a C library, Python ends itself by SIGINT, also where it was caught.
    """


def _interrupt(number: int, frame: Any) -> None:
    raise Interrupted


AGAIN = 0.05  # s until a signal comes again whose exception was lost


@contextmanager
def heeding(act: Callable[[int, Any], Any] = _interrupt) -> Iterator[None]:
    """Call `act` on each of the signals; by default it raises Interrupted. SIGHUP stays ignored under nohup.

    Python drops an exception that is raised in a callback of its own; the signal is then sent again.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, act) for number in numbers}
    others = sys.unraisablehook

    def lost(found: Any) -> None:
        if not issubclass(found.exc_type, KeyboardInterrupt):
            return others(found)
        timer = threading.Timer(AGAIN, _thread.interrupt_main)
        timer.daemon = True
        timer.start()

    sys.unraisablehook = lost
    try:
        yield
    finally:
        sys.unraisablehook = others
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def held_back() -> Iterator[None]:
    """Hold the signals back until the end of the block, which starts a process: half started, it could not be ended."""
    came: list[int] = []
    with heeding(lambda number, frame: came.append(number)):
        yield
    if came:
        signal.raise_signal(came[0])


def end_with(parent: "Connection") -> None:
    """End this process as soon as its parent has closed the other end of the pipe, or is gone, however it ended."""

    def wait() -> None:
        with suppress(EOFError, OSError):
            parent.recv_bytes()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
