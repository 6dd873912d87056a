"""Melting in fluid-solid interaction (Shao & Song 2017): scenes of figures 4 to 6, table 2, conservation, regions."""

from __future__ import annotations

from refsim.backends.arrays import unavailable
from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.melting import claims, device, pictures, runs, stability
from validation.experiments.melting.runs import ON_GPU, PAPER, SOLID_SHARES, WIDTHS
from validation.results import real
from validation.tables import Table

SHARES = {"figure_4": [0.9, 0.5, 0.1], "figure_5": [0.8, 0.5, 0.2], "figure_6": [0.8, 0.5, 0.2]}
UNTIL = 4.0  # [s]
SEARCHED = (1, 2, 3)  # half-widths whose regions are compared with a search
KEPT = (("float64", "immiscible"), ("float32", "immiscible"), ("float64", "water"))  # dtype and bookkeeping
KINDS = {"cost": "refsim", "rival": "stand-in for the rival"}
QUICK = 0.4  # size of the scenes with --quick
TITLES = {
    "figure_4": "Figure 4, an ice cube in warm water",
    "figure_5": "Figure 5, bodies of equal conductivity",
    "figure_6": "Figure 6, rabbits and ducks in two streams",
}


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    quick, backend, threads = options.quick, {"backend": options.backend}, {"threads": options.threads}
    size = {"size": QUICK if quick else 1.0}
    shorter = {"step": 0.002} if not quick else {}  # of figure 5, see docs/melting.md
    scenes = {
        figure: {"figure": figure, "shares": shares, "until": UNTIL, **size, **backend}
        for figure, shares in SHARES.items()
    }
    scenes["figure_5"] |= shorter
    own = {**scenes["figure_5"], "weighted": False}  # every particle of a pair pushes by its own pressure
    printed = {**scenes["figure_4"], "size": QUICK, "shares": [0.5, 0.0], "scale": 1.0, "largest_number": 10.0}
    cost = {**size, **backend, **threads, "warm": 40, "rounds": 5, "steps": 4}
    few = {"warm": 3, "rounds": 2, "steps": 2} if quick else {}
    return [
        *(Run(figure, runs.melt, scene, 8.0 if quick else 120.0) for figure, scene in scenes.items()),
        Run("own_pressure", runs.melt, own, 120.0, "takes as long as figure 5; run without --quick" if quick else ""),
        Run("as_printed", runs.melt, printed, 4.0),
        Run("filling", runs.filling, estimate=0.5),
        *(Run(f"regions_{width}", runs.region_rounds, {"half_width": width}, 2.0) for width in SEARCHED),
        Run("lattice", runs.free_lattice, {"steps": 400 if quick else 10000, **backend}, 8.0),
        *(Run(f"kept_{dtype}_{books}", runs.conserved,
              {"dtype": dtype, "bookkeeping": books, "steps": 200 if quick else 1000, **backend}, 5.0)
          for dtype, books in KEPT),
        *(Run(f"{kind}_{figure}", runs.step_cost, {"figure": figure, "rival": kind == "rival", **cost},
              1.0 if quick else 12.0) for figure in PAPER for kind in KINDS),
        *claims.shares(options),
        *(Run(f"gpu_{figure}", device.on_gpu, {"figure": figure, **size}, 10.0, unavailable("cuda") or "")
          for figure in ON_GPU),
        *(Run(f"width_{width}", runs.stiffness, {"half_width": width, "steps": 30 if quick else 60, **backend}, 3.0)
          for width in WIDTHS),
        Run("savings", runs.savings, {**size, **backend, **threads, **few}, 1.0 if quick else 20.0),
    ]  # fmt: skip


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
    for width in SEARCHED:
        if f"regions_{width}" in results:
            check("wrong_regions", results[f"regions_{width}"].values["wrong"], f"w_{width}")
    if "lattice" in results:
        values = results["lattice"].values
        for name in ("angular_momentum", "momentum", "shape"):
            check(f"lattice_{name}", values[name])
    for dtype, bookkeeping in KEPT:
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


def milliseconds(stages: dict[str, float]) -> list[float]:
    """The paper's stages in milliseconds."""
    return [1e3 * seconds for seconds in runs.grouped(stages).values()]


def tables(results: Results) -> list[Table]:
    """The scenes, table 2 by stage, and half-widths."""
    had = {key: result.values for key, result in results.items()}
    scenes, costs, on_gpu, widths, shares, saved = [], [], [], [], [], []
    others = {"own_pressure": "Figure 5, each by its own pressure", "as_printed": "Figure 4, K as printed under it"}
    for key, title in (TITLES | others).items():
        if v := had.get(key):
            s = v["series"]
            scenes.append([title, v["particles"], sum(v["solids"]), v["times"][-1], s["solid"][-1], v["together"],
                           *(max(s[name]) for name in ("fragments", "fastest", "densest"))])  # fmt: skip
    for figure, (words, paper) in PAPER.items():
        for kind, name in KINDS.items():
            if v := had.get(f"{kind}_{figure}"):
                costs.append([words, name, v["liquid"], v["solid"], *milliseconds(v["stages"]), 1e3 * v["seconds"],
                              paper, v["step"] / v["seconds"]])  # fmt: skip
    for figure in ON_GPU:
        if v := had.get(f"gpu_{figure}"):
            whole = [1e3 * real(v[name]) for name in ("one_graph", "with_list", "seconds")]
            paper = PAPER[figure][1] if figure in PAPER else float("nan")
            on_gpu.append([v["liquid"], v["solid"], *(1e3 * t for t in v["stages"].values()), *whole, paper,
                           v["step"] / v["seconds"]])  # fmt: skip
    for width in WIDTHS:
        for row in had.get(f"width_{width}", {"rows": ()})["rows"]:
            own = [row[name] for name in ("summation", "dtype", "stiffness", "bend", "error")]
            widths.append([width, *own, 1e9 * row["seconds"] / row["nodes"]])
    for share in SOLID_SHARES:
        if v := had.get(f"share_{round(100 * share)}"):
            shares.append([v["liquid"], v["solid"], v["solid"] / (v["liquid"] + v["solid"]),
                           *milliseconds(v["stages"]), 1e3 * v["seconds"]])  # fmt: skip
    found = had.get("savings", {"rows": ()})["rows"]
    for row in found:
        saved.append([row["scene"], row["particles"], row["operations"], row["bytes"] / row["particles"],
                      *(1e3 * t for t in row["stages"].values()), 1e3 * row["seconds"],
                      100 * (1 - row["seconds"] / found[0]["seconds"])])  # fmt: skip
    made = (
        ("Scenes", ["scene", "particles", "solid", "last frame [s]", "solid then", "most in a step", "pieces",
                    "fastest [m/s]", "densest [rho0]"], scenes, ""),
        ("Seconds a step",
         ["Table 2", "by", "liquid", "solid", *runs.GROUPS, "step", "paper", "of real time"], costs,
         "Milliseconds; the paper's on a GTX 690. The stand-in has explicit heat and searches every region in every"
         " step; it is not Iwasaki 2010, and figure 7's own numbers are lost."),
        ("Table 2 on a GPU",
         ["liquid", "solid", *runs.GROUPS, "one graph", "with a new list", "step", "paper", "of real time"], on_gpu,
         "Milliseconds; each stage is timed alone, the list over all steps. The step is the mean over all steps."),
        ("Half-width and summation: a bar of 20 x 8 x 8 nodes",
         ["w", "sums", "dtype", "stiffness [1/s]", "bend [d]", "from float64 gather [d]", "ns a node"], widths, ""),
        ("Milliseconds a step by the share of solid, one tank",
         ["liquid", "solid", "share", *runs.GROUPS, "step"], shares, ""),
        ("Pay for what is used",
         ["figure 4 with", "particles", "operations", "bytes a particle", *runs.GROUPS, "ms a step", "saved [%]"],
         saved, ""),
    )  # fmt: skip
    return [Table(title, heading, rows, note) for title, heading, rows, note in made if rows]


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
            tuple(f"width_{width}" for width in WIDTHS),
        ),
        Picture(
            "melting_figure_7", pictures.time_data, pictures.time_picture,
            tuple(f"{kind}_{figure}" for figure in PAPER for kind in KINDS),
        ),
        Picture("melting_savings", pictures.savings_data, pictures.savings_picture, ("savings",)),
        Picture(
            "melting_gpu", pictures.gpu_data, pictures.gpu_picture, tuple(f"gpu_{figure}" for figure in ON_GPU)
        ),
    ),
    tables=tables,
    claims=measures(claims),
    trials=vars(stability),
)  # fmt: skip
