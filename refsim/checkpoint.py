"""Checkpoints: named arrays and attributes in one HDF5 file that is either whole or not there.

A checkpoint is written beside its final name and renamed into place, so a killed process or a full disk costs
at most the interval since the last one. Values come back bit for bit; digests tell a damaged file from a good
one.

Layout, version 1: root attributes `format`, `version`, `written_ns` (clock of the writer, nanoseconds) and
`digest` (over all the digests below); one dataset per array in the group `arrays`, each with its `sha256`;
the attributes as JSON text in the dataset `attributes`, with its `sha256`.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from refsim.errors import InputError, RunStopped

if TYPE_CHECKING:
    import h5py

FORMAT = "refsim checkpoint"
VERSION = 1

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
) -> None:
    """Write a checkpoint to `path`; at every instant a whole one, old or new, lies there or beside it.

    arrays      any shape, boolean, integer, floating or complex; written bit for bit, units are the caller's
    attributes  text and plain numbers; numbers come back exactly, with their type
    keep        whole checkpoints to hold: `path` itself, then `<stem>.previous<suffix>`,
                `<stem>.previous2<suffix>`, ...

    Raises RunStopped, and leaves the checkpoints that are there as they are:
      "non_finite"    an array holds a NaN or an infinity, or an attribute a NaN: nothing is written
      "disk_full"     no space or quota left; the run itself is unharmed, so the caller may go on and try
                      again later
      "write_failed"  the disk refused for another reason
    Raises InputError when the folder cannot be written to, TypeError or ValueError when a name, a dtype, an
    attribute or `keep` is not of the kinds above. One writer per `path`: a write clears the leavings of
    killed writers.
    """
    path = Path(path)
    if keep < 1:
        raise ValueError(f"keep must be at least 1, not {keep}")
    checked = {name: _checked_array(path, name, array) for name, array in arrays.items()}
    text = _attributes_text(path, attributes)

    remove_stale_temporaries(path)
    temporary = temporary_path(path)
    try:
        stream = _Stream(temporary)
    except OSError as error:
        raise cannot_write("checkpoint", path, error, KEPT) from error
    try:
        try:
            _write_hdf5(stream, checked, text, written_ns=_next_written_ns(path))
        except Exception:
            if stream.error is None:  # a refused write is the cause of whatever HDF5 made of it
                raise
        finally:
            stream.close()
        if stream.error is not None:
            raise stream.error
        _put_in_place(temporary, path, keep)
    except OSError as error:
        raise cannot_write("checkpoint", path, error, KEPT) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def read_checkpoint(path: str | os.PathLike[str]) -> Checkpoint:
    """Read a checkpoint and compare every digest.

    Raises InputError, in one sentence that names the file, when it is missing, is no checkpoint, is of
    another version, is cut short or has been altered; when the previous checkpoint beside it is whole, the
    sentence says so.
    """
    path = Path(path)
    try:
        return _read(path)
    except _Unreadable as error:
        previous = previous_path(path)
        advice = "start the run again, or give the path of a whole checkpoint"
        with suppress(_Unreadable):
            _read(previous)
            advice = f"resume from {previous} instead, which is whole"
        raise InputError(f"checkpoint {path} {error}; {advice}") from error


def latest_checkpoint(folder: str | os.PathLike[str]) -> Path | None:
    """The path of the newest whole checkpoint in `folder` (not below it), or None when there is none.

    Raises InputError where the folder cannot be read.
    """
    try:
        files = [entry for entry in Path(folder).iterdir() if entry.is_file() and not entry.name.startswith(".")]
    except OSError as error:
        raise InputError(f"folder {folder} cannot be read ({error.strerror}); give the folder of a run") from error
    dated = []
    for file in files:
        with suppress(_Unreadable):
            dated.append((_written_ns(file), file))
    for _, file in sorted(dated, reverse=True):
        with suppress(_Unreadable):
            _read(file)
            return file
    return None


def previous_path(path: str | os.PathLike[str], generation: int = 1) -> Path:
    """Where the checkpoint that stood at `path` goes when a newer one comes: `run.h5` ->
    `run.previous.h5`."""
    path = Path(path)
    number = "" if generation == 1 else str(generation)
    return path.with_name(f"{path.stem}.previous{number}{path.suffix}")


# -- what is written ---------------------------------------------------------------------------------------


def _checked_array(path: Path, name: str, array: np.ndarray) -> np.ndarray:
    if not name or "/" in name or name == ".":
        raise ValueError(f"{name!r} cannot name an array in a checkpoint")
    array = np.asarray(array)
    if array.dtype.kind not in "biufc":
        raise TypeError(f"array {name!r} has dtype {array.dtype}, which a checkpoint does not hold")
    if array.dtype.kind in "fc":
        finite = np.isfinite(array)
        if not finite.all():
            bad = np.argwhere(~finite)
            raise RunStopped(
                "non_finite",
                f"checkpoint {path} was not written because array {name!r} holds {len(bad)} non-finite "
                f"values, the first at index {tuple(bad[0].tolist())}; {KEPT}",
            )
    return array if array.flags.c_contiguous else array.copy(order="C")


def _attributes_text(path: Path, attributes: Mapping[str, Attribute]) -> str:
    plain = {name: value.item() if isinstance(value, np.generic) else value for name, value in attributes.items()}
    for name, value in plain.items():
        if not isinstance(value, str | int | float | bool):
            raise TypeError(f"attribute {name!r} is a {type(value).__name__}, not text or a plain number")
        if isinstance(value, float) and math.isnan(value):
            raise RunStopped(
                "non_finite",
                f"checkpoint {path} was not written because attribute {name!r} is not a number; {KEPT}",
            )
    return json.dumps(plain)


def _digest(array: np.ndarray) -> str:
    """SHA-256 over dtype, shape and bytes, so that the same bytes read as another type do not pass."""
    digest = hashlib.sha256(f"{array.dtype.str}{array.shape}".encode())
    digest.update(array.reshape(-1).view(np.uint8))
    return digest.hexdigest()


def _text_digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _whole_digest(digests: Mapping[str, str]) -> str:
    """One digest over names and digests, so that a missing or a renamed array is noticed."""
    return _text_digest(json.dumps(sorted(digests.items())))


def _write_hdf5(stream: _Stream, arrays: Mapping[str, np.ndarray], text: str, written_ns: int) -> None:
    import h5py

    with h5py.File(stream, "w", libver=("v110", "v110")) as file:  # where HDF5 checksums its own structures
        digests = {}
        group = file.create_group("arrays")
        for name, array in arrays.items():
            dataset = group.create_dataset(name, data=array)
            digests[f"arrays/{name}"] = dataset.attrs["sha256"] = _digest(array)
        string = h5py.string_dtype("utf-8", len(text))
        dataset = file.create_dataset("attributes", data=text, dtype=string)
        digests["attributes"] = dataset.attrs["sha256"] = _text_digest(text)
        file.attrs["format"] = FORMAT
        file.attrs["version"] = VERSION
        file.attrs["written_ns"] = written_ns
        file.attrs["digest"] = _whole_digest(digests)


class _Stream:
    """The file that h5py writes to. It remembers the first error of the disk instead of raising it: an
    exception inside HDF5's own close leaves the library with a half-closed file, and loses the error
    number."""

    def __init__(self, path: Path) -> None:
        self.error: OSError | None = None
        self._file = open(path, "x+b", buffering=0)  # noqa: SIM115

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def read(self, size: int = -1) -> bytes:
        """Not used: h5py takes an object with `read` for a file, and reads with `readinto`."""
        return self._file.read(size)

    def readinto(self, buffer: memoryview) -> int:
        return self._file.readinto(buffer)

    def write(self, data: memoryview) -> int:
        self._remember(write_all, self._file, data)
        return len(data)

    def truncate(self, size: int) -> int:
        self._remember(self._file.truncate, size)
        return size

    def flush(self) -> None:
        pass

    def close(self) -> None:
        """Put everything on the disk and close; `error` holds what went wrong, now or before."""
        self._remember(os.fsync, self._file.fileno())
        try:
            self._file.close()
        except OSError as error:
            self.error = self.error or error

    def _remember(self, action: Callable[..., object], *arguments: object) -> None:
        if self.error is None:
            try:
                action(*arguments)
            except OSError as error:
                self.error = error


def _put_in_place(temporary: Path, path: Path, keep: int) -> None:
    """Rename `temporary` to `path` and the files before it one place down the row.

    The old file gets a second name first and takes its new place last: a kill between any two calls leaves a
    whole checkpoint at `path`. Where the file system has no hard links, the old one is moved to its new place
    first.
    """
    for generation in range(keep - 1, 1, -1):
        with suppress(FileNotFoundError):
            _copy_name(previous_path(path, generation - 1), previous_path(path, generation))
    old = temporary.with_suffix(".old.tmp")
    if keep > 1 and path.exists():
        try:
            os.link(path, old)
        except OSError:
            os.replace(path, previous_path(path))
    os.replace(temporary, path)
    if old.exists():
        os.replace(old, previous_path(path))
    sync_folder(path.parent)


def _copy_name(source: Path, target: Path) -> None:
    """Let `target` name the file that `source` names, without an instant in which `target` names nothing."""
    second = temporary_path(target)
    try:
        os.link(source, second)
    except FileNotFoundError:
        raise
    except OSError:
        os.replace(source, target)
    else:
        os.replace(second, target)


# -- what is read ------------------------------------------------------------------------------------------


class _Unreadable(Exception):
    """Why a file is not a whole checkpoint: the rest of a sentence that begins with its name."""


def _read(path: Path) -> Checkpoint:
    with _Opened(path) as file:
        digests = {}
        arrays = {}
        for name, dataset in file["arrays"].items():
            array = np.asarray(dataset[()])
            digests[f"arrays/{name}"] = _digest(array)
            if digests[f"arrays/{name}"] != dataset.attrs["sha256"]:
                raise _Unreadable(f"is damaged (array {name!r} does not match its digest)")
            arrays[name] = array
        text = file["attributes"].asstr()[()]
        digests["attributes"] = _text_digest(text)
        if digests["attributes"] != file["attributes"].attrs["sha256"]:
            raise _Unreadable("is damaged (the attributes do not match their digest)")
        if _whole_digest(digests) != file.attrs["digest"]:
            raise _Unreadable("is damaged (arrays are missing or have other names than when it was written)")
        return Checkpoint(arrays, json.loads(text))


def _written_ns(path: Path) -> int:
    with _Opened(path) as file:
        return int(file.attrs["written_ns"])


def _next_written_ns(path: Path) -> int:
    """The clock, but always after the checkpoint at `path`, even when the clock was set back."""
    before = -1
    with suppress(_Unreadable):
        before = _written_ns(path)
    return max(time.time_ns(), before + 1)


class _Opened:
    """Open an HDF5 file of our format; whatever goes wrong inside becomes an _Unreadable with its reason."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: h5py.File | None = None

    def __enter__(self) -> h5py.File:
        import h5py

        try:
            with open(self._path, "rb") as file:
                signature = file.read(8)
        except FileNotFoundError:
            raise _Unreadable("does not exist") from None
        except OSError as error:
            raise _Unreadable(f"cannot be read ({error.strerror})") from error
        if signature != b"\x89HDF\r\n\x1a\n":
            raise _Unreadable("is not a checkpoint (it is no HDF5 file)")
        try:
            self._file = h5py.File(self._path, "r")
            name, version = self._file.attrs.get("format"), self._file.attrs.get("version")
        except Exception as error:
            self._close()
            raise _Unreadable("is cut short or damaged (HDF5 cannot open it)") from error
        if name != FORMAT:
            self._close()
            raise _Unreadable("is not a checkpoint (it is an HDF5 file of another kind)")
        if version != VERSION:
            self._close()
            raise _Unreadable(f"has format version {version}, and this refsim reads version {VERSION}")
        return self._file

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._close()
        if isinstance(error, Exception) and not isinstance(error, _Unreadable):
            raise _Unreadable("is damaged (HDF5 cannot read all of it)") from error

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()


# -- files that are replaced whole, for other writers too --------------------------------------------------

KEPT = "the last good checkpoint is untouched"


def temporary_path(path: Path) -> Path:
    """A hidden name beside `path`, which `remove_stale_temporaries` finds again after a kill."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def remove_stale_temporaries(path: Path) -> None:
    """Remove what killed writers of `path` left behind; nothing happens where the folder is missing or
    read-only."""
    prefix = f".{path.name}."
    with suppress(OSError):
        for entry in list(path.parent.iterdir()):
            if entry.name.startswith(prefix) and entry.name.endswith(".tmp"):
                entry.unlink(missing_ok=True)


def replace_file(path: Path, content: bytes | bytearray) -> None:
    """Write `content` to `path`, which names the old file or the whole new one at every instant. Raises
    OSError."""
    remove_stale_temporaries(path)
    temporary = temporary_path(path)
    try:
        with open(temporary, "xb", buffering=0) as file:
            write_all(file, content)
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
    sync_folder(path.parent)


def write_all(file: FileIO, data: bytes | bytearray | memoryview) -> None:
    """Write all of `data` to an unbuffered file, which may take less than it is given. Raises OSError."""
    view = memoryview(data).cast("B")
    while len(view):
        view = view[file.write(view) :]


def sync_folder(folder: Path) -> None:
    """Put the names in `folder` on the disk, where the system can do that."""
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def cannot_write(what: str, path: Path, error: OSError, kept: str) -> InputError | RunStopped:
    """The error to raise for a refused write of `what` ("checkpoint", ...) to `path`; `kept` says what is
    still good."""
    why = error.strerror or str(error)
    if error.errno in (errno.ENOENT, errno.ENOTDIR, errno.EACCES, errno.EPERM, errno.EROFS, errno.EISDIR):
        return InputError(
            f"{what} {path} cannot be written ({why}); give a path in a folder that exists and is writable"
        )
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return RunStopped("disk_full", f"{what} {path} was not written because the disk is full ({why}); {kept}")
    return RunStopped("write_failed", f"{what} {path} was not written because the disk refused ({why}); {kept}")
