"""The neighbour lists of a run: of the particles, and of the wall particles near each of them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from refsim.core.capabilities import BringsWalls, CorrectsPositions, having
from refsim.core.errors import RunStopped
from refsim.core.walls import WallParticles, liquid_with_list, with_list
from refsim.engine.list_policy import ListPolicy
from refsim.engine.run import Run
from refsim.neighbours import NeighbourSearch, Particles


class NeighbourLists:
    """Builds the lists of a run when `ListPolicy` requires it, and shares them with all passes.

    search          of the particles; None where no effect needs neighbours, and on backend "numpy", which sums over all
                    pairs
    auditable       whether a step moves every particle by dt v, so that the audit can compute its previous position
    velocities_set  whether velocities are others than those that led to the positions, which excludes an audit
    """

    def __init__(self, run: Run) -> None:
        plan, grid = run.plan, run.plan.grid
        self.run = run
        self.search: NeighbourSearch | None = None
        if plan.list_radius > 0 and run.backend.name != "numpy":
            self.search = NeighbourSearch(
                run.backend, grid.dim, grid.dtype, plan.list_radius, plan.scene.skin, plan.shared["period"]
            )
        self.policy = ListPolicy(plan, self.search)
        correctors = having(plan.effects, CorrectsPositions)
        self.auditable = not any(effect.corrects_positions() for effect in correctors)
        self.velocities_set = False
        self._lists: tuple[Any, Any, Any] | None = None
        self._static: Any = None
        self._walls: tuple[Any, Any] | None = None  # their positions and volumes on the backend, in cell order
        self.around_walls = any(effect.extrapolates() for effect in having(plan.effects, BringsWalls))
        run._shared |= {"neighbours": None, "liquid_near_walls": None}
        if plan.walls is not None:
            walls = plan.walls._replace(position=grid.local(plan.walls.position))
            self._prepare_walls(walls, np.dtype(grid.dtype))

    def _prepare_walls(self, walls: WallParticles, dtype: np.dtype) -> None:
        if self.search is None:
            self.run._shared["walls"] = WallParticles(walls.position.astype(dtype), walls.volume.astype(dtype))
            return
        self._static = self.search.static_set(walls.position)
        volume = self.run.backend.asarray(walls.volume[self._static.order].astype(dtype))
        self._walls = (self._static.position, volume)

    def in_first_order(self, values: np.ndarray) -> np.ndarray:
        """A table of the wall particles in the order in which the effects gave them."""
        return values if self._static is None else self._static.in_first_order(values)

    def in_list_order(self, values: np.ndarray) -> np.ndarray:
        """A table of the wall particles in the order of the lists: the inverse of `in_first_order`."""
        return values if self._static is None else values[self._static.order]

    @contextmanager
    def empty(self) -> Iterator[list[tuple[Any, tuple[Any, ...]]]]:
        """Share lists without entries, so that passes can be bound to their types; gives what builds and audits launch.

        For backend "cpu": (kernel, arguments) each.
        """
        run, before = self.run, dict(self.run._shared)
        launched = []
        if self.search is not None:
            from refsim.neighbours.rows import NeighbourRows  # loads Numba

            near = NeighbourRows(np.empty(0, np.int64), np.empty(0, np.int32), np.empty(0, np.uint32))
            run._shared |= {
                "neighbours": near, "liquid_near_walls": liquid_with_list(run.fields["position"], near)
            }  # fmt: skip
            if self._walls is not None:
                run._shared["walls"] = with_list(*self._walls, near)
            launched = self.search.programs.calls(run.build_position, run.fields.values(), run._shared.get("bounds"))
        yield launched
        run._shared.clear()
        run._shared.update(before)

    @property
    def built(self) -> bool:
        """Whether there is a list."""
        return self.run._shared["neighbours"] is not None

    def update(self) -> None:
        """Rebuild the lists where one may lack a pair; the particles are put into cell order before.

        Raises RunStopped where the audit of the old list finds that it lacked a neighbour.
        """
        if self.policy.needs_no_look():
            return
        self.run.timings.run("neighbours", self._look)

    def compare(self) -> None:
        """Compare displacements, whether or not it is due."""
        if self.search is not None and self.built:
            self.policy.keeps(self._particles())

    def look_ahead(self) -> bool:
        """Launch the comparison of displacements behind a step, if it will probably be needed, which is told; for a
        GPU."""
        expected = self.policy.expects_look()
        if self.search is not None and self.built:
            self.search.look_ahead(self._particles(), expected)
        return expected

    def _particles(self) -> Particles:
        run = self.run
        return Particles(run.fields["position"], run.build_position, run.fields["velocity"], run.timestep)

    def _look(self) -> None:
        run, search = self.run, self.search
        assert search is not None
        if self.built and self.policy.keeps(self._particles()):
            return
        # The audit steps positions back by the velocities, which must be those that led to them.
        if self.built and self.auditable and not self.velocities_set:
            position, velocity = run.fields["position"], run.fields["velocity"]
            neighbours, bounds = run._shared["neighbours"], run._shared.get("bounds")
            search.audit(position, velocity, run.timestep, neighbours, bounds, before_sort=True)
        run.order.sort(search, before_build=True)
        self.rebuild()
        missed = search.log.missed_neighbours
        if missed:
            raise RunStopped(
                "missed_neighbours",
                f"The neighbour list lacked {missed} neighbours of the audited particles up to step {run.steps} at"
                f" {run.time:.6g} s; give the scene a larger skin than {run.plan.scene.skin}.",
            )

    def rebuild(self) -> None:
        """Build the lists from the particles' present order and `build_position`."""
        run, known = self.run, self._lists
        assert self.search is not None
        near = self.search.build(run.build_position)
        at_walls = None if self._walls is None else self.search.build_against(run.build_position, self._static)
        around = self.search.build_around(run.build_position, self._static) if self.around_walls else None
        self.policy.after_build()
        run.outdate()
        if known is None or any(new is not old for new, old in zip((near, at_walls, around), known)):
            self._lists = (near, at_walls, around)
            run._shared["neighbours"] = near
            if around is not None:
                run._shared["liquid_near_walls"] = liquid_with_list(run.fields["position"], around)
            if self._walls is not None:
                run._shared["walls"] = with_list(*self._walls, at_walls)
            run.rebind()
