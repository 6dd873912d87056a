"""Checkpoints: named arrays and attributes in one HDF5 file that is complete or absent.

A checkpoint is written beside its final name and renamed into place, so a killed process or a full disk costs
at most the interval since the last one. Values are restored bit for bit; a digest detects a
damaged file.

Layout, version 4: the file begins with a block of 512 bytes that HDF5 passes over, lines of text padded with zero
bytes: `refsim checkpoint` (or another kind of file), `version`, `bytes` (of the whole file) and `sha256` (of the lines
before it and of all that follows the block). It is compared before HDF5 sees the file: HDF5 may read a damaged file
without end. Behind the block stand one dataset per array in the
group `arrays` and the attributes as JSON text in the dataset `attributes`. Other versions are not read.
"""

import dataclasses
import functools
import hashlib
import io
import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim.core.effect import Effect
from refsim.core.errors import InputError, RunStopped
from refsim.core.reading import open_regular
from refsim.core.writing import replace_file, writing
from refsim.scene.files import parse_scene, scene_to_dict, scene_to_toml
from refsim.scene.plan import Plan, make_plan
from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud
from refsim.scene.solids import Solid, SolidCells, SolidMesh

VERSION = 4
CHECKPOINT = "checkpoint.h5"  # in the folder of a run
KEPT = "the last good checkpoint is untouched"
BLOCK = 512  # bytes before what HDF5 reads; HDF5 looks for its signature there

Attribute = str | int | float | bool


@dataclass(frozen=True)
class Checkpoint:
    """What `read_checkpoint` returns: the arrays by name (any shape, dtype as written) and the attributes."""

    arrays: dict[str, np.ndarray]
    attributes: dict[str, Attribute]


def write_checkpoint(
    path: str | os.PathLike[str],
    arrays: Mapping[str, np.ndarray],
    attributes: Mapping[str, Attribute],
    keep: int = 2,
    what: str = "checkpoint",
) -> None:
    """Write a checkpoint to `path`; at every instant a whole one, old or new, lies there or beside it.

    arrays      any shape, boolean, integer, floating or complex; written bit for bit, units are the caller's
    attributes  text and plain numbers; numbers come back exactly, with their type
    keep        whole checkpoints to hold: 1, `path` itself, or 2, `<stem>.previous<suffix>`, too
    what        the kind of file that is written in this way

    Raises RunStopped, and leaves the checkpoints that are there as they are:
      "non_finite"    an array holds a NaN or an infinity: nothing is written
      "disk_full"     no space or quota left; the run itself is unharmed, so the caller may go on and try
                      again later
      "write_failed"  the disk refused for another reason
    Raises InputError when the folder cannot be written to. One writer per `path`: a write removes the temporary files
    of killed writers.
    """
    path = Path(path)
    content = checkpoint_bytes(path, arrays, attributes, what)
    with writing(what, path, KEPT):
        replace_file(path, content, put=functools.partial(_put_in_place, keep=keep))


def checkpoint_bytes(
    path: Path, arrays: Mapping[str, np.ndarray], attributes: Mapping[str, Attribute], what: str
) -> bytes:
    """What `write_checkpoint` writes. Raises RunStopped("non_finite"), whose sentence names the path."""
    import h5py

    file, text = io.BytesIO(), json.dumps(dict(attributes))
    # HDF5 passes over the block; in this format it checksums its own structures.
    with h5py.File(file, "w", libver=("v110", "v110"), userblock_size=BLOCK) as root:
        group = root.create_group("arrays")
        for name, array in arrays.items():
            group.create_dataset(name, data=_finite(path, name, array))
        root.create_dataset("attributes", data=text, dtype=h5py.string_dtype("utf-8", len(text)))
    # From 3.12 on Python must not collect a BytesIO that still has a view.
    with file.getbuffer() as content, content[BLOCK:] as body:
        lines = f"refsim {what}\nversion {VERSION}\nbytes {len(content)}\n".encode()
        digest = hashlib.sha256(lines)
        digest.update(body)
        content[:BLOCK] = (lines + f"sha256 {digest.hexdigest()}\n".encode()).ljust(BLOCK, b"\0")
    return file.getvalue()


def whole_checkpoint(path: str | os.PathLike[str]) -> tuple[Path, Checkpoint, tuple[str, ...]]:
    """(its path, what it holds, one sentence for each that was passed over) of the checkpoint to go on from.

    path  a checkpoint, or the folder of a run, whose one is `CHECKPOINT`; the one before it is taken where that is
          missing, cut short or altered

    Raises InputError where there is no whole one.
    """
    path = Path(path, CHECKPOINT) if os.path.isdir(path) else Path(path)
    passed: list[Unreadable] = []
    for file in (path, previous_path(path)):
        try:
            saved = read_checkpoint(file)
        except Unreadable as error:
            passed.append(error)
        else:
            return file, saved, tuple(f"{error.sentence}: resumed from {file}" for error in passed)
    raise passed[0]


def previous_path(path: str | os.PathLike[str]) -> Path:
    """Where the checkpoint that stood at `path` goes when a newer one comes: `run.h5` -> `run.previous.h5`."""
    return Path(path).with_stem(f"{Path(path).stem}.previous")


# -- what is written ---------------------------------------------------------------------------------------


def _finite(path: Path, name: str, array: np.ndarray) -> np.ndarray:
    """The array. Raises RunStopped where it holds a NaN or an infinity."""
    array = np.asarray(array)
    if array.dtype.kind in "fc" and not (finite := np.isfinite(array)).all():
        bad = np.argwhere(~finite)
        raise RunStopped(
            "non_finite",
            f"{path} was not written because array {name!r} holds {len(bad)} non-finite values, the first at index"
            f" {tuple(bad[0].tolist())}; {KEPT}",
        )
    return array


HEAD = re.compile(
    rb"(refsim ([a-z ]+)\nversion (\d{1,9})\nbytes (\d{1,19})\n)sha256 ([0-9a-f]{64})\n\0*"
)  # the lines that the digest covers, too; kind, version, size; the digest


def _put_in_place(temporary: Path, path: Path, keep: int) -> None:
    """Rename `temporary` to `path`, and with keep = 2 the checkpoint that stood there to that of the previous one.

    The old file gets a second name first and takes its new place last: a kill between any two calls leaves a
    whole checkpoint at `path`. Where the file system has no hard links, the old one is moved to its new place
    first.
    """
    old = temporary.with_suffix(".old.tmp")
    if keep > 1 and path.exists():
        try:
            os.link(path, old)
        except OSError:
            os.replace(path, previous_path(path))
    try:
        os.replace(temporary, path)
        if old.exists():
            os.replace(old, previous_path(path))
    finally:
        with suppress(OSError):
            old.unlink(missing_ok=True)


# -- what is read ------------------------------------------------------------------------------------------


class Unreadable(InputError):
    """Raised with the kind of a file, its path and why it is not a whole one."""

    @property
    def sentence(self) -> str:
        """What is wrong, without what to do."""
        return " ".join(map(str, self.args))

    def __str__(self) -> str:
        return f"{self.sentence}; start the run again, or give a whole {self.args[0]}."


def read_checkpoint(path: str | os.PathLike[str], what: str = "checkpoint") -> Checkpoint:
    """Read a checkpoint, or another kind of file that was written as one, after its digest was compared.

    Raises Unreadable when it is missing, is of another kind or version, is cut short or has been altered.
    """
    import h5py

    with _opened(path, what) as (file, head):
        size = os.fstat(file.fileno()).st_size
        if size != int(head[4]):
            raise Unreadable(what, path, f"is cut short or damaged (it has {size} of {int(head[4])} bytes)")
        if hashlib.file_digest(file, lambda: hashlib.sha256(head[1])).hexdigest() != head[5].decode():
            raise Unreadable(what, path, "is damaged (it does not match its digest)")
        with h5py.File(file, "r") as root:
            arrays = {name: np.asarray(dataset[()]) for name, dataset in root["arrays"].items()}
            return Checkpoint(arrays, json.loads(root["attributes"].asstr()[()]))


@contextmanager
def _opened(path: str | os.PathLike[str], what: str) -> Iterator[tuple[BufferedReader, re.Match[bytes]]]:
    """A file that stands behind its first block, and that block as `HEAD` divides it."""
    try:
        with open_regular(path) as file:
            block = file.read(BLOCK)
            head = HEAD.match(block)
            if not block.startswith(f"refsim {what}\n".encode()):
                raise Unreadable(what, path, f"is not a {what} (it does not begin as one)")
            if head is not None and int(head[3]) != VERSION:
                has = f"has format version {int(head[3])}"
                raise Unreadable(what, path, f"{has}, and this refsim reads version {VERSION}")
            if head is None or head.end() != BLOCK:
                raise Unreadable(what, path, f"is cut short or damaged (its first lines are not those of a {what})")
            yield file, head
    except FileNotFoundError:
        raise Unreadable(what, path, "does not exist") from None
    except OSError as error:
        raise Unreadable(what, path, f"cannot be read ({error.strerror})") from error


# Scenes in checkpoints and particle files


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
