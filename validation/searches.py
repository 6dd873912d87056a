"""The neighbour list of a GPU held against the CPU's, entry by entry, and against all pairs in sampled rows."""

from __future__ import annotations

import numpy as np

from refsim import neighbours
from refsim.backends import arrays as backend
from refsim.backends import runtime

SUPPORT = 0.2  # m, twice the mean spacing


def compare(dim: int, dtype: str) -> list[tuple[str, int, int]]:
    """(what was counted, count, most allowed) for a random cloud with one particle far from all others.

    Products are fused differently on a GPU, so that in float32 a pair on the very edge may fall on either side.
    """
    count = 60 if runtime.simulated() else 20_000
    position = np.random.default_rng(dim).uniform(0, SUPPORT / 2 * count ** (1 / dim), (count, 3))
    position[:, dim:] = 0
    position[5] = [1e5, -1e5, 3e4 * (dim == 3)]
    position = position.astype(dtype)
    cuda = backend.choose("cuda")
    searches = []
    for _ in range(2):
        search = neighbours.NeighbourSearch(cuda, dim, dtype, SUPPORT)
        there = cuda.asarray(position)
        order = search.order(there)
        there = search.reorder(there, order)
        listed = search.build(there)
        counts, entries = cuda.host(listed.count), cuda.host(listed.entries).reshape(-1, count)
        searches.append((cuda.host(order), [entries[:n, i] for i, n in enumerate(counts)]))
    order, lists = searches[0]
    same = np.array_equal(order, searches[1][0]) and all(np.array_equal(a, b) for a, b in zip(lists, searches[1][1]))
    search.audit(there, cuda.zeros(position.shape, dtype), cuda.zeros(2, dtype), listed)
    search.build(there)  # the audit's result is read here
    rows = [("differences between two builds", int(not same), 0)]
    rows.append(("neighbours missed in sampled rows", search.log.missed_neighbours, 0))
    if not runtime.simulated():  # the CPU's search would run as Python there
        cpu = neighbours.NeighbourSearch(backend.choose("cpu"), dim, dtype, SUPPORT)
        their_order = cpu.order(position)
        theirs = cpu.build(np.ascontiguousarray(position[their_order]))
        rows_of = zip(lists, theirs.start, theirs.count)
        other = sum(not np.array_equal(own, theirs.entries[s : s + n]) for own, s, n in rows_of)
        rows.append(("particles in another order than on the CPU", int((order != their_order).sum()), 0))
        rows.append(("rows that differ from the CPU's", other, 10 if dtype == "float32" else 0))
    return rows
