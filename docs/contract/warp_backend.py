"""NVIDIA Warp on the CPU under the contract: `refsim contract warp_backend.py`. It returns Warp's own arrays."""

import numpy as np
import warp as wp

from refsim.contract import Programs

wp.config.quiet = True
wp.init()


@wp.struct
class Kernel:
    """Wendland C2."""

    radius: wp.float32
    inverse: wp.float32
    value: wp.float32
    slope: wp.float32
    laplacian: wp.float32


@wp.kernel
def density_sum(
    x: wp.array(dtype=wp.vec3), mass: wp.array(dtype=wp.float32), start: wp.array(dtype=wp.int64),
    count: wp.array(dtype=wp.int32), entries: wp.array(dtype=wp.int32), w: Kernel, rho: wp.array(dtype=wp.float32),
):  # fmt: skip
    i = wp.tid()
    total = mass[i]
    for k in range(count[i]):
        j = entries[int(start[i]) + k]
        q = wp.length(x[i] - x[j]) * w.inverse
        if q < 1.0:
            a = (1.0 - q) * (1.0 - q)
            total += mass[j] * a * a * (1.0 + 4.0 * q)
    rho[i] = w.value * total


@wp.kernel
def momentum_sum(
    x: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), mass: wp.array(dtype=wp.float32),
    rho: wp.array(dtype=wp.float32), p: wp.array(dtype=wp.float32), start: wp.array(dtype=wp.int64),
    count: wp.array(dtype=wp.int32), entries: wp.array(dtype=wp.int32), w: Kernel, share: wp.float32, mu: wp.float32,
    viscous: wp.int32, added: wp.array(dtype=wp.vec3),
):  # fmt: skip
    i = wp.tid()
    total = wp.vec3(0.0, 0.0, 0.0)
    for k in range(count[i]):
        j = entries[int(start[i]) + k]
        d = x[i] - x[j]
        r = wp.length(d)
        q = r * w.inverse
        if q < 1.0:
            volume = mass[j] / rho[j]
            slope = w.slope * (-20.0) * q * (1.0 - q) * (1.0 - q) * (1.0 - q)
            total -= d * (share * volume * (p[i] + p[j]) * slope / (r + 1.0e-9 * w.radius))
            if viscous != 0:
                total += (v[j] - v[i]) * (mu * volume * w.laplacian * (1.0 - q))
    added[i] = total / rho[i]


def shared(array):
    """The same memory as an array of Warp; rows of three numbers are vectors."""
    array = array.view(np.int32) if array.dtype == np.uint32 else array
    kind = wp.vec3 if array.ndim == 2 else wp.dtype_from_numpy(array.dtype)
    return wp.array(array, dtype=kind, device="cpu", copy=False)


def launched(kernel, kind, arrays, neighbours, smoothing, *numbers):
    """The kernel's answer, an array of Warp."""
    w = Kernel()
    w.radius, w.inverse, w.value = smoothing.support_radius, smoothing.inverse_radius, smoothing.value_scale
    w.slope, w.laplacian = smoothing.slope_scale, smoothing.laplacian_scale
    answer = wp.zeros(len(arrays[0]), dtype=kind, device="cpu")
    given = [shared(array) for array in (*arrays, neighbours.start, neighbours.count, neighbours.entries)]
    wp.launch(kernel, dim=len(arrays[0]), inputs=[*given, w, *numbers, answer], device="cpu")
    return answer


def density(position, mass, neighbours, smoothing):
    return {"density": launched(density_sum, wp.float32, (position, mass), neighbours, smoothing)}


def momentum(position, velocity, mass, density, pressure, neighbours, smoothing, fluid, viscosity):
    mu = 0.0 if viscosity is None else viscosity.coefficient
    arrays = (position, velocity, mass, density, pressure)
    return launched(
        momentum_sum, wp.vec3, arrays, neighbours, smoothing, fluid.gradient_share, mu, int(viscosity is not None)
    )


PROGRAMS = Programs(
    {"sph.density": density, "sph.momentum": momentum}, kernels=("wendland_c2",), dtypes=("float32",), walls=False,
    without=("number_density", "asymmetry", "period"),
)  # fmt: skip
