"""The order of the particles in memory: cell by cell, so that neighbouring threads read contiguous memory."""

import functools
import math
from typing import Any

from refsim.core.capabilities import NeedsCellOrder, having
from refsim.engine.run import Run
from refsim.neighbours import NeighbourSearch

SORT_EVERY = 50  # steps between two sortings of particles that no neighbour list sorts


class ParticleOrder:
    """Puts the particles of a run into cell order: for the neighbour list, or now and then where there is none."""

    def __init__(self, run: Run) -> None:
        plan, grid = run.plan, run.plan.grid
        self.run = run
        size = max((e.sorting_cell(grid) for e in having(plan.effects, NeedsCellOrder)), default=0.0)
        self._cells: NeighbourSearch | None = None
        if plan.list_radius == 0 and size > 0 and run.backend.name != "numpy":
            self._cells = NeighbourSearch(run.backend, grid.dim, grid.dtype, size, 0.0)
        # Groups that update their own arrays before a step that is one CUDA graph; they also give an order (`order`).
        self._attended: list[Any] = []
        if run.backend.name == "cuda" and not any(e.host_in_step for e in plan.effects.values()):
            groups = run._parameters.values()
            self._attended = [value for group in groups for value in group.values() if hasattr(value, "attend")]
        self._rows: Any = None

    @property
    def attends(self) -> bool:
        """Whether groups make arrays before each step."""
        return bool(self._attended)

    def due(self) -> bool:
        """Whether particles that no neighbour list sorts are to be sorted before this step."""
        return self._cells is not None and self.run.steps % SORT_EVERY == 0

    def sort(self, search: NeighbourSearch, before_build: bool = False) -> None:
        """Put the particles into the cell order of `search` and note their positions in `build_position`."""
        run, names = self.run, self._names()
        arrays = [run.fields[name] for name in names]
        moved = search.sort(run.fields["position"], arrays, run.build_position, before_build, self.renumber)
        run.fields |= zip(names, moved)
        if not search.looks_ahead:
            self.renumber()

    def sort_alone(self) -> None:
        """Sort where it is due and no attended group gives the order."""
        if self.due() and not self._attended:
            self.run.timings.run("sorting", self._sort_alone)

    def _sort_alone(self) -> None:
        assert self._cells is not None
        self.sort(self._cells)
        self.run.rebind()

    def attend(self) -> None:
        """Call `attend` of these groups with the positions: they make the arrays that the step needs."""
        moved = math.isinf(self.run.lists.policy.squared_displacement)  # set between two steps
        for each in self._attended:
            if each.attend(self.run.fields["position"], moved=moved):
                self.run.stepper.rebind()

    def follow(self) -> None:
        """Where sorting is due, put the particles into the order that an attended group gives."""
        for each in self._attended if self.due() else ():
            order = each.order(self.run.fields["position"])
            if order is not None:
                self.run.timings.run("sorting", functools.partial(self._follow, order))

    def _follow(self, order: Any) -> None:
        arrays = [self.run.fields[name] for name in self._names()]
        if self._rows is None or self._rows.order is not order or not self._rows.belongs_to(arrays):
            from refsim.backends import device

            self._rows = device.Rows(arrays, order)
        self._rows.launch()
        self.renumber()

    def renumber(self) -> None:
        """Bring the table of each particle's row up to the present order, where the scene has one."""
        fields = self.run.fields
        self.run.outdate()
        if "place" in fields:
            self.run.backend.invert(fields["identity"], fields["place"])

    def _names(self) -> list[str]:
        return [name for name, f in self.run.plan.particle_fields.items() if f.state]
