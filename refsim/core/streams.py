"""Standard output and standard error in any encoding."""

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress


@contextmanager
def any_letter() -> Iterator[None]:
    """Inside, a letter that a standard stream's encoding lacks is written as its number: \\xe4, \\u03c1."""
    streams = [s for s in (sys.stdout, sys.stderr) if isinstance(s, io.TextIOWrapper)]
    before = [s.errors for s in streams]
    for stream in streams:
        stream.reconfigure(errors="backslashreplace")
    try:
        yield
    finally:
        for stream, errors in zip(streams, before):
            with suppress(OSError, ValueError):  # what is left cannot be written, or the stream is closed
                stream.reconfigure(errors=errors)
