"""What the method costs: seconds to steady state (table 1), the stages of a step, and each effect's price.

The paper's 30.3 s are on an unnamed machine with unstated parameters (Jiang & Zhu E17): absolute times are only shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.droplet import runs as droplet_runs
from validation.experiments.timing import pictures, runs
from validation.tables import Table

PAPER_SECONDS, PAPER_COUNT = 30.3, 5039
STEADY = {  # variant of the tension and whether the surface is detected, which the paper's text needs for its force
    "steady_default": ("default", False), "steady_default_detection": ("default", True),
    "steady_soft": ("soft", False), "steady_soft_detection": ("soft", True), "steady_text": ("text", True),
    "steady_one_sided": ("one_sided", False),
}  # fmt: skip
PEER_TENSION = 0.05  # of Akinci et al. 2013 beside SPlisHSPlasH: present, and too weak to break the block up
QUICK_SCENES = ("liquid", "gravity", "detection", "default", "default_detection")
PEERS = {
    "peer_splishsplash": ("peer_ratio", "splishsplash", "with viscosity"),
    "peer_splishsplash_akinci": ("peer_ratio_akinci", "splishsplash_akinci", "with viscosity and Akinci 2013"),
}


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    backend, threads = options.backend, options.threads
    slow = "takes a minute with the others; run without --quick" if options.quick else ""
    reason = "" if options.peers else "measured with --peers"
    few = {"steps": 100, "named": QUICK_SCENES} if options.quick else {}
    steady = {"shape": "cut", "count": PAPER_COUNT, "backend": backend}
    peer = {"side": 47, "steps": 30, "rounds": 3 if options.quick else 5, "threads": threads or 2}
    return [
        *(Run(key, droplet_runs.relax, {**steady, "variant": variant, "detection": detection}, 14.0, slow,
              timed=True) for key, (variant, detection) in STEADY.items()),
        Run("steps", runs.step_costs, {"steps": 200, "backend": backend, "threads": threads, **few}, 16.0),
        Run("peer_splishsplash", runs.against_splishsplash, peer, 60.0, reason),
        Run("peer_splishsplash_akinci", runs.against_splishsplash, {**peer, "tension": PEER_TENSION}, 90.0, reason),
    ]  # fmt: skip


def checks(results: Results, check: Checks) -> None:
    """Absolute times are shown; the ratio to the peer is judged."""
    for key, result in results.items():
        if key.startswith("steady_"):
            steady = result.values["steady"]
            words = described(key)
            seconds = float("nan") if steady is None else steady["wall"]
            check("steady_seconds", seconds, key.removeprefix("steady_"), words)
    if "steps" in results:
        for name, row in results["steps"].values["scenes"].items():
            check("step_time", 1e3 * row["step"], name, row["words"])
    for key, (ratio, name, words) in PEERS.items():
        if key not in results or results[key].values["missing"]:
            continue
        values = results[key].values
        check(ratio, values["ratio"], name, "SPlisHSPlasH")
        for part, program in (("refsim", "refsim"), ("peer", "SPlisHSPlasH")):
            run = part if key == "peer_splishsplash" else f"{part}_akinci"
            check("peer_time", 1e6 * values[part]["median"], run, f"{program}, {words}")


def described(key: str) -> str:
    """A run to steady state in words."""
    words = {
        "default": "all pairs", "soft": "soft pairs", "text": "the paper's text, detection on",
        "one_sided": "the paper's words: force on surface particles only",
    }  # fmt: skip
    variant = key.removeprefix("steady_")
    if variant.endswith("_detection"):
        return f"{words[variant.removesuffix('_detection')]}, detection on"
    return words[variant]


def tables(results: Results) -> list[Table]:
    """Table 1's own column, the step's stages, and what each effect costs."""
    made = []
    rows: list[list[Any]] = []
    for key, result in results.items():
        if not key.startswith("steady_"):
            continue
        values, steady = result.values, result.values["steady"]
        upto = steady or {
            "wall": values["seconds"], "steps": values["steps"], "stages": values["series"]["stages"][-1],
            "time": values["series"]["time"][-1],
        }  # fmt: skip
        share = runs.grouped(upto["stages"])
        other = max(upto["wall"] - sum(share.values()), 0.0)
        cells = [f"{share.get(group, 0.0):.2f}" for group in runs.GROUPS] + [f"{other:.2f}"]
        state = "not steady" if steady is None else "steady"
        if values["stopped"]:
            state = f"stopped: {values['stopped']}"
        rows.append([described(key), state, f"{upto['wall']:.2f}", upto["steps"], *cells])
    if rows:
        rows.append(["Jiang & Zhu 2023, their machine", "steady", f"{PAPER_SECONDS:.1f}", None, *[None] * 6])
        made.append(
            Table(
                f"Table 1, own column: seconds to steady state (or to the end), cube of {PAPER_COUNT:,} particles",
                ["pairs", "state", "seconds", "steps", *runs.GROUPS, "other"],
                rows,
                "Steady: kinetic energy at most 1e-3 of its peak and radius variation at most 0.005, from then on.",
            )
        )
    if "steps" in results:
        values = results["steps"].values
        rows, prices = [], []
        for row in values["scenes"].values():
            share = runs.grouped(row["stages"])
            cells = [f"{1e3 * share.get(group, 0.0):.2f}" for group in runs.GROUPS]
            rows.append([row["words"], f"{1e3 * row['step']:.2f}", *cells, row["rebuilds"]])
        for row in values["prices"]:
            difference = f"{1e3 * row['seconds']:+.2f}", f"{1e3 * row['spread']:.2f}"
            prices.append([row["words"], *difference, f"{row['bytes']:+d}", f"{row['launches']:+d}"])
        count, steps = values["particles"], values["steps"]
        made.append(
            Table(
                f"A step of the droplet, {count:,} particles: milliseconds, means over {steps} steps (step: median)",
                ["scene", "step", *runs.GROUPS, "rebuilds"],
                rows,
                "Compiling is not in the table.",
            )
        )
        made.append(
            Table(
                "What each effect costs",
                ["added", "ms per step", "spread", "bytes per particle", "launches per step"],
                prices,
                "Differences of the medians above; the spread is the sum of both median deviations.",
            )
        )
    made += [_peer_table(results[key].values, words) for key, (_, _, words) in PEERS.items() if key in results]
    return made


def _peer_table(values: Mapping[str, Any], words: str) -> Table:
    """The other program's step beside this one's."""
    if values["missing"]:
        return Table("Other programs", ["program", "result"], [["SPlisHSPlasH", f"left out: {values['missing']}"]])
    low, high = min(values["ratios"]), max(values["ratios"])
    rows = []
    for name, program in (("peer", f"SPlisHSPlasH {values['version']}"), ("refsim", "refsim")):
        part = values[name]
        rows.append([program, f"{1e6 * part['median']:.3f}", f"{1e6 * part['low']:.3f} to {1e6 * part['high']:.3f}"])
    return Table(
        f"WCSPH step {words}, {values['particles']:,} particles, support radius 2 spacings, float32,"
        f" {values['threads']} threads, alternating runs",
        ["program", "us per particle and step", "range"],
        rows,
        f"Ratio {values['ratio']:.2f} ({low:.2f} to {high:.2f}); neighbour search included in both.",
    )


EXPERIMENT = Experiment(
    name="timing",
    title="seconds to steady state (table 1), the stages of a step, what each effect costs, other programs",
    runs=planned,
    checks=checks,
    pictures=(Picture("table_1", pictures.steady_data, pictures.steady_picture, tuple(STEADY)),),
    tables=tables,
)
