"""What a checkpoint of a run holds: taking it, checking one that was read, and putting it back."""

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import msgspec
import numpy as np

from refsim.core.errors import InputError, RunStopped
from refsim.core.versions import versions
from refsim.engine.launching import bind, start
from refsim.engine.neighbour_lists import rebuild, renumber
from refsim.engine.state import State
from refsim.io.checkpoint import KEPT, Checkpoint, scene_from_checkpoint, scene_to_checkpoint, whole_checkpoint
from refsim.scene.plan import Plan, make_plan
from refsim.sph import WAY

OF_RUN = ("time", "steps", "previous_length", "first_length", "stopped_at_walls", "limiters")


class Clock(msgspec.Struct, frozen=True, kw_only=True):
    """Numbers of a run that outlive a step, as a checkpoint holds them as JSON beside its arrays; SI units."""

    backend: Literal["numpy", "cpu", "cuda"]
    time: float
    steps: int
    previous_length: float
    first_length: float | None  # None before the first step
    squared_displacement: float | None  # None where it is infinite, so that the list is built anew
    margin: float
    velocities_set: bool
    density_taken: bool  # whether an advanced density has taken the latest step, see `set_field`
    list_built: bool
    list_built_at: int = 0  # number of steps before
    skin: float | None = None  # of the list; None in files of earlier versions
    stopped_at_walls: int
    limiters: dict[str, int]  # how many steps each limit has set
    versions: dict[str, str]  # of the programs that wrote it
    search_log: dict[str, int]  # counts of the neighbour search
    remarks: dict[str, str]  # notes that effects had made until then, by effect
    greatest_miscount: float | None  # of counted and told density, see `Counting`; None before a look
    origin: tuple[float, float, float]  # of the positions


@dataclass(frozen=True)
class SavedRun:
    """A checkpoint that was read and found to fit its own scene.

    file            where it lies
    plan            of the scene in it
    clock           time, steps and what else counts them
    state           fields that outlive a step, by name
    build_position  positions (n, 3) [m] at the last build of the neighbour list
    gauges          what each of the scene's gauges has measured, time and values (k, 1 + columns), by name
    notes           one sentence for each checkpoint that was passed over for it
    """

    file: Path
    plan: Plan
    clock: Clock
    state: dict[str, np.ndarray]
    build_position: np.ndarray
    gauges: dict[str, np.ndarray]
    notes: tuple[str, ...]


def load_checkpoint(path: str | os.PathLike[str]) -> SavedRun:
    """The run in a checkpoint, or in the newest whole one of a run's folder.

    Its digest, its version and its schema are compared: the clock's fields, and the shapes and dtypes of the arrays
    that its scene needs. Raises InputError, in one sentence, where there is none or it does not fit its own scene.
    """
    file, saved, notes = whole_checkpoint(path)
    plan = make_plan(scene_from_checkpoint(saved, str(file)))

    def wrong(what: str) -> InputError:
        return InputError(f"checkpoint {file}: {what}; start the run again.")

    try:
        clock = msgspec.json.decode(str(saved.attributes.get("clock", "")), type=Clock)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise wrong(f"its numbers are not those of a run of this refsim ({error})") from None
    if clock.origin != plan.grid.origin:
        raise wrong(f"its positions are relative to {list(clock.origin)} m, the scene's to {list(plan.grid.origin)} m")
    state = {name: saved.arrays.get(f"field.{name}") for name, f in plan.fields.items() if f.state}
    arrays = state | {"build_position": saved.arrays.get("build_position")}
    for name, values in arrays.items():
        f = plan.fields[name.removeprefix("build_")]
        shape, dtype = f.shape(plan.grid.count), f.numpy_dtype(plan.grid.dtype)
        if values is None or values.shape != shape or values.dtype != dtype:
            has = "nothing" if values is None else f"{values.dtype} {values.shape}"
            raise wrong(f"its {name} is {has}, and a run of its scene has {dtype} {shape}")
    gauges = {gauge.name: saved.arrays.get(f"gauge.{gauge.name}") for gauge in plan.scene.gauge}
    for gauge in plan.scene.gauge:
        table, columns = gauges[gauge.name], 1 + len(gauge.does.columns(plan.grid.dim))
        if table is None or table.shape[1:] != (columns,):
            raise wrong(f"what the gauge {gauge.name} has measured is no table of {columns} columns")
    return SavedRun(file, plan, clock, state, arrays["build_position"], gauges, notes)  # type: ignore[arg-type]


def snapshot(run: State, tables: Mapping[str, np.ndarray], miscount: float | None) -> Checkpoint:
    """All of a run that outlives a step, on the host: what a checkpoint file holds.

    tables  what each gauge has measured, by name; `miscount` the greatest of the density
    """
    text, arrays = scene_to_checkpoint(run.plan)
    arrays |= {f"field.{name}": run.host(name) for name, f in run.plan.fields.items() if f.state}
    arrays["build_position"] = np.array(run.backend.host(run.build_position))
    arrays |= {f"gauge.{name}": table for name, table in tables.items()}
    lists = run.lists
    clock = Clock(
        backend=cast(Literal["numpy", "cpu", "cuda"], run.backend.name),
        squared_displacement=None if math.isinf(displacement := lists.squared_displacement) else displacement,
        **{name: getattr(run, name) for name in OF_RUN},
        **{name: getattr(lists, name) for name in ("margin", "velocities_set")},
        density_taken=bool(run.previous_length > 0 and run.backend.host(run.timestep)[1] == 0),
        list_built=lists.built,
        list_built_at=lists.built_at,
        skin=None if lists.search is None else lists.search.skin,
        versions=versions(),
        search_log={} if lists.search is None else dataclasses.asdict(lists.search.log),
        remarks=run.remarks,
        greatest_miscount=miscount,
        origin=run.plan.grid.origin,
    )
    try:
        numbers = json.dumps(msgspec.to_builtins(clock), allow_nan=False)
    except ValueError:
        message = "no checkpoint was written because a number of the run beside its fields is not finite"
        raise RunStopped("non_finite", f"{message}; {KEPT}") from None
    return Checkpoint(arrays, {"scene": text, "clock": numbers})


def restore(run: State, saved: SavedRun) -> None:
    """Put a new run of the same scene into the saved state; its notes say where it will not go on bit for bit."""
    clock, lists = saved.clock, run.lists
    run.source = saved.file
    run.notes += saved.notes
    for name, values in saved.state.items():
        run.backend.assign(run.fields[name], values)
    run.backend.assign(run.build_position, saved.build_position)
    for name in OF_RUN:
        setattr(run, name, getattr(clock, name))
    if run.motions is not None:
        run.motions.move(run.time)
    renumber(run)
    start(run)
    untaken = 0.0 if clock.density_taken else run.previous_length
    run.backend.assign(run.timestep, np.array([0.0, untaken], dtype=run.plan.grid.dtype))
    lists.velocities_set, lists.ways_renewed = clock.velocities_set, WAY.name in run.fields
    for effect, note in clock.remarks.items():
        run.add_note(effect, note)
    if lists.search is not None and clock.list_built:
        skin = lists.skins[0] if clock.skin is None else clock.skin
        if skin in lists.skins:
            lists.search.reach_further(skin)
        rebuild(run)
        bind(run)
        lists.built_at = clock.list_built_at
        displacement = clock.squared_displacement
        lists.squared_displacement = math.inf if displacement is None or skin not in lists.skins else displacement
        lists.margin = clock.margin
        log = lists.search.log
        for name in clock.search_log.keys() - {"list_bytes"}:  # the size that the list has grown to changes no result
            setattr(log, name, clock.search_log[name])
    now, then = versions(), clock.versions
    if clock.backend != run.backend.name:
        run.notes.append(
            f"resumed on backend {run.backend.name} from a checkpoint of backend {clock.backend}: the run goes"
            " on from the same state, but not bit for bit as it would have there"
        )
    elif now != then:
        changed = ", ".join(f"{name} {then.get(name)} -> {now[name]}" for name in now if now[name] != then.get(name))
        run.notes.append(f"resumed with other versions ({changed}): bit for bit equality is not promised")
