"""Operations of surface detection: flags and how far each decision is from flipping."""

import numpy as np

from refsim.core.operation import operation
from refsim.core.terms import Decision, where
from refsim.neighbours.sums import Fields, neighbours
from refsim.surface_detection import reference as ref
from refsim.surface_normal.operations import SHAPES

ENOUGH = 3


@operation(
    "J(12), improved by Jiang & Zhu E23", "surface_detection.candidates",
    paper="Jiang & Zhu 2023, with the first moment beside it", outputs="near_surface", exact="near_surface",
    invariants="reordering",
)  # fmt: skip
@operation(
    "J(12)", paper="Jiang & Zhu 2023", outputs="near_surface", exact="near_surface", variants=("asymmetry",),
    invariants="reordering",
)  # fmt: skip
def near_surface(number_density, asymmetry, near_surface_limit, rows=None):
    """Near-surface flags of number densities [1/m^dim]; with asymmetries [m^(1 - dim)] also by them."""
    i = Fields(number=number_density, asymmetry=asymmetry).at(rows)
    near = ref.sparse(i, float(near_surface_limit.number_density))
    if asymmetry is not None:
        near |= ref.asymmetric(i, float(near_surface_limit.asymmetry))
    return {"near_surface": near}


@operation(
    "J(13) with Jiang & Zhu E5, E6, E20", paper="Jiang & Zhu 2023, after Marrone et al. 2010", outputs="surface",
    exact="surface", variants=("walls candidates", "", "candidates"), tolerance=16.0,
    reason="roundings of the distance, the unit normal and their product, relative to the distance",
    invariants="translation reordering", cases=SHAPES,
)  # fmt: skip
def fan_scan(position, surface_normal, candidates, walls, fan_scan, rows=None):
    """Surface flags of candidates; position (n, 3) [m], surface_normal (n, 3) inward, candidates (n,) or None.

    i is surface if its region is empty, or if fewer than 3 particles are nearer than h; with a normal below
    `smallest_normal` the region counts as occupied (Jiang & Zhu E20).
    """
    s, h = float(fan_scan.radius), float(fan_scan.support_radius)
    everyone = position if walls is None else np.concatenate([position, walls.position])
    i = Fields(position=position, normal=surface_normal, axis=ref.axis(Fields(normal=surface_normal)))
    around = neighbours(i, Fields(position=everyone), rows=rows, reach=2 * max(h, 2 * s))
    others = around.others
    empty = ref.directed(around.i, float(fan_scan.smallest_normal)) & ~others.any(
        ref.in_region, s=s, printed=bool(fan_scan.printed)
    )
    surface = empty | ~others.at_least(ENOUGH, ref.near, h=h)
    if candidates is not None:
        chosen = np.asarray(candidates)[slice(None) if rows is None else rows] != 0
        surface &= Decision(np.where(chosen, np.inf, -np.inf))
    return {"surface": surface}


@operation(
    "p = 0 on S", paper="Koshizuka & Oka 1996, as cited by Jiang & Zhu 2023", outputs="pressure", tolerance=0.0,
    reason="a choice between a copy and zero", invariants="reordering",
)  # fmt: skip
def release_pressure(surface, pressure, rows=None):
    """Pressure (n,) [Pa]: 0 where surface (n,) is set, unchanged elsewhere."""
    i = Fields(surface=surface, pressure=pressure).at(rows)
    return {"pressure": where(i.surface, 0, i.pressure)}
