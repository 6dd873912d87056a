"""Processes that compile kernels into the cache.

They are started anew and not forked: a forked process would inherit the threads of Numba's pool and the state of a
GPU. One imports the modules of the kernels that it is sent and compiles them one after another. It ends as soon as the
process that started it does.
"""

import contextlib
import importlib
import os
import pickle
import signal
import subprocess
import sys
import threading
import warnings
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

LONGEST = 300.0  # seconds for one kernel, after which the process is ended; the run then compiles the kernel itself
STORED, FAILED = b".", b"!"
START = "import sys; sys.path[:] = sys.argv[1:]; from refsim.backends.workers import serve; serve()"


@dataclass(frozen=True)
class Task:
    """A kernel, by module and name, and the pickled types for which its code is wanted.

    Of a plain loop they are those of the arguments that it takes; `written_for` are what `PlainKernel.of` takes.
    """

    module: str
    name: str
    types: bytes
    written_for: Any = None

    @classmethod
    def of(cls, program: Any, types: tuple) -> "Task | None":
        """None if no other process can find the kernel or one of its types: those of the main script, say."""
        module, name = getattr(program, "origin", None) or ("__main__", "")
        if module == "__main__" or "<" in name:
            return None
        try:
            sent = pickle.dumps(tuple(types))
        except (pickle.PicklingError, AttributeError, TypeError):
            return None
        return None if b"__main__" in sent else cls(module, name, sent, getattr(program, "written_for", None))

    def store(self) -> None:
        """Compile the kernel in this process and store its code."""
        named = attrgetter(self.name)(importlib.import_module(self.module))
        program = named.on("cpu") if hasattr(named, "on") else named
        program = program if self.written_for is None else program.of(*self.written_for)
        program.store(pickle.loads(self.types))


class Worker:
    """A process that compiles. Raises OSError if it cannot be started."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", START, *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "NUMBA_NUM_THREADS": "1"},
        )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.tasks, self.answers = self.process.stdin, self.process.stdout

    def store(self, task: Task) -> bytes:
        """STORED, or FAILED where an error has occurred, which the run finds again; empty if the process has ended."""
        stop = threading.Timer(LONGEST, self.process.kill)
        stop.daemon = True
        stop.start()
        try:
            pickle.dump(task, self.tasks)
            self.tasks.flush()
            return self.answers.read(1)
        except (OSError, ValueError):  # it has ended, or `close` has been called
            return b""
        finally:
            stop.cancel()

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.tasks, self.answers):
            with contextlib.suppress(OSError):  # of what was not yet sent
                pipe.close()


def serve() -> None:
    """What such a process does: tasks come on standard input, STORED or FAILED for each goes to standard output."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    warnings.simplefilter("ignore")  # the process that sent the task says what the cache refuses
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what modules print
    while True:
        try:
            task = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            task.store()
        except Exception:  # of any kind: the process that runs the kernel compiles it itself then, and raises it
            answers.write(FAILED)
        else:
            answers.write(STORED)
