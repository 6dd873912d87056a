"""The plain road on a CPU: every operation's loops as `refsim show` prints them, against the references."""

import json
import re

import numpy as np

from refsim.backends.plain import PlainKernel
from refsim.backends.written import kind_of
from refsim.commands.show import printed
from refsim.core.operation import REGISTRY
from refsim.sph.kernels import gravity
from tests.running import python

CASE = "two_particles"
PROGRAM = """
import json, sys
from refsim import contract
from refsim.core import cases
from refsim.core.operation import REGISTRY
cases.discover()
answers = {}
for name in sys.argv[2:] or REGISTRY:
    for variant in range(len(REGISTRY[name].variants) if len(sys.argv) == 2 else 1):
        answers[f"{name} {variant}"] = str(contract.run(name, "cpu", "float64", sys.argv[1], variant))
program = REGISTRY["sph.density"].program("cpu")
print(json.dumps([type(program).__name__, answers]))
"""


def outcomes(*operations, **around):
    """What the contract says of the operations on the plain road."""
    run = python("-c", PROGRAM, CASE, *operations, REFSIM_PLAIN="1", **around)
    kind, answers = json.loads(run.stdout.splitlines()[-1])
    assert kind == "PlainKernel"
    return answers


def test_every_operation_keeps_the_contract_as_python():
    answers = outcomes(NUMBA_DISABLE_JIT="1")
    assert len(answers) > 250
    assert not [answer for answer in answers.values() if not answer.startswith("pass")]


def test_functions_that_take_arrays_are_inlined():
    """A call that is not counts references to each array, for each row."""
    heads = re.findall(r"@njit\((.*)\)\ndef (\w+)\(", printed(REGISTRY["sph.density"], "cpu"))
    inlined = {name for options, name in heads if "forceinline=True" in options}
    assert inlined == {"sum_of_density_pair", "put_sums", "density_of_row"}


def test_one_thread_needs_no_parallel_loop():
    loops = PlainKernel(gravity.plain_wrapper("cpu"), "refsim.sph.kernels", ())
    kinds = tuple(map(kind_of, (np.zeros(3), np.zeros((4, 3)))))
    assert ["parallel" in loops.of(kinds, alone).targetoptions for alone in (True, False)] == [False, True]
