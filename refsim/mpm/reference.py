"""Equations of the transfers (thesis, chapter 4): p a particle or an embedded point q, j a node, pj what lies between.

p       mass [kg], velocity [m/s], affine A_p [1/s], stress K_p [J], inverse_moment D_p^-1 [1/m^2], share w_p
j       mass [kg], momentum [kg m/s], force [N], velocity [m/s]
pj      weight B_j(x_p), slope grad B_j(x_p) [1/m], arm x_j - x_p [m]
"""

import numpy as np

from refsim.core.terms import determinant, outer, trace, transposed, where

STICKY, SLIP, SEPARATING = 1, 2, 3


# The grid


def base_node(cells):
    """Chapter 3.4.2: j = floor(x/h - 1/2) of a place x/h, and how far it is from flipping; dimensionless."""
    j = np.floor((np.floor(2 * cells) - 1) / 2)
    return j, np.minimum(cells - 0.5 - j, j + 1.5 - cells)


def spline_weight(b):
    """Before (3.2): B_j(x_p) = B(u_x) B(u_y) B(u_z), u = (x_p - x_j)/h, b the three; dimensionless."""
    return b[:, 0] * b[:, 1] * b[:, 2]


def spline_slope(b, s, h):
    """M19: grad B_j(x_p) [1/m], s = B'(u) along each axis."""
    x, y, z = b.T
    return s * np.stack([y * z, x * z, x * y], axis=-1) / h


# From particles to nodes


def split_mass(p):
    """4.3.1: m_q = m_p w_p [kg], w_p = 1/(2 C_p + 1), of the particle and of each embedded point."""
    return p.mass * p.share


def node_mass(j, p, jp):
    """Before (4.10): m_j = sum_p m_p B_j(x_p) [kg]."""
    return p.mass * jp.weight


def node_momentum(j, p, jp):
    """(4.10), (4.15) (mv)_j = sum_p m_p B_j(x_p) (v_p + A_p (x_j - x_p)) [kg m/s]."""
    return p.mass * jp.weight * (p.velocity + p.affine @ jp.arm)


def stress_of(p, stiffness):
    """(4.17), M3, M4: K_p = lambda V0_p J_p (J_p - 1) [J]; `dilation` is J_p, or 1 as printed."""
    return stiffness * p.rest_volume * p.dilation * (p.volume_ratio - 1)


def inverse_moment(inverse_spread, h):
    """(3.16) D_p^-1 = (4/h^2) E_p^-1 [1/m^2], E_p = 1 without embedded points."""
    return 4 / h**2 * inverse_spread


def stress_force(j, p, jp):
    """(4.17), M6: f_j = -sum_p K_p B_j(x_p) D_p^-1 (x_j - x_p) [N], with the gradient by which J changes."""
    return -(p.stress * jp.weight * (p.inverse_moment @ jp.arm))


def printed_stress_force(j, p, jp):
    """(4.17) as printed: f_j = -sum_p K_p grad B_j(x_p) [N]."""
    return -(p.stress * jp.slope)


# On the nodes


def slow(velocity, least_speed):
    """v_c = 0 [m/s]: whether a component stands still."""
    return abs(velocity) <= least_speed


def node_velocity(j, dt, least_mass, gravity):
    """(4.11), (4.19) v_j = ((mv)_j + dt f_j)/m_j + dt g [m/s]; 0 where there is no mass."""
    return where(j.mass > least_mass, (j.momentum + dt * j.force) / j.mass + dt * gravity, 0.0)


def mirrored(j, plane, inward):
    """Image j' = 2 b - j of a node j behind a plane b, and its depth = inward (b - j); in cells, dimensionless."""
    return 2 * plane - j, inward * (plane - j)


def stopped(velocity, inward, rule):
    """v_c = 0 across a wall [m/s]: whether it stops that component, SEPARATING only where it points outwards."""
    return (rule == STICKY) | (rule == SLIP) | ((rule == SEPARATING) & (inward * velocity < 0))


# From nodes to particles


def gathered_velocity(p, j, pj):
    """(4.12), M7: v_p = sum_j B_j(x_p) v_j [m/s], v_j after (4.19)."""
    return pj.weight * j.velocity


def gathered_moment(p, j, pj):
    """(4.13), M7: sum_j B_j(x_p) v_j (x_j - x_p)^T [m^2/s]."""
    return outer(pj.weight * j.velocity, pj.arm)


def moment_about_the_particle(p, q, pq):
    """(4.14): sum_q sum_j B_j(x_q) v_j (x_j - x_p)^T [m^2/s] of the embedded points q of p, pq.arm = x_q - x_p [m]."""
    return q.moment + outer(q.velocity, pq.arm)


def velocity_gradient(moment, inverse_moment):
    """(4.13) A_p = sum_j B_j(x_p) v_j (x_j - x_p)^T D_p^-1 [1/s]."""
    return moment @ inverse_moment


def advanced_ratio(p, dt):
    """(4.16), M5: J <- J (1 + dt tr A); dimensionless."""
    return p.volume_ratio * (1 + dt * trace(p.affine))


def advanced_deformation(p, dt):
    """(4.16), M5: F <- (1 + dt A) F, and J = det F; dimensionless."""
    new = p.deformation + dt * p.affine @ p.deformation
    return new, determinant(new)


def advected(position, velocity, dt):
    """(4.8), M8: x <- x + dt v_p [m]."""
    return position + dt * velocity


# Embedded points


def share_of(count):
    """4.3.1: w_p = 1/(2 C_p + 1), dimensionless, C_p the number of surface samples nearest to p."""
    return 1 / (2 * count + 1)


def mirror_image(p, s):
    """4.3.1, M11, M12: x_o = 2 x_p - x_s [m]."""
    return 2 * p.position - s.position


def spread(p, q, pq, h):
    """M9: E_p - 1 = (4/h^2) w_p sum_q (x_q - x_p)(x_q - x_p)^T, dimensionless, of the moment D_p = (h^2/4) E_p."""
    return 4 / h**2 * p.share * outer(pq.arm, pq.arm)


# Beside the thesis


def viscosity(p, factor, dt):
    """A <- A - dt J (4 mu/(rho0 h^2)) (A + A^T) E^-1 [1/s]: the stress mu (A + A^T) through (4.10)."""
    return p.affine - dt * p.volume_ratio * factor * (p.affine + transposed(p.affine)) @ p.inverse_spread


def counted_density(p, j, pj, cell_mass):
    """sum_j B_j(x_p) m_j/(rho0 h^d), the counted density over that at rest, dimensionless; q_p = J_p times it."""
    return pj.weight * j.mass / cell_mass
