"""Runs of liquid at meshes: rain, a resting tank, pouring, and what the patent's tension amounts to."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from refsim import (
    Akinci2013,
    Box,
    BoxWalls,
    Cloud,
    Gravity,
    MeshBoundary,
    NormalDifference2014,
    Scene,
    Simulation,
    WeaklyCompressible,
)
from refsim.boundary.signed_distance import NarrowBand
from refsim.core.effect import Extremes
from refsim.core.errors import RunStopped
from validation.experiments.boundary.flow_shapes import SHAPES, SPACING, SUPPORT, cup, mesh_file
from validation.metrics.shapes import lattice_ball
from validation.results import Result
from validation.running import Context, search_log

DENSITY, SOUND, GRAVITY = 1000.0, 20.0, 9.81
RAIN = 2560  # particles
INSIDE = 0.01  # of a spacing: depth from which on a particle counts as inside


def liquid(sound: float = SOUND, viscosity: float = 0.5, **changes: Any) -> WeaklyCompressible:
    """Water-like liquid."""
    return WeaklyCompressible(rest_density=DENSITY, sound_speed=sound, dynamic_viscosity=viscosity, **changes)


def depth(band: NarrowBand, position: NDArray) -> NDArray:
    """How deep particles are inside the solid [m]; negative outside."""
    return -band.at(np.ascontiguousarray(position, dtype=float))[0]


def rain_drops(count: int = RAIN, seed: int = 1) -> NDArray:
    """Scattered particles over the solid, at least 1.2 spacings apart, in a column 18 wide."""
    random = np.random.default_rng(seed)
    half, gap = 9 * SPACING, 1.2 * SPACING
    height = 2.6 * count * gap**3 / (2 * half) ** 2
    kept: list[NDArray] = []
    cells: dict[tuple[int, ...], list[NDArray]] = {}
    while len(kept) < count:
        p = random.uniform((-half, -half, 0), (half, half, height))
        cell = tuple((p // gap).astype(int))
        near = (
            q
            for a in (-1, 0, 1)
            for b in (-1, 0, 1)
            for c in (-1, 0, 1)
            for q in cells.get((cell[0] + a, cell[1] + b, cell[2] + c), ())
        )
        if all(((p - q) ** 2).sum() > gap * gap for q in near):
            kept.append(p)
            cells.setdefault(cell, []).append(p)
    return np.array(kept)


def rain(
    context: Context, shape: str, correction: str, share: float, backend: str, count: int = RAIN, seed: int = 1
) -> Result:
    """Rain at 2 m/s on a shape, at `share` of the runner's step: who is found inside the solid after a step.

    share 1 is the runner's own step; other shares are fixed steps, so many times the first one.
    """
    with mesh_file(SHAPES[shape]()) as file:
        return _rained(context, file, correction, share, backend, rain_drops(count, seed))


def _rained(context: Context, file: str, correction: str, share: float, backend: str, drops: NDArray) -> Result:
    boundary = MeshBoundary(file=file, correction=correction)  # type: ignore[arg-type]
    drops = drops + np.array([0, 0, 10 * SPACING])
    floor = BoxWalls(lower=(-0.15, -0.15, -0.15), upper=(0.15, 0.15, 1.0), open_faces=("+z",))
    options: dict[str, Any] = {}
    runner = 0.4 * SUPPORT / (SOUND + 2)
    if share != 1:
        options["step"] = share * runner
    scene = Scene(
        spacing=SPACING, support_radius=SUPPORT, fluid=(Cloud(position=drops, velocity=(0.0, 0.0, -2.0)),),
        effects=(liquid(), Gravity(), floor, boundary), **options,
    )  # fmt: skip
    simulation = context.simulation(scene, backend)
    band = boundary.placed(simulation.plan.grid).band
    ever = np.zeros(len(drops), dtype=bool)
    deepest, reason, lengths = 0.0, "", []
    try:
        while simulation.time < 0.17:
            lengths.append(simulation.step().length)
            found = depth(band, simulation.field("position"))
            ever |= found > INSIDE * SPACING
            deepest = max(deepest, float(found.max()))
            if simulation.steps % 16 == 0:
                context.progress(simulation.time / 0.17)
    except RunStopped as stop:
        reason = stop.reason
    at_end = depth(band, simulation.field("position")) > INSIDE * SPACING
    corrections = int(simulation.field("corrections").sum()) if correction != "none" else 0
    return Result(
        {
            "ever_inside": int(ever.sum()), "inside_at_end": int(at_end.sum()), "deepest_spacings": deepest / SPACING,
            "corrections": corrections, "reason": reason, "steps": simulation.steps,
            "step_s": float(np.mean(lengths)) if lengths else math.nan, "outside": _outside(simulation),
        }
    )  # fmt: skip


def _outside(simulation: Simulation) -> int:
    """Particles whose position is not finite."""
    return int((~np.isfinite(simulation.field("position")).all(1)).sum())


CELLS = (10, 10, 14)
GAP = 1.0  # between walls and first layer at the start, in spacings
TANK_SUPPORT = 3.0 * SPACING  # where sums over the lattice deliver 99.7 % of a pressure gradient; 97.8 % at 2.7


def resting_scene(file: str, cells: tuple[int, int, int] = CELLS, **changes: Any) -> Scene:
    """Liquid in a cup that is a mesh, a spacing from its walls."""
    tall = cells[2] * SPACING
    return Scene(
        spacing=SPACING, support_radius=TANK_SUPPORT, dtype="float64",
        fluid=(Box(lower=((GAP - 0.5) * SPACING,) * 3, cells=cells),),
        effects=(
            liquid(sound=10 * math.sqrt(2 * GRAVITY * tall), viscosity=2.0), Gravity(),
            MeshBoundary(file=file, **changes),
        ),
    )  # fmt: skip


def resting_cup(cells: tuple[int, int, int] = CELLS) -> Any:
    """The cup for it, six spacings higher than the liquid."""
    return cup(inside_of(cells), 4 * SPACING)


def inside_of(cells: tuple[int, int, int]) -> tuple[float, float, float]:
    """Lengths of the cup's inside [m]."""
    a, b = ((n - 1 + 2 * GAP) * SPACING for n in cells[:2])
    return a, b, (cells[2] + 6) * SPACING


def resting_tank(context: Context, steps: int, backend: str) -> Result:
    """A tank at rest: particles kept, pressure by depth over the last tenth of the steps, noise of the wall's force."""
    with mesh_file(resting_cup()) as file:
        scene = resting_scene(file)
        simulation = context.simulation(scene, backend)
        band = next(e for e in scene.effects if e.name == "mesh_boundary").placed(simulation.plan.grid).band
        mass = simulation.field("mass")
        places, pressures, forces, speeds = [], [], [], []
        for step in range(steps):
            simulation.step()
            if step >= steps - steps // 10:
                velocity = simulation.field("velocity")
                forces.append(float((mass * (simulation.field("acceleration")[:, 2] + GRAVITY)).sum()))
                if step % 10 == 0:
                    places.append(simulation.field("position"))
                    pressures.append(simulation.field("pressure"))
                    speeds.append(float(np.sqrt((velocity**2).sum(1).max())))
            if step % 50 == 0:
                context.progress(step / steps)
        position = simulation.field("position")
        inside = depth(band, position)
    place, p = np.mean(places, axis=0), np.mean(pressures, axis=0)
    z, low, high = place[:, 2], place.min(0), place.max(0)
    middle = ((place - low > 2.5 * SPACING) & (high - place > 2.5 * SPACING))[:, :2].all(1)
    # Boundary particles stand for a layer a spacing thick, half of it outside: the liquid begins there.
    area = np.prod([inner - SPACING for inner in inside_of(CELLS)[:2]])
    level = float(0.5 * SPACING + mass.sum() / DENSITY / area)
    deep = z < level - 3 * SPACING  # where densities lack nothing above
    known = DENSITY * GRAVITY * (level - z)
    slope, offset = np.polyfit(z[deep & middle], p[deep & middle], 1)
    errors = p[deep] / known[deep] - 1
    core = float(np.median((p / known)[deep & middle]) - 1)
    weight = float(mass.sum() * GRAVITY)
    force = np.array(forces)
    lost = int(((position[:, 2] < 0) | (np.abs(position).max(1) > 1)).sum())
    return Result(
        {
            "steps": steps, "particles": len(z), "lost": lost, "inside": int((inside > INSIDE * SPACING).sum()),
            "pressure_error": core, "pressure_everywhere": float(np.median(errors)),
            "pressure_spread": float(errors.std()), "gradient_error": float(-slope / (DENSITY * GRAVITY) - 1),
            "level_m": level, "surface_m": float(-offset / slope), "top_m": surface_height(place[middle]),
            "force_error": float(force.mean() / weight - 1), "force_noise": float(force.std() / weight),
            "greatest_speed": float(np.max(speeds)), "search": search_log(simulation),
            "corrections": int(simulation.field("corrections").sum()),
        },
        {"position": position.astype(np.float32), "height": z.astype(np.float32), "pressure": p.astype(np.float32)},
    )  # fmt: skip


def surface_height(place: NDArray) -> float:
    """Height [m] of a liquid's level: half a spacing over the highest particles of columns a spacing wide."""
    column = np.unique((place[:, :2] // SPACING).astype(int), axis=0, return_inverse=True)[1].ravel()
    highest = np.full(column.max() + 1, -np.inf)
    np.maximum.at(highest, column, place[:, 2])
    return float(np.median(highest) + 0.5 * SPACING)


# Pouring: three arms

ARMS = {"none": "no tension", "cohesion": "pairwise cohesion", "difference": "normal difference (patent P7)"}
POUR = {"sphere": 0.3, "torus": 0.3, "plate": 0.3, "funnel": 0.4, "pebble": 0.3}  # simulated seconds
GAMMA = 0.1  # of the normal difference [m/s^2]
TENSION = 1.0  # nominal, of the cohesion [N/m]


def tension(arm: str) -> tuple[Any, ...]:
    """The effect of an arm."""
    if arm == "cohesion":
        return (Akinci2013(surface_tension=TENSION, area_acceleration=0.0),)
    return (NormalDifference2014(area_acceleration=GAMMA),) if arm == "difference" else ()


def pour(context: Context, shape: str, arm: str, backend: str, seconds: float = 0.0) -> Result:
    """A column of liquid falls on a shape, or into it; components and holes of what it becomes, at several times."""
    until = seconds or POUR[shape]
    with mesh_file(SHAPES[shape]()) as file:
        boundary = MeshBoundary(file=file, viscosity=0.2)
        wide = 8
        low = 5.5 * SPACING if shape == "funnel" else 6.5 * SPACING
        column = Box(
            lower=(-0.5 * wide * SPACING, -0.5 * wide * SPACING, low), cells=(wide, wide, 18), velocity=(0.0, 0.0, -0.8)
        )
        floor = BoxWalls(lower=(-0.16, -0.16, -0.12), upper=(0.16, 0.16, 0.6), open_faces=("+z",))
        scene = Scene(
            spacing=SPACING, support_radius=SUPPORT, fluid=(column,),
            effects=(liquid(), Gravity(), floor, boundary, *tension(arm)),
        )  # fmt: skip
        simulation = context.simulation(scene, backend)
        placed = boundary.placed(simulation.plan.grid)
        frames, values, inside = [], [], 0
        for at in np.linspace(0, until, 7)[1:]:
            while simulation.time < at:
                simulation.step()
            position = simulation.field("position").astype(float)
            inside = max(inside, int((depth(placed.band, position) > INSIDE * SPACING).sum()))
            frames.append(position)
            values.append({"time": float(at), **texture(position)})
            context.progress(at / until)
        speed = np.sqrt((simulation.field("velocity") ** 2).sum(1))
    return Result(
        {
            "frames": values, "inside": inside, "particles": simulation.count, "steps": simulation.steps,
            "corrections": int(simulation.field("corrections").sum()), "greatest_speed": float(speed.max()),
        },
        {"position": np.array(frames, dtype=np.float32), "solid": placed.position.astype(np.float32)},
    )  # fmt: skip


def texture(position: NDArray) -> dict[str, float]:
    """Components of a liquid, lone particles, holes of its sheets, and how evenly its particles stand.

    Particles belong together within 1.5 spacings. A hole is a ring in which the liquid's film has a gap: loops of the
    graph that no triangles fill, counted by the Euler characteristic of edges and triangles of its thin parts.
    """
    tree = cKDTree(position)
    pairs = tree.query_pairs(1.5 * SPACING, output_type="ndarray")
    count = len(position)
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    sizes = np.bincount(label)
    nearest = tree.query(position, k=2)[0][:, 1] / SPACING
    return {
        "components": int(number), "lone": int((sizes == 1).sum()), "largest_share": float(sizes.max() / count),
        "holes": holes(position), "nearest_5": float(np.quantile(nearest, 0.05)),
    }  # fmt: skip


def holes(position: NDArray, cell: float = 0.5 * SPACING, reach: float = 0.85 * SPACING) -> int:
    """Tunnels through a union of balls of `reach` [m] on a raster: components + cavities - Euler's number.

    A net of strands has many; a closed sheet has none. Tunnels that the solid itself fills count, too.
    """
    from scipy.ndimage import label

    low = position.min(0) - 2 * reach
    shape = np.ceil((position.max(0) + 2 * reach - low) / cell).astype(int) + 1
    if shape.prod() > 3e7:  # flung particles: look at the middle nine tenths
        keep = (np.abs(position - np.median(position, axis=0)) < np.quantile(np.abs(position), 0.95)).all(1)
        return holes(position[keep], cell, reach)
    axes = [low[c] + cell * np.arange(shape[c]) for c in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    near = cKDTree(position).query(points.reshape(-1, 3), distance_upper_bound=reach)[0].reshape(shape) < reach
    filled = np.pad(near, 1)
    components = label(filled, np.ones((3, 3, 3)))[1]
    cavities = label(~filled)[1] - 1
    return int(components + cavities - euler(filled))


def euler(filled: NDArray) -> int:
    """Euler characteristic of a union of closed cubes: corners - edges + faces - cubes."""

    def grown(axes: tuple[int, ...]) -> NDArray:
        found = filled
        for axis in axes:
            ahead = [slice(None)] * 3
            behind = [slice(None)] * 3
            ahead[axis], behind[axis] = slice(1, None), slice(None, -1)
            found = found[tuple(ahead)] | found[tuple(behind)]
        return found

    total = 0
    for number in range(8):
        axes = tuple(c for c in range(3) if number >> c & 1)
        total += (-1) ** (3 - len(axes)) * int(grown(axes).sum())
    return total


# The patent's tension alone


def drop_scene(gamma: float, count: int = 1021, clamp: bool = True, step: float = 0.0, **changes: Any) -> Scene:
    """A ball cut from the lattice, without gravity."""
    position = lattice_ball(count).astype(float) * SPACING
    fluid = liquid(sound=20.0, viscosity=1.0, clamp_pressure=clamp)
    return Scene(
        spacing=SPACING, support_radius=SUPPORT, dtype="float64", fluid=(Cloud(position=position),), step=step,
        effects=(fluid, NormalDifference2014(area_acceleration=gamma)), **changes,
    )  # fmt: skip


def own_tension(context: Context, gamma: float, count: int, backend: str) -> Result:
    """A drop under the patent's term alone for 0.2 s: density and pressure in its middle, and how far it reaches.

    sigma is that of Laplace's law, p = 2 sigma/R; it means something only where the drop holds together.
    """
    simulation = context.simulation(drop_scene(gamma, count), backend)
    energy = []
    while simulation.time < 0.2:
        simulation.step()
        if simulation.steps % 20 == 0:
            energy.append(float((simulation.field("velocity") ** 2).sum()))
            context.progress(simulation.time / 0.2)
    simulation.evaluate()
    position, pressure = simulation.field("position"), simulation.field("pressure")
    mass, density = simulation.field("mass"), simulation.field("density")
    away = np.linalg.norm(position - position.mean(0), axis=1)
    radius = float((0.75 / math.pi * (mass / DENSITY).sum()) ** (1 / 3))
    core = away < 0.5 * radius
    inner = float(pressure[core].mean())
    return Result(
        {
            "gamma": gamma, "particles": simulation.count, "radius": radius, "pressure": inner,
            "sigma": 0.5 * inner * radius, "spread": float(pressure[core].std() / max(abs(inner), 1e-300)),
            "core_density": float(density[core].mean() / DENSITY), "energy_share": energy[-1] / max(energy),
            "extent": float(away.max() / radius),
        }
    )  # fmt: skip


def own_bound(context: Context, gamma: float, backend: str, layers: int = 15, steps: int = 300) -> Result:
    """Largest step of the patent's term alone: particles in the middle of a lattice, all others held, leap-frog.

    A step holds if displacements of 1e-6 spacings, at random, have not grown a thousandfold. Beside it 2/omega of the
    stiffest wave on the lattice, from which the runner's limit is taken.
    """
    position = (
        np.stack(np.meshgrid(*3 * [np.arange(layers)], indexing="ij"), axis=-1).reshape(-1, 3) - layers // 2
    ) * SPACING
    scene = Scene(
        spacing=SPACING, support_radius=SUPPORT, dtype="float64", fluid=(Cloud(position=position),),
        effects=(
            WeaklyCompressible(rest_density=DENSITY, sound_speed=1e-4, clamp_pressure=False),
            NormalDifference2014(area_acceleration=gamma),
        ),
    )  # fmt: skip
    simulation = context.simulation(scene, backend)
    free = np.abs(simulation.field("position")).max(1) < (layers // 2 - 2 * SUPPORT / SPACING + 0.01) * SPACING
    start = np.random.default_rng(0).normal(0, 1e-6 * SPACING, position.shape) * free[:, None]
    identity = np.array(simulation.fields["identity"])

    def holds(step: float) -> bool:
        moved, velocity = start.copy(), np.zeros_like(start)
        for _ in range(steps):
            simulation.backend.assign(simulation.fields["position"], (position + moved)[identity])
            simulation.evaluate()
            velocity += step * simulation.field("acceleration") * free[:, None]
            moved += step * velocity
            if np.abs(moved).max() > 1e-3 * SPACING:
                return False
        return True

    limit = simulation.limits["normal_tension"].at(Extremes(0.0, 0.0))
    low, high = 0.5 * limit, 8 * limit
    for k in range(8):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
        context.progress((k + 1) / 8)
    return Result(
        {"gamma": gamma, "largest_step": low, "limit": limit, "predicted": 2 * limit, "free": int(free.sum())}
    )


def marked_cost(context: Context, everywhere: bool, backend: str, repeats: int = 60) -> Result:
    """Seconds of the correction's pass for a large block of which a small part is near the solid."""
    with mesh_file(SHAPES["sphere"]()) as file:
        boundary = MeshBoundary(file=file, every_particle=everywhere)
        block = Box(lower=(-0.4, -0.4, 0.06), cells=(48, 48, 44))
        scene = Scene(spacing=SPACING, support_radius=SUPPORT, fluid=(block,), effects=(liquid(), Gravity(), boundary))
        simulation = context.simulation(scene, backend)
        simulation.step()
        call = dict(simulation.motion_calls)["penetration.kick_drift"]
        simulation.backend.assign(simulation.timestep, np.zeros(2, np.float32))
        seconds = []
        for _ in range(repeats):
            began = time.perf_counter()
            call()
            seconds.append(time.perf_counter() - began)
    fifths = [float(np.median(part)) for part in np.array_split(np.array(seconds), 5)]
    return Result({"seconds": float(np.median(seconds)), "fifths": fifths, "particles": simulation.count})
