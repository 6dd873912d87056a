"""What is left behind when a run stops: where it broke first, and how to see it again.

`postmortem.json` names the first bad particle, the pass that first wrote a non-finite value, the step and its
limits, and the command that replays it; `postmortem.npz` holds all fields of the particles around.
"""

import contextlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.effect import Extremes
from refsim.core.errors import RunStopped
from refsim.core.writing import made_by, plain, write_file
from refsim.engine.launching import replay
from refsim.engine.limits import stable_steps
from refsim.engine.state import State
from refsim.io.checkpoint import KEPT
from refsim.neighbours.reference import nearest_image

POSTMORTEM, POSTMORTEM_FIELDS = "postmortem.json", "postmortem.npz"
AFTER_THESE = {"non_finite", "diverged", "step_too_small", "collapsed", "compressed", "miscounted"}
AFTER_THESE |= {"missed_neighbours", "particles_lost"}
# The particle that is reported
GREATEST = {"step_too_small": "acceleration", "missed_neighbours": "velocity", "diverged": "velocity"}
SHOWN = 500  # particles at most in the neighbourhood


def write_postmortem(simulation: State, stop: RunStopped, folder: Path, replay: str, checkpoint: Path | None) -> Path:
    """Write both files into `folder`; the path of the JSON. Raises RunStopped or InputError where that fails."""
    record, near = examine(simulation, stop)
    path = folder / POSTMORTEM
    record |= {
        "last_checkpoint": str(checkpoint) if checkpoint else None,
        "replay": replay,
        "neighbourhood": {"file": str(folder / POSTMORTEM_FIELDS), "particles": len(near.get("identity", ()))},
    }
    write_file(folder / POSTMORTEM_FIELDS, made_by(np.savez, **near), "post-mortem", KEPT)
    write_file(path, json.dumps(plain(record), indent=1) + "\n", "post-mortem", KEPT)
    return path


def examine(simulation: State, stop: RunStopped) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What went wrong where, from the state at the stop, and all fields of the particles around, nearest first."""
    cause, row, count = _cause(simulation, stop)
    fields = {name: _host(simulation, name) for name in simulation.plan.particle_fields}
    limits = _limits_now(simulation, fields)
    built = np.array(simulation.backend.host(simulation.build_position))
    fields["position_at_list_build"] = simulation.plan.grid.absolute(built)
    record: dict[str, Any] = {"reason": stop.reason, "message": str(stop)}
    record |= {"step": simulation.steps, "time": simulation.time}
    record |= {"backend": simulation.backend.name, "dtype": simulation.plan.grid.dtype}
    record |= {"cause": cause, "bad_particles": count, "limits_now": limits}
    record |= {f"last_step_{name}": getattr(simulation.last, name, None) for name in ("limits", "length")}
    if row is None:
        return record | {"particle": None}, {}
    record["particle"] = {name: values[row].tolist() for name, values in fields.items()}
    return record, _neighbourhood(simulation, fields, row)


def _cause(simulation: State, stop: RunStopped) -> tuple[str, int | None, int]:
    """(pass and field that broke first, row of the first bad particle, number of bad particles)."""
    for name in ("position", "velocity", "mass"):
        if bad := _bad(simulation, name):
            return f"sph.kick_drift wrote {name}" if name != "mass" else "mass of the scene", *bad
    if stop.reason == "collapsed":
        return "neighbours.build", *_most_crowded(simulation)
    if stop.reason == "temperature_out_of_range":
        t, (low, high) = _host(simulation, "temperature"), _host(simulation, "temperature_range")
        beyond = np.maximum(t - high, low - t)
        return "temperature farthest out of its range", int(beyond.argmax()), int((beyond > 0).sum())
    if stop.reason == "compressed":
        if "density" in simulation.fields:
            return "greatest density", int(_host(simulation, "density").argmax()), 1
        return "least volume_ratio", int(_host(simulation, "volume_ratio").argmin()), 1
    if stop.reason in GREATEST:
        name = GREATEST[stop.reason]
        sizes = np.nan_to_num(np.linalg.norm(_host(simulation, name).astype(float), axis=1), nan=np.inf)
        return f"greatest {name}", int(sizes.argmax()), 1
    try:
        with contextlib.closing(replay(simulation)) as passes:
            for operation, written in passes:
                for name in written:
                    if name in simulation.fields and (bad := _bad(simulation, name)):
                        return f"{operation} wrote {name}", *bad
    except RunStopped as again:
        return f"the passes stop again: {again.reason}", None, 0
    return "no pass writes a value that is not finite", None, 0


def _bad(simulation: State, name: str) -> tuple[int, int] | None:
    """Of a field's rows that are not finite that of the lowest identity, whatever the order, and how many they are."""
    values = simulation.host(name)
    rows = np.flatnonzero(~np.isfinite(values).all(tuple(range(1, values.ndim))))
    return (int(rows[simulation.host("identity")[rows].argmin()]), len(rows)) if len(rows) else None


def _most_crowded(simulation: State) -> tuple[int, int]:
    from scipy.spatial import cKDTree

    position = _host(simulation, "position").astype(float)
    tree = cKDTree(position)
    count = tree.query_ball_point(position, 0.5 * simulation.plan.grid.spacing, return_length=True)
    return int(count.argmax()), int(count.max()) - 1


def _limits_now(simulation: State, fields: dict[str, np.ndarray]) -> dict[str, float] | None:
    with np.errstate(all="ignore"):
        both = (fields[name].astype(float) for name in ("velocity", "acceleration"))
        speed, force = (float(np.sqrt((values**2).sum(1).max())) for values in both)
    if not (math.isfinite(speed) and math.isfinite(force)):
        return None
    rate = float(np.max(fields.get("exchange_rate", np.zeros(1))))
    return stable_steps(simulation.limits, Extremes(speed, force, rate if math.isfinite(rate) else 0.0))


def _neighbourhood(simulation: State, fields: dict[str, np.ndarray], row: int) -> dict[str, np.ndarray]:
    """All fields of the particles around one, nearest first: within two support radii of its last finite place."""
    grid, place = simulation.plan.grid, fields["position"][row].astype(float)
    if not np.isfinite(place).all():
        place = fields["position_at_list_build"][row].astype(float)
    with np.errstate(all="ignore"):
        apart = nearest_image(fields["position"].astype(float) - place, grid.period)
        distance = np.linalg.norm(apart, axis=1)
    distance[row] = 0.0
    near = np.flatnonzero(distance <= 2 * grid.support_radius)
    near = near[np.argsort(distance[near], kind="stable")][:SHOWN]
    return {name: values[near] for name, values in fields.items()}


def _host(simulation: State, name: str) -> np.ndarray:
    """A field's values; positions as places in the scene."""
    values = simulation.host(name)
    return simulation.plan.grid.absolute(values) if name == "position" else values
