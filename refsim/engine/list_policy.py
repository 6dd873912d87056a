"""When the neighbour list is rebuilt.

The list holds every pair nearer than radius + skin at the moment it is built. Until some particle has moved by half the
skin it is used without a further check. From then on relative displacements decide: the list is kept while no pair can
have come within the radius; each step reduces the margin that is left.
"""

from __future__ import annotations

import math
from typing import Any

from refsim.neighbours import NeighbourSearch
from refsim.scene.scene import Plan

WORTH_KEEPING = 0.2  # of the allowed displacement; with less left, rebuilding costs less than checks


class ListPolicy:
    """Decides whether the neighbour list still holds every pair within the radius.

    squared_displacement  largest since the list was built [m^2]; infinite where it is not known
    margin                relative displacement [m] left to two particles at the latest check; 0 before the first
    step_displacement     bound on that of the latest step [m]
    by_forces             whether velocities change by accelerations alone, so that these bound a step's displacement
    """

    def __init__(self, plan: Plan, search: NeighbourSearch | None) -> None:
        self.search = search
        self.walls = plan.walls is not None
        self.by_forces = not any(
            effect is not None and {"velocity", "position"} & {*p.updates, *p.writes} for effect, p in plan.motion
        )
        self.squared_displacement = math.inf
        self.margin = self.step_displacement = 0.0

    def needs_no_look(self) -> bool:
        """Whether the bounds of the steps alone show that the list is complete; true where there is no list."""
        if self.search is None:
            return True
        return self.squared_displacement <= self.search.allowed_displacement**2 or self.margin > 0

    def keeps(self, position: Any, build_position: Any) -> bool:
        """Whether relative displacements allow to keep the list; then `margin` [m] says for how long.

        position, build_position  (n, 3) [m], now and when the list was built
        """
        search = self.search
        if search is None or not math.isfinite(self.squared_displacement):
            return False
        if not (self.by_forces or search.looks_ahead):
            return False
        margin = search.margin(position, build_position, math.sqrt(self.squared_displacement), self.walls)
        self.margin = margin if self.by_forces else 0.0  # without a bound on the step, every step is followed by a look
        return margin > (0.0 if search.looks_ahead else WORTH_KEEPING) * search.allowed_displacement

    def expects_look(self) -> bool:
        """Whether displacements will probably have to be compared after a step like the latest one."""
        if self.search is None or not math.isfinite(self.squared_displacement):
            return False
        largest = math.sqrt(self.squared_displacement) + self.step_displacement
        return largest > self.search.allowed_displacement and self.margin <= 2 * self.step_displacement

    def after_step(self, squared_displacement: float, step_displacement: float) -> None:
        """Note a step: the largest squared displacement since the build [m^2], and a bound on that of the step [m]."""
        self.squared_displacement, self.step_displacement = squared_displacement, step_displacement
        self.margin = max(self.margin - 2 * step_displacement, 0.0)

    def after_build(self) -> None:
        """Note that the list was built where the particles are."""
        self.squared_displacement = self.margin = 0.0

    def invalidate(self) -> None:
        """Have the list rebuilt before its next use."""
        self.squared_displacement, self.margin = math.inf, 0.0
