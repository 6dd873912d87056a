"""NumPy oracle of Dong, Zhang & Chen 2016: all pairs, float64.

Arrays: position, velocity, normals (n, 3); mass, density, pressure (n,); SI units.
"""

import numpy as np

from refsim.core.operation import SYMMETRY, Program, operations
from refsim.neighbours.reference import Sums, other_particles, pair_blocks, rows_of
from refsim.smoothing.reference import kernel_gradient, kernel_slope, kernel_value

operation = operations(paper="Dong, Zhang & Chen 2016")


def force_function(r, h, rest_distance):
    """D(7) L(r)/k = ((h-r)^4 - (h-d0)^2 (h-r)^2)/(h^2 d0 (2h-d0)), r < h; dimensionless, > 0 repels."""
    r = np.asarray(r, dtype=float)
    far = (h - rest_distance) ** 2
    shape = ((h - r) ** 4 - far * (h - r) ** 2) / (h**2 * rest_distance * (2 * h - rest_distance))
    return np.where(r < h, shape, 0.0)


@operation(
    "D(3)", outputs="number_density density", optional="number_density walls", invariants=SYMMETRY, packed="number_pair"
)
def density(position, mass, walls, smoothing, fluid, rows=None):
    """Densities [kg/m^dim] and number densities [1/m^dim], self included.

    D(3) rho_i = m_i (sum_j W_ij + sum_b (rho0 V_b/m_i) W_ib).
    """
    own = rows_of(mass, rows)
    number = np.zeros(len(own))
    for place, _, distance in pair_blocks(position, position, rows):
        number[place] += kernel_value(distance, smoothing).sum(1)
    if walls is not None:
        for place, _, distance in pair_blocks(position, walls.position, rows):
            filled = kernel_value(distance, smoothing) @ np.asarray(walls.volume, dtype=float)
            number[place] += float(fluid.rest_density) * filled / own[place]
    return {"density": (own * number, own * number), "number_density": (number, number)}


@operation(
    "D(4), D(5)", adds="acceleration", optional="walls viscosity", tolerance=12.0,
    reason="one rounding in each of distance, slope, two squared volumes, quotients, product and sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean dissipation",
    broken={0: "dissipation", 1: "angular_momentum"}, packed="momentum_pair",
)  # fmt: skip
def momentum(position, velocity, mass, density, pressure, walls, smoothing, fluid, viscosity, rows=None):
    """Acceleration [m/s^2] by pressure and viscosity.

    D(4) a_i = -(1/m_i) sum_j (V_i^2 p_i + V_j^2 p_j) W'(r) e_ij, V = m/rho;
    D(5) a_i += (1/m_i) sum_j mu (V_i^2 + V_j^2) (v_i - v_j) W'(r)/r;
    Akinci 2012 walls: a_i -= k s sum_b rho0 V_b p_i/rho_i^2 grad W_ib, k = 2 for p_b = p_i, s = 1.
    """
    mass, p = np.asarray(mass, dtype=float), np.asarray(pressure, dtype=float)
    rho, v = np.asarray(density, dtype=float), np.asarray(velocity, dtype=float)
    squared = (mass / rho) ** 2
    own = np.arange(len(mass)) if rows is None else np.asarray(rows)
    sums = Sums(len(own), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        i = own[place]
        slope = kernel_slope(distance, smoothing) * other_particles(place, len(mass), rows) / mass[i, None]
        slope = slope / np.where(distance > 0, distance, 1.0)
        both = (squared * p)[i, None] + (squared * p)[None, :]
        sums.add(place, -(both * slope)[..., None] * separation)
        if viscosity is not None:
            factor = float(viscosity.coefficient) * (squared[i, None] + squared[None, :]) * slope
            sums.add(place, factor[..., None] * (v[i, None, :] - v[None, :, :]))
    if walls is not None:
        wall_mass = float(fluid.rest_density) * np.asarray(walls.volume, dtype=float)
        for place, separation, distance in pair_blocks(position, walls.position, rows):
            gradient = kernel_gradient(separation, distance, smoothing)
            ratio = (p / rho**2)[own[place], None]
            share = float(fluid.wall_share) * float(fluid.gradient_share)
            sums.add(place, -(share * wall_mass[None, :] * ratio)[..., None] * gradient)
    return {"acceleration": sums.total()}


@operation(
    "D(6), D(7); D(8) to D(11) with Dong E21", adds="acceleration",
    optional="surface_normal molecular_force normal_correction",
    variants=("normal_correction surface_normal", "", "molecular_force"), tolerance=12.0,
    reason="one rounding in each of distance, powers, kernel, quotients, product and sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", broken={1: "angular_momentum", 2: "angular_momentum"},
    programs={
        "cuda:fused": Program(
            "kernels", "tension_and_momentum", packed="fused_pair", also=("sph.momentum",),
            names={"sph.momentum.smoothing": "gradient_smoothing"},
            variants=("period", "normal_correction surface_normal walls period"),
        )
    },
    packed="tension_pair",
)  # fmt: skip
def tension(position, mass, density, surface_normal, smoothing, molecular_force, normal_correction, rows=None):
    """Acceleration F/m [m/s^2] by pair force and correction, each unless None; surface_normal = h n_i.

    D(6), D(7) a_i = sum_j m_j L(r) e_ij;
    D(9) a_i = -lambda sum_j V_j (n_i - n_j) W_ij, V_j = 2 m_j/(rho_i + rho_j) (Dong E21) or m_j/rho_j; it is lost.
    """
    h = float(smoothing.support_radius)
    mass, rho = np.asarray(mass, dtype=float), np.asarray(density, dtype=float)
    own = np.arange(len(mass)) if rows is None else np.asarray(rows)
    sums = Sums(len(own), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        i = own[place]
        other = other_particles(place, len(mass), rows)
        if molecular_force is not None:
            d0, k = float(molecular_force.rest_distance), float(molecular_force.stiffness)
            unit = separation / np.where(distance > 0, distance, 1.0)[..., None]
            strength = k * mass[None, :] * other
            # The difference of two powers is as uncertain as their sum is large.
            powers = ((h - distance) ** 4 + (h - d0) ** 2 * (h - distance) ** 2) / (h**2 * d0 * (2 * h - d0))
            size = (np.abs(strength) * powers * (distance < h))[..., None] * np.abs(unit)
            sums.add(place, (strength * force_function(distance, h, d0))[..., None] * unit, size)
        if normal_correction is not None:
            normal = np.asarray(surface_normal, dtype=float)
            volume = (mass / rho)[None, :]
            if normal_correction.symmetric:
                volume = 2 * mass[None, :] / (rho[i, None] + rho[None, :])
            factor = float(normal_correction.coefficient) * volume * kernel_value(distance, smoothing) * other
            size = np.abs(factor)[..., None] * (np.abs(normal[i, None, :]) + np.abs(normal[None, :, :]))
            sums.add(place, -factor[..., None] * (normal[i, None, :] - normal[None, :, :]), size)
    return {"acceleration": sums.total()}
