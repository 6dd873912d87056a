"""NumPy oracle of the smoothing kernels, written from the kernel table in the variable r."""

import math

import numpy as np

NAMES = ("poly6", "spiky", "cubic_spline", "wendland_c2", "wendland_c4", "wendland_c6", "quintic_spline", "gaussian")
TAIL = math.exp(-9)


def _normalisation(name, h, dim):
    two, three = {
        "poly6": (4 / math.pi, 315 / (64 * math.pi)),
        "spiky": (10 / math.pi, 15 / math.pi),
        "cubic_spline": (40 / (7 * math.pi), 8 / math.pi),
        "wendland_c2": (7 / math.pi, 21 / (2 * math.pi)),
        "wendland_c4": (9 / math.pi, 495 / (32 * math.pi)),
        "wendland_c6": (78 / (7 * math.pi), 1365 / (64 * math.pi)),
        "quintic_spline": (9 * 7 / (478 * math.pi), 27 / (120 * math.pi)),
        "gaussian": (9 / (math.pi - 10 * math.pi * TAIL), 27 / (math.pi**1.5 * math.erf(3) - 42 * math.pi * TAIL)),
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
    elif name == "wendland_c2":
        w = (1 - q) ** 4 * (1 + 4 * q)
    elif name == "wendland_c4":
        w = (1 - q) ** 6 * (1 + 6 * q + 35 / 3 * q**2)
    elif name == "wendland_c6":
        w = (1 - q) ** 8 * (1 + 8 * q + 25 * q**2 + 32 * q**3)
    elif name == "quintic_spline":
        w = sum(c * np.maximum(k - 3 * q, 0) ** 5 for k, c in ((3, 1), (2, -6), (1, 15)))
    else:
        w = np.exp(-((3 * q) ** 2)) - TAIL
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
    elif name == "wendland_c2":
        w = -20 * q * (1 - q) ** 3
    elif name == "wendland_c4":
        w = -56 / 3 * q * (1 + 5 * q) * (1 - q) ** 5
    elif name == "wendland_c6":
        w = -22 * q * (1 + 7 * q + 16 * q**2) * (1 - q) ** 7
    elif name == "quintic_spline":
        w = sum(-15 * c * np.maximum(k - 3 * q, 0) ** 4 for k, c in ((3, 1), (2, -6), (1, 15)))
    else:
        w = -18 * q * np.exp(-((3 * q) ** 2))
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
