"""Ten faults of a fresh engineer are noticed, each with its cause; with a second kernel at night."""

import pytest

from refsim import contract
from tests.contract import faulty

CAUSES = {
    "self": "leaves out the particle itself (missing self term)", "norm": "normalisation for 3 dimensions",
    "cap": "is right with up to 64 neighbours and wrong with more", "race": "a race between threads",
    "unset": "adds to density, which holds no number before the call; it must assign it", "half": "h/2 in place of h",
    "mirror": "the wall particles are mirrored", "image": "is the nearest image taken in both directions?",
    "prefix": "in float32", "edge": "cut at r = h",
}  # fmt: skip
STEPS = {"prefix": ("T2", "T3"), "mirror": ("T2",), "image": ("T2",)}
VARIANTS = {"self": (0, 6), "mirror": (6,), "image": (7,), "none": (0, 6, 7)}
kernels = pytest.mark.parametrize("kernel", ["wendland_c2", pytest.param("cubic_spline", marks=pytest.mark.slow)])


def judged(fault, kernel, dtype):
    steps, variants = STEPS.get(fault, ("T2",)), VARIANTS.get(fault, (0,))
    return list(contract.trials(faulty.in_numpy(fault, kernel), "sph.density", (dtype,), variants, steps))


@kernels
@pytest.mark.parametrize("fault", CAUSES)
def test_a_fault_is_noticed_with_its_cause(fault, kernel):
    """Most failed trials name the cause, and the first does, which a report tells first."""
    dtype = "float32" if fault == "prefix" else "float64"
    failed = [o for o in judged(fault, kernel, dtype) if not o.passed and not o.not_judged]
    named = [o for o in failed if CAUSES[fault] in o.words]
    assert failed[0] in named, [str(o) for o in failed]
    assert len(named) > len(failed) / 2, [str(o) for o in failed]
    assert all(o.kernel == kernel for o in failed)


def test_a_race_is_said_by_repeated_calls():
    outcomes = contract.trials(faulty.in_numpy("race", "wendland_c2"), "sph.density", ("float32",), (6,), ("T6",))
    assert all(CAUSES["race"] in o.words for o in outcomes)


@kernels
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_right_programs_pass(dtype, kernel):
    outcomes = judged("none", kernel, dtype)
    assert not [str(o) for o in outcomes if not o.passed and not o.not_judged]
    assert {o.dim for o in outcomes if o.telling} == {2, 3}
