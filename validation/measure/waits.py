"""Wall seconds of commands, each in a process of its own, after one that writes Python's byte code; the first frame is
the packaged dam break's start, for which kernels are compiled into an empty folder."""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from refsim.core.writing import write_file
from validation.reading import environment

ROOT = Path(__file__).resolve().parents[2]
COMMANDS = {
    "import": ("-c", "import refsim"), "advise": ("-m", "refsim", "advise", "front", "--error", "0.04"),
    "first frame": ("-m", "refsim", "run", f"{ROOT}/refsim/examples/dam_break_2d.toml", "--quiet", "--output", "run"),
}  # fmt: skip


def waited(command: tuple[str, ...]) -> float:
    """Wall seconds [s] until a command ends, or has written the first frame of its run."""
    with tempfile.TemporaryDirectory() as folder:
        paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        given = {"REFSIM_CACHE_DIR": f"{folder}/cache", "PYTHONDONTWRITEBYTECODE": "", "PYTHONPATH": paths}
        began, frame = time.perf_counter(), Path(folder, "run", "particles", "000000.vtp")
        with subprocess.Popen(
            [sys.executable, *command], env=os.environ | given, cwd=folder, stdout=subprocess.DEVNULL
        ) as process:
            while process.poll() is None and not frame.exists():
                time.sleep(0.002)
            seconds = time.perf_counter() - began
            process.kill()
        assert frame.exists() or process.returncode == 0, f"{' '.join(command)} ended with {process.returncode}"
        return seconds


def perform(given: argparse.Namespace) -> None:
    """The command."""
    seconds = {name: [waited(command) for _ in range(6)][1:] for name, command in COMMANDS.items()}
    kept = {name: environment(None, "cpu")[name] for name in ("date", "processor", "cores")} | {"seconds": seconds}
    write_file(given.output, json.dumps(kept, indent=1) + "\n")
    for name, taken in seconds.items():
        print(f"{name:<12} {statistics.median(taken):6.3f} s ({min(taken):.3f} to {max(taken):.3f})")
