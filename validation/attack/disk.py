"""Runs on a disk that is full: a small tmpfs in a mount namespace of its own, or where none may be made, RLIMIT_FSIZE.

The run must stop in one sentence, with exit code 3, or get through. Then the disk gets larger and the run goes on.
"""

from __future__ import annotations

import functools
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from validation.attack.commands import compared, here, ill, reference, resume_command, run_command, verdict, write_tank

LIMITED = """import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
from refsim.__main__ import main
sys.exit(main(sys.argv[2:]))
"""
SMALL_DISK = """mount -t tmpfs -o size=$1 none "$2" || exit 9
shift; folder=$1; shift; kept=$1; shift
"$@" > "$kept/out" 2> "$kept/err"; echo $? > "$kept/code"
mount -o remount,size=64m "$folder" && cp -r "$folder/." "$kept/run"
"""


def make(seed: int, number: int) -> dict[str, Any]:
    """Bytes of the disk (pages of 4096 on a tmpfs) and how often there is a checkpoint."""
    draw = random.Random(f"disk {seed} {number}")
    return {"bytes": 4096 * draw.randint(1, 60), "checkpoint_every": draw.choice((0.001, 0.05, 60.0))}


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Run on the small disk, then go on without it."""
    whole = reference("--backend", "numpy")
    scene, kept = write_tank(folder), folder / "kept"
    kept.mkdir()
    every = ("--checkpoint-every", str(trial["checkpoint_every"]))
    run, disk = kept / "run", folder / "disk"
    if method() == "tmpfs":
        disk.mkdir()
        run.mkdir()
        inside = [sys.executable, "-m", "refsim", *run_command(scene, disk, "--backend", "numpy", *every)]
        command = [*_namespace(), "sh", "-c", SMALL_DISK, "sh", str(trial["bytes"]), str(disk), str(kept), *inside]
        subprocess.run(command, check=True, timeout=100)
        outcome, words = verdict(int((kept / "code").read_text()), (kept / "err").read_text())
    else:
        inside = run_command(scene, run, "--backend", "numpy", *every)
        command = [sys.executable, "-c", LIMITED, str(trial["bytes"]), *inside]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100)
        outcome, words = verdict(done.returncode, done.stderr)
    if outcome not in ("0", "3"):
        return ill(outcome, "code"), words
    there = any((run / name).exists() for name in ("checkpoint.h5", "checkpoint.previous.h5"))
    again = resume_command(run) if there else run_command(scene, run, "--backend", "numpy", "--overwrite")
    second, later = here(again)
    if second != "0":
        return ill(second), f"{words} Then: {later}"
    same = compared(run, whole)
    return same if same[0] != "0" else (outcome, words)


@functools.cache
def method() -> str:
    """How a full disk is made here: "tmpfs" or "RLIMIT_FSIZE"."""
    return "tmpfs" if _namespace() else "RLIMIT_FSIZE"


@functools.cache
def _namespace() -> tuple[str, ...]:
    if shutil.which("unshare") is None:
        return ()
    with tempfile.TemporaryDirectory() as folder:
        for command in (("unshare", "-Urm"), ("unshare", "-m")):
            script = 'mount -t tmpfs -o size=100k none "$1" && mount -o remount,size=200k "$1"'
            test = subprocess.run([*command, "sh", "-c", script, "sh", folder], capture_output=True)
            if test.returncode == 0:
                return command
    return ()
