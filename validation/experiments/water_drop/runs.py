"""A millimetre of water in SI units, its coefficients from `calibrate`: what jump and frequency say of its tension.

A program of its own beside `validation/measure/drops.py`, which measured the map in units of the drop."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Calibration, Cloud, RunStopped, Scene, Simulation, WeaklyCompressible, calibrate
from refsim.study.panels.drops import (
    BALLS,
    FLOW,
    RAYLEIGH,
    fit_oscillation,
    followed,
    lasting_amplitude,
    radius_of,
    run_to,
    shifted_ball,
)
from refsim.study.panels.virial import inner_pressure
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, Run
from validation.measure.drops import MODELS, SOFTENING
from validation.results import Result
from validation.running import Context

TENSION = 0.0728  # N/m, water in air at 20 degrees
DENSITY = 998.0  # kg/m^3; in 2D kg/m^2
RADIUS = 1e-3  # m
SUPPORT = 2.6  # spacings
CALM, THIN = 0.040, 0.004  # Pa s, while it comes to rest and while it is measured: water has 0.001
STIRS = 20  # random kicks, ever weaker, so that it does not freeze
SNAPSHOTS = 40
KICK = 0.2  # amplitude of the oscillation, in radii: that of the map, whose kicks are of the nominal tension
PERIODS, PER_PERIOD = 2.25, 24
STIRRED, RESTED, SETTLED, AVERAGED = 4.0, 2.0, 2.0, 4.0  # stages in sqrt(rho R^3/sigma), 3.7 ms


def coefficients(model: str, kernels: str, dim: int, cells: float) -> Calibration:
    """What `calibrate` gives for water."""
    return calibrate(
        TENSION, model, spacing=RADIUS / cells, rest_density=DENSITY, dim=dim, kernels=kernels, radius=RADIUS
    )


def water(found: Calibration, kernels: Any, dim: Any, cells: float, position: NDArray, velocity: NDArray,
          viscosity: float) -> Scene:  # fmt: skip
    """The scene with these coefficients, as a user writes it."""
    liquid = WeaklyCompressible(
        rest_density=DENSITY,
        sound_speed=found.sound_speed,
        dynamic_viscosity=viscosity,
        kernels=kernels,
        density="summation",
    )
    return Scene(
        name="water drop", spacing=RADIUS / cells, support_radius=SUPPORT * RADIUS / cells, dim=dim,
        fluid=(Cloud(position=position, velocity=velocity),), effects=(liquid, found.effect, *found.beside),
    )  # fmt: skip


def drop(context: Context, model: str, kernels: str, dim: int, cells: float, seed: int) -> Result:
    """Tension [N/m] of a water drop by its pressure jump and by its frequency.

    cells  radius in spacings

    laplace      P R/(dim - 1) of the total pressure, mean of the snapshots
    rayleigh     rho R^3 (omega^2 + beta^2)/k of the mode n = 2, k = 8 in 3D and 6 in 2D
    uncertainty  relative, as `calibrate` states it
    """
    found = coefficients(model, kernels, dim, cells)
    random, spacing = np.random.default_rng(seed), RADIUS / cells
    position = shifted_ball(dim, RADIUS, random, SUPPORT, spacing)
    unit = math.sqrt(DENSITY * RADIUS**3 / TENSION)
    row: dict[str, Any] = {
        "model": model, "kernels": kernels, "dim": dim, "cells": cells, "seed": seed, "stopped": "",
        "nominal": found.nominal, "uncertainty": found.uncertainty, "sound_speed": found.sound_speed,
        "asked": TENSION, "particles": len(position),
    }  # fmt: skip

    def begin(x: NDArray, v: NDArray, viscosity: float) -> Simulation:
        return context.simulation(water(found, kernels, dim, cells, x, v, viscosity), "cpu")

    try:
        calm = begin(position, np.zeros_like(position), CALM)
        for k in range(STIRS):
            kick = np.zeros_like(position)
            kick[:, :dim] = random.normal(size=(len(position), dim)) * math.sqrt(TENSION / (DENSITY * spacing) / dim)
            velocity = calm.field("velocity").astype(float) + 0.35 * (1 - k / STIRS) * (kick - kick.mean(0))
            calm.set_field("velocity", velocity)
            run_to(calm, STIRRED * unit * (k + 1) / STIRS)
        context.progress(0.3)
        run_to(calm, (STIRRED + RESTED) * unit)
        thin = begin(*_state(calm), THIN)
        run_to(thin, SETTLED * unit)
        context.progress(0.5)
        jumps, radii, times = [], [], []
        for k in range(SNAPSHOTS):
            run_to(thin, (SETTLED + AVERAGED * (k + 1) / SNAPSHOTS) * unit)
            thin.evaluate()
            jump, radius = _pressure(thin, dim)
            jumps.append(jump)
            radii.append(radius)
            times.append(thin.time)
        context.progress(0.8)
        radius, jump = float(np.mean(radii)), float(np.mean(jumps))
        row |= {"radius": radius, "jump": jump, "laplace": jump * radius / (dim - 1)}
        moments, at, fitted = _swing(begin, thin, dim, radius)
        row |= fitted
    except RunStopped as stop:
        return Result(row | {"stopped": stop.reason})
    arrays = {"jump_time": times, "jump": jumps, "moment_time": at, "moment": moments}
    return Result(row, {name: np.asarray(values, dtype=float) for name, values in arrays.items()})


def _state(simulation: Simulation) -> tuple[NDArray, NDArray]:
    x, v = (simulation.field(name).astype(float) for name in ("position", "velocity"))
    return x - x.mean(0), v - v.mean(0)


def _pressure(simulation: Simulation, dim: int) -> tuple[float, float]:
    """Total pressure [Pa] inside, virial and motion, and the radius [m] of the drop's volume."""
    x, v = _state(simulation)
    density = simulation.field("density").astype(float)[np.linalg.norm(x, axis=1) < 0.6 * RADIUS].mean()
    radius = radius_of(simulation.field("mass").astype(float).sum() / density, dim)
    return inner_pressure(simulation, BALLS * radius) + density * float((v**2).sum(1).mean()) / dim, radius


def _swing(begin: Any, rest: Simulation, dim: int, radius: float) -> tuple[NDArray, NDArray, dict[str, float]]:
    """Kick the mode n = 2, follow its second moment, and fit it."""
    expected = math.sqrt(RAYLEIGH[dim] * TENSION / (DENSITY * radius**3))
    x, v = _state(rest)
    drop = begin(x, v + KICK * expected * FLOW[dim] * x, THIN)
    marks = ((k + 1) / PER_PERIOD * 2 * math.pi / expected for k in range(round(PERIODS * PER_PERIOD)))
    at, moments = followed(drop, dim, marks)
    omega, damping, misfit, amplitude = fit_oscillation(at, moments, expected)
    small = omega / (1 - SOFTENING[dim] * min(lasting_amplitude(at, damping, amplitude), 0.6) ** 2)
    fitted = {
        "rayleigh": DENSITY * radius**3 * (small**2 + damping**2) / RAYLEIGH[dim],
        "frequency": small / (2 * math.pi), "asked_frequency": expected / (2 * math.pi), "misfit": misfit,
    }  # fmt: skip
    return moments, at, fitted


# A millimetre of water with coefficients from `calibrate`: measured against requested tension [N/m].


KERNELS = ("wendland", "mueller")
UNSEEN = (4, 5, 6)  # seeds that are not in the map
CELLS = {2: 16.0, 3: 10.0}  # radius in spacings


def planned(options: Options) -> list[Run]:
    """Three drops with each set of kernels in 3D; with --quick one in 2D."""
    if options.quick:
        return [_run("mueller", 2, UNSEEN[0])]
    return [_run(kernels, 3, seed) for kernels in KERNELS for seed in UNSEEN]


def _run(kernels: str, dim: int, seed: int) -> Run:
    given: dict[str, Any] = {"model": "akinci", "kernels": kernels, "dim": dim, "cells": CELLS[dim], "seed": seed}
    return Run(f"{kernels}_{dim}d_{seed}", drop, given, estimate=6.0 if dim == 2 else 30.0)


def checks(results: Results, check: Checks) -> None:
    """Both tensions against the requested one, against each other, and against the uncertainty of `calibrate`."""
    for key, result in results.items():
        row = result.values
        if row["stopped"]:
            continue
        words = f"{MODELS[row['model']][0]}, {row['kernels']}, {row['dim']}D, seed {row['seed']}"
        for name in ("laplace", "rayleigh"):
            share = abs(row[name] / row["asked"] - 1)
            bound = "requested" if row["dim"] == 3 else "requested_2d"
            for kind, value in (("tension", row[name]), (bound, share), ("deviations", share / row["uncertainty"])):
                check(kind, value, f"{key}.{name}", f"{words}, {name.capitalize()}")
        both = row["laplace"] + row["rayleigh"]
        check("apart", 2 * abs(row["laplace"] - row["rayleigh"]) / both, key, words)
        check("misfit", row["misfit"], key, words)


EXPERIMENT = Experiment(
    name="water_drop",
    title="a millimetre of water, coefficients from calibrate(0.0728 N/m): jump and frequency against the request",
    runs=planned,
    checks=checks,
)
