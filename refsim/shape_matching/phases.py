"""Phases of a particle, as the integer field `phase` holds them."""

FLUID, SURFACE, INTERIOR = range(3)  # liquid; solid with fewer than 3^dim direct neighbours; solid with all of them
EMPTY = -1  # empty slot of a table of nodes
