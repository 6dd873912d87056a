"""Drops that spin, with either form of the viscosity.

Lengths in spacings, rho0 = 1, nominal sigma = 1. The tension acts along the pair: Akinci 2013 without its area term."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import Akinci2013, Cloud, Scene, Simulation, WeaklyCompressible
from refsim.study.panels.drops import radius_of
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, RunSpec
from validation.measure.stirring import FLOW, LAMB, kicks, shifted_ball
from validation.results import Result
from validation.running import Context, run_to

FORMS = ("laplacian", "central")
SUPPORT, STIFFNESS = 2.6, 0.01  # h/d; S = sigma/(rho0 c^2 d)
STIRS, STIR = 20, 0.7  # random kicks, ever weaker, in sqrt(sigma/(rho d))
STIRRED, RESTED = 2.0, 2.0  # stages in t_sigma = sqrt(rho R^3/sigma)
CALM = 0.3  # Ohnesorge number mu/sqrt(rho sigma R) while relaxing and while spinning
SPIN = 0.1  # angular velocity in 1/t_sigma: the drop stays round
TURNED = 1.5  # length of the spin-down, in R^2/(5 nu), R^2/(4 nu) in 2D


def scene(form: Any, dim: Any, position: NDArray, velocity: NDArray, viscosity: float) -> Scene:
    """The drop as it stands; mu in units of sqrt(rho sigma d)."""
    fluid = WeaklyCompressible(
        rest_density=1.0, sound_speed=1 / math.sqrt(STIFFNESS), dynamic_viscosity=viscosity, viscosity=form,
        kernels="mueller", density="summation",
    )  # fmt: skip
    return Scene(
        name=f"{form} {dim}d", spacing=1.0, support_radius=SUPPORT, dim=dim, dtype="float64",
        fluid=(Cloud(position=position, velocity=velocity),),
        effects=(fluid, Akinci2013(surface_tension=1.0, area_acceleration=0.0)),
    )  # fmt: skip


def relaxed(context: Context, dim: int, radius: float, seed: int) -> tuple[NDArray, float, dict[str, Any]]:
    """(positions about the centre, radius of the drop's volume, what it is) of a drop that was stirred and rests."""
    random, unit = np.random.default_rng(seed), radius**1.5
    position = shifted_ball(dim, radius, random, SUPPORT)
    made = scene("central", dim, position, np.zeros_like(position), CALM * math.sqrt(radius))
    simulation = context.simulation(made, "cpu")
    for k in range(STIRS):
        kick = kicks(random, len(position), dim)
        simulation.set_field("velocity", simulation.field("velocity") + STIR * (1 - k / STIRS) * (kick - kick.mean(0)))
        run_to(simulation, STIRRED * unit * (k + 1) / STIRS)
    run_to(simulation, (STIRRED + RESTED) * unit)
    simulation.evaluate()
    x = simulation.field("position") - simulation.field("position").mean(0)
    density = simulation.field("density")[np.linalg.norm(x, axis=1) < 0.6 * radius].mean()
    size = radius_of(simulation.field("mass").sum() / density, dim)
    return x, size, {"dim": dim, "radius": radius, "seed": seed, "particles": len(x), "size": size}


def spin(context: Context, dim: int, radius: float, seed: int) -> Result:
    """One relaxed drop under either form: its angular momentum over time, turning as a rigid body, and its damping.

    braking.<form>  rate of decay of L, fitted to log L, over 5 nu/R^2 (4 in 2D)
    change.<form>   largest |L/L(0) - 1|
    damping.<form>  P/(4 K) over 5 nu/R^2 (4 in 2D), with the power P of the viscous forces and the kinetic energy K of
                    the flow v = A x of the mode n = 2: Lamb's damping, whose energy 2 K falls by P/2 in the mean
    """
    position, size, values = relaxed(context, dim, radius, seed)
    viscosity = CALM * math.sqrt(radius)
    expected = LAMB[dim] * viscosity / size**2
    arrays: dict[str, NDArray] = {}
    for share, form in enumerate(FORMS):
        velocity = np.cross([0.0, 0.0, SPIN / radius**1.5], position)
        simulation = context.simulation(scene(form, dim, position, velocity, viscosity), "cpu")
        times, momenta = [0.0], [_angular_momentum(simulation)]
        for k in range(30):
            run_to(simulation, TURNED / expected * (k + 1) / 30)
            times.append(simulation.time)
            momenta.append(_angular_momentum(simulation))
        left = np.array(momenta) / momenta[0]
        values[f"braking.{form}"] = float(-np.polyfit(times, np.log(left), 1)[0] / expected)
        values[f"change.{form}"] = float(np.abs(left - 1).max())
        flow = position * FLOW[dim]
        moving, resting = (
            _accelerations(context, scene(form, dim, position, v, viscosity)) for v in (flow, np.zeros_like(flow))
        )
        power, energy = -(flow * (moving - resting)).sum(), 0.5 * (flow**2).sum()  # of equal masses
        values[f"damping.{form}"] = float(power / (4 * energy) / expected)
        arrays |= {f"time.{form}": np.array(times) * expected, f"left.{form}": left}
        context.progress(0.5 + 0.25 * (share + 1))
    return Result(values, arrays)


def _accelerations(context: Context, made: Scene) -> NDArray:
    """Accelerations (n, 3) of a scene as it starts, in its own order of particles."""
    simulation = context.simulation(made, "cpu")
    simulation.evaluate()
    place = np.argsort(simulation.field("identity"))
    return simulation.field("acceleration")[place]


def _angular_momentum(simulation: Simulation) -> float:
    """About the z axis through the origin, which the drop does not leave."""
    x, v, m = (simulation.field(name) for name in ("position", "velocity", "mass"))
    return float((m * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])).sum())


# Spin and damping of free drops with either form of the viscosity, against rigid rotation and Lamb.


RADII = {2: (8.0, 16.0, 32.0), 3: (5.0, 7.0, 10.0)}  # in spacings
SEED = 2


def planned(options: Options) -> list[RunSpec]:
    """Three sizes in 2D and in 3D; with --quick the smallest in 2D."""
    if options.quick:
        return [_spin(2, RADII[2][0])]
    return [_spin(dim, radius) for dim, radii in RADII.items() for radius in radii]


def _spin(dim: int, radius: float) -> RunSpec:
    drop = {"dim": dim, "radius": radius, "seed": SEED}
    return RunSpec(f"spin_{dim}d_{radius:g}", spin, drop, estimate=0.02 * radius**dim)


def checks(results: Results, check: Checks) -> None:
    """Angular momentum, its braking, and the damping of n = 2; the rates are judged on the largest drops."""
    for key, result in results.items():
        row = result.values
        words = f"{row['dim']}D, R = {row['radius']:g} d"
        check("kept", row["change.central"], key, words)
        check("braking", row["braking.laplacian"], key, words)
        for form in FORMS:
            check("damping", row[f"damping.{form}"], f"{key}.{form}", f"{form}, {words}")
        if row["radius"] == RADII[row["dim"]][-1]:
            check("braking_off", abs(row["braking.laplacian"] - 1), key, words)
            check("damping_off", abs(row["damping.central"] - 1), key, words)


EXPERIMENT = Experiment(
    name="viscosity", title="spin-down and damping (n = 2) of free drops with either form of the viscosity",
    runs=planned, checks=checks,
)  # fmt: skip
