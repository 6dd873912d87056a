"""Audit of the mechanical energy: it must not grow by more than what drives the run puts in.

Contents: EnergyAudit (a scene's option), EnergyAccount (what an effect counts), EnergyState;
compression_energy, compression_amount, pair_potential. The audit of a run is `refsim.engine.audit`.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from refsim.core.checked import Checked, Count, Positive

ROWS = 16384  # particles whose pairs are summed at once


class EnergyAudit(Checked, frozen=True, kw_only=True):
    """Stops a run whose mechanical energy grows.

    every  steps between two audits
    bound  share of the energy turned over so far by which the total may rise above its lowest value
    """

    every: Count = 100
    bound: Positive = 0.05


class Amount(NamedTuple):
    """An energy, and the sum of its absolute terms [J; J/m in 2D]."""

    value: float
    size: float


class EnergyState:
    """The present state of a run as effects' accounts see it: float64 on the host, rows in the order of the memory."""

    def __init__(self, run: Any) -> None:
        self._run = run

    def field(self, name: str) -> NDArray:
        """A field's values, in SI units."""
        return self._run.host(name).astype(float)

    def array(self, name: str) -> Any:
        """A field's array on the backend; read only."""
        return self._run.fields[name]

    def flags(self, name: str) -> NDArray:
        """A field of whole numbers."""
        return self._run.host(name)

    def shared(self, name: str) -> Any:
        """What an effect shares with all passes, on this backend."""
        return self._run.shared[name]

    def host(self, array: Any) -> NDArray:
        """An array of this backend in float64."""
        return np.asarray(self._run.backend.host(array), dtype=float)

    def pair_sum(self, potential: Callable[[NDArray, NDArray, NDArray], NDArray], reach: float) -> Amount:
        """Sum of potential(r, i, j) [J] over all pairs nearer than `reach` [m], each counted once."""
        from scipy.spatial import cKDTree

        position = self.field("position")
        tree = cKDTree(position)
        value = size = 0.0
        for first in range(0, len(position), ROWS):
            rows = cKDTree(position[first : first + ROWS])
            near = rows.sparse_distance_matrix(tree, reach, output_type="ndarray")
            i, j = near["i"] + first, near["j"]
            once = i < j
            part = amount(potential(near["v"][once], i[once], j[once]))
            value, size = value + part.value, size + part.size
        return Amount(value, size)


class EnergyAccount(NamedTuple):
    """Energies of an effect's forces by name, and in words the forces that derive from no energy."""

    parts: Mapping[str, Callable[[EnergyState], Amount]] = {}
    uncounted: tuple[str, ...] = ()


def amount(terms: NDArray) -> Amount:
    """Sum of terms [J] and of their absolute values."""
    terms = np.asarray(terms, dtype=float)
    return Amount(float(terms.sum()), float(np.abs(terms).sum()))


# What effects count with


def compression_energy(
    mass: NDArray, density: NDArray, rest_density: Any, stiffness: Any, exponent: int, internal_pressure: float = 0.0,
    clamped: bool = True,
) -> NDArray:  # fmt: skip
    """m_i u_i [J], u = integral of p/rho^2 drho from rho0: the work that compresses liquid of J(9) or Tait.

    p = B ((rho/rho0)^g - 1) + P_int (rho/rho0)^2, zero where it would be negative and is `clamped`; B [Pa] and rho0
    [kg/m^dim] of all or of each particle. In s = rho/rho0: u = (1/rho0) [B f(s) + P_int (s - 1)] with
    f = ln s + 1/s - 1 for g = 1 and (s^(g-1) - 1)/(g - 1) + 1/s - 1 beyond.
    """
    s = np.asarray(density, dtype=float) / rest_density
    if clamped:
        s = np.maximum(s, _zero_pressure(np.asarray(stiffness, dtype=float), exponent, internal_pressure))
    expansion = np.log(s) if exponent == 1 else (s ** (exponent - 1) - 1) / (exponent - 1)
    work = np.asarray(stiffness) * (expansion + 1 / s - 1) + internal_pressure * (s - 1)
    return np.asarray(mass, dtype=float) * work / rest_density


def compression_amount(work: NDArray, modulus: NDArray, dtype: Any) -> Amount:
    """Sum of m_i u_i [J]; a density known to one rounding of `dtype` is unsure by eps m c^2, at rest too.

    modulus  m_i dp/drho = m_i c^2 at the rest density [J]
    """
    energy = amount(work)
    return energy._replace(size=energy.size + float(np.finfo(dtype).eps) * float(modulus.sum()))


def _zero_pressure(stiffness: NDArray, exponent: int, internal_pressure: float) -> NDArray:
    """rho/rho0 at which B (s^g - 1) + P_int s^2 = 0, by bisection of [0, 1]."""
    low, high = np.zeros_like(stiffness), np.ones_like(stiffness)
    for _ in range(60 if internal_pressure > 0 else 0):
        middle = 0.5 * (low + high)
        positive = stiffness * (middle**exponent - 1) + internal_pressure * middle**2 > 0
        low, high = np.where(positive, low, middle), np.where(positive, middle, high)
    return high


def pair_potential(
    force: Callable[[NDArray], NDArray], reach: float, parts: int = 2048
) -> Callable[[NDArray], NDArray]:
    """phi(r), integral of force(r) dr from r to `reach` [m]: the potential of a central force that repels where > 0.

    A table by Gauss quadrature with cubic interpolation; phi vanishes at `reach`.
    """
    node, weight = np.polynomial.legendre.leggauss(8)
    edge = np.linspace(0.0, reach, parts + 1)
    half = 0.5 * reach / parts
    inside = 0.5 * (edge[1:] + edge[:-1])[:, None] + half * node
    each = half * (weight * force(inside)).sum(1)
    value = np.append(np.cumsum(each[::-1])[::-1], 0.0)
    slope = -force(np.minimum(edge, np.nextafter(reach, 0.0)))

    def phi(r: NDArray) -> NDArray:
        place = np.minimum(np.asarray(r, dtype=float) / (2 * half), parts)
        k = np.minimum(place.astype(int), parts - 1)
        t = place - k
        a, b = value[k], value[k + 1]
        rise, fall = 2 * half * slope[k], 2 * half * slope[k + 1]
        return a + t * (rise + t * (3 * (b - a) - 2 * rise - fall + t * (2 * (a - b) + rise + fall)))

    return phi
