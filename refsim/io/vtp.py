"""Frames as VTP files (XML PolyData with raw data, one vertex per particle), which ParaView opens.

The second line of a file has the SHA-256 of all that follows it. `write_vtp` writes; `read_head` and `read_arrays`
read what it wrote.
"""

import hashlib
import html
import os
import re
import struct
import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from refsim.core.errors import InputError
from refsim.core.reading import open_regular
from refsim.core.writing import replace_file, writing

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
    """A VTP file: `position` (n, 3), float32 or float64, in m; `fields` as `write_vtp` takes them; `time` in s."""
    position = np.asarray(position)
    if position.ndim != 2 or position.shape[1] != 3 or position.dtype not in (np.float32, np.float64):
        raise ValueError(f"position must be (n, 3), float32 or float64, not {position.shape} {position.dtype}")
    count, place = len(position), 0
    blocks: list[bytes | memoryview] = []

    def data_array(name: str, array: np.ndarray) -> str:
        nonlocal place
        if array.dtype == np.bool_:
            array = array.view(np.uint8)
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


def write_vtp(path: str | os.PathLike[str], position: np.ndarray, /, **fields: np.ndarray) -> None:
    """Write one frame as a VTP file; whole or not at all.

    position  (n, 3), float32 or float64, in m
    fields    (n,) or (n, components) arrays, float32, float64, int32, int64, uint8 or bool (written as uint8)

    Raises ValueError for other shapes or dtypes, InputError when the folder is not writable, RunStopped
    ("disk_full", "write_failed") when the disk refuses; a file that was there is then untouched.
    """
    content = vtp_bytes(position, fields)
    with writing("particle file", Path(path), "the file that was there is untouched"):
        replace_file(Path(path), content)


@dataclass(frozen=True)
class Head:
    """What the beginning of a frame's file says."""

    path: Path
    time: float  # [s]; NaN where the file states none
    count: int  # particles
    dtype: np.dtype
    fields: dict[str, tuple[int, np.dtype]]  # components and dtype by name, without "position"
    places: dict[str, int]  # of the arrays in the file, in bytes, by name


def read_head(path: Path) -> Head:
    """The head of a file of `write_vtp`; its data are not read. Raises InputError where it is none, or cut short."""
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
    fields = arrays[3:]  # behind the positions and the two arrays of vertices
    return Head(
        path, float(time[1]) if time else np.nan, count, arrays[0][2], {name: (c, t) for name, c, t, _ in fields},
        {"position": arrays[0][3]} | {name: place for name, _, _, place in fields},
    )  # fmt: skip


def read_arrays(head: Head, names: Collection[str], check: bool = False) -> dict[str, np.ndarray]:
    """Arrays of a file by name, "position" among them: (n,) or (n, components).

    check  compare the digest before, which reads the whole file

    Raises InputError where the file is damaged or has changed.
    """
    arrays = {}
    kinds = {"position": (3, head.dtype), **head.fields}
    try:
        with open_regular(head.path) as file:
            if check:
                stated = HEAD.match(file.read(200))
                file.seek(stated.end() if stated else 0)
                if stated is None or hashlib.file_digest(file, "sha256").hexdigest() != stated[2].decode():
                    raise InputError(f"frame {head.path} is damaged (it does not match its digest); {ADVICE}.")
            for name in names:
                components, dtype = kinds[name]
                file.seek(head.places[name] + 8)
                values = np.frombuffer(file.read(head.count * components * dtype.itemsize), dtype)
                values = values.astype(dtype.newbyteorder("="))
                arrays[name] = values if components == 1 else values.reshape(head.count, components)
    except (OSError, ValueError):
        raise InputError(f"frame {head.path} was changed while it was read; read it again.") from None
    return arrays
