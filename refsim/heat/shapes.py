"""What the heat kernels take: parameters of the pair weights, the graph of exchanges, coefficients of the schemes.

All computed on the host in float64.
"""

import functools
import math
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from refsim.core.effect import Discretisation, int32
from refsim.smoothing import lattice_neighbours

SPIKY, MUELLER, POLY6 = range(3)
# What makes up for missing neighbours: what is added to a moment before it is inverted, the share by which A is drawn
# back to that, bounds of a pair's factor, and weights: of the one round of a step, and of those of a start, behind a
# first that has none those with which strips and rods of 1 to 5 rows are nearest to k (h = 2.1 to 3.2 d: within 0.7 %;
# Chebyshev's for eigenvalues from 0.3 to 1, one factor after the other: 4.2 %)
FLOOR, DRAWN_BACK, LEAST_FACTOR, LARGEST_FACTOR, ONE_ROUND = 0.05, 0.01, 0.1, 10.0, 1.5
SMALLEST = 1e-37  # [m^2] which keeps coincident particles from a division by zero
ROUNDS = 0.0, 1.1, 3.3, 1.3, 1.8
# Coefficient of l(q)/h^(dim + 2) in L_ij, by dimension: the kernels' own normalisations and their derivatives.
NORMALISATION = {
    SPIKY: {2: 30 / math.pi, 3: 45 / math.pi},
    MUELLER: {2: 40 / math.pi, 3: 45 / math.pi},
    POLY6: {2: 6 * 4 / math.pi, 3: 6 * 315 / (64 * math.pi)},
}


class Conduction(NamedTuple):
    """Heat conduction as the kernels take it; lengths in m."""

    support_radius: float  # h
    inverse_radius: float  # 1/h
    inverse_volume: float  # 1/d^dim
    scale: float  # d^(2 dim) times the coefficient of l(q) in L_ij [m^(dim - 2)]
    factor: float  # calibration of L_ij, or 1/2 (Shao & Song M6); a factor of `scale`
    tolerance: float = 4e-3  # of Chebyshev's iteration
    sweep_share: float = 0.5  # of dt in each sweep of M(4) (Shao & Song M8)
    laplacian: int = 0  # SPIKY, MUELLER or POLY6 (Shao & Song M5)
    harmonic: int = 1  # mean of two conductivities: harmonic, else arithmetic
    unit_capacity: int = 0  # the conductivity is a diffusivity (Shao & Song M11)
    frozen: int = 0  # T_j - T_i before the sweep (Shao & Song M9)
    planned_passes: int = 0  # capacity of a GPU's table of passes; 0 if the host finds their number
    dim: int = 3


# The pairs within h on the CPU: of i those from start[i] (n,) int64, count[i] (n,) int32 of them; entries (capacity,)
# int32: j, and weight (capacity,): dt G_ij [J/K]
ExchangeRows = namedtuple("ExchangeRows", "start count entries weight")
# The same on the GPU for all pairs of the neighbour list, of weight 0 beyond h: the k-th of i is entries[k * n + i]
ExchangeColumns = namedtuple("ExchangeColumns", "count entries weight lanes")
# What turns the particles' enthalpies into temperatures
Substance = namedtuple("Substance", "heat_capacity melting_point latent_heat")
# A symmetric matrix of each particle: (n, 3) xx, xy, xz, and (n, 3) yy, yz, zz
Tensors = namedtuple("Tensors", "x rest")
# What the moments of the pairs follow from, beside their list
Places = namedtuple("Places", "position volume reservoir conduction period")
# Values that a stage reads, the flow and change that it keeps for later ones, and the temperatures after the last
StageState = namedtuple("StageState", "start now temperature flow_start change target")
# One stage y' = y + before (y_before - y) + start (y_start - y) + (flow Q(y) + flow_start Q(y_start)) dt/C
Stage = namedtuple("Stage", "before start flow flow_start")


@functools.lru_cache(maxsize=64)
def lattice_moment(support_radius: float, spacing: float, dim: int) -> float:
    """Sum over the infinite lattice of V_j L_ij r^2/dim: 1 for a consistent L_ij. Dimensionless."""
    q, weight = _lattice_weights(SPIKY, support_radius, spacing, dim)
    return float((weight * q**2).sum() / dim) * (support_radius / spacing) ** 2


def _lattice_weights(laplacian: int, support_radius: float, spacing: float, dim: int) -> tuple[np.ndarray, np.ndarray]:
    """(q, d^2 V_j L_ij) of a lattice particle's neighbours."""
    q = lattice_neighbours(support_radius, spacing, dim)[1] / support_radius
    a = 1 - q
    poly6 = 4 * q**2 * (1 - q**2) - dim * (1 - q**2) ** 2
    shape = {SPIKY: a**2 / np.maximum(q, 0.1), MUELLER: a, POLY6: poly6}[laplacian]
    return q, NORMALISATION[laplacian][dim] * shape * (spacing / support_radius) ** (dim + 2)


def lattice_sum(conduction: Conduction, grid: Discretisation) -> float:
    """s_i for k dt/(rho c d^2) = 1 on the infinite lattice: the explicit scheme is stable up to the inverse of it."""
    _, weight = _lattice_weights(int(conduction.laplacian), grid.support_radius, grid.spacing, grid.dim)
    return 2 * float(conduction.factor) * float(np.abs(weight).sum())


def conduction_group(
    grid: Discretisation, *, laplacian: int = SPIKY, factor: float = 1.0, **options: Any
) -> Conduction:
    """Parameters in the run's dtype, from those of a scene."""
    h, volume = grid.support_radius, grid.spacing**grid.dim
    scale = factor * NORMALISATION[laplacian][grid.dim] / h ** (grid.dim + 2) * grid.spacing ** (2 * grid.dim)
    values = Conduction(h, 1 / h, 1 / volume, scale, factor, laplacian=laplacian, dim=grid.dim, **options)
    kinds: dict[type, Any] = {float: grid.real, int: int32}
    return Conduction(*(kinds[kind](value) for kind, value in zip(Conduction.__annotations__.values(), values)))
