"""NumPy oracle of one-way coupling: all pairs, float64."""

import numpy as np

from refsim.neighbours.reference import pair_blocks
from refsim.smoothing.reference import viscosity_laplacian


def wall_viscosity(position, velocity, density, walls, smoothing, fluid, wall_viscosity, rows=None):
    """P6, viscous part: a_i = sum_b mu Psi_b/rho_i^2 (v_b - v_i) lap W_ib [m/s^2], Psi_b = rho0 V_b, v_b = 0 (E30).

    position, velocity (n, 3) [m], [m/s]; density (n,) [kg/m^3]. Returns (value, scale).
    """
    pick = slice(None) if rows is None else np.asarray(rows)
    v, rho = np.asarray(velocity, dtype=float)[pick], np.asarray(density, dtype=float)[pick]
    psi = float(fluid.rest_density) * np.asarray(walls.volume, dtype=float)
    drag = np.zeros(len(rho))
    for place, _, distance in pair_blocks(position, walls.position, rows):
        drag[place] = viscosity_laplacian(distance, smoothing) @ psi
    value = -(float(wall_viscosity.coefficient) * drag / rho**2)[:, None] * v
    return {"acceleration": (value, np.abs(value))}
