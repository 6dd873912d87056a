"""Tanks, columns, vortices, waves and solids with the papers' liquid and with one that rests (docs/liquid.md).

Lengths in m, rho0 = 1000 kg/m^2 or kg/m^3, float64, Wendland C2, sound speed ten times the largest speed. All start on
the lattice, with the density of rest where the density is advanced.
"""

import math
import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from refsim import (
    Box,
    BoxWalls,
    Cloud,
    Gauge,
    Gravity,
    MeshBoundary,
    ParticleShifting,
    Scene,
    ShapeMatching,
    Simulation,
    SolidBox,
    TwoWayCoupling,
    WeaklyCompressible,
    make_plan,
)
from refsim.core.effect import Discretisation
from refsim.core.errors import RunStopped
from refsim.core.operation import REGISTRY
from refsim.core.writing import write_file
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, RunSpec
from validation.experiments.solutions.runs import _projected, order
from validation.metrics import solutions as exact
from validation.metrics.liquid import vortex, vortex_error
from validation.metrics.solutions import standing_flow
from validation.results import Result
from validation.running import Context, advance
from validation.trials import Cell, at_step, largest_stable, silent_up_to

DENSITY, GRAVITY, DEPTH = 1000.0, 9.81, 1.0  # kg/m^2 or kg/m^3, m/s^2, m
SOUND = 10 * math.sqrt(GRAVITY * DEPTH)  # m/s
ARTIFICIAL = 0.02  # alpha of the artificial viscosity that has the tanks' kinematic viscosity
UNTIL, MEAN = 4.0, 0.5  # s; length of the mean at the end
SEED = 3
REYNOLDS, CREST, VISCOUS, WATER = 100.0, 0.02, (0.012, 4), (1e-6, 10)  # U/nu of vortices; wave: m, (m^2/s, periods)
# summed density and mirrored walls; advanced density and extrapolated walls; the same with renormalised gradients
LIQUIDS, CORRECTED = ("papers", "rests"), "corrected"


def _liquid(
    kind: str, sound: float, viscosity: float, clamp: bool = True, kernels: Any = "wendland"
) -> WeaklyCompressible:
    options: dict[str, Any] = {"density": "summation", "clamp_pressure": clamp}
    if kind != "papers":
        options = {"density": "continuity", "gradient": "corrected" if kind == "corrected" else "plain"}
    return WeaklyCompressible(
        rest_density=DENSITY, sound_speed=sound, dynamic_viscosity=DENSITY * viscosity, viscosity="central",
        kernels=kernels, **options,
    )  # fmt: skip


def _walls(kind: str, upper: tuple[float, float, float]) -> BoxWalls:
    return BoxWalls(lower=(0.0, 0.0, 0.0), upper=upper, model="extrapolated" if kind != "papers" else "mirrored")


def _still(simulation: Simulation) -> float:
    """Root mean square speed [m/s]."""
    return float(np.sqrt((simulation.field("velocity") ** 2).sum(1).mean()))


def _water(dim: int, cells: tuple[int, int], support: float, liquid: WeaklyCompressible, *effects: Any) -> Scene:
    """Water 1 m deep in a box, `cells` wide and deep, on the lattice."""
    wide, deep = cells
    spacing, up = DEPTH / deep, dim - 1
    pull, upper = np.zeros(3), np.full(3, wide * spacing)
    pull[up], upper[up] = -GRAVITY, 2 * DEPTH
    walls = _walls("papers" if liquid.density == "summation" else "rests", tuple(upper))
    return Scene(
        name="tank", dim=dim, dtype="float64", spacing=spacing, support_radius=support * spacing,  # type: ignore[arg-type]
        fluid=(Box(cells=(wide, deep, 1) if dim == 2 else (wide, wide, deep)),),
        effects=(liquid, Gravity(acceleration=tuple(pull)), walls, *effects),
    )  # fmt: skip


def _shaken(simulation: Simulation, shake: float, seed: int = SEED) -> Simulation:
    """The simulation with each particle moved by up to `shake` spacings along each axis."""
    grid = simulation.plan.grid
    moves = np.random.default_rng(seed).uniform(-shake, shake, (simulation.count, 3)) * grid.spacing
    moves[:, grid.dim :] = 0
    simulation.set_field("position", simulation.field("position") + moves)
    return simulation


def _restless(context: Context, scene: Scene, seed: int, backend: str, factor: float = 1.0) -> str:
    """Why water, shaken by 0.1 d, does not rest after 4 s with this share of the runner's own step, or ""."""
    simulation = _shaken(context.simulation(at_step(make_plan(scene), factor), backend), 0.1, seed)
    try:
        while simulation.time < UNTIL:
            simulation.step()
    except RunStopped as stop:
        return f"stopped: {stop.reason}"
    context.started[:-1] = []
    moving = _still(simulation) / SOUND
    return f"it moves with {moving:.4f} c" if moving > 0.001 else ""


def _of_number(dim: int, cells: tuple[int, int], kernels: str, number: float) -> Scene:
    viscosity = SOUND * 2.6 * DEPTH / cells[1] / number
    return _water(dim, cells, 2.6, _liquid("rests", SOUND, viscosity, kernels=kernels))


def rest_cell(context: Context, backend: str, dim: int, cells: tuple[int, int], seed: int, kernels: str) -> Result:
    """The largest c h/nu with which water rests."""

    def trouble(number: float) -> str:
        return _restless(context, _of_number(dim, cells, kernels, number), seed, backend)

    silent = silent_up_to(lambda number: _of_number(dim, cells, kernels, number), 8.0, 16384.0, but=("sound_speed",))
    return largest_stable(trouble, 1024.0, 8.0, 16384.0, factor=1.2).result(silent)


def rest_step_cell(context: Context, backend: str, dim: int, cells: tuple[int, int], seed: int, kernels: str) -> Result:
    """The largest share of the runner's own step with which water of c h/nu = 250 rests."""
    scene = _of_number(dim, cells, kernels, 250.0)
    return largest_stable(lambda factor: _restless(context, scene, seed, backend, factor), 1.0, 0.25, 4.0).result(1.0)


# The limits were chosen with the first three; others judge them, shaken otherwise.
_BASINS = (
    (2, (8, 8), SEED), (2, (16, 16), SEED), (2, (6, 30), SEED), (2, (10, 16), 11), (2, (7, 35), 11), (3, (6, 6), 11),
)  # fmt: skip


def _rest_cells(function: Callable[..., Result]) -> tuple[Cell, ...]:
    return tuple(
        Cell(
            f"{wide} x {deep}" if dim == 2 else f"{wide} x {wide} x {deep}", kernels, function,
            {"dim": dim, "cells": (wide, deep), "seed": seed, "kernels": kernels}, seconds=60.0,
        )
        for dim, (wide, deep), seed in _BASINS
        for kernels in ("wendland", "mueller", "cubic_spline")
    )  # fmt: skip


MAPS = {"stability_rest": _rest_cells(rest_cell), "stability_rest_step": _rest_cells(rest_step_cell)}


def column(context: Context, cells: tuple[int, int], support: float, backend: str) -> Result:
    """Water 1 m deep, `cells` wide and deep, suddenly under its own weight for 4 s, with c h/nu = 250.

    speed  largest root mean square speed over that of an elastic rod, g H/(c sqrt(3))
    """
    liquid = _liquid("rests", SOUND, SOUND * support * DEPTH / cells[1] / 250)
    simulation = context.simulation(_water(2, cells, support, liquid), backend)
    simulation.set_field("advanced_excess", np.zeros(simulation.count))
    simulation.set_field("mass", np.full(simulation.count, DENSITY * simulation.plan.grid.spacing**2))
    speed = 0.0

    def sample(simulation: Simulation, wall: float) -> None:
        nonlocal speed
        speed = max(speed, _still(simulation))

    advance(simulation, (DEPTH / SOUND * np.arange(1, UNTIL * SOUND / DEPTH) / 4).tolist(), sample, context)
    values = {
        "kind": "column", "cells": cells[1], "wide": cells[0], "support": support, "particles": simulation.count,
        "speed": speed * math.sqrt(3) * SOUND / (GRAVITY * DEPTH),
    }  # fmt: skip
    return Result(values)


def tank(
    context: Context, kind: str, dim: int, cells: tuple[int, int], support: float, shake: float, shifted: bool,
    backend: str,
) -> Result:  # fmt: skip
    """Water 1 m deep, `cells` wide and deep, from the lattice or shaken by `shake` spacings, for 4 s.

    moving  root mean square speed at the end over the sound speed; slope  of p over rho g, level  twice the mean height
    over the depth, weight  of the liquid that the walls carry, means of the last half second (weight with extrapolated
    walls only); stops  at the planes of the box
    """
    spacing, up = DEPTH / cells[1], dim - 1
    viscosity = ARTIFICIAL * 0.5 * support * spacing * SOUND / (2 * (dim + 2))
    liquid = _liquid(kind, SOUND, viscosity)
    shifting = (ParticleShifting(),) if shifted else ()
    simulation = _shaken(context.simulation(_water(dim, cells, support, liquid, *shifting), backend), shake)
    total = simulation.field("mass").sum() * GRAVITY
    seen: list[tuple[float, float, float]] = []

    def sample(simulation: Simulation, wall: float) -> None:
        height, pressure = simulation.field("position")[:, up], simulation.field("pressure")
        inner = (height > 3 * spacing) & (height < DEPTH - 3 * spacing)
        slope = -float(np.polyfit(height[inner], pressure[inner], 1)[0]) / (DENSITY * GRAVITY)
        weight = float(pushed(simulation)[up]) / total if kind != "papers" else math.nan
        seen.append((slope, 2 * float(height.mean()) / DEPTH, weight))

    advance(simulation, [UNTIL - MEAN + 0.02 * k for k in range(1 + round(MEAN / 0.02))], sample, context)
    slope, level, weight = np.mean(seen, axis=0)
    values = {
        "kind": kind, "dim": dim, "cells": cells[1], "support": support, "shake": shake, "shifted": shifted,
        "particles": simulation.count, "moving": _still(simulation) / SOUND, "slope_off": abs(float(slope) - 1),
        "level_off": abs(float(level) - 1), "stops": simulation.stopped_at_walls,
    }  # fmt: skip
    if kind != "papers":
        values["weight_off"] = abs(float(weight) - 1)
    return Result(values)


def pushed(simulation: Simulation) -> NDArray:
    """Force of walls with an extrapolated pressure on liquid and solids (3,) [N]."""
    plan, operation = simulation.plan, REGISTRY["adami_2012.wall_force"]
    given = {"walls": plan.walls, "smoothing": plan.shared["gradient_smoothing"], "fluid": plan.shared["fluid"]}
    names = operation.arguments("numpy")
    fields = {name: simulation.field(name) for name in names if name in plan.fields}
    push, _ = operation.program("numpy")(*((given | fields).get(name) for name in names))["acceleration"]
    return simulation.field("mass") @ push


def vortices(context: Context, kind: str, cells: int, support: float, backend: str) -> Result:
    """Taylor-Green vortices, U = 1 m/s, in a periodic box of 1 m at Re 100 for 1 s; those that rest are shifted.

    error  L2 of the velocity over the exact field's; rate_off  of the decay, over 8 pi^2/Re, off 1
    """
    spacing, sound, k = 1.0 / cells, 10.0, 2 * math.pi
    liquid = _liquid(kind, sound, 1 / REYNOLDS, clamp=False)
    effects = (liquid, ParticleShifting(surface="none")) if kind != "papers" else (liquid,)
    scene = Scene(
        name="vortices", dim=2, dtype="float64", spacing=spacing, support_radius=support * spacing,
        period=(1.0, 1.0, 0.0), fluid=(Box(cells=(cells, cells, 1)),), effects=effects,
    )  # fmt: skip

    simulation = context.simulation(scene, backend)
    x = simulation.field("position")
    velocity = np.zeros_like(x)
    velocity[:, :2] = vortex(x, 0.0, REYNOLDS)
    simulation.set_field("velocity", velocity)
    if kind != "papers":
        excess = -0.25 * DENSITY * np.cos(2 * k * x[:, :2]).sum(1) / sound**2
        simulation.set_field("advanced_excess", excess)
    advance(simulation, [1.0], lambda simulation, wall: None, context)
    half = 0.5 * simulation.previous_length
    velocity = simulation.field("velocity") + half * simulation.field("acceleration")
    x, time = simulation.field("position"), simulation.time
    size = float(np.linalg.norm(velocity) / np.linalg.norm(vortex(x, 0.0, REYNOLDS)))
    values = {
        "kind": kind, "cells": cells, "support": support, "particles": simulation.count,
        "error": vortex_error(x, velocity, time, REYNOLDS),
        "rate_off": abs(-math.log(size) / time / (2 * k**2 / REYNOLDS) - 1),
    }  # fmt: skip
    return Result(values)


def wave(context: Context, kind: str, cells: int, support: float, water: bool, backend: str) -> Result:
    """A standing wave of half a wave length in a closed box, `cells` particles deep, as in the experiment `solutions`.

    period_off, decay_off  of the fit A exp(-gamma t) cos(omega t + phase), over linear theory, off 1; error  root mean
    square of the part of the velocity in the flow of the start - the theory's, over the theory's; damping  2 pi/omega
    times gamma - 2 nu k^2; `water` has its own viscosity and shifts
    """
    length, depth, (viscosity, periods) = 1.0, 0.5, WATER if water else VISCOUS
    spacing, sound, k = depth / cells, 10 * math.sqrt(GRAVITY * depth), math.pi / length
    omega, gamma = exact.wave(k, depth, GRAVITY, viscosity, "central")
    flow = standing_flow(k, depth)
    lattice = Discretisation(2, "float64", spacing, support * spacing, 0)
    position = Box(cells=(2 * cells, cells, 1)).positions(lattice)
    scene = Scene(
        name="wave", dim=2, dtype="float64", spacing=spacing, support_radius=support * spacing,
        fluid=(Cloud(position=position, velocity=CREST * omega * flow(position)),),
        effects=(
            _liquid(kind, sound, viscosity), Gravity(acceleration=(0.0, -GRAVITY, 0.0)),
            _walls(kind, (length, 2 * depth, 0.0)), *((ParticleShifting(),) if water else ()),
        ),
    )  # fmt: skip
    simulation = context.simulation(scene, backend)
    time, part = _projected(context, simulation, flow, np.linspace(0, periods * 2 * math.pi / omega, 1 + 40 * periods))
    part /= CREST * omega
    period, decay, theory = exact.beside_linear(time, part, k, depth, GRAVITY, viscosity, sound, "central")
    rate, often = exact.fitted(time, part, gamma, omega)
    values = {
        "kind": kind, "cells": cells, "support": support, "shifted": water, "particles": simulation.count,
        "period_off": abs(period - 1), "decay_off": abs(decay - 1),
        "error": float(np.linalg.norm(part - theory) / np.linalg.norm(theory)),
        "damping": 2 * math.pi * (rate - gamma) / often,
    }  # fmt: skip
    return Result(values)


ICE = 917.0  # kg/m^3
ADDED = 0.68  # mass of water that a cube carries along, over that of its volume: DNV-RP-C205, table D-2


def submerged(
    body: tuple[int, int], bottom: int, cells: tuple[int, int], support: float, artificial: float
) -> Scene:  # fmt: skip
    """Ice, `body` cells wide and high, `bottom` cells above the floor of a tank of water 1 m deep, `cells` wide, deep.

    artificial  alpha of the artificial viscosity that has the same kinematic viscosity
    """
    wide, deep = cells
    spacing = DEPTH / deep
    low = np.array([(wide - body[0]) // 2] * 2 + [bottom])
    high = low + [body[0], body[0], body[1]]
    lattice = np.indices((wide, wide, deep)).reshape(3, -1).T
    water = lattice[((lattice < low) | (lattice >= high)).any(1)]
    viscosity = artificial * 0.5 * support * spacing * SOUND / 10
    width = wide * spacing
    return Scene(
        name="solid", dtype="float64", spacing=spacing, support_radius=support * spacing,
        solid=(SolidBox(lower=tuple(low * spacing), upper=tuple(high * spacing), density=ICE),),
        fluid=(Cloud(position=(water + 0.5) * spacing),),
        effects=(
            _liquid("rests", SOUND, viscosity), Gravity(acceleration=(0.0, 0.0, -GRAVITY)),
            _walls("rests", (width, width, 2 * DEPTH)), ShapeMatching(), TwoWayCoupling(),
        ),
    )  # fmt: skip


def draught(water: NDArray, middle: float, edge: int, wide: int, spacing: float) -> float:
    """Share of a cube's edge below the level of the water far from it; `edge` and `wide` (of the tank) in cells.

    water (n, 3) [m]; middle  height of the cube's centre [m]
    """
    far = np.abs(water[:, :2] - 0.5 * wide * spacing).max(1) > (0.5 * edge + 1) * spacing
    layer = (wide**2 - (edge + 2) ** 2) // 2
    level = np.sort(water[far, 2])[-layer:].mean() + 0.5 * spacing
    return float(level - middle) / (edge * spacing) + 0.5


def ice(
    context: Context, edge: int, bottom: int, cells: tuple[int, int], falls: float, artificial: float, backend: str
) -> Result:
    """A cube of ice, released `bottom` cells above the floor, for `falls` times sqrt(edge/g).

    rise_off  2 z/t^2 at the end over g (rho_w - rho_i)/(rho_i + C rho_w), off 1; afloat_off  share of the cube's edge
    below the level of the water far from it, mean of the last quarter, off rho_i/rho_w
    """
    simulation = context.simulation(submerged((edge, edge), bottom, cells, 3.0, artificial), backend)
    count, spacing = edge**3, DEPTH / cells[1]
    until = falls * math.sqrt(edge * spacing / GRAVITY)
    start = simulation.field("position")[:count, 2].mean()
    shares: list[float] = []

    def sample(simulation: Simulation, wall: float) -> None:
        x = simulation.field("position")
        shares.append(draught(x[count:], x[:count, 2].mean(), edge, cells[0], spacing))

    advance(simulation, np.linspace(0, until, 41).tolist(), sample, context)
    rise = 2 * float(simulation.field("position")[:count, 2].mean() - start) / simulation.time**2
    wanted = GRAVITY * (DENSITY - ICE) / (ICE + ADDED * DENSITY)
    values = {
        "kind": "ice", "cells": edge, "support": 3.0, "particles": simulation.count,
        "rise_off": abs(rise / wanted - 1), "afloat_off": abs(float(np.mean(shares[-10:])) - ICE / DENSITY),
    }  # fmt: skip
    return Result(values)


def beside_mesh(offset: float, slope: bool, wide: int, deep: int, folder: str) -> Scene:
    """Water 1 m deep in a box on a mesh: a floor `offset` d above its planes, or a slope of 45 degrees from 6 d on.

    The slope lies between two diagonal rows of the lattice, so that the water of the first row fills what is below it.
    """
    spacing, far = DEPTH / deep, 8 * DEPTH / deep
    long = deep + 10 if slope else wide
    box = np.array([long, wide, 0]) * spacing
    if slope:
        toe, end = 6.5 * spacing, box[0] + far
        flat = [(toe, 0.0), (end, end - toe), (end, 0.0)]
        mesh = trimesh.convex.convex_hull([(x, y, z) for x, z in flat for y in (-far, box[1] + far)])
    else:
        toe, mesh = 0.0, trimesh.creation.box(bounds=[[-far] * 3, box + [far, far, offset * spacing]])
    file = f"{folder}/mesh.obj"
    write_file(file, mesh.export(file_type="obj"))
    x = (np.indices((long, wide, deep)).reshape(3, -1).T + 0.5 + [0.0, 0.0, 0.0 if slope else offset]) * spacing
    x = x[x[:, 2] > x[:, 0] - toe] if slope else x
    places = [(toe + z, box[1] / 2, z) if slope else (z, box[1] / 2, offset * spacing) for z in HEIGHTS]
    every = {"every": 0.01}
    return Scene(
        name="mesh", dtype="float64", spacing=spacing, support_radius=3 * spacing, fluid=(Cloud(position=x),),
        gauge=(
            *(Gauge(name=f"point_{k}", kind="pressure", at=at, **every) for k, at in enumerate(places)),
            *(Gauge(name=on, kind="force", on=on, **every) for on in ("mesh_boundary", "box_walls")),
        ),
        effects=(
            _liquid("rests", SOUND, ARTIFICIAL * 1.5 * spacing * SOUND / 10),
            Gravity(acceleration=(0.0, 0.0, -GRAVITY)),
            BoxWalls(
                lower=(0.0, 0.0, 0.0), upper=(*box[:2], 2 * DEPTH), model="extrapolated",
                open_faces=() if slope else ("-z",),
            ),
            MeshBoundary(file=file, model="extrapolated"),
        ),
    )  # fmt: skip


def on_mesh(context: Context, offset: float, slope: bool, wide: int, deep: int, backend: str) -> Result:
    """Water at rest on a mesh for 1.5 s; means of the last 0.4 s.

    mesh_weight_off  weight on mesh and box, mesh_pressure_off  mean of p over rho g depth at five places of the mesh,
    both off 1; moving  root mean square speed over the sound speed
    """
    with tempfile.TemporaryDirectory() as folder:
        simulation = context.simulation(beside_mesh(offset, slope, wide, deep, folder), backend)
        advance(simulation, np.linspace(0, 1.5, 31).tolist(), lambda simulation, wall: None, context)

    def late(name: str, column: str) -> float:
        series = simulation.gauge(name)
        return float(series[column][series.time > 1.1].mean())

    spacing, mass = DEPTH / deep, float(simulation.field("mass").sum())
    level, toe = DEPTH + offset * spacing, 6.5 * spacing
    if slope:  # that of the water's volume
        level = math.sqrt(toe**2 + 2 * mass / (DENSITY * wide * spacing)) - toe
    shares = [
        late(f"point_{k}", "pressure") / (DENSITY * GRAVITY * (level - (z if slope else offset * spacing)))
        for k, z in enumerate(HEIGHTS)
    ]
    push = late("mesh_boundary", "force_z") + late("box_walls", "force_z")
    values = {
        "kind": "mesh", "cells": deep, "support": 3.0, "slope": slope, "offset": offset,
        "particles": simulation.count, "mesh_weight_off": abs(-push / (mass * GRAVITY) - 1),
        "mesh_pressure_off": abs(float(np.mean(shares)) - 1), "moving": _still(simulation) / SOUND,
    }  # fmt: skip
    return Result(values)


HEIGHTS = (0.2, 0.35, 0.5, 0.65, 0.8)  # m over the floor, of places on a slope; along a floor
ON_MESH = ((0.0, False, 10, 8), (0.3, False, 10, 8), (0.0, True, 10, 16))  # offset, slope, cells wide and deep
# dim, cells (wide, deep), h/d, shaken by [d], shifted
TANKS = (
    (2, (16, 16), 2.6, 0.0, False), (2, (16, 16), 3.0, 0.0, False), (2, (16, 16), 4.0, 0.0, False),
    (2, (16, 16), 3.2, 0.1, False), (2, (16, 16), 3.2, 0.1, True), (2, (20, 100), 3.2, 0.0, False),
    (3, (8, 8), 2.6, 0.0, False), (3, (8, 8), 3.0, 0.1, False), *((2, (n, n), 3.0, 0.0, False) for n in (8, 32, 64)),
)  # fmt: skip
OF_CORRECTED = ((2, (32, 32), 2.6, 0.0, False), (2, (32, 32), 3.0, 0.0, False), (2, (32, 32), 3.2, 0.1, True))
OF_PAPERS = (*((2, (n, n), 2.6, 0.0, False) for n in (8, 16, 32)), (3, (8, 8), 2.6, 0.0, False))
SIDES, VORTICES_SUPPORT = (25, 50, 100), 3.2
DEPTHS, WAVE_SUPPORT = (10, 20, 40), 3.2  # at which the lattice resists shear least
WAVES = (*(("wave", deep) for deep in DEPTHS), ("water", 24), ("water", 48))
COLUMNS = ((20, 100), (60, 100))


def planned(options: Options) -> list[RunSpec]:
    """Tanks, vortices and waves of three sizes; with --quick one tank and the smallest vortices."""
    made = [_tank("rests", *row) for row in TANKS] + [_tank("papers", *row) for row in OF_PAPERS]
    made += [_tank(CORRECTED, *row) for row in OF_CORRECTED]
    for kind in (*LIQUIDS, CORRECTED):
        for cells in SIDES:
            flow = {"kind": kind, "cells": cells, "support": VORTICES_SUPPORT, "backend": "cpu"}
            made.append(RunSpec(f"vortices_{kind}_{cells}", vortices, flow, estimate=2e-5 * cells**3))
        for name, cells in WAVES[: len(DEPTHS) if kind == "papers" else None]:
            flow = {"kind": kind, "cells": cells, "support": WAVE_SUPPORT, "water": name == "water", "backend": "cpu"}
            made.append(RunSpec(f"{name}_{kind}_{cells}", wave, flow, estimate=6e-4 * cells**3))
    for wide, deep in COLUMNS:
        row = {"cells": (wide, deep), "support": 3.0, "backend": "cpu"}
        made.append(RunSpec(f"column_{wide}_{deep}", column, row, estimate=0.02 * wide * deep))
    for offset, slope, wide, deep in ON_MESH:
        name = f"mesh_{'slope' if slope else 'floor'}_{deep}" + ("_cut" if offset else "")
        row = {"offset": offset, "slope": slope, "wide": wide, "deep": deep, "backend": "cpu"}
        made.append(RunSpec(name, on_mesh, row, estimate=0.003 * deep**3))
    for name, bottom, cells, falls, artificial in (
        ("rise_5", 5, (20, 15), 1.5, 0.005),
        ("float_5", 5, (20, 10), 20, 0.05),
    ):
        row = {"edge": 5, "bottom": bottom, "cells": cells, "falls": falls, "artificial": artificial, "backend": "cpu"}
        made.append(RunSpec(name, ice, row, estimate=5.0 * falls))
    quick = ("tank_rests_2d_16_3", f"vortices_rests_{SIDES[0]}", f"vortices_papers_{SIDES[0]}")
    return [run for run in made if run.key in quick] if options.quick else made


def _tank(kind: str, dim: int, cells: tuple[int, int], support: float, shake: float, shifted: bool) -> RunSpec:
    name = f"tank_{kind}_{dim}d_{cells[1]}_{support:g}{'_shaken' * (shake > 0)}{'_shifted' * shifted}"
    row = {"kind": kind, "dim": dim, "cells": cells, "support": support, "shake": shake, "shifted": shifted}
    return RunSpec(name, tank, row | {"backend": "cpu"}, estimate=0.03 * cells[0] ** (dim - 1) * cells[1])


WORDS = {  # what a run is, by the first word of its key
    "tank": "{dim}D, {kind}, {cells} cells, h = {support:g} d",
    **dict.fromkeys(("vortices", "wave", "water"), "{kind}, {cells} cells, h = {support:g} d"),
    "column": "{wide} x {cells} cells",
    "mesh": "{offset:g} d off the lattice, {cells} cells deep",
    **dict.fromkeys(("rise", "float"), "an edge of {cells} cells"),
}


def checks(results: Results, check: Checks) -> None:
    """The bars hold for the liquid that rests; the papers' values are shown."""
    check.seconds(results)
    check.of_runs(results, lambda key, row: WORDS[key.partition("_")[0]].format(**row))
    for flow, sizes, names in (("vortices", SIDES, ("error",)), ("wave", DEPTHS, ("period_off", "decay_off"))):
        rests = [results[key].values for size in sizes if (key := f"{flow}_rests_{size}") in results]
        for name in names if len(rests) == len(sizes) else ():
            rise = order([1 / size for size in sizes], [row[name] for row in rests])
            check(f"{flow}_order", rise, name, f"from {sizes[0]} to {sizes[-1]} cells")


EXPERIMENT = Experiment(
    name="liquid", title="tanks, vortices and waves with the papers' liquid and with one that rests", runs=planned,
    checks=checks,
)  # fmt: skip
