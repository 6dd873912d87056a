"""One equation, its three programs, its hard inputs: the registry that makes the tests.

Arguments are bound by name. A kernel names the arrays and parameter groups it takes; its outputs stand last.
The reference takes the same names, less the neighbour structures and the outputs, and returns
`{output: (value, scale)}`, where `scale` is the sum of the absolute terms behind each value; for a flag, of which
nothing can be nearly right, it is the margin: the relative distance of the decision from flipping.
"""

from __future__ import annotations

import functools
import importlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

BACKENDS = ("numpy", "cpu", "cuda")


@dataclass(frozen=True)
class Operation:
    """One equation of one paper and where its programs stand.

    name        "folder.operation", unique
    folder      the package that holds reference.py, cpu.py and cuda.py
    paper       author and year, or "standard"
    equation    the paper's number, with the spec's erratum where the adopted reading differs
    function    name of the function in all three files
    outputs     kernel arguments that are written
    exact       outputs compared exactly wherever the margin exceeds tolerance * eps
    reach       how many neighbourhoods away one particle's values act; 0 where they may act on all
    adds        outputs to which the kernel adds instead of assigning
    work        arguments, or members of groups ("group.member"), that serve as work space: the contract lets a program
                change them, and no other input
    entrywise   outputs of the whole set with a bound for each entry, whose scale counts the terms itself
    optional    arguments that are None where the scene has no such thing
    tolerance   c in the bound c * neighbours * eps * sum|terms|, with its reason in `tolerance_reason`
    variants    argument overrides under which the operation is tested again (None drops an optional term)
    invariants  names of the contract's conservation and symmetry checks that hold
    broken      those that a variant does not keep, by the variant's number
    cases       names of hard inputs beside the common ones
    joins       operations of which it adds the accelerations of two up in one loop over the neighbours; a GPU launches
                it in place of the two, which saves reading each neighbour twice
    rarely      True where another operation computes the same in another way: its CPU programs are tested once, the
                rest under `slow`
    """

    name: str
    folder: str
    paper: str
    equation: str
    function: str
    outputs: tuple[str, ...]
    exact: tuple[str, ...] = ()
    adds: tuple[str, ...] = ()
    reach: int = 1
    work: tuple[str, ...] = ()
    entrywise: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    tolerance: float = 4.0
    tolerance_reason: str = (
        "one rounding in each of distance, kernel, product and sum, and a few in the kernel's polynomial"
    )
    variants: tuple[Mapping[str, Any], ...] = field(default_factory=lambda: ({},))
    invariants: tuple[str, ...] = ()
    broken: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    cases: tuple[str, ...] = ()
    joins: tuple[str, ...] = ()
    rarely: bool = False

    def program(self, backend: str) -> Callable:
        """The function that computes this operation on `backend`, imported at first use."""
        return _program(self.folder, {"numpy": "reference"}.get(backend, backend), self.function)

    def arguments(self, backend: str) -> tuple[str, ...]:
        """Names that the program takes, in order."""
        function = self.program(backend)
        names = inspect.signature(getattr(function, "py_func", function)).parameters
        return tuple(name for name in names if name != "rows")

    def bind(self, backend: str, lookup: Callable[[str], Any]) -> Callable[[], None]:
        """A call without arguments: the program on the values that `lookup` gives for its names."""
        function = self.program(backend)
        values = [lookup(name) for name in self.arguments(backend)]
        if backend != "numpy":
            if any(isinstance(value, Current) for value in values):
                return lambda: function(*map(current, values))
            return functools.partial(function, *values)
        targets = {name: lookup(name) for name in self.outputs}

        def call() -> None:
            for name, (value, _) in function(*map(current, values)).items():
                target = current(targets[name])
                if target is None:
                    continue
                if name in self.adds:
                    target += value.astype(target.dtype)
                else:
                    target[...] = value

        return call


@dataclass(frozen=True)
class Current:
    """Attribute `name` of an object of the run, taken anew at each launch: an array whose size changes, say."""

    owner: Any
    name: str


def current(value: Any) -> Any:
    """What a Current stands for at present; any other value as it is."""
    return getattr(value.owner, value.name) if isinstance(value, Current) else value


REGISTRY: dict[str, Operation] = {}


def register(operation: Operation) -> Operation:
    """Enter an operation; a name is entered once."""
    if operation.name in REGISTRY:
        raise ValueError(f"operation {operation.name!r} is registered twice")
    REGISTRY[operation.name] = operation
    return operation


@dataclass(frozen=True)
class Procedure:
    """Operations that an object of the run launches one after another, for a pass that bears its name.

    owner       what the object is called among the parameter groups
    method      of the object, which gets what `takes` names
    operations  what it launches, for people
    """

    name: str
    owner: str
    method: str
    takes: tuple[str, ...]
    operations: tuple[str, ...]

    def bind(self, lookup: Callable[[str], Any]) -> Callable[[], None]:
        """A call without arguments on the values that `lookup` gives for the names."""
        values = [lookup(name) for name in (self.owner, *self.takes)]

        def call() -> None:
            owner, *arguments = map(current, values)
            getattr(owner, self.method)(*arguments)

        return call


PROCEDURES: dict[str, Procedure] = {}


def enter(procedure: Procedure) -> Procedure:
    """Enter a procedure; no operation may have its name."""
    if procedure.name in PROCEDURES or procedure.name in REGISTRY:
        raise ValueError(f"procedure {procedure.name!r} has a name that is taken")
    PROCEDURES[procedure.name] = procedure
    return procedure


@functools.cache
def _program(folder: str, module: str, function: str) -> Callable:
    return getattr(importlib.import_module(f"{folder}.{module}"), function)
