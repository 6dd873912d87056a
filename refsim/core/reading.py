"""Opening a file that is only read: a pipe or a device, which may never end, is refused instead of waited for."""

import errno
import os
import stat
from io import BufferedReader

GREATEST = 1e30  # largest magnitude, in SI units, that a number from a file may have: its powers stay in float64
LONGEST = 1e12  # [m] largest length or coordinate


def open_regular(path: str | os.PathLike[str]) -> BufferedReader:
    """The regular file at `path`, open for reading bytes.

    Raises OSError, whose `strerror` says why, also for a folder, a pipe, a device and a name that no file can have.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except ValueError as error:  # a zero byte, or a character that the file system cannot write
        raise OSError(errno.EINVAL, "no file can have this name", str(path)) from error
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        raise OSError(errno.EINVAL, "it is a pipe or a device, and not a file", str(path))
    return open(path, "rb", opener=lambda *_: descriptor)  # its name is the path
