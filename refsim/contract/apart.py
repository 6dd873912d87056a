"""The ladder in a process of its own: if a program crashes or does not return, only that trial fails.

Only that process imports the programs. It reports to the parent by messages, JSON lists through a pipe:
`import`, `about`, `refused`, `begin`, `call`, `returned`, `outcome`, `done`, `fault`. Where it ended, another one
goes on behind the trial that ended it.
"""

import contextlib
import dataclasses
import faulthandler
import gc
import json
import multiprocessing
import os
import queue
import signal
import sys
import threading
import time
import warnings
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from refsim.contract.answers import MANY, MANY_PARTICLES
from refsim.contract.target import Outcome
from refsim.core.errors import InputError
from refsim.core.operation import BACKENDS
from refsim.core.stopping import deaf_to_ctrl_c

OWN_WORK = 600.0  # s without a message between two calls: oracles, neighbour lists, the start of Python
PAUSE = 0.05  # s for which one process is waited for, where several judge
MOST_BYTES = 1 << 20  # of a message
LEAST_THREADS = 4
PROCESSES = min(2, os.cpu_count() or 1)
MOST_ENDINGS = 5  # of processes for one operation; each new one imports the programs again


@dataclass(frozen=True)
class Request:
    """What is judged: see `refsim.contract.programs.ladder`; `seconds` limits the import and each call."""

    source: str
    operations: tuple[str, ...] = ()
    dtypes: tuple[str, ...] = ()
    variants: tuple[int, ...] = ()
    steps: tuple[str, ...] = ()
    seconds: float = 120.0
    allow_untried: bool = False  # whether an operation holds of which a declared trial was not tried
    first: int = 0  # number of the first operation's first trial
    replay: str = ""  # name of the one trial that is run, whose inputs are written into the current folder
    seed: int | str | None = None  # of drawn inputs, or the file of one; see `refsim.contract.programs.ladder`
    processes: int = PROCESSES  # among which operations are shared, of a library where more than one is asked for


@dataclass(frozen=True)
class LibraryDescription:
    """A library as its process describes it: `names` are judged, `offered` has programs (None: refsim's own)."""

    name: str
    arrays: str
    names: list[str]
    offered: list[str] | None
    declared: dict[str, list[Any]]  # what it is declared to support: see `refsim.contract.report.gaps`


def judge(request: Request) -> tuple[LibraryDescription, Iterator[Outcome]]:
    """(what the library is, outcomes of the ladder as they come, operation by operation).

    A trial whose program ends its process or does not return in time fails; another process goes on behind it, at most
    `MOST_ENDINGS` times for one operation. Raises InputError if the library cannot be imported or the request does not
    fit it.
    """
    child = _Child(request, request.operations)
    try:
        kind, value = "", dict[str, Any]()
        while kind != "about":
            kind, value = child.message(request.seconds)
            if kind == "refused":
                raise InputError(value)
        about = LibraryDescription(**value)
    except BaseException as error:
        child.close()
        if isinstance(error, _Gone):
            raise InputError(f"{request.source} cannot be imported: {error}.") from None
        raise
    count = 1 if request.replay else min(request.processes, len(about.names))
    if count > 1:
        child.close()
    first, shares = None if count > 1 else child, [about.names[k::count] for k in range(count)]
    return about, _merged([_outcomes(names, about.arrays, request, first) for names in shares])


def _merged(parts: list[Generator[Outcome | None, None, None]]) -> Iterator[Outcome]:
    """Outcomes as they come, of processes that each judge a part of the operations."""
    try:
        while parts:
            for part in list(parts):
                for outcome in part:
                    if outcome is None:
                        break
                    yield outcome
                else:
                    parts.remove(part)
    finally:
        for part in parts:
            part.close()


def _outcomes(
    names: Sequence[str], arrays: str, request: Request, child: "_Child | None"
) -> Generator[Outcome | None, None, None]:
    """Outcomes of these operations as they come, None where there is none for the moment."""
    waiting, endings, first = list(names), 0, 0
    try:
        while waiting:
            child = child or _Child(dataclasses.replace(request, first=first), waiting)
            at: list[Any] = [waiting[0], "", 0, "-", "the start", 0]
            fault = ""
            try:
                while waiting and not fault:
                    kind, value = child.message(request.seconds)
                    if kind in ("outcome", ""):
                        yield Outcome(**value) if kind else None
                    elif kind == "begin":
                        at = value
                    elif kind == "done":
                        waiting.remove(value)
                        endings = 0
                    elif kind in ("refused", "fault"):
                        fault = value
            except (_Gone, TypeError, ValueError) as gone:  # TypeError: no message of ours
                fault = str(gone) if isinstance(gone, _Gone) else "it disturbed the process that judges it"
            if fault:
                operation, dtype, variant, step, trial, number = at
                endings += 1
                left = not dtype or endings == MOST_ENDINGS
                message = f"{fault}; the trials behind this one are not judged" if left else fault
                many = MANY_PARTICLES if trial == MANY and "did not return" in fault else ""
                yield Outcome(operation, step, trial, arrays, dtype, variant, False, np.inf, message, many)
                first, endings = (0, 0) if left else (number + 1, endings)
                if left and operation in waiting:
                    waiting.remove(operation)
                child.close()
                child = None
    finally:
        if child is not None:
            child.close()


class _Gone(Exception):
    """The process that judges ended, or was ended; the message is a clause that says why."""


class _Child:
    """The process with the programs, and its messages."""

    def __init__(self, request: Request, operations: Sequence[str]) -> None:
        context = multiprocessing.get_context("spawn")  # a forked process would inherit the threads of Numba's pool
        self.pipe, there = context.Pipe(duplex=False)
        task = (there, dataclasses.replace(request, operations=tuple(operations)), list(sys.path))
        self.process = context.Process(target=_work, args=task)
        with deaf_to_ctrl_c():
            self.process.start()
        there.close()
        self.called, self.heard = "", time.monotonic()
        self.messages: queue.SimpleQueue[Any] = queue.SimpleQueue()
        threading.Thread(target=_read, args=(self.pipe, self.messages), daemon=True).start()

    def message(self, seconds: float) -> tuple[str, Any]:
        """(kind, value) of the next message, ("", None) where there is none for the moment; _Gone if none comes,
        `seconds` after the last if a program is running.
        """
        alive, message = self.process.is_alive(), None
        try:  # a process of the program's own may hold the pipe of one that ended open
            message = self.messages.get(timeout=PAUSE if alive else 1)
        except queue.Empty:
            limit = seconds if self.called else OWN_WORK
            if alive and time.monotonic() - self.heard <= limit:
                return "", None
            if alive:
                what = {"import": "its import did not end", "call": "the program did not return"}
                reason = what.get(self.called, "the process that judges it stood still")
                raise _Gone(f"{reason} within {limit:g} s (--time-limit)") from None
        if not isinstance(message, list) or len(message) != 2:
            self.process.join(1)
            code = self.process.exitcode
            if code is None:
                ending = "it closed the pipe that leads out of it"
            else:
                ending = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            raise _Gone(f"the program ended its process ({ending})")
        self.heard = time.monotonic()
        kind, value = message
        self.called = kind if kind in ("import", "call") else ""
        return kind, value

    def close(self) -> None:
        """End the process and those that it started."""
        if self.process.exitcode is None:
            with contextlib.suppress(OSError):
                os.killpg(self.process.pid, signal.SIGKILL)  # type: ignore[arg-type]
            self.process.kill()
        self.process.join()


def _read(pipe: Any, messages: queue.SimpleQueue[Any]) -> None:
    """Messages into the queue, and None at the end, or at the first that is none of ours."""
    try:
        while True:
            messages.put(json.loads(pipe.recv_bytes(MOST_BYTES)))
    except (EOFError, OSError, ValueError):
        messages.put(None)


# In the other process


def _work(pipe: Any, request: Request, path: list[str]) -> None:
    """Import and judge. What programs print goes to standard error, which is no report; nothing is typed into them."""
    from refsim.contract import drawn
    from refsim.contract import programs as library
    from refsim.contract.binding import error_line
    from refsim.contract.export import write_replay

    os.setsid()  # what programs start ends with this process
    gc.set_threshold(50_000)  # of the many objects that imports make few are garbage
    if request.source not in BACKENDS:  # of OpenMP, so that races show on few cores
        os.environ.setdefault("OMP_NUM_THREADS", str(max(LEAST_THREADS, os.cpu_count() or 1)))
    os.dup2(2, 1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    sys.path[:] = path
    process, quiet = os.getpid(), open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115

    def tell(kind: str, value: Any = None) -> None:
        if os.getpid() != process:  # a copy of the process that a program made
            os._exit(1)
        pipe.send_bytes(json.dumps([kind, value]).encode())
        if kind in ("import", "call"):  # ends this process even if the parent is gone
            faulthandler.dump_traceback_later(2 * request.seconds + 30, exit=True, file=quiet)
        else:
            faulthandler.cancel_dump_traceback_later()

    code, refusal = 1, "refused"
    try:
        tell("import")
        with np.errstate(), warnings.catch_warnings():  # a library may change both for the whole process
            programs = library.load(request.source)
            names = list(library.checked_request(programs, request))
            offered = None if programs.programs is None else list(programs.programs)
            declared = {key: list(getattr(programs, key)) for key in ("dtypes", "dims", "kernels", "left_out")}
            about = LibraryDescription(programs.name, programs.arrays, names, offered, declared)
        refusal = "fault"
        tell("about", dataclasses.asdict(about))
        calling = lambda case: tell("returned" if case is None else "call", case)  # noqa: E731
        chosen = request.dtypes, request.variants, request.steps, calling, request.seed
        for operation in about.names:
            tell("begin", [operation, "", 0, "-", "the start", 0])
            for step in library.ladder(programs, operation, *chosen):
                if operation == about.names[0] and step.number < request.first:
                    continue
                trial, target = step.outcome(), step.target
                if request.replay not in ("", trial.replay):
                    continue
                tell("begin", [operation, target.dtype, target.variant, trial.step, trial.trial, step.number])
                outcome = step.perform()
                if outcome is not None:
                    tell("outcome", dataclasses.asdict(outcome))
                if request.replay:
                    write_replay(target)
                elif target.sought.smallest:
                    drawn.write(target)
            tell("done", operation)
        code = 0
    except BaseException as error:
        how = "it ended its step by" if refusal == "fault" else f"{request.source} cannot be imported:"
        said = str(error) if isinstance(error, InputError) else error_line(error, how) + "." * (refusal == "refused")
        with contextlib.suppress(BaseException):
            tell(refusal, said)
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(BaseException):
                stream.flush()
        os._exit(code)  # no exit handlers or threads of the programs
