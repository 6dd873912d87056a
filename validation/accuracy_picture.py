"""The figures of an accuracy panel, drawn from its report alone."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from validation import answers
from validation.answers import group_of, is_peer
from validation.drawing import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, YELLOW
from validation.reading import first_kept
from validation.results import floats, real

GROUP_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "p", "*", "<", ">", "h")  # more than colours: no pair of both comes twice
PART_COLOURS = {"start": YELLOW, "list": GREY, "step": BLUE, "threshold": ORANGE, "normals": SKY, "scan": GREEN}
PALE = "#c4c4c4"
NARROW = 62  # characters of a short line


def answer_picture(data: Mapping[str, Any]) -> Any:
    """Error against time: one line a method, targets, the uncertainty of the reference, advised points by name."""
    observable = answers.observable_of(data["panel"], data["title"], data["headline"]["group"])
    points = data["points"]
    found = answers.candidates(points, observable)
    spread = answers.uncertainty(points, observable, data["band"])
    advised: dict[str, list[float]] = {}
    read: dict[str, list[float]] = {}  # named where no timing has settled
    for reported in (False, True):
        some = [c for c in found if ("reported" in c.point["knobs"]) == reported and not is_peer(c.point)]
        for error in sorted({*answers.TARGETS, *observable.more}, reverse=True) if some else ():
            if observable.meaning and error <= observable.meaning[0]:
                continue
            choice = answers.choose(some, error, spread)
            if choice.advised is not None:
                advised.setdefault(choice.advised.key, []).append(error)
            elif choice.read is not None:
                read.setdefault(choice.read.key, []).append(error)
    figure, axes = plt.subplots(figsize=(7.6, 4.3))
    own = [c for c in found if "reported" not in c.point["knobs"] and not is_peer(c.point)]
    passed = {c.key for c in own if answers.refused(c, own) or answers.by_chance(c, c.error, own)}
    methods: dict[str, tuple[list[Any], list[Any]]] = {}  # of a CPU, of a GPU
    for c in found:
        name = group_of(c.point, observable.method) or "points"
        gpu = c.point["knobs"].get("backend") == "cuda" and "cuda" not in name
        methods.setdefault(name.replace(", GPU", ""), ([], []))[gpu].append(c)
    for k, (name, both) in enumerate(methods.items()):
        colour, mark = GROUP_COLOURS[k % len(GROUP_COLOURS)], MARKERS[k % len(MARKERS)]
        for members, line, size in zip(both, ("-", "--"), (6, 4.5)):
            members.sort(key=lambda c: c.error)
            sound = [c for c in members if c.key not in passed]
            best = [c for c in sound if not any(o.error <= c.error and _wall(o) < _wall(c) for o in sound)]
            axes.plot([100 * c.error for c in best], [_wall(c) for c in best], line, color=colour, lw=1.2, alpha=0.8)
            for c in members:
                axes.plot(100 * c.error, _wall(c), mark, ms=size, color=colour, mfc=colour if c.settled else "white",
                          mew=1.2, alpha=0.35 if c.key in passed else 1.0)  # fmt: skip
        axes.plot([], [], mark, color=colour, label=name)
    if any(gpu for _, gpu in methods.values()):
        axes.plot([], [], "--", color=GREY, label="dashed, small: on a GPU")
    axes.plot([], [], "o", color=GREY, mfc="white", mew=1.2, label="hollow: timing has not settled")
    if passed:
        axes.plot([], [], "o", color=GREY, alpha=0.35, label="pale: passed over at its own error")
    axes.set(xscale="log", yscale="log")
    low, high = axes.get_xlim()
    low, high = min(low, 0.08 if low < 0.5 else 0.8), max(high, 12.0)
    failed = [p for p in points.values() if p["shown"] and p["stopped"]]
    if failed:
        edge = high * (high / low) ** 0.04
        label = f"failed: {short_reason(failed[0])}" + (f"; and {len(failed) - 1} more" if len(failed) > 1 else "")
        for k, (place, _) in enumerate(spread_out(failed, 1.1 * axes.get_ylim()[0])):
            words = "" if k else textwrap.fill(label, 34)
            axes.plot(edge, place, "x", color=VERMILION, ms=7, mew=1.8, label=words)
        high = edge * (high / low) ** 0.03
    axes.set_xlim(low, high)
    shaded = [(100 * spread, ORANGE, "uncertainty of the reference")] if spread else []
    if data["band"] is not None and observable.converged:
        shaded.append((100 * real(data["band"]["width"]), YELLOW, data["band"]["words"]))
    if shaded:
        bottom, top = axes.get_ylim()
        axes.set_ylim(bottom * (bottom / top) ** (0.06 + 0.05 * len(shaded)), top)  # room for their words
    for k, (width, colour, words) in enumerate(shaded):
        axes.axvspan(low, width, color=colour, alpha=0.12, lw=0)
        left = width < math.sqrt(low * high)
        axes.text(width, 0.02 + 0.05 * k, f" {words}: {answers.percent(0.01 * width)} ", ha="left" if left else "right",
                  transform=axes.get_xaxis_transform(), fontsize=7, color="#8a5a00")  # fmt: skip
    for error in answers.TARGETS:
        if low < 100 * error < high:
            axes.axvline(100 * error, color=GREY, ls=":", lw=0.9)
    listed = []
    for c in sorted((c for c in found if c.key in advised or c.key in read), key=lambda c: -c.error):
        letter = "abcdefgh"[len(listed)]
        ring = BLACK if c.key in advised else GREY
        axes.plot(100 * c.error, _wall(c), "o", ms=12, mfc="none", mec=ring, mew=1.3, zorder=5)
        axes.annotate(letter, (100 * c.error, _wall(c)), (8, 6), textcoords="offset points", fontsize=8, zorder=6,
                      fontweight="bold", bbox={"fc": "white", "ec": "none", "alpha": 0.6, "pad": 0.3})  # fmt: skip
        errors = ", ".join(answers.percent(e) for e in advised.get(c.key, read.get(c.key, ())))
        hollow = "" if c.key in advised else ", not settled"
        listed.append(f"{letter}: for {errors}{hollow}\n{textwrap.indent(textwrap.fill(c.point['words'], 36), '    ')}")
    axes.text(1.02, 0.0, "\n".join(listed), transform=axes.transAxes, va="bottom", fontsize=7)
    _plain_ticks(axes.xaxis)
    _plain_ticks(axes.yaxis, seconds)
    axes.set(xlabel=f"error [% {observable.relative}]", ylabel="wall time")
    if not observable.relative:
        axes.set_xlabel(f"error [%]: {data['observable']}")
    axes.grid(True, which="major")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7)
    figure.suptitle(f"{observable.words[:1].upper()}{observable.words[1:]}", x=0.01, ha="left", fontweight="bold")
    return figure


def _wall(candidate: Any) -> float:
    """Wall seconds to the error that a point keeps."""
    return real(candidate.point["seconds"])


def parts_picture(data: Mapping[str, Any]) -> Any:
    """How the error falls; where it comes from; where the time goes; what effects cost; how it was measured."""
    figure = plt.figure(figsize=(14.5, 7.4))
    grid = figure.add_gridspec(3, 4, height_ratios=(1, 1, 0.62))
    points = {key: p for key, p in data["points"].items() if p["shown"]}
    colours = group_colours(data, points)
    if any(p["curve"] for p in points.values()):
        _curves(figure.add_subplot(grid[0, :2]), data, points, colours)
    else:
        _distributions(figure.add_subplot(grid[0, :2]), data, points, colours)
    _parts(figure.add_subplot(grid[0, 2:]), data, points)
    _sources(figure.add_subplot(grid[1, :2]), data)
    _effects(figure.add_subplot(grid[1, 2:]), data)
    _words(figure.add_subplot(grid[2, :2]), figure.add_subplot(grid[2, 2:]), data, points)
    for axes in figure.axes:
        for text in axes.texts:
            text.set_in_layout(False)  # long lines must not squeeze the axes
    figure.suptitle(data["title"], x=0.01, ha="left", fontweight="bold", fontsize=12)
    return figure


def group_colours(data: Mapping[str, Any], points: Mapping[str, Any]) -> dict[str, str]:
    """A colour for each value of the knob that the headline compares."""
    names = dict.fromkeys(group_of(p, data["headline"]["group"]) for p in points.values())
    return {name: GROUP_COLOURS[k % len(GROUP_COLOURS)] for k, name in enumerate(names)}


def _group(data: Mapping[str, Any], point: Mapping[str, Any]) -> str:
    return group_of(point, data["headline"]["group"])


def _plain_ticks(axis: Any, words: Callable[[float], str] = "{:g}".format) -> None:
    """Numbers instead of powers on a logarithmic axis; between the decades where it spans few of them."""
    low, high = sorted(axis.get_view_interval())
    few = high / low < 30
    axis.set(major_locator=LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=12))
    axis.set(major_formatter=FuncFormatter(lambda value, place: words(value)), minor_formatter=NullFormatter())


def spread_out(failed: Sequence[Mapping[str, Any]], low: float) -> list[tuple[float, Mapping[str, Any]]]:
    """Failures with the times at which their crosses stand, `low` at least, and apart where they would cover others."""
    made: list[tuple[float, Mapping[str, Any]]] = []
    for p in sorted(failed, key=lambda p: p["spent"]):
        place = max(p["spent"], low)
        if made:
            place = max(place, made[-1][0] * 1.25)
        made.append((place, p))
    return made


def short_reason(point: Mapping[str, Any]) -> str:
    """A failure for a label: what differed, and the reason's name."""
    return f"{textwrap.shorten(point['words'], 60, placeholder='...')}: {point['stopped'].split()[0].rstrip(':')}"


def _curves(axes: Any, data: Mapping[str, Any], points: Mapping[str, Any], colours: Mapping[str, str]) -> None:
    """The error while runs go on: the fastest to the stated error of each group, and the most accurate of it."""
    chosen: dict[str, None] = dict.fromkeys(row["key"] for row in data["headline"]["rows"])
    for group in colours:
        members = [k for k, p in points.items() if p["curve"] and not p["stopped"] and _group(data, p) == group]
        if members:
            chosen.setdefault(min(members, key=lambda k: points[k]["error"]))
    styles = {}
    for key in chosen:
        p = points.get(key)
        if p is None or not p["curve"]:
            continue
        wall, error = floats(p["curve"]["wall"]), floats(p["curve"]["error"])
        group = _group(data, p)
        dash = ("-", "--", ":")[styles.setdefault(group, 0) % 3]
        styles[group] += 1
        axes.plot(np.maximum(wall, 1e-3), error, dash, color=colours[group], lw=1.4,
                  label=textwrap.shorten(p["words"], 56, placeholder="..."))  # fmt: skip
        k = first_kept(error.tolist(), data["stated"])
        if k is not None:
            axes.plot(wall[k], error[k], "o", color=colours[group], ms=6, mec="white")
    axes.axhline(data["stated"], color=GREY, ls="--", lw=1.0)
    axes.set(xscale="log", yscale="log", xlabel="wall time [s]", ylabel=data["observable"])
    axes.set(title="b  The error while a run goes on")
    axes.grid(True)
    axes.set_ylim(bottom=axes.get_ylim()[0] / 6.0)  # room for the legend
    axes.legend(loc="lower left", fontsize=6.8)


def _distributions(axes: Any, data: Mapping[str, Any], points: Mapping[str, Any], colours: Mapping[str, str]) -> None:
    """Median, 99th percentile and maximum of what each particle or datum deviates, for the front."""
    rows = [(k, name, d) for k in data["front"] for name, d in points[k]["distribution"].items()]
    names = list(dict.fromkeys(name for _, name, _ in rows))
    for number, key in enumerate(data["front"], 1):
        for name, mark in zip(names, MARKERS):
            d = points[key]["distribution"].get(name)
            if d is not None:
                values = [real(d[q]) for q in ("median", "p99", "max")]
                axes.plot(values, [number] * 3, "-", color=PALE, lw=1, zorder=1)
                for value, colour in zip(values, (BLUE, ORANGE, VERMILION)):
                    axes.plot(value, number, mark, color=colour, ms=5)
    for q, colour in (("median", BLUE), ("99 %", ORANGE), ("max", VERMILION)):
        axes.plot([], [], "o", color=colour, label=q)
    axes.set(yticks=range(1, len(data["front"]) + 1), ylim=(0.4 + (len(data["front"]) - 0.1) / 0.76, 0.4))
    axes.set(xlabel="; ".join(textwrap.fill(name, NARROW) for name in names) or "no distribution")
    axes.set(title="b  Not one norm: the front's distributions")
    axes.grid(True, axis="x")
    axes.legend(loc="lower right", fontsize=7.5)


def _parts(axes: Any, data: Mapping[str, Any], points: Mapping[str, Any]) -> None:
    """The time of the front's points by part, and what comes on top."""
    keys = list(data["front"])
    for row in data["headline"]["rows"]:
        p = points.get(row["key"])
        if row["key"] not in keys and p is not None and "reported" not in p["knobs"]:
            keys.append(row["key"])
    used: dict[str, str] = {}
    spare = iter((PURPLE, VERMILION, ORANGE, GREEN))
    for place, key in enumerate(keys):
        p, left = points[key], 0.0
        total = sum(real(v["median"]) for v in p["parts"].values()) or 1.0
        for name, part in p["parts"].items():
            colour = used.setdefault(name, PART_COLOURS.get(name) or next(spare, GREY))
            width = real(part["median"]) / total
            axes.barh(place, width, left=left, height=0.6, color=colour, edgecolor="white", lw=0.5)
            left += width
        for name, part in p["beside"].items():
            width = real(part["median"]) / total
            colour = used.setdefault(name, "white")
            axes.barh(place, width, left=left, height=0.6, color=colour, edgecolor=GREY, hatch="////", lw=0.5)
            left += width
    for name, colour in used.items():
        axes.barh(0, 0, color=colour, label=name, edgecolor=GREY if colour == "white" else colour,
                  hatch="////" if colour == "white" else None)  # fmt: skip
    labels = [str(data["front"].index(k) + 1) if k in data["front"] else _group(data, points[k]) for k in keys]
    words = [f"{textwrap.fill(label, 14)}  {seconds(points[k]['seconds'])}" for label, k in zip(labels, keys)]
    axes.set_yticks(range(len(keys)), words, fontsize=8)
    axes.set_ylim(len(keys) - 0.4, -0.6)
    right = max(axes.get_xlim()[1], 1.0)
    axes.set_xlim(0, min(right, 4.0) * 1.02)
    axes.set_xlabel("share of the time" + ("; hatched: on top" if any(points[k]["beside"] for k in keys) else ""))
    axes.set_title("c  Where the time goes", pad=30)
    axes.legend(loc="lower left", bbox_to_anchor=(-0.05, 1.0), ncols=3, fontsize=7, columnspacing=0.8,
                handlelength=1.0, borderpad=0.2)  # fmt: skip


def _sources(axes: Any, data: Mapping[str, Any]) -> None:
    """How much the observable still changes with each of the five sources."""
    rows = data["sources"]
    sizes = [s["size"] for s in rows if s["size"]]
    high = max(sizes, default=1.0) * 8.0
    low = min(min(sizes, default=1e-3) / 5.0, high / 1e3)  # so that an axis has decades to name
    for place, s in enumerate(rows):
        if s["size"]:
            colour = SKY if s["source"] != "reference" else ORANGE
            axes.barh(place - 0.07, s["size"] - low, left=low, height=0.36, color=colour)
            axes.text(s["size"], place - 0.09, f" {s['size']:.2g}", va="center", fontsize=8)
        elif s["size"] == 0:
            axes.text(low, place - 0.09, " 0", va="center", fontsize=8)
        text = "\n".join(textwrap.wrap(s["words"], 112, max_lines=2, placeholder=" ..."))
        axes.text(low, place + 0.14, text, va="top", fontsize=6.3, color=GREY, linespacing=1.0)
    axes.set(xscale="log", xlim=(low, high))
    if not sizes:
        axes.xaxis.set_visible(False)
    axes.set_ylim(len(rows) - 0.25, -0.5)
    axes.set_yticks([place - 0.07 for place in range(len(rows))], [s["source"] for s in rows])
    axes.set(xlabel="what the last refinement still changes", title="d  Where the error comes from")


def _effects(axes: Any, data: Mapping[str, Any]) -> None:
    """What each effect costs a step, and what it does to the error."""
    rows = data["effects"]
    axes.set_title("e  What switching it on costs")
    if not rows:
        axes.text(0.5, 0.5, "no effect is switched in this panel", transform=axes.transAxes, ha="center", color=GREY)
        axes.set_axis_off()
        return
    for place, e in enumerate(rows):
        share = 100 * real(e["share"])
        axes.barh(place, share, height=0.38, color=BLUE if share > 0 else GREEN)
        after = e["stopped_with"].split()[0] if e["stopped_with"] else f"{real(e['error_with']):.2g}"
        before = e["stopped_without"].split()[0] if e["stopped_without"] else f"{real(e['error_without']):.2g}"
        said = f"{share:+.0f} %, error {before} to {after}"
        if e["launches"] is not None:
            said += f", {e['launches']:+d} launches, {e['bytes']:+d} B"
        axes.text(0.01, place + 0.24, f"{e['words']}:\n{said}", va="top", fontsize=6.8, color="#333333",
                  transform=axes.get_yaxis_transform(), linespacing=1.0,
                  bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.3})  # fmt: skip
    axes.axvline(0, color=GREY, lw=0.8)
    axes.set(yticks=[], ylim=(len(rows) - 0.2, -0.5), xlabel="more time for a step [%]")


def _words(left: Any, right: Any, data: Mapping[str, Any], points: Mapping[str, Any]) -> None:
    """The front in words at the left; reference, starts, omissions and machines at the right."""
    for axes in (left, right):
        axes.set_axis_off()
    lines = []
    for number, key in enumerate(data["front"], 1):
        p = points[key]
        time = seconds(p["seconds"]).replace(" ", "\u00a0")  # a number and its unit stay on one line
        said = f"{number}  {p['words']}: {p['error']:.2g} in {time}"
        if p["unstable"]:
            said += f" (unstable: {p['unstable']})"
        if p["elsewhere"]:
            said += f"; but {p['elsewhere']}"
        lines += textwrap.wrap(said, 112, subsequent_indent="    ")
    left.text(0, 1, "\n".join(lines[:14]), transform=left.transAxes, va="top", fontsize=7.6, linespacing=1.25)
    beside = [f"Reference: {data['reference']}."]
    for start in data["starts"]:
        beside.append(
            f"Starting {start['words']}: {start['cold']:.1f} s with nothing compiled, {start['warm']:.1f} s afterwards."
        )
    beside.append(f"First calls (compiling, or loading) took {data['compile']:.0f} s and are in no time above.")
    if data["omissions"]:
        beside.append("Left out: " + "; ".join(data["omissions"]) + ".")
    for place in data["where"][:2]:
        load = "" if place["load"] is None else f", load {place['load'][0]:.1f} to {place['load'][1]:.1f}"
        commit = str(place["source"]["commit"] or "unknown")[:10] + ("+" if place["source"]["changed"] else "")
        said = f"{place['processor']}, {place['threads']} of {place['cores']} threads"
        if place["device"]:
            said = f"GPU: {place['device'].get('name')} ({place.get('date', 'today')}); host {said}"
        beside.append(f"{said}{load}; source {commit}.")
    beside = list(dict.fromkeys(beside))
    small = [line for part in beside for line in textwrap.wrap(part, 116)]
    right.text(
        0, 1, "\n".join(small[:12]), transform=right.transAxes, va="top", fontsize=7.4, color="#444444",
        linespacing=1.2,
    )  # fmt: skip


def seconds(value: float | None) -> str:
    """A time for a label."""
    if value is None or not math.isfinite(value):
        return "none"
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-6:.3g} us"
