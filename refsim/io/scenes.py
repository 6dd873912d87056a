"""Scenes in checkpoints and particle files: as TOML, and copies of the files that the scene names."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim.core.effect import Effect
from refsim.core.errors import InputError
from refsim.io.checkpoint import Checkpoint
from refsim.scene.files import parse_scene, scene_to_dict, scene_to_toml
from refsim.scene.plan import Plan, make_plan
from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud
from refsim.scene.solids import Solid, SolidCells, SolidMesh


def scene_to_checkpoint(plan: Plan) -> tuple[str, dict[str, np.ndarray]]:
    """The scene as TOML, and copies of the files that it names: clouds, and the cells of meshes."""
    scene, solids = plan.scene, plan.grid.solids
    cells = np.rint(np.array(plan.grid.origin) / plan.grid.spacing).astype(np.int32)
    parts = list(zip((*scene.solid, *scene.fluid), plan.state.sizes))
    clouds = [isinstance(part, Cloud) for part, _ in parts]
    cloud = np.repeat(clouds, plan.state.sizes)
    arrays = {}
    if any(clouds):
        arrays = {f"start.{name}": getattr(plan.state, name)[cloud] for name in ("position", "velocity", "mass")}
        arrays["start.sizes"] = np.array([n for part, n in parts if isinstance(part, Cloud)])
    fluid = tuple(Cloud() if isinstance(part, Cloud) else part for part in scene.fluid)
    solid = []
    for number, part in enumerate(scene.solid):
        kept = isinstance(part, SolidMesh | SolidCells)
        if kept and solids is not None:
            rows = slice(*solids.lattice.first[number : number + 2])
            arrays[f"start.cells.{number}"] = solids.lattice.cell[rows] + cells
        solid.append(SolidCells(**_substance(part)) if kept else part)
    return scene_to_toml(msgspec.structs.replace(scene, fluid=fluid, solid=tuple(solid))), arrays


def _substance(part: Solid) -> dict[str, Any]:
    """What a body has beside its shape."""
    return {f.name: getattr(part, f.name) for f in msgspec.structs.fields(Solid)}


def _found(effect: Effect, folder: Path) -> Effect:
    """The effect, with the file that it names in this folder, unless it is found from the present one."""
    file = getattr(effect, "file", None)
    if not file or Path(file).exists() or not (folder / file).exists():
        return effect
    return msgspec.structs.replace(effect, file=str(folder / file))


def scene_from_checkpoint(saved: Checkpoint, source: str) -> Scene:
    """The scene of a checkpoint. Raises InputError where it cannot be read."""
    scene, arrays = parse_scene(str(saved.attributes["scene"]), f"the scene in {source}"), saved.arrays
    solid = tuple(
        msgspec.structs.replace(part, cells=arrays[f"start.cells.{number}"]) if isinstance(part, SolidCells) else part
        for number, part in enumerate(scene.solid)
    )
    beside = Path(source).parent.parent  # the folder in which a run's own folder lies
    parts = ("position", "velocity", "mass") if "start.sizes" in arrays else ()
    clouds = zip(*(np.split(arrays[f"start.{name}"], np.cumsum(arrays["start.sizes"])[:-1]) for name in parts))
    return msgspec.structs.replace(
        scene, solid=solid, effects=tuple(_found(e, beside) for e in scene.effects),
        fluid=tuple(
            Cloud(**dict(zip(parts, next(clouds)))) if isinstance(part, Cloud) else part for part in scene.fluid
        ),
    )  # fmt: skip


MAY_CHANGE = ("end_time", "name")


def check_same_scene(scene: Scene, stored: Plan, source: str) -> Plan:
    """The checkpoint's plan with the scene's end_time and name. Raises InputError where anything else differs."""
    new, old = (
        dict(_leaves(scene_to_dict(s) | {"fluid": "compared below", "solid": [*map(_substance, s.solid)]}, ""))
        for s in (scene, stored.scene)
    )
    for place in dict.fromkeys((*old, *new)):
        if place not in MAY_CHANGE and old.get(place) != new.get(place):
            raise InputError(
                f"checkpoint {source} has {place} = {old.get(place)} and the scene has {new.get(place)}; only"
                f" {' and '.join(MAY_CHANGE)} may change when a run is resumed."
            )
    start = make_plan(scene).state
    for name in ("position", "velocity", "mass"):
        if not np.array_equal(getattr(start, name), getattr(stored.state, name)):
            raise InputError(
                f"checkpoint {source} began with other particles than the scene (their {name} differs); resume it with"
                " its own scene."
            )
    kept = {name: getattr(scene, name) for name in MAY_CHANGE}
    return dataclasses.replace(stored, scene=msgspec.structs.replace(stored.scene, **kept))


def _leaves(tables: Any, place: str) -> Iterator[tuple[str, Any]]:
    for name, value in tables.items():
        where = f"{place}.{name}" if place else name
        if isinstance(value, dict):
            yield where, "present"
            yield from _leaves(value, where)
        else:
            yield where, value
