"""A reconstruction on a CUDA device as one recorded graph, in arrays with room to spare.

The host launches it as a whole, learns how many vertices and facets there are while the device goes on, and waits once
at the end. Numbers that outgrow the room, or particles in blocks that are not there, make it ask for another one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from refsim.backends import device
from refsim.isosurface import Mesh, case_tables
from refsim.sparse_grid import Blocks, PointList, nodes
from refsim.sparse_grid.cuda import sum_blocks, write_first
from refsim.surface_energy import Tension
from refsim.surface_energy.recorded import cuda as kernels
from refsim.surface_energy.surface import Samples, Surface

ROOM = 4  # a share of this more than was found last
GRAPHS = 4  # particles may stand in so many arrays by turns


def suits(tension: Tension) -> bool:
    """Whether a surface with these parameters can be recorded: its numbers are known to the device alone."""
    return (
        tension.quadrature == "facets"
        and tension.normals in ("mls", "gradient")
        and tension.inset_distance() is not None
        and not tension.enclose_volume
    )


class RecordedSurface(Surface):
    """A surface whose arrays are the next one's, too; those that nobody asks for are not made."""

    def __init__(self, samples: Samples, blocks: Blocks, cells: PointList, later: dict[str, Callable[[], Any]]) -> None:
        self.samples, self.blocks, self.cells, self.seconds = samples, blocks, cells, {}
        self._later = later

    def __getattr__(self, name: str) -> Any:
        later = self.__dict__.get("_later", {})
        if name not in later:
            raise AttributeError(name)
        value = self.__dict__[name] = later[name]()
        return value


class Recorded:
    """The surface of `particles` particles in given blocks, with room for some more than so many vertices and facets.

    sure      (blocks,) whether all blocks in reach of a block's particles are there
    compiled  whether all of its kernels are: they can then be recorded without being launched first
    sufficed  whether blocks and room sufficed the last time
    """

    def __init__(
        self, reconstruction: Any, blocks: Blocks, sure: Any, particles: int, vertices: int, facets: int,
        compiled: bool,
    ) -> None:  # fmt: skip
        self.owner, self.blocks, self.sure = reconstruction, blocks, sure
        self.particles, self.compiled, self.sufficed = particles, compiled, True
        dim, real, count, n = reconstruction.dim, reconstruction.dtype, nodes(blocks), particles
        self.table = case_tables(reconstruction.backend, dim, reconstruction.table_merged)[0]
        self.mls = np.int32(1) if reconstruction.tension.normals == "mls" else None
        self.least = np.int32(reconstruction.tension.least_component(dim))
        v, f, b = vertices + vertices // ROOM + 8, facets + facets // ROOM + 8, count // 64
        shapes = {
            "held": count, "first": count + 1, "place": n, "unsorted": n, "placed": ((n, 3), real),
            "node_state": (count, np.uint8), "node_label": count, "members": count,
            "crossings": (count, np.uint8), "cell_case": (count, np.uint8),
            "cut_total": (b, np.int64), "edge_first": count, "facet_first": count, "vertex_edge": v,
            "facets": ((f, dim), np.int32), "vertex_position": ((v, 3), real), "vertex_outward": ((v, 3), real),
            "sample_place": ((f, 3), real), "facet_normal": ((f, 3), real), "outward": ((f, 3), real),
            "fit_position": ((2 * f, 3), real), "fit_cell": 2 * f, "fit_place": 2 * f, "held_points": count,
            "fit_first": count + 1, "fit_unsorted": 2 * f, "fit_splines": ((2 * f, 9), real),
            "fit_target": (2 * f, real), "node_weight": (count, real),
            "coefficients": (count, real), "rank": count,
            "filled": 2 * f, "pair_total": (b, np.int64), "reached": ((2 * f, 27), real), "change": ((2 * f, 27), real),
            "pulls": ((f, 81), real), "warps": (f // 2 + 1, np.uint8), "sample_normal": ((f, 3), real),
            "vertex_normal": ((v, 3), real),
            "inset_position": ((v, 3), real), "sample_position": ((f, 3), real), "sample_area": (f, real),
            "nearest": f, "sample_count": n, "either": (f + v, np.uint8), "total": b, "one": 1,
            "counts": kernels.COUNTS,
            "held_samples": count, "samples_first": count + 1, "sample_point": f, "node_force": ((count, 3), real),
        }  # fmt: skip
        arrays = {k: s if isinstance(s, tuple) else (s, np.int32) for k, s in shapes.items()}
        self.arrays = {name: reconstruction.backend.empty(shape, dtype) for name, (shape, dtype) in arrays.items()}
        self.cell = reconstruction.backend.empty(n, np.int32)  # of each particle, where it was last
        device.fill(self.cell, -1)
        self.found, self.ended = (device.Mirror(self.arrays["counts"]) for _ in range(2))
        self.mark = device.Mark()
        self.graphs: dict[Any, tuple[device.Recorded, ...]] = {}
        self.pulling = device.Recorded(self._pull)
        self.samples: Samples | None = None
        self._views: dict[str, Any] = {}

    def room(self) -> tuple[int, int]:
        """Vertices and facets that another one should have room for."""
        found, a = self.found.values, self.arrays
        made = a["vertex_edge"].shape[0], a["facets"].shape[0]
        if found[kernels.MISSING]:  # what was found is not whole; what there was room for was found once
            return made[0] * ROOM // (ROOM + 1), made[1] * ROOM // (ROOM + 1)
        return int(found[kernels.EDGES]), int(found[kernels.FACETS])

    def surface(self, position: Any) -> RecordedSurface | None:
        """The surface of particles at `position` (n, 3) [m]; None where it does not fit."""
        key = device.address(position)
        if key not in self.graphs:
            while len(self.graphs) >= GRAPHS:
                del self.graphs[next(iter(self.graphs))]
            parts = (lambda: self._cut(position)), (lambda: self._fit(position))
            self.graphs[key] = tuple(map(self._recorded, parts))
        cut, fit = self.graphs[key]
        cut()
        self.mark.set()
        fit()
        self.compiled = True
        self.mark.wait()
        counts = self.found.values
        vertices, facets = int(counts[kernels.VERTICES]), int(counts[kernels.MADE])
        self.sufficed = not counts[kernels.MISSING] and facets == counts[kernels.FACETS]
        if not facets:
            self.ended.read()
            return None
        a, view = self.arrays, self._view
        names = ("sample_position", "sample_normal", "sample_area", "nearest")
        self.samples = Samples(*(view(name, facets) for name in names), a["sample_count"])
        cells = PointList(a["first"], a["unsorted"], self.cell)
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
        made = RecordedSurface(self.samples, self.blocks, cells, later)
        made.most_in_a_cell, made.unfound = int(ended[kernels.MOST]), bool(ended[kernels.UNFOUND])
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

    def _cut(self, position: Any) -> None:
        """Cells, node states, and how many vertices and facets there are."""
        a, blocks, term = self.arrays, self.blocks, self.owner.term
        counts, total = a["counts"], a["total"]
        kernels.clear(a["held"], a["held_points"], a["members"], a["sample_count"], counts)
        kernels.count_particles(position, term, blocks, self.sure, a["held"], a["place"], self.cell, counts)
        kernels.total_blocks(a["held"], counts, total)
        sum_blocks(a["one"], total)
        write_first(a["held"], total, a["first"])
        kernels.fill_particles(position, self.cell, a["place"], a["first"], a["unsorted"], a["placed"])
        cells = PointList(a["first"], a["unsorted"], self.cell)
        kernels.states_of_blocks(a["placed"], cells, blocks, term, a["node_state"], a["node_label"], total)
        kernels.classify_blocks(blocks, a["node_state"], self.table, a["crossings"], a["cell_case"], a["cut_total"])
        kernels.sum_cuts(a["one"], a["cut_total"], a["vertex_edge"], a["facets"], counts)
        self.found.send()

    def _fit(self, position: Any) -> None:
        """Everything from vertices and facets to the samples."""
        a, blocks, term = self.arrays, self.blocks, self.owner.term
        counts, total, edge, facets = a["counts"], a["total"], a["vertex_edge"], a["facets"]
        cells = PointList(a["first"], a["unsorted"], self.cell)
        crossings, case, table = a["crossings"], a["cell_case"], self.table
        kernels.first_cuts(
            blocks, crossings, case, table, a["node_label"], a["edge_first"], a["facet_first"], a["cut_total"]
        )
        kernels.write_facets(
            blocks, crossings, case, a["edge_first"], a["facet_first"], table, counts, edge, facets, a["first"],
            a["node_label"], a["members"], a["cut_total"],
        )  # fmt: skip
        kernels.place_vertices(
            position,
            a["placed"],
            cells,
            blocks,
            a["node_state"],
            term,
            edge,
            counts,
            a["vertex_position"],
            a["vertex_outward"],
        )
        kernels.place_points(
            position, a["placed"], cells, blocks, term, edge, a["vertex_position"], facets, counts, a["sample_place"],
            a["facet_normal"], a["outward"], a["fit_position"], a["fit_cell"], a["fit_place"], a["held_points"],
        )  # fmt: skip
        splines, first, target = a["fit_splines"], a["fit_first"], a["fit_target"]
        self._number(a["held_points"], first)
        kernels.fill_points(a["fit_cell"], a["fit_place"], first, counts, a["fit_unsorted"])
        kernels.sort_points(
            a["fit_position"], a["fit_cell"], first, a["fit_unsorted"], blocks, term, counts, splines, target
        )
        weight, coefficients, rank, change = a["node_weight"], a["coefficients"], a["rank"], a["change"]
        listed = first, splines, target, a["filled"], blocks
        kernels.sum_fit(*listed, None, counts, a["reached"], change, a["warps"])
        kernels.begin_fit(first, rank, blocks, a["reached"], change, term, weight, coefficients, total)
        for _ in range(int(term.iterations) - 1):
            kernels.sum_fit(*listed, coefficients, counts, None, change, a["warps"])
            kernels.correct(rank, blocks, change, term, weight, coefficients, total)
        kernels.find_normals(
            a["sample_place"], a["outward"], a["vertex_position"], a["vertex_outward"], edge, facets, blocks, term,
            a["coefficients"], self.mls, counts, a["either"], a["sample_normal"], a["vertex_normal"],
            a["inset_position"],
        )  # fmt: skip
        kernels.place_samples(
            position, a["placed"], cells, blocks, term, edge, a["inset_position"], facets, a["node_label"],
            a["members"], self.least, a["sample_position"], a["sample_area"], a["nearest"], a["sample_count"], counts,
        )  # fmt: skip
        self.ended.send()

    def _pull(self) -> None:
        """The force of the samples."""
        a, blocks, term = self.arrays, self.blocks, self.owner.term
        counts, held, first = a["counts"], a["held_samples"], a["samples_first"]
        kernels.clear_samples(held)
        kernels.locate_samples(
            a["sample_position"], a["vertex_edge"], a["facets"], blocks, term, counts, held, a["fit_place"],
            a["fit_cell"],
        )  # fmt: skip
        self._number(held, first)
        kernels.fill_samples(a["fit_cell"], a["fit_place"], first, counts, a["fit_unsorted"])
        kernels.sort_samples(a["fit_cell"], first, a["fit_unsorted"], counts, a["sample_point"])
        kernels.sum_pulls(
            a["sample_position"], a["sample_area"], a["sample_normal"], first, a["sample_point"], a["filled"], counts,
            blocks, term, a["pulls"], a["warps"],
        )  # fmt: skip
        kernels.pull_nodes(first, a["rank"], blocks, a["pulls"], term, a["node_force"], a["total"])

    def _number(self, held: Any, first: Any) -> None:
        """first <- the points of the cells before each; cells with points are numbered."""
        a = self.arrays
        kernels.total_points(held, a["pair_total"])
        kernels.sum_points(a["one"], a["pair_total"], a["counts"])
        kernels.first_points(held, first, a["rank"], a["filled"], a["pair_total"])

    def _component_size(self) -> Any:
        """Particles in the component of each particle."""
        from refsim.surface_energy.cuda import look_up_members

        size = self.owner.backend.empty(self.cell.shape[0], np.int32)
        look_up_members(self.cell, self.arrays["node_label"], self.arrays["members"], size)
        return size
