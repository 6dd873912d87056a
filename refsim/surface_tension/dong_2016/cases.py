"""Inputs and closed forms of Dong, Zhang & Chen 2016."""

import numpy as np

from refsim.core import cases
from refsim.smoothing.cases import for_each_kernel
from refsim.sph import Fluid, ViscosityTerm
from refsim.surface_tension.dong_2016 import Dong2016, MolecularForce, NormalCorrection

cases.example(Dong2016(surface_tension=0.5), brings="corrected_density surface_normal")


@cases.groups("molecular_force", "normal_correction")
def _tension(case, grid):
    """Both terms of similar size; the printed reading of every erratum in cases marked `literal`."""
    effect = Dong2016(stiffness=4.0, correction=2.0 * case.support_radius, literal=("all",) if case.literal else ())
    return effect.prepare(grid, case.effects)


cases.VARIATIONS[MolecularForce] = cases.Variation(
    cases.following(
        rest_share=lambda group, h, dim: (1 - float(group.rest_distance) / h) ** 2,
        scale=lambda group, h, dim: 1 / (1 - (1 - float(group.rest_distance) / h) ** 2),
    )
)
cases.readings(normal_correction="symmetric")
cases.takes("dong_2016.momentum", fluid="rest_density gradient_share wall_share")
cases.plain_keeps(
    "dong_2016.tension",
    molecular_force="the equation is the sum of molecular force and normal correction; the force needs no normals",
)

# h = 2 m, d0 = h/2: L(h/4)/k = (81/256 - 9/64)/(1/2 3/2) = 15/64, L(h/2) = 0, L(3 h/4)/k = (1/256 - 1/64)/(3/4) =
# -1/64.
FORCE = MolecularForce(2.0, 1.0, 0.25, 4 / 3)
MASS, DENSITY = np.array([2.0, 3.0]), np.array([1000.0, 600.0])


def _given(**others):
    no_correction = NormalCorrection(0.0, 1)
    inputs = {"mass": MASS, "density": DENSITY, "molecular_force": FORCE, "normal_correction": no_correction}
    return inputs | {"surface_normal": np.zeros((2, 3))} | others


def _pushed(r, push):
    expected = np.array([[0.0, -3 * push, 0.0], [0.0, 2 * push, 0.0]])
    return cases.Exact(cases.pair_case("dong_pair", r), _given(), {"acceleration": expected})


cases.closed_form(
    "dong_2016.tension",
    repelled_pair=lambda: _pushed(0.5, 2.0 * 15 / 64),  # a_1 = m_2 L(h/4) e_12, 15/64 k
    attracted_pair=lambda: _pushed(1.5, -2.0 / 64),  # a_1 = m_2 L(3 h/4) e_12, -k/64
)


def _corrected(w, symmetric, volume):
    difference = np.array([0.5, -1.0, 0.25])
    inputs = _given(
        molecular_force=FORCE._replace(stiffness=0.0), normal_correction=NormalCorrection(8.0, symmetric),
        surface_normal=[difference, np.zeros(3)],
    )  # fmt: skip
    expected = 8.0 * w.share * w.at_zero * np.array([-volume[0] * difference, volume[1] * difference])
    return cases.Exact(cases.pair_case("dong_pair"), inputs, {"acceleration": expected})


for_each_kernel(
    "dong_2016.tension",
    # a_1 = -lambda 2 m_2/(rho_1 + rho_2) (n_1 - n_2) W(h/2); and as printed -lambda m_2/rho_2 ... (Dong E21)
    corrected_pair=lambda w: _corrected(w, True, (6 / 1600, 4 / 1600)),
    pair_as_printed=lambda w: _corrected(w, False, (3 / 600, 2 / 1000)),
)


@for_each_kernel("dong_2016.density")
def two_densities(w):
    """rho_i = m_i (W(0) + W(h/2))."""
    number = (1 + w.share) * w.at_zero
    expected = {"density": MASS * number, "number_density": np.full(2, number)}
    return cases.Exact(cases.pair_case("dong_pair"), {"mass": MASS}, expected)


@for_each_kernel("dong_2016.momentum")
def pressed_and_sheared_pair(w):
    """F_1 = (V_1^2 p_1 + V_2^2 p_2) |W'| away from 2, and mu (V_1^2 + V_2^2) |W'|/r (v_2 - v_1)."""
    slope = w.slope
    squared = (MASS / DENSITY) ** 2
    push = np.array([0.0, -(squared @ [200.0, 100.0]) * slope, 0.0])
    drag = 0.5 * squared.sum() * slope * np.array([-2.0, 0.0, 4.0])
    inputs = {
        "mass": MASS, "density": DENSITY, "pressure": [200.0, 100.0], "viscosity": ViscosityTerm(0.5),
        "velocity": [[1.0, 0.0, 0.0], [-1.0, 0.0, 4.0]], "fluid": Fluid(1000.0, 4e5, 1, 0),
    }  # fmt: skip
    return cases.Exact(cases.pair_case("dong_pair"), inputs, {"acceleration": [(push + drag) / 2, -(push + drag) / 3]})


@for_each_kernel("dong_2016.shepard_filter")
def filtered_densities(w):
    """(m_1 W(0) + m_2 W(h/2))/(V_1 W(0) + V_2 W(h/2)) on either particle."""
    volume = MASS / DENSITY
    value = (MASS + w.share * MASS[::-1]) / (volume + w.share * volume[::-1])
    return cases.Exact(cases.pair_case("dong_pair"), {"mass": MASS, "density": DENSITY}, {"corrected_density": value})
