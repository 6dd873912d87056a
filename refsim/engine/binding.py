"""Passes of a plan as calls without arguments: every name that a program takes is looked up once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core.effect import Effect, Pass
from refsim.core.operation import PROCEDURES, REGISTRY, Current


def joined(passes: Sequence[tuple[Effect, Pass]], backend: str) -> list[tuple[tuple[Effect, ...], Pass]]:
    """The passes in their order, each with its effects; on a GPU one in the place of two that an operation joins.

    It stands where the later of the two stood: what both read is there by then, and accelerations add in any order.
    """
    result = [((effect,), p) for effect, p in passes]
    for operation in REGISTRY.values():
        places = [k for k, (_, p) in enumerate(result) if p.operation in operation.joins]
        if backend != "cuda" or len(places) != 2:
            continue
        (first, p), (second, q) = (result[k] for k in places)
        names = {name: other for name, other in (*p.names.items(), *q.names.items()) if name in operation.optional}
        reads = tuple(dict.fromkeys((*p.reads, *q.reads)))
        if set(reads) <= {*operation.arguments(backend), *names.values()}:
            one = Pass(operation.name, reads, updates=("acceleration",), names=names)
            result[places[1]] = ((*first, *second), one)
            del result[places[0]]
    return result


def bound(p: Pass, backend: Backend, sources: Sequence[Mapping[str, Any]]) -> Callable[[], None]:
    """A pass as a call without arguments; each name stands for the value of the first of `sources` that has it.

    A name "owner.attribute" is read from its owner at every launch. Raises KeyError where no source has a name that the
    program cannot do without.
    """
    procedure = PROCEDURES.get(p.operation)
    operation = None if procedure is not None else REGISTRY[p.operation]

    def lookup(name: str) -> Any:
        name = p.names.get(name, name)
        owner, _, attribute = (name or "").partition(".")
        for source in sources:
            if owner in source:
                return Current(source[owner], attribute) if attribute else source[owner]
        if name is None or (operation is not None and name in operation.optional):
            return None
        raise KeyError(f"{p.operation} takes {name!r}, which no effect of the scene provides")

    return backend.bind(operation, lookup) if operation is not None else procedure.bind(lookup)


def on_backend(value: Any, backend: Backend) -> Any:
    """A parameter group with its arrays on the backend."""
    if isinstance(value, np.ndarray):
        return backend.asarray(value)
    if isinstance(value, tuple) and any(isinstance(part, np.ndarray) for part in value):
        return type(value)(*(on_backend(part, backend) for part in value))
    return value.on_backend(backend) if hasattr(value, "on_backend") else value
