"""Sums of other programs over all pairs, by their formulas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from refsim.neighbours.reference import pair_blocks
from refsim.smoothing import smoothing
from refsim.smoothing.reference import kernel_slope


@dataclass(frozen=True)
class Sums:
    """Sums of the other programs over all pairs, cubic spline; SI units. `support` is the radius h of the kernel."""

    position: NDArray
    velocity: NDArray
    density: NDArray
    mass: float
    support: float

    def pressure(self) -> NDArray:
        """-sum_j m (p_i/rho_i^2 + p_j/rho_j^2) grad W."""
        share = self._pressure() / self.density**2
        return self._sum(lambda i, apart, square, slope: -self.mass * _along(share[i, None] + share, slope, apart))

    def mixed_pressure(self) -> NDArray:
        """-sum_j m (p_i + p_j)/(rho_i rho_j) grad W."""
        p, rho = self._pressure(), self.density

        def term(i: NDArray, apart: NDArray, square: NDArray, slope: NDArray) -> NDArray:
            return -self.mass * _along((p[i, None] + p) / (rho[i, None] * rho), slope, apart)

        return self._sum(term)

    def cohesion(self) -> NDArray:
        """-gamma sum_j m K_ij C(r) x_ij/r, where the factor 32/(pi h^9) of C(r) is missing at h^6/64 for r <= h/2."""
        h, rho = self.support, self.density

        def term(i: NDArray, apart: NDArray, square: NDArray, slope: NDArray) -> NDArray:
            r = np.sqrt(square)
            shape = 32 / (np.pi * h**9) * np.maximum(h - r, 0.0) ** 3 * r**3
            spline = np.where(r > 0.5 * h, shape, 2 * shape - h**6 / 64)
            factor = -TENSION * self.mass * 2 * TERMS_DENSITY / (rho[i, None] + rho) * spline
            return _along(factor, np.divide(1.0, r, out=np.zeros_like(r), where=r > 0), apart)

        return self._sum(term)

    def central(self, softening: float) -> NDArray:
        """2 (dim + 2) nu sum_j m/rho_j v_ij.x_ij/(r^2 + softening) grad W."""

        def term(i: NDArray, apart: NDArray, square: NDArray, slope: NDArray) -> NDArray:
            speed = ((self.velocity[i, None, :] - self.velocity) * apart).sum(-1)
            share = 10 * VISCOSITY * self.mass / self.density
            return _along(share * speed / (square + softening), slope, apart)

        return self._sum(term)

    def morris(self, softening: float) -> NDArray:
        """4 nu sum_j m/(rho_i + rho_j) x_ij.grad W/(r^2 + softening) v_ij."""

        def term(i: NDArray, apart: NDArray, square: NDArray, slope: NDArray) -> NDArray:
            share = 4 * VISCOSITY * self.mass / (self.density[i, None] + self.density)
            return _along(share * square / (square + softening), slope, self.velocity[i, None, :] - self.velocity)

        return self._sum(term)

    def _pressure(self) -> NDArray:
        return SOUND**2 * np.maximum(self.density - TERMS_DENSITY, 0.0)

    def _sum(self, term: Callable[[NDArray, NDArray, NDArray, NDArray], NDArray]) -> NDArray:
        """Sum over j of term(i, x_i - x_j, r^2, W'/r), for blocks of particles i."""
        kernel = smoothing("cubic_spline", self.support, 3)
        found = np.zeros_like(self.position)
        for i, apart, distance in pair_blocks(self.position, self.position):
            met = distance > 0
            slope = np.where(met, kernel_slope(distance, kernel) / np.where(met, distance, 1.0), 0.0)
            found[i] = term(i, apart, distance**2, slope).sum(1)
        return found


def _along(factor: NDArray, slope: NDArray, direction: NDArray) -> NDArray:
    """Vectors (block, n, 3)."""
    return (factor * slope)[..., None] * direction


TERMS_DENSITY, SOUND, VISCOSITY, SPACING = 1000.0, 10.0, 0.01, 0.1  # kg/m^3, m/s, m^2/s, m

TENSION = 1.0  # gamma [m^4/(kg s^2)] of the cohesion, and eps [m/s^2] of the area term
