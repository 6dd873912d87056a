"""Hard cases of a collapsing column: voids at the start, detection beside walls, in sprays and in films."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from scipy.spatial import cKDTree

from refsim import Box, Cloud, Scene, SurfaceDetection
from refsim.scene.plan import make_plan
from validation.experiments.dam_break.runs import (
    DENSITY,
    GRAVITY,
    HEIGHT,
    SETTINGS,
    TRUTH_RADIUS,
    column_scene,
    detect,
)
from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface
from validation.metrics.voids import find_voids
from validation.results import Result
from validation.running import Context
from validation.trials import Trial

COLUMNS = 40
SPLASH = (0.8, 0.9, 1.0, 1.1, 1.2)  # s
WIDEST = 1.0  # spacings: a disc that fits into a void between the particles' centres; a lattice has none above 0.71
STARTS: dict[str, dict[str, Any]] = {
    "cold": {},
    "hydrostatic": {"hydrostatic": True},
    "cold, walls as printed": {"walls": ("g",)},
    "hydrostatic, walls as printed": {"hydrostatic": True, "walls": ("g",)},
    "cold, jittered by d/10": {"jitter": 0.1},
    "cold, an eighth of the viscosity": {"viscosity": 0.125},
}


def hydrostatic_column(columns: int) -> np.ndarray:
    """The column's particles (n, 3) [m], each layer as near to the next as Tait's equation has it under its weight."""
    spacing, layers = 0.5 * HEIGHT / columns, 2 * columns
    above = (layers - np.arange(layers) - 0.5) * spacing
    bulk = DENSITY * 100.0 * GRAVITY * HEIGHT  # rho0 c^2
    layer = spacing * (1 + 7 * DENSITY * GRAVITY * above / bulk) ** (-1 / 7)
    y = np.cumsum(layer) - 0.5 * layer
    x = (np.arange(columns) + 0.5) * spacing
    grid = np.stack(np.meshgrid(x, y, [0.0], indexing="ij"), axis=-1)
    return grid.reshape(-1, 3)


def start_scene(hydrostatic: bool = False, walls: tuple = (), jitter: float = 0.0, viscosity: float = 1.0) -> Scene:
    """The dam break's column in one of its starts; `jitter` in spacings, `viscosity` as a share of the dam break's."""
    scene = column_scene(COLUMNS)
    liquid, gravity, box = scene.effects
    liquid = msgspec.structs.replace(liquid, dynamic_viscosity=viscosity * liquid.dynamic_viscosity)
    effects = (liquid, gravity, msgspec.structs.replace(box, literal=walls))
    position = hydrostatic_column(COLUMNS) if hydrostatic else make_plan(scene).state.position.copy()
    shift = np.random.default_rng(1).uniform(-jitter, jitter, (len(position), 2))
    position[:, :2] += scene.spacing * shift
    return msgspec.structs.replace(scene, fluid=(Cloud(position=position),), effects=effects)


def voids(context: Context, backend: str, until: float = 0.5, samples: int = 20) -> Result:
    """Void area over time from a cold and a hydrostatic start, with calibrated and with printed walls, and others."""
    trial = Trial(context, backend)
    times = np.linspace(0.0, until, samples + 1)[1:]
    area: dict[str, list[float]] = {}
    count: dict[str, list[int]] = {}
    frames = {}
    with trial.ending():
        for name, changes in STARTS.items():
            simulation = trial.start(start_scene(**changes))
            spacing, walls = simulation.plan.grid.spacing, simulation.plan.walls.position
            area[name], count[name] = [], []
            for at in times:
                while simulation.time < at:
                    simulation.step()
                x = simulation.field("position")
                found = find_voids(x, spacing, WIDEST * spacing, walls)
                area[name].append(found.area)
                count[name].append(found.count)
                if abs(at - 0.3) < 1e-9:
                    frames[name] = x[:, :2]
            trial.account(simulation)
        trial.check("void area of a cold start [d^2]", max(area["cold"]), at_most=2.0)
        trial.check("void area of a hydrostatic start [d^2]", max(area["hydrostatic"]), at_most=2.0)
        trial.check("void area with printed walls, cold [d^2]", max(area["cold, walls as printed"]), at_least=100.0)
        both = max(area["hydrostatic, walls as printed"])
        trial.check("void area with printed walls, hydrostatic [d^2]", both, at_least=100.0)
        trial.show("time", times)
        trial.show("area", area)
        trial.show("count", count)
        trial.show("spacing", spacing)
    return trial.result(**{f"at_0.3_{k}": frames[name] for k, name in enumerate(STARTS) if name in frames})


def beside_walls(context: Context, backend: str, method: str, depth: int = 1, columns: int = 20) -> Result:
    """A tank filled to half and at rest: a detector takes no particle at a wall, an edge or a corner for surface, and
    finds the whole free surface but for the contact line (its outermost particles, whose cone a wall blocks)."""
    trial = Trial(context, backend)
    scene = column_scene(columns, depth)
    spacing = scene.spacing
    size = columns * spacing
    tank = msgspec.structs.replace(scene.effects[2], upper=(size, 4 * size, depth * spacing))
    with trial.ending():
        detection = SurfaceDetection(**SETTINGS[method])
        box = Box(cells=(columns, columns, depth))
        simulation = trial.start(
            msgspec.structs.replace(scene, fluid=(box,), effects=(*scene.effects[:2], tank, detection))
        )
        simulation.evaluate()
        x, flags = simulation.field("position"), simulation.field("surface").astype(bool)
        top = x[:, 1] > size - spacing
        dim = simulation.plan.grid.dim
        line = top & ((x < spacing) | (x > np.array(tank.upper) - spacing))[:, [0, 2][: dim - 1]].any(1)
        trial.check("found off the surface", int((flags & ~top).sum()), equals=0)
        trial.check("missed of the surface away from the contact line", int((~flags & top & ~line).sum()), equals=0)
        trial.show("missed of the contact line", f"{int((~flags & line).sum())} of {int(line.sum())}")
    return trial.result()


def in_motion(context: Context, backend: str, method: str, times: Sequence[float] = SPLASH, starts: int = 4) -> Result:
    """The splash: isolated particles are never missed, and walls do not raise the share of false alarms.

    Rounding decides where single particles are: several splashes, from starts that differ by 1e-6 d, are looked at
    several times.
    """
    trial = Trial(context, backend)
    away = at = few = 0
    excess: list[float] = []
    recall: list[float] = []
    lattice = make_plan(column_scene(COLUMNS))
    grid, start, walls = lattice.grid, lattice.state, lattice.walls.position
    with trial.ending():
        for seed, time in itertools.product(range(starts), times):
            if time == times[0]:
                shift = np.random.default_rng(seed).uniform(0, 1e-6 * grid.spacing, start.position.shape) * [1, 1, 0]
                simulation = trial.start(column_scene(COLUMNS, cloud=(start.position + shift, start.mass)))
            trial.advance(simulation, until=time)
            x, mass = simulation.field("position"), simulation.field("mass")
            truth = arc_cover_surface(x, TRUTH_RADIUS * grid.spacing, walls)
            near = np.array([len(found) - 1 for found in cKDTree(x).query_ball_point(x, grid.support_radius)])
            at_wall = cKDTree(walls).query(x)[0] < grid.support_radius
            flags = detect(context, method, COLUMNS, 1, 4.0, (x, mass), backend).field("surface").astype(bool)
            few += int((near < 3).sum())
            away += int((~flags & (near < 3) & ~at_wall).sum())
            at += int((~flags & (near < 3) & at_wall).sum())
            shares = [float((flags & ~truth & part).sum() / (~truth & part).sum()) for part in (at_wall, ~at_wall)]
            excess.append(shares[0] - shares[1])
            recall.append(float((flags & truth).sum() / truth.sum()))
        trial.show("particles with fewer than 3 neighbours", few)
        trial.check("missed of those with fewer than 3 neighbours, away from walls", away, equals=0)
        trial.check("missed of those with fewer than 3 liquid neighbours, beside walls", at, equals=0)
        trial.check("false alarms beside walls less those away", max(excess), at_most=0.02)
        trial.show("least recall", min(recall))
    return trial.result()


def spray(context: Context, backend: str, depth: int = 1) -> Result:
    """Lone particles, pairs and triples in the air and on a wall: all of them are surface, by every detector."""
    trial = Trial(context, backend)
    columns = 10
    spacing = 0.5 * HEIGHT / columns
    z = 0.5 * depth * spacing if depth > 1 else 0.0
    group = spacing * np.array([[0.0, 0, 0], [1.0, 0, 0], [0.5, 0.8, 0]])
    places = [(0.5, 1.0, z), (1.0, 2.0, z), (1.5, 3.0, z), (0.2, 0.5 * spacing, z), (1.0, 0.5 * spacing, z)]
    parts = [np.array(place) + group[: 1 + k % 3] for k, place in enumerate(places)]
    position = np.vstack(parts)
    with trial.ending():
        for method in SETTINGS:
            mass = np.full(len(position), DENSITY * spacing ** (2 if depth == 1 else 3))
            seen = detect(context, method, columns, depth, 4.0, (position, mass), backend)
            flags = seen.field("surface").astype(bool)
            trial.check(f"{method}: missed", int((~flags).sum()), equals=0)
    return trial.result()


def sheet(context: Context, backend: str, method: str, layers: int, side: int = 11) -> Result:
    """A flat sheet in the air in 3D: every particle of one or two layers is surface."""
    trial = Trial(context, backend)
    columns = 10
    spacing = 0.5 * HEIGHT / columns
    axes = [np.arange(n) * spacing for n in (side, layers, side)]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + [0.5, 1.0, 0.25]
    with trial.ending():
        mass = np.full(len(position), DENSITY * spacing**3)
        seen = detect(context, method, columns, 2 * columns, 4.0, (position, mass), backend)
        flags = seen.field("surface").astype(bool)
        truth = cap_cover_surface(position, TRUTH_RADIUS * spacing)
        trial.check("particles that are no surface", int((~truth).sum()), equals=0)
        trial.check("missed", int((truth & ~flags).sum()), equals=0)
    return trial.result()
