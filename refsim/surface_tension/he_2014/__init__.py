"""Gradient energy and air pressure on free surfaces after He et al. 2014 (Jiang & Zhu 2023, reference [10]).

The terms are independent of each other. A term whose coefficient is zero is not computed.
"""

import functools
import math
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from refsim.core.checked import NotNegative
from refsim.core.effect import Discretisation, Field, Others, Pass
from refsim.core.errors import InputError
from refsim.smoothing import lattice_neighbours, smoothing
from refsim.smoothing.reference import kernel_slope, kernel_value
from refsim.sph import SETS, liquid_of
from refsim.surface_tension.cohesion import BECAME_DROPS, DENSITY_KEPT, KEEPS_DENSITY, PairCohesion

COLOR = Field("color", "-", "smoothed color c, 1 inside the liquid")
COLOR_GRADIENT_SQUARED = Field("color_gradient_squared", "1/m^2", "|grad c|^2")


class GradientEnergy(NamedTuple):
    """Parameters of the energy (kappa/2) |grad c|^2 in kernels."""

    kappa: float  # [N]
    quarter: float  # kappa/4 [N]


class AirPressure(NamedTuple):
    """Parameters of the air-pressure term in kernels."""

    pressure: float  # p_atm [Pa]


@functools.lru_cache(maxsize=64)
def flat_surface_tension(sums: str, gradients: str, support_radius: float, spacing: float, dim: int) -> float:
    """Surface tension [N/m] of kappa = 1 N at the flat surface of a lattice half-space, by the virial.

    sigma = int (P_N - P_T) dz = (1/2A) sum_ij [z_ij F_z - (x_ij F_x + y_ij F_y)/(dim - 1)].
    """
    reach = math.ceil(support_radius / spacing)
    layers = np.arange(4 * reach + 2)  # deep enough that the lower half is bulk
    steps, distance = lattice_neighbours(support_radius, spacing, dim)
    volume = spacing**dim
    w = volume * kernel_value(distance, smoothing(sums, support_radius, dim))
    itself = volume * float(kernel_value(0.0, smoothing(sums, support_radius, dim)))
    slope = volume * kernel_slope(distance, smoothing(gradients, support_radius, dim))
    up = np.rint(steps[:, -1] / spacing).astype(int)  # x_ij of a neighbour below is positive
    below = layers[:, None] + up  # layer of each neighbour: negative above the surface, bulk below the last layer
    color = np.array([itself + w[j >= 0].sum() for j in below])
    deep = len(layers) - 1
    squared = np.zeros(len(layers))
    for k, j in zip(layers, below):
        there = j >= 0
        c = color[np.minimum(j[there], deep)]
        squared[k] = ((c * slope[there] * steps[there, -1] / distance[there]).sum() / color[k]) ** 2
    sigma = 0.0
    for k, j in zip(layers[: 3 * reach], below):
        there = j >= 0
        force = 0.25 * volume * (squared[k] + squared[np.minimum(j[there], deep)]) * slope[there] / distance[there]
        normal = steps[there, -1] ** 2
        tangential = (steps[there, :-1] ** 2).sum(1) / (dim - 1)
        sigma += 0.5 * float((force * (normal - tangential)).sum()) / spacing ** (dim - 1)
    return sigma


LARGEST_STIFFNESS = 0.004  # cubes of 512 particles became drops up to S = 0.005 (docs/stability.md)


class He2014(PairCohesion, frozen=True, kw_only=True):
    """Surface tension of a free liquid surface by its gradient energy, and the pressure of air that is not simulated.

    surface_tension   sigma [N/m]; nominal: turned into kappa by the virial of a flat lattice surface
    kappa             coefficient of the gradient energy [N], instead of sigma; without both the term is left out
    air_pressure      p_atm [Pa]; the pair force yields half of it at the surface, and a further tension
    balance_pressure  the equation of state balances the p_atm/2 by which the air-pressure term compresses the bulk (not
                      in the paper); the gradient energy does not act in the bulk

    Both terms conserve linear and angular momentum.
    """

    name: ClassVar[str] = "he_2014"
    scales: ClassVar[tuple[str, ...]] = ("surface_tension", "kappa", "air_pressure")

    kappa: NotNegative | None = None
    air_pressure: NotNegative = 0.0

    def check_coefficients(self) -> None:
        if self.surface_tension is not None and self.kappa is not None:
            raise InputError(f"{self.name}: both of surface_tension and kappa given; give one of them, or neither.")

    def own_notes(self, grid: Discretisation, others: Others) -> Iterator[str]:
        if self._own_tension(grid, others) > 0:
            yield (
                f"{self.name}: the gradient energy does not act in the bulk: drops were found to spread, or to come to"
                " rest in the shape they have, with particles that gather in pairs"
            )

    def stiffness_limits(self, grid: Discretisation, others: Others) -> Iterator[tuple[float, float, str]]:
        if tension := self._own_tension(grid, others):
            yield tension, LARGEST_STIFFNESS, BECAME_DROPS
        if air := super().nominal_tension(grid, others):
            yield air, KEEPS_DENSITY, DENSITY_KEPT

    def _own_tension(self, grid: Discretisation, others: Others) -> float:
        """sigma [N/m] of the gradient energy."""
        return self.coefficient(grid, others) * self._unit_tension(grid, others)

    def coefficient(self, grid: Discretisation, others: Others) -> float:
        """kappa [N], given or from sigma."""
        if self.kappa is not None:
            return self.kappa
        return (self.surface_tension or 0.0) / self._unit_tension(grid, others)

    def pair_force(self, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        """p_atm W'(r)/rho0^2 [N/kg^2], the term that also acts in the bulk."""
        fluid = liquid_of(others)
        kernel = smoothing(SETS[fluid.kernels][1], grid.support_radius, grid.dim)
        return self.air_pressure * kernel_slope(r, kernel) / fluid.rest_density**2

    def nominal_tension(self, grid: Discretisation, others: Others) -> float:
        """sigma [N/m] of both terms."""
        return self._own_tension(grid, others) + super().nominal_tension(grid, others)

    def passes(self, others: Others) -> tuple[Pass, ...]:
        passes: list[Pass] = []
        if self._has_energy():
            passes += [
                Pass("he_2014.color", writes=(COLOR,)),
                Pass("he_2014.squared_gradient", writes=(COLOR_GRADIENT_SQUARED,)),
            ]
        names = {} if self._has_energy() else {"color_gradient_squared": None}
        return (*passes, Pass("he_2014.tension", updates=("acceleration",), names=names))

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        kappa = self.coefficient(grid, others)
        energy = GradientEnergy(grid.real(kappa), grid.real(kappa / 4)) if self._has_energy() else None
        air = AirPressure(grid.real(self.air_pressure)) if self.air_pressure > 0 else None
        return {"gradient_energy": energy, "air_pressure": air}

    def _unit_tension(self, grid: Discretisation, others: Others) -> float:
        sums, gradients = SETS[liquid_of(others).kernels]
        return flat_surface_tension(sums, gradients, grid.support_radius, grid.spacing, grid.dim)

    def _has_energy(self) -> bool:
        return bool(self.kappa or self.surface_tension)
