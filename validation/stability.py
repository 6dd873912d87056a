"""Hard cases, whose outcomes are on file, and maps of what is stable: `python -m validation stability [NAME ...]`.

An experiment names them as `hard_cases` and `maps`. A hard case ends in a pass, a refusal, or a stop with a reason;
what stands in the experiment's `expected.toml`, as `[hard_case.NAME]`, must come out again. In every cell of a map the
runner's own limit must lie below what was measured.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from validation.checks import FAIL, HARD_CASE, Check, expected, number
from validation.checks import PASS as WELL
from validation.drawing import BLACK, GREY
from validation.experiment import Experiment, Options, Part, Picture, Results, Run, chosen
from validation.results import Result, real
from validation.tables import Table
from validation.trials import FAILS, PASS, REFUSED, STOPPED, WARNED, Cell, HardCase, StabilityMap


@dataclass(frozen=True)
class OnFile:
    """The outcome on file of one hard case; `why` explains one that is not a pass."""

    outcome: str
    why: str = ""


def outcomes(experiment: str, folder: Path | None = None) -> dict[str, OnFile]:
    """The outcomes on file. Raises ValueError for an entry that does not say what it must."""
    entries = expected(experiment, HARD_CASE, folder)
    for name, entry in entries.items():
        said = entry.get("outcome", "")
        if not said or set(entry) - {"outcome", "why"} or ("why" in entry) == (said == PASS):
            raise ValueError(f"{experiment}: [hard_case.{name}] needs an outcome and, unless that is a pass, why")
    return {name: OnFile(**entry) for name, entry in entries.items()}


def parts(names: Sequence[str], experiments: Mapping[str, Experiment], options: Options) -> list[Part]:
    """The named experiments, hard cases and maps, or all. Raises InputError for a name that there is not."""
    own = {name: e for name, e in experiments.items() if e.hard_cases or e.maps}
    owner = {case.name: name for name, e in own.items() for case in e.hard_cases}
    owner |= {m.name: name for name, e in own.items() for m in e.maps}
    chosen(names, {**own, **owner}, "experiment, hard case or map")
    made = []
    for name, experiment in own.items():
        some = [part for part in names if owner.get(part) == name]
        if name in names or not names:
            made.append(part_of(experiment, options))
        elif some:
            made.append(part_of(experiment, options, some))
    return made


def part_of(experiment: Experiment, options: Options, only: Sequence[str] = (), folder: Path | None = None) -> Part:
    """An experiment's hard cases and maps; `only` names some of them."""
    hard = [case for case in experiment.hard_cases if not only or case.name in only]
    maps = [m for m in experiment.maps if not only or m.name in only]
    runs = []
    for case in hard:
        skip = "long; run without --quick" if options.quick and not case.short and not only else ""
        parameters = {**case.parameters, "backend": options.backend}
        runs.append(Run(case.name, case.function, parameters, estimate=case.seconds, skip=skip))
    for m in maps:
        if options.quick and not only:
            runs.append(Run(m.name, m.cells[0].function, skip="a sweep of many runs; run without --quick"))
            continue
        for cell in m.cells:
            parameters = {**cell.parameters, "backend": options.backend}
            runs.append(Run(_key(m, cell), cell.function, parameters, estimate=cell.seconds))

    def checks(results: Results) -> list[Check]:
        known = outcomes(experiment.name, folder)
        made = [judged(case, results[case.name], known.get(case.name)) for case in hard if case.name in results]
        cells = [(m, cell) for m in maps for cell in m.cells if _key(m, cell) in results]
        return [*made, *(judged_cell(m, cell, results[_key(m, cell)]) for m, cell in cells)]

    def tables(results: Results) -> list[Table]:
        made = [outcome_table(experiment.name, hard, results), *(map_table(m, results) for m in maps)]
        return [t for t in made if t.rows]

    names = {case.name for case in hard}
    pictures = [*map(map_picture, maps), *(p for p in experiment.pictures if names & set(p.needs))]
    return Part(HARD_CASE, experiment.name, experiment.name, runs, checks, pictures, tables)


def judged(case: HardCase, result: Result, known: OnFile | None) -> Check:
    """The verdict on an outcome: it is the one on file, or misses fewer checks than that."""
    checks, outcome = result.values["checks"], result.values["outcome"]
    held = sum(check["held"] for check in checks.values())
    expected = known.outcome if known else "nothing on file"
    verdict = WELL if foreseen(outcome, expected) else FAIL
    return Check(
        case.name, f"{case.hard}: {outcome}", held, f"of {len(checks)} checks", "", f"on file: {expected}", verdict
    )


def foreseen(outcome: str, expected: str) -> bool:
    """Whether an outcome is the expected one; where checks are missed, no others may be (which of them are differs from
    one processor to another, because splashes are chaotic), and what the run warned of may go well."""
    kind, _, missed = outcome.partition(": ")
    as_kind, _, may_miss = expected.partition(": ")
    if kind in (FAILS, WARNED):
        return kind == as_kind and set(missed.split(", ")) <= set(may_miss.split(", "))
    return outcome == expected or (outcome == PASS and as_kind == WARNED)


def judged_cell(m: StabilityMap, cell: Cell, result: Result) -> Check:
    """The verdict on a map's cell: what the runner lets pass without a word is stable."""
    largest, runner = real(result.values["largest"]), real(result.values["runner"])
    what = f"{m.quantity}, {cell.row}, {cell.column}"
    verdict, expected = WELL if runner <= largest else FAIL, f"at least {number(runner)}, the runner's own"
    if result.values.get("refused"):
        verdict, expected = WELL if largest == 0 else FAIL, "none: the runner refuses to choose a step"
    return Check(_key(m, cell), what, largest, "", "", expected, verdict)


def _key(m: StabilityMap, cell: Cell) -> str:
    return f"{m.name}.{cell.key}"


# Tables and pictures


def outcome_table(system: str, hard: Sequence[HardCase], results: Results) -> Table:
    """What became of every hard case."""
    rows = []
    for case in hard:
        if case.name in results:
            values = results[case.name].values
            rows.append([case.name, case.hard, values["outcome"], worst(values)])
    return Table(f"Hard cases: {system}", ["case", "what is hard", "outcome", "nearest to its bound"], rows)


def worst(values: Mapping[str, Any]) -> str:
    """The check that is nearest to its bound, or beyond it, in words; the first sentence of a stop or a refusal."""
    if values["outcome"].startswith((STOPPED, REFUSED)):
        return values["message"].partition(": ")[0].partition(";")[0].rstrip(".")

    def used(check: Mapping[str, Any]) -> float:
        value, bound = real(check["value"]), real(check["bound"])
        if not check["held"]:
            return 2.0
        if check["rule"] == "exactly" or bound == 0:
            return 0.0
        share = value / bound if check["rule"] == "at most" else bound / value if value else 0.0
        return share if share == share else 2.0

    if not values["checks"]:
        return "-"
    what, check = max(values["checks"].items(), key=lambda item: used(item[1]))
    return f"{what} {number(real(check['value']))} ({check['rule']} {number(real(check['bound']))})"


def map_table(m: StabilityMap, results: Results) -> Table:
    """Largest stable values, the runner's own limits, and what happens beyond."""
    rows: list[list[Any]] = []
    for cell in m.cells:
        if _key(m, cell) in results:
            values = results[_key(m, cell)].values
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
            values = results[_key(m, cell)].values
            cells.append({"row": cell.row, "column": cell.column, **{k: values[k] for k in _CELL}})
        return {
            "title": m.title,
            "quantity": m.quantity,
            "criterion": m.criterion,
            "advice": m.advice,
            "machine": results[_key(m, m.cells[0])].about.get("machine"),
            "cells": cells,
        }

    return Picture(m.name, collect, draw_map, tuple(_key(m, cell) for cell in m.cells))


_CELL = ("largest", "failing", "why", "runner", "tried")


def draw_map(data: Mapping[str, Any]) -> Any:
    """A heat map: in each cell the largest stable value, two digits, and the runner's own limit; the colour is their
    ratio."""
    import matplotlib.pyplot as plt
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Rectangle

    rows = list(dict.fromkeys(cell["row"] for cell in data["cells"]))
    columns = list(dict.fromkeys(cell["column"] for cell in data["cells"]))
    heads = [textwrap.fill(column, 19) for column in columns]
    lines = max(head.count("\n") for head in heads) + 1
    figure, axes = plt.subplots(figsize=(2.6 + max(1.45 * len(columns), 4.4), 1.5 + 0.18 * lines + 0.52 * len(rows)))
    margins = np.full((len(rows), len(columns)), np.nan)
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
        dark = runner > 0 and not 0.25 < margins[there] < 4.5
        axes.text(there[1], there[0] - 0.14, said, ha="center", va="center", fontsize=9, fontweight="bold",
                  color="white" if dark else BLACK)  # fmt: skip
        axes.text(there[1], there[0] + 0.24, limit, ha="center", va="center", fontsize=7,
                  color="white" if dark else BLACK)  # fmt: skip
    axes.imshow(margins, cmap="RdYlBu", norm=norm, aspect="auto")
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


NO_LIMIT = "#d9d9d9"
WIDEST_MARGIN = 8.0  # ratio of the largest stable value to the runner's limit at which the colour saturates


def two_digits(value: float) -> str:
    """A number with two significant digits, without an exponent between 0.001 and 10,000."""
    if not math.isfinite(value):
        return "none"
    rounded = float(f"{value:.1e}")
    return f"{rounded:,.{max(0, 1 - math.floor(math.log10(rounded)))}f}" if 1e-3 <= rounded < 1e5 else f"{rounded:.1e}"


def markdown(experiment: Experiment) -> list[str]:
    """The rows of the page's table: case, what must hold, outcome on file and why."""
    known = outcomes(experiment.name)
    rows = []
    for case in experiment.hard_cases:
        on_file = known[case.name]
        outcome = on_file.outcome if on_file.outcome == PASS else f"**{on_file.outcome}**: {on_file.why}"
        rows.append(f"| `{case.name}` | {case.hard} | {case.holds} | {outcome} |")
    return rows
