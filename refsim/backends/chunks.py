"""Rows in a fixed number of chunks: a sum over rows is taken chunk by chunk and does not depend on the threads."""

from refsim.backends.compile import formula

CHUNKS = 64


@formula
def limits(chunk: int, rows: int) -> tuple[int, int]:
    """First row of a chunk, and the end."""
    return chunk * rows // CHUNKS, (chunk + 1) * rows // CHUNKS
