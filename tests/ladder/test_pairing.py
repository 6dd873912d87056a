"""Every operation on every backend, precision and hard input: this file only calls the contract.

A kernel is compiled for every combination of optional terms and every precision. By day the CPU's are compiled without
any, in single precision and with one smoothing kernel, and the other combinations run as Python, like fused programs
(test_plain.py); the references run in double. The rest is `slow`.
"""

import numba
import numpy as np
import pytest

from refsim import contract
from refsim.backends.arrays import unavailable
from refsim.contract import inputs as contract_inputs
from refsim.contract.answers import typed
from refsim.core import cases
from refsim.core.operation import REGISTRY, backend_of, without
from tests import pairs
from tests.running import python

FUSED = "cpu:fused", "cpu:central"  # by one program, for which he_2014.tension stands by day
EVERY_SHAPE = "sph.density", "sph.momentum"  # W and its slope: no other formula knows the smoothing kernel's shape.
# An operation with two kernels keeps every shape: with one shape for both, each could stand in the other's place.


def trials():
    cases.discover()
    for name, operation in REGISTRY.items():
        for program in operation.names():
            backend = backend_of(program)
            for variant in range(len(operation.as_computed_by(program).variants)):
                for dtype in ("float32", "float64"):
                    compiled = dtype == "float32" and variant == 0
                    compiled &= program not in FUSED or (name, program) == ("he_2014.tension", FUSED[0])
                    by_day = {"numpy": dtype == "float64", "cpu": compiled, "cuda": True}[backend]
                    marks = [pytest.mark.gpu] * (backend == "cuda") + [pytest.mark.slow] * (not by_day)
                    taken = sum(kernel in operation.arguments("numpy") for kernel in contract_inputs.KERNELS)
                    one = compiled and backend == "cpu" and taken == 1 and name not in EVERY_SHAPE
                    yield pytest.param(name, variant, program, dtype, "wendland_c2" if one else "", marks=marks)
                    if one:
                        yield pytest.param(name, variant, program, dtype, "", marks=pytest.mark.slow)


@pytest.mark.parametrize("name, variant, program, dtype, kernel", list(trials()))
def test_ladder(name, variant, program, dtype, kernel):
    reason = unavailable(backend_of(program))
    if reason is not None:
        pytest.skip(reason)
    outcomes = list(contract.climb(contract.Target(REGISTRY[name], program, dtype, variant, kernel=kernel)))
    assert len(outcomes) >= 2, "nothing was climbed"
    assert {outcome.operation for outcome in outcomes} == {name}  # also of a fused program
    failed = [str(outcome) for outcome in outcomes if not outcome.passed]
    assert not failed, "\n".join(failed)


def test_many_threads_give_the_same_bits():
    """Eight threads, more than there are cores, against one: T6 in a process that was started with eight."""
    program = """
from refsim import contract
from refsim.core.operation import REGISTRY, backend_of
for operation in REGISTRY.values():
    for outcome in contract.climb(contract.Target(operation, "cpu", "float32"), ("T6",)):
        print(outcome.passed, outcome)
"""
    lines = python("-c", program, NUMBA_NUM_THREADS="8").stdout.splitlines()
    assert len(lines) == len(REGISTRY)
    assert all(line.startswith("True") and "1, 2, 8" in line for line in lines), lines


def test_another_output_of_a_kernel_changes_no_bit():
    """With AVX-512 a compiler left to itself sums more outputs in fewer chains of vectors, in another order."""
    densities = []
    for left_out in ("number_density asymmetry walls period", "walls period"):
        values = contract.bindings("sph.density", "cpu", "float32", "cloud_3d", without(left_out))
        values["smoothing"] = values["smoothing"].fixed()  # as in a run
        REGISTRY["sph.density"].bind("cpu", values.__getitem__)()
        densities.append(values["density"])
    assert np.array_equal(*densities)


# T8
@pytest.mark.parametrize("name", [n for n in pairs.EFFECTS if n != "mesh_boundary"])  # test_one_way_coupling.py
def test_a_run_with_each_effect_is_resumed_as_the_same_run(name):
    outcomes = list(contract.resumes(pairs.scene(name, name), "numpy", (2, 2)))
    assert all(outcome.passed for outcome in outcomes), "\n".join(map(str, outcomes))


@pytest.mark.parametrize("backend", ["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def test_a_resumed_run_is_the_same_run(backend):
    reason = unavailable(backend)
    if reason is not None:
        pytest.skip(reason)
    outcomes = list(contract.resumes(pairs.scene("surface_detection", "gravity", "float32"), backend))
    assert len(outcomes) == 4
    assert all(outcome.passed for outcome in outcomes), "\n".join(map(str, outcomes))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_every_step_hands_a_kernel_the_types_of_a_run(dtype):
    """Lists over all pairs are typed as those of the search, and groups of closed forms as those of a scene."""
    cases.discover()
    found, pairs = (contract.inputs.prepared("cloud_3d", "cpu", dtype, lists)[1:] for lists in contract.inputs.LISTS)
    assert list(map(numba.typeof, found)) == list(map(numba.typeof, pairs))
    usual, compared = contract.Inputs(cases.CASES["few"](), dtype), set()
    for maker in (maker for makers in cases.CLOSED_FORMS.values() for maker in makers):
        for name, value in maker().inputs.items():
            if hasattr(value, "on_backend"):
                assert typed(name, value, dtype).dtype == usual[name].dtype == dtype, (maker.__name__, name)
                compared.add(name)
            elif hasattr(value, "_fields") and type(value) is type(usual[name]):
                given = typed(name, value, dtype)
                assert numba.typeof(given) == numba.typeof(usual[name]), (maker.__name__, name)
                compared.add(name)
    assert {"background", "boxes", "grid", "solid_field", "surface_term", "planes"} <= compared


def test_an_argument_that_nothing_makes_is_named():
    with pytest.raises(KeyError, match="'unheard_of'"):
        contract.Inputs(cases.CASES["cloud_3d"](), "float32")["unheard_of"]


# T10: parameters
def test_every_member_acts_somewhere_or_is_held_with_a_reason():
    cases.discover()
    acting, all_members = set(), set()
    for operation in REGISTRY.values():
        inputs = contract.Inputs(cases.CASES["few"](), "float64")
        kernel = contract_inputs.kernel_of(operation, inputs)
        for name, group in contract_inputs.groups_of(operation, inputs).items():
            rule = cases.VARIATIONS.get(type(group), cases.Variation())
            assert all(rule.held.values())
            free = {m for m, value in zip(group._fields, group) if np.ndim(value) == 0} - rule.held.keys()
            free -= rule.follow(group, inputs, kernel).keys()
            all_members |= {(type(group), member) for member in free}
            acting |= {(type(group), m) for m in free if contract_inputs.acts(operation, name, m, inputs)}
    idle = {(kind.__name__, member) for kind, member in all_members - acting}
    # How many passes iisph.solve makes may depend on a rounding: the case makes two, whatever is left.
    assert idle == {("Implicit", "tolerance"), ("Implicit", "least")}
    assert len(acting) > 100
