"""The whole reconstruction of a surface in NumPy: the oracle's equations one after another, all pairs, for small runs.

Figure 4.7 of the thesis up to the transfers, as `refsim.surface_energy.reconstruction` computes it with kernels. Each
stage computes in float64; what it hands on is rounded to the run's dtype.
"""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np

from refsim.core.errors import RunStopped
from refsim.isosurface import Mesh
from refsim.isosurface import operations as isosurface
from refsim.sparse_grid import Blocks, PointList
from refsim.sparse_grid.reference import Lookup, covering
from refsim.sparse_grid.tables import blocks_of, keys_at
from refsim.surface_energy import LARGEST_INSET, Dice, SurfaceTerm, Tension, operations, surface_term
from refsim.surface_energy.reconstruction import AREA_UNITS, CANDIDATES, DENSEST, Liquid, Samples, Surface

FARTHEST = (1 << 20) - 16  # cells from the origin up to which there are blocks


class ReferenceReconstruction:
    """Reconstructs surfaces with one set of parameters, which InputError refuses where they are impossible; h [m]."""

    def __init__(self, dim: int, dtype: str, cell_size: float, tension: Tension) -> None:
        tension.check_parameters(dim)
        self.dim, self.dtype, self.tension = dim, np.dtype(dtype), tension
        self.term: SurfaceTerm = surface_term(tension, dim, dtype, cell_size)
        self.merged = "M32" in tension.printed()

    def surface(self, position: Any, step: int = 0, volume: float | None = None, number: Any = None) -> Surface:
        """The surface of particles at `position` (n, 3) [m]; each `step` draws other Poisson-disk samples.

        volume  enclosed by the surface after the inset [m^dim]; with None the inset's distance is given
        number  (n,) of each particle, by which equally near ones are told apart; by default that of its row
        """
        number = np.arange(len(position)) if number is None else number
        term, kind = self.term, self.tension.normals
        blocks, cells = self._cells(position)

        # level set and marching cubes
        state = self._of(operations.node_states(position, cells, blocks, term))[0]
        mesh = self._mesh(position, cells, blocks, state)

        # samples, the particle nearest to each, and the points of the fit
        facet_place, facet_area, facet_normal = self._facet_samples(mesh)
        if self.tension.quadrature == "facets":
            place, area, facet = facet_place, facet_area, np.arange(len(mesh.facets))
        else:
            place, area, facet = self._poisson_samples(mesh, facet_area, blocks, step)
        liquid = Liquid(position, number, blocks, cells)
        nearest, away, points = self.offsets(liquid, place, True)

        # fit and normals
        coefficients = np.zeros(64 * len(blocks.keys), self.dtype)
        if kind in ("mls", "gradient"):
            coefficients = self._fit(points, blocks)
            normal = self._fitted_normals(place, blocks, coefficients, away)
        else:
            normal = away if kind == "offsets" else facet_normal[facet]

        # inset: vertices move back along their normals, and with them the samples and their areas
        inset_mesh, fitted_place = mesh, place
        if self.tension.inset_distance() is not None:
            _, outward, _ = self.offsets(liquid, mesh.vertices, False)
            if kind in ("mls", "gradient"):
                outward = self._fitted_normals(mesh.vertices, blocks, coefficients, outward)
            if volume is not None:
                term = term._replace(inset=self.dtype.type(self._enclosing(mesh, outward, volume)))
            inset_mesh = Mesh(self._of(operations.inset(mesh.vertices, outward, term))[0], mesh.facets)
            after_place, after, _ = self._facet_samples(inset_mesh)
            if self.tension.quadrature == "facets":
                place, area = after_place, after
            else:
                place = self._of(operations.inset(place, normal, term))[0]
                change = np.divide(after, facet_area, out=np.ones_like(after), where=facet_area > 0)
                area = area * change[facet]
            nearest, _, _ = self.offsets(liquid, place, False)

        # components of few particles have no tension
        label = self._of(operations.components(blocks, state))[0]
        size = self._of(operations.component_sizes(cells, label))[0]
        tense = np.array([p >= 0 and size[p] >= self.tension.least_component(self.dim) for p in nearest], bool)
        area = np.where(tense, area, 0)

        samples = Samples(place, normal, area, nearest)
        return Surface(
            samples, mesh, inset_mesh, size, blocks, cells, coefficients, facet_normal, away, fitted_place,
            most_in_a_cell=int(np.bincount(cells.cell).max(initial=0)), unfound=bool((nearest < 0).any()),
        )  # fmt: skip

    def force(self, samples: Samples, blocks: Blocks) -> Any:
        """Force of the surface's tension on the nodes of `blocks` (nodes, 3) [N], (4.18*)."""
        pull = operations.surface_force(samples.position, samples.area, samples.normal, None, blocks, self.term)
        return self._of(pull)[0]

    def most_in_a_cell(self, surface: Surface) -> int:
        """Largest number of particles in one cell."""
        assert surface.most_in_a_cell is not None
        return surface.most_in_a_cell

    def finds_all(self, surface: Surface) -> bool:
        """Whether every sample has a particle."""
        return not surface.unfound

    def offsets(self, liquid: Liquid, place: Any, fitted: bool) -> tuple[Any, ...]:
        """(nearest particle, direction away from it, points of the fit if `fitted`) of places (s, 3) [m]."""
        position, number, blocks, cells = liquid
        return self._of(operations.offsets(position, number, cells, blocks, self.term, place, None))

    # Stages

    def _cells(self, position: Any) -> tuple[Blocks, PointList]:
        """Blocks of all nodes that samples, the points of the fit and the splines of both reach, and cells in them."""
        h = float(self.term.cell_size)
        if not (np.abs(position) < FARTHEST * h).all():
            raise RunStopped(
                "out_of_grid",
                f"A particle left the background grid of the surface, which ends {FARTHEST} cells from the origin, or"
                " is at no finite place: take a smaller step, or put walls around the liquid.",
            )
        reach = self.tension.radius(self.dim) + self.tension.offset + 0.5
        node = covering(position, h, self.dim, math.ceil(reach), math.floor(reach) + 2)
        width = np.array([4, 4, 4] if self.dim == 3 else [8, 8, 1])
        blocks = blocks_of(np.unique(keys_at(node // width)), self.dim)
        return blocks, self._list(position, blocks, 0.0)

    def _list(self, place: Any, blocks: Blocks, shift: float) -> PointList:
        """The points of each cell floor(x/h - shift)."""
        coordinates = np.floor(np.asarray(place, dtype=float) / float(self.term.cell_size) - shift).astype(int)
        coordinates[:, self.dim :] = 0
        cell = Lookup(blocks)(coordinates)
        order = np.argsort(cell, kind="stable")
        order = order[cell[order] >= 0]
        return PointList(np.searchsorted(cell[order], np.arange(64 * len(blocks.keys) + 1)), order, cell)

    def _mesh(self, position: Any, cells: PointList, blocks: Blocks, state: Any) -> Mesh:
        table: Any = SimpleNamespace(merged=self.merged)
        crossings, case = self._of(isosurface.classify(blocks, state))
        edge, facets = self._of(isosurface.facets(blocks, crossings, case, None, None, table))
        vertices = operations.exit_points(position, cells, blocks, state, self.term, edge)
        return Mesh(self._of(vertices)[0], facets)

    def _facet_samples(self, mesh: Mesh) -> tuple[Any, ...]:
        """(centroids [m], areas, normals) of the facets."""
        return self._of(operations.facet_samples(mesh.vertices, mesh.facets))

    def _poisson_samples(self, mesh: Mesh, facet_area: Any, blocks: Blocks, step: int) -> tuple[Any, ...]:
        """(place [m], area, facet) of Poisson-disk samples, which share the whole area evenly, (4.5)."""
        unit = float(self.term.cell_size) ** (self.dim - 1)
        parts = np.rint(facet_area.astype(float) * (AREA_UNITS / unit)).astype(int)
        before = np.concatenate([[0], np.cumsum(parts)])
        whole = before[-1] / AREA_UNITS
        count = math.ceil(CANDIDATES * DENSEST[self.dim] * whole / self.tension.disk_radius ** (self.dim - 1))
        dice = Dice(self.tension.seed + 7919 * step, count)
        facet, place = self._of(operations.candidates(mesh.vertices, mesh.facets, before, dice))
        accepted = self._of(operations.poisson_disk(place, None, blocks, dice, self.term))[0] == 1
        area = np.full(accepted.sum(), whole * unit / max(accepted.sum(), 1), self.dtype)
        return place[accepted], area, facet[accepted]

    def _fit(self, points: Any, blocks: Blocks) -> Any:
        """Coefficients of the splines at the nodes, (3.6)."""
        listed = self._list(points, blocks, 0.5)
        splines, weight = self._of(operations.fit_weights(points, listed, blocks, self.term))
        return self._of(operations.fit(splines, listed, blocks, self.term, weight, np.flatnonzero(weight)))[1]

    def _fitted_normals(self, place: Any, blocks: Blocks, coefficients: Any, outward: Any) -> Any:
        chosen = operations.mls_normals if self.tension.normals == "mls" else operations.spline_normals
        return self._of(chosen(place, None, blocks, self.term, coefficients, outward))[2]

    def _enclosing(self, mesh: Mesh, normal: Any, volume: float) -> float:
        """(r - delta)/h with which the surface encloses `volume` [m^dim], by bisection; delta is 0 to LARGEST_INSET
        cells. The volume within falls as the vertices move inwards."""
        if not len(mesh.facets):
            return float(self.term.inset)
        h, radius = float(self.term.cell_size), self.tension.radius(self.dim)
        place, direction = np.asarray(mesh.vertices, dtype=float), np.asarray(normal, dtype=float)

        def within(distance: float) -> float:
            """By the divergence theorem: the sum of the simplices from one point to all facets."""
            moved = place - distance * h * direction
            corner = (moved - moved[mesh.facets[0, 0]])[mesh.facets][:, :, : self.dim]
            return abs(float(np.linalg.det(corner).sum())) / math.factorial(self.dim)

        deep, shallow = radius, radius - LARGEST_INSET
        if not within(deep) < volume < within(shallow):
            return deep if volume <= within(deep) else shallow
        for _ in range(60):
            middle = 0.5 * (deep + shallow)
            deep, shallow = (middle, shallow) if within(middle) < volume else (deep, middle)
        return 0.5 * (deep + shallow)

    def _of(self, answer: dict[str, Any]) -> tuple[Any, ...]:
        """The outputs of a reference in the run's dtype; integers are int32."""
        values = (np.asarray(value) for value, _ in answer.values())
        return tuple(value.astype(self.dtype if value.dtype.kind == "f" else np.int32) for value in values)
