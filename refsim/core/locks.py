"""Locks of files between processes: a file beside the one that is locked, of which the system keeps account."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from filelock import FileLock


@contextlib.contextmanager
def in_turn(lock: Path, stays: bool = False) -> Iterator[None]:
    """Let one process after the other in; all, where the folder of `lock` cannot be written or has no locks.

    stays  whether the file of the lock does, too
    """
    from filelock import FileLock  # takes 20 ms

    held = FileLock(lock, thread_local=False)
    with contextlib.suppress(OSError, NotImplementedError):
        held.acquire()
    try:
        yield
    finally:
        if held.is_locked and not stays:
            unlock(held)
        held.release()


def unlock(lock: "FileLock") -> None:
    """Release the lock, and remove its file."""
    with contextlib.suppress(OSError):  # where a file in use cannot be removed, the next writer finds and takes it
        os.unlink(lock.lock_file)
    lock.release()
