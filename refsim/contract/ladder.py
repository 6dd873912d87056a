"""The steps of the ladder, from a closed form of two particles to bad input; each gives an outcome for each trial."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim.backends.arrays import Backend, set_threads
from refsim.contract.bounds import errors, neighbour_counts, oracle, size, undecided
from refsim.contract.guards import Guards
from refsim.contract.inputs import Inputs, all_pairs, backend_for, on_backend, prepared, value_of, with_variant
from refsim.contract.parameters import acts, varied
from refsim.core import cases
from refsim.core.operation import REGISTRY, Operation, backend_of
from refsim.core.walls import WallParticles

SAMPLED_ROWS = 40
MOST_UNDECIDED = 0.1
LARGE = "large"
FEW = "few"
INVARIANT_CASES = ("cloud_3d", "cloud_2d")
TURNS = {
    2: ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 0], [1, 0, 0], [0, 0, 1]]),
    3: ([[0, 0, -1], [1, 0, 0], [0, 1, 0]], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
}
GRID = 2.0**-12  # positions on this grid are shifted without rounding


class ProgramFailed(Exception):
    """A program under test raised instead of answering; the message says what."""


@dataclass(frozen=True)
class Outcome:
    """One trial of one step: whether it passed, and the largest error as a share of what is allowed."""

    operation: str
    step: str
    trial: str
    backend: str
    dtype: str
    variant: int
    passed: bool
    error: float
    words: str = ""

    def __str__(self) -> str:
        verdict = "pass" if self.passed else "FAIL"
        return (
            f"{verdict} {self.operation} {self.step} {self.trial} on {self.backend} {self.dtype}, variant"
            f" {self.variant}: {self.error:.3g} of the bound{'; ' + self.words if self.words else ''}"
        )


@dataclass(frozen=True)
class Target:
    """One operation's program under test: one of refsim's, or a loader's own with the same arguments.

    backend  name of the program: its backend, or backend and algorithm ("cuda:fused")
    variant  number of the operation's variant
    loader   operation -> program taking the arguments of the backend's own program in their order
    calling  is told the name of the case before each call of the program, and None after it
    faults   what the program did since the last outcome beside a wrong answer; the next outcome fails by it
    """

    operation: Operation
    backend: str = "cpu"
    dtype: str = "float32"
    variant: int = 0
    loader: Callable[[Operation], Callable[..., Any]] | None = None
    calling: Callable[[str | None], None] = lambda case: None
    faults: list[str] = field(default_factory=list, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "operation", self.operation.as_computed_by(self.backend))

    @property
    def place(self) -> Backend:
        """Where the arrays live."""
        return backend_for(backend_of(self.backend))

    def outcome(self, step: str, trial: str, error: float, words: str = "") -> Outcome:
        """Passed where the error is at most the bound and no launch since the last outcome had a fault; NaN fails."""
        faults = tuple(dict.fromkeys(self.faults))
        self.faults.clear()
        passed = bool(error <= 1) and not faults
        words = "; ".join(faults) or words
        return Outcome(
            self.operation.name, step, trial, self.backend, self.dtype, self.variant, passed, float(error), words
        )

    def varied(self, inputs: Inputs) -> Inputs:
        """Inputs with this variant's overrides."""
        return with_variant(inputs, self.operation.variants[self.variant])

    def launch(
        self, inputs: Inputs, neighbours: Any = None, walls: Any = None, before: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """(outputs before, outputs after) one launch, on the host.

        Without lists those of the oracle are taken, for the particles' order as it is; `before` sets outputs. A
        program that raises, changes an input or writes beside its arrays adds to `faults`.
        """
        operation, place = self.operation, self.place
        if self.backend == "numpy":
            walls = inputs["walls"]
        elif neighbours is None:
            neighbours, walls = all_pairs(inputs, place)
        wanted = {n: inputs.output(operation, n) for n in operation.outputs if not inputs.dropped(n)}
        wanted |= {n: np.asarray(v, wanted[n].dtype) for n, v in (before or {}).items() if n in wanted}
        guards = Guards(place, operation.work)
        values = {n: guards.hold(n, on_backend(v, place), written=True) for n, v in wanted.items()}

        def lookup(name: str) -> Any:
            if name not in values:
                values[name] = guards.hold(name, value_of(operation, name, inputs, neighbours, walls, place))
            return values[name]

        if self.loader is None:
            call = operation.bind(self.backend, lookup)
        else:
            call = functools.partial(self.loader(operation), *map(lookup, operation.arguments(self.backend)))
        self.calling(inputs.case.name)
        try:
            with np.errstate(all="ignore"):
                call()
            place.synchronize()
        except ProgramFailed as error:
            self.faults.append(str(error))
        finally:
            self.calling(None)
        self.faults.extend(guards.faults())
        return wanted, {n: np.array(place.host(values[n])) for n in wanted}


def worst(found: Mapping[str, np.ndarray]) -> float:
    """Largest error over bound of all outputs."""
    return max((float(np.max(ratio, initial=0.0)) for ratio in found.values()), default=0.0)


def named_worst(found: Mapping[str, np.ndarray]) -> str:
    """Where the largest error is."""
    peaks = {n: float(np.max(r, initial=0.0)) for n, r in found.items()}
    name = max(peaks, key=lambda n: peaks[n], default="")
    return f"{name} of particle {int(np.argmax(found[name]))}" if name and peaks[name] > 0 else ""


# T1


def closed_forms(target: Target) -> Iterator[Outcome]:
    """T1: answers known in closed form, without the oracle."""
    cases.discover()
    variant = target.operation.variants[target.variant]
    for maker in cases.CLOSED_FORMS.get(target.operation.name, ()):
        exact = maker()
        written = set(target.operation.outputs) - set(target.operation.arguments("numpy"))
        dropped = {name for name, value in variant.items() if value is None and name in written}
        if any(not _same(exact.given[n], v) for n, v in variant.items() if n in exact.given and n not in dropped):
            continue
        given = {name: _cast(value, target.dtype) for name, value in exact.given.items() if name not in dropped}
        inputs = target.varied(Inputs(exact.case, target.dtype)).replaced(**given)
        start = {n: 0 * inputs.output(target.operation, n) for n in target.operation.adds}
        _, after = target.launch(inputs, before=start)
        eps = float(np.finfo(target.dtype).eps)
        found = {}
        for name, value in exact.expected.items():
            if name not in after:
                continue
            if name in target.operation.exact:
                found[name] = np.where(after[name] == value, 0.0, np.inf)
                continue
            error = size(np.asarray(after[name], dtype=float) - value)
            bound = 8 * target.operation.tolerance * eps * np.max(np.abs(value), initial=0)
            found[name] = np.where(np.isfinite(error), error / (bound + np.finfo(target.dtype).tiny), np.inf)
        yield target.outcome("T1", maker.__name__, worst(found), named_worst(found))


def _same(given: Any, override: Any) -> bool:
    if given is None or override is None:
        return given is override
    return not isinstance(override, tuple) or tuple(given) == tuple(override)


def _cast(value: Any, dtype: str) -> Any:
    """Closed forms are written in Python's numbers; kernels get the run's dtype."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*(_cast(part, dtype) for part in value))
    if isinstance(value, np.ndarray):
        return value.astype(dtype) if value.dtype.kind == "f" else value
    return np.dtype(dtype).type(value) if isinstance(value, float) else value


# T2, T3


def on_case(target: Target, name: str, step: str = "T2", lists: str = "search") -> Outcome:
    """T2: one hard input against the oracle, over the neighbour search's lists or the oracle's."""
    made, neighbours, walls = prepared(name, target.place.name, target.dtype, lists)
    inputs = target.varied(made)
    before, after = target.launch(inputs, neighbours, walls)
    answer = oracle(target.operation, inputs)
    found = errors(target.operation, inputs, before, after, answer=answer)
    words = named_worst(found)
    if inputs.case.count >= 20 and not inputs.case.ties:
        share = undecided(target.operation, inputs, answer)
        if share > MOST_UNDECIDED:
            return target.outcome(step, name, np.inf, f"{share:.0%} of the flags are too near to flipping to compare")
    return target.outcome(step, name if lists == "search" else f"{name} over all pairs", worst(found), words)


def hard_inputs(target: Target) -> Iterator[Outcome]:
    """T2: every common case and the operation's own, and one over the all-pairs list."""
    cases.discover()
    for name in (*cases.COMMON, *target.operation.cases):
        yield on_case(target, name)
    yield on_case(target, "cloud_3d", lists="all_pairs")


def large_case(target: Target) -> Iterator[Outcome]:
    """T3: a few thousand particles, sampled rows against the oracle."""
    made, neighbours, walls = prepared(LARGE, target.place.name, target.dtype)
    inputs = target.varied(made)
    before, after = target.launch(inputs, neighbours, walls)
    rows = np.sort(inputs.case.random("rows").choice(inputs.case.count, SAMPLED_ROWS, replace=False))
    found = errors(target.operation, inputs, before, after, rows)
    yield target.outcome("T3", LARGE, worst(found), named_worst(found))


# T4: what holds whatever the numbers are


def invariants(target: Target) -> Iterator[Outcome]:
    """T4: conservation and dissipation, as far as the operation claims them; no wall takes part."""
    checks = {
        "linear_momentum": _momentum,
        "angular_momentum": _angular_momentum,
        "galilean": _galilean,
        "dissipation": _dissipation,
    }
    for name in held(target):
        if name in checks:
            for trial in INVARIANT_CASES:
                inputs = target.varied(_without_walls(_on_grid(trial, target.dtype)))
                yield target.outcome("T4", f"{name} in {trial}", checks[name](target, inputs))


def held(target: Target) -> tuple[str, ...]:
    """Invariants that this variant keeps."""
    broken = target.operation.broken.get(target.variant, ())
    return tuple(name for name in target.operation.invariants if name not in broken)


def _on_grid(name: str, dtype: str) -> Inputs:
    """A case with positions and velocities on a binary grid, in the order in which it is written."""
    cases.discover()
    inputs = Inputs(cases.CASES[name](), dtype)
    walls = inputs["walls"]
    return inputs.replaced(
        position=np.round(inputs["position"] / GRID) * np.dtype(dtype).type(GRID),
        velocity=np.round(inputs["velocity"] / GRID) * np.dtype(dtype).type(GRID),
        walls=walls._replace(position=(np.round(walls.position / GRID) * GRID).astype(dtype)),
    )


def _without_walls(inputs: Inputs) -> Inputs:
    none = WallParticles(np.zeros((0, 3), inputs.dtype), np.zeros(0, inputs.dtype))
    return inputs.replaced(walls=none)


def _force(target: Target, inputs: Inputs) -> tuple[np.ndarray, np.ndarray]:
    """(m a, bound on the rounding of m a) for each particle, from zero."""
    count = len(inputs["position"])
    _, after = target.launch(inputs, before={"acceleration": np.zeros((count, 3))})
    mass = np.asarray(inputs["mass"], dtype=float)
    _, scale = oracle(target.operation, inputs)["acceleration"]
    eps = float(np.finfo(target.dtype).eps)
    bound = target.operation.tolerance * (neighbour_counts(target.operation, inputs) + 1) * eps * mass * size(scale)
    return mass[:, None] * np.asarray(after["acceleration"], dtype=float), bound


def _momentum(target: Target, inputs: Inputs) -> float:
    force, bound = _force(target, inputs)
    return float(size(force.sum(0)[None])[0] / bound.sum())


def _angular_momentum(target: Target, inputs: Inputs) -> float:
    force, bound = _force(target, inputs)
    arm = np.asarray(inputs["position"], dtype=float)
    arm = arm - arm.mean(0)
    return float(size(np.cross(arm, force).sum(0)[None])[0] / (bound * size(arm)).sum())


def _galilean(target: Target, inputs: Inputs) -> float:
    """A common velocity, added without rounding, changes nothing at all."""
    wind = np.array([4.0, -2.0, 0.0], dtype=target.dtype)
    _, still = target.launch(inputs)
    _, moved = target.launch(inputs.replaced(velocity=inputs["velocity"] + wind))
    return 0.0 if all(np.array_equal(still[n], moved[n]) for n in still) else np.inf


def _dissipation(target: Target, inputs: Inputs) -> float:
    """Without pressure the kinetic energy falls; also where all that moves is one particle."""
    calm = inputs.replaced(pressure=0 * inputs["pressure"])
    lone = 0 * inputs["velocity"]
    lone[len(lone) // 2] = [1.0, 2.0, 0.0]
    for velocity in (inputs["velocity"], lone):
        force, _ = _force(target, calm.replaced(velocity=velocity))
        if not (force * velocity).sum() < 0:
            return np.inf
    return 0.0


# T5: the same particles, described otherwise


def symmetries(target: Target) -> Iterator[Outcome]:
    """T5: translation, rotation (by exact turns and reflections) and another order of the particles."""
    for trial in INVARIANT_CASES:
        inputs = target.varied(_on_grid(trial, target.dtype))
        dim = inputs.case.dim
        names = [n for n in target.operation.arguments("numpy") if inputs.per_particle(n) and not inputs.dropped(n)]
        names += [n for n in target.operation.outputs if inputs.per_particle(n) and n in target.operation.adds]
        before, after = target.launch(inputs)
        answer = oracle(target.operation, inputs)

        def compared(
            name: str, other: Inputs, back: Callable[[Any], Any], inputs: Inputs = inputs,
            before: dict = before, after: dict = after, answer: dict = answer, trial: str = trial,
        ) -> Outcome:  # fmt: skip
            """The other description's answer, brought back, against this one's; twice the bound, once for each."""
            _, moved = target.launch(other)
            scales = {n: (after[n] - (before[n] if n in target.operation.adds else 0), answer[n][1]) for n in after}
            brought = {n: back(v) if inputs.per_particle(n) else v for n, v in moved.items()}
            found = errors(target.operation, inputs, before, brought, answer=scales, share=2.0)
            return target.outcome("T5", f"{name} of {trial}", worst(found), named_worst(found))

        kept = held(target)
        if "translation" in kept:
            shift = np.array([4.0, -2.0, 1.0 if dim == 3 else 0.0], dtype=target.dtype)
            walls = inputs["walls"]
            if walls is not None:
                walls = walls._replace(position=walls.position + shift)
            yield compared("translation", inputs.replaced(position=inputs["position"] + shift, walls=walls), _as_is)
        if "reordering" in kept:
            order = inputs.case.random("order").permutation(inputs.case.count)
            changed = {n: inputs[n][order] for n in names}
            yield compared("reordering", inputs.replaced(**changed), lambda v, order=order: _unsorted(v, order))
        if "rotation" in kept:
            for number, turn in enumerate(np.array(TURNS[dim], dtype=target.dtype)):
                changed = {n: inputs[n] @ turn.T for n in names if inputs[n].ndim == 2}
                if inputs["walls"] is not None:
                    changed["walls"] = inputs["walls"]._replace(position=inputs["walls"].position @ turn.T)
                yield compared(
                    f"rotation {number}",
                    inputs.replaced(**changed),
                    lambda v, turn=turn: v @ turn if v.ndim == 2 else v,
                )


def _as_is(values: np.ndarray) -> np.ndarray:
    return values


def _unsorted(values: np.ndarray, order: np.ndarray) -> np.ndarray:
    result = np.empty_like(values)
    result[order] = values
    return result


# T6, T7


def repeats(target: Target) -> Iterator[Outcome]:
    """T6: the same bits again; on the CPU also on one, two and all threads."""
    made, neighbours, walls = prepared("cloud_3d", target.place.name, target.dtype)
    inputs = target.varied(made)
    counts: tuple[int | None, ...] = (None, None)
    if target.place.name == "cpu":
        import numba

        counts = tuple(sorted({1, min(2, numba.config.NUMBA_NUM_THREADS), numba.config.NUMBA_NUM_THREADS})) * 2
    answers = []
    try:
        for threads in counts:
            set_threads(target.place, threads)
            answers.append(target.launch(inputs, neighbours, walls)[1])
    finally:
        set_threads(target.place, None)
    same = all(a[n].tobytes() == answers[0][n].tobytes() for a in answers for n in a)
    trial = "again" if target.place.name != "cpu" else f"on {', '.join(map(str, counts))} threads"
    yield target.outcome("T6", trial, 0.0 if same else np.inf)


def additivity(target: Target) -> Iterator[Outcome]:
    """T7: outputs that are added to gain the same from any start; the others do not depend on what stood there."""
    inputs = target.varied(_on_grid("cloud_3d", target.dtype))
    operation = target.operation
    free = [n for n in operation.outputs if not inputs.dropped(n) and n not in operation.arguments("numpy")]
    if not free:
        return
    zero = {n: 0 * inputs.output(operation, n) for n in free if n in operation.adds}
    _, first = target.launch(inputs, before=zero)
    other = {n: np.full_like(first[n], 7) for n in free if n not in operation.adds}
    start = {n: 3 * first[n] for n in zero}
    begun, second = target.launch(inputs, before=other | start)
    answer = {n: (first[n].astype(float), oracle(operation, inputs)[n][1]) for n in zero}
    found = errors(operation, inputs, begun, second, answer=answer, share=2.0) if zero else {}
    found |= {n: np.array([0.0 if first[n].tobytes() == second[n].tobytes() else np.inf]) for n in other}
    yield target.outcome("T7", "from another start", worst(found), named_worst(found))


# T9


def bad_input(target: Target) -> Iterator[Outcome]:
    """T9: a NaN in one particle's values stays visible in every answer that depends on them, and changes no other.

    What depends on them is what the oracle changes where they change. Flags cannot show a NaN; a position that is
    not finite is the search's to report.
    """
    inputs = target.varied(_on_grid("cloud_3d", target.dtype))
    operation, broken = target.operation, 11
    distance = size(np.asarray(inputs["position"], dtype=float) - inputs["position"][broken])
    far = (distance > 1.1 * inputs.case.list_radius * operation.reach) & (operation.reach > 0)
    answer = oracle(operation, inputs)
    for name in operation.arguments("numpy"):
        values = inputs[name]
        if name == "position" or not inputs.per_particle(name) or values is None or values.dtype.kind != "f":
            continue
        changed, spoiled = np.array(values), np.array(values)
        changed[broken] = 1.5 * changed[broken] + 1
        spoiled[broken] = np.nan
        other = oracle(operation, inputs.replaced(**{name: changed}))
        broken_inputs = inputs.replaced(**{name: spoiled})
        before, after = target.launch(broken_inputs)
        whole = {n: v for n, v in oracle(operation, broken_inputs).items() if not inputs.per_particle(n)}
        counted = errors(operation, broken_inputs, before, after, answer=whole)
        found, visible = {}, False
        for output, (value, scale) in answer.items():
            depends = np.abs(other[output][0] - value) > 1e-9 * scale
            got = ~np.isfinite(after[output])
            if inputs.per_particle(output) and output not in operation.exact:
                depends, got = (m.reshape(len(m), -1).any(1) for m in (depends, got))
                found[output] = np.where((depends & ~got) | (far & got), np.inf, 0.0)
                visible |= depends.any()
            elif output in whole:  # what the oracle can still say of the whole set must be right
                known = np.isfinite(whole[output][0])
                known = known.reshape(len(known), -1).all(1) if known.ndim > counted[output].ndim else known
                found[output] = np.where(known, counted[output], 0.0)
                visible |= got.any() or (after[output] != before[output]).any()
        used = any((np.abs(other[n][0] - v) > 1e-9 * s).any() for n, (v, s) in answer.items())
        if found or not operation.exact:
            error = worst(found) if visible or not used else np.inf
            yield target.outcome("T9", f"NaN in {name}", error, named_worst(found))


# T10


def parameters(target: Target) -> Iterator[Outcome]:
    """T10: another value of each member of each parameter group, one at a time; the answer follows as the oracle's.

    On the references: that there is an answer to follow, in one of the variants and cases, for all that the operation
    says it takes.
    """
    cases.discover()
    if target.backend == "numpy":
        yield from _takes(target)
        return
    operation = target.operation
    made, neighbours, walls = prepared(FEW, target.place.name, target.dtype)
    start = target.varied(made)
    usual = None
    for name, member, inputs in varied(operation, start):
        if name not in operation.arguments(target.backend):
            continue  # fixed in a program that serves some of the operation's variants
        if acts(operation, name, member, start):
            answer = oracle(operation, inputs)
        else:
            usual = answer = oracle(operation, start) if usual is None else usual
        if any(len(value) != len(inputs.output(operation, n)) for n, (value, _) in answer.items()):
            continue  # a table with another number of rows than the case's
        before, after = target.launch(inputs, neighbours, walls)
        found = errors(operation, inputs, before, after, answer=answer)
        yield target.outcome("T10", f"another {name}.{member}", worst(found), named_worst(found))


def _takes(target: Target) -> Iterator[Outcome]:
    """Members that change an answer of the reference, and those that are said to."""
    operation = target.operation
    if target.variant or target.dtype != "float64":  # computed once for all variants
        return
    moved: dict[tuple[str, str], tuple[bool, bool]] = {}
    for case in (FEW, "cloud_2d", *operation.cases):
        for variant in operation.variants:
            if moved and all(found >= wanted for found, wanted in moved.values()):
                break
            inputs = with_variant(Inputs(cases.CASES[case](), target.dtype), variant)
            answer = oracle(operation, inputs)
            for name, member, other in varied(operation, inputs):
                if not moved.get((name, member), (False, False))[0]:
                    found = differs(answer, oracle(operation, other))
                    moved[name, member] = (found, acts(operation, name, member, inputs))
    for (name, member), (found, wanted) in moved.items():
        words = "" if found == wanted else "changes nothing" if wanted else "changes the answer, and is not in `takes`"
        yield target.outcome("T10", f"{name}.{member} acts", 0.0 if found == wanted else np.inf, words)


def differs(one: Mapping[str, tuple[Any, Any]], other: Mapping[str, tuple[Any, Any]]) -> bool:
    """Whether two answers in the oracle's form are not the same."""
    return any(
        len(value) != len(other[name][0]) or not np.array_equal(value, other[name][0], equal_nan=True)
        for name, (value, _) in one.items()
    )


STEPS: dict[str, Callable[[Target], Iterator[Outcome]]] = {
    "T1": closed_forms,
    "T2": hard_inputs,
    "T3": large_case,
    "T4": invariants,
    "T5": symmetries,
    "T6": repeats,
    "T7": additivity,
    "T9": bad_input,
    "T10": parameters,
}
AGAINST_ORACLE = ("T2", "T3", "T9")  # say nothing about the oracle itself


def run(operation: Operation | str, backend: str, dtype: str, case: str, variant: int = 0) -> Outcome:
    """One operation's program on one case against the oracle (T2)."""
    operation = REGISTRY[operation] if isinstance(operation, str) else operation
    return on_case(Target(operation, backend, dtype, variant), case)


def climbing(
    target: Target,
    steps: tuple[str, ...] | None = None,
    begin: Callable[[str, int, str], None] = lambda dtype, variant, step: None,
) -> Iterator[Outcome]:
    """Outcomes of all steps, or of those named, as they come; for the references those that judge them.

    begin  is told of (dtype, variant, step) before each step

    A trial fails in which the program raises, changes an input or writes beside its arrays.
    """
    for name in STEPS if steps is None else steps:
        if target.backend == "numpy" and name in AGAINST_ORACLE:
            continue
        begin(target.dtype, target.variant, name)
        yield from STEPS[name](target)
        if target.faults:
            yield target.outcome(name, "the rest of the step", np.inf)


def climb(target: Target, steps: tuple[str, ...] | None = None) -> list[Outcome]:
    """Outcomes of all steps, or of those named; for the references those that judge them."""
    return list(climbing(target, steps))


def check(
    name: str,
    program_loader: Callable[[Operation], Callable[..., Any]] | None = None,
    backend: str = "cpu",
    dtypes: tuple[str, ...] = ("float32", "float64"),
    variants: tuple[int, ...] | None = None,
    steps: tuple[str, ...] | None = None,
) -> list[Outcome]:
    """Outcomes of the whole ladder for operation `name`.

    program_loader  operation -> a plain callable that takes what refsim's own program on `backend` takes, in that
                    order, and writes its outputs in place; refsim's own by default
    backend         whose arrays and neighbour lists the callable takes: "cpu" (NumPy arrays, NeighbourRows) or
                    "cuda" (device arrays, NeighbourColumns)
    dtypes          in which it is run
    variants        numbers of the operation's variants; all by default
    steps           names in STEPS; all by default

    Raises KeyError for an unknown operation and InputError for a backend that is not there.
    """
    operation = REGISTRY[name]
    target = Target(operation, backend, loader=program_loader)
    numbers = range(len(operation.variants)) if variants is None else variants
    return [
        outcome
        for dtype in dtypes
        for number in numbers
        for outcome in climb(dataclasses.replace(target, dtype=dtype, variant=number), steps)
    ]
