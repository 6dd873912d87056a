"""Work of motions, of moving faces of walls and of the pressure that is extrapolated to solids, step by step."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.core.capabilities import BringsWalls, having
from refsim.core.effect import Effect, Pass
from refsim.engine.binding import bound
from refsim.engine.motions import Drive
from refsim.engine.run import Run
from refsim.engine.wall_forces import FRICTION, WallForces
from refsim.shape_matching.phases import FLUID

PUSH = "two_way_coupling.push"  # between liquid and solids with an extrapolated pressure
BY_WALLS = "adami_2012.wall_force"


class Driving:
    """The work done on a run since `renew`.

    work  [J; J/m in 2D]

    A step moves a particle by dt v between two forces, and each of them acts for half of it: forces of the frame work
    along dt v with the mean of both, and so do solids; faces with the mean of the power at both ends.
    """

    def __init__(self, run: Run) -> None:
        self.run, plan = run, run.plan
        self.solids: list[tuple[Effect, Pass]] = []
        if any(p.operation == PUSH for _, p in plan.passes):
            self.solids = [part for part in plan.passes if part[1].operation in (PUSH, BY_WALLS)]
        self.forces: WallForces | None = None
        if "wall_motion" in plan.shared:
            self.forces = WallForces(run)
            low, high = plan.shared["wall_motion"].lower, plan.shared["wall_motion"].upper
            place = plan.grid.local(plan.walls.position)
            moving = ((place < low) | (place > high)).any(1)
            self.volume = self.forces.volumes(np.where(moving, plan.walls.volume, 0.0))
            extrapolated = any(effect.extrapolates() for effect in having(plan.effects, BringsWalls))
            pushing = self.forces.passes if extrapolated else ()
            self.passes = [part for part in self.forces.passes if part[1].operation == FRICTION]
            self.pressing = [part for part in pushing if part[1].operation != FRICTION]
        self.renew()

    def renew(self) -> None:
        """Begin anew: the state was set between two steps."""
        self.work, self.power, self.drive, self.push = 0.0, math.nan, None, None

    drive: Drive | None  # at the beginning of the step
    push: NDArray[np.float64] | None  # of solids at the beginning of the step

    def begin(self) -> None:
        """Note what acts at the beginning of a step."""
        self.drive = None if self.run.motions is None else self.run.motions.drive
        if self.forces is not None and math.isnan(self.power):
            self.power = self._of_faces(self.forces)
        if self.solids and self.push is None:
            self.push = self._of_solids()

    def after_step(self) -> None:
        """Add the work of the step."""
        run = self.run
        if self.drive is not None:
            mass, velocity, place = (run._host(n).astype(float) for n in ("mass", "velocity", "position"))
            way = velocity * run.previous_length
            mean = 0.5 * (self.drive.at(place - way) + run.motions.drive.at(place))
            self.work += math.fsum(mass * (mean * way).sum(1))
        if self.forces is not None:
            before, self.power = self.power, self._of_faces(self.forces)
            self.work += 0.5 * (before + self.power) * run.previous_length
        if self.push is not None:
            push = self._of_solids()
            way = self._in_first_order(run._host("velocity")) * run.previous_length
            self.work += math.fsum(0.5 * ((self.push + push) * way).sum(1))
            self.push = push

    def _of_solids(self) -> NDArray[np.float64]:
        """Forces (n, 3) [N] of the pressure p_k of solids' particles, V_j V_k p_k grad W_jk, and of walls on solids, in
        the first order.

        The liquid's own pressure works on the strain that its density takes, and so do walls on it; p_k works on one
        that no density has.
        """
        run, dtype = self.run, self.run.plan.grid.dtype
        run.lists.update()
        run.order.attend()
        run.bring(sorted({name for _, p in self.solids for name in p.reads}))
        liquid = run._host("phase") == FLUID
        pressure = np.where(liquid, 0.0, run._host("pressure")).astype(dtype)
        force = np.zeros((len(liquid), 3))
        for effect, p in self.solids:
            found = run.backend.zeros(force.shape, dtype)
            given = {"acceleration": found, "pressure": run.backend.asarray(pressure)}
            sources = (given, run._parameters[effect.name], run._shared, run.fields)
            run.timings.run(p.operation, bound(dataclasses.replace(p, algorithm="plain"), run.backend, sources))
            acting = ~liquid if p.operation == BY_WALLS else np.ones(len(liquid), bool)
            force += acting[:, None] * np.asarray(run.backend.host(found), dtype=float)
        return self._in_first_order(run._host("mass")[:, None] * force)

    def _in_first_order(self, rows: NDArray) -> NDArray[np.float64]:
        ordered = np.empty(rows.shape)
        ordered[self.run._host("identity")] = rows
        return ordered

    def _of_faces(self, forces: WallForces) -> float:
        """Power [W] of the moving faces: their friction and the liquid's own pressure on them, times their velocity.

        The pressure of their particles works on the strain that the density takes, and on solids (`_of_solids`).
        """
        run = self.run
        reads = {name for _, p in (*self.passes, *self.pressing) for name in p.reads}
        run.lists.update()
        run.order.attend()
        run.bring(sorted(reads))
        rows = forces.rows()
        wall: NDArray[np.float64] = np.asarray(run.backend.host(run._shared["wall_motion"].velocity), dtype=float)
        push = forces.acceleration(self.passes, self.volume, rows)
        if self.pressing:
            none: Any = run.backend.zeros(run.fields["wall_pressure"].shape, run.plan.grid.dtype)
            given = {"wall_pressure": none}
            if self.solids:
                wet = np.where(run._host("phase") == FLUID, run._host("pressure"), 0.0)
                given["pressure"] = run.backend.asarray(wet.astype(run.plan.grid.dtype))
            push += forces.acceleration(self.pressing, self.volume, rows, **given)
        return math.fsum(forces.taken(run.fields["mass"], rows) * (push @ wall))
