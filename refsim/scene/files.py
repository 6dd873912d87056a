"""Scenes as TOML: reading with errors that name the place, writing for checkpoints, and the published JSON schema.

What a field means is written once, in the docstring of its class ("name   meaning [unit]"); the schema, the
lists of the command line and the error messages all take it from there.
"""

import functools
import inspect
import io
import json
import os
import pathlib
import re
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from refsim.core.checked import as_plain, plainly, suggestion, why, word_for
from refsim.core.effect import EFFECTS, Effect
from refsim.core.errors import InputError
from refsim.core.reading import open_regular
from refsim.gauges import Gauge
from refsim.motion import Motion
from refsim.scene.scene import Scene
from refsim.scene.shapes import Ball, Box, Cloud, FluidMesh
from refsim.scene.solids import SolidBall, SolidBox, SolidCells, SolidMesh, SolidTorus

VERSION = 1  # of scene files; docs/public_names.md says when it grows
LARGEST_FILE = 1 << 28  # bytes
SHAPES = {kind.__struct_config__.tag: kind for kind in (Box, Ball, Cloud, FluidMesh)}
SOLIDS = {kind.__struct_config__.tag: kind for kind in (SolidBox, SolidBall, SolidTorus, SolidMesh, SolidCells)}
DEEPEST = 50  # levels of tables and lists; a scene has four
# What a scene lists: its class, or the shapes that it can have
LISTED: dict[str, Any] = {"fluid": SHAPES, "solid": SOLIDS, "motion": Motion, "gauge": Gauge}


@plainly
def load_scene(path: str | os.PathLike[str]) -> Scene:
    """The scene in a TOML file; a cloud's `file` is looked for beside it.

    Raises InputError, in one sentence with file and place, when the file is missing, is not TOML, has an
    unknown key, lacks one or has a value of the wrong kind.
    """
    path = pathlib.Path(path)
    return parse_scene(text_of(path, "scene file"), str(path), folder=path.parent)


def text_of(path: pathlib.Path, what: str) -> str:
    """The text of a TOML file. Raises InputError, which begins with `what`, where it cannot be read."""
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            if size > LARGEST_FILE:
                raise InputError(
                    f"{what} {path} has {size / 2**20:,.0f} MiB, more than {LARGEST_FILE >> 20}; keep the positions"
                    " of a cloud in a .npy file beside it."
                )
            with io.TextIOWrapper(file, encoding="utf-8-sig") as lines:  # some editors begin with a byte-order mark
                return lines.read()
    except FileNotFoundError:
        raise InputError(f"{what} {path} does not exist; give the path of a TOML file.") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not TOML, because it is not text in UTF-8; give a {what}.") from None
    except OSError as error:
        raise InputError(f"{what} {path} cannot be read ({error.strerror}); give the path of a file.") from None


def parse_scene(text: str, source: str, folder: pathlib.Path | None = None) -> Scene:
    """The scene in a TOML text; `source` names it in errors, `folder` is where files of clouds lie."""
    return scene_from_dict(tables_of(text, source), source, folder)


def tables_of(text: str, source: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises InputError, which begins with `source`, where it is none."""
    import tomllib  # here, as everything that only some scenes need: importing refsim loads it otherwise

    try:
        tables = tomllib.loads(text)
        if _depth(tables) > DEEPEST:
            raise RecursionError
        return tables
    except ValueError as error:  # tomllib's own, and Python's for whole numbers of thousands of digits
        message = str(error)
        raise InputError(f"{source} is not TOML: {message[:1].lower()}{message[1:]}; correct that place.") from None
    except RecursionError:
        raise InputError(f"{source}: its tables or lists are nested too deeply; a scene needs four levels.") from None


def _depth(tables: Any) -> int:
    """Levels of tables and lists in one another."""
    level, depth = [tables], 0
    while level:
        inner = [v.values() if isinstance(v, dict) else v for v in level if isinstance(v, dict | list)]
        level, depth = [value for values in inner for value in values], depth + bool(inner)
    return depth


def scene_from_dict(tables: Mapping[str, Any], source: str, folder: pathlib.Path | None = None) -> Scene:
    """The scene in nested tables, as TOML gives them."""
    for key in tables:
        if key in EFFECTS:
            raise InputError(f"{source}: the table [{key}] is an effect; call it [effects.{key}].")
    values = dict(tables)
    version = values.pop("version", VERSION)
    if type(version) is not int or version != VERSION:
        raise InputError(f"{source}: version = {version!r} is not known; this refsim reads version {VERSION}.")
    for name, kind in LISTED.items():
        values[name] = tuple(_beside(part, folder) for part in _parts(name, kind, values.get(name, []), source))
    values["effects"] = tuple(_beside(effect, folder) for effect in _effects(values.get("effects", {}), source))
    return struct_of(Scene, values, source, ready=(*LISTED, "effects"))


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """The scene as nested tables of plain values; `scene_from_dict` gives the same scene back."""
    tables = {name: value for name, value in _plain(scene).items() if name not in (*LISTED, "effects")}
    tables |= {name: [_plain(one) for one in getattr(scene, name)] for name in LISTED if getattr(scene, name)}
    tables["effects"] = {effect.name: _plain(effect) for effect in scene.effects}
    return tables


def set_parameter(tables: Mapping[str, Any], name: str, value: Any, source: str) -> None:
    """Set a parameter in a scene's tables. Raises InputError as `place_of` does."""
    place, last = place_of(tables, name, source)
    place[last] = value


def place_of(tables: Mapping[str, Any], name: str, source: str) -> tuple[Any, str]:
    """The table that holds a parameter, such as effects.gravity.acceleration or fluid.1.cells, and its own name there.

    Parts count from 1. Raises InputError, beginning with `source`, where the scene lacks the table or the part.
    """
    *parents, last = name.split(".")
    place: Any = tables
    for word in parents:
        if isinstance(place, list):
            inner = place[int(word) - 1] if word.isdecimal() and 0 < int(word) <= len(place) else None
            hint = f"it has numbers 1 to {len(place)}."
        else:
            inner = place.get(word)
            hint = suggestion(word, [key for key, held in place.items() if isinstance(held, dict | list)])
        if not isinstance(inner, dict | list):
            raise InputError(f"{source}: the scene has no parameter {name!r}, for lack of {word!r}; {hint}")
        place = inner
    if not isinstance(place, dict):
        raise InputError(f"{source}: {name!r} is no parameter; write a part's number and then a name: fluid.1.cells.")
    return place, last


def scene_to_toml(scene: Scene) -> str:
    """The scene as TOML text, every value written out; numbers come back bit for bit."""
    tables = scene_to_dict(scene)
    effects = tables.pop("effects")
    headed = [(f"[[{name}]]", part) for name in LISTED for part in tables.pop(name, ())]
    headed += [(f"[effects.{_key(name)}]", values) for name, values in effects.items()]
    lines = []
    for head, values in [("", tables), *headed]:
        lines += ["", head] * bool(head) + [f"{_key(name)} = {as_toml(value)}" for name, value in values.items()]
    return "\n".join(lines) + "\n"


@functools.cache
def describe(owner: type) -> dict[str, str]:
    """What each field of a scene, shape or effect means, from the lines of its docstring."""
    names = {f.name for f in msgspec.structs.fields(owner)}
    meanings: dict[str, str] = {}
    current: tuple[str, ...] = ()
    documented = [
        kind for kind in reversed(owner.__mro__) if issubclass(kind, msgspec.Struct) and "__doc__" in vars(kind)
    ]
    for line in [line for kind in documented for line in (inspect.getdoc(kind) or "").splitlines()[1:]]:
        match = re.match(r"(\w+(?:, \w+)*)\s{2,}(\S.*)", line)
        if match and set(match[1].split(", ")) <= names:
            current = tuple(match[1].split(", "))
            meanings |= dict.fromkeys(current, match[2].strip())
        elif current and re.match(r"\s{3,}\S", line):
            meanings |= {name: f"{meanings[name]} {line.strip()}" for name in current}
        else:
            current = ()
    return meanings


def unit_of(description: str) -> str | None:
    """The unit in square brackets, None where there is none."""
    match = re.search(r"\[([^\]\"]+)\]", description)
    return match[1] if match else None


def scene_schema(effects: Mapping[str, type[Effect]] = EFFECTS) -> dict[str, Any]:
    """JSON schema of scene files, with description and unit of every field (units also as "x-unit")."""
    effects = dict(sorted(effects.items()))
    owners = [Scene, Motion, Gauge, *SHAPES.values(), *SOLIDS.values(), *effects.values()]
    _, definitions = msgspec.json.schema_components(owners, ref_template="#/$defs/{name}")
    for owner in owners:
        definition = definitions[owner.__name__]
        definition["description"] = (inspect.getdoc(owner) or "").splitlines()[0]
        for name, text in describe(owner).items():
            entry = definition["properties"][name]
            entry["description"] = text
            if unit_of(text):
                entry["x-unit"] = unit_of(text)
    scene = definitions.pop("Scene")
    scene["properties"]["version"] = {"description": f"version of scene files, {VERSION}", "const": VERSION}
    scene["properties"]["effects"] = {
        "description": scene["properties"]["effects"]["description"],
        "type": "object",
        "properties": {name: {"$ref": f"#/$defs/{effect.__name__}"} for name, effect in effects.items()},
        "additionalProperties": False,
    }
    numbers = {"type": "array", "items": {"type": "number"}}
    rows = {"type": "array", "items": numbers}
    definitions["Cloud"]["properties"]["position"] |= rows
    definitions["Cloud"]["properties"]["velocity"] |= {"anyOf": [numbers, rows]}
    definitions["Cloud"]["properties"]["mass"] |= numbers
    definitions["SolidCells"]["properties"]["cells"] |= {
        "type": "array", "items": {"type": "array", "items": {"type": "integer"}}
    }  # fmt: skip
    for kind, shapes in (("fluid", SHAPES), ("solid", SOLIDS)):
        for shape in shapes.values():
            definitions[shape.__name__]["properties"]["shape"]["description"] = f"kind of this part of the {kind}"
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "refsim scene"}
    whole = head | {k: v for k, v in scene.items() if k != "title"} | {"$defs": definitions}
    return json.loads(json.dumps(whole))


# Reading


def _parts(kind: str, shapes: Any, tables: Any, source: str) -> Iterator[Any]:
    """Each of the tables [[kind]]: a part of the fluid, a solid, or what is of one class."""
    if not isinstance(tables, list):
        raise InputError(f"{source}: {kind} must be a list of tables; begin each with [[{kind}]].")
    for number, values in enumerate(tables, 1):
        place = f"[[{kind}]] number {number}"
        if not isinstance(values, dict):
            raise InputError(f"{source}: {place} must be a table, not {word_for(values)}; begin it with [[{kind}]].")
        if isinstance(shapes, type):
            yield struct_of(shapes, values, source, place)
            continue
        shape = values.get("shape")
        if shape is None:
            *some, last = (f'"{name}"' for name in shapes)
            raise InputError(f"{source}: {place} has no shape; add shape = {', '.join(some)} or {last}.")
        if not isinstance(shape, str) or shape not in shapes:
            raise InputError(f"{source}: {place} has the unknown shape {shape!r}; {suggestion(shape, shapes)}")
        yield struct_of(shapes[shape], {k: v for k, v in values.items() if k != "shape"}, source, place)


def _effects(tables: Any, source: str) -> Iterator[Effect]:
    if not isinstance(tables, dict):
        raise InputError(f"{source}: effects must be tables; write each as [effects.name].")
    for name, values in tables.items():
        if name not in EFFECTS:
            raise InputError(f"{source}: effect {name!r} is unknown; {suggestion(name, sorted(EFFECTS))}")
        if not isinstance(values, dict):
            given = word_for(values)
            raise InputError(f"{source}: effects.{name} must be a table, not {given}; write [effects.{name}].")
        yield struct_of(EFFECTS[name], values, source, f"[effects.{name}]")


def _beside(part: Any, folder: pathlib.Path | None) -> Any:
    """A part of a scene whose file, where it names one, lies in the folder."""
    if folder is None or not getattr(part, "file", None):
        return part
    return msgspec.structs.replace(part, file=str(folder / part.file))


def struct_of(
    owner: type, values: Mapping[str, Any], source: str, place: str = "", ready: tuple[str, ...] = ()
) -> Any:  # fmt: skip
    """An instance of `owner` from a table; values named in `ready` are taken as they are.

    Raises InputError, which begins with `source` and `place`, for a key that is unknown or missing and for a value of
    the wrong kind.
    """
    fields = {f.name: f for f in msgspec.structs.fields(owner)}
    at = f"{place}: " if place else ""
    for name in values:
        if name not in fields:
            where = f" in {place}" if place else ""
            raise InputError(f"{source}: unknown key {name!r}{where}; {suggestion(name, fields)}")
    missing = [name for name, f in fields.items() if f.required and name not in values]
    if missing:
        meaning = describe(owner).get(missing[0])
        description = f" ({meaning})" if meaning else ""
        raise InputError(f"{source}: {at}the key {missing[0]!r}{description} is missing; add it.")
    made = {}
    for name, value in values.items():
        try:
            made[name] = value if name in ready else msgspec.convert(value, fields[name].type)
        except (msgspec.ValidationError, OverflowError) as error:
            said = why(error, value, fields[name].type, removed=getattr(owner, "removed", None))
            raise InputError(f"{source}: {at}{name}{said}") from None
    return owner(**made)


# Writing


def _plain(struct: Any) -> dict[str, Any]:
    """A struct's fields as plain values; None, which TOML does not have, is left out."""
    values = msgspec.to_builtins(struct, enc_hook=as_plain, order="deterministic")
    return {name: value for name, value in values.items() if value is not None}


def as_toml(value: Any) -> str:
    """A plain value as TOML has it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_toml, value))}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {as_toml(v)}" for k, v in value.items()) + "}"
    raise TypeError(f"{value!r} cannot be written as TOML")


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else as_toml(name)
