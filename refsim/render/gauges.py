"""Plots of what the gauges of a run have measured."""

import os
from pathlib import Path

from refsim.core.writing import made_by, output_path, write_file
from refsim.io.series import GAUGES, read_series

DOTS = 150  # pixels an inch


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
