"""The contract that every program of every operation keeps: one ladder of steps, for refsim's backends and others'.

T1 closed form, T2 hard inputs against the oracle, T3 a large case on sampled rows, T4 conservation, T5 symmetries,
T6 the same bits again, T7 additivity, T9 bad input, T10 other parameters; and for a whole run T8, resuming.
`trials(load("module"), "sph.density")` runs it on a program of your own, as `refsim contract` does; `run` makes one
comparison; `bindings` gives the arguments of a program by name.
"""

from refsim.contract.binding import to_numpy
from refsim.contract.inputs import Inputs
from refsim.contract.programs import STEPS, Programs, Step, climb, ladder, load, refsim_programs, run, trials
from refsim.contract.target import Outcome, Target, bindings
from refsim.contract.whole_runs import resumes

__all__ = ["STEPS", "Inputs", "Outcome", "Programs", "Step", "Target", "bindings", "climb", "ladder", "load"]
__all__ += ["refsim_programs", "resumes", "run", "to_numpy", "trials"]
