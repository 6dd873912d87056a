"""What one setting of an accuracy panel gave, and where it was measured.

A panel's run functions return `measured(readings, ...)`. This module is small on purpose: stored results are reused
until a source behind their run function changes, and drawing or statistics are not among those.
"""

from __future__ import annotations

import datetime
import functools
import os
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from validation.results import Result


@dataclass(frozen=True)
class Reading:
    """One setting, measured one or more times.

    key, words    name within the panel, and the setting in words
    knobs         the setting as plain values: spacing, step (share of the stable one), dtype, backend ...
    error         distance of the observable from its reference; NaN where the run failed
    value         the observable itself (the error where it has no other value)
    seconds       wall seconds to that error, one for each repeat
    parts         the same seconds by part (start, list, step ...), which sum up to them
    beside        what comes on top and is not in `seconds`: output, or work that is done anyway
    per_step      wall seconds of a step, one for each repeat
    compile       seconds of starting and of every first call in this process; None where others had compiled before
    curve         {"wall": [...], "error": [...]} of a run whose error falls while it goes on
    distribution  {"what": {"median", "p99", "max"}} of quantities that each particle (or each datum) has
    stopped       why the setting failed, beginning with the reason's name; "" if it did not
    spent         seconds until it failed
    launches, bytes   operations that a step launches, and bytes of fields that a particle takes
    joules        energy of each repeat, where the machine counts it
    scene         digest of the scene
    expected      whether a failure is what the setting was to probe
    shown         whether it is a point of the panel; if not, its error alone is wanted
    noise         of its times, or of all readings of its key, see `validation.turns.Readings`; without, the times over
                  their median
    """

    key: str
    words: str
    knobs: Mapping[str, Any]
    error: float = float("nan")
    value: float = float("nan")
    seconds: Sequence[float] = ()
    parts: Mapping[str, Sequence[float]] = field(default_factory=dict)
    beside: Mapping[str, Sequence[float]] = field(default_factory=dict)
    per_step: Sequence[float] = ()
    compile: float | None = None
    curve: Mapping[str, Sequence[float]] = field(default_factory=dict)
    distribution: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    stopped: str = ""
    spent: float = 0.0
    particles: int = 0
    steps: int = 0
    launches: int | None = None
    bytes: int | None = None
    joules: Sequence[float] = ()
    scene: str = ""
    expected: bool = False
    shown: bool = True
    noise: Sequence[float] = ()

    def plain(self) -> dict[str, Any]:
        """What JSON takes."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


def measured(readings: Sequence[Reading], threads: int | None, backend: str, **more: Any) -> Result:
    """The result of a panel's run: its readings, and where they were measured."""
    return Result({"readings": [r.plain() for r in readings], "where": environment(threads, backend), **more})


def distribution(values: ArrayLike) -> dict[str, float]:
    """Median, 99th percentile and maximum of |values|; NaN for none."""
    size = np.abs(np.asarray(values, dtype=float)).ravel()
    if not size.size:
        return dict.fromkeys(("median", "p99", "max"), float("nan"))
    return {"median": float(np.median(size)), "p99": float(np.quantile(size, 0.99)), "max": float(size.max())}


def environment(threads: int | None, backend: str) -> dict[str, Any]:
    """Where and with what a reading was taken: versions, source, threads, clocks, load; the device's where one is used.

    What the machine does not tell is None.
    """
    from refsim.core.versions import versions

    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    found: dict[str, Any] = {
        "date": datetime.date.today().isoformat(),
        "backend": backend,
        "processor": processor(),
        "cores": cores,
        "threads": threads or cores,
        "threads_asked_for": {name: os.environ.get(name) for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS")},
        "clock_mhz": clocks(),
        "timer": time.get_clock_info("perf_counter").implementation,
        "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "versions": dict(versions()),
        "source": source(),
        "device": None,
    }
    if backend == "cuda":
        found["device"] = device()
    return found


@functools.cache
def processor() -> str:
    """The processor in words."""
    import platform

    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def clocks() -> dict[str, float] | None:
    """Lowest and highest clock of the cores now [MHz]."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        speeds = [float(line.split(":", 1)[1]) for line in lines if line.startswith("cpu MHz")]
    except (OSError, ValueError):
        return None
    return {"low": min(speeds), "high": max(speeds)} if speeds else None


@functools.cache
def source() -> dict[str, Any]:
    """Git commit of the sources and whether files differ from it; None each outside a checkout."""
    root = Path(__file__).resolve().parent.parent

    def git(*words: str) -> str | None:
        try:
            done = subprocess.run(
                ["git", "-C", str(root), *words], capture_output=True, text=True, timeout=10, check=False
            )
        except (OSError, subprocess.TimeoutExpired):
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    changed = git("status", "--porcelain", "--", "refsim", "validation")
    return {"commit": git("rev-parse", "HEAD"), "changed": None if changed is None else bool(changed)}


def device() -> dict[str, Any]:
    """The CUDA device, its driver and clocks, as the driver's own library tells them."""
    words = "name,driver_version,clocks.sm,clocks.max.sm,power.limit"
    try:
        done = subprocess.run(
            ["nvidia-smi", f"--query-gpu={words}", "--format=csv,noheader"],
            capture_output=True, text=True, timeout=20, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return {}
    return dict(zip(words.split(","), (part.strip() for part in done.stdout.splitlines()[0].split(","))))
