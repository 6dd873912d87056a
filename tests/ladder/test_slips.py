"""Whether the contract notices errors: every sign, factor, index and condition of every program is altered once.

A slip that no trial notices is a gap in the contract, unless it changes nothing: those stand in `harmless.toml`,
with reasons.
"""

import pytest

from refsim.core import cases
from refsim.core.operation import REGISTRY
from tests.ladder import slips


def verdict(names):
    gaps = [slip for slip in slips.judged(names) if not slips.harmless(slip)]
    assert not gaps, "not noticed:\n" + "\n".join(gaps)


QUICK = {"sph.gravity"}


@pytest.mark.parametrize("names", [n for n in slips.programs() if n[0] in QUICK], ids="+".join)
def test_slips_in_a_short_program_are_noticed(names):
    verdict(names)


@pytest.mark.slow
@pytest.mark.parametrize("names", [n for n in slips.programs() if n[0] not in QUICK], ids="+".join)
def test_slips_are_noticed(names):
    verdict(names)


@pytest.mark.slow
def test_every_harmless_slip_can_be_made():
    cases.discover()
    planted = [(operation, *slip) for operation in REGISTRY.values() for slip in slips.planted(operation)]
    assert {operation.name for operation, *_ in planted} == set(REGISTRY)
    made = {f"{function.__name__}: {slips.altered(function, *site)[1]}" for _, function, *site in planted}
    assert [known for known in slips.HARMLESS if not any(slip.startswith(known) for slip in made)] == []


def test_every_operation_is_tried():
    assert sorted(name for names in slips.programs() for name in names) == sorted(REGISTRY)
