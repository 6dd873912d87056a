"""The ladder of one operation of a library: its trials in order, for each dtype, variant and kernel."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from refsim.contract.ladder import STEPS, performed, planned
from refsim.contract.programs import DTYPES, Programs, among, chosen_variants
from refsim.contract.target import Outcome, Target, Trial
from refsim.core.operation import backend_of


@dataclass(frozen=True)
class Step:
    """One trial of the ladder of one operation, in the order in which they are climbed.

    number      of the trial in the operation's ladder
    step        its step's name, "-" for all
    trial       None for what is not judged as a whole: a dtype, a variant
    not_judged  why
    """

    number: int
    target: Target
    step: str = "-"
    trial: Trial | None = None
    not_judged: str = ""

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.trial.name if self.trial else "every trial"

    def outcome(self) -> Outcome:
        """An outcome of this trial that did not pass."""
        made = self.target.outcome(0.0)
        return replace(made, step=self.step, trial=self.name, passed=False, not_judged=self.not_judged)

    def perform(self) -> Outcome | None:
        """Call the program and judge; None where the trial does not apply."""
        return performed(self.target, self.step, self.trial) if self.trial else self.outcome()


def ladder(
    programs: Programs,
    operation: str,
    dtypes: Sequence[str] = (),
    variants: Sequence[int] = (),
    steps: Sequence[str] = (),
    calling: Callable[[str | None], None] = lambda case: None,
    seed: int | str | None = None,
) -> Iterator[Step]:
    """The trials of one operation, in order; no program is called before `perform`.

    calling  is told the case's name before each call of the program, and None after it
    seed     of drawn inputs (T11), or the file of one; 0 by default, and none of refsim's own programs

    All dtypes, variants and steps by default. Raises InputError for what does not exist or cannot run here.
    """
    found = programs.operation(programs.operations((operation,))[0])
    among(dtypes, programs.dtypes, f"{programs.name} does not compute in")
    among(steps, tuple(STEPS), "there is no step")
    chosen = chosen_variants(found, variants)
    names = [programs.arrays]
    if programs.programs is None:
        names = [name for name in found.names() if backend_of(name) == programs.arrays]
    dims = (3,) if programs.programs is None else tuple(sorted(programs.dims, reverse=True))
    target = Target(
        found, names[0], loader=programs.loader(), calling=calling, excludes=programs.excludes, dims=dims,
        same_bits=programs.same_bits, readings=programs.readings,
        seed=0 if seed is None and programs.programs is not None else seed,
    )  # fmt: skip
    counter = itertools.count()
    for name, dtype, variant, kernel in itertools.product(names, dtypes or DTYPES, chosen, programs.ladders(found)):
        overrides = found.as_computed_by(name).variants
        if variant >= len(overrides):
            continue
        at = replace(
            target, operation=found, backend=name, dtype=dtype, variant=variant, kernel=kernel, faults=[], last={}
        )
        reason = dtype if dtype not in programs.dtypes else programs.unsupported(found, overrides[variant])
        if reason:
            yield Step(next(counter), at, not_judged=reason)
            continue
        for step, trial in planned(at, tuple(steps) or None):
            yield Step(next(counter), at, step, trial)


def trials(
    programs: Programs,
    operation: str,
    dtypes: Sequence[str] = (),
    variants: Sequence[int] = (),
    steps: Sequence[str] = (),
    seed: int | None = None,
) -> Iterator[Outcome]:
    """Outcomes of the ladder for one operation as they come; all dtypes of the backend, variants and steps by default.

    Raises InputError for what does not exist or cannot run here.
    """
    for step in ladder(programs, operation, dtypes or programs.dtypes, variants, steps, seed=seed):
        outcome = step.perform()
        if outcome is not None:
            yield outcome
