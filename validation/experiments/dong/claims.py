"""What Dong, Zhang & Chen 2016 claim, measured: density, area, momentum, time, shape, coefficients, distances, drops.

Starts are cubes of other sizes and lattices, other shapes, or other shakings of the falling block, as each test says.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Cloud, CsfWang2019, Dong2016, Scene
from validation.experiment import Family, Measure, Options, Results, Run, alike
from validation.experiments.dong import runs
from validation.experiments.dong import scene as scenes
from validation.experiments.droplet.runs import relaxed
from validation.metrics.shapes import lattice_ball, lattice_cube
from validation.results import Result, real
from validation.running import Context, advance

SMALL = 1331  # particles
SEEDS = (1, 2, 3, 4, 5)
STARTS = {
    "cube": ("cube", SMALL, 1), "cut": ("cut", SMALL, 1), "cut_2": ("cut", SMALL, 2), "cut_3": ("cut", SMALL, 3),
    "box": ("box", SMALL, 1),
}  # fmt: skip
PRINTED_SIDES = (13, 14, 15, 16, 17)  # particles along the cube's edge; the paper's has 17
ARMS = (True, False)  # with and without the Shepard filter


def values_of(prefix: str, part: Callable[[dict], float]) -> Callable[[Results], list[float]]:
    """A number of every run whose key begins so."""
    return lambda found: [part(dict(r.values)) for key, r in found.items() if key.startswith(prefix)]


# Density. The paper speaks of the amplitude of its oscillation: half of the peak-to-peak over the last half of a run,
# whose first half is the collapse or the fall. Of a drop it is the bulk's mean of rho/rho0 - 1; of the block, which
# has no bulk, the 95th percentile over its particles.


def half_swing(rows: list[dict]) -> float:
    """Half of the peak-to-peak of the block's compression over the last half of the frames."""
    late = [real(row["compression"]) for row in rows[len(rows) // 2 :]]
    return (max(late) - min(late)) / 2


def calibrated_cube(filtered: bool) -> Measure:
    """Half of the bulk's peak-to-peak over the last half of the time, from the calibrated starts."""

    def planned(options: Options) -> list[Run]:
        made = []
        for name, (shape, count, seed) in STARTS.items():
            parameters: dict[str, Any] = {"shape": shape, "count": count, "seed": seed, "backend": options.backend}
            if not filtered:
                parameters["changes"] = {"filter_density": False}
            made.append(Run(f"claim_cube_{name}_{'filtered' if filtered else 'raw'}", runs.cube, parameters, 8.0))
        return made

    return Measure(planned, values_of("claim_cube", lambda v: real(v["swing_late"])), quick=False)


def calibrated_block(filtered: bool) -> Measure:
    """Oscillation of the falling block's density up to frame 320, calibrated; it lands at frame 40."""

    def planned(options: Options) -> list[Run]:
        return [
            Run(
                f"claim_block_{'filtered' if filtered else 'raw'}_{seed}", runs.fall,
                {"tension": True, "backend": options.backend, "seed": seed, "frames": list(range(0, 321, 4)),
                 "filtered": filtered}, 4.0,
            )
            for seed in SEEDS
        ]  # fmt: skip

    return Measure(planned, values_of("claim_block", lambda v: half_swing(v["rows"])), quick=False)


def printed_cube(filtered: bool) -> Measure:
    """Oscillation of the cube's density with the printed numbers, at the sound speed that the printed step allows."""

    def planned(options: Options) -> list[Run]:
        return [
            Run(
                f"claim_printed_{'filtered' if filtered else 'raw'}_{side}", runs.printed,
                {"side": side, "cohesion": True, "correction": True, "steps": 400, "backend": options.backend,
                 "filtered": filtered, "samples": 80}, 4.0,
            )
            for side in PRINTED_SIDES
        ]  # fmt: skip

    return Measure(planned, values_of("claim_printed", lambda v: real(v["swing_late"])), quick=False)


DENSITY_CUBE = calibrated_cube(True)
DENSITY_CUBE_RAW = calibrated_cube(False)
DENSITY_BLOCK = calibrated_block(True)
DENSITY_BLOCK_RAW = calibrated_block(False)
DENSITY_PRINTED = printed_cube(True)
DENSITY_PRINTED_RAW = printed_cube(False)

# Cohesion alone, and with the correction, from shapes far from a ball.

SHAPES = ("cube", "cut", "box", "rod", "pair")


def excess(values: dict) -> float:
    """Area over that of a ball of the same volume, less one; infinite for a torn drop."""
    found = real(values["area"])
    return math.inf if math.isnan(found) else found - 1


def rest_area(corrected: bool) -> Measure:
    """Area at rest over that of a ball of the same volume, less one, at the calibrated setting."""

    def planned(options: Options) -> list[Run]:
        made = []
        for shape in SHAPES:
            parameters: dict[str, Any] = {
                "shape": shape,
                "count": SMALL,
                "backend": options.backend,
                "until": 8.0,
                "viscosity": scenes.CALM,
            }
            if not corrected:
                parameters["changes"] = {"correction": 0.0}
            made.append(Run(f"claim_area_{shape}_{corrected:d}", runs.cube, parameters, 12.0))
        return made

    return Measure(planned, values_of("claim_area", excess), quick=False)


def frozen(context: Context, shape: str, corrected: bool, backend: str) -> Result:
    """From a shape to rest with the paper's support of 1.5 spacings, which the sigma map does not cover."""
    position, spacing = scenes.start(shape, SMALL)
    scene = Scene(
        spacing=spacing, support_radius=scenes.PRINTED_SUPPORT * spacing, fluid=(Cloud(position=position),),
        effects=(
            scenes.liquid(sound_speed=15.0, dynamic_viscosity=scenes.CALM, kernels="mueller"),
            Dong2016(surface_tension=scenes.TENSION, correction=None if corrected else 0.0),
        ),
    )  # fmt: skip
    found = runs.drop(context, scene, np.linspace(0.0, 4.0, 21), backend)
    return Result({**found.values, "series": {}})


def frozen_area(corrected: bool) -> Measure:
    """The same as `rest_area` with the paper's support."""

    def planned(options: Options) -> list[Run]:
        made = []
        for shape in SHAPES:
            parameters = {"shape": shape, "corrected": corrected, "backend": options.backend}
            made.append(Run(f"claim_frozen_{shape}_{corrected:d}", frozen, parameters, 12.0))
        return made

    return Measure(planned, values_of("claim_frozen", excess), quick=False)


COHESION_NOT_MINIMAL = rest_area(False)
CORRECTION_MINIMAL = rest_area(True)
COHESION_NOT_MINIMAL_SHORT = frozen_area(False)
CORRECTION_MINIMAL_SHORT = frozen_area(True)

# Momentum: sums of forces and torques over the sums of their moduli, float64, on a moving drop.


def forces(context: Context, seed: int, backend: str) -> Result:
    """Of each term on a drop after 0.2 s: the pair force, the correction (adopted and printed), the continuum force."""
    position, spacing = scenes.start("cut", SMALL, seed)
    scene = scenes.cube_scene(position, spacing, dtype="float64")
    moving = context.simulation(scene, backend)
    advance(moving, [0.2], lambda simulation, wall: None, context)
    position, mass = moving.field("position"), moving.field("mass")[:, None]
    k, strength = runs.coefficients(scene)["stiffness"], runs.coefficients(scene)["correction"]
    liquid = scenes.liquid(sound_speed=20.0, kernels="mueller")
    raw = {"filter_density": False}
    terms = {
        "cohesion": Dong2016(stiffness=k, correction=0.0, **raw),
        "correction": Dong2016(stiffness=0.0, correction=strength, **raw),
        "printed": Dong2016(stiffness=0.0, correction=strength, literal=("E21",), **raw),
        "csf": CsfWang2019(surface_tension=scenes.TENSION, density_correction=False),
    }

    def acceleration(effects: tuple) -> NDArray:
        scene = Scene(
            spacing=spacing, support_radius=2.6 * spacing, dtype="float64", fluid=(Cloud(position=position),),
            effects=(liquid, *effects),
        )  # fmt: skip
        looked = context.simulation(scene, backend)
        looked.evaluate(on_demand=False)
        return looked.field("acceleration")

    pressure, found = acceleration(()), {}
    for name, effect in terms.items():
        force = mass * (acceleration((effect,)) - pressure)
        found[name] = left_over(position, force)
    return Result(found)


def left_over(position: NDArray, force: NDArray) -> dict[str, float]:
    """Sum of the forces and of their torques, each over the sum of the moduli; position, force (n, 3)."""
    torque = np.cross(position, force)
    return {
        name: float(np.linalg.norm(each.sum(0)) / np.linalg.norm(each, axis=1).sum())
        for name, each in (("linear", force), ("angular", torque))
    }


def momentum(term: str, part: str) -> Measure:
    """What a term does to the linear or angular momentum, start by start."""

    def planned(options: Options) -> list[Run]:
        return [Run(f"claim_forces_{s}", forces, {"seed": s, "backend": options.backend}, 4.0) for s in SEEDS]

    return Measure(planned, values_of("claim_forces", lambda v: real(v[term][part])), quick=False)


LINEAR_COHESION = momentum("cohesion", "linear")
ANGULAR_COHESION = momentum("cohesion", "angular")
LINEAR_CORRECTION = momentum("correction", "linear")
ANGULAR_CORRECTION = momentum("correction", "angular")
LINEAR_PRINTED = momentum("printed", "linear")
ANGULAR_PRINTED = momentum("printed", "angular")
LINEAR_CSF = momentum("csf", "linear")
ANGULAR_CSF = momentum("csf", "angular")

# Seconds a frame, in five rounds on one thread and five on all: what is shared between threads differs by model.

ROUNDS = [(k, threads) for threads in (1, None) for k in (1, 2, 3, 4, 5)]


def speed_key(case: str, model: str, turn: int, threads: int | None) -> str:
    """Key of a run."""
    return f"claim_speed_{case}_{model}_{turn}_{threads or 'all'}"


def speed(rival: str, case: str) -> Callable[[Options], list[Run]]:
    """Runs of Dong's model and its rival, a round each in turn."""

    def planned(options: Options) -> list[Run]:
        made = []
        for k, threads in ROUNDS:
            for model in ("dong", rival):
                parameters = {"model": model, "case": case, "backend": options.backend, "turn": k, "threads": threads}
                made.append(Run(speed_key(case, model, k, threads), runs.seconds_per_frame, parameters, 8.0))
        return made

    return planned


def quotients(found: Results, rival: str, case: str) -> list[float]:
    """Seconds of a frame with Dong's model over those with its rival, round by round."""
    values = []
    for k, threads in ROUNDS:
        own, its = (runs.per_frame(found[speed_key(case, m, k, threads)].values) for m in ("dong", rival))
        values.append(own / its)
    return values


def faster(rival: str, case: str) -> Measure:
    """Seconds of a frame over the rival's."""
    return Measure(speed(rival, case), lambda found: quotients(found, rival, case), quick=False, timed=True)


def more_so(rival: str) -> Measure:
    """The quotient of the oil drops over that of the droplet."""

    def values(found: Results) -> list[float]:
        return [a / b for a, b in zip(quotients(found, rival, "oil"), quotients(found, rival, "droplet"), strict=True)]

    def planned(options: Options) -> list[Run]:
        return [*speed(rival, "droplet")(options), *speed(rival, "oil")(options)]

    return Measure(planned, values, quick=False, timed=True)


FASTER_THAN_CSF_DROPLET = faster("csf", "droplet")
FASTER_THAN_CSF_OIL = faster("csf", "oil")
FASTER_IN_COMPLEX_SCENES = more_so("csf")
AS_FAST_AS_IIF_DROPLET = faster("iif", "droplet")
AS_FAST_AS_IIF_OIL = faster("iif", "oil")

# The history of the shape beside that of the continuum force, in one liquid and with one measured tension: h = 2.6 d,
# Wendland, and a viscosity at which the continuum force holds a cube together. q4 over time, each time in units of its
# own half-way.

SIDES = (11, 12, 13, 14, 15)
LIQUID = {"support": 2.6, "kernels": "wendland", "viscosity": 0.3}


def history(context: Context, side: int, model: str, backend: str) -> Result:
    """A cube of side 1 m in the liquid of the experiment `droplet`: q4 over time."""
    effect = (
        Dong2016(surface_tension=1.0 / scenes.RATIO["wendland"])
        if model == "dong"
        else CsfWang2019(surface_tension=1.0)
    )
    changes = {**LIQUID, "effects": (effect,)}
    found = relaxed(context, model, changes, "cube", side**3, backend, until=2.2, samples=220)
    series = {name: found.values["series"][name] for name in ("time", "cubic_moment", "radius_variation")}
    return Result({"series": series, "stopped": found.values["stopped"]})


def in_half_times(values: dict, at: NDArray) -> NDArray:
    """q4 over its start, at times `at` in units of the time in which it halves."""
    time, moment = (np.array(values["series"][name], dtype=float) for name in ("time", "cubic_moment"))
    share = moment / moment[0]
    first = int(np.argmax(share <= 0.5))
    half = np.interp(-0.5, -share[first - 1 : first + 1], time[first - 1 : first + 1]) if first else math.nan
    return np.interp(at, time / half, share, right=math.nan)


def _history_runs(options: Options) -> list[Run]:
    return [
        Run(f"claim_history_{side}_{model}", history, {"side": side, "model": model, "backend": options.backend}, 8.0)
        for side in SIDES
        for model in ("dong", "csf")
    ]


def _history_values(found: Results) -> list[float]:
    values, at = [], np.linspace(0.0, 6.0, 241)
    for side in SIDES:
        a, b = (in_half_times(dict(found[f"claim_history_{side}_{m}"].values), at) for m in ("dong", "csf"))
        both = np.isfinite(a) & np.isfinite(b)
        values.append(float(np.sqrt(((a - b)[both] ** 2).mean())) if both.any() else math.nan)
    return values


SHAPE_LIKE_CSF = Measure(_history_runs, _history_values, quick=False)

# Droplets against net.


def _fall_runs(options: Options) -> list[Run]:
    made = []
    for seed in SEEDS:
        for tension in ARMS:
            parameters = {
                "tension": tension,
                "backend": options.backend,
                "seed": seed,
                "frames": [*scenes.FRAMES, *scenes.LATER],
            }
            made.append(Run(f"claim_fall_{seed}_{tension:d}", runs.fall, parameters, 3.0))
    return made


def splash(part: str, frame: int, over: Callable[[float, float], float]) -> Measure:
    """A count with tension against the same without, start by start."""

    def values(found: Results) -> list[float]:
        made = []
        for seed in SEEDS:
            both = []
            for tension in ARMS:
                rows = found[f"claim_fall_{seed}_{tension:d}"].values["rows"]
                both.append(real(next(row[part] for row in rows if row["frame"] == frame)))
            made.append(over(*both))
        return made

    return Measure(_fall_runs, values)


NET_WITHOUT = splash("holes", 90, lambda a, b: b / max(a, 1.0))
FEWER_LONE = splash("lone", 120, lambda a, b: a / max(b, 1.0))
GATHERS = splash("height", 160, lambda a, b: a / b)

# Figure 6: after 8 s there is one drop.

RESTED = 1600  # frames


def _merge_runs(options: Options) -> list[Run]:
    return [
        Run(f"claim_merge_{seed}", runs.fall,
            {"tension": True, "backend": options.backend, "seed": seed, "frames": [0, RESTED]}, 30.0)
        for seed in SEEDS
    ]  # fmt: skip


def _outside_largest(values: dict) -> float:
    """Share of the particles outside of the largest part at the end; 1 for a run that stopped."""
    return 1.0 if values["stopped"] else 1 - real(values["rows"][-1]["largest"])


MERGES_INTO_ONE = Measure(_merge_runs, values_of("claim_merge", _outside_largest), quick=False)

# Section 2.1: L(0) = k, where the cosine of the plain pair force vanishes at r = 0.

FEW = 512  # particles
NEAR_STARTS = {
    "cube": ("cube", FEW, 1), "cut": ("cut", FEW, 1), "cut_2": ("cut", FEW, 2), "cut_3": ("cut", FEW, 3),
    "box": ("box", FEW, 1),
}  # fmt: skip


def near(model: str, rival: str = "") -> Measure:
    """Nearest neighbour, 5th percentile [d], at the end of a run without the correction, or over that of a rival."""
    models = [model, rival] if rival else [model]

    def planned(options: Options) -> list[Run]:
        made = []
        for name, (shape, count, seed) in NEAR_STARTS.items():
            for each in models:
                parameters: dict[str, Any] = {
                    "shape": shape, "count": count, "seed": seed, "model": each, "until": 2.0, "samples": 20,
                    "viscosity": scenes.CALM, "backend": options.backend,
                }  # fmt: skip
                if each == "dong":
                    parameters["changes"] = {"correction": 0.0}
                made.append(Run(f"claim_near_{each}_{name}", runs.cube, parameters, 4.0))
        return made

    def values(found: Results) -> list[float]:
        last = {key: real(result.values["series"]["nn_5"][-1]) for key, result in found.items()}
        made = []
        for name in NEAR_STARTS:
            own = last[f"claim_near_{model}_{name}"]
            made.append(own / last[f"claim_near_{rival}_{name}"] if rival else own)
        return made

    return Measure(planned, values)


NO_CLUSTERS = near("dong")
NO_CLUSTERS_BESIDE_COSINE = near("dong", "iif")

# Null models


def _shape(made: Callable[[int], NDArray], side: int) -> Callable[[Measure], list[float]]:
    """Particles at rest on a lattice."""
    return lambda measure: measure.of({"": {"area": runs.area(made(side).astype(float), 1.0)}})


def _random_forces(measure: Measure) -> list[float]:
    """Forces that no particle returns."""
    position = lattice_ball(SMALL).astype(float)
    found = left_over(position, np.random.default_rng(1).normal(size=position.shape))
    return measure.of({"": dict.fromkeys(("cohesion", "correction", "printed"), found)})


def _central_forces(measure: Measure) -> list[float]:
    """A force between every two of some particles, along the line between them."""
    position = np.random.default_rng(1).normal(size=(100, 3))
    apart = position[:, None] - position[None]
    found = left_over(position, (apart * np.exp(-(apart**2).sum(-1))[..., None]).sum(1))
    return measure.of({"": {"csf": found}})


def _two_histories(measure: Measure) -> list[float]:
    """One cube that swings, and one that creeps."""
    time = np.linspace(0.0, 2.2, 221)
    swings, creeps = np.exp(-time) * np.cos(8 * time), np.exp(-time)
    given = {"dong": swings, "csf": creeps}
    return measure.of(
        {
            run.key: {"series": {"time": time.tolist(), "cubic_moment": given[run.parameters["model"]].tolist()}}
            for run in measure.runs(Options())
        }
    )


def _pairs(measure: Measure) -> list[float]:
    """Particles that lie in pairs, two hundredths of a spacing apart, with every model."""
    return measure.of({"": {"series": {"nn_5": [1.0, 0.02]}}})


ROW = {"holes": 4, "lone": 9, "height": 1.5, "largest": 0.3}
FAMILIES = (
    Family(
        tuple(f"density_{name}{raw}" for name in ("printed", "block", "cube") for raw in ("", "_raw")),
        "The density could deviate by more than one part in a hundred.", "a density that swings by 2 %",
        alike({"swing_late": 0.02, "rows": [{"compression": 0.0}, {"compression": 0.0}, {"compression": 0.04}]}),
    ),
    Family(
        ("cohesion_not_minimal", "cohesion_not_minimal_short"), "Cohesion alone could make a ball.",
        "a ball cut from a lattice", _shape(lattice_ball, 4913),
    ),
    Family(
        ("correction_minimal", "correction_minimal_short"), "The drop could keep edges.", "a cube",
        _shape(lattice_cube, 11),
    ),
    Family(
        tuple(f"{part}_{term}" for part in ("linear", "angular") for term in ("cohesion", "correction", "printed")),
        "Forces or torques could be left over when they are summed.",
        "random forces, to which no particle returns the opposite", _random_forces,
    ),
    Family(
        ("linear_csf", "angular_csf"), "The continuum force could keep momentum after all.",
        "a central force between every two particles", _central_forces,
    ),
    Family(
        ("faster_than_csf_droplet", "faster_than_csf_oil", "faster_in_complex_scenes"),
        "A frame could take as long as the rival's.", "all take the same time",
        alike({"step": 0.01, "steps": 40, "frames": 40}),
    ),
    Family(
        ("as_fast_as_iif_droplet", "as_fast_as_iif_oil"),
        "A frame could take clearly longer than the plain pair force's.",
        "a model that takes twice as long",
        lambda measure: measure.of(
            {
                run.key: {"step": 0.02 if run.parameters["model"] == "dong" else 0.01, "steps": 40, "frames": 40}
                for run in measure.runs(Options())
            }
        ),
    ),
    Family(
        ("shape_like_csf",), "The two models could deform a cube differently.",
        "a cube that swings beside one that creeps",
        _two_histories,
    ),
    Family(
        ("net_without", "fewer_lone", "gathers"), "The block could fall apart alike with and without tension.",
        "both runs end alike",
        alike({"rows": [{"frame": frame, **ROW} for frame in (*scenes.FRAMES, *scenes.LATER)]}),
    ),
    Family(
        ("merges_into_one",), "Droplets could stay apart.", "drops of which the largest holds 30 %",
        alike({"stopped": "", "rows": [ROW]}),
    ),
    Family(
        ("no_clusters", "no_clusters_beside_cosine"),
        "Particles could pile up with L(0) = k, too, or as much as with a cosine.",
        "particles in pairs, 0.02 spacings apart, with either force", _pairs,
    ),
)  # fmt: skip
