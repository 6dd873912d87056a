"""Trials in processes that are watched: one that dies or stands still is a finding, and another takes its place."""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import multiprocessing
import os
import shutil
import signal
import tempfile
import time
import traceback
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from validation.attack import KINDS

MEMORY = 8 << 30  # bytes of address space of a process
BATCH = 20  # trials that a process is given at once


@dataclass(frozen=True)
class Ended:
    """One trial that was carried out."""

    kind: str
    number: int
    outcome: str
    words: str
    trial: dict[str, Any]
    seconds: float


class _Worker:
    def __init__(self, seed: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.pipe, there = context.Pipe()
        self.log = tempfile.NamedTemporaryFile(prefix="refsim-attack-", suffix=".log")  # noqa: SIM115
        self.scratch = tempfile.mkdtemp(prefix="refsim-attack-")
        self.process = context.Process(target=_work, args=(there, seed, self.log.name, self.scratch))
        self.process.start()
        there.close()
        self.waiting: list[tuple[str, int]] = []
        self.since = time.monotonic()

    def give(self, tasks: list[tuple[str, int]]) -> None:
        self.waiting = tasks
        self.since = time.monotonic()
        self.pipe.send(tasks)

    def end(self) -> None:
        if self.process.exitcode is None:
            with contextlib.suppress(OSError, AttributeError):
                os.killpg(self.process.pid, signal.SIGKILL)  # type: ignore[arg-type]
            self.process.kill()
        self.process.join()
        self.pipe.close()
        self.log.close()
        shutil.rmtree(self.scratch, ignore_errors=True)

    def last_words(self) -> str:
        return Path(self.log.name).read_text(errors="replace")[-1500:]


def perform(tasks: Iterable[tuple[str, int]], seed: int, jobs: int, until: float) -> Iterator[Ended]:
    """Carry (kind, number) out in `jobs` processes until there are no more, or the clock (monotonic, s) is `until`."""
    source = iter(tasks)
    workers: list[_Worker] = []

    def more() -> list[tuple[str, int]]:
        found: list[tuple[str, int]] = []
        for kind, number in source:
            found.append((kind, number))
            if len(found) == BATCH or kind not in ("scenes", "checkpoints"):
                break
        return found

    try:
        for _ in range(jobs):
            batch = more()
            if batch:
                workers.append(_Worker(seed))
                workers[-1].give(batch)
        while workers and time.monotonic() < until:
            ready = set(wait([w.pipe for w in workers], timeout=0.5))
            for w in list(workers):
                cause = ""
                if w.pipe in ready:
                    try:
                        ended = w.pipe.recv()
                        w.waiting.remove((ended.kind, ended.number))
                        w.since = time.monotonic()
                        yield ended
                    except (EOFError, OSError):
                        w.process.join(5)
                        cause = "died"
                elif w.waiting and time.monotonic() - w.since > KINDS[w.waiting[0][0]][2] + 30:
                    cause = "hang"
                if cause:
                    (kind, number), *rest = w.waiting
                    words = f"exit code {w.process.exitcode}; {w.last_words()}"
                    yield Ended(kind, number, cause, words, draw(kind, seed, number), time.monotonic() - w.since)
                    w.end()
                    workers.remove(w)
                    w = _Worker(seed)
                    workers.append(w)
                    w.give(rest)
                if not w.waiting:
                    batch = more()
                    if batch:
                        w.give(batch)
                    else:
                        w.end()
                        workers.remove(w)
    finally:
        for w in workers:
            w.end()


def module(kind: str) -> Any:
    """The module of a kind of trial."""
    return importlib.import_module(f"validation.attack.{KINDS[kind][0] if kind in KINDS else kind}")


def draw(kind: str, seed: int, number: int) -> dict[str, Any]:
    """The trial of a kind with this seed and number."""
    return module(kind).make(seed, number)


def carry_out(kind: str, trial: dict[str, Any]) -> tuple[str, str]:
    """(outcome, words) of one trial, here, in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="refsim-attack-") as folder:
        before = os.getcwd()
        try:
            return module(kind).perform(trial, Path(folder))
        finally:
            os.chdir(before)


def _work(pipe: Any, seed: int, log: str, scratch: str) -> None:
    """In a process of its own: trials as they come. Its words go to a file; they are read if it dies."""
    file = open(log, "w", buffering=1)  # noqa: SIM115
    os.dup2(file.fileno(), 2)
    os.dup2(file.fileno(), 1)
    faulthandler.enable(file)
    if hasattr(os, "setsid"):
        os.setsid()
    with contextlib.suppress(ImportError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tempfile.tempdir = scratch  # the parent removes it
    try:
        while True:
            for kind, number in pipe.recv():
                trial, began = draw(kind, seed, number), time.monotonic()
                try:
                    outcome, words = carry_out(kind, trial)
                except Exception:  # of a public function that a trial calls, or of the attack itself
                    outcome, words = "traceback", traceback.format_exc()[-1500:]
                pipe.send(Ended(kind, number, outcome, words, trial, time.monotonic() - began))
    except (EOFError, OSError):
        pass
