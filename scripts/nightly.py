"""What takes too long to run for every change: further precisions, slips, attacks, other programs, published sizes.

Runs the tasks one after another, each with a time limit, and prints a table. The outcome of each task is kept in
validation/nightly.json and shown on docs/nightly.md and in figures/pages/nightly.png; the output of each task goes to
results/nightly/. Exit code: 0 if every task passed, 2 for bad input, 4 if a task failed or exceeded its time limit.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim.core.errors import InputError  # noqa: E402
from validation.attack.campaign import commit  # noqa: E402
from validation.drawing import GREEN, VERMILION, save_picture, style  # noqa: E402
from validation.experiment import chosen  # noqa: E402
from validation.perform import EXIT_FAILED, EXIT_FINE, machine  # noqa: E402
from validation.tables import aligned  # noqa: E402

PASSED = "passed"
BEGIN, END = "<!-- outcomes -->\n", "<!-- end of outcomes -->"
CORES = str(min(4, os.cpu_count() or 1))
SLIPS = ("tests/ladder/test_slips.py", "tests/ladder/test_host_slips.py")
SEED = f"{datetime.date.today():%Y%m%d}"  # other attacks every night; the record names the command


@dataclass(frozen=True)
class Task:
    """One task of the night.

    words    what it does
    command  words after `python`, in the folder of the clone
    minutes  time limit
    """

    words: str
    command: tuple[str, ...]
    minutes: float


@dataclass(frozen=True)
class Place:
    """Where the outcomes are kept: the record, page and picture that show it, and the folder of the tasks' output."""

    record: Path = ROOT / "validation" / "nightly.json"
    page: Path = ROOT / "docs" / "nightly.md"
    logs: Path = ROOT / "results" / "nightly"
    picture: Path = ROOT / "figures" / "pages" / "nightly.png"


TASKS = {
    "slow": Task(
        "every operation in all variants and both precisions",
        ("-m", "pytest", "-q", "-m", "slow", *(word for file in SLIPS for word in ("--ignore", file))),
        240,
    ),
    "slips": Task(
        "every slip in every program, to be noticed by the contract, and in host code, by its closed forms",
        ("-m", "pytest", "-q", "-m", "slow", "-n", CORES, *SLIPS),
        240,
    ),
    "attack": Task(
        "attacks on the command line, with the date as seed",
        ("-m", "validation", "attack", "--minutes", "60", "--seed", SEED),
        75,
    ),
    "peers": Task(
        "other programs on the same work",
        ("-m", "validation", "run", "boundary", "mpm_droplet", "surface_reconstruction", "timing", "--peers"),
        180,
    ),
    "lessons": Task("every lesson, with the code of its answers", ("scripts/lessons.py",), 30),
    "experiments": Task("every experiment at its published size", ("-m", "validation", "run", "--jobs", CORES), 480),
    "claims": Task("every claim of the papers", ("-m", "validation", "claims", "--jobs", CORES), 480),
    "verify": Task("claims drawn at random, with the date as seed", ("-m", "validation", "verify", "--draw", "20"), 40),
    "stability": Task("every hard case and map", ("-m", "validation", "stability", "--jobs", CORES), 480),
    "environments": Task("the supported versions of Python and libraries", ("scripts/environments.py",), 120),
}


def main(
    arguments: Sequence[str] | None = None, tasks: Mapping[str, Task] = TASKS, place: Place = Place()
) -> int:  # fmt: skip
    """Run the command on `tasks`; returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="TASK", help="these; all by default")
    parser.add_argument("--list", action="store_true", help="print the tasks and run nothing")
    given = parser.parse_args(arguments)
    if given.list:
        for name, task in tasks.items():
            print(f"{name:12}  {task.minutes:g} min  {task.words}: {written(task)}")
        return EXIT_FINE
    try:
        chosen(given.only, tasks, "task")
    except InputError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    here, state = machine(), commit("validation/nightly.json", "docs/nightly.md", "figures/pages/nightly.png")
    done: dict[str, dict[str, Any]] = {}
    for name in given.only or tasks:
        print(f"{name}: {written(tasks[name])}", flush=True)
        done[name] = {"commit": state, "machine": here, **perform(name, tasks[name], place.logs)}
        keep(place, {name: done[name]})  # now, so that an interrupted night leaves what it has found
    print(f"\n{table(done)}\n\nOutput of the tasks: {place.logs}; the record: {place.record}")
    return EXIT_FINE if all(entry["outcome"] == PASSED for entry in done.values()) else EXIT_FAILED


def written(task: Task) -> str:
    """The task's command as it is typed."""
    return " ".join(("python", *task.command))


def perform(name: str, task: Task, logs: Path) -> dict[str, Any]:
    """Run a task; its entry of the record. At its time limit it is ended with all processes that it has started."""
    logs.mkdir(parents=True, exist_ok=True)
    date, began = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"), time.monotonic()
    with (logs / f"{name}.log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, *task.command], cwd=ROOT, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
            start_new_session=True,
        )  # fmt: skip
        try:
            code = process.wait(60 * task.minutes)
            outcome = PASSED if code == 0 else f"failed with exit code {code}"
        except subprocess.TimeoutExpired:
            outcome = f"exceeded its limit of {task.minutes:g} min"
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # the task itself, or what it has left behind
            process.wait()
    seconds = round(time.monotonic() - began, 1)
    return {"date": date, "words": task.words, "command": written(task), "seconds": seconds, "outcome": outcome}


def keep(place: Place, found: Mapping[str, Mapping[str, Any]]) -> None:
    """Put entries into the record, and the record onto the page and into its picture."""
    stored = json.loads(place.record.read_text()) if place.record.exists() else {}
    stored |= found
    place.record.write_text(json.dumps(stored, indent=1) + "\n")
    before, _, rest = place.page.read_text().partition(BEGIN)
    place.page.write_text(f"{before}{BEGIN}\n{page_table(stored)}\n{END}{rest.partition(END)[2]}")
    with style():
        save_picture(drawing(stored), place.picture)


def drawing(entries: Mapping[str, Mapping[str, Any]]) -> Any:
    """Figure of the record: what each task took, coloured by its outcome, against its time limit [min]."""
    from matplotlib.figure import Figure

    names = list(dict.fromkeys([*TASKS, *entries]))[::-1]
    with style():
        figure = Figure(figsize=(7.6, 0.9 + 0.3 * len(names)))
        axes = figure.subplots()
        for k, name in enumerate(names):
            limit, minutes, words = TASKS[name].minutes if name in TASKS else 0.0, 0.0, "not run yet"
            axes.barh(k, limit, color="#e4e4e4")
            if name in entries:
                minutes, words = entries[name]["seconds"] / 60, entries[name]["outcome"]
                axes.barh(k, minutes, color=GREEN if words == PASSED else VERMILION, height=0.5)
                words += "" if "limit" in words else f", {minutes:.0f} min"
            axes.text(1.05 * max(limit, minutes, 1.0), k, words, va="center", size=8.5)
        ticks = (1, 10, 60, 480)
        axes.set(xscale="log", xlim=(1, 5000), xticks=ticks, xticklabels=[str(tick) for tick in ticks])
        axes.set(xlabel="wall time [min]; grey: time limit", yticks=range(len(names)), yticklabels=names)
        axes.tick_params(axis="y", length=0)
        axes.minorticks_off()
    return figure


def table(entries: Mapping[str, Mapping[str, Any]]) -> str:
    """Outcomes of tasks as text."""
    rows = [[name, entry["outcome"], f"{entry['seconds']:.0f}"] for name, entry in entries.items()]
    return "\n".join(aligned([["task", "outcome", "seconds"], *rows], [False, False, True]))


def page_table(entries: Mapping[str, Mapping[str, Any]]) -> str:
    """The record as the page shows it: a row for each task of the night, and for each that has an outcome."""
    lines = ["| task | what it runs | last outcome | date (UTC) | commit | seconds |", "| --- " * 6 + "|"]
    for name in dict.fromkeys([*TASKS, *entries]):
        entry = entries.get(name)
        if entry is None:
            cells = [TASKS[name].words, "not run yet", "", "", ""]
        else:
            cells = [
                entry["words"],
                entry["outcome"],
                entry["date"][:10],
                entry["commit"][:10],
                f"{entry['seconds']:.0f}",
            ]
        lines.append(f"| {' | '.join([name, *cells])} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
