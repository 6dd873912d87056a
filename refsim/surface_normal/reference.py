"""NumPy oracle of surface normals: all pairs, float64.

Arrays: position (n, 3) [m]; mass [kg], density [kg/m^dim], number_density [1/m^dim] (n,); candidates (n,) uint8
or None.
"""

import numpy as np

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.reference import Sums, pair_blocks, rows_of
from refsim.smoothing.reference import kernel_gradient, kernel_value

# Hard inputs of normals and of the fan scan, beside those of every operation.
SHAPES = ("two_layers", "three_layers", "jittered_film", "bent_filament", "cavity", "tank_corner", "notch")
operation = operations(
    paper="Jiang & Zhu 2023", cases=SHAPES, optional="walls candidates",
    variants=("walls candidates", "", "candidates", "walls"), invariants=SYMMETRY,
)  # fmt: skip


def _neighbour_volumes(mass, density, density_i, normal_term):
    """V_j as a (b, n) table: m_j/rho_j, or the printed m_j/rho_i (Jiang & Zhu E10)."""
    mass, density = np.asarray(mass, dtype=float), np.asarray(density, dtype=float)
    if normal_term.own_density:
        return mass[None, :] / density_i[:, None]
    return np.broadcast_to(mass / density, (len(density_i), len(mass)))


def _only_candidates(output, value, scale, candidates, rows):
    if candidates is not None:
        wanted = (rows_of(candidates, rows) != 0)[:, None]
        value, scale = np.where(wanted, value, 0.0), np.where(wanted, scale, 0.0)
    return {output: (value, scale)}


def normals_apart(normal, i, separation, distance, axial):
    """n_i - n_j (b, n, 3), by `axial` s ((n_i - n_j) . e_ij) e_ij, and the sum of the absolute terms behind it."""
    normal = np.asarray(normal, dtype=float)
    apart, size = normal[i, None, :] - normal[None, :, :], np.abs(normal[i, None, :]) + np.abs(normal[None, :, :])
    if axial is None:
        return apart, size
    unit = separation / np.where(distance > 0, distance, 1.0)[..., None]
    along = (apart * unit).sum(-1, keepdims=True) * float(axial.factor)
    return along * unit, (size * np.abs(unit)).sum(-1, keepdims=True) * float(axial.factor) * np.abs(unit)


@operation("J(19) with Jiang & Zhu E10", outputs="surface_normal", tolerance=8.0, packed="normal_pair")
def color_gradient(position, mass, density, candidates, walls, gradient_smoothing, normal_term, rows=None):
    """Colour-gradient normals, inward, dimensionless; zero for particles that are no candidates.

    J(19) n_i = h sum_j (m_j/rho_j) grad W_ij + h sum_b V_b grad W_ib (Jiang & Zhu E10: printed
    m_j/rho_i).
    """
    h = float(gradient_smoothing.support_radius)
    density_i = rows_of(density, rows)
    sums = Sums(len(density_i), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        volume = _neighbour_volumes(mass, density, density_i[place], normal_term)
        sums.add(place, h * volume[..., None] * kernel_gradient(separation, distance, gradient_smoothing))
    if walls is not None:
        volume = np.asarray(walls.volume, dtype=float)
        for place, separation, distance in pair_blocks(position, walls.position, rows):
            sums.add(place, h * volume[None, :, None] * kernel_gradient(separation, distance, gradient_smoothing))
    return _only_candidates("surface_normal", *sums.total(), candidates, rows)


@operation(
    "J(20), J(15) with Jiang & Zhu E10", outputs="corrected_normal", tolerance=12.0,
    reason="the roundings of one pair, and once more those of the denominator", packed="corrected_normal_pair",
)  # fmt: skip
def corrected(
    position, mass, density, number_density, candidates, walls, smoothing, gradient_smoothing, normal_term, rows=None
):
    """Corrected normals, inward [1/m]; zero for particles that are no candidates.

    J(20) n_i* = sum_j ((delta_j - delta_i)/delta0) V_j grad W_ij / sum_k V_k W_ik, self in the denominator only;
    V_j = m_j/rho_j (Jiang & Zhu E10: printed m_j/rho_i). Walls: delta_b = delta_i, V_b in the denominator.
    """
    density_i, number_i = rows_of(density, rows), rows_of(number_density, rows)
    number = np.asarray(number_density, dtype=float)
    volume_k = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    sums = Sums(len(density_i), 3)
    filled = np.zeros(len(density_i))
    for place, separation, distance in pair_blocks(position, position, rows):
        filled[place] += kernel_value(distance, smoothing) @ volume_k
        volume = _neighbour_volumes(mass, density, density_i[place], normal_term)
        rise = (number[None, :] - number_i[place, None]) / float(normal_term.rest_number_density)
        sums.add(place, (rise * volume)[..., None] * kernel_gradient(separation, distance, gradient_smoothing))
    if walls is not None:
        for place, _, distance in pair_blocks(position, walls.position, rows):
            filled[place] += kernel_value(distance, smoothing) @ np.asarray(walls.volume, dtype=float)
    return _only_candidates("corrected_normal", *sums.total(filled[:, None]), candidates, rows)
