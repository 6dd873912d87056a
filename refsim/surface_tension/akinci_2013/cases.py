"""Inputs and closed forms of Akinci et al. 2013."""

import math

import numpy as np

from refsim.core import cases
from refsim.core.cases import VARIATIONS, Exact, Variation, at, closed_form, following, pair_case, plain_keeps, prepared
from refsim.core.walls import WallParticles
from refsim.surface_normal import AxialPart
from refsim.surface_tension.akinci_2013 import Adhesion, Akinci2013, AreaMinimisation, CohesionSpline

cases.example(Akinci2013(surface_tension=0.5, adhesion=0.1), brings="surface_normal")

# area term and cohesion of similar size, so that an error in either is visible
prepared("spline area_term adhesion", lambda case: Akinci2013(gamma=2.0, area_acceleration=5.0, adhesion=3.0))

VARIATIONS[CohesionSpline] = Variation(
    following(amplitude=lambda group, h, dim: 32 * float(group.gamma) / (math.pi * h**dim))
)
VARIATIONS[Adhesion] = Variation(following(amplitude=lambda group, h, dim: 0.007 * float(group.beta) / h**dim))
cases.takes("akinci_2013.tension", "akinci_2013.adhesion", smoothing="support_radius dim")
plain_keeps("akinci_2013.tension", spline="the equation sums cohesion and area term; cohesion needs no normals")

# h = 2 m in 3D at r = h/2: C = 32/(pi h^3) (1/64) = 1/(16 pi), the spline's greatest attraction.
PAIR = pair_case("akinci_pair")
NEAR = at("akinci_near_pair", [[0.0, 0.0, 0.0], [0.0, 0.0, 0.5]])
MASS, DENSITY = np.array([2.0, 3.0]), np.array([1000.0, 600.0])  # K_12 = 2 1000/1600 = 5/4
SPLINE = CohesionSpline(0.5, 0.5 * 4 / math.pi)

PULL = 5 / 4 * 0.5 / (16 * math.pi)  # K gamma C(h/2)
PUSH = 5 / 4 * 0.5 * 4 / math.pi * 5 / 2048  # at r = h/4 the core repels: 2 (3/4)^3 (1/4)^3 - 1/64 = -5/2048


def _pair(acceleration, case=PAIR, **inputs):
    """Cohesion alone, but for what is given."""
    fields = {"mass": MASS, "density": DENSITY, "spline": SPLINE, "area_term": AreaMinimisation(0.0), "axial": None}
    return Exact(case, fields | {"area_normal": np.zeros((2, 3))} | inputs, {"acceleration": np.array(acceleration)})


ATTRACTED = [[0.0, 3 * PULL, 0.0], [0.0, -2 * PULL, 0.0]]  # a_1 = -K gamma m_2 C(h/2) e_12 with K = 5/4
AT_REST = {"pressure": np.zeros(2), "velocity": np.ones((2, 3)), "walls": None}  # so that only cohesion acts
closed_form(
    "akinci_2013.tension",
    attracted_pair=lambda: _pair(ATTRACTED),
    repelled_pair=lambda: _pair([[0.0, 0.0, -3 * PUSH], [0.0, 0.0, 2 * PUSH]], NEAR),
)
closed_form("akinci_2013.tension:fused", pair_at_rest=lambda: _pair(ATTRACTED, **AT_REST))


def _with_normals(axial):
    """a_1 = -K eps (n_1 - n_2), twice its part along y if axial, for any masses; cohesion is zero."""
    difference = np.array([0.5, -1.0, 0.25])
    inputs = {"spline": CohesionSpline(0.0, 0.0), "area_term": AreaMinimisation(8.0), "axial": axial}
    inputs["area_normal"] = np.array([difference, [0.0, 0.0, 0.0]])
    difference = difference * (0.0, 2.0, 0.0) if axial else difference
    return _pair(5 / 4 * 8.0 * np.array([-difference, difference]), **inputs)


closed_form(
    "akinci_2013.tension",
    pair_with_normals=lambda: _with_normals(None),
    pair_with_axial_normals=lambda: _with_normals(AxialPart(2.0)),
)


@closed_form("akinci_2013.adhesion")
def drawn_to_a_wall():
    """At r = 3 h/4: A = 0.007/h^3 (1/4)^(1/4) = 0.007/(8 sqrt 2); a = beta rho0 V_b A towards the wall."""
    wall = np.array([[0.0, -1.5, 0.0]])
    case = at("akinci_wall", [0, 0, 0], wall)
    pull = 3.0 * 1000 * 0.25 * 0.007 / (8 * math.sqrt(2))
    inputs = {"walls": WallParticles(wall, np.array([0.25])), "adhesion": Adhesion(3.0, 3.0 * 0.007 / 8)}
    return Exact(case, inputs, {"acceleration": [[0.0, -pull, 0.0]]})
