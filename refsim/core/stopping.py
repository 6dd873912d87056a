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


ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(__file__))))
COMMANDS = tuple(os.path.join(ROOT, *path) for path in (("validation", "__main__.py"), ("scripts", "reproduce.py")))
AGAIN = 0.05  # s until a signal comes again whose exception was lost
_heeded: list[int] = []  # signals that asked for the end since the outermost `heeding` began
_blocks: list[Any] = []  # what the blocks of `heeding` call, the outermost first


class Interrupted(KeyboardInterrupt):
    """A signal asks for the end.

    After a plain KeyboardInterrupt that passed a C library, Python ends itself by SIGINT, also where it was caught.
    """


def heed_while_importing() -> None:
    """Have signals end a command of this project with its exit code until `heeding` begins; other programs do not care.

    Nothing has been started or written by then. Processes that a command starts are left alone, too.
    """
    program = (getattr(sys, "argv", None) or [""])[0]
    word = os.path.splitext(os.path.basename(program))[0]
    as_module = word == "-m" and ("-m", "refsim") in zip(sys.orig_argv, sys.orig_argv[1:])
    is_refsim = word == "refsim" or as_module or os.path.realpath(program) in COMMANDS
    if is_refsim and "--multiprocessing-fork" not in sys.orig_argv:
        with suppress(ValueError):  # not in the main thread
            for number in _numbers():
                if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                    signal.signal(number, _end)


def _end(number: int, frame: Any) -> None:
    sentence = "Interrupted before anything was begun."
    with suppress(OSError):
        os.write(2, f"refsim: {sentence} [interrupted]\n".encode())
        if "--json" in sys.argv:
            os.write(1, f'{{"error": "{sentence}", "reason": "interrupted", "exit_code": 3}}\n'.encode())
    os._exit(3)


def _numbers() -> list[int]:
    """The signals that ask for the end. SIGHUP stays ignored under nohup."""
    numbers = [int(getattr(signal, name)) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    return [n for n in numbers if n in numbers[:2] or signal.getsignal(n) is not signal.SIG_IGN]


def _interrupt(number: int, frame: Any) -> None:
    raise Interrupted


@contextmanager
def handling_signals(act: Callable[[int, Any], Any] = _interrupt, last: bool = False) -> Iterator[None]:
    """Call `act` on the first of the signals, and on every Ctrl-C; by default it raises Interrupted.

    A batch system may send SIGTERM twice: what comes after the first signal, but for Ctrl-C, is dropped. Python drops
    an exception that is raised in a callback of its own; the signal is then sent again.

    last  the process ends after the block; where a signal asked for that, no other one disturbs the end
    """

    def heed(number: int, frame: Any) -> None:
        if not _heeded or number == signal.SIGINT:
            _heeded.append(number)
            act(number, frame)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    if not _blocks:
        _heeded.clear()
    others = sys.unraisablehook

    def lost(unraisable: Any) -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            return others(unraisable)
        timer = threading.Timer(AGAIN, _thread.interrupt_main)
        timer.daemon = True
        timer.start()

    with _handled_by(heed) as before:
        sys.unraisablehook = lost
        _blocks.append(act)
        try:
            yield
        finally:
            sys.unraisablehook = others
            _blocks.pop()
            if last:
                before |= dict.fromkeys(before, signal.SIG_IGN if _heeded else signal.SIG_DFL)


@contextmanager
def _handled_by(handler: Callable[[int, Any], Any]) -> Iterator[dict[int, Any]]:
    """Handle the signals so in the block; gives the handlers that are put back after it."""
    before = {number: signal.signal(number, handler) for number in _numbers()}
    try:
        yield before
    finally:
        for number, one in before.items():
            signal.signal(number, one)


@contextmanager
def held_back() -> Iterator[None]:
    """Hold the signals back until the end of the block, which starts a process: half started, it could not be ended."""
    came: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with _handled_by(lambda number, frame: came.append(number)):
        yield
    if came:
        signal.raise_signal(came[0])


@contextmanager
def deaf_to_ctrl_c() -> Iterator[None]:
    """Processes that the block starts get no Ctrl-C, for which they would print tracebacks; here it comes after it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with(parent: "Connection") -> None:
    """End this process as soon as its parent has closed the other end of the pipe, or is gone, however it ended."""

    def wait() -> None:
        with suppress(EOFError, OSError):
            parent.recv_bytes()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
