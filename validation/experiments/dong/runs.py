"""Runs of Dong's scenes."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Mapping
from typing import Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim import Cloud, Dong2016, Scene, Simulation
from refsim.core.effect import Extremes
from refsim.core.errors import RunStopped
from refsim.scene.plan import make_plan
from validation.experiments.dong import scene as scenes
from validation.metrics.droplet import (
    cubic_moment,
    nearest_neighbour_distance,
    radius_variation,
    sphericity,
    surface_mesh,
)
from validation.metrics.spread import layers, seen_from_above
from validation.results import Result, real
from validation.running import Context, advance, momenta, refusal

BULK = 0.6  # of R: particles inside count as bulk


def rayleigh_period(tension: float, radius: float, mode: int = 4) -> float:
    """Of a drop's mode [s]: omega^2 = n(n-1)(n+2) sigma/(rho0 R^3), without viscosity."""
    square = mode * (mode - 1) * (mode + 2) * tension / (scenes.DENSITY * radius**3)
    return 2 * math.pi / math.sqrt(square)


def oscillation(time: NDArray, moment: NDArray) -> dict[str, float]:
    """Period and decay of the cubic moment from its first maximum on, by a fit of a damped cosine.

    period  [s]; free: the same without the fitted damping; decay [1/s]; misfit: rms over the first amplitude.
    NaN where there is no maximum, or no two half-swings after it.
    """
    from scipy.optimize import curve_fit

    none = dict.fromkeys(("period", "free", "decay", "misfit"), math.nan)
    turns = [k for k in range(1, len(moment) - 1) if (moment[k] - moment[k - 1]) * (moment[k + 1] - moment[k]) < 0]
    tops = [k for k in turns if moment[k] > 0]
    if not tops or len([k for k in turns if k > tops[0]]) < 2:
        return none
    later = [k for k in turns if k > tops[0]]
    guess = 2 * (time[later[0]] - time[tops[0]])
    window = (time >= time[tops[0]]) & (time <= time[tops[0]] + 2.5 * guess)
    t, q = time[window] - time[tops[0]], moment[window]

    def swing(t: NDArray, a: float, decay: float, omega: float, phase: float, rest: float) -> NDArray:
        return a * np.exp(-decay * t) * np.cos(omega * t + phase) + rest

    try:
        (a, decay, omega, *_), _ = found = curve_fit(swing, t, q, (q[0], 1 / guess, 2 * math.pi / guess, 0.0, 0.0))
    except RuntimeError:
        return none
    misfit = float(np.sqrt(((swing(t, *found[0]) - q) ** 2).mean()) / abs(a))
    omega = abs(omega)
    free = 2 * math.pi / math.sqrt(omega**2 + decay**2)
    return {"period": 2 * math.pi / omega, "free": free, "decay": float(decay), "misfit": misfit}


def cube(
    context: Context, shape: str, count: int, backend: str, seed: int = 1, until: float = 4.0, samples: int = 100,
    model: str = "dong", viscosity: float = scenes.CUBE_VISCOSITY, changes: dict[str, Any] | None = None,
) -> Result:  # fmt: skip
    """From a shape to rest in free space, calibrated: how round it is, along which axes it stands out, its density."""
    position, spacing = scenes.start(shape, count, seed)
    scene = scenes.cube_scene(position, spacing, viscosity=viscosity, model=model, **(changes or {}))
    return drop(context, scene, np.linspace(0.0, until, samples + 1), backend)


def drop(context: Context, scene: Scene, times: NDArray, backend: str) -> Result:
    """Any scene of one drop, sampled at `times` [s]; a run that stops is a result, with its reason.

    compression  95th percentile over the particles of rho/rho0 - 1; swing: the bulk's mean of rho/rho0 - 1
    """
    simulation = context.simulation(scene, backend)
    spacing = scene.spacing
    radius = spacing * (3 * simulation.count / (4 * math.pi)) ** (1 / 3)
    begin = simulation.field("position").astype(float)
    series: dict[str, list[Any]] = {}
    frames, stopped, wall = [], "", 0.0

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        x = simulation.field("position").astype(float)
        away = x - x.mean(0)
        distance = np.linalg.norm(away, axis=1)
        share = simulation.field("density").astype(float) / scenes.DENSITY - 1
        bulk = share[distance < BULK * radius]
        near = nearest_neighbour_distance(x) / spacing
        row = {
            "time": simulation.time, "wall": wall, "steps": simulation.steps, "moment": cubic_moment(x),
            "radius_variation": radius_variation(x),
            "points": _reach(away, 1) / radius, "corners": _reach(away, 3) / radius,
            "swing": float(bulk.mean()) if len(bulk) else math.nan, "compression": float(np.quantile(share, 0.95)),
            "nn_5": float(np.quantile(near, 0.05)), "moved": float(np.linalg.norm(x - begin, axis=1).max()) / spacing,
            **momenta(simulation),
        }  # fmt: skip
        for name, value in row.items():
            series.setdefault(name, []).append(value)
        frames.append(x.astype(np.float32))

    try:
        wall = advance(simulation, times.tolist(), sample, context)
    except RunStopped as error:
        stopped = f"{error.reason} at {simulation.time:.3f} s"
    energy, time_ = np.array(series["kinetic_energy"]), np.array(series["time"])
    values = {
        "particles": simulation.count, "spacing": spacing, "radius": radius, "stopped": stopped, "series": series,
        "oscillation": oscillation(time_, np.array(series["moment"])), "area": area(frames[-1], spacing),
        "kinetic_share": float(energy[-1] / energy.max()) if energy.max() > 0 else 0.0,
        "swing": float(np.nanmax(np.abs(series["swing"]))), "compression": max(series["compression"]),
        "swing_late": float(np.ptp(np.array(series["swing"])[len(time_) // 2 :]) / 2),
        "notes": list(simulation.plan.notes), "steps": simulation.steps, "seconds": wall,
        **coefficients(scene),
    }  # fmt: skip
    return Result(values, {"position": np.array(frames)})


def coefficients(scene: Scene) -> dict[str, Any]:
    """k [N/kg^2] and lambda [m^2/s^2] of the scene's tension; nothing of another one."""
    plan = make_plan(scene)
    effect = plan.effects.get("dong_2016")
    if not isinstance(effect, Dong2016):
        return {}
    return {
        "stiffness": effect.coefficient(plan.grid, plan.effects),
        "correction": effect.correction_coefficient(plan.grid, plan.effects),
    }


def area(position: NDArray, spacing: float) -> float:
    """Area of the surface over that of a ball of the same volume; NaN where there is no one closed surface."""
    try:
        return 1 / sphericity(*surface_mesh(position.astype(float), spacing))
    except ValueError:
        return math.nan


def _reach(away: NDArray, axes: int) -> float:
    """How far the drop reaches along the lattice's axes (1) or its body diagonals (3): mean over all of them [m]."""
    grid = np.array(np.meshgrid(*[(-1, 0, 1)] * 3)).reshape(3, -1).T
    directions = grid[np.abs(grid).sum(1) == axes] / math.sqrt(axes)
    near = away @ directions.T
    across = np.linalg.norm(away[:, None, :] - near[..., None] * directions[None], axis=2)
    width = 0.15 * np.abs(away).max()
    return float(np.where(across < width, near, -np.inf).max(0).mean())


def printed(
    context: Context, side: int, cohesion: bool, correction: bool, steps: int, backend: str, filtered: bool = True,
    samples: int = 4,
) -> Result:  # fmt: skip
    """The 0.5 m cube with every printed number: how far its particles move in `steps` steps of 0.005 s."""
    scene = scenes.printed_cube(side, cohesion, correction, filtered)
    result = drop(context, scene, np.linspace(0.0, steps * scenes.PRINTED_STEP, samples + 1), backend)
    simulation = context.simulation(scene, backend)
    simulation.evaluate()
    greatest = float(np.linalg.norm(simulation.field("acceleration"), axis=1).max())
    return Result({**result.values, "greatest_acceleration": greatest})


def printed_limits(context: Context, backend: str) -> Result:
    """What the printed step is for the block that falls: refused at ten times the impact's speed, soft below.

    limit        stable step at rest for c = 10 U [s]; refused: the sentence that the scene is answered with
    soft         compression of the block for the sound speed that the step does allow, 0.2 h/dt
    """
    speed = scenes.impact_speed()
    stiff = scenes.printed_block(1, 10 * speed)
    soft_sound = 0.2 * stiff.support_radius / scenes.PRINTED_STEP
    plan = make_plan(scenes.printed_block(1, 10 * speed, step=0.0))
    limits = [limit for e in plan.effects.values() for limit in e.step_limits(plan.grid, plan.effects).values()]
    found = falling(context, scenes.printed_block(1, soft_sound), list(range(0, 101, 2)), backend)
    return Result(
        {
            "impact_speed": speed, "sound_speed": 10 * speed, "step": scenes.PRINTED_STEP,
            "limit": min(limit.at(Extremes(0.0, 0.0)) for limit in limits), "refused": refusal(stiff),
            "soft_sound_speed": soft_sound, "soft": found.values["compression"],
            "soft_stopped": found.values["stopped"],
        }
    )  # fmt: skip


def fall(
    context: Context, tension: bool, backend: str, seed: int = 1, frames: tuple[int, ...] = scenes.FRAMES,
    filtered: bool = True, solver: Literal["shared", "hu_adams"] = "shared",
) -> Result:  # fmt: skip
    """The block of 810 particles falls into the room: what lies on the floor at the given frames."""
    return falling(context, scenes.block_scene(seed, tension, filtered, solver=solver), list(frames), backend)


def falling(context: Context, scene: Scene, frames: list[int], backend: str) -> Result:
    """A scene of the falling block, sampled at frames; a run that stops is a result, with its reason."""
    simulation = context.simulation(scene, backend)
    rows: list[dict[str, Any]] = []
    positions: list[NDArray] = []
    stopped = ""

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        x = simulation.field("position").astype(float)
        share = simulation.field("density").astype(float) / scenes.DENSITY - 1
        motion = momenta(simulation)
        rows.append(
            {
                "frame": frames[len(rows)], "time": simulation.time, "wall": wall, "steps": simulation.steps,
                **seen_from_above(x, scene.spacing), "layers": layers(x, scene.spacing),
                "compression": float(np.quantile(share, 0.95)), "kinetic_energy": motion["kinetic_energy"],
            }
        )  # fmt: skip
        positions.append(x.astype(np.float32))

    try:
        wall = advance(simulation, [frame * scenes.FRAME for frame in frames], sample, context)
    except RunStopped as error:
        stopped, wall = f"{error.reason} at {simulation.time:.3f} s", math.nan
    return Result(
        {
            "particles": simulation.count, "spacing": scene.spacing, "rows": rows, "stopped": stopped, "seconds": wall,
            "compression": max((row["compression"] for row in rows), default=math.nan), "steps": simulation.steps,
            "notes": list(simulation.plan.notes),
        },
        {"position": np.array(positions)},
    )  # fmt: skip


def per_frame(values: Mapping[str, Any]) -> float:
    """Seconds a frame, from the values of `seconds_per_frame`."""
    return real(values["step"]) * values["steps"] / values["frames"]


def seconds_per_frame(
    context: Context, model: str, case: str, backend: str, frames: int = 40, timed: int = 20, side: int = 17,
    drops: int = 12, turn: int = 1, threads: int | None = None,
) -> Result:  # fmt: skip
    """Seconds a frame of 0.005 s for one model: the median step of the last `timed` frames, times steps per frame.

    A frame is one or two steps, so that the median of frames would jump.

    turn  tells repetitions apart; threads: of the CPU, all without
    case  "droplet" (the cube) or "oil" (drops of 900 kg/m^3 that run into each other). All models have one sound speed,
          support, viscosity and nominal tension.
    """
    if case == "droplet":
        position, spacing = scenes.start("cube", side**3)
        density = scenes.DENSITY
    else:
        position, spacing = scenes.oil_drops(drops)
        density = scenes.OIL
    sound = math.sqrt(scenes.TENSION / (density * spacing * 0.01))
    scene = Scene(
        name=f"dong_{case}", spacing=spacing, support_radius=2.6 * spacing, fluid=(Cloud(position=position),),
        effects=(
            scenes.liquid(density, sound_speed=sound, dynamic_viscosity=scenes.CUBE_VISCOSITY, kernels="wendland"),
            scenes.tension_of(model, scenes.TENSION),
        ),
    )  # fmt: skip
    simulation = context.simulation(scene, backend, threads)
    spent, steps, stopped = [], [], ""
    try:
        for frame in range(frames):
            simulation.backend.synchronize()
            began, before = time.perf_counter(), simulation.steps
            while simulation.time < (frame + 1) * scenes.FRAME:
                simulation.step()
            simulation.backend.synchronize()
            spent.append(time.perf_counter() - began)
            steps.append(simulation.steps - before)
            context.progress((frame + 1) / frames)
    except RunStopped as error:
        stopped = f"{error.reason} at {simulation.time:.3f} s"
    late = spent[-timed:]
    each = [s / max(1, n) for s, n in zip(late, steps[-timed:])]
    return Result(
        {
            "model": model, "case": case, "particles": simulation.count, "frames": len(spent), "steps": sum(steps),
            "stopped": stopped,
            "step": statistics.median(each) if each else math.nan,
            "spread": [min(late), max(late)] if late else [], "threads": threads or context.threads, "turn": turn,
        }
    )  # fmt: skip


SWEEP_SIDES = (9, 11, 13)
COHESIONS = (0.25, 1.0, 4.0)  # times the calibrated tension's k
CORRECTIONS = (0.0, 0.3, 1.0, 3.0, 10.0, 30.0)  # sigma/(rho0 d) of the calibrated nominal tension


def sweep_pairs() -> dict[str, dict[str, Any]]:
    """Sides and pairs of coefficients by the keys of their runs."""
    return {
        f"sweep_{side}_{k:g}_{c:g}": {"side": side, "cohesion": k, "correction": c}
        for side in SWEEP_SIDES
        for k in COHESIONS
        for c in CORRECTIONS
    }


def sweep(context: Context, side: int, cohesion: float, correction: float, backend: str) -> Result:
    """A small cube under one pair of k and lambda, 4 s."""
    position, spacing = scenes.start("cube", side**3)
    calibrated = scenes.cube_scene(position, spacing, viscosity=scenes.CALM)
    base = coefficients(calibrated)
    effect = Dong2016(stiffness=cohesion * base["stiffness"], correction=correction * base["correction"] / 3.0)
    changed = msgspec.structs.replace(calibrated, effects=(calibrated.effects[0], effect))
    found = drop(context, changed, np.linspace(0.0, 4.0, 41), backend)
    return Result({**found.values, "series": {}})
