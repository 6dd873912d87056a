"""What every drop is put through: a shifted lattice, random kicks, the swing of the mode n = 2 and its fit."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from refsim import Ball, Simulation
from refsim.core.effect import Discretisation

JITTER = 0.1  # of the starting lattice, in spacings: each seed another drop
FLOW = {2: np.array([1.0, -1.0, 0.0]), 3: np.array([0.5, 0.5, -1.0])}  # diagonal of A in v = A x of the mode n = 2
RAYLEIGH = {2: 6.0, 3: 8.0}  # omega^2 = k sigma/(rho R^3)
LAMB = {2: 4, 3: 5}  # damping k nu/R^2


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
