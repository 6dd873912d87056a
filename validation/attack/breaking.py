"""Trials that break the process that performs them: tests see by them that the campaign notices. None of `KINDS`."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any


def make(seed: int, number: int) -> dict[str, Any]:
    """The number is the trial."""
    return {"number": number}


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """1 ends the process, 2 does not return, 3 raises; the others are well."""
    if trial["number"] == 1:
        os.abort()
    if trial["number"] == 2:
        time.sleep(1000)
    if trial["number"] == 3:
        raise ValueError("no")
    return "0", ""
