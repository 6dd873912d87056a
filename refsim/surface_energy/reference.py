"""Equations of the reconstruction of a surface and of its tension.

Places are in cells, u = x/h - j is one beside node j, and C are the coefficients of the splines at the nodes around.
"""

import numpy as np

LEAST_SUM = 1e-12  # of a node's splines; a node with a smaller sum is not active


def inside(distance, radius):
    """Algorithm 1, lines 5 to 9: s_g = 1 where |x_g - x_v| < r for some particle v, a flag of its distance."""
    return distance < radius


def exit_length(along, across, r2):
    """Algorithm 1, line 15: l = a + sqrt(r^2/h^2 - q^2) [cells], a and q^2 along and across the edge."""
    return along + np.sqrt(np.maximum(r2 - across, 0))


def on_edge(j, direction, sign, length, h):
    """Algorithm 1, lines 16, 17: x = h (j + s min(l, 1) e_a) [m], l = max_v l_v."""
    return h * (j + sign * np.minimum(length, 1) * direction)


def centroid(corner):
    """x_s = (1/dim) sum_c x_c [m] of a facet."""
    return corner.mean(axis=1)


def area_vector(corner):
    """A n = (b - a) x (c - a)/2 [m^2] of a triangle; of a segment A n = (b - a) turned to the right [m]."""
    side = corner[:, 1:] - corner[:, :1]
    if side.shape[1] == 2:
        return np.cross(side[:, 0], side[:, 1]) / 2
    return side[:, 0] @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


def hash_word(a, b, c):
    """hash(a, b, c) = 32 bits of two rounds of xor, shift and multiply; dimensionless."""
    mask = 0xFFFFFFFF
    word = (int(a) * 0x9E3779B1 + int(b) * 0x85EBCA77 + int(c) * 0xC2B2AE3D) & mask
    for _ in range(2):
        word ^= word >> 16
        word = word * 0x7FEB352D & mask
        word ^= word >> 15
        word = word * 0x846CA68B & mask
        word ^= word >> 16
    return word


def share(a, b, c):
    """hash(a, b, c)/2^32 = u in [0, 1), of 24 bits; dimensionless."""
    return (hash_word(a, b, c) >> 8) / 2.0**24


def place_in_facet(corner, u, w):
    """x = (1 - s) a + s ((1 - w) b + w c) [m], s = sqrt(u); in a segment x = a + u (b - a)."""
    if corner.shape[1] == 2:
        return corner[:, 0] + u * (corner[:, 1] - corner[:, 0])
    s = np.sqrt(u)
    return (1 - s) * corner[:, 0] + s * ((1 - w) * corner[:, 1] + w * corner[:, 2])


def accepted(distance, disk):
    """Darts for (4.5): a = 1 (flag) where no dart that was taken before stands nearer than the disk's radius."""
    return bool((distance >= disk).all())


def second_point(x, n, epsilon):
    """Section 4.3.1: q_s = x_s + epsilon n_s [m], n_s = (x_s - x_p)/|x_s - x_p|, p_s = argmin_v |x_s - x_v|."""
    return x + epsilon * n


def spline(u):
    """B(u) = 3/4 - u^2 (|u| < 1/2), 1/2 (3/2 - |u|)^2 (|u| < 3/2), else 0; dimensionless."""
    u = np.abs(u)
    return np.where(u < 0.5, 0.75 - u**2, np.where(u < 1.5, 0.5 * (1.5 - u) ** 2, 0))


def spline_derivative(u):
    """dB/du = -2 u (|u| < 1/2), -sign(u) (3/2 - |u|) (|u| < 3/2), else 0; dimensionless."""
    size = np.abs(u)
    return np.where(size < 0.5, -2 * u, np.where(size < 1.5, -np.sign(u) * (1.5 - size), 0))


def basis(u, dim):
    """B_j(x) = prod_c B(u_c), dimensionless."""
    return spline(u[..., :dim]).prod(-1)


def basis_gradient(u, dim):
    """h grad B_j = dB/du_c prod_(b != c) B(u_b), dimensionless."""
    one, gradient = spline(u[..., :dim]), np.zeros(u.shape)
    for c in range(dim):
        gradient[..., c] = spline_derivative(u[..., c]) * np.prod(np.delete(one, c, axis=-1), axis=-1)
    return gradient


def diagonal(total):
    """(3.7) Lambda_j = 1/sum_r B_j(x_r), 0 where the sum is below 1e-12 (thesis M16); dimensionless."""
    return np.divide(1, total, out=np.zeros(total.shape), where=total > LEAST_SUM)


def residual(b, BC):
    """(3.5) r = b - B C, in units of h, dimensionless; b is 0 at samples and epsilon at the second points."""
    return b - BC


def corrected(C, step, Br):
    """(3.6), Algorithm 2: C <- C + w Lambda B^T r from C = 0, in units of h, dimensionless."""
    return C + step * Br


def value(C, u, dim):
    """(3.8) f/h = sum_j C_j B_j, dimensionless."""
    return (basis(u, dim) * C).sum(1)


def spline_gradient(C, u, dim):
    """(3.9) g = sum_j C_j h grad B_j, C in units of h, dimensionless."""
    return np.einsum("nk,nka->na", C, basis_gradient(u, dim))


def mls_gradient(C, u, dim):
    """(3.17) c = (4/h^2) sum_j B_j C_j (x_j - y), solved as the weighted least squares it comes from, (3.13).

    (sum_j B_j d d^T) c = sum_j B_j (C_j - f) d, d = (x_j - y)/h = -u; dimensionless.
    """
    B = basis(u, dim)
    moment = np.einsum("nk,nka,nkb->nab", B, u, u) + np.diag([0.0] * dim + [1.0] * (3 - dim))
    side = -np.einsum("nk,nk,nka->na", B, C - value(C, u, dim)[:, None], u)
    return np.linalg.solve(moment, side[..., None])[..., 0]


def inset(x, n, distance):
    """Thesis M31: x <- x - (r - delta) n [m] of every vertex."""
    return x - distance * n


def pull(area, n, gradient, k):
    """(4.5), (4.18*) f_j = -k sum_s A_s (I - n n^T) grad B_j(x_s) [N]; of one sample. Thesis M1 turns the sign of k."""
    return -k * area * (gradient - n * (n * gradient).sum(-1, keepdims=True))


def lowest_joined(inside, around):
    """l_i = lowest number (dimensionless) of the inside nodes that edges between inside nodes join to i; -1 outside.

    around: for each step to a neighbour the number of the node there, -1 without one.
    """
    label = np.where(inside, np.arange(len(inside)), -1)
    while True:
        lower = label.copy()
        for j in around:
            met = inside & (j >= 0) & inside[j]
            lower[met] = np.minimum(lower[met], label[j[met]])
        if (lower == label).all():
            return label
        label = lower


def component_size(label):
    """n_p = particles whose label is that of p, dimensionless; 0 where it is -1."""
    return np.where(label >= 0, (label[:, None] == label[None, :]).sum(1), 0)
