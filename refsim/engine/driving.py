"""Work of motions, of moving faces of walls and of the pressure that is extrapolated to solids, step by step."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.core.capabilities import BringsWalls, effects_with
from refsim.core.effect import Effect, Pass
from refsim.engine.launching import bring, launch_pass, ready
from refsim.engine.motions import Drive
from refsim.engine.state import State
from refsim.engine.wall_forces import FRICTION, WallForces, taken
from refsim.shape_matching.phases import FLUID

PUSH = "two_way_coupling.push"  # between liquid and solids with an extrapolated pressure
BY_WALLS = "adami_2012.wall_force"


class Driving:
    """The work done on a run since `renew`.

    work  [J; J/m in 2D]

    A step moves a particle by dt v between two forces, and each of them acts for half of it: forces of the frame work
    along dt v with the mean of both, and so do solids; faces with the mean of the power at both ends.
    """

    def __init__(self, run: State) -> None:
        plan = run.plan
        self.solids: list[tuple[Effect, Pass]] = []
        if any(p.operation == PUSH for _, p in plan.passes):
            self.solids = [part for part in plan.passes if part[1].operation in (PUSH, BY_WALLS)]
        self.forces: WallForces | None = None
        if "wall_motion" in plan.shared:
            self.forces = WallForces(run)
            low, high = plan.shared["wall_motion"].lower, plan.shared["wall_motion"].upper
            place = plan.grid.local(plan.walls.position)
            moving = ((place < low) | (place > high)).any(1)
            self.volume = self.forces.volumes(run, np.where(moving, plan.walls.volume, 0.0))
            extrapolated = any(effect.extrapolates() for effect in effects_with(plan.effects, BringsWalls))
            pushing = self.forces.passes if extrapolated else ()
            self.passes = [part for part in self.forces.passes if part[1].operation in FRICTION]
            self.pressing = [part for part in pushing if part[1].operation not in FRICTION]
        self.renew()

    def renew(self) -> None:
        """Begin anew: the state was set between two steps."""
        self.work, self.power, self.drive, self.push = 0.0, math.nan, None, None

    drive: Drive | None  # at the beginning of the step
    push: NDArray[np.float64] | None  # of solids at the beginning of the step

    def begin(self, run: State) -> None:
        """Note what acts at the beginning of a step."""
        self.drive = None if run.motions is None else run.motions.drive
        if self.forces is not None and math.isnan(self.power):
            self.power = self._of_faces(run, self.forces)
        if self.solids and self.push is None:
            self.push = self._of_solids(run)

    def after_step(self, run: State) -> None:
        """Add the work of the step."""
        if self.drive is not None:
            mass, velocity, place = (run.host(n).astype(float) for n in ("mass", "velocity", "position"))
            way = velocity * run.previous_length
            mean = 0.5 * (self.drive.at(place - way) + run.motions.drive.at(place))  # type: ignore[union-attr]
            self.work += math.fsum(mass * (mean * way).sum(1))
        if self.forces is not None:
            before, self.power = self.power, self._of_faces(run, self.forces)
            self.work += 0.5 * (before + self.power) * run.previous_length
        if self.push is not None:
            push = self._of_solids(run)
            way = run.in_first_order(run.host("velocity").astype(float)) * run.previous_length
            self.work += math.fsum(0.5 * ((self.push + push) * way).sum(1))
            self.push = push

    def _of_solids(self, run: State) -> NDArray[np.float64]:
        """Forces (n, 3) [N] of the pressure p_k of solids' particles, V_j V_k p_k grad W_jk, and of walls on solids, in
        the first order.

        The liquid's own pressure works on the strain that its density takes, and so do walls on it; p_k works on one
        that no density has.
        """
        dtype = run.plan.grid.dtype
        ready(run)
        bring(run, {name for _, p in self.solids for name in p.reads})
        liquid = run.host("phase") == FLUID
        pressure = np.where(liquid, 0.0, run.host("pressure")).astype(dtype)
        force = np.zeros((len(liquid), 3))
        for effect, p in self.solids:
            pushed = run.backend.zeros(force.shape, dtype)
            given = {"acceleration": pushed, "pressure": run.backend.asarray(pressure)}
            launch_pass(run, dataclasses.replace(p, algorithm="plain"), given, run.parameters[effect.name])
            acting = ~liquid if p.operation == BY_WALLS else np.ones(len(liquid), bool)
            force += acting[:, None] * np.asarray(run.backend.host(pushed), dtype=float)
        return run.in_first_order(run.host("mass")[:, None] * force)

    def _of_faces(self, run: State, forces: WallForces) -> float:
        """Power [W] of the moving faces: their friction and the liquid's own pressure on them, times their velocity.

        The pressure of their particles works on the strain that the density takes, and on solids (`_of_solids`).
        """
        reads = {name for _, p in (*self.passes, *self.pressing) for name in p.reads}
        ready(run)
        bring(run, reads)
        rows = forces.rows(run)
        wall: NDArray[np.float64] = np.asarray(run.backend.host(run.shared["wall_motion"].velocity), dtype=float)
        push = forces.acceleration(run, self.passes, self.volume, rows)
        if self.pressing:
            none: Any = run.backend.zeros(run.fields["wall_pressure"].shape, run.plan.grid.dtype)
            given = {"wall_pressure": none}
            if self.solids:
                wet = np.where(run.host("phase") == FLUID, run.host("pressure"), 0.0)
                given["pressure"] = run.backend.asarray(wet.astype(run.plan.grid.dtype))
            push += forces.acceleration(run, self.pressing, self.volume, rows, **given)
        return math.fsum(taken(run, run.fields["mass"], rows) * (push @ wall))
