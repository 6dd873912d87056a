"""NumPy oracle of one-way coupling: all pairs, float64."""

import numpy as np

from refsim.core.operation import SYMMETRY, operation
from refsim.neighbours.reference import Sums, pair_blocks
from refsim.smoothing.reference import kernel_gradient, kernel_value, viscosity_laplacian


@operation(
    "patent P6, viscous force, with E30", paper="patent CN104318598A, 2014; Akinci et al. 2012", adds="acceleration",
    optional="wall_motion period", variants=("wall_motion period", "", "wall_motion"), tolerance=8.0,
    reason="one rounding in each of distance, Laplacian, mass, product and sum, and the squared density",
    invariants=SYMMETRY, broken={1: "translation rotation", 2: "rotation"},
)  # fmt: skip
def wall_viscosity(
    position, velocity, density, walls, smoothing, fluid, wall_viscosity, wall_motion=None, period=None, rows=None
):
    """Patent P6 with E30, viscous part: a_i = sum_b mu Psi_b/rho_i^2 (v_b - v_i) lap W_ib [m/s^2].

    Psi_b = rho0 V_b; position, velocity (n, 3) [m], [m/s]; density (n,) [kg/m^3]; v_b = 0, or the velocity of
    `wall_motion` beyond its planes. Returns (value, scale).
    """
    pick = slice(None) if rows is None else np.asarray(rows)
    v, rho = np.asarray(velocity, dtype=float)[pick], np.asarray(density, dtype=float)[pick]
    psi = float(fluid.rest_density) * np.asarray(walls.volume, dtype=float)
    wall_velocity = np.zeros((len(psi), 3))
    if wall_motion is not None:
        lower, upper, moving = (np.asarray(part, dtype=float) for part in wall_motion)
        x = np.asarray(walls.position, dtype=float)
        wall_velocity[((x < lower) | (x > upper)).any(1)] = moving
    sums = Sums(len(rho), 3)
    for place, _, distance in pair_blocks(position, walls.position, rows, period):
        factor = float(wall_viscosity.coefficient) * psi * viscosity_laplacian(distance, smoothing)
        factor = factor / rho[place, None] ** 2
        # The scale counts both velocities, not their difference.
        sums.add(place, factor[..., None] * wall_velocity[None, :, :])
        sums.add(place, -factor[..., None] * v[place, None, :])
    return {"acceleration": sums.total()}


@operation(
    "patent P6, pressure, with E30", "one_way_coupling.wall_pressure",
    paper="patent CN104318598A, 2014; Adami, Hu & Adams 2012", adds="acceleration", tolerance=16.0,
    reason="as sph.pressure, with the roundings of a mean of the liquid's pressure and of its extrapolation to the"
    " wall", invariants="translation reordering",
)  # fmt: skip
def extrapolated_wall_pressure(position, density, pressure, walls, smoothing, fluid, wall_gravity, rows=None):
    """Patent P6 with E30: a_i = -s sum_b Psi_b p_b/rho_i^2 grad W_ib [m/s^2], after Adami, Hu & Adams 2012, (27).

    p_b = p~_i + rho0 g.(x_b - x_i) [Pa], p~_i = sum_j W_ij (p_j + rho_j g.(x_i - x_j)) / sum_j W_ij, self included.
    position (n, 3) [m]; density [kg/m^3], pressure [Pa] (n,). Returns (value, scale).
    """
    rho, p = np.asarray(density, dtype=float), np.asarray(pressure, dtype=float)
    g = np.array([float(part) for part in wall_gravity])
    own = rho if rows is None else rho[np.asarray(rows)]
    mean, filled = Sums(len(own)), np.zeros(len(own))
    for place, separation, distance in pair_blocks(position, position, rows):
        w = kernel_value(distance, smoothing)
        deeper = rho[None, :] * (separation @ g)
        mean.add(place, w * (p[None, :] + deeper), w * (np.abs(p)[None, :] + np.abs(deeper)))
        filled[place] += w.sum(1)
    pressure_i, size = mean.total(filled)
    sums = Sums(len(own), 3)
    psi = float(fluid.rest_density) * np.asarray(walls.volume, dtype=float)
    for place, separation, distance in pair_blocks(position, walls.position, rows):
        gradient = kernel_gradient(separation, distance, smoothing)
        head = float(fluid.rest_density) * (separation @ g)
        pressure_b = pressure_i[place, None] - head
        if fluid.clamp:
            pressure_b = np.maximum(pressure_b, 0)
        factor = (float(fluid.gradient_share) * psi[None, :] / own[place, None] ** 2)[..., None] * gradient
        largest = size[place, None] + np.abs(head)
        sums.add(place, -factor * pressure_b[..., None], np.abs(factor) * largest[..., None])
    return {"acceleration": sums.total()}
