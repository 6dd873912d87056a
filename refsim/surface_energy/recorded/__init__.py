"""A reconstruction on a CUDA device, in arrays with capacities above what was found last.

A run's surface is one recorded graph: the host launches it as a whole, learns how many vertices and facets there are
while the device goes on, and does not wait for the end. If a capacity is exceeded, or a particle stands in no block,
the host enlarges the arrays and records the graph again. The stages are the programs "cuda" of the operations whose
outputs they compute (`refsim.surface_energy.kernels_cuda`). A surface that is not reused, because its arrays are kept,
is made by the same stages, launched one by one.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from refsim.backends import device
from refsim.backends.arrays import Backend, Scratch
from refsim.core.errors import InputError, RunStopped
from refsim.isosurface import Mesh, case_tables
from refsim.sparse_grid import Blocks, PointList, nodes
from refsim.surface_energy import Tension
from refsim.surface_energy.kernels import look_up_members
from refsim.surface_energy.reconstruction import Reconstruction, Samples, Surface
from refsim.surface_energy.recorded import level_set_cuda, samples_cuda, stages
from refsim.surface_energy.recorded.cells_cuda import EDGES, FACETS, MADE, MISSING, MOST, UNFOUND, VERTICES
from refsim.surface_energy.recorded.stages import Arrays

MARGIN = 4  # a capacity is larger by 1/MARGIN than what was found last
GRAPHS = 4  # particles may stand in so many arrays by turns


class RecordedSurface(Surface):
    """A surface whose arrays are overwritten by the next one; arrays beside the samples are made on request.

    padded   the samples in all of their arrays: behind them are some at NaN, of area 0 and without a particle (-1)
    unfound  of the last surface: the host does not wait until this one has its samples
    """

    def __init__(
        self, samples: Samples, padded: Samples, blocks: Blocks, cells: PointList, later: dict[str, Callable[[], Any]],
        told: device.PinnedCopy,
    ) -> None:  # fmt: skip
        self.samples, self.padded, self.blocks, self.cells, self.seconds = samples, padded, blocks, cells, {}
        self._later, self._told = later, told
        self.most_in_a_cell = int(told.values[MOST])

    def __getattr__(self, name: str) -> Any:
        later = self.__dict__.get("_later", {})
        if name not in later:
            raise AttributeError(name)
        value = self.__dict__[name] = later[name]()
        return value

    def kept(self) -> Surface:
        """The same with all of its arrays, which are overwritten no more."""
        later = {name: call() for name, call in self._later.items()}
        return Surface(
            self.samples, blocks=self.blocks, cells=self.cells, seconds=self.seconds,
            most_in_a_cell=self.most_in_a_cell, unfound=bool(self._told.read()[UNFOUND]), **later,
        )  # fmt: skip


class DeviceReconstruction(Reconstruction):
    """As `Reconstruction`, on a CUDA device.

    reused  the next surface overwrites the arrays of the last one, and is a recorded graph
    """

    def __init__(
        self, backend: Backend, dim: int, dtype: str, cell_size: float, tension: Tension, timed: bool, reused: bool
    ) -> None:
        super().__init__(backend, dim, dtype, cell_size, tension, timed)
        if tension.quadrature != "facets":
            raise InputError(
                f"{tension.name or 'surface_energy'}: quadrature = {tension.quadrature!r} runs on backends cpu and"
                " numpy only; take quadrature = 'facets', or another backend."
            )
        self.reused = reused
        self._graph: SurfaceGraph | None = None

    def surface(self, position: Any, step: int = 0, volume: float | None = None, number: Any = None) -> Surface:
        number, graph = self._numbers(position, number), self._graph if self.reused else None
        lost = graph is not None and bool(graph.sent.values[UNFOUND])
        for _ in range(3):  # blocks for particles that have left theirs, then capacity for vertices and facets
            if graph is not None and graph.particles == position.shape[0]:
                surface = graph.surface(position, number, volume)
                if surface is not None:
                    surface.unfound = lost
                    return surface if self.reused else surface.kept()
            last, margin = self._graph, self.grid.programs.width if self.reused else 0
            blocks, sure = self.grid.programs.with_margin(position, self.below, self.above, margin)
            capacity = (0, 0) if last is None else last.capacity()
            compiled = self.reused and last is not None
            graph = self._graph = SurfaceGraph(self, blocks, sure, position.shape[0], *capacity, compiled)
        raise RunStopped(
            "out_of_grid",
            "A particle left the background grid of the surface, or is at no finite place: take a smaller step, or put"
            " walls around the liquid.",
        )

    def force(self, samples: Samples, blocks: Blocks) -> Any:
        graph = self._graph
        if self.reused and graph is not None and samples is graph.samples and blocks is graph.blocks:
            return graph.force()
        from refsim.surface_energy.kernels_cuda import surface_force  # it imports from here

        force, cells = self._empty((nodes(blocks), 3)), self.grid.by_cell(samples.position, blocks, 0.5)
        place, normal, area, _ = samples
        surface_force(place, area, normal, cells, blocks, self.term, Scratch(self.backend), force)
        return force


class SurfaceGraph:
    """The surface of `particles` particles in given blocks, with capacities above so many vertices and facets.

    sure      (blocks,) whether all blocks in reach of a block's particles exist
    compiled  whether all of its kernels are compiled: they can then be recorded without being launched first
    """

    def __init__(
        self, reconstruction: Any, blocks: Blocks, sure: Any, particles: int, vertices: int, facets: int,
        compiled: bool,
    ) -> None:  # fmt: skip
        self.owner, self.blocks, self.particles, self.compiled = reconstruction, blocks, particles, compiled
        self.kind = reconstruction.tension.normals
        v, f = vertices + vertices // MARGIN + 8, facets + facets // MARGIN + 8
        self.arrays = stages.work_arrays(
            reconstruction.backend.empty, reconstruction.dim, reconstruction.dtype, nodes(blocks), particles, v, f
        )
        device.fill(self.arrays["cell"], -1)  # of each particle, where it was last
        device.fill(self.arrays["coefficients"], 0)  # which is not fitted for all kinds of normals
        self.sent = device.PinnedCopy(self.arrays["counts"])
        self.arrays |= {
            "blocks": blocks, "sure": sure, "surface_term": reconstruction.term, "sent": self.sent.there,
            "table": case_tables(reconstruction.backend, reconstruction.dim, reconstruction.table_merged)[0],
            "least": np.int32(reconstruction.tension.least_component(reconstruction.dim)),
            "mls": None if self.kind == "gradient" else np.int32(1),
        }  # fmt: skip
        self.mark = device.Event()
        self.graphs: dict[Any, tuple[device.CudaGraph, ...]] = {}
        self.pulling = device.CudaGraph(lambda: stages.pull(self.arrays))
        self.samples: Samples | None = None
        self._views: dict[str, Any] = {}

    def capacity(self) -> tuple[int, int]:
        """Vertices and facets for which another one should have capacity."""
        counts, a = self.sent.values, self.arrays
        capacity = a["vertex_edge"].shape[0], a["facets"].shape[0]
        if counts[MISSING]:  # what was found is incomplete; what fits was found once
            return capacity[0] * MARGIN // (MARGIN + 1), capacity[1] * MARGIN // (MARGIN + 1)
        return int(counts[EDGES]), int(counts[FACETS])

    def surface(self, position: Any, number: Any, volume: float | None = None) -> RecordedSurface | None:
        """The surface of particles `number` (n,) at `position` (n, 3) [m]; None where it does not fit.

        volume  that it encloses [m^dim], for which the host looks at its normals; None where the inset is given
        """
        key = device.address(position), device.address(number), volume is None
        self.owner._seconds = {}
        if key not in self.graphs:
            while len(self.graphs) >= GRAPHS:
                del self.graphs[next(iter(self.graphs))]
            a = self.arrays | {"position": position, "number": number}
            parts = [partial(self._level_set, a), partial(self._fit, a, volume is None)]
            if volume is not None:
                parts.append(partial(self._samples, a))
            self.graphs[key] = tuple(map(self._recorded, parts))
        cut, fit, *samples = self.graphs[key]
        cut()
        self.mark.set()
        fit()
        self.mark.wait()
        a, view, counts = self.arrays, self._view, self.sent.values
        vertices, facets = int(counts[VERTICES]), int(counts[MADE])
        suffices = not counts[MISSING] and facets == counts[FACETS]
        if volume is not None and suffices:
            mesh = Mesh(view("vertex_position", vertices), view("facets", facets))
            normal, moved = view("vertex_normal", vertices), view("inset_position", vertices)
            inset = self.owner.dtype.type(self.owner.enclosing(mesh, normal, volume))
            self.owner._run("inset", mesh.vertices, normal, self.owner.term._replace(inset=inset), moved)
        for call in samples:
            call()
        self.compiled = True
        if not suffices:
            self.sent.read()
            return None
        names = ("sample_position", "sample_normal", "sample_area", "nearest")
        place, normal, area, nearest = (view(name, facets) for name in names)  # `position` belongs to the graphs
        self.samples = Samples(place, normal, area, nearest)
        padded = Samples(*(a[name] for name in names))
        cells = stages.named(a, "cells")
        later = {
            "mesh": lambda: Mesh(view("vertex_position", vertices), view("facets", facets)),
            "inset_mesh": lambda: Mesh(view("inset_position", vertices), view("facets", facets)),
            "component_size": self._component_size,
            "coefficients": lambda: a["coefficients"],
            "facet_normal": lambda: view("facet_normal", facets),
            "offset_direction": lambda: view("outward", facets),
            "sample_place": lambda: view("sample_place", facets),
        }
        recorded = RecordedSurface(self.samples, padded, self.blocks, cells, later, self.sent)
        recorded.seconds = self.owner._seconds
        return recorded

    def force(self) -> Any:
        """Force of the latest samples on the nodes (nodes, 3) [N]."""
        self.pulling()
        return self.arrays["node_force"]

    # Inside

    def _recorded(self, call: Callable[[], None]) -> device.CudaGraph:
        """The call to be recorded, at once where its kernels are compiled."""
        graph = device.CudaGraph(call)
        graph.called = self.compiled
        return graph

    def _view(self, name: str, count: int) -> Any:
        """The first rows of an array."""
        held = self._views.get(name)
        if held is None or held.shape[0] != count:
            held = self._views[name] = device.head(self.arrays[name], count)
        return held

    def _level_set(self, a: Arrays) -> None:
        """Cells, node states, and how many vertices and facets there are."""
        self.owner._stage("cells", stages.sort_particles, a)
        self.owner._stage("level set and facets", stages.launch, a, level_set_cuda.states_of_blocks)
        self.owner._stage("level set and facets", stages.count_cuts, a)

    def _fit(self, a: Arrays, whole: bool) -> None:
        """From vertices and facets to normals, fitted or those of facets or offsets; as a `whole` the samples, too."""
        device.launch_after([
            self._part("components", stages.join_components, a),
            self._part("level set and facets", stages.launch, a, samples_cuda.place_vertices),
            self._part("offsets", stages.launch, a, samples_cuda.place_points),
            self._part("fit", self._sweep, a),
            self._part("offsets", stages.launch, a, samples_cuda.turn_vertices),
            self._part("normals", self._normals, a),
            *((partial(self._samples, a),) if whole else ()),
        ], [(), (), (1,), (2,), (1,), (3, 4), (5, 0)][: 7 if whole else 6])  # fmt: skip

    def _part(self, name: str, *call: Any) -> Callable[[], None]:
        """What is launched for a stage."""
        return partial(self.owner._stage, name, *call)

    def _sweep(self, a: Arrays) -> None:
        """The fit, for normals that need one."""
        if self.kind in ("mls", "gradient"):
            stages.sort_points(a)
            stages.sweep(a)

    def _normals(self, a: Arrays) -> None:
        """Normals of samples and vertices; for "facets", without a gradient, the direction handed in."""
        outward = a["facet_normal" if self.kind == "facets" else "outward"]
        stages.launch({**a, "outward": outward}, samples_cuda.find_normals)

    def _samples(self, a: Arrays) -> None:
        """The samples after the inset."""
        self.owner._stage("inset", stages.launch, a, samples_cuda.place_samples)

    def _component_size(self) -> Any:
        """Particles in the component of each particle."""
        a = self.arrays
        size = self.owner.backend.empty(a["cell"].shape[0], np.int32)
        look_up_members(a["cell"], a["node_label"], a["members"], size)
        return size
