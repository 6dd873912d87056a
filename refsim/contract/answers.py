"""Steps that hold a program's answer to a right one: closed forms (T1), the oracle (T2, T3), other parameters (T10)."""

import copy
import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from refsim.contract.bounds import errors, oracle, takes_neighbours
from refsim.contract.causes import judgement
from refsim.contract.inputs import Inputs, acts, shape_acts, varied, with_variant
from refsim.contract.target import NotJudged, Outcome, Target, Trial, worst
from refsim.core import cases
from refsim.core.clock import Seconds
from refsim.core.operation import REGISTRY, Operation
from refsim.smoothing import SHAPES

SAMPLED_ROWS = 40
MOST_UNDECIDED = 0.1
CLOUDS = {3: "cloud_3d", 2: "cloud_2d"}
FEW = {3: "few", 2: "few_2d"}
LARGE = {3: "large", 2: "large_2d"}
DENSE, MANY = "dense_cluster", "many_particles"
MANY_PARTICLES = f"with {cases.MANY:,} particles"
MOST_SECONDS = 6.0  # of the processor that a call with many particles may take
SIZES = "thousand", LARGE[3]  # cases whose seconds say how long it takes

Given = tuple[Inputs, Any, Any]

# T1


def closed_forms(target: Target) -> Iterator[Trial]:
    """T1: answers known in closed form, without the oracle; of the target's kernel where the kernel acts."""
    forms = list(exact_forms(target.operation, target.operation.variants[target.variant], target.dtype))
    fitting = [form for form in forms if not target.kernel or _of_kernel(target, form[2])]
    for name, exact, inputs in fitting or [("closed forms", None, None)][: len(forms)]:
        yield Trial(name, functools.partial(_closed_form, target, exact, inputs))


def _of_kernel(target: Target, inputs: Inputs) -> bool:
    wanted, acting = target.kernel.split(), shape_acts(target.operation)
    shapes = zip(("smoothing", "gradient_smoothing"), (wanted[0], wanted[-1]))
    return all(int(inputs[name].shape) == SHAPES[shape] for name, shape in shapes if name in acting)


def exact_forms(
    operation: Operation, variant: Mapping[str, Any], dtype: str
) -> Iterator[tuple[str, cases.Exact, Inputs]]:
    """(name, closed form, its inputs) of those that are worked out for the variant; outputs begin with zeros."""
    cases.discover()
    taken = operation.arguments("numpy")
    dropped = {n for n, value in variant.items() if value is None and n in operation.outputs and n not in taken}
    for maker in cases.CLOSED_FORMS.get(operation.name, ()):
        exact = maker()
        given = {name: value for name, value in exact.inputs.items() if name not in dropped}
        if all(_same(given[name], value) for name, value in variant.items() if name in given):
            given = {name: typed(name, value, dtype) for name, value in given.items()}
            made = with_variant(Inputs(exact.case, dtype), variant)
            for name in exact.expected.keys() - given.keys() - dropped - {*taken}:
                if not made.per_particle(name):
                    given[name] = np.zeros(np.shape(exact.expected[name]), usual_value(name, dtype).dtype)
            yield maker.__name__, exact, made.replaced(**given)


def _closed_form(target: Target, exact: cases.Exact | None, inputs: Any) -> Outcome:
    if exact is None:
        raise NotJudged("a closed form, as there is none for the kernel")
    operation = target.operation
    start = {n: 0 * inputs.output(operation, n) for n in operation.adds}
    written = [n for n in operation.outputs if n in exact.expected and not inputs.dropped(n)]
    known = {n: (np.asarray(exact.expected[n], dtype=float), None) for n in written}
    return judgement(target, target.judged(inputs, answer=known, before=start))


def _same(given: Any, override: Any) -> bool:
    if given is None or override is None:
        return given is override
    return not isinstance(override, Mapping) or all(getattr(given, name) == value for name, value in override.items())


def typed(name: str, value: Any, dtype: str) -> Any:
    """The argument `name` of a closed form, written in Python's numbers, with the types that it has in a run."""
    numbered = hasattr(value, "_fields") or (isinstance(value, np.ndarray) and value.dtype.kind in "iu")
    return _cast(value, usual_value(name, dtype) if numbered else None, dtype)


@functools.cache
def usual_value(name: str, dtype: str) -> Any:
    """The parameter group `name` as a run has it: some of its numbers are float64 whatever the run's dtype is."""
    return Inputs(cases.CASES[FEW[3]](), dtype)[name]


def _cast(value: Any, usual: Any, dtype: str) -> Any:
    """Floats in `value`, a grid's too, as `dtype`; integers, and numbers of a group, with the types of `usual`."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        others = usual if type(usual) is type(value) else (None,) * len(value)
        return type(value)(*(_cast(part, other, dtype) for part, other in zip(value, others)))
    if isinstance(value, np.ndarray):
        kind = dtype if value.dtype.kind == "f" else value.dtype
        return value.astype(usual.dtype if isinstance(usual, np.ndarray) else kind)
    if isinstance(value, float):
        return type(usual)(value) if isinstance(usual, float) else np.dtype(dtype).type(value)
    if isinstance(value, int):
        return type(usual)(value) if isinstance(usual, np.generic) else np.int32(value)
    if hasattr(value, "on_backend"):  # a grid, whose copy on a backend has node arrays of its dtype
        value = copy.copy(value)
        value.dtype = dtype
    return value


# T2, T3


def on_case(target: Target, name: str, lists: str = "search") -> Outcome:
    """T2: one hard input against the oracle, over the neighbour search's lists or the oracle's."""
    judged = target.judged(*target.prepared(name, lists))
    if judged.inputs.case.count >= 20 and not judged.inputs.case.ties:
        flipping = target.operation.tolerance * float(np.finfo(target.dtype).eps)
        scales = (judged.answer[name][1] for name in target.operation.exact)
        share = max(((scale <= flipping).mean() for scale in scales if len(scale)), default=0.0)
        if share > MOST_UNDECIDED:
            return target.outcome(np.inf, f"{share:.0%} of the flags are too near to flipping to compare")
    return judgement(target, judged)


def hard_inputs(target: Target) -> Iterator[Trial]:
    """T2: every common case and the operation's own; one over the all-pairs list, one with 300 neighbours.

    Of other programs than refsim's also the spatial cases in the plane; of refsim's the clouds with every kernel.
    """
    cases.discover()
    names = [*cases.COMMON, *target.operation.cases]
    if target.loader and 2 in target.dims:
        names += cases.IN_PLANE
    if takes_neighbours(target.operation):
        names.append(DENSE)
    for name in names:
        yield Trial(name, functools.partial(on_case, target, name))
    for name in (CLOUDS[dim] for dim in target.dims if target.listed):
        yield Trial(f"{name} over all pairs", functools.partial(on_case, target, name, lists="all_pairs"))
    if not target.kernel and shape_acts(target.operation) and target.loader is None:
        for kernel, name in itertools.product(SHAPES, CLOUDS.values()):
            other = dataclasses.replace(target, kernel=kernel, faults=[])
            yield Trial(f"{name} with {kernel}", functools.partial(on_case, other, name))


def large_case(target: Target) -> Iterator[Trial]:
    """T3: some thousand particles, sampled rows against the oracle; of other programs also more than 16 bits count."""
    for dim in target.dims:
        yield Trial(LARGE[dim], functools.partial(_large, target, LARGE[dim]))
    if target.loader and target.variant == 0 and takes_neighbours(target.operation):
        yield Trial(MANY, functools.partial(many, target))


def _large(target: Target, name: str) -> Outcome:
    return judgement(target, target.judged(*target.prepared(name), rows=sampled(name)))


def sampled(name: str) -> np.ndarray:
    """Rows of a large case that are compared."""
    case = cases.CASES[name]()
    return np.sort(case.random("rows").choice(case.count, SAMPLED_ROWS, replace=False))


def many(target: Target, name: str = MANY) -> Outcome:
    """70,000 particles, or so, where calls with 1,000 and 3,000 say that it ends in time."""
    excluded = target.excludes(target.operation, target.varied(Inputs(cases.CASES[name](), target.dtype)))
    if excluded:
        raise NotJudged(excluded)
    seconds = seconds_of_many(target)
    if seconds > MOST_SECONDS:
        raise NotJudged(
            MANY_PARTICLES, f"a call would take {seconds:.0f} s of the processor, and {MOST_SECONDS:g} s are allowed"
        )
    return _large(target, name)


def seconds_of_many(target: Target) -> float:
    """Seconds of the processor of a call with 70,000 particles: a power of their number, from calls with fewer.

    The power is 1 to 2. Of two calls the shorter counts; the first may compile.
    """
    counts, seconds = [], []
    for name in SIZES:
        given = target.prepared(name)
        counts.append(given[0].case.count)
        clock = [Seconds.now().processor]
        for _ in range(2):
            target.quiet().launch(*given, complete=False)
            clock.append(Seconds.now().processor)
        seconds.append(max(np.diff(clock).min(), 1e-6))
    power = math.log(seconds[1] / seconds[0]) / math.log(counts[1] / counts[0])
    return seconds[1] * (cases.MANY / counts[1]) ** min(max(power, 1.0), 2.0)


# T10


def parameters(target: Target) -> Iterator[Trial]:
    """T10: another value of each member of each parameter group, one at a time; the answer follows as the oracle's.

    On the references: that there is an answer to follow, in one of the variants and cases, for all that the operation
    says it takes.
    """
    cases.discover()
    if target.backend == "numpy":
        yield from _takes(target)
        return
    operation = target.operation
    for dim in dict.fromkeys((*target.dims, 2)):
        start, neighbours, walls = target.prepared(FEW[dim])
        usual = functools.cache(functools.partial(oracle, operation, start))
        for name, member, inputs in varied(operation, start):
            if dim not in target.dims and member != "dim":
                continue
            if name not in operation.arguments(target.backend):
                continue  # fixed in a program that serves some of the variants
            if target.kernel and member == "shape":
                continue  # each declared kernel is a ladder of its own
            if not target.readings and member in cases.READINGS.get(name, ()):
                continue
            acting = acts(operation, name, member, start)
            answer = functools.partial(oracle, operation, inputs) if acting else usual
            given = (inputs, None, None) if name == "period" else (inputs, neighbours, walls)  # which has other lists
            trial = f"another {name}.{member}{' in the plane' if dim == 2 else ''}"
            run = functools.partial(_another, target, f"{name}.{member}", given, answer, usual if acting else None)
            yield Trial(trial, run)


def _another(
    target: Target, member: str, given: Given, answer: Callable[[], Any], usual: Callable[[], Any] | None
) -> Outcome | None:
    inputs, operation = given[0], target.operation
    right = answer()
    if any(len(value) != len(inputs.output(operation, n)) for n, (value, _) in right.items()):
        return None  # a table with another number of rows than the case's
    judged = target.judged(*given, answer=right)
    if usual is not None and not worst(judged.ratios) <= 1:
        same = usual()
        if all(value.shape == same[n][0].shape for n, (value, _) in right.items()) and (
            worst(errors(operation, inputs, judged.before, judged.after, answer=same)) <= 1
        ):
            message = f"your program's answer does not follow {member}"
            return target.outcome(worst(judged.ratios), message, telling=True)
    return judgement(target, judged)


def _takes(target: Target) -> Iterator[Trial]:
    """Members that change an answer of the reference, and those that are said to."""
    operation = target.operation
    if target.variant or target.dtype != "float64":  # computed once for all variants
        return
    moved: dict[tuple[str, str], tuple[bool, bool]] = {}
    for case in (CLOUDS[2], FEW[3], *operation.cases):  # the first has all members
        for variant in operation.variants:
            if moved and all(change >= wanted for change, wanted in moved.values()):
                break
            inputs = with_variant(Inputs(cases.CASES[case](), target.dtype), variant)
            answer = oracle(operation, inputs)
            for name, member, other in varied(operation, inputs):
                if not moved.get((name, member), (False, False))[0]:
                    change = differs(answer, oracle(operation, other))
                    moved[name, member] = (change, acts(operation, name, member, inputs))
    for (name, member), (change, wanted) in moved.items():
        wrong = "changes nothing" if wanted else "changes the answer, and is not in `takes`"
        error, message = (0.0, "") if change == wanted else (np.inf, wrong)
        yield Trial(f"{name}.{member} acts", functools.partial(target.outcome, error, message))


def differs(one: Mapping[str, tuple[Any, Any]], other: Mapping[str, tuple[Any, Any]]) -> bool:
    """Whether two answers in the oracle's form are not the same."""
    return any(
        len(value) != len(other[name][0]) or not np.array_equal(value, other[name][0], equal_nan=True)
        for name, (value, _) in one.items()
    )


# Each feature by itself: variants with one optional argument, where an operation's own have it only beside others

TURNED = {"period": ("rotation", "angular_momentum")}  # what no answer keeps in a box that does not turn with it


@functools.cache
def extended(name: str) -> Operation:
    """The operation with a variant for each optional argument by itself beside those of the plain one, if it acts."""
    operation = REGISTRY[name]
    plain, variants, broken = operation.variants[0], list(operation.variants), dict(operation.broken)
    present_names = [present(operation, variant) for variant in operation.variants]
    for feature in operation.optional:
        there = feature in present_names[0] or present_names[0] | {feature} in present_names
        if there or feature not in frozenset().union(*present_names):
            continue
        alone = {key: value for key, value in plain.items() if key != feature}
        if _acts(operation, alone, feature):
            having = [operation.broken.get(k, ()) for k, names in enumerate(present_names) if feature in names or not k]
            lost = {*sum(map(tuple, having), ()), *TURNED.get(feature, ())}
            broken[len(variants)] = tuple(sorted(lost))
            variants.append(alone)
    return dataclasses.replace(operation, variants=tuple(variants), broken=broken)


def present(operation: Operation, variant: Mapping[str, Any]) -> frozenset[str]:
    """Optional arguments that a variant has."""
    return frozenset(n for n in operation.optional if variant.get(n, n) is not None)


def _acts(operation: Operation, variant: Mapping[str, Any], feature: str) -> bool:
    """Whether the reference takes the feature without others, and gives another answer or a further output."""
    cases.discover()
    for case in (FEW[3], CLOUDS[2], *operation.cases):
        inputs = Inputs(cases.CASES[case](), "float64")
        try:
            with np.errstate(all="ignore"):
                answer = oracle(operation, with_variant(inputs, variant))
                plain = oracle(operation, with_variant(inputs, operation.variants[0]))
        except (TypeError, AttributeError, IndexError, KeyError, ValueError):  # it needs another one
            return False
        if answer.keys() != plain.keys() or differs(answer, plain):
            return True
    return False
