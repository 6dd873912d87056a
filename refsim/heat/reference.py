"""Equations of heat conduction (Shao & Song 2017, equation (4), here M(4)): i a particle, j its neighbour, ij the pair.

i, j    volume V [m^3; m^2 in 2D], conductivity k [W/(m K)], temperature T [degrees C], inverse 1/C [K/J], tensor A
ij      x_ij [m], e = x_ij/r, laplacian L_ij, conductivity k_ij, factor f_ij, weight g_ij = dt f_ij G_ij [J/K],
        share V_j L_ij [1/m^2]
"""

import math

import numpy as np

SPIKY, MUELLER, POLY6 = range(3)


# The pairs


def spiky(r, h, dim):
    """M(4), M5: L_ij = -W'(r)/max(r, h/10) of the spiky kernel [1/m^(dim+2)]."""
    return 3 * {2: 10, 3: 15}[dim] / math.pi / h ** (dim + 1) * (1 - r / h) ** 2 / np.maximum(r, h / 10)


def mueller(r, h, dim):
    """M(4), M6: L_ij = (h - r) 45/(pi h^6) in 3D, 40/(pi h^5) in 2D [1/m^(dim+2)]; twice the diffusivity."""
    return {2: 40, 3: 45}[dim] / math.pi / h ** (dim + 3) * (h - r)


def poly6(r, h, dim):
    """M(4), M5 as printed: the Laplacian of poly6 [1/m^(dim+2)], negative near the particle."""
    w0, q = {2: 4, 3: 315 / 64}[dim] / math.pi / h**dim, r / h
    return w0 / h**2 * (24 * q**2 * (1 - q**2) - 6 * dim * (1 - q**2) ** 2)


def harmonic_mean(i, j):
    """k_ij = 2 k_i k_j/(k_i + k_j) [W/(m K)]; 0 of two that are 0."""
    both = i.conductivity + j.conductivity
    return np.where(both == 0, 0.0, 2 * i.conductivity * j.conductivity / np.where(both == 0, 1.0, both))


def arithmetic_mean(i, j):
    """M(4): k_ij = (k_i + k_j)/2 [W/(m K)]."""
    return (i.conductivity + j.conductivity) / 2


def conductance(i, j, ij):
    """M(4): G_ij = V_i V_j 2 k_ij L_ij [W/K]."""
    return i.volume * j.volume * 2 * ij.conductivity * ij.laplacian


def capacity_of(mass, heat_capacity):
    """C_i = m_i c_i [J/K]; of a diffusivity V_i in place of m_i and 1 in place of c_i (M11)."""
    return mass * heat_capacity


def volume_of(mass, density):
    """V_i = m_i/rho_i [m^3; m^2 in 2D]."""
    return mass / density


def flow(i, j, ij):
    """dt Q_i = sum_j g_ij (T_j - T_i) [J]."""
    return ij.weight * (j.temperature - i.temperature)


def exchange(i, j, ij):
    """M(4), M7, M8: E_ij = g_ij (T_j - T_i)/(1 + g_ij (1/C_i + 1/C_j)) [J] from j to i, backward Euler of the pair."""
    return flow(i, j, ij) / (1 + ij.weight * (i.inverse + j.inverse))


# Missing neighbours (M26)


def moment(i, j, ij):
    """S_i = sum_j V_j L_ij f_ij x_ij x_ij^T, dimensionless; I inside."""
    return (ij.share * ij.factor)[:, None, None] * ij.x[:, :, None] * ij.x[:, None, :]


def factor_of(i, j, ij):
    """f_ij = e.(A_i + A_j).e/2 within 1/10 and 10, dimensionless."""
    return np.clip(np.einsum("pa,pab,pb->p", ij.e, (i.tensor + j.tensor) / 2, ij.e), 0.1, 10)


def nearly_inverse(moment):
    """P = 1.05 (M + 0.05 I)^-1, dimensionless, of the moment M for f = 1."""
    return 1.05 * np.linalg.inv(moment + 0.05 * np.eye(3))


def correction(a, p, moment):
    """A += w ((P (I - S) + (I - S) P)/2 - (A - P)/100), dimensionless: a round without its weight w."""
    left = np.eye(3) - moment
    return (p @ left + left @ p) / 2 - (a - p) / 100


def round_weight(k):
    """w_k = 1.1, 3.3, 1.3, 1.8, dimensionless: with these rounds of a start thin strips come nearest to k."""
    return (1.1, 3.3, 1.3, 1.8)[k - 1]


# Enthalpy


def temperature_of(enthalpy, heat_capacity, melting_point, latent_heat):
    """M12: T = Tm + H/c for H < 0, Tm from 0 to the latent heat L, Tm + (H - L)/c above [degrees C]."""
    above = enthalpy - latent_heat
    return melting_point + np.where(enthalpy < 0, enthalpy, np.where(above > 0, above, 0.0)) / heat_capacity


def heated(enthalpy, heat_capacity, change):
    """H += c dT [J/kg]."""
    return enthalpy + heat_capacity * change


# Backward Euler by Chebyshev's iteration (Saad 2003, algorithm 12.1)


def passes(s_max, tolerance):
    """n = ceil(ln(tol/2)/ln sigma), sigma = rho/(1 + sqrt(1 - rho^2)), rho = s_max/(1 + s_max); dimensionless."""
    rho = s_max / (1 + s_max)
    return math.ceil(math.log(tolerance / 2) / math.log(rho / (1 + math.sqrt(1 - rho**2))))


def next_correction(d, r, ratio, s_max):
    """d <- rho' rho d + 2 rho'/s_max r [K], rho' = 1/(2 (1 + s_max)/s_max - rho); eigenvalues 1 to 1 + 2 s_max."""
    after = 1 / (2 * (1 + s_max) / s_max - ratio)
    return after * ratio * d + 2 * after / s_max * r, after


# Runge-Kutta-Legendre (Meyer, Balsara & Aslam 2014)


def stages(s_max, order):
    """Odd s with (s^2 + s - 2)/4 >= s_max of second order, (s^2 + s)/2 >= 5/4 s_max of first; dimensionless."""
    enough = {1: lambda s: (s**2 + s) / 2 >= 1.25 * s_max, 2: lambda s: (s**2 + s - 2) / 4 >= s_max}[order]
    return next(s for s in range(2 * order - 1, 10**9, 2) if enough(s))


def legendre(k):
    """b_k = (k^2 + k - 2)/(2 k (k + 1)), b_0 = b_1 = b_2 = 1/3; dimensionless."""
    return 1 / 3 if k < 2 else (k**2 + k - 2) / (2 * k * (k + 1))


def first_order_stage(k, s, y, old, change):
    """RKL1: y_k = mu y_{k-1} + (1 - mu) y_{k-2} + mu w dt M(y_{k-1}), mu = (2 k - 1)/k, w = 2/(s^2 + s).

    [J/kg], dt M(y) = c dt/C sum_j G_ij (T_j - T_i).
    """
    mu = (2 * k - 1) / k
    return mu * y + (1 - k) / k * old + mu * 2 / (s**2 + s) * change


def second_order_stage(k, s, y, old, start, change, first):
    """RKL2: y_k = mu y_{k-1} + nu y_{k-2} + (1 - mu - nu) y_0 + mu w (dt M(y_{k-1}) - (1 - b_{k-1}) dt M(y_0)).

    mu = (2 k - 1)/k b_k/b_{k-1}, nu = -(k - 1)/k b_k/b_{k-2}, w = 4/(s^2 + s - 2); [degrees C].
    """
    b, w = legendre, 4 / (s**2 + s - 2)
    if k == 1:
        return y + b(1) * w * first
    mu, nu = (2 * k - 1) / k * b(k) / b(k - 1), -(k - 1) / k * b(k) / b(k - 2)
    return mu * y + nu * old + (1 - mu - nu) * start + mu * w * (change - (1 - b(k - 1)) * first)
