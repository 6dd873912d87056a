"""Results of a run in Python: frames, report and scene, from the folder that `refsim run` wrote.

The series that gauges measure lie in `gauges.hdf5`, replaced whole at every checkpoint. Behind the head of a checkpoint
(`refsim.io.checkpoint`) it has the datasets `arrays/NAME.time` (k,) [s] and `arrays/NAME.values` (k, columns) of each
gauge, and in `attributes` its kind, columns and units.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from refsim.core.checked import plainly, suggestion
from refsim.core.effect import Field
from refsim.core.errors import InputError
from refsim.core.reading import open_regular
from refsim.core.tables import Shown
from refsim.gauges import GaugeSeries
from refsim.io.checkpoint import Checkpoint, Unreadable, read_checkpoint, scene_from_checkpoint, write_checkpoint
from refsim.io.frames import heads_of, read_arrays, read_origin
from refsim.scene.scene import Scene

PARTICLES, REPORT = "particles.pvd", "report.json"
SAME_TIME = 5e-6  # relative difference of two times that are the same to the six digits in which times are printed


class RunFrame:
    """One frame of a run; a field is read from the file when it is first used.

    number  of the frame in the run, from 0
    time    [s]
    fields  what can be read: `frame["density"]` is a NumPy array, (n,) or (n, components)

    Rows are those of the file. `sorted()` is the frame with its rows in the order of `identity`, in which every row is
    the same particle in all frames.
    """

    def __init__(self, run: "Run", number: int, by_identity: bool = False) -> None:
        self._run, self._by_identity = run, by_identity
        self.number = number
        self.time = float(run.times[number])
        self._read: dict[str, NDArray[Any]] = {}

    @property
    def fields(self) -> Mapping[str, Field]:
        """The fields by name, with unit and meaning."""
        return self._run.fields

    @property
    def position(self) -> NDArray[Any]:
        """Positions (n, 3) [m]."""
        return self["position"]

    def __len__(self) -> int:
        return self._run._heads[self.number].count

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._read:
            values = self._run._rows(name, self.number)
            if self._by_identity:
                values = values[np.argsort(self._run._rows("identity", self.number), kind="stable")]
            self._read[name] = values
        return self._read[name]

    def sorted(self) -> "RunFrame":
        """This frame with its rows in the order of `identity`."""
        return RunFrame(self._run, self.number, by_identity=True)

    def __repr__(self) -> str:
        return f"<frame {self.number} at {self.time:.6g} s: {len(self):,} particles>"


class Run(Shown):
    """A run that was written to a folder; made by `open_run`.

    folder  where it is
    times   of the frames (k,) [s]
    fields  of the particles by name: unit, meaning, components, dtype

    `run[3]` and `run[-1]` are frames by number, `run.at(0.1)` is the frame nearest to a time, `for frame in run` goes
    through all of them. Nothing but the list of frames is read before it is used, and no file is kept open.
    """

    def __init__(self, path: Path, check: bool) -> None:
        self._file = path / PARTICLES if os.path.isdir(path) else path
        self.folder = self._file.parent

        self._heads, self._origin = heads_of(self._file), read_origin(self._file)
        self._unchecked = set(range(len(self._heads) if check else 0))  # frames whose digest is still to be compared
        self.fields = {
            name: Field(name, self._origin.units.get(name, ""), self._origin.meanings.get(name, ""), count, dtype.name)
            for name, (count, dtype, _) in self._heads[0].arrays.items()
        }
        self.times: NDArray[np.float64] = np.array([head.time for head in self._heads])

    # Frames

    def __len__(self) -> int:
        return len(self.times)

    @overload
    def __getitem__(self, number: int) -> RunFrame: ...
    @overload
    def __getitem__(self, number: slice) -> list[RunFrame]: ...
    @plainly
    def __getitem__(self, number: int | slice) -> RunFrame | list[RunFrame]:
        if isinstance(number, slice):
            return [RunFrame(self, k) for k in range(len(self))[number]]
        if not -len(self) <= number < len(self):
            raise IndexError(f"run {self.folder}: there is no frame {number}; give a number from 0 to {len(self) - 1}.")
        return RunFrame(self, range(len(self))[number])

    def __iter__(self) -> Iterator[RunFrame]:
        return (RunFrame(self, k) for k in range(len(self)))

    @plainly
    def at(self, time: float) -> RunFrame:
        """The frame nearest to `time` [s]. Raises InputError for a time before the first or after the last frame."""
        first, last = self.times[0], self.times[-1]
        slack = SAME_TIME * max(abs(first), abs(last))
        if not first - slack <= time <= last + slack:
            raise InputError(f"run {self.folder}: there is no frame at {time:.9g} s; give {first:.6g} to {last:.6g} s.")
        return RunFrame(self, int(np.abs(self.times - time).argmin()))

    def _rows(self, name: str, number: int) -> NDArray[Any]:
        if name not in self.fields:
            raise InputError(f"run {self.folder}: there is no field {name!r}; {suggestion(name, self.fields)}")
        array = read_arrays(self._heads[number], [name], number in self._unchecked)[name]
        self._unchecked.discard(number)
        return array

    # What was run, and what came of it

    @property
    def scene(self) -> Scene:
        """The scene that was run. Raises InputError where it is not said, because origin.h5 is missing."""
        if not self._origin.scene.strip():
            raise InputError(
                f"the frames of {self._file} do not say their scene (origin.h5 is not beside them); load the scene file"
                " (refsim.load_scene)."
            )
        saved = Checkpoint(dict(self._origin.arrays), {"scene": self._origin.scene})
        return scene_from_checkpoint(saved, str(self._file))

    @property
    def report(self) -> dict[str, Any]:
        """What the run did, as `report.json` has it: in "ledger" particles, mass, momentum and energies at its start
        and its end, in 2D per metre of depth. Raises InputError where the file is missing or damaged."""
        path = self.folder / REPORT
        try:
            with open_regular(path) as file:
                report: dict[str, Any] = json.load(file)
        except OSError as error:
            raise InputError(f"report {path} cannot be read ({error.strerror}); a checkpoint writes it.") from None
        except ValueError as error:
            raise InputError(f"report {path} is damaged ({error}); run the scene again.") from None
        if not (isinstance(report, dict) and {"start", "end"} <= set(report.get("ledger", ()))):
            raise InputError(f"report {path} is not that of a run; give the folder of a run.")
        return report

    @property
    def gauges(self) -> tuple[str, ...]:
        """Names of the scene's gauges; none where the folder has no file of them."""
        return tuple(read_series(self.folder / GAUGES)) if (self.folder / GAUGES).exists() else ()

    @plainly
    def gauge(self, name: str) -> GaugeSeries:
        """What the gauge of this name has measured. Raises InputError where there is no such gauge."""
        series = read_series(self.folder / GAUGES)
        if name not in series:
            raise InputError(f"run {self.folder}: there is no gauge {name!r}; {suggestion(name, series)}")
        return series[name]

    # As text

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        span = f", from {self.times[0]:.6g} to {self.times[-1]:.6g} s" if len(self) else ""
        counts = sorted({head.count for head in self._heads})
        particles = f"{counts[0]:,}" + (f" to {counts[-1]:,}" if len(counts) > 1 else "") if counts else "none"
        units = (f"{name} [{field.unit}]" if field.unit else name for name, field in self.fields.items())
        frames, fields = f"{len(self)}{span}", ", ".join(units)
        return "Run", [("folder", str(self.folder)), ("frames", frames), ("particles", particles), ("fields", fields)]


@plainly
def open_run(folder: str | os.PathLike[str], *, check: bool = True) -> Run:
    """Open the folder of a run, as `refsim run` and `simulate` write it, or its collection of frames.

    check  compare the digest of each frame when something of it is read first, which reads its file from end to end

    A run that is still being written can be opened; it has the frames that were there then.
    Raises InputError where there is no frame, or one is cut short; of a damaged one when it is read.
    """
    return Run(Path(folder), check)


# Series of gauges


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
