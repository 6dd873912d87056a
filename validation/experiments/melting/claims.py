"""What the paper on melting claims of its scenes: order of melting, bookkeeping, stability, shares of solid, time."""

from __future__ import annotations

from collections.abc import Callable

from refsim.backends.arrays import unavailable
from validation.claims import Measure
from validation.experiment import Options, Results, Run
from validation.experiments.melting import device, runs

SMALL = 0.4  # size of the scenes that are followed to the end
FIGURES = ("figure_4", "figure_5", "figure_6")
BOOKKEEPING = (("float64", "immiscible"), ("float64", "water"))


def scenes(options: Options) -> list[Run]:
    """The figures' scenes, small, until a tenth of the solid is left."""
    shared = {"size": SMALL, "backend": options.backend, "shares": [0.5, 0.1], "until": 4.0}
    return [Run(f"melt_{figure}", runs.melt, {"figure": figure, **shared}, estimate=10.0) for figure in FIGURES]


def of_scenes(value: Callable[[dict], float]) -> Callable[[Results], list[float]]:
    """One number of each scene."""
    return lambda results: [float(value(results[key].values)) for key in sorted(results)]


def kept(options: Options) -> list[Run]:
    """A ball of ice melts in a block of water, in both bookkeepings."""
    return [
        Run(
            f"kept_{bookkeeping}", runs.conserved,
            {"backend": options.backend, "dtype": dtype, "bookkeeping": bookkeeping, "steps": 300}, estimate=5.0,
        )
        for dtype, bookkeeping in BOOKKEEPING
    ]  # fmt: skip


def shares(options: Options) -> list[Run]:
    """Tanks of 60,840 particles (with --quick 3,900) of which more and more is solid."""
    size = SMALL if options.quick else 1.0
    shared = {"figure": "figure_6", "size": size, "backend": options.backend, "threads": options.threads}
    shared |= {"warm": 4, "rounds": 5, "steps": 3}
    return [
        Run(f"share_{round(100 * share)}", runs.step_cost, {**shared, "solid_share": share}, estimate=8.0)
        for share in runs.SOLID_SHARES
    ]


def slower(results: Results) -> list[float]:
    """Time with 60 % of solid over that with one layer."""
    seconds = {key: results[key].values["seconds"] for key in results}
    return [seconds["share_60"] / seconds["share_0"]]


def full(options: Options) -> list[Run]:
    """The scene of figure 5, 60,392 particles and steps of 5 ms, on a GPU."""
    parameters = {"figure": "figure_5", "size": 1.0}
    return [Run("full", device.on_gpu, parameters, estimate=15.0, skip=unavailable("cuda") or "")]


def of_real_time(results: Results) -> list[float]:
    """The scene's step over the wall time that it takes."""
    values = results["full"].values
    return [values["step"] / values["seconds"]]


def on_both(options: Options) -> list[Run]:
    """The scene of figure 6 on a GPU and on four threads of its host."""
    parameters = {"figure": "figure_6", "size": 1.0, "threads": 4}
    return [Run("both", device.beside_cpu, parameters, estimate=60.0, skip=unavailable("cuda") or "")]


def faster(results: Results) -> list[float]:
    """Time on the CPU over that on the GPU, of each stage."""
    values = results["both"].values
    return [values["cpu"][stage] / values["gpu"][stage] for stage in values["gpu"]]


MELTING_OUTSIDE_IN = Measure(scenes, of_scenes(lambda v: v["inside_melted"]))
MELTING_STAYS_STABLE = Measure(scenes, of_scenes(lambda v: max(v["series"]["fastest"])))
MELTING_VOLUME_KEPT = Measure(
    scenes, of_scenes(lambda v: abs(v["series"]["rest_volume"][-1] / v["series"]["rest_volume"][0] - 1))
)
MELTING_MASS_KEPT = Measure(kept, lambda results: [abs(results["kept_immiscible"].values["mass_change"])])
MELTING_MASS_NOT_KEPT_AS_WATER = Measure(kept, lambda results: [abs(results["kept_water"].values["mass_change"])])
MELTING_SOLIDS_SLOWER = Measure(shares, slower, quick=False, timed=True)
MELTING_GPU_PER_STAGE = Measure(on_both, faster, quick=False, timed=True)
MELTING_REAL_TIME = Measure(full, of_real_time, quick=False, timed=True)
