"""refsim's command line as a trial calls it, in this process or in one of its own, and the verdict on its ending."""

from __future__ import annotations

import contextlib
import functools
import io
import os
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from validation.attack import GOOD

ROOT = Path(__file__).parents[2]
TANK = """name = "tank"
dim = 2
spacing = 0.01
support_radius = 0.026
end_time = 0.06

[[fluid]]
shape = "box"
cells = [5, 8, 1]

[effects.weakly_compressible]
density = "summation"
rest_density = 1000.0
sound_speed = 20.0
dynamic_viscosity = 2.2

[effects.gravity]
acceleration = [0.0, -9.81, 0.0]

[effects.box_walls]
lower = [0.0, 0.0, 0.0]
upper = [0.1, 0.1, 0.0]
"""
FRAMES = "0.005"  # s of simulated time


def here(arguments: Sequence[str], out: io.StringIO | None = None) -> tuple[str, str]:
    """(outcome, words) of a command in this process; its standard output goes to `out`."""
    from refsim.__main__ import main

    out, err = out or io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            code = main(list(arguments))
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 1
        except Exception:  # whatever escapes refsim is a finding
            return "traceback", last_lines(traceback.format_exc())
    return verdict(code, err.getvalue())


def apart(
    arguments: Sequence[str], *, out: Any = subprocess.PIPE, folder: Path | None = None, **variables: str
) -> subprocess.Popen[str]:
    """A process, in a session of its own, that performs a command; its output is text in pipes, or goes to `out`."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    environment |= {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"} | variables
    return subprocess.Popen(
        [sys.executable, "-m", "refsim", *arguments],
        stdout=out,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=folder,
        start_new_session=True,
    )


def ended(process: subprocess.Popen[str], seconds: float = 100.0) -> tuple[str, str]:
    """(outcome, words) of a process once it has ended; "hang" if it does not end."""
    try:
        _, err = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return "hang", f"no end within {seconds:g} s"
    if process.returncode < 0:
        return "died", f"signal {-process.returncode}; {last_lines(err)}"
    return verdict(process.returncode, err)


def verdict(code: int, err: str) -> tuple[str, str]:
    """Judge an exit code and what was said on standard error."""
    if "Traceback (most recent call last)" in err:
        return "traceback", last_lines(err)
    if code not in (0, 2, 3, 4):
        return "code", f"exit code {code}; {last_lines(err)}"
    said = [line for line in err.splitlines() if line.startswith("refsim: ")]
    if code in (2, 3) and len(said) != 1:
        return "sentence", f"exit code {code}; {last_lines(err)}"
    return str(code), said[0] if said else ""


def ill(outcome: str, finding: str = "lost") -> str:
    """The finding that an outcome is which ought to be another one: itself if it is one, else `finding`."""
    return finding if outcome in GOOD else outcome


def last_lines(text: str) -> str:
    """The beginning and the end of a long text."""
    return text.strip() if len(text) <= 3000 else f"{text[:1500]}\n...\n{text[-1500:]}".strip()


# Whole runs, compared


def write_tank(folder: Path) -> Path:
    """The scene of the runs that are killed or damaged; 40 particles, some 150 steps."""
    path = folder / "tank.toml"
    path.write_text(TANK)
    return path


def run_command(scene: Path, run: Path, *more: str) -> list[str]:
    """Run the scene from its start."""
    return ["run", str(scene), "--output", str(run), "--every", FRAMES, "--quiet", *more]


def resume_command(run: Path, *more: str) -> list[str]:
    """Resume a run to the scene's end."""
    return ["run", "--resume", str(run), "--every", FRAMES, "--quiet", *more]


def state(checkpoint: Path) -> dict[str, Any]:
    """What a run's state is compared by: every array bit for bit, time and step count."""
    from refsim.io.checkpoint import read_checkpoint

    saved = read_checkpoint(checkpoint)
    values: dict[str, Any] = {name: array.tobytes() for name, array in saved.arrays.items()}
    return values | {n: v for n, v in saved.attributes.items() if n in ("time", "steps", "previous_length")}


def frames(run: Path) -> list[tuple[float, bytes]]:
    """Times and positions of a run's frames."""
    from refsim.io.frames import read_particles

    return [(frame.time, np.ascontiguousarray(frame.position).tobytes()) for frame in read_particles(run_file(run))]


def run_file(run: Path) -> Path:
    """The frames of a run."""
    return run / "particles.vtkhdf"


def compared(run: Path, whole: Mapping[str, Any]) -> tuple[str, str]:
    """("0", "") if a finished run has the final state and the frames of the uninterrupted one, else "lost"."""
    found = state(run / "checkpoint.h5")
    other = [name for name, value in whole["state"].items() if found.get(name) != value]
    if other:
        return "lost", f"the final state has other bits than the uninterrupted run's in {', '.join(other)}"
    if "frames" in whole and frames(run) != whole["frames"]:
        return "lost", "the frames are not those of the uninterrupted run"
    return "0", ""


@functools.cache
def reference(*more: str) -> dict[str, Any]:
    """The uninterrupted run: its folder, final state and frames; once a process."""
    folder = Path(tempfile.mkdtemp(prefix="refsim-attack-"))
    outcome, words = here(run_command(write_tank(folder), folder / "whole", *more))
    if outcome != "0":
        raise RuntimeError(f"the run without an attack failed: {outcome}: {words}")
    run = folder / "whole"
    return {"run": run, "state": state(run / "checkpoint.h5"), "frames": frames(run)}
