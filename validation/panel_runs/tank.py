"""What the accuracy panel of a tank measures: the pressure of liquid at rest in a cup that is a mesh, against wall
time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Cloud, Gravity, MeshBoundary, RunStopped, Scene, Simulation, WeaklyCompressible
from validation.experiments.boundary.scene import cup, mesh_file
from validation.experiments.solutions import scene as solution
from validation.running import Context, advance
from validation.turns import Outcome, panel, stepped

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
        rest_density=DENSITY,
        sound_speed=SOUND,
        dynamic_viscosity=DENSITY * SHARE * SOUND * SUPPORT * d,
        density="summation",
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
    unit = share * math.sqrt(HEIGHT / GRAVITY)

    def off(place: NDArray, pressure: NDArray) -> NDArray:
        return (pressure - solution.hydrostatic(place[:, 2], top, DENSITY, GRAVITY, SOUND)) / (
            DENSITY * GRAVITY * HEIGHT
        )

    return at_rest(context, simulation, [unit * (SETTLED + 0.5 * k / SAMPLES) for k in range(SAMPLES + 1)], off)


def at_rest(
    context: Context, simulation: Simulation, times: Sequence[float], off: Callable[[NDArray, NDArray], NDArray],
    evaluate: bool = True,
) -> Outcome:  # fmt: skip
    """Root mean square of `off(places, pressures)`, both in the mean of samples at the `times` [s].

    evaluate  whether pressures are computed anew at the places of a sample
    """
    places, pressures = [], []

    def sample(simulation: Simulation, wall: float) -> None:
        if evaluate:
            simulation.evaluate()
        places.append(simulation.field("position").astype(float))
        pressures.append(simulation.field("pressure").astype(float))

    try:
        wall = advance(simulation, times, sample, replace(context, progress=lambda done: None))
    except RunStopped as stop:
        return stepped(simulation, math.nan, 0.0, stop.reason)
    errors = off(np.mean(places, axis=0), np.mean(pressures, axis=0))
    return stepped(simulation, float(np.sqrt((errors**2).mean())), wall)


tanks = panel(rested, lambda context, setting: rested(context, {**setting, "cells": 5}, 0, share=0.01))
