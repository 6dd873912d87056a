"""Damaged files of a run: checkpoints, frames and their journal, the report; and meshes and tables that a scene names.

A trial damages one file in one place. The run is then resumed. It must reach the bits of the uninterrupted run, or
refuse in one sentence; while one of two checkpoints is whole, a resume from the folder may not refuse.
"""

from __future__ import annotations

import functools
import random
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from validation.attack.commands import (
    compared,
    here,
    ill,
    last_lines,
    reference,
    resume_command,
    run_command,
    write_tank,
)

RUN_FILES = (
    ("checkpoint.h5", 40),
    ("checkpoint.previous.h5", 10),
    ("particles.vtkhdf", 15),
    ("particles.vtkhdf.journal", 5),
    ("report.json", 5),
)
INPUTS = (("stone.obj", 3), ("stone.stl", 2), ("cloud.npy", 5), ("cloud.csv", 5))  # a mesh takes seconds
HALF, END = "0.02", "0.03"  # s of simulated time
HOW = ("bit", "byte", "zeros", "noise", "cut", "longer", "empty", "gone", "folder", "doubled", "swapped")
OBJ = """v 0 0 0
v .02 0 0
v 0 .02 0
v .02 .02 0
v 0 0 .02
v .02 0 .02
v 0 .02 .02
v .02 .02 .02
f 1 3 4
f 1 4 2
f 5 6 8
f 5 8 7
f 1 2 6
f 1 6 5
f 3 7 8
f 3 8 4
f 1 5 7
f 1 7 3
f 2 4 8
f 2 8 6
"""
MESH_SCENE = """dim = 3
spacing = 0.01
support_radius = 0.026
fluid = [{{shape = "box", lower = [0.1, 0.1, 0.1], cells = [3, 3, 3]}}]
[effects.weakly_compressible]
density = "summation"
sound_speed = 20.0
rest_density = 1000.0
[effects.mesh_boundary]
file = "{file}"
"""
CLOUD_SCENE = """dim = 2
spacing = 0.01
support_radius = 0.026
fluid = [{{shape = "cloud", file = "{file}"}}]
[effects.weakly_compressible]
density = "summation"
sound_speed = 20.0
rest_density = 1000.0
"""


def make(seed: int, number: int) -> dict[str, Any]:
    """A file, a damage and how the run goes on."""
    draw = random.Random(f"checkpoints {seed} {number}")
    names, weights = zip(*(RUN_FILES + INPUTS))
    file = draw.choices(names, weights)[0]
    damages = [drawn_damage(draw) for _ in range(draw.choice((1, 1, 1, 2)))]
    return {"file": file, "damages": damages, "resume": draw.choice(("folder", "folder", "file"))}


def drawn_damage(draw: random.Random, how: Sequence[str] = HOW) -> dict[str, Any]:
    """A damage; `at` and `length` are shares of the file."""
    return {"how": draw.choice(how), "at": draw.random(), "length": draw.random() ** 3, "value": draw.randrange(256)}


def damage(path: Path, damages: list[dict[str, Any]]) -> None:
    """Carry damages out, one after the other."""
    for d in damages:
        content = bytearray(path.read_bytes()) if path.is_file() else bytearray()
        place = min(int(d["at"] * len(content)), max(len(content) - 1, 0))
        end = min(place + max(1, int(d["length"] * 4096)), len(content))
        how = d["how"]
        if how == "bit" and content:
            content[place] ^= 1 << d["value"] % 8
        elif how == "byte" and content:
            content[place] = d["value"]
        elif how == "zeros":
            content[place:end] = bytes(end - place)
        elif how == "noise":
            content[place:end] = random.Random(d["value"]).randbytes(end - place)
        elif how == "cut":
            del content[place:]
        elif how == "longer":
            content += random.Random(d["value"]).randbytes(1 + int(d["length"] * 4096))
        elif how == "empty":
            content.clear()
        elif how == "doubled":
            content += bytes(content)
        elif how == "swapped":
            content[place:] = content[place:] + content[:place]
        path.unlink(missing_ok=True) if not path.is_dir() else shutil.rmtree(path)
        if how == "folder":
            path.mkdir()
        elif how != "gone":
            path.write_bytes(content)


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Damage a copy, and go on with it."""
    if trial["file"] in dict(INPUTS):
        return _input(trial, folder)
    base, whole = _base()
    run = folder / "run"
    shutil.copytree(base, run)
    before = {p.name: p.read_bytes() for p in run.iterdir() if p.is_file()}
    damage(run / trial["file"], trial["damages"])
    about = trial["file"]
    is_checkpoint = about.startswith("checkpoint")
    named = trial["resume"] == "file" and is_checkpoint
    until = ("--until", END)
    outcome, words = here(resume_command(run / about if named else run, "--output", str(run), *until))
    if outcome == "2" and any(d["how"] == "folder" for d in trial["damages"]):
        return outcome, words  # refsim deletes no folder that lies in the place of its file
    if outcome == "2" and is_checkpoint:
        if not named:
            return "lost", f"one of two checkpoints is whole, and the folder is refused: {words}"
        outcome, words = here(resume_command(run, *until))
        if outcome != "0":
            return ill(outcome), f"the folder was refused after the file: {words}"
    if outcome == "0":
        frames_kept = not about.startswith("particles")  # raw positions in a frame carry no digest
        wanted = whole if frames_kept else {"state": whole["state"]}
        same = compared(run, wanted)
        return same if same[0] != "0" else (outcome, words)
    if outcome == "2" and (run / "checkpoint.h5").read_bytes() != before["checkpoint.h5"]:
        return "lost", f"the resume was refused, and changed the checkpoint: {words}"
    return outcome, last_lines(words)


def _input(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    import numpy as np

    path = folder / trial["file"]
    if path.suffix == ".obj":
        path.write_text(OBJ)
    elif path.suffix == ".stl":
        import trimesh

        trimesh.creation.box((0.02, 0.02, 0.02)).export(path)
    else:
        points = np.array([[0.0, 0.0], [0.01, 0.0], [0.0, 0.01], [0.01, 0.01]])
        np.save(path, points) if path.suffix == ".npy" else np.savetxt(path, points, delimiter=",")
    damage(path, trial["damages"])
    scene = folder / "scene.toml"
    scene.write_text((MESH_SCENE if path.stem == "stone" else CLOUD_SCENE).format(file=path.name))
    return here(["plan", str(scene)])


@functools.cache
def _base() -> tuple[Path, dict[str, Any]]:
    """(folder of a run stopped in the middle with two checkpoints, what the whole run reaches); once a process."""
    folder = Path(tempfile.mkdtemp(prefix="refsim-attack-"))
    whole = reference("--backend", "numpy", "--until", END)
    scene = write_tank(folder)
    half = folder / "half"
    arguments = run_command(scene, half, "--backend", "numpy", "--until", HALF, "--checkpoint-every", "0.02")
    outcome, words = here(arguments)
    if outcome != "0" or not (half / "checkpoint.previous.h5").exists():
        raise RuntimeError(f"the run to be damaged failed: {outcome}: {words}")
    return half, whole
