"""What the accuracy panel of implicit pressure measures: the pressure of a tank at rest in the plane, implicit and
weakly compressible, against wall time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import BoxWalls, Cloud, Gravity, ImplicitPressure, Scene, WeaklyCompressible
from validation.experiments.solutions import scene
from validation.panel_runs.tank import at_rest
from validation.running import Context
from validation.turns import Outcome, panel

DENSITY, GRAVITY, SUPPORT = 1000.0, 9.81, 2.6  # kg/m^2, m/s^2, h/d
HEIGHT, WIDTH = 1.0, 1.0  # of the liquid [m]
SOUND = 10 * math.sqrt(GRAVITY * HEIGHT)  # m/s
SHARE = 0.02  # kinematic viscosity over c h: calms the start within SETTLED
STEP = 0.04  # of implicit pressure [s], times d/m: a particle falls by 1/60 d in the first one at d = 0.1 m
SETTLED, SAMPLES = 4.0, 60  # fall times sqrt(H/g) until the mean, and samples in one


def tank(cells: int, dtype: str, tolerance: float, step: float) -> Scene:
    """Liquid in hydrostatic balance between walls, `cells` particles high.

    tolerance  of implicit pressure; 0 for weakly compressible liquid
    step       over the stable one, or over STEP d
    """
    d = HEIGHT / cells
    x, y = np.meshgrid((np.arange(round(WIDTH / d)) + 0.5) * d, (np.arange(cells) + 0.5) * d, indexing="ij")
    place = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    if not tolerance:
        place[:, 1], _ = scene.compressed(place[:, 1], HEIGHT, GRAVITY, SOUND)
    liquid = WeaklyCompressible(
        rest_density=DENSITY,
        sound_speed=SOUND,
        dynamic_viscosity=DENSITY * SHARE * SOUND * SUPPORT * d,
        density="summation",
    )
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(WIDTH, 2 * HEIGHT, 0.0), open_faces=("+y",))
    solver = (ImplicitPressure(tolerance=tolerance),) if tolerance else ()
    return Scene(
        dim=2, spacing=d, support_radius=SUPPORT * d, dtype=dtype,  # type: ignore[arg-type]
        step=step * STEP * d if tolerance else 0.0, step_factor=1.0 if tolerance else step,
        fluid=(Cloud(position=place),),
        effects=(liquid, *solver, Gravity(acceleration=(0.0, -GRAVITY, 0.0)), walls),
    )  # fmt: skip


def rested(context: Context, setting: Mapping[str, Any], repeat: int, share: float = 1.0) -> Outcome:
    """Root mean square of p - rho0 g (H - y) over rho0 g H, of pressures in the mean of the last samples.

    Farther than h from walls and surface: next to a wall the implicit pressure is two to three times as large, because
    its walls act with p_i alone.
    """
    knobs = setting["knobs"]
    made = tank(setting["cells"], knobs["dtype"], setting["tolerance"], knobs["step"])
    unit, reach = share * math.sqrt(HEIGHT / GRAVITY), SUPPORT * HEIGHT / setting["cells"]

    def off(place: NDArray, pressure: NDArray) -> NDArray:
        x, y = place[:, :2].T
        bulk = (np.minimum(x, WIDTH - x) > reach) & (np.minimum(y, HEIGHT - y) > reach)
        return (pressure / (DENSITY * GRAVITY * HEIGHT) - (HEIGHT - y) / HEIGHT)[bulk]

    times = [unit * (SETTLED + k / SAMPLES) for k in range(SAMPLES + 1)]
    simulation = context.simulation(made, knobs["backend"])
    return at_rest(context, simulation, times, off, evaluate=not setting["tolerance"])


tanks = panel(rested, lambda context, setting: rested(context, {**setting, "cells": 10}, 0, share=0.01))
