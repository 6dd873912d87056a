"""NumPy oracle of Akinci et al. 2013: all pairs, float64.

Arrays: position, normals (n, 3); mass, density (n,); SI units.
"""

import math

import numpy as np

from refsim.core.operation import SYMMETRY, Program, operations
from refsim.neighbours.reference import Sums, other_particles, pair_blocks
from refsim.surface_normal.reference import normals_apart

operation = operations(paper="Akinci, Akinci & Teschner 2013")


def cohesion_function(r, h, dim):
    """C(r) = 32/(pi h^9) {(h-r)^3 r^3, r > h/2; 2 (h-r)^3 r^3 - h^6/64} [1/m^3]; h^8 in 2D [1/m^2]; > 0 attracts."""
    r = np.asarray(r, dtype=float)
    q = r / h
    near = 2 * (1 - q) ** 3 * q**3 - 1 / 64
    far = (1 - q) ** 3 * q**3
    return np.where(q < 1, np.where(q > 0.5, far, near), 0.0) * 32 / (math.pi * h**dim)


def adhesion_function(r, h, dim):
    """A(r) = 0.007/h^3.25 (-4 r^2/h + 6 r - 2 h)^(1/4), h/2 < r < h [1/m^3]; h^2.25 in 2D [1/m^2]."""
    q = np.asarray(r, dtype=float) / h
    inside = np.where((q > 0.5) & (q < 1), -4 * q**2 + 6 * q - 2, 0.0)
    return 0.007 / h**dim * np.maximum(inside, 0) ** 0.25


@operation(
    "cohesion, area term and K_ij", adds="acceleration", optional="area_normal spline area_term axial",
    variants=("area_term area_normal axial", "axial", "spline axial", ""), tolerance=12.0,
    reason="one rounding in each of distance, K_ij, the cubes of the spline, direction, product and sum; not in the"
    " bound: the area term does not vanish at r = h, so that a pair which a rounding moves across r = h changes a by"
    " K_ij eps |n_i - n_j|, at most 3.2 s^2 eps with s = rho0 over the least density near by: the longest normal is"
    " that of a half-space of liquid, h int W dA over its surface, which is below 1.6, times s for V_j = m_j/rho_j,"
    " and K_ij is at most s", invariants=f"{SYMMETRY} linear_momentum angular_momentum",
    broken=dict.fromkeys((1, 2, 3), "linear_momentum angular_momentum"),
    programs={
        "cuda:fused": Program(
            "kernels", "tension_and_momentum", packed="fused_pair", also=("sph.momentum",),
            names={"smoothing": "gradient_smoothing"},
            variants=("period axial", "area_term area_normal axial walls period", "period"),
        )
    },
    packed="tension_pair",
)  # fmt: skip
def tension(position, mass, density, area_normal, smoothing, fluid, spline, area_term, axial, rows=None):
    """Acceleration F/m [m/s^2] by cohesion and area term, each unless None.

    a_i = sum_j K_ij [-gamma m_j C(r) e_ij - eps (n_i - n_j)], K_ij = 2 rho0/(rho_i + rho_j); by `axial`
    n_i - n_j along e_ij alone, s ((n_i - n_j) . e_ij) e_ij.
    """
    h, dim = float(smoothing.support_radius), int(smoothing.dim)
    mass, rho = np.asarray(mass, dtype=float), np.asarray(density, dtype=float)
    own = np.arange(len(mass)) if rows is None else np.asarray(rows)
    sums = Sums(len(own), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        i = own[place]
        near = (distance < h) & other_particles(place, len(mass), rows)
        factor = near * 2 * float(fluid.rest_density) / (rho[i, None] + rho[None, :])
        if spline is not None:
            unit = separation / np.where(distance > 0, distance, 1.0)[..., None]
            strength = factor * float(spline.gamma) * mass[None, :]
            cohesion = cohesion_function(distance, h, dim)
            # The scale adds the two terms of the spline below h/2, which may cancel.
            size = np.abs(strength) * np.abs(cohesion + (distance <= h / 2) / (math.pi * h**dim))
            sums.add(place, -(strength * cohesion)[..., None] * unit, size[..., None] * np.abs(unit))
        if area_term is not None:
            eps = (factor * float(area_term.coefficient))[..., None]
            apart, size = normals_apart(area_normal, i, separation, distance, axial)
            sums.add(place, -eps * apart, np.abs(eps) * size)
    return {"acceleration": sums.total()}


@operation(
    "adhesion A(r), with the walls' Psi_b", adds="acceleration", tolerance=12.0,
    reason="one rounding in each of distance, direction, product and sum, and two roots", invariants=SYMMETRY,
)  # fmt: skip
def adhesion(position, walls, smoothing, fluid, adhesion, rows=None):
    """Acceleration [m/s^2] a_i = -beta sum_b Psi_b A(r) e_ib, Psi_b = rho0 V_b.

    The scale contains the effect of a rounding of q on the fourth root: |x dA/dx| with x = (2 q - 1)(2 - 2 q).
    """
    h, dim = float(smoothing.support_radius), int(smoothing.dim)
    filling = float(fluid.rest_density) * np.asarray(walls.volume, dtype=float)
    count = len(position) if rows is None else len(rows)
    sums = Sums(count, 3)
    for place, separation, distance in pair_blocks(position, walls.position, rows):
        q = distance / h
        unit = separation / np.where(distance > 0, distance, 1.0)[..., None]
        strength = float(adhesion.beta) * filling[None, :] * adhesion_function(distance, h, dim)
        inside = np.where(strength != 0, (2 * q - 1) * (2 - 2 * q), 1.0)
        rounding = 1 + 0.25 * ((2 * q + 1) * (2 - 2 * q) + (2 * q - 1) * (2 + 2 * q)) / inside
        size = np.abs(strength) * np.abs(rounding)
        sums.add(place, -strength[..., None] * unit, size[..., None] * np.abs(unit))
    return {"acceleration": sums.total()}
