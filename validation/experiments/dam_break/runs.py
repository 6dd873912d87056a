"""Runs of the dam break. Lengths in metres; the column is 1 m high (2 L) unless its height is given."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from refsim import Box, BoxWalls, Cloud, Gravity, Scene, Simulation, SurfaceDetection, WeaklyCompressible, make_plan
from refsim.surface_detection import half_space_moment
from validation.metrics.dam_break import (
    FRONT_DATA,
    dimensionless_time,
    fit_time_offset,
    front_error,
    front_position,
    load_front_data,
)
from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface, detection_score
from validation.results import Result
from validation.running import Context, advance, search_log, stage_seconds

HEIGHT, GRAVITY, DENSITY = 1.0, 9.81, 1000.0
LID = 4.0  # m: the splash at the far wall rises nearly that high
SUPPORT = 2.6  # spacings
SKIN = 0.3  # of the support radius: the flow is fast, so a wider list is rebuilt less often
TRUTH_RADIUS = 1.2  # spacings
METHODS = ("number_density", "fan_scan", "two_step")  # those of the paper's figures 4 and 5
DETECTORS: dict[str, dict[str, Any]] = {  # settings of the effect
    **{method: {"method": method} for method in METHODS},
    "two_step_printed": {"literal": ("E23",)},
}
SETTINGS = {**DETECTORS, "second_moment": {"thin_features": "second_moment"}}  # of every detector of the hard cases
WORDS = {
    "number_density": "number density",
    "fan_scan": "fan scan",
    "two_step": "two-step",
    "two_step_printed": "two-step with J(12) as printed",
    "second_moment": "two-step with the second moment",
}


def viscosity(spacing: float) -> float:
    """Dynamic viscosity [Pa s] of the column: 4 Pa s at 80 spacings to a metre, in proportion to the spacing [m]."""
    return 4.0 * 80.0 * spacing


def column_scene(columns: int, depth: int = 1, tank: float = 4.0, effects: tuple = (), cloud: Any = None) -> Scene:
    """A column of columns x 2 columns (x depth) particles at one end of a closed tank of length `tank` L.

    The viscosity is numerical: it stands for the artificial viscosity that
    weakly compressible liquid needs, and the flow does not follow from it (Reynolds number above 500).
    depth  particles across; 1 is 2D. cloud  (position, mass) of a later moment, instead of the column
    """
    spacing = 0.5 * HEIGHT / columns
    dim = 2 if depth == 1 else 3
    fluid = Box(cells=(columns, 2 * columns, depth))
    if cloud is not None:
        fluid = Cloud(position=cloud[0], mass=cloud[1])
    return Scene(
        name="dam_break",
        dim=dim,
        spacing=spacing,
        support_radius=SUPPORT * spacing,
        skin=SKIN,
        fluid=(fluid,),
        effects=(
            WeaklyCompressible(
                rest_density=DENSITY,
                sound_speed=10.0 * math.sqrt(GRAVITY * HEIGHT),
                dynamic_viscosity=viscosity(spacing),
                state="tait",
            ),
            Gravity(acceleration=(0.0, -GRAVITY, 0.0)),
            BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.5 * HEIGHT * tank, LID, depth * spacing)),
            *effects,
        ),
    )


def jittered(columns: int, depth: int, seed: int, share: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    """(position, mass) of the column, every particle off its lattice point by up to `share` of the spacing."""
    plan = make_plan(column_scene(columns, depth))
    position, dim = plan.state.position.copy(), plan.grid.dim
    width = share * plan.grid.spacing
    position[:, :dim] += np.random.default_rng(seed).uniform(-width, width, (len(position), dim))
    return position, plan.state.mass


def collapse(
    context: Context,
    columns: int,
    until: float,
    backend: str,
    depth: int = 1,
    samples: int = 36,
    tank: float = 4.0,
    seed: int | None = None,
) -> Result:
    """The collapse in a tank of 4 L to `until` [s], with every detector scored against the exact surface.

    At every sample, each rule of FIRST_STEPS is tried as the first of two steps. With a `seed` the start is jittered.
    """
    start = None if seed is None else jittered(columns, depth, seed)
    simulation = context.simulation(column_scene(columns, depth, tank, (SurfaceDetection(),), start), backend)
    spacing, walls = simulation.plan.grid.spacing, simulation.plan.walls.position
    cover = arc_cover_surface if depth == 1 else cap_cover_surface
    mass = simulation.field("mass")
    ledger = Ledger(simulation, (0.5 * HEIGHT * tank, LID, depth * spacing))
    frames: dict[str, list[np.ndarray]] = {"position": [], "truth": [], **{method: [] for method in METHODS}}
    time, truth_count, scanned = [], [], []
    counts = {method: np.zeros(3, int) for method in DETECTORS}  # hits, false surface, false interior
    over_time: dict[str, dict[str, list[float]]] = {
        method: {name: [] for name in ("precision", "recall", "f1")} for method in DETECTORS
    }
    tried: dict[str, list[tuple[float, int, int, float]]] = {}

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        ledger.add(simulation)
        position = simulation.field("position")
        truth = cover(position, TRUTH_RADIUS * spacing, walls)
        frames["position"].append(position)
        frames["truth"].append(truth)
        time.append(simulation.time)
        truth_count.append(int(truth.sum()))
        scanned.append(float(simulation.field("scan_candidates").mean()))
        for method in DETECTORS:
            looked = simulation
            if method != "two_step":
                looked = detect(context, method, columns, depth, tank, (position, mass), backend)
            flags = looked.field("surface").astype(bool)
            if method == "fan_scan":
                try_first_steps(tried, simulation, looked, truth)
            if method in frames:
                frames[method].append(flags)
            score = detection_score(flags, truth)
            counts[method] += ((flags & truth).sum(), score.false_surface, score.false_interior)
            for name, values in over_time[method].items():
                values.append(float(getattr(score, name)))

    wall = advance(simulation, np.linspace(0.0, until, samples + 1).tolist(), sample, context)
    pooled = {}
    for method, (hit, false_surface, false_interior) in counts.items():
        pooled[method] = {
            "precision": hit / max(hit + false_surface, 1),
            "recall": hit / max(hit + false_interior, 1),
            "f1": 2 * hit / max(2 * hit + false_surface + false_interior, 1),
        }
    values = {
        "particles": simulation.count,
        "spacing": spacing,
        "truth_radius": TRUTH_RADIUS,
        "time": time,
        "truth": truth_count,
        "over_time": over_time,
        "score": pooled,
        "scanned_share": float(np.mean(scanned)),
        "first_step": first_step_values(tried),
        "ledger": ledger.values(simulation),
        "steps": simulation.steps,
        "seconds": wall,
        "stages": stage_seconds(simulation),
    }
    return Result(values, {name: np.array(parts) for name, parts in frames.items()})


def detect(
    context: Context,
    method: str,
    columns: int,
    depth: int,
    tank: float,
    cloud: tuple,
    backend: str,
    threads: int | None = None,
) -> Simulation:
    """A cloud (position, mass) in the tank, seen by one detector of SETTINGS."""
    scene = column_scene(columns, depth, tank, (SurfaceDetection(**SETTINGS[method]),), cloud)
    simulation = context.simulation(scene, backend, threads)
    simulation.evaluate()
    return simulation


@dataclass(frozen=True)
class Neighbourhoods:
    """What a first step may look at, each (n,): number density over delta0, its mean and largest value among the
    neighbours within h, first moment over that of a plane surface, |h grad c|."""

    density: np.ndarray
    mean: np.ndarray
    largest: np.ndarray
    moment: np.ndarray
    gradient: np.ndarray


# Rules for the first of two steps: words, what it costs beside the number density, and who is scanned.
FIRST_STEPS: dict[str, tuple[str, str, Callable[[Neighbourhoods], np.ndarray]]] = {
    "printed_0.90": ("delta <= 0.90 delta0", "nothing", lambda n: n.density <= 0.90),
    "printed_0.95": ("delta <= 0.95 delta0", "nothing", lambda n: n.density <= 0.95),
    "printed_0.98": ("delta <= 0.98 delta0, as printed", "nothing", lambda n: n.density <= 0.98),
    "printed_1.00": ("delta <= 1.00 delta0", "nothing", lambda n: n.density <= 1.0),
    "printed_1.01": ("delta <= 1.01 delta0", "nothing", lambda n: n.density <= 1.01),
    "below_mean": (
        "delta <= 0.99 of the neighbours' mean", "a pass over the list", lambda n: n.density <= 0.99 * n.mean,
    ),
    "below_largest": (
        "delta <= 0.98 of the neighbours' largest", "a pass over the list", lambda n: n.density <= 0.98 * n.largest,
    ),
    "gradient": ("|h grad c| >= 0.4", "J(19) everywhere", lambda n: n.gradient >= 0.4),
    "moment_0.25": ("first moment >= 0.25 M", "three sums in J(8)", lambda n: n.moment >= 0.25),
    "adopted_0.15": (
        "delta <= 0.90 delta0 or first moment >= 0.15 M", "three sums in J(8)",
        lambda n: (n.density <= 0.90) | (n.moment >= 0.15),
    ),
    "adopted_0.25": (
        "delta <= 0.90 delta0 or first moment >= 0.25 M, adopted", "three sums in J(8)",
        lambda n: (n.density <= 0.90) | (n.moment >= 0.25),
    ),
    "adopted_0.35": (
        "delta <= 0.90 delta0 or first moment >= 0.35 M", "three sums in J(8)",
        lambda n: (n.density <= 0.90) | (n.moment >= 0.35),
    ),
}  # fmt: skip


def neighbourhoods(simulation: Simulation, scanned: Simulation) -> Neighbourhoods:
    """From a simulation with the two-step detector, and one with the fan scan alone, of the same particles."""
    grid, fluid = simulation.plan.grid, simulation.plan.effects["weakly_compressible"]
    rest = fluid.rest_number_density(grid)  # type: ignore[attr-defined]
    density = simulation.field("number_density").astype(float) / rest
    moment = simulation.field("asymmetry").astype(float) / half_space_moment(fluid, grid)  # type: ignore[arg-type]
    pairs = cKDTree(simulation.field("position")).query_pairs(grid.support_radius, output_type="ndarray")
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    number = np.bincount(one, minlength=len(density))
    mean = np.bincount(one, density[other], minlength=len(density)) / np.maximum(number, 1)
    mean[number == 0] = 1.0
    largest = density.copy()
    np.maximum.at(largest, one, density[other])
    gradient = np.linalg.norm(scanned.field("surface_normal"), axis=1)
    return Neighbourhoods(density, mean, largest, moment, gradient)


def try_first_steps(
    tried: dict[str, list[tuple[float, int, int, float]]],
    simulation: Simulation,
    scanned: Simulation,
    truth: np.ndarray,
) -> None:
    """Note for every rule (recall lost to the fan scan alone, hits, false surface, share scanned)."""
    seen, surface = neighbourhoods(simulation, scanned), scanned.field("surface").astype(bool)
    all_hits, count = int((surface & truth).sum()), max(int(truth.sum()), 1)
    for name, (_, _, rule) in FIRST_STEPS.items():
        chosen = rule(seen)
        hits, wrong = int((surface & truth & chosen).sum()), int((surface & ~truth & chosen).sum())
        tried.setdefault(name, []).append(((all_hits - hits) / count, hits, wrong, float(chosen.mean())))


def first_step_values(tried: dict[str, list[tuple[float, int, int, float]]]) -> dict[str, dict[str, float]]:
    """Of every rule: largest and mean loss of recall over the samples, pooled precision, mean and largest share."""
    found = {}
    for name, rows in tried.items():
        loss, hits, wrong, share = np.array(rows).T
        found[name] = {
            "largest_loss": float(loss.max()),
            "mean_loss": float(loss.mean()),
            "precision": float(hits.sum() / max(hits.sum() + wrong.sum(), 1)),
            "share": float(share.mean()),
            "largest_share": float(share.max()),
        }
    return found


class Ledger:
    """Particles, mass and energy of a closed tank.

    Energy [J; J/m in 2D]: kinetic, potential, and the work stored by the compression under the clamped Tait equation,
    e(rho) = c^2/7 ((x^6 - 1)/6 + 1/x - 1) for x = rho/rho0 > 1.
    """

    def __init__(self, simulation: Simulation, upper: tuple[float, float, float]) -> None:
        self.upper = np.array(upper)
        self.count, self.mass = simulation.count, float(simulation.field("mass").astype(float).sum())
        self.energy: list[float] = []

    def add(self, simulation: Simulation) -> None:
        """Note the energy; the densities must belong to the present positions."""
        mass, density = (simulation.field(name).astype(float) for name in ("mass", "density"))
        velocity, height = simulation.field("velocity").astype(float), simulation.field("position")[:, 1].astype(float)
        x = np.maximum(density / DENSITY, 1.0)
        stored = 100.0 * GRAVITY * HEIGHT / 7.0 * ((x**6 - 1.0) / 6.0 + 1.0 / x - 1.0)
        self.energy.append(float((mass * (0.5 * (velocity**2).sum(1) + GRAVITY * height + stored)).sum()))

    def values(self, simulation: Simulation) -> dict[str, Any]:
        """The account at the end. Energy rise: largest rise above any earlier value, over the energy at the start."""
        position = simulation.field("position")
        spacing, dim = simulation.plan.grid.spacing, simulation.plan.grid.dim
        outside = ((position < -spacing) | (position > self.upper + spacing))[:, :dim].any(1)
        outside |= ~np.isfinite(position).all(1)
        energy = np.array(self.energy)
        rise = float((energy - np.minimum.accumulate(energy)).max()) if len(energy) else 0.0
        return {
            "lost_particles": self.count - simulation.count + int(outside.sum()),
            "mass_change": abs(float(simulation.field("mass").astype(float).sum()) - self.mass) / self.mass,
            "energy": self.energy,
            "energy_rise": rise / energy[0] if len(energy) else float("nan"),
            "stopped_at_walls": simulation.stopped_at_walls,
            **search_log(simulation),
        }


def surge(context: Context, columns: int, backend: str, depth: int = 1, tank: float = 15.0) -> Result:
    """The surge front in a tank of 15 L, against the published series."""
    width = 0.5 * HEIGHT
    simulation = context.simulation(column_scene(columns, depth, tank), backend)
    spacing = simulation.plan.grid.spacing
    ledger = Ledger(simulation, (width * tank, LID, depth * spacing))
    series = {name: load_front_data(name) for name in FRONT_DATA}
    last = max(data.time[-1] for data in series.values()) + 0.5
    time, front, farthest, detached = [], [], [], []

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        ledger.add(simulation)
        found = front_position(simulation.field("position")[:, : simulation.plan.grid.dim], spacing)
        time.append(float(dimensionless_time(simulation.time, width, GRAVITY)))
        front.append(found.connected / width)
        farthest.append(found.farthest / width)
        detached.append(found.detached)

    def short_of_end() -> bool:
        return farthest[-1] < tank - 0.1

    scale = math.sqrt(width / (2.0 * GRAVITY))
    times = (np.arange(0.0, last + 0.05, 0.05) * scale).tolist()
    wall = advance(simulation, times, sample, context, short_of_end)
    fits = {}
    for name, data in series.items():
        fit = fit_time_offset(time, front, data)
        error = front_error(time, front, data, fit.offset)
        fits[name] = {
            "offset": fit.offset,
            "offset_at_limit": fit.at_limit,
            "largest": error.largest,
            "at": error.at,
            "rms": error.rms,
            "points": error.points,
        }
    values = {
        "particles": simulation.count,
        "time": time,
        "connected": front,
        "farthest": farthest,
        "detached": detached,
        "front": fits,
        "ledger": ledger.values(simulation),
        "steps": simulation.steps,
        "seconds": wall,
    }
    return Result(values)


def detection_cost(
    context: Context,
    columns: int,
    repeats: int,
    backend: str,
    moment: float = 0.6,
    tank: float = 4.0,
    moved_on: str | None = None,
) -> Result:
    """Seconds of detection on the state at `moment` [s], by detector: on one thread, and on all of them.

    With few particles most of the time of many threads goes into starting them; so one thread is judged, and read in
    four times as many turns. moved_on: the backend that moves the column to that state, `backend` if left out.
    """
    simulation = context.simulation(column_scene(columns, 1, tank), moved_on or backend)
    advance(simulation, [moment], lambda simulation, wall: None, context)
    cloud = (simulation.field("position"), simulation.field("mass"))
    alone = timed_detectors(context, cloud, columns, tank, backend, repeats, 1)
    together = (
        alone
        if backend != "cpu"
        else timed_detectors(context, cloud, columns, tank, backend, max(repeats // 4, 1), None)
    )
    values = {"moment": moment, "repeats": repeats, "particles": simulation.count, "moved_on": moved_on or backend}
    return Result(values | alone | {"all_threads": together["methods"]})


QUIET = 0.25  # quantile of the readings that is taken: what else the machine does only adds to a reading
SPAN = 1.0  # s of readings, at least: more than a short disturbance


def timed_detectors(
    context: Context, cloud: tuple, columns: int, tank: float, backend: str, repeats: int, threads: int | None
) -> dict[str, Any]:
    """Seconds of every detector on one cloud: the lower quartile of its readings, `repeats` at least and for SPAN at
    least; the detectors take turns.

    A reading is one evaluation, shorter than the time that an operating system gives a process at once. Beside ten
    other processes on two cores, lower quartiles of 60 readings gave ratios within 3 % of each other, medians of 15
    within a factor of ten, and longer readings, each of them interrupted, within a factor of two.

    whole    threshold, normals and scan, and what the detector adds to the density pass
    charged  the same where no other effect needs the number density: with the pass that sums it
    """
    judged = {method: detect(context, method, columns, 1, tank, cloud, backend, threads) for method in DETECTORS}
    spent: dict[str, list[dict[str, float]]] = {method: [] for method in judged}
    random = np.random.default_rng(0)  # the order changes, so that no detector keeps the same moment of a busy machine
    until = time.perf_counter() + SPAN
    while len(spent["two_step"]) < repeats or time.perf_counter() < until:
        for method in random.permutation(list(judged)).tolist():
            spent[method].append(_stages(judged[method]))

    def quiet(method: str, name: str) -> float:
        return float(np.quantile([stages.get(name, 0.0) for stages in spent[method]], QUIET))

    plain = quiet("number_density", "sph.density")  # J(7) and J(8), nothing else
    methods = {}
    for method, rounds in spent.items():
        own = [op for op in rounds[0] if op.startswith(("surface_detection.", "surface_normal."))]
        whole = np.array([sum(stages[op] for op in own) for stages in rounds])
        moment_sum = 0.0
        if "asymmetry" in judged[method].fields:
            moment_sum = max(quiet(method, "sph.density") - plain, 0.0)
        seconds = float(np.quantile(whole, QUIET)) + moment_sum
        methods[method] = {
            "scan": quiet(method, "surface_detection.fan_scan"),
            "normals": quiet(method, "surface_normal.color_gradient"),
            "moment_sum": moment_sum,
            "whole": seconds,
            "charged": seconds + (0.0 if method == "fan_scan" else plain),
            "spread": float(np.median(np.abs(whole - np.median(whole)))),
        }
    return {
        "scanned_share": float(judged["two_step"].field("scan_candidates").mean()),
        "methods": methods,
        "number_density_pass": plain,
    }


def _stages(simulation: Simulation) -> dict[str, float]:
    """Seconds of every pass in one more evaluation."""
    before = stage_seconds(simulation)
    simulation.evaluate()
    return {name: seconds - before.get(name, 0.0) for name, seconds in stage_seconds(simulation).items()}
