"""The contract that every program of every operation keeps: one ladder of steps, for refsim's backends and others'.

T1 closed form, T2 hard inputs against the oracle, T3 a large case on sampled rows, T4 conservation, T5 symmetries,
T6 the same bits again, T7 additivity, T9 bad input, T10 other parameters; and for a whole run T8, resuming.
`trials(load("module"), "sph.density")` runs it on a program of your own, as `refsim contract` does; `run` makes one
comparison; `bindings` gives the arguments of a program by name.
"""

from refsim.contract.binding import to_numpy as to_numpy
from refsim.contract.inputs import Inputs as Inputs
from refsim.contract.inputs import bindings as bindings
from refsim.contract.programs import STEPS as STEPS
from refsim.contract.programs import Programs as Programs
from refsim.contract.programs import Step as Step
from refsim.contract.programs import climb as climb
from refsim.contract.programs import ladder as ladder
from refsim.contract.programs import load as load
from refsim.contract.programs import refsim_programs as refsim_programs
from refsim.contract.programs import run as run
from refsim.contract.programs import trials as trials
from refsim.contract.target import Outcome as Outcome
from refsim.contract.target import Target as Target
from refsim.contract.whole_runs import resumes as resumes
