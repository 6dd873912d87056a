"""Other programs on the same work, each in a process of its own.

A module of this package is one program: its `run` calls `launch`, which starts `python -m validation.peers MODULE` in
an empty folder; there the module's `work` gets what `run` gave, and what it returns is stored with the version.
"""

import importlib.metadata
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.writing import made_by, write_file

ROOT = Path(__file__).resolve().parent.parent.parent


PROGRAMS = {  # by module: the program in words, what it is imported as, and its distribution
    "pysplashsurf": ("pysplashsurf", "pysplashsurf", "pysplashsurf"), "taichi_mpm": ("Taichi", "taichi", "taichi"),
    "warp_sph": ("Warp", "warp", "warp-lang"),
    "pysph_flows": ("PySPH", "pysph", "pysph"),
} | dict.fromkeys(
    ("splishsplash", "splishsplash_sampling"),
    ("SPlisHSPlasH", "pysplishsplash", "pySPlisHSPlasH"),
)  # fmt: skip


def stopwatch() -> float:
    """Seconds of this process; those of the processor if it has one thread, which other work does not slow."""
    one = "1" in (os.environ.get("OMP_NUM_THREADS"), os.environ.get("RAYON_NUM_THREADS"))
    return time.process_time() if one else time.perf_counter()


def missing(module: str) -> str:
    """Why a program cannot run here, or ""."""
    _, name, package = PROGRAMS[module]
    there = importlib.util.find_spec(name) is not None
    return "" if there else f"{package} is not installed; run pip install {package}"


def in_turns(
    rounds: int, peer: Callable[[], Mapping[str, Any]], own: Callable[[], float], progress: Callable[[float], object],
    particles: float = 1.0,
) -> dict[str, Any]:  # fmt: skip
    """Seconds of two programs in turn, over `particles`: the peer's "seconds", and what `own` returns, in each round.

    {"missing": why}; or "" there, medians, least and largest of both, their ratios and the median of these.
    """
    spent: dict[str, list[float]] = {"refsim": [], "peer": []}
    answer: Mapping[str, Any] = {}
    for k in range(rounds):
        answer = peer()
        if "missing" in answer:
            return {"missing": answer["missing"]}
        spent["peer"].append(answer["seconds"] / particles)
        spent["refsim"].append(own() / particles)
        progress((k + 1) / rounds)
    spread = {n: {"median": float(np.median(s)), "low": min(s), "high": max(s)} for n, s in spent.items()}
    ratios = [b / a for a, b in zip(spent["refsim"], spent["peer"])]
    summary = {"missing": "", "version": answer["version"], "particles": particles, "rounds": rounds, **spread}
    return summary | {"ratios": ratios, "ratio": float(np.median(ratios))}


def launch(
    module: str, given: Mapping[str, Any], environment: Mapping[str, str] | None = None, limit: float = 300.0
) -> dict[str, Any]:
    """What the work of a program returns in a process of its own, with its "version", or {"missing": why}.

    given  its parameters, plain values and arrays; limit: seconds that it may take
    """
    if why := missing(module):
        return {"missing": why}
    title = PROGRAMS[module][0]
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write(folder, "given", given)
        try:
            done = subprocess.run(
                [sys.executable, "-m", "validation.peers", module],
                cwd=name, env={**os.environ, "PYTHONPATH": paths, **(environment or {})}, capture_output=True,
                text=True, timeout=limit, check=False,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            return {"missing": f"{title} did not run ({error})"}
        if done.returncode != 0 or not (folder / "answer.json").exists():
            last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
            return {"missing": f"{title} ended with code {done.returncode}: {last}"}
        return _read(folder, "answer")


def answer(module: str) -> None:
    """In the program's process: do the work on what was given, and leave the answer in the working folder."""
    result = importlib.import_module(f"{__name__}.{module}").work(**_read(Path(), "given"))
    _write(Path(), "answer", {**result, "version": importlib.metadata.version(PROGRAMS[module][2])})


def _write(folder: Path, name: str, values: Mapping[str, Any]) -> None:
    arrays = {key: value for key, value in values.items() if isinstance(value, np.ndarray)}
    write_file(folder / f"{name}.npz", made_by(np.savez, **arrays))
    plain = {key: value for key, value in values.items() if key not in arrays}
    write_file(folder / f"{name}.json", json.dumps(plain))


def _read(folder: Path, name: str) -> dict[str, Any]:
    with np.load(folder / f"{name}.npz") as arrays:
        return {**json.loads((folder / f"{name}.json").read_text(encoding="utf-8")), **arrays}
