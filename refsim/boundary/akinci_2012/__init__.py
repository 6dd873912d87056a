"""Walls of boxes as one layer of boundary particles, after Akinci et al. 2012 with a calibrated volume.

V_b = g / sum_k W_bk. With g = 1 (literal) the first fluid layer on a flat wall is 12 to 17 % too dense; the default g
is calibrated on the lattice so that this layer has the rest density. A lone particle never reaches the rest density
and would pass through one layer: the planes of the box stop it, and the run counts these stops.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np

from refsim.boundary import adami_2012
from refsim.boundary.adami_2012 import LEAST_SHARE, ParticleWalls
from refsim.core.capabilities import FACES, BringsWalls, Face, HasErrata, HasPlanes, effects_with
from refsim.core.checked import NotNegative, Printed
from refsim.core.effect import Discretisation, InitialState, Others
from refsim.core.errors import InputError
from refsim.core.period import Lengths
from refsim.core.walls import WallMotion, WallParticles, planes
from refsim.scene.solids import countable
from refsim.smoothing import lattice, smoothing
from refsim.sph import acceleration_of, gravity_of, liquid_of

# Spacings of the support radius from which on one layer pushes less the nearer a particle is (docs/liquid.md)
WIDE = 2.5


class BoxWalls(ParticleWalls, HasPlanes, HasErrata, frozen=True, kw_only=True):
    """Walls around the box from `lower` to `upper` [m].

    lower, upper  corners of the box [m]; in 2D the z components are ignored, and those along a period of the scene
    model         "extrapolated" (layers as deep as the support whose pressure is extrapolated from the liquid, Adami et
                  al.) or "mirrored" (one layer whose pressure mirrors the liquid's, Akinci et al.); by default
                  extrapolated with an advanced density, else mirrored
    open_faces    faces without wall, of "-x", "+x", "-y", "+y", "-z", "+z"; there the others end, but go on above one
                  against gravity
    viscosity     mu_b of the friction between liquid and wall particles [Pa s]; 0 for free slip
    no_slip       friction with which the liquid's velocity at the walls is theirs
    moving_faces  faces that move in their own plane and drag the liquid by their friction
    velocity      of the moving faces [m/s]
    literal       readings of Akinci et al.: their own choice "g" (g = 1 in V_b, not calibrated); or "paper" or "all",
                  which are the same
    """

    name: ClassVar[str] = "box_walls"
    periodic: ClassVar[bool] = True
    source: ClassVar[str] = "Akinci et al."
    errata: ClassVar[tuple[str, ...]] = ("g",)
    improvements: ClassVar[tuple[str, ...]] = errata
    places: ClassVar[tuple[str, ...]] = ("lower", "upper")

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    model: Literal["mirrored", "extrapolated"] | None = None
    open_faces: tuple[Face, ...] = ()
    viscosity: NotNegative = 0.0
    no_slip: bool = False
    moving_faces: tuple[Face, ...] = ()
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    literal: Printed = ()

    def check(self, grid: Discretisation, others: Others) -> None:
        for face in FACES:
            across = grid.period["xyz".index(face[1])] > 0
            if across and face not in self.open_faces:
                raise InputError(
                    f"{self.name}: the face {face} would stand across the scene's period; add it to open_faces."
                )
        self._check_motion(grid, others)
        for axis in range(grid.dim):
            if grid.period[axis] > 0:
                continue
            low, high = self.lower[axis], self.upper[axis]
            if high - low < grid.spacing:
                raise InputError(
                    f"box_walls: along {'xyz'[axis]} the box from {low} to {high} m is thinner than one particle"
                    f" spacing ({grid.spacing} m); make it larger."
                )
        cells = [(high - low) / grid.spacing for low, high in zip(*self._corners(grid))][: grid.dim]
        countable(f"box_walls: its box at a spacing of {grid.spacing} m", cells, each=1, grid=grid)

    def _corners(self, grid: Discretisation) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Lower and upper corner [m]; along a period those of the periodic box."""
        start, length = grid.period_lower, grid.period
        lower = tuple(a if size > 0 else b for a, size, b in zip(start, length, self.lower))
        upper = tuple(a + size if size > 0 else b for a, size, b in zip(start, length, self.upper))
        return lower, upper

    def _check_motion(self, grid: Discretisation, others: Others) -> None:
        """Raise InputError for faces that cannot move as they are said to, and for friction at others' particles."""
        for face in self.moving_faces:
            axis = "xyz".index(face[1])
            if face in self.open_faces or axis >= grid.dim:
                raise InputError(f"{self.name}: the face {face} has no wall that could move; take it off moving_faces.")
            if self.velocity[axis] != 0:
                raise InputError(
                    f"{self.name}: the velocity {list(self.velocity)} m/s has a part across the face {face}, and faces"
                    " move in their own plane only; set that part to 0."
                )
        if grid.dim == 2 and self.velocity[2] != 0:
            raise InputError(f"{self.name}: velocity has a z part in a 2D scene; set it to 0.")
        if self.moving_faces and not self.rubs():
            raise InputError(
                f"{self.name}: moving_faces drag the liquid by friction only; set no_slip, or give a viscosity above 0."
            )
        if any(self.velocity) and not self.moving_faces:
            raise InputError(f"{self.name}: a velocity is given and no face moves; name it in moving_faces.")
        rivals = [e.name for e in others.values() if isinstance(e, BringsWalls) and e.name != self.name]
        if self.rubs() and rivals:
            key = "no_slip" if self.no_slip else "viscosity"
            raise InputError(
                f"{self.name}: its {key} would act at the particles of {rivals[0]} as well; give {key} to"
                f" {rivals[0]}, whose friction acts at all walls, or leave it out."
            )

    def sums_density(self, standing: bool) -> bool:
        return self.model == "mirrored" or bool(self.literal)

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        wide = grid.support_radius / grid.spacing
        if self.extrapolates() or grid.dim == 2 or wide < WIDE or gravity_of(others) is None:
            return ()
        return (
            f"{self.name}: model = 'mirrored' does not carry the weight of liquid in 3D at a support radius of"
            f" {wide:.3g} spacings; take less than {WIDE:g}, or model = 'extrapolated'",
        )

    def walls(self, grid: Discretisation, others: Others) -> WallParticles | None:
        """Positions (m, 3) [m] half a spacing outside the box and volumes (m,) [m^dim]; None with all faces open."""
        lower, upper = self._corners(grid)
        count = adami_2012.layers(grid) if self.extrapolates() else 1
        position = box_layers(lower, upper, grid.spacing, grid.dim, count, self.open_faces, grid.period)
        if not len(position):
            return None
        if self.extrapolates():
            return self._beside(position, grid, others)
        sums = wall_kernel_sums(position, liquid_of(others).sum_kernel(), grid.support_radius, grid.dim, grid.period)
        return WallParticles(position, self._factor(grid, others) / sums)

    def _factor(self, grid: Discretisation, others: Others) -> float:
        """g of V_b."""
        shape = liquid_of(others).sum_kernel()
        return 1.0 if "g" in self.printed() else calibrated_factor(shape, grid.support_radius, grid.spacing, grid.dim)

    def layer_volumes(self, grid: Discretisation, others: Others) -> tuple[float, ...]:
        if self.extrapolates():
            return ()
        liquid = liquid_of(others)
        layer, _ = lattice_layers(liquid.sum_kernel(), grid.support_radius, grid.spacing, grid.dim)
        return (self._factor(grid, others) / layer[0] / liquid.particle_volume(grid),)

    def _beside(self, position: np.ndarray, grid: Discretisation, others: Others) -> WallParticles:
        """Cells at (m, 3) [m] less what other walls fill of them: each at the centre of the rest."""
        left = np.ones(len(position))
        moment = position.copy()
        for effect in effects_with(others, BringsWalls):
            if not isinstance(effect, BoxWalls):
                share, centre = effect.filled(grid, position)
                left -= share
                moment -= share[:, None] * centre
        kept = left > LEAST_SHARE
        volume = liquid_of(others).particle_volume(grid) * left[kept]
        return WallParticles(moment[kept] / left[kept, None], volume)

    def normals(self, grid: Discretisation, points: np.ndarray) -> np.ndarray:
        away = points - np.clip(points, *self._corners(grid))
        away[:, grid.dim :] = 0
        return np.sign(away) * (np.count_nonzero(away, axis=1) == 1)[:, None]

    def wall_speed(self) -> float:
        return math.hypot(*self.velocity) if self.moving_faces else 0.0

    def shares(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        groups: dict[str, Any] = {}
        if self.moving_faces:
            moving = np.full((2, 3), [[-np.inf], [np.inf]])
            for face in self.moving_faces:
                side, axis = "-+".index(face[0]), "xyz".index(face[1])
                moving[side, axis] = (self.lower, self.upper)[side][axis]
            groups["wall_motion"] = WallMotion(*(np.array(v, grid.dtype) for v in (*moving, self.velocity)))
        lower, upper = self.domain(grid)
        if np.isfinite([*lower, *upper]).any():
            first, last = self._ends(grid, others)
            groups["bounds"] = planes(lower, upper, first, last, grid.dtype)
        return groups

    def _ends(self, grid: Discretisation, others: Others) -> np.ndarray:
        """(2, 3) coordinates [m] between which planes act: corners at open faces, but upward; d/2 behind the others."""
        ends, up = np.array([self.lower, self.upper], dtype=float), -np.array(acceleration_of(others))
        for number, face in enumerate(FACES):
            axis, side = divmod(number, 2)
            outward = 2 * side - 1
            if axis >= grid.dim or grid.period[axis] > 0 or (face in self.open_faces and outward * up[axis] > 0):
                ends[side, axis] = outward * math.inf
            elif face not in self.open_faces:
                ends[side, axis] += 0.5 * outward * grid.spacing
        return ends

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        """No values of its own; raises InputError for particles that start behind a wall."""
        first = 0 if grid.solids is None else len(grid.solids.lattice.key)  # ShapeMatching tests particles of solids
        self.check_inside(grid, state.position[first:], 1e-3 * grid.spacing, first)  # for the rounding of the planes
        return {}


def box_layers(
    lower: tuple, upper: tuple, spacing: float, dim: int, layers: int = 1, open_faces: tuple[str, ...] = (),
    period: Lengths = (0, 0, 0),
) -> np.ndarray:  # fmt: skip
    """Layers of points (m, 3) [m], the first half a spacing outside the box, edges and corners included.

    Along a `period` [m] they begin half a spacing inside and go once around.
    """
    axes: list[np.ndarray] = []
    walled, opened = np.zeros((2, 1, 1, 1), bool)
    for axis in range(3):
        if axis >= dim:
            axes.append(np.zeros(1))
        elif period[axis] > 0:
            around = max(1, round(period[axis] / spacing))
            axes.append(lower[axis] + (np.arange(around) + 0.5) * period[axis] / around)
        else:
            low, high = lower[axis] - 0.5 * spacing, upper[axis] + 0.5 * spacing
            inner = np.linspace(low, high, max(2, round((high - low) / spacing) + 1))
            deeper = spacing * np.arange(1, layers)
            axes.append(np.concatenate([low - deeper[::-1], inner, high + deeper]))
            for side, beyond in (("-", axes[-1] < lower[axis]), ("+", axes[-1] > upper[axis])):
                along = beyond.reshape(np.roll((-1, 1, 1), axis))
                if side + "xyz"[axis] in open_faces:
                    opened = opened | along
                else:
                    walled = walled | along
    kept = np.broadcast_to(walled & ~opened if layers > 1 else walled, [len(places) for places in axes])
    return np.stack([places[k] for places, k in zip(axes, np.nonzero(kept))], axis=1)


def wall_kernel_sums(
    position: np.ndarray, shape: str, support_radius: float, dim: int, period: Lengths = (0, 0, 0)
) -> np.ndarray:
    """sum_k W_bk over the wall particles, in a periodic box over nearest images, self included (m,) [1/m^dim]."""
    from scipy.spatial import cKDTree

    from refsim.neighbours.reference import nearest_image
    from refsim.smoothing.reference import kernel_value

    kernel = smoothing(shape, support_radius, dim)
    tree = cKDTree(position - position.min(0), boxsize=period)  # 0 for no period; the layer goes once around each
    pairs = tree.query_pairs(support_radius, output_type="ndarray")
    apart = position[pairs[:, 0]] - position[pairs[:, 1]]
    if any(period):
        apart = nearest_image(apart, period)
    w = kernel_value(np.linalg.norm(apart, axis=1), kernel)
    return kernel_value(0.0, kernel) + np.bincount(pairs.ravel(), np.repeat(w, 2), len(position))


def lattice_layers(shape: str, support_radius: float, spacing: float, dim: int) -> tuple[list[float], float]:
    """(sum of W over each layer of the lattice, from a particle's own on [1/m^dim]; share that a half-space lacks)."""
    from refsim.smoothing.reference import kernel_value

    kernel = smoothing(shape, support_radius, dim)
    reach = math.ceil(support_radius / spacing)
    flat2 = (lattice(reach, dim - 1) ** 2).sum(1)
    layer = [float(kernel_value(spacing * np.sqrt(flat2 + k * k), kernel).sum()) for k in range(reach + 1)]
    return layer, 1 - sum(layer) / sum(layer[abs(k)] for k in range(-reach, reach + 1))


def calibrated_factor(shape: str, support_radius: float, spacing: float, dim: int) -> float:
    """g for which the first fluid layer of a half-space lattice on a flat wall has the rest density.

    rho_1/rho0 = (sum over fluid layers)/(sum over the full lattice) + g (sum_b W_ib)/(sum_k W_bk) = 1.
    """
    layer, lacking = lattice_layers(shape, support_radius, spacing, dim)
    return lacking * layer[0] / layer[1]
