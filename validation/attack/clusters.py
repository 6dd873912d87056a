"""Sweeps through a Dask scheduler that is killed, or whose workers are; then the sweep is given again without it."""

from __future__ import annotations

import importlib.util
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from validation.attack import stores
from validation.attack.commands import ROOT, apart, ended, here, ill

WORKERS = 2
LONGEST = 12.0  # s until a kill
STARTS = 60.0  # s in which scheduler and workers must be there


def make(seed: int, number: int) -> dict[str, Any]:
    """What is killed, and when."""
    draw = random.Random(f"clusters {seed} {number}")
    return {"killed": draw.choice(("scheduler", "worker", "workers")), "delay": round(LONGEST * draw.random(), 3)}


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Kill, look at how the sweep ends, and go on from its store in processes of this machine."""
    if importlib.util.find_spec("distributed") is None:
        return "0", "Dask distributed is not installed"
    stores.write(folder)
    processes = start(folder)
    try:
        address = json.loads((folder / "scheduler.json").read_text())["address"]
        words = [word for word in stores.command("sweep", folder) if word not in ("--jobs", "1")]
        sweep = apart([*words, "--scheduler", address], folder=folder)
        until = time.monotonic() + trial["delay"]
        while time.monotonic() < until and sweep.poll() is None:
            time.sleep(0.01)
        for process in {"scheduler": processes[:1], "worker": processes[1:2], "workers": processes[1:]}[
            trial["killed"]
        ]:
            os.killpg(process.pid, signal.SIGKILL)
        if trial["killed"] == "workers":  # a sweep waits for others to come
            processes.append(worker(folder, WORKERS))
        outcome, said = ended(sweep)
    finally:
        for process in processes:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if outcome not in ("0", "3") and not (outcome == "2" and trial["killed"] == "scheduler"):  # it never connected
        return ill(outcome, "code"), said
    again, more = here(stores.command("sweep", folder))
    if again != "0":
        return ill(again), more
    whole, found = stores.values(stores.base("sweep") / "sweep"), stores.values(folder / "sweep")
    return (outcome, said) if found == whole else ("lost", f"{found} and not {whole}")


def start(folder: Path) -> list[subprocess.Popen[bytes]]:
    """A scheduler and its workers."""
    found = [dask(folder, "dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--no-show")]
    until = time.monotonic() + STARTS
    while not (folder / "scheduler.json").exists():
        if time.monotonic() > until:
            raise RuntimeError("the scheduler did not start")
        time.sleep(0.1)
    return found + [worker(folder, k) for k in range(WORKERS)]


def worker(folder: Path, number: int) -> subprocess.Popen[bytes]:
    """One more worker of one thread."""
    options = ("--no-nanny", "--nthreads", "1", "--name", f"worker {number}", "--local-directory", str(folder))
    return dask(folder, "dask_worker", *options)


def dask(folder: Path, program: str, *options: str) -> subprocess.Popen[bytes]:
    """A process of Dask, which may die loudly."""
    words = ["-m", f"distributed.cli.{program}", "--scheduler-file", str(folder / "scheduler.json"), "--no-dashboard"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    silent = subprocess.DEVNULL
    return subprocess.Popen(
        [sys.executable, *words, *options], env=environment, stdout=silent, stderr=silent, start_new_session=True
    )
