"""Which facets a cell has in each state of its corners: 16 cases in the plane, 256 in space, made by tracing.

Corner c of a cell stands at its bits (x = c & 1, y = c >> 1 & 1, z = c >> 2); a state has bit c set where corner c
is inside. Inside corners that are diagonal on a face are always separated, in both cells that share the face: cells
agree with their neighbours, and the surface is closed. The classical table merges states with their complements; the
two cells of such a face may disagree and leave a hole.
"""

import functools
import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

Loop = tuple[int, ...]
Facet = tuple[int, ...]


class CaseTable(NamedTuple):
    """Facets of a cell in each state of its corners, as kernels take them."""

    count: np.ndarray  # type: ignore[assignment]  # (states,) uint8, number of facets
    edge: np.ndarray  # (states, dim * most) int8, edges whose points are the facets' corners, -1 for none
    corner: np.ndarray  # (edges, 4) int8, lower corner (x, y, z) and axis of each edge
    merged: np.int32  # 1 for the classical table


def edges(dim: int) -> list[tuple[int, int]]:
    """(lower corner, axis) of the 4 or 12 edges of a cell."""
    return [(c, a) for a in range(dim) for c in range(2**dim) if not c >> a & 1]


@functools.cache
def faces(dim: int) -> list[tuple[int, ...]]:
    """Corners of each face of a cell, counter-clockwise as seen from outside; the square itself in 2D."""
    if dim == 2:
        return [(0, 1, 3, 2)]
    corners = []
    for axis, side in itertools.product(range(3), (0, 1)):
        u, v = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        ring = (0, u, u | v, v) if side else (0, v, u | v, u)
        corners.append(tuple(c | side << axis for c in ring))
    return corners


def loops(state: int, dim: int) -> list[Loop]:
    """Closed loops of cut edges of a cell, counter-clockwise from outside; in the plane segments, the inside left."""
    number = {frozenset((c, c | 1 << a)): e for e, (c, a) in enumerate(edges(dim))}
    follows: dict[int, int] = {}
    for ring in faces(dim):
        inside = [state >> c & 1 for c in ring]
        size = len(ring)
        for k in range(size):
            if inside[k] and not inside[k - 1]:  # the first of a run of inside corners
                end = k
                while inside[(end + 1) % size]:
                    end += 1
                into = number[frozenset((ring[k - 1], ring[k]))]
                out = number[frozenset((ring[end % size], ring[(end + 1) % size]))]
                follows[into] = out
    if dim == 2:
        return [(out, into) for into, out in sorted(follows.items())]
    polygons = []
    while follows:
        loop = [min(follows)]
        while loop[-1] in follows:
            loop.append(follows.pop(loop[-1]))
        polygons.append(tuple(loop[:-1]))
    return polygons


def triangulations(loop: Loop) -> Iterator[tuple[Facet, ...]]:
    """All triangulations of a polygon along its diagonals."""
    if len(loop) < 3:
        yield ()
        return
    first, last = loop[0], loop[-1]
    for k in range(1, len(loop) - 1):
        for left, right in itertools.product(triangulations(loop[: k + 1]), triangulations(loop[k:])):
            yield ((first, loop[k], last), *left, *right)


@functools.cache
def triangulated(loop: Loop) -> tuple[Facet, ...]:
    """The triangulation of a loop without a diagonal in a face of the cell, where the adjacent cell might have the same
    one; of several that with the least sum of squares of the diagonals between midpoints of edges; then the first."""
    ends = [{c, c | 1 << a} for c, a in edges(3)]
    middle = [[sum(c >> b & 1 for c in pair) for b in range(3)] for pair in ends]  # in halves of the cell size
    best = None
    sides = {frozenset(pair) for pair in zip(loop, loop[1:] + loop[:1], strict=True)}
    for way in triangulations(loop):
        diagonals = {frozenset(p) for t in way for p in itertools.combinations(t, 2)} - sides
        if any(ends[e] | ends[f] <= set(ring) for e, f in diagonals for ring in faces(3)):
            continue
        cost = sum(sum((x - y) ** 2 for x, y in zip(*(middle[e] for e in d), strict=True)) for d in diagonals)
        turned = sorted(t[t.index(min(t)) :] + t[: t.index(min(t))] for t in way)
        best = min(best or (cost, turned), (cost, turned))
    if best is None:
        raise ValueError(f"every triangulation of the loop {loop} has a diagonal in a face")
    return tuple(best[1])


def facets(state: int, dim: int) -> list[Facet]:
    """Facets of a cell in this state, as tuples of edges."""
    outlines = loops(state, dim)
    return outlines if dim == 2 else [facet for loop in outlines for facet in triangulated(loop)]


@functools.cache
def case_table(dim: int, merged: bool = False) -> CaseTable:
    """The table of all states.

    merged  True for the classical table, in which states of more than half the corners are those of their complement
            with reversed facets: 15 cases, with holes
    """
    states = 2 ** (2**dim)
    rows = []
    for state in range(states):
        if merged and state.bit_count() > 2 ** (dim - 1):
            rows.append([facet[::-1] for facet in facets(states - 1 - state, dim)])
        else:
            rows.append(facets(state, dim))
    most = max(map(len, rows))
    edge = np.full((states, dim * most), -1, np.int8)
    for state, row in enumerate(rows):
        edge[state, : dim * len(row)] = [e for facet in row for e in facet]
    corner = np.array([[c & 1, c >> 1 & 1, c >> 2, a] for c, a in edges(dim)], np.int8)
    return CaseTable(np.array([len(row) for row in rows], np.uint8), edge, corner, np.int32(merged))
