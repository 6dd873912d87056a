"""The first variant of every operation is the plain one: the least that a program must compute, and not zero."""

import itertools

import numpy as np
import pytest

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


@pytest.mark.parametrize("name", cases.PLAIN_KEEPS)
def test_with_less_than_the_plain_variant_there_is_no_answer(name):
    operation, kept = REGISTRY[name], sorted(cases.PLAIN_KEEPS[name])
    for size in range(len(kept)):
        for some in itertools.combinations(kept, size):
            less = operation.variants[0] | {argument: None for argument in kept if argument not in some}
            try:
                assert not answers(operation, less), some
            except (TypeError, IndexError):  # None where the equation needs an array
                assert some
