"""What is judged: one operation's program with one dtype, variant and kernel; its calls, and the outcomes of trials."""

import contextlib
import dataclasses
import functools
import math
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from refsim.backends.arrays import Backend
from refsim.contract.bounds import errors, oracle
from refsim.contract.inputs import (
    Inputs,
    all_pairs,
    as_in_runs,
    backend_for,
    on_backend,
    period_of,
    prepared,
    unwritten,
    value_of,
    with_kernel,
    with_variant,
)
from refsim.core import cases
from refsim.core.operation import REGISTRY, Operation, backend_of

Answer = Mapping[str, tuple[Any, Any]]
LISTED = {"neighbours", "walls", "liquid_near_walls"}  # arguments with lists of the neighbour search
MOST_SOUGHT = 12  # wrong answers of one operation whose signs are sought by further calls
MOST_SEEKING = 5.0  # s of the processor for which they are
FEW, MANY = 8, 400  # particles: fewer say less, with more a call takes long
REPEATS = 6  # calls of other programs with the same inputs
RACE = "a race between threads, or memory that is read before it is written"


class ProgramFailed(Exception):
    """A program under test raised instead of answering; the message says what."""


class NotJudged(Exception):
    """The inputs hold something that the program is declared not to support; the message names it.

    A second message says why it is not tried in spite of what is declared.
    """


@dataclass
class Sought:
    """What was found out about an operation's program: answers whose signs were sought, seconds for that, words if its
    answers vary.
    """

    answers: int = 0
    seconds: float = 0.0
    smallest: Any = None  # drawn input that fails: its trial's name, and what `refsim.contract.drawn` makes again
    unsteady: str = ""

    def wanted(self, particles: int) -> bool:
        """Whether the sign of one more wrong answer is sought."""
        most = 3 if particles < FEW else MOST_SOUGHT
        return particles <= MANY and self.answers < most and self.seconds < MOST_SEEKING


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
    not_judged: str = ""  # what it needs and the program is declared not to support; nothing ran, and it did not pass
    kernel: str = ""  # smoothing kernel of the inputs, "" for that of the case
    dim: int = 0  # of the inputs
    telling: bool = False  # whether the right answer differs from zero, so that the trial could fail
    values: Mapping[str, Any] = field(default_factory=dict)  # of a wrong answer: output, row, got, expected, error, ...
    sign: str = ""  # of a wrong answer, "" without one, and traits of the inputs: see `refsim.contract.causes`
    traits: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 0.0  # of wall time

    @property
    def untried(self) -> bool:
        """Whether it is declared, and was not tried; then `words` say why."""
        return bool(self.not_judged and self.words)

    @property
    def replay(self) -> str:
        """The trial's name for `refsim contract --replay`."""
        return ":".join((self.operation, self.dtype, str(self.variant), self.kernel, self.step, self.trial))

    def __str__(self) -> str:
        verdict = "pass" if self.passed else "FAIL"
        at = f"variant {self.variant}{f', {self.kernel}' if self.kernel else ''}"
        if self.not_judged:
            told = f"{'not tried' if self.untried else 'not judged'}: {self.operation} {self.step} {self.trial}, {at}:"
            return f"{told} {self.not_judged}{f'; {self.words}' if self.words else ''}"
        said = "; ".join(part for part in (self.words, told_values(self.values)) if part)
        return (
            f"{verdict} {self.operation} {self.step} {self.trial} on {self.backend} {self.dtype}, {at}:"
            f" {self.error:.3g} of the bound{'; ' + said if said else ''}"
        )


def told_values(values: Mapping[str, Any]) -> str:
    """The worst row of a wrong answer on one line; "" without values."""
    if not values:
        return ""
    largest, error = float(np.max(np.abs(values["expected"]))), values["error"]
    more = 2 + math.ceil(math.log10(largest / error)) if 0 < error < largest < math.inf else 0
    got, expected = (_number(values[name], more) for name in ("got", "expected"))
    text = f"{values['output']} of particle {values['row']}: got {got}, expected {expected}, error {error:.3g}"
    text += "" if values["bound"] is None else f", bound {values['bound']:.3g}"
    text += f", {values['neighbours']} neighbour{'s' if values['neighbours'] != 1 else ''}"
    return text


def _number(value: Any, digits: int = 0) -> str:
    """A number with at least 9 digits, or a vector with 7."""
    if isinstance(value, list):
        return f"({', '.join(f'{v + 0.0:.{max(7, digits)}g}' for v in value)})"
    return f"{value:.{max(9, digits)}g}"


class Judged(NamedTuple):
    """A program's answer to one trial beside the right one; see `refsim.contract.bounds.errors`."""

    inputs: Inputs
    before: Mapping[str, np.ndarray]
    after: Mapping[str, np.ndarray]
    answer: Answer
    ratios: Mapping[str, np.ndarray]
    rows: np.ndarray | None = None


@dataclass(frozen=True)
class Target:
    """One operation's program under test: one of refsim's, or a loader's own with the same arguments.

    loader  operation -> program taking the arguments of the backend's own program in their order, or those that its
            attribute `arguments` names; its attribute `takes`, if there, names those that it reads
    """

    operation: Operation
    backend: str = "cpu"  # name of the program: its backend, or backend and algorithm ("cuda:fused")
    dtype: str = "float32"
    variant: int = 0  # number of the operation's variant
    loader: Callable[[Operation], Callable[..., Any]] | None = None
    calling: Callable[[str | None], None] = lambda case: None  # is told a case before each call, and None after it
    faults: list[str] = field(default_factory=list, compare=False, repr=False)  # since the last outcome; the next fails
    excludes: Callable[[Operation, Inputs], str] = lambda operation, inputs: ""  # what of them is not supported, or ""
    kernel: str = ""  # smoothing kernel that every input has, or "value gradient"; "" as each case has it
    dims: tuple[int, ...] = (3,)  # in which steps with one cloud are climbed
    same_bits: bool = True  # whether the program is held to give the same bits again
    readings: bool = True  # whether members of groups that stand for a reading of a paper are varied
    seed: int | str | None = None  # of drawn inputs, or the file of one; None: none are drawn
    sought: Sought = field(default_factory=Sought, compare=False, repr=False)
    last: dict[str, Any] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "operation", self.operation.as_computed_by(self.backend))

    @property
    def place(self) -> Backend:
        """Where the arrays live."""
        return backend_for(backend_of(self.backend))

    @functools.cached_property
    def program(self) -> Callable[..., Any] | None:
        """The loader's program; None for refsim's own."""
        return self.loader(self.operation) if self.loader else None

    @functools.cached_property
    def arguments(self) -> tuple[str, ...]:
        """Names of the arguments that the program is called with, in order."""
        return getattr(self.program, "arguments", None) or self.operation.arguments(self.backend)

    @functools.cached_property
    def taken(self) -> frozenset[str]:
        """Arguments that the program reads, and its outputs."""
        return frozenset({*getattr(self.program, "takes", self.arguments), *self.operation.outputs})

    @property
    def by_ranks(self) -> bool:
        """Whether the program asks how many of the particles a rank owns."""
        return "owned" in getattr(self.program, "takes", ())

    @property
    def listed(self) -> bool:
        """Whether the program reads a list of neighbours."""
        return bool(LISTED & self.taken)

    def outcome(self, error: float, words: str = "", **more: Any) -> Outcome:
        """Of a trial without a name; it passed if the error is at most the bound and no launch since the last outcome
        had a fault. NaN fails. Of a program whose answers vary from call to call no other cause is told.
        """
        faults = tuple(dict.fromkeys(self.faults))
        self.faults.clear()
        passed = bool(error <= 1) and not faults
        words = "; ".join(faults) or ("" if passed else self.sought.unsteady) or words
        return Outcome(
            self.operation.name.partition(":")[0], "", "", self.backend, self.dtype, self.variant, passed,
            float(error), words, kernel=self.kernel, dim=self.last.get("dim", 0), **more,
        )  # fmt: skip

    def varied(self, inputs: Inputs) -> Inputs:
        """Inputs with this variant's overrides and this target's kernel."""
        made = with_variant(inputs, self.operation.variants[self.variant])
        return with_kernel(self.operation, made, self.kernel) if self.kernel else made

    def prepared(self, case: str, lists: str = "search") -> tuple[Inputs, Any, Any]:
        """(inputs with this variant's overrides, neighbours, walls with their list) of a case by name.

        For a program that reads no list none is made, and the particles are in a random order.
        """
        cases.discover()
        given = with_variant(Inputs(cases.CASES[case](), self.dtype), self.operation.variants[self.variant])
        period = period_of(self.operation, given)
        lists = lists if self.listed else "none"
        made, neighbours, walls = prepared(case, self.place.name, self.dtype, lists, period)
        return self.varied(made), neighbours, walls

    def judged(
        self, inputs: Inputs, neighbours: Any = None, walls: Any = None, answer: Answer | None = None,
        rows: np.ndarray | None = None, before: Mapping[str, Any] | None = None,
    ) -> Judged:  # fmt: skip
        """The program's answer to inputs beside `answer`, the oracle's by default; see `launch`."""
        start, after = self.launch(inputs, neighbours, walls, before)
        right = oracle(self.operation, inputs, rows) if answer is None else answer
        return Judged(inputs, start, after, right, errors(self.operation, inputs, start, after, rows, right), rows)

    def launch(
        self,
        inputs: Inputs,
        neighbours: Any = None,
        walls: Any = None,
        before: Mapping[str, Any] | None = None,
        complete: bool = True,
        owned: int | None = None,
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """(outputs before, outputs after) one launch, on the host.

        Without lists those of the oracle are taken, for the particles' order as it is; `before` sets outputs; `owned`
        is the number of particles that are no ghosts, all by default, for a program that asks for it. A
        program that raises, changes an input, writes beside its arrays or (with `complete`) leaves an output unset
        adds to `faults`.
        Raises NotJudged for inputs that the program is declared not to support.
        """
        operation, place = self.operation, self.place
        excluded = self.excludes(operation, inputs)
        if excluded:
            raise NotJudged(excluded)
        self.last["dim"] = inputs.case.dim
        if self.backend == "numpy":
            walls = inputs["walls"]
        elif neighbours is None and self.listed:
            neighbours, walls = all_pairs(inputs, place, period_of(operation, inputs))
        wanted = {n: inputs.output(operation, n) for n in operation.outputs if not inputs.dropped(n)}
        wanted |= {n: np.asarray(v, wanted[n].dtype) for n, v in (before or {}).items() if n in wanted}
        guards = Guards(place, operation.work)
        values = {n: guards.hold(n, on_backend(v, place), written=True) for n, v in wanted.items()}

        def lookup(name: str) -> Any:
            if name not in values:
                made = value_of(operation, name, inputs, neighbours, walls, place) if name in self.taken else None
                as_run = self.program is None and place.name == "cpu"
                values[name] = guards.hold(name, as_in_runs(made) if as_run else made)
            return values[name]

        if self.program is None:
            call = operation.bind(self.backend, lookup)
        else:
            count = len(inputs["position"]) if owned is None else owned
            told = {"owned": count} if self.by_ranks else {}
            call = functools.partial(self.program, *map(lookup, self.arguments), **told)
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
        self.last["launch"] = inputs, wanted, after
        if complete and not self.faults:
            left = list(unwritten(wanted, after, before or {}))
            if left:
                self.faults.append(self._unset(left, inputs, neighbours, walls))
        return wanted, after

    def _unset(self, left: Iterable[str], inputs: Inputs, neighbours: Any, walls: Any) -> str:
        """Why outputs hold no numbers after a call: nothing was written, or something was added to what stood there."""
        quiet = self.quiet()
        zero = {name: np.zeros_like(inputs.output(self.operation, name)) for name in left}
        _, after = quiet.launch(inputs, neighbours, walls, before=zero, complete=False)
        added = ", ".join(name for name in left if np.any(after[name] != zero[name]))
        if added:
            return f"your program adds to {added}, which holds no number before the call; it must assign it"
        return f"your program does not write {', '.join(left)}"

    def quiet(self) -> "Target":
        """The same program, whose faults are nobody's."""
        return dataclasses.replace(self, faults=[], last={})


def bindings(
    operation: Operation | str, backend: str, dtype: str, case: str, variant: Mapping[str, Any] | int = 0,
    lists: str = "search", names: Collection[str] = (),
) -> dict[str, Any]:  # fmt: skip
    """Values of everything that the operation's program on `backend` takes, by argument name, on one case.

    operation  an Operation or its name
    backend    or the name of one of the operation's further programs ("cuda:fused")
    dtype      "float32" or "float64"
    case       name in refsim.core.cases.CASES
    variant    overrides, or the number of one of the operation's own variants
    lists      "search" (refsim's neighbour search) or "all_pairs" (the oracle)
    names      arguments that are wanted in place of those of refsim's own program

    Arrays that are written are copies of their own. Raises KeyError where nothing makes an argument.
    """
    operation = REGISTRY[operation] if isinstance(operation, str) else operation
    if not isinstance(variant, int):
        operation, variant = dataclasses.replace(operation, variants=(variant,)), 0
    target = Target(operation, backend, dtype, variant)
    made, wanted = target.prepared(case, lists), names or target.arguments
    return {name: value_of(target.operation, name, *made, target.place) for name in wanted}


class Trial(NamedTuple):
    """One trial, by a name that is known before the program is called; None where it does not apply."""

    name: str
    run: Callable[[], Outcome | None]


def worst(ratios: Mapping[str, np.ndarray]) -> float:
    """Largest error over bound of all outputs."""
    return max((float(np.max(ratio, initial=0.0)) for ratio in ratios.values()), default=0.0)


def named_worst(ratios: Mapping[str, np.ndarray], rows: np.ndarray | None = None) -> str:
    """Where the largest error is."""
    peaks = {n: float(np.max(r, initial=0.0)) for n, r in ratios.items()}
    name = max(peaks, key=lambda n: peaks[n], default="")
    if not name or not peaks[name] > 0:
        return ""
    place = int(np.argmax(ratios[name]))
    return f"{name} of particle {place if rows is None or len(rows) != len(ratios[name]) else int(rows[place])}"


@contextlib.contextmanager
def on_one_core(wanted: bool) -> Iterator[None]:
    """Threads that a program starts share one core, if `wanted` and on Linux: those that race meet in another order."""
    if not wanted or not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


# What a program under test may not touch

GUARD_BYTES = 4096  # before and after each array on the CPU; a multiple of every alignment
PATTERN = 0xA5


class Guards:
    """Hands the arguments of one call over, and says afterwards what the program changed that is not its own.

    A program may change its outputs and what is named in `work`. On the CPU each array is a copy between guard bytes.
    On a GPU the inputs are compared, without guard bytes.
    """

    def __init__(self, backend: Backend, work: Collection[str] = ()) -> None:
        self.backend, self.work = backend, work
        self.checks: list[Callable[[], str]] = []

    def hold(self, name: str, value: Any, written: bool = False) -> Any:
        """The argument as the program gets it; arrays in named tuples are held, too, other objects are not.

        written  the argument is an output, which the program may change
        """
        written = written or name in self.work
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            parts = zip(value._fields, value)
            return type(value)(*(self.hold(f"{name}.{field}", part, written) for field, part in parts))
        fenced = isinstance(value, np.ndarray) and self.backend.name != "cuda"
        if not fenced and (written or not hasattr(value, "copy_to_host")):
            return value
        before, array, memory = value, value, np.zeros(0, np.uint8)
        if fenced:
            memory = np.full(value.nbytes + 2 * GUARD_BYTES, PATTERN, np.uint8)
            array = np.ndarray(value.shape, value.dtype, memory, GUARD_BYTES)
            array[...] = value
        else:
            before = np.array(self.backend.host(value))

        def check() -> str:
            fences = memory[:GUARD_BYTES], memory[GUARD_BYTES + before.nbytes :]
            for fence, where in zip(fences, ("before the start", "behind the end")):
                if (fence != PATTERN).any():
                    return f"it wrote {where} of {name}"
            fault = "" if written else _difference(name, before, np.array(self.backend.host(array)))
            if fault and not fenced:
                array.copy_to_device(before)  # lists serve several trials
            return fault

        self.checks.append(check)
        return array

    def faults(self) -> list[str]:
        """What the program did to arguments since, one clause for each."""
        return [fault for check in self.checks if (fault := check())]


def _difference(name: str, before: np.ndarray, after: np.ndarray) -> str:
    """A clause on the first row whose bytes differ; "" where all are the same."""
    held, found = (np.ascontiguousarray(values).reshape(-1).view(np.uint8) for values in (before, after))
    changed = np.flatnonzero(held != found)
    if not len(changed):
        return ""
    row = int(changed[0]) // before[:1].nbytes if before.ndim else 0
    return f"it changed its input {name} (row {row} first)"
