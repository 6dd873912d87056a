"""Runs of the base SPH liquid with a surface tension in 2D, against solutions: d = 1, rho0 = 1, sigma = 1.

The tension is Akinci's with the coefficients that refsim's own calibration gives for sigma and a contact angle.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from refsim import BoxWalls, Cloud, Gravity, Scene, Simulation, WeaklyCompressible, calibrate_contact_angle
from refsim.core.walls import WallParticles
from refsim.sph import reference as sph
from refsim.surface_tension.akinci_2013 import reference as akinci
from refsim.surface_tension.contact_angle import ContactAngle
from validation.experiments.solutions import exact, tension_exact
from validation.experiments.viscosity import runs as spinning
from validation.results import Result
from validation.running import Context, advance

SUPPORT = 2.6  # h/d
JITTER, STIRS, STIR = 0.1, 20, 0.7  # of the lattice; random kicks, ever weaker, in sqrt(sigma/(rho d))
STIRRED, RESTED = 2.0, 6.0  # stages of the flat surface, in 1/omega_0
CREST, FRICTION, PERIODS = 0.06, 0.1, 2.0  # a'(0)/omega_0 in half wave lengths; nu k^2/omega_0; followed
OHNESORGE = 0.3  # mu/sqrt(rho sigma l) of the meniscus, l = sqrt(sigma/(rho g))
WIDE, DEEP, CLIMBED, MEANS = 10.0, 2.0, 30.0, 40  # tank in l; time until the mean in sqrt(l/g), and samples in it


def _scene(
    name: str, found: ContactAngle, position: NDArray, velocity: NDArray, viscosity: float, width: float, gravity: float
) -> Scene:
    """Liquid between walls at x = 0 and `width`, on a floor at y = 0, with the tension `found`."""
    liquid = WeaklyCompressible(
        rest_density=1.0,
        sound_speed=found.tension.sound_speed,
        dynamic_viscosity=viscosity,
        viscosity="central",
        kernels="mueller",
    )
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(width, 10 * width, 0.0), open_faces=("+y",))
    pull = (Gravity(acceleration=(0.0, -gravity, 0.0)),) if gravity else ()
    return Scene(
        name=name,
        dim=2,
        dtype="float64",
        spacing=1.0,
        support_radius=SUPPORT,
        fluid=(Cloud(position=position, velocity=velocity),),
        effects=(liquid, found.effect, walls, *pull),
    )


def _stirred(context: Context, made: Scene, times: tuple[float, float], seed: int, backend: str) -> Simulation:
    """The liquid after random kicks, ever weaker, during the first of `times`, and at rest until the second."""
    random = np.random.default_rng(seed)
    simulation = context.simulation(made, backend)
    for k in range(STIRS):
        kick = np.zeros_like(simulation.field("velocity"))
        kick[:, :2] = random.normal(size=(len(kick), 2)) / math.sqrt(2)
        simulation.set_field("velocity", simulation.field("velocity") + STIR * (1 - k / STIRS) * kick)
        advance(simulation, [times[0] * (k + 1) / STIRS], lambda simulation, wall: None, context)
    advance(simulation, [times[1]], lambda simulation, wall: None, context)
    return simulation


def _block(across: int, up: int, seed: int) -> NDArray:
    """Positions of a block on the floor, shifted at random."""
    x, y = np.meshgrid(np.arange(across) + 0.5, np.arange(up) + 0.5, indexing="ij")
    position = np.stack([x.ravel(), y.ravel(), np.zeros(across * up)], axis=1)
    position[:, :2] += JITTER * np.random.default_rng(seed).uniform(-1, 1, (across * up, 2))
    return position


def capillary(context: Context, cells: int, backend: str, seed: int = 1) -> Result:
    """A capillary wave of half a wave length, `cells` long and deep, between walls that slip; contact angle 90 degrees.

    The flat liquid is stirred and comes to rest; it then starts with the velocities of a potential flow. The amplitude
    is 2 sum m cos(k x)/(rho L), as the depth at x is H + a cos(k x), less that of the start.
    error   root mean square of omega_0 a/a'(0) - Prosperetti's
    crest   greatest height over Prosperetti's; crest_off from 1
    side    part of the velocity in the flow after a thirtieth of a period, within 1.2 spacings of the side walls, over
            the same farther than 4 from all walls
    """
    found = calibrate_contact_angle(90.0, 1.0, spacing=1.0, rest_density=1.0, dim=2)
    k = math.pi / cells
    omega = math.sqrt(k**3)
    viscosity = FRICTION * omega / k**2
    start = _block(cells, cells, seed)
    flat = _scene("flat", found, start, np.zeros_like(start), viscosity, float(cells), 0.0)
    rested = _stirred(context, flat, (STIRRED / omega, (STIRRED + RESTED) / omega), seed, backend)
    rested.evaluate()
    x = rested.field("position")
    density = float(rested.field("density")[np.abs(x[:, 1] - 0.5 * cells) < 0.25 * cells].mean())
    top = len(x) / (density * cells)

    def flow(x: NDArray) -> NDArray:
        made = np.zeros_like(x)
        made[:, 0] = -np.sin(k * x[:, 0]) * np.cosh(k * x[:, 1]) / math.sinh(k * top)
        made[:, 1] = np.cos(k * x[:, 0]) * np.sinh(k * x[:, 1]) / math.sinh(k * top)
        return made

    velocity = CREST * cells * omega * flow(x)
    simulation = context.simulation(_scene("capillary", found, x, velocity, viscosity, float(cells), 0.0), backend)
    seen: list[tuple[float, float]] = []
    sides: list[float] = []

    def sample(simulation: Simulation, wall: float) -> None:
        if not sides and simulation.time * omega >= 2 * math.pi / 30:
            x, v = simulation.field("position"), simulation.field("velocity")
            u, apart = flow(x), np.minimum(x[:, 0], cells - x[:, 0])
            by, off = apart < 1.2, (apart > 4) & (x[:, 1] > 4)
            parts = [(v[part] * u[part]).sum() / (u[part] ** 2).sum() for part in (by, off)]
            sides.append(float(parts[0] / parts[1]))
        high = 2 * np.cos(k * simulation.field("position")[:, 0]).sum() / (density * cells)
        seen.append((simulation.time, float(high)))

    advance(simulation, np.linspace(0.0, PERIODS * 2 * math.pi / omega, 121).tolist(), sample, context)
    time, height = np.array(seen).T
    part = (height - height[0]) / (CREST * cells)
    theory = tension_exact.prosperetti(time, omega**2, viscosity * k**2, velocity=True)
    values = {
        "cells": cells,
        "spacing": 1.0 / cells,
        "particles": len(x),
        "density": density,
        "uncertainty": found.tension.uncertainty,
        "error": float(np.sqrt(np.mean((part - theory) ** 2))),
        "crest": float(part.max() / theory.max()),
        "side": sides[0],
    }
    values["crest_off"] = abs(values["crest"] - 1)
    return Result(values, {"time": time * omega / (2 * math.pi), "part": part, "theory": theory})


def drop(context: Context, cells: int, form: str, backend: str, seed: int = 1) -> Result:
    """A free drop of radius `cells` that its tension holds together, turning slowly as a rigid body.

    error  root mean square of L/L(0) - exact; rate  of log L at the end over the exact (not with the central form)
    """
    position, radius = spinning.relaxed(context, 2, float(cells), seed)
    viscosity = spinning.CALM * math.sqrt(cells)
    velocity = np.cross([0.0, 0.0, spinning.SPIN / cells**1.5], position)
    simulation = context.simulation(spinning.scene(form, 2, position, velocity, viscosity), backend)
    seen: list[tuple[float, float]] = []

    def sample(simulation: Simulation, wall: float) -> None:
        x, v = simulation.field("position"), simulation.field("velocity")
        seen.append((simulation.time, float(np.cross(x, v)[:, 2].sum())))

    until = spinning.TURNED / spinning.rate(2, viscosity, radius)
    advance(simulation, np.linspace(0.0, until, 61).tolist(), sample, context)
    time, momentum = np.array(seen).T
    left = momentum / momentum[0]
    theory = exact.spin_down(time, viscosity / radius**2) if form == "laplacian" else np.ones_like(time)
    values = {"cells": cells, "spacing": 1.0 / cells, "form": form, "particles": len(position), "radius": radius}
    values["error"] = float(np.sqrt(np.mean((left - theory) ** 2)))
    if form == "laplacian":
        values["rate"] = float(np.log(left[-1]) / np.log(theory[-1]))
        values["rate_off"] = abs(values["rate"] - 1)
    return Result(values, {"time": time, "left": left, "theory": theory})


def meniscus(context: Context, cells: int, angle: float, backend: str, seed: int = 1) -> Result:
    """Liquid in a tank of ten capillary lengths, l = `cells`, whose walls it meets at a contact angle [degrees].

    The depth of a column of half a capillary length is 1.5 l and what stands above, over the density below: layers at
    a wall have a density of their own.
    lifted  area that a wall lifts above the level in the middle, over l^2; lifted_off  from cos(angle)
    """
    found = calibrate_contact_angle(angle, 1.0, spacing=1.0, rest_density=1.0, dim=2)
    length, gravity = float(cells), 1.0 / cells**2
    width, unit = WIDE * length, math.sqrt(length / gravity)
    start = _block(round(width), round(DEEP * length), seed)
    viscosity = OHNESORGE * math.sqrt(length)
    made = _scene("meniscus", found, start, np.zeros_like(start), viscosity, width, gravity)
    simulation = _stirred(context, made, (2 * unit, CLIMBED * unit), seed, backend)
    columns = np.linspace(0.0, width, 2 * round(WIDE) + 1)
    above, below = [], []

    def sample(simulation: Simulation, wall: float) -> None:
        x, y = simulation.field("position")[:, :2].T
        high, low = y > 1.5 * length, np.abs(y - length) < 0.5 * length
        above.append(np.histogram(x[high], columns)[0])
        below.append(np.histogram(x[low], columns)[0])

    times = CLIMBED * unit + unit * np.arange(1, MEANS + 1) / 4
    advance(simulation, times.tolist(), sample, context)
    place, apart = 0.5 * (columns[1:] + columns[:-1]), float(columns[1] - columns[0])
    height = (1.5 + np.sum(above, axis=0) / np.sum(below, axis=0)) * length
    level = float(height[np.abs(place - 0.5 * width) < length].mean())
    lifted = float((height - level).sum() * apart / 2 / length**2)
    wanted = tension_exact.meniscus(1.0, math.radians(angle))[1]
    values = {"cells": cells, "spacing": 1.0 / cells, "angle": angle, "particles": len(start), "lifted": lifted}
    values |= {"wanted": wanted, "lifted_off": abs(lifted - wanted), "level": level / length}
    return Result(values, {"place": place / length, "height": height / length})


def jurin(context: Context, cells: int, backend: str, angle: float = 70.0, seed: int = 1) -> Result:
    """A column three widths high between two plates `cells` apart on a floor, met at a contact angle [degrees].

    The plates carry a part of the weight. In a reservoir the column would rise until they carried all of it above the
    level: h = F/(rho g w), F their vertical force on the upper half, where the floor is far. Gravity is such that
    Jurin's h is one width.
    risen  F over 2 sigma cos(angle), in the mean of `MEANS` samples; risen_off  from 1
    """
    found = calibrate_contact_angle(angle, 1.0, spacing=1.0, rest_density=1.0, dim=2)
    width, wanted = float(cells), 2 * math.cos(math.radians(angle))
    gravity = wanted / width**2
    unit = math.sqrt(width / gravity)
    start = _block(cells, 3 * cells, seed)
    viscosity = OHNESORGE * math.sqrt(width)
    made = _scene("jurin", found, start, np.zeros_like(start), viscosity, width, gravity)
    simulation = _stirred(context, made, (2 * unit, CLIMBED * unit), seed, backend)
    plan = simulation.plan
    x = plan.walls.position[:, 0]
    plates = WallParticles(*(part[(x < 0) | (x > width)] for part in plan.walls))
    groups = {**plan.shared, **plan.parameters[found.effect.name]}
    lifted: list[float] = []

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        position, velocity, mass, density, pressure = (
            simulation.field(name) for name in ("position", "velocity", "mass", "density", "pressure")
        )
        state, kernel, fluid = (
            (position, velocity, mass, density, pressure),
            groups["gradient_smoothing"],
            groups["fluid"],
        )
        near, without = (
            sph.momentum(*state, walls, kernel, fluid, None)["acceleration"][0] for walls in (plates, None)
        )
        pull, _ = akinci.adhesion(position, plates, groups["smoothing"], fluid, groups["adhesion"])["acceleration"]
        upper = position[:, 1] > 1.5 * width
        lifted.append(float((mass * (near - without + pull)[:, 1])[upper].sum()))

    advance(simulation, (CLIMBED * unit + unit * np.arange(1, MEANS + 1) / 4).tolist(), sample, context)
    values = {"cells": cells, "spacing": 1.0 / cells, "angle": angle, "particles": len(start)}
    values |= {"risen": float(np.mean(lifted) / wanted), "scatter": float(np.std(lifted) / wanted)}
    values["risen_off"] = abs(values["risen"] - 1)
    return Result(values, {"lifted": np.array(lifted) / wanted})
