"""Running sums on all threads of a CPU: sums of chunks, sums before each chunk, sums within chunks."""

from typing import Any

import numpy as np

from refsim.backends.chunks import CHUNKS, limits
from refsim.backends.compile import kernel


@kernel(rows_of="totals")
def sum_chunk(chunk: int, values: Any, totals: Any) -> None:
    """totals[chunk] = sum of the values of a chunk."""
    total = 0
    begin, end = limits(chunk, values.shape[0])
    for i in range(begin, end):
        total += int(values[i])
    totals[chunk] = total


@kernel(rows_of="before")
def write_chunk(chunk: int, values: Any, before: Any, sums: Any) -> None:
    """sums[i + 1] = values[0] + ... + values[i]; `before` each chunk."""
    total = before[chunk]
    begin, end = limits(chunk, values.shape[0])
    for i in range(begin, end):
        total += int(values[i])
        sums[i + 1] = total


def running_sum(values: np.ndarray) -> np.ndarray:
    """(n + 1,) int32: sum of the integers that stand before each place, and of all at the end."""
    totals, sums = np.empty(CHUNKS, np.int32), np.empty(len(values) + 1, np.int32)
    sum_chunk(values, totals)
    write_chunk(values, np.cumsum(totals, dtype=np.int32) - totals, sums)
    sums[0] = 0
    return sums
