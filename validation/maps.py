"""Maps of how far a setting can go: judged, as a table, and as a picture."""

import math
import textwrap
from collections.abc import Mapping
from typing import Any

import numpy as np

from validation.checks import FAIL, HARD_CASE, PASS, Check, number
from validation.drawing import BLACK, BLUE, GREY, VERMILION, headline, signs
from validation.experiment import Picture, Results
from validation.results import Result, real
from validation.tables import Table
from validation.trials import Cell, StabilityMap


def judged_cell(m: StabilityMap, cell: Cell, result: Result) -> Check:
    """The verdict on a map's cell: what the runner lets pass without a word is stable."""
    largest, runner = real(result.values["largest"]), real(result.values["runner"])
    what = f"{m.quantity}, {cell.row}, {cell.column}"
    verdict, expected = PASS if runner <= largest else FAIL, f"at least {number(runner)}, the runner's own"
    if result.values.get("refused"):
        verdict, expected = PASS if largest == 0 else FAIL, "none: the runner refuses to choose a step"
    return Check(cell_key(m, cell), what, largest, "", "", expected, verdict, HARD_CASE)


def cell_key(m: StabilityMap, cell: Cell) -> str:
    """Key of the run of a map's cell."""
    return f"{m.name}.{cell.key}"


def map_table(m: StabilityMap, results: Results) -> Table:
    """Largest stable values, the runner's own limits, and what happens beyond."""
    rows: list[list[Any]] = []
    for cell in m.cells:
        if cell_key(m, cell) in results:
            values = results[cell_key(m, cell)].values
            beyond = real(values["failing"])
            said = values["why"] or ("stable as far as tried" if beyond != beyond else "")
            rows.append([cell.row, cell.column, *(real(values[k]) for k in ("runner", "largest")), beyond, said])
    heading = ["", "", "runner's limit", "largest stable", "next tried", "what happens there"]
    return Table(f"{m.title}: {m.quantity}", heading, rows, f"Stable: {m.criterion} {m.advice}")


def map_picture(m: StabilityMap) -> Picture:
    """A map as a picture, drawn from what its cells found."""

    def collect(results: Results) -> dict[str, Any]:
        cells = []
        for cell in m.cells:
            values = results[cell_key(m, cell)].values
            cells.append({"row": cell.row, "column": cell.column, **{k: values[k] for k in _CELL}})
        return {
            "title": m.title, "quantity": m.quantity, "criterion": m.criterion, "advice": m.advice,
            "machine": results[cell_key(m, m.cells[0])].about.get("machine"), "cells": cells,
        }  # fmt: skip

    return Picture(m.name, collect, draw_map, tuple(cell_key(m, cell) for cell in m.cells))


_CELL = ("largest", "failing", "why", "runner", "tried")


def draw_map(data: Mapping[str, Any]) -> Any:
    """A heat map: in each cell the largest stable value, two digits, and the runner's own limit; the colour is their
    ratio."""
    import matplotlib
    import matplotlib.pyplot as plt
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Rectangle

    rows = list(dict.fromkeys(cell["row"] for cell in data["cells"]))
    columns = list(dict.fromkeys(cell["column"] for cell in data["cells"]))
    if len(columns) == 1:
        return draw_column(data)
    heads = [signs(textwrap.fill(column, 19)) for column in columns]
    lines = max(head.count("\n") for head in heads) + 1
    figure, axes = plt.subplots(figsize=(2.6 + max(1.45 * len(columns), 4.4), 1.5 + 0.18 * lines + 0.52 * len(rows)))
    margins = np.full((len(rows), len(columns)), np.nan)
    colours = matplotlib.colormaps["RdYlBu"]
    norm = LogNorm(1 / WIDEST_MARGIN, WIDEST_MARGIN, clip=True)
    for cell in data["cells"]:
        largest, runner, failing = (real(cell[k]) for k in ("largest", "runner", "failing"))
        there = rows.index(cell["row"]), columns.index(cell["column"])
        if runner > 0:
            margins[there] = min(max(largest / runner, 1 / WIDEST_MARGIN), WIDEST_MARGIN)
        else:
            axes.add_patch(
                Rectangle((there[1] - 0.5, there[0] - 0.5), 1, 1, facecolor=NO_LIMIT, edgecolor="white", lw=2)
            )
        said = f"{'at least ' * (not failing < float('inf'))}{two_digits(largest)}" if largest > 0 else "none"
        limit = f"runner: {two_digits(runner)}" if runner > 0 else "runner: none"
        dark = runner > 0 and np.dot(colours(norm(margins[there]))[:3], (0.3, 0.59, 0.11)) < 0.5
        axes.text(there[1], there[0] - 0.14, said, ha="center", va="center", fontsize=9, fontweight="bold",
                  color="white" if dark else BLACK)  # fmt: skip
        axes.text(there[1], there[0] + 0.24, limit, ha="center", va="center", fontsize=7,
                  color="white" if dark else BLACK)  # fmt: skip
    axes.imshow(margins, cmap=colours, norm=norm, aspect="auto")
    axes.set_xticks(range(len(columns)), heads, fontsize=8)
    axes.set_yticks(range(len(rows)), [textwrap.fill(row, 30) for row in rows], fontsize=8)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.set_xticks([k + 0.5 for k in range(len(columns) - 1)], minor=True)
    axes.set_yticks([k + 0.5 for k in range(len(rows) - 1)], minor=True)
    axes.grid(False)
    axes.grid(True, which="minor", color="white", lw=2.0)
    axes.tick_params(which="minor", length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    width = int(12 * figure.get_figwidth())
    figure.suptitle(textwrap.fill(data["title"], width), x=0.01, ha="left", fontweight="bold", fontsize=10.5)
    figure.supxlabel(
        textwrap.fill(
            f"Largest stable {data['quantity']}. Blue: beyond the runner's own limit; red: below it; grey:"
            " the runner lets no value pass without a note", width,
        ),
        fontsize=8.5, color=GREY,
    )  # fmt: skip
    return figure


def draw_column(data: Mapping[str, Any]) -> Any:
    """A map of one column: from the largest stable value of each row to the next that fails; the runner's own limit."""
    import matplotlib.pyplot as plt

    cells = data["cells"]
    figure, axes = plt.subplots(figsize=(7.2, 0.36 * len(cells) + 1.5))
    for k, cell in enumerate(cells):
        largest, runner, failing = (real(cell[name]) for name in ("largest", "runner", "failing"))
        lasts = not failing < float("inf")
        if largest > 0:
            axes.plot(largest, k, ">" if lasts else "o", color=BLUE, ms=8)
            said = f"{'at least ' * lasts}{two_digits(largest)}"
            beside = max(largest, runner if runner < 2 * largest else 0.0)
            axes.annotate(said, (beside, k), (9, 0), textcoords="offset points", va="center", fontsize=9.5)
        else:
            axes.text(0.01, k, "none", transform=axes.get_yaxis_transform(), va="center", fontsize=9.5)
        if runner > 0:
            axes.plot(runner, k, "|", color=VERMILION, ms=16, mew=2)
    axes.plot([], [], "o", color=BLUE, label="largest stable value")
    axes.plot([], [], ">", color=BLUE, label="stable as far as tried")
    axes.plot([], [], "|", color=VERMILION, ms=12, mew=2, label="limit of the runner")
    axes.set_yticks(range(len(cells)), [cell["row"] for cell in cells])
    axes.set(xscale="log", ylim=(len(cells) - 0.5, -0.6))
    axes.set_xlabel(textwrap.fill(f"largest stable {data['quantity']}", 70))
    axes.set_xlim(axes.get_xlim()[0], axes.get_xlim()[1] * 3)
    axes.grid(True, axis="x")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=9)
    headline(figure, textwrap.fill(data["title"], 76), 10.5)
    return figure


NO_LIMIT = "#d9d9d9"
WIDEST_MARGIN = 64.0  # ratio of the largest stable value to the runner's limit at which the colour saturates


def two_digits(value: float) -> str:
    """A number with two significant digits, without an exponent between 0.001 and 10,000."""
    if not math.isfinite(value):
        return "none"
    rounded = float(f"{value:.1e}")
    return f"{rounded:,.{max(0, 1 - math.floor(math.log10(rounded)))}f}" if 1e-3 <= rounded < 1e5 else f"{rounded:.1e}"
