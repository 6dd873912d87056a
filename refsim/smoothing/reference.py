"""NumPy oracle of the smoothing kernels, written from the kernel table in the variable r."""

import math

import numpy as np

NAMES = ("poly6", "spiky", "cubic_spline", "wendland_c2")


def _normalisation(name, h, dim):
    two, three = {
        "poly6": (4 / math.pi, 315 / (64 * math.pi)),
        "spiky": (10 / math.pi, 15 / math.pi),
        "cubic_spline": (40 / (7 * math.pi), 8 / math.pi),
        "wendland_c2": (7 / math.pi, 21 / (2 * math.pi)),
    }[name]
    return (two if dim == 2 else three) / h**dim


def _inside(r, h):
    """(zeros of r's shape, mask of r < h, r/h there): most of all pairs are farther apart than the support."""
    q = np.asarray(r, dtype=float) / h
    near = q < 1
    return np.zeros(q.shape), near, q[near]


def kernel_value(r, smoothing):
    """W(r, h) [1/m^dim] at distances r [m], an array of any shape."""
    h, name = float(smoothing.support_radius), NAMES[smoothing.shape]
    values, near, q = _inside(r, h)
    if name == "poly6":
        w = (1 - q**2) ** 3
    elif name == "spiky":
        w = (1 - q) ** 3
    elif name == "cubic_spline":
        w = np.where(q <= 0.5, 6 * (q**3 - q**2) + 1, 2 * (1 - q) ** 3)
    else:
        w = (1 - q) ** 4 * (1 + 4 * q)
    values[near] = w * _normalisation(name, h, smoothing.dim)
    return values


def kernel_slope(r, smoothing):
    """dW/dr [1/m^(dim+1)] at distances r [m], an array of any shape."""
    h, name = float(smoothing.support_radius), NAMES[smoothing.shape]
    values, near, q = _inside(r, h)
    if name == "poly6":
        w = -6 * q * (1 - q**2) ** 2
    elif name == "spiky":
        w = -3 * (1 - q) ** 2
    elif name == "cubic_spline":
        w = np.where(q <= 0.5, 18 * q**2 - 12 * q, -6 * (1 - q) ** 2)
    else:
        w = -20 * q * (1 - q) ** 3
    values[near] = w * _normalisation(name, h, smoothing.dim) / h
    return values


def kernel_gradient(separation, distance, smoothing):
    """grad W_ij = W'(r) x_ij/r (b, m, 3) [1/m^(dim+1)] of separations (b, m, 3); 0 for particles at one place."""
    return (kernel_slope(distance, smoothing) / np.where(distance > 0, distance, 1.0))[..., None] * separation


def viscosity_laplacian(r, smoothing):
    """A (h - r) [1/m^(dim+2)] inside the support, A = 40/(pi h^5) in 2D and 45/(pi h^6) in 3D."""
    h = float(smoothing.support_radius)
    factor = 40 / (math.pi * h**5) if smoothing.dim == 2 else 45 / (math.pi * h**6)
    r = np.asarray(r, dtype=float)
    return np.where(r < h, factor * (h - r), 0.0)
