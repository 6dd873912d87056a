"""What the ladder found, and what of a library's declaration no trial judged, as data, as text and as JUnit's XML."""

import collections
import dataclasses
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from refsim.contract.answers import extended, present
from refsim.contract.apart import LibraryDescription, Request
from refsim.contract.causes import first_cause
from refsim.contract.inputs import shape_acts
from refsim.contract.programs import STEPS
from refsim.contract.target import Outcome, told_values
from refsim.core.operation import REGISTRY
from refsim.core.tables import in_time, table

TOLD = 8  # failed trials that the text names for each operation; --json has all
NOT_SHOWN = ("operation", "backend", "telling", "sign", "traits")  # of an outcome, in --json
Found = Mapping[str, Sequence[Outcome]]


def report(about: LibraryDescription, request: Request, outcomes_of: Found, seconds: float) -> dict[str, Any]:
    """The verdicts as plain data; an operation holds where trials passed, none failed and nothing declared is left."""
    operations = {}
    for name, outcomes in outcomes_of.items():
        lacking = [] if about.offered is None else gaps(name, about.declared, request, outcomes)
        operations[name] = _judged(outcomes, lacking, request.allow_untried)
    holds = all(operation["holds"] for operation in operations.values())
    told = {"programs": about.name, "arrays": about.arrays, "holds": holds, "seconds": round(seconds, 1)}
    return told | {
        "allow_untried": request.allow_untried,
        "operations": operations,
        "not_offered": [] if about.offered is None else [n for n in REGISTRY if n not in about.offered],
    }


def _judged(every: Sequence[Outcome], lacking: list[str], allowed: bool) -> dict[str, Any]:
    outcomes = [o for o in every if not o.not_judged]
    failed = [o for o in outcomes if not o.passed]
    untried = dict(collections.Counter(o.not_judged for o in every if o.untried))
    trials, wrong = (collections.Counter(o.step for o in some) for some in (outcomes, failed))
    steps = {step: {"trials": count, "failed": wrong[step]} for step, count in trials.items()}
    holds = bool(outcomes) and not failed and not lacking and (allowed or not untried)
    told: dict[str, Any] = {"holds": holds, "trials": len(outcomes), "failed": len(failed), "gaps": lacking}
    declared = collections.Counter(o.not_judged for o in every if o.not_judged and not o.untried)
    told |= {"cause": first_cause(every), "untried": untried, "not_judged": dict(declared)}
    largest = max((o.error for o in outcomes), default=0.0)
    plain = (dataclasses.asdict(o) | {"replay": o.replay} for o in every)
    shown = [{name: value for name, value in one.items() if name not in NOT_SHOWN} for one in plain]
    return told | {"largest_error": largest, "steps": steps, "outcomes": shown}


def text(data: Mapping[str, Any], outcomes_of: Found) -> str:
    """The verdicts as a table, failed trials grouped by what is wrong, and what was not judged."""
    operations = data["operations"]
    used = [step for step in STEPS if any(step in o["steps"] for o in operations.values())]
    rows = []
    for name, o in operations.items():
        counts_of = [o["steps"].get(step) for step in used]
        cells = [f"{c['trials'] - c['failed']}/{c['trials']}" if c else "-" for c in counts_of]
        largest = f"{o['largest_error']:.3g}" if math.isfinite(o["largest_error"]) else "no number"
        rows.append((name, *cells, largest, verdict(o)))
    lines = [f"{data['programs']}, arrays of {data['arrays']}: trials passed, by step of the ladder", ""]
    lines.append(table(rows, ("operation", *used, "largest error", "verdict"), tuple(range(1, len(used) + 2))))
    for name, outcomes in outcomes_of.items():
        lines += _failures(name, operations[name]["cause"], outcomes)
    for name, o in operations.items():
        if o["gaps"]:
            lines += ["", f"{name} is declared, and not judged: {', '.join(o['gaps'])}."]
        for size, count in o["untried"].items():
            first = next(each.words for each in outcomes_of[name] if each.untried and each.not_judged == size)
            lines += ["", f"{name} is not tried {size} ({count} trial{'s' if count > 1 else ''}): {first}."]
    if not data["allow_untried"] and any(o["untried"] for o in operations.values()):
        lines += ["", "Declare most_particles, or take --allow-untried where that is enough."]
    counts = sum((collections.Counter(o["not_judged"]) for o in operations.values()), collections.Counter[str]())
    if reasons := ", ".join(f"{reason} ({count})" for reason, count in counts.items()):
        lines += ["", f"Not judged, as declared (trials or whole variants): {reasons}."]
    trials, bad = (sum(o[key] for o in operations.values()) for key in ("trials", "failed"))
    holding = sum(o["holds"] for o in operations.values())
    lines += [
        "",
        f"{holding} of {len(operations)} operations hold; {trials - bad} of {trials} trials passed in"
        f" {in_time(data['seconds'])}. Errors are shares of the bound on rounding.",
    ]
    if data["not_offered"]:
        lines.append(f"{len(data['not_offered'])} of refsim's {len(REGISTRY)} operations have no program here.")
    return "\n".join(lines)


def verdict(operation: Mapping[str, Any]) -> str:
    """The word for an operation's report."""
    if operation["holds"]:
        return "holds"
    if operation["failed"]:
        return "FAILS"
    return "no trial" if not operation["trials"] else "not judged" if operation["gaps"] else "not tried"


def _failures(name: str, cause: str, outcomes: Sequence[Outcome]) -> list[str]:
    """Failed trials by what is wrong, the most frequent first."""
    groups: dict[str, list[Outcome]] = {}
    for o in outcomes:
        if not o.passed and not o.not_judged:
            groups.setdefault(re.sub(r"[\d.e+]+", "#", o.words), []).append(o)
    if not groups:
        return []
    frequent = sorted(groups.values(), key=len, reverse=True)
    lines = ["", f"{name} fails: {cause}"] + [_told(alike) for alike in frequent[:TOLD]]
    rest = sum(map(len, frequent[TOLD:]))
    return [*lines, f"  and {rest} more failed trials; --json has all"] if rest else lines


def _told(alike: Sequence[Outcome]) -> str:
    """Failed trials with the same words: how many, the values of the first, and its name for --replay."""
    first = alike[0]
    trials = "1 trial" if len(alike) == 1 else f"{len(alike)} trials, the first"
    lines = [f"  {first.words or 'a wrong answer'}"]
    if first.values:
        lines.append(f"      {told_values(first.values)}")
    where = first.replay if first.dtype else f"{first.step} {first.trial}, before the first trial"
    error = "" if not math.isfinite(first.error) else f", {first.error:.3g} of the bound"
    return "\n".join([*lines, f"      {trials}: {where}{error}"])


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
    lacking = []
    if "T1" in wanted and not any(o.step == "T1" and (o.not_judged or o in told) for o in outcomes):
        lacking.append("an answer in closed form (T1)")
    if "T2" in wanted and not any(o.step == "T2" for o in told):
        lacking.append("the hard inputs (T2)")
    lacking += [dtype for dtype in request.dtypes or declared["dtypes"] if not any(o.dtype == dtype for o in told)]
    kernels: Sequence[str] = declared["kernels"] if shape_acts(operation) else [""]
    for dim, kernel in itertools.product(declared["dims"] if set(wanted) != {"T1"} else (), kernels):
        if not any(o.dim == dim and (not kernel or kernel in o.kernel.split()) for o in told):
            lacking.append(f"{f'the kernel {kernel} ' if kernel else ''}in {dim} dimensions")
    if not request.variants:
        given, judged = (
            {feature for number in numbers for feature in present(operation, operation.variants[number])}
            for numbers in (range(len(operation.variants)), {o.variant for o in told})
        )
        lacking += [f"with {feature}" for feature in sorted(given - judged - {*declared["left_out"]})]
    return lacking
