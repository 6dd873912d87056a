"""Equations of weakly compressible SPH: the term of one pair in the sum over j, or what follows from the sums.

Walls b are particles of volume V_b and mass m_b = rho0 V_b.
"""

import math

import numpy as np

from refsim.core.terms import Terms, clip, determinant, inverse, maximum, outer, where


def summed_density(i, j, ij):
    """J(7) rho_i = sum_j m_j W_ij [kg/m^dim], i itself included."""
    return j.mass * ij.W


def number_density(i, j, ij):
    """J(8) delta_i = sum_j W_ij [1/m^dim], i itself included."""
    return ij.W


def number_density_at_walls(i, b, ib):
    """delta_i += sum_b (m_b/m_i) W_ib [1/m^dim]."""
    return b.mass / i.mass * ib.W


def first_moment(i, j, ij):
    """First moment of J(8), sum_j W_ij x_ij [m^(1 - dim)]; the asymmetry is its length."""
    return ij.W * ij.x


def first_moment_at_walls(i, b, ib):
    """sum_b (m_b/m_i) W_ib x_ib [m^(1 - dim)]."""
    return b.mass / i.mass * ib.W * ib.x


def strain(i, j, ij):
    """Colagrossi & Landrini 2003: d rho_i/dt = rho_i sum_j V_j (v_i - v_j).grad W_ij; the sum [1/s], over walls too."""
    return j.volume * ((i.velocity - j.velocity) @ ij.gradient)


def transport(i, j, ij):
    """Sun et al. 2019, (-rho div s + div(rho s))/rho: sum_j V_j (2 s_i + (rho_j/rho_i - 1) s_j).grad W_ij [1/s]."""
    return j.volume * ((2 * i.shift + (j.density / i.density - 1) * j.shift) @ ij.gradient)


def transport_at_walls(i, b, ib):
    """The same over walls, whose shift is 0: 2 sum_b V_b s_i.grad W_ib [1/s]."""
    return 2 * b.volume * (i.shift @ ib.gradient)


def diffusion(i, j, ij, delta_h_c, stretch):
    """Molteni & Colagrossi 2009, Fourtakas et al. 2019: delta h c sum_j V_j psi_ij.grad W_ij [kg/(m^dim s)].

    psi_ij = 2 (e_j - e_i + b_i b_j rho0/c^2 g_ij.x_ij) x_ji/r^2, e = rho - rho0, g_ij the mean of both; over liquid
    alone. `felt` is g, and in a tank that turns what is felt there; `stretch` is rho0/c^2.
    """
    at_rest = i.borne * j.borne * stretch * (ij.x @ (0.5 * (i.felt + j.felt)))
    return -2 * delta_h_c * j.liquid * j.volume * (j.excess - i.excess + at_rest) * ij.slope / ij.apart


def borne(i, g):
    """b = 2 s - 1/2 in 0 to 1, s = 1 - g.a/g^2 the share of its weight that something takes off a particle; [-]."""
    return clip(1.5 - 2 * (i.acceleration @ g) / maximum(g @ g, 1e-300), 0, 1)


def filling(i, j, ij):
    """-sum_j V_j x_ij.grad W_ij, with liquid and walls dim inside and less at a surface; dimensionless."""
    return -j.volume * ij.r * ij.slope


def filling_of_liquid(i, j, ij):
    """l = -sum_j V_j x_ij.grad W_ij over liquid alone; dimensionless."""
    return j.liquid * filling(i, j, ij)


def filling_of_solids(i, j, ij):
    """b = -sum_j V_j x_ij.grad W_ij over solids alone; dimensionless."""
    return (1 - j.liquid) * filling(i, j, ij)


def of_what_is_left(filled, held):
    """s = l/(1 - b), the liquid's share of the space that walls and solids leave; dimensionless."""
    return filled / maximum(1 - held, 0.1)


def told_volume(i, j, ij):
    """s_i = sum_j V_j W_ij, i itself included, over that of a lattice: the share of space that is filled; [-]."""
    return j.volume * ij.W


def returned(filled, share, rate):
    """Colagrossi & Landrini 2003, in small shares: strain += rate f (s - 1) [1/s], f of `interior`."""
    return rate * interior(filled) * (share - 1)


def interior(filled):
    """f from 0 at filled = 0.75 to 1 at 0.85; dimensionless."""
    return clip(10 * filled - 7.5, 0, 1)


def handed_on(i, b, ib):
    """Strain of walls: f_i sum_b s_b W_ib/V_i is added to the strain; the sum [1/(s m^dim)]."""
    return b.strain * ib.W


def across(v, n):
    """n n.v, what moves across a wall of normal n [m/s]; all of v at an edge, where n = 0."""
    return where(n @ n, (v @ n) * n, v)


def strain_across(i, b, ib):
    """The strain by walls along which the liquid slides, sum_b V_b n_b n_b.v_i.grad W_ib [1/s], n n.v of `across`."""
    return b.volume * (across(i.velocity, b.normal) @ ib.gradient)


def lone(around):
    """a = (0.3 - s)/0.1 between 0 and 1, s the share of the space around that is filled; dimensionless."""
    return clip((0.3 - around) / 0.1, 0, 1)


def advanced(i, strain, spread, released, dt):
    """e_i <- (e_i + dt (rho_i strain + spread))/(1 + dt `released`) [kg/m^dim], at least -0.05 rho0: liquid pulled
    further apart breaks."""
    return i.liquid * maximum((i.excess + dt * (i.density * strain + spread)) / (1 + dt * released), -0.05 * i.rest)


def state(i, stiffness, rest, exponent):
    """J(9) p = c^2 (rho - rho0), of Tait p = B ((rho/rho0)^g - 1) [Pa] that with g = 1 and B = c^2 rho0."""
    return stiffness * ((i.density / rest) ** exponent - 1)


def internal_pressure(i, p_int, rest):
    """p += P_int (rho/rho0)^2 [Pa], which balances the cohesion of the bulk."""
    return p_int * (i.density / rest) ** 2


def pressure_force(i, j, ij, s):
    """J(10) a_i = -s sum_j m_j (p_i + p_j)/(rho_i rho_j) grad W_ij [m/s^2]; s = 1 (Jiang & Zhu E24), printed 1/2."""
    return -s * j.mass / j.density * (i.pressure + j.pressure) / i.density * ij.gradient


def wall_pressure_force(i, b, ib, s, k):
    """Akinci et al. 2012: a_i = -k s sum_b m_b p_i/rho_i^2 grad W_ib [m/s^2], k = 2 for p_b = p_i."""
    return -s * k * b.mass * i.pressure / (i.density * i.density) * ib.gradient


def viscous_force(i, j, ij, mu):
    """J(11) a_i = (mu/rho_i) sum_j (m_j/rho_j) (v_j - v_i) lap W_ij [m/s^2], sign of Jiang & Zhu E3."""
    return mu * j.mass / j.density / i.density * ij.laplacian * (j.velocity - i.velocity)


def steepness(r, h, dim):
    """F = -W'/r = 6 A (1 - r/h)/h^2 [1/m^(dim+2)] of W = A (1 - r/h)^2 (1 + 2 r/h), whose integral is one."""
    amplitude = 10 / (3 * math.pi * h**2) if dim == 2 else 15 / (4 * math.pi * h**3)
    return Terms(6 * amplitude * np.maximum(1 - r.value / h, 0) / h**2)


def central_viscous_force(i, j, ij, k):
    """Espanol & Revenga 2003, zeta = 5 eta/3: a_i = (2 k/rho_i) sum_j (m_j/rho_j) F_ij e_ij e_ij.(v_j - v_i) [m/s^2].

    k = (dim + 2) mu; in 3D the part along e_ij alone is left.
    """
    F = steepness(ij.r, ij.h, ij.dim)
    return 2 * k * j.mass / j.density / i.density * F * (ij.e @ (j.velocity - i.velocity)) * ij.e


def filled_matrix(i, j, ij):
    """Bonet & Lok 1999: M_i = -sum_j V_j x_ij grad W_ij^T, I inside of the liquid; dimensionless."""
    return -j.volume * outer(ij.x, ij.gradient)


def renormalised(m):
    """B = I + s (M^-1 - I), s = (det M - 0.5)/0.3 between 0 and 1; dimensionless."""
    s = clip((determinant(m) - 0.5) / 0.3, 0, 1)
    regular = where(determinant(m) > 0.4, m, np.eye(3))
    return np.eye(3) + s * (inverse(regular) - np.eye(3))


def own_pressure(i):
    """Sun et al. 2018: q = -p [Pa] where p < 0 away from the surface, else p, the pressure of i in its own force."""
    return where(i.near_surface, i.pressure, Terms(np.abs(i.pressure.value)))


def corrected_pressure_force(i, j, ij, s):
    """a_i = -(s/rho_i) sum_j V_j (q_i + p_j) (B_i + B_j)/2 grad W_ij [m/s^2], q the own pressure, s of J(10)."""
    B = 0.5 * (i.correction + j.correction)
    return -s * j.mass / j.density / i.density * (i.own_pressure + j.pressure) * (B @ ij.gradient)


def beyond(temperature, low, high):
    """How far a temperature is out of its range [K], d = max(T - high, low - T, 0)."""
    return maximum(maximum(temperature - high, low - temperature), 0)


def kicked(i, kick):
    """Leap-frog: v <- v + (dt_previous + dt)/2 a [m/s]."""
    return i.velocity + kick * i.acceleration


def drifted(i, v, drift):
    """Leap-frog: x <- x + dt v + shift; the change [m]."""
    return drift * v + i.shift
