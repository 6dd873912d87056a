"""Units of parameters, read from the docstrings that the schema is made of, and scenes in other units."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import msgspec
import numpy as np

from refsim.core.effect import Effect
from refsim.scene.files import describe, unit_of
from refsim.scene.scene import Scene


class Unit(NamedTuple):
    """Powers of metre, second, kilogram and kelvin; or factors of the four, as `Unit.of` takes them."""

    length: float
    time: float
    mass: float
    temperature: float

    def of(self, factors: Unit) -> float:
        """What one of this unit becomes if the four are multiplied by `factors`."""
        return float(np.prod([factor**power for factor, power in zip(factors, self)]))


SYMBOLS = {
    "m": Unit(1, 0, 0, 0), "s": Unit(0, 1, 0, 0), "kg": Unit(0, 0, 1, 0), "K": Unit(0, 0, 0, 1),
    "C": Unit(0, 0, 0, 1), "Pa": Unit(-1, -2, 1, 0), "N": Unit(1, -2, 1, 0), "J": Unit(2, -2, 1, 0),
    "W": Unit(2, -3, 1, 0),
}  # fmt: skip


def unit(words: str, dim: int = 3) -> Unit:
    """Powers of "W/(m K)", and in 2D of what stands behind the semicolon of "kg; kg/m in 2D".

    Masses of the plane are those of a metre of depth: densities and viscosities have the same unit as in space.
    """
    space, _, plane = words.partition(";")
    chosen = plane if plane and dim == 2 and not space.startswith(("kg/m^3", "Pa s")) else space
    total = np.zeros(4)
    sign, inside = 1, False
    for symbol, power in re.findall(r"([A-Za-z]+|[/()])(?:\^(-?\d+))?", chosen.replace("deg C", "C").split(" in ")[0]):
        if symbol == "/":
            sign = -1
        elif symbol in "()":
            inside = symbol == "("
            sign = sign if inside else 1
        else:
            total += sign * int(power or 1) * np.array(SYMBOLS.get(symbol, Unit(0, 0, 0, 0)))
            sign = sign if inside else 1
    return Unit(*map(float, total))


def units_of(kind: type, dim: int) -> dict[str, Unit]:
    """Units of a struct's fields, by its docstring."""
    found = {name: unit_of(text) for name, text in describe(kind).items() if name != "literal"}
    return {name: unit(words, dim) for name, words in found.items() if words}


def scaled(part: Any, factors: Unit, dim: int = 0) -> Any:
    """The same scene, or a part, in other units: lengths, times, masses, temperatures `factors` times as large."""
    dim = dim or part.dim
    units, changes = units_of(type(part), dim), {}
    for field in msgspec.structs.fields(type(part)):
        value = getattr(part, field.name)
        if isinstance(value, tuple) and any(isinstance(v, msgspec.Struct) for v in value):
            changes[field.name] = tuple(scaled(v, factors, dim) for v in value)
        elif field.name in units and value is not None and not isinstance(value, str):
            f = units[field.name].of(factors)
            if f == 1 or (field.name == "amplitude" and part.of == "turn"):  # whose unit is then the radian
                continue
            kept = isinstance(value, np.ndarray)
            changes[field.name] = value * f if kept or np.isscalar(value) else tuple(f * v for v in value)
    return msgspec.structs.replace(part, **changes)


def without(scene: Scene, name: str) -> Scene:
    """The scene without an effect."""
    return msgspec.structs.replace(scene, effects=tuple(e for e in scene.effects if e.name != name))


def with_effect(scene: Scene, effect: Effect) -> Scene:
    """The scene with another effect of that name."""
    return msgspec.structs.replace(scene, effects=tuple(effect if e.name == effect.name else e for e in scene.effects))
