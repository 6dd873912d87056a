"""What an effect is: parameters with units, the fields it needs, its passes and its stable step.

A scene is a list of effects. What no effect asks for is neither allocated nor launched.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import msgspec
import numpy as np

from refsim.boundary.walls import WallParticles
from refsim.errors import InputError
from refsim.particles import Field


@dataclass(frozen=True)
class Pass:
    """One launch of one operation; `names` says what its arguments are called here where names differ."""

    operation: str
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    updates: tuple[str, ...] = ()  # changed in place: after every writer, before every reader
    on_demand: bool = False  # run when somebody looks at the state, not in every step
    names: Mapping[str, str | None] = field(default_factory=dict)


@dataclass(frozen=True)
class Discretisation:
    """What every effect may know of the scene when it prepares: lengths in metres, dtype as a NumPy name."""

    dim: int
    dtype: str
    spacing: float
    support_radius: float
    count: int

    def real(self, value: float) -> Any:
        """`value` in the run's dtype."""
        return np.dtype(self.dtype).type(value)


@dataclass(frozen=True)
class Extremes:
    """Largest values over the particles in the present step."""

    speed: float  # [m/s]
    acceleration: float  # [m/s^2]


EFFECTS: dict[str, type[Effect]] = {}


class Effect(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all effects. Parameters are the struct's fields, in SI units."""

    name: ClassVar[str] = ""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if cls.name:
            EFFECTS[cls.name] = cls

    def needs(self) -> tuple[str, ...]:
        """Names of effects without which this one cannot work."""
        return ()

    def fields(self, others: Mapping[str, Effect]) -> tuple[Field, ...]:
        """Fields it reads or writes beside the base fields."""
        return ()

    def passes(self, others: Mapping[str, Effect]) -> tuple[Pass, ...]:
        """Its passes in an order that suits it; the plan orders passes of all effects by what they touch."""
        return ()

    def list_radius(self, grid: Discretisation) -> float:
        """Distance [m] up to which it needs neighbours; 0 if it needs none."""
        return 0.0

    def prepare(self, grid: Discretisation, others: Mapping[str, Effect]) -> dict[str, Any]:
        """Parameter groups that its passes take by name, computed once on the host in float64."""
        return {}

    def shares(self, grid: Discretisation, others: Mapping[str, Effect]) -> dict[str, Any]:
        """Parameter groups that passes of every effect may take by name."""
        return {}

    def walls(self, grid: Discretisation, others: Mapping[str, Effect]) -> WallParticles | None:
        """Static boundary particles that it brings into the scene."""
        return None

    def balanced_pressure(self, grid: Discretisation, others: Mapping[str, Effect]) -> float:
        """Cohesive pressure [Pa] of the undisturbed bulk that the equation of state is to balance."""
        return 0.0

    def step_limits(self, grid: Discretisation, others: Mapping[str, Effect], extremes: Extremes) -> dict[str, float]:
        """Largest stable steps [s] by the name of what limits them."""
        return {}

    def greatest_speed(self, grid: Discretisation) -> float:
        """Speed [m/s] beyond which its equations mean nothing: a particle that is faster ends the run."""
        return math.inf

    def check(self, grid: Discretisation, others: Mapping[str, Effect]) -> None:
        """Raise InputError where the parameters do not fit the scene, whose particles are not yet counted."""


def require(owner: str, **bounds: tuple[float, str]) -> None:
    """Check numbers: `name=(value, rule)`, rule one of "positive", "not negative", "finite".

    Raises InputError with one sentence that names the parameter.
    """
    tests = {
        "positive": (lambda x: x > 0, "a positive number"),
        "not negative": (lambda x: x >= 0, "zero or a positive number"),
        "finite": (lambda x: True, "a finite number"),
    }
    for name, (value, rule) in bounds.items():
        test, words = tests[rule]
        if not (math.isfinite(value) and test(value)):
            raise InputError(f"{owner}: {name} = {value} is not possible; give {words}.")


def literal_errata(owner: str, literal: tuple[str, ...], switchable: tuple[str, ...]) -> frozenset[str]:
    """Errata whose printed reading `literal` asks for; "all" in it means every one of `switchable`.

    Raises InputError, naming the effect `owner`, for anything else.
    """
    chosen = {literal} if isinstance(literal, str) else set(literal)
    unknown = chosen - set(switchable) - {"all"}
    if unknown:
        raise InputError(
            f"{owner}: literal has {', '.join(sorted(unknown))}; only {', '.join(switchable)} or all can be given here."
        )
    return frozenset(switchable if "all" in chosen else chosen)
