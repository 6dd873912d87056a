"""Up to which tension small drops keep their density: `python -m validation measure drop_density` prints it.

Balls and cubes of six to eight cells without gravity, d = 1, rho0 = 1, nominal tension 1, and so S = sigma/(rho0 c^2 d)
= 1/c^2. A term without a tension of its own has the coefficient 1 m/s^2, S = gamma d/c^2. Each drop runs for 3
sqrt(rho0 R^3/sigma) with the viscosity 0.3 sqrt(rho0 sigma R), and is judged over the last two fifths.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from refsim import (
    Akinci2013,
    Ball,
    Box,
    He2014,
    NormalDifference2014,
    RunStopped,
    Scene,
    Simulation,
    WeaklyCompressible,
    make_plan,
)
from refsim.surface_tension.calibration import BESIDE, SETTINGS
from validation.measure.drops import CALM, RELAXED

STIFFNESSES = (0.003, 0.01, 0.02, 0.03, 0.1, 0.3)
JUDGED_FROM, CORE, DENSE = 0.6, 0.25, 1.1  # share of the time; share of the particles, nearest to the middle; of rho0
FEW = 20_000  # steps after which a drop is given up


class Drop(NamedTuple):
    """A start: cells along an edge or diameter, support radius [d]."""

    shape: str
    cells: int
    dim: int = 3
    kernels: str = "mueller"
    support: float = 2.6


DROPS = (
    Drop("ball", 6), Drop("ball", 8), Drop("box", 6), Drop("box", 8), Drop("box", 6, kernels="wendland"),
    Drop("ball", 7, support=2.0), Drop("ball", 7, kernels="wendland", support=3.0),
    Drop("ball", 8, dim=2), Drop("ball", 8, dim=2, kernels="wendland"),
)  # fmt: skip
Made = Callable[[Drop], tuple]


def air(drop: Drop) -> tuple:
    """He's air pressure alone, with a nominal tension of 1."""
    plan = make_plan(scene(drop, 0.01, (He2014(air_pressure=1.0),)))
    effect = plan.effects["he_2014"]
    return (He2014(air_pressure=1 / effect.nominal_tension(plan.grid, plan.effects)),)  # type: ignore[attr-defined]


def of_map(name: str) -> Made:
    """A model at the settings of the sigma map."""
    return lambda drop: (SETTINGS[name][1](1.0), *BESIDE.get(name, ()))


TENSIONS: dict[str, Made] = {name: of_map(name) for name in SETTINGS if name not in BESIDE} | {
    "he_air_pressure": air,
    "normal_difference": lambda drop: (NormalDifference2014(area_acceleration=1.0),),
    "akinci_area": lambda drop: (Akinci2013(surface_tension=0.0, area_acceleration=1.0),),
}


def scene(drop: Drop, stiffness: float, effects: tuple) -> Scene:
    """The drop at rest."""
    size, radius = (drop.cells,) * drop.dim, 0.5 * drop.cells
    part = Ball(radius=radius) if drop.shape == "ball" else Box(cells=(*size, 1)[:3])  # type: ignore[arg-type]
    liquid = WeaklyCompressible(
        rest_density=1.0, sound_speed=1 / math.sqrt(stiffness), dynamic_viscosity=CALM * math.sqrt(radius),
        kernels=drop.kernels, density="summation",  # type: ignore[arg-type]
    )  # fmt: skip
    return Scene(
        dim=drop.dim, spacing=1.0, support_radius=drop.support, fluid=(part,), effects=(liquid, *effects)  # type: ignore[arg-type]
    )  # fmt: skip


def measure(drop: Drop, stiffness: float, effects: tuple) -> tuple[float, float]:
    """(mean density of the core/rho0 - 1, share of the particles above 1.1 rho0); infinite for a run that stopped."""
    run = Simulation(scene(drop, stiffness, effects), threads=1)
    until, core, dense = RELAXED * (0.5 * drop.cells) ** 1.5, [], []
    try:
        while run.time < until and run.steps < FEW:
            run.step()
            if run.time > JUDGED_FROM * until and run.steps % 10 == 0:
                density, x = run.field("density").astype(float), run.field("position").astype(float)
                near = np.argsort(np.linalg.norm(x - x.mean(0), axis=1))[: math.ceil(CORE * len(x))]
                core.append(density[near].mean() - 1)
                dense.append((density > DENSE).mean())
    except RunStopped:
        return math.inf, math.inf
    return (float(np.mean(core)), float(np.mean(dense))) if core else (math.inf, math.inf)


def row(name: str) -> list[str]:
    """For each S: greatest deviation of the core's density over all drops, greatest share above 1.1 rho0, stops."""
    cells = []
    for stiffness in STIFFNESSES:
        found = [measure(drop, stiffness, TENSIONS[name](drop)) for drop in DROPS]
        ended = [each for each in found if math.isfinite(each[0])]
        words = [f"{len(found) - len(ended)} of {len(found)} stop"] if len(ended) < len(found) else []
        if ended:
            words.insert(0, f"{100 * max((off for off, _ in ended), key=abs):+.1f} %")
            words.insert(1, f"{100 * max(share for _, share in ended):.1f} %")
        cells.append(", ".join(words))
    return cells
