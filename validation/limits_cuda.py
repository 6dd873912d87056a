"""CUDA kernel that measures a device's speed of arithmetic."""

from __future__ import annotations

from refsim.backends.compile import cuda, cuda_kernel

CHAINS = 8  # independent chains of a thread, so that no multiply-add waits for the one before
OPERATIONS = 2 * CHAINS  # of a thread in a round: each multiply-add is two


@cuda_kernel
def multiply_add(factor, summand, rounds, out):  # noqa: ANN001, ANN201
    """out[i] = sum of CHAINS numbers x after `rounds` times x <- factor x + summand, float32."""
    i = cuda.grid(1)
    if i < out.shape[0]:
        real = type(factor)
        x = real(i)
        a, b, c, d = x, x + real(1), x + real(2), x + real(3)
        e, f, g, h = x + real(4), x + real(5), x + real(6), x + real(7)
        for _ in range(rounds):
            a = a * factor + summand
            b = b * factor + summand
            c = c * factor + summand
            d = d * factor + summand
            e = e * factor + summand
            f = f * factor + summand
            g = g * factor + summand
            h = h * factor + summand
        out[i] = a + b + c + d + e + f + g + h
