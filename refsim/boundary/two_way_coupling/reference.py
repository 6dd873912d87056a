"""NumPy oracle of two-way coupling: all pairs, float64.

Arrays: position, velocity (n, 3); mass, density, pressure, volume, rest_density (n,) in SI units; phase (n,): 0 liquid,
1 solid at its body's surface, 2 solid inside. `rows` picks particles.
"""

import numpy as np

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.reference import Sums, other_particles, pair_blocks
from refsim.smoothing.reference import kernel_gradient, kernel_value, viscosity_laplacian

operation = operations(paper="Shao & Song 2017")

FLUID, SURFACE, INTERIOR = 0, 1, 2


def _rows(array, rows, kind=float):
    array = np.asarray(array, dtype=kind)
    return array if rows is None else array[rows]


@operation(
    "Shao & Song (1), phi, with M4", outputs="relative_contribution",
    reason="one rounding in each of distance, kernel, sum and quotient", invariants=SYMMETRY,
    packed="contribution_pair",
)  # fmt: skip
def contribution(position, phase, smoothing, coupling, rows=None):
    """Weights in Shao & Song (1): 1 in the liquid, 0 inside solids, phi_k = 1/(V_min sum_k' W_kk') at surfaces.

    With Shao & Song M4 k' runs over all solid particles; as printed, over those at surfaces alone. Dimensionless.
    """
    phase = np.asarray(phase)
    own = _rows(phase, rows, int)
    counted = phase == SURFACE if coupling.printed_volume else phase != FLUID
    sums = np.zeros(len(own))
    for place, _, distance in pair_blocks(position, position, rows):
        sums[place] = kernel_value(distance, smoothing) @ counted.astype(float)
    with np.errstate(divide="ignore"):
        phi = 1 / (sums * float(coupling.least_volume))
    value = np.where(own == FLUID, 1.0, np.where(own == SURFACE, phi, 0.0))
    return {"relative_contribution": (value, value)}


@operation(
    "Shao & Song (1), p = B ((rho/rho0)^7 - 1), V = m/rho", outputs="density pressure volume", optional="walls",
    tolerance=8.0, reason="one rounding in each of distance, kernel, product and sum; the scale counts the power's",
    invariants=SYMMETRY, packed="density_pair",
)  # fmt: skip
def density(position, mass, rest_density, phase, relative_contribution, walls, smoothing, coupling, rows=None):
    """Shao & Song (1): rho_i = m_i sum_j W_ij + m_i sum_k phi_k W_ik [kg/m^dim], self included; solids keep rho0_i.

    Walls, whose phi_b = V_b rho0_i/m_i: rho_i += rho0_i sum_b V_b W_ib.
    Tait: p_i = max(0, B_i ((rho_i/rho0_i)^g - 1)) [Pa], B_i = rho0_i c^2/g, 0 in solids. V_i = m_i/rho_i [m^dim].
    """
    own, m, rho0 = _rows(phase, rows, int), _rows(mass, rows), _rows(rest_density, rows)
    weight = np.asarray(relative_contribution, dtype=float)
    rho = np.zeros(len(own))
    for place, _, distance in pair_blocks(position, position, rows):
        rho[place] = m[place] * (kernel_value(distance, smoothing) @ weight)
    if walls is not None:
        for place, _, distance in pair_blocks(position, walls.position, rows):
            filled = kernel_value(distance, smoothing) @ np.asarray(walls.volume, dtype=float)
            rho[place] += rho0[place] * filled
    rho = np.where(own == FLUID, rho, rho0)
    stiffness, exponent = rho0 * float(coupling.stiffness), int(coupling.exponent)
    power = (rho / rho0) ** exponent
    pressure = np.where(own == FLUID, np.maximum(stiffness * (power - 1), 0), 0.0)
    volume = m / rho
    return {
        "density": (rho, rho),
        "pressure": (pressure, np.where(own == FLUID, stiffness * exponent * (power + 1), 0.0)),
        "volume": (volume, volume),
    }


@operation(
    "Shao & Song (2), (3) with M1 to M3", adds="acceleration", optional="walls viscosity", tolerance=8.0,
    invariants=f"{SYMMETRY} linear_momentum galilean dissipation", broken={0: "dissipation"}, packed="force_pair",
)  # fmt: skip
@operation(
    "Shao & Song (2) with M1, M2", "two_way_coupling.pressure", adds="acceleration", optional="walls viscosity",
    variants=("viscosity walls", "viscosity"), tolerance=8.0, invariants=f"{SYMMETRY} linear_momentum angular_momentum",
    packed="force_pair",
)  # fmt: skip
def forces(
    position, velocity, mass, density, rest_density, phase, pressure, volume, relative_contribution, walls, smoothing,
    coupling, viscosity, rows=None,
):  # fmt: skip
    """Accelerations F_i/m_i [m/s^2] of liquid and solids.

    Liquid i, liquid j: F_ij = -(V_i^2 p_i + V_j^2 p_j) grad W + mu V_i V_j (v_j - v_i) lap W.
    Liquid i, solid k: Shao & Song (2) with M1, M2: F_ik = -V_i^2 p_i phi_k grad W; (3) with M3: F_ik += mu V_i^2 phi_k
    (v_k - v_i) lap W; as printed without one m_i, and without one V_i. F_ki = -F_ik. With density_weighted p_i and p_j
    of two liquids are both (rho_j p_i + rho_i p_j)/(rho_i + rho_j), rho = m/V. Walls: a_i -= rho0_i V_b p_i/rho_i^2
    grad W.
    """
    phase = np.asarray(phase)
    m, p, size, phi = (np.asarray(a, dtype=float) for a in (mass, pressure, volume, relative_contribution))
    v = np.asarray(velocity, dtype=float)
    liquid = phase == FLUID
    pick = slice(None) if rows is None else np.asarray(rows)
    own_liquid, own_v = liquid[pick], v[pick]
    push, rho_of = size**2 * p, m / size
    across = push / m if coupling.printed_pressure else push
    sums = Sums(len(own_liquid), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        a, b = own_liquid[place, None], liquid[None, :]
        gradient = kernel_gradient(separation, distance, smoothing)
        together = push[pick][place, None] + push[None, :]
        if coupling.density_weighted:
            share = rho_of[None, :] / (rho_of[pick][place, None] + rho_of[None, :])
            between = share * p[pick][place, None] + (1 - share) * p[None, :]
            together = (size[pick][place, None] ** 2 + size[None, :] ** 2) * between
        liquid_first = across[pick][place, None] * phi[None, :]
        solid_first = across[None, :] * phi[pick][place, None]
        strength = np.where(a & b, together, np.where(a & ~b, liquid_first, np.where(~a & b, solid_first, 0.0)))
        own_mass = m[pick][place, None]
        sums.add(place, -(strength / own_mass)[..., None] * gradient)
        if viscosity is not None:
            mine, its = size[pick][place, None], size[None, :]
            power = 1 if coupling.printed_viscosity else 2
            first = mine**power * phi[None, :]
            second = its**power * phi[pick][place, None]
            both = np.where(a & b, mine * its, np.where(a & ~b, first, np.where(~a & b, second, 0.0)))
            factor = float(viscosity.coefficient) * both * viscosity_laplacian(distance, smoothing) / own_mass
            factor = factor * other_particles(place, len(v), rows)
            sums.add(place, factor[..., None] * (v[None, :, :] - own_v[place, None, :]))
    if walls is not None:
        rho = np.asarray(density, dtype=float)[pick]
        filled = np.asarray(rest_density, dtype=float)[pick] * p[pick] / rho**2 * own_liquid
        for place, separation, distance in pair_blocks(position, walls.position, rows):
            gradient = kernel_gradient(separation, distance, smoothing)
            factor = filled[place, None] * np.asarray(walls.volume, dtype=float)[None, :]
            sums.add(place, -factor[..., None] * gradient)
    return {"acceleration": sums.total()}


def _at_rest(velocity, followed_velocity, lean, delay, rows):
    """g - a_k (n, 3) [m/s^2] of the rows, a_k = (v_k - u_k)/tau, and the scale of that difference."""
    v, u = _rows(velocity, rows), _rows(followed_velocity, rows)
    g, tau = np.array([float(part) for part in lean]), float(delay.tau)
    return g - (v - u) / tau, np.abs(g) + (np.abs(v) + np.abs(u)) / tau


@operation(
    "(27)", paper="Adami, Hu & Adams 2012", outputs="wet pressure", entrywise=True, tolerance=16.0,
    reason="one rounding in each of distance, kernel, head, product and sum, and those of the quotient",
    packed="held_pair",
)  # fmt: skip
def extrapolation(position, velocity, followed_velocity, phase, density, smoothing, lean, delay, pressure, rows=None):
    """Pressure of each solid's particle k [Pa], 0 where no liquid is within reach; the liquid's stays.

    (27) p_k = sum_f W_kf (p_f + rho_f (g - a_k).(x_k - x_f)) / sum_f W_kf over liquid f, a_k = (v_k - u_k)/tau.
    wet_k = sum_f W_kf/W(0), dimensionless; 0 in the liquid.
    """
    rho, p = np.asarray(density, dtype=float), np.asarray(pressure, dtype=float)
    liquid, own = np.asarray(phase) == FLUID, _rows(phase, rows, int) == FLUID
    pull, doubt = _at_rest(velocity, followed_velocity, lean, delay, rows)
    sums, weights, terms = Sums(len(own)), np.zeros(len(own)), np.zeros(len(own))
    for place, separation, distance in pair_blocks(position, position, rows):
        w = kernel_value(distance, smoothing) * liquid
        weights[place] += w.sum(1)
        terms[place] += (w > 0).sum(1)
        head = rho * (separation * pull[place, None, :]).sum(-1)
        most = np.abs(p) + rho * (np.abs(separation) * doubt[place, None, :]).sum(-1)
        sums.add(place, w * (p + head), w * most)
    near = np.where(weights > 0, weights, 1.0)
    kept = p if rows is None else p[rows]
    value = np.where(own, kept, sums.value / near)
    wet = np.where(own, 0.0, weights / float(kernel_value(0.0, smoothing)))
    return {"wet": (wet, wet), "pressure": (value, np.where(own, np.abs(kept), (1 + terms) * sums.scale / near))}


@operation(
    "pressure of a film", paper="this project", outputs="pressure", entrywise=True, tolerance=16.0,
    reason="one rounding in each of distance, kernel, head, product and sum, and those of the quotient",
)  # fmt: skip
def spread(
    position, velocity, followed_velocity, phase, wet, smoothing, fluid, lean, delay, pressure, rows=None
):  # fmt: skip
    """Pressure [Pa] of solids' particles k with wet_k = 0, 0 without particles s with wet_s > 0 in reach.

    p_k = sum_s W_ks wet_s max(0, p_s + rho0 (g - a_k).(x_k - x_s)) / sum_s W_ks wet_s: a film too thin for particles
    carries the pressure between bodies in contact, and under tension it breaks.
    """
    damp, p = np.asarray(wet, dtype=float), np.asarray(pressure, dtype=float)
    pull, doubt = _at_rest(velocity, followed_velocity, lean, delay, rows)
    kept = _rows(pressure, rows)
    stays = (_rows(phase, rows, int) == FLUID) | (_rows(wet, rows) > 0)
    sums, weights, terms = Sums(len(kept)), np.zeros(len(kept)), np.zeros(len(kept))
    for place, separation, distance in pair_blocks(position, position, rows):
        w = kernel_value(distance, smoothing) * damp
        weights[place] += w.sum(1)
        terms[place] += (w > 0).sum(1)
        rest = float(fluid.rest_density)
        film = p + rest * (separation * pull[place, None, :]).sum(-1)
        most = np.abs(p) + rest * (np.abs(separation) * doubt[place, None, :]).sum(-1)
        sums.add(place, w * np.maximum(film, 0), w * most)
    near = np.where(weights > 0, weights, 1.0)
    scale = (1 + terms) * sums.scale / near
    return {"pressure": (np.where(stays, kept, sums.value / near), np.where(stays, np.abs(kept), scale))}


@operation(
    "J(10)", paper="Jiang & Zhu 2023; Adami, Hu & Adams 2012", adds="acceleration", tolerance=8.0,
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", packed="push_pair",
)  # fmt: skip
def push(position, phase, solid_number, mass, density, pressure, smoothing, fluid, rows=None):
    """Accelerations [m/s^2] a_i = -(1/rho_i) sum_j V_j (p_i + p_j) grad W_ij of liquid and solids, V = m/rho.

    Particles of one solid (`solid_number`) do not push each other.
    """
    rho, p = np.asarray(density, dtype=float), np.asarray(pressure, dtype=float)
    part = np.where(np.asarray(phase) == FLUID, -1 - np.arange(len(p)), np.asarray(solid_number, dtype=int))
    volume = np.asarray(mass, dtype=float) / rho
    pick = slice(None) if rows is None else np.asarray(rows)
    own_rho, own_p, own_part = rho[pick], p[pick], part[pick]
    share, sums = float(fluid.gradient_share), Sums(len(own_rho), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        gradient = kernel_gradient(separation, distance, smoothing)
        acting = (own_part[place, None] != part[None, :]) * share * volume / own_rho[place, None]
        both, size = own_p[place, None] + p, np.abs(own_p)[place, None] + np.abs(p)
        sums.add(place, -(acting * both)[..., None] * gradient, (acting * size)[..., None] * np.abs(gradient))
    return {"acceleration": sums.total()}


@operation("u of the step before", paper="standard", outputs="followed_velocity", invariants="reordering")
def follow(velocity, delay, timestep, followed_velocity, rows=None):
    """Velocity [m/s] that follows that of a particle: u += (v - u)/(1 + tau/dt); (v - u)/tau is its acceleration."""
    v, u = _rows(velocity, rows), _rows(followed_velocity, rows)
    share = float(timestep[1]) / (float(timestep[1]) + float(delay.tau))
    return {"followed_velocity": (u + share * (v - u), np.abs(u) + share * (np.abs(u) + np.abs(v)))}
