"""What heat does in closed form, and a melting sphere by another program: one dimension, thousands of thin shells.

Everywhere k = rho = c = 1 (SI units) and the melting point is 0 deg C.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import erf, erfc, erfcx


def cosine(x: np.ndarray, length: float, until: float) -> np.ndarray:
    """50 + 50 cos(pi x/length) [deg C] in an insulated slab, after so many seconds."""
    wave = math.pi / length
    return 50 + 50 * np.cos(wave * x) * math.exp(-(wave**2) * until)


def cooled_sphere(r: np.ndarray, radius: float, until: float, terms: int = 400) -> np.ndarray:
    """T of a sphere of 1 deg C whose surface is held at 0: the series of Carslaw & Jaeger 1959, section 9.3 (III).

    2 R/(pi r) sum (-1)^(n+1)/n sin(n pi r/R) exp(-n^2 pi^2 t/R^2).
    """
    n = np.arange(1, terms + 1)
    weight = 2.0 * (-1.0) ** (n + 1) * np.exp(-((n * math.pi / radius) ** 2) * until)
    return np.sinc(np.minimum(np.asarray(r, dtype=float), radius)[..., None] / radius * n) @ weight


def stefan_root(wall: float, start: float, latent: float) -> float:
    """lambda of Neumann's solution, front s = 2 lambda sqrt(t): a wall at `wall` > 0 deg C, ice at `start` <= 0 deg C.

    Ste/(exp(l^2) erf l) - cold/(exp(l^2) erfc l) = sqrt(pi) l, Ste = wall/L, cold = -start/L (Alexiades & Solomon 1993,
    section 2.2).
    """
    ste, cold = wall / latent, -start / latent

    def miss(root: float) -> float:
        return ste * math.exp(-(root**2)) / erf(root) - cold / erfcx(root) - math.sqrt(math.pi) * root

    return float(brentq(miss, 1e-9, 10.0, xtol=1e-15))


def stefan_profile(x: np.ndarray, until: float, wall: float, start: float, root: float) -> np.ndarray:
    """Neumann's temperatures [deg C] at depth x [m], u = x/(2 sqrt t), l = `root`.

    wall (1 - erf(u)/erf(l)) above the front, start (1 - erfc(u)/erfc(l)) below it.
    """
    u = np.asarray(x, dtype=float) / (2 * math.sqrt(until))
    return np.where(u < root, wall * (1 - erf(u) / erf(root)), start * (1 - erfc(u) / erfc(root)))


class Melting(NamedTuple):
    """How a shell melts from its held surface: times [s] and ice volume over the first one."""

    time: np.ndarray
    ice: np.ndarray

    def at(self, time: np.ndarray) -> np.ndarray:
        """Ice volume over the first one, at times [s]."""
        return np.interp(time, self.time, self.ice)


def melting_shell(
    inner: float, outer: float, cells: int, wall: float, start: float, latent: float, until: float
) -> Melting:
    """Ice between two radii [m], insulated inside, its outer surface held at `wall` [deg C].

    Finite volumes of the enthalpy in one dimension, forward Euler: nothing of it is shared with the particles. Written
    in volumes and areas, so that inner = 0 is a sphere and inner >> outer - inner a plane wall.
    """
    faces = np.linspace(inner, outer, cells + 1)
    volume = np.diff(faces**3) / 3
    area = faces[1:] ** 2
    width = (outer - inner) / cells
    weight = area / np.append(np.full(cells - 1, width), width / 2)
    step = 0.2 * width**2
    steps = math.ceil(until / step)
    enthalpy = np.full(cells, float(start))
    step_over_volume = step / volume
    flow, temperature = np.zeros(cells + 1), np.empty(cells)
    times, ice = [], []
    every = max(1, steps // 4000)
    for k in range(steps + 1):
        if k % every == 0:
            solid = 1 - np.clip(enthalpy / latent, 0, 1)
            times.append(k * step)
            ice.append(float(solid @ volume / volume.sum()))
            if ice[-1] == 0.0:
                break
        np.subtract(enthalpy, np.clip(enthalpy, 0.0, latent), out=temperature)
        flow[1:-1] = weight[:-1] * (temperature[1:] - temperature[:-1])
        flow[-1] = weight[-1] * (wall - temperature[-1])
        enthalpy += step_over_volume * (flow[1:] - flow[:-1])
    return Melting(np.array(times), np.array(ice))


def quasi_steady_melting_time(wall: float, latent: float) -> float:
    """Time [s] in which a sphere of 1 m at its melting point melts, Ste = wall/L << 1: (1 + Ste)/(6 Ste).

    The quasi-steady 1/6 and its first correction (Pedroso & Domoto 1973; Riley, Smith & Poots 1974).
    """
    ste = wall / latent
    return (1 + ste) / (6 * ste)
