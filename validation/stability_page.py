"""The generated parts of docs/stability.md: matrix, totals, failures, cases (`python -m validation stability --write`).

Everything comes from the hard cases of the experiments and their outcomes on file (`expected.toml`). A part stands on
the page between two marks that name it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from validation.checks import PASS as WELL
from validation.drawing import GREY, save_picture, style
from validation.experiment import Experiment
from validation.stability import markdown, outcomes
from validation.trials import FAILS, PASS, REFUSED, STOPPED, WARNED

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "stability.md"
MATRIX = ROOT / "figures" / "stability_matrix.png"

KINDS = (PASS, WARNED, REFUSED, STOPPED, FAILS)
WORDS = {
    PASS: "passes", WARNED: "warned beforehand", REFUSED: "refused", STOPPED: "stops with a reason", FAILS: "fails",
}  # fmt: skip
COLOURS = {PASS: "#cfe8dc", WARNED: "#f3dc8f", REFUSED: "#bcdcf2", STOPPED: "#5b9bd1", FAILS: "#D55E00"}
TITLES = {  # order on the page: (heading, conditions of all its cases)
    "foundation": ("The liquid, its walls, its list and its files", ""),
    "dam_break": ("Detection and the start of a collapsing column", ""),
    "droplet": ("A drop under surface tension", ""),
    "models": (
        "Every model of surface tension",
        "h = 2.6 d, S = sigma/(rho0 c^2 d) = 0.01, Oh = 0.3 of the nominal tension unless said",
    ),
    "heat": ("Conduction of heat", ""),
    "melting": ("Solids and melting", "small pools, c = 35 m/s, h = 2.5 d; a speed above c is a failure"),
    "boundary": (
        "Meshes as boundaries",
        "meshes of every kind, and particles shot at them, by up to 3 spacings a step",
    ),
    "mpm_droplet": ("A liquid of material points under surface tension", ""),
}
GRIDS = {  # systems whose cases cross with models: suffix of the case's name, words
    "models": {
        "jiang_zhu": "Jiang & Zhu",
        "akinci_iisph": "Akinci, IISPH",
        "akinci": "Akinci",
        "dong": "Dong",
        "becker_teschner": "Becker & Teschner",
        "tartakovsky_meakin": "Tartakovsky & Meakin",
        "he": "He",
        "csf": "CSF",
    },
    "dam_break": {
        "number_density": "number density",
        "fan_scan": "fan scan",
        "two_step_printed": "two-step, printed",
        "two_step": "two-step",
        "second_moment": "second moment",
    },
}
PICTURES = {  # of what failures look like
    **{name: ("known_failures", words) for name, words in (
        ("impact_wall", "red: nearer than 0.1 d"), ("edge_wedge", "red: inside the wall"),
        ("edge_level_plate", "red: below the plate"), ("beside_walls_3d_number_density", "red: taken for surface"),
        ("sheet_1_fan_scan", "red: missed"), ("sheet_1_two_step", "red: missed by the fan scan"),
        ("filament", "the thread after 1.2 s"), ("heat_s_max_1e7", "change of heat by scheme"),
    )},
    **{f"splash_{name}": ("figure_4", "the detectors in the splash at 1.0 s")
       for name in ("number_density", "fan_scan", "two_step", "two_step_printed", "second_moment")},
}  # fmt: skip


def kind(outcome: str) -> str:
    """The kind of an outcome. Raises ValueError for one that is none of KINDS."""
    found = outcome.partition(":")[0]
    if found not in KINDS:
        raise ValueError(f"the outcome {outcome!r} is none of {', '.join(KINDS)}")
    return found


def systems(experiments: Mapping[str, Experiment]) -> dict[str, dict[str, str]]:
    """Kinds of outcome by case by system, in the page's order. Raises ValueError for a system without a title."""
    own = {name: e for name, e in experiments.items() if e.hard_cases}
    if missing := set(own) - set(TITLES):
        raise ValueError(f"validation/stability_page.py: TITLES lacks {', '.join(sorted(missing))}")
    made = {}
    for name in TITLES:
        if name in own:
            known = outcomes(name)
            made[name] = {case.name: kind(known[case.name].outcome) for case in own[name].hard_cases}
    return made


def crossed(system: str, cases: Mapping[str, str]) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    """(kinds by model by row of the system's grid, kinds of the cases that stand alone)."""
    rows: dict[str, dict[str, str]] = {}
    alone = {}
    for name, found in cases.items():
        # the longest suffix that fits: "akinci_iisph" before "akinci"
        fits = [suffix for suffix in GRIDS.get(system, ()) if name.endswith(f"_{suffix}")]
        if fits:
            suffix = max(fits, key=len)
            rows.setdefault(name.removesuffix(f"_{suffix}"), {})[suffix] = found
        else:
            alone[name] = found
    return rows, alone


def totals(experiments: Mapping[str, Experiment]) -> list[str]:
    """The table of counts: a row a system, a column a kind of outcome."""
    lines = [f"| system | cases | {' | '.join(WORDS[k] for k in KINDS)} |", "| --- |" + " --: |" * (1 + len(KINDS))]
    whole: Counter[str] = Counter()
    for system, cases in systems(experiments).items():
        count = Counter(cases.values())
        whole += count
        cells = [str(count[k] or "") for k in KINDS]
        lines.append(f"| {TITLES[system][0]} (`{system}`) | {len(cases)} | {' | '.join(cells)} |")
    sums = " | ".join(f"**{whole[k]}**" for k in KINDS)
    return [*lines, f"| **all** | **{whole.total()}** | {sums} |"]


def failures(experiments: Mapping[str, Experiment]) -> list[str]:
    """A line for each case that fails: what is hard, what is missed, and why."""
    lines = []
    for system, cases in systems(experiments).items():
        known = outcomes(system)
        hard = {case.name: case.hard for case in experiments[system].hard_cases}
        for name, found in cases.items():
            if found != FAILS:
                continue
            missed = known[name].outcome.partition(": ")[2]
            line = f"- `{name}`, {hard[name]}: {missed}. {known[name].why[:1].upper()}{known[name].why[1:]}."
            if name in PICTURES:
                picture, words = PICTURES[name]
                line += f" ([picture](../figures/{picture}.png): {words})"
            lines.append(line)
    return lines


def cases_of(experiments: Mapping[str, Experiment]) -> list[str]:
    """Every case, a table a system."""
    lines: list[str] = []
    for system in systems(experiments):
        title, conditions = TITLES[system]
        lines += [f"**{title}** (`{system}`)" + (f": {conditions}" if conditions else ""), ""]
        lines += ["| case | what is hard | what must hold | outcome |", "| --- | --- | --- | --- |"]
        lines += [*markdown(experiments[system]), ""]
    return lines[:-1]


PARTS = {"totals": totals, "failures": failures, "cases": cases_of}


def replaced(text: str, name: str, lines: Sequence[str], page: Path = PAGE) -> str:
    """The page with other lines between the marks of the part. Raises ValueError where the marks are missing."""
    begin, end = f"<!-- {name} -->\n", f"\n<!-- end of {name} -->"
    before, mark, rest = text.partition(begin)
    _, last, after = rest.partition(end)
    if not mark or not last:
        raise ValueError(f"{page.name} lacks the lines {begin.strip()!r} and {end.strip()!r}")
    return f"{before}{begin}\n" + "\n".join(lines) + f"\n{end}{after}"


def page(text: str, experiments: Mapping[str, Experiment]) -> str:
    """The page with its generated parts renewed."""
    for name, make in PARTS.items():
        text = replaced(text, name, make(experiments))
    return text


def write(experiments: Mapping[str, Experiment]) -> list[Path]:
    """Renew the page and the picture of the matrix; returns their paths."""
    PAGE.write_text(page(PAGE.read_text(), experiments))
    with style():
        save_picture(matrix(experiments), MATRIX)
    return [PAGE, MATRIX]


# The matrix as a picture

LEFT = (*GRIDS, "heat")  # systems of the left column; the others stand at the right
ACROSS = 7  # cases in a line of a system without models
CUT = {"droplet": r"^drop_", "melting": "", "mpm_droplet": r"^mpm_", "heat": r"^heat_"}


def matrix(experiments: Mapping[str, Experiment]) -> Any:
    """A tile for each hard case, coloured by its outcome; case by model where the cases cross with models."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Rectangle

    found = systems(experiments)
    left = [name for name in found if name in LEFT]
    right = [name for name in found if name not in LEFT]
    figure, columns = plt.subplots(1, 2, figsize=(15.0, 7.4), layout="none", gridspec_kw={"width_ratios": (1.0, 1.15)})
    figure.subplots_adjust(left=0.01, right=0.995, top=0.95, bottom=0.005, wspace=0.03)
    bottoms = []
    for axes, names in zip(columns, (left, right)):
        y = 0.0
        for name in names:
            y = _system(axes, name, found[name], y)
        axes.set_axis_off()
        bottoms.append(y)
    for axes in columns:
        axes.set(xlim=(0, 10), ylim=(max(bottoms), -0.2))
    count = Counter(k for cases in found.values() for k in cases.values())
    handles = [Rectangle((0, 0), 1, 1, color=COLOURS[k]) for k in KINDS]
    labels = [f"{WORDS[k]}: {count[k]}" for k in KINDS]
    figure.legend(handles, labels, loc="upper right", ncols=len(KINDS), fontsize=10, frameon=False)
    figure.suptitle(f"Outcomes of {count.total()} hard cases", x=0.01, ha="left", fontweight="bold", fontsize=13)
    return figure


def _system(axes: Any, name: str, cases: Mapping[str, str], y: float) -> float:
    """One system from `y` down: its grid, then the cases that stand alone; returns where it ends."""
    axes.text(0, y + 0.55, TITLES[name][0], fontweight="bold", fontsize=9.5, va="center")
    y += 1.0
    rows, alone = crossed(name, cases)
    if rows:
        models = list(GRIDS[name])
        width = (10 - 2.1) / len(models)
        for k, model in enumerate(models):
            axes.text(2.1 + (k + 0.5) * width, y + 0.55, GRIDS[name][model].replace(" & ", "\n& ").replace(", ", ",\n"),
                      fontsize=6.8, ha="center", va="center", color=GREY)  # fmt: skip
        y += 1.1
        for row, kinds in rows.items():
            axes.text(2.05, y + 0.5, row.replace("_", " "), fontsize=7.5, ha="right", va="center")
            for k, model in enumerate(models):
                if model in kinds:
                    _tile(axes, 2.1 + k * width, y, width, kinds[model], "" if kinds[model] == WELL else kinds[model])
            y += 0.85
    width = 10 / ACROSS
    for place, (case, found) in enumerate(alone.items()):
        words = re.sub(CUT.get(name, ""), "", case).replace("_", " ")
        _tile(axes, (place % ACROSS) * width, y + 0.85 * (place // ACROSS), width, found, words)
    return y + 0.85 * -(-len(alone) // ACROSS) + 0.35


def _tile(axes: Any, x: float, y: float, width: float, found: str, words: str) -> None:
    import textwrap

    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle((x, y), width - 0.04, 0.8, color=COLOURS[found], lw=0))
    axes.text(x + 0.5 * width, y + 0.4, textwrap.fill(words, 16), fontsize=7, ha="center", va="center",
              color="white" if found == FAILS else "black", linespacing=0.95)  # fmt: skip
