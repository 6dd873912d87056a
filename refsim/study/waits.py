"""What a run's user waits beside its steps: starting Python, loading or compiling kernels, writing frames.

Measured by a short run of the scene in a process of its own, in seconds of its processor: other programs' do not count.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from refsim.core.effect import Extremes
from refsim.engine.stepping import stable_steps, step_limits
from refsim.scene.files import scene_to_toml
from refsim.scene.plan import Plan

STEPS, FRAMES = 12, 6  # of the short run, about
USUAL_FRAMES = 101  # of a run without --every
KEPT = ("writing", "checkpoints")  # of frames that are held until then, so few times in a run


def waits(plan: Plan, backend: str, threads: int | None = None) -> dict[str, float]:
    """Seconds of "start", "loading" and "writing" of a run of the scene as `refsim run` does it; none if it fails."""
    scene = plan.scene
    length = scene.step or min(stable_steps(step_limits(plan), Extremes(0.0, 0.0)).values()) * scene.step_factor
    until = min(scene.end_time, STEPS * length)
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder, "scene.toml"), Path(folder, "out")
        file.write_text(scene_to_toml(scene), encoding="utf-8")
        given = ["--backend", backend, "--until", repr(until), "--every", repr(until / FRAMES), "--output", str(out)]
        given += [] if threads is None else ["--threads", str(threads)]
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        command = [sys.executable, "-m", "refsim", "run", str(file), "--quiet", *given]
        run = subprocess.run(command, capture_output=True, env=dict(os.environ), check=False)
        took, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
        if run.returncode != 0:
            return {}
        report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return parts(report["seconds"], report["frames"], used, took)


def parts(seconds: dict[str, Any], frames: int, used: float, took: float) -> dict[str, float]:
    """The parts from a short run's report and the processor's and the clock's seconds of its process.

    Its report has seconds of the clock; the processor's are taken to be in proportion in each part of the run.
    """
    stages = seconds["stages"]
    frame = stages.get("frames", 0.0) / max(frames, 1)
    kept = sum(stages.get(name, 0.0) for name in KEPT)
    run = sum(stages.values()) + seconds["compiling"]
    share = min(1.0, used / took)
    return {
        "start": max(used - share * run, 0.0),
        "loading": share * seconds["compiling"],
        "writing": share * (frame * USUAL_FRAMES + kept),
    }
