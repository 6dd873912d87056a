"""Particle shifting after Sun et al. 2017: displacements that keep the particles evenly spaced.

Displacements beside dt v keep the linear momentum, since velocities stay, but neither angular momentum nor energy. At a
detected surface only their tangential part acts. Free drops and collisions do without them.
"""

import dataclasses
from typing import Any, ClassVar, Literal, NamedTuple

from refsim.core.capabilities import CorrectsPositions, open_axis
from refsim.core.checked import NotNegative
from refsim.core.effect import Discretisation, Effect, Others, Pass
from refsim.core.errors import InputError
from refsim.core.fields import Field
from refsim.particle_shifting import reference as reference
from refsim.smoothing import smoothing
from refsim.sph import DETECTION, LARGEST_SHIFT, LIQUID, SETS, SHIFT, liquid_of, surface_of
from refsim.surface_normal import SURFACE_NORMAL, color_gradient_pass, normal_term

CONCENTRATION_GRADIENT = Field(
    "concentration_gradient", "1/m", "gradient of the concentration, sum_j V_j (1 + 0.2 (W_ij/W(d))^4) grad W_ij", 3
)
PASSING_SHIFT = dataclasses.replace(SHIFT, state=False)  # that no later density takes


class Shifting(NamedTuple):
    """Parameters of the shift as the kernels take them."""

    length: float  # A 2 h_s [m]
    inverse_neighbour: float  # 1/W(d) [m^dim]
    largest: float  # of v_max dt


class ParticleShifting(Effect, CorrectsPositions, frozen=True, kw_only=True):
    """Displacements down the gradient of the particles' concentration.

    strength  A, 0 for none; Sun et al. 2017 have 1, with which vortices at Re 50 to 200 decay too fast
    surface   "detected": at the surface that `surface_detection` finds only the tangential part acts; "none": the
              liquid has no surface, as in a periodic box or between walls on all sides, and its continuity equation
              takes the shifts (Sun et al. 2019)
    """

    name: ClassVar[str] = "particle_shifting"
    scales: ClassVar[tuple[str, ...]] = ("strength",)
    periodic: ClassVar[bool] = True

    strength: NotNegative = 2.2
    surface: Literal["detected", "none"] = "detected"

    def needs(self) -> tuple[str, ...]:
        return (LIQUID, DETECTION) if self._at_surface() else (LIQUID,)

    def check(self, grid: Discretisation, others: Others) -> None:
        if self.strength == 0:
            return
        if "shape_matching" in others:
            raise InputError(f"{self.name}: it would tear solids apart; leave it out of a scene with shape_matching.")
        if self.surface == "none":
            axis = open_axis(grid, others)
            if axis:
                raise InputError(
                    f"{self.name}: surface = 'none', but the scene is open along {axis}; set surface = 'detected' and"
                    f" add the effect {DETECTION}."
                )
        for effect in others.values():
            if effect is not self and isinstance(effect, CorrectsPositions) and effect.corrects_positions():
                raise InputError(f"{self.name} and {effect.name} would both correct positions; keep one of them.")

    def corrects_positions(self) -> bool:
        return self.strength > 0

    def _at_surface(self) -> bool:
        return self.surface == "detected" and self.strength > 0

    def fields(self, others: Others) -> tuple[Field, ...]:
        if self.strength == 0:
            return ()
        if self._at_surface():
            return (CONCENTRATION_GRADIENT, PASSING_SHIFT, *surface_of(others).near_fields(), SURFACE_NORMAL)
        return (CONCENTRATION_GRADIENT, SHIFT)

    def passes(self, others: Others) -> tuple[Pass, ...]:
        if self.strength == 0:
            return ()
        names: dict[str, str | None] = {"smoothing": "gradient_smoothing"}
        crowding = Pass("particle_shifting.crowding", writes=(CONCENTRATION_GRADIENT.name,), names=names)
        if self._at_surface():
            detected = (*surface_of(others).near_passes(), color_gradient_pass())
            return (crowding, *detected, Pass("particle_shifting.shift", writes=("shift",), stage="motion"))
        names = {"near_surface": None, "surface_normal": None}
        return (crowding, Pass("particle_shifting.shift", writes=("shift",), names=names, stage="motion"))

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        if self.strength == 0:
            return {}
        from refsim.smoothing.reference import kernel_value

        liquid = liquid_of(others)
        kernel = smoothing(SETS[liquid.kernels][1], grid.support_radius, grid.dim)
        group = Shifting(
            grid.real(self.strength * grid.support_radius),
            grid.real(1 / float(kernel_value(grid.spacing, kernel))),
            grid.real(LARGEST_SHIFT),
        )
        found: dict[str, Any] = {"shifting": group}
        if self._at_surface():
            found |= {**normal_term(liquid, grid), **surface_of(others).near_groups(grid, others)}
        return found

    def energy(self, grid: Discretisation, others: Others) -> None:
        """None: its displacements do work that is not summed."""
