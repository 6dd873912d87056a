"""Scenes in other units, read from the docstrings that the schema is made of, elsewhere, with other axes; meshes."""

from __future__ import annotations

import hashlib
import re
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from refsim.core.effect import Effect
from refsim.core.writing import write_file
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
    """Powers of "W/(m K)"; in 2D, where masses are those of a metre of depth, those behind "; " of "kg; kg/m in 2D"."""
    space, _, plane = words.partition(";")
    chosen = plane if plane and dim == 2 and not space.startswith(("kg/m^3", "Pa s")) else space
    total, sign, inside = np.zeros(4), 1, False
    for symbol, power in re.findall(r"([A-Za-z]+|[/()])(?:\^(-?\d+))?", chosen.replace("deg C", "C").split(" in ")[0]):
        if symbol in SYMBOLS:
            total += sign * int(power or 1) * np.array(SYMBOLS[symbol])
        inside = symbol == "(" if symbol in ("(", ")") else inside
        sign = -1 if symbol == "/" else sign if inside else 1
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
            if f == 1 or (field.name in ("amplitude", "values") and part.of == "turn"):  # whose unit is then the radian
                continue
            changes[field.name] = tuple(f * v for v in value) if isinstance(value, tuple | list) else value * f
    return msgspec.structs.replace(part, **changes)


def without(scene: Scene, name: str) -> Scene:
    """The scene without an effect."""
    return msgspec.structs.replace(scene, effects=tuple(e for e in scene.effects if e.name != name))


def with_effect(scene: Scene, effect: Effect) -> Scene:
    """The scene with another effect of that name."""
    return msgspec.structs.replace(scene, effects=tuple(effect if e.name == effect.name else e for e in scene.effects))


PLACES = {"position", "lower", "upper", "center", "pivot", "period_lower"}  # members that are places [m]
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))  # and its ends
SIDES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))  # of a hexahedron
TRIANGLES = [(a, b, c) for p, q, r, s in SIDES for a, b, c in ((p, q, r), (p, r, s))]


def hexahedron(length: float, width: float, depth: float, slope: float = 0.0) -> str:
    """The file of a block below z = 0, whose top falls along x by `slope` of its depth."""
    top = np.array([[0, 0, 0], [length, 0, -depth * slope], [length, width, -depth * slope], [0, width, 0]], float)
    low = np.where([True, True, False], top, -float(depth))
    return mesh_file(np.concatenate([low, top]), TRIANGLES)


def mesh_file(corners: np.ndarray, faces: Any) -> str:
    """The file of these triangles."""
    text = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist())
    text += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    folder = Path(tempfile.gettempdir()) / "refsim-laws"
    folder.mkdir(exist_ok=True)
    path = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:12]}.obj"
    if not path.exists() or path.read_text() != text:
        write_file(path, text)
    return str(path)


def turned(part: Any, axes: list[int]) -> Any:
    """The scene with other axes, or a part of it: what lay along axes[k] lies along k."""
    hand = round(float(np.linalg.det(np.eye(3)[axes])))
    changes: dict[str, Any] = {}
    for name in part.__struct_fields__:
        value = getattr(part, name)
        # what turns about an axis goes the other way round in a mirror
        about = hand if name == "spin" or (name == "direction" and part.of == "turn") else 1
        if isinstance(value, np.ndarray) and value.ndim == 2:
            changes[name] = value[:, axes]
        elif name == "file" and value:
            changes[name] = _mesh_turned(value, axes, hand)
        elif isinstance(value, tuple) and any(isinstance(v, msgspec.Struct) for v in value):
            changes[name] = tuple(turned(v, axes) for v in value)
        elif isinstance(value, tuple) and value and all(isinstance(v, str) and len(v) == 2 for v in value):
            changes[name] = tuple(f"{face[0]}{'xyz'[axes.index('xyz'.index(face[1]))]}" for face in value)
        elif isinstance(value, tuple) and len(value) == 3 and all(isinstance(v, float | int) for v in value):
            changes[name] = tuple(about * value[axis] for axis in axes)
    return msgspec.structs.replace(part, **changes)


def _mesh_turned(file: str, axes: list[int], hand: int) -> str:
    lines = [line.split() for line in Path(file).read_text().splitlines()]
    corners = np.array([[float(word) for word in words[1:]] for words in lines if words[0] == "v"])
    faces = [tuple(int(word) - 1 for word in words[1:])[::hand] for words in lines if words[0] == "f"]
    return mesh_file(corners[:, axes], faces)  # type: ignore[arg-type]


def moved(part: Any, way: np.ndarray, boost: np.ndarray | float = 0.0) -> Any:
    """The scene elsewhere [m], its liquid faster [m/s]; or a part of it."""
    changes: dict[str, Any] = {}
    for name in part.__struct_fields__:
        value = getattr(part, name)
        if isinstance(value, np.ndarray) and name in ("position", "velocity"):
            changes[name] = value + (way if name == "position" else boost)
        elif isinstance(value, tuple) and any(isinstance(v, msgspec.Struct) for v in value):
            changes[name] = tuple(moved(v, way, boost) for v in value)
        elif name in PLACES and isinstance(value, tuple) and (name != "period_lower" or any(part.period)):
            changes[name] = tuple(float(v) for v in np.add(value, way))
    return msgspec.structs.replace(part, **changes)
