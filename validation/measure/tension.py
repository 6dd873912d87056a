"""The tension that acts in the default liquid: drops whose `surface_tension` is 1, with every model.

A row's `laplace` and `rayleigh` are the tensions by pressure jump and by frequency over the one that was asked for;
`share` is the measured over the nominal one that the model took for it, 1 where it knows none.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from refsim.core.effect import Effect
from refsim.particle_shifting import ParticleShifting
from refsim.scene.plan import make_plan
from refsim.surface_tension.akinci_2013 import Akinci2013
from refsim.surface_tension.becker_teschner_2007 import BeckerTeschner2007
from refsim.surface_tension.cohesion import PairCohesion
from refsim.surface_tension.csf_wang_2019 import CsfWang2019
from refsim.surface_tension.dong_2016 import Dong2016
from refsim.surface_tension.he_2014 import He2014
from refsim.surface_tension.jiang_zhu_2023 import JiangZhu2023
from refsim.surface_tension.tartakovsky_meakin_2005 import TartakovskyMeakin2005
from validation.measure import drops
from validation.measure.sigma_map import with_motion
from validation.measure.stirring import CALM, free_drop

MODELS: dict[str, Effect] = {
    "akinci": Akinci2013(surface_tension=1.0),
    "becker_teschner": BeckerTeschner2007(surface_tension=1.0),
    "csf": CsfWang2019(surface_tension=1.0),
    "dong": Dong2016(surface_tension=1.0),
    "he": He2014(surface_tension=1.0),
    "jiang_zhu": JiangZhu2023(surface_tension=1.0),
    "tartakovsky_meakin": TartakovskyMeakin2005(surface_tension=1.0),
}
RADII = {2: (11.0, 16.0, 24.0), 3: (8.5, 10.0, 12.0)}  # in spacings
SUPPORTS = (2.3, 3.0)  # h in spacings, beside 2.6
# S, beside 0.01; of water in a scene of one's own 0.001: 0.072 N/m, d = 1 mm, c = 8.5 m/s
STIFFNESSES = (0.0003, 0.001, 0.003, 0.03)
# (R, h, S, seed) of further drops, with other sizes and seeds than the first ones
FURTHER: dict[tuple[str, int], tuple[tuple[float, float, float, int], ...]] = {
    ("akinci", 3): ((7.0, 2.6, 0.005, 1),), ("csf", 3): ((7.0, 2.6, 0.005, 2),),
    ("dong", 2): (
        (11.0, 3.3, 0.001, 1), (11.0, 3.3, 0.003, 1), (16.0, 3.3, 0.0007, 3), (16.0, 3.3, 0.003, 2),
        (11.0, 3.6, 0.0003, 1), (11.0, 3.6, 0.001, 1), (11.0, 3.6, 0.003, 1), (16.0, 3.6, 0.0007, 3),
        (16.0, 3.6, 0.002, 2), (11.0, 4.0, 0.0003, 1), (11.0, 4.0, 0.001, 1), (11.0, 4.0, 0.003, 1),
        (16.0, 4.0, 0.0015, 2),
    ),
    ("dong", 3): (
        (7.0, 3.0, 0.0003, 2), (7.0, 3.0, 0.001, 1), (7.0, 3.0, 0.003, 2), (8.5, 3.0, 0.003, 3), (10.0, 3.0, 0.005, 2),
        (7.0, 3.3, 0.001, 1), (7.0, 3.3, 0.005, 1), (10.0, 2.6, 0.003, 2),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Point(drops.Point):
    """One drop of the default liquid, with a tension as a scene asks for it."""

    kernels: Any = "wendland"
    liquid: Any = "continuity"

    def tension(self) -> tuple[Any, ...]:
        return MODELS[self.model], ParticleShifting()


def points(models: tuple[str, ...] = tuple(MODELS), dims: tuple[int, ...] = (2, 3)) -> Iterator[Point]:
    """Three radii with three seeds at the middle one, other supports there; at the first all stiffnesses; FURTHER."""
    for model, dim in itertools.product(models, dims):
        first, middle, _ = RADII[dim]
        for radius in RADII[dim]:
            for seed in (1, 2, 3) if radius == middle else (1,):
                yield Point(model, dim, radius=radius, seed=seed)
        for support in SUPPORTS:
            yield Point(model, dim, radius=middle, support=support)
        for support, stiffness in itertools.product((2.6, *SUPPORTS), (0.01, *STIFFNESSES)):
            if (support, stiffness) != (2.6, 0.01):
                yield Point(model, dim, radius=first, support=support, stiffness=stiffness)
        for radius, support, stiffness, seed in FURTHER.get((model, dim), ()):
            yield Point(model, dim, radius=radius, support=support, stiffness=stiffness, seed=seed)


def measure(point: Point, backend: str = "cpu") -> dict[str, Any]:
    """The row of a drop: see `drops.measure`; the pressure has the part of the random motion."""
    row = drops.measure(point, backend)
    plan = make_plan(free_drop(point, drops.start(point), None, CALM))
    tension = plan.effects[MODELS[point.model].name]
    share = tension.share_of_nominal(plan.grid, plan.effects) if isinstance(tension, PairCohesion) else 1.0
    return {**(row if row["stopped"] else with_motion(row)), "share": share}
