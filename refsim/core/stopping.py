"""What ends a process from outside: Ctrl-C, SIGTERM, the terminal that closes (SIGHUP), and a parent that is gone."""

from __future__ import annotations

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


@contextmanager
def heeding(act: Callable[[int, Any], Any] = signal.default_int_handler) -> Iterator[None]:
    """Call `act` on each of the signals; by default it raises KeyboardInterrupt. SIGHUP stays ignored under nohup."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, act) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def end_with(parent: Connection) -> None:
    """End this process as soon as its parent has closed the other end of the pipe, or is gone, however it ended."""

    def wait() -> None:
        with suppress(EOFError, OSError):
            parent.recv_bytes()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
