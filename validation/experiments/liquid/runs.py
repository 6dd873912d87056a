"""Tanks, columns, vortices and waves with the papers' liquid and with one that rests (docs/liquid.md).

Lengths in m, rho0 = 1000 kg/m^2 or kg/m^3, float64, Wendland C2, sound speed ten times the largest speed. All start on
the lattice, with the density of rest where the density is advanced.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import (
    Box,
    BoxWalls,
    Cloud,
    Gravity,
    ParticleShifting,
    Scene,
    Simulation,
    SurfaceDetection,
    WeaklyCompressible,
)
from refsim.core.effect import Discretisation
from refsim.core.operation import REGISTRY
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, Run
from validation.experiments.solutions import scene as exact
from validation.results import Result
from validation.running import Context, advance

DENSITY, GRAVITY, DEPTH = 1000.0, 9.81, 1.0  # kg/m^2 or kg/m^3, m/s^2, m
SOUND = 10 * math.sqrt(GRAVITY * DEPTH)  # m/s
ARTIFICIAL = 0.02  # alpha of the artificial viscosity that has the tanks' kinematic viscosity
UNTIL, MEAN = 4.0, 0.5  # s; length of the mean at the end
SEED = 3
REYNOLDS, CREST, WAVE_VISCOSITY, PERIODS = 100.0, 0.02, 0.012, 4  # U/nu of the vortices' box; wave: m, m^2/s
LIQUIDS = ("papers", "rests")  # summed density and mirrored walls; advanced density and extrapolated walls


def _liquid(kind: str, sound: float, viscosity: float, clamp: bool = True) -> WeaklyCompressible:
    own: dict[str, Any] = {"density": "continuity"} if kind == "rests" else {"clamp_pressure": clamp}
    return WeaklyCompressible(
        rest_density=DENSITY, sound_speed=sound, dynamic_viscosity=DENSITY * viscosity, viscosity="central", **own
    )


def _walls(kind: str, upper: tuple[float, float, float]) -> BoxWalls:
    return BoxWalls(lower=(0.0, 0.0, 0.0), upper=upper, model="extrapolated" if kind == "rests" else "mirrored")


def _shifting(shifted: bool) -> tuple:
    return (SurfaceDetection(), ParticleShifting()) if shifted else ()


def _still(simulation: Simulation) -> float:
    """Root mean square speed [m/s]."""
    return float(np.sqrt((simulation.field("velocity") ** 2).sum(1).mean()))


def tank(
    context: Context, kind: str, dim: int, cells: tuple[int, int], support: float, shake: float, shifted: bool,
    backend: str,
) -> Result:  # fmt: skip
    """Water 1 m deep, `cells` wide and deep, from the lattice or shaken by `shake` spacings, for 4 s.

    moving  root mean square speed at the end over the sound speed; slope  of p over rho g, level  twice the mean height
    over the depth, weight  of the liquid that the walls carry, means of the last half second (weight with extrapolated
    walls only); stops  at the planes of the box
    """
    wide, deep = cells
    spacing, up = DEPTH / deep, dim - 1
    pull, upper = np.zeros(3), np.full(3, wide * spacing)
    pull[up], upper[up] = -GRAVITY, 2 * DEPTH
    viscosity = ARTIFICIAL * 0.5 * support * spacing * SOUND / (2 * (dim + 2))
    scene = Scene(
        name="tank", dim=dim, dtype="float64", spacing=spacing, support_radius=support * spacing,  # type: ignore[arg-type]
        fluid=(Box(cells=(wide, deep, 1) if dim == 2 else (wide, wide, deep)),),
        effects=(
            _liquid(kind, SOUND, viscosity), Gravity(acceleration=tuple(pull)), _walls(kind, tuple(upper)),
            *_shifting(shifted),
        ),
    )  # fmt: skip
    simulation = context.simulation(scene, backend)
    moves = np.random.default_rng(SEED).uniform(-shake, shake, (simulation.count, 3)) * spacing
    moves[:, dim:] = 0
    simulation.set_field("position", simulation.field("position") + moves)
    total = simulation.count * spacing**dim * DENSITY * GRAVITY
    seen: list[tuple[float, float, float]] = []

    def sample(simulation: Simulation, wall: float) -> None:
        height, pressure = simulation.field("position")[:, up], simulation.field("pressure")
        inner = (height > 3 * spacing) & (height < DEPTH - 3 * spacing)
        slope = -float(np.polyfit(height[inner], pressure[inner], 1)[0]) / (DENSITY * GRAVITY)
        weight = float(pushed(simulation)[up]) / total if kind == "rests" else math.nan
        seen.append((slope, 2 * float(height.mean()) / DEPTH, weight))

    advance(simulation, [UNTIL - MEAN + 0.02 * k for k in range(1 + round(MEAN / 0.02))], sample, context)
    slope, level, weight = np.mean(seen, axis=0)
    values = {
        "kind": kind, "dim": dim, "cells": deep, "support": support, "shake": shake, "shifted": shifted,
        "particles": simulation.count, "moving": _still(simulation) / SOUND, "slope_off": abs(float(slope) - 1),
        "level_off": abs(float(level) - 1), "stops": simulation.stopped_at_walls,
    }  # fmt: skip
    if kind == "rests":
        values["weight_off"] = abs(float(weight) - 1)
    return Result(values)


def pushed(simulation: Simulation) -> NDArray:
    """Force of walls with an extrapolated pressure on the liquid (3,) [N]."""
    plan, operation = simulation.plan, REGISTRY["adami_2012.wall_force"]
    given: dict[str, Any] = {n: simulation.field(n) for n in ("position", "density", "pressure", "wall_pressure")}
    given |= {"walls": plan.walls, "smoothing": plan.shared["gradient_smoothing"], "period": None}
    push = operation.program("numpy")(*(given[name] for name in operation.arguments("numpy")))
    return simulation.field("mass") @ push["acceleration"][0]


def vortices(context: Context, kind: str, cells: int, support: float, backend: str) -> Result:
    """Taylor-Green vortices, U = 1 m/s, in a periodic box of 1 m at Re 100 for 1 s; those that rest are shifted.

    error  L2 of the velocity over the exact field's; rate_off  of the decay, over 8 pi^2/Re, off 1
    """
    spacing, sound, k = 1.0 / cells, 10.0, 2 * math.pi
    liquid = _liquid(kind, sound, 1 / REYNOLDS, clamp=False)
    effects = (liquid, ParticleShifting(surface="none")) if kind == "rests" else (liquid,)
    scene = Scene(
        name="vortices", dim=2, dtype="float64", spacing=spacing, support_radius=support * spacing,
        period=(1.0, 1.0, 0.0), fluid=(Box(cells=(cells, cells, 1)),), effects=effects,
    )  # fmt: skip

    def flow(x: NDArray, time: float) -> NDArray:
        made = np.zeros_like(x)
        made[:, 0] = -np.cos(k * x[:, 0]) * np.sin(k * x[:, 1])
        made[:, 1] = np.sin(k * x[:, 0]) * np.cos(k * x[:, 1])
        return made * math.exp(-2 * k**2 / REYNOLDS * time)

    simulation = context.simulation(scene, backend)
    x = simulation.field("position")
    simulation.set_field("velocity", flow(x, 0.0))
    if kind == "rests":
        excess = -0.25 * DENSITY * np.cos(2 * k * x[:, :2]).sum(1) / sound**2
        simulation.set_field("advanced_excess", excess)
    advance(simulation, [1.0], lambda simulation, wall: None, context)
    half = 0.5 * simulation.previous_length
    velocity = simulation.field("velocity") + half * simulation.field("acceleration")
    x, time = simulation.field("position"), simulation.time
    size = float(np.linalg.norm(velocity) / np.linalg.norm(flow(x, 0.0)))
    values = {
        "kind": kind, "cells": cells, "support": support, "particles": simulation.count,
        "error": float(np.linalg.norm(velocity - flow(x, time)) / np.linalg.norm(flow(x, time))),
        "rate_off": abs(-math.log(size) / time / (2 * k**2 / REYNOLDS) - 1),
    }  # fmt: skip
    return Result(values)


def wave(context: Context, kind: str, cells: int, support: float, shifted: bool, backend: str) -> Result:
    """A standing wave of half a wave length in a closed box, `cells` particles deep, as in the experiment `solutions`.

    period_off, decay_off  of the fit A exp(-gamma t) cos(omega t + phase), over linear theory, off 1
    """
    length, depth = 1.0, 0.5
    spacing, sound, k = depth / cells, 10 * math.sqrt(GRAVITY * depth), math.pi / length
    omega, gamma = exact.wave(k, depth, GRAVITY, WAVE_VISCOSITY, "central")

    def flow(x: NDArray) -> NDArray:
        made = np.zeros_like(x)
        made[:, 0] = -np.sin(k * x[:, 0]) * np.cosh(k * x[:, 1]) / math.sinh(k * depth)
        made[:, 1] = np.cos(k * x[:, 0]) * np.sinh(k * x[:, 1]) / math.sinh(k * depth)
        return made

    lattice = Discretisation(2, "float64", spacing, support * spacing, 0)
    position = Box(cells=(2 * cells, cells, 1)).positions(lattice)
    scene = Scene(
        name="wave", dim=2, dtype="float64", spacing=spacing, support_radius=support * spacing,
        fluid=(Cloud(position=position, velocity=CREST * omega * flow(position)),),
        effects=(
            _liquid(kind, sound, WAVE_VISCOSITY), Gravity(acceleration=(0.0, -GRAVITY, 0.0)),
            _walls(kind, (length, 2 * depth, 0.0)), *_shifting(shifted),
        ),
    )  # fmt: skip
    simulation = context.simulation(scene, backend)
    found: list[tuple[float, float]] = []

    def sample(simulation: Simulation, wall: float) -> None:
        u = flow(simulation.field("position"))
        found.append((simulation.time, float((simulation.field("velocity") * u).sum() / (u * u).sum())))

    advance(simulation, np.linspace(0, PERIODS * 2 * math.pi / omega, 161).tolist(), sample, context)
    time, part = np.array(found).T
    _, decay, rate, _ = exact.fitted(time, part, gamma, omega)
    values = {
        "kind": kind, "cells": cells, "support": support, "shifted": shifted, "particles": simulation.count,
        "period_off": abs(omega / rate - 1), "decay_off": abs(decay / gamma - 1),
    }  # fmt: skip
    return Result(values)


# dim, cells (wide, deep), h/d, shaken by [d], shifted
TANKS = (
    (2, (16, 16), 2.6, 0.0, False), (2, (16, 16), 3.0, 0.0, False), (2, (16, 16), 4.0, 0.0, False),
    (2, (16, 16), 3.2, 0.1, False), (2, (16, 16), 3.2, 0.1, True), (2, (20, 100), 3.2, 0.0, False),
    (3, (8, 8), 2.6, 0.0, False), (3, (8, 8), 3.0, 0.1, False),
)  # fmt: skip
OF_PAPERS = ((2, (16, 16), 2.6, 0.0, False), (3, (8, 8), 2.6, 0.0, False))
SIDES, VORTICES_SUPPORT = (25, 50, 100), 3.2
DEPTHS, WAVE_SUPPORT = (10, 20, 40), 3.0


def planned(options: Options) -> list[Run]:
    """Tanks, vortices and waves of three sizes; with --quick one tank and the smallest vortices."""
    made = [_tank("rests", *row) for row in TANKS] + [_tank("papers", *row) for row in OF_PAPERS]
    for kind in LIQUIDS:
        for cells in SIDES:
            flow = {"kind": kind, "cells": cells, "support": VORTICES_SUPPORT, "backend": "cpu"}
            made.append(Run(f"vortices_{kind}_{cells}", vortices, flow, estimate=2e-5 * cells**3))
        for cells in DEPTHS:
            flow = {"kind": kind, "cells": cells, "support": WAVE_SUPPORT, "shifted": False, "backend": "cpu"}
            made.append(Run(f"wave_{kind}_{cells}", wave, flow, estimate=4e-4 * cells**3))
    quick = ("tank_rests_2d_16_3", f"vortices_rests_{SIDES[0]}", f"vortices_papers_{SIDES[0]}")
    return [run for run in made if run.key in quick] if options.quick else made


def _tank(kind: str, dim: int, cells: tuple[int, int], support: float, shake: float, shifted: bool) -> Run:
    words = (
        f"tank_{kind}_{dim}d_{cells[1]}_{support:g}" + ("_shaken" if shake else "") + ("_shifted" if shifted else "")
    )
    row = {"kind": kind, "dim": dim, "cells": cells, "support": support, "shake": shake, "shifted": shifted}
    return Run(words, tank, row | {"backend": "cpu"}, estimate=0.03 * cells[0] ** (dim - 1) * cells[1])


def checks(results: Results, check: Checks) -> None:
    """The bars hold for the liquid that rests; the papers' values are shown."""
    for key, result in results.items():
        row, papers = result.values, result.values["kind"] == "papers"
        where = f"{'papers' if papers else 'rests'}, {row['cells']} cells, h = {row['support']:g} d"
        if key.startswith("tank"):
            for name in ("moving", "level_off", "stops", *(() if papers else ("weight_off",))):
                check(f"papers_{name}" if papers else name, row[name], key, f"{row['dim']}D, {where}")
            name = "slope_off" if row["support"] >= 3 else "slope_off_narrow"
            check("papers_slope_off" if papers else name, row["slope_off"], key, f"{row['dim']}D, {where}")
        elif key.startswith("vortices"):
            names = {25: "error_25", 50: "error_50", 100: "error_100"}
            check("papers_error" if papers else names[row["cells"]], row["error"], key, where)
            check("papers_rate_off" if papers else "rate_off", row["rate_off"], key, where)
        elif row["cells"] == DEPTHS[-1] or papers:
            for name in ("period_off", "decay_off"):
                check(f"papers_{name}" if papers else name, row[name], key, where)


EXPERIMENT = Experiment(
    name="liquid",
    title="tanks, vortices and waves with the papers' liquid and with one that rests",
    runs=planned,
    checks=checks,
)
