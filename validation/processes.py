"""Runs in many processes at a time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from validation.harness import Case, Options, Run, about_run, check, interrupted
from validation.results import Result, load, result_folder, save
from validation.running import Context


def compute_ahead(cases: Sequence[Case], options: Options, jobs: int) -> None:
    """Compute what is not stored in `jobs` processes of one thread each; `perform` then finds it stored.

    The longest come first. Runs that take a number of threads are timed: they are left to `perform`, which has nothing
    else beside. A run that fails here is computed again by `perform`, which says so.

    Raises InputError as `perform` does, RunStopped after Ctrl-C.
    """
    from tqdm import tqdm

    check(cases, options)
    waiting = []
    for case in cases:
        for run in case.runs(options):
            if run.skip or "threads" in run.parameters or (options.only and not run.key.startswith(options.only)):
                continue
            folder = result_folder(options.results, case.name, run.key, run.function, run.parameters)
            if options.fresh or load(folder) is None:
                waiting.append((case, run, folder))
    waiting.sort(key=lambda item: -item[1].estimate)
    if not waiting:
        return
    context = multiprocessing.get_context("spawn")  # a forked process would inherit the threads of Numba's pool
    with ProcessPoolExecutor(min(jobs, len(waiting)), mp_context=context, initializer=_one_thread) as pool:
        futures = {
            pool.submit(_compute, case.name, run.key, run.function, dict(run.parameters), folder): run.key
            for case, run, folder in waiting
        }
        try:
            for done in tqdm(as_completed(futures), total=len(futures), desc="computing", mininterval=5.0):
                if done.exception() is not None:
                    print(f"{futures[done]}: {done.exception()}", file=sys.stderr)
        except KeyboardInterrupt:
            pool.shutdown(wait=True, cancel_futures=True)
            whole = sum(f.done() and not f.cancelled() and f.exception() is None for f in futures)
            raise interrupted(whole, options.results) from None


def _one_thread() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it without words; the parent says what is kept
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # before Numba is loaded


def _compute(case: str, key: str, function: Any, parameters: dict[str, Any], folder: Path) -> None:
    context, began = Context(threads=1), time.perf_counter()
    result = function(context, **parameters)
    seconds = time.perf_counter() - began
    about = about_run(case, Run(key, function, parameters), seconds, context)
    save(folder, Result(result.values, result.arrays, about))
