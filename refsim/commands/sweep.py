"""`refsim sweep`: a scene's observable at many parameters, on the processors of this machine or on a cluster."""

import argparse

from refsim.commands import CommandResult, command, kept_in, results_folder, takes
from refsim.core.terminal import say, wanted
from refsim.sweep import TABLE, sweep

DESCRIPTION = """Run a scene at every combination of parameters that a sweep file (TOML) gives, and print the observable
of each run. What is in the results folder is not computed again, so that the same command goes on where it was
stopped."""
FAILED = 3


@command("sweep", "run a scene at many parameters", DESCRIPTION)
@takes("sweep", metavar="SWEEP.toml", help="scene, observable, and a grid or a list of parameters, seeds")
@takes("--scheduler", metavar="ADDRESS", help="compute on the workers of a Dask scheduler", group="where")
@takes("--jobs", type=int, metavar="N", help="processes of this machine (as many as processors)", group="where")
@takes("--output", metavar="DIR", help="folder of the results (NAME_sweep for NAME.toml)")
@takes("--checkpoint-every", type=float, default=60.0, metavar="S",
       help="wall time between a run's checkpoints [s] (60)")  # fmt: skip
@takes("--quiet", action="store_true", help="no progress")
def execute(options: argparse.Namespace) -> CommandResult:
    """Compute what is missing; print all runs."""
    folder = results_folder(options.output, options.sweep, "sweep")
    with kept_in(folder):
        given = {name: getattr(options, name) for name in ("jobs", "scheduler", "checkpoint_every")}
        tell, bar = ((lambda text: None), False) if options.quiet else (say, wanted())
        swept = sweep(options.sweep, folder=folder, say=tell, bar=bar, **given)
    worked = any(reading is not None and not reading.failed for reading in swept.readings)
    code = 0 if worked and not swept.missing else FAILED
    return CommandResult(swept.data() | {"folder": str(folder)}, f"{swept.text()}\n{folder / TABLE}", code)
