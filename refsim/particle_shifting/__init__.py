"""Particle shifting after Sun et al. 2017: displacements that keep the particles evenly spaced.

Displacements beside dt v keep the linear momentum, since velocities stay, but neither angular momentum nor energy. Near
a free surface only what is uneven within it acts; what is near it, and its normal, follow from sums of the step.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import msgspec
import numpy as np

from refsim.core.capabilities import (
    BringsWalls,
    CorrectsPositions,
    FollowsStart,
    HasPlanes,
    Joins,
    PullsParticles,
    closed_box,
    effects_with,
    open_axis,
)
from refsim.core.checked import NotNegative
from refsim.core.effect import Discretisation, Effect, Field, InitialState, Others, Pass
from refsim.core.errors import InputError
from refsim.smoothing import lattice, smoothing
from refsim.sph import FILLING, LIQUID, LONGEST_SHIFT, NUMBER_DENSITY, SETS, SHIFT, WAY, liquid_of, volumes

VELOCITY_RANGE = Field(
    "velocity_range", "m/s", "largest velocities of each body: along each axis, and against it", 6, rows="bodies"
)
DRAWN_BODY = Field("drawn_body", "-", "number of the body that the particle was drawn in", dtype="int32", state=True)
LARGEST_SHIFT = 0.5  # of v_max dt: longest displacement of a step beside dt v (Sun et al. 2017)
LEAST_NORMAL = 0.05  # of h times the gradient of the filling, below which a surface has no direction
# fillings between which what is uneven along the normal begins to act: not in the outermost layer of a lattice (0.69 to
# 0.88), but in the next one (0.96 and more); beside a tension as its coefficients were measured
OUTERMOST, BESIDE_TENSION = (0.9, 0.95), (0.97, 1.0)
OVERSHOT = 1.75  # of a lattice's wave, most that a step takes away; with 2 it stays as large, and beyond it grows
LEAST_FULL = 0.97  # share of a box that liquid without a surface fills at least


class Shifting(NamedTuple):
    """Parameters of the shift as the kernels take them."""

    length: float  # A 2 h_s [m]
    inverse_neighbour: float  # 1/W(d) [m^dim]
    largest: float  # of v_max dt
    least: float = 0.0  # gradient of the filling below which a surface has no direction [1/m]
    whole: float = 1.0  # factor of the filling: 1, or 1/delta0 of the number density [m^dim]
    outer: float = 0.9  # filling up to which nothing along the normal is left
    within: float = 0.95  # filling from which on all is
    farthest: float = math.inf  # largest v_max dt that counts [m]


@functools.lru_cache(maxsize=64)
def steepest(shape: str, reach: float, dim: int) -> float:
    """Largest change of g_i, (7), over the displacement of a wave's crest in a lattice [1/d^2], h = `reach` [d].

    Nine wave numbers up to pi/d an axis are tried; between them it is up to 0.4 % larger.
    """
    from refsim.smoothing.reference import kernel_slope, kernel_value

    kernel, x, step = smoothing(shape, reach, dim), lattice(math.ceil(reach), dim), 1e-4
    x = x[x.any(1)]

    def gradients(x: np.ndarray) -> np.ndarray:
        r = np.linalg.norm(x, axis=1)
        crowded = 1 + 0.2 * (kernel_value(r, kernel) / kernel_value(1.0, kernel)) ** 4
        return (crowded * kernel_slope(r, kernel) / r)[:, None] * x

    change = np.stack([gradients(x + e) - gradients(x - e) for e in step * np.eye(dim)], -1) / (2 * step)
    waves = np.array(list(itertools.product(np.linspace(0, math.pi, 9), repeat=dim)))
    return float(np.linalg.eigvalsh(np.einsum("nw,nab->wab", 1 - np.cos(x @ waves.T), change)).max())


def _within_meshes(others: Others) -> bool:
    """Whether walls without planes take a part of the box."""
    return any(not isinstance(effect, HasPlanes) for effect in effects_with(others, BringsWalls))


def _filled(grid: Discretisation, others: Others) -> float:
    """Share of its closed box that the particles fill; 0 in an open one."""
    return grid.count * grid.spacing**grid.dim / float(np.prod(closed_box(grid, others)))


class ParticleShifting(Effect, CorrectsPositions, Joins, FollowsStart, frozen=True, kw_only=True):
    """Displacements down the gradient of the particles' concentration.

    strength  A, 0 for none; Sun et al. 2017 have 1, with which vortices at Re 50 to 200 decay too fast
    surface   "detected": near a free surface, where less than 0.97 of the space is filled, the gradient of the filling
              does not count, and the outermost layer moves along the surface only; "none": the liquid has no surface,
              and its continuity equation takes the shifts (Sun et al. 2019); by default none where the liquid fills a
              box that periods or planes close, without solids and meshes
    bodies    "apart": largest velocities are those of the body that a particle was drawn in, parts whose boxes touch
              being one, also solids; "together": of all particles; by default apart where there are several bodies
              and no period
    """

    name: ClassVar[str] = "particle_shifting"
    scales: ClassVar[tuple[str, ...]] = ("strength",)
    periodic: ClassVar[bool] = True
    needed: ClassVar[tuple[str, ...]] = (LIQUID,)

    strength: NotNegative = 2.2
    surface: Literal["detected", "none"] | None = None
    bodies: Literal["apart", "together"] | None = None

    @classmethod
    def joins(cls, others: Others) -> bool:
        """Beside a liquid that names no density, where that is advanced."""
        liquid = others.get(LIQUID)
        return liquid is not None and liquid.density is None and liquid.with_scene_defaults(others).advances()  # type: ignore[attr-defined]

    def check(self, grid: Discretisation, others: Others) -> None:
        if self.surface == "none" and self.acts() and (axis := open_axis(grid, others)):
            raise InputError(
                f"{self.name}: surface = 'none', but the scene is open along {axis}; set surface = 'detected'."
            )

    def with_start_defaults(self, grid: Discretisation, others: Others) -> Effect:
        closed = self.surface is None and grid.solids is None and not _within_meshes(others)
        full = closed and _filled(grid, others) >= LEAST_FULL
        several = self.bodies is None and max(grid.bodies) > 0 and not any(grid.period)
        chosen = ({"surface": "none"} if full else {}) | ({"bodies": "apart"} if several else {})
        return msgspec.structs.replace(self, **chosen) if chosen else self

    def start_defaults(self, scene_effects: Iterable[Effect]) -> Iterator[str]:
        named = next((effect for effect in scene_effects if isinstance(effect, ParticleShifting)), None)
        if self.surface == "none" and (named is None or named.surface is None):
            yield f"surface of {self.name} is 'none', since the liquid fills its closed box"
        if self.bodies == "apart" and (named is None or named.bodies is None):
            yield f"bodies of {self.name} are 'apart', since several do not touch at the start"

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        """Bodies that are told apart. Raises InputError for a box that is not full without a surface."""
        filled = 1.0 if _within_meshes(others) else _filled(grid, others)
        if self.surface == "none" and filled < LEAST_FULL:
            raise InputError(
                f"{self.name}: surface = 'none', but the liquid fills {filled:.2g} of its box and has a free"
                " surface, which would compress it; set surface = 'detected'."
            )
        return {"drawn_body": np.repeat(grid.bodies, state.sizes)} if self.bodies == "apart" else {}

    def parts_from_density(self) -> bool:
        return self._at_surface()  # elsewhere the density takes the shifts

    def _at_surface(self) -> bool:
        return self.surface != "none"

    def passes(self, others: Others) -> tuple[Pass, ...]:
        apart, surface = self.bodies == "apart", self._at_surface()
        whole: dict[str, str | None] = {} if apart else {"drawn_body": None}
        filling = FILLING if liquid_of(others).advances() else NUMBER_DENSITY
        names = volumes(others) | {"smoothing": "gradient_smoothing", "filling": filling.name if surface else None}
        names |= {} if "shape_matching" in others else {"phase": None}
        largest, longest = (f if apart else dataclasses.replace(f, rows=1) for f in (VELOCITY_RANGE, LONGEST_SHIFT))
        bodies = (DRAWN_BODY,) * apart
        return (
            Pass("particle_shifting.crowding", writes=(WAY,), names=names, fields=(filling,) * surface),
            Pass("particle_shifting.velocity_range", writes=(largest,), names=whole, stage="motion", fields=bodies),
            Pass("particle_shifting.longest_shift", writes=(longest,), stage="motion"),
            *((Pass("particle_shifting.shift", writes=(SHIFT,), names=whole, stage="motion"),) * (not surface)),
        )

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        from refsim.smoothing.reference import kernel_value

        liquid = liquid_of(others)
        shape, reach = SETS[liquid.kernels][1], grid.support_radius / grid.spacing
        kernel = smoothing(shape, grid.support_radius, grid.dim)
        farthest = OVERSHOT * grid.spacing / (self.strength * reach * steepest(shape, reach, grid.dim))
        numbers = (
            self.strength * grid.support_radius, 1 / float(kernel_value(grid.spacing, kernel)), LARGEST_SHIFT,
            LEAST_NORMAL / grid.support_radius, 1.0 if liquid.advances() else 1 / liquid.rest_number_density(grid),
            *(BESIDE_TENSION if effects_with(others, PullsParticles) else OUTERMOST), farthest,
        )  # fmt: skip
        return {"shifting": Shifting(*map(grid.real, numbers))}
