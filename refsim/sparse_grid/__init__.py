"""The background grid near points only: blocks of 64 nodes in a table of sorted keys, and points by cell.

Memory follows what is covered, not the domain. Reference: `refsim.sparse_grid.reference`.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from refsim.backends.arrays import Backend
from refsim.sparse_grid.tables import Blocks as Blocks
from refsim.sparse_grid.tables import PointList as PointList


@dataclass
class SparseGrid:
    """Makes blocks and lists of points on a backend; nodes stand at h j, j integer, h = `cell_size` [m]."""

    backend: Backend
    dim: int
    dtype: str
    cell_size: float

    def __post_init__(self) -> None:
        if self.backend.name == "cuda":
            from refsim.sparse_grid import block_search_cuda as programs
        elif self.backend.name == "cpu":
            from refsim.sparse_grid import block_search as programs  # type: ignore[no-redef]
        else:
            from refsim.sparse_grid import block_search_numpy as programs  # type: ignore[no-redef]
        self.programs: Any = programs.BlockSearch(self.dim, inverse_cell(self.cell_size, self.dtype))

    def cover(self, position: Any, below: int, above: int) -> Blocks:
        """Blocks that hold every node from `below` under to `above` over the cell of each position (n, 3) [m]."""
        return self.programs.cover(position, below, above)

    def by_cell(self, position: Any, blocks: Blocks, shift: float = 0.0) -> PointList:
        """The points (n, 3) [m] of each cell j = floor(x/h - shift); those outside all blocks are left out."""
        return self.programs.by_cell(position, blocks, shift)

    def cells_alone(self, position: Any, blocks: Blocks, shift: float = 0.0) -> PointList:
        """The cell of each point, as a list without valid rows: it saves the sorting, which takes most of the time."""
        cell = self.programs.cell_of(position, blocks, shift)
        return PointList(cell, cell, cell)


def inverse_cell(cell_size: float, dtype: str) -> float:
    """1/h [1/m] in float64 for h as rounded to the dtype."""
    return 1.0 / float(np.dtype(dtype).type(cell_size))


def nodes(blocks: Blocks) -> int:
    """Number of nodes."""
    return 64 * blocks.keys.shape[0]
