"""Surface energy of the liquid of the material point method: the effect `surface_energy`, and the surface of a run.

The passes of the transfers that the surface takes part in are those of `refsim.mpm`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np

from refsim.backends.arrays import Backend, Growing, growing
from refsim.core.capabilities import HasTension, HoldsOtherMemory, RunMonitor
from refsim.core.checked import Positive
from refsim.core.effect import Discretisation, Field, InitialState, Others, Pass, StepLimit
from refsim.core.errors import InputError, RunStopped
from refsim.core.operation import REGISTRY, Procedure, enter
from refsim.surface_energy import Tension
from refsim.surface_energy.reconstruction import Reconstruction

CROWDING = Field("crowding", "-", "density counted on the grid times J, over the rest density")
GREATEST_CROWDING = Field("greatest_crowding", "-", "largest crowding of the particles", rows=1)
# Crowding is 1.000 in a lattice, however it is turned. Of particles strewn at random, each within its own share of the
# volume, it is 1.01 with a deviation of 0.04 in the plane, 1.00 with 0.02 in space, and in none of 14,000 above 1.2; of
# particles strewn without shares none is above 2 (`tests/mpm/test_mpm.py:test_crowding_of_particles_strewn_at_random`).
CROWDED = 1.25  # above, particles are denser than by chance
OVERFULL = 2.0  # above, a force has drawn them together
# Step of a surface that stays at r, over min(h/c, sqrt(rho0 h^3/(2 pi k))): with nothing embedded, and of a liquid that
# is soft against its surface, k > SOFT lambda h; two thirds of the least that was measured (docs/stability.md)
AT_R_ALONE, AT_R_SOFT, SOFT = 0.08, 0.03, 0.1


class SurfaceEnergy(Tension, HasTension, HoldsOtherMemory, RunMonitor, frozen=True, kw_only=True):
    """Surface tension of an MPM liquid: its surface is reconstructed in each step and pulls on the grid.

    embedding         how points are embedded for the samples: "cluster" (default), "thesis", "gradient_corrected" or
                      "none"
    capillary_number  share b of sqrt(rho h^3/(2 pi k)) that the step may have; the limit of stability is 0.75
    """

    name: ClassVar[str] = "surface_energy"
    scales: ClassVar[tuple[str, ...]] = ("surface_tension",)
    paper: ClassVar[Mapping[str, Any]] = {"embedding": "thesis"}
    needed: ClassVar[tuple[str, ...]] = ("mpm_liquid",)
    watched: ClassVar[tuple[str, ...]] = ("greatest_crowding",)
    host_passes: ClassVar[tuple[str, ...]] = ("surface_energy.reconstruct",)

    embedding: Literal["none", "cluster", "thesis", "gradient_corrected"] = "cluster"
    capillary_number: Positive = 0.3

    def acting_tension(self, grid: Discretisation, others: Others) -> tuple[float, str]:
        return self.surface_tension, "energy of the surface"

    def other_memory(self) -> str:
        return "nodes, facets and samples of the surface"

    def check(self, grid: Discretisation, others: Others) -> None:
        self.check_parameters(grid.dim)
        foreign = self.embedding in ("thesis", "gradient_corrected")
        if foreign and self.acts() and self.inset_distance() is None and not grid.step:
            raise InputError(
                f"{self.name}: embedding = {self.embedding!r} with the surface at r is stable with no step; give"
                " the scene a step of its own to see how it ends, or take an inset or the cluster."
            )

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        least = self.least_component(grid.dim)
        if grid.count < least:
            raise InputError(
                f"{self.name}: {grid.count} particles do not resolve a body whose surface has tension, which takes"
                f" {least}; take smaller cells and more particles, or set smallest."
            )
        liquid: Any = others["mpm_liquid"]
        cell = liquid.cell(grid)
        filled = grid.count * (grid.spacing / cell) ** grid.dim
        if filled < least / 2**grid.dim:
            raise InputError(
                f"{self.name}: cells of {cell:g} m do not resolve the body, which fills {filled:.2g} of them and must"
                f" fill {least / 2**grid.dim:.3g}; take a smaller cell_size."
            )
        return {}

    def fields(self, others: Others) -> tuple[Field, ...]:
        return CROWDING, GREATEST_CROWDING

    def passes(self, others: Others) -> tuple[Pass, ...]:
        volume = ("mass", "volume_ratio")
        reads = ("position", "identity", *(volume if self.enclose_volume else ()))
        lacking = {} if self.enclose_volume else dict.fromkeys(volume)
        return (Pass(self.host_passes[0], reads, ("samples",), names=lacking, stage="motion"),)

    def shares(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        liquid: Any = others["mpm_liquid"]
        cell = liquid.cell(grid)
        full = (cell / grid.spacing) ** grid.dim
        return {"surface": SurfaceOfRun(self, grid.dim, grid.dtype, cell, grid.count, full, liquid.rest_density)}

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        """Readings that are there to compare with, and were seen to be unstable (docs/stability.md)."""
        said = []
        if self.embedding in ("thesis", "gradient_corrected"):
            said.append(
                f"surface_energy: embedding = {self.embedding!r} is there to compare with: it loses momentum and may"
                " be unstable with any step; take 'cluster'."
            )
        if self.inset_distance() is None:
            said.append(
                "surface_energy: without an inset the surface stands at r from the particles and presses too hard; with"
                " nothing embedded or a soft liquid the step is down to a tenth of the usual one. Take inset = 0.25."
            )
        return tuple(said)

    def verdict(self, grid: Discretisation, seen: Mapping[str, np.ndarray], length: float) -> tuple[str, str] | None:
        crowding = float(seen["greatest_crowding"][0])
        if crowding > OVERFULL:
            return (
                "clumped",
                f"the grid counts {crowding:.3g} times the liquid that a particle's volume ratio implies, more than"
                f" {OVERFULL:g}: {GATHERED}",
            )
        return None

    def warning(self, grid: Discretisation, seen: Mapping[str, np.ndarray]) -> str | None:
        crowding = float(seen["greatest_crowding"][0])
        if crowding > CROWDED:
            return (
                f"the grid counts {crowding:.3g} times the liquid that a particle's volume ratio implies, more than"
                f" {CROWDED:g}: shape and pressure are no longer to be trusted, and the run may stop as clumped."
                " dynamic_viscosity keeps particles apart."
            )
        return None

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        liquid: Any = others["mpm_liquid"]
        period = math.sqrt(liquid.rest_density * liquid.cell(grid) ** 3 / (2 * math.pi * self.surface_tension))
        limits = {"capillary": StepLimit.constant(self.capillary_number * period)}
        h, alone = liquid.cell(grid), self.embedding == "none"
        soft = self.surface_tension > SOFT * liquid.bulk_modulus * h
        if self.inset_distance() is None and (soft or alone):
            share = AT_R_SOFT if soft else AT_R_ALONE
            limits["surface_at_r"] = StepLimit.constant(share * min(h / liquid.sound_speed(), period))
        return limits


def surface_of(others: Others) -> SurfaceEnergy | None:
    """The scene's surface with tension, or None."""
    return others.get(SurfaceEnergy.name)  # type: ignore[return-value]


_STAGES = tuple(name for name in REGISTRY if name.startswith("surface_energy."))
_TAKEN = ("position", "identity", "mass", "volume_ratio")
enter(Procedure("surface_energy.reconstruct", "surface", "reconstruct", _TAKEN, _STAGES))


CLUMPED = 4.0  # times the particles of a full cell in one cell: J would have to be below a quarter to represent it
# Why J does not notice, and what helps
GATHERED = (
    "J follows the velocity's divergence over a cell and more, not particles that draw nearer within one, as they do at"
    " once in a film or a filament of one or two of them, and sooner or later at a surface that swings. Take smaller"
    " cells and more particles across a film; for a body dynamic_viscosity, or a smaller step."
)


def reconstruction_on(
    backend: Backend, dim: int, dtype: str, cell_size: float, tension: Tension, timed: bool = False,
    reused: bool = False,
) -> Any:  # fmt: skip
    """A `Reconstruction` on a backend; its counterpart on "cuda".

    timed   measure each stage, waiting for the device after it
    reused  the next surface overwrites the arrays of the last one: on a GPU it is then one recorded graph
    """
    if backend.name == "cuda":
        from refsim.surface_energy.recorded import DeviceReconstruction

        return DeviceReconstruction(backend, dim, dtype, cell_size, tension, timed, reused and not timed)
    return Reconstruction(backend, dim, dtype, cell_size, tension, timed)


@dataclass(eq=False)
class SurfaceOfRun:
    """The reconstruction of a run's surface, and its samples, replaced in each step by those of the new surface.

    sample_position (s, 3) [m], sample_normal (s, 3) outward, sample_area (s,) [m^(d-1)], sample_nearest (s,) int32,
    the particle nearest to each, -1 where there is no sample but capacity; carrier_... of the 2 s embedded points, by
    owner: carrier_first (n + 1), carrier_position (2 s, 3) [m], carrier_owner (2 s,), carrier_moment (2 s, 12).

    full            particles of a full cell
    latest          all that the latest reconstruction made; None before the first
    reconstruction  on a backend where the surface is ready to work
    version         is another one whenever the samples stand in other arrays
    """

    tension: Tension
    dim: int
    dtype: str
    cell_size: float
    count: int
    full: float
    rest_density: float
    backend: Backend = field(default_factory=partial(Backend, "numpy"))
    reconstruction: Any = None
    latest: Any = None
    version = 0

    def __post_init__(self) -> None:
        self.arrays = Growing(self.backend)
        self._taken: tuple[Any, ...] = (None,) * 4
        none = self.backend.zeros
        self._assign(none((0, 3), self.dtype), none((0, 3), self.dtype), none(0, self.dtype), none(0, "int32"))

    def _assign(self, *taken: Any) -> None:
        """Take the samples of this step: positions, normals, areas and nearest particles on this backend."""
        self.version += any(a is not b for a, b in zip(taken, self._taken, strict=True))
        self._taken = taken
        self.sample_position, self.sample_normal, self.sample_area, self.sample_nearest = taken
        self.samples = int(self.sample_position.shape[0])

    carrier_first = growing(
        "First embedded point of each particle, and the end (n + 1,)", "first", lambda own: (own.count + 1,), "int32"
    )
    carrier_position = growing(
        "Embedded points (2 s, 3) [m], by owner: a sample, then its mirror image", "position",
        lambda own: (2 * own.samples, 3),
    )  # fmt: skip
    carrier_owner = growing("The particle that each is around (2 s,)", "owner", lambda own: (2 * own.samples,), "int32")
    carrier_moment = growing(
        "Sums of B v (3) and B v (x_j - x_q)^T (9) of each (2 s, 12)", "moment", lambda own: (2 * own.samples, 12)
    )

    def on_backend(self, backend: Backend) -> "SurfaceOfRun":
        """The same, ready to work, on another backend."""
        made = reconstruction_on(backend, self.dim, self.dtype, self.cell_size, self.tension, reused=True)
        return replace(self, backend=backend, reconstruction=made)

    @property
    def term(self) -> Any:
        """Parameter group of the surface's kernels."""
        return self.reconstruction.term

    def reconstruct(self, position: Any, identity: Any, mass: Any, volume_ratio: Any) -> int:
        """The surface of particles at `position` (n, 3) [m], that encloses sum m J/rho0 if these are given; `version`.

        Of equally near particles the one with the lowest `identity` (n,) is taken, however they are sorted.

        Raises RunStopped where a cell holds more particles than any volume ratio that a run survives could explain: J
        follows the divergence of the velocity and does not see particles that gather on a line or in a point.
        """
        xp, to_xp, _ = self.backend.array_library()
        volume = None
        if mass is not None:
            volume = float((to_xp(mass).astype(xp.float64) * to_xp(volume_ratio)).sum()) / self.rest_density
        self.latest = self.reconstruction.surface(position, volume=volume, number=identity)
        most = self.latest.most_in_a_cell
        if most > CLUMPED * self.full:
            raise RunStopped(
                "clumped", f"{most} particles have gathered in one cell, which holds {self.full:.3g}: {GATHERED}"
            )
        if self.latest.unfound:
            raise RunStopped(
                "diverged",
                "A part of the reconstructed surface has no particle within two cells: particles fly apart; take a"
                " smaller step, or an inset and the embedding 'cluster'.",
            )
        samples = self.latest.padded or self.latest.samples
        self._assign(samples.position, samples.normal, samples.area, samples.nearest)
        return self.version
