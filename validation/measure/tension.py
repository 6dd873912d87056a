"""The tension that acts: drops whose `surface_tension` is 1, by every model, in default and summed liquid and MPM.

A row's `laplace` and `rayleigh` are the tensions by pressure jump and by frequency over the one that was asked for;
`share` is the measured over the nominal one that the model took for it, 1 where it knows none.
"""

import itertools
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import refsim
from refsim.core.capabilities import with_scene_defaults
from refsim.core.effect import Discretisation
from refsim.particle_shifting import ParticleShifting
from refsim.scene.plan import make_plan
from validation.measure import drops
from validation.measure.sigma_map import with_motion
from validation.measure.stirring import CALM, free_drop

SPH: dict[str, Any] = {
    "akinci": refsim.Akinci2013, "becker_teschner": refsim.BeckerTeschner2007, "csf": refsim.CsfWang2019,
    "dong": refsim.Dong2016, "he": refsim.He2014, "jiang_zhu": refsim.JiangZhu2023,
    "tartakovsky_meakin": refsim.TartakovskyMeakin2005,
}  # fmt: skip
MODELS = SPH | {"mpm": partial(refsim.SurfaceEnergy, enclose_volume=True)}
RADII = {2: (11.0, 16.0, 24.0), 3: (8.5, 10.0, 12.0)}  # in spacings
SUPPORTS = (2.3, 3.0)  # h in spacings, beside 2.6
STIFFNESS = 0.001  # S of water in a scene of one's own, 0.072 N/m, d = 1 mm, c = 8.5 m/s; beside 0.01
# Where sigma is that of measured drops, others judge it, by model, dimension and whether containers' coefficients are
# meant: radii; h and S. By SEEDS, or 31 and, between the radii, 32
JUDGED: dict[tuple[str, int, bool], tuple[tuple[float, ...], tuple[tuple[float, float], ...]]] = {
    ("akinci", 2, False): ((6.0, 8.0, 11.0, 16.0, 20.0), ((2.6, 0.0015), (2.6, 0.006), (3.0, 0.003), (3.0, 0.009))),
    ("akinci", 3, False): ((6.0, 8.5, 12.0, 14.0, 20.0), ((2.6, 7e-4), (2.6, 2e-3), (2.6, 6e-3), (2.6, 0.015),
                                                          (2.8, 5e-3), (3.0, 3e-3), (3.0, 9e-3))),
    ("akinci", 3, True): ((6.0, 8.5, 12.0, 14.0), ((2.6, 7e-4), (2.6, 1.5e-3), (2.6, 4e-3), (2.6, 7e-3), (2.6, 0.015),
                                                   (2.6, 0.025), (2.8, 8e-3), (3.0, 2e-3), (3.0, 8e-3))),
    ("csf", 2, False): ((6.0, 11.0, 16.0, 20.0), ((2.3, 3e-3), (2.6, 5e-4), (2.6, 6e-3), (3.0, 2e-3), (3.0, 8e-3))),
    ("csf", 3, False): ((6.0, 8.5, 12.0, 14.0), ((2.6, 0.0015), (2.6, 0.006), (2.8, 0.003), (3.0, 0.008))),
    ("dong", 2, False): ((8.0, 11.0, 16.0, 20.0), ((3.8, 7e-3), (3.8, 0.011), (3.9, 9e-3), (4.0, 8e-3), (4.0, 0.012))),
    ("dong", 3, False): ((6.0, 8.5, 12.0, 14.0), ((3.0, 0.002), (3.0, 0.0045), (3.0, 0.008))),
    ("dong", 3, True): ((6.0, 7.0, 12.0, 14.0), ((3.0, 0.002), (3.0, 0.006))),
}  # fmt: skip
SEEDS = {("akinci", 2, False): range(41, 46), ("akinci", 3, False): range(41, 46), ("akinci", 3, True): range(53, 58),
         ("dong", 3, False): range(61, 63)}  # fmt: skip
OWN = {"akinci": ("gamma", "area_acceleration"), "dong": ("stiffness", "correction")}  # coefficients of a model


@dataclass(frozen=True)
class Point(drops.Point):
    """One drop, of the default liquid or a summed one, with a tension as a scene asks for it.

    standing  with the coefficient that a container has
    """

    kernels: Any = "wendland"
    liquid: Any = "continuity"
    standing: Any = False

    @property
    def key(self) -> str:
        return super().key + ".standing" * self.standing

    def tension(self) -> tuple[Any, ...]:
        shifted = self.model in SPH and not drops.summed(asdict(self))
        made = MODELS[self.model](surface_tension=1.0)
        if self.standing:
            own, further = OWN[self.model]
            beside = self.share(f"{further.split('_')[0]}_coefficient")
            made = MODELS[self.model](**{own: self.share("coefficient"), further: beside})
        return made, *((ParticleShifting(),) if shifted else ())

    def share(self, of: str = "share_of_nominal") -> float:
        """What the model takes in a container, measured over nominal tension by default."""
        fluid = refsim.WeaklyCompressible(sound_speed=self.stiffness**-0.5, rest_density=1.0, density=self.liquid)
        beside = (fluid, ParticleShifting(), refsim.Gravity(), refsim.BoxWalls(lower=(0.0,) * 3, upper=(1.0,) * 3))
        grid = Discretisation(self.dim, "float64", 1.0, self.support, 0, drop_radius=self.radius)
        effects = with_scene_defaults((*beside, MODELS[self.model](surface_tension=1.0)))
        return getattr(effects[MODELS[self.model].name], of)(grid, effects)


def points(models: tuple[str, ...] = tuple(MODELS), dims: tuple[int, ...] = (2, 3)) -> Iterator[Point]:
    """Three radii with three seeds at the middle one, other supports there, another stiffness at the first; JUDGED.

    Of a summed density the first radius with both stiffnesses, and the last.
    """
    for model, dim in itertools.product(models, dims):
        first, middle, last = RADII[dim]
        if model == "mpm":  # whose h is three spacings
            for radius, seed in itertools.product((6.0, 8.0, 12.0, 20.0), (31, 32)):
                yield Point(model, dim, support=3.0, radius=radius, seed=seed)
            continue
        for radius, stiffness in ((first, 0.01), (first, STIFFNESS), (last, 0.01)):
            yield Point(model, dim, radius=radius, stiffness=stiffness, liquid="summation")
        judged = [(standing, *JUDGED[of]) for standing in (False, True) if (of := (model, dim, standing)) in JUDGED]
        for standing, radii, places in judged:
            seeds = SEEDS.get((model, dim, standing), (31, 32))
            for (support, stiffness), radius, seed in itertools.product(places, radii, seeds):
                if radius in radii[1:-1] or seed != 32:
                    yield Point(model, dim, support, radius, stiffness, seed=seed, standing=standing)
        if judged and (model, dim) != ("akinci", 2):  # whose tension is nominal in a container
            continue
        for radius in RADII[dim]:
            for seed in (1, 2, 3) if radius == middle else (1,):
                yield Point(model, dim, radius=radius, seed=seed, standing=bool(judged))
        for support in SUPPORTS:
            yield Point(model, dim, radius=middle, support=support, standing=bool(judged))
        yield Point(model, dim, radius=first, stiffness=STIFFNESS, standing=bool(judged))


def measure(point: Point, backend: str = "cpu") -> dict[str, Any]:
    """The row of a drop: see `drops.measure`; the pressure has the part of the random motion."""
    row = drops.measure(point, backend)
    if point.model not in SPH:
        return row
    plan = make_plan(free_drop(point, drops.start(point), None, CALM))
    tension: Any = plan.effects[MODELS[point.model].name]
    share = point.share() if point.standing else tension.share_of_nominal(plan.grid, plan.effects)
    return {**(row if row["stopped"] else with_motion(row)), "share": share}
