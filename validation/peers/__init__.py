"""Other programs on the same work, each in a process of its own.

A module of this package is one program: its `run` calls `launch`, which starts `python -m validation.peers.<module>` in
an empty folder; there `answer` calls the module's work with what `run` gave and stores what it returns.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent.parent


def lacking(module: str, package: str) -> str:
    """Why a program cannot run here, or ""."""
    installed = importlib.util.find_spec(module) is not None
    return "" if installed else f"{package} is not installed; run pip install {package}"


def launch(
    program: str, words: str, given: Mapping[str, Any], environment: Mapping[str, str], limit: float = 300.0,
    missing: str = "",
) -> dict[str, Any]:  # fmt: skip
    """What the work of a program returns in a process of its own, or {"missing": why}.

    program  the module's name; words: the program's. given: its parameters, plain values and arrays
    limit    seconds that it may take; missing: why it cannot run, or ""
    """
    if missing:
        return {"missing": missing}
    paths = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH", "")]))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write(folder, "given", given)
        try:
            done = subprocess.run(
                [sys.executable, "-m", f"validation.peers.{program}"],
                cwd=name, env={**os.environ, "PYTHONPATH": paths, **environment}, capture_output=True, text=True,
                timeout=limit, check=False,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            return {"missing": f"{words} did not run ({error})"}
        if done.returncode != 0 or not (folder / "answer.json").exists():
            last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
            return {"missing": f"{words} ended with code {done.returncode}: {last}"}
        return _read(folder, "answer")


def answer(work: Callable[..., Mapping[str, Any]]) -> None:
    """In the program's process: do the work on what was given, and leave the answer in the working folder."""
    _write(Path(), "answer", work(**_read(Path(), "given")))


def _write(folder: Path, name: str, values: Mapping[str, Any]) -> None:
    arrays = {key: value for key, value in values.items() if isinstance(value, np.ndarray)}
    np.savez(folder / f"{name}.npz", **arrays)
    plain = {key: value for key, value in values.items() if key not in arrays}
    (folder / f"{name}.json").write_text(json.dumps(plain))


def _read(folder: Path, name: str) -> dict[str, Any]:
    with np.load(folder / f"{name}.npz") as arrays:
        return {**json.loads((folder / f"{name}.json").read_text()), **arrays}
