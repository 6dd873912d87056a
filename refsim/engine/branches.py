"""Which passes of a step need the results of which others: those that do not may run side by side in its graph."""

from collections.abc import Sequence
from typing import NamedTuple

from refsim.core.effect import Pass
from refsim.core.operation import PROCEDURES, REGISTRY


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
