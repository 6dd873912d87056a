"""NumPy oracle of He et al. 2014: all pairs, float64.

Arrays: position (n, 3); mass, density, color (n,); SI units.
"""

import numpy as np

from refsim.core.operation import SYMMETRY, Program, operations
from refsim.neighbours.reference import Sums, pair_blocks
from refsim.smoothing.reference import kernel_gradient, kernel_value

operation = operations(paper="He et al. 2014")


@operation("smoothed color c", outputs="color", optional="walls", invariants=SYMMETRY, packed="color_pair")
def color(position, mass, density, walls, smoothing, rows=None):
    """c_i = sum_j V_j W_ij + sum_b V_b W_ib, self included; dimensionless."""
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    value = np.zeros(len(volume) if rows is None else len(rows))
    for place, _, distance in pair_blocks(position, position, rows):
        value[place] += kernel_value(distance, smoothing) @ volume
    if walls is not None:
        for place, _, distance in pair_blocks(position, walls.position, rows):
            value[place] += kernel_value(distance, smoothing) @ np.asarray(walls.volume, dtype=float)
    return {"color": (value, value)}


@operation(
    "|grad c|^2", outputs="color_gradient_squared", tolerance=16.0,
    reason="those of one pair twice, for the square, and the quotient", invariants=SYMMETRY, packed="gradient_pair",
)  # fmt: skip
def squared_gradient(position, mass, density, color, gradient_smoothing, rows=None):
    """|grad c_i|^2 [1/m^2], grad c_i = (1/c_i) sum_j V_j c_j grad W_ij; the scale squares the sum of moduli."""
    volume = np.asarray(mass, dtype=float) / np.asarray(density, dtype=float)
    c = np.asarray(color, dtype=float)
    own = np.arange(len(c)) if rows is None else np.asarray(rows)
    sums = Sums(len(own), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        sums.add(place, (volume * c)[None, :, None] * kernel_gradient(separation, distance, gradient_smoothing))
    gradient, size = sums.total(c[own, None])
    return {"color_gradient_squared": ((gradient**2).sum(1), 2 * (size**2).sum(1))}


@operation(
    "gradient energy; air pressure", adds="acceleration",
    optional="color_gradient_squared gradient_energy air_pressure",
    variants=("gradient_energy color_gradient_squared", "", "air_pressure"), tolerance=12.0,
    reason="one rounding in each of distance, slope, volume, two factors, direction, product and sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum",
    programs={
        "cuda:fused": Program(
            "kernels", "tension_and_momentum", packed="fused_pair", also=("sph.momentum",),
            names={"smoothing": "gradient_smoothing"},
            variants=("period", "gradient_energy color_gradient_squared walls period"),
        )
    },
    packed="tension_pair",
)  # fmt: skip
def tension(
    position, mass, density, color_gradient_squared, gradient_smoothing, gradient_energy, air_pressure, rows=None
):
    """Acceleration [m/s^2] by gradient energy and air pressure, each unless None.

    a_i = (kappa/(4 rho_i)) sum_j V_j (|grad c_i|^2 + |grad c_j|^2) grad W_ij;
    a_i += (p_atm/rho_i) sum_j V_j grad W_ij.
    """
    rho = np.asarray(density, dtype=float)
    volume = np.asarray(mass, dtype=float) / rho
    own = np.arange(len(rho)) if rows is None else np.asarray(rows)
    sums = Sums(len(own), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        i = own[place]
        gradient = (
            volume[None, :, None] * kernel_gradient(separation, distance, gradient_smoothing) / rho[i, None, None]
        )
        if gradient_energy is not None:
            squared = np.asarray(color_gradient_squared, dtype=float)
            both = float(gradient_energy.kappa) / 4 * (squared[i, None] + squared[None, :])
            sums.add(place, both[..., None] * gradient)
        if air_pressure is not None:
            sums.add(place, float(air_pressure.pressure) * gradient)
    return {"acceleration": sums.total()}
