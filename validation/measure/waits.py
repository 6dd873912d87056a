"""What a user waits for: `python -m validation measure waits` stores wall seconds of commands, for docs/study.md.

Each runs as a process of its own, after one that writes Python's byte code. The first frame is the file of the packaged
dam break's start; its kernels are compiled into an empty folder before.
"""

from __future__ import annotations

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
SCENE = str(ROOT / "refsim" / "examples" / "dam_break_2d.toml")
COMMANDS = {
    "import": ("-c", "import refsim"), "advise": ("-m", "refsim", "advise", "front", "--error", "0.04"),
    "first frame": ("-m", "refsim", "run", SCENE, "--quiet"),
}  # fmt: skip
TURNS = 5


def waited(command: tuple[str, ...]) -> float:
    """Wall seconds [s] until a command ends, or has written the first frame of its run."""
    with tempfile.TemporaryDirectory() as folder:
        paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        given_to = {"REFSIM_CACHE_DIR": f"{folder}/cache", "PYTHONDONTWRITEBYTECODE": "", "PYTHONPATH": paths}
        began, frame = time.perf_counter(), Path(folder, "run", "particles", "000000.vtp")
        given = [sys.executable, *command, *(("--output", f"{folder}/run") if "run" in command else ())]
        with subprocess.Popen(given, env=os.environ | given_to, stdout=subprocess.DEVNULL, cwd=folder) as process:
            while process.poll() is None and not frame.exists():
                time.sleep(0.002)
            seconds = time.perf_counter() - began
            if process.poll() is None:
                process.kill()
            elif process.returncode or "run" in command:
                raise RuntimeError(f"{' '.join(given)} ended with {process.returncode}, without a frame")
        return seconds


def perform(given: argparse.Namespace) -> None:
    """The command."""
    seconds = {name: [waited(command) for _ in range(1 + TURNS)][1:] for name, command in COMMANDS.items()}
    about = environment(None, "cpu")
    kept = {name: about[name] for name in ("date", "processor", "cores")} | {"seconds": seconds}
    write_file(given.output, json.dumps(kept, indent=1) + "\n")
    for name, taken in seconds.items():
        print(f"{name:<12} {statistics.median(taken):6.3f} s ({min(taken):.3f} to {max(taken):.3f})")
