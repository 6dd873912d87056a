"""Orders of accuracy: what the sums and the time step promise, measured by refining."""

import math

import numpy as np
import pytest

from refsim.contract import Inputs, Target
from refsim.core.cases import Case, lattice
from refsim.core.operation import REGISTRY
from refsim.smoothing.reference import kernel_slope, kernel_value, viscosity_laplacian
from refsim.sph import Fluid, ViscosityTerm

RATIO = 3.0  # support radius in spacings
CELLS = (12, 18, 27, 40)


def order(sizes, errors):
    """Slope of error against size, and the errors must fall at every refinement."""
    assert (np.diff(errors) < 0).all()
    return np.polyfit(np.log(sizes), np.log(errors), 1)[0]


def patch(n):
    """A unit square of n x n particles (in the plane), and a mask of those without an edge in reach."""
    spacing = 1.0 / n
    position = lattice((n, n, 1), spacing, 2) + [0.5 * spacing, 0.5 * spacing, 0]
    case = Case(f"patch_{n}", 2, position, spacing=spacing, support_radius=RATIO * spacing)
    inside = (np.abs(position[:, :2] - 0.5) < 0.5 - RATIO / CELLS[0]).all(1)
    assert inside.any()
    return case, inside


def moment(case, function, power):
    """Sum over the infinite lattice of V r^power f(r): the integral that the lattice stands for, but for a constant
    share which depends on h/d alone. The project's masses (delta0) take it out of the density; here it is
    taken out of the derivatives too, so that what is left must shrink with h."""
    reach = np.arange(-4, 5) * case.spacing
    r = np.hypot(*np.meshgrid(reach, reach)).ravel()
    return (case.spacing**2 * r**power * function(r, Inputs(case, "float64")["smoothing"])).sum()


def smooth(x):
    return 2 + np.sin(2 * x[:, 0] + 0.3) * np.cos(1.5 * x[:, 1])


def smooth_gradient(x):
    a, b = 2 * x[:, 0] + 0.3, 1.5 * x[:, 1]
    return np.stack([2 * np.cos(a) * np.cos(b), -1.5 * np.sin(a) * np.sin(b), 0 * a], axis=1)


def launched(name, case, **given):
    """Outputs of the operation's CPU program, added to nothing."""
    variant = next(k for k, v in enumerate(REGISTRY[name].variants) if v.get("walls", 0) is None)
    target = Target(REGISTRY[name], "cpu", "float64", variant)
    inputs = target.varied(Inputs(case, "float64")).replaced(**given)
    return target.launch(inputs, before={"acceleration": np.zeros((case.count, 3))})[1]


@pytest.mark.parametrize("kernels", ["wendland", "mueller"])
def test_summation_is_of_second_order(kernels):
    """sum_j V f_j W_ij -> f_i, with masses V f_j in the density sum J(7)."""
    errors = []
    for n in CELLS:
        case, inside = patch(n)
        object.__setattr__(case, "kernels", kernels)
        field = smooth(case.position)
        rho = launched("sph.density", case, mass=field / n**2)["density"] / moment(case, kernel_value, 0)
        errors.append(np.abs(rho - field)[inside].max())
    assert 1.8 < order([1 / n for n in CELLS], errors) < 2.3
    assert errors[-1] < 5e-3


def still(case, **given):
    """A liquid at rest with density 1 and no pressure."""
    n = case.count
    liquid = Fluid(1.0, 1.0, np.int32(1), np.int32(0))
    return {
        "mass": np.full(n, 1.0 / n), "density": np.ones(n), "pressure": np.zeros(n), "velocity": np.zeros((n, 3)),
        "fluid": liquid, "viscosity": ViscosityTerm(0.5),
    } | given  # fmt: skip


def test_pressure_force_is_of_second_order():
    """J(10) with Jiang & Zhu E24: a -> -grad p / rho. The printed factor 1/2 halves it.

    Of (p_i + p_j)/2 the first part has no gradient inside the liquid: as printed, the stated pressure is twice what
    holds the liquid, and sound travels at c/sqrt(2).
    """
    errors = []
    for n in CELLS:
        case, inside = patch(n)
        got = launched("sph.momentum", case, **still(case, pressure=smooth(case.position)))["acceleration"]
        got = got / (-0.5 * moment(case, kernel_slope, 1))
        errors.append(np.linalg.norm(got + smooth_gradient(case.position), axis=1)[inside].max())
    assert 1.8 < order([1 / n for n in CELLS], errors) < 2.3


def test_viscous_force_is_of_second_order():
    """J(11): a -> (mu/rho) lap v."""
    errors = []
    for n in CELLS:
        case, inside = patch(n)
        x = case.position
        velocity = np.stack([np.sin(2 * x[:, 1]), np.cos(1.5 * x[:, 0]), 0 * x[:, 0]], axis=1)
        exact = 0.5 * np.stack([-4 * np.sin(2 * x[:, 1]), -2.25 * np.cos(1.5 * x[:, 0]), 0 * x[:, 0]], axis=1)
        got = launched("sph.momentum", case, **still(case, velocity=velocity))["acceleration"]
        got = got / (0.25 * moment(case, viscosity_laplacian, 2))
        errors.append(np.linalg.norm(got - exact, axis=1)[inside].max())
    assert 1.8 < order([1 / n for n in CELLS], errors) < 2.3


def oscillate(steps, varying=True):
    """Error after one time unit of x'' = -x with the run's own kick and drift."""
    kick_drift = REGISTRY["sph.kick_drift"].program("cpu")
    weights = np.ones(steps)
    if varying:
        weights += 0.5 * np.sin(np.arange(steps) * 2 * math.pi / steps) ** 2 + 0.3 * (np.arange(steps) % 2)
    lengths = weights / weights.sum()
    position, velocity = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.5, 0.0]])
    built, moved = position.copy(), np.zeros(2)
    previous = 0.0
    for length in lengths:
        kick = 0.5 * (previous + length)
        kick_drift(-position, built, None, np.array([kick, length]), None, None, velocity, position, moved)
        previous = length
    exact = np.array([math.cos(1.0), 0.5 * math.sin(1.0)])
    return np.abs(position[0, :2] - exact).max()


def test_leap_frog_is_of_second_order_while_the_step_changes():
    steps = [16, 32, 64, 128]
    assert 1.9 < order([1 / n for n in steps], [oscillate(n) for n in steps]) < 2.1
    assert 1.9 < order([1 / n for n in steps], [oscillate(n, varying=False) for n in steps]) < 2.1
