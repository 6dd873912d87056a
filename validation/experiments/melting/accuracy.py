"""What accuracy costs in solids: a body that spins freely, whose angular velocity and shape nothing changes."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim import Scene, ShapeMatching, SolidBox
from validation.checks import Checks
from validation.experiment import Options, Panel, Run
from validation.results import Result
from validation.running import Context, first_call_seconds
from validation.turns import Outcome, in_turns
from validation.work_precision import REPEATS

EDGE = 0.6  # of the cube [m]
SPIN = 2 * math.pi  # [1/s] about an axis of the cube
TURNS = 2.0
STEPS = (50, 200, 800)  # of a turn
CELLS = (4, 6, 10)  # of the cube's edge
WIDTHS = (1, 2)


def spin_scene(cells: int, half_width: int, steps: int, dtype: str) -> Scene:
    """A cube that spins about z, in `steps` steps a turn."""
    d = EDGE / cells
    body = SolidBox(lower=(0.0, 0.0, 0.0), upper=(EDGE,) * 3, spin=(0.0, 0.0, SPIN))
    effects = (ShapeMatching(half_width=half_width, damping=0.0),)
    return Scene(
        spacing=d, support_radius=2.5 * d, fluid=(), solid=(body,), effects=effects, step=1.0 / steps, dtype=dtype,
    )  # fmt: skip


def angular_velocity(position: np.ndarray, velocity: np.ndarray, mass: np.ndarray) -> float:
    """omega_z = L_z/I_zz about the centre of mass [1/s]."""
    x = position - np.average(position, axis=0, weights=mass)
    v = velocity - np.average(velocity, axis=0, weights=mass)
    turning = (mass * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])).sum()
    return float(turning / (mass * (x[:, 0] ** 2 + x[:, 1] ** 2)).sum())


def spun(context: Context, setting: Mapping[str, Any], repeat: int) -> Outcome:
    """omega after TURNS turns over omega at first, and its distance from 1."""
    knobs = setting["knobs"]
    scene = spin_scene(setting["cells"], setting["half_width"], setting["steps"], knobs["dtype"])
    simulation = context.simulation(scene, knobs["backend"])
    count = round(TURNS * setting["steps"])
    began = time.perf_counter()
    for _ in range(count):
        simulation.step()
    simulation.backend.synchronize()
    spent = time.perf_counter() - began - first_call_seconds(simulation)
    position, velocity, mass = (simulation.field(name).astype(float) for name in ("position", "velocity", "mass"))
    share = angular_velocity(position, velocity, mass) / SPIN
    return Outcome(
        share, abs(share - 1), spent, count, simulation.count, launches=len(simulation.plan.launches()),
        bytes=sum(simulation.plan.field_bytes().values()),
    )  # fmt: skip


def bodies(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every setting in turn."""
    for setting in settings.values():  # compiles
        spun(context, {**setting, "steps": 4, "cells": 3}, 0)
    return in_turns(context, settings, spun, threads, repeats, backend)


def runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns."""
    settings: dict[str, dict[str, Any]] = {}

    def add(cells: int, half_width: int, steps: int, dtype: str = "float32") -> None:
        knobs = {
            "spacing": EDGE / cells, "step": 1.0 / steps, "half_width": half_width, "dtype": dtype,
            "backend": options.backend, "scheme": f"w = {half_width}",
        }  # fmt: skip
        words = f"{cells} cells, w = {half_width}, {steps} steps a turn, {dtype}"
        key = f"n{cells}_w{half_width}_s{steps}" + ("_float64" if dtype == "float64" else "")
        settings[key] = {
            "words": words, "knobs": knobs, "cells": cells, "half_width": half_width, "steps": steps,
        }  # fmt: skip

    for width in WIDTHS:
        for steps in STEPS[:2] if options.quick or width == 1 else STEPS:
            add(CELLS[1], width, steps)
        for cells in () if options.quick else (CELLS[0], CELLS[2])[:width]:
            add(cells, width, STEPS[1])
    add(CELLS[1], 2, STEPS[1], "float64")
    parameters = {
        "settings": settings, "backend": options.backend, "threads": options.threads,
        "repeats": 2 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run("bodies", bodies, parameters, estimate=60.0)]


def checks(report: Mapping[str, Any], check: Checks) -> None:
    """A setting keeps the stated error, and shorter steps keep more of the spin."""
    points = report["points"]
    middle, short = (points.get(f"n{CELLS[1]}_w2_s{steps}") for steps in STEPS[1:])
    if middle is not None and short is not None:
        check("spin_lost", short["error"])
        check("spin_lost_shorter_step", short["error"] / middle["error"])


PANELS = (
    Panel(
        name="spinning_body",
        title="Angular velocity of a cube that spins freely, two turns",
        observable="omega over its first value, distance from 1",
        reference="a free rigid body keeps it",
        stated=0.01,
        runs=runs,
        space=tuple(f"n{cells}_w2_s{STEPS[1]}" for cells in CELLS),
        space_theory=None,
        time=tuple(f"n{CELLS[1]}_w2_s{steps}" for steps in STEPS),
        time_theory=None,
        arithmetic=(f"n{CELLS[1]}_w2_s{STEPS[1]}", f"n{CELLS[1]}_w2_s{STEPS[1]}_float64"),
        tolerance="no solver iterates",
        group="half_width",
        checks=checks,
        effects=(("w = 2 for w = 1", f"n{CELLS[1]}_w1_s{STEPS[1]}", f"n{CELLS[1]}_w2_s{STEPS[1]}"),),
    ),
)
