"""Damaged stores of sweeps and studies: the same command must reach the same values, and say what was damaged."""

from __future__ import annotations

import functools
import io
import json
import random
import shutil
import tempfile
from pathlib import Path
from typing import Any

from validation.attack.checkpoints import damage, drawn_damage
from validation.attack.commands import here, ill

SCENE = """dim = 2
spacing = 0.01
support_radius = 0.026
end_time = 0.004
[[fluid]]
shape = "box"
cells = [4, 8, 1]
[effects.weakly_compressible]
density = "summation"
sound_speed = 20.0
[effects.gravity]
acceleration = [0.0, -9.81, 0.0]
"""
SWEEP = """scene = "scene.toml"
observable = "kinetic_energy"
backend = "numpy"
[grid]
"effects.weakly_compressible.sound_speed" = [20.0, 21.0, 22.0]
"""
LEVELS = ("--observable", "kinetic_energy", "--levels", "3", "--knobs", "spacing", "--ratio", "2", "--backend", "numpy")


def write(folder: Path) -> None:
    """The scene and the sweep file."""
    (folder / "scene.toml").write_text(SCENE)
    (folder / "sweep.toml").write_text(SWEEP)


def command(name: str, folder: Path) -> list[str]:
    """A sweep or a study of the scene in the folder, whose results stand in a folder of its name."""
    given = (str(folder / "sweep.toml"), "--jobs", "1") if name == "sweep" else (str(folder / "scene.toml"), *LEVELS)
    return [name, *given, "--output", str(folder / name), "--quiet"]


def values(folder: Path) -> dict[str, float]:
    """The value of every result file."""
    return {path.name: json.loads(path.read_text())["reading"]["value"] for path in sorted(folder.glob("*.json"))}


def make(seed: int, number: int) -> dict[str, Any]:
    """A command, which of its result files, and a damage."""
    draw = random.Random(f"stores {seed} {number}")
    one = drawn_damage(draw)
    return {"command": draw.choice(("sweep", "sweep", "study")), "file": draw.randrange(3), "damages": [one]}


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Damage a result of a copy, and give the command again."""
    name = trial["command"]
    shutil.copytree(base(name), folder, dirs_exist_ok=True)
    write(folder)
    whole = values(folder / name)
    path = sorted((folder / name).glob("*.json"))[trial["file"]]
    before = path.read_bytes()
    damage(path, trial["damages"])
    changed = path.is_file() and path.read_bytes() != before
    said = io.StringIO()
    outcome, words = here(command(name, folder), said)
    if outcome == "2" and path.is_dir():
        return outcome, words  # refsim deletes no folder that lies in the place of its file
    if outcome != "0":
        return ill(outcome), words
    if values(folder / name) != whole:
        return "lost", f"{values(folder / name)} and not {whole}"
    told = path.name in said.getvalue() and any(path.parent.glob(f"{path.name}.damaged*"))
    return ("silent", "the damage is not said, or the file not kept") if changed and not told else (outcome, words)


@functools.cache
def base(name: str) -> Path:
    """Folder with the results of the undisturbed command; once a process."""
    folder = Path(tempfile.mkdtemp(prefix="refsim-attack-"))
    write(folder)
    outcome, words = here(command(name, folder))
    if outcome != "0":
        raise RuntimeError(f"the undisturbed {name} failed: {outcome}: {words}")
    return folder
