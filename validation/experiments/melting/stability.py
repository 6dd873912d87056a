"""Hard cases of solids, of what holds them together, of their coupling and of melting."""

from __future__ import annotations

from typing import Any

import numpy as np

from refsim import (
    Box,
    BoxWalls,
    Gravity,
    HeatConduction,
    Melting,
    Scene,
    ShapeMatching,
    Simulation,
    SolidBox,
    SolidCells,
    TwoWayCoupling,
    WeaklyCompressible,
)
from refsim.shape_matching.phases import FLUID, SURFACE
from validation.experiments.melting.scene import SOUND, SPACING, SUPPORT, VISCOSITY
from validation.results import Result
from validation.running import Context
from validation.trials import Trial

CUBE = SolidBox(lower=(0.4, 0.4, 0.8), upper=(1.4, 1.4, 1.8))
FASTEST = SOUND  # [m/s]: above it the liquid's equation of state means nothing


def pool(
    solid: tuple[Any, ...] = (CUBE,), temperature: Any = (-10.0, 40.0), conductivity: float = 0.3,
    bookkeeping: Any = "immiscible", **more: Any,
) -> Scene:  # fmt: skip
    """Bodies over a basin of 9 x 9 x 4 particles; K in m^2/s."""
    effects = (
        WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=VISCOSITY, state="tait", kernels="cubic_spline"),
        Gravity(),
        BoxWalls(lower=(0, 0, 0), upper=(1.8, 1.8, 3.0)),
        ShapeMatching(),
        TwoWayCoupling(),
        HeatConduction(
            temperature=temperature, conductivity=conductivity, melting_point=0.0, mean="arithmetic", literal=("M11",)
        ),
        Melting(bookkeeping=bookkeeping),
    )
    options = {"spacing": SPACING, "support_radius": SUPPORT, "step": 0.004} | more
    return Scene(fluid=(Box(cells=(9, 9, 4)),), solid=solid, effects=effects, **options)


def _watched(trial: Trial, simulation: Simulation, steps: int) -> list[int]:
    """Step, and check that what melts lay at a surface and that speeds stay bounded; how many melted in each step."""
    phase, gone, speed = simulation.field("phase"), [], 0.0
    for _ in range(steps):
        simulation.step()
        now = simulation.field("phase")
        melted = (phase != FLUID) & (now == FLUID)
        trial.check("melted from inside", int((phase[melted] != SURFACE).sum()), equals=0)
        gone.append(int(melted.sum()))
        phase = now
        speed = max(speed, float(np.linalg.norm(simulation.field("velocity").astype(float), axis=1).max()))
    trial.check("greatest speed [m/s]", speed, at_most=FASTEST)
    trial.account(simulation)
    return gone


def all_or_nothing(context: Context, backend: str, temperature: float, layers: list[int]) -> Result:
    """A cube that is as warm everywhere, and no conduction: whole layers melt, one a step, or nothing does."""
    trial = Trial(context, backend)
    with trial.ending():
        simulation = trial.start(pool(temperature=temperature, conductivity=0.0))
        gone = _watched(trial, simulation, 60)
        for k, wanted in enumerate(layers):
            trial.check(f"melted in step {k + 1}", gone[k], equals=wanted)
        trial.check("melted in all", sum(gone), equals=sum(layers))
    return trial.result()


def melting_body(
    context: Context, backend: str, body: str, density: float = 917.0, bookkeeping: str = "immiscible",
    steps: int = 300,
) -> Result:  # fmt: skip
    """A body of BODIES falls into warm water and melts."""
    trial = Trial(context, backend)
    with trial.ending():
        cells = BODIES[body]
        simulation = trial.start(pool((SolidCells(cells=cells, density=density),), (-10.0, 60.0), 0.5, bookkeeping))
        gone = _watched(trial, simulation, steps)
        trial.check("particles left solid", len(cells) - sum(gone), at_most=0.9 * len(cells))
        ratio = float((simulation.field("density") / simulation.field("rest_density")).max())
        trial.check("greatest density over rest density", ratio, at_most=1.6)
        mass, rho = simulation.field("mass").astype(float), simulation.field("rest_density").astype(float)
        trial.show("rest volume", float((mass / rho).sum()))
    return trial.result()


def refused_bookkeeping(context: Context, backend: str) -> Result:
    """To keep the mass of the melt and switch its rest density is refused."""
    trial = Trial(context, backend)
    with trial.ending():
        trial.start(pool(bookkeeping="keep_mass"))
    trial.check("the sentence says why", "Tait" in trial.message, equals=1)
    return trial.result()


DEFORMATIONS = {
    "inverted": np.diag([1.0, 1.0, -1.0]), "coplanar": np.diag([1.0, 1.0, 0.0]), "collinear": np.diag([1.0, 0.0, 0.0]),
    "point": np.zeros((3, 3)), "flipped": np.diag([1.0, -1.0, -1.0]),
}  # fmt: skip


def mapped(context: Context, backend: str, kind: str, dtype: str = "float32") -> Result:
    """A free cube whose particles are mapped through its middle, and let go: it comes back to its shape."""
    trial = Trial(context, backend)
    with trial.ending():
        body = SolidBox(lower=(0, 0, 0), upper=(1.0, 1.0, 1.0))
        scene = Scene(
            spacing=SPACING, support_radius=SUPPORT, fluid=(), solid=(body,), step=0.005, dtype=dtype,
            effects=(ShapeMatching(half_width=1),),
        )  # fmt: skip
        simulation = trial.start(scene)
        x = simulation.field("position").astype(float)
        rest = np.linalg.norm(x[:, None] - x[None], axis=2)
        there = (x - x.mean(0)) @ DEFORMATIONS[kind].T + x.mean(0)
        simulation.backend.assign(simulation.fields["position"], there.astype(dtype))
        trial.advance(simulation, steps=800)
        now = simulation.field("position").astype(float)
        speed = float(np.linalg.norm(simulation.field("velocity").astype(float), axis=1).max())
        change = float(np.abs(np.linalg.norm(now[:, None] - now[None], axis=2) - rest).max()) / SPACING
        drift = float(np.abs(now.mean(0) - x.mean(0)).max()) / SPACING
        trial.check("greatest speed at the end [m/s]", speed, at_most=5.0)
        trial.check("drift of the center of mass [d]", drift, at_most=1e-3)
        trial.check("change of a distance [d]", change, at_most=0.01)
    return trial.result()


def one_voxel_apart(context: Context, backend: str, gap: int) -> Result:
    """Two boxes whose cells touch (gap 0) or are one cell apart melt in warm water; their tables never mix."""
    trial = Trial(context, backend)
    with trial.ending():
        left = [[a, b, e] for a in range(1, 4) for b in range(3, 6) for e in range(5, 8)]
        right = [[a + 3 + gap, b, e] for a, b, e in left]
        simulation = trial.start(
            pool((SolidCells(cells=left), SolidCells(cells=right, density=500.0)), (-10.0, -10.0, 60.0), 0.5)
        )
        _watched(trial, simulation, 150)
        region = simulation.field("region")
        owner = np.repeat([0, 1], [len(left), len(right)])
        row, slot = np.nonzero(region >= 0)
        trial.check("members of the other body", int((owner[region[row, slot]] != owner[row]).sum()), equals=0)
    return trial.result()


def _box(low: tuple[int, int, int], edges: tuple[int, int, int]) -> list[list[int]]:
    return (np.stack(np.meshgrid(*map(np.arange, edges), indexing="ij"), -1).reshape(-1, 3) + low).tolist()


BODIES = {
    "plate": _box((1, 1, 6), (7, 7, 1)), "chain": _box((1, 4, 6), (7, 1, 1)), "single": [[4, 4, 6]],
    "bridge": [*_box((1, 3, 6), (2, 3, 3)), *_box((3, 4, 7), (3, 1, 1)), *_box((6, 3, 6), (2, 3, 3))],
    "cube": _box((2, 2, 5), (5, 5, 5)),
}  # fmt: skip
