"""The VTKHDF layout of a particle file: its frames, its fields, and what made it.

Frames stand one after another in Points and PointData/*; Steps/PointOffsets says where each begins. All frames share
the connectivity 0, 1, 2, ... of the largest one. They do not share the cell offsets, though these are the same numbers:
readers of VTK 9.3 take the place of the offsets from the number of steps, and later ones from the number of different
CellOffsets, so each frame has its own, and an empty one has space for one cell. Tables that are equal by construction
are one dataset under several names.

Beside the group `VTKHDF` the file has a group `refsim` with the scene that made it; the units and meanings of the
fields are attributes of their datasets (`Origin`). Readers of VTKHDF pass over both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import DTypeLike

from refsim.core.errors import InputError
from refsim.core.fields import POSITION_RESIDUAL
from refsim.core.reading import unpacks
from refsim.io.scenes import scene_to_checkpoint
from refsim.io.transactions import PAGE, Staged

if TYPE_CHECKING:
    import h5py

    from refsim.scene.plan import Plan


T = TypeVar("T")

DTYPES = {
    np.dtype("float32"): "Float32",
    np.dtype("float64"): "Float64",
    np.dtype("int32"): "Int32",
    np.dtype("int64"): "Int64",
    np.dtype("uint8"): "UInt8",
}
CHUNK_ROWS = 65536
HDF5 = {"libver": ("v110", "v110")}  # its chunk indices never move an old entry; HDF5 1.10 and later read it
PAGED = {"fs_strategy": "page", "fs_page_size": PAGE, "userblock_size": PAGE}  # what it changes does not straddle pages


@dataclass(frozen=True)
class Origin:
    """What made a particle file, as the file says it.

    scene     as TOML; "" where it is not known
    arrays    what the scene took from files, by name (`refsim.io.scenes.scene_to_checkpoint`)
    units     of the fields by name, that of "position" among them
    meanings  of the fields in words
    """

    scene: str = ""
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)


def origin_of(plan: Plan) -> Origin:
    """What particle files of a run of this plan say of it: its scene, and units and meanings of the particle fields."""
    scene, arrays = scene_to_checkpoint(plan)
    fields = {name: f for name, f in plan.particle_fields.items() if name != POSITION_RESIDUAL.name}
    units = {name: field.unit_in(plan.grid.dim) for name, field in fields.items()}
    return Origin(scene, arrays, units, {name: field.meaning for name, field in fields.items()})


def fields_of(root: h5py.Group) -> dict[str, tuple[int, np.dtype]]:
    return {name: (1 if data.ndim == 1 else data.shape[1], data.dtype) for name, data in root["PointData"].items()}


@dataclass(frozen=True)
class Index:
    """Where the frames of a particle file are: `times` (k,) [s], and of each the first row and the number of rows."""

    times: np.ndarray
    starts: np.ndarray
    counts: np.ndarray

    def rows(self, number: int) -> slice:
        """Rows of frame `number` in every dataset."""
        return slice(int(self.starts[number]), int(self.starts[number] + self.counts[number]))


def read_index(root: h5py.Group) -> Index:
    """The frames of the VTKHDF group `root`."""
    steps = root["Steps"]
    times = steps["Values"][: steps.attrs["NSteps"]]
    return Index(times, steps["PointOffsets"][: len(times)], root["NumberOfPoints"][: len(times)])


def read_origin(root: h5py.Group) -> Origin:
    """What the file of the VTKHDF group `root` says of the run that made it; empty where it says nothing."""
    if "refsim" not in root.file:
        return Origin()
    group = root.file["refsim"]
    data = {"position": root["Points"], **root["PointData"]}
    return Origin(
        group["scene"][()].decode(),
        {name: values[()] for name, values in group["start"].items()},
        *({name: d.attrs[word] for name, d in data.items() if word in d.attrs} for word in ("unit", "meaning")),
    )


def checked_field(name: str, components: int, dtype: DTypeLike) -> tuple[int, np.dtype]:
    dtype = np.dtype(dtype)
    if not name or "/" in name or name == "." or components < 1 or dtype not in DTYPES:
        raise ValueError(f"field {name!r} cannot be written as {components} components of {dtype}")
    return int(components), dtype


def field_list(fields: Mapping[str, tuple[int, np.dtype]]) -> str:
    return (
        ", ".join(f"{name} ({components} x {dtype})" for name, (components, dtype) in sorted(fields.items())) or "none"
    )


def create_layout(root: h5py.Group, arrays: Mapping[str, np.ndarray]) -> None:
    """The empty VTKHDF group for frames like `arrays`."""

    def table(group: h5py.Group, name: str, columns: tuple[int, ...] = ()) -> h5py.Dataset:
        return group.create_dataset(name, (0, *columns), "i8", maxshape=(None, *columns), chunks=(256, *columns))

    root.attrs["Version"] = np.array([2, 0])
    root.attrs.create("Type", b"PolyData", dtype="S8")
    rows = len(arrays["Points"]) or 1024
    rows = -(-rows // -(-rows // CHUNK_ROWS))  # a frame fills whole chunks
    for name, array in arrays.items():
        shape = array.shape[1:]
        root.create_dataset(name, (0, *shape), array.dtype, maxshape=(None, *shape), chunks=(rows, *shape))
    root.require_group("PointData")
    counts = table(root, "NumberOfPoints")

    vertices = root.create_group("Vertices")
    vertices["NumberOfCells"] = vertices["NumberOfConnectivityIds"] = counts
    for name in ("Connectivity", "Offsets"):
        vertices.create_dataset(name, (0,), "i4", maxshape=(None,), chunks=(rows + 1,))
    nothing = root.create_group("Lines")
    nothing["NumberOfConnectivityIds"] = nothing["Offsets"] = table(nothing, "NumberOfCells")
    nothing.create_dataset("Connectivity", (0,), "i8")
    root["Polygons"] = root["Strips"] = nothing

    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = 0
    steps.create_dataset("Values", (0,), "f8", maxshape=(None,), chunks=(256,))
    table(steps, "PartOffsets")
    table(steps, "NumberOfParts")
    offsets = table(steps, "PointOffsets")
    table(steps, "CellOffsets", (4,))
    table(steps, "ConnectivityIdOffsets", (4,))
    names = steps.create_group("PointDataOffsets")
    for name in root["PointData"]:
        names[name] = offsets


def append_frames(root: h5py.Group, times: Sequence[float], frames: Sequence[Mapping[str, np.ndarray]]) -> None:
    counts = np.array([len(arrays["Points"]) for arrays in frames])
    cells = np.maximum(counts, 1)  # a frame has one offset more than cells
    first = int(root["Steps"].attrs["NSteps"])
    start, offsets = _rows(root, "Points"), _rows(root, "Vertices/Offsets")
    steps, nothing = first + np.arange(len(times)), np.zeros_like(counts)
    for name in frames[0]:
        _extend(root, name, start, np.concatenate([arrays[name] for arrays in frames]))
    known, most = _rows(root, "Vertices/Connectivity"), int(counts.max())
    if most > known:
        _extend(root, "Vertices/Connectivity", known, np.arange(known, most))
    _extend(root, "Vertices/Offsets", offsets, np.concatenate([np.arange(n + 1) for n in cells]))
    before = offsets - first + np.cumsum(cells) - cells
    for name, rows in {
        "NumberOfPoints": counts,
        "Lines/NumberOfCells": nothing,
        "Steps/Values": np.array(times),
        "Steps/PartOffsets": steps,
        "Steps/NumberOfParts": nothing + 1,
        "Steps/PointOffsets": start + np.cumsum(counts) - counts,
        "Steps/CellOffsets": np.column_stack([before, nothing, nothing, nothing]),
        "Steps/ConnectivityIdOffsets": np.column_stack([nothing] * 4),
    }.items():
        _extend(root, name, first, rows)
    root["Steps"].attrs.modify("NSteps", first + len(times))


def write_origin(root: h5py.Group, origin: Origin) -> None:
    """Write what made the file, in place of what it said before."""
    import h5py

    file = root.file
    if "refsim" in file:
        del file["refsim"]
    group = file.create_group("refsim")
    text = origin.scene.encode()
    group.create_dataset("scene", data=text or b"\n", dtype=h5py.string_dtype("utf-8", len(text) or 1))
    start = group.create_group("start")
    for name, values in origin.arrays.items():
        start.create_dataset(name, data=values)
    for name, data in {"position": root["Points"], **root["PointData"]}.items():
        for word, words in (("unit", origin.units), ("meaning", origin.meanings)):
            if name in words:
                data.attrs[word] = words[name]


def same_words(first: Origin, second: Origin) -> bool:
    """Whether two origins say the same but for their arrays, which no resumed run changes."""
    return all(getattr(first, name) == getattr(second, name) for name in ("scene", "units", "meanings"))


def _rows(root: h5py.Group, name: str) -> int:
    return int(_opened(root, name).shape[0])


def _extend(root: h5py.Group, name: str, start: int, rows: np.ndarray) -> None:
    """Write rows from `start` on; not by `h5py.Dataset`, which takes six times as long for a short table."""
    import h5py

    data = _opened(root, name)
    rows = np.ascontiguousarray(rows, data.dtype)
    data.set_extent((start + len(rows), *rows.shape[1:]))
    place = data.get_space()
    place.select_hyperslab((start,) + (0,) * (rows.ndim - 1), rows.shape)
    data.write(h5py.h5s.create_simple(rows.shape), place, rows)


def _opened(root: h5py.Group, name: str) -> h5py.h5d.DatasetID:
    import h5py

    return h5py.h5d.open(root.id, name.encode())


def drop_frames(root: h5py.Group, kept: int) -> None:
    """Cut the file back to its first `kept` frames; the shared connectivity stays."""
    steps = root["Steps"]
    rows, cells = int(steps["PointOffsets"][kept]), int(steps["CellOffsets"][kept, 0])
    steps.attrs.modify("NSteps", kept)
    for data in (root["Points"], *root["PointData"].values()):
        data.resize(rows, axis=0)
    root["Vertices/Offsets"].resize(cells + kept, axis=0)
    for table in steps.values():
        if hasattr(table, "resize"):
            table.resize(kept, axis=0)
    root["NumberOfPoints"].resize(kept, axis=0)
    root["Lines/NumberOfCells"].resize(kept, axis=0)


def edit(staged: Staged, mode: str, change: Callable[[h5py.Group], object]) -> int:
    """Apply `change` to the VTKHDF group of a staged file; returns where the header with the number of steps
    lies."""
    import h5py

    with h5py.File(staged, mode, **HDF5, **(PAGED if mode == "w" else {})) as file:
        root = file.require_group("VTKHDF")
        change(root)
        return file.userblock_size + h5py.h5o.get_info(root["Steps"].id).addr


def read_hdf5(path: Path, read: Callable[[h5py.Group], T]) -> T:
    """What `read` returns for the VTKHDF group of a file whose digest was compared."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            size = path.stat().st_size
            packed = file.visititems(lambda name, item: name if unpacks(item, size) else None)
            if packed is not None:
                raise InputError(
                    f"particle file {path} is not of refsim: its {packed} is compressed or cut; run it again."
                )
            return read(file["VTKHDF"])
    except (OSError, KeyError, RuntimeError) as error:
        raise InputError(f"particle file {path} was changed while it was read; read it again") from error
