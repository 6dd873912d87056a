"""Every row is in one chunk."""

import pytest

from refsim.backends.chunks import CHUNKS, limits


@pytest.mark.parametrize("rows", [0, 1, CHUNKS - 1, CHUNKS, CHUNKS + 1, 1000])
def test_chunks_hold_every_row_once_and_are_as_long(rows):
    found = [range(*limits(chunk, rows)) for chunk in range(CHUNKS)]
    assert [i for chunk in found for i in chunk] == list(range(rows))
    assert max(map(len, found)) - min(map(len, found)) <= 1
