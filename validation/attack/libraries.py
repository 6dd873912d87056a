"""Libraries that break what judges them, for `refsim contract`: each has the ending that the command must give it.

Beside the broken program each library has a sound one, which must hold.
"""

from __future__ import annotations

import json
import random
import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

from validation.attack.commands import apart, ill, last_lines, verdict

SOUND = "def gravity(field, acceleration):\n    acceleration += field\n"
PROGRAMS = "PROGRAMS = {'sph.state': broken, 'sph.gravity': gravity}\n"
STATE = "density, fluid, pressure"
LIMIT = "3"
LIBRARIES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())  # by group and name: code, words


def kinds() -> list[tuple[str, str]]:
    """(group, name) of every library."""
    return [(group, name) for group, members in LIBRARIES.items() for name in members]


def make(seed: int, number: int) -> dict[str, Any]:
    """The kinds in turn."""
    order = kinds()
    random.Random(f"libraries {seed}").shuffle(order)
    group, name = order[number % len(order)]
    return {"group": group, "name": name}


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Judge the library by the command, and the command by what it says."""
    group, name = trial["group"], trial["name"]
    body, words = LIBRARIES[group][name]["code"], LIBRARIES[group][name]["says"]
    if group == "import":
        text = f"{body}\n{SOUND}PROGRAMS = {{'sph.gravity': gravity}}\n"
    elif group == "table":
        text = f"{SOUND}{body}"
    else:
        right = "" if group == "program" else f"    RIGHT({STATE})\n"
        head = "from refsim.core.operation import REGISTRY\nRIGHT = REGISTRY['sph.state'].program('cpu').py_func\n"
        text = f"{head}{SOUND}def broken({STATE}):\n    {body}\n{right}{PROGRAMS}"
    (folder / "library.py").write_text(text)
    options = ("--step", "T1", "--step", "T7", "--dtype", "float64", "--time-limit", LIMIT, "--json")
    process = apart(["contract", str(folder / "library.py"), *options])
    try:
        out, err = process.communicate(timeout=100)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return "hang", "no end within 100 s"
    quiet = "\n".join(line for line in err.splitlines() if line.startswith("refsim: ") or "refsim/" in line)
    outcome, said = verdict(process.returncode, quiet)
    wanted = {"import": "2", "table": "2", "program": "4", "harmless": "0"}[group]
    if outcome != wanted:
        return ill(outcome, "code"), f"{outcome} and not {wanted}: {said} {last_lines(err)}"
    if group in ("import", "table"):
        return (outcome, said) if re.search(words, said) else ("sentence", said)
    operations = json.loads(out)["operations"]
    if not operations["sph.gravity"]["holds"]:
        return "lost", f"the sound program beside it was not judged well: {operations['sph.gravity']}"
    told = " ".join(o["words"] for o in operations["sph.state"]["outcomes"])
    return (outcome, last_lines(told)) if re.search(words, told) else ("sentence", last_lines(told))
