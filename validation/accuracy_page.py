"""Settings on docs/study.md and their pictures, from the stored points (`python -m validation accuracy --draw`)."""

import math
import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.writing import write_file
from refsim.study.advice import cheapest, duration, in_words, least, price, settings
from refsim.study.panels import Panel, Point, abouts, panel
from refsim.study.result import percent, plain_ticks
from validation import own_choices
from validation.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, save_picture, style
from validation.filling import replaced

ROOT = Path(__file__).resolve().parent.parent
FIGURES, PAGE = ROOT / "figures", ROOT / "docs" / "study.md"
TARGETS = (0.1, 0.05, 0.01, 0.001)
ABSENT = "\u2013"  # not measured
COLOURS, MARKERS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY), ("o", "s", "^", "D", "v", "P", "X", "p", "*", "<")
HEAD = ("observable", "error", "cheapest setting", "its error, at most", "CPU")


def places(of: Panel, *kinds: str) -> dict[tuple[str, str], list[str]]:
    """Days and commits of the settings of these kinds by kind and machine: a GPU's name, or a processor's."""
    sources: dict[tuple[str, str], set[str]] = {}
    for kind in kinds:
        for _, point in settings(of, kind):
            place = of.places[point.place]
            sources.setdefault((kind, of.machine(point)), set()).add(f"{place.date}, commit {place.commit[:8]}")
    return {key: sorted(texts) for key, texts in sources.items()}


def tables(known: list[Panel]) -> list[str]:
    """A table for each processor, with a column for each GPU, so that a column has the seconds of one machine.

    Raises ValueError where one panel's settings were not timed on one processor.
    """
    by: dict[str, list[Panel]] = {}
    for each in known:
        machines = {machine for _, machine in places(each, "cpu", "peer")}
        if len(machines) != 1:
            raise ValueError(f"panel {each.name} was not timed on one processor: {', '.join(sorted(machines))}")
        by.setdefault(machines.pop(), []).append(each)
    lines = []
    for machine, panels in by.items():
        gpus = sorted({gpu for each in panels for _, gpu in places(each, "gpu")})
        head = [*HEAD, *gpus, "best other program"]
        lines += [f"CPU: {machine}.", "", f"| {' | '.join(head)} |"]
        lines.append(f"| --- | --: | --- | --: |{' --: |' * (len(head) - 4)}")
        lines += [*(line for each in panels for line in rows(each, gpus)), ""]
    return lines


def rows(of: Panel, gpus: list[str]) -> list[str]:
    """The panel's lines of the table: one for the errors of equal answers, without those that have no meaning."""
    about, groups = of.about, dict[tuple[str, ...], list[str]]()
    for error in sorted({*TARGETS, *about.more}, reverse=True):
        if error > of.reference().uncertainty:
            raw = f" ({error * about.scale:.2g} {about.unit})" if about.unit and about.scale not in (1.0, 100.0) else ""
            groups.setdefault(tuple(_cells(of, error, gpus)), []).append(percent(error) + raw)
    name = f"[{about.words}]({about.page}), `{of.name}`; {about.relative}"
    lines = []
    for cells, errors in groups.items():
        peer = "" if not name and cells[-1] == about.peer else cells[-1]  # said once
        lines.append(f"| {name} | {', '.join(errors)} | {' | '.join(cells[:-1])} | {peer} |")
        name = ""
    return lines


def _cells(of: Panel, error: float, gpus: list[str]) -> list[str]:
    """Cells behind the error: setting, its own error, seconds, seconds on each GPU, the best other program's seconds.

    The setting is a CPU's, or a GPU's where none that was measured on a CPU reaches the error.
    """
    cpu, gpu, other = (cheapest(of, error, kind) for kind in ("cpu", "gpu", "peer"))
    peer = of.about.peer
    if other is not None:
        peer = f"{duration(other[1].seconds)} ({other[1].program})"
    elif (best := least(of, "peer")) is not None:
        peer = f"{percent(best[0])} at best ({best[1].program})"
    named = cpu or gpu
    if named is None:
        bounds = [pair[0] for kind in ("cpu", "gpu") if (pair := least(of, kind)) is not None]
        return ["not reached", f"at least {in_words(of, min(bounds))}", *[""] * (1 + len(gpus)), peer]
    there = ["" if settings(of, "gpu") else ABSENT] * len(gpus)
    if gpu:
        other_setting = "" if _words(gpu[1]) == _words(named[1]) else f" ({_words(gpu[1])})"
        there[gpus.index(of.machine(gpu[1]))] = duration(gpu[1].seconds) + other_setting
    seconds = duration(cpu[1].seconds) + of.threads(cpu[1]) if cpu else ABSENT
    return [_words(named[1]), in_words(of, named[0]), seconds, *there, peer]


def _words(point: Point) -> str:
    """The setting, whatever it ran on."""
    return re.sub(", (on a GPU|float32|cpu|cuda)", "", point.words)


HEADER = """### Cheapest setting for an error

![Seconds that an error of five systems costs, on a CPU and on a GPU](../figures/accuracy_cost.png)

*A line ends at the smallest error that `refsim advise` offers (`python -m validation accuracy`; days and commits stand
below the pictures).*
"""
MIDDLE = """### Error against seconds

Each line joins the best settings of a method (`python -m validation accuracy NAME`).

<details><summary>A picture of each observable, with its reference</summary>
"""
CHOICES = """</details>

### The papers' own choices

Where refsim improves on a paper, `literal = "paper"` takes [the paper's own choice](errata.md) instead (`python
-m validation own`).
"""


def page() -> str:
    """docs/study.md with the stored settings."""
    known = [panel(name) for name in abouts()]
    lines = [HEADER, *tables(known), MIDDLE]
    where = ["| observable | machine | days and commits |", "| --- | --- | --- |"]
    for of in known:
        uncertainty = of.reference().uncertainty
        within = f", known to {percent(uncertainty)}" if uncertainty else ""
        lines += [f"![{of.name}](../figures/accuracy_cost_{of.name}.png)", ""]
        lines += [f"*Reference: {of.about.reference}{within}.*", ""]
        for (_, machine), when in places(of, "cpu", "gpu").items():
            where.append(f"| `{of.name}` | {machine} | {'; '.join(when)} |")
    lines += [*where, "", CHOICES, *own_choices.markdown()]
    return replaced(PAGE.read_text(encoding="utf-8"), "accuracy", lines, PAGE)


def write() -> list[Path]:
    """Renew page and pictures; returns their paths."""
    import matplotlib.pyplot as plt

    write_file(PAGE, page())
    drawn = {f"accuracy_cost_{name}": partial(picture, panel(name)) for name in abouts()} | {"accuracy_cost": overview}
    for name, draw in drawn.items():
        with style():
            figure, axes = plt.subplots(figsize=(7.6, 4.0 if draw is overview else 4.3))
            draw(axes)
            save_picture(figure, FIGURES / f"{name}.png")
        plt.close(figure)
    return [PAGE, *(FIGURES / f"{name}.png" for name in drawn)]


# Pictures

METHODS = {"R1": "each particle\nby itself (R1)", "RKL2": "Runge-Kutta-\nLegendre"}


def picture(of: Panel, axes: Any) -> None:
    """Error that each setting keeps against its seconds: a line through the best settings of each method."""
    methods: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for kind in ("cpu", "gpu", "peer"):
        for bound, p in settings(of, kind):
            name = p.program if kind == "peer" else str(p.knobs.get(of.about.method, "refsim"))
            name = "refsim" if name in ("cpu", "cuda") else name
            if bound < math.inf:
                methods.setdefault(name, {}).setdefault(kind, []).append((100 * bound, price(p)))
    for k, (name, kinds) in enumerate(methods.items()):
        look = {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)]}
        numbered = f"{str(of.about.method).replace('_', ' ')} {name}" if name[0].isdigit() else name
        axes.plot([], [], label=METHODS.get(name, numbered), ls="", **look)
        for kind, points in kinds.items():
            best = [(e, t) for e, t in points if not any(a <= e and b < t for a, b in points)]
            fill = "white" if kind == "gpu" else look["color"]
            axes.plot(*zip(*points), ls="", mfc=fill, ms=5, **look)
            axes.plot(*zip(*sorted(best)), "--" if kind == "gpu" else "-", color=look["color"], lw=1.2)
    if any("gpu" in kinds for kinds in methods.values()):
        axes.plot([], [], "o--", color=GREY, mfc="white", label="hollow: on a GPU")
    uncertainty = of.reference().uncertainty
    axes.set(xscale="log", yscale="log", xlabel=f"error [% {of.about.relative}]", ylabel="seconds of the run")
    low, high = axes.get_xlim()
    axes.set_xlim(low := min(low, 0.08 if low < 0.5 else 0.8), high := max(high, 12.0))
    if 100 * uncertainty > low:
        axes.axvspan(low, 100 * uncertainty, color=ORANGE, alpha=0.12, lw=0, label="uncertainty of the reference")
    for error in TARGETS:
        if low < 100 * error < high:
            axes.axvline(100 * error, color=GREY, ls=":", lw=0.9)
    _finished(axes, f"{of.about.words[:1].upper()}{of.about.words[1:]}")


SYSTEMS = {
    "front": "dam break", "droplet": "drop", "melting": "melting", "mpm_pressure": "MPM", "tank_pressure": "mesh"
}  # fmt: skip
WANTED = 0.01


def overview(axes: Any) -> None:
    """Seconds that an error of the five systems costs, on a CPU and on a GPU; points where they reach 1 %."""
    errors = np.geomspace(0.1, 0.001, 201)
    for (name, label), colour in zip(SYSTEMS.items(), COLOURS):
        for kind, line, fill, shown in (("cpu", "-", colour, label), ("gpu", "--", "white", None)):
            spent = [_seconds(panel(name), error, kind) for error in errors]
            axes.plot(100 * errors, spent, line, color=colour, drawstyle="steps-post", label=shown)
            axes.plot(100 * WANTED, _seconds(panel(name), WANTED, kind), "o", color=colour, mfc=fill, ms=7)
    axes.plot([], [], "--", color=GREY, label="dashed: on a GPU")
    axes.axvline(100 * WANTED, color=GREY, ls=":", lw=1.2)
    axes.set(xscale="log", yscale="log", xlabel="relative error [%]", ylabel="seconds of the run")
    axes.set_xlim(0.1, 10)
    reach = sum(math.isfinite(_seconds(panel(name), WANTED, "cpu")) for name in SYSTEMS)
    _finished(axes, f"What an error costs: {reach} of {len(SYSTEMS)} systems reach 1 %")


def _seconds(of: Panel, error: float, kind: str) -> float:
    """Seconds of the setting that is advised; NaN where none is."""
    cheapest_run = cheapest(of, error, kind)
    return math.nan if cheapest_run is None else price(cheapest_run[1])


def _finished(axes: Any, title: str) -> None:
    """Numbers instead of powers on the axes, a legend beside them, a title."""
    plain_ticks(axes.xaxis, few=30, most=12)
    plain_ticks(axes.yaxis, lambda value: duration([value]), few=30, most=12)
    axes.grid(True, which="major")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    axes.figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
