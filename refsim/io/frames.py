"""Particle output that ParaView opens: VTKHDF for a whole run.

A VTKHDF file is one HDF5 file that grows by one or more frames at a time, each time in a transaction
(`refsim.io.transactions`). A journal that a dead writer left behind is completed by the next
`ParticleWriter(append=True)` or `read_particles`.
"""

from __future__ import annotations

import math
import os
import time as clock
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import DTypeLike

from refsim.core.errors import InputError
from refsim.core.locks import unlock
from refsim.core.writing import replace_file, writing
from refsim.io import vtkhdf
from refsim.io.transactions import Staged, check_path, journal_path, locked_journal, recover

if TYPE_CHECKING:
    import h5py


KEPT = "the frames before it are untouched"


@dataclass(frozen=True)
class Frame:
    """One frame of n particles: `time` in s, `position` (n, 3) in m, `fields` by name."""

    time: float
    position: np.ndarray
    fields: dict[str, np.ndarray]


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
        origin: vtkhdf.Origin | None = None,
    ) -> None:
        self.path = Path(path)
        self._origin, self._stated_origin = origin, vtkhdf.Origin()  # to be written, and in the file
        self._fields = {name: vtkhdf.checked_field(name, *field) for name, field in fields.items()}
        self._times: list[float] = []
        self._precision: np.dtype | None = None  # of the positions in the file
        self._file: FileIO | None = None
        with writing("particle file", self.path, KEPT):
            try:
                self._journal, self._lock = locked_journal(journal_path(self.path))
            except BlockingIOError:
                words = f"particle file {self.path} is being written by another process"
                raise InputError(f"{words}; wait for it") from None
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
        with writing(f"frame at time {times[0]} of", self.path, KEPT):
            if self._file is None:
                staged = Staged(None)
                vtkhdf.edit(staged, "w", lambda root: self._begin(root, times, added))
                staged.seal()
                replace_file(self.path, staged.tail)
                self._file = open(self.path, "r+b", buffering=0)  # noqa: SIM115
            else:
                self._transaction(lambda root: vtkhdf.append_frames(root, times, added))
        self._precision = precision
        self._times += times

    def _begin(self, root: h5py.Group, times: Sequence[float], frames: Sequence[Mapping[str, np.ndarray]]) -> None:
        vtkhdf.create_layout(root, frames[0])
        if self._origin is not None:
            vtkhdf.write_origin(root, self._origin)
        vtkhdf.append_frames(root, times, frames)

    def close(self) -> None:
        """Close the file; nothing is left to be written. A second call does nothing."""
        if not self._journal.closed:
            finished = os.fstat(self._journal.fileno()).st_size == 0
            if finished:
                with suppress(OSError):
                    journal_path(self.path).unlink()
            self._close_files()

    def __enter__(self) -> ParticleWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _close_files(self) -> None:
        self._journal.close()
        unlock(self._lock)
        if self._file is not None:
            self._file.close()

    def _go_on(self, resume_time: float | None) -> None:
        """Open the file that is there, complete what a dead writer left half done, and drop late frames."""
        found = self._settle()
        if found != self._fields:
            raise InputError(
                f"particle file {self.path} holds the fields {vtkhdf.field_list(found)}, but this run writes "
                f"{vtkhdf.field_list(self._fields)}; give another path"
            )
        kept = len(self._times) if resume_time is None else sum(time <= resume_time for time in self._times)
        origin = None if self._origin is None or vtkhdf.same_words(self._origin, self._stated_origin) else self._origin
        if kept == len(self._times) and origin is None:
            return

        def change(root: h5py.Group) -> None:
            if kept < len(self._times):
                vtkhdf.drop_frames(root, kept)
            if origin is not None:
                vtkhdf.write_origin(root, origin)

        with writing("shortened particle file", self.path, KEPT):
            self._transaction(change)
        del self._times[kept:]

    def _settle(self) -> dict[str, tuple[int, np.dtype]]:
        """Complete what was left half done, and read what the file then holds; returns its fields."""
        with writing("particle file", self.path, KEPT):
            if self._file is None:
                self._file = open(self.path, "r+b", buffering=0)  # noqa: SIM115
            recover(self._file, self._journal)
        found: dict[str, tuple[int, np.dtype]] = {}

        def look(root: h5py.Group) -> None:
            self._precision = root["Points"].dtype
            self._times = root["Steps/Values"][: root["Steps"].attrs["NSteps"]].tolist()
            found.update(vtkhdf.fields_of(root))
            self._stated_origin = vtkhdf.read_origin(root)

        vtkhdf.read_hdf5(self.path, look)
        return found

    def _transaction(self, change: Callable[[h5py.Group], object]) -> None:
        """Let `change` edit the VTKHDF group, then put all of its writes into the file or none (OSError)."""
        assert self._file is not None
        staged = Staged(self._file)
        last = vtkhdf.edit(staged, "r+", change)
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
        index = vtkhdf.read_index(root)
        found = []
        for k in range(len(index.times))[frames] if isinstance(frames, slice) else sorted(frames):
            rows = index.rows(k)
            data = {n: values[rows] for n, values in root["PointData"].items() if fields is None or n in fields}
            found.append(Frame(float(index.times[k]), root["Points"][rows], data))
        return found

    return read_file(Path(path), read)


def read_file(path: Path, read: Callable[[h5py.Group], vtkhdf.T], check: bool = True) -> vtkhdf.T:
    """What `read` returns for the VTKHDF group of a particle file, whose digest is compared before.

    check  False leaves the comparison out, for a file that was compared before: HDF5 can crash on a damaged one

    Completes what a writer that was killed left half done. Reads again while a living writer is between two pages.
    Raises InputError when the file is missing, damaged, or no particle file.
    """
    for _ in range(2):
        try:
            return _checked_and_read(path, read, check)
        except InputError:
            if not journal_path(path).exists():
                raise
            clock.sleep(0.01)
    return _checked_and_read(path, read, check)


def _checked_and_read(path: Path, read: Callable[[h5py.Group], vtkhdf.T], check: bool) -> vtkhdf.T:
    if check:
        check_path(path)
    return vtkhdf.read_hdf5(path, read)
