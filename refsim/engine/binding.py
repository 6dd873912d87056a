"""Passes of a plan as calls without arguments: every name that a program takes is looked up once."""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from refsim.backends.arrays import Backend
from refsim.core.effect import Effect, Pass
from refsim.core.errors import InputError
from refsim.core.operation import PROCEDURES, REGISTRY, LiveAttribute, backend_of
from refsim.scene.plan import ordered_passes


def fused(passes: Sequence[tuple[Effect, Pass]], backend: str) -> list[tuple[tuple[Effect, ...], Pass]]:
    """The passes in their order, each with its effects; one in place of several that one program computes together.

    It stands where the last of them stood: what all of them read is there by then, and accelerations add in any order.
    What reads a field that it writes comes behind it; where it would wait for that itself, the passes stay apart.
    """
    result: list[tuple[tuple[Effect, ...], Pass]] = [((effect,), p) for effect, p in passes]
    for _, p in list(passes):
        operation = REGISTRY.get(p.operation)
        if operation is None:
            continue
        for name in operation.names():
            parts = {p.operation, *operation.entry(name).also}
            places = [k for k, (_, q) in enumerate(result) if q.operation in parts]
            if backend_of(name) != backend or len(parts) == 1 or len(places) != len(parts):
                continue
            together = [result[k] for k in places]
            taken, optional = operation.arguments(name), operation.as_computed_by(name).optional
            takers = {a: [q for _, q in together if a in REGISTRY[q.operation].arguments("numpy")] for a in taken}
            names = {
                a: b for _, q in together for a, b in q.names.items()
                if a in taken and (a in optional or {r.names.get(a) for r in takers[a]} == {b})
            }  # fmt: skip
            reads, writes, updates = (
                tuple(dict.fromkeys(field for _, q in together for field in getattr(q, kind)))
                for kind in ("reads", "writes", "updates")
            )
            if set(reads) <= {*taken, *names.values()}:
                one = Pass(p.operation, reads, writes, updates, names=names, algorithm=name.partition(":")[2])
                effects = tuple(effect for effects, _ in together for effect in effects)
                joined = list(result)
                joined[places[-1]] = effects, one
                for k in reversed(places[:-1]):
                    del joined[k]
                with contextlib.suppress(InputError):
                    result = list(ordered_passes(joined))
    return result


def bind_pass(p: Pass, backend: Backend, sources: Sequence[Mapping[str, Any]]) -> Callable[[], None]:
    """A pass as a call without arguments; each name stands for the value of the first of `sources` that has it.

    A name "owner.attribute" is read from its owner at every launch. Raises KeyError where no source has a name that the
    program cannot do without.
    """
    operation, program = None, ""
    if p.operation not in PROCEDURES:
        program = REGISTRY[p.operation].chosen(backend.name, p.algorithm)
        operation = REGISTRY[p.operation].as_computed_by(program)

    def lookup(argument: str) -> Any:
        name = p.names.get(argument, argument)
        owner, _, attribute = (name or "").partition(".")
        for source in sources:
            if owner in source:
                return LiveAttribute(source[owner], attribute) if attribute else source[owner]
        if name is None or (operation is not None and name in operation.optional):
            return None
        raise KeyError(f"{p.operation} takes {name!r}, which no effect of the scene provides")

    if operation is None:
        return PROCEDURES[p.operation].bind(lookup)
    return operation.bind(program, lookup)


# Passes side by side


class Accesses(NamedTuple):
    """Names of what a launch takes, and of what it changes of these; None if it may touch anything."""

    taken: frozenset[str]
    changed: frozenset[str]


def accesses(p: Pass, backend: str) -> Accesses | None:
    """What a pass touches on a backend, by the arguments of its program; the contract sees that it changes no other.

    A procedure may touch anything. Scratch memory is changed by every program that takes it.
    """
    if p.operation in PROCEDURES:
        return None
    operation = REGISTRY[p.operation]
    name = operation.chosen(backend, p.algorithm)
    arguments, operation = operation.arguments(name), operation.as_computed_by(name)

    def owners(names: Sequence[str]) -> set[str]:
        fields = (p.names.get(argument, argument) for argument in (name.partition(".")[0] for name in names))
        return {(name or "").partition(".")[0] for name in fields} - {""}

    changed = owners((*operation.outputs, *operation.work)) | {*p.writes, *p.updates}
    if "scratch" in arguments:
        changed.add("scratch")
    return Accesses(frozenset({*owners(arguments), *p.reads} | changed), frozenset(changed))


def needed_before(launches: Sequence[Accesses | None]) -> list[tuple[int, ...]]:
    """For each launch the earlier ones that must have ended; without those that these wait for themselves."""
    result: list[tuple[int, ...]] = []
    behind: list[set[int]] = []  # of each launch all that must have ended
    for k, launch in enumerate(launches):
        needed = {
            j
            for j, other in enumerate(launches[:k])
            if launch is None or other is None or launch.changed & other.taken or launch.taken & other.changed
        }
        implied = set().union(*(behind[j] for j in needed))
        behind.append(needed | implied)
        result.append(tuple(sorted(needed - implied)))
    return result
