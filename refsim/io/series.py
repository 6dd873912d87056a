"""The file of the series that gauges measure: `gauges.hdf5`, replaced whole at every checkpoint.

Behind the head of a checkpoint (`refsim.io.checkpoint`) it has the datasets `arrays/NAME.time` (k,) [s] and
`arrays/NAME.values` (k, columns) of each gauge, and in `attributes` its kind, columns and units.
"""

import json
from collections.abc import Iterable
from pathlib import Path

from refsim.core.errors import InputError
from refsim.gauges import GaugeSeries
from refsim.io.checkpoint import Unreadable, read_checkpoint, write_checkpoint

GAUGES, KIND = "gauges.hdf5", "file of gauges"


def write_series(path: Path, series: Iterable[GaugeSeries]) -> None:
    """Replace the file by one with these series. Raises InputError or RunStopped where the disk refuses."""
    arrays, attributes = {}, {}
    for one in series:
        arrays[f"{one.name}.time"], arrays[f"{one.name}.values"] = one.time, one.values
        attributes[one.name] = json.dumps({"kind": one.kind, "columns": one.columns, "units": one.units})
    write_checkpoint(path, arrays, attributes, keep=1, what=KIND)


def read_series(path: Path) -> dict[str, GaugeSeries]:
    """The series in a file by name. Raises InputError where it is missing or damaged."""
    try:
        saved = read_checkpoint(path, KIND)
    except Unreadable as error:
        raise InputError(
            f"{error.sentence}; a run of a scene with [[gauge]] writes it with its first checkpoint."
        ) from None
    series = {}
    for name, text in saved.attributes.items():
        attributes = json.loads(str(text))
        columns, units = tuple(attributes["columns"]), tuple(attributes["units"])
        values = saved.arrays[f"{name}.values"].reshape(-1, len(columns))
        series[name] = GaugeSeries(name, attributes["kind"], saved.arrays[f"{name}.time"], values, columns, units)
    return series
