"""Limits of the background grid, and the mark of a block deep in it."""

FARTHEST = (1 << 20) - 16  # cells from the origin up to which there are blocks
DEEP = 2  # a block around which all blocks are complete
OUTSIDE, LOST = -1, -2  # cells of points in no block, and at no possible place
