"""Pictures in 2D by matplotlib: filled surfaces or discs, and the series of gauges."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from refsim.core.writing import made_by, output_path, write_file
from refsim.io.results import GAUGES, read_series


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


def add_area(axes: Any, points: NDArray, facets: NDArray, colour: NDArray | Callable, size: float) -> None:
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


DOTS = 150  # pixels an inch of a picture of gauges


def plot_gauges(run: str | os.PathLike[str], output: str | os.PathLike[str], size: tuple[int, int]) -> Path:
    """Draw all series of a run over time, one plot for each unit of each gauge, below each other.

    size  of the picture for each of the plots [pixels]

    Raises InputError where the run has no gauges, or the picture cannot be written.
    """
    from matplotlib.figure import Figure

    series = list(read_series(Path(run) / GAUGES).values())
    parts = [(one, unit) for one in series for unit in dict.fromkeys(one.units)]
    path = output_path(output, "picture", ".png", ".pdf", ".svg")
    figure = Figure(figsize=(size[0] / DOTS, 0.4 * size[1] / DOTS * len(parts)), dpi=DOTS, layout="constrained")
    for axes, (one, unit) in zip(figure.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0], parts):
        names = [name for name, column_unit in zip(one.columns, one.units) if column_unit == unit]
        for name in names:
            axes.plot(one.time, one[name], label=name, linewidth=1)
        axes.set_title(one.name, loc="left", fontsize="medium")
        axes.set_ylabel(f"[{unit}]" if len(names) > 1 else f"{names[0]} [{unit}]")
        if len(names) > 1:
            axes.legend(fontsize="small")
    axes.set_xlabel("time [s]")
    write_file(path, made_by(figure.savefig, format=path.suffix[1:]), "picture")
    return path
