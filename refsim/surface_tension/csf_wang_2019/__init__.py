"""Continuum surface force of a free surface after Wang, Zhu & Yin 2019, as reconstructed (Jiang & Zhu 2023, [6]).

Jiang & Zhu describe the paper in words: a normal and a tangential force, and a density correction near the surface.
These forces are not pairwise opposite and equal, so that momentum is not conserved.
"""

import functools
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, NamedTuple

import msgspec
import numpy as np

from refsim.core.capabilities import HasErrata, HasTension, KnowsLimits, Margin, PullsAtLines, PullsParticles
from refsim.core.checked import NotNegative, Positive, Printed
from refsim.core.effect import Discretisation, Effect, Field, Others, Pass, StepLimit, int32
from refsim.smoothing import lattice, smoothing
from refsim.smoothing.reference import kernel_slope, kernel_value
from refsim.sph import LIQUID, SETS, liquid_of
from refsim.surface_detection import detection_in
from refsim.surface_tension import cohesion
from refsim.surface_tension.cohesion import MeasuredByDrops
from refsim.surface_tension.jiang_zhu_2023 import corrected_density_passes

INTERFACE_NORMAL = Field("interface_normal", "1/m", "normal n by the corrected kernel, inward", 3)
CURVATURE = Field("curvature", "1/m", "curvature kappa of the surface, positive where liquid bulges")


class Continuum(NamedTuple):
    """Parameters of the continuum surface force in kernels."""

    tension: float  # sigma [N/m]
    threshold: float  # |n| above which a particle belongs to the surface [1/m]
    factor: float  # dim - 1; dim in the plain reading
    share: float  # 1/int |n| over the liquid's side of a flat surface; dimensionless
    plain: int  # 1: the plain reading


class Wetting(NamedTuple):
    """Contact angle at walls as kernels take it."""

    cotangent: float  # of the angle; dimensionless


class Marangoni(NamedTuple):
    """Gradient of the surface tension [N/m^2]."""

    x: float  # gradient of the surface tension along x [N/m^2]
    y: float  # gradient of the surface tension along y [N/m^2]
    z: float  # gradient of the surface tension along z [N/m^2]


@functools.lru_cache(maxsize=64)
def flat_share(sums: str, gradients: str, support_radius: float, spacing: float, dim: int) -> float:
    """1/sum_k |n_k| d over the layers of a lattice half-space, dimensionless; 1 with particles on both sides."""
    reach = math.ceil(support_radius / spacing)
    steps = spacing * lattice(reach, dim)
    distance = np.sqrt((steps**2).sum(1))
    w = spacing**dim * kernel_value(distance, smoothing(sums, support_radius, dim))
    slope = spacing**dim * kernel_slope(distance, smoothing(gradients, support_radius, dim))
    along = np.divide(slope * steps[:, -1], distance, out=np.zeros_like(slope), where=distance > 0)
    total = 0.0
    for depth in range(reach + 1):
        there = steps[:, -1] >= -(depth + 0.5) * spacing
        total += abs(along[there].sum()) / w[there].sum() * spacing
    return 1 / total


# Bounds of the notes: cubes of 512 particles became drops up to S = 0.020 and down to mu = 0.39 sqrt(rho0 sigma d)
# (docs/stability.md).
LARGEST_STIFFNESS = 0.015
LEAST_VISCOSITY = 0.45


class CsfWang2019(
    Effect, MeasuredByDrops, HasTension, KnowsLimits, HasErrata, PullsParticles, PullsAtLines, frozen=True, kw_only=True
):
    """Surface tension of a free liquid surface as a force along its normal, by its curvature.

    surface_tension      sigma [N/m]: that of measured drops in the default liquid
    tension_gradient     gradient of sigma along x, y, z [N/m^2], which drives the force along the surface
    contact_angle        angle between surface and walls, through the liquid [degrees]
    threshold            a particle belongs to the surface where |n| h exceeds this (Morris 2000 takes 0.01 with his h,
                         half the support radius)
    normalise            compensate for the half of |n| outside the liquid, where there are no particles; without it the
                         force is about half to two thirds of that of sigma
    density_correction   correct the density near the surface as in Jiang & Zhu, J(14) and J(15); left out, it is on but
                         for the default liquid, whose density a surface leaves whole
    literal              plain readings to use: "shell" (the curvature's factor dim with the whole distance in the
                         denominator, up to 1.5 times too large on a thin surface layer); or "all". The paper is not at
                         hand, so that "paper" changes nothing
    """

    name: ClassVar[str] = "csf_wang_2019"
    scales: ClassVar[tuple[str, ...]] = ("surface_tension", "tension_gradient")
    source: ClassVar[str] = "Wang et al."
    errata: ClassVar[tuple[str, ...]] = ("shell",)
    unopposed: ClassVar[str] = "csf_wang_2019.force"
    virial: ClassVar[str] = "the force acts on the surface alone, and the capillary limit holds"
    sums: ClassVar[bool] = True
    needed: ClassVar[tuple[str, ...]] = (LIQUID,)
    in_papers: ClassVar[Mapping[str, Any]] = {"density_correction": True}

    surface_tension: NotNegative
    tension_gradient: tuple[float, float, float] = (0.0, 0.0, 0.0)
    contact_angle: Annotated[float, msgspec.Meta(ge=0, le=180)] = 90.0
    threshold: Positive = 0.5
    normalise: bool = True
    density_correction: bool | None = None
    literal: Printed = ()

    def _plain(self) -> "CsfWang2019":
        return type(self)(
            surface_tension=self.surface_tension, tension_gradient=self.tension_gradient,
            contact_angle=self.contact_angle,
        )  # fmt: skip

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        return (
            f"{self.name}: the forces of a pair are not opposite and equal: momentum is not conserved, and drops of"
            " few layers were found to gain energy until particles gather in pairs or leave the drop",
            *self.exceeded(grid, others),
            *self.beyond_measured(grid, others),
        )

    def margins(self, grid: Discretisation, others: Others) -> Iterator[Margin]:
        yield from cohesion.stiffness_margin(
            self.surface_tension, LARGEST_STIFFNESS, cohesion.BECAME_DROPS, grid, others
        )
        fluid = liquid_of(others)
        least = LEAST_VISCOSITY * math.sqrt(fluid.rest_density * self.surface_tension * grid.spacing)
        consequence = (
            f"dynamic_viscosity {fluid.dynamic_viscosity:.3g} Pa s is below {least:.3g} Pa s = {LEAST_VISCOSITY:g}"
            " sqrt(rho0 sigma d), the least with which cubes became drops in one piece"
        )
        yield Margin("dynamic_viscosity [Pa s]", fluid.dynamic_viscosity, least, least=True, beyond=consequence)

    def nominal_tension(self, grid: Discretisation, others: Others) -> float:
        """sigma [N/m]."""
        return self.surface_tension

    def passes(self, others: Others) -> tuple[Pass, ...]:
        return (
            *(corrected_density_passes() if self.density_correction is not False else ()),
            Pass("csf_wang_2019.normal", writes=(INTERFACE_NORMAL,)),
            Pass("csf_wang_2019.curvature", writes=(CURVATURE,)),
            Pass("csf_wang_2019.force", updates=("acceleration",)),
        )

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        real, h = grid.real, grid.support_radius
        fluid = liquid_of(others)
        plain = "shell" in self.printed()
        share = flat_share(*SETS[fluid.kernels], h, grid.spacing, grid.dim) if self.normalise else 1.0
        share /= self.share_of_nominal(grid, others)
        gradient = Marangoni(*map(real, self.tension_gradient)) if any(self.tension_gradient) else None
        groups = detection_in(others).prepare(grid, others)
        return groups | {
            "continuum": Continuum(
                real(self.surface_tension), real(self.threshold / h), real(grid.dim if plain else grid.dim - 1),
                real(share), int32(plain),
            ),
            "marangoni": gradient,
            "wetting": Wetting(real(1 / math.tan(math.radians(np.clip(self.contact_angle, 0.01, 179.99))))),
        }  # fmt: skip

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        return cohesion.capillary_limit(self.surface_tension, grid, others)
