"""What the paper on melting claims of its scenes: order of melting, volume and mass, shares of solid, sums, time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from refsim import (
    BoxWalls,
    Cloud,
    Gravity,
    HeatConduction,
    Melting,
    Scene,
    ShapeMatching,
    SolidCells,
    TwoWayCoupling,
    WeaklyCompressible,
)
from refsim.backends.arrays import unavailable
from refsim.shape_matching.phases import FLUID, INTERIOR
from validation.experiment import Family, Measure, Options, Results, Run, alike
from validation.experiments.melting import device, runs
from validation.experiments.melting.scene import HALF_WIDTH, SOUND, SPACING, SUPPORT, VISCOSITY
from validation.metrics.droplet import surface_mesh
from validation.results import Result
from validation.running import Context

SMALL = 0.4  # size of the scenes that are followed to the end
FIGURES = ("figure_4", "figure_5", "figure_6")
RADII = (0.5, 0.55, 0.6, 0.65, 0.7)  # of the ice balls whose volume is measured [m]


def scenes(options: Options) -> list[Run]:
    """The figures' scenes, small, until a tenth of the solid is left."""
    shared = {"size": SMALL, "backend": options.backend, "shares": [0.5, 0.1], "until": 4.0}
    return [Run(f"melt_{figure}", runs.melt, {"figure": figure, **shared}, estimate=10.0) for figure in FIGURES]


def of_scenes(value: Callable[[dict], float]) -> Callable[[Results], list[float]]:
    """One number of each scene."""
    return lambda results: [float(value(results[key].values)) for key in sorted(results)]


def volume(place: np.ndarray) -> float:
    """Volume that the smoothed surface of a block of particles encloses [m^3]; place (n, 3) [m]."""
    vertices, faces = surface_mesh(place, SPACING)
    corner = vertices[faces] - vertices.mean(0)
    return float(np.einsum("ij,ij->i", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum() / 6)


def melted(context: Context, radius: float, bookkeeping: str, backend: str, seconds: float = 1.2) -> Result:
    """A ball of ice in a tank of warm water, with and without melting: volume and change of mass at the end.

    The volume is that within the smoothed surface; `left` is the share of the ball that has not melted.
    """
    wide = 12
    cells = np.stack(np.meshgrid(*[np.arange(wide)] * 3, indexing="ij"), -1).reshape(-1, 3)
    inside = np.linalg.norm(cells - 0.5 * (wide - 1), axis=1) * SPACING < radius
    heat = HeatConduction(
        temperature=(-10.0, 80.0), conductivity=0.3 * 1000 * 4186, heat_capacity=4186.0, melting_point=0.0
    )
    effects = (
        WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=VISCOSITY, state="tait", kernels="cubic_spline"),
        Gravity(),
        BoxWalls(lower=(0.0, 0.0, 0.0), upper=(wide * SPACING, wide * SPACING, 2 * wide * SPACING)),
        ShapeMatching(half_width=HALF_WIDTH),
        TwoWayCoupling(),
        heat,
    )
    found = {}
    for name, more in (("kept", ()), ("melted", (Melting(bookkeeping=bookkeeping),))):
        scene = Scene(
            spacing=SPACING, support_radius=SUPPORT, fluid=(Cloud(position=SPACING * (cells[~inside] + 0.5)),),
            solid=(SolidCells(cells=cells[inside], density=917.0),), effects=(*effects, *more), step=0.004,
            dtype="float64",
        )  # fmt: skip
        simulation = context.simulation(scene, backend)
        solid, mass = int((simulation.field("phase") != FLUID).sum()), float(simulation.field("mass").sum())
        while simulation.time < seconds:
            simulation.step()
            context.progress(0.5 * len(found) + 0.5 * simulation.time / seconds)
        found[name] = {
            "volume": volume(simulation.field("position")),
            "left": int((simulation.field("phase") != FLUID).sum()) / solid,
            "mass_change": float(simulation.field("mass").sum()) / mass - 1,
        }
    return Result(
        {
            "before": found["kept"]["volume"], "after": found["melted"]["volume"], "left": found["melted"]["left"],
            "mass_change": found["melted"]["mass_change"],
        }
    )  # fmt: skip


def pools(bookkeeping: str) -> Callable[[Options], list[Run]]:
    """Balls of five sizes."""
    return lambda options: [
        Run(f"claim_volume_{bookkeeping}_{radius:g}", melted,
            {"radius": radius, "bookkeeping": bookkeeping, "backend": options.backend}, estimate=10.0)
        for radius in RADII
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
    """Time with 20, 40 and 60 % of solid over that with one layer."""
    seconds = {key: results[key].values["seconds"] for key in results}
    return [seconds[f"share_{share}"] / seconds["share_0"] for share in (20, 40, 60)]


def sums(options: Options) -> list[Run]:
    """A bent bar with every summation, at half-widths 1 to 4."""
    parameters = {"backend": options.backend, "steps": 30 if options.quick else 60}
    return [Run(f"width_{w}", runs.stiffness, {"half_width": w, **parameters}, 3.0) for w in runs.WIDTHS]


def by_members(results: Results) -> list[float]:
    """Seconds of the additions of a reduction over those of fast summation, float32, for each half-width."""
    found = []
    for result in results.values():
        seconds = {row["summation"]: row["seconds"] for row in result.values["rows"] if row["dtype"] == "float32"}
        found.append(seconds["reduction"] / seconds["fast"])
    return found


def full(options: Options) -> list[Run]:
    """The scenes of figures 4 to 6 on a GPU: the experiment's own runs."""
    missing = unavailable("cuda") or ""
    return [Run(f"gpu_{f}", device.on_gpu, {"figure": f, "size": 1.0}, estimate=15.0, skip=missing) for f in FIGURES]


def of_real_time(results: Results) -> list[float]:
    """A scene's step over the wall time that it takes, lists included."""
    return [result.values["step"] / result.values["seconds"] for result in results.values()]


def on_both(options: Options) -> list[Run]:
    """The scene of figure 6 on a GPU and on four threads of its host."""
    parameters = {"figure": "figure_6", "size": 1.0, "threads": 4}
    return [Run("both", device.beside_cpu, parameters, estimate=60.0, skip=unavailable("cuda") or "")]


def faster(results: Results) -> list[float]:
    """Time on the CPU over that on the GPU, of each stage."""
    values = results["both"].values
    return [values["cpu"][stage] / values["gpu"][stage] for stage in values["gpu"]]


def growth(results: Results) -> list[float]:
    """Volume that the surface encloses after melting over that without melting, less one."""
    return [abs(result.values["after"] / result.values["before"] - 1) for result in results.values()]


def gain(results: Results) -> list[float]:
    """Change of the mass, over that before."""
    return [abs(result.values["mass_change"]) for result in results.values()]


MELTING_OUTSIDE_IN = Measure(scenes, of_scenes(lambda v: v["inside_melted"]))
MELTING_VOLUME_KEPT = Measure(pools("immiscible"), growth)
MELTING_VOLUME_KEPT_AS_WATER = Measure(pools("water"), growth)
MELTING_MASS_NOT_KEPT_AS_WATER = Measure(pools("water"), gain)
MELTING_SOLIDS_SLOWER = Measure(shares, slower, quick=False, timed=True)
MELTING_SUMS_IN_PARALLEL = Measure(sums, by_members, timed=True)
MELTING_GPU_PER_STAGE = Measure(on_both, faster, quick=False, timed=True)
MELTING_REAL_TIME = Measure(full, of_real_time, quick=False, timed=True)

# Null models


class _Anywhere:
    """A simulation of which the inner particles melt as often as the outer ones."""

    def __init__(self) -> None:
        self.phases = np.full(1000, INTERIOR, np.int32)

    def field(self, name: str) -> np.ndarray:
        """Phases, all of the interior at first; nothing moves."""
        return self.phases.copy() if name == "phase" else np.zeros((1000, 3))


def _melts_anywhere(measure: Measure) -> list[float]:
    """A tenth of the particles melts, chosen at random."""
    simulation = _Anywhere()
    watch = runs.Watch(simulation)  # type: ignore[arg-type]
    simulation.phases[np.random.default_rng(1).random(1000) < 0.1] = FLUID
    watch.after_step()
    return measure.of({"": {"inside_melted": watch.inside_melted}})


def _shrinks(measure: Measure) -> list[float]:
    """A block of particles, and the same with a tenth of it gone; its mass stays."""
    axis = SPACING * np.arange(10.0)
    place = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return measure.of({"": {"before": volume(place), "after": volume(place[100:]), "mass_change": 0.0}})


def _twice_as_long(measure: Measure) -> list[float]:
    """The reduction takes twice as long."""
    rows = [{"dtype": "float32", "summation": s, "seconds": t} for s, t in (("reduction", 0.02), ("fast", 0.01))]
    return measure.of({"": {"rows": rows}})


FAMILIES = (
    Family(
        ("melting_outside_in",), "Particles could melt inside a solid.",
        "a tenth of a solid's particles melts anywhere",
        _melts_anywhere,
    ),
    Family(
        ("melting_volume_kept", "melting_volume_kept_as_water", "melting_mass_not_kept_as_water"),
        "The surface could enclose another volume afterwards; the mass could stay.",
        "a block that loses a tenth of its particles, with the mass of all", _shrinks,
    ),
    Family(
        ("melting_solids_slower",), "A step could take as long with more solid.", "all shares take the same time",
        alike({"seconds": 0.07}),
    ),
    Family(
        ("melting_sums_in_parallel",), "The reduction's additions could take longer than fast summation.",
        "a reduction that takes twice as long", _twice_as_long,
    ),
    Family(
        ("melting_gpu_per_stage",), "A stage could take as long on the GPU.", "both take the same time",
        alike({"cpu": dict.fromkeys("abc", 1.0), "gpu": dict.fromkeys("abc", 1.0)}),
    ),
    Family(
        ("melting_real_time",), "A step could take longer than the time that it covers.",
        "the paper's own 35.7 ms for a step of 5 ms", alike({"step": 0.005, "seconds": 0.0357}),
    ),
)  # fmt: skip
