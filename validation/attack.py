"""Attacks on refsim: drawn scenes, damaged files and killed runs; `python -m validation attack`.

Hypothesis draws the trials, makes one that fails smaller, and keeps it in `--out`, where the next campaign tries it
first. A command may end well or with one sentence (exit codes 0, 2, 3); a state that was on the disk may not get lost,
and a resumed run has the bits of the uninterrupted one.
"""

import argparse
import contextlib
import faulthandler
import functools
import io
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import traceback
import types
import typing
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import hypothesis
import msgspec
import numpy as np
from hypothesis import strategies as st
from hypothesis.database import DirectoryBasedExampleDatabase

from refsim.core.effect import EFFECTS
from refsim.core.errors import InputError
from refsim.core.writing import made_by, write_file
from refsim.io.checkpoint import read_checkpoint
from refsim.io.results import open_run
from refsim.scene import shapes, solids
from refsim.scene.scene import Scene

ROOT = Path(__file__).resolve().parent.parent
MEMORY = 8 << 30  # bytes of address space of a campaign
LONGEST = 120.0  # s that one trial may take

# Scenes: some that run with a few values changed, others drawn from their types, others damaged as text

LIQUID = {"rest_density": 1000.0, "sound_speed": 20.0, "dynamic_viscosity": 2.2, "density": "summation"}
BASE = {"spacing": 0.01, "support_radius": 0.026, "end_time": 0.01}
BLOCK = [{"shape": "box", "lower": [0.02, 0.02, 0.02], "cells": [3, 3, 3]}]
FLAT = [{"shape": "box", "lower": [0.02, 0.02, 0.0], "cells": [5, 5, 1]}]
WALLS = {"lower": [0.0, 0.0, 0.0], "upper": [0.1, 0.1, 0.1]}
WEIGHT = {"acceleration": [0.0, -9.81, 0.0]}
TENSION = {"surface_tension": 0.07}
SCENES: list[dict[str, Any]] = [
    BASE | {"dim": 2, "fluid": FLAT, "effects": {
        "weakly_compressible": LIQUID, "gravity": WEIGHT, "box_walls": WALLS | {"upper": [0.1, 0.1, 0.0]}}},
    *(BASE | {"dim": 2, "fluid": FLAT, "effects": {"weakly_compressible": LIQUID, tension: TENSION}}
      for tension in ("becker_teschner_2007", "csf_wang_2019", "tartakovsky_meakin_2005")),
    *(BASE | {"fluid": BLOCK, "effects": {"weakly_compressible": LIQUID, tension: TENSION, "surface_detection": {}}}
      for tension in ("jiang_zhu_2023", "akinci_2013", "he_2014")),
    BASE | {"fluid": BLOCK, "effects": {"mpm_liquid": {"bulk_modulus": 2500.0}, "mpm_walls": WALLS, "gravity": {}}},
    BASE | {"fluid": BLOCK, "effects": {"iisph": {}, "weakly_compressible": LIQUID, "gravity": {}}, "dtype": "float64"},
    BASE | {"solid": [{"shape": "ball", "center": [0.05, 0.05, 0.05], "radius": 0.02}], "fluid": [],
            "effects": {"weakly_compressible": LIQUID, "shape_matching": {}, "gravity": {}, "box_walls": WALLS}},
    BASE | {"fluid": [{"shape": "box", "lower": [0.1, 0.1, 0.1], "cells": [3, 3, 3]}],
            "effects": {"weakly_compressible": LIQUID, "mesh_boundary": {"file": "stone.obj"}}},
    BASE | {"dim": 2, "fluid": [{"shape": "cloud", "file": "cloud.npy"}], "effects": {"weakly_compressible": LIQUID}},
]  # fmt: skip
PARTS = {kind.__struct_config__.tag: kind for kind in (
    shapes.Box, shapes.Ball, shapes.Cloud, solids.SolidBox, solids.SolidBall, solids.SolidTorus, solids.SolidMesh,
    solids.SolidCells)}  # fmt: skip
NUMBERS = st.floats(1e-3, 1e3) | st.floats() | st.integers() | st.sampled_from((0, 1, 2**31, 2**63, 10**30, 5e-324))
TEXTS = st.text(max_size=8) | st.sampled_from(
    ("stone.obj", "nowhere.obj", ".", "../..", "cloud.csv", "cloud.npy", "pipe", "/dev/zero", "x" * 5000, "float16")
)
ANY = st.recursive(NUMBERS | TEXTS | st.booleans(), lambda inside: st.lists(inside, max_size=4), max_leaves=9)


def values(kind: Any) -> st.SearchStrategy[Any]:
    """Values of a type as TOML holds them; one in twenty is of any type."""
    return st.integers(0, 19).flatmap(lambda k: _values(kind) if k else ANY)


@functools.cache
def _values(kind: Any) -> st.SearchStrategy[Any]:
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Literal:
        return st.sampled_from(inside)
    if origin in (typing.Union, types.UnionType):
        return st.one_of([values(each) for each in inside if each is not types.NoneType])
    if origin is typing.Annotated:
        return values(inside[0])
    if origin is tuple and inside[-1:] != (...,):
        return st.tuples(*map(values, inside)).map(list)
    if origin in (tuple, list, set, frozenset):
        return st.lists(values(inside[0]), max_size=3)
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return tables(kind)
    known = {bool: st.booleans(), int: st.integers(1, 4) | st.integers(), float: NUMBERS, str: TEXTS}
    return known.get(kind, ANY)


def tables(kind: Any) -> st.SearchStrategy[dict[str, Any]]:
    """Tables of a struct: the keys that it must have, and some of the others."""
    fields = {field.name: field for field in msgspec.structs.fields(kind)}
    given = {name: values(field.type) for name, field in fields.items()}
    tag = {} if kind not in PARTS.values() else {"shape": st.just(kind.__struct_config__.tag)}
    return st.fixed_dictionaries(
        {name: made for name, made in given.items() if fields[name].required} | tag,
        optional={name: made for name, made in given.items() if not fields[name].required},
    )


@st.composite
def altered(draw: Callable[[st.SearchStrategy[Any]], Any]) -> dict[str, Any]:
    """A scene that runs, with up to three changes."""
    scene = json.loads(json.dumps(draw(st.sampled_from(SCENES))))
    for _ in range(draw(st.integers(0, 3))):
        parts = [part for key in ("fluid", "solid") for part in scene.get(key, ()) if isinstance(scene[key], list)]
        inside = [(part, PARTS.get(part["shape"])) for part in parts if isinstance(part.get("shape"), str)]
        effects = scene.get("effects", {})
        inside += [(table, EFFECTS.get(name)) for name, table in effects.items() if isinstance(table, dict)]
        table, kind = draw(st.sampled_from([(scene, Scene), *inside]))
        fields = {field.name: field.type for field in msgspec.structs.fields(kind)} if kind else {}
        if draw(st.booleans()) and fields:
            name = draw(st.sampled_from([name for name in fields if name != "effects"]))
            table[name] = draw(values(fields[name]))
        elif draw(st.booleans()):
            name = draw(st.sampled_from(sorted(EFFECTS)))
            effects[name] = draw(tables(EFFECTS[name]))
        elif draw(st.booleans()):
            table[draw(TEXTS | st.sampled_from(("spacing", "radius", "shape")))] = draw(ANY)
        elif table is not scene and table:
            del table[draw(st.sampled_from(sorted(table)))]
    return scene


@st.composite
def damaged(draw: Callable[[st.SearchStrategy[Any]], Any]) -> bytes:
    """The text of a scene with a part cut out, and bytes put in."""
    text = written(draw(st.sampled_from(SCENES))).encode()
    place = draw(st.integers(0, len(text)))
    more = draw(st.binary(max_size=9) | st.sampled_from((b"[" * 5000, b"'''", b"\xef\xbb\xbf", b"\r", text)))
    return text[:place] + more + text[place + draw(st.integers(0, 30)) :]


def written(value: Any) -> str:
    """TOML; tables in tables stand in one line."""
    if isinstance(value, bool | str):
        return json.dumps(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_inline, value))}]"
    return "".join(f"{json.dumps(key)} = {_inline(each)}\n" for key, each in value.items())


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_inline(each)}" for key, each in value.items()) + "}"
    return repr(value) if isinstance(value, int | float) and not isinstance(value, bool) else written(value)


def drawn_scenes() -> st.SearchStrategy[bytes]:
    """Scene files."""
    whole = tables(Scene).map(lambda scene: BASE | scene)
    return (altered() | altered() | whole).map(lambda scene: written(scene).encode()) | damaged()


def plan(text: bytes, folder: Path) -> str:
    """Plan the scene, and run three steps of a small one."""
    inputs(folder)
    path = folder / "scene.toml"
    write_file(path, text)
    code, output = outcome_of(["plan", str(path), "--json"])
    if code == 0 and json.loads(output)["particles"] <= 200:
        run = ("run", str(path), "--output", str(folder / "run"), "--backend", "numpy", "--until", "1e-9", "--quiet")
        code, _ = outcome_of(run)
    return str(code)


# Files: of a run that stopped in the middle, and those that a scene names

TANK = BASE | {
    "dim": 2, "end_time": 0.06, "fluid": [{"shape": "box", "cells": [5, 8, 1]}], "effects": SCENES[0]["effects"],
}  # fmt: skip
CORNERS = [[x, y, z] for z in (0, 0.02) for y in (0, 0.02) for x in (0, 0.02)]
FACES = "134 142 568 587 126 165 378 384 157 173 248 286"
RUN = ("checkpoint.h5", "checkpoint.previous.h5", "particles/000003.vtp", "particles/origin.h5", "report.json")
INPUTS = {"stone.obj": "mesh_boundary", "cloud.npy": "cloud", "cloud.csv": "cloud"}


class Damage(NamedTuple):
    """What is done to a file, `at` a place in ten thousandths of it, with so many bytes."""

    how: str
    at: int = 0
    length: int = 1
    value: int = 0

    def of(self, content: bytes) -> bytes:
        """The content with the damage."""
        place = self.at * len(content) // 10_000
        end = place + self.length
        head, part, tail = content[:place], content[place:end], content[end:]
        made = {
            "flipped": bytes(byte ^ 1 << self.value % 8 for byte in part[:1]) + part[1:],
            "zeros": bytes(len(part)), "noise": np.random.default_rng(self.value).bytes(len(part)),
            "longer": part + bytes([self.value]) * 4096, "swapped": part + tail + head,
            "doubled": part + tail + content,
        }  # fmt: skip
        return b"" if self.how == "empty" else head if self.how == "cut" else head + made[self.how] + tail


HOW = ("flipped", "zeros", "noise", "cut", "longer", "empty", "gone", "folder", "doubled", "swapped")


def drawn_files() -> st.SearchStrategy[tuple[str, list[Damage], bool]]:
    """A file, what is done to it, and whether a run is resumed from the file and not from its folder.

    By a number of random.Random: drawn one by one, places in files crowd at the ends.
    """

    def made(number: int) -> tuple[str, list[Damage], bool]:
        draw = random.Random(number)
        damages = [
            Damage(draw.choice(HOW), draw.randrange(10_000), 1 + int(4096 * draw.random() ** 3), draw.randrange(256))
            for _ in range(draw.choice((1, 1, 2)))
        ]
        return draw.choice((*RUN[:2], *RUN, *INPUTS)), damages, draw.random() < 0.5

    return st.integers(0, 2**32).map(made)


def resume(trial: tuple[str, list[Damage], bool], folder: Path) -> str:
    """Damage a file and go on: to the bits of the uninterrupted run, or not at all, and not if one state is whole."""
    name, damages, by_file = trial
    inputs(folder)
    if name in INPUTS:
        spoil(folder / name, damages)
        (scene,) = (scene for scene in SCENES if f'"{name[:5]}' in json.dumps(scene) and scene is not SCENES[0])
        path = folder / "scene.toml"
        write_file(path, written(scene).replace("cloud.npy", name))
        return str(outcome_of(["plan", str(path)])[0])
    half, whole = _half()
    run, checkpoint = folder / "run", name.startswith("checkpoint")
    shutil.copytree(half, run)
    spoil(run / name, damages)
    before = (run / "checkpoint.h5").read_bytes() if (run / "checkpoint.h5").is_file() else b""
    given = str(run / name if by_file and checkpoint else run)
    code, output = outcome_of(["run", "--resume", given, "--output", str(run), "--every", "0.005", "--quiet"])
    if code == 2 and any(damage.how == "folder" for damage in damages):
        return "2"  # refsim deletes no folder that lies in the place of its file
    if code == 2 and checkpoint:
        assert given != str(run), f"one of two checkpoints is whole, and the folder is refused: {output}"
        code, output = outcome_of(["run", "--resume", str(run), "--every", "0.005", "--quiet"])
        assert code == 0, output
    if code == 0:
        after = reached(run, frames=not name.startswith("particles"))  # a frame that is damaged stays as it is
        same = {key: after[key] == whole[key] for key in after}
        assert all(same.values()), f"other bits than the uninterrupted run's: {same}"
    else:
        assert (run / "checkpoint.h5").read_bytes() == before, f"refused, and changed the checkpoint: {output}"
    return str(code)


def spoil(path: Path, damages: Sequence[Damage]) -> None:
    """Carry damages out, one after the other."""
    for damage in damages:
        content = path.read_bytes() if path.is_file() else b""
        shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
        if damage.how == "folder":
            path.mkdir()
        elif damage.how != "gone":
            write_file(path, damage.of(content))


def inputs(folder: Path) -> None:
    """Files that scenes may name."""
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"f {' '.join(face)}" for face in FACES.split()]
    write_file(folder / "stone.obj", "\n".join(lines))
    points = np.array([[0.0, 0.0], [0.01, 0.0], [0.0, 0.01], [0.01, 0.01]])
    write_file(folder / "cloud.npy", made_by(np.save, points))
    write_file(folder / "cloud.csv", made_by(np.savetxt, points, delimiter=","))
    os.mkfifo(folder / "pipe")


# Stops: a run that is killed once or more, and given again

SIGNALS = ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP")


def drawn_stops() -> st.SearchStrategy[tuple[list[tuple[str, float]], float]]:
    """Signals, each some seconds after a start, and how often there is a checkpoint [s]."""
    stop = st.tuples(st.sampled_from(SIGNALS), st.floats(0, 3))
    return st.tuples(st.lists(stop, min_size=1, max_size=3), st.sampled_from((0.001, 0.02, 60.0)))


def stop(trial: tuple[list[tuple[str, float]], float], folder: Path) -> str:
    """Stop the run as often as that, let it end, and compare."""
    import signal

    stops, every = trial
    run, whole = folder / "run", _half()[1]
    write_file(folder / "tank.toml", written(TANK))
    for name, delay in (*stops, ("", LONGEST)):
        there = any((run / file).exists() for file in RUN[:2])
        arguments = ["--resume", str(run)] if there else [*start(folder, run), "--overwrite"]
        command = [sys.executable, "-m", "refsim", "run", *arguments, "--every", "0.005", "--quiet"]
        around = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_NUM_THREADS": "1"}
        process = subprocess.Popen(
            [*command, "--checkpoint-every", str(every)], env=around, text=True, stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            _, said = process.communicate(timeout=delay)
        except subprocess.TimeoutExpired:
            assert name, f"no end within {LONGEST:g} s"
            process.send_signal(getattr(signal, name))
            _, said = process.communicate(timeout=LONGEST)
        early = process.returncode == -getattr(signal, name or "SIGKILL") and not said  # before refsim heeds it
        assert process.returncode in (0, 3) or (name and early), f"exit code {process.returncode}: {said[-1500:]}"
    assert process.returncode == 0, said
    assert reached(run) == whole, "other bits than the uninterrupted run's"
    return "0"


def start(folder: Path, run: Path) -> list[str]:
    """Words that begin the run of the tank, 40 particles and some 150 steps."""
    return [str(folder / "tank.toml"), "--output", str(run), "--backend", "numpy"]


@functools.cache
def _half() -> tuple[Path, dict[str, Any]]:
    """(folder of a run stopped in the middle with two checkpoints, what the whole run reaches); once a process."""
    folder = Path(tempfile.mkdtemp(prefix="refsim-attack-"))
    write_file(folder / "tank.toml", written(TANK))
    for name, more in (("whole", ()), ("half", ("--until", "0.03", "--checkpoint-every", "0.02"))):
        command = ["run", *start(folder, folder / name), "--every", "0.005", "--quiet", *more]
        code, output = outcome_of(command)
        assert code == 0, output
    assert (folder / "half" / RUN[1]).exists()
    return folder / "half", reached(folder / "whole")


def reached(run: Path, frames: bool = True) -> dict[str, Any]:
    """What a run is compared by: the final state and, unless it shall not, the frames, bit for bit."""
    saved = read_checkpoint(run / "checkpoint.h5")
    clock = json.loads(str(saved.attributes["clock"]))
    state = {name: clock[name] for name in ("time", "steps", "previous_length")}
    reached_state = {"arrays": {name: each.tobytes() for name, each in saved.arrays.items()}, "state": state}
    return reached_state | ({"frames": [(f.time, f.position.tobytes()) for f in open_run(run)]} if frames else {})


# The campaign

KINDS: dict[str, tuple[Callable[[], st.SearchStrategy[Any]], Callable[[Any, Path], str], int]] = {
    "scenes": (drawn_scenes, plan, 200),  # strategy, what is done, trials of a turn
    "files": (drawn_files, resume, 60),
    "stops": (drawn_stops, stop, 8),
}


def outcome_of(arguments: Sequence[str]) -> tuple[int, str]:
    """(exit code, what was printed or the sentence) of a command in this process; AssertionError for a bad ending."""
    from refsim.__main__ import main

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        code = main(list(arguments))
    said = [line for line in err.getvalue().splitlines() if line.startswith("refsim: ")]
    assert code in (0, 2, 3), f"exit code {code}: {err.getvalue()[-1500:]}"
    assert code == 0 or len(said) == 1, f"exit code {code}, and not one sentence: {err.getvalue()[-1500:]}"
    return code, out.getvalue() if code == 0 else said[0]


def add_options(made: argparse.ArgumentParser) -> None:
    """The command line."""
    made.add_argument("--minutes", type=float, default=8.0, help="begin no further turn after so long (8)")
    made.add_argument("--seed", type=int, default=1, help="of the first turn; the same one draws the same trials (1)")
    made.add_argument("--only", nargs="+", choices=tuple(KINDS), default=list(KINDS), help="kinds of trials")
    made.add_argument("--out", type=Path, default=Path("results/attack"), help="folder that keeps trials that failed")
    made.set_defaults(perform=campaign)


def campaign(given: argparse.Namespace) -> int:
    """Turns of all kinds until the time is over; 4 if a trial failed. Raises InputError for bad input."""
    if not 0 < given.minutes < math.inf:
        raise InputError(f"--minutes = {given.minutes} is not possible; give a positive number.")
    with contextlib.suppress(ImportError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    until, turn, bad = time.monotonic() + 60 * given.minutes, 0, 0
    while not bad and (turn == 0 or time.monotonic() < until):
        for kind in given.only:
            bad += not held(kind, given.seed + turn, given.out / kind)
        turn += 1
    return 4 if bad else 0


def held(kind: str, seed: int, kept: Path) -> bool:
    """Whether the trials of one turn ended well; the smallest that did not is printed."""
    drawn, perform, count = KINDS[kind]
    outcomes: Counter[str] = Counter()

    @hypothesis.settings(
        max_examples=count, deadline=None, suppress_health_check=list(hypothesis.HealthCheck),
        database=DirectoryBasedExampleDatabase(kept),
    )  # fmt: skip
    @hypothesis.seed(seed)  # below the settings, or it takes the database away
    @hypothesis.given(drawn())
    def trials(trial: Any) -> None:
        hypothesis.note(repr(trial))
        faulthandler.dump_traceback_later(5 * LONGEST, exit=True, file=sys.__stderr__)
        with tempfile.TemporaryDirectory(prefix="refsim-attack-") as folder:
            outcomes[perform(trial, Path(folder))] += 1
        faulthandler.cancel_dump_traceback_later()

    try:
        trials()
    except Exception as error:  # any that a trial raises is a finding: Hypothesis has made it small and noted the trial
        traceback.print_exception(error)
        return False
    said = ", ".join(f"{n} of code {code}" for code, n in sorted(outcomes.items()))
    print(f"{kind}, seed {seed}: {said}", flush=True)
    return True
