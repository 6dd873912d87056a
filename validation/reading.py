"""What was measured of a setting, where and with what."""

import datetime
import functools
import math
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

from refsim.core.versions import commit, versions
from refsim.study.runs import Reading


def reading(value: float = math.nan, seconds: float = 0.0, steps: int = 0, particles: int = 0, failed: str = "",
            held: int = 0) -> Reading:  # fmt: skip
    """What one run of a setting gave; `held` bytes."""
    return Reading(value, seconds, seconds, held, particles, steps, 0.0, failed=failed)


def environment(threads: int | None, backend: str) -> dict[str, Any]:
    """Date, backend, processor, cores, threads, load, versions, commit; the device's name and driver where one is used.

    What the machine does not tell is None.
    """
    return {
        "date": datetime.date.today().isoformat(), "backend": backend, "processor": processor(), "cores": cores(),
        "threads": threads or cores(), "load": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "versions": dict(versions()), "commit": commit(), "device": device() if backend == "cuda" else None,
    }  # fmt: skip


def cores() -> int | None:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


@functools.cache
def processor() -> str:
    """The processor in words."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def device() -> dict[str, str]:
    """Name and driver of the CUDA device, as the driver's own library tells them."""
    columns = ("name", "driver_version")
    said = output_of("nvidia-smi", f"--query-gpu={','.join(columns)}", "--format=csv,noheader") or ""
    return dict(zip(columns, (part.strip() for part in said.partition("\n")[0].split(","))))


def output_of(*command: str) -> str | None:
    """What a program prints; None where it is not there or fails."""
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=20, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
