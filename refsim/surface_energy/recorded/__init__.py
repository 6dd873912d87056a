"""A reconstruction on a CUDA device as one recorded graph, in arrays with capacities above what was found last.

The host launches it as a whole, learns how many vertices and facets there are while the device goes on, and waits once
at the end. If a capacity is exceeded, or a particle stands in no block, the host enlarges the arrays and records the
graph again. Its stages are programs `cuda:recorded` of the operations whose outputs they compute (`programs.py`).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from refsim.backends import device
from refsim.isosurface import Mesh, case_tables
from refsim.sparse_grid import Blocks, PointList, nodes
from refsim.surface_energy.counts import look_up_members
from refsim.surface_energy.recorded import stages
from refsim.surface_energy.recorded.cells_cuda import EDGES, FACETS, MADE, MISSING, MOST, UNFOUND, VERTICES
from refsim.surface_energy.surface import Samples, Surface

MARGIN = 4  # a capacity is larger by 1/MARGIN than what was found last
GRAPHS = 4  # particles may stand in so many arrays by turns


class RecordedSurface(Surface):
    """A surface whose arrays are overwritten by the next one; arrays beside the samples are made on request.

    padded  the samples in all of their arrays: behind them are some at NaN, of area 0 and without a particle (-1)
    """

    def __init__(
        self, samples: Samples, padded: Samples, blocks: Blocks, cells: PointList, later: dict[str, Callable[[], Any]]
    ) -> None:
        self.samples, self.padded, self.blocks, self.cells, self.seconds = samples, padded, blocks, cells, {}
        self._later = later

    def __getattr__(self, name: str) -> Any:
        later = self.__dict__.get("_later", {})
        if name not in later:
            raise AttributeError(name)
        value = self.__dict__[name] = later[name]()
        return value


class SurfaceGraph:
    """The surface of `particles` particles in given blocks, with capacities above so many vertices and facets.

    sure      (blocks,) whether all blocks in reach of a block's particles exist
    compiled  whether all of its kernels are compiled: they can then be recorded without being launched first
    sufficed  whether blocks and capacities sufficed the last time
    """

    def __init__(
        self, reconstruction: Any, blocks: Blocks, sure: Any, particles: int, vertices: int, facets: int,
        compiled: bool,
    ) -> None:  # fmt: skip
        self.owner, self.blocks, self.sure = reconstruction, blocks, sure
        self.particles, self.compiled, self.sufficed = particles, compiled, True
        self.table = case_tables(reconstruction.backend, reconstruction.dim, reconstruction.table_merged)[0]
        self.mls = np.int32(1) if reconstruction.tension.normals == "mls" else None
        self.least = np.int32(reconstruction.tension.least_component(reconstruction.dim))
        v, f = vertices + vertices // MARGIN + 8, facets + facets // MARGIN + 8
        self.arrays = stages.work_arrays(
            reconstruction.backend.empty, reconstruction.dim, reconstruction.dtype, nodes(blocks), particles, v, f
        )
        device.fill(self.arrays["cell"], -1)  # of each particle, where it was last
        self.found, self.ended = (device.Mirror(self.arrays["counts"]) for _ in range(2))
        self.mark = device.Mark()
        self.graphs: dict[Any, tuple[device.Recorded, ...]] = {}
        self.pulling = device.Recorded(lambda: stages.pull(self.arrays, self.blocks, self.owner.term))
        self.samples: Samples | None = None
        self._views: dict[str, Any] = {}

    def capacity(self) -> tuple[int, int]:
        """Vertices and facets for which another one should have capacity."""
        found, a = self.found.values, self.arrays
        made = a["vertex_edge"].shape[0], a["facets"].shape[0]
        if found[MISSING]:  # what was found is incomplete; what fits was found once
            return made[0] * MARGIN // (MARGIN + 1), made[1] * MARGIN // (MARGIN + 1)
        return int(found[EDGES]), int(found[FACETS])

    def surface(self, position: Any, number: Any) -> RecordedSurface | None:
        """The surface of particles `number` (n,) at `position` (n, 3) [m]; None where it does not fit."""
        key = device.address(position), device.address(number)
        if key not in self.graphs:
            while len(self.graphs) >= GRAPHS:
                del self.graphs[next(iter(self.graphs))]
            parts = (lambda: self._level_set(position)), (lambda: self._samples(position, number))
            self.graphs[key] = tuple(map(self._recorded, parts))
        cut, fit = self.graphs[key]
        cut()
        self.mark.set()
        fit()
        self.compiled = True
        self.mark.wait()
        counts = self.found.values
        vertices, facets = int(counts[VERTICES]), int(counts[MADE])
        self.sufficed = not counts[MISSING] and facets == counts[FACETS]
        if not facets:
            self.ended.read()
            return None
        a, view = self.arrays, self._view
        names = ("sample_position", "sample_normal", "sample_area", "nearest")
        place, normal, area, nearest = (view(name, facets) for name in names)  # `position` belongs to the graphs
        self.samples = Samples(place, normal, area, nearest, a["sample_count"])
        place, normal, area, nearest = (a[name] for name in names)
        padded = Samples(place, normal, area, nearest, a["sample_count"])
        cells = stages.listed(a)
        later = {
            "mesh": lambda: Mesh(view("vertex_position", vertices), view("facets", facets)),
            "inset_mesh": lambda: Mesh(view("inset_position", vertices), view("facets", facets)),
            "component_size": self._component_size,
            "coefficients": lambda: a["coefficients"],
            "facet_normal": lambda: view("facet_normal", facets),
            "offset_direction": lambda: view("outward", facets),
            "sample_place": lambda: view("sample_place", facets),
        }
        ended = self.ended.read()
        made = RecordedSurface(self.samples, padded, self.blocks, cells, later)
        made.most_in_a_cell, made.unfound = int(ended[MOST]), bool(ended[UNFOUND])
        return made

    def force(self) -> Any:
        """Force of the latest samples on the nodes (nodes, 3) [N]."""
        self.pulling()
        return self.arrays["node_force"]

    # Inside

    def _recorded(self, call: Callable[[], None]) -> device.Recorded:
        """The call to be recorded, at once where its kernels are compiled."""
        made = device.Recorded(call)
        made.called = self.compiled
        return made

    def _view(self, name: str, count: int) -> Any:
        """The first rows of an array."""
        held = self._views.get(name)
        if held is None or held.shape[0] != count:
            held = self._views[name] = device.head(self.arrays[name], count)
        return held

    def _level_set(self, position: Any) -> None:
        """Cells, node states, and how many vertices and facets there are."""
        a, blocks, term = self.arrays, self.blocks, self.owner.term
        stages.sort_particles(a, position, blocks, term, self.sure)
        stages.mark_nodes(a, blocks, term)
        stages.count_cuts(a, blocks, self.table)
        self.found.send()

    def _samples(self, position: Any, number: Any) -> None:
        """Everything from vertices and facets to the samples."""
        a, blocks, term = self.arrays, self.blocks, self.owner.term
        stages.write_cuts(a, blocks, self.table)
        stages.place_vertices(a, position, number, blocks, term)
        stages.place_points(a, position, number, blocks, term)
        stages.sort_points(a, blocks, term)
        stages.sweep(a, blocks, term)
        stages.find_normals(a, blocks, term, self.mls)
        stages.place_samples(a, position, number, blocks, term, self.least)
        self.ended.send()

    def _component_size(self) -> Any:
        """Particles in the component of each particle."""
        a = self.arrays
        size = self.owner.backend.empty(a["cell"].shape[0], np.int32)
        look_up_members(a["cell"], a["node_label"], a["members"], size)
        return size
