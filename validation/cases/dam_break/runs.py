"""Runs of the dam break. Lengths in metres; the column is 1 m high (2 L) unless its height is given."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from refsim import Box, BoxWalls, Cloud, Gravity, Scene, Simulation, SurfaceDetection, WeaklyCompressible
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
METHODS = ("number_density", "fan_scan", "two_step")
WORDS = {"number_density": "number density", "fan_scan": "fan scan", "two_step": "two-step"}


def column_scene(columns: int, depth: int = 1, tank: float = 4.0, effects: tuple = (), cloud: Any = None) -> Scene:
    """A column of columns x 2 columns (x depth) particles at one end of a closed tank of length `tank` L.

    The viscosity of 4 Pa s, in proportion to the spacing, is numerical: it stands for the artificial viscosity that
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
                dynamic_viscosity=4.0 * 80.0 * spacing,
                state="tait",
            ),
            Gravity(acceleration=(0.0, -GRAVITY, 0.0)),
            BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.5 * HEIGHT * tank, LID, depth * spacing)),
            *effects,
        ),
    )


def collapse(
    context: Context, columns: int, until: float, backend: str, depth: int = 1, samples: int = 36, tank: float = 4.0
) -> Result:
    """The collapse in a tank of 4 L to `until` [s], with three detectors scored against the exact surface."""
    simulation = context.simulation(column_scene(columns, depth, tank, (SurfaceDetection(),)), backend)
    spacing, walls = simulation.plan.grid.spacing, simulation.plan.walls.position
    cover = arc_cover_surface if depth == 1 else cap_cover_surface
    mass = simulation.field("mass")
    ledger = Ledger(simulation, (0.5 * HEIGHT * tank, LID, depth * spacing))
    frames: dict[str, list[np.ndarray]] = {"position": [], "truth": [], **{method: [] for method in METHODS}}
    time, truth_count, scanned = [], [], []
    counts = {method: np.zeros(3, int) for method in METHODS}  # hits, false surface, false interior
    over_time: dict[str, dict[str, list[float]]] = {
        method: {name: [] for name in ("precision", "recall", "f1")} for method in METHODS
    }

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        ledger.add(simulation)
        position = simulation.field("position")
        truth = cover(position, TRUTH_RADIUS * spacing, walls)
        frames["position"].append(position)
        frames["truth"].append(truth)
        time.append(simulation.time)
        truth_count.append(int(truth.sum()))
        scanned.append(float(simulation.field("near_surface").mean()))
        for method in METHODS:
            if method == "two_step":
                flags = simulation.field("surface").astype(bool)
            else:
                flags = detect(context, method, columns, depth, tank, (position, mass), backend)
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
        "ledger": ledger.values(simulation),
        "steps": simulation.steps,
        "seconds": wall,
        "stages": stage_seconds(simulation),
    }
    return Result(values, {name: np.array(parts) for name, parts in frames.items()})


def detect(
    context: Context, method: str, columns: int, depth: int, tank: float, cloud: tuple, backend: str
) -> np.ndarray:
    """What one detector says of a cloud (position, mass) in the tank; bool (n,)."""
    scene = column_scene(columns, depth, tank, (SurfaceDetection(method=method),), cloud)
    simulation = context.simulation(scene, backend)
    simulation.evaluate()
    return simulation.field("surface").astype(bool)


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
    context: Context, columns: list[int], repeats: int, backend: str, moment: float = 0.6, tank: float = 4.0
) -> Result:
    """Median seconds of detection on the state at `moment` [s], by particle number and detector."""
    sizes, weights = [], np.cumsum([0.0, *(n**3 for n in columns)])
    for k, width in enumerate(columns):

        def progress(share: float, k: int = k) -> None:
            context.progress((weights[k] + share * (weights[k + 1] - weights[k])) / weights[-1])

        simulation = context.simulation(column_scene(width, 1, tank), backend)
        advance(simulation, [moment], lambda simulation, wall: None, Context(progress))
        cloud = (simulation.field("position"), simulation.field("mass"))
        methods, share, density = {}, 0.0, []
        for method in METHODS:
            scene = column_scene(width, 1, tank, (SurfaceDetection(method=method),), cloud)
            judged = context.simulation(scene, backend)
            judged.evaluate()
            spent = [_stages(judged) for _ in range(repeats)]
            own = [op for op in spent[0] if op.startswith(("surface_detection.", "surface_normal."))]
            density += [stages["sph.density"] for stages in spent]
            scan = [stages.get("surface_detection.fan_scan", 0.0) for stages in spent]
            whole = [sum(stages[op] for op in own) for stages in spent]
            methods[method] = {
                "scan": float(np.median(scan)),
                "whole": float(np.median(whole)),
                "spread": float(np.median(np.abs(np.array(whole) - np.median(whole)))),
            }
            if method == "two_step":
                share = float(judged.field("near_surface").mean())
        sizes.append(
            {
                "particles": simulation.count,
                "scanned_share": share,
                "methods": methods,
                "number_density_pass": float(np.median(density)),
            }
        )
    return Result({"moment": moment, "repeats": repeats, "sizes": sizes})


def _stages(simulation: Simulation) -> dict[str, float]:
    """Seconds of every pass in one more evaluation."""
    before = stage_seconds(simulation)
    simulation.evaluate()
    return {name: seconds - before.get(name, 0.0) for name, seconds in stage_seconds(simulation).items()}
