"""Pictures in 2D by matplotlib: filled surfaces or discs."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Paint = Callable[[NDArray[np.float64]], NDArray[np.float64]]  # colours (k, 3) at places (k, 3)


def loops(facets: NDArray) -> list[NDArray[np.int64]]:
    """Vertices of the closed lines that segments (f, 2) make, each in order."""
    after = dict(zip(facets[:, 0].tolist(), facets[:, 1].tolist()))
    outlines = []
    while after:
        first, following = after.popitem()
        line = [first]
        while following != first and following in after:
            line.append(following)
            following = after.pop(following)
        outlines.append(np.array(line))
    return outlines


def add_discs(axes: Any, position: NDArray, radius: float, colour: NDArray) -> None:
    """Discs of one radius [m] at `position` (n, 3) in colours (n, 3)."""
    from matplotlib.collections import EllipseCollection

    width = np.full(len(position), 2.0 * radius)
    axes.add_collection(
        EllipseCollection(
            width, width, np.zeros(len(position)), units="xy", offsets=position[:, :2], facecolors=colour,
            edgecolors="none", offset_transform=axes.transData,
        )
    )  # fmt: skip


def add_area(axes: Any, points: NDArray, facets: NDArray, colour: NDArray | Paint, size: float) -> None:
    """The area inside of a surface in one colour (3,), or with a cell each `size` in the colours of its places."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    if not len(facets):
        return
    place = np.asarray(points, dtype=float)[:, :2]
    path = Path.make_compound_path(*(Path(place[np.append(line, line[0])], closed=True) for line in loops(facets)))
    if not callable(colour):
        axes.add_artist(PathPatch(path, facecolor=colour, edgecolor="none"))
        return
    low, high = place.min(0) - size, place.max(0) + size
    counts = np.minimum(np.ceil((high - low) / size), 1200).astype(int)
    x, y = (low[k] + (np.arange(counts[k]) + 0.5) * (high[k] - low[k]) / counts[k] for k in range(2))
    cells = np.zeros((counts[1], counts[0], 3))
    cells[..., 0], cells[..., 1] = np.meshgrid(x, y)
    image = colour(cells.reshape(-1, 3)).reshape(cells.shape).clip(0, 1)
    extent = low[0], high[0], low[1], high[1]
    shown = axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear", aspect="equal")
    shown.set_clip_path(path, axes.transData)


def add_line(axes: Any, points: NDArray, facets: NDArray, colour: ArrayLike, width: float) -> None:
    """The segments of a surface in one colour (3,)."""
    from matplotlib.collections import LineCollection

    ends = np.asarray(points, dtype=float)[:, :2][facets]
    axes.add_artist(LineCollection(ends, colors=[colour], linewidths=width, capstyle="round"))
