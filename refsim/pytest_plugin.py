"""A plugin of pytest: the trials of `refsim contract`, one test each, and the arrays of its cases.

A test file with a mapping `PROGRAMS` and a test that takes `contract_trial`:

    from mine import PROGRAMS

    def test_contract(contract_trial):
        contract_trial()

Nothing of refsim but this module is imported unless a test takes one of the two fixtures.
"""

from collections.abc import Callable
from typing import Any

import pytest

MARK = "contract"
KEYS = ("operations", "dtypes", "variants", "steps")


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line("markers", f"{MARK}({', '.join(KEYS)}): part of the ladder that `contract_trial` climbs")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test for each trial of the module's PROGRAMS, where a test takes `contract_trial`."""
    if "contract_trial" not in metafunc.fixturenames:
        return
    from refsim.contract.programs import ladder, programs_of
    from refsim.core.errors import InputError

    chosen: dict[str, Any] = {}
    for mark in metafunc.definition.iter_markers(MARK):
        chosen = {**mark.kwargs, **chosen}
    unknown = ", ".join(set(chosen) - set(KEYS))
    if unknown:
        raise pytest.UsageError(f"{metafunc.definition.nodeid}: contract has no {unknown}; it has {', '.join(KEYS)}.")
    operations, dtypes, variants, steps = (tuple(chosen.get(key, ())) for key in KEYS)
    parameters = []
    try:
        programs = programs_of(metafunc.module, metafunc.module.__name__)
        for operation in programs.operations(operations):
            for step in ladder(programs, operation, dtypes, variants, steps):
                at = step.target
                name = f"{operation}-{at.dtype}-variant{at.variant}-{step.step}-{step.name}"
                parameters.append(pytest.param(Trial(step), id=name.replace(" ", "_")))
    except InputError as error:
        raise pytest.UsageError(str(error)) from None
    metafunc.parametrize("contract_trial", parameters)


class Trial:
    """A trial of the contract; called, it fails with what is wrong or skips what is not judged."""

    def __init__(self, step: Any) -> None:
        self.step = step

    def __call__(self) -> None:
        """Run the trial."""
        outcome = self.step.perform()
        if outcome is None:
            pytest.skip("the trial does not apply to this operation's arguments")
        if outcome.not_judged and not outcome.untried:
            pytest.skip(f"not judged: {outcome.not_judged}")
        if not outcome.passed:
            pytest.fail(str(outcome), pytrace=False)


@pytest.fixture
def contract_arrays() -> Callable[..., dict[str, Any]]:
    """A function (operation, case, dtype, variant, arrays) of a case's arguments by name, outputs as they are before.

    contract_arrays("sph.density") gives those of the case "cloud_3d" in float64 and variant 0 for the CPU.
    """
    from refsim.contract import bindings
    from refsim.contract.inputs import arguments_of_others
    from refsim.core.operation import REGISTRY

    def arguments(
        operation: str, case: str = "cloud_3d", dtype: str = "float64", variant: int = 0, arrays: str = "cpu"
    ) -> dict[str, Any]:
        names = arguments_of_others(REGISTRY[operation], arrays)
        return bindings(operation, arrays, dtype, case, variant, names=names)

    return arguments
