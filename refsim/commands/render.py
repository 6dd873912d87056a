"""`refsim render`: pictures and films of a run."""

import argparse
import os
import time
from typing import Any

from refsim.commands import CommandResult, command, in_bytes, in_time, table, takes
from refsim.core.errors import InputError

DESCRIPTION = (
    "Draw a run: surfaces or particles in 3D by PyVista, without a window; runs in 2D by matplotlib. Pictures in 3D and"
    ' films need `pip install "refsim[view]"`.'
)


@command("render", "draw pictures and films of a run", DESCRIPTION)
@takes("run", metavar="RUN", help="folder that `refsim run` has written")
@takes("--frames", metavar="LIST",
       help="such as 0,5,-1 or 0:100:10, or all (the last one; of a film those in which something moves)")  # fmt: skip
@takes("--film", metavar="FILE.mp4", help="write a film")
@takes("-o", "--output", metavar="FILE.png", help="picture to write, .png, .webp or .jpg (RUN.png)")
@takes("--gauges", action="store_true", help="plot what the gauges have measured (RUN_gauges.png)")
@takes("--style", default="paper", help="paper (opaque surfaces), water (clear ones) or particles (default paper)")
@takes("--color", metavar="FIELD", help="colour by a field of the run, such as pressure, velocity or velocity.x")
@takes("--limits", metavar="LOW,HIGH",
       help="of the colour bar (0.5 %% of a frame's particles may lie beyond either end)")  # fmt: skip
@takes("--camera", metavar="A,E[,Z]", help="azimuth, elevation [degrees] and zoom (default -60,20,1)")
@takes("--cut", metavar="x=0", help="leave away what lies before this plane [m]")
@takes("--size", default="1280x960", metavar="WxH", help="pixels (default 1280x960)")
@takes("--per-second", type=float, default=25, metavar="N", help="frames of the run for a second of film (25)")
def execute(options: argparse.Namespace) -> CommandResult:
    """Draw, write, and say what was written."""
    from refsim.render.pictures import Look, write_film, write_pictures

    limits = None if options.limits is None else _numbers("limits", options.limits, ",", float)
    size = _numbers("size", options.size, "x", int)
    look = Look(options.style, options.color, limits, options.camera, options.cut, size)
    began = time.perf_counter()
    if options.film and options.output:
        raise InputError("--film and --output name two files; give one of them.")
    name = os.path.basename(os.path.realpath(options.run))
    if options.gauges:
        from refsim.render.plane import plot_gauges

        written = [plot_gauges(options.run, options.output or f"{name}_gauges.png", size)]
    elif options.film:
        written = [write_film(options.run, look, options.frames, options.film, options.per_second)]
    else:
        written = write_pictures(options.run, look, options.frames, options.output or f"{name}.png")
    seconds = time.perf_counter() - began
    rows = [(path, in_bytes(path.stat().st_size)) for path in written]
    data = {"files": [str(path) for path in written], "seconds": seconds}
    return CommandResult(data, f"{table(rows, right=(1,))}\n{in_time(seconds)}")


def _numbers(name: str, text: str, between: str, kind: type) -> tuple[Any, Any]:
    """Two numbers of an option. Raises InputError for anything else."""
    try:
        first, second = map(kind, text.split(between))
    except ValueError:
        raise InputError(f"--{name} {text!r} is not possible; give two numbers with {between!r} between.") from None
    return first, second
