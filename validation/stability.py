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

import matplotlib.pyplot as plt
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from validation.checks import FAIL, HARD_CASE, Check, expected, number
from validation.checks import PASS as WELL
from validation.drawing import BLACK, BLUE, GREY, VERMILION
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
    """One panel a column; in each row a bar over what was stable, a cross at what was not, the runner's limit."""

    rows = list(dict.fromkeys(cell["row"] for cell in data["cells"]))
    columns = list(dict.fromkeys(cell["column"] for cell in data["cells"]))
    positive = [value for cell in data["cells"] for value, _ in cell["tried"] if value > 0]
    positive += [cell["runner"] for cell in data["cells"] if cell["runner"]]
    left, right = 0.7 * min(positive), 1.3 * max(positive)
    wide = any(len(number(real(cell["largest"]))) > 4 and cell["failing"] is None for cell in data["cells"])
    right *= (right / left) ** (0.85 if wide else 0.35)  # room for the numbers
    across = min(len(columns), 4)
    down = math.ceil(len(columns) / across)
    figure, panels = plt.subplots(
        down, across, sharex=True, sharey=True, squeeze=False,
        figsize=(2.2 + max(2.4 * across, 4.8), 0.9 + down * (0.75 + 0.4 * len(rows))),
    )  # fmt: skip
    for axes in panels.flat[len(columns) :]:
        axes.set_axis_off()
    for column, axes in zip(columns, panels.flat):
        for cell in (c for c in data["cells"] if c["column"] == column):
            y = rows.index(cell["row"])
            largest, failing = real(cell["largest"]), real(cell["failing"])
            open_end = not failing < float("inf")
            if largest > 0:
                axes.barh(y, largest - left, left=left, height=0.5, color=BLUE, alpha=0.3 if open_end else 0.55)
            said = f"{number(largest)}{' or more' if open_end else ''}" if largest > 0 else "none"
            axes.text(
                0.985, y, said, transform=axes.get_yaxis_transform(), ha="right", va="center", fontsize=8,
                color=BLACK if largest > 0 else VERMILION,
            )  # fmt: skip
            for value, said in cell["tried"]:
                mark = {"marker": "x", "color": VERMILION, "s": 26} if said else {"marker": "o", "color": BLUE, "s": 9}
                axes.scatter(value, y, zorder=3, linewidths=1.4, **mark)
            runner = cell["runner"] or left
            axes.plot([runner, runner], [y - 0.36, y + 0.36], color=BLACK, lw=2.2, zorder=4, solid_capstyle="butt")
        axes.set(xscale="log", xlim=(left, right))
        if right / left < 100:
            axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_title(column, fontweight="normal", loc="center")
        axes.grid(True, axis="x")
        axes.tick_params(axis="y", length=0)
    panels[0, 0].set_yticks(range(len(rows)), rows)
    panels[0, 0].set_ylim(len(rows) - 0.5, -0.5)
    width = int(14 * figure.get_figwidth())
    figure.suptitle(textwrap.fill(data["title"], width), x=0.01, ha="left", fontweight="bold", fontsize=10.5)
    figure.supxlabel(
        f"{data['quantity']}.\nBar: stable; cross: not; upright stroke: the runner's own limit",
        fontsize=8.5,
        color=GREY,
    )
    return figure


def markdown(experiment: Experiment) -> list[str]:
    """The rows of the page's table: case, what must hold, outcome on file and why."""
    known = outcomes(experiment.name)
    rows = []
    for case in experiment.hard_cases:
        on_file = known[case.name]
        outcome = on_file.outcome if on_file.outcome == PASS else f"**{on_file.outcome}**: {on_file.why}"
        rows.append(f"| `{case.name}` | {case.hard} | {case.holds} | {outcome} |")
    return rows
