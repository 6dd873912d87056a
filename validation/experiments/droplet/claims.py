"""What Jiang & Zhu 2023 claim of their force and its correction, measured on drops.

Quick sizes are drops of 11^3 particles, the published ones those of the experiment's own runs; starts are rotations of
a cut cube, so that no symmetry of a lattice flatters the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from refsim import Cloud, JiangZhu2023, Scene, WeaklyCompressible
from refsim.surface_tension.jiang_zhu_2023 import kirkwood_buff_sigma, unit_moment
from validation.experiment import Family, Measure, Options, Results, Run, alike
from validation.experiments.droplet import runs
from validation.experiments.droplet.scene import VARIANTS, droplet_scene, particles
from validation.metrics.shapes import lattice_ball
from validation.results import Result, real
from validation.running import Context, advance

SMALL, FULL = 1331, 5039  # particles
SEEDS = (1, 2, 3, 4, 5)
DEFAULTS = {seed: f"cut_{FULL}" if seed == 1 else f"seed_cut_{seed}" for seed in SEEDS}  # the experiment's runs
SUPPORT = 2.6  # of the default droplet, in spacings


def drop(options: Options, seed: int, key: str, **changes: Any) -> Run:
    """A cut cube to rest; `changes` are parameters of `runs.relax`."""
    count = SMALL if options.quick else FULL
    parameters = {"shape": "cut", "count": count, "backend": options.backend, "seed": seed, **changes}
    if seed == 1:
        parameters.pop("seed")  # the experiment's own run: its result serves
    name = f"claim_{key}_{parameters['count']}_{seed}"
    if key == "default" and not options.quick:
        name = DEFAULTS[seed]
    return Run(name, runs.relax, parameters, estimate=3.0 if parameters["count"] == SMALL else 40.0)


def starts(options: Options) -> Sequence[int]:
    """Seeds of the rotations."""
    return SEEDS[:3] if options.quick else SEEDS


def end(results: Results, key: str, part: str) -> list[float]:
    """A number of each run's final state by seed, for keys that begin so; the default's runs are the experiment's."""
    found = {seed: results[name] for seed, name in DEFAULTS.items() if key == "default" and name in results}
    for name, result in results.items():
        if name.startswith(f"claim_{key}_"):
            found[int(name.rsplit("_", 1)[1])] = result
    return [real(found[seed].values["end"][part]) for seed in sorted(found)]


def compared(over: str, under: str, part: str) -> Callable[[Results], list[float]]:
    """Ratio of an end's number between two sets of runs, start by start."""

    def values(results: Results) -> list[float]:
        return [a / b for a, b in zip(end(results, over, part), end(results, under, part), strict=True)]

    return values


def both(key: str, **changes: Any) -> Callable[[Options], list[Run]]:
    """The default and a changed drop from every start."""

    def planned(options: Options) -> list[Run]:
        return [
            run
            for seed in starts(options)
            for run in (drop(options, seed, "default"), drop(options, seed, key, **changes))
        ]

    return planned


# J(21) and momentum, by pair mode: the force of the area term alone, in float64, where what is left is not rounding.
# A run cannot tell: the viscous force J(11) is not central either, and turns a drop as well.


def area_force(context: Context, count: int, seed: int, mode: str, backend: str) -> Result:
    """Sum of the area term's forces and of their torques, over the sums of moduli, on a drop after 0.1 s.

    `without` is the same for all forces but the area term and viscosity.
    """
    position, spacing, _ = particles("cut", count, seed)
    moving = context.simulation(droplet_scene(position, spacing, dtype="float64"), backend)
    advance(moving, [0.1], lambda simulation, wall: None, context)
    position, mass = moving.field("position"), moving.field("mass")[:, None]
    force = {}
    for area in ("corrected", "none"):
        changes = {**VARIANTS["default" if mode == "all" else mode].changes, "viscosity": 0.0, "dtype": "float64"}
        changes["tension"] = {**changes.get("tension", {}), "area_term": area}
        looked = context.simulation(droplet_scene(position, spacing, **changes), backend)
        looked.evaluate(on_demand=False)
        force[area] = mass * looked.field("acceleration")
    found = {}
    for name, value in (("area", force["corrected"] - force["none"]), ("without", force["none"])):
        found[name] = lost(position, value)
    return Result(found)


def lost(position: np.ndarray, force: np.ndarray) -> dict[str, float]:
    """Sum of the forces over the sum of |f|, and of the torques over the sum of |x| |f|; position, force (n, 3)."""
    length, torque = np.linalg.norm(force, axis=1), np.cross(position, force)
    return {
        "linear": float(np.linalg.norm(force.sum(0)) / length.sum()),
        "angular": float(np.linalg.norm(torque.sum(0)) / (np.linalg.norm(position, axis=1) * length).sum()),
    }


def momentum(mode: str, force: str, part: str) -> Measure:
    """What a force does to the linear or angular momentum, start by start."""

    def planned(options: Options) -> list[Run]:
        made = []
        for seed in SEEDS:
            parameters = {"count": SMALL, "seed": seed, "mode": mode, "backend": options.backend}
            made.append(Run(f"claim_area_force_{mode}_{seed}", area_force, parameters, estimate=2.0))
        return made

    return Measure(planned, lambda found: [result.values[force][part] for result in found.values()])


LINEAR_MOMENTUM_ALL = momentum("all", "area", "linear")
ANGULAR_MOMENTUM_ALL = momentum("all", "area", "angular")
LINEAR_MOMENTUM_SOFT = momentum("soft", "area", "linear")
ANGULAR_MOMENTUM_SOFT = momentum("soft", "area", "angular")
LINEAR_MOMENTUM_EITHER = momentum("either", "area", "linear")
ANGULAR_MOMENTUM_EITHER = momentum("either", "area", "angular")
LINEAR_MOMENTUM_BOTH = momentum("both", "area", "linear")
ANGULAR_MOMENTUM_BOTH = momentum("both", "area", "angular")
LINEAR_MOMENTUM_ONE_SIDED = momentum("one_sided", "area", "linear")
ANGULAR_MOMENTUM_ONE_SIDED = momentum("one_sided", "area", "angular")
ANGULAR_MOMENTUM_WITHOUT_AREA = momentum("all", "without", "angular")

# The area term and its normals.

AREA_ROUNDS = Measure(
    both("no_area", tension={"area_term": "none"}), compared("no_area", "default", "radius_variation"), quick=False
)
AREA_CALMS = Measure(
    both("no_area", tension={"area_term": "none"}), compared("no_area", "default", "kinetic_share"), quick=False
)
STRENGTHS = (0.5, 1.0, 1.5)  # of the default coefficient of each area term


def area_runs(options: Options) -> list[Run]:
    """Both area terms, each at three strengths, from every start."""
    spacing = (1.0 / (SMALL if options.quick else FULL)) ** (1.0 / 3.0)
    gamma = 1.0 / kirkwood_buff_sigma(1.0, 1.0, SUPPORT * spacing, 3)
    made = []
    for seed in starts(options):
        for strength in STRENGTHS:
            corrected, color = {"area_ratio": 0.012 * strength}, {
                "area_term": "color", "area_acceleration": float(f"{1e-3 * gamma * strength:.6g}"),
            }  # fmt: skip
            if strength == 1.0:
                made.append(drop(options, seed, "default"))
            else:
                made.append(drop(options, seed, f"corrected{strength}", tension=corrected))
            made.append(drop(options, seed, f"color{strength}", tension=color))
    return made


def smoothest(part: str) -> Callable[[Results], list[float]]:
    """Least value with J(20) over that with J(19), each at its best strength, start by start."""

    def values(results: Results) -> list[float]:
        best = {}
        for kind in ("corrected", "color"):
            keys = ["default" if kind == "corrected" and s == 1.0 else f"{kind}{s}" for s in STRENGTHS]
            best[kind] = np.min([end(results, key, part) for key in keys], axis=0)
        return (best["corrected"] / best["color"]).tolist()

    return values


NORMALS_SMOOTH = Measure(area_runs, smoothest("radius_variation"), quick=False)
NORMALS_CALM = Measure(area_runs, smoothest("kinetic_share"), quick=False)

# The density correction.


def surface_density(context: Context, count: int, seed: int, backend: str) -> Result:
    """Density error near the surface of a jittered ball, rms over N, by J(7) and by J(14); the truth is rho0."""
    position = lattice_ball(count).astype(float)
    position += np.random.default_rng(seed).uniform(-0.05, 0.05, position.shape)
    found = {}
    for name, corrects in (("raw", False), ("corrected", True)):
        scene = Scene(
            spacing=1.0,
            support_radius=SUPPORT,
            dtype="float64",
            fluid=(Cloud(position=position),),
            effects=(
                WeaklyCompressible(rest_density=1.0, sound_speed=40.0, kernels="mueller"),
                JiangZhu2023(gamma=0.0, density_correction=corrects),
            ),
        )
        simulation = context.simulation(scene, backend)
        simulation.evaluate()
        found[name] = simulation
    near = found["corrected"].field("near_surface") != 0
    error = {name: float(np.sqrt(((s.field("density")[near] - 1.0) ** 2).mean())) for name, s in found.items()}
    return Result({"error": error, "near_surface": int(near.sum()), "particles": len(position)})


def _density_runs(options: Options) -> list[Run]:
    return [
        Run(f"claim_density_{seed}", surface_density, {"count": SMALL, "seed": seed, "backend": options.backend}, 2.0)
        for seed in SEEDS
    ]


CORRECTION_ACCURATE = Measure(
    _density_runs, lambda found: [r.values["error"]["corrected"] / r.values["error"]["raw"] for r in found.values()]
)
CORRECTION_STEADIES = Measure(
    both("raw_density", tension={"density_correction": False}),
    compared("raw_density", "default", "radius_variation"),
    quick=False,
)

# Time to steady state: pairs confined to the surface over all pairs.

FROM = {
    "cube_4913": ("cube", 4913, 1), "cube_5832": ("cube", 5832, 1), "cut_5039": ("cut", 5039, 1),
    "box_4862": ("box", 4913, 1), "seed_cut_2": ("cut", 5039, 2),
}  # fmt: skip


def steady_ratio(variant: str) -> Measure:
    """Wall seconds until steady over those of all pairs, from two lattice cubes, two cut ones and a turned box.

    Infinite where the drop is never steady, zero where only that of all pairs is not.
    """

    def planned(options: Options) -> list[Run]:
        made = []
        for key, (shape, count, seed) in FROM.items():
            parameters: dict[str, Any] = {"shape": shape, "count": count, "backend": options.backend}
            if seed != 1:
                parameters["seed"] = seed
            made.append(Run(key, runs.relax, parameters, estimate=15.0))  # the experiment's own, but for one
            changed = {**parameters, "variant": variant}
            made.append(Run(f"claim_steady_{variant}_{key}", runs.relax, changed, estimate=18.0))
        return made

    def values(results: Results) -> list[float]:
        found = []
        for key in FROM:
            mine, its = results[f"claim_steady_{variant}_{key}"].values["steady"], results[key].values["steady"]
            found.append(float("inf") if mine is None else mine["wall"] / its["wall"] if its else 0.0)
        return found

    return Measure(planned, values, quick=False, timed=True)


STEADY_SOONER_SOFT = steady_ratio("soft")
STEADY_SOONER_TEXT = steady_ratio("text")


# J(17): no run, only integration and roots.


def force_extremes(context: Context, dim: int, alpha: float, beta: float) -> Result:
    """Greatest repulsion over greatest attraction of C(r), and its first moment of force."""
    q = np.linspace(0.0, 1.0, 200_001)
    inner = np.where(q < 0.8, (1 - (q / 0.8) ** 2) ** 3, 0.0) / 0.8**dim
    curve = alpha * inner - beta * (1 - q**2) ** 3
    moment = unit_moment(dim, alpha, beta, dim)
    return Result({"ratio": float(curve.max() / -curve.min()), "moment": moment})


def repulsion(dim: int) -> Measure:
    """Greatest repulsion over greatest attraction with the printed coefficients."""

    def planned(options: Options) -> list[Run]:
        return [Run(f"claim_curve_{dim}d", force_extremes, {"dim": dim, "alpha": 0.6, "beta": 0.9}, 0.1)]

    return Measure(planned, lambda found: [result.values["ratio"] for result in found.values()])


REPULSION_3D = repulsion(3)
REPULSION_2D = repulsion(2)

# Null models


def _without_reaction(measure: Measure) -> list[float]:
    """Forces that no particle returns: random ones on a ball."""
    position = lattice_ball(SMALL).astype(float)
    found = lost(position, np.random.default_rng(1).normal(size=position.shape))
    return measure.of({"": {"area": found, "without": found}})


def _end(**values: float) -> Callable[[Measure], Sequence[float]]:
    return alike({"end": values})


def _only_attraction(measure: Measure) -> list[float]:
    """J(17) whose repulsion has the range of its attraction."""
    q = np.linspace(0.0, 1.0, 1001)
    curve = (0.6 - 0.9) * (1 - q**2) ** 3
    return measure.of({"": {"ratio": float(curve.max() / -curve.min())}})


MODES = ("all", "soft", "either", "both", "one_sided")
MOMENTA = tuple(f"{part}_momentum_{mode}" for part in ("linear", "angular") for mode in MODES)
FAMILIES = (
    Family(
        (*MOMENTA, "angular_momentum_without_area"), "Forces or torques could be left over when they are summed.",
        "random forces, to which no particle returns the opposite", _without_reaction,
    ),
    Family(
        ("correction_accurate",), "(14) could be as far from the density as (7).", "both have the same error",
        alike({"error": {"corrected": 0.1, "raw": 0.1}}),
    ),
    Family(
        ("correction_steadies", "normals_smooth", "area_rounds"),
        "A drop with the term could be as rough as one without it.", "both drops are alike",
        _end(radius_variation=0.01),
    ),
    Family(
        ("normals_calm", "area_calms"), "A drop with the term could move as much as one without it.",
        "both drops are alike", _end(kinetic_share=0.01),
    ),
    Family(
        ("repulsion_3d", "repulsion_2d"), "The greatest repulsion could be smaller than the greatest attraction.",
        "a repulsion with the range of the attraction", _only_attraction,
    ),
    Family(
        ("steady_sooner_soft", "steady_sooner_text"), "Fewer pairs could take as long to a drop at rest.",
        "both take the same time", alike({"steady": {"wall": 2.0}}),
    ),
)  # fmt: skip
