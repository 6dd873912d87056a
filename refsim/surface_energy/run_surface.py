"""The surface of a run: samples that the transfers take, and the reconstruction that renews them in each step."""

import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core.errors import RunStopped
from refsim.isosurface import Mesh
from refsim.surface_energy import Tension
from refsim.surface_energy.reconstruction import Reconstruction
from refsim.surface_energy.reference_reconstruction import ReferenceReconstruction
from refsim.surface_energy.surface import Liquid, Samples

IMAGED = 5.0  # cells from a wall within which particles have an image: beyond that no sample at the wall is affected
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


class Face(NamedTuple):
    """A wall in which the liquid is mirrored, a plane of nodes."""

    axis: int
    plane: Any  # [m]
    inward: int  # 1 or -1, along the axis, towards the liquid


class SurfaceSamples:
    """Samples on one backend, replaced in each step by those of the new surface (`assign`).

    sample_position (s, 3) [m], sample_normal (s, 3) outward, sample_area (s,) [m^(d-1)], sample_nearest (s,) int32,
    the particle nearest to each, -1 where there is no sample but capacity; sample_line (s, 3) [m^(d-2)], on the edge of
    a wetted area its outward normal in the wall times its length, None without contact angles; carrier_... of the 2 s
    embedded points, by owner: carrier_first (n + 1), carrier_position (2 s, 3) [m], carrier_owner (2 s,),
    carrier_moment (2 s, 12).

    version  is another one whenever the samples stand in other arrays
    """

    version = 0

    def __init__(self, count: int, dtype: str, backend: Backend) -> None:
        self.count, self.dtype, self.backend = count, dtype, backend
        self._storage: dict[str, Any] = {}
        self._views: dict[str, Any] = {}
        self._taken: tuple[Any, ...] = (None,) * 5
        none = backend.zeros
        self.assign(none((0, 3), dtype), none((0, 3), dtype), none(0, dtype), none(0, "int32"))

    def assign(self, position: Any, normal: Any, area: Any, nearest: Any, line: Any = None) -> None:
        """Take the samples of this step: arrays of this backend."""
        taken = position, normal, area, nearest, line
        self.version += any(a is not b for a, b in zip(taken, self._taken, strict=True))
        self._taken = taken
        self.sample_position, self.sample_normal, self.sample_area, self.sample_nearest, self.sample_line = taken

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
                capacity = (shape[0] + shape[0] // 4, *shape[1:])
                held = self._storage[name] = self.backend.empty(capacity, np.dtype(dtype))
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
        faces: tuple[Face, ...] = (), edges: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(count, dtype, Backend("numpy"))
        self.tension, self.dim, self.cell_size, self.full = tension, dim, cell_size, full
        self.rest_density, self.faces, self.edges = rest_density, faces, edges
        self.reconstruction: Any = None
        self.latest: Any = None

    def on_backend(self, backend: Backend) -> "SurfaceOfRun":
        """The same, ready to work, on another backend."""
        made = copy.copy(self)
        SurfaceSamples.__init__(made, self.count, self.dtype, backend)
        # with images the number of particles is another one in each step
        made.reconstruction = reconstruction_on(
            backend, self.dim, self.dtype, self.cell_size, self.tension, reused=not self.faces
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
        owner = None
        if self.faces:
            position, owner = self._with_images(position)
            _, to_xp, from_xp = self.backend.array_library()
            identity = from_xp(to_xp(identity)[owner])
            held = None if held is None else held[owner]
        volume = None if held is None else float(held.sum()) / self.rest_density
        self.latest = self.reconstruction.surface(position, volume=volume, number=identity)
        most = self.reconstruction.most_in_a_cell(self.latest)
        if most > CLUMPED * self.full:
            raise RunStopped(
                "clumped", f"{most} particles have gathered in one cell, which holds {self.full:.3g}: {GATHERED}"
            )
        samples = self.latest.samples
        if not self.reconstruction.finds_all(self.latest):
            raise RunStopped(
                "diverged",
                "A part of the reconstructed surface has no particle within two cells: particles fly apart; take a"
                " smaller step, or an inset and the embedding 'cluster'.",
            )
        if owner is None:
            samples = self.latest.padded or samples
            self.assign(samples.position, samples.normal, samples.area, samples.nearest)
        else:
            self._keep_free(position, identity, owner)
        return self.version

    def _with_images(self, position: Any) -> tuple[Any, Any]:
        """(particles and their images in the walls near them, the particle of each)."""
        xp, to_xp, from_xp = self.backend.array_library()
        place, owner = to_xp(position), xp.arange(position.shape[0], dtype=np.int32)
        for axis in range(self.dim):
            places, owners = [place], [owner]
            for face in (f for f in self.faces if f.axis == axis):
                near = xp.flatnonzero(face.inward * (place[:, axis] - face.plane) < IMAGED * self.cell_size)
                image = place[near]
                image[:, axis] = face.plane + (face.plane - image[:, axis])
                places.append(image)
                owners.append(owner[near])
            place, owner = xp.concatenate(places), xp.concatenate(owners)
        return from_xp(xp.ascontiguousarray(place)), owner

    def _keep_free(self, position: Any, identity: Any, owner: Any) -> None:
        """Of the surface of liquid and images keep what bounds the liquid, and add the edges of its wetted areas.

        A wall is a plane of nodes, so that no facet crosses it. position of particles and images, owner of each.
        """
        xp, to_xp, from_xp = self.backend.array_library()
        surface, samples = self.latest, self.latest.samples
        place, facets, dtype = to_xp(surface.sample_place), to_xp(surface.mesh.facets), np.dtype(self.dtype)
        before, after = to_xp(surface.mesh.vertices), to_xp(surface.inset_mesh.vertices)
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
        liquid = Liquid(position, identity, surface.blocks, surface.cells)
        nearest, _, _ = self.reconstruction.offsets(liquid, from_xp(edge), False)
        beside = to_xp(nearest)
        tense = (beside >= 0) & (
            to_xp(surface.component_size)[xp.maximum(beside, 0)] >= self.tension.least_component(self.dim)
        )
        edge, line, normal, beside = edge[tense], line[tense], normal[tense], beside[tense]
        parts = (
            (to_xp(samples.position)[free], edge),
            (to_xp(samples.normal)[free], normal),
            (to_xp(samples.area)[free], xp.zeros(len(edge), dtype)),
            (owner[to_xp(samples.nearest)[free]], owner[beside]),
            (xp.zeros((int(free.sum()), 3), dtype), line),
        )
        arrays = [from_xp(xp.ascontiguousarray(xp.concatenate(part).astype(part[0].dtype))) for part in parts]
        self.assign(*arrays)
        count = self.reconstruction.sample_counts(self.sample_nearest, self.count)
        kept = from_xp(xp.ascontiguousarray(facets))
        self.latest = replace(
            surface, samples=Samples(*[*arrays[:4], count]), mesh=Mesh(surface.mesh.vertices, kept),
            inset_mesh=Mesh(surface.inset_mesh.vertices, kept), component_size=surface.component_size[: self.count],
        )  # fmt: skip

    def _edges(self, facets: Any, touches: Any, place: Any, face: Face) -> tuple[Any, Any]:
        """(middles [m], outward normals in the wall times lengths) of the edges that facets have in a wall.

        Facets turn left seen from outside, so that the normal is the edge turned about the wall's: edge x inward.
        """
        xp, _, _ = self.backend.array_library()
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
