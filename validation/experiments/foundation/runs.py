"""Hard cases of weakly compressible liquid between walls, its largest stable step and lowest viscosity."""

import dataclasses
import math
from typing import Any

import msgspec
import numpy as np

from refsim import Ball, Box, BoxWalls, Gravity, Scene, Simulation, WeaklyCompressible
from refsim.boundary.akinci_2012 import calibrated_factor, wall_kernel_sums
from refsim.core.walls import WallParticles
from refsim.scene.plan import Plan, make_plan
from validation.experiment import Experiment
from validation.metrics.droplet import nearest_neighbour_distance
from validation.results import Result
from validation.running import Context, EnergyWatch, momenta
from validation.trials import Cell, Trial, at_step, hard_case, largest_stable, silent_up_to

SPACING, SUPPORT = 0.01, 0.026  # [m]
SOUND, STABILITY_DENSITY = 20.0, 1000.0  # [m/s], [kg/m^3]
GRAVITY = 9.81
MACH, SIDE = 0.3, 10  # of the impacts; particles along the cube


def liquid(
    fluid: Any, *effects: Any, viscosity: float = 0.5, kernels: str = "wendland", state: str = "tait", **changes: Any
) -> Scene:
    """Water-like liquid of the given parts, without gravity and tension unless `effects` bring them."""
    parts = fluid if isinstance(fluid, tuple) else (fluid,)
    effect = WeaklyCompressible(
        rest_density=STABILITY_DENSITY, sound_speed=SOUND, dynamic_viscosity=viscosity, kernels=kernels, state=state,
        density="summation",
    )  # fmt: skip
    return Scene(spacing=SPACING, support_radius=SUPPORT, fluid=parts, effects=(effect, *effects), **changes)


def tank(columns: int = 16, **changes: Any) -> Scene:
    """A column of columns x 2 columns particles in 2D that collapses in a tank four times as long.

    Its numerical viscosity stands to the spacing as in the dam break.
    """
    size = columns * SPACING
    changes = {"viscosity": 320.0 * SPACING, **changes}
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(4 * size, 4 * size, 0.0))
    return liquid(
        Box(cells=(columns, 2 * columns, 1)), Gravity(acceleration=(0.0, -GRAVITY, 0.0)), walls, dim=2, **changes
    )


@hard_case
def collapse(trial: Trial, factor: float = 0.0, viscosity: float = 320.0 * SPACING, columns: int = 16) -> None:
    """A collapsing column with a fixed step of `factor` times the first stable one; 0: the runner's own steps."""
    scene = tank(columns, viscosity=viscosity)
    step = factor * trial.start(scene).step().length if factor else 0.0
    simulation = trial.start(msgspec.structs.replace(scene, step=step))
    height = 2 * columns * SPACING
    energy, potential = EnergyWatch(simulation), GRAVITY * 0.5 * height
    trial.advance(simulation, until=4 * math.sqrt(height / GRAVITY), watch=energy, every=4)
    share = energy.rise / (STABILITY_DENSITY * 2 * (columns * SPACING) ** 2 * potential)
    trial.check_unless_noted(
        simulation, "viscosity", "rise of kinetic + potential energy over the start's", share, at_most=0.01
    )
    trial.check("particles outside the tank", _outside(simulation), equals=0)
    trial.show("stopped at walls", simulation.stopped_at_walls)


def closed_box(columns: int = 16, mach: float = 0.075, **changes: Any) -> Scene:
    """A block that fills half of a closed 2D box and moves towards its other half, without gravity."""
    size = 2 * columns * SPACING
    block = Box(cells=(columns, 2 * columns, 1), velocity=(mach * SOUND, 0.0, 0.0))
    return liquid(block, BoxWalls(lower=(0.0, 0.0, 0.0), upper=(size, size, 0.0)), dim=2, **changes)


@hard_case
def thrown_about(trial: Trial, until: float = 1.0) -> None:
    """A block between the walls of a closed box: no gravity, no viscosity, nothing that could bring energy."""
    simulation = trial.start(closed_box(viscosity=0.0))
    energy = [_kinetic(simulation)]
    trial.advance(simulation, until=until, watch=lambda simulation: energy.append(_kinetic(simulation)), every=4)
    share = max(energy) / energy[0]
    trial.check_unless_noted(simulation, "viscosity", "kinetic energy over the start's", share, at_most=1.01)
    trial.check("particles outside the box", _outside(simulation), equals=0)


@hard_case
def impact(trial: Trial, what: str, mach: float = MACH) -> None:
    """A cube hits a wall, or two cubes hit each other, at 0.3 of the sound speed."""
    n, speed = SIDE, mach * SOUND
    size = n * SPACING
    above = Box(lower=(0.3 * SPACING, 0.2 * SPACING, size + SPACING), cells=(n, n, n), velocity=(0, 0, -speed))
    both = (Box(cells=(n, n, n), velocity=(0.0, 0.0, speed)), above)
    simulation = trial.start(_against_wall(speed) if what == "wall" else liquid(both, viscosity=1.0))
    before = momenta(simulation)
    peak: list[float] = []

    watch = lambda simulation: peak.append(_kinetic(simulation))  # noqa: E731
    trial.advance(simulation, until=3 * size / speed, watch=watch, every=4)
    trial.check("kinetic energy over the start's", max(peak) / before["kinetic_energy"], at_most=1.01)
    trial.check("greatest speed over the impact's", _speed(simulation) / speed, at_most=3.0)
    trial.check("least distance [d]", float(_nearest(simulation).min()) / SPACING, at_least=0.1)
    if what == "wall":
        trial.check("particles outside the box", _outside(simulation), equals=0)
        trial.show("stopped at walls", simulation.stopped_at_walls)
    else:
        after = momenta(simulation)["momentum"]
        drift = float(np.linalg.norm(after - before["momentum"])) / before["momentum_scale"]
        trial.check("momentum gained over sum of m |v|", drift, at_most=32 * 1.2e-7)


@hard_case
def sharp_edge(trial: Trial, edge: str) -> None:
    """A 2D drop falls on the edge of a wedge of 60 degrees, on the end of an upright plate one particle thin, or with
    half of it beyond the end of a level plate. The walls' particles alone hold it: there are no planes."""
    with trial.ending():
        plan, inside = _edge_plan(edge)
        simulation = trial.start(plan)
        start = momenta(simulation)["kinetic_energy"] / float(simulation.field("mass").astype(float).sum())
        trial.advance(simulation, until=0.25)
        x = simulation.field("position").astype(float)
        trial.check("particles inside the wall", int(inside(x).sum()), equals=0)
        below = start + GRAVITY * (x[:, 1].max() - x[:, 1].min() + 0.4)
        share = _speed(simulation) / math.sqrt(2 * below)
        trial.check("greatest speed over that of free fall", share, at_most=1.5)
        trial.check("least distance [d]", float(_nearest(simulation).min()) / SPACING, at_least=0.05)


def _edge_plan(edge: str) -> tuple[Plan, Any]:
    """A drop above an edge at the origin; and a function that says who is inside the wall's body."""
    reach = np.arange(0, 41) * SPACING
    if edge == "wedge":
        slope = math.radians(60)  # of each side
        right = np.stack([reach * math.cos(slope), -reach * math.sin(slope)], axis=1)
        wall = np.vstack([right, right[1:] * [-1.0, 1.0]])

        def inside(x: np.ndarray) -> np.ndarray:
            deep = -x[:, 1] * math.cos(slope) - np.abs(x[:, 0]) * math.sin(slope)
            return (deep > 0) & (x[:, 1] > -0.95 * reach[-1] * math.sin(slope))

    elif edge == "upright plate":
        wall = np.stack([0 * reach, -reach], axis=1)

        def inside(x: np.ndarray) -> np.ndarray:  # on the plate's particles: it has no inside, and is not crossed
            return (np.abs(x[:, 0]) < 0.25 * SPACING) & (x[:, 1] < 0) & (x[:, 1] > -0.95 * reach[-1])

    else:
        wall = np.stack([-reach, 0 * reach], axis=1)

        def inside(x: np.ndarray) -> np.ndarray:  # under the plate, farther from its end than a drop can flow round
            return (x[:, 1] < 0) & (x[:, 0] < -4 * SPACING)

    wall = np.hstack([wall, np.zeros((len(wall), 1))])
    radius = 8.2 * SPACING
    drop = Ball(center=(0.15 * SPACING, radius + 1.2 * SPACING, 0.0), radius=radius, velocity=(0.0, -1.0, 0.0))
    scene = liquid(drop, Gravity(acceleration=(0.0, -GRAVITY, 0.0)), dim=2)
    volume = calibrated_factor("wendland_c2", SUPPORT, SPACING, 2) / wall_kernel_sums(wall, "wendland_c2", SUPPORT, 2)
    return dataclasses.replace(make_plan(scene), walls=WallParticles(wall, volume)), inside


# Measures


def _kinetic(simulation: Simulation) -> float:
    return float(momenta(simulation)["kinetic_energy"])


def _nearest(simulation: Simulation) -> np.ndarray:
    return nearest_neighbour_distance(simulation.field("position").astype(float))


def _against_wall(speed: float) -> Scene:
    """A cube that flies at the floor of a box."""
    size = SIDE * SPACING
    room = BoxWalls(lower=(-2 * size, -2 * size, 0.0), upper=(3 * size, 3 * size, 8 * size))
    cube = Box(lower=(0.0, 0.0, 1.5 * SPACING), cells=(SIDE,) * 3, velocity=(0.0, 0.0, -speed))
    return liquid(cube, room, viscosity=1.0)


def _speed(simulation: Simulation) -> float:
    return float(np.linalg.norm(simulation.field("velocity").astype(float), axis=1).max())


def _outside(simulation: Simulation) -> int:
    from refsim.engine.conserved_totals import conserved_totals

    return conserved_totals(simulation)["outside_walls"]


# The map


def step_cell(context: Context, backend: str, state: str, kernels: str, viscosity: float) -> Result:
    """The largest share of the runner's own step with which the column collapses as it does with half of it."""
    columns = 12
    height = 2 * columns * SPACING
    weight = STABILITY_DENSITY * 2 * (columns * SPACING) ** 2 * GRAVITY * 0.5 * height
    plan = make_plan(tank(columns, viscosity=viscosity, kernels=kernels, state=state))
    limiter: dict[str, int] = {}

    def run(factor: float) -> tuple[str, float]:
        simulation = context.simulation(at_step(plan, factor), backend)
        energy = EnergyWatch(simulation)
        if stopped := energy.run(4 * math.sqrt(height / GRAVITY)):
            return stopped, math.inf
        limiter.update(simulation.limiters)
        return "a particle outside the tank" if _outside(simulation) else "", energy.rise / weight

    _, unavoidable = run(0.5)  # what the viscosity lets pass whatever the step

    def trouble(factor: float) -> str:
        said, rise = run(factor)
        return said or (f"energy rises by {100 * rise:.0f} %" if rise > 1.5 * unavoidable + 0.02 else "")

    largest = largest_stable(trouble, 1.0, 0.25, 16.0)
    return largest.result(1.0, limiter=max(limiter, key=lambda k: limiter[k]) if limiter else "")


_COLUMNS = {"mu = 3.2 Pa s (acoustic)": 3.2, "mu = 40 Pa s (viscous)": 40.0}
STEP_CELLS = tuple(
    Cell(f"{state}, {kernels}", column, step_cell, {"state": state, "kernels": kernels, "viscosity": viscosity})
    for state in ("tait", "linear")
    for kernels in ("wendland", "mueller")
    for column, viscosity in _COLUMNS.items()
)


def viscosity_cell(context: Context, backend: str, scene: str, kernels: str, columns: int) -> Result:
    """The largest c h/nu with which a liquid between walls gains no energy."""

    def made(number: float) -> Scene:
        viscosity = STABILITY_DENSITY * SOUND * SUPPORT / number
        return (tank if scene == "tank" else closed_box)(columns, viscosity=viscosity, kernels=kernels)

    def trouble(number: float) -> str:
        simulation = context.simulation(made(number), backend)
        energy = EnergyWatch(simulation, gravity=GRAVITY if scene == "tank" else 0.0)
        until = 1.0 if scene == "box" else 4 * math.sqrt(2 * columns * SPACING / GRAVITY)
        stopped = energy.run(until)
        context.started[:-1] = []
        rise = energy.rise / energy.start
        return stopped or (f"energy rises by {100 * rise:.0f} %" if rise > 0.01 else "")

    return largest_stable(trouble, 128.0, 8.0, 16384.0, factor=1.2).result(silent_up_to(made, 8.0, 16384.0))


VISCOSITY_CELLS = tuple(
    Cell(
        f"{label}, {columns} wide", kernels, viscosity_cell,
        {"scene": scene, "kernels": kernels, "columns": columns}, seconds=20.0 if columns == 12 else 60.0,
    )
    for scene, label in (("tank", "column in a tank"), ("box", "block in a box"))
    for columns in (12, 24)
    for kernels in ("wendland", "mueller", "cubic_spline")
)  # fmt: skip

MAPS = {"stability_tank_step": STEP_CELLS, "stability_viscosity": VISCOSITY_CELLS}


# The liquid, its walls, its list and its files: hard cases that have no paper of their own.


EXPERIMENT = Experiment(name="foundation", title="the liquid, its walls, its list and its files")
