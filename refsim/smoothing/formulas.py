"""Smoothing kernels W(r, h) in q = r/h, h the support radius.

`value` and `slope` give the dimensionless shapes w(q) and w'(q); the host computes the factors in front
(`refsim.smoothing.smoothing`) in float64, so that in float32 no higher power of h occurs than in the result.
"""

import math

import numpy as np
from numba import types

from refsim.backends.compile import formula, overloaded
from refsim.smoothing.shapes import CUBIC_SPLINE, POLY6, QUINTIC_SPLINE, SPIKY, WENDLAND_C2, WENDLAND_C4, WENDLAND_C6

EDGE = math.exp(-9)  # of the Gaussian, three standard widths away


@formula
def value(q, shape):
    """w(q) of W = scale * w(q), zero for q >= 1; dimensionless."""
    real = type(q)
    one = real(1)
    if q >= one:
        return real(0)
    if shape == POLY6:
        a = one - q * q
        return a * a * a
    a = one - q
    if shape == SPIKY:
        return a * a * a
    if shape == CUBIC_SPLINE:
        if q <= real(0.5):
            return one - real(6) * q * q * a
        return real(2) * a * a * a
    b = a * a
    if shape == WENDLAND_C2:
        return b * b * (one + real(4) * q)
    if shape == WENDLAND_C4:
        return b * b * b * (one + q * (real(6) + real(35) / real(3) * q))
    if shape == WENDLAND_C6:
        b = b * b
        return b * b * (one + q * (real(8) + q * (real(25) + real(32) * q)))
    if shape == QUINTIC_SPLINE:
        if q <= real(1) / real(3):
            b = q * q
            return real(22) / real(81) - b * (real(20) / real(9) - real(10) * b * a)
        inner = max(real(2) / real(3) - q, real(0))
        return b * b * a - real(6) * inner * inner * inner * inner * inner
    return real(EDGE) * real(math.expm1(real(9) * a * (one + q)))


@formula
def slope(q, shape):
    """w'(q) of dW/dr = scale * w'(q) / h, zero for q >= 1, never positive; dimensionless."""
    real = type(q)
    one = real(1)
    if q >= one:
        return real(0)
    if shape == POLY6:
        a = one - q * q
        return real(-6) * q * a * a
    a = one - q
    if shape == SPIKY:
        return real(-3) * a * a
    if shape == CUBIC_SPLINE:
        if q <= real(0.5):
            return q * (real(18) * q - real(12))
        return real(-6) * a * a
    if shape == WENDLAND_C2:
        return real(-20) * q * a * a * a
    b = a * a
    if shape == WENDLAND_C4:
        return real(-56) / real(3) * q * b * b * a * (one + real(5) * q)
    if shape == WENDLAND_C6:
        return real(-22) * q * b * b * b * a * (one + q * (real(7) + real(16) * q))
    if shape == QUINTIC_SPLINE:
        if q <= real(1) / real(3):
            return -q * (real(40) / real(9) - q * q * (real(40) - real(50) * q))
        inner = max(real(2) / real(3) - q, real(0))
        inner *= inner
        return real(30) * inner * inner - real(5) * b * b
    return real(-18) * q * real(math.exp(real(-9) * q * q))


def shape_of(smoothing):
    """The number of the shape; of a `fixed` one the compiler knows it, and leaves the other shapes out."""
    return len(smoothing.shape) if isinstance(smoothing.shape, tuple) else smoothing.shape


def _shape_of(smoothing):
    if isinstance(smoothing[smoothing.fields.index("shape")], types.BaseTuple):
        return lambda smoothing: len(smoothing.shape)
    return lambda smoothing: smoothing.shape


overloaded(shape_of, _shape_of)


@formula
def kernel_value(r, smoothing):
    """W(r, h) = scale * w(r/h) [1/m^dim]."""
    return smoothing.value_scale * value(r * smoothing.inverse_radius, shape_of(smoothing))


@formula
def kernel_slope(r, smoothing):
    """dW/dr [1/m^(dim+1)], never positive; grad W_ij = dW/dr * (x_i - x_j)/r."""
    return smoothing.slope_scale * slope(r * smoothing.inverse_radius, shape_of(smoothing))


@formula
def viscosity_laplacian(r, smoothing):
    """Laplacian of the viscosity kernel, A (h - r) >= 0 [1/m^(dim+2)]."""
    real = type(r)
    q = r * smoothing.inverse_radius
    if q >= real(1):
        return real(0)
    return smoothing.laplacian_scale * (real(1) - q)


def quick_inverse(x):
    """1/x [1/unit]; on a GPU, in single precision, with an error of up to two roundings, in fewer instructions."""
    return type(x)(1) / x


def _inverse_on_cuda(x):
    if x != types.float32:
        return quick_inverse
    from numba.cuda import libdevice

    return lambda x: libdevice.fast_fdividef(np.float32(1), x)


overloaded(quick_inverse, lambda x: quick_inverse, ("cpu",), forceinline=True)
overloaded(quick_inverse, _inverse_on_cuda, ("cuda",), forceinline=True)


@formula
def safe_distance(r, smoothing):
    """r [m], h in place of r = 0: divided by it, the direction x_ij/r = 0 of particles in one place is a number."""
    return r if r > type(r)(0) else smoothing.support_radius


@formula
def gradient_factor(r, smoothing):
    """f = W'(r)/r [1/m^(dim + 2)], with grad W_ij = f x_ij."""
    return kernel_slope(r, smoothing) / safe_distance(r, smoothing)


@formula
def undivided_factor(r, smoothing):
    """f = W'(r)/r [1/m^(dim + 2)], 0 of coincident particles; of Wendland's C2, whose W' has a factor r, without a
    quotient: for sums over volumes V_j, as the compiler takes the constants together, which only V_j keeps within
    single precision."""
    real = type(r)
    if shape_of(smoothing) != WENDLAND_C2:
        return gradient_factor(r, smoothing)
    a = max(real(1) - r * smoothing.inverse_radius, real(0)) if r > real(0) else real(0)
    return real(-20) * smoothing.slope_scale * smoothing.inverse_radius * (a * a * a)
