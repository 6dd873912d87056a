"""Gravity, frames that turn and moving faces that follow the motions of a scene.

What moves stands in small arrays of the backend, which the passes read and the host sets between two steps: a step that
was recorded as a CUDA graph reads the values of its own time.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.backends.arrays import Backend
from refsim.core.errors import RunStopped
from refsim.scene.plan import Plan
from refsim.sph import acceleration_of

PULLS = "field", "lean"  # parameter groups that are the acceleration of gravity (3,) [m/s^2]


class Motions:
    """The motions of a run.

    gravity  acceleration of gravity in the scene's frame, (3,) [m/s^2], at the time that was set last
    """

    def __init__(
        self, plan: Plan, backend: Backend, parameters: dict[str, dict[str, Any]], shared: dict[str, Any]
    ) -> None:
        self.plan, self.backend = plan, backend
        self.moving = plan.scene.motion
        self.gravity = self.rest = np.array(acceleration_of(plan.effects))
        self.pulls: list[Any] = []
        self.faces: Any = None
        kinds = {motion.of for motion in self.moving}
        self.turning: Any = shared["turning"] if "turn" in kinds else None
        if kinds & {"gravity", "turn"}:
            for groups in parameters.values():
                for name in PULLS:
                    if groups.get(name) is not None:
                        groups[name] = backend.asarray(self.rest.astype(plan.grid.dtype))
                        self.pulls.append(groups[name])
        if "moving_faces" in kinds:
            self.faces = shared["wall_motion"].velocity
            self.face_velocity = np.asarray(plan.shared["wall_motion"].velocity, dtype=float)
        self.move(0.0)

    def move(self, time: float) -> None:
        """Set what passes read to `time` [s]. Raises RunStopped where a motion has no finite value then."""
        pull, drag, rest = np.zeros(3), np.zeros(3), self.rest
        for number, motion in enumerate(self.moving, 1):
            try:
                moved = motion.at(time)
            except (ArithmeticError, ValueError):
                moved = None
            if moved is None or not np.isfinite(moved).all():
                raise RunStopped(
                    "non_finite", f"At {time:.6g} s [[motion]] number {number} is not finite: correct its formula."
                )
            if motion.of == "gravity":
                pull -= moved.acceleration * motion.unit()
            elif motion.of == "turn":
                axis, place = motion.unit(), self.plan.grid.local(np.array(motion.pivot or (0.0, 0.0, 0.0)))
                rest = turned(self.rest, axis, -moved.place)
                self._assign(self.turning, np.concatenate([moved.velocity * axis, moved.acceleration * axis, place]))
            else:
                drag += moved.velocity * motion.unit()
        self.gravity = rest + pull
        for array in self.pulls:
            self._assign(array, self.gravity)
        if self.faces is not None:
            self._assign(self.faces, self.face_velocity + drag)

    def _assign(self, array: Any, values: NDArray[np.float64]) -> None:
        self.backend.assign(array, values.astype(self.plan.grid.dtype))


def turned(vector: NDArray[np.float64], axis: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """A vector (3,) turned about an axis of length 1 by an angle [rad]."""
    along = axis * (axis @ vector)
    return along + (vector - along) * np.cos(angle) + np.cross(axis, vector) * np.sin(angle)
