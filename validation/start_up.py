"""What starting costs: a fresh process, with and without compiled kernels on the disk."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from validation.reading import measured
from validation.results import Result
from validation.running import Context

TIME_LIMIT = 300.0  # s


def start_up(context: Context, scenes: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None) -> Result:
    """Wall seconds of a process from its start to the end of its first two steps, cold and warm, scene by scene.

    scenes  words to {"module", "function", "parameters"} of what makes the scene; a function of plain parameters
    """
    starts = []
    for k, (words, made) in enumerate(scenes.items()):
        with tempfile.TemporaryDirectory() as cache:
            cold = _process({**made, "backend": backend, "threads": threads}, cache)
            context.progress((k + 0.8) / len(scenes))
            warm = _process({**made, "backend": backend, "threads": threads}, cache)
        context.progress((k + 1) / len(scenes))
        starts.append({"words": words, "cold": cold["whole"], "warm": warm["whole"],
                       "parts": {"cold": cold, "warm": warm}})  # fmt: skip
    return measured([], threads, backend, starts=starts)


def _process(spec: Mapping[str, Any], cache: str) -> dict[str, float]:
    root = str(Path(__file__).resolve().parent.parent)
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
    environment = {**os.environ, "REFSIM_CACHE_DIR": cache, "PYTHONPATH": path}
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", f"from validation.start_up import timed; timed({json.dumps(json.dumps(spec))})"],
        env=environment, capture_output=True, text=True, timeout=TIME_LIMIT, check=False,
    )  # fmt: skip
    whole = time.perf_counter() - began
    if done.returncode != 0:
        raise RuntimeError(f"a process that was to be timed ended with code {done.returncode}: {done.stderr[-500:]}")
    return {"whole": whole, **json.loads(done.stdout.splitlines()[-1])}


def timed(text: str) -> None:
    """In a process of its own: make the scene that the JSON names, take two steps, print the parts' seconds as JSON."""
    began, spec = time.perf_counter(), json.loads(text)
    scene = getattr(importlib.import_module(spec["module"]), spec["function"])(**spec["parameters"])
    from refsim import Simulation

    imported = time.perf_counter()
    simulation = Simulation(scene, backend=spec["backend"], threads=spec["threads"])
    simulation.step()
    first = time.perf_counter()
    simulation.step()
    simulation.backend.synchronize()
    end = time.perf_counter()
    print(json.dumps({"import": imported - began, "first_step": first - imported, "second_step": end - first}))
