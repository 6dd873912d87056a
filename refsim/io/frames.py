"""Particle output that ParaView opens: VTKHDF for a whole run, VTP for one frame.

A VTKHDF file is one HDF5 file that grows by one or more frames at a time. HDF5 alone can lose the whole file when its
writer dies in the middle of an append, so each append is a transaction: HDF5 works on the file as if it were
written to, while its writes are held in memory; then what lies behind the old end goes to the disk, where no
reader looks yet, and then the few pages that change inside the old file, first into a journal beside it and
then into place, the page with the number of steps last. On the disk there is at every other instant a closed
HDF5 file. A journal that a dead writer left behind is completed by the next `ParticleWriter(append=True)` or
`read_particles`.

HDF5 can crash on a damaged file, so a digest is compared before HDF5 opens it. The file begins with a page of 4096
bytes that HDF5 and its readers pass over (a user block): lines of text padded with zero bytes, `refsim particles`,
`version`, `bytes` (of the file; what lies behind them was left by a stopped append) and `digest`. The digest is the sum
modulo 2^256 of BLAKE2b (32 bytes, little-endian, salted with the page's number) over all other pages of 4096 bytes, so
that an append hashes only what it changes. The head changes in the same transaction as the other pages.

Beside the group `VTKHDF` the file has a group `refsim` with the scene that made it; the units and meanings of the
fields are attributes of their datasets (`Origin`). Readers of VTKHDF pass over both.
"""

from __future__ import annotations

import errno
import hashlib
import math
import os
import re
import struct
import sys
import time as clock
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BufferedReader, FileIO
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import DTypeLike

from refsim.core.errors import InputError
from refsim.core.fields import POSITION_RESIDUAL
from refsim.core.reading import open_regular
from refsim.io.checkpoint import cannot_write, replace_file, write_all
from refsim.io.scenes import scene_to_checkpoint

if TYPE_CHECKING:
    import h5py
    from filelock import FileLock

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
PAGE = 4096  # a page is written whole even by a process that is being killed
PAGED = {"fs_strategy": "page", "fs_page_size": PAGE, "userblock_size": PAGE}  # what it changes does not straddle pages
KEPT = "the frames before it are untouched"


@dataclass(frozen=True)
class Frame:
    """One frame of n particles: `time` in s, `position` (n, 3) in m, `fields` by name."""

    time: float
    position: np.ndarray
    fields: dict[str, np.ndarray]


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


class ParticleWriter:
    """Writes a temporal VTKHDF file (PolyData, one vertex per particle), one or more frames at a time.

    path         the file, usually `*.vtkhdf`; it is created or replaced by the first frame, not before
    fields       name -> (components, dtype): one component is an (n,) array, more an (n, components) array;
                 dtype is float32, float64, int32, int64 or uint8
    append       go on with the file at `path` if there is one, which must have the same fields
    resume_time  with `append`: frames later than this time (s) are dropped
    origin       what made the file; with `append` it replaces what the file says

    The number of particles may change between frames. After `append` or `write` returns the frames are on the disk.
    While the writer is open, `<path>.journal` and `<path>.journal.lock` lie beside the file.

    Raises InputError when the folder is not writable, another process writes the same file, or, with
    `append`, the file is damaged, has no digest or has other fields; ValueError when `fields` is not of the form
    above.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        fields: Mapping[str, tuple[int, DTypeLike]],
        *,
        append: bool = False,
        resume_time: float | None = None,
        origin: Origin | None = None,
    ) -> None:
        self.path = Path(path)
        self._origin, self._stated_origin = origin, Origin()  # to be written, and in the file
        self._fields = {name: _checked_field(name, *field) for name, field in fields.items()}
        self._times: list[float] = []
        self._precision: np.dtype | None = None  # of the positions in the file
        self._file: FileIO | None = None
        try:
            self._journal, self._lock = _locked_journal(_journal_path(self.path))
        except BlockingIOError:
            raise InputError(
                f"particle file {self.path} is being written by another process; wait for it, or give another path"
            ) from None
        except OSError as error:
            raise cannot_write("particle file", self.path, error, KEPT) from error
        try:
            if append and self.path.exists():
                self._go_on(resume_time)
            else:
                self._journal.truncate(0)
        except BaseException:
            self.close()
            raise

    @property
    def last_time(self) -> float | None:
        """Time (s) of the last frame in the file, None before the first."""
        return self._times[-1] if self._times else None

    def write(self, time: float, position: np.ndarray, /, **fields: np.ndarray) -> None:
        """Append one frame: `time` in s, later than the last; `position` (n, 3) in m; every declared field,
        (n,) or (n, components), of the declared dtype. The dtype of the first frame's positions holds for the
        whole file.

        Raises as `append` does.
        """
        self.append([Frame(time, position, fields)])

    def append(self, frames: Sequence[Frame]) -> None:
        """Append frames as `write` does, in one transaction: the file has all of them then, or none.

        Raises ValueError when a frame does not fit the file, RunStopped ("disk_full", "write_failed") when the disk
        refuses: the frames before are then untouched, and the same frames or later ones can be tried again.
        """
        if self._journal.closed:
            raise ValueError(f"the writer of {self.path} is closed")
        if self._file is not None and os.fstat(self._journal.fileno()).st_size:
            self._settle()  # the disk refused the last frames when they were half in place
            frames = [frame for frame in frames if frame.time not in self._times]  # without those
        last, precision, added = self.last_time, self._precision, []
        for frame in frames:
            if not math.isfinite(frame.time) or (last is not None and frame.time <= last):
                raise ValueError(f"time {frame.time} is not later than that of the last frame, {last}")
            arrays = self._checked_arrays(frame.position, frame.fields)
            if precision not in (None, arrays["Points"].dtype):
                raise ValueError(f"position must be {precision} as in the first frame")
            last, precision = frame.time, arrays["Points"].dtype
            added.append(arrays)
        if not added:
            return
        times = [float(frame.time) for frame in frames]
        try:
            if self._file is None:
                staged = _Staged(None)
                _edit(staged, "w", lambda root: self._begin(root, times, added))
                staged.seal()
                replace_file(self.path, staged.tail)
                self._file = open(self.path, "r+b", buffering=0)  # noqa: SIM115
            else:
                self._transaction(lambda root: _append_frames(root, times, added))
        except OSError as error:
            raise cannot_write(f"frame at time {times[0]} of", self.path, error, KEPT) from error
        self._precision = precision
        self._times += times

    def _begin(self, root: h5py.Group, times: Sequence[float], frames: Sequence[Mapping[str, np.ndarray]]) -> None:
        _create(root, frames[0])
        if self._origin is not None:
            _write_origin(root, self._origin)
        _append_frames(root, times, frames)

    def close(self) -> None:
        """Close the file; nothing is left to be written. A second call does nothing."""
        if not self._journal.closed:
            finished = os.fstat(self._journal.fileno()).st_size == 0
            if finished:
                with suppress(OSError):
                    _journal_path(self.path).unlink()
            self._close_files()

    def __enter__(self) -> ParticleWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _close_files(self) -> None:
        self._journal.close()
        _unlock(self._lock)
        if self._file is not None:
            self._file.close()

    def _go_on(self, resume_time: float | None) -> None:
        """Open the file that is there, complete what a dead writer left half done, and drop late frames."""
        found = self._settle()
        if found != self._fields:
            raise InputError(
                f"particle file {self.path} holds the fields {_field_list(found)}, but this run writes "
                f"{_field_list(self._fields)}; give another path"
            )
        kept = len(self._times) if resume_time is None else sum(time <= resume_time for time in self._times)
        origin = None if self._origin is None or _same_words(self._origin, self._stated_origin) else self._origin
        if kept == len(self._times) and origin is None:
            return

        def change(root: h5py.Group) -> None:
            if kept < len(self._times):
                _drop_frames(root, kept)
            if origin is not None:
                _write_origin(root, origin)

        try:
            self._transaction(change)
        except OSError as error:
            raise cannot_write("shortened particle file", self.path, error, KEPT) from error
        del self._times[kept:]

    def _settle(self) -> dict[str, tuple[int, np.dtype]]:
        """Complete what was left half done, and read what the file then holds; returns its fields."""
        try:
            if self._file is None:
                self._file = open(self.path, "r+b", buffering=0)  # noqa: SIM115
            _recover(self._file, self._journal)
        except OSError as error:
            raise cannot_write("particle file", self.path, error, KEPT) from error
        found: dict[str, tuple[int, np.dtype]] = {}

        def look(root: h5py.Group) -> None:
            self._precision = root["Points"].dtype
            self._times = root["Steps/Values"][: root["Steps"].attrs["NSteps"]].tolist()
            found.update(_fields_of(root))
            self._stated_origin = read_origin(root)

        _read_hdf5(self.path, look)
        return found

    def _transaction(self, change: Callable[[h5py.Group], object]) -> None:
        """Let `change` edit the VTKHDF group, then put all of its writes into the file or none (OSError)."""
        assert self._file is not None
        staged = _Staged(self._file)
        last = _edit(staged, "r+", change)
        staged.seal()
        staged.commit(self._journal, last)

    def _checked_arrays(self, position: np.ndarray, fields: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        position = np.asarray(position)
        if position.ndim != 2 or position.shape[1] != 3 or position.dtype not in (np.float32, np.float64):
            raise ValueError(f"position must be (n, 3), float32 or float64, not {position.shape} {position.dtype}")
        if fields.keys() != self._fields.keys():
            raise ValueError(f"the frame has the fields {sorted(fields)}, the file {sorted(self._fields)}")
        arrays = {"Points": position}
        for name, (components, dtype) in self._fields.items():
            array = np.asarray(fields[name])
            shape = (len(position),) if components == 1 else (len(position), components)
            if array.shape != shape or array.dtype != dtype:
                raise ValueError(f"field {name!r} must be {shape} {dtype}, not {array.shape} {array.dtype}")
            arrays[f"PointData/{name}"] = array
        return arrays


def read_particles(
    path: str | os.PathLike[str], frames: slice | Collection[int] = slice(None), fields: Collection[str] | None = None
) -> list[Frame]:
    """The frames of a file written by `ParticleWriter`, in order of time.

    frames  which of them: a slice, or numbers from 0
    fields  names of the fields that are read, of those that the file has; all by default

    Completes what a writer that was killed left half done, where the folder is writable.
    Raises InputError when the file is missing, damaged (it does not match its digest), or no particle file.
    """

    def read(root: h5py.Group) -> list[Frame]:
        index = read_index(root)
        found = []
        for k in range(len(index.times))[frames] if isinstance(frames, slice) else sorted(frames):
            rows = index.rows(k)
            data = {n: values[rows] for n, values in root["PointData"].items() if fields is None or n in fields}
            found.append(Frame(float(index.times[k]), root["Points"][rows], data))
        return found

    return read_file(Path(path), read)


def particle_table(path: str | os.PathLike[str]) -> tuple[list[float], dict[str, tuple[int, np.dtype]]]:
    """Times [s] of the frames in a file written by `ParticleWriter`, and its fields: name -> (components, dtype).

    Raises InputError as `read_particles` does.
    """
    return read_file(Path(path), lambda root: (read_index(root).times.tolist(), _fields_of(root)))


def _fields_of(root: h5py.Group) -> dict[str, tuple[int, np.dtype]]:
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


def read_file(path: Path, read: Callable[[h5py.Group], T], check: bool = True) -> T:
    """What `read` returns for the VTKHDF group of a particle file, whose digest is compared before.

    check  False leaves the comparison out, for a file that was compared before: HDF5 can crash on a damaged one

    Completes what a writer that was killed left half done. Reads again while a living writer is between two pages.
    Raises InputError when the file is missing, damaged, or no particle file.
    """
    for _ in range(2):
        try:
            return _checked_and_read(path, read, check)
        except InputError:
            if not _journal_path(path).exists():
                raise
            clock.sleep(0.01)
    return _checked_and_read(path, read, check)


def _checked_and_read(path: Path, read: Callable[[h5py.Group], T], check: bool) -> T:
    if check:
        _check_path(path)
    return _read_hdf5(path, read)


def write_vtp(path: str | os.PathLike[str], position: np.ndarray, /, **fields: np.ndarray) -> None:
    """Write one frame as a VTP file (XML PolyData with raw data, one vertex per particle); whole or not at
    all.

    position  (n, 3), float32 or float64, in m
    fields    (n,) or (n, components) arrays, float32, float64, int32, int64, uint8 or bool (written as uint8)

    Raises ValueError for other shapes or dtypes, InputError when the folder is not writable, RunStopped
    ("disk_full", "write_failed") when the disk refuses; a file that was there is then untouched.
    """
    from xml.sax.saxutils import quoteattr  # here, because it brings the network library along

    position = np.asarray(position)
    if position.ndim != 2 or position.shape[1] != 3 or position.dtype not in (np.float32, np.float64):
        raise ValueError(f"position must be (n, 3), float32 or float64, not {position.shape} {position.dtype}")
    count = len(position)
    blocks: list[bytes] = []

    def data_array(name: str, array: np.ndarray) -> str:
        if array.dtype == np.bool_:
            array = array.view(np.uint8)
        if array.shape[:1] != (count,) or array.ndim > 2 or array.dtype not in DTYPES:
            raise ValueError(
                f"array {name!r} must be ({count},) or ({count}, components), not {array.shape} {array.dtype}"
            )
        components = array.shape[1] if array.ndim == 2 else 1
        offset = sum(map(len, blocks))
        blocks.append(struct.pack("=Q", array.nbytes) + array.tobytes())
        return (
            f'<DataArray type="{DTYPES[array.dtype]}" Name={quoteattr(name)} '
            f'NumberOfComponents="{components}" format="appended" offset="{offset}"/>'
        )

    byte_order = f"{sys.byteorder.capitalize()}Endian"
    lines = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="PolyData" version="1.0" header_type="UInt64" byte_order="{byte_order}">',
        f'<PolyData><Piece NumberOfPoints="{count}" NumberOfVerts="{count}">',
        "<Points>",
        data_array("Points", position),
        "</Points>",
        "<Verts>",
        data_array("connectivity", np.arange(count, dtype=np.int64)),
        data_array("offsets", np.arange(1, count + 1, dtype=np.int64)),
        "</Verts>",
        "<PointData>",
        *(data_array(name, np.asarray(array)) for name, array in fields.items()),
        "</PointData>",
        "</Piece></PolyData>",
        '<AppendedData encoding="raw">_',
    ]
    content = b"".join(["\n".join(lines).encode(), *blocks, b"\n</AppendedData></VTKFile>\n"])
    try:
        replace_file(Path(path), content)
    except OSError as error:
        raise cannot_write("particle file", Path(path), error, "the file that was there is untouched") from error


# -- the VTKHDF layout -------------------------------------------------------------------------------------
#
# Frames stand one after another in Points and PointData/*; Steps/PointOffsets says where each begins. All
# frames share the connectivity 0, 1, 2, ... of the largest one. They do not share the cell offsets, though
# these are the same numbers: readers of VTK 9.3 take the place of the offsets from the number of steps, and
# later ones from the number of different CellOffsets, so each frame has its own, and an empty one has space for
# one cell. Tables that are equal by construction are one dataset under several names.


def _checked_field(name: str, components: int, dtype: DTypeLike) -> tuple[int, np.dtype]:
    dtype = np.dtype(dtype)
    if not name or "/" in name or name == "." or components < 1 or dtype not in DTYPES:
        raise ValueError(f"field {name!r} cannot be written as {components} components of {dtype}")
    return int(components), dtype


def _field_list(fields: Mapping[str, tuple[int, np.dtype]]) -> str:
    return (
        ", ".join(f"{name} ({components} x {dtype})" for name, (components, dtype) in sorted(fields.items())) or "none"
    )


def _create(root: h5py.Group, arrays: Mapping[str, np.ndarray]) -> None:
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


def _append_frames(root: h5py.Group, times: Sequence[float], frames: Sequence[Mapping[str, np.ndarray]]) -> None:
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


def _write_origin(root: h5py.Group, origin: Origin) -> None:
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


def _same_words(first: Origin, second: Origin) -> bool:
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


def _drop_frames(root: h5py.Group, kept: int) -> None:
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


def _edit(staged: _Staged, mode: str, change: Callable[[h5py.Group], object]) -> int:
    """Apply `change` to the VTKHDF group of a staged file; returns where the header with the number of steps
    lies."""
    import h5py

    with h5py.File(staged, mode, **HDF5, **(PAGED if mode == "w" else {})) as file:
        root = file.require_group("VTKHDF")
        change(root)
        return file.userblock_size + h5py.h5o.get_info(root["Steps"].id).addr


def _read_hdf5(path: Path, read: Callable[[h5py.Group], T]) -> T:
    """What `read` returns for the VTKHDF group of a file whose digest was compared."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return read(file["VTKHDF"])
    except (OSError, KeyError, RuntimeError) as error:
        raise InputError(f"particle file {path} was changed while it was read; read it again") from error


# -- the digest --------------------------------------------------------------------------------------------

HEAD = re.compile(rb"refsim particles\nversion 1\nbytes (\d{1,19})\ndigest ([0-9a-f]{64})\n\0*")
ADVICE = "give another path, or move the file away (a resumed run then begins a new one)"


def _head(size: int, digest: int) -> bytes:
    """The first page of a file of `size` bytes."""
    return f"refsim particles\nversion 1\nbytes {size}\ndigest {digest:064x}\n".encode().ljust(PAGE, b"\0")


def _page_digest(number: int, page: bytes | memoryview) -> int:
    """What a page adds to the digest; the head and pages that are not there add nothing."""
    if number == 0 or not page:
        return 0
    return int.from_bytes(hashlib.blake2b(page, digest_size=32, salt=number.to_bytes(16, "little")).digest(), "little")


def _stated(file: FileIO | BufferedReader, head: bytes = b"") -> tuple[int, int]:
    """(bytes, digest) in `head`, or else in the first page of the file. Raises InputError."""
    if not head:
        file.seek(0)
        head = file.read(PAGE)
    found = HEAD.fullmatch(head)
    size = int(found[1]) if found else 0
    if found and len(head) == PAGE and size <= os.fstat(file.fileno()).st_size:
        return size, int(found[2], 16)
    if found:
        why = "is cut short"
    elif head.startswith(b"\x89HDF\r\n\x1a\n"):
        why = "is an HDF5 file without the digest that particle files begin with (refsim 0.1.0 wrote such files)"
    else:
        why = "is damaged, or not a particle file of refsim (it does not begin as one)"
    raise InputError(f"particle file {file.name} {why}; {ADVICE}")


def _check(file: FileIO | BufferedReader, pages: Mapping[int, bytes]) -> None:
    """Compare the digest of the file, as it will be with `pages` (by offset) in place. Raises InputError."""
    size, digest = _stated(file, pages.get(0, b""))
    total = 0
    file.seek(PAGE)
    for offset in range(PAGE, size, PAGE):
        page, new = file.read(PAGE), pages.get(offset, b"")
        total += _page_digest(offset // PAGE, (new + page[len(new) :])[: size - offset])
    if total % 2**256 != digest:
        raise InputError(f"particle file {file.name} is damaged (it does not match its digest); {ADVICE}")


def _check_path(path: Path) -> None:
    """Complete the last transaction on `path` unless its writer lives, and compare the digest. Raises InputError."""
    pages: dict[int, bytes] = {}
    try:
        with suppress(OSError), open(_journal_path(path), "r+b", buffering=0) as journal:
            pages = _journalled(journal)[1]  # which a living writer is putting in place
            lock = _lock(_journal_path(path))
            try:
                with open(path, "r+b", buffering=0) as file:
                    return _recover(file, journal)
            finally:
                _unlock(lock)
        with open_regular(path) as file:
            return _check(file, pages)
    except FileNotFoundError:
        raise InputError(f"particle file {path} does not exist; give a file that refsim wrote") from None
    except OSError as error:
        raise InputError(f"particle file {path} cannot be read ({error.strerror}); {ADVICE}") from error


# -- transactions ------------------------------------------------------------------------------------------

JOURNAL_MAGIC = b"refsimJ1"


class _Staged:
    """A file for h5py to work on: reads see the file below, writes stay in memory until `commit`."""

    def __init__(self, file: FileIO | None) -> None:
        self.tail = bytearray()  # what lies behind the end of the file below
        self._file = file
        self._base, self._digest = _stated(file) if file else (0, 0)
        self._size = self._base
        self._pages: dict[int, bytearray] = {}  # changed pages of the file below, by number
        self._position = 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._position = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence] + offset
        return self._position

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        pass

    def truncate(self, size: int) -> int:
        self._size = size
        behind = max(size - self._base, 0)
        del self.tail[behind:]
        self.tail.extend(bytes(behind - len(self.tail)))
        return size

    def read(self, size: int) -> bytes:
        """Not used: h5py takes an object with `read` for a file, and reads with `readinto`."""
        data = bytearray(size)
        self.readinto(memoryview(data))
        return bytes(data)

    def readinto(self, buffer: memoryview) -> int:
        view = memoryview(buffer).cast("B")
        start, end = self._position, self._position + len(view)
        view[:] = bytes(len(view))
        if start < self._base:
            assert self._file is not None
            below = min(end, self._base)
            self._file.seek(start)
            done = 0
            while done < below - start and (got := self._file.readinto(view[done : below - start])):
                done += got
            for number in range(start // PAGE, -(-below // PAGE)):
                page = self._pages.get(number)
                if page is not None:
                    first, last = max(start, number * PAGE), min(below, (number + 1) * PAGE)
                    view[first - start : last - start] = page[first - number * PAGE : last - number * PAGE]
        if end > self._base:
            first = max(start, self._base)
            piece = self.tail[first - self._base : end - self._base]
            view[first - start : first - start + len(piece)] = piece
        self._position = end
        return len(view)

    def write(self, data: memoryview) -> int:
        view = memoryview(data).cast("B")
        start, end = self._position, self._position + len(view)
        self._size = max(self._size, end)
        below = min(end, self._base)
        for number in range(start // PAGE, -(-below // PAGE) if start < below else 0):
            page = self._pages.get(number)
            if page is None:
                page = self._pages[number] = bytearray(self._page_below(number))
            first, last = max(start, number * PAGE), min(below, (number + 1) * PAGE)
            page[first - number * PAGE : last - number * PAGE] = view[first - start : last - start]
        if end > self._base:
            first = max(start, self._base)
            gap = first - self._base - len(self.tail)
            if gap > 0:
                self.tail.extend(bytes(gap))
            self.tail[first - self._base : end - self._base] = view[first - start :]
        self._position = end
        return len(view)

    def _page_below(self, number: int) -> bytes:
        assert self._file is not None
        self._file.seek(number * PAGE)
        return self._file.read(max(min(PAGE, self._base - number * PAGE), 0))

    def seal(self) -> None:
        """Write the head, with the digest of what the file now holds."""
        whole = -(-self._base // PAGE)  # pages from there on are in the tail alone
        digest = self._digest
        for number in {*self._pages, *range(min(self._base, self._size) // PAGE, whole)}:
            self.seek(number * PAGE)
            now = self.read(max(min(PAGE, self._size - number * PAGE), 0))
            digest += _page_digest(number, now) - _page_digest(number, self._page_below(number) if self._file else b"")
        with memoryview(self.tail) as tail:
            for number in range(whole, -(-self._size // PAGE)):
                start = number * PAGE - self._base
                digest += _page_digest(number, tail[start : start + PAGE])
        self.seek(0)
        self.write(memoryview(_head(self._size, digest % 2**256)))

    def commit(self, journal: FileIO, last: int) -> None:
        """Put the writes into the file, the page that holds the byte `last` after all others.

        On an OSError the file is as before, or, when the disk refuses even to change what it already holds,
        the journal has what is missing.
        """
        assert self._file is not None
        numbers = sorted(self._pages, key=lambda number: (number in (last // PAGE, last // PAGE + 1), number))
        pages = [
            (number * PAGE, bytes(self._pages[number]))
            for number in numbers
            if self._pages[number] != self._page_below(number)
        ]
        try:
            if self.tail:
                self._file.seek(self._base)
                write_all(self._file, self.tail)
                os.fsync(self._file.fileno())
            write_all(journal, _journal_entry(self._size, pages))
            os.fsync(journal.fileno())
        except OSError:
            with suppress(OSError):
                journal.truncate(0)
            with suppress(OSError):
                self._file.truncate(self._base)
            raise
        _apply(self._file, self._size, pages)
        journal.truncate(0)


def _apply(file: FileIO, size: int, pages: list[tuple[int, bytes]]) -> None:
    for offset, page in pages:
        file.seek(offset)
        write_all(file, page)
    if size < os.fstat(file.fileno()).st_size:
        file.truncate(size)
    os.fsync(file.fileno())


def _journal_path(path: Path) -> Path:
    return path.with_name(f"{path.name}.journal")


def _locked_journal(path: Path) -> tuple[FileIO, FileLock]:
    """The journal at `path` and its lock. Raises OSError, BlockingIOError where another writer holds it."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "its journal is a pipe or a device, and not a file", str(path))
    os.stat(f"{path.parent}{os.sep}")  # the lock would make the folder
    lock = _lock(path)
    try:
        return open(path, "a+b", buffering=0), lock
    except BaseException:
        _unlock(lock)
        raise


def _lock(journal: Path) -> FileLock:
    """The lock that a living writer holds for its journal, taken: a file beside it, of which the system keeps account.

    Raises BlockingIOError where another process holds it, OSError where it cannot be written.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(f"{journal}.lock", blocking=False, thread_local=False)
    try:
        lock.acquire()
    except Timeout:
        raise BlockingIOError(errno.EAGAIN, "locked", str(journal)) from None
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOTSUP):  # a file system without locks
            raise
    return lock


def _unlock(lock: FileLock) -> None:
    """Release the lock, and remove its file."""
    with suppress(OSError):  # where a file in use cannot be removed, the next writer finds and takes it
        os.unlink(lock.lock_file)
    lock.release()


def _journal_entry(size: int, pages: list[tuple[int, bytes]]) -> bytes:
    body = struct.pack("<QQ", size, len(pages)) + b"".join(
        struct.pack("<QQ", offset, len(page)) + page for offset, page in pages
    )
    return JOURNAL_MAGIC + body + hashlib.sha256(body).digest()


def _journalled(journal: FileIO) -> tuple[int, dict[int, bytes]]:
    """(size of the file, pages by offset in the order of writing) of the transaction in `journal`; no pages where none
    is whole."""
    journal.seek(0)
    entry = journal.read()
    body, digest = entry[len(JOURNAL_MAGIC) : -32], entry[-32:]
    if not entry.startswith(JOURNAL_MAGIC) or hashlib.sha256(body).digest() != digest:
        return 0, {}
    size, count = struct.unpack_from("<QQ", body)
    pages, at = {}, 16
    for _ in range(count):
        offset, length = struct.unpack_from("<QQ", body, at)
        pages[offset] = body[at + 16 : at + 16 + length]
        at += 16 + length
    return size, pages


def _recover(file: FileIO, journal: FileIO) -> None:
    """Compare the digest, complete the transaction in `journal`, if there is a whole one, and empty it.

    Raises OSError, InputError where the file does not match its digest; both files are then as before.
    """
    size, pages = _journalled(journal)
    _check(file, pages)
    if pages:
        _apply(file, size, list(pages.items()))
    journal.truncate(0)
