"""Commands that are stopped by a signal, print to a full disk, or run twice at once; then they are given again."""

from __future__ import annotations

import functools
import os
import random
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from validation.attack import stores
from validation.attack.commands import apart, ended, here, ill, run_command, write_tank

COMMANDS = ("run", "sweep", "sweep", "study", "study", "view", "render", "reproduce")
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGKILL")
LONGEST = 6.0  # s until a signal
ENDS = 15.0  # s until no process of a stopped command is left


def make(seed: int, number: int) -> dict[str, Any]:
    """A command and a signal with its delay, or a full disk, or two processes."""
    draw = random.Random(f"stops {seed} {number}")
    name, how = draw.choice(COMMANDS), draw.choice((*SIGNALS, *SIGNALS, "full", "twice"))
    if name == "reproduce" and how in ("full", "twice"):
        how = "SIGTERM"
    return {"command": name, "how": how, "delay": round(LONGEST * draw.random(), 3)}


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Disturb the command, look for what it left running, and give it again."""
    name, how = trial["command"], trial["how"]
    stores.write(folder)
    write_tank(folder)
    if how == "twice":
        outcomes = [ended(process) for process in (started(name, folder), started(name, folder))]
    elif how == "full":
        with open("/dev/full", "w") as full:
            outcomes = [ended(started(name, folder, full))]
    else:
        outcomes = [stopped(name, folder, getattr(signal, how), trial["delay"])]
    for outcome, words in outcomes:
        if outcome not in ("0", "3") and not (outcome == "2" and how == "twice" and name in ("run", "view", "render")):
            return ill(outcome, "code"), words
    if name == "reproduce":
        return outcomes[0]
    outcome, words = here(command(name, folder))
    if outcome != "0":
        return ill(outcome), f"again: {words}"
    return checked(name, folder) or outcomes[0]


def command(name: str, folder: Path) -> list[str]:
    """The command's words, its results in the folder."""
    if name == "run":
        return run_command(folder / "tank.toml", folder / "run", "--backend", "numpy", "--overwrite")
    if name == "view":
        return ["view", str(finished()), "--html", str(folder / "view.html")]
    if name == "render":
        return ["render", str(finished()), "--frames", "last", "--output", str(folder / "picture.png")]
    return ["reproduce", "--quick"] if name == "reproduce" else stores.command(name, folder)


def started(name: str, folder: Path, out: Any = subprocess.PIPE) -> subprocess.Popen[str]:
    """The command in a session of its own."""
    return apart(command(name, folder), out=out, folder=folder)


def stopped(name: str, folder: Path, number: signal.Signals, delay: float) -> tuple[str, str]:
    """Send the signal to the command's own process; every process of it must end."""
    process = started(name, folder)
    until = time.monotonic() + delay
    while time.monotonic() < until and process.poll() is None:
        time.sleep(0.01)
    alone = process.poll() is None
    if alone:
        process.send_signal(number)
    outcome, words = ended(process, ENDS)
    until = time.monotonic() + ENDS
    while left(process.pid) and time.monotonic() < until:
        time.sleep(0.1)
    if left(process.pid):
        os.killpg(process.pid, signal.SIGKILL)
        return "hang", f"processes of the stopped {name} go on"
    unheeded = outcome == "died" and words == f"signal {number.value}; "  # before refsim heeds it, without a word
    killed = process.returncode == -number and (number == signal.SIGKILL or unheeded)
    return ("0", "killed") if alone and killed else (outcome, words)


def left(group: int) -> bool:
    """Whether a process of the group is alive."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def checked(name: str, folder: Path) -> tuple[str, str] | None:
    """What is wrong with the results of the command that was given again."""
    if name in ("sweep", "study"):
        found, whole = (set(stores.values(place / name).values()) for place in (folder, stores.base(name)))
        return None if found == whole else ("lost", f"{found} and not {whole}")
    path = folder / {"run": "run/particles.vtkhdf", "view": "view.html", "render": "picture.png"}[name]
    return (
        None if path.exists() and path.stat().st_size > 0 else ("lost", f"{name} left no {path.name}, or an empty one")
    )


@functools.cache
def finished() -> Path:
    """A finished run for pictures and pages; once a process."""
    folder = Path(tempfile.mkdtemp(prefix="refsim-attack-"))
    outcome, words = here(run_command(write_tank(folder), folder / "run", "--backend", "numpy"))
    if outcome != "0":
        raise RuntimeError(f"the run to be shown failed: {outcome}: {words}")
    return folder / "run"
