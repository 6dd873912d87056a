"""Motions: displacements and angles that are given in time, of a tank as its liquid feels them or of faces of walls.

What a run does with them is `refsim.engine.motions`.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from refsim.core.checked import Checked, NotNegative, Positive, given_keys
from refsim.core.effect import Discretisation, Others, Pass
from refsim.core.errors import InputError
from refsim.motion.expression import FUNCTIONS, Jet, parsed

Vector = tuple[float, float, float]
SAMPLES = 2001  # times between the start and the end at which a motion is looked at before a run
LIQUID = "weakly_compressible"


class Moved(NamedTuple):
    """A displacement along an axis at a time, or an angle about it, with its derivatives."""

    place: float  # [m], of an angle [rad]
    velocity: float  # [m/s]
    acceleration: float  # [m/s^2]


class Motion(Checked, frozen=True, kw_only=True):
    """A displacement X(t) that is given in time; of a turn, an angle.

    of         what moves: "gravity" (the scene is seen from a tank that moves, so that -d^2X/dt^2 is added to gravity),
               "turn" (it is seen from a tank that turns about an axis by the angle X) or "moving_faces" (dX/dt is added
               to the velocity of the moving_faces of box_walls)
    kind       "sway" (X = amplitude sin(2 pi t/period)), "table" (interpolated by a cubic spline, at rest before and
               after it) or "formula"
    direction  along which it moves, or axis about which it turns; its length does not matter
    pivot      of a turn: a point of the axis [m]; left out, the origin
    amplitude  of a sway [m]; of a turn [rad]
    period     of a sway [s]
    ramp       time in which a sway grows from nothing, smoothly [s]
    times      of a table, rising [s]
    values     of a table, X at its times [m]; of a turn [rad]
    formula    X of t in m, of a turn in rad, with + - * / **, pi and the functions sin, cos, tan, exp, log, sqrt, tanh
    """

    of: Literal["gravity", "turn", "moving_faces"]
    kind: Literal["sway", "table", "formula"]
    direction: Vector
    pivot: Vector | None = None
    amplitude: float | None = None
    period: Positive | None = None
    ramp: NotNegative | None = None
    times: tuple[float, ...] | None = None
    values: tuple[float, ...] | None = None
    formula: str | None = None

    def check(self, owner: str) -> None:
        """Raise InputError, in one sentence, for keys that do not belong together."""
        if not any(self.direction):
            raise InputError(f"{owner}: direction = {list(self.direction)} is none; give the axis of the motion.")
        if self.pivot is not None and self.of != "turn":
            raise InputError(f"{owner}: only a turn has a 'pivot'; leave it out.")
        given, does = given_keys(self, owner, {name: kind.takes for name, kind in KINDS.items()}), KINDS[self.kind]
        for key in does.takes:
            if key not in given and key not in does.optional:
                raise InputError(f"{owner}: {key!r} is missing; a motion of kind {self.kind!r} needs it.")
        does.check(self, owner)

    def unit(self) -> np.ndarray:
        """The direction as a vector of length 1, (3,)."""
        axis = np.array(self.direction)
        return axis / np.linalg.norm(axis)

    def at(self, time: float) -> Moved:
        """Where it is at `time` [s]."""
        return _path(self)(time)


@functools.lru_cache(maxsize=64)
def _path(motion: Motion) -> Callable[[float], Moved]:
    """The motion as a function of time."""
    return KINDS[motion.kind].path(motion)


def _sway(motion: Motion, time: float) -> Moved:
    t, ramp = Jet(time, 1.0), motion.ramp or 0.0
    x = Jet(motion.amplitude or 0.0) * FUNCTIONS["sin"](t * Jet(2 * math.pi / (motion.period or 1.0)))
    if 0 <= time < ramp:
        share = t * Jet(1 / ramp)  # 10 s^3 - 15 s^4 + 6 s^5, at rest at both ends
        cube = share * share * share
        x = x * cube * (Jet(10.0) - share * (Jet(15.0) - share * Jet(6.0)))
    return Moved(*x)


def _spline(motion: Motion) -> Callable[[float], Moved]:
    from scipy.interpolate import CubicSpline  # loads for as long as all of refsim

    times, values = np.array(motion.times), np.array(motion.values)
    curve = CubicSpline(times, values, bc_type="clamped")

    def at(time: float) -> Moved:
        if time <= times[0] or time >= times[-1]:
            return Moved(float(values[0] if time <= times[0] else values[-1]), 0.0, 0.0)
        return Moved(*(float(curve(time, order)) for order in range(3)))

    return at


def _formula(motion: Motion) -> Callable[[float], Moved]:
    tree = parsed(motion.formula or "", "motion")
    return lambda time: Moved(*tree(Jet(time, 1.0)))


def _check_table(motion: Motion, owner: str) -> None:
    times, values = np.array(motion.times), np.array(motion.values)
    if len(times) != len(values) or len(times) < 2:
        raise InputError(
            f"{owner}: times has {len(times)} numbers and values has {len(values)}; give as many, at least two."
        )
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        first, second = times[late[0] : late[0] + 2]
        raise InputError(f"{owner}: the table jumps, from {first:g} s to {second:g} s; let its times rise.")


class Kind(NamedTuple):
    """What a kind of motion takes, and where it is in time.

    takes     keys of a motion of this kind; all but those in `optional` are needed
    path      the displacement as a function of time [s]
    check     raises InputError, which begins with the second argument, for keys that do not belong together
    """

    takes: tuple[str, ...]
    path: Callable[[Motion], Callable[[float], Moved]]
    check: Callable[[Motion, str], object] = lambda motion, owner: None
    optional: tuple[str, ...] = ()


KINDS = {
    "sway": Kind(("amplitude", "period", "ramp"), lambda motion: functools.partial(_sway, motion), optional=("ramp",)),
    "table": Kind(("times", "values"), _spline, _check_table),
    "formula": Kind(("formula",), _formula, lambda motion, owner: parsed(motion.formula or "", owner)),
}


def pace(motion: Motion, end: float) -> float:
    """Time [s] in which it changes: largest speed over largest acceleration up to the `end` [s]; infinite at rest."""
    path = [*map(_path(motion), _looked_at(motion, end))]
    pull = max(abs(moved.acceleration) for moved in path)
    return max(abs(moved.velocity) for moved in path) / pull if pull > 0 else math.inf


def _looked_at(motion: Motion, end: float) -> list[float]:
    """Times [s] at which a motion is looked at before a run."""
    times, given = np.linspace(0.0, end, SAMPLES), np.array(motion.times or ())
    return [*times.tolist(), *(0.5 * (given[1:] + given[:-1])).tolist()]


def moves_tank(motions: Sequence[Motion]) -> bool:
    """Whether the tank moves from which the scene is seen: gravity acts then, if only for that."""
    return any(motion.of != "moving_faces" for motion in motions)


def frame_passes(motions: Sequence[Motion], effects: Others) -> tuple[Pass, ...]:
    """Passes of a tank that moves beside those of the effects: of gravity that is 0 at rest, and of a turn."""
    gravity: Any = effects.get("gravity")
    still = moves_tank(motions) and not any(gravity.acceleration)
    pulling = (Pass("sph.gravity", updates=("acceleration",)),) if still else ()
    turns = any(motion.of == "turn" for motion in motions)
    turning = (Pass("motion.turning", ("position", "velocity"), updates=("acceleration",)),) if turns else ()
    return (*pulling, *turning)


def check_motions(motions: Sequence[Motion], end: float, grid: Discretisation, effects: Others) -> None:
    """Raise InputError for motions that the scene cannot have; `end` of the run [s]."""
    for number, motion in enumerate(motions, 1):
        owner = f"[[motion]] number {number}"
        motion.check(owner)
        if LIQUID not in effects:
            raise InputError(f"{owner}: it moves the liquid of {LIQUID}; add that effect to the scene.")
        if motion.of == "turn":
            if grid.dim == 2 and any(motion.direction[:2]):
                raise InputError(f"{owner}: a 2D tank turns about z; set direction = [0.0, 0.0, 1.0].")
            if sum(other.of == "turn" for other in motions) > 1:
                raise InputError(f"{owner}: the scene has two turns, which do not add up; keep one.")
            for axis, length, part in zip("xyz", grid.period or (), motion.unit()):
                if length and abs(part) < 1 - 1e-9:
                    raise InputError(
                        f"{owner}: its forces differ at the two ends of the period along {axis}; leave one of them out."
                    )
        elif grid.dim == 2 and motion.direction[2] != 0:
            raise InputError(f"{owner}: direction has a z part in a 2D scene; set it to 0.")
        if motion.of == "moving_faces":
            _check_faces(motion, owner, effects.get("box_walls"))
        _check_path(motion, owner, end, effects)


def _check_faces(motion: Motion, owner: str, box: Any) -> None:
    """Raise InputError where no face of `box_walls` moves, or one across its plane."""
    if box is None or not box.moving_faces:
        raise InputError(f"{owner}: no face moves; name it in moving_faces of box_walls.")
    for face in box.moving_faces:
        if motion.direction["xyz".index(face[1])] != 0:
            raise InputError(
                f"{owner}: direction {list(motion.direction)} has a part across the face {face}, and faces move in"
                " their own plane only; set that part to 0."
            )


def _check_path(motion: Motion, owner: str, end: float, effects: Others) -> None:
    """Raise InputError where a motion is not finite, or faster than sound: it jumps."""
    sound_speed, path = effects[LIQUID].sound_speed, None  # type: ignore[attr-defined]
    for time in _looked_at(motion, end):
        try:
            path = path or _path(motion)
            moved = path(time)
        except (ArithmeticError, ValueError):
            moved = Moved(math.nan, math.nan, math.nan)
        if not all(map(math.isfinite, moved)):
            raise InputError(f"{owner}: it is not a finite number at {time:g} s; correct its formula or its numbers.")
        if motion.of != "turn" and abs(moved.velocity) > sound_speed:
            raise InputError(
                f"{owner}: it jumps: at {time:g} s it moves with {abs(moved.velocity):.3g} m/s, faster than the sound"
                f" speed of {sound_speed:g} m/s; take a smoother one."
            )
