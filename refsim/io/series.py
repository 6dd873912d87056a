"""The file of the series that gauges measure: `gauges.hdf5`, replaced whole at every checkpoint.

It begins with a block of 512 bytes that HDF5 passes over, `refsim gauges` and the SHA-256 of all that follows the
block. Behind it stands a group for each gauge with the datasets `time` (k,) [s] and `values` (k, columns) and the
attributes `kind`, `columns` and `units`.
"""

import hashlib
import io
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from refsim.core.errors import InputError
from refsim.core.reading import open_regular
from refsim.core.writing import replace_file, writing
from refsim.gauges import GaugeSeries
from refsim.io.checkpoint import BLOCK, KEPT, in_hdf5

if TYPE_CHECKING:
    import h5py

GAUGES = "gauges.hdf5"
HEAD = b"refsim gauges\nversion 1\nsha256 "


def write_series(path: Path, series: Iterable[GaugeSeries]) -> None:
    """Replace the file by one with these series. Raises InputError or RunStopped where the disk refuses."""

    def fill(file: "h5py.File") -> None:
        for one in series:
            group = file.create_group(one.name)
            group.attrs["kind"] = one.kind
            group.attrs["columns"], group.attrs["units"] = list(one.columns), list(one.units)
            group.create_dataset("time", data=one.time)
            group.create_dataset("values", data=one.values)

    content = in_hdf5(fill)
    content[:BLOCK] = _head(content[BLOCK:])
    with writing("file of gauges", path, KEPT):
        replace_file(path, content)


def _head(body: bytes | memoryview) -> bytes:
    """The block before what HDF5 reads."""
    return (HEAD + hashlib.sha256(body).hexdigest().encode() + b"\n").ljust(BLOCK, b"\0")


def read_series(path: Path) -> dict[str, GaugeSeries]:
    """The series in a file by name. Raises InputError where it is missing or damaged."""
    import h5py

    try:
        with open_regular(path) as file:
            content = file.read()
    except OSError as error:
        raise InputError(
            f"file of gauges {path} cannot be read ({error.strerror}); a run of a scene with [[gauge]] writes it with"
            " its first checkpoint."
        ) from None
    if content[:BLOCK] != _head(content[BLOCK:]):
        raise InputError(f"file of gauges {path} is damaged (it does not match its digest); run the scene again.")
    found = {}
    with h5py.File(io.BytesIO(content), "r") as root:
        for name, group in root.items():
            columns, units = (tuple(map(str, group.attrs[word])) for word in ("columns", "units"))
            values = np.asarray(group["values"][()]).reshape(-1, len(columns))
            found[name] = GaugeSeries(name, str(group.attrs["kind"]), group["time"][()], values, columns, units)
    return found
