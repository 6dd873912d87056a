"""NumPy oracle of the smoothing kernels: W(r, h) = A/h^dim w(q), q = r/h, and its slope, as in the kernel table."""

import math

import numpy as np

TAIL = math.exp(-9)
NAMES = ("poly6", "spiky", "cubic_spline", "wendland_c2", "wendland_c4", "wendland_c6", "quintic_spline", "gaussian")
QUINTIC = ((3, 1), (2, -6), (1, 15))  # k, c of the sum of c (k - 3 q)^5 over k > 3 q

W = {  # w(q); dimensionless
    "poly6": lambda q: (1 - q**2) ** 3,
    "spiky": lambda q: (1 - q) ** 3,
    "cubic_spline": lambda q: np.where(q <= 0.5, 6 * (q**3 - q**2) + 1, 2 * (1 - q) ** 3),
    "wendland_c2": lambda q: (1 - q) ** 4 * (1 + 4 * q),
    "wendland_c4": lambda q: (1 - q) ** 6 * (1 + 6 * q + 35 / 3 * q**2),
    "wendland_c6": lambda q: (1 - q) ** 8 * (1 + 8 * q + 25 * q**2 + 32 * q**3),
    "quintic_spline": lambda q: sum(c * np.maximum(k - 3 * q, 0) ** 5 for k, c in QUINTIC),
    "gaussian": lambda q: np.exp(-((3 * q) ** 2)) - TAIL,
}
SLOPE = {  # w'(q); dimensionless
    "poly6": lambda q: -6 * q * (1 - q**2) ** 2,
    "spiky": lambda q: -3 * (1 - q) ** 2,
    "cubic_spline": lambda q: np.where(q <= 0.5, 18 * q**2 - 12 * q, -6 * (1 - q) ** 2),
    "wendland_c2": lambda q: -20 * q * (1 - q) ** 3,
    "wendland_c4": lambda q: -56 / 3 * q * (1 + 5 * q) * (1 - q) ** 5,
    "wendland_c6": lambda q: -22 * q * (1 + 7 * q + 16 * q**2) * (1 - q) ** 7,
    "quintic_spline": lambda q: sum(-15 * c * np.maximum(k - 3 * q, 0) ** 4 for k, c in QUINTIC),
    "gaussian": lambda q: -18 * q * np.exp(-((3 * q) ** 2)),
}
A = {  # in 2D and 3D, so that the integral of W is one
    "poly6": (4 / math.pi, 315 / (64 * math.pi)),
    "spiky": (10 / math.pi, 15 / math.pi),
    "cubic_spline": (40 / (7 * math.pi), 8 / math.pi),
    "wendland_c2": (7 / math.pi, 21 / (2 * math.pi)),
    "wendland_c4": (9 / math.pi, 495 / (32 * math.pi)),
    "wendland_c6": (78 / (7 * math.pi), 1365 / (64 * math.pi)),
    "quintic_spline": (9 * 7 / (478 * math.pi), 27 / (120 * math.pi)),
    "gaussian": (9 / (math.pi - 10 * math.pi * TAIL), 27 / (math.pi**1.5 * math.erf(3) - 42 * math.pi * TAIL)),
}


def _of_support(functions, r, smoothing, power):
    """A/h^power f(r/h) of the kernel's function inside of the support, where few of all pairs are; else 0."""
    h, name = float(smoothing.support_radius), NAMES[smoothing.shape]
    q = np.asarray(r, dtype=float) / h
    near, values = q < 1, np.zeros(q.shape)
    values[near] = A[name][int(smoothing.dim) - 2] / h**power * functions[name](q[near])
    return values


def kernel_value(r, smoothing):
    """W(r, h) = A/h^dim w(r/h) [1/m^dim] at distances r [m], an array of any shape."""
    return _of_support(W, r, smoothing, int(smoothing.dim))


def kernel_slope(r, smoothing):
    """dW/dr = A/h^(dim+1) w'(r/h) [1/m^(dim+1)] at distances r [m], an array of any shape."""
    return _of_support(SLOPE, r, smoothing, int(smoothing.dim) + 1)


def viscosity_laplacian(r, smoothing):
    """A (h - r) [1/m^(dim+2)] inside the support, A = 40/(pi h^5) in 2D and 45/(pi h^6) in 3D."""
    h = float(smoothing.support_radius)
    factor = 40 / (math.pi * h**5) if smoothing.dim == 2 else 45 / (math.pi * h**6)
    r = np.asarray(r, dtype=float)
    return np.where(r < h, factor * (h - r), 0.0)
