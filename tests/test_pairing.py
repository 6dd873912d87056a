"""Every operation on every backend, precision and hard input: this file only calls the contract.

Where the formula does not branch on the precision, float64 is left to `slow`, and so are variants whose kernels
would be compiled for this file alone.
"""

import os
import subprocess
import sys

import numpy as np
import pytest

from refsim import cases, contract
from refsim.backend import unavailable
from refsim.neighbours.rows import NeighbourRows
from refsim.operation import REGISTRY

EPS = np.finfo(np.float32).eps


def trials():
    cases.discover()
    for backend in ("numpy", "cpu", "cuda"):
        for name, operation in REGISTRY.items():
            for variant in range(len(operation.variants)):
                for dtype in ("float32", "float64"):
                    marks = []
                    if backend == "cuda":
                        marks.append(pytest.mark.gpu)
                    elif dtype == "float64" and variant and backend == "cpu":
                        marks.append(pytest.mark.slow)
                    yield pytest.param(name, variant, backend, dtype, marks=marks)


@pytest.mark.parametrize("name, variant, backend, dtype", list(trials()))
def test_ladder(name, variant, backend, dtype):
    reason = unavailable(backend)
    if reason is not None:
        pytest.skip(reason)
    outcomes = contract.climb(contract.Target(REGISTRY[name], backend, dtype, variant))
    assert len(outcomes) >= 3
    failed = [str(outcome) for outcome in outcomes if not outcome.passed]
    assert not failed, "\n".join(failed)


def test_many_threads_give_the_same_bits():
    """Eight threads, more than there are cores, against one: T6 in a process that was started with eight."""
    program = """
from refsim import contract
from refsim.operation import REGISTRY
for operation in REGISTRY.values():
    for outcome in contract.climb(contract.Target(operation, "cpu", "float32"), ("T6",)):
        print(outcome.passed, outcome)
"""
    environment = dict(os.environ, NUMBA_NUM_THREADS="8")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) == len(REGISTRY)
    assert all(line.startswith("True") and "1, 2, 8" in line for line in lines), done.stdout


# The contract judges: it must be able to say no.


def own_density(change):
    """A third party's plain program for sph.density, with something the matter."""

    def program(position, mass, neighbours, walls, smoothing, fluid, number_density, density):
        answer = REGISTRY["sph.density"].program("numpy")(position, mass, walls, smoothing, fluid)
        density[...] = change(answer["density"][0])
        if number_density is not None:
            number_density[...] = answer["number_density"][0]

    return lambda operation: program


def test_a_plain_program_passes_through():
    steps = ("T1", "T2", "T5", "T6", "T7", "T9")
    outcomes = contract.check("sph.density", own_density(lambda rho: rho), dtypes=("float64",), steps=steps)
    assert {outcome.step for outcome in outcomes} == set(steps)
    # In a product of matrices 0 * NaN spreads: the step that asks for harm to nobody else notices.
    assert all(outcome.passed or outcome.trial == "NaN in mass" for outcome in outcomes)


@pytest.mark.parametrize(
    "change",
    [lambda rho: rho * (1 + 100 * EPS), lambda rho: -rho, lambda rho: np.roll(rho, 1), lambda rho: rho * np.nan],
    ids=["factor", "sign", "index", "nan"],
)
def test_a_wrong_program_fails(change):
    outcomes = contract.check(
        "sph.density", own_density(change), dtypes=("float64",), variants=(0,), steps=("T1", "T2")
    )
    assert {outcome.step for outcome in outcomes if not outcome.passed} == {"T1", "T2"}


def test_bindings_are_what_the_program_takes():
    values = contract.bindings("sph.momentum", "cpu", "float32", "cloud_3d", variant=1)
    assert tuple(values) == REGISTRY["sph.momentum"].arguments("cpu")
    assert isinstance(values["neighbours"], NeighbourRows)
    assert values["position"].dtype == np.float32
    again = contract.bindings("sph.momentum", "cpu", "float32", "cloud_3d", variant=1)
    assert again["acceleration"] is not values["acceleration"]
    assert np.array_equal(again["acceleration"], values["acceleration"])


def test_an_argument_that_nothing_makes_is_named():
    with pytest.raises(KeyError, match="'unheard_of'"):
        contract.Inputs(cases.CASES["cloud_3d"](), "float32")["unheard_of"]
