"""The first variant of every operation is the plain one: the least that a program must compute, and not zero."""

import numpy as np
import pytest

from refsim.contract import Target
from refsim.contract.answers import parameters
from refsim.contract.bounds import oracle
from refsim.contract.inputs import Inputs, with_variant
from refsim.core import cases
from refsim.core.operation import REGISTRY

cases.discover()


def answers(operation, variant):
    """Whether the reference's answer differs from zero in one of the operation's cases under these overrides."""
    for case in ("few", "cloud_2d", *operation.cases):
        inputs = with_variant(Inputs(cases.CASES[case](), "float64"), variant)
        if any(np.any(value != 0) for value, _ in oracle(operation, inputs).values()):
            return True
    return False


@pytest.mark.parametrize("name", REGISTRY)
def test_the_first_variant_is_plain_and_not_zero(name):
    operation = REGISTRY[name]
    first, kept = operation.variants[0], cases.PLAIN_KEEPS.get(name, {})
    present = {argument for argument in operation.optional if first.get(argument, argument) is not None}
    assert present == set(kept), "variant 0 leaves out all that is optional, or `plain_keeps` says what it needs"
    assert all(kept.values())
    assert answers(operation, first)


@pytest.mark.parametrize("name", [name for name in REGISTRY if REGISTRY[name].programs.get("cuda:fused")])
def test_members_that_act_in_a_fused_program_are_those_of_its_parts(name):
    """A part without its optional walls takes more than acts; none acts that no part takes."""
    fused = REGISTRY[name].as_computed_by("cuda:fused")
    outcomes = [trial.run() for trial in parameters(Target(fused, "numpy", "float64"))]
    assert outcomes
    assert not [str(outcome) for outcome in outcomes if "is not in `takes`" in str(outcome)]
