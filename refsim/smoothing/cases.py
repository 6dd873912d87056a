"""Each smoothing kernel at half of its support radius, of which closed forms of pairs are made."""

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from refsim.core.cases import Case, Exact, across_a_border, at, closed_form
from refsim.smoothing.shapes import Smoothing, smoothing

RADIUS = 2.0  # h [m]; particles stand 1 m apart
TAIL = math.exp(-9)  # of the Gaussian where it is cut
# w(1/2)/w(0), |w'(1/2)|/w(0), and w(0) h^dim in 2D and 3D
AT_HALF = {
    "wendland_c2": (3 / 16, 5 / 4, 7 / math.pi, 21 / (2 * math.pi)),
    "poly6": (27 / 64, 27 / 16, 4 / math.pi, 315 / (64 * math.pi)),
    "spiky": (1 / 8, 3 / 4, 10 / math.pi, 15 / math.pi),
    "cubic_spline": (1 / 4, 3 / 2, 40 / (7 * math.pi), 8 / math.pi),
    "wendland_c4": (83 / 768, 49 / 48, 9 / math.pi, 495 / (32 * math.pi)),
    "wendland_c6": (61 / 1024, 187 / 256, 78 / (7 * math.pi), 1365 / (64 * math.pi)),
    "quintic_spline": (79 / 704, 375 / 352, 2079 / (239 * math.pi), 297 / (20 * math.pi)),
    "gaussian": (
        (math.exp(-9 / 4) - TAIL) / (1 - TAIL),
        9 * math.exp(-9 / 4) / (1 - TAIL),
        9 * (1 - TAIL) / (math.pi * (1 - 10 * TAIL)),
        27 * (1 - TAIL) / (math.pi**1.5 * math.erf(3) - 42 * math.pi * TAIL),
    ),
}
PLACES = {2: [[0.0, 0.0, 0.0], [0.6, 0.8, 0.0]], 3: [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]}


class AtHalf(NamedTuple):
    """A kernel with h = 2 m: W(0) [1/m^dim], W(h/2)/W(0), |W'(h/2)| [1/m^(dim+1)], two particles 1 m apart."""

    at_zero: float
    share: float
    slope: float
    smoothing: Smoothing
    pair: Case


def for_each_kernel(
    *operations: str, dims: tuple[int, ...] = (3,), across: float = 0.0, **named: Callable[[AtHalf], Exact]
) -> Callable[[Callable[[AtHalf], Exact]], Callable[[AtHalf], Exact]]:
    """Mark a function that returns an exactly known case of the operations for a kernel, in each of the dimensions.

    across  as of `closed_form`, in space
    named   further ones, `name=function`
    """

    def mark(maker: Callable[[AtHalf], Exact], name: str = "") -> Callable[[AtHalf], Exact]:
        name = name or maker.__name__
        for kernel, dim in itertools.product(AT_HALF, dims):
            form = functools.partial(_at_half, maker, kernel, dim)
            closed_form(*operations, **{f"{name}_{kernel}{'_2d' * (dim == 2)}": form})
            if across > 0 and dim == 3:
                closed_form(*operations, **{f"{name}_{kernel}_across": functools.partial(form, across)})
        return maker

    for name, maker in named.items():
        mark(maker, name)
    return mark


def _at_half(maker: Callable[[AtHalf], Exact], kernel: str, dim: int, across: float = 0.0) -> Exact:
    share, slope, *scales = AT_HALF[kernel]
    value = scales[dim - 2] / RADIUS**dim
    pair = at(f"pair_{dim}d", PLACES[dim], dim=dim)
    w = AtHalf(value, share, value * slope / RADIUS, smoothing(kernel, RADIUS, dim), pair)
    exact = across_a_border(maker(w), across) if across else maker(w)
    return replace(exact, inputs={"smoothing": w.smoothing, "gradient_smoothing": w.smoothing, **exact.inputs})
