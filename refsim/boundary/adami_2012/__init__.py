"""Walls whose pressure is extrapolated from the liquid, after Adami, Hu & Adams 2012.

There is no effect of this name: `box_walls` and `mesh_boundary` add the passes with `model = "extrapolated"`.
"""

import functools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import msgspec
import numpy as np

from refsim.core.capabilities import BringsWalls, FollowsScene, SumsDensity, effects_with
from refsim.core.effect import Discretisation, Effect, Field, Others, Pass, StepLimit, int32
from refsim.core.errors import InputError
from refsim.core.walls import Holding, WallViscosity
from refsim.smoothing import lattice, smoothing
from refsim.sph import LIQUID, lean, liquid_of
from refsim.sph.shear import SHORTEST, layer_friction

WALL_PRESSURE = Field("wall_pressure", "Pa", "pressure of the wall particles, from the liquid", rows="walls")
WALL_STRAIN = Field("wall_strain", "m^(2 dim)/s", "strain of the liquid at the wall particles", rows="walls")
LEAST_SHARE = 1e-3  # of a cell that a wall particle fills


class ParticleWalls(Effect, BringsWalls, FollowsScene, SumsDensity, frozen=True, kw_only=True):
    """Walls of particles whose pressure is mirrored or extrapolated from the liquid, with friction."""

    in_papers: ClassVar[Mapping[str, str]] = {"model": "mirrored"}
    needed: ClassVar[tuple[str, ...]] = (LIQUID,)

    if TYPE_CHECKING:  # parameters of each
        model: Literal["mirrored", "extrapolated"] | None
        viscosity: float
        no_slip: bool

    def with_scene_defaults(self, others: Others) -> "ParticleWalls":
        """Extrapolated, where no model is given, with a liquid whose density is advanced; else mirrored.

        Raises InputError where `no_slip` has no viscosity to follow.
        """
        liquid = liquid_of(others)
        model = self.model or ("extrapolated" if liquid.with_scene_defaults(others).advances() else "mirrored")
        if self.no_slip and self.viscosity > 0:
            raise InputError(f"{self.name}: no_slip follows the liquid's viscosity; leave out its viscosity.")
        if self.no_slip and liquid.dynamic_viscosity == 0:
            raise InputError(
                f"{self.name}: no_slip needs a liquid with viscosity; give {liquid.name} a dynamic_viscosity."
            )
        return msgspec.structs.replace(self, model=model)

    def layer_volumes(self, grid: Discretisation, others: Others) -> tuple[float, ...]:
        """Volumes of flat walls of each layer over those of as much lattice [-]; () for whole cells."""
        return ()

    def extrapolates(self) -> bool:
        return self.model == "extrapolated"

    def fields(self, others: Others) -> tuple[Field, ...]:
        if not self.extrapolates():
            return ()
        return (WALL_PRESSURE, WALL_STRAIN) if liquid_of(others).advances() else (WALL_PRESSURE,)

    def passes(self, others: Others) -> tuple[Pass, ...]:
        return (*self.pressure_passes(others), *self.friction_passes())

    def rubs(self) -> bool:
        """Whether there is friction at its particles."""
        return self.no_slip or self.viscosity > 0

    def pressure_passes(self, others: Others) -> tuple[Pass, ...]:
        """Extrapolation from the liquid and push of all walls, of the first effect with such walls."""
        if self is not next((effect for effect in effects_with(others, BringsWalls) if effect.extrapolates()), None):
            return ()
        solids = "two_way_coupling" in others
        pushing: dict[str, str | None] = {"smoothing": "gradient_smoothing"}
        liquid = liquid_of(others)
        names = pushing | ({} if solids else dict.fromkeys(("phase", "wet", "suction", "film_factor")))
        names |= {} if liquid.leans(others) else {"borne": None}
        return (
            *((Pass("adami_2012.strain", writes=("wall_strain",), names=names),) if liquid.advances() else ()),
            Pass("adami_2012.extrapolation", writes=("wall_pressure",), names=names),
            liquid.with_own_force("adami_2012.wall_force", names, "pressure"),
        )

    def friction_passes(self) -> tuple[Pass, ...]:
        """Friction at the wall particles, where there is some."""
        if not self.rubs():
            return ()
        operation = "adami_2012.hold" if self.no_slip else "one_way_coupling.wall_viscosity"
        return (Pass(operation, updates=("acceleration",), names={"smoothing": "gradient_smoothing"}),)

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        groups: dict[str, Any] = lean(grid, others) if self.extrapolates() else {}
        if self.no_slip:
            steepness = int32(STEEPNESS[liquid_of(others).central()])
            return groups | {"holding": Holding(grid.real(self._holding(grid, others)[0]), steepness)}
        return groups | ({"wall_viscosity": WallViscosity(grid.real(self.viscosity))} if self.viscosity > 0 else {})

    def _holding(self, grid: Discretisation, others: Others) -> tuple[float, float]:
        """(coefficient of the friction by which liquid does not slip [Pa s], `holding_rate` [-])."""
        liquid = liquid_of(others)
        given = grid.support_radius / grid.spacing, grid.dim, liquid.central(), self.layer_volumes(grid, others)
        return holding_share(*given) * liquid.line_viscosity(grid), holding_rate(*given)

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        if not self.rubs():
            return {}
        density = liquid_of(others).rest_density
        if not self.no_slip:
            half = 0.5 * grid.support_radius
            return {"wall friction": StepLimit.constant(0.125 * half**2 * density / self.viscosity)}
        seconds = RESOLVED * density * grid.spacing**2 / math.prod(self._holding(grid, others))
        return {"wall friction": StepLimit.constant(seconds)}


def layers(grid: Discretisation) -> int:
    """As many layers of wall particles as the support is wide, and one more."""
    return math.ceil(grid.support_radius / grid.spacing * (1 - 1e-9)) + 1


# The friction of a wall is that of the liquid times (1 - r/h)^n, so that it grows towards the wall as that of a layer
# in shear: ten layers flow as Poiseuille says to 0.5 % (h = 2.6 d and more), with n = 0 by 4 to 8 % too fast.
STEEPNESS = {True: 3, False: 1}  # n where the liquid's viscosity is along the line of centres, and beside J(11)
NEAR, RESOLVED = 0.75, 0.9  # spacings off the first layer; step over the time in which friction stops a particle there


def _padded(volumes: tuple[float, ...], far: int) -> list[float]:
    """Volumes of `far` layers of the wall; 1 for whole cells."""
    return [*volumes, *[0.0] * far][:far] if volumes else [1.0] * far


@functools.lru_cache(maxsize=64)
def holding_share(reach: float, dim: int, central: bool, volumes: tuple[float, ...] = ()) -> float:
    """Coefficient of the friction over that of the liquid's viscosity [-], with which a sheared lattice does not slip.

    reach    support radius [d]
    central  whether that viscosity is along the line of centres, with (dim + 2) mu, or J(11), over (dim + 2)
    volumes  of the wall's layers over those of the lattice; () for whole cells
    """
    from scipy.optimize import brentq

    liquid, wall = (layer_friction(reach, dim, *form) for form in ((central,), (True, STEEPNESS[central])))
    far = len(wall)
    rows, volume = 12 * far, _padded(volumes, far)
    between, held = np.zeros((rows, rows)), np.zeros(rows)
    for k, friction in enumerate(liquid, 1):
        between += friction * (np.eye(rows, k=k) + np.eye(rows, k=-k))
    between -= np.diag(between.sum(1))
    for i in range(far):
        held[i] = sum(wall[i + j] * volume[j] for j in range(far - i))
    height, sheared = np.arange(rows) + 0.5, np.arange(rows) >= rows - far
    between[sheared] = np.eye(rows)[sheared]

    def slip(share: float) -> float:
        """Where the velocity of the middle layers, which shear uniformly, vanishes below the wall."""
        velocity = np.linalg.solve(between - share * np.diag(held), np.where(sheared, height, 0.0))
        i = rows // 2
        return float(velocity[i] / (velocity[i + 1] - velocity[i]) - height[i])

    return float(brentq(slip, 1e-2, 1e6, rtol=1e-10))


@functools.lru_cache(maxsize=64)
def holding_rate(reach: float, dim: int, central: bool, volumes: tuple[float, ...] = ()) -> float:
    """Rate [k/(rho d^2)] at which friction of coefficient k stops a particle on its way to the wall, `NEAR` off its
    first layer."""
    from refsim.smoothing.reference import viscosity_laplacian

    reach = max(reach, SHORTEST)
    far = math.ceil(reach)
    beside, kernel = (lattice(far, dim - 1) ** 2).sum(1), smoothing("wendland_c2", reach, dim)
    rate = 0.0
    for j, volume in enumerate(_padded(volumes, far)):
        away = j + NEAR
        r = np.sqrt(beside + away**2)
        shape = viscosity_laplacian(r, kernel) * np.maximum(1 - r / reach, 0) ** STEEPNESS[central]
        rate += volume * float((shape * (away / r) ** 2).sum())
    return rate
