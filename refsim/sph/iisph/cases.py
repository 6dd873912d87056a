"""Inputs and closed forms of implicit incompressible SPH."""

import math

import numpy as np

from refsim.core import cases
from refsim.smoothing.cases import for_each_kernel
from refsim.sph import Fluid
from refsim.sph.iisph import Implicit, ImplicitPressure

cases.example(
    ImplicitPressure(), brings="advected_density density_error diagonal new_pressure own_displacement pair_displacement"
)

KICK, DRIFT = 0.011, 0.012  # per spacing, as in the steps of refsim.core.cases

# of the size that the case's pressures cause in one of its steps
cases.particles("own_displacement", "pair_displacement")(
    lambda case, random: KICK * DRIFT * case.spacing**2 * 1e-2 / case.support_radius * cases.vectors(case, random)
)


@cases.particles("diagonal")
def _diagonal(case, random):
    """Negative, of the size that step and support radius give; some zero, by which nothing is divided."""
    values = -KICK * DRIFT * case.spacing**2 / case.support_radius**2 * random.uniform(0.2, 2, case.count)
    values[4::9] = 0
    return values


cases.particles(advected_density=lambda case, random: 1000 * random.uniform(0.9, 1.2, case.count))
cases.particles("density_error", "new_pressure")(lambda case, random: 1e4 * random.uniform(0, 1, case.count))
# always two iterations, since the number needed may depend on rounding
cases.prepared("implicit", lambda case: ImplicitPressure(iterations=(2, 2)))
cases.VARIATIONS[Implicit] = cases.Variation(other={"least_diagonal": lambda least: 5e5 * least})
cases.takes("iisph.relax", implicit="relaxation least_diagonal")
cases.takes("iisph.solve", implicit="relaxation most least_diagonal")  # always two iterations, whatever the compression

PAIR = cases.at("implicit_pair", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
MASS, DENSITY = np.array([2.0, 3.0]), np.array([1000.0, 500.0])
WATER = Fluid(1000.0, 4e5, 1, 0)
STEP = np.array([0.5, 0.25])
GIVEN = {"mass": MASS, "density": DENSITY, "timestep": STEP, "fluid": WATER}
RESTING = GIVEN | {"velocity": np.zeros((2, 3)), "acceleration": np.zeros((2, 3))}
UP = np.array([0.0, 1.0, 0.0])
IMPLICIT = Implicit(0.5, 1e-3, 2, 2, 1e-9)


@for_each_kernel("iisph.predict")
def approaching_pair(w):
    """grad W_12 = |W'| y: d_11 = -(s/rho_1^2) m_2 |W'| y; they approach with 2 m/s after the kick."""
    share = 0.125 / DENSITY**2
    gradient = MASS[::-1] * w.slope
    squares = gradient**2 + MASS * MASS[::-1] * w.slope**2
    velocity = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    acceleration = np.array([[3.0, 0.0, 0.0], [0.0, -2.0, 0.0]])
    return cases.Exact(
        PAIR, GIVEN | {"velocity": velocity, "acceleration": acceleration},
        {
            "own_displacement": [-share[0] * gradient[0] * UP, share[1] * gradient[1] * UP],
            "diagonal": -share * squares, "advected_density": DENSITY + 0.25 * gradient * 2.0,
        },
    )  # fmt: skip


@for_each_kernel("iisph.displace")
def displaced_pair(w):
    """s_1 = -s m_2 p_2/rho_2^2 |W'| y."""
    pressure = np.array([4000.0, 1000.0])
    size = 0.125 * (MASS * pressure / DENSITY**2)[::-1] * w.slope
    return cases.Exact(PAIR, GIVEN | {"pressure": pressure}, {"pair_displacement": [-size[0] * UP, size[1] * UP]})


def _relaxed(w, diagonal, pressure, new):
    """Displacements across the line of centres do not count; d_ji p_i gives s m_1 p_1/rho_1^2 |W'|^2 m_2."""
    advected = np.array([1100.0, 950.0])
    coefficient = 0.125 * MASS * MASS[::-1] / DENSITY**2 * pressure * w.slope**2
    sums = 1000 - advected - coefficient
    expected = np.maximum(0.5 * pressure + 0.5 * sums / diagonal, 0) if new is None else new
    inputs = GIVEN | {
        "pressure": pressure, "diagonal": diagonal, "advected_density": advected, "implicit": IMPLICIT,
        "own_displacement": [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "pair_displacement": [[0.0, 0.0, 2.0], [1.0, 0.0, 0.0]],
    }  # fmt: skip
    return cases.Exact(
        PAIR, inputs,
        {"new_pressure": expected, "density_error": np.maximum(advected + diagonal * pressure + coefficient - 1000, 0)},
    )  # fmt: skip


for_each_kernel(
    "iisph.relax",
    # the first has too large a density and gets a pressure; the second too small a density: its pressure becomes 0
    compressed_and_thin=lambda w: _relaxed(w, np.array([-0.02, -0.5]), np.array([4000.0, 10.0]), None),
    # the same below one pascal
    compressed_at_low_pressure=lambda w: _relaxed(w, np.array([-2e4, -5e5]), np.array([4e-3, 1e-5]), None),
    # a particle whose -a_ii is below the limit gets no pressure
    hardly_coupled=lambda w: _relaxed(w, np.full(2, -1e-11), np.array([4000.0, 1000.0]), np.zeros(2)),
)


@for_each_kernel("iisph.push")
def pushed_pair(w):
    """a_1 = -m_2 (p_1/rho_1^2 + p_2/rho_2^2) |W'| y."""
    pressure = np.array([4000.0, 1000.0])
    push = (pressure / DENSITY**2).sum() * w.slope
    return cases.Exact(PAIR, GIVEN | {"pressure": pressure}, {"acceleration": [-3 * push * UP, 2 * push * UP]})


@for_each_kernel("iisph.solve")
def pair_at_rest(w):
    """Two particles at half the rest density need no pressure."""
    inputs = RESTING | {"density": np.full(2, 500.0), "pressure": np.zeros(2), "implicit": IMPLICIT}
    expected = {"pressure": np.zeros(2), "acceleration": np.zeros((2, 3)), "advected_density": np.full(2, 500.0)}
    return cases.Exact(PAIR, inputs, expected)


@for_each_kernel("iisph.solve")
def squeezed_pair(w):
    """A pair at 1.1 and 1.2 rho0, as two numbers: after five iterations its compression is the tolerance.

    Each is displaced along y by its own pressure and by the other's; what remains are sums of the two.
    """
    rho, pressure, wanted = np.array([1100.0, 1200.0]), np.array([2e8, 1e8]), 5
    share = 0.125 / rho**2 * w.slope**2
    diagonal = -share * (MASS[::-1] ** 2 + MASS.prod())
    errors, p = [], 0.5 * pressure
    for _ in range(wanted):
        rest = -MASS[::-1] * (share * MASS.sum() * p)[::-1]
        errors.append(np.maximum(rho + diagonal * p + rest - 1000, 0).mean())
        p = np.maximum(0.5 * p + 0.5 * (1000 - rho - rest) / diagonal, 0)
    assert errors[-1] < min(errors[:-1])
    tolerance = math.sqrt(errors[-1] * errors[-2]) / 1000
    push = (p / rho**2).sum() * w.slope
    inputs = RESTING | {"density": rho, "pressure": pressure, "implicit": Implicit(0.5, tolerance, 2, 100, 1e-15)}
    push = push * MASS[::-1, None] * np.array([-UP, UP])
    return cases.Exact(PAIR, inputs, {"pressure": p, "acceleration": push})
