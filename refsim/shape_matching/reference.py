"""Equations of lattice shape matching (Shao & Song 2017 after Rivers & James 2007): s a node, k a member of its region.

s       count cnt_s, velocity v_s [m/s]
k       mass m_k/cnt_k [kg]
sk      x x_k - x_s [m], rest x0_k - x0_s [m], velocity v_k - v_s [m/s], arm from the region's center r = x_k - c_s [m]
r       a region that holds s: anchor c + R (x0_r - c0) - x_r [m], turn R, velocity v_c [m/s], spin omega [1/s]
sr      x x_r - x_s [m], rest x0_r - x0_s [m], arm from the region's center x_s - c_r [m]
"""

import numpy as np

from refsim.core.terms import cross, outer

FLUID, SURFACE, INTERIOR = 0, 1, 2
EMPTY = -1


# Neighbours and members


def directly_beside(cells, of_one_body, solid):
    """Figure 2, arrayN, M18, M19: k is solid, of the body of s, |g_k - g_s| <= 1 cell along each axis; a flag."""
    return (abs(cells) <= 1).all(-1) & of_one_body & solid


def one_step_farther(members, direct):
    """Figure 3, arrayR, M14, M15: R <- R and the direct neighbours of each k in R, w times; dimensionless."""
    return members | {int(j) for m in members for j in direct[m] if j != EMPTY}


def phase(neighbours, dim):
    """Section 2: phase = 1 (SBP) with fewer than 3^dim direct neighbours, itself included, 2 (IBP) with all; a flag."""
    return np.where(neighbours == 0, FLUID, np.where(neighbours < 3**dim, SURFACE, INTERIOR))


def share(mass, count):
    """m = m_k/cnt_k [kg] in each of the cnt_k regions of node k; 0 in none."""
    return np.where(count > 0, mass / np.maximum(count, 1), 0.0)


# The best rigid motion of a region


def mass(s, k, sk):
    """M = sum_k m [kg]."""
    return k.mass


def moment(s, k, sk):
    """sum_k m x [kg m]; the center is c = sum_k m x/M."""
    return k.mass * sk.x


def moment_at_rest(s, k, sk):
    """sum_k m x0 [kg m]; c0 = sum_k m x0/M."""
    return k.mass * sk.rest


def products(s, k, sk):
    """sum_k m x x0^T [kg m^2]."""
    return k.mass * outer(sk.x, sk.rest)


def covariance(products, mass, center, rest_center):
    """A = sum_k m (x - c)(x0 - c0)^T = sum_k m x x0^T - M c c0^T [kg m^2]."""
    return products - mass * outer(center, rest_center)


def rotation_matrix(q):
    """R(q) = (1 - 2 |u|^2) 1 + 2 u u^T + 2 w [u]x of the quaternion (w, u), dimensionless."""
    w, u = q[..., 0, None, None], q[..., None, 1:]
    squared, products = (u * u).sum(-1, keepdims=True), np.swapaxes(u, -1, -2) * u
    return (1 - 2 * squared) * np.eye(3) + 2 * products + 2 * w * np.cross(np.eye(3), u)


def quadratic_form(a):
    """K of tr(R(q)^T A) = q^T K q + tr A, by polarisation of R; [kg m^2] as A, or dimensionless."""
    mixed = [[(rotation_matrix(p + q) - rotation_matrix(p - q)) / 4 for q in np.eye(4)] for p in np.eye(4)]
    return np.einsum("pqab,...ab->...pq", mixed, a)


def best_turn(form, before, weight):
    """q = argmax q^T (K + e b b^T) q, dimensionless, b the turn before, and the gap to the next eigenvalue."""
    values, vectors = np.linalg.eigh(form + weight[:, None, None] * before[:, :, None] * before[:, None, :])
    return vectors[:, :, -1], values[:, -1] - values[:, -2]


def anchor(center, turn, rest_center):
    """Where a region takes its node: c + R (x0_s - c0) = c - R c0 [m], from x_s and x0_s."""
    return center - turn @ rest_center


# Goals and damping


def goal(s, r, sr):
    """g_s - x_s = (1/cnt_s) sum_r (R_r (x0_s - c0_r) + c_r - x_s) [m]."""
    return (sr.x + r.anchor - r.turn @ sr.rest) / s.count


def towards(goal, stiffness, kick, drift):
    """v += alpha (g - x)/dt in a kick of t: a = alpha (g - x)/(t dt) [m/s^2]."""
    return stiffness / (kick * drift) * goal


def momentum(s, k, sk):
    """sum_k m (v - v_s) [kg m/s]; v_c = v_s + sum_k m (v - v_s)/M."""
    return k.mass * sk.velocity


def inertia(s, k, sk):
    """I = sum_k m (r^2 1 - r r^T) [kg m^2]."""
    return k.mass * ((sk.arm @ sk.arm) * np.eye(3) - outer(sk.arm, sk.arm))


def angular_momentum(s, k, sk):
    """L = sum_k m r x (v - v_s) [kg m^2/s]."""
    return k.mass * cross(sk.arm, sk.velocity)


def spin(inertia, held, momentum):
    """omega = I^-1 L [1/s]; of I + e tr(I) 1, `held`, and solved again for what e left over."""
    first = np.linalg.solve(held, momentum[..., None])
    return (first + np.linalg.solve(held, momentum[..., None] - inertia @ first))[..., 0]


def damping(s, r, sr, beta):
    """M25: v_s += (beta/cnt_s) sum_r (v_r + omega_r x (x_s - c_r) - v_s) [m/s]."""
    return beta / s.count * (r.velocity + cross(r.spin, sr.arm) - s.velocity)
