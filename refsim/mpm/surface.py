"""The surface of an MPM liquid in a run: the effect `surface_energy`, and what holds its samples from step to step."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core.effect import Discretisation, Effect, Pass, StepLimit, literal_errata, require
from refsim.core.energy import Amount, EnergyAccount, EnergyState, amount
from refsim.core.errors import InputError, RunStopped
from refsim.core.fields import Field
from refsim.core.operation import REGISTRY, Operation, Procedure, enter, register
from refsim.isosurface import Mesh
from refsim.mpm import CROWDED, CROWDING, GREATEST_CROWDING, OVERFULL
from refsim.surface_energy import Tension
from refsim.surface_energy.reconstruction import Samples

if TYPE_CHECKING:
    from refsim.core.effect import InitialState

EXTENT = Field("extent", "-", "axes along which the liquid round a particle spreads; 1 in a filament", dtype="uint8")
IMAGED = 5.0  # cells from a wall within which particles have an image: further than any sample at it can tell
# Step of a surface that stays at r, over min(h/c, sqrt(rho0 h^3/(2 pi k))): with nothing embedded, and of a liquid that
# is soft against its surface, k > SOFT lambda h; two thirds of the least that was measured (docs/stability.md)
AT_R_ALONE, AT_R_SOFT, SOFT = 0.08, 0.03, 0.1
# How J comes not to know, and what helps
_GATHERED = (
    "J follows the velocity's divergence over a cell and more, not particles that draw nearer within one, as they do at"
    " once in a film or a filament of one or two of them, and sooner or later at a surface that swings. Take smaller"
    " cells and more particles across a film; for a body dynamic_viscosity, a smaller step, or recount_time."
)
CLUMPED = 4.0  # times the particles of a full cell in one cell: J would have to be below a quarter to know of it


class Face(NamedTuple):
    """A wall in which the liquid is mirrored, a plane of nodes."""

    axis: int
    plane: Any  # [m]
    inward: int  # 1 or -1, along the axis, towards the liquid


class SurfaceEnergy(Effect, frozen=True, kw_only=True):
    """Surface tension of an MPM liquid: its surface is reconstructed in each step and pulls on the grid.

    surface_tension   k [N/m] (in the plane N, per metre of depth)
    embedding         how points are embedded for the samples: "cluster" (default), "thesis", "gradient_corrected" or
                      "none"
    contact_angle     of the liquid on the walls of `mpm_walls` [degrees], which then mirror it; 180 leaves the surface
                      along walls as it is
    capillary_number  share b of sqrt(rho h^3/(2 pi k)) that the step may have; the limit of stability is 0.75
    level_set_radius  r of the spheres round the particles, in cells; by default sqrt(dim)
    quadrature        "facets": a sample to each facet; "poisson": Poisson-disk samples
    disk_radius       least distance of Poisson-disk samples, in cells, at most 1
    seed              of the Poisson-disk samples
    offset            epsilon of the fit, in cells
    iterations        sweeps of the fit
    relaxation        omega of the fit, between 0 and 2
    normals           "mls" (3.17), "gradient" (3.9), or, to compare, "facets" and "offsets"
    inset             distance of the liquid's surface from its outermost particles, in cells: the surface is pulled
                      back to it; a negative one leaves it at r
    enclose_volume    the inset is the distance at which the surface encloses the liquid's present volume; `inset` is
                      not used. One distance for all of the surface
    smallest          particles of the smallest component that bears tension; 0 takes 3^dim
    recount_time      time [s] in which J follows the density that the grid counts, where that is more than 1.05 times
                      what J tells; 0 (default) never
    literal           printed readings to use: "M1" (the force's sign), "M14" (Algorithm 2), "M31" (the surface at r),
                      "M32" (15 cases); or "all"
    """

    name: ClassVar[str] = "surface_energy"
    surface_tension: float
    embedding: Literal["none", "cluster", "thesis", "gradient_corrected"] = "cluster"
    contact_angle: float = 180.0
    capillary_number: float = 0.3
    level_set_radius: float | None = None
    quadrature: Literal["facets", "poisson"] = "facets"
    disk_radius: float = 0.5
    seed: int = 0
    offset: float = 0.5
    iterations: int = 10
    relaxation: float = 1.0
    normals: Literal["mls", "gradient", "facets", "offsets"] = "mls"
    inset: float = 0.25
    enclose_volume: bool = False
    smallest: int = 0
    recount_time: float = 0.0
    literal: tuple[str, ...] = ()

    @property
    def host_in_step(self) -> bool:
        """Whether the surface is reconstructed, for which the host is needed."""
        return self.acts()

    @property
    def watched(self) -> tuple[str, ...]:
        """The largest crowding, where there is a surface."""
        return ("greatest_crowding",) if self.acts() else ()

    def acts(self) -> bool:
        """Whether there is tension; else nothing is reconstructed, embedded or mirrored."""
        return self.surface_tension > 0

    def needs(self) -> tuple[str, ...]:
        return ("mpm_liquid",)

    def beside_fields(self) -> str:
        return "" if not self.acts() else "nodes, facets and samples of the surface"

    def check(self, grid: Discretisation, others: Mapping[str, Effect]) -> None:
        self.tension().check(grid.dim)
        require(
            self.name,
            capillary_number=(self.capillary_number, "positive"),
            recount_time=(self.recount_time, "not negative"),
        )
        if self.embedding not in ("none", "cluster", "thesis", "gradient_corrected"):
            raise InputError(
                f"{self.name}: embedding = {self.embedding!r} is not known; give cluster, thesis, gradient_corrected or"
                " none."
            )
        if not 0 <= self.contact_angle <= 180:
            raise InputError(
                f"{self.name}: contact_angle = {self.contact_angle} is not possible; give 0 to 180 degrees."
            )
        foreign = self.embedding in ("thesis", "gradient_corrected")
        if foreign and self.surface_tension > 0 and self.tension().inset_distance() is None and not grid.step:
            raise InputError(
                f"{self.name}: embedding = {self.embedding!r} with the surface at r is stable with no step; give"
                " the scene a step of its own to see how it ends, or take an inset or the cluster."
            )
        if self.contact_angle != 180 and "mpm_walls" not in others:
            raise InputError(
                f"{self.name}: contact_angle = {self.contact_angle} needs a wall; add mpm_walls or leave it out."
            )

    def tension(self) -> Tension:
        """Parameters of the reconstruction."""
        printed = literal_errata(self.name, self.literal, ("M1", "M14", "M31", "M32"))
        own = ("surface_tension", "level_set_radius", "quadrature", "disk_radius", "seed", "offset", "iterations")
        return Tension(
            **{name: getattr(self, name) for name in (*own, "relaxation", "normals", "enclose_volume")},
            inset=self.inset if self.inset >= 0 else None,
            smallest=self.smallest or None,
            literal=tuple(sorted(printed)),
        )

    def initial(
        self, grid: Discretisation, state: InitialState, others: Mapping[str, Effect]
    ) -> Mapping[str, np.ndarray]:
        if not self.acts():
            return {}
        least = self.tension().least_component(grid.dim)
        if grid.count < least:
            raise InputError(
                f"{self.name}: {grid.count} particles do not resolve a body whose surface bears tension, which takes"
                f" {least}; take smaller cells and more particles, or set smallest."
            )
        cell = others["mpm_liquid"].cell(grid)  # type: ignore[attr-defined]
        filled = grid.count * (grid.spacing / cell) ** grid.dim
        if filled < least / 2**grid.dim:
            raise InputError(
                f"{self.name}: cells of {cell:g} m do not resolve the body, which fills {filled:.2g} of them and must"
                f" fill {least / 2**grid.dim:.3g}; take a smaller cell_size."
            )
        return {}

    def fields(self, others: Mapping[str, Effect]) -> tuple[Field, ...]:
        if not self.acts():
            return ()
        crowding = replace(CROWDING, state=self.recount_time > 0)  # the next step begins with it
        return EXTENT, crowding, GREATEST_CROWDING

    def passes(self, others: Mapping[str, Effect]) -> tuple[Pass, ...]:
        if not self.acts():
            return ()
        found = [Pass("surface_energy.reconstruct", ("position",), ("samples",), stage="motion")]
        if self.enclose_volume:
            reads = ("position", "mass", "volume_ratio")
            found = [Pass("surface_energy.reconstruct_enclosing", reads, ("samples",), stage="motion")]
        found.append(Pass("surface_energy.find_filaments", ("position",), ("extent",), on_demand=True))
        return tuple(found)

    def wets(self, others: Mapping[str, Effect]) -> bool:
        """Whether walls have a contact angle."""
        return self.contact_angle != 180 and "mpm_walls" in others

    def contact_pull(self) -> float:
        """k cos(theta) [N/m; N in the plane]: what a wall pulls at the edge of the wetted area (Young)."""
        share = math.cos(math.radians(self.contact_angle)) if self.contact_angle != 90 else 0.0
        return share * self.surface_tension

    def _faces(self, grid: Discretisation, others: Mapping[str, Effect]) -> tuple[Face, ...]:
        """The walls with a contact angle, as planes of nodes."""
        if not self.wets(others):
            return ()
        real = np.dtype(grid.dtype).type
        cell = others["mpm_liquid"].cell(grid)  # type: ignore[attr-defined]
        nodes = others["mpm_walls"].nodes(grid, cell)  # type: ignore[attr-defined]
        made = []
        for axis in range(grid.dim):
            for side, node in enumerate((nodes.lower[axis], nodes.upper[axis])):
                if nodes.rules[2 * axis + side]:
                    made.append(Face(axis, real(cell) * real(node), 1 - 2 * side))
        return tuple(made)

    def energy(self, grid: Discretisation, others: Mapping[str, Effect]) -> EnergyAccount:
        """k times the area of the reconstructed surface, less k cos(theta) times that of the wetted walls (Young)."""
        if not self.acts():
            return EnergyAccount()
        dim, pull, wets = grid.dim, self.contact_pull(), self.wets(others)

        def surface(state: EnergyState) -> Amount:
            made, mass = state.shared("surface"), state.array("mass")
            if self.enclose_volume:
                made.reconstruct_enclosing(state.array("position"), mass, state.array("volume_ratio"))
            else:
                made.reconstruct(state.array("position"))
            found = amount(self.surface_tension * state.host(made.sample_area))
            if not (wets and pull):
                return found
            # by the divergence theorem the lines at the edge give dim - 1 times the wetted area
            place, line = state.host(made.sample_position), state.host(made.sample_line)
            wetted = amount(-pull * (place * line).sum(1) / (dim - 1))
            return Amount(found.value + wetted.value, found.size + wetted.size)

        return EnergyAccount(
            {"surface": surface}, ("what the surface's fitted normals pull beside the change of its area",)
        )

    def shares(self, grid: Discretisation, others: Mapping[str, Effect]) -> dict[str, Any]:
        if not self.acts():
            return {}
        cell = others["mpm_liquid"].cell(grid)  # type: ignore[attr-defined]
        full, density = (cell / grid.spacing) ** grid.dim, others["mpm_liquid"].rest_density  # type: ignore[attr-defined]
        faces = self._faces(grid, others)
        made = SurfaceOfRun(
            self.tension(), grid.dim, grid.dtype, cell, grid.count, full, density, faces, self.contact_pull() != 0
        )
        return {"surface": made}

    def notes(self, grid: Discretisation, others: Mapping[str, Effect]) -> tuple[str, ...]:
        """Readings that are there to compare with, and were seen to be unstable (docs/stability.md)."""
        said = []
        if self.surface_tension > 0 and self.embedding in ("thesis", "gradient_corrected"):
            said.append(
                f"surface_energy: embedding = {self.embedding!r} is there to compare with: it loses momentum and may"
                " be unstable with any step; take 'cluster'."
            )
        if self.surface_tension > 0 and self.tension().inset_distance() is None:
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
                f"the grid counts {crowding:.3g} times the liquid that a particle's volume ratio tells of, more than"
                f" {OVERFULL:g}: {_GATHERED}",
            )
        return None

    def remark(self, grid: Discretisation, seen: Mapping[str, np.ndarray]) -> str | None:
        crowding = float(seen["greatest_crowding"][0])
        if crowding > CROWDED:
            return (
                f"the grid counts {crowding:.3g} times the liquid that a particle's volume ratio tells of, more than"
                f" {CROWDED:g}: shape and pressure are no longer to be trusted, and the run may stop as clumped."
                " dynamic_viscosity keeps particles apart, and so does recount_time, for ten steps, say."
            )
        return None

    def step_limits(self, grid: Discretisation, others: Mapping[str, Effect]) -> dict[str, StepLimit]:
        if self.surface_tension == 0:
            return {}
        liquid = others["mpm_liquid"]
        period = math.sqrt(liquid.rest_density * liquid.cell(grid) ** 3 / (2 * math.pi * self.surface_tension))  # type: ignore[attr-defined]
        limits = {"capillary": StepLimit.constant(self.capillary_number * period)}
        h, alone = liquid.cell(grid), self.embedding == "none"  # type: ignore[attr-defined]
        soft = self.surface_tension > SOFT * liquid.bulk_modulus * h  # type: ignore[attr-defined]
        if self.tension().inset_distance() is None and (soft or alone):
            share = AT_R_SOFT if soft else AT_R_ALONE
            limits["surface_at_r"] = StepLimit.constant(share * min(h / liquid.sound_speed(), period))  # type: ignore[attr-defined]
        return limits


class SurfaceSamples:
    """Samples on one backend, replaced in each step by whoever reconstructs the surface (`assign`).

    sample_position (s, 3) [m], sample_normal (s, 3) outward, sample_area (s,) [m^(d-1)], sample_nearest (s,) int32,
    the particle nearest to each; sample_line (s, 3) [m^(d-2)], on the edge of a wetted area its outward normal in the
    wall times its length, None without contact angles; carrier_... of the 2 s embedded points, by owner:
    carrier_first (n + 1), carrier_position (2 s, 3) [m], carrier_owner (2 s,), carrier_moment (2 s, 12).
    """

    def __init__(self, count: int, dtype: str, backend: Backend) -> None:
        self.count, self.dtype, self.backend = count, dtype, backend
        self._storage: dict[str, Any] = {}
        self._views: dict[str, Any] = {}
        none = backend.zeros
        self.assign(none((0, 3), dtype), none((0, 3), dtype), none(0, dtype), none(0, "int32"))

    def assign(self, position: Any, normal: Any, area: Any, nearest: Any, line: Any = None) -> None:
        """Take the samples of this step: arrays of this backend."""
        self.sample_position, self.sample_normal, self.sample_area = position, normal, area
        self.sample_nearest, self.sample_line = nearest, line

    @property
    def carrier_first(self) -> Any:
        """First embedded point of each particle, and the end (n + 1,)."""
        return self._array("first", (self.count + 1,), "int32")

    @property
    def carrier_position(self) -> Any:
        """Embedded points (2 s, 3) [m], by owner: a sample, then its mirror image."""
        return self._array("position", (2 * self.sample_position.shape[0], 3), self.dtype)

    @property
    def carrier_owner(self) -> Any:
        """The particle that each is embedded around (2 s,)."""
        return self._array("owner", (2 * self.sample_position.shape[0],), "int32")

    @property
    def carrier_moment(self) -> Any:
        """Sums of B v (3) and B v (x_j - x_q)^T (9) of each (2 s, 12)."""
        return self._array("moment", (2 * self.sample_position.shape[0], 12), self.dtype)

    def _array(self, name: str, shape: tuple[int, ...], dtype: Any) -> Any:
        view = self._views.get(name)
        if view is None or view.shape != shape:
            held = self._storage.get(name)
            if held is None or held.shape[0] < shape[0]:
                room = (shape[0] + shape[0] // 4, *shape[1:])
                held = self._storage[name] = self.backend.empty(room, np.dtype(dtype))
            view = self._views[name] = held[: shape[0]]
        return view


class SurfaceOfRun(SurfaceSamples):
    """The reconstruction of a run's surface, and its latest samples.

    full    particles of a full cell
    faces   walls that mirror the liquid
    edges   the edges of wetted areas are samples, too
    latest  all that the latest reconstruction made; None before the first. Beside mirrors meshes and samples are those
            of the free surface, with the edges of wetted areas as samples without area
    """

    def __init__(
        self, tension: Tension, dim: int, dtype: str, cell_size: float, count: int, full: float, rest_density: float,
        faces: tuple[Face, ...] = (), edges: bool = False, backend: Backend | None = None,
    ) -> None:  # fmt: skip
        super().__init__(count, dtype, backend or Backend("numpy"))
        self.tension, self.dim, self.cell_size, self.full = tension, dim, cell_size, full
        self.rest_density, self.faces, self.edges = rest_density, faces, edges
        self.reconstruction: Any = None
        self.latest: Any = None

    def on_backend(self, backend: Backend) -> SurfaceOfRun:
        """The same, ready to work, on another backend."""
        from refsim.surface_energy.reconstruction import Reconstruction

        if backend.name == "numpy":
            raise InputError(
                "surface_energy: backend 'numpy' has its operations one by one, but no whole reconstruction; take 'cpu'"
                " or 'cuda'."
            )
        made = SurfaceOfRun(
            self.tension, self.dim, self.dtype, self.cell_size, self.count, self.full, self.rest_density, self.faces,
            self.edges, backend,
        )  # fmt: skip
        # with images the number of particles is another one in each step
        made.reconstruction = Reconstruction(
            backend, self.dim, self.dtype, self.cell_size, self.tension, reused=not self.faces
        )
        return made

    @property
    def term(self) -> Any:
        """Parameter group of the surface's kernels."""
        return self.reconstruction.term

    def reconstruct_enclosing(self, position: Any, mass: Any, volume_ratio: Any) -> None:
        """The surface of particles at `position` (n, 3) [m] that encloses their volume, sum m J/rho0."""
        xp, seen, _ = self._library()
        self.reconstruct(position, seen(mass).astype(xp.float64) * seen(volume_ratio))

    def reconstruct(self, position: Any, held: Any = None) -> None:
        """The surface of particles at `position` (n, 3) [m], with m J [kg] of each to enclose their volume.

        Raises RunStopped where a cell holds more particles than any volume ratio that a run survives could explain: J
        follows the divergence of the velocity and does not see particles that gather on a line or in a point.
        """
        owner = None
        if self.faces:
            position, owner = self._with_images(position)
            held = None if held is None else held[owner]
        volume = None if held is None else float(held.sum()) / self.rest_density
        self.latest = self.reconstruction.surface(position, volume=volume)
        most = self.reconstruction.most_in_a_cell(self.latest)
        if most > CLUMPED * self.full:
            raise RunStopped(
                "clumped",
                f"{most} particles have gathered in one cell, which holds {self.full:.3g}: {_GATHERED}",
            )
        samples = self.latest.samples
        if not self.reconstruction.finds_all(self.latest):
            raise RunStopped(
                "diverged",
                "A part of the reconstructed surface has no particle within two cells: particles fly apart; take a"
                " smaller step, or an inset and the embedding 'cluster'.",
            )
        if owner is None:
            self.assign(samples.position, samples.normal, samples.area, samples.nearest)
        else:
            self._keep_free(position, owner)

    def _library(self) -> tuple[Any, Callable[[Any], Any], Callable[[Any], Any]]:
        """(NumPy or CuPy, what shows it an array of this backend, what makes one)."""
        if self.backend.name != "cuda":
            return np, np.asarray, np.asarray
        from refsim.backends import device

        return device.library(), device.seen, device.wrapped

    def _with_images(self, position: Any) -> tuple[Any, Any]:
        """(particles and their images in the walls near them, the particle of each)."""
        xp, seen, wrapped = self._library()
        place, owner = seen(position), xp.arange(position.shape[0], dtype=np.int32)
        for axis in range(self.dim):
            places, owners = [place], [owner]
            for face in (f for f in self.faces if f.axis == axis):
                near = xp.flatnonzero(face.inward * (place[:, axis] - face.plane) < IMAGED * self.cell_size)
                image = place[near]
                image[:, axis] = face.plane + (face.plane - image[:, axis])
                places.append(image)
                owners.append(owner[near])
            place, owner = xp.concatenate(places), xp.concatenate(owners)
        return wrapped(xp.ascontiguousarray(place)), owner

    def _keep_free(self, position: Any, owner: Any) -> None:
        """Of the surface of liquid and images keep what bounds the liquid, and add the edges of its wetted areas.

        A wall is a plane of nodes, so that no facet crosses it. position of particles and images, owner of each.
        """
        xp, seen, wrapped = self._library()
        found, samples = self.latest, self.latest.samples
        place, facets, dtype = seen(found.sample_place), seen(found.mesh.facets), np.dtype(self.dtype)
        before, after = seen(found.mesh.vertices), seen(found.inset_mesh.vertices)
        free, bounding = xp.ones(len(place), bool), xp.ones(len(facets), bool)
        for face in self.faces:
            free &= face.inward * (place[:, face.axis] - face.plane) > 0
            height = face.inward * (before[facets][:, :, face.axis] - face.plane)
            bounding &= height.sum(1) > 0
        facets = facets[bounding]
        none = xp.zeros((0, 3), dtype)
        places, lines, normals = [none], [none], [none]
        for face in self.faces if self.edges else ():
            touches = before[facets][:, :, face.axis] == face.plane
            middle, line = self._edges(facets, touches, after, face)
            middle[:, face.axis] = face.plane
            out = xp.zeros_like(middle)
            out[:, face.axis] = -face.inward
            places.append(middle)
            lines.append(line)
            normals.append(out)
        edge, line, normal = (xp.ascontiguousarray(xp.concatenate(p).astype(dtype)) for p in (places, lines, normals))
        nearest, _, _ = self.reconstruction.offsets(position, found.blocks, found.cells, wrapped(edge), False)
        beside = seen(nearest)
        bears = (beside >= 0) & (
            seen(found.component_size)[xp.maximum(beside, 0)] >= self.tension.least_component(self.dim)
        )
        edge, line, normal, beside = edge[bears], line[bears], normal[bears], beside[bears]
        parts = (
            (seen(samples.position)[free], edge),
            (seen(samples.normal)[free], normal),
            (seen(samples.area)[free], xp.zeros(len(edge), dtype)),
            (owner[seen(samples.nearest)[free]], owner[beside]),
            (xp.zeros((int(free.sum()), 3), dtype), line),
        )
        arrays = [wrapped(xp.ascontiguousarray(xp.concatenate(part).astype(part[0].dtype))) for part in parts]
        self.assign(*arrays)
        count = self.backend.empty(self.count, np.int32)
        REGISTRY["surface_energy.sample_counts"].program(self.backend.name)(self.sample_nearest, count)
        kept = wrapped(xp.ascontiguousarray(facets))
        self.latest = replace(
            found, samples=Samples(*arrays[:4], count), mesh=Mesh(found.mesh.vertices, kept),
            inset_mesh=Mesh(found.inset_mesh.vertices, kept), component_size=found.component_size[: self.count],
        )  # fmt: skip

    def _edges(self, facets: Any, touches: Any, place: Any, face: Face) -> tuple[Any, Any]:
        """(middles [m], outward normals in the wall times lengths) of the edges that facets have in a wall.

        Facets turn left seen from outside, so that the normal is the edge turned about the wall's: edge x inward.
        """
        xp, _, _ = self._library()
        if self.dim == 2:
            row, corner = xp.nonzero(touches)
            middle = place[facets[row, corner]]
            up = xp.zeros_like(middle)
            up[:, face.axis] = face.inward
            turn = xp.where(corner == 0, 1, -1)[:, None]
            return middle, turn * xp.stack([up[:, 1], -up[:, 0], up[:, 2]], axis=1)
        middles, lines = [], []
        inward = xp.zeros(3, place.dtype)
        inward[face.axis] = face.inward
        for a, b in ((0, 1), (1, 2), (2, 0)):
            both = touches[:, a] & touches[:, b]
            start, end = place[facets[both, a]], place[facets[both, b]]
            middles.append(start + (end - start) / 2)
            lines.append(xp.cross(end - start, xp.broadcast_to(inward, start.shape)))
        return xp.concatenate(middles), xp.concatenate(lines)

    def find_filaments(self, position: Any, extent: Any) -> None:
        """Along how many axes the liquid round each particle spreads."""
        self.backend.assign(extent, self.reconstruction.extents(position))


_STAGES = tuple(name for name in REGISTRY if name.startswith("surface_energy."))
enter(Procedure("surface_energy.reconstruct", "surface", "reconstruct", ("position",), _STAGES))
enter(
    Procedure(
        "surface_energy.reconstruct_enclosing",
        "surface",
        "reconstruct_enclosing",
        ("position", "mass", "volume_ratio"),
        _STAGES,
    )
)
enter(
    Procedure(
        "surface_energy.find_filaments",
        "surface",
        "find_filaments",
        ("position", "extent"),
        ("surface_energy.extents",),
    )
)
register(
    Operation(
        name="mpm.contact",
        folder="refsim.mpm",
        paper="thesis on reconstructed-surface tension in MPM",
        equation="k_wall = -k cos(theta) at the edge of the wetted area (Young)",
        function="contact",
        outputs=("node_force",),
        adds=("node_force",),
        tolerance=8.0,
        tolerance_reason="splines, products and sum",
    )
)
