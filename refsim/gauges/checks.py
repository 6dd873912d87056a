"""Whether a scene has what its gauges measure, and which share of the forces on walls a face bears."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim.core.capabilities import FACES, BringsWalls, HasPlanes, effects_with
from refsim.core.checked import suggestion
from refsim.core.effect import Discretisation, Effect, Others
from refsim.core.errors import InputError
from refsim.gauges import Gauge

LIQUID = "weakly_compressible"
SOLVED = "iisph"  # whose pressure forces are no pass before the step's length is known


def check_gauges(gauges: Sequence[Gauge], solids: int, grid: Discretisation, effects: Others) -> None:
    """Raise InputError for a gauge that the scene, with this number of solids, cannot have."""
    names: set[str] = set()
    for gauge in gauges:
        gauge.check()
        if gauge.name in names:
            raise InputError(f"scene: two gauges have the name {gauge.name!r}; give each its own.")
        names.add(gauge.name)
        if LIQUID not in effects:
            raise InputError(f"gauge {gauge.name}: it measures the liquid of {LIQUID}; add that effect to the scene.")
        if gauge.does.instant and SOLVED in effects:
            raise InputError(
                f"gauge {gauge.name}: the pressure of {SOLVED} is that of a step, not of an instant; leave {SOLVED} or"
                " the gauge out."
            )
        if "on" in gauge.does.takes:
            _check_body(gauge, solids, grid, effects)
        else:
            _check_inside(gauge, gauge.points(grid).place, grid, effects)


def _check_body(gauge: Gauge, solids: int, grid: Discretisation, effects: Others) -> None:
    """Raise InputError where the scene lacks what a force acts on."""
    bodies = [f"solid {k}" for k in range(1, solids + 1)]
    known = [effect.name for effect in effects_with(effects, BringsWalls) if isinstance(effect, Effect)]
    faces = walled_faces(effects["box_walls"], grid) if "box_walls" in effects else []
    choices = (*faces, *known, *bodies)
    if gauge.on not in choices:
        what = f"; {suggestion(gauge.on, choices)}" if choices else ": it has neither walls nor solids."
        raise InputError(f"gauge {gauge.name}: the scene has no {gauge.on!r} on which a force could act{what}")


def walled_faces(box: Any, grid: Discretisation) -> list[str]:
    """Faces of `box_walls` that have a wall."""
    return [f for f in FACES[: 2 * grid.dim] if f not in box.open_faces and grid.period["xyz".index(f[1])] == 0]


def _check_inside(gauge: Gauge, place: NDArray[np.float64], grid: Discretisation, effects: Others) -> None:
    """Raise InputError where a point lies behind a plane of the walls, or outside a periodic box."""
    corners = [effect.domain(grid) for effect in effects_with(effects, HasPlanes)]
    for axis in range(grid.dim):
        lows, highs = [low[axis] for low, _ in corners], [high[axis] for _, high in corners]
        if grid.period[axis] > 0:
            lows.append(grid.period_lower[axis])
            highs.append(grid.period_lower[axis] + grid.period[axis])
        low, high = max(lows, default=-math.inf), min(highs, default=math.inf)
        slack = 1e-6 * grid.spacing
        least, most = place[:, axis].min(), place[:, axis].max()
        if least < low - slack or most > high + slack:
            raise InputError(
                f"gauge {gauge.name}: it reaches from {least:g} to {most:g} m along {'xyz'[axis]}, outside of the"
                f" domain from {low:g} to {high:g} m; move it inside."
            )


def shares_of_faces(
    box: Any, position: NDArray[np.float64], gravity: Sequence[float], grid: Discretisation
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
    """By face the shares (m, dim) of each component of the forces on wall particles: of pressure, and of friction.

    position  (m, 3) of the wall particles of `box_walls` [m], as the box stands at rest

    Beyond a face of an axis that component is the face's. Beyond none of them it belongs, along gravity, to the face to
    which gravity points, which so bears the weight, and else to the faces beyond which the particle stands: the
    pressure on a floor also pushes it sideways near a wall, by that on 0.2 spacings. Friction is shared by
    the faces beyond which the particle stands. All shares of a particle and an axis add up to 1.
    """
    walled = walled_faces(box, grid)
    count, dim = len(position), grid.dim
    beyond = {}
    for face in walled:
        axis = "xyz".index(face[1])
        beyond[face] = position[:, axis] > box.upper[axis] if face[0] == "+" else position[:, axis] < box.lower[axis]
    faces_of = np.maximum(sum((b.astype(float) for b in beyond.values()), np.zeros(count)), 1.0)
    friction = {face: np.repeat((beyond[face] / faces_of)[:, None], dim, axis=1) for face in walled}
    pressure = {face: np.zeros((count, dim)) for face in walled}
    for axis in range(dim):
        faces = [face for face in walled if "xyz".index(face[1]) == axis]
        none = ~np.logical_or.reduce([beyond[face] for face in faces]) if faces else np.ones(count, bool)
        for face in faces:
            pressure[face][:, axis] += beyond[face]
        if faces and gravity[axis] != 0:
            pressure[faces[min(int(gravity[axis] > 0), len(faces) - 1)]][:, axis] += none
        else:
            for face in walled:
                pressure[face][:, axis] += none * beyond[face] / faces_of
    return pressure, friction
