"""Taichi on the CPU under the contract: `refsim contract taichi_backend.py`. It takes NumPy arrays as they are."""

import numpy as np
import taichi as ti

from refsim.contract import Programs

ti.init(arch=ti.cpu, default_fp=ti.f32, fast_math=False, log_level=ti.ERROR, offline_cache=False)
REALS, LONGS, INTS = (ti.types.ndarray(dtype=kind) for kind in (ti.f32, ti.i64, ti.i32))


@ti.func
def apart(x: ti.template(), i, j):
    return ti.Vector([x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]])


@ti.kernel
def density_sum(
    x: REALS, mass: REALS, start: LONGS, count: INTS, entries: INTS, inverse: ti.f32, value: ti.f32, rho: REALS
):
    for i in range(mass.shape[0]):
        total = mass[i]
        for k in range(count[i]):
            j = entries[start[i] + k]
            q = apart(x, i, j).norm() * inverse
            if q < 1.0:
                a = (1.0 - q) * (1.0 - q)
                total += mass[j] * a * a * (1.0 + 4.0 * q)
        rho[i] = value * total


@ti.kernel
def momentum_sum(
    x: REALS, v: REALS, mass: REALS, rho: REALS, p: REALS, start: LONGS, count: INTS, entries: INTS, radius: ti.f32,
    inverse: ti.f32, slope: ti.f32, laplacian: ti.f32, share: ti.f32, mu: ti.f32, viscous: ti.i32, a: REALS,
):  # fmt: skip
    for i in range(mass.shape[0]):
        total = ti.Vector([0.0, 0.0, 0.0])
        for k in range(count[i]):
            j = entries[start[i] + k]
            d = apart(x, i, j)
            r = d.norm()
            q = r * inverse
            if q < 1.0:
                volume = mass[j] / rho[j]
                gradient = slope * (-20.0) * q * (1.0 - q) * (1.0 - q) * (1.0 - q) / (r + 1.0e-9 * radius)
                total -= share * volume * (p[i] + p[j]) * gradient * d
                if viscous != 0:
                    total -= mu * volume * laplacian * (1.0 - q) * apart(v, i, j)
        for c in ti.static(range(3)):
            a[i, c] += total[c] / rho[i]


@ti.kernel
def cohesion_sum(
    x: REALS, mass: REALS, start: LONGS, count: INTS, entries: INTS, inverse: ti.f32, strength: ti.f32, least: ti.f32,
    a: REALS,
):  # fmt: skip
    for i in range(mass.shape[0]):
        total = ti.Vector([0.0, 0.0, 0.0])
        for k in range(count[i]):
            j = entries[start[i] + k]
            d = apart(x, i, j)
            q = d.norm() * inverse
            if q < 1.0:
                q = ti.max(q, least)
                s = 2.0 * (1.0 - q) * (1.0 - q) * (1.0 - q)
                if q <= 0.5:
                    s = 1.0 - 6.0 * q * q * (1.0 - q)
                total -= mass[j] * s * d
        for c in ti.static(range(3)):
            a[i, c] += strength / mass[i] * total[c]


def listed(neighbours):
    """The list as the kernels take it; Taichi's indices are signed."""
    return neighbours.start, neighbours.count, neighbours.entries.view(np.int32)


def density(position, mass, neighbours, smoothing, density):
    if len(mass):  # Taichi takes no empty arrays
        near = listed(neighbours)
        density_sum(position, mass, *near, smoothing.inverse_radius, smoothing.value_scale, density)


def momentum(position, velocity, mass, density, pressure, neighbours, smoothing, fluid, viscosity, acceleration):
    if len(mass):
        h, inverse = smoothing.support_radius, smoothing.inverse_radius
        mu, viscous = (0.0, 0) if viscosity is None else (viscosity.coefficient, 1)
        momentum_sum(
            position, velocity, mass, density, pressure, *listed(neighbours), h, inverse, smoothing.slope_scale,
            smoothing.laplacian_scale, fluid.gradient_share, mu, viscous, acceleration,
        )  # fmt: skip


def cohesion(position, mass, neighbours, smoothing, attraction, acceleration):
    if len(mass):
        numbers = (smoothing.inverse_radius, attraction.strength, attraction.least_q)
        cohesion_sum(position, mass, *listed(neighbours), *numbers, acceleration)


PROGRAMS = Programs(
    {"sph.density": density, "sph.momentum": momentum, "becker_teschner_2007.cohesion": cohesion},
    kernels=("wendland_c2",),
    dtypes=("float32",),
    walls=False,
    without=("number_density", "asymmetry", "period"),
)
