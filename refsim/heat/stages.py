"""Coefficients of the schemes' stages, from the largest s_i; computed in float64."""

import math
from collections.abc import Iterator

from refsim.backends.compile import formula
from refsim.heat.shapes import Stage

LARGEST_SUM = 1e12  # s_i beyond which no number of passes is found


@formula
def chebyshev_passes(largest_sum: float, tolerance: float) -> int:
    """Passes after which Chebyshev's iteration has shrunk every error by `tolerance`, for eigenvalues 1..1 + 2 s."""
    if not largest_sum > 0.0:
        return 1
    if not largest_sum < LARGEST_SUM:
        return 1 << 30
    rho = largest_sum / (1.0 + largest_sum)
    sigma = rho / (1.0 + math.sqrt((1.0 + 2.0 * largest_sum) / (1.0 + largest_sum) ** 2))
    return int(math.ceil(math.log(tolerance / 2.0) / math.log(sigma)))  # noqa: RUF046  (a float in CUDA)


@formula
def chebyshev_omega(k: int, largest_sum: float, before: float) -> float:
    """omega_k = 1, 1/(1 - rho^2/2), 1/(1 - rho^2 omega/4), ..., rho = s/(1 + s)."""
    rho = largest_sum / (1.0 + largest_sum)
    if k == 0:
        return 1.0
    return 1.0 / (1.0 - rho * rho * (0.5 if k == 1 else 0.25 * before))


def legendre_stages(largest_sum: float) -> Iterator[Stage]:
    """RKL2 (Meyer, Balsara & Aslam 2014): s odd with (s^2 + s - 2)/4 >= s_max, at least 3; second order in dt."""
    number = max(3, math.ceil((math.sqrt(9 + 16 * max(largest_sum, 0.0)) - 1) / 2 - 1e-9))
    number += 1 - number % 2
    w = 4 / (number**2 + number - 2)
    b = [1 / 3] * 3 + [(j * j + j - 2) / (2 * j * (j + 1)) for j in range(3, number + 1)]
    yield Stage(0.0, 0.0, b[1] * w, 0.0)
    for j in range(2, number + 1):
        mu = (2 * j - 1) / j * b[j] / b[j - 1]
        nu = (1 - j) / j * b[j] / b[j - 2]
        yield Stage(nu, 1 - mu - nu, mu * w, -(1 - b[j - 1]) * mu * w)


def first_legendre_stages(largest_sum: float) -> Iterator[Stage]:
    """RKL1: (s^2 + s)/2 >= 5/4 s_max; first order. At the bound of 1 s_max melting overshoots beside a reservoir."""
    number = max(1, math.ceil((math.sqrt(1 + 10 * max(largest_sum, 0.0)) - 1) / 2 - 1e-9))
    number += 1 - number % 2
    w = 2 / (number**2 + number)
    for j in range(1, number + 1):
        mu, nu = (2 * j - 1) / j, (1 - j) / j
        yield Stage(nu, 0.0, mu * w, 0.0)
