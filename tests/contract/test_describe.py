"""What the command says of an operation, its stub, and its variants: the first is the plain one, and not zero."""

import numpy as np
import pytest

from refsim.contract import Target, describe
from refsim.contract.answers import parameters
from refsim.contract.bounds import oracle
from refsim.contract.inputs import Inputs, arguments_of_others, with_variant
from refsim.core import cases
from refsim.core.operation import REGISTRY

cases.discover()


def test_everything_that_an_operation_takes_is_described():
    """Arguments of all, variants of a fifth: each makes its inputs anew."""
    for number, (name, operation) in enumerate(REGISTRY.items()):
        found = describe.arguments(operation, "cpu")
        assert [a.name for a in found if a.role] == list(arguments_of_others(operation, "cpu")), name
        assert not [a.name for a in found if not a.meaning], name
        told = describe.variants(operation) if number % 5 == 0 else operation.variants
        assert len(told) == len(set(map(str, told))) == len(operation.variants), name


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
