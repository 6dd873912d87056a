"""Appends to a particle file as transactions, and the digest that tells a damaged one.

HDF5 alone can lose the whole file when its writer dies in the middle of an append, so each append is a transaction:
HDF5 works on the file as if it were written to, while its writes are held in memory; then what lies behind the old end
goes to the disk, where no reader looks yet, and then the few pages that change inside the old file, first into a
journal beside it and then into place, the page with the number of steps last. On the disk there is at every other
instant a closed HDF5 file.

HDF5 can crash on a damaged file, so a digest is compared before HDF5 opens it. The file begins with a page of 4096
bytes that HDF5 and its readers pass over (a user block): lines of text padded with zero bytes, `refsim particles`,
`version`, `bytes` (of the file; what lies behind them was left by a stopped append) and `digest`. The digest is the sum
modulo 2^256 of BLAKE2b (32 bytes, little-endian, salted with the page's number) over all other pages of 4096 bytes, so
that an append hashes only what it changes. The head changes in the same transaction as the other pages.
"""

import errno
import hashlib
import io
import os
import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import suppress
from io import BufferedReader, FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from refsim.core.errors import InputError
from refsim.core.locks import unlock
from refsim.core.reading import open_regular
from refsim.core.writing import write_all

if TYPE_CHECKING:
    from filelock import FileLock


PAGE = 4096  # a page is written whole even by a process that is being killed


HEAD = re.compile(rb"refsim particles\nversion 1\nbytes (\d{1,19})\ndigest ([0-9a-f]{64})\n\0*")
ADVICE = "give another path, or move the file away (a resumed run then begins a new one)"


def _head(size: int, digest: int) -> bytes:
    """The first page of a file of `size` bytes."""
    return f"refsim particles\nversion 1\nbytes {size}\ndigest {digest:064x}\n".encode().ljust(PAGE, b"\0")


def _page_digest(number: int, page: bytes | memoryview) -> int:
    """What a page adds to the digest; the head and pages that are not there add nothing."""
    if number == 0 or not page:
        return 0
    return int.from_bytes(hashlib.blake2b(page, digest_size=32, salt=number.to_bytes(16, "little")).digest(), "little")


def _stated(file: FileIO | BufferedReader, head: bytes = b"") -> tuple[int, int]:
    """(bytes, digest) in `head`, or else in the first page of the file. Raises InputError."""
    if not head:
        file.seek(0)
        head = file.read(PAGE)
    found = HEAD.fullmatch(head)
    size = int(found[1]) if found else 0
    if found and len(head) == PAGE and size <= os.fstat(file.fileno()).st_size:
        return size, int(found[2], 16)
    if found:
        why = "is cut short"
    elif head.startswith(b"\x89HDF\r\n\x1a\n"):
        why = "is an HDF5 file without the digest that particle files begin with (refsim 0.1.0 wrote such files)"
    else:
        why = "is damaged, or not a particle file of refsim (it does not begin as one)"
    raise InputError(f"particle file {file.name} {why}; {ADVICE}")


def _check(file: FileIO | BufferedReader, pages: Mapping[int, bytes]) -> None:
    """Compare the digest of the file, as it will be with `pages` (by offset) in place. Raises InputError."""
    size, digest = _stated(file, pages.get(0, b""))
    total = 0
    file.seek(PAGE)
    for offset in range(PAGE, size, PAGE):
        page, new = file.read(PAGE), pages.get(offset, b"")
        total += _page_digest(offset // PAGE, (new + page[len(new) :])[: size - offset])
    if total % 2**256 != digest:
        raise InputError(f"particle file {file.name} is damaged (it does not match its digest); {ADVICE}")


def check_path(path: Path) -> None:
    """Complete the last transaction on `path` unless its writer lives, and compare the digest. Raises InputError."""
    pages: dict[int, bytes] = {}
    try:
        with suppress(OSError), open(journal_path(path), "r+b", buffering=0) as journal:
            pages = _journalled(journal)[1]  # which a living writer is putting in place
            lock = _lock(journal_path(path))
            try:
                with open(path, "r+b", buffering=0) as file:
                    return recover(file, journal)
            finally:
                unlock(lock)
        with open_regular(path) as file:
            return _check(file, pages)
    except FileNotFoundError:
        raise InputError(f"particle file {path} does not exist; give a file that refsim wrote") from None
    except OSError as error:
        raise InputError(f"particle file {path} cannot be read ({error.strerror}); {ADVICE}") from error


JOURNAL_MAGIC = b"refsimJ1"


class Staged(io.RawIOBase):
    """A file for h5py to work on: reads see the file below, writes stay in memory, page by page, until `commit`."""

    def __init__(self, file: FileIO | None) -> None:
        self._file = file
        self._base, self._digest = _stated(file) if file else (0, 0)  # bytes of the file below, and its digest
        self._size = self._base
        self._pages: dict[int, bytearray] = {}  # changed pages, by number
        self._position = 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._position = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence] + offset
        return self._position

    def truncate(self, size: int | None = None) -> int:
        assert size is not None  # HDF5 names it
        self._size = size
        self._pages = {number: page for number, page in self._pages.items() if number * PAGE < size}
        return size

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer).cast("B")
        for number, inside, place in self._parts(len(view)):
            page = self._pages.get(number) or self._page_below(number)
            view[place] = bytes(page[inside]).ljust(place.stop - place.start, b"\0")
        self._position += len(view)
        return len(view)

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        for number, inside, place in self._parts(len(view)):
            if number not in self._pages:
                self._pages[number] = bytearray(self._page_below(number).ljust(PAGE, b"\0"))
            self._pages[number][inside] = view[place]
        self._position += len(view)
        self._size = max(self._size, self._position)
        return len(view)

    def _parts(self, length: int) -> Iterator[tuple[int, slice, slice]]:
        """(number of the page, bytes of it, their place in the data) of data of this length at the present position."""
        start, end = self._position, self._position + length
        for number in range(start // PAGE, -(-end // PAGE)):
            first, last = max(start, number * PAGE), min(end, (number + 1) * PAGE)
            yield number, slice(first - number * PAGE, last - number * PAGE), slice(first - start, last - start)

    def _page_below(self, number: int) -> bytes:
        """A page of the file below; empty behind its end."""
        if self._file is None or number * PAGE >= self._base:
            return b""
        self._file.seek(number * PAGE)
        return self._file.read(min(PAGE, self._base - number * PAGE))

    def _page(self, number: int) -> bytes:
        """A page as it is now, as long as the file reaches."""
        page = bytes(self._pages.get(number) or self._page_below(number))
        return page.ljust(PAGE, b"\0")[: max(self._size - number * PAGE, 0)]

    @property
    def tail(self) -> bytes:
        """What lies behind the end of the file below: all of a new file."""
        first = self._base // PAGE
        return b"".join(map(self._page, range(first, -(-self._size // PAGE))))[self._base - first * PAGE :]

    def seal(self) -> None:
        """Write the head, with the digest of what the file now holds."""
        digest, end = self._digest, max(self._base, self._size)
        for number in {*self._pages, *range(min(self._base, self._size) // PAGE, -(-end // PAGE))}:
            digest += _page_digest(number, self._page(number)) - _page_digest(number, self._page_below(number))
        self.seek(0)
        self.write(memoryview(_head(self._size, digest % 2**256)))

    def commit(self, journal: FileIO, last: int) -> None:
        """Put the writes into the file, the page that holds the byte `last` after all others.

        On an OSError the file is as before, or, when the disk refuses even to change what it already holds,
        the journal has what is missing.
        """
        assert self._file is not None
        pages = []
        for number in sorted(self._pages, key=lambda number: (number in (last // PAGE, last // PAGE + 1), number)):
            below = self._page_below(number)
            if below and (page := self._page(number)[: len(below)]) != below:
                pages.append((number * PAGE, page))
        try:
            if tail := self.tail:
                self._file.seek(self._base)
                write_all(self._file, tail)
                os.fsync(self._file.fileno())
            body = struct.pack("<QQ", self._size, len(pages))
            body += b"".join(struct.pack("<QQ", offset, len(page)) + page for offset, page in pages)
            write_all(journal, JOURNAL_MAGIC + body + hashlib.sha256(body).digest())
            os.fsync(journal.fileno())
        except OSError:
            with suppress(OSError):
                journal.truncate(0)
            with suppress(OSError):
                self._file.truncate(self._base)
            raise
        _apply(self._file, self._size, pages)
        journal.truncate(0)


def _apply(file: FileIO, size: int, pages: list[tuple[int, bytes]]) -> None:
    for offset, page in pages:
        file.seek(offset)
        write_all(file, page)
    if size < os.fstat(file.fileno()).st_size:
        file.truncate(size)
    os.fsync(file.fileno())


def journal_path(path: Path) -> Path:
    return path.with_name(f"{path.name}.journal")


def locked_journal(path: Path) -> "tuple[FileIO, FileLock]":
    """The journal at `path` and its lock. Raises OSError, BlockingIOError where another writer holds it."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "its journal is a pipe or a device, and not a file", str(path))
    os.stat(f"{path.parent}{os.sep}")  # the lock would make the folder
    lock = _lock(path)
    try:
        return open(path, "a+b", buffering=0), lock
    except BaseException:
        unlock(lock)
        raise


def _lock(journal: Path) -> "FileLock":
    """The lock that a living writer holds for its journal, taken: a file beside it, of which the system keeps account.

    Raises BlockingIOError where another process holds it, OSError where it cannot be written.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(f"{journal}.lock", blocking=False, thread_local=False)
    try:
        lock.acquire()
    except Timeout:
        raise BlockingIOError(errno.EAGAIN, "locked", str(journal)) from None
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.ENOTSUP):  # a file system without locks
            raise
    return lock


def _journalled(journal: FileIO) -> tuple[int, dict[int, bytes]]:
    """(size of the file, pages by offset in the order of writing) of the transaction in `journal`; no pages where none
    is whole."""
    journal.seek(0)
    entry = journal.read()
    body, digest = entry[len(JOURNAL_MAGIC) : -32], entry[-32:]
    if not entry.startswith(JOURNAL_MAGIC) or hashlib.sha256(body).digest() != digest:
        return 0, {}
    size, count = struct.unpack_from("<QQ", body)
    pages, at = {}, 16
    for _ in range(count):
        offset, length = struct.unpack_from("<QQ", body, at)
        pages[offset] = body[at + 16 : at + 16 + length]
        at += 16 + length
    return size, pages


def recover(file: FileIO, journal: FileIO) -> None:
    """Compare the digest, complete the transaction in `journal`, if there is a whole one, and empty it.

    Raises OSError, InputError where the file does not match its digest; both files are then as before.
    """
    size, pages = _journalled(journal)
    _check(file, pages)
    if pages:
        _apply(file, size, list(pages.items()))
    journal.truncate(0)
