"""Runs that are killed (SIGKILL) at random moments, up to three times, and then go on to their end."""

from __future__ import annotations

import random
import time
from pathlib import Path
from typing import Any

from validation.attack.commands import apart, compared, ended, ill, reference, resume_command, run_command, write_tank

LONGEST = 3.0  # s until a kill; a whole run takes about as long


def make(seed: int, number: int) -> dict[str, Any]:
    """Seconds after which each start is killed, how often there is a checkpoint, and the backend."""
    draw = random.Random(f"kills {seed} {number}")
    return {
        "delays": [round(LONGEST * draw.random(), 3) for _ in range(draw.choice((1, 1, 2, 3)))],
        "checkpoint_every": draw.choice((0.001, 0.02, 0.1, 60.0)),
        "backend": draw.choice(("numpy", "numpy", "cpu")),
    }


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Kill, go on, and compare with the uninterrupted run."""
    whole = reference("--backend", trial["backend"])
    run, scene = folder / "run", write_tank(folder)
    for delay in trial["delays"]:
        process = apart(_next(scene, run, trial))
        until = time.monotonic() + delay
        while time.monotonic() < until and process.poll() is None:
            time.sleep(0.002)
        if process.poll() is None:
            process.kill()
            process.communicate()
        else:
            outcome, words = ended(process)
            if outcome != "0":
                return ill(outcome), words
    outcome, words = ended(apart(_next(scene, run, trial)))
    if outcome != "0":
        return ill(outcome), words
    return compared(run, whole)


def _next(scene: Path, run: Path, trial: dict[str, Any]) -> list[str]:
    """Resume if there is a checkpoint, else begin anew, which a user must allow once there is a report."""
    more = ("--checkpoint-every", str(trial["checkpoint_every"]))
    if any((run / name).exists() for name in ("checkpoint.h5", "checkpoint.previous.h5")):
        return resume_command(run, *more)
    return run_command(scene, run, "--backend", trial["backend"], "--overwrite", *more)
