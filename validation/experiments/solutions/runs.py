"""Runs of the base SPH liquid in 2D against solutions of its equations. Lengths in m, rho0 = 1000 kg/m^2.

Discs start at the positions of equal masses in hydrostatic balance, p = c^2 (rho - rho0), so that no pressure wave of
the start covers what is measured. The sound speed is ten times the largest speed of the problem."""

import math
from collections.abc import Callable, Container, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import (
    Ball,
    Box,
    BoxWalls,
    Cloud,
    Gravity,
    ParticleShifting,
    Scene,
    Simulation,
    WeaklyCompressible,
    calibrate_contact_angle,
)
from refsim.core.effect import Discretisation
from refsim.core.walls import WallParticles
from refsim.sph import operations as sph
from refsim.sph.resting import RestingColumn
from refsim.surface_tension.akinci_2013 import operations as akinci
from refsim.surface_tension.calibration import ContactAngle
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, RunSpec
from validation.metrics import solutions as scene
from validation.metrics.solutions import standing_flow
from validation.results import Result
from validation.running import Context, advance

DENSITY, SUPPORT = 1000.0, 2.6  # kg/m^2; h/d
RESTS, REACH = "rests", 3.2  # the liquid that rests, and its h/d
NUMERICAL = 1 / 200  # kinematic viscosity over c h where the solution has none: above the least of docs/stability.md
STEP = 0.3  # c dt/h of a fixed step

MACH = 0.1  # Omega R/c of the discs
PULL, STRAIN, SWINGS = 1.0, 0.5, 2.0  # ellipse: Omega [1/s], sigma at the start [1/s], periods 2 pi/(sqrt(2) Omega)
SPIN, SPIN_VISCOSITY, SPUN = 0.2, 0.05, 6.0  # disc: omega [1/s], m^2/s, s
REYNOLDS, MIXED, BACKGROUND = 50.0, 2.0, 1.0  # Taylor-Green: pi U/(nu k), s until the end, pressure over rho0 U^2


# Plates (Morris, Fox & Zhu, J. Comput. Phys. 136 (1997) 214): m, m^2/s, m/s, m/s, samples over H^2/nu
GAP, PLATE_VISCOSITY, PLATE_SPEED, PLATE_SOUND = 1e-3, 1e-6, 1.25e-5, 2.5e-4
SAMPLES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)


def _scene(
    name: str, spacing: float, fluid: Any, effects: tuple, sound: float, viscosity: float, form: str,
    clamp: bool = True, **more: Any,
) -> Scene:  # fmt: skip
    """A scene in 2D of one part of the base liquid with kinematic viscosity `viscosity` [m^2/s].

    form  of the viscosity, or the liquid that rests (docs/liquid.md), in a disc without shifts, which would turn it
    """
    own: dict[str, Any] = {"viscosity": form, "density": "summation", "clamp_pressure": clamp}
    if form == RESTS:
        own = {"density": "continuity"} if name == "disc" else {}
    liquid = WeaklyCompressible(rest_density=DENSITY, sound_speed=sound, dynamic_viscosity=DENSITY * viscosity, **own)
    reach = (REACH if form == RESTS else SUPPORT) * spacing
    return Scene(
        name=name, dim=2, dtype="float64", spacing=spacing, support_radius=reach, fluid=(fluid,),
        effects=(liquid, *effects), **more,
    )  # fmt: skip


def _told(cells: int, spacing: float, particles: int, off: Sequence[str] = (), **values: Any) -> dict[str, Any]:
    """The values of a run; those named in `off` are shares of the exact ones, and get their distance from 1, too."""
    away = {f"{name}_off": abs(values[name] - 1) for name in off}
    return {"cells": cells, "spacing": spacing, "particles": particles, **values, **away}


def ellipse(context: Context, cells: int, backend: str, form: str = "central") -> Result:
    """A disc of radius 1 m, `cells` spacings, in the force -Omega^2 x, that starts with v = sigma (x, -y).

    Viscous forces along the line of centres; the sound speed is Omega R/MACH. The semi-axis is twice the root mean
    square of x.
    error  root mean square of a - a_exact over R, with the numerical viscosity in the equation; inviscid  without
    period  time of the second maximum of a over the exact
    """
    spacing, sound = 1.0 / cells, PULL / MACH
    position, radius = _disc(spacing, PULL**2 + STRAIN**2, sound)
    viscosity = NUMERICAL * sound * SUPPORT * spacing
    velocity = STRAIN * position * np.array([1.0, -1.0, 0.0])
    until = SWINGS * 2 * math.pi / (math.sqrt(2) * PULL)
    time, (along, _) = _pulled(context, "ellipse", spacing, sound, position, velocity, viscosity, form, until,
                                    lambda x, v: 2 * np.sqrt((x[:, :2] ** 2).mean(0)), backend)  # fmt: skip
    a, b = scene.ellipse(time, radius, PULL, STRAIN, 2 * viscosity)
    ideal, _ = scene.ellipse(time, radius, PULL, STRAIN, 0.0)
    last = time > 0.5 * until
    values = _told(
        cells, spacing, len(position), ("period",), radius=radius, error=_rms(along - a) / radius,
        inviscid=_rms(along - ideal) / radius,
        period=float(scene.peak(time[last], along[last]) / scene.peak(time[last], a[last])),
    )  # fmt: skip
    return Result(values, {"time": time, "along": along, "a": a, "b": b})


def disc(context: Context, cells: int, form: str, backend: str) -> Result:
    """A disc of radius 1 m, `cells` spacings, that turns as a rigid body, held together by the force -Omega^2 x.

    error  root mean square of L/L(0) - exact; rate  of log L at the end over the exact (not with the central form)
    """
    spacing, sound = 1.0 / cells, PULL / MACH
    position, radius = _disc(spacing, PULL**2 - SPIN**2, sound)
    velocity = np.cross([0.0, 0.0, SPIN], position)
    time, (momentum,) = _pulled(context, "disc", spacing, sound, position, velocity, SPIN_VISCOSITY, form, SPUN,
                                lambda x, v: np.array([np.cross(x, v)[:, 2].sum()]), backend)  # fmt: skip
    left, turns = momentum / momentum[0], form == "laplacian"
    theory = scene.spin_down(time, SPIN_VISCOSITY / radius**2) if turns else np.ones_like(time)
    rate = {"rate": float(np.log(left[-1]) / np.log(theory[-1]))} if turns else {}
    error = _rms(left - theory)
    values = _told(cells, spacing, len(position), tuple(rate), form=form, radius=radius, error=error, **rate)
    return Result(values, {"time": time, "left": left, "theory": theory})


def vortex(context: Context, cells: int, form: str, backend: str) -> Result:
    """One vortex of Taylor & Green, U = 1 m/s, in a closed box of 1 m with `cells` particles a side; its walls slip.

    The liquid that rests is shifted. The background pressure comes of `cells`^2 particles that are heavier than the box
    takes at rest density.
    rate   of decay of the part of the velocity in the initial flow over 2 nu k^2
    error  root mean square of v - v_exact at the end over that of v_exact
    """
    sound, viscosity, k = 10.0, 1 / REYNOLDS, math.pi
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 0.0))
    width = 1.0 / cells
    # which sets the particles' mass
    spacing = width if form == RESTS else width * math.sqrt(1 + BACKGROUND / sound**2)
    position = Box(cells=(cells, cells, 1)).positions(Discretisation(2, "float64", width, SUPPORT * width, 0))

    def flow(x: NDArray) -> NDArray:
        made = np.zeros_like(x)
        made[:, 0] = np.sin(k * x[:, 0]) * np.cos(k * x[:, 1])
        made[:, 1] = -np.cos(k * x[:, 0]) * np.sin(k * x[:, 1])
        return made

    cloud = Cloud(position=position, velocity=flow(position))
    effects = (walls, ParticleShifting(surface="none")) if form == RESTS else (walls,)
    made = _scene("vortex", spacing, cloud, effects, sound, viscosity, form, clamp=False)
    simulation = context.simulation(made, backend)
    if form == RESTS:  # the pressure of the flow, with p = 0 in the mean
        pressure = 0.25 * DENSITY * np.cos(2 * k * position[:, :2]).sum(1)
        simulation.set_field("advanced_excess", pressure / sound**2)
    time, part = _projected(context, simulation, flow, np.linspace(0, MIXED, 41))
    x, v = simulation.field("position"), simulation.field("velocity")
    decay = 2 * viscosity * k**2
    solution = flow(x) * math.exp(-decay * time[-1])
    values = _told(
        cells, width, len(position), ("rate",), form=form,
        rate=float(-np.polyfit(time, np.log(part), 1)[0] / decay),
        error=float(np.linalg.norm(v - solution) / np.linalg.norm(solution)),
    )  # fmt: skip
    return Result(values, {"time": time, "part": part, "theory": np.exp(-decay * time)})


def couette(context: Context, cells: int, form: str, backend: str) -> Result:
    """Liquid between a plate at rest and one that begins to move, `cells` particles apart; measured as `_between`."""
    solution = partial(scene.couette, gap=GAP, speed=PLATE_SPEED, viscosity=PLATE_VISCOSITY)
    return _between(context, cells, form, backend, solution, moving=True)


def poiseuille(context: Context, cells: int, form: str, backend: str) -> Result:
    """Liquid between two plates at rest that begins to be pushed along them; measured as `_between`."""
    push = 8 * PLATE_VISCOSITY * PLATE_SPEED / GAP**2
    solution = partial(scene.poiseuille, gap=GAP, push=push, viscosity=PLATE_VISCOSITY)
    return _between(context, cells, form, backend, solution, push=push)


def _between(
    context: Context, cells: int, form: str, backend: str, solution: Callable[..., NDArray],
    moving: bool = False, push: float = 0.0,
) -> Result:  # fmt: skip
    """A channel, periodic along x over half its height or all, between plates without slip.

    error   root mean square of u - u_exact over all particles and samples, over the largest velocity
    steady  the same in the last sample
    """
    spacing = GAP / cells
    wide = cells if form == RESTS else cells // 2
    walls = BoxWalls(
        lower=(0.0, 0.0, 0.0), upper=(wide * spacing, GAP, 0.0), open_faces=("-x", "+x"),
        no_slip=True, moving_faces=("+y",) if moving else (),
        velocity=(PLATE_SPEED if moving else 0.0, 0.0, 0.0),
    )  # fmt: skip
    effects: tuple = (walls, Gravity(acceleration=(push, 0.0, 0.0))) if push else (walls,)
    made = _scene("channel", spacing, Box(cells=(wide, cells, 1)), effects, PLATE_SOUND, PLATE_VISCOSITY, form,
                  clamp=False, period=(wide * spacing, 0.0, 0.0))  # fmt: skip
    simulation = context.simulation(made, backend)
    height, speed, wanted = [], [], []

    def sample(simulation: Simulation, wall: float) -> None:
        height.append(simulation.field("position")[:, 1])
        speed.append(simulation.field("velocity")[:, 0] / PLATE_SPEED)
        wanted.append(solution(height[-1], simulation.time - 0.5 * simulation.previous_length) / PLATE_SPEED)

    advance(simulation, [share * GAP**2 / PLATE_VISCOSITY for share in SAMPLES], sample, context)
    off = np.array(speed) - np.array(wanted)
    values = _told(cells, spacing / GAP, len(height[0]), form=form, error=_rms(off), steady=_rms(off[-1]))
    return Result(values, {"height": np.array(height) / GAP, "speed": np.array(speed)})


def _disc(spacing: float, pull: float, sound: float) -> tuple[NDArray, float]:
    """(positions of a disc of 1 m in balance with the acceleration -pull x, its radius [m])."""
    position = Ball(radius=1.0).positions(Discretisation(2, "float64", spacing, SUPPORT * spacing, 0))
    total = len(position) * spacing**2 / math.pi  # square of the radius of this mass at rest density
    square = (position**2).sum(1)
    depth = RestingColumn(0.5 * np.append(total - square, total), pull, 1.0, sound).height()  # r^2/2 stands for heights
    return position * np.sqrt(2 * (depth[-1] - depth[:-1]) / square)[:, None], math.sqrt(2 * depth[-1])


def _pulled(
    context: Context, name: str, spacing: float, sound: float, position: NDArray, velocity: NDArray, viscosity: float,
    form: str, until: float, measure: Callable[[NDArray, NDArray], NDArray], backend: str,
) -> tuple[NDArray, NDArray]:  # fmt: skip
    """(times, what `measure` gives of positions and velocities) of a free cloud in the force -Omega^2 x.

    No effect has this force: it is added to the velocities between the steps, with the leap-frog's share of the step.
    """
    reach = (REACH if form == RESTS else SUPPORT) * spacing
    viscous = 0.125 * (0.5 * reach) ** 2 / viscosity / (1 if form == "laplacian" else 3)  # docs/sph.md#step
    step = min(STEP * reach / sound, 0.8 * viscous)
    cloud = Cloud(position=position, velocity=velocity)
    simulation = context.simulation(_scene(name, spacing, cloud, (), sound, viscosity, form, step=step), backend)
    if form == RESTS:
        square = (position**2).sum(1)
        edge = np.sort(square)[-1]
        simulation.set_field("advanced_excess", 0.5 * DENSITY * (PULL / sound) ** 2 * (edge - square))
    steps = math.ceil(until / step)
    every = max(1, steps // 120)
    time, measured = [0.0], [measure(position, velocity)]
    for k in range(steps):
        x, v = simulation.field("position"), simulation.field("velocity")
        simulation.set_field("velocity", v - (0.5 if k == 0 else 1.0) * step * PULL**2 * x)
        simulation.step()
        if (k + 1) % every == 0:
            time.append(simulation.time)
            measured.append(measure(simulation.field("position"), simulation.field("velocity")))
            context.progress(k / steps)
    return np.array(time), np.array(measured).T


def _projected(
    context: Context, simulation: Simulation, flow: Callable[[NDArray], NDArray], times: NDArray
) -> tuple[NDArray, NDArray]:
    """(times, part of the velocity in `flow` of the positions: sum v.u/sum u.u)."""
    amplitudes: list[tuple[float, Any]] = []

    def sample(simulation: Simulation, wall: float) -> None:
        u = flow(simulation.field("position"))
        amplitudes.append((simulation.time, (simulation.field("velocity") * u).sum() / (u * u).sum()))

    advance(simulation, times.tolist(), sample, context)
    time, part = np.array(amplitudes).T
    return time, part


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


# Runs of the base SPH liquid with a surface tension in 2D, against solutions: d = 1, rho0 = 1, sigma = 1.
#
# The tension is Akinci's with the coefficients that refsim's own calibration gives for sigma and a contact angle.


TENSION_SUPPORT = 2.6  # h/d
JITTER, STIRS, STIR = 0.1, 20, 0.7  # of the lattice; random kicks, ever weaker, in sqrt(sigma/(rho d))
STIRRED, RESTED = 2.0, 6.0  # stages of the flat surface, in 1/omega_0
TENSION_CREST, FRICTION, TENSION_PERIODS = 0.06, 0.1, 2.0  # a'(0)/omega_0 in half waves; nu k^2/omega_0; followed
OHNESORGE = 0.3  # mu/sqrt(rho sigma l) of the meniscus, l = sqrt(sigma/(rho g))
WIDE, DEEP, CLIMBED, TENSION_MEANS = 10.0, 2.0, 30.0, 40  # tank in l; sqrt(l/g) until the mean, samples in it


def _tension_scene(
    name: str, found: ContactAngle, position: NDArray, velocity: NDArray, viscosity: float, width: float, gravity: float
) -> Scene:
    """Liquid between walls at x = 0 and `width`, on a floor at y = 0, with the tension `found`."""
    liquid = WeaklyCompressible(
        rest_density=1.0, sound_speed=found.tension.sound_speed, dynamic_viscosity=viscosity, viscosity="central",
        kernels="mueller", density="summation",
    )  # fmt: skip
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(width, 10 * width, 0.0), open_faces=("+y",))
    pull = (Gravity(acceleration=(0.0, -gravity, 0.0)),) if gravity else ()
    return Scene(
        name=name, dim=2, dtype="float64", spacing=1.0, support_radius=TENSION_SUPPORT,
        fluid=(Cloud(position=position, velocity=velocity),), effects=(liquid, found.effect, walls, *pull),
    )  # fmt: skip


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
    calibration = calibrate_contact_angle(90.0, 1.0, spacing=1.0, rest_density=1.0, dim=2)
    k = math.pi / cells
    omega = math.sqrt(k**3)
    viscosity = FRICTION * omega / k**2
    start = _block(cells, cells, seed)
    flat = _tension_scene("flat", calibration, start, np.zeros_like(start), viscosity, float(cells), 0.0)
    rested = _stirred(context, flat, (STIRRED / omega, (STIRRED + RESTED) / omega), seed, backend)
    rested.evaluate()
    x = rested.field("position")
    density = float(rested.field("density")[np.abs(x[:, 1] - 0.5 * cells) < 0.25 * cells].mean())
    top = len(x) / (density * cells)
    flow = standing_flow(k, top)
    velocity = TENSION_CREST * cells * omega * flow(x)
    made = _tension_scene("capillary", calibration, x, velocity, viscosity, float(cells), 0.0)
    simulation = context.simulation(made, backend)
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

    advance(simulation, np.linspace(0.0, TENSION_PERIODS * 2 * math.pi / omega, 121).tolist(), sample, context)
    time, height = np.array(seen).T
    part = (height - height[0]) / (TENSION_CREST * cells)
    theory = scene.prosperetti(time, omega**2, viscosity * k**2, velocity=True)
    values = _told(
        cells, 1.0 / cells, len(x), ("crest",), density=density, uncertainty=calibration.tension.uncertainty,
        error=_rms(part - theory), crest=float(part.max() / theory.max()), side=sides[0],
    )  # fmt: skip
    return Result(values, {"time": time * omega / (2 * math.pi), "part": part, "theory": theory})


def meniscus(context: Context, cells: int, angle: float, backend: str, seed: int = 1) -> Result:
    """Liquid in a tank of ten capillary lengths, l = `cells`, whose walls it meets at a contact angle [degrees].

    The depth of a column of half a capillary length is 1.5 l and what stands above, over the density below: layers at
    a wall have a density of their own.
    lifted  area that a wall lifts above the level in the middle, over l^2; lifted_off  from cos(angle)
    """
    calibration = calibrate_contact_angle(angle, 1.0, spacing=1.0, rest_density=1.0, dim=2)
    length, gravity = float(cells), 1.0 / cells**2
    width, unit = WIDE * length, math.sqrt(length / gravity)
    start = _block(round(width), round(DEEP * length), seed)
    viscosity = OHNESORGE * math.sqrt(length)
    made = _tension_scene("meniscus", calibration, start, np.zeros_like(start), viscosity, width, gravity)
    simulation = _stirred(context, made, (2 * unit, CLIMBED * unit), seed, backend)
    columns = np.linspace(0.0, width, 2 * round(WIDE) + 1)
    above, below = [], []

    def sample(simulation: Simulation, wall: float) -> None:
        x, y = simulation.field("position")[:, :2].T
        high, low = y > 1.5 * length, np.abs(y - length) < 0.5 * length
        above.append(np.histogram(x[high], columns)[0])
        below.append(np.histogram(x[low], columns)[0])

    times = CLIMBED * unit + unit * np.arange(1, TENSION_MEANS + 1) / 4
    advance(simulation, times.tolist(), sample, context)
    place, apart = 0.5 * (columns[1:] + columns[:-1]), float(columns[1] - columns[0])
    height = (1.5 + np.sum(above, axis=0) / np.sum(below, axis=0)) * length
    level = float(height[np.abs(place - 0.5 * width) < length].mean())
    lifted = float((height - level).sum() * apart / 2 / length**2)
    wanted = scene.meniscus(1.0, math.radians(angle))[1]
    off = abs(lifted - wanted)
    values = _told(cells, 1.0 / cells, len(start), angle=angle, lifted=lifted, lifted_off=off, level=level / length)
    return Result(values, {"place": place / length, "height": height / length})


def jurin(context: Context, cells: int, backend: str, angle: float = 70.0, seed: int = 1) -> Result:
    """A column three widths high between two plates `cells` apart on a floor, met at a contact angle [degrees].

    The plates carry a part of the weight. In a reservoir the column would rise until they carried all of it above the
    level: h = F/(rho g w), F their vertical force on the upper half, where the floor is far. Gravity is such that
    Jurin's h is one width.
    risen  F over 2 sigma cos(angle), in the mean of `TENSION_MEANS` samples; risen_off  from 1
    """
    calibration = calibrate_contact_angle(angle, 1.0, spacing=1.0, rest_density=1.0, dim=2)
    width, wanted = float(cells), 2 * math.cos(math.radians(angle))
    gravity = wanted / width**2
    unit = math.sqrt(width / gravity)
    start = _block(cells, 3 * cells, seed)
    viscosity = OHNESORGE * math.sqrt(width)
    made = _tension_scene("jurin", calibration, start, np.zeros_like(start), viscosity, width, gravity)
    simulation = _stirred(context, made, (2 * unit, CLIMBED * unit), seed, backend)
    plan = simulation.plan
    x = plan.walls.position[:, 0]
    plates = WallParticles(*(part[(x < 0) | (x > width)] for part in plan.walls))
    groups = {**plan.shared, **plan.parameters[calibration.effect.name]}
    lifted: list[float] = []

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        state = position, _, mass, *_ = [
            simulation.field(name) for name in ("position", "velocity", "mass", "density", "pressure")
        ]
        kernel, fluid = groups["gradient_smoothing"], groups["fluid"]
        near, without = (
            sph.momentum(*state, walls, kernel, fluid, None)["acceleration"].value for walls in (plates, None)
        )
        pull, _ = akinci.adhesion(position, plates, groups["smoothing"], fluid, groups["adhesion"])["acceleration"]
        upper = position[:, 1] > 1.5 * width
        lifted.append(float((mass * (near - without + pull)[:, 1])[upper].sum()))

    advance(simulation, (CLIMBED * unit + unit * np.arange(1, TENSION_MEANS + 1) / 4).tolist(), sample, context)
    risen, scatter = float(np.mean(lifted) / wanted), float(np.std(lifted) / wanted)
    values = _told(cells, 1.0 / cells, len(start), ("risen",), angle=angle, risen=risen, scatter=scatter)
    return Result(values, {"lifted": np.array(lifted) / wanted})


# The base SPH liquid held against solutions of its equations, at three spacings each.


FORMS = ("laplacian", "central")
ALL = (*FORMS, RESTS)
CELLS = {
    "ellipse": (10, 20, 40), "disc": (10, 20, 40), "vortex": (20, 40, 80), "couette": (12, 24, 48),
    "poiseuille": (12, 24, 48), "capillary": (12, 24, 48),
    "meniscus": (4, 8, 12), "jurin": (8, 12, 16),
}  # fmt: skip
WITH_FORMS: dict[str, tuple[str, ...]] = dict.fromkeys(("disc", "vortex", "couette", "poiseuille"), ALL)
WITH_FORMS |= {"ellipse": ("", RESTS), "meniscus": ("70", "110")}  # [degrees]
JUDGED = {  # quantities by problem: those with a measured order, and those that are judged at the smallest spacing
    "ellipse": ("error", "period_off"), "disc": ("rate_off",), "vortex": ("rate_off", "error"),
    "couette": ("error", "steady"), "poiseuille": ("error", "steady"), "capillary": ("crest_off", "error", "side"),
    "meniscus": ("lifted_off",), "jurin": ("risen_off",),
}  # fmt: skip
ORDERED = {"ellipse": "error", "couette": "steady"}  # surfaces are of first order
SECONDS = 5e-6  # of a particle in a step, for the progress bar


def planned(options: Options) -> list[RunSpec]:
    """Every problem at three spacings, with both viscosities where they differ; with --quick one of plates."""
    if options.quick:
        return [_run("couette", 12, "central", options.backend)]
    return _solved(options.backend)


def _solved(backend: str) -> list[RunSpec]:
    return [
        _run(problem, cells, form, backend)
        for problem, sizes in CELLS.items()
        for form in WITH_FORMS.get(problem, ("",))
        for cells in sizes
    ]


def _run(problem: str, cells: int, form: str, backend: str) -> RunSpec:
    parameters: dict[str, Any] = {"cells": cells, "backend": backend}
    if form:
        parameters |= {"angle": float(form)} if problem == "meniscus" else {"form": form}
    key = "_".join(filter(None, (problem, form, str(cells))))
    tense = problem in ("jurin", "capillary", "meniscus")
    return RunSpec(
        key, globals()[problem], parameters,
        estimate=5.0 * (cells / 12) ** 3 if tense else SECONDS * 200 * cells**3,
    )  # fmt: skip


def series(results: Results) -> dict[str, dict[str, list[float]]]:
    """Spacings and quantities of every problem (with its viscosity), from the largest spacing to the smallest."""
    by_solution: dict[str, dict[str, list[float]]] = {}
    for key, result in results.items():
        one = by_solution.setdefault(key.rpartition("_")[0], {})
        for name, value in result.values.items():
            if isinstance(value, float):
                one.setdefault(name, []).append(value)
    return by_solution


def order(spacing: Sequence[float], error: Sequence[float]) -> float:
    """Exponent p of error ~ spacing^p between the largest and the smallest spacing; NaN from one spacing alone."""
    if len(spacing) < 2:
        return math.nan
    return math.log(error[0] / error[-1]) / math.log(spacing[0] / spacing[-1])


def checks(results: Results, check: Checks) -> None:
    """Errors at the smallest spacing, and orders between the largest and the smallest."""
    for name, one in series(results).items():
        problem, _, form = name.partition("_")
        whole = len(one["spacing"]) == len(CELLS[problem])
        for quantity in (q for q in JUDGED[problem] if q in one and whole):
            suffix = "_of_rest" if quantity == "error" and problem == "ellipse" and form else ""
            check(f"{problem}_{quantity}{suffix}", one[quantity][-1], form)
            rule = "order" if ORDERED.get(problem) == quantity else "order_shown"
            if quantity != "side":  # no error
                check(rule, order(one["spacing"], one[quantity]), f"{name}.{quantity}")
        for value, size in zip(one.get("error", ()), one["spacing"]):
            if name in ("disc_central", "disc_rests"):
                check(f"{problem}_kept", value, f"{1 / size:.0f}", f"R = {1 / size:.0f} d")
    check.seconds(results)


def _behind(titles: Container[str]) -> tuple[str, ...]:
    """Keys of the runs of some problems."""
    return tuple(run.key for run in _solved("cpu") if run.key.partition("_")[0] in titles)


EXPERIMENT = Experiment(
    name="solutions",
    title="the base SPH liquid against solutions: ellipse, spin-down, Taylor-Green, plates, capillary wave, meniscus",
    runs=planned,
    checks=checks,
)
