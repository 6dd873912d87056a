"""Scenes seen from elsewhere: moved, with other axes; and meshes whose corners are known."""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim.core.writing import write_file

PLACES = {"position", "lower", "upper", "center", "pivot", "period_lower"}  # members that are places [m]
SIDES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))  # of a hexahedron


def hexahedron(length: float, width: float, depth: float, slope: float = 0.0) -> str:
    """The file of a block below z = 0, whose top falls along x by `slope` of its depth."""
    down = -depth * slope
    top = np.array([[0, 0, 0], [length, 0, down], [length, width, down], [0, width, 0]], dtype=float)
    low = np.where([True, True, False], top, -float(depth))
    corners = np.concatenate([low, top])
    faces = [(a, b, c) for p, q, r, s in SIDES for a, b, c in ((p, q, r), (p, r, s))]
    return _written(corners, faces)


def _written(corners: np.ndarray, faces: list[tuple[int, int, int]]) -> str:
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
    return _written(corners[:, axes], faces)  # type: ignore[arg-type]


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
