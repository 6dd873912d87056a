"""Inputs and closed forms of Jiang & Zhu 2023."""

import math

import numpy as np

from refsim.core import cases
from refsim.smoothing.cases import for_each_kernel
from refsim.surface_normal import AxialPart
from refsim.surface_tension.jiang_zhu_2023 import AreaTerm, Cohesion, JiangZhu2023, PairSelection, SoftThresholds
from refsim.surface_tension.jiang_zhu_2023.modes import ALL, AREA_TERMS, PAIR_MODES, SOFT

cases.example(
    JiangZhu2023(surface_tension=0.5, pair_mode="soft"),
    brings="corrected_density corrected_normal near_surface number_density surface_normal surface_weight",
)

cases.particles(
    # from the bulk to the surface; some exactly 0 and some exactly 1
    surface_weight=lambda case, random: np.clip(random.uniform(-0.3, 1.3, case.count), 0, 1),
    corrected_density=lambda case, random: 1000 * random.uniform(0.95, 1.05, case.count),
)


@cases.groups("pairs", "soft", "cohesion", "area")
def _tension(case, grid):
    read = {"area_term": "color", "literal": ("all",)} if case.literal else {}
    return JiangZhu2023(surface_tension=0.07, area_ratio=0.2, **read).prepare(grid, case.effects)


# gamma W(0, h) of poly6, and W(0, 0.8 h) over it
cases.VARIATIONS[Cohesion] = cases.Variation(
    cases.following(
        amplitude=lambda group, h, dim: float(group.gamma) * (315 / 64 if dim == 3 else 4) / (math.pi * h**dim),
        inner_share=lambda group, h, dim: 0.8**-dim,
    ),
    {"inner_stretch": "the reference has the 0.8 of J(17)"},
)
cases.VARIATIONS[SoftThresholds] = cases.Variation(
    lambda group, inputs, kernel: {"inverse_width": 1 / (float(group.upper) - float(group.lower))}
)
cases.takes("jiang_zhu_2023.cohesion", "jiang_zhu_2023.tension", smoothing="support_radius dim")
cases.codes(PairSelection, mode=PAIR_MODES)
cases.codes(AreaTerm, kind=AREA_TERMS)
cases.plain_keeps(
    "jiang_zhu_2023.cohesion",
    "jiang_zhu_2023.tension",
    cohesion="the equation is the sum of cohesion and area term; cohesion needs no normals",
)

# h = 2 m in 3D: poly6 W(0, h) = 315/(512 pi) and W(h/2, h) = 27/64 of it; W(h/2, 0.8 h) = (1 - 25/64)^3/0.512 of it.
PAIR = cases.pair_case("tension_pair")
W0 = 315 / (512 * math.pi)
SHAPE = 0.6 * (39 / 64) ** 3 / 0.512 - 0.9 * 27 / 64
COHESION = Cohesion(0.5, 0.6, 0.9, 0.5 * W0, 1 / 0.512, 1.25)
MASS, DENSITY = np.array([2.0, 3.0]), np.array([1000.0, 500.0])


@for_each_kernel("jiang_zhu_2023.corrected_density")
def two_densities(w):
    """(m_1 W(0) + m_2 W(h/2)) / (V_1 W(0) + V_2 W(h/2)); the second particle is left alone."""
    value = (2 + 3 * w.share) / (2 / 1000 + 3 / 500 * w.share)
    inputs = {"mass": MASS, "density": DENSITY, "near_surface": [1, 0]}
    return cases.Exact(PAIR, inputs, {"corrected_density": [value, 500.0]})


cases.closed_form(
    "jiang_zhu_2023.replace_density",
    copied=lambda: cases.Exact(PAIR, {"corrected_density": [3.0, 4.0]}, {"density": [3.0, 4.0]}),
)


@cases.closed_form("jiang_zhu_2023.soft_weight")
def half_way():
    """Half way up the ramp the weight is 1/2; a quarter up it is 5/32."""
    normal = np.array([[0.0, 0.3, 0.4], [0.0, 0.375, 0.0]])
    inputs = {"surface_normal": normal, "soft": SoftThresholds(0.25, 0.75, 2.0)}
    return cases.Exact(PAIR, inputs, {"surface_weight": [0.5, 5 / 32]})


def _cohering(share, **inputs):
    """A share of the pull; the area term is zero, but for what is given."""
    pull = share * 0.5 * W0 * SHAPE
    fields = {"mass": MASS, "density": DENSITY, "cohesion": COHESION, "area": AreaTerm(0, 0.0), "axial": None}
    expected = np.array([[0.0, -3 * pull, 0.0], [0.0, 2 * pull, 0.0]])
    return cases.Exact(PAIR, fields | {"area_normal": np.zeros((2, 3))} | inputs, {"acceleration": expected})


AT_REST = {"pressure": np.zeros(2), "velocity": np.ones((2, 3)), "walls": None}  # so that only cohesion acts
ALONE = {"area": None, "area_normal": None}
MARKED = {"surface_weight": None, "surface": [0, 1], "pairs": PairSelection(3)}
HALF = {"surface_weight": [1.0, 0.0], "surface": None, "pairs": PairSelection(0)}
# a_1 = gamma m_2 C(h/2) e_12, half of it where one of the two is of the bulk
cases.closed_form("jiang_zhu_2023.cohesion", "jiang_zhu_2023.tension", cohering_pair=lambda: _cohering(0.5, **HALF))
cases.closed_form("jiang_zhu_2023.tension:fused", cohering_pair_at_rest=lambda: _cohering(1.0, **AT_REST))
cases.closed_form(
    "jiang_zhu_2023.cohesion:fused", cohering_pair_without_area_term=lambda: _cohering(1.0, **AT_REST, **ALONE)
)
# particle 2 is of the surface: the pair acts where either has to be
cases.closed_form("jiang_zhu_2023.cohesion", cohering_marked_pair=lambda: _cohering(1.0, **MARKED, **ALONE))


def _area_pair(share, pairs, surface_weight, axial=None):
    """a_1 = -eps m_2/(rho_1 rho_2) (n_1 - n_2), halved by the weights, or between all pairs; cohesion is zero."""
    difference = np.array([0.5, -1.0, 0.0])
    factor = share * 8.0 / (1000.0 * 500.0)
    inputs = {
        "mass": MASS, "density": DENSITY, "surface": None, "surface_weight": surface_weight,
        "pairs": PairSelection(pairs), "cohesion": COHESION._replace(amplitude=0.0, gamma=0.0),
        "area": AreaTerm(0, 8.0), "area_normal": [difference, [0.0, 0.0, 0.0]], "axial": axial,
    }  # fmt: skip
    difference = difference * (0.0, 2.0, 0.0) if axial else difference  # the pair lies along y
    return cases.Exact(PAIR, inputs, {"acceleration": factor * np.array([-3 * difference, 2 * difference])})


cases.closed_form(
    "jiang_zhu_2023.tension",
    area_pair=lambda: _area_pair(0.5, SOFT, [1.0, 0.0]),
    whole_area_pair=lambda: _area_pair(1.0, ALL, None),
    axial_area_pair=lambda: _area_pair(1.0, ALL, None, AxialPart(2.0)),
)
