"""What the accuracy panel of a tank measures: the pressure of liquid at rest in a cup that is a mesh, against wall
time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from refsim import Cloud, Gravity, MeshBoundary, RunStopped, Scene, WeaklyCompressible
from validation.experiments.boundary.scene import cup, mesh_file
from validation.experiments.solutions import scene as solution
from validation.results import Result
from validation.running import Context, advance
from validation.turns import Outcome, in_turns

DENSITY, GRAVITY = 1000.0, 9.81  # kg/m^3, m/s^2
HEIGHT = 0.1  # of the liquid, and edge of the tank [m]
SUPPORT = 3.0  # h/d, where sums over the lattice deliver 99.7 % of a pressure gradient
SOUND = 10 * math.sqrt(2 * GRAVITY * HEIGHT)  # m/s
SHARE = 0.02  # kinematic viscosity over c h: calms the start within SETTLED
SETTLED, SAMPLES = 2.5, 40  # fall times sqrt(H/g) until the mean, and samples in a half of one


def scene(file: str, cells: int, dtype: str, literal: tuple[str, ...] = ()) -> tuple[Scene, float]:
    """(liquid in hydrostatic balance in a cup, `cells` particles along an edge; its level [m])."""
    d = HEIGHT / cells
    axis = (np.arange(cells) + 0.5) * d
    place = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    # boundary particles stand for a layer a spacing thick, half of it outside: the liquid begins there
    place[:, 2], top = solution.compressed(place[:, 2], HEIGHT, GRAVITY, SOUND)
    liquid = WeaklyCompressible(
        rest_density=DENSITY, sound_speed=SOUND, dynamic_viscosity=DENSITY * SHARE * SOUND * SUPPORT * d
    )
    effects = (liquid, Gravity(), MeshBoundary(file=file, literal=literal))
    return Scene(
        spacing=d, support_radius=SUPPORT * d, dtype=dtype, effects=effects,  # type: ignore[arg-type]
        fluid=(Cloud(position=place + 0.5 * d),),
    ), top + 0.5 * d  # fmt: skip


def rested(context: Context, setting: Mapping[str, Any], repeat: int, share: float = 1.0) -> Outcome:
    """Root mean square of p - p_exact over rho0 g H, of pressures in the mean of the last samples."""
    cells, knobs = setting["cells"], setting["knobs"]
    inner = (HEIGHT + HEIGHT / cells,) * 2
    with mesh_file(cup((*inner, 1.5 * HEIGHT), 0.5 * HEIGHT)) as file:
        made, top = scene(file, cells, knobs["dtype"], setting.get("literal", ()))
        simulation = context.simulation(made, knobs["backend"])
    heights, pressures = [], []

    def sample(simulation: Any, wall: float) -> None:
        simulation.evaluate()
        heights.append(simulation.field("position")[:, 2].astype(float))
        pressures.append(simulation.field("pressure").astype(float))

    unit = math.sqrt(HEIGHT / GRAVITY)
    times = [share * unit * (SETTLED + 0.5 * k / SAMPLES) for k in range(SAMPLES + 1)]
    try:
        wall = advance(simulation, times, sample, replace(context, progress=lambda done: None))
    except RunStopped as stop:
        return Outcome(0.0, 0.0, 0.0, simulation.steps, simulation.count, stopped=stop.reason)
    height, pressure = np.mean(heights, axis=0), np.mean(pressures, axis=0)
    known = solution.hydrostatic(height, top, DENSITY, GRAVITY, SOUND)
    off = (pressure - known) / (DENSITY * GRAVITY * HEIGHT)
    error = float(np.sqrt((off**2).mean()))
    return Outcome(
        error, error, wall, simulation.steps, simulation.count, launches=len(simulation.plan.launches()),
        bytes=sum(simulation.plan.field_bytes().values()),
    )  # fmt: skip


def tanks(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every setting in turn."""
    for setting in settings.values():  # compiles
        rested(context, {**setting, "cells": 5}, 0, share=0.01)
    return in_turns(context, settings, rested, threads, repeats, backend)
