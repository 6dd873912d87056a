"""Scene files that are altered, drawn from the scene's own types, or damaged as text; then planned, and some run.

Most trials start from a scene that runs and change few values, so that they get past the first check. Values are drawn
by the type of the key, with the limits of numbers among them, and sometimes of another type.
"""

from __future__ import annotations

import json
import os
import random
import types
import typing
from pathlib import Path
from typing import Any

import msgspec

from validation.attack.checkpoints import OBJ
from validation.attack.commands import here

LIQUID = {"rest_density": 1000.0, "sound_speed": 20.0, "dynamic_viscosity": 2.2, "density": "summation"}
BASE = {"spacing": 0.01, "support_radius": 0.026, "end_time": 0.01}
BLOCK = [{"shape": "box", "lower": [0.02, 0.02, 0.02], "cells": [3, 3, 3]}]
FAR = [{"shape": "box", "lower": [0.1, 0.1, 0.1], "cells": [3, 3, 3]}]
FLAT = [{"shape": "box", "lower": [0.02, 0.02, 0.0], "cells": [5, 5, 1]}]
BALL = [{"shape": "ball", "center": [0.05, 0.05, 0.05], "radius": 0.02}]
WALLS = {"lower": [0.0, 0.0, 0.0], "upper": [0.1, 0.1, 0.1]}
WEIGHT = {"acceleration": [0.0, -9.81, 0.0]}
TENSION = {"surface_tension": 0.07}
SCENES: list[dict[str, Any]] = [
    BASE | {"dim": 2, "fluid": FLAT, "effects": {
        "weakly_compressible": LIQUID, "gravity": WEIGHT, "box_walls": WALLS | {"upper": [0.1, 0.1, 0.0]}}},
    BASE | {"fluid": BLOCK, "effects": {"weakly_compressible": LIQUID, "jiang_zhu_2023": TENSION}},
    BASE | {"fluid": BLOCK, "effects": {"weakly_compressible": LIQUID, "akinci_2013": TENSION}, "dtype": "float64"},
    BASE | {"fluid": BLOCK, "effects": {"mpm_liquid": {"bulk_modulus": 2500.0}, "mpm_walls": WALLS, "gravity": {}}},
    BASE | {"fluid": BLOCK, "effects": {"iisph": {}, "weakly_compressible": LIQUID, "gravity": {}}},
    BASE | {"solid": BALL, "fluid": [],
            "effects": {"weakly_compressible": LIQUID, "shape_matching": {}, "gravity": {}, "box_walls": WALLS}},
    BASE | {"fluid": FAR, "effects": {"weakly_compressible": LIQUID, "mesh_boundary": {"file": "stone.obj"}}},
    BASE | {"dim": 2, "fluid": [{"shape": "cloud", "position": [[0.0, 0.0], [0.01, 0.0], [0.0, 0.01]]}],
            "effects": {"weakly_compressible": LIQUID, "csf_wang_2019": TENSION}},
    BASE | {"dim": 2, "fluid": [{"shape": "ball", "radius": 0.03, "velocity": [0.1, 0.0, 0.0]}],
            "effects": {"weakly_compressible": LIQUID, "tartakovsky_meakin_2005": TENSION}},
    BASE | {"dim": 2, "fluid": FLAT, "effects": {"weakly_compressible": LIQUID, "becker_teschner_2007": TENSION}},
    BASE | {"fluid": BLOCK, "effects": {"weakly_compressible": LIQUID, "he_2014": TENSION, "surface_detection": {}}},
]  # fmt: skip
WEIGHTS = [0.3 if "mesh_boundary" in scene["effects"] else 1.0 for scene in SCENES]  # a mesh takes seconds
FLOATS = (0.0, -0.0, 1.0, -1.0, 1e-3, 1e3, 1e-9, 1e9, 1e-30, 1e30, 1e-310, 1e308, 5e-324, float("nan"), float("inf"))
INTEGERS = (0, 1, -1, 2, 3, 7, 100, 2**31 - 1, 2**31, 2**53 + 1, 2**63, -(2**63), 2**64, 10**30)
TEXTS = ("", " ", "a", "stone.obj", "nowhere.obj", ".", "/", "../..", "empty.obj", "table.csv", "table.npy", "pipe",
         "/dev/null", "/dev/zero", "\u0000", "\u202e", "\U0001f4a7" * 50, "x" * 5000, "float16", "nan")  # fmt: skip
RAW = ("1979-05-27", "0x1F", "+inf", "1_000", "[[]]", "{}", "[[[[[[1]]]]]]", "''", "1e400", "-nan", "true", '"""a"""',
       "1" + "0" * 5000)  # fmt: skip
STEPS = 3
MOST = 200  # particles of a scene that is also run


class _Raw(str):
    """Text that stands in the file as it is."""


def make(seed: int, number: int) -> dict[str, Any]:
    """The file's bytes as text (latin-1), and whether it is run if it can be planned."""
    draw = random.Random(f"scenes {seed} {number}")
    scene = json.loads(json.dumps(draw.choices(SCENES, WEIGHTS)[0]))
    way = draw.random()
    if way < 0.75:
        for _ in range(draw.choice((0, 1, 1, 1, 1, 2, 3))):
            _alter(scene, draw)
    elif way < 0.9:
        scene = _drawn(draw)
    text = _toml(scene).encode("utf-8", "surrogatepass")
    if way >= 0.9:
        text = _spoiled(text, draw)
    return {"text": text.decode("latin-1"), "run": draw.random() < 0.25}


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Plan the scene; run a few steps of a small one on numpy."""
    import numpy as np

    (folder / "stone.obj").write_text(OBJ)
    (folder / "empty.obj").write_text("")
    (folder / "table.csv").write_text("0,0\n0.01,0\n")
    np.save(folder / "table.npy", np.zeros((2, 3)))
    if hasattr(os, "mkfifo"):
        os.mkfifo(folder / "pipe")
    path = folder / "scene.toml"
    path.write_bytes(trial["text"].encode("latin-1"))
    outcome, words = here(["plan", str(path)])
    return _steps(path, folder) if outcome == "0" and trial["run"] else (outcome, words)


def _steps(path: Path, folder: Path) -> tuple[str, str]:
    import numpy as np

    from refsim.core.errors import RefsimError
    from refsim.engine.driver import simulate
    from refsim.engine.simulation import Simulation
    from refsim.scene.files import load_scene
    from refsim.scene.plan import make_plan

    plan = make_plan(load_scene(path))
    walls = 0 if plan.walls is None else len(plan.walls.position)
    if plan.grid.count > MOST or walls > 5000:
        return "0", "too large to be run here"
    try:
        simulation = Simulation(plan, "numpy")
        with np.errstate(all="ignore"):
            simulate(simulation, output=folder / "run", asked_to_stop=lambda: simulation.steps >= STEPS)
    except RefsimError as error:
        return str(error.exit_code), " ".join(str(error).split())
    return "0", ""


# Changes


def _alter(scene: dict[str, Any], draw: random.Random) -> None:
    """One change of a scene's tables, in place."""
    from refsim.core.effect import EFFECTS

    tables = _tables(scene)
    table, kind = draw.choice(tables)
    what = draw.random()
    fields = {f.name: f.type for f in msgspec.structs.fields(kind)} if kind else {}
    if what < 0.55 and fields:
        name = draw.choice(list(fields))
        table[name] = _value(fields[name], draw)
    elif what < 0.7 and table:
        name = draw.choice(list(table))
        table[name] = _number(table[name], draw)
    elif what < 0.78 and table:
        del table[draw.choice(list(table))]
    elif what < 0.84:
        table[draw.choice(("spacing", "radius", "file", "colour", "", "a b", "shape"))] = _any(draw)
    elif what < 0.95 and isinstance(scene.get("effects"), dict):
        name = draw.choice(list(EFFECTS))
        scene["effects"][name] = _struct(EFFECTS[name], draw, 0.2)
    else:
        scene.setdefault(draw.choice(("fluid", "solid")), [])
        part = _part(draw)
        key = draw.choice(("fluid", "solid"))
        scene[key] = [*scene[key], part] if isinstance(scene.get(key), list) else [part]


def _number(value: Any, draw: random.Random) -> Any:
    """A value near another one, or of another size."""
    if isinstance(value, float):
        return draw.choice((-value, value * 10 ** draw.uniform(-3, 3), value * 2, value * draw.uniform(0.5, 2)))
    if isinstance(value, int) and not isinstance(value, bool):
        return draw.choice((-value, value + 1, value * 2, float(value), str(value)))
    if isinstance(value, list) and value:
        k = draw.randrange(len(value))
        return draw.choice((value[:k], [*value, value[k]], value[:k] + [_number(value[k], draw)] + value[k + 1 :]))
    return _any(draw)


def _tables(scene: dict[str, Any]) -> list[tuple[dict[str, Any], Any]]:
    """Every table of the scene with the struct that it becomes, if it is known."""
    from refsim.core.effect import EFFECTS
    from refsim.scene.scene import Scene

    found: list[tuple[dict[str, Any], Any]] = [(scene, Scene)]
    parts = {kind.__struct_config__.tag: kind for kind in _parts()}
    for key in ("fluid", "solid"):
        for part in scene.get(key) or [] if isinstance(scene.get(key), list) else []:
            if isinstance(part, dict):
                found.append((part, parts.get(part.get("shape")) if isinstance(part.get("shape"), str) else None))
    effects = scene.get("effects")
    if isinstance(effects, dict):
        found += [(table, EFFECTS.get(name)) for name, table in effects.items() if isinstance(table, dict)]
    return found


def _parts() -> list[type]:
    from refsim.scene import shapes, solids

    return [shapes.Box, shapes.Ball, shapes.Cloud, solids.SolidBox, solids.SolidBall, solids.SolidTorus,
            solids.SolidMesh, solids.SolidCells]  # fmt: skip


def _part(draw: random.Random) -> dict[str, Any]:
    kind = draw.choice(_parts())
    return {"shape": kind.__struct_config__.tag} | _struct(kind, draw, 0.4)


def _drawn(draw: random.Random) -> dict[str, Any]:
    """A scene from its types alone."""
    from refsim.core.effect import EFFECTS

    scene: dict[str, Any] = dict(BASE)
    scene |= {"fluid": [_part(draw) for _ in range(draw.randint(0, 2))]}
    if draw.random() < 0.3:
        scene["solid"] = [_part(draw)]
    names = draw.sample(list(EFFECTS), draw.randint(0, 3))
    scene["effects"] = {name: _struct(EFFECTS[name], draw, 0.3) for name in names}
    if draw.random() < 0.8:
        scene["effects"]["weakly_compressible"] = dict(LIQUID)
    return scene


def _struct(kind: Any, draw: random.Random, share: float) -> dict[str, Any]:
    """Values for the keys that a struct must have, and for a share of the others."""
    fields = msgspec.structs.fields(kind)
    return {f.name: _value(f.type, draw, 0.7) for f in fields if f.required or draw.random() < share}


def _value(kind: Any, draw: random.Random, tame: float = 0.3) -> Any:
    """A value of a type; a share of `tame` values are of ordinary size, and one in twenty is of another type."""
    if draw.random() < 0.05:
        return _any(draw)
    origin, inside = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.Literal:
        return draw.choice(inside)
    if origin in (typing.Union, types.UnionType):
        return _value(draw.choice([k for k in inside if k is not type(None)]), draw, tame)
    if origin is typing.Annotated:
        return _value(inside[0], draw, tame)
    if origin in (tuple, list, set, frozenset):
        many = inside[-1:] == (...,) or origin is not tuple
        members = [inside[0]] * draw.randint(0, 3) if many else inside
        return [_value(k, draw, tame) for k in members]
    if kind is bool:
        return draw.random() < 0.5
    if kind is int:
        return draw.randint(1, 4) if draw.random() < tame else draw.choice(INTEGERS)
    if kind is float:
        tamed = round(10 ** draw.uniform(-3, 3), 4)
        return tamed if draw.random() < tame else draw.choice((*FLOATS, *(-x for x in FLOATS), *INTEGERS))
    if kind is str:
        return draw.choice(TEXTS)
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return _struct(kind, draw, 0.3)
    return _any(draw)


def _any(draw: random.Random) -> Any:
    """A value of any type."""
    way = draw.randrange(7)
    if way < 4:
        return draw.choice((FLOATS, INTEGERS, TEXTS, (True, False))[way])
    if way == 4:
        return _Raw(draw.choice(RAW))
    if way == 5:
        return [_any(draw) for _ in range(draw.randint(0, 4))] if draw.random() < 0.7 else [[0.0, 0.0, 0.0]] * 3
    return {draw.choice(("a", "shape", "spacing")): _any(draw)} if draw.random() < 0.6 else {}


# Text


def _toml(scene: dict[str, Any]) -> str:
    lines = [f"{_key(name)} = {_written(value)}" for name, value in scene.items() if name != "effects"]
    effects = scene.get("effects")
    if not isinstance(effects, dict):
        return "\n".join([*lines, *([] if effects is None else [f"effects = {_written(effects)}"])]) + "\n"
    for name, values in effects.items():
        lines.append(f"[effects.{_key(name)}]")
        if isinstance(values, dict):
            lines += [f"{_key(k)} = {_written(v)}" for k, v in values.items()]
        else:
            lines[-1] = f"[effects]\n{_key(name)} = {_written(values)}"
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if name.replace("_", "").isalnum() and name.isascii() else json.dumps(name)


def _written(value: Any) -> str:
    if isinstance(value, _Raw):
        return str(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, list):
        return f"[{', '.join(map(_written, value))}]"
    return "{" + ", ".join(f"{_key(k)} = {_written(v)}" for k, v in value.items()) + "}"


def _spoiled(text: bytes, draw: random.Random) -> bytes:
    """The bytes of a file with one or a few places damaged."""
    content = bytearray(text)
    for _ in range(draw.choice((1, 1, 2, 5))):
        place = draw.randrange(len(content) + 1)
        way = draw.randrange(6)
        if way == 0 and place < len(content):
            content[place] ^= 1 << draw.randrange(8)
        elif way == 1:
            content[place : place + draw.randint(1, 30)] = b""
        elif way == 2:
            content[place:place] = draw.choice(
                (b"\0", b"\xff\xfe", b"\r", b"\xc3", b"'''", b"[", b"=", b"\xef\xbb\xbf")
            )
        elif way == 3:
            content[place:place] = content[max(0, place - 40) : place]
        elif way == 4:
            del content[place:]
        else:
            content[place:place] = b"[" * draw.choice((1, 50, 5000))
    return bytes(content)
