"""The ladder: steps from a closed form of two particles to bad input; each gives an outcome for each trial."""

import dataclasses
import functools
import time
from collections.abc import Callable, Iterator

import numpy as np

from refsim.contract.answers import closed_forms, hard_inputs, large_case, on_case, parameters
from refsim.contract.drawn import drawn_inputs
from refsim.contract.properties import additivity, bad_input, invariants, repeats, symmetries
from refsim.contract.target import NotJudged, Outcome, Target, Trial
from refsim.core.operation import REGISTRY, Operation

STEPS: dict[str, Callable[[Target], Iterator[Trial]]] = {
    "T1": closed_forms,
    "T2": hard_inputs,
    "T3": large_case,
    "T4": invariants,
    "T5": symmetries,
    "T6": repeats,
    "T7": additivity,
    "T9": bad_input,
    "T10": parameters,
    "T11": drawn_inputs,
}
AGAINST_ORACLE = ("T2", "T3", "T9", "T11")  # say nothing about the oracle itself


def run(operation: Operation | str, backend: str, dtype: str, case: str, variant: int = 0) -> Outcome:
    """One operation's program on one case against the oracle (T2)."""
    operation = REGISTRY[operation] if isinstance(operation, str) else operation
    target = Target(operation, backend, dtype, variant)
    return performed(target, "T2", Trial(case, functools.partial(on_case, target, case)))  # type: ignore[return-value]


def planned(target: Target, steps: tuple[str, ...] | None = None) -> Iterator[tuple[str, Trial]]:
    """(step, trial) of all steps, or of those named; for the references those that judge them. No program is called."""
    for name in STEPS if steps is None else steps:
        if target.backend != "numpy" or name not in AGAINST_ORACLE:
            yield from ((name, trial) for trial in STEPS[name](target))


def performed(target: Target, step: str, trial: Trial) -> Outcome | None:
    """The outcome of one trial; None where it does not apply.

    A trial fails in which the program raises, changes an input, writes beside its arrays or leaves an output unset.
    """
    began = time.perf_counter()
    try:
        outcome = trial.run()
    except NotJudged as reason:
        target.faults.clear()
        told, message = (*reason.args, "")[:2]
        outcome = dataclasses.replace(target.outcome(0.0), passed=False, not_judged=told, words=message)
    if outcome is None and target.faults:
        outcome = target.outcome(np.inf)
    seconds = round(time.perf_counter() - began, 4)
    return outcome and dataclasses.replace(outcome, step=step, trial=trial.name, seconds=seconds)


def climbing(target: Target, steps: tuple[str, ...] | None = None) -> Iterator[Outcome]:
    """Outcomes of all steps, or of those named, as they come; for the references those that judge them."""
    outcomes = (performed(target, step, trial) for step, trial in planned(target, steps))
    return (outcome for outcome in outcomes if outcome is not None)


def climb(target: Target, steps: tuple[str, ...] | None = None) -> list[Outcome]:
    """Outcomes of all steps, or of those named; for the references those that judge them."""
    return list(climbing(target, steps))
