"""Inputs and closed forms of the continuum surface force."""

import numpy as np

from refsim.core.cases import Exact, at, example, groups, pair_case, particles, readings, takes, vectors
from refsim.smoothing.cases import for_each_kernel
from refsim.surface_tension.csf_wang_2019 import Continuum, CsfWang2019, Marangoni

example(
    CsfWang2019(surface_tension=0.5), brings="corrected_density curvature interface_normal near_surface number_density"
)


@particles("interface_normal")
def _normals(case, random):
    """Lengths from zero to well beyond that of a flat surface; some exactly zero."""
    values = 0.7 * vectors(case, random) / case.support_radius
    values[3::7] = 0
    return values


# of either sign, up to one over the support
particles(curvature=lambda case, random: random.uniform(-1, 1, case.count) / case.support_radius)


@groups("continuum", "marangoni", "wetting")
def _continuum(case, grid):
    slope = tuple(c / case.support_radius for c in (0.3, -0.2, 0.25 if case.dim == 3 else 0.0))
    literal = ("all",) if case.literal else ()
    effect = CsfWang2019(surface_tension=0.5, contact_angle=60.0, tension_gradient=slope, literal=literal)
    return effect.prepare(grid, case.effects)


readings(continuum="plain")
takes("csf_wang_2019.normal", wetting="cotangent")
takes("csf_wang_2019.curvature", continuum="threshold factor plain")
takes("csf_wang_2019.force", continuum="tension threshold share")

PAIR = pair_case("interface_pair")
VOLUME = np.array([2 / 1000, 3 / 600])
GIVEN = {"mass": [2.0, 3.0], "density": [1000.0, 600.0]}
CONTINUUM = Continuum(0.5, 0.1, 2.0, 2.0, 0)


@for_each_kernel("csf_wang_2019.normal")
def two_normals(w):
    """n_1 = V_2 W'(r) e_12/(V_1 W(0) + V_2 W(r)) points towards particle 2."""
    length = VOLUME[::-1] * w.slope / (w.at_zero * (VOLUME + w.share * VOLUME[::-1]))
    return Exact(PAIR, GIVEN, {"interface_normal": [[0.0, length[0], 0.0], [0.0, -length[1], 0.0]]})


@for_each_kernel("csf_wang_2019.curvature")
def two_curvatures(w):
    """n^_1 = x, n^_2 = 0.8 x + 0.6 y: kappa_1 = -2 (V_2 0.6 |W'|)/(V_2 |W'|) = -1.2/m, hollow.

    From particle 2 the pair's direction has the cosine 0.6: the share is 1 - 0.99 0.36.
    """
    normal = np.array([[3.0, 0.0, 0.0], [4.0, 3.0, 0.0]])
    inputs = GIVEN | {"interface_normal": normal, "continuum": CONTINUUM}
    return Exact(PAIR, inputs, {"curvature": [-2 * 0.6, -2 * 0.6 / (1 - 0.99 * 0.36)]})


@for_each_kernel("csf_wang_2019.curvature")
def two_plain_curvatures(w):
    """The same with the factor dim over the whole distance; the threshold puts a third particle out."""
    three = at("interface_three", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    normal = np.array([[3.0, 0.0, 0.0], [4.0, 3.0, 0.0], [0.05, 0.0, 0.0]])
    inputs = {"mass": [2.0, 3.0, 1.0], "density": [1000.0, 600.0, 900.0], "interface_normal": normal}
    plain = {"continuum": CONTINUUM._replace(factor=3.0, plain=1)}
    return Exact(three, inputs | plain, {"curvature": [-1.8, -1.8, 0.0]})


@for_each_kernel("csf_wang_2019.force")
def bulging_and_drawn(w):
    """Normal force 2/rho (sigma + g.x) kappa n; along the surface 2/rho |n| g_x V_2 ..., where n is along z.

    g_1 = V_2 (s.y) |W'| y with s = 0.25 along y: the pair's own share of the gradient.
    """
    normal = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 0.05]])
    gradient = VOLUME[1] * 0.25 * w.slope
    value = 2 / 1000 * np.array([0.0, 2 * gradient, 0.5 * 4.0 * 2.0])
    inputs = GIVEN | {"interface_normal": normal, "curvature": [4.0, 4.0], "continuum": CONTINUUM}
    return Exact(PAIR, inputs | {"marangoni": Marangoni(0.0, 0.25, 0.0)}, {"acceleration": [value, np.zeros(3)]})
