"""Whether the contract notices errors: every sign, factor, index and condition of every program is altered once.

A slip that no trial notices is a gap in the contract, unless it changes nothing: those stand in `harmless.toml`,
with reasons.
"""

import importlib.util
import pathlib
import sys

import pytest

from refsim.core import cases
from refsim.core.operation import REGISTRY

spec = importlib.util.spec_from_file_location("slips", pathlib.Path(__file__).with_name("slips.py"))
slips = sys.modules.setdefault(spec.name, importlib.util.module_from_spec(spec))
spec.loader.exec_module(slips)


def required(name, planted):
    """Kinds of slips that every equation must have had, of those that its program has a place for.

    A flag has no sign, its condition stands in; a count has no factor.
    """
    operation = REGISTRY[name]
    assert planted, f"{name}: no slip can be made"
    return {"condition" if operation.exact == operation.outputs else "sign", "factor", "index"} & planted


def verdict(names):
    found = slips.judged(names)
    planted, survived = slips.together(found["functions"].values())
    for name in names:
        missing = required(name, set(planted)) - set(found["noticed"][name])
        assert not missing, f"{name}: no slip of kind {missing} was noticed"
    gaps = [slip for slip in survived if not slips.harmless(slip)]
    assert not gaps, "not noticed:\n" + "\n".join(gaps)


QUICK = {"sph.state", "sph.gravity"}


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
    planted = [slip for operation in REGISTRY.values() for slip in slips.planted(operation)]
    made = {f"{function.__name__}: {slips.altered(function, *site)[1]}" for function, _, *site in planted}
    assert [known for known in slips.HARMLESS if not any(slip.startswith(known) for slip in made)] == []


def test_every_operation_is_tried():
    assert sorted(name for names in slips.programs() for name in names) == sorted(REGISTRY)
