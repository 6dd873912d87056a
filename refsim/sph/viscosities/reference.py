"""NumPy oracle of the viscous forces: all pairs, float64. Each function returns {output: (value, scale)}."""

import numpy as np

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.reference import Sums, pair_blocks, rows_of
from refsim.smoothing.reference import kernel_gradient

SAFETY = 0.01  # of h_s^2 beside r^2
CLOSE = 1e-3  # share of the sizes of its parts below which rounding may decide whether a pair approaches

operation = operations(
    adds="acceleration", optional="period", tolerance=12.0,
    reason="one rounding in each of distance, slope, velocity difference, projection, quotients, products and sum",
)  # fmt: skip


@operation(
    "artificial viscosity, alpha and beta", paper="Monaghan 1992", packed="artificial_pair",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean dissipation",
    broken={1: "rotation angular_momentum"},
)  # fmt: skip
def artificial(position, velocity, mass, density, smoothing, artificial_viscosity, period=None, rows=None):
    """Acceleration [m/s^2] a_i = -sum_j m_j Pi_ij grad W_ij, Pi_ij = (beta mu_ij^2 - alpha c mu_ij)/rho_ij.

    mu_ij = h_s v_ij.x_ij/(r^2 + 0.01 h_s^2) of particles that approach, v_ij.x_ij < 0, and 0 of others;
    rho_ij = (rho_i + rho_j)/2.
    """
    alpha, beta, c, h = (float(part) for part in artificial_viscosity)
    v, m, rho = (np.asarray(part, dtype=float) for part in (velocity, mass, density))
    v_i, rho_i = rows_of(velocity, rows), rows_of(density, rows)
    sums = Sums(len(rho_i), 3)
    for place, separation, distance in pair_blocks(position, position, rows, period):
        parts = (v_i[place, None, :] - v[None, :, :]) * separation
        approach, size = parts.sum(-1), np.abs(parts).sum(-1)
        reach = h / (distance**2 + SAFETY * h**2)
        mu, most = reach * np.minimum(approach, 0), reach * np.where(approach < CLOSE * size, size, 0)
        mean = (rho_i[place, None] + rho[None, :]) / 2
        gradient = kernel_gradient(separation, distance, smoothing)
        viscous, sized = (beta * mu**2 - alpha * c * mu) / mean, (beta * most**2 + alpha * c * most) / mean
        terms, sizes = ((m[None, :] * part)[..., None] for part in (viscous, sized))
        sums.add(place, -terms * gradient, sizes * np.abs(gradient))
    return {"acceleration": sums.total()}


@operation(
    "laminar viscosity at low Reynolds numbers", paper="Morris, Fox & Zhu 1997", packed="laminar_pair",
    invariants=f"{SYMMETRY} linear_momentum galilean dissipation", broken={1: "rotation"},
)  # fmt: skip
def laminar(position, velocity, mass, density, smoothing, laminar_viscosity, period=None, rows=None):
    """Acceleration [m/s^2] a_i = sum_j m_j 2 mu/(rho_i rho_j) x_ij.grad W_ij/(r^2 + 0.01 h_s^2) (v_i - v_j)."""
    mu, h = (float(part) for part in laminar_viscosity)
    v = np.asarray(velocity, dtype=float)
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    v_i, rho_i = rows_of(velocity, rows), rows_of(density, rows)
    sums = Sums(len(rho_i), 3)
    for place, separation, distance in pair_blocks(position, position, rows, period):
        along = (separation * kernel_gradient(separation, distance, smoothing)).sum(-1)
        factor = 2 * mu * volume[None, :] * along / (distance**2 + SAFETY * h**2) / rho_i[place, None]
        sums.add(place, factor[..., None] * (v_i[place, None, :] - v[None, :, :]))
    return {"acceleration": sums.total()}
