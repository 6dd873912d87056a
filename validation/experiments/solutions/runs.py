"""Runs of the base SPH liquid in 2D against solutions of its equations. Lengths in m, rho0 = 1000 kg/m^2.

Columns and discs start at the positions of equal masses in hydrostatic balance, p = c^2 (rho - rho0), so that no
pressure wave of the start covers what is measured. The sound speed is ten times the largest speed of the problem.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Ball, Box, BoxWalls, Cloud, Gravity, Scene, Simulation, WeaklyCompressible
from refsim.core.effect import Discretisation
from validation.experiments.solutions import exact
from validation.results import Result
from validation.running import Context, advance

DENSITY, SUPPORT = 1000.0, 2.6  # kg/m^2; h/d
GRAVITY = 9.81  # m/s^2
NUMERICAL = 1 / 200  # kinematic viscosity over c h where the solution has none: above the least of docs/stability.md
STEP = 0.3  # c dt/h of a fixed step

HEIGHT, WIDTH, SETTLED, MEANS = 1.0, 0.5, 2.0, 400  # tank: m, m, s until the mean, samples in it
LENGTH, DEPTH, CREST, WAVE_VISCOSITY, PERIODS = 1.0, 0.5, 0.02, 0.012, 4  # wave: m, m, m, m^2/s
MACH = 0.1  # Omega R/c of the discs
PULL, STRAIN, SWINGS = 1.0, 0.5, 2.0  # ellipse: Omega [1/s], sigma at the start [1/s], periods 2 pi/(sqrt(2) Omega)
SPIN, SPIN_VISCOSITY, SPUN = 0.2, 0.05, 6.0  # disc: omega [1/s], m^2/s, s
REYNOLDS, MIXED, BACKGROUND = 50.0, 2.0, 1.0  # Taylor-Green: pi U/(nu k), U k t/pi at the end, pressure over rho0 U^2


# Plates (Morris, Fox & Zhu, J. Comput. Phys. 136 (1997) 214): m, m^2/s, m/s, m/s, samples over H^2/nu
GAP, PLATE_VISCOSITY, PLATE_SPEED, PLATE_SOUND = 1e-3, 1e-6, 1.25e-5, 2.5e-4
SAMPLES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
STICKING = 2.0  # wall friction over the liquid's viscosity: the velocity is odd about the wall


def _scene(
    name: str,
    spacing: float,
    fluid: tuple,
    effects: tuple,
    sound: float,
    viscosity: float,
    form: str,
    step: float = 0.0,
    clamp: bool = True,
    period: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Scene:
    """A scene in 2D of the base liquid with kinematic viscosity `viscosity` [m^2/s]."""
    liquid = WeaklyCompressible(
        rest_density=DENSITY,
        sound_speed=sound,
        dynamic_viscosity=DENSITY * viscosity,
        viscosity=form,  # type: ignore[arg-type]
        clamp_pressure=clamp,
    )
    return Scene(
        name=name,
        dim=2,
        dtype="float64",
        spacing=spacing,
        support_radius=SUPPORT * spacing,
        step=step,
        period=period,
        fluid=fluid,
        effects=(liquid, *effects),
    )


def _column(spacing: float, cells: tuple[int, int], sound: float) -> tuple[NDArray, float]:
    """(positions of a column of cells in hydrostatic balance, its height [m])."""
    position = Box(cells=(*cells, 1)).positions(Discretisation(2, "float64", spacing, SUPPORT * spacing, 0))
    position[:, 1], top = exact.compressed(position[:, 1], cells[1] * spacing, GRAVITY, sound)
    return position, top


def tank(context: Context, cells: int, backend: str) -> Result:
    """Pressure of a tank at rest, `cells` particles high, in the mean of `MEANS` samples after `SETTLED`.

    error  root mean square of p - p_exact, over rho0 g H; bulk  the same farther than h from surface and floor
    moving  largest root mean square speed of the samples, over sqrt(g H)
    """
    spacing, sound = HEIGHT / cells, 10 * math.sqrt(GRAVITY * HEIGHT)
    position, top = _column(spacing, (round(WIDTH / spacing), cells), sound)
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(WIDTH, 2 * HEIGHT, 0.0), open_faces=("+y",))
    effects = (Gravity(acceleration=(0.0, -GRAVITY, 0.0)), walls)
    viscosity = NUMERICAL * sound * SUPPORT * spacing
    simulation = context.simulation(
        _scene("tank", spacing, (Cloud(position=position),), effects, sound, viscosity, "laplacian"), backend
    )
    heights, pressures, speeds = [], [], []

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        heights.append(simulation.field("position")[:, 1])
        pressures.append(simulation.field("pressure"))
        speeds.append(math.sqrt((simulation.field("velocity") ** 2).sum(1).mean()))

    advance(simulation, [SETTLED * (1 + k / MEANS) for k in range(MEANS)], sample, context)
    height, pressure = np.mean(heights, axis=0), np.mean(pressures, axis=0)
    scale = DENSITY * GRAVITY * HEIGHT
    off = (pressure - exact.hydrostatic(height, top, DENSITY, GRAVITY, sound)) / scale
    reach = SUPPORT * spacing
    bulk = (height > reach) & (height < top - reach)
    values = {
        "cells": cells,
        "spacing": spacing,
        "particles": len(position),
        "error": _rms(off),
        "bulk": _rms(off[bulk]),
        "moving": max(speeds) / math.sqrt(GRAVITY * HEIGHT),
    }
    order = np.argsort(height)
    return Result(values, {"height": height[order], "pressure": pressure[order] / scale})


def wave(context: Context, cells: int, form: str, backend: str, crest: float = CREST) -> Result:
    """A standing wave of half a wave length in a closed box, `cells` particles deep, started by the velocities.

    Measured is the part of the velocity in the linear flow, fitted to A exp(-gamma t) cos(omega t + phase).
    crest  height of the first crest [m]
    period, decay   measured over linear theory; residual  of the fit, over A
    """
    spacing, sound = DEPTH / cells, 10 * math.sqrt(GRAVITY * DEPTH)
    position, top = _column(spacing, (round(LENGTH / spacing), cells), sound)
    k = math.pi / LENGTH
    omega, gamma = exact.wave(k, top, GRAVITY, WAVE_VISCOSITY, form)

    def flow(x: NDArray) -> NDArray:
        made = np.zeros_like(x)
        made[:, 0] = -np.sin(k * x[:, 0]) * np.cosh(k * x[:, 1]) / math.sinh(k * top)
        made[:, 1] = np.cos(k * x[:, 0]) * np.sinh(k * x[:, 1]) / math.sinh(k * top)
        return made

    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(LENGTH, 2 * DEPTH, 0.0), open_faces=("+y",))
    effects = (Gravity(acceleration=(0.0, -GRAVITY, 0.0)), walls)
    cloud = Cloud(position=position, velocity=crest * omega * flow(position))
    simulation = context.simulation(_scene("wave", spacing, (cloud,), effects, sound, WAVE_VISCOSITY, form), backend)
    time, part = _projected(context, simulation, flow, np.linspace(0, PERIODS * 2 * math.pi / omega, 161))
    amplitude, decay, rate, residual = exact.fitted(time, part, gamma, omega)
    values = {
        "cells": cells,
        "spacing": spacing,
        "form": form,
        "particles": len(position),
        "period": omega / rate,
        "decay": decay / gamma,
        "residual": residual / abs(amplitude),
    }
    values |= {"period_off": abs(values["period"] - 1), "decay_off": abs(values["decay"] - 1)}
    return Result(values, {"time": time, "part": part / (crest * omega), "theory": exact.swing(time, gamma, omega)})


def ellipse(context: Context, cells: int, backend: str, mach: float = MACH) -> Result:
    """A disc of radius 1 m, `cells` spacings, in the force -Omega^2 x, that starts with v = sigma (x, -y).

    Viscous forces along the line of centres; the sound speed is Omega R/mach. The semi-axis is twice the root mean
    square of x.
    error  root mean square of a - a_exact over R, with the numerical viscosity in the equation; inviscid  without
    period  time of the second maximum of a over the exact
    """
    spacing, sound = 1.0 / cells, PULL / mach
    position, radius = _disc(spacing, PULL**2 + STRAIN**2, sound)
    viscosity = NUMERICAL * sound * SUPPORT * spacing
    velocity = STRAIN * position * np.array([1.0, -1.0, 0.0])
    until = SWINGS * 2 * math.pi / (math.sqrt(2) * PULL)
    time, (along, across) = _pulled(context, "ellipse", spacing, sound, position, velocity, viscosity, "central", until,
                                    lambda x, v: 2 * np.sqrt((x[:, :2] ** 2).mean(0)), backend)  # fmt: skip
    a, b = exact.ellipse(time, radius, PULL, STRAIN, 2 * viscosity)
    ideal, _ = exact.ellipse(time, radius, PULL, STRAIN, 0.0)
    last = time > 0.5 * until
    values = {
        "cells": cells,
        "spacing": spacing,
        "particles": len(position),
        "radius": radius,
        "error": _rms(along - a) / radius,
        "inviscid": _rms(along - ideal) / radius,
        "period": float(exact.peak(time[last], along[last]) / exact.peak(time[last], a[last])),
    }
    values["period_off"] = abs(values["period"] - 1)
    return Result(values, {"time": time, "along": along, "across": across, "a": a, "b": b})


def disc(context: Context, cells: int, form: str, backend: str) -> Result:
    """A disc of radius 1 m, `cells` spacings, that turns as a rigid body, held together by the force -Omega^2 x.

    error  root mean square of L/L(0) - exact; rate  of log L at the end over the exact (not with the central form)
    """
    spacing, sound = 1.0 / cells, PULL / MACH
    position, radius = _disc(spacing, PULL**2 - SPIN**2, sound)
    velocity = np.cross([0.0, 0.0, SPIN], position)
    time, (momentum,) = _pulled(context, "disc", spacing, sound, position, velocity, SPIN_VISCOSITY, form, SPUN,
                                lambda x, v: np.array([np.cross(x, v)[:, 2].sum()]), backend)  # fmt: skip
    left = momentum / momentum[0]
    theory = exact.spin_down(time, SPIN_VISCOSITY / radius**2) if form == "laplacian" else np.ones_like(time)
    values = {"cells": cells, "spacing": spacing, "form": form, "particles": len(position), "radius": radius}
    values["error"] = _rms(left - theory)
    if form == "laplacian":
        values["rate"] = float(np.log(left[-1]) / np.log(theory[-1]))
        values["rate_off"] = abs(values["rate"] - 1)
    return Result(values, {"time": time, "left": left, "theory": theory})


def vortex(context: Context, cells: int, form: str, backend: str) -> Result:
    """One vortex of Taylor & Green, U = 1 m/s, in a closed box of 1 m with `cells` particles a side; its walls slip."""
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 0.0))
    return _turning(context, cells, form, backend, math.pi, (walls,), (0.0, 0.0, 0.0))


def vortices(context: Context, cells: int, form: str, backend: str, reynolds: float = REYNOLDS) -> Result:
    """Four vortices of Taylor & Green, U = 1 m/s, in a periodic box of 1 m with `cells` particles a side.

    reynolds  U/nu times the side of a vortex
    """
    return _turning(context, cells, form, backend, 2 * math.pi, (), (1.0, 1.0, 0.0), reynolds)


def _turning(
    context: Context,
    cells: int,
    form: str,
    backend: str,
    k: float,
    walls: tuple,
    period: tuple[float, float, float],
    reynolds: float = REYNOLDS,
) -> Result:
    """A flow of Taylor & Green with wave number k [1/m] in a square of 1 m, until it has decayed as in `vortex`.

    The background pressure comes of `cells`^2 particles that are heavier than the box takes at rest density.
    rate   of decay of the part of the velocity in the initial flow over 2 nu k^2
    error  root mean square of v - v_exact at the end over that of v_exact
    """
    sound, viscosity = 10.0, math.pi / k / reynolds
    until = MIXED * math.pi / k * reynolds / REYNOLDS
    width = 1.0 / cells
    spacing = width * math.sqrt(1 + BACKGROUND / sound**2)  # which sets the particles' mass
    position = Box(cells=(cells, cells, 1)).positions(Discretisation(2, "float64", width, SUPPORT * width, 0))

    def flow(x: NDArray) -> NDArray:
        made = np.zeros_like(x)
        made[:, 0] = np.sin(k * x[:, 0]) * np.cos(k * x[:, 1])
        made[:, 1] = -np.cos(k * x[:, 0]) * np.sin(k * x[:, 1])
        return made

    cloud = Cloud(position=position, velocity=flow(position))
    made = _scene("vortex", spacing, (cloud,), walls, sound, viscosity, form, clamp=False, period=period)
    simulation = context.simulation(made, backend)
    time, part = _projected(context, simulation, flow, np.linspace(0, until, 41))
    x, v = simulation.field("position"), simulation.field("velocity")
    decay = 2 * viscosity * k**2
    solution = flow(x) * math.exp(-decay * time[-1])
    values = {"cells": cells, "spacing": width, "form": form, "particles": len(position)}
    values["rate"] = float(-np.polyfit(time, np.log(part), 1)[0] / decay)
    values["rate_off"] = abs(values["rate"] - 1)
    values["error"] = float(np.linalg.norm(v - solution) / np.linalg.norm(solution))
    return Result(values, {"time": time, "part": part, "theory": np.exp(-decay * time)})


def couette(context: Context, cells: int, form: str, backend: str, friction: float = STICKING) -> Result:
    """Liquid between a plate at rest and one that begins to move, `cells` particles apart; measured as `_between`."""

    def solution(height: NDArray, time: float) -> NDArray:
        return exact.couette(height, time, GAP, PLATE_SPEED, PLATE_VISCOSITY)

    return _between(context, cells, form, backend, friction, solution, moving=True)


def poiseuille(context: Context, cells: int, form: str, backend: str, friction: float = STICKING) -> Result:
    """Liquid between two plates at rest that begins to be pushed along them; measured as `_between`."""
    push = 8 * PLATE_VISCOSITY * PLATE_SPEED / GAP**2

    def solution(height: NDArray, time: float) -> NDArray:
        return exact.poiseuille(height, time, GAP, push, PLATE_VISCOSITY)

    return _between(context, cells, form, backend, friction, solution, push=push)


def _between(
    context: Context,
    cells: int,
    form: str,
    backend: str,
    friction: float,
    solution: Callable[[NDArray, float], NDArray],
    moving: bool = False,
    push: float = 0.0,
) -> Result:
    """A channel that is periodic along x over half its height; its friction is that of the liquid times `friction`.

    error   root mean square of u - u_exact over all particles and samples, over the largest velocity
    steady  the same in the last sample
    """
    spacing = GAP / cells
    half = cells // 2 * spacing
    walls = BoxWalls(
        lower=(0.0, 0.0, 0.0),
        upper=(half, GAP, 0.0),
        open_faces=("-x", "+x"),
        viscosity=friction * DENSITY * PLATE_VISCOSITY,
        moving_faces=("+y",) if moving else (),
        velocity=(PLATE_SPEED if moving else 0.0, 0.0, 0.0),
    )
    effects: tuple = (walls, Gravity(acceleration=(push, 0.0, 0.0))) if push else (walls,)
    block = Box(cells=(cells // 2, cells, 1))
    made = _scene(
        "channel", spacing, (block,), effects, PLATE_SOUND, PLATE_VISCOSITY, form, clamp=False, period=(half, 0.0, 0.0)
    )
    simulation = context.simulation(made, backend)
    height, speed, wanted = [], [], []

    def sample(simulation: Simulation, wall: float) -> None:
        height.append(simulation.field("position")[:, 1])
        speed.append(simulation.field("velocity")[:, 0] / PLATE_SPEED)
        wanted.append(solution(height[-1], simulation.time - 0.5 * simulation.previous_length) / PLATE_SPEED)

    times = [share * GAP**2 / PLATE_VISCOSITY for share in SAMPLES]
    advance(simulation, times, sample, context)
    off = np.array(speed) - np.array(wanted)
    values = {
        "cells": cells,
        "spacing": spacing / GAP,
        "form": form,
        "particles": len(height[0]),
        "error": _rms(off),
        "steady": _rms(off[-1]),
    }
    return Result(values, {"height": np.array(height) / GAP, "speed": np.array(speed)})


def _disc(spacing: float, pull: float, sound: float) -> tuple[NDArray, float]:
    """(positions of a disc of 1 m in balance with the acceleration -pull x, its radius [m])."""
    position = Ball(radius=1.0).positions(Discretisation(2, "float64", spacing, SUPPORT * spacing, 0))
    total = len(position) * spacing**2 / math.pi  # square of the radius of this mass at rest density
    square = (position**2).sum(1)
    now, edge = exact.compressed(0.5 * square, 0.5 * total, pull, sound)
    return position * np.sqrt(2 * now / square)[:, None], math.sqrt(2 * edge)


def _pulled(
    context: Context,
    name: str,
    spacing: float,
    sound: float,
    position: NDArray,
    velocity: NDArray,
    viscosity: float,
    form: str,
    until: float,
    measure: Callable[[NDArray, NDArray], NDArray],
    backend: str,
) -> tuple[NDArray, NDArray]:
    """(times, what `measure` gives of positions and velocities) of a free cloud in the force -Omega^2 x.

    No effect has this force: it is added to the velocities between the steps, with the leap-frog's share of the step.
    """
    reach = SUPPORT * spacing
    viscous = 0.125 * (0.5 * reach) ** 2 / viscosity / (3 if form == "central" else 1)  # docs/sph.md#step
    step = min(STEP * reach / sound, 0.8 * viscous)
    cloud = Cloud(position=position, velocity=velocity)
    simulation = context.simulation(_scene(name, spacing, (cloud,), (), sound, viscosity, form, step), backend)
    steps = math.ceil(until / step)
    every = max(1, steps // 120)
    time, found = [0.0], [measure(position, velocity)]
    for k in range(steps):
        x, v = simulation.field("position"), simulation.field("velocity")
        v = v - (0.5 if k == 0 else 1.0) * step * PULL**2 * x
        simulation.set_field("velocity", v)
        simulation.step()
        if (k + 1) % every == 0:
            time.append(simulation.time)
            found.append(measure(simulation.field("position"), simulation.field("velocity")))
            context.progress(k / steps)
    return np.array(time), np.array(found).T


def _projected(
    context: Context, simulation: Simulation, flow: Callable[[NDArray], NDArray], times: NDArray
) -> tuple[NDArray, NDArray]:
    """(times, part of the velocity in `flow` of the positions: sum v.u/sum u.u)."""
    found: list[tuple[float, Any]] = []

    def sample(simulation: Simulation, wall: float) -> None:
        u = flow(simulation.field("position"))
        found.append((simulation.time, (simulation.field("velocity") * u).sum() / (u * u).sum()))

    advance(simulation, times.tolist(), sample, context)
    time, part = np.array(found).T
    return time, part


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
