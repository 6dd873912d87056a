"""Observables of the panels: functions of a simulation, one for each packaged scene, called as the panel is.

`times` and `reduce` of a function say when it is read and how one number follows (`refsim/study/observables.py`).
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from refsim.engine.simulation import Simulation
from refsim.scene.scene import Scene
from refsim.sph import liquid_of
from refsim.sph.resting import column_of
from refsim.study.observables import observable_of
from refsim.study.panels import FOLDER, drops
from refsim.study.panels.drops import inner_pressure
from refsim.study.panels.scenes import MODULUS, frequency, radius
from refsim.surface_tension.calibration import BASE, sigma_map

GRAVITY, DENSITY, REYNOLDS = 9.81, 1000.0, 100.0  # m/s^2; kg/m^3, in the plane kg/m^2; of the vortices
DIRECTIONS, CONE = 200, np.radians(10)
FALL = np.sqrt(0.5 / (2 * 9.81))  # sqrt(L/(2g)) of the dam break [s]
STEFAN = 0.42877773257020996  # front of melt_front over 2 sqrt(a t): Neumann's solution for Stefan numbers 0.5 and 0.1
DETECTING = ("surface_detection.", "surface_normal.")  # names of the stages of a detector
BASIN, EDGE = 1.6, 0.8  # of the floating box [m]


def watched(times: Callable[[Scene], Any], reduce: Callable[[np.ndarray, list[Any]], float]) -> Callable[[Any], Any]:
    """Give a function the moments at which it is read, and what makes one number of them."""

    def give(read: Any) -> Any:
        read.times, read.reduce = times, reduce
        return read

    return give


def mean(times: np.ndarray, values: list[Any]) -> float:
    """Mean of the values."""
    return float(np.mean(values))


def kept(times: np.ndarray, values: list[Any]) -> float:
    """What a falling value keeps: the largest of the last third; NaN where one of them is not finite."""
    late = np.asarray(values, dtype=float)[int(2 / 3 * len(values)) :]
    return float(late.max()) if np.isfinite(late).all() else float("nan")


@watched(
    lambda scene: FALL * np.linspace(0.95, 3.05, 43),
    lambda times, values: float(np.interp(np.linspace(1.0, 3.0, 41), times / FALL, values).mean()),
)
def front(simulation: Simulation) -> float:
    """Edge of the connected liquid over the column's width of 0.5 m; its mean from t sqrt(2g/L) = 1 to 3."""
    return observable_of("front", simulation.plan)(simulation) / 0.5


@watched(lambda scene: np.linspace(0.0, scene.end_time, 46), kept)
def droplet(simulation: Simulation) -> float:
    """std/mean over Fibonacci directions of the greatest distance from the centre within 10 degrees; what is kept."""
    offset = simulation.field("position").astype(float)
    offset -= offset.mean(0)
    radius = np.linalg.norm(offset, axis=1)
    number = np.arange(DIRECTIONS)
    z = 1 - (2 * number + 1) / DIRECTIONS
    angle, ring = np.pi * (3 - np.sqrt(5)) * number, np.sqrt(1 - z**2)
    axis = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    within = offset @ axis.T > np.cos(CONE) * radius[:, None]
    outermost = np.where(within, radius[:, None], 0.0).max(axis=0)
    return float(outermost.std() / outermost.mean())


@watched(lambda scene: scene.end_time - 2.5 + np.linspace(0.0, 2.5, 101), mean)
def coupling(simulation: Simulation) -> float:
    """Height of the box's centre over the level of water and half of the box, over its edge; mean of the last 2.5 s."""
    plan = simulation.plan
    assert plan.grid.solids is not None
    box = simulation.field("position")[: len(plan.grid.solids.lattice.key), 2].astype(float)
    volume = plan.grid.spacing**3 * (plan.grid.count - 0.5 * len(box))
    return float(box.mean() - volume / BASIN**2) / EDGE


@watched(lambda scene: scene.end_time * np.linspace(0.8, 1.0, 61), mean)
def wall_force(simulation: Simulation) -> float:
    """Force on a side wall over that of the compressible liquid at rest, 1 m wide."""
    series, plan = simulation.gauge("wall")["force_x"], simulation.plan
    return -float(series[-1]) / column_of(plan.effects, plan.state.mass.sum()).side_force()


def vortex_decay(simulation: Simulation) -> float:
    """Rate at which the speed decays over 8 pi^2/Re, that of one wave in the box of 1 m."""
    position, speed = simulation.field("position").astype(float), simulation.field("velocity").astype(float)
    speed += 0.5 * simulation.previous_length * simulation.field("acceleration")
    x, y = 2 * np.pi * position[:, 0], 2 * np.pi * position[:, 1]
    first = (np.sin(x) * np.cos(y)) ** 2 + (np.cos(x) * np.sin(y)) ** 2
    return float(-0.5 * np.log((speed**2).sum() / first.sum()) / simulation.time * REYNOLDS / (8 * np.pi**2))


def spinning_body(simulation: Simulation) -> float:
    """L_z/I_zz about the centre of mass at the end, over that of the start, 2 pi/s."""
    position, velocity, mass = (simulation.field(name).astype(float) for name in ("position", "velocity", "mass"))
    x = position - np.average(position, axis=0, weights=mass)
    v = velocity - np.average(velocity, axis=0, weights=mass)
    turning = (mass * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])).sum()
    return float(turning / (mass * (x[:, 0] ** 2 + x[:, 1] ** 2)).sum() / (2 * np.pi))


def heat(simulation: Simulation) -> float:
    """Root mean square of T - T_exact of the cosine at the end [% of the range of 100 degrees C]."""
    x, length = simulation.field("position")[:, 0].astype(float), 4.0
    decay = np.exp(-((np.pi / length) ** 2) * simulation.time)
    off = simulation.field("temperature").astype(float) - 50 - 50 * np.cos(np.pi * x / length) * decay
    return float(np.sqrt((off**2).mean()))


def _largest_error(times: np.ndarray, values: list[Any]) -> float:
    known = 2 * STEFAN * np.sqrt(times)
    late = times >= (0.25 - 1e-9) * times[-1]
    return float(100 * np.abs(np.array(values) / known - 1)[late].max())


@watched(lambda scene: scene.step * np.arange(1, round(scene.end_time / scene.step) + 1), _largest_error)
def melt_front(simulation: Simulation) -> float:
    """Melted depth from the first held layer on [m]; its largest error [%] over the last three quarters of the time."""
    spacing, wide = simulation.plan.grid.spacing, simulation.plan.grid.period[1] / simulation.plan.grid.spacing
    return float(_molten(simulation).sum() * spacing / round(wide) ** 2 + 0.5 * spacing)


def _molten(simulation: Simulation) -> np.ndarray:
    """Share of each particle of the second part, the ice, that is liquid."""
    ice = slice(simulation.plan.state.sizes[0], None)
    return np.clip(simulation.field("enthalpy")[ice] / simulation.field("latent_heat")[ice], 0, 1)


@watched(lambda scene: np.zeros(21), lambda times, values: float(values[-1][1]))
def detection_2d(simulation: Simulation) -> tuple[float, float]:
    """(seconds of threshold, normals and scan; 1 - F1 against the exact surface)."""
    before, began, used = dict(simulation.timings.stages), time.perf_counter(), time.process_time()
    simulation.evaluate()
    share = 1.0 if simulation.backend.name == "cuda" else (time.process_time() - used) / (time.perf_counter() - began)
    stages = simulation.timings.stages.items()
    spent = share * sum(seconds - before.get(name, 0.0) for name, seconds in stages if name.startswith(DETECTING))
    with np.load(str(FOLDER / f"{simulation.plan.scene.name}.npz")) as stored:
        truth = stored["surface"]
    marked = simulation.field("surface").astype(bool)
    return spent, 1 - 2 * int((marked & truth).sum()) / max(int(marked.sum()) + int(truth.sum()), 1)


def _spent(values: list[Any]) -> float:
    """Median seconds of the readings that were not the first, which may compile; of the only one."""
    return float(np.median([spent for spent, _ in values[1:] or values]))


detection_2d.seconds = _spent
detection_3d = detection_2d


def melting(simulation: Simulation) -> float:
    """Share of the ball that is ice; its melt time is that at which none is left."""
    return 1 - float(_molten(simulation).mean())


def _resting(times: np.ndarray, values: list[Any]) -> float:
    """Root mean square of p - p_exact over that at the bottom, of places and pressures in the mean of the samples."""
    place, pressure = (np.mean([sample[k] for sample in values], axis=0) for k in (0, 1))
    known, bulk, bottom = values[0][2](place)
    return float(np.sqrt((((pressure - known) / bottom)[bulk] ** 2).mean()))


@watched(lambda scene: scene.end_time * np.linspace(0.8, 1.0, 61), _resting)
def implicit_pressure(simulation: Simulation) -> Any:
    """Places, pressures and what is known of them farther than h from walls and surface: rho g (H - y), and that of the
    compressible liquid without the solver."""
    plan = simulation.plan
    implicit, reach = "iisph" in plan.effects, plan.grid.support_radius
    if not implicit:
        simulation.evaluate()
    resting = column_of(plan.effects, plan.state.mass.sum())

    def known(place: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        y, bulk = place[:, 1], (np.minimum(place, 1 - place)[:, :2] > reach).all(1)
        return DENSITY * GRAVITY * (1 - y) if implicit else resting.pressure(y), bulk, DENSITY * GRAVITY

    return *(simulation.field(name).astype(float) for name in ("position", "pressure")), known


@watched(lambda scene: scene.end_time * np.linspace(2.5, 3.0, 41) / 3.0, _resting)
def tank_pressure(simulation: Simulation) -> Any:
    """Places, pressures and what is known of them: hydrostatic pressure of the compressible liquid."""
    simulation.evaluate()
    plan, height = simulation.plan, 0.1
    water: Any = plan.scene.fluid[0]
    resting = column_of(plan.effects, plan.state.mass.sum() / height**2)

    def known(place: np.ndarray) -> tuple[np.ndarray, slice, float]:
        return resting.pressure(place[:, 2] - water.lower[2]), slice(None), DENSITY * GRAVITY * height

    return *(simulation.field(name).astype(float) for name in ("position", "pressure")), known


@watched(lambda scene: scene.end_time * np.linspace(0.25, 1.0, 301), mean)
def mpm_pressure(simulation: Simulation) -> float:
    """Mean pressure over Laplace's k/R."""
    ratio = simulation.field("volume_ratio").astype(float)
    return -MODULUS * float(((ratio - 1) * ratio).sum() / ratio.sum()) * radius(simulation.plan.scene)


def _over_rayleigh(times: np.ndarray, values: list[Any]) -> float:
    known = values[0][1]
    return float(np.hypot(*drops.fit_oscillation(times, np.array([shape for shape, _ in values]), known)[:2]) / known)


@watched(lambda scene: scene.end_time * np.linspace(0.0, 1.0, 401), _over_rayleigh)
def mpm_frequency(simulation: Simulation) -> Any:
    """Mode 2 of the disc, and Rayleigh's frequency [rad/s], which its own is held against."""
    return drops.second_moment(simulation, 2), frequency(simulation.plan.scene)


def _drop(simulation: Simulation) -> tuple[float, float]:
    """(radius of a disc [spacings], tension of its model's flat surface in 2D over the nominal one, by the map)."""
    models, effects = ("akinci_2013", "jiang_zhu_2023", "dong_2016"), simulation.plan.effects
    (model,) = (name[:-5] for name in effects if name in models)
    wanted = {"model": model, "dim": 2, **BASE}.items()
    simulation.evaluate()
    _, radius = drops.inside(simulation, (liquid_of(effects).dynamic_viscosity / drops.THIN) ** 2)
    return radius, next(float(entry["flat_laplace"]) for entry in sigma_map() if wanted <= entry.items())


def _jump(times: np.ndarray, values: list[Any]) -> float:
    pressure, radius, flat = np.mean(values, axis=0)
    return float(pressure * radius / flat)


@watched(lambda scene: scene.end_time / 3 * (1 + 2 * np.arange(1, drops.SNAPSHOTS + 1) / drops.SNAPSHOTS), _jump)
def surface_tension_jump(simulation: Simulation) -> Any:
    """Pressure of the pair forces within a disc, its radius, and the flat tension: R P over the last."""
    size, flat = _drop(simulation)
    return inner_pressure(simulation, drops.BALLS * size), size, flat


def _swing(times: np.ndarray, values: list[Any]) -> float:
    moments, (size, flat) = np.array([moment for moment, _ in values]), values[0][1]
    expected = drops.PERIODS * 2 * np.pi / times[-1]
    omega, damping, _, _ = drops.fit_oscillation(times, moments, expected)
    return float(np.sqrt((omega**2 + damping**2) * size**3 / drops.RAYLEIGH[2] / flat))


@watched(lambda scene: scene.end_time * np.linspace(0, 1, 1 + round(drops.PERIODS * drops.PER_PERIOD)), _swing)
def surface_tension_frequency(simulation: Simulation) -> Any:
    """Mode 2 of a disc; at first its radius and the flat tension. Frequency over Rayleigh's with the flat tension."""
    return drops.second_moment(simulation, 2), None if simulation.steps else _drop(simulation)


@watched(lambda scene: scene.end_time * np.linspace(0, 1, drops.SNAPSHOTS_ON_PLANE + 1)[1:], mean)
def contact_angle(simulation: Simulation) -> float:
    """Angle of the cap with the drop's volume and centre of mass [degrees]."""
    simulation.evaluate()
    height = simulation.field("position").astype(float)[:, 1]
    size = len(height) / float(np.median(simulation.field("density")))
    return drops.angle_by_lift(float(height.mean()) / np.sqrt(size), 2)
