"""Isosurfaces: corners and edges of a cell, polygons followed edge by edge, no table; crossings by linear values."""

import math

import numpy as np


def corner_places(dim):
    """Corner c = 4 z + 2 y + x of a cell stands at (x, y, z): (2^dim, 3), dimensionless."""
    return np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(2**dim)])


def cell_edges(dim):
    """Edges e = (lower corner, axis) of a cell, dimensionless."""
    return [(c, a) for a in range(dim) for c in range(2**dim) if not c >> a & 1]


def crossings(states, dim):
    """Bits 1 <- state_0 + state_a = 1 of the edges from a cell's lowest corner along each axis, dimensionless."""
    ends = states[:, [1, 2, 4][:dim]]
    cut = (ends + states[:, :1] == 1) & (ends < 2) & (states[:, :1] < 2)
    return (cut * 2 ** np.arange(dim)).sum(1)


def case(states):
    """case = sum_c state_c 2^c of a cell, 0 where a corner is unknown (2); dimensionless."""
    return np.where((states < 2).all(1), (states * 2 ** np.arange(states.shape[1])).sum(1), 0)


def joined(inside):
    """Groups = inside corners of a face that its rim joins, dimensionless numbers."""
    groups = []
    for c in inside:
        near = [g for g in groups if any((c ^ o).bit_count() == 1 for o in g)]
        groups = [g for g in groups if g not in near] + [sum(near, [c])]
    return groups


def segments(case, dim):
    """{e: f}, segments e -> f = the surface's on the faces of a cell, between cut edges; dimensionless numbers.

    On a square face a point on edge e is joined to the one on the other cut edge at e's inside corner's side: the
    segment from e separates e's inside corner, and those joined to it along the face's rim, from the others.
    """
    corner, ends = corner_places(dim), [{c, c | 1 << a} for c, a in cell_edges(dim)]
    place, arrows = [corner[list(pair)].mean(axis=0) for pair in ends], {}
    for axis, side in [(2, 0)] if dim == 2 else [(axis, side) for axis in range(3) for side in (0, 1)]:
        on_face = {c for c in range(2**dim) if c >> axis & 1 == side}
        inside = {c for c in on_face if case >> c & 1}
        for group in joined(inside):
            cut = [e for e, pair in enumerate(ends) if pair <= on_face and pair & set(group) and pair - inside]
            if cut:  # turned so that the group is on the right, as seen from outside; a plane's cell is a lowest face
                a, b = (place[e] for e in cut)
                right = np.cross(b - a, np.eye(3)[axis] * (2 * side - 1)) @ (corner[group].mean(axis=0) - a)
                arrows.update([cut if right >= 0 else cut[::-1]])
    return arrows


def polygons(case, dim):
    """Oriented polygons of one cell = tuples of edges (dimensionless), found by going from segment to segment."""
    arrows, outlines = segments(case, dim), []
    if dim == 2:
        return sorted(arrows.items(), key=lambda arrow: arrow[1])
    for start in sorted(arrows):
        if not any(start in loop for loop in outlines):
            loop = [start]
            while arrows[loop[-1]] != start:
                loop.append(arrows[loop[-1]])
            outlines.append(tuple(loop))
    return outlines


_FACETS = {}


def cell_facets(case, dim):
    """Facets of one cell = its polygons cut into triangles, computed once; dimensionless numbers of edges."""
    if (case, dim) not in _FACETS:
        loops = polygons(case, dim)
        _FACETS[case, dim] = loops if dim == 2 else [facet for loop in loops for facet in triangles(loop)]
    return _FACETS[case, dim]


def triangles(loop):
    """Triangles of a polygon: no diagonal lies in a face, and the sum_ of the diagonals' squares is least.

    Of equal ways the first when sorted; dimensionless numbers of edges, the lowest first.
    """
    rim = {frozenset((loop[k - 1], loop[k])) for k in range(len(loop))}

    def cost(way):
        sides = {frozenset((t[k - 1], t[k])) for t in way for k in range(3)} - rim
        turned = [t[t.index(min(t)) :] + t[: t.index(min(t))] for t in way]
        return sum(round(4 * math.dist(*(edge_middle(e) for e in side)) ** 2) for side in sides), sorted(turned)

    return min(map(cost, ways(loop)))[1]


def ways(loop):
    """All sets of triangles = a polygon cut by ears, without diagonals in a face; dimensionless numbers of edges."""
    if len(loop) == 3:
        return {frozenset([loop])}
    triangulations = set()
    for k in range(len(loop)):
        ear = (loop[k - 1], loop[k], loop[(k + 1) % len(loop)])
        if not (np.isin(2 * edge_middle(ear[0]), (0, 2)) & (edge_middle(ear[0]) == edge_middle(ear[2]))).any():
            triangulations |= {way | {ear} for way in ways(loop[:k] + loop[k + 1 :])}
    return triangulations


def edge_middle(e):
    """Middle = (c + c')/2 of a cell's edge in space, [cells]."""
    c, a = cell_edges(3)[e]
    return corner_places(3)[[c, c | 1 << a]].mean(axis=0)


def share(level, low, high):
    """t = (c - f_0)/(f_1 - f_0) with the values at the edge's ends, dimensionless."""
    return (level - low) / (high - low)


def crossing_point(h, j, way, t):
    """x = h (j + t e_a) [m]."""
    return h * (j + t * way)
