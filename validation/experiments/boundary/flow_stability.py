"""Hard cases of liquid at meshes."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from refsim import Box, Cloud, Gravity, MeshBoundary, Scene, WeaklyCompressible
from refsim.core.walls import WallParticles
from refsim.scene.scene import make_plan
from validation.experiments.boundary.flow_shapes import SHAPES, SPACING, mesh_file
from validation.results import Result
from validation.running import Context
from validation.trials import HardCase, Trial

STEP, SOUND = 2e-4, 20.0  # [s], [m/s]
LIQUID = WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=0.5)


def shots(
    context: Context, backend: str, shape: str, spacings: float, shift: float = 0.0, begin: float = 0.045,
    steps: int = 60,     thin: float = 1.0, **changes: Any,
) -> Result:  # fmt: skip
    """Lone particles that fly down on a solid at `spacings` a step from `begin` [m] over its middle; none gets in."""
    trial = Trial(context, backend)
    made = SHAPES[shape]()
    made.apply_scale((1, 1, thin))
    x, y = np.meshgrid(np.arange(-3, 4), np.arange(-3, 4))
    at = np.stack([0.012 * x.ravel(), 0.012 * y.ravel(), np.full(x.size, begin)], axis=1)
    at[:, 2] += 0.1 * SPACING * np.arange(x.size) % SPACING
    fluid = Cloud(position=at + [0, 0, shift], velocity=(0.0, 0.0, -spacings * SPACING / STEP))
    with mesh_file(made) as file, trial.ending():
        boundary = MeshBoundary(**{"file": file, "center": (0.0, 0.0, shift), "field_spacing": 0.0025, **changes})
        scene = Scene(
            spacing=SPACING, support_radius=1.1 * SPACING, fluid=(fluid,), effects=(LIQUID, boundary), step=STEP
        )
        simulation = trial.start(scene)
        solid = boundary.placed(simulation.plan.grid)

        def watch(simulation: Any) -> None:
            depth = -solid.distance(simulation.field("position").astype(float)).min() / SPACING
            trial.check("greatest depth [d]", depth, at_most=0.2 if shift else 0.02)

        trial.advance(simulation, steps=steps, watch=watch)
        trial.check("corrections", simulation.field("corrections").sum(), at_least=1)
        if shape == "plate":
            over = np.abs(at[:, :2]).max(1) < 0.05
            lowest = float((simulation.field("position")[over, 2] - shift).min())
            trial.check("height over the plate's middle [m]", lowest, at_least=-0.003)
    return trial.result()


def coincident(context: Context, backend: str) -> Result:
    """Every boundary particle stands there twice, with half the volume each: liquid falls on them as on one."""
    trial = Trial(context, backend)
    with mesh_file(SHAPES["plate"]()) as file, trial.ending():
        block = Box(lower=(-0.03, -0.03, 0.013), cells=(6, 6, 4))
        effects = (LIQUID, Gravity(), MeshBoundary(file=file))
        plan = make_plan(Scene(spacing=SPACING, support_radius=2.7 * SPACING, fluid=(block,), effects=effects))
        twice = WallParticles(np.repeat(plan.walls.position, 2, axis=0), 0.5 * np.repeat(plan.walls.volume, 2))
        places = []
        for walls in (plan.walls, twice):
            simulation = trial.start(dataclasses.replace(plan, walls=walls))
            trial.advance(simulation, steps=40)
            places.append(simulation.field("position"))
        trial.check("difference [d]", np.abs(places[0] - places[1]).max() / SPACING, at_most=1e-3)
    return trial.result()


def hard_cases() -> tuple[HardCase, ...]:
    """Those of liquid at meshes."""

    def shot(name: str, hard: str, holds: str, **parameters: Any) -> HardCase:
        return HardCase(name, hard, holds, shots, parameters, seconds=5.0)

    return (
        shot("flow_thin_plate", "a plate half a spacing thick, particles at 3 spacings a step", "no particle passes",
             shape="plate", spacings=3.0, thin=0.5),
        shot("flow_needle_edges", "a needle's point and edges, 2 spacings a step", "no particle is inside",
             shape="needle", spacings=2.0, begin=0.1),
        shot("flow_starts_outside", "paths that begin half a metre outside the grid", "no particle is inside",
             shape="sphere", spacings=3.0, begin=0.5),
        shot("flow_far_away", "a mesh 1e4 m from the origin in float32", "no particle passes the plate",
             shape="plate", spacings=3.0, shift=1e4),
        shot("flow_too_small", "a mesh smaller than the spacing", "refused in one sentence",
             shape="sphere", spacings=2.0, size=0.004),
        HardCase("flow_coincident", "every boundary particle twice at its place", "liquid moves as on one",
                 coincident, seconds=8.0),
    )  # fmt: skip
