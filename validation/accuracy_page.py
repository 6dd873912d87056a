"""docs/accuracy_cost.md and its pictures from the stored points (`python -m validation accuracy --draw`)."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from refsim.study.advice import answer, own_error
from refsim.study.choice import Candidate, Choice, by_chance, candidates, duration, kinds, percent, physics, refused
from refsim.study.panels import OWN, Panel, abouts, panel
from validation.drawing import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, YELLOW, save_picture, style
from validation.filling import replaced

ROOT = Path(__file__).resolve().parent.parent
FIGURES, PAGE = ROOT / "figures", ROOT / "docs" / "accuracy_cost.md"
TARGETS = (0.1, 0.05, 0.01, 0.001)
HOLLOW, ABSENT = "\u25cb", "\u2013"  # not settled; not measured
COLOURS, MARKERS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY), ("o", "s", "^", "D", "v", "P", "X", "p", "*", "<")


def targets(of: Panel) -> list[float]:
    """Errors of the panel's rows, from large to small."""
    return sorted({*TARGETS, *of.about.more}, reverse=True)


def rows(of: Panel) -> list[str]:
    """The panel's lines of the table: one for the errors of equal answers, without those that have no meaning."""
    about = of.about
    name = f"[{about.words}]({about.page}), `{of.name}`; {about.relative}"
    groups: dict[tuple[str, ...], list[str]] = {}
    for error in targets(of):
        if answer(of, error).no_meaning:
            continue
        own = f" ({error * about.scale:.2g} {about.unit})" if about.unit and about.scale not in (1.0, 100.0) else ""
        groups.setdefault(tuple(_cells(of, error)), []).append(percent(error) + own)
    lines = []
    for cells, errors in groups.items():
        if not name and cells[-1] == about.peer:  # said once
            cells = (*cells[:-1], "")
        lines.append(f"| {name} | {', '.join(errors)} | {' | '.join(cells)} |")
        name = ""
    return lines


def _cells(of: Panel, error: float) -> list[str]:
    """Cells behind the error: setting, its own error, seconds, seconds on a GPU, the best other program's seconds.

    The setting is a CPU's, or a GPU's where none that was measured on a CPU reaches the error.
    """
    found = answer(of, error)
    choice, gpu = found.choice, answer(of, error, "gpu").choice
    peer = of.about.peer if found.peer is None else _peer(found.peer)
    assert choice is not None
    on_gpu = gpu is not None and bool(gpu.advised or gpu.read)
    seconds, there = _time(choice), _time(gpu) if on_gpu else ABSENT
    if choice.nearest and gpu and (on_gpu or (gpu.nearest and gpu.nearest.most < choice.nearest.most)):
        choice, seconds = gpu, ABSENT
    if choice.named is None:
        return [choice.why, "", "", there, peer]
    own = own_error(of, choice.named, choice.nearest is None)
    if choice.nearest is not None:
        return ["not reached", own, "", "", peer]
    words = _words(choice.named)
    if on_gpu and gpu and gpu.named and gpu.nearest is None and _words(gpu.named) != words:
        there += f" ({_words(gpu.named)})"
    return [words if choice.advised else f"{HOLLOW} {words}", own, seconds, there, peer]


def _words(setting: Candidate) -> str:
    """The setting, whatever it ran on."""
    words = setting.point.words
    for part in (", on a GPU", ", float32", ", cpu", ", cuda"):
        words = words.replace(part, "")
    return words


def _peer(choice: Choice) -> str:
    """Seconds of the best other program, or the least error that it has."""
    if choice.nearest is None:
        return _time(choice, lambda c: f" ({c.point.program})")
    return f"{percent(choice.nearest.most)} at best ({choice.nearest.point.program})"


def _time(choice: Choice | None, after: Callable[[Candidate], str] = lambda c: "") -> str:
    """Seconds of an advised setting; the range of one whose timing scatters; nothing where none reaches the error."""
    if choice is None:
        return ABSENT
    named = choice.named
    if named is None:
        return choice.why
    if choice.nearest is not None:
        return ""
    if choice.advised is None:
        return f"{HOLLOW} " + " to ".join(duration(choice.seconds * share) for share in named.scatter) + after(named)
    return duration(choice.seconds) + after(named)


HEAD = [
    "| observable | error | cheapest setting | its error | CPU, at most 2 threads | GPU | best other program |",
    "| --- | --: | --- | --: | --: | --: | --: |",
]


def pictures(of: Panel) -> list[str]:
    """The panel's picture, its reference and how well that is known."""
    about, known = of.about, of.reference()[2]
    within = f", known to {percent(known)}" if known else ""
    picture = f"![{of.name}](../figures/accuracy_cost_{of.name}.png)"
    return [picture, "", f"*Reference: {about.reference}{within}.*", ""]


def page(text: str) -> str:
    """docs/accuracy_cost.md with its generated parts renewed."""
    known = [panel(name) for name in abouts()]
    text = replaced(text, "answers", HEAD + [line for each in known for line in rows(each)], PAGE)
    return replaced(text, "pictures", [line for each in known for line in pictures(each)][:-1], PAGE)


def write() -> list[Path]:
    """Renew page and pictures; returns their paths."""
    import matplotlib.pyplot as plt

    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")))
    made = [PAGE]
    drawn = {f"accuracy_cost_{name}": partial(picture, panel(name)) for name in abouts()} | {"accuracy_cost": overview}
    for name, draw in drawn.items():
        made.append(FIGURES / f"{name}.png")
        with style():
            figure = draw()
            save_picture(figure, made[-1])
        plt.close(figure)
    return made


# The picture


def picture(of: Panel) -> Any:
    """Error against time: one line a method, targets, the uncertainty of the reference, advised points by name."""
    import matplotlib.pyplot as plt

    about, found, uncertainty = of.about, candidates(of), of.reference()[2]
    figure, axes = plt.subplots(figsize=(7.6, 4.3))
    _methods(axes, of, found)
    axes.set(xscale="log", yscale="log")
    low, high = axes.get_xlim()
    low, high = min(low, 0.08 if low < 0.5 else 0.8), max(high, 12.0)
    failed = [p for p in of.points.values() if p.failed]
    if failed:
        high *= (high / low) ** 0.07
        more = f"; and {len(failed) - 1} more" if len(failed) > 1 else ""
        words = textwrap.fill(f"stopped: {textwrap.shorten(failed[0].words, 60)}{more}", 34)
        place = 1.1 * axes.get_ylim()[0]
        for k, p in enumerate(sorted(failed, key=lambda p: p.spent)):
            place = max(p.spent, place if k == 0 else 1.25 * place)
            axes.plot(high * (low / high) ** 0.03, place, "x", color=VERMILION, ms=7, mew=1.8, label="" if k else words)
    axes.set_xlim(low, high)
    shaded = [(uncertainty, ORANGE, "uncertainty of the reference")] if uncertainty else []
    shaded += [(about.spread[0], YELLOW, about.spread[1])] if about.spread else []
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom * (bottom / top) ** (0.05 * len(shaded) + 0.06 * bool(shaded)), top)  # room for their words
    for k, (width, colour, words) in enumerate(shaded):
        axes.axvspan(low, 100 * width, color=colour, alpha=0.12, lw=0)
        side = "left" if 100 * width < math.sqrt(low * high) else "right"
        axes.text(100 * width, 0.02 + 0.05 * k, f" {words}: {percent(width)} ", ha=side, fontsize=7, color="#8a5a00",
                  transform=axes.get_xaxis_transform())  # fmt: skip
    for error in TARGETS:
        if low < 100 * error < high:
            axes.axvline(100 * error, color=GREY, ls=":", lw=0.9)
    _named(axes, of)
    _plain_ticks(axes.xaxis)
    _plain_ticks(axes.yaxis, duration)
    axes.set(xlabel=f"error [% {about.relative}]", ylabel="wall time")
    axes.grid(True, which="major")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7)
    figure.suptitle(f"{about.words[:1].upper()}{about.words[1:]}", x=0.01, ha="left", fontweight="bold")
    return figure


def _methods(axes: Any, of: Panel, found: Sequence[Candidate]) -> None:
    """Points of each method, and a line through its best ones; on a GPU dashed and small."""
    own, known = kinds(of)["cpu"], physics(kinds(of))
    passed = {c.point.key for c in own if refused(c, own) or by_chance(c, c.error, known)}
    passed = (passed | {f"cuda_{key}" for key in passed}).difference(_chosen(of)[1])
    methods: dict[str, tuple[list[Candidate], list[Candidate]]] = {}  # of a CPU, of a GPU
    for c in found:
        name = c.point.program if c.point.program != OWN else str(c.point.knobs.get(of.about.method, OWN))
        gpu = c.point.gpu and "cuda" not in name
        methods.setdefault(name.replace(", GPU", ""), ([], []))[gpu].append(c)
    for k, (name, both) in enumerate(methods.items()):
        colour, mark = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
        for members, line, size in zip(both, ("-", "--"), (6, 4.5)):
            sound = sorted((c for c in members if c.point.key not in passed), key=lambda c: c.error)
            best = [c for c in sound if not any(o.error <= c.error and o.wall < c.wall for o in sound)]
            axes.plot([100 * c.error for c in best], [c.wall for c in best], line, color=colour, lw=1.2, alpha=0.8)
            for c in members:
                axes.plot(100 * c.error, c.wall, mark, ms=size, color=colour, mfc="white" if c.unsettled else colour,
                          mew=1.2, alpha=0.35 if c.point.key in passed else 1.0)  # fmt: skip
        axes.plot([], [], mark, color=colour, label=name)
    if any(gpu for _, gpu in methods.values()):
        axes.plot([], [], "--", color=GREY, label="dashed, small: on a GPU")
    axes.plot([], [], "o", color=GREY, mfc="white", mew=1.2, label="hollow: seconds scatter")
    if passed:
        axes.plot([], [], "o", color=GREY, alpha=0.35, label="pale: not advised")


def _chosen(of: Panel) -> tuple[dict[str, list[str]], dict[str, tuple[Candidate, bool]]]:
    """Settings that the table names, by key: for which errors; the setting, and whether its seconds have settled."""
    errors: dict[str, list[str]] = {}
    named: dict[str, tuple[Candidate, bool]] = {}
    for kind in ("cpu", "gpu"):
        for error in targets(of):
            choice = answer(of, error, kind).choice
            setting = None if choice is None else choice.advised or choice.read
            if choice is not None and setting is not None:
                errors.setdefault(setting.point.key, []).append(percent(error))
                named[setting.point.key] = setting, choice.advised is not None
    return errors, named


def _named(axes: Any, of: Panel) -> None:
    """Letters on the settings that the table names, and what they are beside the axes."""
    errors, named = _chosen(of)
    listed = []
    for letter, (c, advised) in zip("abcdefgh", sorted(named.values(), key=lambda pair: -pair[0].error)):
        at = (100 * of.error(c.point), c.wall)
        axes.plot(*at, "o", ms=12, mfc="none", mec=BLACK if advised else GREY, mew=1.3, zorder=5)
        axes.annotate(letter, at, (8, 6), textcoords="offset points", fontsize=8, zorder=6, fontweight="bold",
                      bbox={"fc": "white", "ec": "none", "alpha": 0.6, "pad": 0.3})  # fmt: skip
        words = textwrap.indent(textwrap.fill(c.point.words, 36), "    ")
        scatter = "" if advised else ", seconds scatter"
        listed.append(f"{letter}: for {', '.join(errors[c.point.key])}{scatter}\n{words}")
    axes.text(1.02, 0.0, "\n".join(listed), transform=axes.transAxes, va="bottom", fontsize=7)


def _plain_ticks(axis: Any, words: Callable[[float], str] = "{:g}".format) -> None:
    """Numbers instead of powers on a logarithmic axis; between the decades where it spans few of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = sorted(axis.get_view_interval())
    axis.set(major_locator=LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 30 else (1.0,), numticks=12))
    axis.set(major_formatter=FuncFormatter(lambda value, place: words(value)), minor_formatter=NullFormatter())


# The picture of all systems

SYSTEMS = {
    "front": "dam break", "droplet": "drop", "melting": "melting", "mpm_pressure": "MPM", "tank_pressure": "mesh"
}  # fmt: skip
WANTED = 0.01


def overview() -> Any:
    """Seconds that an error of the five systems costs, on a CPU and on a GPU; points where they reach 1 %."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.6, 4.0))
    errors = np.geomspace(0.1, 0.001, 201)
    for (name, words), colour in zip(SYSTEMS.items(), COLOURS):
        for kind, line, fill in (("cpu", "-", colour), ("gpu", "--", "white")):
            spent = [_seconds(panel(name), error, kind) for error in errors]
            axes.plot(100 * errors, spent, line, color=colour, label=words if kind == "cpu" else None)
            axes.plot(100 * WANTED, _seconds(panel(name), WANTED, kind), "o", color=colour, mfc=fill, ms=7)
    axes.plot([], [], "--", color=GREY, label="dashed: on a GPU")
    axes.axvline(100 * WANTED, color=GREY, ls=":", lw=1.2)
    axes.set(xscale="log", yscale="log", xlabel="relative error [%]", ylabel="wall time")
    axes.set_xlim(10, 0.1)
    axes.set_xticks([10, 5, 2, 1, 0.5, 0.2, 0.1], ["10", "5", "2", "1", "0.5", "0.2", "0.1"])
    axes.set_xticks([], minor=True)
    _plain_ticks(axes.yaxis, duration)
    axes.grid(True, which="major")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    reach = sum(math.isfinite(_seconds(panel(name), WANTED, "cpu")) for name in SYSTEMS)
    title = f"What an error costs: {reach} of {len(SYSTEMS)} systems reach 1 %"
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    return figure


def _seconds(of: Panel, error: float, kind: str) -> float:
    """Seconds of the setting that is advised; NaN where none is."""
    choice = answer(of, error, kind).choice
    return math.nan if choice is None or choice.advised is None else choice.seconds
