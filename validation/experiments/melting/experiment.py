"""Melting in fluid-solid interaction (Shao & Song 2017): scenes of figures 4 to 6, table 2, conservation, regions."""

from __future__ import annotations

from refsim.backends.arrays import unavailable
from validation.checks import Checks
from validation.claims import measures
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.melting import claims, device, pictures, runs, stability
from validation.results import real
from validation.tables import Table

SHARES = {"figure_4": [0.9, 0.5, 0.1], "figure_5": [0.8, 0.5, 0.2], "figure_6": [0.8, 0.5, 0.2]}
UNTIL = 4.0  # [s]
QUICK = 0.4  # size of the scenes with --quick
PAPER = {"figure_4": ("35k + 5k", 22.5), "figure_5": ("48.5k + 12k", 35.7), "figure_6": ("40.5k + 20k", 42.3)}  # ms
ON_GPU = (*PAPER, "million")
WIDTHS = (1, 2, 3)
TITLES = {
    "figure_4": "Figure 4, an ice cube in warm water",
    "figure_5": "Figure 5, bodies of equal conductivity",
    "figure_6": "Figure 6, rabbits and ducks in two streams",
}


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    quick, backend = options.quick, options.backend
    size = QUICK if quick else 1.0
    made = []
    for figure, shares in SHARES.items():
        parameters = {"figure": figure, "size": size, "backend": backend, "shares": shares, "until": UNTIL}
        if figure == "figure_5" and not quick:
            parameters["step"] = 0.002  # see docs/melting.md
        made.append(Run(figure, runs.melt, parameters, estimate=8.0 if quick else 120.0))
        if figure == "figure_5":  # the same, every particle of a pair pushing by its own pressure
            skip = "takes as long as figure 5; run without --quick" if quick else ""
            made.append(Run("own_pressure", runs.melt, {**parameters, "weighted": False}, 120.0, skip))
    parameters = {"figure": "figure_4", "size": QUICK, "backend": backend, "shares": [0.5, 0.0], "until": UNTIL}
    made.append(Run("as_printed", runs.melt, {**parameters, "scale": 1.0, "largest_number": 10.0}, estimate=4.0))
    made.append(Run("filling", runs.filling, estimate=0.5))
    for width in WIDTHS:
        made.append(Run(f"regions_{width}", runs.region_rounds, {"half_width": width}, estimate=2.0))
    made.append(Run("lattice", runs.free_lattice, {"backend": backend, "steps": 400 if quick else 10000}, estimate=8.0))
    for dtype, bookkeeping in (("float64", "immiscible"), ("float32", "immiscible"), ("float64", "water")):
        parameters = {"backend": backend, "dtype": dtype, "bookkeeping": bookkeeping, "steps": 200 if quick else 1000}
        made.append(Run(f"kept_{dtype}_{bookkeeping}", runs.conserved, parameters, estimate=5.0))
    for figure in PAPER:
        for kind in ("cost", "rival"):
            parameters = {
                "figure": figure, "size": size, "backend": backend, "threads": options.threads, "warm": 40,
                "rounds": 5, "steps": 4, "rival": kind == "rival",
            }  # fmt: skip
            made.append(Run(f"{kind}_{figure}", runs.step_cost, parameters, estimate=1.0 if quick else 12.0))
    made += claims.shares(options)
    for figure in ON_GPU:
        made.append(
            Run(f"gpu_{figure}", device.on_gpu, {"figure": figure, "size": size}, 10.0, unavailable("cuda") or "")
        )
    for width in (1, 2, 3, 4):
        parameters = {"backend": backend, "half_width": width, "steps": 30 if quick else 60}
        made.append(Run(f"width_{width}", runs.stiffness, parameters, estimate=3.0))
    parameters = {"backend": backend, "size": QUICK if quick else 1.0, "threads": options.threads}
    parameters |= {"warm": 3, "rounds": 2, "steps": 2} if quick else {}
    made.append(Run("savings", runs.savings, parameters, estimate=1.0 if quick else 20.0))
    return made


def checks(results: Results, check: Checks) -> None:
    """Conservation, regions and bookkeeping are judged against their bars; times are shown."""
    for figure in SHARES:
        if figure in results:
            values = results[figure].values
            series = values["series"]
            check("from_inside", values["inside_melted"], figure)
            check("fragments", max(series["fragments"]), figure)
            check("fastest", max(series["fastest"]), figure)
            check("volume", abs(series["rest_volume"][-1] / series["rest_volume"][0] - 1), figure)
            check("mass", series["mass"][-1] / series["mass"][0] - 1, figure)
    if "own_pressure" in results:
        check("fastest_own_pressure", max(results["own_pressure"].values["series"]["fastest"]))
    if "as_printed" in results:
        check("printed_time", results["as_printed"].values["times"][-1])
    for width in WIDTHS:
        if f"regions_{width}" in results:
            check("wrong_regions", results[f"regions_{width}"].values["wrong"], f"w_{width}")
    if "lattice" in results:
        values = results["lattice"].values
        for name in ("angular_momentum", "momentum", "shape"):
            check(f"lattice_{name}", values[name])
    for dtype, bookkeeping in (("float64", "immiscible"), ("float32", "immiscible"), ("float64", "water")):
        key = f"kept_{dtype}_{bookkeeping}"
        if key in results:
            values, words = results[key].values, f"{dtype}, {bookkeeping}"
            if bookkeeping == "immiscible":
                check(f"heat_{dtype}", values["heat_drift"])
                check(f"momentum_{dtype}", values["momentum"])
            check(f"mass_unexplained_{dtype}", values["mass_unexplained"], bookkeeping, words)
            check(f"volume_{dtype}", values["volume_change"], bookkeeping, words)
    for figure, (words, paper) in PAPER.items():
        if f"cost_{figure}" in results:
            seconds = results[f"cost_{figure}"].values["seconds"]
            check("step", 1e3 * seconds, figure, words)
            check("step_ratio", 1e3 * seconds / paper, figure, words)
            if f"rival_{figure}" in results:
                rival = results[f"rival_{figure}"].values["seconds"]
                check("rival_ratio", rival / seconds, figure, words)


def tables(results: Results) -> list[Table]:
    """The scenes, table 2 by stage, and half-widths."""
    made = []
    rows = []
    others = {"own_pressure": "Figure 5, each by its own pressure", "as_printed": "Figure 4, K as printed under it"}
    for key, title in (TITLES | others).items():
        if key in results:
            v = results[key].values
            s = v["series"]
            rows.append(
                [title, v["particles"], sum(v["solids"]), v["times"][-1], s["solid"][-1], v["together"],
                 max(s["fragments"]), max(s["fastest"]), max(s["densest"])]
            )  # fmt: skip
    if rows:
        heading = ["scene", "particles", "solid", "last frame [s]", "solid then", "most in a step", "pieces",
                   "fastest [m/s]", "densest [rho0]"]  # fmt: skip
        made.append(Table("Scenes", heading, rows))
    rows = []
    for figure, (words, paper) in PAPER.items():
        for kind, name in (("cost", "refsim"), ("rival", "stand-in for the rival")):
            if f"{kind}_{figure}" in results:
                v = results[f"{kind}_{figure}"].values
                group = runs.grouped(v["stages"])
                rows.append([words, name, v["liquid"], v["solid"], *(1e3 * t for t in group.values()),
                             1e3 * v["seconds"], paper, v["step"] / v["seconds"]])  # fmt: skip
    if rows:
        heading = ["Table 2", "by", "liquid", "solid", *runs.GROUPS, "step", "paper", "of real time"]
        note = (
            "Milliseconds; the paper's on a GTX 690. The stand-in has explicit heat and searches every region in every"
            " step; it is not Iwasaki 2010, and figure 7's own numbers are lost."
        )
        made.append(Table("Seconds a step", heading, rows, note))
    rows = []
    for figure in ON_GPU:
        if f"gpu_{figure}" in results:
            v, (_, paper) = results[f"gpu_{figure}"].values, PAPER.get(figure, ("", float("nan")))
            whole = [1e3 * real(v[name]) for name in ("one_graph", "with_list", "seconds")]
            rows.append([v["liquid"], v["solid"], *(1e3 * t for t in v["stages"].values()), *whole, paper,
                         v["step"] / v["seconds"]])  # fmt: skip
    if rows:
        heading = ["liquid", "solid", *runs.GROUPS, "one graph", "with a new list", "step", "paper", "of real time"]
        note = "Milliseconds; each stage by itself, the list over all steps. The step is the mean over all steps."
        made.append(Table("Table 2 on a GPU", heading, rows, note))
    rows = []
    for width in (1, 2, 3, 4):
        if f"width_{width}" in results:
            for row in results[f"width_{width}"].values["rows"]:
                rows.append([width, row["summation"], row["dtype"], row["stiffness"], row["bend"], row["error"],
                             1e9 * row["seconds"] / row["nodes"]])  # fmt: skip
    if rows:
        heading = ["w", "sums", "dtype", "stiffness [1/s]", "bend [d]", "from float64 gather [d]", "ns a node"]
        made.append(Table("Half-width and ways of summing: a bar of 20 x 8 x 8 nodes", heading, rows))
    rows = []
    for share in claims.SHARES:
        key = f"share_{round(100 * share)}"
        if key in results:
            v = results[key].values
            rows.append([v["liquid"], v["solid"], v["solid"] / (v["liquid"] + v["solid"]),
                         *(1e3 * t for t in runs.grouped(v["stages"]).values()), 1e3 * v["seconds"]])  # fmt: skip
    if rows:
        heading = ["liquid", "solid", "share", *runs.GROUPS, "step"]
        made.append(Table("Milliseconds a step by the share of solid, one tank", heading, rows))
    if "savings" in results:
        rows, found = [], results["savings"].values["rows"]
        for row in found:
            saved = 1 - row["seconds"] / found[0]["seconds"]
            rows.append([row["scene"], row["particles"], row["operations"], row["bytes"] / row["particles"],
                         *(1e3 * t for t in row["stages"].values()), 1e3 * row["seconds"], 100 * saved])  # fmt: skip
        heading = ["figure 4 with", "particles", "operations", "bytes a particle", *runs.GROUPS, "ms a step",
                   "saved [%]"]  # fmt: skip
        made.append(Table("Pay for what is used", heading, rows))
    return made


EXPERIMENT = Experiment(
    name="melting",
    title="melting in fluid-solid interaction: scenes, times, conservation, regions",
    runs=planned,
    checks=checks,
    pictures=(
        Picture("melting_figure_3", pictures.filling_data, pictures.filling_picture, ("filling",)),
        Picture(
            "melting_figure_4", pictures.stage_data("figure_4", TITLES["figure_4"]),
            pictures.stage_picture(-68.0, 16.0, False), ("figure_4",), shaded=True),
        Picture(
            "melting_figure_5", pictures.stage_data("figure_5", TITLES["figure_5"]),
            pictures.stage_picture(-68.0, 22.0, True), ("figure_5",), shaded=True),
        Picture(
            "melting_figure_6", pictures.stage_data("figure_6", TITLES["figure_6"]),
            pictures.stage_picture(-72.0, 24.0, True), ("figure_6",), shaded=True),
        Picture("melting_speed", pictures.speed_data, pictures.speed_picture, ("figure_5", "own_pressure")),
        Picture(
            "melting_half_width", pictures.width_data, pictures.width_picture,
            tuple(f"width_{width}" for width in (1, 2, 3, 4)),
        ),
        Picture(
            "melting_figure_7", pictures.time_data, pictures.time_picture,
            tuple(f"{kind}_{figure}" for figure in PAPER for kind in ("cost", "rival")),
        ),
        Picture(
            "melting_share", pictures.share_data, pictures.share_picture,
            tuple(f"share_{round(100 * share)}" for share in claims.SHARES),
        ),
        Picture("melting_savings", pictures.savings_data, pictures.savings_picture, ("savings",)),
        Picture(
            "melting_gpu", pictures.gpu_data, pictures.gpu_picture, tuple(f"gpu_{figure}" for figure in ON_GPU)
        ),
    ),
    tables=tables,
    claims=measures(claims),
    hard_cases=stability.CASES,
)  # fmt: skip
