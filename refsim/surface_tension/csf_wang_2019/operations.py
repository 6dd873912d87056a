"""Operations of the continuum surface force; arrays position, normals (n, 3); mass, density, curvature (n,); SI."""

import numpy as np

from refsim.core.operation import SYMMETRY, operations
from refsim.core.terms import Terms, length, minimum, where
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.surface_tension.csf_wang_2019 import reference as ref

operation = operations(paper="Wang, Zhu & Yin 2019, reconstructed")


@operation(
    "n_i by the corrected kernel", outputs="interface_normal", optional="walls", tolerance=12.0,
    reason="the roundings of one pair, and once more those of the denominator", invariants=SYMMETRY,
    packed="normal_pair",
)  # fmt: skip
def normal(position, mass, density, walls, smoothing, gradient_smoothing, wetting, rows=None):
    """Normals, inward [1/m], walls by the contact angle; i itself in the denominator."""
    i, b = Fields(position=position, mass=mass, density=density), wall_particles(walls)
    around, at_walls = (neighbours(i, j, smoothing, gradient_smoothing, rows=rows) for j in (i, b))
    n, filled = around(ref.normal), around(ref.filled)
    if walls is not None:
        w, walled = at_walls(ref.wall_normal), at_walls(ref.wall_filled)
        n, filled = n + w, filled + walled
        from_here = at_walls.of(Fields(inward=n), b)
        whole = from_here(ref.beyond, both=True)
        there = whole.value > 0
        dry = where(there, minimum(8 * from_here(ref.beyond) / where(there, whole, 1), 1), 0)
        n, filled = ref.turned(n, w, dry, float(wetting.cotangent)), filled - dry * walled
    return {"interface_normal": n / filled}


@operation(
    "kappa_i, renormalised divergence of the unit normals", outputs="curvature", tolerance=16.0,
    reason="two unit normals, direction, slope and volume in each of two sums, and their quotient", invariants=SYMMETRY,
)  # fmt: skip
def curvature(position, mass, density, interface_normal, gradient_smoothing, continuum, rows=None):
    """Curvature [1/m], positive where liquid bulges; 0 where |n| is at most the threshold."""
    i = Fields(position=position, mass=mass, density=density, **directions(interface_normal, continuum))
    around = neighbours(i, i, gradient_smoothing, rows=rows).others
    above, below = around(ref.divergence), around(ref.renormalisation, plain=bool(continuum.plain))
    there = (around.i.active.value != 0) & (below.value != 0)
    kappa = -float(continuum.factor) * above / where(there, below, 1)
    return {"curvature": where(there, kappa, 0)}


@operation(
    "sigma kappa n and the force along grad sigma", adds="acceleration", optional="marangoni", tolerance=16.0,
    reason="distance, slope, volume, rise and direction in a sum, its projection, and the product", invariants=SYMMETRY,
    broken={1: "translation rotation"},
)  # fmt: skip
def force(position, mass, density, interface_normal, curvature, gradient_smoothing, continuum, marangoni, rows=None):
    """Acceleration [m/s^2], zero off the surface; c = `share` compensates for the half of |n| outside the liquid."""
    slope = np.zeros(3) if marangoni is None else np.array([float(part) for part in marangoni])
    given = {"sigma": Terms(continuum.tension), "slope": Terms(slope, rank=1)}
    i = Fields(
        position=position, mass=mass, density=density, normal=interface_normal, curvature=curvature,
        **directions(interface_normal, continuum),
    )  # fmt: skip
    here, a = i.at(rows), 0.0
    a = ref.normal_force(here, **given)
    if marangoni is not None:
        a += ref.tangential_force(here, neighbours(i, i, gradient_smoothing, rows=rows)(ref.tension_rise, slope=slope))
    return {"acceleration": where(here.active, float(continuum.share) / here.density * a, 0)}


def directions(interface_normal, continuum):
    """Unit normals, 0 where |n| is at most the threshold, and flags of the particles where it is larger."""
    n = Terms(interface_normal, rank=1)
    size = length(n).value
    active = ~(size <= float(continuum.threshold))
    return {"active": active, "unit": n.value / np.where(active, size, 1.0)[:, None]}
