"""Trials in processes that are watched: one that dies or stands still is a finding, and another takes its place."""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import multiprocessing
import os
import queue
import shutil
import signal
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from validation.attack import KINDS

MEMORY = 8 << 30  # bytes of address space of a process


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
    """A process that carries trials out one after another; its words go to a file, which is read if it dies."""

    def __init__(self, seed: int) -> None:
        context = multiprocessing.get_context("spawn")
        self.seed, self.scratch = seed, Path(tempfile.mkdtemp(prefix="refsim-attack-"))
        self.pipe, there = context.Pipe()
        self.process = context.Process(target=_work, args=(there, seed, str(self.scratch)))
        self.process.start()
        there.close()

    def carry_out(self, kind: str, number: int, over: Callable[[], bool]) -> Ended | None:
        """One trial; None where the campaign is `over` before its end."""
        began = time.monotonic()
        limit = began + KINDS[kind][1] + 30
        self.pipe.send((kind, number))
        try:
            while not self.pipe.poll(0.5):
                if over():
                    return None
                if time.monotonic() > limit:
                    return self._lost("hang", kind, number, began)
            ended: Ended = self.pipe.recv()
            return ended
        except (EOFError, OSError):
            self.process.join(5)
            return self._lost("died", kind, number, began)

    def _lost(self, cause: str, kind: str, number: int, began: float) -> Ended:
        words = f"exit code {self.process.exitcode}; {(self.scratch / 'log').read_text(errors='replace')[-1500:]}"
        return Ended(kind, number, cause, words, draw(kind, self.seed, number), time.monotonic() - began)

    def end(self) -> None:
        """Kill the process and what it started."""
        if self.process.exitcode is None:
            with contextlib.suppress(OSError, AttributeError):
                os.killpg(self.process.pid, signal.SIGKILL)  # type: ignore[arg-type]
            self.process.kill()
        self.process.join()
        self.pipe.close()
        shutil.rmtree(self.scratch, ignore_errors=True)


def perform(tasks: Iterable[tuple[str, int]], seed: int, jobs: int, until: float) -> Iterator[Ended]:
    """Carry (kind, number) out in `jobs` processes until there are no more, or the clock (monotonic, s) is `until`."""
    source, lock, stop = iter(tasks), threading.Lock(), threading.Event()
    found: queue.SimpleQueue[Ended] = queue.SimpleQueue()

    def over() -> bool:
        return stop.is_set() or time.monotonic() > until

    def attend() -> None:
        worker = _Worker(seed)
        try:
            while not over():
                with lock:
                    task = next(source, None)
                if task is None or (ended := worker.carry_out(*task, over)) is None:
                    return
                found.put(ended)
                if ended.outcome in ("died", "hang"):
                    worker.end()
                    worker = _Worker(seed)
        finally:
            worker.end()

    with ThreadPoolExecutor(jobs) as threads:
        running = [threads.submit(attend) for _ in range(jobs)]
        try:
            while not (all(each.done() for each in running) and found.empty()):
                try:
                    ended = found.get(timeout=0.5)
                except queue.Empty:
                    continue
                yield ended
        finally:
            stop.set()
    for each in running:
        each.result()


def module(kind: str) -> Any:
    """The module of a kind of trial."""
    return importlib.import_module(f"validation.attack.{kind}")


def draw(kind: str, seed: int, number: int) -> dict[str, Any]:
    """The trial of a kind with this seed and number."""
    trial: dict[str, Any] = module(kind).make(seed, number)
    return trial


def carry_out(kind: str, trial: dict[str, Any]) -> tuple[str, str]:
    """(outcome, words) of one trial, here, in a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="refsim-attack-") as folder, contextlib.chdir(os.getcwd()):
        outcome: tuple[str, str] = module(kind).perform(trial, Path(folder))
        return outcome


def _work(pipe: Any, seed: int, scratch: str) -> None:
    """In a process of its own: trials as they come."""
    file = open(Path(scratch, "log"), "w", buffering=1)  # noqa: SIM115
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
    with contextlib.suppress(EOFError, OSError):
        while True:
            kind, number = pipe.recv()
            trial, began = draw(kind, seed, number), time.monotonic()
            try:
                outcome, words = carry_out(kind, trial)
            except Exception:  # of a public function that a trial calls, or of the attack itself
                outcome, words = "traceback", traceback.format_exc()[-1500:]
            pipe.send(Ended(kind, number, outcome, words, trial, time.monotonic() - began))
