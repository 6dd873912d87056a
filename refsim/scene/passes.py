"""The order of the passes: what is written comes before what is read, and equal passes are launched once."""

import dataclasses
from collections.abc import Container, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from refsim.core.effect import Effect, Pass
from refsim.core.errors import InputError
from refsim.core.operation import PROCEDURES, REGISTRY

Owner = TypeVar("Owner")


def motion_passes(asked: Sequence[tuple[Effect, Pass]]) -> tuple[tuple[Effect | None, Pass], ...]:
    """Passes once the step's length is known, ordered by what they touch, the integrator last.

    Raises InputError where there are two integrators.
    """
    moving = [(e, p) for e, p in asked if "position" in p.updates]
    if len({e.name for e, _ in moving}) > 1:
        raise InputError(
            f"Effects {' and '.join(sorted({repr(e.name) for e, _ in moving}))} would both move the particles; keep"
            " one of them."
        )
    last: list[tuple[Effect | None, Pass]] = list(moving)
    if not moving:
        last = [(None, Pass("sph.kick_drift", updates=("velocity", "position"), stage="motion"))]
    return (*ordered_passes([(e, p) for e, p in asked if "position" not in p.updates]), *last)


def with_reads(p: Pass, fields: Container[str]) -> Pass:
    """A pass that names no reads with the fields that its operation's reference takes and that it does not write."""
    if p.reads or p.operation not in REGISTRY:
        return p
    taken = dict.fromkeys(p.names.get(name, name) for name in REGISTRY[p.operation].arguments("numpy"))
    reads = tuple(name for name in taken if name is not None and name in fields and name not in p.written)
    return dataclasses.replace(p, reads=reads)


def merged_passes(
    passes: Sequence[tuple[Effect, Pass]], parameters: Mapping[str, Mapping[str, Any]]
) -> list[tuple[Effect, Pass]]:
    """Passes with one launch for equal passes of two effects; it is on demand only if both effects take it on demand.

    A pass over every row also serves an effect that needs it for its `candidates` only. Raises InputError if two
    effects would write one field differently.
    """
    kept: list[tuple[Effect, Pass]] = []
    for effect, p in passes:
        rivals = [k for k, (_, q) in enumerate(kept) if set(p.writes) & set(q.writes)]
        for k in rivals:
            other, q = kept[k]
            if not _same_but_candidates(effect, p, other, q, parameters):
                field_name = sorted(set(p.writes) & set(q.writes))[0]
                raise InputError(
                    f"Effects {other.name!r} and {effect.name!r} compute field {field_name!r} in different ways; give"
                    " them the same settings or remove one."
                )
            first, second = q.names.get("candidates"), p.names.get("candidates")
            names = {**q.names, **p.names}
            if first != second:
                names["candidates"] = None
            reads = tuple(dict.fromkeys(q.reads + p.reads))
            kept[k] = (other, dataclasses.replace(q, reads=reads, names=names, on_demand=q.on_demand and p.on_demand))
        if not rivals:
            kept.append((effect, p))
    return kept


def _same_but_candidates(
    effect: Effect, p: Pass, other: Effect, q: Pass, parameters: Mapping[str, Mapping[str, Any]]
) -> bool:
    def names_of(p: Pass) -> dict[str, str | None]:
        return {name: field_name for name, field_name in p.names.items() if name != "candidates"}

    if (p.operation, p.writes, p.updates, names_of(p)) != (q.operation, q.writes, q.updates, names_of(q)):
        return False
    names = {p.names.get(name, name) or "" for name in REGISTRY[p.operation].arguments("numpy")}
    ours, its = parameters[effect.name], parameters[other.name]
    return all(_same(ours.get(name), its.get(name)) for name in names)


def _same(a: Any, b: Any) -> bool:
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return type(a) is type(b) and bool(np.array_equal(a, b))


def ordered_passes(passes: Sequence[tuple[Owner, Pass]]) -> tuple[tuple[Owner, Pass], ...]:
    """Passes, each with its owner, so that every field is written, then updated, then read; else in the same order."""
    for _, p in passes:
        if p.operation not in REGISTRY and p.operation not in PROCEDURES:
            raise InputError(f"A pass names operation {p.operation!r}, which is not registered.")
    writers: dict[str, list[int]] = {}
    updaters: dict[str, list[int]] = {}
    for k, (_, p) in enumerate(passes):
        for name in p.writes:
            writers.setdefault(name, []).append(k)
        for name in p.updates:
            updaters.setdefault(name, []).append(k)
    after: list[set[int]] = [set() for _ in passes]
    for k, (_, p) in enumerate(passes):
        for name in p.reads:
            after[k].update(w for w in writers.get(name, []) if w != k)
            if name not in p.updates:
                after[k].update(u for u in updaters.get(name, []) if u != k)
        for name in p.updates:
            after[k].update(w for w in writers.get(name, []) if w != k)
    done: list[int] = []
    waiting = list(range(len(passes)))
    while waiting:
        ready = next((k for k in waiting if after[k] <= set(done)), None)
        if ready is None:
            names = ", ".join(passes[k][1].operation for k in waiting)
            raise InputError(f"scene: the passes {names} wait for each other; one effect must not need the other.")
        done.append(ready)
        waiting.remove(ready)
    return tuple(passes[k] for k in done)
