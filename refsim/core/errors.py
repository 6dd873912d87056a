"""The two errors that a user of refsim meets, each with the exit code of the command line; packages that may lack."""

import errno
import importlib
from typing import Any

REASONS = {  # why a run stops: the only names that RunStopped takes
    "non_finite": "a position, a velocity, an acceleration or a saved value is NaN or infinite",
    "diverged": "a particle is faster than the effects' equations allow (ten times the sound speed)",
    "heat_lost": "heat has changed by more than 1 % of what can be exchanged, and nothing enters or leaves",
    "temperature_out_of_range": "a temperature has left the range that conduction from the start's can reach",
    "step_too_small": "the stable step has shrunk to a millionth of the first one",
    "collapsed": "particles have clumped until one has thousands of neighbours",
    "missed_neighbours": "an audit found a neighbour that the list lacks",
    "out_of_grid": "a particle is beyond the last cell of the background grid, or at no finite place",
    "outrun": "a particle moved by more than half a cell of the background grid in one step",
    "compressed": "a particle has less than a fifth of its volume (MPM), or more than 0.1 % of the particles of SPH are"
    " denser than the scene's density_bound, 1.5 times the rest density",
    "miscounted": "the density that is counted inside the liquid is more than 25 % off the advanced one",
    "expanded": "a particle has more than three times its volume",
    "volume_jump": "a particle's volume changed by more than half in one step",
    "clumped": "surface tension has drawn particles together where their volume ratio does not see it",
    "held_by_planes": "the planes behind walls stop more than 30 % of the liquid in each step",
    "shape_lost": "particles of a solid are twice as far from their neighbours as in its lattice, in the mean",
    "particles_lost": "a particle of the start is missing, or has another mass",
    "out_of_memory": "the machine has no memory left",
    "disk_full": "no space or quota is left; the run can be resumed from the last checkpoint",
    "write_failed": "the disk refused a write for another reason",
    "scheduler_lost": "the scheduler of the workers has gone away; what was finished is kept",
    "interrupted": "Ctrl-C, SIGTERM or SIGHUP; the run can be resumed from the checkpoint written then",
}


class RefsimError(Exception):
    """Base of the errors that end a command with one clear sentence instead of a traceback."""

    exit_code = 1


class InputError(RefsimError):
    """Bad input (exit code 2). The message is one sentence: what is wrong, where, and what to do about it."""

    exit_code = 2


class RunStopped(RefsimError):
    """The run cannot go on as it is (exit code 3); `reason`, for programs, is a name of REASONS."""

    exit_code = 3
    report: Any = None  # of the run that stopped, where there was one (`refsim.engine.driver.RunReport`)
    advice: tuple[str, ...] = ()  # lines that say what can be done next, added where the error is caught

    def __init__(self, reason: str, message: str) -> None:
        if reason not in REASONS:
            raise ValueError(f"{reason!r} is not one of the reasons {', '.join(REASONS)}")
        super().__init__(reason, message)  # both, so that the error survives pickling between processes
        self.reason = reason

    def __str__(self) -> str:
        return self.args[1]


NO_SPACE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def refused(error: OSError, what: str = "") -> RefsimError:
    """The error to raise for what the system has refused; `what` is said where the error names no file."""
    why = error.strerror or " ".join(str(error).split()) or type(error).__name__
    place = what if error.filename is None else str(error.filename)
    at = f"{place}: " if place else ""
    if error.errno in NO_SPACE:
        return RunStopped("disk_full", f"{at}no space is left ({why}); free some, and give the same command again.")
    return InputError(f"{at}the system refuses it ({why}); give another path, or correct its rights.")


EXTRAS = {"distributed": "cluster", "pyvista": "view"}  # package: extra of refsim that has it


def extra(module: str, use: str) -> Any:
    """The module, imported; InputError, whose subject is `use`, says how to install one that is missing."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        raise InputError(
            f"{use} needs the package {module}, which is not installed; run pip install {module} (it is one of"
            f" refsim's extra {EXTRAS[module]!r})."
        ) from None
