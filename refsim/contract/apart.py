"""The ladder in a process of its own: a program that crashes costs its own operation, not the report."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from refsim.contract.ladder import Outcome
from refsim.errors import InputError


def outcomes(
    source: str,
    operations: Sequence[str],
    dtypes: Sequence[str] = (),
    variants: Sequence[int] = (),
    steps: Sequence[str] = (),
) -> Iterator[Outcome]:
    """Outcomes of the ladder for the programs of `source` (see `load`), operation by operation, as they come.

    A process that ends by itself gives a failed outcome, and the next operation starts another one. Raises InputError
    as `load` and `trials` do.
    """
    context = multiprocessing.get_context("spawn")
    waiting = list(operations)
    while waiting:
        here, there = context.Pipe(duplex=False)
        task = (there, source, tuple(waiting), tuple(dtypes), tuple(variants), tuple(steps), list(sys.path))
        process = context.Process(target=_work, args=task, daemon=True)
        process.start()
        there.close()
        at: tuple[Any, ...] = (waiting[0], "cpu", "", 0, "the start")
        try:
            while True:
                kind, value = here.recv()
                if kind == "refused":
                    raise InputError(value)
                if kind == "outcome":
                    yield value
                elif kind == "begin":
                    at = value
                elif kind == "done":
                    waiting.remove(value)
                    if not waiting:
                        break
        except EOFError:  # the process is gone
            process.join()
            operation, arrays, dtype, variant, step = at
            words = f"the program ended its process ({_ending(process.exitcode)}); what was left of it is not judged"
            yield Outcome(operation, step, "the rest of the step", arrays, dtype, variant, False, np.inf, words)
            waiting.remove(operation)
        finally:
            here.close()
            if process.is_alive():
                process.join(5)
                process.terminate()
            process.join()


def _ending(code: int | None) -> str:
    if code is not None and code < 0:
        return f"signal {signal.Signals(-code).name}"
    return f"exit code {code}"


def _work(
    pipe: Any,
    source: str,
    operations: tuple[str, ...],
    dtypes: tuple[str, ...],
    variants: tuple[int, ...],
    steps: tuple[str, ...],
    path: list[str],
) -> None:
    """In the other process: whatever the programs print goes to standard error, which is no report."""
    os.dup2(2, 1)
    sys.path[:] = path
    from refsim.contract.programs import load, trials

    try:
        programs = load(source)
        for operation in operations:
            pipe.send(("begin", (operation, programs.arrays, "", 0, "the start")))

            def begin(dtype: str, variant: int, step: str, operation: str = operation) -> None:
                pipe.send(("begin", (operation, programs.arrays, dtype, variant, step)))

            for outcome in trials(programs, operation, dtypes, variants, steps, begin):
                pipe.send(("outcome", outcome))
            pipe.send(("done", operation))
    except InputError as error:
        pipe.send(("refused", str(error)))
