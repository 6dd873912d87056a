"""The steps of the ladder, from a closed form of two particles to bad input; each gives an outcome for each trial."""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim.backends.arrays import Backend, set_threads
from refsim.contract.bounds import errors, exact_bound, neighbour_counts, oracle, size, undecided
from refsim.contract.diagnosis import diagnosis, unwritten
from refsim.contract.guards import Guards
from refsim.contract.inputs import (
    Inputs,
    all_pairs,
    backend_for,
    on_backend,
    period_of,
    prepared,
    value_of,
    with_variant,
)
from refsim.contract.parameters import acts, varied
from refsim.core import cases
from refsim.core.operation import REGISTRY, Operation, backend_of
from refsim.core.walls import WallParticles
from refsim.neighbours.reference import nearest_image

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


class NotJudged(Exception):
    """The inputs hold something that the program is declared not to support; the message names it."""


@dataclass(frozen=True)
class Outcome:
    """One trial of one step: whether it passed, and the largest error as a share of what is allowed.

    not_judged  what the trial needs that the program is declared not to support; then nothing ran, and it did not pass
    """

    operation: str
    step: str
    trial: str
    backend: str
    dtype: str
    variant: int
    passed: bool
    error: float
    words: str = ""
    not_judged: str = ""

    def __str__(self) -> str:
        verdict = "pass" if self.passed else "FAIL"
        if self.not_judged:
            return f"not judged: {self.operation} {self.step} {self.trial}, variant {self.variant}: {self.not_judged}"
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
    excludes (operation, inputs) -> what the program does not support of them, as a clause; "" if it supports all
    """

    operation: Operation
    backend: str = "cpu"
    dtype: str = "float32"
    variant: int = 0
    loader: Callable[[Operation], Callable[..., Any]] | None = None
    calling: Callable[[str | None], None] = lambda case: None
    faults: list[str] = field(default_factory=list, compare=False, repr=False)
    excludes: Callable[[Operation, Inputs], str] = lambda operation, inputs: ""

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

    def prepared(self, case: str, lists: str = "search") -> tuple[Inputs, Any, Any]:
        """(inputs with this variant's overrides, neighbours, walls with their list) of a case by name."""
        period = period_of(self.operation, self.varied(Inputs(cases.CASES[case](), self.dtype)))
        made, neighbours, walls = prepared(case, self.place.name, self.dtype, lists, period)
        return self.varied(made), neighbours, walls

    def launch(
        self,
        inputs: Inputs,
        neighbours: Any = None,
        walls: Any = None,
        before: Mapping[str, Any] | None = None,
        complete: bool = True,
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """(outputs before, outputs after) one launch, on the host.

        Without lists those of the oracle are taken, for the particles' order as it is; `before` sets outputs. A
        program that raises, changes an input, writes beside its arrays or (with `complete`) leaves an output unset
        adds to `faults`.
        Raises NotJudged for inputs that the program is declared not to support.
        """
        operation, place = self.operation, self.place
        excluded = self.excludes(operation, inputs)
        if excluded:
            raise NotJudged(excluded)
        if self.backend == "numpy":
            walls = inputs["walls"]
        elif neighbours is None:
            neighbours, walls = all_pairs(inputs, place, period_of(operation, inputs))
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
        after = {n: np.array(place.host(values[n])) for n in wanted}
        if complete and not self.faults:
            left = ", ".join(unwritten(wanted, after, before or {}))
            self.faults.extend([f"your program does not write {left}"] if left else ())
        return wanted, after


@dataclass(frozen=True)
class Trial:
    """One trial of one step, by a name that is known before the program is called; None where it does not apply."""

    step: str
    name: str
    run: Callable[[], Outcome | None]


Answer = Callable[[], Mapping[str, tuple[Any, Any]]]


def worst(found: Mapping[str, np.ndarray]) -> float:
    """Largest error over bound of all outputs."""
    return max((float(np.max(ratio, initial=0.0)) for ratio in found.values()), default=0.0)


def named_worst(found: Mapping[str, np.ndarray]) -> str:
    """Where the largest error is."""
    peaks = {n: float(np.max(r, initial=0.0)) for n, r in found.items()}
    name = max(peaks, key=lambda n: peaks[n], default="")
    return f"{name} of particle {int(np.argmax(found[name]))}" if name and peaks[name] > 0 else ""


# T1


def closed_forms(target: Target) -> Iterator[Trial]:
    """T1: answers known in closed form, without the oracle."""
    for name, exact in exact_forms(target.operation, target.operation.variants[target.variant]):
        yield Trial("T1", name, functools.partial(_closed_form, target, name, exact))


def exact_forms(operation: Operation, variant: Mapping[str, Any]) -> Iterator[tuple[str, cases.Exact]]:
    """(name, closed form) of those that are worked out for the variant."""
    cases.discover()
    dropped = _dropped_outputs(operation, variant)
    for maker in cases.CLOSED_FORMS.get(operation.name, ()):
        exact = maker()
        if all(_same(exact.given[n], v) for n, v in variant.items() if n in exact.given and n not in dropped):
            yield maker.__name__, exact


def exact_inputs(operation: Operation, variant: Mapping[str, Any], exact: cases.Exact, dtype: str) -> Inputs:
    """The inputs of a closed form."""
    dropped = _dropped_outputs(operation, variant)
    given = {name: typed(name, value, dtype) for name, value in exact.given.items() if name not in dropped}
    return with_variant(Inputs(exact.case, dtype), variant).replaced(**given)


def _dropped_outputs(operation: Operation, variant: Mapping[str, Any]) -> set[str]:
    written = set(operation.outputs) - set(operation.arguments("numpy"))
    return {name for name, value in variant.items() if value is None and name in written}


def _closed_form(target: Target, trial: str, exact: cases.Exact) -> Outcome:
    inputs = exact_inputs(target.operation, target.operation.variants[target.variant], exact, target.dtype)
    start = {n: 0 * inputs.output(target.operation, n) for n in target.operation.adds}
    before, after = target.launch(inputs, before=start)
    found = {}
    for name, value in exact.expected.items():
        if name not in after:
            continue
        if name in target.operation.exact:
            found[name] = np.where(after[name] == value, 0.0, np.inf)
            continue
        error = size(np.asarray(after[name], dtype=float) - value)
        found[name] = np.where(np.isfinite(error), error / exact_bound(target.operation, value, target.dtype), np.inf)
    answer = {name: (np.asarray(value, dtype=float), 0) for name, value in exact.expected.items()}
    return target.outcome("T1", trial, worst(found), diagnosis(target.operation, before, after, answer, found))


def _same(given: Any, override: Any) -> bool:
    if given is None or override is None:
        return given is override
    return not isinstance(override, Mapping) or all(getattr(given, name) == value for name, value in override.items())


def typed(name: str, value: Any, dtype: str) -> Any:
    """The argument `name` of a closed form, written in Python's numbers, with the types that it has in a run."""
    return _cast(value, _usual(name, dtype) if hasattr(value, "_fields") else None, dtype)


@functools.cache
def _usual(name: str, dtype: str) -> Any:
    """The parameter group `name` as a run has it: some of its numbers are float64 whatever the run's dtype is."""
    return Inputs(cases.CASES[FEW](), dtype)[name]


def _cast(value: Any, usual: Any, dtype: str) -> Any:
    """Floats in `value`, a grid's too, as `dtype`, and in a group as float64 where the group `usual` has that."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        others = usual if type(usual) is type(value) else (None,) * len(value)
        return type(value)(*(_cast(part, other, dtype) for part, other in zip(value, others)))
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return value.astype(usual.dtype if isinstance(usual, np.ndarray) else dtype)
    if isinstance(value, float):
        return float(value) if isinstance(usual, float) else np.dtype(dtype).type(value)
    if hasattr(value, "on_backend"):  # a grid, whose copy on a backend has node arrays of its dtype
        value = copy.copy(value)
        value.dtype = dtype
    return value


# T2, T3


def on_case(target: Target, name: str, step: str = "T2", lists: str = "search") -> Outcome:
    """T2: one hard input against the oracle, over the neighbour search's lists or the oracle's."""
    inputs, neighbours, walls = target.prepared(name, lists)
    before, after = target.launch(inputs, neighbours, walls)
    answer = oracle(target.operation, inputs)
    found = errors(target.operation, inputs, before, after, answer=answer)
    words = diagnosis(target.operation, before, after, answer, found)
    if inputs.case.count >= 20 and not inputs.case.ties:
        share = undecided(target.operation, inputs, answer)
        if share > MOST_UNDECIDED:
            return target.outcome(step, name, np.inf, f"{share:.0%} of the flags are too near to flipping to compare")
    return target.outcome(step, name if lists == "search" else f"{name} over all pairs", worst(found), words)


def hard_inputs(target: Target) -> Iterator[Trial]:
    """T2: every common case and the operation's own, and one over the all-pairs list."""
    cases.discover()
    for name in (*cases.COMMON, *target.operation.cases):
        yield Trial("T2", name, functools.partial(on_case, target, name))
    yield Trial("T2", "cloud_3d over all pairs", functools.partial(on_case, target, "cloud_3d", lists="all_pairs"))


def large_case(target: Target) -> Iterator[Trial]:
    """T3: a few thousand particles, sampled rows against the oracle."""
    yield Trial("T3", LARGE, functools.partial(_large, target))


def _large(target: Target) -> Outcome:
    inputs, neighbours, walls = target.prepared(LARGE)
    before, after = target.launch(inputs, neighbours, walls)
    rows = np.sort(inputs.case.random("rows").choice(inputs.case.count, SAMPLED_ROWS, replace=False))
    answer = oracle(target.operation, inputs, rows)
    found = errors(target.operation, inputs, before, after, rows, answer)
    words = diagnosis(target.operation, before, after, answer, found, rows)
    return target.outcome("T3", LARGE, worst(found), words)


# T4: what holds whatever the numbers are


def invariants(target: Target) -> Iterator[Trial]:
    """T4: conservation and dissipation, as far as the operation claims them; no wall takes part."""
    for name in held(target):
        if name in CONSERVED:
            for case in INVARIANT_CASES:
                yield Trial("T4", f"{name} in {case}", functools.partial(_conserved, target, name, case))


def _conserved(target: Target, name: str, case: str) -> Outcome:
    check, words = CONSERVED[name]
    error = check(target, target.varied(_without_walls(_on_grid(case, target.dtype))))
    return target.outcome("T4", f"{name} in {case}", error, "" if error <= 1 else words)


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


CONSERVED = {
    "linear_momentum": (_momentum, "the sum of m a over all particles is not zero"),
    "angular_momentum": (_angular_momentum, "the sum of m x cross a over all particles is not zero"),
    "galilean": (_galilean, "a velocity added to all particles changes the answer"),
    "dissipation": (_dissipation, "without pressure the kinetic energy does not fall"),
}

# T5: the same particles, described otherwise

Description = tuple[Inputs, Callable[[np.ndarray], np.ndarray]]  # inputs, and what brings an answer back


def symmetries(target: Target) -> Iterator[Trial]:
    """T5: translation, rotation (by exact turns and reflections) and another order of the particles.

    In a periodic box also other images of some particles.
    """
    kept = held(target)
    for case in INVARIANT_CASES:
        usual = _Usual(target, case)
        described: dict[str, Callable[[], Description]] = {}
        if "translation" in kept:
            described["translation"] = functools.partial(_translated, usual)
        if "reordering" in kept:
            described["reordering"] = functools.partial(_reordered, usual)
        if "rotation" in kept:
            described |= {f"rotation {k}": functools.partial(_rotated, usual, k) for k in (0, 1)}
        if period_of(target.operation, usual.inputs) is not None:
            described["images"] = functools.partial(_other_images, usual)
        for name, other in described.items():
            yield Trial("T5", f"{name} of {case}", functools.partial(_compared, usual, name, other))


class _Usual:
    """A case as it stands, and the answer to it, computed when the first trial needs it."""

    def __init__(self, target: Target, case: str) -> None:
        self.target, self.case = target, case

    @functools.cached_property
    def inputs(self) -> Inputs:
        return self.target.varied(_on_grid(self.case, self.target.dtype))

    @functools.cached_property
    def expected(self) -> dict[str, tuple[Any, Any]]:
        """The oracle's answer."""
        return oracle(self.target.operation, self.inputs)

    @functools.cached_property
    def answer(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], dict[str, tuple[Any, Any]]]:
        """(outputs before, outputs after, the oracle's answer)."""
        return *self.target.launch(self.inputs), self.expected

    @functools.cached_property
    def names(self) -> list[str]:
        """Arrays with one row for each particle that the operation reads or adds to."""
        operation, inputs = self.target.operation, self.inputs
        names = [n for n in operation.arguments("numpy") if inputs.per_particle(n) and not inputs.dropped(n)]
        return names + [n for n in operation.outputs if inputs.per_particle(n) and n in operation.adds]


def _compared(usual: _Usual, name: str, other: Callable[[], Description]) -> Outcome:
    """The other description's answer, brought back, against this one's; twice the bound, once for each."""
    target, inputs = usual.target, usual.inputs
    before, after, answer = usual.answer
    described, back = other()
    _, moved = target.launch(described)
    scales = {n: (after[n] - (before[n] if n in target.operation.adds else 0), answer[n][1]) for n in after}
    brought = {n: back(v) if inputs.per_particle(n) else v for n, v in moved.items()}
    found = errors(target.operation, inputs, before, brought, answer=scales, share=2.0)
    words = named_worst(found)
    if not worst(found) <= 1:
        words = f"your program's answer does not follow a {name.split()[0]} of all particles: {words}"
    return target.outcome("T5", f"{name} of {usual.case}", worst(found), words)


def _translated(usual: _Usual) -> Description:
    inputs = usual.inputs
    shift = np.array([4.0, -2.0, 1.0 if inputs.case.dim == 3 else 0.0], dtype=usual.target.dtype)
    walls = inputs["walls"]
    if walls is not None:
        walls = walls._replace(position=walls.position + shift)
    return inputs.replaced(position=inputs["position"] + shift, walls=walls), lambda values: values


def _other_images(usual: _Usual) -> Description:
    """Every third particle one period further on, and the next back by one."""
    inputs = usual.inputs
    position, lengths = np.array(inputs["position"]), np.array(inputs["period"][:3], dtype=usual.target.dtype)
    position[::3] += lengths
    position[1::3] -= lengths
    return inputs.replaced(position=position), lambda values: values


def _reordered(usual: _Usual) -> Description:
    inputs = usual.inputs
    order = inputs.case.random("order").permutation(inputs.case.count)
    changed = {n: inputs[n][order] for n in usual.names}
    return inputs.replaced(**changed), lambda values: _unsorted(values, order)


def _rotated(usual: _Usual, number: int) -> Description:
    inputs = usual.inputs
    turn = np.array(TURNS[inputs.case.dim], dtype=usual.target.dtype)[number]
    changed = {n: inputs[n] @ turn.T for n in usual.names if inputs[n].ndim == 2}
    if inputs["walls"] is not None:
        changed["walls"] = inputs["walls"]._replace(position=inputs["walls"].position @ turn.T)
    return inputs.replaced(**changed), lambda values: values @ turn if values.ndim == 2 else values


def _unsorted(values: np.ndarray, order: np.ndarray) -> np.ndarray:
    result = np.empty_like(values)
    result[order] = values
    return result


# T6, T7


def repeats(target: Target) -> Iterator[Trial]:
    """T6: the same bits again; on the CPU also on one, two and all threads."""
    counts: tuple[int | None, ...] = (None, None)
    if target.place.name == "cpu":
        import numba

        counts = tuple(sorted({1, min(2, numba.config.NUMBA_NUM_THREADS), numba.config.NUMBA_NUM_THREADS})) * 2
    trial = "again" if target.place.name != "cpu" else f"on {', '.join(map(str, counts))} threads"
    yield Trial("T6", trial, functools.partial(_repeated, target, trial, counts))


def _repeated(target: Target, trial: str, counts: tuple[int | None, ...]) -> Outcome:
    inputs, neighbours, walls = target.prepared("cloud_3d")
    answers = []
    try:
        for threads in counts:
            set_threads(target.place, threads)
            answers.append(target.launch(inputs, neighbours, walls)[1])
    finally:
        set_threads(target.place, None)
    same = all(a[n].tobytes() == answers[0][n].tobytes() for a in answers for n in a)
    words = "" if same else "your program gives other bits for the same inputs"
    return target.outcome("T6", trial, 0.0 if same else np.inf, words)


def additivity(target: Target) -> Iterator[Trial]:
    """T7: outputs that are added to gain the same from any start; the others do not depend on what stood there."""
    operation, variant = target.operation, target.operation.variants[target.variant]
    left_out = {name for name, value in variant.items() if value is None}
    free = [n for n in operation.outputs if n not in left_out and n not in operation.arguments("numpy")]
    if free:
        yield Trial("T7", "from another start", functools.partial(_from_another_start, target, free))


def _from_another_start(target: Target, free: list[str]) -> Outcome:
    inputs = target.varied(_on_grid("cloud_3d", target.dtype))
    operation = target.operation
    zero = {n: 0 * inputs.output(operation, n) for n in free if n in operation.adds}
    _, first = target.launch(inputs, before=zero)
    other = {n: np.full_like(first[n], 7) for n in free if n not in operation.adds}
    start = {n: 3 * first[n] for n in zero}
    begun, second = target.launch(inputs, before=other | start)
    usual = oracle(operation, inputs) if zero else {}
    answer = {n: (first[n].astype(float), usual[n][1]) for n in zero}
    found = errors(operation, inputs, begun, second, answer=answer, share=2.0) if zero else {}
    found |= {n: np.array([0.0 if first[n].tobytes() == second[n].tobytes() else np.inf]) for n in other}
    words = named_worst(found)
    if not worst(found) <= 1:
        peak = words.split()[0]
        must = "add to it" if peak in operation.adds else "assign it"
        words = f"your program's answer depends on what stood in {peak} before; it must {must}"
        if peak in other and second[peak].tobytes() == np.asarray(other[peak], second[peak].dtype).tobytes():
            words = f"your program does not write {peak}"
    return target.outcome("T7", "from another start", worst(found), words)


# T9


def bad_input(target: Target) -> Iterator[Trial]:
    """T9: a NaN in one particle's values stays visible in every answer that depends on them, and changes no other.

    What depends on them is what the oracle changes where they change. Flags cannot show a NaN; a position that is
    not finite, or has such a residual or shift, is the search's to report.
    """
    usual = _Usual(target, "cloud_3d")
    operation, inputs = target.operation, usual.inputs
    written = [n for n in operation.outputs if not inputs.dropped(n)]
    if operation.exact and all(n in operation.exact and inputs.per_particle(n) for n in written):
        return
    for name in operation.arguments("numpy"):
        if name in ("position", "position_residual", "shift") or not inputs.per_particle(name):
            continue
        if inputs[name] is not None and inputs[name].dtype.kind == "f":
            yield Trial("T9", f"NaN in {name}", functools.partial(_spoiled, usual, name))


def _spoiled(usual: _Usual, name: str) -> Outcome:
    target, inputs, broken = usual.target, usual.inputs, 11
    operation = target.operation
    changed, spoiled = np.array(inputs[name]), np.array(inputs[name])
    changed[broken] = 1.5 * changed[broken] + 1
    spoiled[broken] = np.nan
    broken_inputs = inputs.replaced(**{name: spoiled})
    before, after = target.launch(broken_inputs, complete=False)  # an iteration may end at the NaN
    apart = np.asarray(inputs["position"], dtype=float) - inputs["position"][broken]
    period = period_of(operation, inputs)
    distance = size(apart if period is None else nearest_image(apart, period))
    far = (distance > 1.1 * inputs.case.list_radius * operation.reach) & (operation.reach > 0)
    answer = usual.expected
    other = oracle(operation, inputs.replaced(**{name: changed}))
    of_all = [n for n in answer if not inputs.per_particle(n)]
    whole = {n: v for n, v in (oracle(operation, broken_inputs) if of_all else {}).items() if n in of_all}
    counted = errors(operation, broken_inputs, before, after, answer=whole)
    found, visible, words = {}, False, ""
    for output, (value, scale) in answer.items():
        depends = np.abs(other[output][0] - value) > 1e-9 * scale
        got = ~np.isfinite(after[output])
        if inputs.per_particle(output) and output not in operation.exact:
            depends, got = (m.reshape(len(m), -1).any(1) for m in (depends, got))
            found[output] = np.where((depends & ~got) | (far & got), np.inf, 0.0)
            visible |= depends.any()
            if (depends & ~got).any():
                words = f"a NaN in {name} does not show in {output}, which depends on it"
            elif (far & got).any():
                words = f"a NaN in {name} of one particle spreads to {output} of particles far away"
        elif output in whole:  # what the oracle can still say of the whole set must be right
            known = np.isfinite(whole[output][0])
            known = known.reshape(len(known), -1).all(1) if known.ndim > counted[output].ndim else known
            found[output] = np.where(known, counted[output], 0.0)
            visible |= got.any() or (after[output] != before[output]).any()
    used = any((np.abs(other[n][0] - v) > 1e-9 * s).any() for n, (v, s) in answer.items())
    error = worst(found) if visible or not used else np.inf
    return target.outcome("T9", f"NaN in {name}", error, words or named_worst(found))


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
    start, neighbours, walls = target.prepared(FEW)
    usual = functools.cache(lambda: oracle(operation, start))
    for name, member, inputs in varied(operation, start):
        if name in operation.arguments(target.backend):  # else fixed in a program that serves some of the variants
            acting = acts(operation, name, member, start)
            answer = functools.partial(oracle, operation, inputs) if acting else usual
            given = (inputs, None, None) if name == "period" else (inputs, neighbours, walls)  # which has other lists
            run = functools.partial(_another, target, f"{name}.{member}", given, answer, usual if acting else None)
            yield Trial("T10", f"another {name}.{member}", run)


def _another(
    target: Target, member: str, given: tuple[Inputs, Any, Any], answer: Answer, usual: Answer | None
) -> Outcome | None:
    inputs, operation = given[0], target.operation
    right = answer()
    if any(len(value) != len(inputs.output(operation, n)) for n, (value, _) in right.items()):
        return None  # a table with another number of rows than the case's
    before, after = target.launch(*given)
    found = errors(operation, inputs, before, after, answer=right)
    words = diagnosis(operation, before, after, right, found)
    if usual is not None and not worst(found) <= 1:
        same = usual()
        if all(value.shape == same[n][0].shape for n, (value, _) in right.items()) and (
            worst(errors(operation, inputs, before, after, answer=same)) <= 1
        ):
            words = f"your program's answer does not follow {member}"
    return target.outcome("T10", f"another {member}", worst(found), words)


def _takes(target: Target) -> Iterator[Trial]:
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
        error = 0.0 if found == wanted else np.inf
        trial = f"{name}.{member} acts"
        yield Trial("T10", trial, functools.partial(target.outcome, "T10", trial, error, words))


def differs(one: Mapping[str, tuple[Any, Any]], other: Mapping[str, tuple[Any, Any]]) -> bool:
    """Whether two answers in the oracle's form are not the same."""
    return any(
        len(value) != len(other[name][0]) or not np.array_equal(value, other[name][0], equal_nan=True)
        for name, (value, _) in one.items()
    )


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
}
AGAINST_ORACLE = ("T2", "T3", "T9")  # say nothing about the oracle itself


def run(operation: Operation | str, backend: str, dtype: str, case: str, variant: int = 0) -> Outcome:
    """One operation's program on one case against the oracle (T2)."""
    operation = REGISTRY[operation] if isinstance(operation, str) else operation
    return on_case(Target(operation, backend, dtype, variant), case)


def planned(target: Target, steps: tuple[str, ...] | None = None) -> Iterator[Trial]:
    """Trials of all steps, or of those named; for the references those that judge them. No program is called."""
    for name in STEPS if steps is None else steps:
        if target.backend != "numpy" or name not in AGAINST_ORACLE:
            yield from STEPS[name](target)


def performed(target: Target, trial: Trial) -> Outcome | None:
    """The outcome of one trial; None where it does not apply.

    A trial fails in which the program raises, changes an input, writes beside its arrays or leaves an output unset.
    """
    try:
        outcome = trial.run()
    except NotJudged as reason:
        target.faults.clear()
        return dataclasses.replace(target.outcome(trial.step, trial.name, 0.0), passed=False, not_judged=str(reason))
    return target.outcome(trial.step, trial.name, np.inf) if outcome is None and target.faults else outcome


def climbing(target: Target, steps: tuple[str, ...] | None = None) -> Iterator[Outcome]:
    """Outcomes of all steps, or of those named, as they come; for the references those that judge them."""
    found = (performed(target, trial) for trial in planned(target, steps))
    return (outcome for outcome in found if outcome is not None)


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
