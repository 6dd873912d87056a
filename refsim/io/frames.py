"""Frames of a run: a VTP file a frame in a folder, and a collection that ParaView opens with all of them.

Beside `particles.pvd`, the collection, stands the folder `particles`: `000000.vtp`, `000001.vtp`, ... in order of time,
and `origin.h5`, which says what made them. A file is written beside its name and renamed, so that it is whole at every
instant. Nothing is read from the collection: it is made anew from the files whenever frames are written.
"""

import hashlib
import html
import json
import os
import re
import struct
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike

from refsim.core.effect import POSITION_RESIDUAL
from refsim.core.errors import InputError
from refsim.core.reading import open_regular
from refsim.core.writing import Content, remove_stale_temporaries, replace_file, replace_files, unlock, writing
from refsim.io.checkpoint import checkpoint_bytes, read_checkpoint, scene_to_checkpoint

if TYPE_CHECKING:
    from refsim.scene.plan import Plan

KEPT = "the frames before it are untouched"
ORIGIN = "origin of frames"
OLDER = "particles.vtkhdf"  # the frames of earlier versions


@dataclass(frozen=True)
class Frame:
    """One frame of n particles: `time` in s, `position` (n, 3) in m, `fields` by name."""

    time: float
    position: np.ndarray
    fields: dict[str, np.ndarray]


@dataclass(frozen=True)
class Origin:
    """What made the frames.

    scene     as TOML; "" where it is not known
    arrays    what the scene took from files, by name (`refsim.io.checkpoint.scene_to_checkpoint`)
    units     of the fields by name, that of "position" among them
    meanings  of the fields in words
    """

    scene: str = ""
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)


def origin_of(plan: "Plan") -> Origin:
    """What frames of a run of this plan say of it: its scene, and units and meanings of the particle fields."""
    scene, arrays = scene_to_checkpoint(plan)
    fields = {name: f for name, f in plan.particle_fields.items() if name != POSITION_RESIDUAL.name}
    units = {name: field.unit_in(plan.grid.dim) for name, field in fields.items()}
    return Origin(scene, arrays, units, {name: field.meaning for name, field in fields.items()})


def folder_of(path: Path) -> Path:
    """The folder of the frames of a collection."""
    return path.with_suffix("")


def frame_files(path: Path) -> list[Path]:
    """The files of the frames of a collection, in order of time; none where there is no folder."""
    try:
        files = [file for file in folder_of(path).iterdir() if file.suffix == ".vtp" and file.stem.isdecimal()]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise InputError(f"frames of {path} cannot be read ({error.strerror}); give another folder.") from None
    return sorted(files, key=lambda file: int(file.stem))


def read_origin(path: Path) -> Origin:
    """What made the frames of a collection; empty where it is not said. Raises InputError for a damaged file."""
    file = folder_of(path) / "origin.h5"
    if not os.path.lexists(file):
        return Origin()
    saved = read_checkpoint(file, ORIGIN)
    scene, units, meanings = (str(saved.attributes[name]) for name in ("scene", "units", "meanings"))
    return Origin(scene, saved.arrays, json.loads(units), json.loads(meanings))


class ParticleWriter:
    """Writes frames of a run, one or more at a time, and the collection of them.

    path         the collection, usually `particles.pvd`; with the first frame the folder of frames is made, or
                 emptied, not before
    fields       name -> (components, dtype): one component is an (n,) array, more an (n, components) array;
                 dtype is float32, float64, int32, int64 or uint8
    resume_time  go on with the frames that are there up to this time (s), which must have the same fields; later ones
                 are removed
    origin       what made the frames; with `resume_time` it replaces what is said

    The number of particles may change between frames. After `append` returns the frames are on the disk.
    While the writer is open, `<path>.lock` lies beside the collection.

    Raises InputError when the folder is not writable, another process writes the same frames, or, with
    `resume_time`, a frame is damaged or has other fields.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        fields: Mapping[str, tuple[int, DTypeLike]],
        *,
        resume_time: float | None = None,
        origin: Origin | None = None,
    ) -> None:
        from filelock import FileLock, Timeout  # takes 20 ms

        self.path, self.folder, self._origin = Path(path), folder_of(Path(path)), origin
        self._fields = {name: (components, np.dtype(dtype)) for name, (components, dtype) in fields.items()}
        self._heads: list[Head] = []
        self._afresh = True
        with writing("collection of frames", self.path, KEPT):
            os.stat(f"{self.path.parent}{os.sep}")  # the lock would make the folder
            self._lock = FileLock(f"{self.path}.lock", blocking=False, thread_local=False)
            try:
                self._lock.acquire()
            except Timeout:
                raise InputError(f"frames of {self.path} are being written by another process; wait for it.") from None
        try:
            if resume_time is not None:
                self._go_on(resume_time)
        except BaseException:
            self.close()
            raise

    @property
    def last_time(self) -> float | None:
        """Time (s) of the last frame, None before the first."""
        return self._heads[-1].time if self._heads else None

    def append(self, frames: Sequence[Frame]) -> None:
        """Append frames with the fields above, in order of time; none gets its name before all are on the disk.

        Raises RunStopped ("disk_full", "write_failed") when the disk refuses: the frames before are then untouched, and
        the same frames or later ones can be tried again.
        """
        number = int(self._heads[-1].path.stem) + 1 if self._heads else 0
        files = {
            self.folder / f"{number + k:06d}.vtp": vtp_bytes(frame.position, frame.fields, float(frame.time))
            for k, frame in enumerate(frames)
        }
        if not files:
            return
        with writing(f"frame at time {frames[0].time} of", self.path, KEPT):
            self.folder.mkdir(exist_ok=True)
            if self._afresh:
                remove_stale_temporaries(self.folder)
                replace_files(self._origin_file() | files, self._begin)
            else:
                replace_files(files)
            self._afresh = False
            heads = [*self._heads, *(head_of(file, content, len(content)) for file, content in files.items())]
            self._write_collection(heads)
        self._heads = heads

    def _begin(self) -> None:
        """Remove the frames of an earlier run, the last one first."""
        for file in reversed(frame_files(self.path)):
            file.unlink()

    def _origin_file(self) -> dict[Path, Content]:
        """The file that says what makes the frames."""
        origin, file = self._origin or Origin(), self.folder / "origin.h5"
        attributes = {"units": json.dumps(dict(origin.units)), "meanings": json.dumps(dict(origin.meanings))}
        return {file: checkpoint_bytes(file, origin.arrays, {"scene": origin.scene, **attributes}, ORIGIN)}

    def _write_collection(self, heads: "Sequence[Head]") -> None:
        name = html.escape(self.folder.name)
        lines = (f'<DataSet timestep="{h.time!r}" file="{name}/{h.path.name}"/>\n' for h in heads)
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1"><Collection>\n'
        replace_file(self.path, f"{head}{''.join(lines)}</Collection></VTKFile>\n".encode(errors="surrogateescape"))

    def _go_on(self, resume_time: float) -> None:
        """Take the frames that are there, and drop late ones."""
        self._heads = [read_head(file) for file in frame_files(self.path)]
        if not self._heads:
            return
        there = {name: (count, dtype) for name, (count, dtype, _) in self._heads[0].arrays.items()}
        del there["position"]
        if there != self._fields:
            raise InputError(
                f"frames of {self.path} hold the fields {_field_list(there)}, but this run writes"
                f" {_field_list(self._fields)}; give another path."
            )
        self._afresh = False
        with writing("collection of frames", self.path, KEPT):
            remove_stale_temporaries(self.folder)
            while self._heads and self._heads[-1].time > resume_time:
                self._heads[-1].path.unlink()
                del self._heads[-1]
            if self._origin is not None:
                replace_files(self._origin_file())
            self._write_collection(self._heads)

    def close(self) -> None:
        """Let others write; nothing is left to be written. A second call does nothing."""
        if self._lock.is_locked:
            unlock(self._lock)


def heads_of(path: Path) -> "list[Head]":
    """The heads of the frames of a collection, in order of time. Raises InputError where there is none."""
    heads = [read_head(file) for file in frame_files(path)]
    if not heads:
        if (older := path.parent / OLDER).exists():
            raise InputError(
                f"{older} was written by an earlier version of refsim, whose frames this one does not read; open it in"
                " ParaView, or run the scene again into another folder."
            )
        raise InputError(f"there are no frames of {path}; give the folder of a run that has written one.")
    return heads


def _field_list(fields: Mapping[str, tuple[int, np.dtype]]) -> str:
    return ", ".join(f"{name} ({count} x {dtype})" for name, (count, dtype) in sorted(fields.items())) or "none"


DTYPES: dict[np.dtype, str] = {
    np.dtype("float32"): "Float32", np.dtype("float64"): "Float64", np.dtype("int32"): "Int32",
    np.dtype("int64"): "Int64", np.dtype("uint8"): "UInt8",
}  # fmt: skip
HEAD = re.compile(rb'<\?xml version="1.0"\?>\n<!-- refsim frame, version (\d+), sha256 ([0-9a-f]{64}) -->\n')
ARRAY = re.compile(r'type="(\w+)" Name="([^"]*)" NumberOfComponents="(\d+)" format="appended" offset="(\d+)"')
BEGIN, END = b'<AppendedData encoding="raw">_', b"\n</AppendedData></VTKFile>\n"
VERSION = 1
ADVICE = "move it away, or run the scene again"


def vtp_bytes(position: np.ndarray, fields: Mapping[str, np.ndarray], time: float | None = None) -> bytes:
    """A VTP file: `position` (n, 3), float32 or float64, in m; `time` in s; `fields`: (n,) or (n, components) arrays.

    Raises ValueError for other shapes or dtypes (`DTYPES`).
    """
    position = np.asarray(position)
    if position.ndim != 2 or position.shape[1] != 3 or position.dtype not in (np.float32, np.float64):
        raise ValueError(f"position must be (n, 3), float32 or float64, not {position.shape} {position.dtype}")
    count, place = len(position), 0
    blocks: list[bytes | memoryview] = []

    def data_array(name: str, array: np.ndarray) -> str:
        nonlocal place
        if array.shape[:1] != (count,) or array.ndim > 2 or array.dtype not in DTYPES:
            raise ValueError(f"array {name!r} must be ({count},) or ({count}, k), not {array.shape} {array.dtype}")
        blocks.extend((struct.pack("=Q", array.nbytes), np.ascontiguousarray(array).reshape(-1).view(np.uint8).data))
        offset, place = place, place + 8 + array.nbytes
        return (
            f'<DataArray type="{DTYPES[array.dtype]}" Name="{html.escape(name)}"'
            f' NumberOfComponents="{array.shape[1] if array.ndim == 2 else 1}" format="appended"'
            f' offset="{offset}"/>'
        )

    stated = '<DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">'
    lines = [
        f'<VTKFile type="PolyData" version="1.0" header_type="UInt64" byte_order="{sys.byteorder.capitalize()}Endian">',
        "<PolyData>",
        "" if time is None else f"<FieldData>{stated}{time!r}</DataArray></FieldData>",
        f'<Piece NumberOfPoints="{count}" NumberOfVerts="{count}">',
        f"<Points>{data_array('Points', position)}</Points>",
        f"<Verts>{data_array('connectivity', np.arange(count, dtype=np.int32))}",
        f"{data_array('offsets', np.arange(1, count + 1, dtype=np.int32))}</Verts>",
        "<PointData>",
        *(data_array(name, np.asarray(array)) for name, array in fields.items()),
        "</PointData></Piece></PolyData>",
    ]
    body = b"".join(["\n".join(lines).encode(), b"\n", BEGIN, *blocks, END])
    digest = hashlib.sha256(body).hexdigest()
    return f'<?xml version="1.0"?>\n<!-- refsim frame, version {VERSION}, sha256 {digest} -->\n'.encode() + body


@dataclass(frozen=True)
class Head:
    """What the beginning of a frame's file says."""

    path: Path
    time: float  # [s]; NaN where the file states none
    count: int  # particles
    arrays: dict[str, tuple[int, np.dtype, int]]  # components, dtype and place in the file [bytes]; "position" first


def read_head(path: Path) -> Head:
    """The head of a file of `vtp_bytes`; its data are not read. Raises InputError where it is none, or cut short."""
    try:
        with open_regular(path) as file:
            text = file.read(2**14)
            while BEGIN not in text and (more := file.read(2**20)):
                text += more
            size = os.fstat(file.fileno()).st_size
    except OSError as error:
        raise InputError(f"frame {path} cannot be read ({error.strerror}); {ADVICE}.") from None
    return head_of(path, text, size)


def head_of(path: Path, text: bytes | bytearray, size: int) -> Head:
    """The head of a file of `size` bytes that begins with `text`. Raises InputError as `read_head` does."""
    match = HEAD.match(text)
    if match is None:
        raise InputError(f"frame {path} is damaged, or not of refsim (it does not begin as one); {ADVICE}.")
    if int(match[1]) != VERSION:
        raise InputError(
            f"frame {path} has version {int(match[1])}, and this refsim reads version {VERSION}; {ADVICE}."
        )
    try:
        begin = text.index(BEGIN) + len(BEGIN)
        xml = text[:begin].decode()
        little = '"LittleEndian"' in xml
        kinds = {name: dtype.newbyteorder("<" if little else ">") for dtype, name in DTYPES.items()}
        arrays = [(html.unescape(n), int(c), kinds[t], begin + int(o)) for t, n, c, o in ARRAY.findall(xml)]
        time = re.search('Name="TimeValue"[^>]*>([^<]*)<', xml)
        count = int(xml.partition('NumberOfPoints="')[2].partition('"')[0])
        _, components, dtype, end = arrays[-1]
        if size != end + 8 + count * components * dtype.itemsize + len(END):
            raise ValueError
    except (ValueError, IndexError, KeyError):
        raise InputError(f"frame {path} is cut short or damaged; {ADVICE}.") from None
    # Behind the positions stand two arrays of vertices.
    stored = {"position": arrays[0][1:]} | {name: (c, t, place) for name, c, t, place in arrays[3:]}
    return Head(path, float(time[1]) if time else np.nan, count, stored)


def read_arrays(head: Head, names: Collection[str], check: bool = False) -> dict[str, np.ndarray]:
    """Arrays of a file by name, "position" among them: (n,) or (n, components).

    check  compare the digest before, which reads the whole file

    Raises InputError where the file is damaged or has changed.
    """
    arrays = {}
    try:
        with open_regular(head.path) as file:
            if check:
                stated = HEAD.match(file.read(200))
                file.seek(stated.end() if stated else 0)
                if stated is None or hashlib.file_digest(file, "sha256").hexdigest() != stated[2].decode():
                    raise InputError(f"frame {head.path} is damaged (it does not match its digest); {ADVICE}.")
            for name in names:
                components, dtype, place = head.arrays[name]
                file.seek(place + 8)
                values = np.frombuffer(file.read(head.count * components * dtype.itemsize), dtype)
                values = values.astype(dtype.newbyteorder("="))
                arrays[name] = values if components == 1 else values.reshape(head.count, components)
    except (OSError, ValueError):
        raise InputError(f"frame {head.path} was changed while it was read; read it again.") from None
    return arrays
