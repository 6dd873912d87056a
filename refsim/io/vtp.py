"""One frame as a VTP file, which ParaView opens."""

import os
import struct
import sys
from pathlib import Path

import numpy as np

from refsim.core.writing import replace_file, writing
from refsim.io.vtkhdf import DTYPES


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
            raise ValueError(f"array {name!r} must be ({count},) or ({count}, k), not {array.shape} {array.dtype}")
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
    with writing("particle file", Path(path), "the file that was there is untouched"):
        replace_file(Path(path), content)
