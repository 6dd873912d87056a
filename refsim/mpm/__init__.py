"""Material point method for a weakly compressible liquid: transfers between particles and a sparse background grid.

Its step as passes is `refsim.mpm.step`, its surface the effect of `refsim.surface_energy`.
Numbers in brackets are those of the thesis, and so are the errata M3 to M27 (docs/errata.md).
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from refsim.core.capabilities import (
    FACES,
    Face,
    HasErrata,
    HasPlanes,
    HoldsOtherMemory,
    JudgesStart,
    KnowsParticleMass,
    LimitsMassRatio,
    NeedsCellOrder,
    RunMonitor,
)
from refsim.core.checked import NotNegative, Positive, Printed
from refsim.core.effect import Discretisation, Effect, Field, InitialState, Others, Pass, StepLimit
from refsim.core.errors import InputError
from refsim.core.walls import WallParticles
from refsim.mpm.grid import Background, MpmGrid, blocks_at, grid_bytes
from refsim.mpm.limits import FARTHEST
from refsim.mpm.step import Step
from refsim.sph import LIQUID, acceleration_of
from refsim.sph.flow import at_least, fast_flow
from refsim.surface_energy import REACH
from refsim.surface_energy.effect import surface_of

AFFINE = Field("affine", "1/s", "affine velocity matrix A, row by row: A_ab is dv_a/dx_b", 9, state=True)
VOLUME_RATIO = Field("volume_ratio", "-", "present over initial volume J", state=True)
DEFORMATION = Field("deformation", "-", "deformation gradient F, row by row", 9, state=True)
CELL = Field("cell", "-", "number of the background grid's node at the base of the particle's stencil", dtype="int32")
CLUSTER_SHARE = Field("cluster_share", "-", "weight w = 1/(2 C + 1) of each point of the particle's cluster")
INVERSE_SPREAD = Field("inverse_spread", "-", "(h^2/4) D^-1 of the cluster: xx, xy, xz, yy, yz, zz", 6)
STEP_EXTREMES = Field(
    "step_extremes", "-, -, 1/s, m^2", "least and largest J, largest |tr A|, largest squared displacement in a step",
    rows=4, state=True,
)  # fmt: skip

READINGS = ("none", "cluster", "thesis", "gradient_corrected")
RULES = {"none": 0, "sticky": 1, "slip": 2, "separating": 3}
OPEN = 1 << 30
ALIGNED = 1e-3  # cells by which a face may lie before its node without a note
# Share of a particle's mass up to which a node stands still. Towards the edge of a spline mass falls with the square of
# the distance and the surface's force with the distance itself, so that 1e-12 drops an impulse of 1e-10 of m v now and
# then; in float32, whose products underflow, that is far below a rounding.
NEGLIGIBLE_MASS = {"float32": 1e-12, "float64": 1e-24}
# Share of the sound speed below which a node stands still, far below what a step of gravity adds: what runs ahead of
# the sound falls to subnormal numbers, with which some processors compute a hundred times as slowly.
NEGLIGIBLE_SPEED = {"float32": 1e-24, "float64": 1e-200}
LEAST_VOLUME, LARGEST_VOLUME = 0.2, 3.0
MASS_RATIO = 1000.0  # largest that was measured; the energy does not depend on the ratio (docs/stability.md)
LARGEST_DISPLACEMENT = 0.5  # cells that a particle may move in a step
LARGEST_DILATION = 0.5  # |dt tr A| of a step


class Liquid(NamedTuple):
    """Stress and volume update as the kernels take them."""

    rest_density: Any  # rho0 [kg/m^dim]
    stress: Any  # share of the stress that acts, times lambda [Pa]: 2 with thesis M27, 0 with thesis M7
    linear_stress: Any  # thesis M4: without the factor J
    unit_volume: Any  # thesis M3: V0 = 1
    timeless: Any  # thesis M5: dt = 1 s in the update of J or F


class Embedding(NamedTuple):
    """How embedded points are read: index in READINGS."""

    reading: Any  # how embedded points are read


class Counting(NamedTuple):
    """What a cell holds where the liquid is at rest."""

    cell_mass: Any  # rho0 h^dim [kg]


class ViscousStress(NamedTuple):
    """Viscous stress as the kernels take it."""

    factor: Any  # 4 mu/(rho0 h^2) [1/s]


class KernelGradient(NamedTuple):
    """Thesis M6 as printed: the liquid's force acts through grad B, not through the affine field."""

    on: Any  # 1: thesis M6 as printed


class WallNodes(NamedTuple):
    """Nodes in walls: coordinates j <= lower and j >= upper along each axis; rules of -x, +x, -y, +y, -z, +z."""

    lower: Any  # (3,) int32
    upper: Any  # (3,) int32
    rules: Any  # (6,) int32: see RULES


class MpmLiquid(
    Effect, KnowsParticleMass, LimitsMassRatio, NeedsCellOrder, HoldsOtherMemory, RunMonitor, HasErrata, JudgesStart,
    frozen=True, kw_only=True,
):  # fmt: skip
    """Weakly compressible liquid moved by the material point method (APIC, quadratic B-splines).

    rest_density     rho0 [kg/m^3; kg/m^2 in 2D]
    bulk_modulus     lambda [Pa]; the sound speed is its root over rho0
    dynamic_viscosity  mu [Pa s; N s/m in 2D] of the stress mu (grad v + grad v^T); the thesis's liquid has none
    cell_size        h of the background grid [m]; 0 takes two spacings, 2^dim particles to a cell
    initial_ratio    J of every particle at the start; below one for a drop that its surface tension compresses
    volume           "ratio" follows J alone (default), "full_gradient" F, as printed
    acoustic_number  share a of h/(c + |v|) that the step may have; at most 0.5
    literal          readings of the thesis: misprints "M3" (force without the volume), "M5" (F and J move without dt),
                     "M7" (particles take the nodal velocity of before the update, so that no force acts and no wall),
                     "M13" (A starts as the unit matrix), "M27" (twice the stress); its own choices "M4" (without the
                     factor J), "M6" (force through grad B); "paper" for its own choices, with volume "full_gradient",
                     "all" for every printed text
    """

    name: ClassVar[str] = "mpm_liquid"
    source: ClassVar[str] = "thesis"
    errata: ClassVar[tuple[str, ...]] = ("M3", "M4", "M5", "M6", "M7", "M13", "M27")
    improvements: ClassVar[tuple[str, ...]] = ("M4", "M6")
    paper: ClassVar[Mapping[str, Any]] = {"volume": "full_gradient"}
    of_liquid: ClassVar[bool] = True
    watched: ClassVar[tuple[str, ...]] = ("step_extremes",)
    with_spacing: ClassVar[tuple[str, ...]] = ("cell_size",)
    replaced: ClassVar[tuple[str, ...]] = ("sph.gravity",)

    rest_density: Positive = 1000.0
    bulk_modulus: Positive
    dynamic_viscosity: NotNegative = 0.0
    cell_size: NotNegative = 0.0
    initial_ratio: Positive = 1.0
    volume: Literal["ratio", "full_gradient"] = "ratio"
    acoustic_number: Positive = 0.3
    literal: Printed = ()

    def check(self, grid: Discretisation, others: Others) -> None:
        if self.acoustic_number > 0.5:
            raise InputError(
                f"{self.name}: acoustic_number = {self.acoustic_number} is near the limit of stability; give at most"
                " 0.5."
            )
        if not LEAST_VOLUME < self.initial_ratio < LARGEST_VOLUME:
            raise InputError(
                f"{self.name}: initial_ratio = {self.initial_ratio} is not possible; give a number between"
                f" {LEAST_VOLUME} and {LARGEST_VOLUME}."
            )
        if grid.spacing > self.cell(grid):
            raise InputError(
                f"{self.name}: cell_size = {self.cell_size} m is below one particle spacing ({grid.spacing} m), so that"
                " cells would be empty inside the liquid; give two spacings."
            )
        for other in (LIQUID, "box_walls"):
            if other in others:
                raise InputError(f"Effects {self.name!r} and {other!r} do not go together; keep one of them.")

    def cell(self, grid: Discretisation) -> float:
        """h [m]."""
        return self.cell_size or 2 * grid.spacing

    def particle_mass(self, grid: Discretisation) -> float:
        """m = rho0 d^dim [kg; kg/m in 2D]: the lattice fills space."""
        return self.rest_density * grid.spacing**grid.dim

    def starting_share(self) -> float:
        return self.initial_ratio

    def sound_speed(self) -> float:
        """c = sqrt(lambda/rho0) [m/s]."""
        return math.sqrt(self.bulk_modulus / self.rest_density)

    def fields(self, others: Others) -> tuple[Field, ...]:
        fields: tuple[Field, ...] = (AFFINE, VOLUME_RATIO, CELL, STEP_EXTREMES)
        fields += (DEFORMATION,) if self.volume != "ratio" else ()
        return fields + ((CLUSTER_SHARE, INVERSE_SPREAD) if self.step(others).embedded else ())

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        n, h = grid.count, self.cell(grid)
        far = np.flatnonzero(np.abs(state.position).max(1) > (FARTHEST - 2) * h)
        if len(far):
            raise InputError(
                f"{self.name}: particle {far[0]} is outside the background grid, which ends {FARTHEST} cells of {h:g} m"
                f" from the origin ({len(far)} such particles); move the liquid or take larger cells."
            )
        unit = np.tile(np.eye(3).ravel(), (n, 1))
        start = {
            "volume_ratio": np.full(n, self.initial_ratio),
            "step_extremes": np.array([self.initial_ratio, self.initial_ratio, 0.0, 0.0]),
        }
        if "M13" in self.printed():
            start["affine"] = unit * (np.arange(9) < 4 * grid.dim)
        if self.volume != "ratio":
            start["deformation"] = unit * self.initial_ratio ** (1 / grid.dim)
            if grid.dim == 2:
                start["deformation"][:, 8] = 1
        return start

    def sorting_cell(self, grid: Discretisation) -> float:
        return self.cell(grid)

    def other_memory(self) -> str:
        return "blocks that the background grid gains after the start"

    def bytes_at_start(
        self, grid: Discretisation, position: np.ndarray, others: Others, backend: str
    ) -> dict[str, int]:
        blocks = blocks_at(position, grid.dim, grid.dtype, self.cell(grid), backend)
        tension = self.step(others).tension
        size = grid_bytes(blocks, grid.count, grid.dim, grid.dtype, backend, tension)
        return {"background_grid": size}

    def step(self, others: Others) -> Step:
        """What a step consists of in this scene."""
        surface = surface_of(others)
        idle = "M7" in self.printed()  # forces reach no particle
        tension = surface is not None and not idle
        pushed = any("acceleration" in p.updates for e in others.values() if e is not self for p in e.passes(others))
        return Step(
            reading=None if surface is None else surface.embedding, tension=tension,
            viscous=self.dynamic_viscosity > 0 and not idle,
            deforms=self.volume != "ratio", accelerated=pushed and not idle,
            listed=any(e.list_radius(_ANY) > 0 for e in others.values()),
        )  # fmt: skip

    def passes(self, others: Others) -> tuple[Pass, ...]:
        return tuple(self.step(others).passes())

    def largest_mass_ratio(self, others: Others) -> float:
        return MASS_RATIO

    def background(self, grid: Discretisation) -> Background:
        """The background grid as kernels take it."""
        h = grid.real(self.cell(grid))
        layers, width = (3, 6) if grid.dim == 3 else (1, 10)
        return Background(
            h, np.float64(1.0 / float(h)), grid.real(4.0 / float(h) ** 2), np.int32(layers), np.int32(width),
            grid.real(NEGLIGIBLE_MASS[grid.dtype] * self.particle_mass(grid)),
            grid.real(NEGLIGIBLE_SPEED[grid.dtype] * self.sound_speed()),
        )  # fmt: skip

    def notes_on_start(
        self, grid: Discretisation, state: InitialState, walls: WallParticles | None, others: Others
    ) -> Iterator[str]:
        def advice(sound: float) -> str:
            return at_least("bulk_modulus", self.rest_density * sound**2, "Pa")

        pull = acceleration_of(others)
        return fast_flow(self.name, self.sound_speed(), advice, grid, state, walls, others, pull)

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        printed = self.printed()
        acceleration, surface = acceleration_of(others), surface_of(others)
        walls = next((effect for effect in others.values() if isinstance(effect, MpmWalls)), None)
        idle = "M7" in printed  # (4.12) to (4.14) with v^n: what makes v^(n+1) of it reaches no particle
        share = 0.0 if idle else 1.0
        pull = any(acceleration) and not idle
        planes = None if walls is None or idle or not walls.stand(grid) else walls.nodes(grid, self.cell(grid))
        return {
            "grid": MpmGrid(grid.dim, grid.dtype, self.cell(grid), reach=0 if surface is None else REACH),
            "background": self.background(grid),
            "liquid": Liquid(
                grid.real(self.rest_density), grid.real(share * self.bulk_modulus * (2 if "M27" in printed else 1)),
                np.int32("M4" in printed), np.int32("M3" in printed), np.int32("M5" in printed),
            ),
            "field": np.array(acceleration, dtype=grid.dtype) if pull else None,
            "planes": planes,
            "embedding": Embedding(np.int32(0 if surface is None else READINGS.index(surface.embedding))),
            "kernel_gradient": KernelGradient(np.int32(1)) if "M6" in printed else None,
            "viscous_stress": ViscousStress(grid.real(self._viscous_factor(grid))),
            "counting": Counting(grid.real(self.rest_density * self.cell(grid) ** grid.dim)),
        }  # fmt: skip

    def _viscous_factor(self, grid: Discretisation) -> float:
        """4 mu/(rho0 h^2) [1/s]."""
        return 4 * self.dynamic_viscosity / (self.rest_density * self.cell(grid) ** 2)

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        h = self.cell(grid)
        acoustic = StepLimit.crossing(self.acoustic_number * h, self.sound_speed())
        limits = {"acoustic": acoustic, "advection": StepLimit.crossing(0.3 * h)}
        if self.dynamic_viscosity > 0:  # half of the step in which a strain would vanish at once
            limits["viscous"] = StepLimit.constant(0.25 / self._viscous_factor(grid))
        if (pull := math.hypot(*acceleration_of(others))) > 0:
            limits["gravity"] = StepLimit.constant(math.sqrt(0.3 * h / pull))
        return limits

    def verdict(self, grid: Discretisation, seen: Mapping[str, np.ndarray], length: float) -> tuple[str, str] | None:
        least, most, rate, squared = (float(v) for v in seen["step_extremes"])
        h = self.cell(grid)
        if least < LEAST_VOLUME:
            return (
                "compressed",
                f"a particle is compressed to {least:.3g} of its volume, below {LEAST_VOLUME}: take a larger"
                " bulk_modulus or a smaller step, or no surface tension on parts so small.",
            )
        if most > LARGEST_VOLUME:
            return (
                "expanded",
                f"a particle is expanded to {most:.3g} times its volume, above {LARGEST_VOLUME}: particles have been"
                " torn apart or have lost their neighbours; take more of them or a smaller step.",
            )
        if length * rate > LARGEST_DILATION:
            return (
                "volume_jump",
                f"a particle's volume changed by {length * rate:.3g} of itself at once, more than {LARGEST_DILATION}:"
                " take a smaller step.",
            )
        if squared > (LARGEST_DISPLACEMENT * h) ** 2:
            return (
                "outrun",
                f"a particle moved by {math.sqrt(squared) / h:.3g} cells at once, more than"
                f" {LARGEST_DISPLACEMENT}: take a smaller step.",
            )
        return None


def mpm_liquid_of(others: Others) -> MpmLiquid:
    """The scene's liquid on the background grid; an effect that takes it has `mpm_liquid` among its needs."""
    return others[MpmLiquid.name]  # type: ignore[return-value]


class MpmWalls(Effect, HasPlanes, frozen=True, kw_only=True):
    """Walls of a box, as conditions on the nodes of the background grid on and beyond its faces.

    lower, upper      corners of the liquid's domain [m]; in 2D the z parts are ignored
    rule              on every face: "sticky" (v = 0), "slip" (n.v = 0), "separating" (no part into the wall)
    sticky_faces      faces that are sticky, whatever the rule, of "-x", "+x", "-y", "+y", "-z", "+z"
    slip_faces        faces that are slip
    separating_faces  faces that are separating
    open_faces        faces without wall
    """

    name: ClassVar[str] = "mpm_walls"
    places: ClassVar[tuple[str, ...]] = ("lower", "upper")
    needed: ClassVar[tuple[str, ...]] = ("mpm_liquid",)

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    rule: Literal["sticky", "slip", "separating"] = "separating"
    sticky_faces: tuple[Face, ...] = ()
    slip_faces: tuple[Face, ...] = ()
    separating_faces: tuple[Face, ...] = ()
    open_faces: tuple[Face, ...] = ()

    def check(self, grid: Discretisation, others: Others) -> None:
        chosen = (*self.sticky_faces, *self.slip_faces, *self.separating_faces, *self.open_faces)
        for face in chosen:
            if chosen.count(face) > 1:
                raise InputError(
                    f"{self.name}: face {face!r} cannot be given a rule like that; name each of {', '.join(FACES)} at"
                    " most once."
                )
        h = mpm_liquid_of(others).cell(grid) if MpmLiquid.name in others else grid.spacing
        for axis in range(grid.dim):
            low, high = self.lower[axis], self.upper[axis]
            if high - low < 3 * h:
                raise InputError(
                    f"{self.name}: along {'xyz'[axis]} the domain from {low} to {high} m is narrower than three cells"
                    f" ({3 * h:g} m); make it wider or the cells smaller."
                )

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        inside = mpm_liquid_of(others).cell(grid) * 1e-6 if MpmLiquid.name in others else 0.0
        self.check_inside(grid, state.position, inside)
        return {}

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        h = mpm_liquid_of(others).cell(grid)
        at = self.nodes(grid, h)
        faces = [
            (FACES[2 * axis + side], given[axis], node[axis] * h)
            for side, (given, node) in enumerate(((self.lower, at.lower), (self.upper, at.upper)))
            for axis in range(grid.dim)
            if at.rules[2 * axis + side] and abs(given[axis] - node[axis] * h) > ALIGNED * h
        ]
        return tuple(
            f"{self.name}: its face {face} at {given:.6g} m acts at the node beyond it, at {node:.6g} m"
            f" ({abs(given - node) / h:.2g} cells): give a multiple of the cell size, {h:.6g} m"
            for face, given, node in faces
        )

    def stand(self, grid: Discretisation) -> bool:
        """Whether any face has a wall."""
        return not set(FACES[: 2 * grid.dim]) <= set(self.open_faces)

    def nodes(self, grid: Discretisation, cell_size: float) -> WallNodes:
        """The nodes on and beyond each face, and its rule."""
        lower, upper, rules = np.full(3, -OPEN), np.full(3, OPEN), np.zeros(6)
        faces_of = {"sticky": self.sticky_faces, "slip": self.slip_faces, "separating": self.separating_faces}
        rule_of = {face: name for name, faces in (faces_of | {"none": self.open_faces}).items() for face in faces}
        for axis in range(grid.dim):
            lower[axis] = math.floor(self.lower[axis] / cell_size + 1e-6)
            upper[axis] = math.ceil(self.upper[axis] / cell_size - 1e-6)
            for side in (2 * axis, 2 * axis + 1):
                rules[side] = RULES[rule_of.get(FACES[side], self.rule)]
        return WallNodes(*(values.astype(np.int32) for values in (lower, upper, rules)))


_ANY = Discretisation(3, "float64", 1.0, 2.0, 0)  # for methods whose result does not depend on it
