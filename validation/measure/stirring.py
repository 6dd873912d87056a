"""Drops without gravity and on a plane that are stirred and rest: a shifted lattice, random kicks, scenes.

Lengths in spacings, rho0 = 1 and the nominal sigma = 1. A drop's setting is an object with its parameters, such as
`validation.measure.drops.Point`.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.boundary.akinci_2012 import BoxWalls
from refsim.core.effect import Discretisation, Effect
from refsim.engine.simulation import Simulation
from refsim.mpm import MpmLiquid
from refsim.scene.scene import Scene
from refsim.scene.shapes import Ball, Cloud
from refsim.sph import Gravity, WeaklyCompressible
from refsim.study.panels.drops import cap_volume, second_moment
from refsim.surface_tension.akinci_2013 import Akinci2013
from validation.running import run_to

JITTER = 0.1  # of the starting lattice, in spacings: each seed another drop
FLOW = {2: np.array([1.0, -1.0, 0.0]), 3: np.array([0.5, 0.5, -1.0])}  # diagonal of A in v = A x of the mode n = 2
LAMB = {2: 4, 3: 5}  # damping k nu/R^2
RELAXED, SETTLED, AVERAGED = 3.0, 1.0, 2.0  # length of the stages in t_sigma = sqrt(rho R^3/sigma)
STIRRED, STIRS, STIR = 2.0, 20, 0.7  # t_sigma, number and first size [sqrt(sigma/(rho d))] of random kicks
CALM = 0.3  # Ohnesorge number mu/sqrt(rho sigma R) while relaxing
KICK = 0.4  # amplitude of the oscillation, in radii: large enough that the particles' frozen order yields
BOND = 0.2  # of a drop on a plane: rho g R^2/sigma of the nominal tension, the weight that keeps it there
FLOOR = 3.2  # half width of the plane, in R
ON_PLANE = (1.5, 3.0)  # t_sigma until a stirred drop on a plane rests, and in which it is watched


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


def followed(simulation: Simulation, dim: int, times: Iterable[float]) -> tuple[NDArray, NDArray]:
    """Times [s] and second moments, from now on."""
    seen = [(0.0, second_moment(simulation, dim))]
    for time in times:
        run_to(simulation, time)
        seen.append((simulation.time, second_moment(simulation, dim)))
    at, moments = np.array(seen).T.copy()
    return at, moments


def lasting_amplitude(times: NDArray, damping: float, amplitude: float) -> float:
    """Amplitude of the radius that a damped second moment stands for, in the mean."""
    return math.sqrt(float(np.mean(np.exp(-2 * damping * times)))) * amplitude / 2


def relaxed(
    point: Any, scene: Scene, until: float, backend: str, kicked: bool = True,
    look: Callable[[Simulation], object] = lambda simulation: None,
) -> Simulation:  # fmt: skip
    """The drop of a scene at `until` [t_sigma], kicked at random, ever more weakly, for the first STIRRED of these.

    A drop at rest is a solid with the stresses of its freezing. `look` is called after each kick and at the end.
    """
    simulation, random = Simulation(scene, backend), np.random.default_rng(1000 + point.seed)
    unit = math.sqrt(point.radius**3)
    for k in range(STIRS if kicked else 0):
        velocity = simulation.field("velocity").astype(float)
        noise = random.normal(size=velocity.shape)
        noise[:, point.dim :] = 0
        velocity += STIR * (1 - k / STIRS) * (noise - noise.mean(0)) / math.sqrt(point.dim)
        simulation.set_field("velocity", velocity)
        run_to(simulation, STIRRED * unit * (k + 1) / STIRS)
        look(simulation)
    run_to(simulation, until * unit)
    look(simulation)
    return simulation


def _liquid(point: Any, ohnesorge: float) -> Effect:
    """The liquid of a drop, with a viscosity mu = Oh sqrt(rho sigma R)."""
    if point.model == "mpm":
        viscosity = ohnesorge * math.sqrt(point.radius)
        return MpmLiquid(rest_density=1.0, bulk_modulus=1 / point.stiffness, dynamic_viscosity=viscosity)
    return WeaklyCompressible(
        rest_density=1.0, sound_speed=1 / math.sqrt(point.stiffness),
        dynamic_viscosity=ohnesorge * math.sqrt(point.radius), kernels=point.kernels, density=point.liquid,
    )  # fmt: skip


def free_drop(point: Any, position: NDArray, velocity: NDArray | None, ohnesorge: float) -> Scene:
    """The drop as it stands."""
    return Scene(
        name=point.key, spacing=1.0, support_radius=point.support, dim=point.dim, dtype=point.dtype,
        fluid=(Cloud(position=position, velocity=(0.0, 0.0, 0.0) if velocity is None else velocity),),
        effects=(_liquid(point, ohnesorge), *point.tension()),
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
