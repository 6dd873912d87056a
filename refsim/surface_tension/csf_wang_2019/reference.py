"""NumPy oracle of the continuum surface force: all pairs, float64.

Arrays: position, normals (n, 3); mass, density, curvature (n,); SI units.
"""

import numpy as np

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.reference import Sums, other_particles, pair_blocks
from refsim.smoothing.reference import kernel_gradient, kernel_slope, kernel_value

operation = operations(paper="Wang, Zhu & Yin 2019, reconstructed")


@operation(
    "n_i by the corrected kernel", outputs="interface_normal", optional="walls", tolerance=12.0,
    reason="the roundings of one pair, and once more those of the denominator", invariants=SYMMETRY,
    packed="normal_pair",
)  # fmt: skip
def normal(position, mass, density, walls, smoothing, gradient_smoothing, rows=None):
    """Normals, inward [1/m]: n_i = sum_j V_j grad W_ij / sum_k V_k W_ik, walls as liquid, self in the denominator."""
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    count = len(volume) if rows is None else len(rows)
    sums, filled = Sums(count, 3), np.zeros(count)
    sources = [(position, volume)]
    if walls is not None:
        sources.append((walls.position, np.asarray(walls.volume, dtype=float)))
    for source, size in sources:
        for place, separation, distance in pair_blocks(position, source, rows):
            filled[place] += kernel_value(distance, smoothing) @ size
            sums.add(place, size[None, :, None] * kernel_gradient(separation, distance, gradient_smoothing))
    return {"interface_normal": sums.total(filled[:, None])}


@operation(
    "kappa_i, renormalised divergence of the unit normals", outputs="curvature", tolerance=16.0,
    reason="two unit normals, direction, slope and volume in each of two sums, and their quotient", invariants=SYMMETRY,
)  # fmt: skip
def curvature(position, mass, density, interface_normal, gradient_smoothing, continuum, rows=None):
    """Curvature [1/m], positive where liquid bulges; 0 where |n| is at most the threshold.

    kappa_i = -f sum_j V_j (n^_j - n^_i).e_ij W' / (-sum_j V_j r s_ij W') over active j, n^ = n/|n|;
    s_ij = 1 - 0.99 (e_ij.n^_i)^2 and f = dim - 1, or in the plain reading s_ij = 1 and f = dim.
    """
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    n = np.asarray(interface_normal, dtype=float)
    length = np.sqrt((n**2).sum(1))
    active = ~(length <= float(continuum.threshold))
    unit = n / np.where(active, length, 1.0)[:, None]
    own = np.arange(len(n)) if rows is None else np.asarray(rows)
    above, below = Sums(len(own)), Sums(len(own))
    for place, separation, distance in pair_blocks(position, position, rows):
        i = own[place]
        slope = kernel_slope(distance, gradient_smoothing) * active[None, :] * volume[None, :]
        slope = slope * other_particles(place, len(n), rows)
        direction = separation / np.where(distance > 0, distance, 1.0)[..., None]
        change = (unit[None, :, :] - unit[i, None, :]) * direction
        cosine = (unit[i, None, :] * direction).sum(-1)
        share = np.ones_like(cosine) if continuum.plain else 1 - 0.99 * cosine**2
        # The rounding of a unit vector does not depend on how small the difference of two is.
        size = np.abs(change).sum(-1) + np.abs(direction).sum(-1)
        above.add(place, slope * change.sum(-1), np.abs(slope) * size)
        below.add(place, -slope * distance * share, np.abs(slope) * distance * (1 + cosine**2))
    there = active[own] & (below.value != 0)
    safe = np.where(there, below.value, 1.0)
    factor = float(continuum.factor)
    value = np.where(there, -factor * above.value / safe, 0.0)
    scale = np.where(there, factor * above.scale / safe + np.abs(value) * below.scale / safe, 0.0)
    return {"curvature": (value, scale)}


@operation(
    "sigma kappa n and the force along grad sigma", adds="acceleration", optional="marangoni", tolerance=16.0,
    reason="distance, slope, volume, rise and direction in a sum, its projection, and the product", invariants=SYMMETRY,
    broken={1: "translation rotation"},
)  # fmt: skip
def force(position, mass, density, interface_normal, curvature, gradient_smoothing, continuum, marangoni, rows=None):
    """Acceleration [m/s^2], zero off the surface; c = `share` compensates for the half of |n| outside the liquid.

    a_i = (c/rho_i) [sigma_i kappa_i n_i + |n_i| (g_i - (g_i.n^_i) n^_i)];
    g_i = sum_j V_j (sigma_j - sigma_i) grad W_ij.
    """
    x, n = np.asarray(position, dtype=float), np.asarray(interface_normal, dtype=float)
    rho = np.asarray(density, dtype=float)
    volume = np.asarray(mass, dtype=float) / rho
    own = np.arange(len(n)) if rows is None else np.asarray(rows)
    length = np.sqrt((n[own] ** 2).sum(1))
    active = ~(length <= float(continuum.threshold))
    safe = np.where(active, length, 1.0)
    sigma = np.full(len(own), float(continuum.tension))
    sigma_size = sigma.copy()
    slope = np.zeros(3)
    if marangoni is not None:
        slope = np.array([float(marangoni.x), float(marangoni.y), float(marangoni.z)])
        sigma = sigma + x[own] @ slope
        sigma_size = sigma_size + np.abs(x[own]) @ np.abs(slope)
    kappa = np.asarray(curvature, dtype=float)[own, None]
    value = sigma[:, None] * kappa * n[own]
    scale = sigma_size[:, None] * np.abs(kappa * n[own])
    if marangoni is not None:
        sums = Sums(len(own), 3)
        for place, separation, distance in pair_blocks(position, position, rows):
            grad = volume[None, :, None] * kernel_gradient(separation, distance, gradient_smoothing)
            moduli = (np.abs(separation) @ np.abs(slope))[..., None] * np.abs(grad)
            sums.add(place, -(separation @ slope)[..., None] * grad, moduli)
        gradient, size = sums.total()
        unit = n[own] / safe[:, None]
        value = value + length[:, None] * (gradient - (gradient * unit).sum(1)[:, None] * unit)
        scale = scale + length[:, None] * (size + (size * np.abs(unit)).sum(1)[:, None] * np.abs(unit))
    factor = np.where(active, float(continuum.share) / rho[own], 0.0)[:, None]
    return {"acceleration": (factor * value, factor * scale)}
