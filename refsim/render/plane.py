"""Pictures in 2D by matplotlib: filled surfaces or discs."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def loops(facets: NDArray) -> list[NDArray[np.int64]]:
    """Vertices of the closed lines that segments (f, 2) make, each in order."""
    after = dict(zip(facets[:, 0].tolist(), facets[:, 1].tolist()))
    found = []
    while after:
        first, following = after.popitem()
        line = [first]
        while following != first and following in after:
            line.append(following)
            following = after.pop(following)
        found.append(np.array(line))
    return found


def filled_path(points: ArrayLike, facets: NDArray) -> Any:
    """The area inside of segments (f, 2) between points (n, 3) [m] as a matplotlib path."""
    from matplotlib.path import Path

    place = np.asarray(points, dtype=float)[:, :2]
    corners, codes = [np.zeros((0, 2))], [np.zeros(0, np.uint8)]
    for line in loops(facets):
        corners.append(place[np.append(line, line[0])])
        codes.append(np.array([Path.MOVETO] + [Path.LINETO] * (len(line) - 1) + [Path.CLOSEPOLY], np.uint8))
    return Path(np.concatenate(corners), np.concatenate(codes))


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


def add_area(axes: Any, points: NDArray, facets: NDArray, colour: Any, position: NDArray, radius: float) -> None:
    """The area inside of a surface: in one colour (3,), or in those (n, 3) of the particles next to each place."""
    from matplotlib.patches import PathPatch

    if not len(facets):
        return
    path = filled_path(points, facets)
    colour = np.asarray(colour, dtype=float)
    if colour.ndim == 1 or (colour == colour[0]).all():
        one = colour if colour.ndim == 1 else colour[0]
        axes.add_patch(PathPatch(path, facecolor=one, edgecolor=0.7 * one, linewidth=1.0))
        return
    image, extent = _nearest_colours(np.asarray(points, dtype=float)[:, :2], position[:, :2], colour, radius)
    shown = axes.imshow(image, extent=extent, origin="lower", interpolation="bilinear", aspect="equal")
    shown.set_clip_path(path, axes.transData)
    axes.add_patch(PathPatch(path, facecolor="none", edgecolor="#333333", linewidth=0.8))


def _nearest_colours(
    outline: NDArray, position: NDArray, colour: NDArray, radius: float
) -> tuple[NDArray[np.float64], tuple[float, float, float, float]]:
    from scipy.spatial import cKDTree

    low, high = outline.min(0) - radius, outline.max(0) + radius
    counts = np.minimum(np.ceil((high - low) / (0.5 * radius)), 1200).astype(int)
    x, y = (low[k] + (np.arange(counts[k]) + 0.5) * (high[k] - low[k]) / counts[k] for k in range(2))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    number = min(4, len(position))
    distance, near = cKDTree(position).query(places, k=number)
    distance, near = distance.reshape(-1, number), near.reshape(-1, number)
    weight = np.exp(-((distance - distance[:, :1]) ** 2) / radius**2)
    mixed = (weight[..., None] * colour[near]).sum(1) / weight.sum(1)[:, None]
    return mixed.reshape(counts[1], counts[0], 3).clip(0, 1), (low[0], high[0], low[1], high[1])
