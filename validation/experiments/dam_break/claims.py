"""What Jiang & Zhu 2023 claim of surface detection and of the density near a surface, measured on collapsing columns.

Starts are jitters of the column's lattice; quick sizes have 800 particles, the published ones 3,200.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from refsim import JiangZhu2023, Simulation, SurfaceDetection
from refsim.backends.arrays import unavailable
from validation.experiment import Family, Measure, Options, Results, Run, alike
from validation.experiments.dam_break import runs
from validation.metrics.dam_break import front_position
from validation.metrics.surface_truth import arc_cover_surface, detection_score
from validation.results import Result, real
from validation.running import Context, advance

SEEDS = (1, 2, 3, 4, 5)

# Detection: precision and recall of every detector over the collapse.


def _collapses(options: Options) -> list[Run]:
    columns, until, samples = (20, 1.0, 10) if options.quick else (40, 1.8, 36)
    made = []
    for seed in SEEDS:
        parameters = {"columns": columns, "until": until, "samples": samples, "backend": options.backend, "seed": seed}
        made.append(Run(f"claim_collapse_{seed}", runs.collapse, parameters, estimate=4.0 if options.quick else 40.0))
    return made


def scores(method: str, part: str) -> Callable[[Results], list[float]]:
    """One score of a detector over the whole collapse, start by start."""
    return lambda results: [real(result.values["score"][method][part]) for result in results.values()]


def _recall_gap(method: str) -> Callable[[Results], list[float]]:
    def values(results: Results) -> list[float]:
        pairs = zip(scores(method, "recall")(results), scores("fan_scan", "recall")(results))
        return [own - its for own, its in pairs]

    return values


def _precision_gain(results: Results) -> list[float]:
    pairs = zip(scores("two_step", "precision")(results), scores("number_density", "precision")(results))
    return [own - its for own, its in pairs]


TWO_STEP_AS_GOOD = Measure(_collapses, _recall_gap("two_step"))
TWO_STEP_AS_GOOD_PRINTED = Measure(_collapses, _recall_gap("two_step_printed"))
DENSITY_MARKS_INTERIOR = Measure(_collapses, scores("number_density", "precision"))
FAN_SCAN_FAULTLESS = Measure(_collapses, scores("fan_scan", "precision"))
TWO_STEP_MORE_PRECISE = Measure(_collapses, _precision_gain)

# Figure 5.

COSTLY = (32, 50, 80, 126, 200, 316)  # columns of figure 5: 2,048 to 199,712 particles, 2 n^2 each
COSTLY_QUICK = (20, 30, 50)  # at 5,000 particles two steps lead by more than the noise of a busy machine


def costs_planned(options: Options) -> list[Run]:
    """Figure 5, a run for each size; a GPU, where there is one, moves the column to the state that is timed."""
    made = []
    for k, columns in enumerate(COSTLY_QUICK if options.quick else COSTLY):
        parameters = {"columns": columns, "repeats": 60, "backend": options.backend}
        if not options.quick and unavailable("cuda") is None:
            parameters["moved_on"] = "cuda"
        estimate = 1 + 6e-5 * columns**3
        made.append(Run(f"detection_cost_{k + 1}", runs.detection_cost, parameters, estimate, timed=True))
    return made


def ratio(over: str, under: str, of: str = "charged") -> Callable[[Results], list[float]]:
    """Time of one detector over another's, size by size; "whole" takes the number density as summed anyway."""

    def values(results: Results) -> list[float]:
        methods = [result.values["methods"] for result in results.values()]
        return [each[over][of] / each[under][of] for each in methods]

    return values


FIGURE_5_LOWER = Measure(costs_planned, ratio("number_density", "two_step"), quick=False, timed=True)
FIGURE_5_UPPER_SUMMED = Measure(costs_planned, ratio("two_step", "fan_scan", "whole"), quick=False, timed=True)
FIGURE_5_UPPER = Measure(costs_planned, ratio("two_step", "fan_scan"), quick=False, timed=True)

# Pressure of the surface set to zero in every step, by detector.


def interior_noise(simulation: Simulation) -> tuple[float, float]:
    """(rms of p - mean p of the neighbours over rho g H, share marked as surface) of the deep interior.

    Deep: not on the exact surface, and with no neighbour within h that is.
    """
    position, pressure = (simulation.field(name).astype(float) for name in ("position", "pressure"))
    grid = simulation.plan.grid
    truth = arc_cover_surface(position, runs.TRUTH_RADIUS * grid.spacing, simulation.plan.walls.position)
    pairs = cKDTree(position).query_pairs(grid.support_radius, output_type="ndarray")
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    number = np.bincount(one, minlength=len(position))
    mean = np.bincount(one, pressure[other], minlength=len(position)) / np.maximum(number, 1)
    deep = ~truth & (np.bincount(one, truth[other], minlength=len(position)) == 0)
    noise = float(np.sqrt(((pressure - mean)[deep] ** 2).mean())) / (runs.DENSITY * runs.GRAVITY * runs.HEIGHT)
    return noise, float((simulation.field("surface")[deep] != 0).mean())


def released(context: Context, columns: int, until: float, seed: int, method: str, clamp: bool, backend: str) -> Result:
    """The collapse with p = 0 on the set of one detector, in every step."""
    detection = SurfaceDetection(method=method, release_pressure=True)
    cloud = runs.jittered(columns, 1, seed)
    scene = runs.column_scene(columns, 1, 4.0, (detection,), cloud)
    bound = 1.5 if clamp else 10.0  # of the density: where pressures pull, single particles fall into each other
    liquid = msgspec.structs.replace(scene.effects[0], clamp_pressure=clamp, density_bound=bound)
    simulation = context.simulation(msgspec.structs.replace(scene, effects=(liquid, *scene.effects[1:])), backend)
    noise, marked = [], []

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        found = interior_noise(simulation)
        noise.append(found[0])
        marked.append(found[1])

    advance(simulation, np.arange(0.1, until + 0.01, 0.1).tolist(), sample, context)
    return Result({"noise": float(np.mean(noise)), "marked": float(np.mean(marked)), "over_time": noise})


def oscillation(clamp: bool) -> Measure:
    """Interior pressure noise with the number density's set over that with the two-step set."""
    methods = ("number_density", "two_step")

    def planned(options: Options) -> list[Run]:
        columns, until = (16, 0.6) if options.quick else (40, 1.0)
        return [
            Run(
                f"claim_released_{method}_{'clamped' if clamp else 'free'}_{seed}",
                released,
                {"columns": columns, "until": until, "seed": seed, "method": method, "clamp": clamp,
                 "backend": options.backend},
                estimate=3.0 if options.quick else 40.0,
            )
            for seed in SEEDS
            for method in methods
        ]  # fmt: skip

    def values(results: Results) -> list[float]:
        kind = "clamped" if clamp else "free"
        noise = {m: [results[f"claim_released_{m}_{kind}_{seed}"].values["noise"] for seed in SEEDS] for m in methods}
        return [a / b for a, b in zip(noise["number_density"], noise["two_step"])]

    return Measure(planned, values)


FALSE_INTERIOR_CLAMPED = oscillation(True)
FALSE_INTERIOR_FREE = oscillation(False)

# The density correction in a splash, without tension.


def splash(context: Context, columns: int, until: float, seed: int, corrects: bool, backend: str) -> Result:
    """Particles torn off the liquid, mean over the collapse, with and without the density correction."""
    effects: Sequence[Any] = (JiangZhu2023(gamma=0.0, density_correction=True),) if corrects else ()
    cloud = runs.jittered(columns, 1, seed)
    simulation = context.simulation(runs.column_scene(columns, 1, 4.0, tuple(effects), cloud), backend)
    detached = []

    def sample(simulation: Simulation, wall: float) -> None:
        position = simulation.field("position")[:, :2]
        detached.append(front_position(position, simulation.plan.grid.spacing).detached)

    advance(simulation, np.arange(0.4, until + 0.01, 0.05).tolist(), sample, context)
    return Result({"detached": float(np.mean(detached)), "over_time": detached})


def _splashes(options: Options) -> list[Run]:
    columns, until = (16, 1.2) if options.quick else (40, 1.8)
    return [
        Run(
            f"claim_splash_{'on' if corrects else 'off'}_{seed}",
            splash,
            {"columns": columns, "until": until, "seed": seed, "corrects": corrects, "backend": options.backend},
            estimate=3.0 if options.quick else 30.0,
        )
        for seed in SEEDS
        for corrects in (False, True)
    ]


def _spray(results: Results) -> list[float]:
    torn = {name: result.values["detached"] for name, result in results.items()}
    return [torn[f"claim_splash_on_{seed}"] / torn[f"claim_splash_off_{seed}"] for seed in SEEDS]


CORRECTION_STOPS_SPRAY = Measure(_splashes, _spray)

# lambda of J(12), alone: inside and outside of the paper's range.

INSIDE, OUTSIDE = (0.90, 0.95, 0.98, 0.99), (0.80, 0.85, 1.0, 1.05)


def thresholds(context: Context, columns: int, until: float, seed: int, backend: str) -> Result:
    """F1 of the number density over a collapse for every lambda, INSIDE and OUTSIDE, against the exact surface."""
    mass = runs.jittered(columns, 1, seed)[1]
    simulation = context.simulation(runs.column_scene(columns, 1, 4.0, (), runs.jittered(columns, 1, seed)), backend)
    counts = {factor: np.zeros(3, int) for factor in (*INSIDE, *OUTSIDE)}  # hits, false surface, false interior

    def sample(simulation: Simulation, wall: float) -> None:
        position = simulation.field("position")
        truth = arc_cover_surface(
            position, runs.TRUTH_RADIUS * simulation.plan.grid.spacing, simulation.plan.walls.position
        )
        for factor in counts:
            detection = SurfaceDetection(method="number_density", threshold=factor)
            looked = context.simulation(
                runs.column_scene(columns, 1, 4.0, (detection,), (position, mass)), backend
            )  # fmt: skip
            looked.evaluate()
            flags = looked.field("surface").astype(bool)
            score = detection_score(flags, truth)
            counts[factor] += ((flags & truth).sum(), score.false_surface, score.false_interior)

    advance(simulation, np.linspace(0.0, until, 7).tolist(), sample, context)
    f1 = {f"{factor:g}": 2 * hit / (2 * hit + extra + missed) for factor, (hit, extra, missed) in counts.items()}
    return Result({"f1": f1})


def _thresholds(options: Options) -> list[Run]:
    columns, until = (16, 0.6) if options.quick else (40, 1.8)
    return [
        Run(f"claim_lambda_{seed}", thresholds,
            {"columns": columns, "until": until, "seed": seed, "backend": options.backend}, estimate=20.0)
        for seed in SEEDS
    ]  # fmt: skip


def best(values: Any, factors: Sequence[float]) -> float:
    """Best F1 among some lambdas."""
    return max(real(values["f1"][f"{factor:g}"]) for factor in factors)


LAMBDA_OUTSIDE = Measure(
    _thresholds,
    lambda found: [best(r.values, OUTSIDE) - best(r.values, INSIDE) for r in found.values()],
)

# Null models


def _guessed(fan_scan: bool) -> Callable[[Measure], list[float]]:
    """Scores of detectors that mark a tenth of the particles at random; the fan scan marks the truth if `fan_scan`."""
    random = np.random.default_rng(1)
    truth, guess = random.random((2, 10_000)) < 0.1
    score = {name: detection_score(flags, truth) for name, flags in (("truth", truth), ("guess", guess))}
    named = {name: {"precision": s.precision, "recall": s.recall} for name, s in score.items()}
    all_ = dict.fromkeys(runs.DETECTORS, named["guess"]) | {"fan_scan": named["truth" if fan_scan else "guess"]}
    return lambda measure: measure.of({"": {"score": all_}})


def _exact(measure: Measure) -> list[float]:
    """Scores of a detector that marks the truth."""
    truth = np.arange(100) < 10
    score = detection_score(truth, truth)
    return measure.of({"": {"score": {"number_density": {"precision": score.precision}}}})


FAMILIES = (
    Family(
        ("correction_stops_spray",), "As many particles could be torn off with the correction as without it.",
        "both runs lose as many", alike({"detached": 5.0}),
    ),
    Family(
        ("false_interior_clamped", "false_interior_free"),
        "The pressure could be as even with the number density's set as with that of two steps.",
        "both are as noisy", alike({"noise": 0.01}),
    ),
    Family(
        ("density_marks_interior",), "The number density could mark the surface alone.",
        "a detector that marks the truth", _exact,
    ),
    Family(
        ("fan_scan_faultless", "two_step_more_precise"), "A detector could mark interior particles.",
        "detectors that mark a tenth of the particles at random", _guessed(False),
    ),
    Family(
        ("two_step_as_good", "two_step_as_good_printed"),
        "Two steps could miss surface particles that the fan scan finds.",
        "two steps mark a tenth at random, the fan scan the truth", _guessed(True),
    ),
    Family(
        ("figure_5_lower", "figure_5_upper", "figure_5_upper_summed"),
        "A detector could take as long as the one that is said to be slower.",
        "all take the same time", alike({"methods": {m: {"whole": 1.0, "charged": 1.0} for m in runs.METHODS}}),
    ),
    Family(
        ("lambda_outside",), "A lambda outside of the range could find the surface as well as the best inside it.",
        "every lambda scores the same", alike({"f1": {f"{factor:g}": 0.7 for factor in (*INSIDE, *OUTSIDE)}}),
    ),
)  # fmt: skip
