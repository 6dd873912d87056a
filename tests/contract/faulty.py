"""Densities by summation with one planted fault each, in NumPy."""

import math

import numpy as np

from refsim.contract import Programs

NORMS = {
    "cubic_spline": {2: 40 / (7 * math.pi), 3: 8 / math.pi}, "wendland_c2": {2: 7 / math.pi, 3: 21 / (2 * math.pi)},
}  # fmt: skip


def programs(function, kernel):
    """A library that declares one kernel, walls and periods."""
    return Programs(
        {"sph.density": function}, kernels=(kernel,), without=("number_density", "asymmetry"), name="faulty"
    )


def kernel_of(kernel, h, dim, dtype, cut=True):
    scale = NORMS[kernel][dim] / h**dim

    def value(r):
        q = np.asarray(r / h, dtype)
        a = 1 - q
        w = a**4 * (1 + 4 * q) if kernel == "wendland_c2" else np.where(q <= 0.5, 1 - 6 * q * q * a, 2 * a**3)
        return (scale * (np.where(q < 1, w, 0) if cut else w)).astype(dtype)

    return value


def distances(x, place, period, both=True):
    d = place - x
    for c in range(3 if period is not None else 0):
        length = period[c]
        if length > 0:
            d[:, c] -= length * (np.round(d[:, c] / length) if both else d[:, c] > length / 2)
    return np.sqrt((d * d).sum(1))


def in_numpy(fault, kernel):
    if fault == "prefix":
        return programs(_prefix(kernel), kernel)
    lost = np.random.default_rng()  # whether another thread has written over a particle's sum

    def density(position, mass, walls, smoothing, fluid, period, density):
        dim, dtype = int(smoothing.dim), density.dtype
        h = float(smoothing.support_radius) / (2 if fault == "half" else 1)
        w = kernel_of(kernel, h, 3 if fault == "norm" else dim, dtype, cut=fault != "edge")
        for i in range(len(mass)):
            r = distances(position[i], position, period, both=fault != "image")
            terms = mass * w(r)
            if fault == "self":
                terms[i] = 0
            if fault == "cap":
                terms = terms[np.flatnonzero(r < h)[:65]]
            total = terms.sum()
            if walls is not None and len(walls.position):
                side = [1, 1, -1] if dim == 3 else [1, -1, 1]
                place = walls.position * (side if fault == "mirror" else 1)
                total += (fluid.rest_density * walls.volume * w(distances(position[i], place, period))).sum()
            if fault == "race" and lost.random() < 0.5:
                total = terms[i]
            density[i] = density[i] + total if fault == "unset" else total

    return programs(density, kernel)


def _prefix(kernel):
    def density(position, mass, neighbours, smoothing, density):
        w = kernel_of(kernel, float(smoothing.support_radius), int(smoothing.dim), density.dtype)
        own = np.repeat(np.arange(len(mass)), neighbours.count)
        end = np.cumsum(neighbours.count, dtype=np.int64)
        place = np.arange(len(own)) + np.repeat(neighbours.start - (end - neighbours.count), neighbours.count)
        index = neighbours.entries[place].astype(int)
        d = position[own] - position[index]
        terms = mass[index] * w(np.sqrt((d * d).sum(1)))
        running = np.concatenate([[0], np.cumsum(terms, dtype=np.float32)])
        density[:] = mass * w(np.zeros(1)) + (running[end] - running[end - neighbours.count])

    return density
