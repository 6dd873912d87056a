"""NVIDIA Warp on the CPU under the contract: `refsim contract warp_backend.py`. It returns Warp's own arrays.

The kernels are generic: Warp compiles them for the precision of the arrays that they are given.
"""

from typing import Any

import numpy as np
import warp as wp

from refsim.contract import Programs

wp.config.quiet = True
wp.init()


@wp.kernel
def density_sum(
    x: wp.array(dtype=Any), mass: wp.array(dtype=Any), start: wp.array(dtype=wp.int64),
    count: wp.array(dtype=wp.int32), entries: wp.array(dtype=wp.int32), inverse_radius: Any, value_scale: Any,
    rho: wp.array(dtype=Any),
):  # fmt: skip
    i = wp.tid()
    one = mass.dtype(1.0)
    total = mass[i]
    for k in range(count[i]):
        j = entries[int(start[i]) + k]
        q = wp.length(x[i] - x[j]) * inverse_radius
        if q < one:
            a = (one - q) * (one - q)
            total += mass[j] * a * a * (one + mass.dtype(4.0) * q)
    rho[i] = value_scale * total


@wp.kernel
def momentum_sum(
    x: wp.array(dtype=Any), v: wp.array(dtype=Any), mass: wp.array(dtype=Any), rho: wp.array(dtype=Any),
    p: wp.array(dtype=Any), start: wp.array(dtype=wp.int64), count: wp.array(dtype=wp.int32),
    entries: wp.array(dtype=wp.int32), inverse_radius: Any, slope_scale: Any, laplacian_scale: Any, share: Any,
    mu: Any, viscous: Any, added: wp.array(dtype=Any),
):  # fmt: skip
    i = wp.tid()
    one = mass.dtype(1.0)
    total = x.dtype()
    for k in range(count[i]):
        j = entries[int(start[i]) + k]
        d = x[i] - x[j]
        q = wp.length(d) * inverse_radius
        if q < one:
            volume = mass[j] / rho[j]
            slope_over_r = slope_scale * inverse_radius * mass.dtype(-20.0) * (one - q) * (one - q) * (one - q)
            total -= d * (share * volume * (p[i] + p[j]) * slope_over_r)
            if viscous > mass.dtype(0.0):
                total += (v[j] - v[i]) * (mu * volume * laplacian_scale * (one - q))
    added[i] = total / rho[i]


def shared(array):
    """The same memory as an array of Warp; rows of three numbers are vectors."""
    array = array.view(np.int32) if array.dtype == np.uint32 else array
    kind = wp.dtype_from_numpy(array.dtype)
    return wp.array(array, dtype=wp.types.vector(3, kind) if array.ndim == 2 else kind, device="cpu", copy=False)


def launched(kernel, arrays, neighbours, *numbers):
    """The kernel's answer, an array of Warp of the second array's kind."""
    given = [shared(array) for array in (*arrays, neighbours.start, neighbours.count, neighbours.entries)]
    answer = wp.zeros_like(given[1])
    real = wp.dtype_from_numpy(arrays[-1].dtype)
    wp.launch(kernel, dim=len(arrays[0]), inputs=[*given, *map(real, numbers), answer], device="cpu")
    return answer


def density(position, mass, neighbours, smoothing):
    numbers = smoothing.inverse_radius, smoothing.value_scale
    return {"density": launched(density_sum, (position, mass), neighbours, *numbers)}


def momentum(position, velocity, mass, density, pressure, neighbours, smoothing, fluid, viscosity):
    mu = 0.0 if viscosity is None else viscosity.coefficient
    numbers = smoothing.inverse_radius, smoothing.slope_scale, smoothing.laplacian_scale, fluid.gradient_share, mu
    arrays = (position, velocity, mass, density, pressure)
    return launched(momentum_sum, arrays, neighbours, *numbers, int(viscosity is not None))


PROGRAMS = Programs(
    {"sph.density": density, "sph.momentum": momentum}, kernels=("wendland_c2",), walls=False,
    without=("number_density", "asymmetry", "period"),
)  # fmt: skip
