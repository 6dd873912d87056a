"""What of a library's declaration no trial judged that could fail: a green verdict needs all of it."""

from collections.abc import Mapping, Sequence
from typing import Any

from refsim.contract.features import extended, present
from refsim.contract.parameters import shape_acts
from refsim.contract.target import Outcome

JUDGING = ("T1", "T2", "T3", "T11")  # steps that hold the answer itself to a right one


def gaps(name: str, declared: Mapping[str, Sequence[Any]], request: Any, outcomes: Sequence[Outcome]) -> list[str]:
    """What was declared and asked for, and met no trial of an operation whose right answer differs from zero.

    declared  "dtypes", "dims", "kernels" and "left_out", the arguments that are declared not to be supported
    request   "dtypes", "variants" and "steps" that were asked for, all if empty
    """
    operation = extended(name)
    told = [o for o in outcomes if o.step in JUDGING and o.telling and not o.not_judged]
    wanted = [step for step in JUDGING if step in (request.steps or JUDGING)]
    if not wanted:
        return []
    found = []
    if "T1" in wanted and not any(o.step == "T1" and (o.not_judged or o in told) for o in outcomes):
        found.append("an answer in closed form (T1)")
    if "T2" in wanted and not any(o.step == "T2" for o in told):
        found.append("the hard inputs (T2)")
    found += [dtype for dtype in request.dtypes or declared["dtypes"] if not any(o.dtype == dtype for o in told)]
    kernels: Sequence[str] = declared["kernels"] if shape_acts(operation) else [""]
    for dim in declared["dims"]:
        for kernel in kernels:
            met = any(o.dim == dim and (not kernel or kernel in o.kernel.split()) for o in told)
            if not met and set(wanted) != {"T1"}:
                found.append(f"{f'the kernel {kernel} ' if kernel else ''}in {dim} dimensions")
    if not request.variants:
        given, judged = (
            {feature for number in numbers for feature in present(operation, operation.variants[number])}
            for numbers in (range(len(operation.variants)), {o.variant for o in told})
        )
        found += [f"with {feature}" for feature in sorted(given - judged - {*declared["left_out"]})]
    return found
