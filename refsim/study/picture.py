"""The picture of a study: value against spacing, error against time, sources of error, what each change costs."""

import math
from typing import Any

import numpy as np

BLUE, VERMILION, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"  # Okabe & Ito's palette


def draw(study: Any) -> Any:
    """A Matplotlib figure of four panels, from a `refsim.study.result.Study`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    (values, errors), (sources, changes) = figure.subplots(2, 2)
    _values(study, values)
    _errors(study, errors)
    errors.axhline(100 * study.error, color=GREY, lw=1)
    errors.set_xlabel("seconds of the processor; on a GPU of the clock")
    _sources(study, sources)
    _changes(study, changes)
    figure.suptitle(f"{study.observable} of {study.scene.name}", fontsize=11)
    return figure


def _values(study: Any, axes: Any) -> None:
    from matplotlib.ticker import MaxNLocator

    levels = study.of("spacing")
    spacing = [s.scene.spacing for s, _ in levels]
    axes.plot(spacing, [r.value for _, r in levels], "o-", color=BLUE)
    stopped = [s.scene.spacing for s, r in study.runs if s.kind == "spacing" and r.failed]
    if stopped:
        height = [0.04] * len(stopped)
        axes.plot(stopped, height, "x", color=VERMILION, ms=9, transform=axes.get_xaxis_transform(), label="stopped")
        axes.legend(fontsize=9)
    limit = study.convergence
    if limit is not None and math.isfinite(limit.uncertainty):
        width = [0, 1.05 * max(spacing)]
        axes.fill_between(
            width, limit.value - limit.uncertainty, limit.value + limit.uncertainty, color=BLUE, alpha=0.15
        )
        if limit.asymptotic:
            h = np.linspace(0, max(spacing), 60)
            finest = min(levels, key=lambda pair: pair[0].scene.spacing)
            slope = (finest[1].value - limit.value) / finest[0].scene.spacing ** limit.order
            axes.plot(h, limit.value + slope * h**limit.order, "--", color=GREY, lw=1)
            axes.set_title(f"order {limit.order:.2f}, ± {100 * limit.relative:.2g} %", fontsize=9)
        else:
            axes.set_title("not in the asymptotic range", fontsize=9)
    axes.set_xlim(left=0)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.set_xlabel("spacing [m]")
    axes.set_ylabel(f"{study.observable} [{study.unit}]" if study.unit else study.observable)


def _errors(study: Any, axes: Any) -> None:
    limit = study.convergence
    points = [] if limit is None else [(r.seconds, 100 * limit.bound(r.value)) for _, r in study.of("spacing")]
    points = [(seconds, error) for seconds, error in points if seconds > 0 and 0 < error < math.inf]
    if points:
        axes.loglog(*zip(*points), "o-", color=BLUE, label="spacings")
    for error, colour in ((study.error, VERMILION), (study.error / 2, GREEN)):
        advice = study.cheapest(error)
        if advice is not None and advice.seconds > 0:
            filled = colour if advice.measured else "none"
            axes.loglog(
                [advice.seconds], [100 * error], "D", color=colour, markerfacecolor=filled,
                label=f"{100 * error:g} %: {advice.spacing:.3g} m" + ("" if advice.measured else ", estimated"),
            )  # fmt: skip
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)
    _plain(axes.xaxis)
    _plain(axes.yaxis)
    axes.set_ylabel("bound of the error [%]")
    axes.set_title("what an error costs", fontsize=9)


def _plain(axis: Any) -> None:
    """Numbers without powers of ten; between them where an axis has less than two decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if axis.get_scale() != "log":
        return
    low, high = axis.get_view_interval()
    few = 0 < low < high < 100 * low
    axis.set_major_locator(LogLocator(subs=(1, 2, 5) if few else (1,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def _sources(study: Any, axes: Any) -> None:
    """Bars of the error of the scene as it is, by source."""
    sources = sorted(study.sources().items(), key=lambda item: item[1])
    axes.barh([name for name, _ in sources], [100 * error for _, error in sources], 0.6, color=BLUE)
    for k, (_, error) in enumerate(sources):
        axes.annotate(f" {100 * error:.2g} %", (100 * error, k), va="center", fontsize=9)
    axes.axvline(100 * study.error, color=GREY, lw=1)
    if any(error > 0 for _, error in sources):
        axes.set_xscale("log")
        axes.margins(x=0.25)
        _plain(axes.xaxis)
    axes.set_xlabel("error of the scene as it is [%]")
    axes.set_title("where the error comes from", fontsize=9)


def _changes(study: Any, axes: Any) -> None:
    rows = [row for row in study.rows() if row["what"] != "spacing" and row["change"] is not None]
    rows.reverse()
    place = np.arange(len(rows))
    saved = [100 * (1 - row["cost"]) if row["what"] == "effect" else 100 * (row["cost"] - 1) for row in rows]
    axes.barh(
        place + 0.2, [100 * row["change"] for row in rows], 0.36, color=VERMILION, label="changes the value by [%]"
    )
    axes.barh(place - 0.2, saved, 0.36, color=BLUE, label="costs [% of the seconds]")
    axes.set_yticks(place, [row["setting"] for row in rows], fontsize=8)
    axes.axvline(0, color=GREY, lw=0.8)
    axes.set_xscale("symlog", linthresh=1.0)
    if rows:
        axes.set_ylim(-0.7, len(rows) + 0.8)  # the legend stands above the bars
        axes.legend(fontsize=9, loc="upper right")
    axes.set_title("each change alone; of an effect, what it costs", fontsize=9)
