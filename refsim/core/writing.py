"""Files that are written whole or not at all, or by one process after the other; results as plain values."""

import errno
import io
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim.core.errors import NO_SPACE, InputError, RunStopped

Content = bytes | bytearray | memoryview
BAD_PATH = (
    errno.ENOENT, errno.ENOTDIR, errno.EACCES, errno.EPERM, errno.EROFS, errno.EISDIR, errno.EEXIST, errno.ELOOP,
    errno.ENAMETOOLONG, errno.EINVAL,
)  # fmt: skip


@contextmanager
def writing(what: str, path: Path, kept: str) -> Iterator[None]:
    """Raise the error for a refused write of `what` ("checkpoint", ...) to `path`; `kept` says what is still good.

    InputError for a bad path; RunStopped "disk_full" where there is no space, "write_failed" for other reasons.
    """
    try:
        yield
    except OSError as error:
        why = error.strerror or str(error)
        if error.errno in BAD_PATH:
            raise InputError(
                f"{what} {path} cannot be written ({why}); give a path in a folder that exists and is writable"
            ) from error
        full = error.errno in NO_SPACE
        because = "the disk is full" if full else "the disk refused"
        raise RunStopped(
            "disk_full" if full else "write_failed", f"{what} {path} was not written because {because} ({why}); {kept}"
        ) from error


def write_file(
    path: str | os.PathLike[str], content: str | Content, what: str = "file", kept: str = "what was there is untouched"
) -> None:
    """Write a file of text (UTF-8) or bytes: `path` names the old one or the whole new one at every instant.

    what, kept  as `writing` takes them

    A symbolic link at `path` is replaced and not followed. Raises InputError for a bad path, RunStopped where the disk
    refuses.
    """
    with writing(what, Path(path), kept):
        replace_file(Path(path), content.encode() if isinstance(content, str) else content)


def made_by(save: Callable[..., object], *given: Any, **named: Any) -> bytes:
    """What `save(file, *given, **named)` writes: `made_by(numpy.savez, x=x)`."""
    file = io.BytesIO()
    save(file, *given, **named)
    return file.getvalue()


def write_once(path: Path, content: Content) -> None:
    """Write a file unless it is there already; it is not forced onto the disk. Raises OSError."""
    if not path.exists():
        with _beside([path]) as (draft,):
            draft.write_bytes(content)
            os.replace(draft, path)


def output_path(given: str | os.PathLike[str], what: str, *endings: str) -> Path:
    """The path of a file to write. Raises InputError for a name without one of the `endings`, and without its folder.

    what  the file is ("picture")
    """
    path, (*others, last) = Path(given), endings or ("",)
    if endings and path.suffix not in endings:
        named = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"{os.fspath(given)!r} is no {what}; give a name that ends in {named}.")
    if not path.parent.is_dir():
        raise InputError(f"there is no folder {str(path.parent)!r} for the {what}; make it.")
    return path


def remove_stale_temporaries(folder: Path, name: str = "") -> None:
    """Remove what killed writers of a file of this name, or of any, left in a folder, if it is there and writable."""
    prefix = f".{name}." if name else "."
    with suppress(OSError):
        for entry in list(folder.iterdir()):
            if entry.name.startswith(prefix) and entry.name.endswith(".tmp") and not _is_written(entry.name):
                entry.unlink(missing_ok=True)


def _is_written(temporary: str) -> bool:
    """Whether another process, whose number is in the name, still writes the temporary file."""
    number = re.search(r"\.(\d+)\.(?:old\.)?tmp$", temporary)
    if number is None or int(number[1]) == os.getpid():
        return False
    try:
        os.kill(int(number[1]), 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


Renaming = Callable[[Path, Path], object]  # of a whole new file, beside its place, to that place


def replace_file(path: Path, content: Content, tidy: bool = True, put: Renaming | None = None) -> None:
    """Write `content` to `path`, which names the old file or the whole new one at every instant.

    tidy  whether to remove what killed writers left, for which the folder is listed
    put   by default `os.replace`

    Raises OSError.
    """
    if tidy:
        remove_stale_temporaries(path.parent, path.name)
    replace_files({path: content}, put=put)


def replace_files(
    files: Mapping[Path, Content], before: Callable[[], object] = lambda: None, put: Renaming | None = None
) -> None:
    """Write files of one folder as `replace_file` does; none is changed before all are on the disk.

    before  is called then, before the first gets its name

    Raises OSError.
    """
    with _beside(files) as temporaries:
        for temporary, content in zip(temporaries, files.values()):
            with open(temporary, "xb", buffering=0) as file:
                write_all(file, content)
                os.fsync(file.fileno())
        before()
        for temporary, path in zip(temporaries, files):
            (put or os.replace)(temporary, path)
    sync_folder(next(iter(files)).parent)


@contextmanager
def replaced_at_the_end(path: Path) -> Iterator[Path]:
    """A new file that another program writes in the block; then `path` names it, as of `replace_file`."""
    remove_stale_temporaries(path.parent, path.name)
    with _beside([path]) as (temporary,):
        temporary.touch(exist_ok=False)
        yield temporary
        with open(temporary, "rb") as file:
            os.fsync(file.fileno())
        os.replace(temporary, path)
    sync_folder(path.parent)


@contextmanager
def _beside(paths: Iterable[Path]) -> Iterator[list[Path]]:
    """Hidden names beside files to be replaced, found again after a kill; what is there at the end is removed."""
    temporaries = [path.with_name(f".{path.name}.{os.getpid()}.tmp") for path in paths]
    try:
        yield temporaries
    finally:
        for temporary in temporaries:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def write_all(file: Any, data: Content) -> None:
    """Write all of `data` to an unbuffered file, which may take less than it is given. Raises OSError."""
    view = memoryview(data).cast("B")
    while len(view):
        view = view[file.write(view) :]


def sync_folder(folder: Path) -> None:
    """Put the names in `folder` on the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def plain(value: Any) -> Any:
    """`value` with only what strict JSON has: NaN and infinities become their names."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, msgspec.Struct):
        return plain(msgspec.structs.asdict(value))
    return value


@contextmanager
def in_turn(lock: Path, stays: bool = False) -> Iterator[None]:
    """Let one process after the other in; all, where the folder of `lock` cannot be written or has no locks.

    lock   a file beside the one that is locked
    stays  whether it does
    """
    from filelock import FileLock  # takes 20 ms

    held = FileLock(lock, thread_local=False)
    with suppress(OSError, NotImplementedError):
        held.acquire()
    try:
        yield
    finally:
        if held.is_locked and not stays:
            unlock(held)
        held.release()


def unlock(lock: Any) -> None:
    """Release a lock of `filelock`, and remove its file."""
    with suppress(OSError):  # where a file in use cannot be removed, the next writer finds and takes it
        os.unlink(lock.lock_file)
    lock.release()
