"""The reconstruction of a surface, step after step: from particles to samples with normals, areas and particles.

Figure 4.7 of the thesis up to the transfers: level set, marching cubes, samples, offsets, fit, normals, inset, and
which components have tension. `recorded` does it on a GPU.
"""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core.operation import REGISTRY
from refsim.isosurface import Mesh, edges_and_facets
from refsim.sparse_grid import Blocks, PointList, SparseGrid, nodes
from refsim.surface_energy import LARGEST_INSET, Dice, SurfaceTerm, Tension, surface_term

AREA_UNITS = 1 << 20  # of h^(dim-1), so that running sums of areas are whole numbers and repeat
CANDIDATES = 8  # for each Poisson-disk sample
DENSEST = {2: 0.75, 3: 0.7}  # samples of a jammed set on an area of disk_radius^(dim-1)


class Samples(NamedTuple):
    """The surface as the transfers take it: s samples."""

    position: Any  # (s, 3) [m]
    normal: Any  # (s, 3), unit, outward
    area: Any  # (s,) [m^(dim-1)], 0 on components without tension
    nearest: Any  # (s,) int32, nearest interior particle


class Liquid(NamedTuple):
    """Particles (n, 3) [m], the number of each (n,), blocks about them, and the particles of each cell."""

    position: Any
    number: Any
    blocks: Blocks
    cells: PointList


@dataclass
class Surface:
    """All that one reconstruction makes; arrays on the backend."""

    samples: Samples  # what the transfers take
    mesh: Mesh  # the level set's surface, before the inset
    inset_mesh: Mesh  # after it; the same mesh without an inset
    component_size: Any  # (particles,) int32, particles in the component of each
    blocks: Blocks
    cells: PointList
    coefficients: Any
    facet_normal: Any
    offset_direction: Any
    sample_place: Any
    seconds: dict[str, float]  # time of each stage [s], if measured
    most_in_a_cell: int  # largest number of particles in one cell
    unfound: bool  # whether a sample has no particle
    padded: Samples | None = None  # the samples with unused capacity, see `RecordedSurface`, or None


def area_before(area: Any, h: float, dim: int) -> Any:
    """(facets + 1,) int64: running sum of areas in whole units, AREA_UNITS of them in h^(dim-1)."""
    units = np.rint(area.astype(float) * (AREA_UNITS / h ** (dim - 1))).astype(np.int64)
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(units)])


class Reconstruction:
    """Reconstructs surfaces with one set of parameters, which InputError refuses where they are impossible; h [m]."""

    def __init__(
        self, backend: Backend, dim: int, dtype: str, cell_size: float, tension: Tension, timed: bool = False
    ) -> None:
        tension.check_parameters(dim)
        self.backend, self.dim, self.dtype, self.tension, self.timed = backend, dim, np.dtype(dtype), tension, timed
        self.grid = SparseGrid(backend, dim, dtype, cell_size)
        self.term: SurfaceTerm = surface_term(tension, dim, dtype, cell_size)
        self.table_merged = "M32" in tension.printed()
        # nodes that samples, their second points and the splines of both reach beyond a particle's cell
        reach = tension.radius(dim) + tension.offset + 0.5
        self.below, self.above = math.ceil(reach), math.floor(reach) + 2
        self._seconds: dict[str, float] = {}
        self._rows: Any = None  # numbers of the rows

    def surface(self, position: Any, step: int = 0, volume: float | None = None, number: Any = None) -> Surface:
        """The surface of particles at `position` (n, 3) [m]; each `step` draws other Poisson-disk samples.

        volume  enclosed by the surface after the inset [m^dim]; with None the inset's distance is given
        number  (n,) int32 of each particle, by which equally near ones are told apart; by default that of its row
        """
        number = self._numbers(position, number)
        self._seconds = {}
        blocks, cells = self._stage("cells", self._cells, position)
        liquid = Liquid(position, number, blocks, cells)
        mesh = self._stage("level set and facets", self._mesh, position, blocks, cells)
        place, area, facet_normal, facet = self._stage("samples", self._samples, mesh, blocks, step)
        nearest, away, fit_position = self._stage("offsets", self.offsets, liquid, place, True)
        coefficients = self._stage("fit", self._fit, blocks, fit_position)
        of_facets = facet_normal if facet is None else facet_normal[facet]
        normal = self._stage("normals", self._normals, blocks, coefficients, place, away, of_facets)
        inset_mesh = mesh
        if self.tension.inset_distance() is not None:
            inset_mesh, place, area, nearest = self._stage(
                "inset", self._inset, liquid, mesh, coefficients, place, area, normal, facet, volume
            )
        size, area = self._stage("components", self._components, blocks, cells, nearest, area)
        return Surface(
            Samples(place, normal, area, nearest), mesh, inset_mesh, size, blocks, cells, coefficients,
            facet_normal, away, fit_position[: place.shape[0]], dict(self._seconds),
            most_in_a_cell=int(np.diff(cells.first).max(initial=0)), unfound=bool((nearest < 0).any()),
        )  # fmt: skip

    def force(self, samples: Samples, blocks: Blocks) -> Any:
        """Force of the surface's tension on the nodes of `blocks` (nodes, 3) [N], (4.18*)."""
        force = self._empty((nodes(blocks), 3))
        bases = self.grid.by_cell(samples.position, blocks, 0.5)
        self._run("surface_force", samples.position, samples.area, samples.normal, bases, blocks, self.term, force)
        return force

    # Stages

    def _numbers(self, position: Any, number: Any) -> Any:
        """Numbers of particles as given, or those of the rows."""
        if number is not None:
            return number
        if self._rows is None or self._rows.shape[0] != position.shape[0]:
            self._rows = self.backend.asarray(np.arange(position.shape[0], dtype=np.int32))
        return self._rows

    def _cells(self, position: Any) -> tuple[Blocks, PointList]:
        blocks = self.grid.cover(position, self.below, self.above)
        return blocks, self.grid.by_cell(position, blocks)

    def _mesh(self, position: Any, blocks: Blocks, cells: PointList) -> Mesh:
        state = self._empty(nodes(blocks), np.uint8)
        self._run("node_states", position, cells, blocks, self.term, state)
        self._state = state
        edges = edges_and_facets(self.backend, blocks, state, self.dim, self.table_merged)
        vertex = self._empty((edges.vertex_edge.shape[0], 3))
        self._run("exit_points", position, cells, blocks, state, self.term, edges.vertex_edge, vertex)
        return Mesh(vertex, edges.facets)

    def _samples(self, mesh: Mesh, blocks: Blocks, step: int) -> tuple[Any, ...]:
        """(place, area, normals of facets, facet of each sample or None where each facet has one)."""
        place, area, normal = self._facet_samples(mesh)
        if self.tension.quadrature == "facets":
            return place, area, normal, None
        before = area_before(area, float(self.term.cell_size), self.dim)
        units = float(before[-1]) / AREA_UNITS
        count = math.ceil(CANDIDATES * DENSEST[self.dim] * units / self.tension.disk_radius ** (self.dim - 1))
        dice = Dice(*map(np.int64, (self.tension.seed + 7919 * step, count)))  # type: ignore[arg-type]
        facet, candidate = self._empty(count, np.int32), self._empty((count, 3))
        self._run("candidates", mesh.vertices, mesh.facets, before, dice, facet, candidate)
        accepted = self._empty(count, np.uint8)
        self._run("poisson_disk", candidate, self.grid.by_cell(candidate, blocks), blocks, dice, self.term, accepted)
        place, facet = candidate[accepted == 1], facet[accepted == 1]
        h = float(self.term.cell_size)
        each = units * h ** (self.dim - 1) / max(place.shape[0], 1)  # (4.5)
        return place, np.full(len(place), each, self.dtype), normal, facet

    def _facet_samples(self, mesh: Mesh) -> tuple[Any, Any, Any]:
        count = mesh.facets.shape[0]
        place, area, normal = self._empty((count, 3)), self._empty(count), self._empty((count, 3))
        self._run("facet_samples", mesh.vertices, mesh.facets, place, area, normal)
        return place, area, normal

    def offsets(self, liquid: Liquid, place: Any, fitted: bool) -> tuple[Any, ...]:
        """(nearest particle, direction away from it, points of the fit if `fitted`) of places (s, 3) [m]."""
        count = place.shape[0]
        nearest, away = self._empty(count, np.int32), self._empty((count, 3))
        points = self._empty((2 * count, 3)) if fitted else None
        position, number, blocks, cells = liquid
        own = self.grid.cells_alone(place, blocks)
        self._run("offsets", position, number, cells, blocks, self.term, place, own, nearest, away, points)
        return nearest, away, points

    def _fit(self, blocks: Blocks, points: Any) -> Any:
        count = nodes(blocks)
        if self.tension.normals in ("facets", "offsets"):
            return np.zeros(count, self.dtype)
        coefficients = self._empty(count)
        weight, residual, splines = self._empty(count), self._empty(points.shape[0]), self._empty((points.shape[0], 9))
        bases = self.grid.by_cell(points, blocks, 0.5)
        self._run("fit_weights", points, bases, blocks, self.term, splines, weight)
        active = np.flatnonzero(weight).astype(np.int32)
        self._run("fit", splines, bases, blocks, self.term, weight, active, residual, coefficients)
        return coefficients

    def _normals(self, blocks: Blocks, coefficients: Any, place: Any, outward: Any, of_facets: Any = None) -> Any:
        """Normals at places (s, 3) [m]: of the fit, else those of facets where they have some, or the directions."""
        kind = self.tension.normals
        if kind in ("facets", "offsets"):
            return outward if kind == "offsets" or of_facets is None else of_facets
        normal = self._empty((place.shape[0], 3))
        bases = self.grid.cells_alone(place, blocks, 0.5)
        name = "mls_normals" if kind == "mls" else "spline_normals"
        self._run(name, place, bases, blocks, self.term, coefficients, outward, None, None, normal)
        return normal

    def _inset(
        self, liquid: Liquid, mesh: Mesh, coefficients: Any, place: Any, area: Any, normal: Any, facet: Any,
        volume: float | None,
    ) -> tuple[Mesh, Any, Any, Any]:  # fmt: skip
        """The surface pulled back by r - delta along the normals at its vertices; samples and areas go with it."""
        _, outward, _ = self.offsets(liquid, mesh.vertices, False)
        vertex_normal = self._normals(liquid.blocks, coefficients, mesh.vertices, outward)
        vertices = self._empty(mesh.vertices.shape)
        term = self.term
        if volume is not None:
            term = term._replace(inset=self.dtype.type(self.enclosing(mesh, vertex_normal, volume)))
        self._run("inset", mesh.vertices, vertex_normal, term, vertices)
        inset_mesh = Mesh(vertices, mesh.facets)
        if facet is None:
            place, area, _ = self._facet_samples(inset_mesh)
        else:
            area = self._rescaled(area, facet, mesh, inset_mesh)
            moved = self._empty(place.shape)
            self._run("inset", place, normal, term, moved)
            place = moved
        nearest, _, _ = self.offsets(liquid, place, False)
        return inset_mesh, place, area, nearest

    def enclosing(self, mesh: Mesh, vertex_normal: Any, volume: float) -> float:
        """(r - delta)/h with which the surface encloses `volume` [m^dim]; delta is 0 to LARGEST_INSET cells.

        The volume within facets whose corners move along straight lines is a polynomial of degree dim in the distance.
        """
        xp, to_xp, _ = self.backend.array_library()
        facets, h = to_xp(mesh.facets), float(self.term.cell_size)
        if not len(facets):
            return float(self.term.inset)
        place, direction = to_xp(mesh.vertices).astype(float), to_xp(vertex_normal).astype(float)
        first = place[facets[0, 0]]
        corner, move = (place[facets] - first)[:, :, : self.dim], h * direction[facets][:, :, : self.dim]
        radius = self.tension.radius(self.dim)
        distances = radius - np.linspace(0.0, LARGEST_INSET, self.dim + 1)
        within = []
        for t in distances:
            p = corner - float(t) * move
            if self.dim == 2:
                part = 0.5 * (p[:, 0, 0] * p[:, 1, 1] - p[:, 0, 1] * p[:, 1, 0])
            else:
                part = (p[:, 0] * xp.cross(p[:, 1], p[:, 2])).sum(1) / 6
            within.append(abs(float(part.sum())))
        if not within[0] < volume < within[-1]:
            return float(distances[0] if volume <= within[0] else distances[-1])
        curve = np.polynomial.Polynomial.fit(distances, np.array(within) - volume, self.dim)
        roots = [float(z.real) for z in curve.roots() if abs(z.imag) < 1e-9 and distances[-1] <= z.real <= distances[0]]
        return min(roots, key=lambda z: abs(z - float(self.term.inset)), default=float(self.term.inset))

    def _components(self, blocks: Blocks, cells: PointList, nearest: Any, area: Any) -> tuple[Any, Any]:
        """(particles in each particle's component, areas without those of components that are too small)."""
        label = self._empty(nodes(blocks), np.int32)
        size = self._empty(cells.cell.shape[0], np.int32)
        self._run("components", blocks, self._state, label)
        self._run("component_sizes", cells, label, size)
        least = self.tension.least_component(self.dim)
        if len(nearest):
            area = np.where((nearest >= 0) & (size[np.maximum(nearest, 0)] >= least), area, self.dtype.type(0))
        return size, area

    # Arrays

    def _run(self, name: str, *arguments: Any) -> None:
        REGISTRY[f"surface_energy.{name}"].launch(self.backend.name, *arguments)

    def _empty(self, shape: Any, dtype: Any = None) -> Any:
        return self.backend.empty(shape, self.dtype if dtype is None else np.dtype(dtype))

    def _stage(self, name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        if not self.timed:
            return function(*arguments)
        began = time.perf_counter()
        result = function(*arguments)
        self.backend.synchronize()
        self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - began
        return result

    def _rescaled(self, area: Any, facet: Any, mesh: Mesh, inset_mesh: Mesh) -> Any:
        """Areas of Poisson-disk samples times the change of their facet's area."""
        _, old, _ = self._facet_samples(mesh)
        _, new, _ = self._facet_samples(inset_mesh)
        change = np.divide(new, old, out=np.ones_like(old), where=old > 0)
        return area * change[facet]
