"""What a checkpoint of a run holds: taking it, checking one that was read, and putting it back."""

import dataclasses
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import msgspec
import numpy as np

from refsim.core.checked import NotNegative
from refsim.core.errors import InputError
from refsim.core.reading import GREATEST
from refsim.core.versions import versions
from refsim.engine.audit import AuditState
from refsim.engine.run import Run
from refsim.io.checkpoint import Checkpoint, whole_checkpoint
from refsim.io.scenes import scene_from_checkpoint, scene_to_checkpoint
from refsim.neighbours import SearchLog
from refsim.scene.plan import Plan, make_plan

ROUNDED = 1 + 1e-5  # of a number that was added up, or that a GPU computed in float32
Number = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
Length = Annotated[float, msgspec.Meta(ge=0, le=GREATEST)]


class Clock(msgspec.Struct, frozen=True, kw_only=True):
    """Numbers of a run that outlive a step, as a checkpoint holds them beside its arrays; SI units.

    Names in a file are those of its first version: squared_way and set_between_steps. TABLES stand there as JSON.
    """

    backend: Literal["numpy", "cpu", "cuda"]
    time: Length
    steps: Number
    previous_length: Length
    squared_displacement: NotNegative = msgspec.field(name="squared_way")
    margin: Length
    velocities_set: bool = msgspec.field(name="set_between_steps")
    list_built: bool
    stopped_at_walls: Number
    limiters: dict[str, Number]  # how many steps each limit has set
    versions: dict[str, str]  # of the programs that wrote it
    search_log: dict[str, Number]  # counts of the neighbour search
    remarks: dict[str, str]  # notes that effects had made until then, by effect
    first_length: Length | None = None  # None before the first step
    greatest_miscount: float | None = None  # of counted and told density, see `Counting`; None before a look
    density_taken: bool | None = None  # whether an advanced density has taken the latest step, see `set_field`
    energy_audit: AuditState | None = None  # None where the scene has none
    origin: tuple[float, float, float] | None = None  # of the positions; None of a version without residual


TABLES = ("limiters", "versions", "search_log", "remarks", "energy_audit", "origin")


@dataclass(frozen=True)
class SavedRun:
    """A checkpoint that was read and found to fit its own scene.

    file            where it lies
    plan            of the scene in it
    clock           time, steps and what else counts them
    state           fields that outlive a step, by name
    build_position  positions (n, 3) [m] at the last build of the neighbour list
    gauges          what each of the scene's gauges has measured, time and values (k, 1 + columns), by name
    notes           one sentence for each checkpoint that was passed over for it, and for an older one
    """

    file: Path
    plan: Plan
    clock: Clock
    state: dict[str, np.ndarray]
    build_position: np.ndarray
    gauges: dict[str, np.ndarray]
    notes: tuple[str, ...]


def load_checkpoint(path: str | os.PathLike[str]) -> SavedRun:
    """The run in a checkpoint, or in the newest whole checkpoint of a folder, all of it checked.

    Raises InputError, in one sentence, where there is none or it does not fit its own scene.
    """
    file, saved, notes = whole_checkpoint(path)
    plan = make_plan(scene_from_checkpoint(saved, str(file)))

    def wrong(what: str) -> InputError:
        return InputError(f"checkpoint {file}: {what}; start the run again.")

    clock = _clock(saved.attributes, wrong)
    if (plan.scene.energy_audit is None) != (clock.energy_audit is None):
        raise wrong("its energy audit is not that of its scene")
    if clock.first_length is None and clock.steps:
        raise wrong("it lacks 'first_length', the length of the first of its steps")
    lengths = {"previous_length": clock.previous_length, "first_length": clock.first_length}
    for name, length in lengths.items() if clock.steps else ():
        if not 0 < length <= clock.time * ROUNDED:  # type: ignore[operator]
            raise wrong(f"{name} = {length:g} s is no step of a run that has come to {clock.time:g} s")
    if clock.margin > (widest := plan.scene.skin * plan.list_radius) * ROUNDED:
        raise wrong(f"margin = {clock.margin:g} m is more than the neighbour list's skin of {widest:g} m")
    if not clock.search_log.keys() <= {f.name for f in dataclasses.fields(SearchLog)}:
        raise wrong(f"its search log has the entries {', '.join(clock.search_log)}")
    shapes = {f"field.{name}": (f.shape(plan.grid.count), f.numpy_dtype(plan.grid.dtype))
              for name, f in plan.fields.items() if f.state}  # fmt: skip
    if (origin := clock.origin or (0.0, 0.0, 0.0)) != plan.grid.origin:
        raise wrong(f"its positions are relative to {list(origin)} m and the scene's to {list(plan.grid.origin)} m")
    residual = "field.position_residual"
    if clock.origin is None and residual in saved.arrays:
        raise wrong("it lacks 'origin', the place to which its positions are relative")
    if clock.origin is None and residual in shapes:
        shape, dtype = shapes[residual]
        saved.arrays.setdefault(residual, np.zeros(shape, dtype))
        older = f"checkpoint {file} is of a version that dropped what rounding takes from positions"
        notes = (*notes, f"{older}: the run goes on from the same places, but not bit for bit as it would have there")
    shapes["build_position"] = shapes["field.position"]
    for name, (shape, dtype) in shapes.items():
        values = saved.arrays.get(name)
        if values is None and name == "field.advanced_excess":
            raise wrong("it has no advanced density, which this refsim gives a liquid whose scene names none")
        if values is None:
            raise wrong(f"it lacks {name!r}, so that it is not one of a run of this refsim")
        if values.shape != shape or values.dtype != dtype:
            raise wrong(f"{name} is {values.dtype} {values.shape}, and the scene has {dtype} {shape}")
        if dtype.kind == "f" and not (np.abs(values) <= GREATEST).all():
            raise wrong(f"{name} has values that are not finite, or beyond {GREATEST:g}")
    state = {name.removeprefix("field."): saved.arrays[name] for name in shapes if name != "build_position"}
    if (state["mass"] <= 0).any():
        raise wrong(f"{int((state['mass'] <= 0).sum())} of its particles have no positive mass")
    if not np.array_equal(np.sort(state["identity"]), np.arange(plan.grid.count)):
        raise wrong("its particles' numbers (identity) are not each of 0, 1, 2, ... once")
    places = state["position"]
    if len(places) > 1 and (places == places[0]).all():
        raise wrong(f"its {len(places)} particles are all at one place")
    build_position = saved.arrays["build_position"]
    if plan.grid.dim == 2 and any(v[:, 2].any() for v in (state["position"], state["velocity"], build_position)):
        raise wrong("it has particles with another z or v_z than 0 in a 2D scene")
    gauges = {}
    for gauge in plan.scene.gauge:
        table = gauges[gauge.name] = saved.arrays.get(f"gauge.{gauge.name}", np.zeros(0))
        shaped = table.ndim == 2 and table.shape[1:] == (1 + len(gauge.columns(plan.grid.dim)),)
        if not (shaped and table.dtype == np.float64 and np.isfinite(table).all()):
            raise wrong(f"what the gauge {gauge.name} has measured is no table of numbers")
        if (np.diff(table[:, 0], prepend=-1.0) <= 0).any() or (table[:, 0] > clock.time).any():
            raise wrong(f"the times of the gauge {gauge.name} do not rise to that of the run")
    return SavedRun(file, plan, clock, state, build_position, gauges, notes)


def _clock(attributes: Mapping[str, Any], wrong: Callable[[str], InputError]) -> Clock:
    """The numbers of a checkpoint. Raises what `wrong` makes of a sentence where one is missing or not possible."""
    found = {}
    for field in msgspec.structs.fields(Clock):
        name = field.encode_name
        if name not in attributes and field.required:
            raise wrong(f"it lacks {name!r}, so that it is not one of a run of this refsim")
        if (value := attributes.get(name)) is not None:
            try:
                read = msgspec.json.decode(value) if name in TABLES else value
                found[field.name] = msgspec.convert(read, field.type)
            except (msgspec.MsgspecError, OverflowError, RecursionError, TypeError):
                raise wrong(f"its numbers are not those of a run: {name} = {str(value)[:80]} is not possible") from None
    return Clock(**found)


def snapshot(run: Run) -> Checkpoint:
    """All of a run that outlives a step, on the host: what a checkpoint file holds."""
    text, arrays = scene_to_checkpoint(run.plan)
    arrays |= {f"field.{name}": run._host(name) for name, f in run.plan.fields.items() if f.state}
    arrays["build_position"] = np.array(run.backend.host(run.build_position))
    for k, gauge in enumerate(run.plan.scene.gauge):
        arrays[f"gauge.{gauge.name}"] = run.gauges.table(k)
    lists = run.lists
    clock = Clock(
        backend=cast(Literal["numpy", "cpu", "cuda"], run.backend.name),
        time=run.time,
        steps=run.steps,
        previous_length=run.previous_length,
        squared_displacement=lists.policy.squared_displacement,
        margin=lists.policy.margin,
        velocities_set=lists.velocities_set,
        density_taken=bool(run.previous_length > 0 and run.backend.host(run.timestep)[1] == 0) or None,
        list_built=lists.built,
        stopped_at_walls=run.stopped_at_walls,
        limiters=run.limiters,
        versions=versions(),
        first_length=run.first_length,
        search_log={} if lists.search is None else dataclasses.asdict(lists.search.log),
        energy_audit=None if run.auditor is None else run.auditor.saved(),
        remarks=run.remarks,
        greatest_miscount=run.counting.greatest,
        origin=run.plan.grid.origin,
    )
    stored = {f.encode_name: getattr(clock, f.name) for f in msgspec.structs.fields(Clock)}
    attributes = {"scene": text} | {
        name: msgspec.json.encode(value).decode() if name in TABLES else value
        for name, value in stored.items()
        if value is not None
    }
    return Checkpoint(arrays, attributes)


def restore(run: Run, saved: SavedRun) -> None:
    """Put a new run of the same scene into the saved state; its notes say where it will not go on bit for bit."""
    clock, lists = saved.clock, run.lists
    run.source = saved.file
    run.notes += saved.notes
    for name, values in saved.state.items():
        run.backend.assign(run.fields[name], values)
    run.backend.assign(run.build_position, saved.build_position)
    run.time, run.steps = clock.time, clock.steps
    run.previous_length, run.first_length = clock.previous_length, clock.first_length
    if run.motions is not None:
        run.motions.move(run.time)
    run.order.renumber()
    run.start()
    untaken = 0.0 if clock.density_taken else run.previous_length
    run.backend.assign(run.timestep, np.array([0.0, untaken], dtype=run.plan.grid.dtype))
    run.limiters = dict(clock.limiters)
    run.stopped_at_walls = clock.stopped_at_walls
    lists.velocities_set = clock.velocities_set
    if run.auditor is not None and clock.energy_audit is not None:
        run.auditor.restore(clock.energy_audit)
    if run.gauges is not None:
        run.gauges.restore(saved.gauges)
    run.balances.renew()
    run.counting.greatest = clock.greatest_miscount
    for effect, note in clock.remarks.items():
        run.remark(effect, note)
    if lists.search is not None and clock.list_built:
        lists.rebuild()
        lists.policy.squared_displacement, lists.policy.margin = clock.squared_displacement, clock.margin
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
