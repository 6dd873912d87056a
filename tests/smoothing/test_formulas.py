"""Smoothing kernels, called from Python: by integration and by differences; what calibrated walls are for."""

import math

import numpy as np
import pytest

from refsim import InputError
from refsim.boundary.akinci_2012 import box_layers, calibrated_factor, wall_kernel_sums
from refsim.smoothing import SHAPES, reference, smoothing
from refsim.smoothing.formulas import kernel_slope, kernel_value, viscosity_laplacian
from refsim.sph import lattice_number_density
from tests.running import rows


@pytest.mark.parametrize("h", [1e-6, 0.7, 1e3])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("shape", SHAPES)
class TestKernels:
    def test_slope_is_the_derivative(self, shape, dim, h):
        kernel = smoothing(shape, h, dim)
        step = 1e-5 * h
        for q in (0.05, 0.3, 0.45, 0.55, 0.8, 0.97):
            r = np.float64(q * h)
            difference = (kernel_value(r + step, kernel) - kernel_value(r - step, kernel)) / (2 * step)
            assert kernel_slope(r, kernel) == pytest.approx(difference, rel=1e-5)
            assert kernel_slope(r, kernel) < 0

    def test_nothing_at_and_beyond_the_edge(self, shape, dim, h):
        kernel = smoothing(shape, h, dim)
        for r in (h, 1.5 * h, 1e6 * h, math.inf):
            assert (kernel_value(np.float64(r), kernel), kernel_slope(np.float64(r), kernel)) == (0, 0)
            assert viscosity_laplacian(np.float64(r), kernel) == 0


@pytest.mark.parametrize("arguments, words", rows(__file__, "impossible_kernels"))
def test_impossible_kernels_are_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        smoothing(*arguments)


@pytest.mark.parametrize(
    "shape, dim, ratio, factor",
    [("wendland_c2", 2, 2.6, 0.5846), ("wendland_c2", 3, 2.7, 0.5714), ("poly6", 3, 2.0, 0.6182)],
)
def test_calibrated_walls_give_the_first_layer_the_rest_density(shape, dim, ratio, factor):
    """The calibrated factor, and what it is for: liquid filling a box has the rest density at its wall."""
    spacing = 0.1
    h = ratio * spacing
    g = calibrated_factor(shape, h, spacing, dim)
    assert g == pytest.approx(factor, abs=5e-5)
    cells = 13
    upper = (cells * spacing,) * 3
    wall = box_layers((0, 0, 0), upper, spacing, dim)
    kernel = smoothing(shape, h, dim)
    volume = g / wall_kernel_sums(wall, shape, h, dim)
    axes = [(np.arange(cells) + 0.5) * spacing] * dim
    liquid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dim)
    first = np.array([0.5 * spacing] + [upper[0] / 2] * (dim - 1))  # in the first layer, far from every edge
    sums = reference.kernel_value(np.linalg.norm(liquid - first, axis=1), kernel).sum()
    filled = volume @ reference.kernel_value(np.linalg.norm(wall[:, :dim] - first, axis=1), kernel)
    rest = lattice_number_density(shape, h, spacing, dim)
    assert sums / rest + filled == pytest.approx(1, abs=1e-6)
    assert sums / rest + filled / g == pytest.approx(1.15, abs=0.035)  # uncalibrated: 12 to 17 % too dense
