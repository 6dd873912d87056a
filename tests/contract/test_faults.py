"""Ten faults of a fresh engineer are noticed, each with its cause, for two kernels, in NumPy and C++."""

import shutil

import pytest

from refsim import contract
from tests.contract import faulty

CAUSES = {
    "self": "leaves out the particle itself (missing self term)",
    "norm": "normalisation for 3 dimensions",
    "cap": "is right with up to 64 neighbours and wrong with more",
    "race": "a race between threads",
    "unset": "adds to density, which holds no number before the call; it must assign it",
    "half": "h/2 in place of h",
    "mirror": "is wrong only with wall particles",
    "image": "is the nearest image taken in both directions?",
    "prefix": "in float32",
    "edge": "there is no cut at r = h",
}
STEPS = {"prefix": ("T2", "T3"), "mirror": ("T2",), "image": ("T2",)}
VARIANTS = {"mirror": (6,), "image": (7,), "none": (0, 6, 7)}
KERNELS = ("wendland_c2", "cubic_spline")


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    compiler = shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        pytest.skip("no C++ compiler (g++ or c++) is on the path")
    return faulty.compiled(tmp_path_factory.mktemp("cpp"), compiler)


def judged(programs, fault, dtype):
    steps, variants = STEPS.get(fault, ("T2",)), VARIANTS.get(fault, (0,))
    return list(contract.trials(programs, "sph.density", (dtype,), variants, steps))


def told(programs, fault):
    """Failed trials of a faulty program."""
    dtype = "float32" if fault == "prefix" else "float64"
    return [o for o in judged(programs, fault, dtype) if not o.passed and not o.not_judged]


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("fault", CAUSES)
def test_a_fault_in_numpy_is_noticed_with_its_cause(fault, kernel):
    failed = told(faulty.in_numpy(fault, kernel), fault)
    assert any(CAUSES[fault] in o.words for o in failed), [str(o) for o in failed]
    assert all(o.kernel == kernel for o in failed)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("fault", CAUSES)
def test_a_fault_in_cpp_is_noticed_with_its_cause(fault, kernel, library):
    failed = told(faulty.in_cpp(library, fault, kernel), fault)
    assert any(CAUSES[fault] in o.words for o in failed), [str(o) for o in failed]


def test_a_race_is_said_by_repeated_calls(library):
    outcomes = contract.trials(faulty.in_cpp(library, "race", KERNELS[0]), "sph.density", ("float32",), (0,), ("T6",))
    assert all(CAUSES["race"] in o.words for o in outcomes)


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_right_programs_pass(dtype, kernel, library):
    for programs in (faulty.in_numpy("none", kernel), faulty.in_cpp(library, "none", kernel)):
        outcomes = judged(programs, "none", dtype)
        assert not [str(o) for o in outcomes if not o.passed and not o.not_judged]
        assert {o.dim for o in outcomes if o.telling} == {2, 3}
