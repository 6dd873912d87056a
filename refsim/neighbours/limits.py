"""Limits of the neighbour search."""

MOST_NEIGHBOURS = 4096  # a particle with more is inside a collapsed clump
