"""States of the hard cases that fail, for a picture of each."""

from __future__ import annotations

import msgspec
import numpy as np

from refsim import Box, BoxWalls, Simulation, SurfaceDetection
from validation.experiments.dam_break.runs import DENSITY, HEIGHT, SETTINGS, column_scene, detect
from validation.experiments.droplet.stability import SPACING as FILAMENT_SPACING
from validation.experiments.droplet.stability import filament
from validation.experiments.foundation.stability import SOUND, SPACING, _edge_plan, liquid
from validation.experiments.heat.stability import each_scheme
from validation.metrics.droplet import nearest_neighbour_distance
from validation.results import Result
from validation.running import Context

MACH, SIDE = 0.3, 10  # of the impact; particles along the cube
WITHIN = 0.25  # s until the drop's fate at an edge is clear
COLUMNS = 20  # of the tank


def impact(context: Context, backend: str) -> Result:
    """A cube that hits a wall at 0.3 c, when two of its particles are closest."""
    size = SIDE * SPACING
    walls = BoxWalls(lower=(-2 * size, -2 * size, 0.0), upper=(3 * size, 3 * size, 8 * size))
    cube = Box(lower=(0.0, 0.0, 1.5 * SPACING), cells=(SIDE,) * 3, velocity=(0.0, 0.0, -MACH * SOUND))
    run: Simulation = context.simulation(liquid(cube, walls, viscosity=1.0), backend)
    least, kept, at = np.inf, np.zeros((0, 3)), 0.0
    until = 3 * size / (MACH * SOUND)
    while run.time < until:
        run.step()
        place = run.field("position").astype(float)
        if (near := float(nearest_neighbour_distance(place).min())) < least:
            least, kept, at = near, place, run.time
        context.progress(run.time / until)
    return Result(
        {
            "time": at,
            "least": least / SPACING,
            "spacing": SPACING,
            "wrong": int((nearest_neighbour_distance(kept) < 0.1 * SPACING).sum()),
        },
        {"position": kept, "nearest": nearest_neighbour_distance(kept) / SPACING},
    )


def edge(context: Context, backend: str, what: str) -> Result:
    """A drop that has fallen on an edge: who is inside the wall."""
    plan, inside = _edge_plan(what)
    run: Simulation = context.simulation(plan, backend)
    while run.time < WITHIN:
        run.step()
    place = run.field("position").astype(float)
    wrong = inside(place)
    walls = np.asarray(plan.walls.position)  # type: ignore[union-attr]
    return Result(
        {"time": run.time, "spacing": SPACING, "wrong": int(wrong.sum())},
        {"position": place, "walls": walls, "flags": wrong},
    )


def upright_edges(context: Context, backend: str) -> Result:
    """A tank at rest in 3D: what the number density takes for surface below it."""
    scene = column_scene(COLUMNS, COLUMNS)
    d = scene.spacing
    size = COLUMNS * d
    tank = msgspec.structs.replace(scene.effects[2], upper=(size, 4 * size, size))
    detection = SurfaceDetection(**SETTINGS["number_density"])
    made = msgspec.structs.replace(
        scene, fluid=(Box(cells=(COLUMNS,) * 3),), effects=(*scene.effects[:2], tank, detection)
    )
    run: Simulation = context.simulation(made, backend)
    run.evaluate()
    place = run.field("position").astype(float)
    wrong = run.field("surface").astype(bool) & (place[:, 1] < size - d)
    return Result({"spacing": d, "wrong": int(wrong.sum())}, {"position": place, "flags": wrong})


def sheet(context: Context, backend: str, side: int = 11) -> Result:
    """A flat sheet of one layer in 3D: which of its particles the fan scan misses."""
    d = 0.5 * HEIGHT / 10
    axis = np.arange(side) * d
    place = np.stack(np.meshgrid(axis, [0.0], axis, indexing="ij"), axis=-1).reshape(-1, 3) + [0.5, 1.0, 0.25]
    seen = detect(context, "fan_scan", 10, 20, 4.0, (place, np.full(len(place), DENSITY * d**3)), backend)
    wrong = ~seen.field("surface").astype(bool)
    return Result({"spacing": d, "wrong": int(wrong.sum())}, {"position": place, "flags": wrong})


def drawn_in(context: Context, backend: str) -> Result:
    """A thread that should break into drops, after 1.2 s."""
    found = filament(context, backend)
    values = {"pieces": found.values["shown"]["pieces"], "spacing": FILAMENT_SPACING}
    return Result(values, {"position": found.arrays["position"]})


def rounding(context: Context, backend: str) -> Result:
    """Change of heat over the heat in three steps of s_max = 1e7, by scheme, and its bar."""
    found = each_scheme(context, backend, what="", number=3e6, steps=3)
    return Result({"checks": found.values["checks"]})
