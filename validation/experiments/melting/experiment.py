"""Melting in fluid-solid interaction (Shao & Song 2017): scenes of figures 4 to 6, table 2, conservation, regions."""

from __future__ import annotations

from refsim.backends.arrays import unavailable
from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.melting import claims, device, pictures, runs, stability
from validation.experiments.melting.runs import ON_GPU, PAPER, WIDTHS

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
    claims=measures(claims),
    trials=vars(stability),
)  # fmt: skip
