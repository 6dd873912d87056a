"""Drops without gravity and on a plane: a shifted lattice, random kicks, the swing of the mode n = 2 and its fit.

Lengths in spacings, rho0 = 1 and the nominal sigma = 1. A drop's setting is an object with its parameters, such as
`validation.measure.drops.Point`.
"""

import functools
import itertools
import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim.backends.arrays import unavailable
from refsim.boundary.akinci_2012 import BoxWalls
from refsim.core.effect import Discretisation
from refsim.engine.simulation import Simulation
from refsim.scene.scene import Scene
from refsim.scene.shapes import Ball, Cloud
from refsim.sph import Gravity, WeaklyCompressible
from refsim.study.panels.virial import inner_pressure
from refsim.surface_tension.akinci_2013 import Akinci2013
from refsim.surface_tension.calibration import BASE, BESIDE, SETTINGS
from refsim.surface_tension.contact_angle import calibrate_contact_angle

JITTER = 0.1  # of the starting lattice, in spacings: each seed another drop
FLOW = {2: np.array([1.0, -1.0, 0.0]), 3: np.array([0.5, 0.5, -1.0])}  # diagonal of A in v = A x of the mode n = 2
RAYLEIGH = {2: 6.0, 3: 8.0}  # omega^2 = k sigma/(rho R^3)
LAMB = {2: 4, 3: 5}  # damping k nu/R^2
RELAXED, SETTLED, AVERAGED = 3.0, 1.0, 2.0  # length of the stages in t_sigma = sqrt(rho R^3/sigma)
PERIODS = 2.25  # of the oscillation that are fitted
STIRRED, STIRS, STIR = 2.0, 20, 0.7  # t_sigma, number and first size [sqrt(sigma/(rho d))] of random kicks
CALM, THIN = 0.3, 0.03  # Ohnesorge numbers mu/sqrt(rho sigma R) while relaxing and while measuring
SNAPSHOTS, PER_PERIOD = 40, 24
KICK = 0.4  # amplitude of the oscillation, in radii: large enough that the particles' frozen order yields
INNER = 0.6  # of R: where density is taken
BALLS = np.linspace(0.4, 0.7, 7)  # of R: in which the pressure is taken
BOND = 0.2  # of a drop on a plane: rho g R^2/sigma of the nominal tension, the weight that keeps it there
FLOOR = 3.2  # half width of the plane, in R
ON_PLANE = (1.5, 3.0, 45)  # t_sigma until a stirred drop on a plane rests and in which it is watched, and snapshots
SEED = 10  # of the first drop of a panel: the maps of tension and adhesion hold seeds 1 to 3


def run_to(simulation: Simulation, time: float) -> None:
    """Step until this time is reached."""
    while simulation.time < time:
        simulation.step()


def shifted_ball(
    dim: int, radius: float, random: np.random.Generator, support: float = 2.6, spacing: float = 1.0
) -> NDArray:
    """Particles of a ball (disc) cut from the lattice, shifted at random; `support` in spacings."""
    position = Ball(radius=radius).positions(Discretisation(dim, "float64", spacing, support * spacing, 0))
    position[:, :dim] += JITTER * spacing * random.uniform(-1, 1, (len(position), dim))
    return position - position.mean(0)


def kicks(random: np.random.Generator, count: int, dim: int) -> NDArray:
    """Random velocities (count, 3) of variance 1/dim."""
    kick = np.zeros((count, 3))
    kick[:, :dim] = random.normal(size=(count, dim)) / math.sqrt(dim)
    return kick


def radius_of(volume: float, dim: int) -> float:
    """Radius of a ball (disc)."""
    return (3 * volume / (4 * math.pi)) ** (1 / 3) if dim == 3 else math.sqrt(volume / math.pi)


def second_moment(simulation: Simulation, dim: int) -> float:
    """Second moment of the mode n = 2 over the mean square radius."""
    x = simulation.field("position").astype(float)
    square = ((x - x.mean(0)) ** 2).mean(0)
    top = square[0] + square[1] - 2 * square[2] if dim == 3 else square[0] - square[1]
    return float(top / square.sum())


def followed(simulation: Simulation, dim: int, times: Iterable[float]) -> tuple[NDArray, NDArray]:
    """Times [s] and second moments, from now on."""
    seen = [(0.0, second_moment(simulation, dim))]
    for time in times:
        run_to(simulation, time)
        seen.append((simulation.time, second_moment(simulation, dim)))
    at, moments = np.array(seen).T.copy()
    return at, moments


def fit_oscillation(times: NDArray, values: NDArray, expected: float) -> tuple[float, float, float, float]:
    """(omega [1/s], beta [1/s], misfit, A) of a + b t + A exp(-beta t) sin(omega t + phi); NaN where nothing fits.

    misfit  rms of what is left over the rms of the values about their line
    """
    from scipy.optimize import OptimizeWarning, curve_fit

    def curve(t: NDArray, a: float, b: float, amplitude: float, beta: float, omega: float, phase: float) -> NDArray:
        return a + b * t + amplitude * np.exp(-beta * t) * np.sin(omega * t + phase)

    spread = float(np.abs(values - values[0]).max())
    best = (math.nan, math.nan, math.nan, math.nan)
    line = values - np.polyval(np.polyfit(times, values, 1), times)
    for factor, damping in itertools.product((0.6, 0.8, 1.0, 1.25, 1.5), (0.05, 0.3)):
        guess = (float(values[0]), 0.0, spread, damping * expected, factor * expected, 0.0)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", OptimizeWarning)
                found, _ = curve_fit(curve, times, values, guess, maxfev=4000)
        except RuntimeError:
            continue
        rest = float(np.std(values - curve(times, *found)) / max(np.std(line), 1e-30))
        if found[4] > 0 and found[3] > -0.1 * expected and not rest >= best[2]:
            best = (float(found[4]), float(found[3]), rest, abs(float(found[2])))
    return best


def lasting_amplitude(times: NDArray, damping: float, amplitude: float) -> float:
    """Amplitude of the radius that a damped second moment stands for, in the mean."""
    return math.sqrt(float(np.mean(np.exp(-2 * damping * times)))) * amplitude / 2


def stir(simulation: Simulation, point: Any, until: float, look: Callable[[], None] = lambda: None) -> None:
    """Kick all particles at random, ever more weakly: a drop at rest is a solid with the stresses of its freezing."""
    random = np.random.default_rng(1000 + point.seed)
    for k in range(STIRS):
        velocity = simulation.field("velocity").astype(float)
        noise = random.normal(size=velocity.shape)
        noise[:, point.dim :] = 0
        velocity += STIR * (1 - k / STIRS) * (noise - noise.mean(0)) / math.sqrt(point.dim)
        simulation.set_field("velocity", velocity)
        run_to(simulation, until * (k + 1) / STIRS)
        look()


def _liquid(point: Any, ohnesorge: float) -> WeaklyCompressible:
    """The liquid of a drop, with a viscosity mu = Oh sqrt(rho sigma R)."""
    return WeaklyCompressible(
        rest_density=1.0, sound_speed=1 / math.sqrt(point.stiffness),
        dynamic_viscosity=ohnesorge * math.sqrt(point.radius), kernels=point.kernels, density=point.liquid,
    )  # fmt: skip


def free_drop(point: Any, position: NDArray, velocity: NDArray | None, ohnesorge: float) -> Scene:
    """The drop as it stands."""
    return Scene(
        name=point.key, spacing=1.0, support_radius=point.support, dim=point.dim, dtype=point.dtype,
        fluid=(Cloud(position=position, velocity=(0.0, 0.0, 0.0) if velocity is None else velocity),),
        effects=(_liquid(point, ohnesorge), SETTINGS[point.model][1](1.0), *BESIDE.get(point.model, ())),
    )  # fmt: skip


def cap(point: Any) -> NDArray:
    """Particles of a cap on the plane z = 0 (y = 0 in 2D), cut from the lattice and shifted at random."""
    angle = math.radians(point.begin)
    radius = point.radius * (cap_volume(math.pi / 2, point.dim) / cap_volume(angle, point.dim)) ** (1 / point.dim)
    reach = math.ceil(2 * radius)
    axes = [np.arange(-reach, reach) + 0.5] * (point.dim - 1) + [np.arange(reach) + 0.5]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, point.dim)
    centre = np.zeros(point.dim)
    centre[-1] = -radius * math.cos(angle)
    lattice = lattice[((lattice - centre) ** 2).sum(1) < radius**2]
    position = np.zeros((len(lattice), 3))
    position[:, : point.dim] = lattice
    random = np.random.default_rng(point.seed)
    position[:, : point.dim] += JITTER * random.uniform(-1, 1, lattice.shape)
    return position


def sessile(point: Any, position: NDArray) -> Scene:
    """The drop over the plane."""
    fluid = _liquid(point, CALM)
    grid = Discretisation(point.dim, "float64", 1.0, point.support, 0)
    gamma = Akinci2013(surface_tension=1.0).coefficient(grid, {"weakly_compressible": fluid})
    up, width = point.dim - 1, float(math.ceil(FLOOR * point.radius))
    lower: Any = [-width] * 3
    weight: Any = [0.0] * 3
    lower[up], weight[up] = 0.0, -BOND / point.radius**2
    sides: Any = tuple(face for face in ("-x", "+x", "-y", "+y", "-z", "+z") if face != "-" + "xyz"[up])
    floor = BoxWalls(lower=tuple(lower), upper=(width,) * 3, open_faces=sides)
    tension = Akinci2013(surface_tension=1.0, adhesion=point.share * gamma)
    return Scene(
        name=point.key, spacing=1.0, support_radius=point.support, dim=point.dim, fluid=(Cloud(position=position),),
        effects=(fluid, tension, floor, Gravity(acceleration=tuple(weight))),
    )  # fmt: skip


def cap_volume(angle: float, dim: int) -> float:
    """Volume (area in 2D) of a spherical cap of radius 1 with a contact angle [rad]."""
    c = math.cos(angle)
    return math.pi / 3 * (2 + c) * (1 - c) ** 2 if dim == 3 else angle - math.sin(angle) * c


@functools.cache
def _lifts(dim: int) -> tuple[NDArray, NDArray]:
    """Contact angles [degrees] and the height of the centre of mass over volume^(1/dim) of each cap."""
    angles, lifts = np.linspace(2.0, 178.0, 353), []
    for angle in np.radians(angles):
        z = np.linspace(0.0, 1 - math.cos(angle), 801)
        across = np.maximum(1 - (z + math.cos(angle)) ** 2, 0) ** (1.0 if dim == 3 else 0.5)
        centre = np.trapezoid(z * across, z) / np.trapezoid(across, z)
        lifts.append(centre / cap_volume(float(angle), dim) ** (1 / dim))
    return angles, np.array(lifts)


def angle_by_lift(lift: float, dim: int) -> float:
    """Contact angle [degrees] of the cap whose centre of mass stands at `lift` = height/volume^(1/dim)."""
    angles, lifts = _lifts(dim)
    return float(np.interp(lift, lifts, angles))


def inside(simulation: Simulation, radius: float) -> tuple[float, float]:
    """(mean density of the particles within INNER of a drop's nominal radius, radius of the drop with that density)."""
    x, dim = simulation.field("position").astype(float), simulation.plan.grid.dim
    within = np.linalg.norm(x - x.mean(0), axis=1) < INNER * radius
    density = float(simulation.field("density").astype(float)[within].mean())
    return density, radius_of(simulation.field("mass").astype(float).sum() / density, dim)


# Scenes of panels


@dataclass(frozen=True)
class Drop:
    """A disc of a panel, or on a plane a half disc."""

    radius: float
    seed: int
    model: str = "akinci"
    dtype: Any = "float32"
    dim: Any = 2
    support: float = BASE["support"]
    stiffness: float = BASE["stiffness"]
    kernels: Any = BASE["kernels"]
    liquid: Any = "summation"  # `density` of weakly_compressible
    begin: float = 90.0
    share: float = 0.0
    key: str = "drop"

    @property
    def time(self) -> float:
        """t_sigma [s]."""
        return math.sqrt(self.radius**3)


def surface_tension_jump(given: Mapping[str, Any], seed: int = 0) -> Scene:
    """A disc that was stirred and has relaxed, and comes to rest with less viscosity."""
    drop = Drop(given["radius"], SEED + seed, given["model"], given["dtype"])
    start = shifted_ball(2, drop.radius, np.random.default_rng(drop.seed), drop.support)
    calm = Simulation(free_drop(drop, start, None, CALM), _there(given))
    stir(calm, drop, STIRRED * drop.time)
    run_to(calm, RELAXED * drop.time)
    scene = free_drop(drop, calm.field("position").astype(float), None, THIN)
    return msgspec.structs.replace(scene, end_time=(SETTLED + AVERAGED) * drop.time)


def surface_tension_frequency(given: Mapping[str, Any], seed: int = 0) -> Scene:
    """The same disc at rest, kicked into its mode 2."""
    rest = Simulation(surface_tension_jump(given, seed), _there(given))
    samples = []
    for k in range(SNAPSHOTS):
        run_to(rest, (SETTLED + AVERAGED * (k + 1) / SNAPSHOTS) * rest.plan.scene.end_time / (SETTLED + AVERAGED))
        rest.evaluate()
        radius = inside(rest, given["radius"])[1]
        samples.append((radius, inner_pressure(rest, BALLS * radius)))
    radius, pressure = np.mean(samples, axis=0)
    nominal = math.sqrt(RAYLEIGH[2] / radius**3)
    x, v = rest.field("position").astype(float), rest.field("velocity").astype(float)
    x = x - x.mean(0)
    drop = Drop(given["radius"], SEED + seed, given["model"], given["dtype"])
    scene = free_drop(drop, x, v - v.mean(0) + KICK * nominal * FLOW[2] * x, THIN)
    expected = nominal * math.sqrt(max(pressure * radius, 0.25))
    return msgspec.structs.replace(scene, end_time=PERIODS * 2 * math.pi / expected)


def contact_angle(given: Mapping[str, Any], seed: int = 0) -> Scene:
    """A half disc on a plane that asks for 90 degrees; it was stirred and rests."""
    share = calibrate_contact_angle(90.0, 1.0, spacing=1.0, rest_density=1.0, dim=2).share
    drop = Drop(given["radius"], SEED + seed, share=share)
    calm = Simulation(sessile(drop, cap(drop)), _there(given))
    stir(calm, drop, STIRRED * drop.time)
    run_to(calm, (STIRRED + ON_PLANE[0]) * drop.time)
    place, velocity = (calm.field(name).astype(float) for name in ("position", "velocity"))
    fluid = (Cloud(position=place, velocity=velocity),)
    return msgspec.structs.replace(sessile(drop, place), fluid=fluid, end_time=ON_PLANE[1] * drop.time)


def _there(given: Mapping[str, Any]) -> str:
    """The setting's backend, where it is available."""
    return str(given["backend"]) if unavailable(given["backend"]) is None else "cpu"
