"""The neighbour lists of a run, when they are rebuilt, and the order of its particles.

The list holds every pair nearer than radius + skin at the moment it is built. Until some particle has moved by half the
skin it is used without a further check. From then on relative displacements decide: the list is kept while no pair can
have come within the radius; each step reduces the margin that is left.
"""

import math
from typing import Any

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core.capabilities import BringsWalls, CorrectsPositions, NeedsCellOrder, effects_with
from refsim.core.walls import WallParticles
from refsim.engine.limits import StepOutcome
from refsim.neighbours import NeighbourSearch, Particles
from refsim.neighbours.limits import FEW_STEPS, GPU_SKINS, MANY_STEPS
from refsim.scene.plan import Plan
from refsim.sph import WAY

WORTH_KEEPING = 0.2  # of the allowed displacement; with less left, rebuilding costs less than checks


class Lists:
    """The lists of a run, of the particles and of the wall particles near each, and whether they hold every pair.

    search          of the particles; None where no effect needs neighbours, and on backend "numpy", which sums over all
                    pairs
    latest          the lists that passes take: of particles, of walls near each, of particles near each wall particle
    static, walls   wall particles in cell order: their set; their positions and volumes on the backend. Or None
    around_walls    whether there is a list of the particles near each wall particle, too
    auditable       whether a step moves every particle by dt v and a shift, from which its previous position follows
    velocities_set  whether velocities are others than those that led to the positions, which excludes an audit
    ways_renewed    whether the ways of the shifts are, which does too
    squared_displacement  largest since the list was built [m^2]; infinite where it is not known
    margin          relative displacement [m] left to two particles at the latest check; 0 before the first
    step_displacement  bound on that of the latest step [m], of length `length` [s]; `shifted` its part beside dt v
    rate            change of the margin [m/s] if velocities stay, for `ahead` [s]; None where it is not known
    gained          bound on the change of the velocities [m/s] since the latest check
    skins           that lists may take, the first at first; `built_at` is the step before which the latest was built
    by_forces       whether velocities change by accelerations alone, so that these bound a step's displacement
    """

    def __init__(self, plan: Plan, backend: Backend, shared: dict[str, Any]) -> None:
        grid, effects, dtype = plan.grid, plan.effects, np.dtype(plan.grid.dtype)
        self.search: NeighbourSearch | None = None
        if plan.list_radius > 0 and backend.name != "numpy":
            period = plan.shared["period"]
            self.skins = plan.scene.skins
            if backend.name == "cuda" and len(self.skins) > 1:
                self.skins = GPU_SKINS
            options = plan.list_radius, self.skins[0], period, max(self.skins)
            self.search = NeighbourSearch(backend, grid.dim, grid.dtype, *options)
        self.latest: tuple[Any, Any, Any] | None = None
        self.static: Any = None
        self.walls: tuple[Any, Any] | None = None
        self.around_walls = any(effect.extrapolates() for effect in effects_with(effects, BringsWalls))
        self.auditable = not any(
            effect.corrects_positions() and WAY.name not in (f.name for f in effect.fields(effects))  # type: ignore[attr-defined]
            for effect in effects_with(effects, CorrectsPositions)
        )
        self.velocities_set = self.ways_renewed = False
        self.by_forces = not any(
            effect is not None and {"velocity", "position"} & {*p.updates, *p.writes} for effect, p in plan.motion
        )
        self.squared_displacement = math.inf
        self.built_at = 0
        self.margin = self.step_displacement = self.shifted = self.length = self.ahead = self.gained = 0.0
        self.rate: float | None = None
        shared |= {"neighbours": None, "liquid_near_walls": None}
        if plan.walls is not None:
            position = grid.local(plan.walls.position)
            if self.search is None:
                shared["walls"] = WallParticles(position.astype(dtype), plan.walls.volume.astype(dtype))
            else:
                self.static = self.search.static_set(position)
                volume = backend.asarray(self.in_list_order(plan.walls.volume).astype(dtype))
                self.walls = self.static.position, volume
                if plan.shared["wall_normal"] is not None:
                    shared["wall_normal"] = backend.asarray(self.in_list_order(plan.shared["wall_normal"]))

    @property
    def built(self) -> bool:
        """Whether there is a list."""
        return self.latest is not None

    @property
    def brief(self) -> bool:
        """Whether the list is a GPU's narrowest: to build it anew is quicker than to compare displacements."""
        return self.search is not None and self.search.looks_ahead and self.search.skin < self.skins[0]

    def in_first_order(self, values: np.ndarray) -> np.ndarray:
        """A table of the wall particles in the order in which the effects gave them."""
        return values if self.static is None else self.static.in_first_order(values)

    def in_list_order(self, values: np.ndarray) -> np.ndarray:
        """A table of the wall particles in the order of the lists: the inverse of `in_first_order`."""
        return values if self.static is None else values[self.static.order]

    def needs_no_look(self) -> bool:
        """Whether the bounds of the steps alone show that the list is complete; true where there is no list."""
        if self.search is None:
            return True
        return self.squared_displacement <= self.search.allowed_displacement**2 or self.margin > 0

    def keeps(self, particles: Particles) -> bool:
        """Whether relative displacements allow to keep the list; then `margin` [m] says for how long."""
        search = self.search
        if search is None or self.brief or not math.isfinite(self.squared_displacement):
            return False
        if not (self.by_forces or search.looks_ahead):
            return False
        way, self.ahead, self.gained = math.sqrt(self.squared_displacement), search.ahead(self.length), 0.0
        farther = way + (self.step_displacement * self.ahead / self.length if self.length else 0.0)
        margin, *then = search.margins(particles, (way, farther), self.walls is not None)
        # Relative displacements of particles that keep their velocities are convex in time: between two times the
        # margin is at least what interpolation gives.
        known = then and self.by_forces and self.ahead > 0
        self.rate = (then[0] - margin) / self.ahead if known else None
        self.margin = margin if self.by_forces else 0.0  # without a bound on the step, every step is followed by a look
        return margin > (0.0 if search.looks_ahead else WORTH_KEEPING) * search.allowed_displacement

    def expects_look(self) -> bool:
        """Whether displacements will probably have to be compared after a step like the latest one."""
        if self.search is None or not math.isfinite(self.squared_displacement):
            return False
        largest = math.sqrt(self.squared_displacement) + self.step_displacement
        return largest > self.search.allowed_displacement and self._left(self.length, self.gained) <= 0

    def after_step(self, done: StepOutcome) -> None:
        """Note a step."""
        self.squared_displacement, self.step_displacement = done.squared_displacement, done.step_displacement
        self.length, self.shifted = done.length, done.shifted
        self.gained += done.velocity_change
        self.margin = max(self._left(done.length, self.gained), 0.0)
        self.ahead -= done.length
        if self.rate is not None and (done.stopped or self.margin == 0):
            self._forget()

    def _left(self, length: float, gained: float) -> float:
        """Margin [m] after a step of this length [s], before which velocities had changed by up to `gained` [m/s].

        What was compared ahead has no shifts.
        """
        if self.rate is None:
            return self.margin - 2 * self.step_displacement
        return self.margin + length * (self.rate - 2 * gained) - 2 * self.shifted if length <= self.ahead else 0.0

    def choose_skin(self, steps: int) -> None:
        """The skin of the next list, by the number of steps that the latest one served until step number `steps`.

        A wider list takes longer to build and to sum over, and is built more rarely; not where a particle crosses the
        widest skin in one step, so that it is tried at every MANY_STEPS-th only.
        """
        assert self.search is not None
        served, crossing = steps - self.built_at, (max(self.skins) * self.search.radius) ** 2
        hurried = served == 1 and crossing < self.squared_displacement < math.inf
        if self.outlasts(steps) or (hurried and steps % MANY_STEPS):
            self.search.reach_further(min(self.skins))
        elif served < FEW_STEPS:
            self.search.reach_further(max(self.skins))
        elif served > 2 * FEW_STEPS and self.search.skin > self.skins[0]:
            self.search.reach_further(self.skins[0])

    def outlasts(self, steps: int) -> bool:
        """Whether a list of the first skin served many steps and the narrowest would serve twice as many.

        A new one then saves more than it costs: the liquid rests, or creeps.
        """
        if self.search is None or not (least := min(self.skins)) < self.skins[0] == self.search.skin:
            return False
        moved = math.sqrt(self.squared_displacement)
        return steps - self.built_at > MANY_STEPS and moved <= 0.25 * least * self.search.radius

    def after_build(self, steps: int) -> None:
        """Note that the list was built where the particles are, after this number of steps."""
        self.built_at = steps
        self.squared_displacement = 0.0
        self._forget()

    def invalidate(self) -> None:
        """Have the list rebuilt before its next use."""
        self.squared_displacement = math.inf
        self._forget()

    def velocities_changed(self) -> None:
        """Note that velocities are no longer those that were compared: nothing is known of the time ahead."""
        self.length = 0.0
        if self.rate is not None:
            self._forget()

    def _forget(self) -> None:
        """Have displacements compared anew, once a particle has moved by half the skin."""
        self.margin, self.rate = 0.0, None


class Order:
    """What gives the particles their order in memory where no neighbour list sorts them.

    cells     the search whose cells they are sorted by now and then; None where none is needed
    attended  groups that update their own arrays before a step that is one CUDA graph, and give an order (`order`)
    rows      moves the particles into such an order
    """

    def __init__(self, plan: Plan, backend: Backend, parameters: dict[str, dict[str, Any]]) -> None:
        grid, groups = plan.grid, parameters.values()
        size = max((effect.sorting_cell(grid) for effect in effects_with(plan.effects, NeedsCellOrder)), default=0.0)
        sorted_alone = plan.list_radius == 0 and size > 0 and backend.name != "numpy"
        self.cells = NeighbourSearch(backend, grid.dim, grid.dtype, size, 0.0) if sorted_alone else None
        recorded = backend.name == "cuda" and not any(effect.host_in_step for effect in plan.effects.values())
        self.attended = [v for group in groups for v in group.values() if hasattr(v, "attend")] if recorded else []
        self.rows: Any = None
