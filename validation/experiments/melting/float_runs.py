"""What the accuracy panel of two-way coupling measures: how deep a box floats, against wall time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import (
    Box,
    BoxWalls,
    Gravity,
    RunStopped,
    Scene,
    ShapeMatching,
    SolidBox,
    TwoWayCoupling,
    WeaklyCompressible,
)
from validation.results import Result
from validation.running import Context, advance
from validation.turns import Outcome, in_turns

EDGE, BASIN, DEPTH = 0.8, 1.6, 0.8  # of the box, of the basin's square floor, of the water before [m]
SHARE = 0.5  # density of the box over that of water: however it turns, its centre floats at the water's level
SOUND, STEP, VISCOSITY = 40.0, 0.02, 250.0  # m/s; step over spacing [s/m]; dynamic viscosity over spacing [Pa s/m]
SETTLED, SAMPLES = 2.5, 40  # s until the mean, samples in 1 s


def scene(cells: int, half_width: int, dtype: str, step: float) -> Scene:
    """A box of `cells` lattice cells along an edge that sinks into a basin."""
    d = EDGE / cells
    low = 0.5 * (BASIN - EDGE)
    body = SolidBox(
        lower=(low, low, DEPTH + 1.2 * d), upper=(low + EDGE, low + EDGE, DEPTH + 1.2 * d + EDGE),
        density=1000.0 * SHARE,
    )  # fmt: skip
    wide, high = round(BASIN / d), round(DEPTH / d)
    effects = (
        WeaklyCompressible(
            sound_speed=SOUND, dynamic_viscosity=VISCOSITY * d, state="tait", kernels="cubic_spline"
        ),
        ShapeMatching(half_width=half_width), TwoWayCoupling(), Gravity(),
        BoxWalls(lower=(0.0, 0.0, 0.0), upper=(BASIN, BASIN, 4 * DEPTH)),
    )  # fmt: skip
    return Scene(
        spacing=d, support_radius=2.5 * d, fluid=(Box(cells=(wide, wide, high)),), solid=(body,), effects=effects,
        step=step * STEP * d, dtype=dtype,  # type: ignore[arg-type]
    )  # fmt: skip


def level(place: NDArray, spacing: float) -> float:
    """Height [m] of the water's surface: half a spacing over the highest particles of columns a spacing wide."""
    column = np.unique((place[:, :2] // spacing).astype(int), axis=0, return_inverse=True)[1].ravel()
    highest = np.full(column.max() + 1, -np.inf)
    np.maximum.at(highest, column, place[:, 2])
    return float(np.median(highest) + 0.5 * spacing)


def floated(context: Context, setting: Mapping[str, Any], repeat: int, share: float = 1.0) -> Outcome:
    """Height of the box's centre over the water's level, over its edge, in the mean of the last second."""
    knobs = setting["knobs"]
    made = scene(setting["cells"], setting["half_width"], knobs["dtype"], knobs["step"])
    simulation = context.simulation(made, knobs["backend"])
    heights = []

    def sample(simulation: Any, wall: float) -> None:
        place, count = simulation.field("position").astype(float), setting["cells"] ** 3  # the solid's come first
        water = place[count:]
        beside = np.abs(water[:, :2] - 0.5 * BASIN).max(1) > 0.4 * BASIN
        heights.append(float(place[:count, 2].mean()) - level(water[beside], made.spacing))

    try:
        wall = advance(
            simulation,
            [share * (SETTLED + k / SAMPLES) for k in range(SAMPLES + 1)],
            sample,
            replace(context, progress=lambda done: None),
        )
    except RunStopped as stop:
        return Outcome(0.0, 0.0, 0.0, simulation.steps, simulation.count, stopped=stop.reason)
    value = float(np.mean(heights)) / EDGE
    return Outcome(
        value, abs(value), wall, simulation.steps, simulation.count, launches=len(simulation.plan.launches()),
        bytes=sum(simulation.plan.field_bytes().values()),
    )  # fmt: skip


def boxes(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every setting in turn."""
    for setting in settings.values():  # compiles
        floated(context, {**setting, "cells": 4}, 0, share=0.01)
    return in_turns(context, settings, floated, threads, repeats, backend)
