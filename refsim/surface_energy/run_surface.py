"""The surface of a run: samples that the transfers take, and the reconstruction that renews them in each step."""

import copy
from typing import Any

from refsim.backends.arrays import Backend, Growing, growing
from refsim.core.errors import RunStopped
from refsim.surface_energy import Tension
from refsim.surface_energy.reconstruction import Reconstruction
from refsim.surface_energy.reference_reconstruction import ReferenceReconstruction

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
    """A `Reconstruction` on backend "cpu", its counterparts on "numpy" and "cuda".

    timed   measure each stage, waiting for the device after it; not on "numpy"
    reused  the next surface overwrites the arrays of the last one: on a GPU it is then one recorded graph
    """
    if backend.name == "numpy":
        return ReferenceReconstruction(dim, dtype, cell_size, tension)
    if backend.name == "cuda":
        from refsim.surface_energy.recorded import DeviceReconstruction

        return DeviceReconstruction(backend, dim, dtype, cell_size, tension, timed, reused and not timed)
    return Reconstruction(backend, dim, dtype, cell_size, tension, timed)


class SurfaceSamples:
    """Samples on one backend, replaced in each step by those of the new surface (`assign`).

    sample_position (s, 3) [m], sample_normal (s, 3) outward, sample_area (s,) [m^(d-1)], sample_nearest (s,) int32,
    the particle nearest to each, -1 where there is no sample but capacity; carrier_... of the 2 s embedded points, by
    owner: carrier_first (n + 1), carrier_position (2 s, 3) [m], carrier_owner (2 s,), carrier_moment (2 s, 12).

    version  is another one whenever the samples stand in other arrays
    """

    version = 0

    def __init__(self, count: int, dtype: str, backend: Backend) -> None:
        self.count, self.dtype, self.backend = count, dtype, backend
        self.arrays = Growing(backend)
        self._taken: tuple[Any, ...] = (None,) * 4
        none = backend.zeros
        self.assign(none((0, 3), dtype), none((0, 3), dtype), none(0, dtype), none(0, "int32"))

    def assign(self, position: Any, normal: Any, area: Any, nearest: Any) -> None:
        """Take the samples of this step: arrays of this backend."""
        taken = position, normal, area, nearest
        self.version += any(a is not b for a, b in zip(taken, self._taken, strict=True))
        self._taken = taken
        self.sample_position, self.sample_normal, self.sample_area, self.sample_nearest = taken

    @property
    def points(self) -> int:
        """Number of embedded points, 2 s."""
        return 2 * int(self.sample_position.shape[0])

    carrier_first = growing(
        "First embedded point of each particle, and the end (n + 1,)", "first", lambda own: (own.count + 1,), "int32"
    )
    carrier_position = growing(
        "Embedded points (2 s, 3) [m], by owner: a sample, then its mirror image", "position",
        lambda own: (own.points, 3),
    )  # fmt: skip
    carrier_owner = growing("The particle that each is around (2 s,)", "owner", lambda own: (own.points,), "int32")
    carrier_moment = growing(
        "Sums of B v (3) and B v (x_j - x_q)^T (9) of each (2 s, 12)", "moment", lambda own: (own.points, 12)
    )


class SurfaceOfRun(SurfaceSamples):
    """The reconstruction of a run's surface, and its latest samples.

    full    particles of a full cell
    latest  all that the latest reconstruction made; None before the first
    """

    def __init__(
        self, tension: Tension, dim: int, dtype: str, cell_size: float, count: int, full: float, rest_density: float
    ) -> None:
        super().__init__(count, dtype, Backend("numpy"))
        self.tension, self.dim, self.cell_size, self.full = tension, dim, cell_size, full
        self.rest_density = rest_density
        self.reconstruction: Any = None
        self.latest: Any = None

    def on_backend(self, backend: Backend) -> "SurfaceOfRun":
        """The same, ready to work, on another backend."""
        made = copy.copy(self)
        SurfaceSamples.__init__(made, self.count, self.dtype, backend)
        made.reconstruction = reconstruction_on(
            backend, self.dim, self.dtype, self.cell_size, self.tension, reused=True
        )
        return made

    @property
    def term(self) -> Any:
        """Parameter group of the surface's kernels."""
        return self.reconstruction.term

    def reconstruct_enclosing(self, position: Any, identity: Any, mass: Any, volume_ratio: Any) -> int:
        """The surface of particles at `position` (n, 3) [m] that encloses their volume, sum m J/rho0."""
        xp, to_xp, _ = self.backend.array_library()
        return self.reconstruct(position, identity, to_xp(mass).astype(xp.float64) * to_xp(volume_ratio))

    def reconstruct(self, position: Any, identity: Any, held: Any = None) -> int:
        """The surface of particles at `position` (n, 3) [m], with m J [kg] of each to enclose their volume; `version`.

        Of equally near particles the one with the lowest `identity` (n,) is taken, however they are sorted.

        Raises RunStopped where a cell holds more particles than any volume ratio that a run survives could explain: J
        follows the divergence of the velocity and does not see particles that gather on a line or in a point.
        """
        volume = None if held is None else float(held.sum()) / self.rest_density
        self.latest = self.reconstruction.surface(position, volume=volume, number=identity)
        most = self.reconstruction.most_in_a_cell(self.latest)
        if most > CLUMPED * self.full:
            raise RunStopped(
                "clumped", f"{most} particles have gathered in one cell, which holds {self.full:.3g}: {GATHERED}"
            )
        if not self.reconstruction.finds_all(self.latest):
            raise RunStopped(
                "diverged",
                "A part of the reconstructed surface has no particle within two cells: particles fly apart; take a"
                " smaller step, or an inset and the embedding 'cluster'.",
            )
        samples = self.latest.padded or self.latest.samples
        self.assign(samples.position, samples.normal, samples.area, samples.nearest)
        return self.version
