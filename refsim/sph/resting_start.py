"""How deep the particles of liquid at rest lie below its surface, from their places alone."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from refsim.scene.overlaps import connected

TOUCH = 1.25  # spacings up to which particles of different parts touch
BESIDE = 0.55  # spacings across the pull up to which particles stand above each other


def depths(
    parts: Sequence[np.ndarray], spacing: float, down: np.ndarray, stands: Callable[[np.ndarray], bool],
    covered: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:  # fmt: skip
    """Depths (n,) [m] of the particles of all parts, half a spacing at the surface; 0 in liquid that does not stand.

    parts    places (n, 3) [m] of each
    down     unit vector of the pull
    stands   whether liquid at such places touches a wall below it
    covered  which of the places (n, 3) [m] solids and meshes fill

    A part alone lies below its highest particle. Parts that touch are one liquid, whose columns along the pull have a
    surface each; where something covers a column, the surface is that of the columns beside it.
    """
    deep = [np.zeros(len(x)) for x in parts]
    for group in _touching(parts, TOUCH * spacing):
        x = np.concatenate([parts[k] for k in group])
        depth = x @ down
        surface, liquid = depth.min(), np.zeros(len(x), int)
        if len(group) > 1:
            surface, liquid = _surfaces(x, depth, spacing, down, covered)
        depth = depth - surface + 0.5 * spacing
        for number in range(liquid.max() + 1):
            if not stands(x[liquid == number]):
                depth[liquid == number] = 0.0
        for k, part in zip(group, np.split(depth, np.cumsum([len(parts[k]) for k in group])[:-1])):
            deep[k] = part
    return np.concatenate([np.zeros(0), *deep])


def _touching(parts: Sequence[np.ndarray], reach: float) -> Iterator[list[int]]:
    """Numbers of the parts whose boxes are at most `reach` [m] apart, group by group."""
    from scipy.sparse.csgraph import connected_components

    filled = [k for k, x in enumerate(parts) if len(x)]
    if filled:
        low, high = (np.array([bound(parts[k], 0) for k in filled]) for bound in (np.min, np.max))
        near = ((low[:, None] <= high + reach) & (low <= high[:, None] + reach)).all(2)
        count, group = connected_components(near, directed=False)
        yield from ([filled[k] for k in np.flatnonzero(group == number)] for number in range(count))


def _surfaces(
    x: np.ndarray, depth: np.ndarray, spacing: float, down: np.ndarray, covered: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """(depth (n,) [m] of the surface above each particle, number (n,) of the liquid that it belongs to)."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(x).query_pairs(TOUCH * spacing, output_type="ndarray")
    apart = x[pairs[:, 0]] - x[pairs[:, 1]]
    across = (apart**2).sum(1) - (apart @ down) ** 2
    above = pairs[across < (BESIDE * spacing) ** 2]
    liquid, column = (connected(len(x), *linked.T) for linked in (pairs, above))
    order = np.lexsort([depth, column])
    top = order[np.unique(column[order], return_index=True)[1]]  # of each column
    hidden = covered(x[top] - spacing * down)
    surface = np.where(hidden, np.inf, depth[top])
    beside = column[np.concatenate([pairs, pairs[:, ::-1]])]
    beside = np.unique(beside[hidden[beside[:, 0]] & (beside[:, 0] != beside[:, 1])], axis=0)
    before = np.zeros(0)
    while not np.array_equal(before, surface):
        before = surface.copy()
        np.minimum.at(surface, beside[:, 0], before[beside[:, 1]])
    highest = np.full(liquid.max() + 1, np.inf)
    np.minimum.at(highest, liquid, depth)
    return np.where(np.isinf(surface[column]), highest[liquid], surface[column]), liquid
