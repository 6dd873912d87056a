"""What is read of a drop: its density and radius, the swing of the mode n = 2 and its fit, its angle on a plane.

Lengths in spacings, rho0 = 1 and the nominal sigma = 1.
"""

import functools
import itertools
import math
import warnings

import numpy as np
from numpy.typing import NDArray

from refsim.engine.simulation import Simulation

RAYLEIGH = {2: 6.0, 3: 8.0}  # omega^2 = k sigma/(rho R^3)
PERIODS = 2.25  # of the oscillation that are fitted
SNAPSHOTS, PER_PERIOD, SNAPSHOTS_ON_PLANE = 40, 24, 45
THIN = 0.03  # Ohnesorge number mu/sqrt(rho sigma R) while measuring
INNER = 0.6  # of R: where density is taken
BALLS = np.linspace(0.4, 0.7, 7)  # of R: in which the pressure is taken


def radius_of(volume: float, dim: int) -> float:
    """Radius of a ball (disc)."""
    return (3 * volume / (4 * math.pi)) ** (1 / 3) if dim == 3 else math.sqrt(volume / math.pi)


def second_moment(simulation: Simulation, dim: int) -> float:
    """Second moment of the mode n = 2 over the mean square radius."""
    x = simulation.field("position").astype(float)
    square = ((x - x.mean(0)) ** 2).mean(0)
    top = square[0] + square[1] - 2 * square[2] if dim == 3 else square[0] - square[1]
    return float(top / square.sum())


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
                fit, _ = curve_fit(curve, times, values, guess, maxfev=4000)
        except RuntimeError:
            continue
        rest = float(np.std(values - curve(times, *fit)) / max(np.std(line), 1e-30))
        if fit[4] > 0 and fit[3] > -0.1 * expected and not rest >= best[2]:
            best = (float(fit[4]), float(fit[3]), rest, abs(float(fit[2])))
    return best


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
