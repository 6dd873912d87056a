"""Files of the compile cache: checked before their machine code is run, and in a folder that only its user writes to.

Numba unpickles what it finds in its cache and runs it. Each file of refsim's cache therefore ends with a SHA-256 over
its name and its content. A file that does not match is deleted and its kernel is compiled anew; a warning says so once
in a process. The digest detects damage; the check of the folder's owner and rights protects against other users.
"""

import contextlib
import functools
import hashlib
import io
import itertools
import os
import stat
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from refsim.backends.fast.private import names
from refsim.core.errors import InputError

DIGEST_BYTES = 32
_told: set[str] = set()  # kinds of warnings that this process has given


def refuse_foreign(folder: Path) -> None:
    """Raise InputError if another user owns a folder of the cache, or every user may write to it."""
    try:
        about = os.stat(folder)
    except OSError:
        return  # an absent folder holds no code
    if about.st_uid != os.geteuid():
        why = f"belongs to another user (number {about.st_uid})"
    elif about.st_mode & stat.S_IWOTH:
        why = "can be written to by every user"
    else:
        return
    raise InputError(
        f"the compile cache {folder} {why}, who could place code there that refsim would run; set REFSIM_CACHE_DIR to a"
        " folder that only you can write to, or correct the folder's owner and rights."
    )


def is_shared(folder: Path) -> bool:
    """Whether the group of a folder of the cache, but not every user, may write to it; a warning says so once."""
    try:
        mode = os.stat(folder).st_mode
    except OSError:
        return False
    shared = bool(mode & stat.S_IWGRP) and not mode & stat.S_IWOTH
    if shared:
        tell_once(
            "shared",
            f"the compile cache {folder} is not used, because its group can write to it and could place code there that"
            f" refsim would run; run `chmod g-w {folder}`, or set REFSIM_CACHE_DIR to a folder that only you can write"
            " to.",
        )
    return shared


def check_files(cache: Any) -> None:
    """Let Numba's `cache` of one kernel check what it reads, and go on without what it cannot write."""
    files = cache._cache_file
    files.__class__ = _checked_kind(files.__class__)
    save = cache.save_overload

    def save_if_possible(signature: Any, compiled: Any) -> None:
        try:
            save(signature, compiled)
        except OSError as error:
            tell_once(
                "unwritable",
                f"the compile cache {cache.cache_path} cannot be written ({error.strerror or error}); the next run"
                " compiles these kernels again.",
            )

    cache.save_overload = save_if_possible


def is_stored(dispatcher: Any, signature: Any) -> bool:
    """Whether the cache holds whole code of a kernel for a signature and this processor."""
    if names("cache") is None:
        return False
    cache = dispatcher._cache
    name = cache._cache_file._load_index().get(cache._index_key(signature, dispatcher.targetctx.codegen()))
    return name is not None and _is_whole(cache._cache_file._data_path(name))


class _Checked:
    """What differs from Numba's IndexDataCacheFile."""

    def save(self, key: Any, data: Any) -> None:
        """Store the code before the index names it, so that a kill between both leaves no index of other code."""
        index = self._load_index()
        taken = set(index.values())
        free = (name for name in map(self._data_name, itertools.count(1)) if name not in taken)
        name = index.get(key) or next(free)
        self._save_data(name, data)
        self._save_index({**index, key: name})

    def _load_index(self) -> dict[Any, str]:
        return super()._load_index() if _is_whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if not _is_whole(path):
            raise FileNotFoundError(path)  # Numba then compiles
        return super()._load_data(name)

    @contextlib.contextmanager
    def _open_for_write(self, path: str) -> Iterator[io.BytesIO]:
        with super()._open_for_write(path) as file:
            content = io.BytesIO()
            yield content
            file.write(content.getvalue() + _digest(path, content.getvalue()))


@functools.cache
def _checked_kind(kind: type) -> type:
    """Numba's class for the files of a cache (the CPU's or CUDA's) with the checks."""
    return type(f"Checked{kind.__name__}", (_Checked, kind), {})


def _digest(path: str, content: bytes) -> bytes:
    return hashlib.sha256(os.path.basename(path).encode() + b"\0" + content).digest()


def _is_whole(path: str) -> bool:
    """Whether the file is there and matches its digest; a damaged one is deleted."""
    try:
        if stat.S_ISREG(os.stat(path).st_mode):
            content = Path(path).read_bytes()
            if _digest(path, content[:-DIGEST_BYTES]) == content[-DIGEST_BYTES:]:
                return True
    except FileNotFoundError:
        return False
    except OSError:
        pass  # an unreadable file is treated as damaged
    with contextlib.suppress(OSError):
        os.unlink(path)
    tell_once(
        "damaged", f"the compile cache was damaged ({path}); damaged files are deleted, their kernels compiled again."
    )
    return False


def tell_once(kind: str, sentence: str) -> None:
    """Warn once in a process of what is of this kind."""
    if kind not in _told:
        _told.add(kind)
        warnings.warn(sentence, stacklevel=2)
