"""When the neighbour list is rebuilt.

The list holds every pair nearer than radius + skin at the moment it is built. Until some particle has moved by half the
skin it is used without a further check. From then on relative displacements decide: the list is kept while no pair can
have come within the radius; each step reduces the margin that is left.
"""

import math
from typing import TYPE_CHECKING

from refsim.neighbours import NeighbourSearch, Particles
from refsim.scene.plan import Plan

if TYPE_CHECKING:
    from refsim.engine.stepping import Advance

WORTH_KEEPING = 0.2  # of the allowed displacement; with less left, rebuilding costs less than checks


class ListPolicy:
    """Decides whether the neighbour list still holds every pair within the radius.

    squared_displacement  largest since the list was built [m^2]; infinite where it is not known
    margin                relative displacement [m] left to two particles at the latest check; 0 before the first
    step_displacement     bound on that of the latest step [m], of length `length` [s]
    rate                  change of the margin [m/s] if velocities stay, for `ahead` [s]; None where it is not known
    gained                bound on the change of the velocities [m/s] since the latest check
    by_forces             whether velocities change by accelerations alone, so that these bound a step's displacement
    """

    def __init__(self, plan: Plan, search: NeighbourSearch | None) -> None:
        self.search = search
        self.walls = plan.walls is not None
        self.by_forces = not any(
            effect is not None and {"velocity", "position"} & {*p.updates, *p.writes} for effect, p in plan.motion
        )
        self.squared_displacement = math.inf
        self.margin = self.step_displacement = self.length = self.ahead = self.gained = 0.0
        self.rate: float | None = None

    def needs_no_look(self) -> bool:
        """Whether the bounds of the steps alone show that the list is complete; true where there is no list."""
        if self.search is None:
            return True
        return self.squared_displacement <= self.search.allowed_displacement**2 or self.margin > 0

    def keeps(self, particles: Particles) -> bool:
        """Whether relative displacements allow to keep the list; then `margin` [m] says for how long."""
        search = self.search
        if search is None or not math.isfinite(self.squared_displacement):
            return False
        if not (self.by_forces or search.looks_ahead):
            return False
        way, self.ahead, self.gained = math.sqrt(self.squared_displacement), search.ahead(self.length), 0.0
        farther = way + (self.step_displacement * self.ahead / self.length if self.length else 0.0)
        margin, *then = search.margins(particles, (way, farther), self.walls)
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

    def after_step(self, done: "Advance") -> None:
        """Note a step."""
        self.squared_displacement, self.step_displacement = done.squared_displacement, done.step_displacement
        self.length = done.length
        self.gained += done.velocity_change
        self.margin = max(self._left(done.length, self.gained), 0.0)
        self.ahead -= done.length
        if self.rate is not None and (done.stopped or self.margin == 0):
            self._forget()

    def _left(self, length: float, gained: float) -> float:
        """Margin [m] after a step of this length [s], before which velocities had changed by up to `gained` [m/s]."""
        if self.rate is None:
            return self.margin - 2 * self.step_displacement
        return self.margin + length * (self.rate - 2 * gained) if length <= self.ahead else 0.0

    def after_build(self) -> None:
        """Note that the list was built where the particles are."""
        self.squared_displacement = 0.0
        self._forget()

    def invalidate(self) -> None:
        """Have the list rebuilt before its next use."""
        self.squared_displacement = math.inf
        self._forget()

    def velocities_set(self) -> None:
        """Note that velocities are no longer those that were compared: nothing is known of the time ahead."""
        self.length = 0.0
        if self.rate is not None:
            self._forget()

    def _forget(self) -> None:
        """Have displacements compared anew, once a particle has moved by half the skin."""
        self.margin, self.rate = 0.0, None
