"""Blocks, and points by cell, in NumPy: for small runs of the references."""

from typing import Any

import numpy as np

from refsim.core.errors import RunStopped
from refsim.sparse_grid.reference import Lookup, covering
from refsim.sparse_grid.tables import Blocks, PointList, blocks_of, keys_at

FARTHEST = (1 << 20) - 16  # cells from the origin up to which there are blocks


class BlockSearch:
    """As `block_search.BlockSearch`, with no blocks but those of the nodes that are asked for."""

    def __init__(self, dim: int, inverse_cell: float) -> None:
        self.dim, self.inverse_cell = dim, inverse_cell
        self.width = np.array([4, 4, 4] if dim == 3 else [8, 8, 1])

    def cover(self, position: np.ndarray, below: int, above: int) -> Blocks:
        if not (np.abs(position) * self.inverse_cell < FARTHEST).all():
            raise RunStopped(
                "out_of_grid",
                f"A particle left the background grid, which ends {FARTHEST} cells from the origin, or is at no finite"
                " place: take a smaller step, or put walls around the liquid.",
            )
        node = covering(position, 1 / self.inverse_cell, self.dim, below, above)
        return blocks_of(np.unique(keys_at(node // self.width)), self.dim)

    def cell_of(self, position: np.ndarray, blocks: Blocks, shift: float) -> Any:
        coordinates = np.floor(np.asarray(position, dtype=float) * self.inverse_cell - shift).astype(int)
        coordinates[:, self.dim :] = 0
        return Lookup(blocks)(coordinates).astype(np.int32)

    def by_cell(self, position: np.ndarray, blocks: Blocks, shift: float) -> PointList:
        cell = self.cell_of(position, blocks, shift)
        order = np.argsort(cell, kind="stable")
        order = order[cell[order] >= 0]
        return PointList(np.searchsorted(cell[order], np.arange(64 * len(blocks.keys) + 1)), order, cell)
