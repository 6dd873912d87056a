"""Steps of what holds whatever the numbers are: conservation (T4), symmetries (T5), repetition, additivity, NaN."""

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from refsim.backends.arrays import on_threads, threads_of
from refsim.contract.answers import CLOUDS, LARGE
from refsim.contract.bounds import errors, neighbour_counts, oracle, size
from refsim.contract.inputs import Inputs, period_of, subset, unwritten, without_walls
from refsim.contract.target import RACE, REPEATS, Outcome, Target, Trial, named_worst, on_one_core, worst
from refsim.core import cases
from refsim.core.operation import Operation
from refsim.neighbours.reference import nearest_image, pair_blocks

TURNS = {
    2: ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 0], [1, 0, 0], [0, 0, 1]]),
    3: ([[0, 0, -1], [1, 0, 0], [0, 1, 0]], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
}
IN = {2: " in the plane", 3: ""}  # behind a trial's name
GRID = 2.0**-12  # positions on this grid are shifted without rounding
RANKS = (2, 4)  # that share the particles of a program that takes ghosts

# T4: what holds whatever the numbers are


def invariants(target: Target) -> Iterator[Trial]:
    """T4: conservation and dissipation, as far as the operation claims them; no wall takes part."""
    for name in held(target):
        for case in CLOUDS.values() if name in CONSERVED else ():
            yield Trial(f"{name} in {case}", functools.partial(_conserved, target, name, case))


def held(target: Target) -> tuple[str, ...]:
    """Invariants that this variant keeps."""
    broken = target.operation.broken.get(target.variant, ())
    return tuple(name for name in target.operation.invariants if name not in broken)


def _conserved(target: Target, name: str, case: str) -> Outcome:
    moves, message = CONSERVED[name]
    inputs = without_walls(on_grid(target, case))
    if name == "galilean":
        answers = [target.launch(given)[1] for given in (inputs, *moves(inputs))]
        same = all(np.array_equal(answers[0][n], answers[1][n]) for n in answers[0])
        return target.outcome(0.0 if same else np.inf, "" if same else message)
    error = 0.0
    for given in moves(inputs):
        _, after = target.launch(given, before={"acceleration": np.zeros((len(given["position"]), 3))})
        acceleration = np.asarray(after["acceleration"], dtype=float)
        amount, bound = total(name, given, acceleration, force_bound(target, given))
        none = amount < 0 if name == "dissipation" else amount == 0
        error = max(error, float(amount / bound) if bound else 0.0 if none else np.inf)
    return target.outcome(error, "" if error <= 1 else message)


def on_grid(target: Target, name: str) -> Inputs:
    """A case with positions and velocities on a binary grid, in the order in which it is written."""
    cases.discover()
    dtype = target.dtype
    inputs = Inputs(cases.CASES[name](), dtype)
    walls = inputs["walls"]
    step = np.dtype(dtype).type(GRID)
    moved = {name: np.round(inputs[name] / GRID) * step for name in ("position", "velocity")}
    on = walls._replace(position=(np.round(walls.position / GRID) * GRID).astype(dtype))
    varied = target.varied(inputs.replaced(**moved, walls=on))
    if not {"volume", "advanced_excess"} <= {*target.operation.arguments("numpy")}:
        return varied
    rest = varied["fluid"].rest_density if varied["rest_density"] is None else varied["rest_density"]
    return varied.replaced(mass=varied["volume"] * (rest + varied["advanced_excess"]))  # as before the step


def force_bound(target: Target, inputs: Inputs) -> np.ndarray:
    """Bound on the rounding of m a for each particle, from zero."""
    operation = target.operation
    _, scale = oracle(operation, inputs)["acceleration"]
    share = operation.tolerance * (neighbour_counts(operation, inputs) + 1) * float(np.finfo(target.dtype).eps)
    return share * np.asarray(inputs["mass"], dtype=float) * size(scale)


def total(name: str, inputs: Inputs, acceleration: np.ndarray, bound: np.ndarray) -> tuple[float, float]:
    """(size of a conserved total's change, or the power; the bound on its rounding)."""
    force = inputs["mass"][:, None] * acceleration
    if name == "dissipation":
        return float((force * inputs["velocity"]).sum()), 0.0
    if name == "linear_momentum":
        return float(size(force.sum(0)[None])[0]), float(bound.sum())
    arm = np.asarray(inputs["position"], dtype=float)
    arm = arm - arm.mean(0)
    return float(size(np.cross(arm, force).sum(0)[None])[0]), float((bound * size(arm)).sum())


def _in_wind(inputs: Inputs) -> list[Inputs]:
    """With a common velocity, which is added without rounding."""
    return [inputs.replaced(velocity=inputs["velocity"] + np.array([4.0, -2.0, 0.0], dtype=inputs.dtype))]


def _calm(inputs: Inputs) -> list[Inputs]:
    """Without pressure; also where all that moves is one particle."""
    calm = inputs.replaced(pressure=0 * inputs["pressure"])
    lone = 0 * inputs["velocity"]
    lone[len(lone) // 2] = [1.0, 2.0, 0.0]
    return [calm, calm.replaced(velocity=lone)]


CONSERVED: dict[str, tuple[Callable[[Inputs], list[Inputs]], str]] = {
    "linear_momentum": (lambda inputs: [inputs], "the sum of m a over all particles is not zero"),
    "angular_momentum": (lambda inputs: [inputs], "the sum of m x cross a over all particles is not zero"),
    "galilean": (_in_wind, "a velocity added to all particles changes the answer"),
    "dissipation": (_calm, "without pressure the kinetic energy does not fall"),
}

# T5: the same particles, described otherwise

MOVED = {
    "translation": "a translation of all particles",
    "reordering": "another order of the particles",
    "rotation": "a rotation of all particles",
    "images": "particles that are moved by a period",
}
Description = tuple[Inputs, Callable[[np.ndarray], np.ndarray]]  # inputs, and what brings an answer back


def symmetries(target: Target) -> Iterator[Trial]:
    """T5: translation, rotation (by exact turns and reflections) and another order of the particles.

    In a periodic box also other images of some particles; of a program that takes ghosts also several ranks.
    """
    for case in CLOUDS.values():
        usual = Usual(target, on_grid(target, case))
        for name, other in descriptions(usual).items():
            yield Trial(f"{name} of {case}", functools.partial(_compared, usual, name, other))
        for ranks in RANKS if target.by_ranks and target.operation.halo_depth == 1 else ():
            yield Trial(f"{ranks} ranks with {case}", functools.partial(by_ranks, usual, ranks))


def descriptions(usual: "Usual") -> dict[str, Callable[[], Description]]:
    """Other descriptions of the same particles, by name: those whose answer is the same one, described so."""
    kept, inputs = held(usual.target), usual.inputs
    described: dict[str, Callable[[], Description]] = {}
    if "translation" in kept:
        shift = np.array([4.0, -2.0, 1.0 if inputs.case.dim == 3 else 0.0], dtype=inputs.dtype)
        described["translation"] = functools.partial(_moved, inputs, shift, shift)
    if "reordering" in kept:
        described["reordering"] = functools.partial(_reordered, usual)
    if "rotation" in kept:
        described |= {f"rotation {k}": functools.partial(_rotated, usual, k) for k in (0, 1)}
    if period_of(usual.target.operation, inputs) is not None:  # every third by a period, and the next back by one
        shift = np.zeros((inputs.case.count, 3), dtype=inputs.dtype)
        shift[::3] = inputs["period"][:3]
        shift[1::3] = -shift[0]
        described["images"] = functools.partial(_moved, inputs, shift)
    return described


@dataclass(frozen=True, eq=False)
class Usual:
    """Inputs as they stand, and the answer to them, computed when the first trial needs it."""

    target: Target
    inputs: Inputs

    @functools.cached_property
    def expected(self) -> dict[str, tuple[Any, Any]]:
        """The oracle's answer."""
        return oracle(self.target.operation, self.inputs)

    @functools.cached_property
    def launched(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """(outputs before, outputs after) a call."""
        return self.target.launch(self.inputs)

    @functools.cached_property
    def names(self) -> list[str]:
        """Arrays with one row for each particle that the operation reads or adds to."""
        operation, inputs = self.target.operation, self.inputs
        names = [n for n in operation.arguments("numpy") if inputs.per_particle(n) and not inputs.dropped(n)]
        return names + [n for n in operation.outputs if inputs.per_particle(n) and n in operation.adds]


def _compared(usual: Usual, name: str, other: Callable[[], Description]) -> Outcome:
    """The other description's answer, brought back, against this one's; twice the bound, once for each."""
    target, inputs, answer = usual.target, usual.inputs, usual.expected
    before, after = usual.launched
    described, back = other()
    _, moved = target.launch(described)
    scales = {n: (after[n] - (before[n] if n in target.operation.adds else 0), answer[n][1]) for n in after}
    brought = {n: back(v) if inputs.per_particle(n) else v for n, v in moved.items()}
    ratios = errors(target.operation, inputs, before, brought, answer=scales, share=2.0)
    return _told(target, ratios, f"your program's answer does not follow {MOVED[name.split()[0]]}")


def _told(target: Target, ratios: dict[str, np.ndarray], wrong: str) -> Outcome:
    """The outcome, with words for a wrong answer."""
    worst_named, error = named_worst(ratios), worst(ratios)
    return target.outcome(error, worst_named if error <= 1 else f"{wrong}: {worst_named}")


def by_ranks(usual: Usual, ranks: int) -> Outcome:
    """Each rank gets its share and, behind it, the particles within reach as ghosts; the answers are gathered."""
    target, inputs, operation = usual.target, usual.inputs, usual.target.operation
    reach = inputs.case.list_radius * (1 + inputs.case.skin)
    gathered: dict[str, np.ndarray] = {}
    for share in np.array_split(np.argsort(inputs["position"][:, 0], kind="stable"), ranks):
        near = np.zeros(inputs.case.count, dtype=bool)
        for *_, distance in pair_blocks(inputs["position"], inputs["position"], share, period_of(operation, inputs)):
            near |= (distance < reach).any(0)
        near[share] = False
        keep = np.concatenate([share, np.flatnonzero(near)])
        _, part = target.launch(subset(operation, inputs, keep), owned=len(share))
        for name in (n for n in part if inputs.per_particle(n)):
            gathered.setdefault(name, inputs.output(operation, name))[share] = part[name][: len(share)]
    before = {name: inputs.output(operation, name) for name in gathered}
    answer = {name: usual.expected[name] for name in gathered}
    ratios = errors(operation, inputs, before, gathered, answer=answer)
    return _told(target, ratios, f"the answer of {ranks} ranks with ghosts is not that of one")


def _moved(inputs: Inputs, shift: np.ndarray, of_walls: np.ndarray | None = None) -> Description:
    """Particles, and walls, that are moved."""
    changed, walls = {"position": inputs["position"] + shift}, inputs["walls"]
    if walls is not None and of_walls is not None:
        changed["walls"] = walls._replace(position=walls.position + of_walls)
    return inputs.replaced(**changed), lambda values: values


def _reordered(usual: Usual) -> Description:
    inputs = usual.inputs
    order = inputs.case.random("order").permutation(inputs.case.count)
    return inputs.replaced(**{n: inputs[n][order] for n in usual.names}), lambda values: values[np.argsort(order)]


def _rotated(usual: Usual, number: int) -> Description:
    inputs = usual.inputs
    turn = np.array(TURNS[inputs.case.dim], dtype=usual.target.dtype)[number]
    changed = {n: inputs[n] @ turn.T for n in usual.names if inputs[n].ndim == 2}
    if inputs["walls"] is not None:
        changed["walls"] = inputs["walls"]._replace(position=inputs["walls"].position @ turn.T)
    return inputs.replaced(**changed), lambda values: values @ turn if values.ndim == 2 else values


# T6, T7


def repeats(target: Target) -> Iterator[Trial]:
    """T6: the same bits again; refsim's own on the CPU on one, two and all threads, others in several calls."""
    if target.loader:
        for dim in target.dims:
            case = LARGE[dim] if target.variant == 0 else CLOUDS[dim]
            yield Trial(f"{REPEATS} calls with {case}", functools.partial(_repeated, target, case, (None,) * REPEATS))
        return
    counts: tuple[int | None, ...] = (None, None)
    if target.place.name == "cpu":
        import numba

        counts = tuple(sorted({1, min(2, numba.config.NUMBA_NUM_THREADS), numba.config.NUMBA_NUM_THREADS})) * 2
    trial = "again" if target.place.name != "cpu" else f"on {', '.join(map(str, counts))} threads"
    yield Trial(trial, functools.partial(_repeated, target, CLOUDS[3], counts))


def _repeated(target: Target, case: str, counts: tuple[int | None, ...]) -> Outcome:
    inputs, neighbours, walls = target.prepared(case)
    answers = []
    for number, threads in enumerate(counts):
        on_core = on_one_core(bool(target.loader) and number % 2 == 1)
        with on_threads(threads_of(target.place, threads)), on_core:
            answers.append(target.launch(inputs, neighbours, walls)[1])
    first = answers[0]
    if all(a[n].tobytes() == v.tobytes() for a in answers for n, v in first.items()):
        return target.outcome(0.0)
    name, rows, share = "", 0, np.inf
    changed = {n: np.max([size(a[n] - v) for a in answers], 0) for n, v in first.items() if v.dtype.kind == "f"}
    if changed:
        name = max(changed, key=lambda n: float(np.nanmax(changed[n], initial=0.0)))
        rows, most = int(np.count_nonzero(changed[name])), float(np.nanmax(size(first[name]), initial=0.0))
        share = float(np.nanmax(changed[name], initial=0.0)) / most if most > 0 else np.inf
    if share >= 100 * float(np.finfo(target.dtype).eps):
        other = f"values of {name} for the same inputs ({rows} rows, by {share:.2g} of the largest): {RACE}"
    elif target.same_bits:
        other = f"bits for the same inputs, within rounding ({rows} rows): a race, or atomic sums"
    else:
        return target.outcome(0.0)
    return target.outcome(np.inf, f"your program gives other {other}")


def additivity(target: Target) -> Iterator[Trial]:
    """T7: outputs that are added to gain the same from any start; the others do not depend on what stood there."""
    operation, variant = target.operation, target.operation.variants[target.variant]
    left_out = {name for name, value in variant.items() if value is None}
    free = [n for n in operation.outputs if n not in left_out and n not in operation.arguments("numpy")]
    for dim in target.dims if free else ():
        run = functools.partial(_from_another_start, target, CLOUDS[dim], free)
        yield Trial(f"from another start{IN[dim]}", run)


def _from_another_start(target: Target, case: str, free: list[str]) -> Outcome:
    inputs, operation = on_grid(target, case), target.operation
    zero = {n: 0 * inputs.output(operation, n) for n in free if n in operation.adds}
    _, first = target.launch(inputs, before=zero)
    other = {n: np.full_like(first[n], 7) for n in free if n not in operation.adds}
    start = {n: 3 * first[n] for n in zero}
    begun, second = target.launch(inputs, before=other | start)
    usual = oracle(operation, inputs) if zero else {}
    answer = {n: (first[n].astype(float), np.maximum(usual[n][1], np.abs(first[n]))) for n in zero}
    ratios = errors(operation, inputs, begun, second, answer=answer, share=2.0) if zero else {}
    ratios |= {n: np.array([0.0 if first[n].tobytes() == second[n].tobytes() else np.inf]) for n in other}
    worst_named = named_worst(ratios)
    if not worst(ratios) <= 1:
        peak = worst_named.split()[0]
        worst_named = f"your program's answer depends on what stood in {peak} before"
        if peak in other:
            worst_named += "; it must assign it"
            if second[peak].tobytes() == np.asarray(other[peak], second[peak].dtype).tobytes():
                worst_named = f"your program does not write {peak}"
        elif np.array_equal(first[peak], second[peak]):
            worst_named = f"your program overwrites {peak}; it must add to what stands there"
    return target.outcome(worst(ratios), worst_named)


# T9


def bad_input(target: Target) -> Iterator[Trial]:
    """T9: a NaN in one particle's values stays visible in every answer that depends on them, and changes no other.

    A program over all pairs may multiply it by the zero of the kernel beyond its support.

    What depends on them is what the oracle changes where they change. Flags cannot show a NaN; a position that is
    not finite, or has such a residual or shift, is the search's to report.
    """
    for dim in target.dims:
        usual = Usual(target, on_grid(target, CLOUDS[dim]))
        for name in spoilable(target.operation, usual.inputs):
            yield Trial(f"NaN in {name}{IN[dim]}", functools.partial(_spoiled, usual, name))


def spoilable(operation: Operation, inputs: Inputs) -> Iterator[str]:
    """Arguments in which a NaN of one particle has to show."""
    written = [n for n in operation.outputs if not inputs.dropped(n)]
    if operation.exact and all(n in operation.exact and inputs.per_particle(n) for n in written):
        return
    for name in operation.arguments("numpy"):
        if name in ("position", "position_residual", "way") or not inputs.per_particle(name):
            continue
        if inputs[name] is not None and inputs[name].dtype.kind == "f":
            yield name


class Spoiled:
    """A NaN in one particle's row of the argument `name`.

    inputs  with it
    used    whether another number in its place changes the oracle's answer
    answer  in the oracle's form: NaN in rows that change so; of the whole set what the oracle can still say
    free    rows of each output that may be anything
    """

    def __init__(self, usual: Usual, name: str) -> None:
        operation, inputs, row = usual.target.operation, usual.inputs, 11
        changed, spoiled = np.array(inputs[name]), np.array(inputs[name])
        changed[row] = 1.5 * changed[row] + 1
        spoiled[row] = np.nan
        self.inputs, other = (inputs.replaced(**{name: values}) for values in (spoiled, changed))
        apart = np.asarray(inputs["position"], dtype=float) - inputs["position"][row]
        period = period_of(operation, inputs)
        distance = size(apart if period is None else nearest_image(apart, period))
        far = (distance > 1.1 * inputs.case.list_radius * operation.halo_depth) & (operation.halo_depth > 0)
        moved = oracle(operation, other)
        whole = {} if all(map(inputs.per_particle, moved)) else oracle(operation, self.inputs)
        self.used, self.answer, self.free = False, dict[str, Any](), dict[str, np.ndarray]()
        for output, (value, scale) in usual.expected.items():
            depends = in_rows(np.abs(moved[output][0] - value) > 1e-9 * scale)
            self.used |= bool(depends.any())
            if not inputs.per_particle(output):
                value, scale = whole[output]
                self.free[output] = in_rows(~np.isfinite(value))
            elif output in operation.exact:  # flags cannot show a NaN
                self.free[output] = np.ones(len(value), dtype=bool)
            else:
                value = np.array(value)
                value[depends] = np.nan
                self.free[output] = ~depends & ~far
            self.answer[output] = value, scale


def in_rows(entries: np.ndarray) -> np.ndarray:
    """Whether there is one in each row."""
    return np.any(entries, axis=tuple(range(1, entries.ndim)))


def _spoiled(usual: Usual, name: str) -> Outcome:
    target, inputs, spoiled = usual.target, usual.inputs, Spoiled(usual, name)
    over_all = "neighbours" in target.arguments and "neighbours" not in target.taken
    before, after = target.launch(spoiled.inputs, complete=False)  # an iteration may end at the NaN
    if any(unwritten(before, after)):
        quiet = target.quiet()
        quiet.launch(inputs)
        target.faults.extend(quiet.faults)
    whole = {n: right for n, right in spoiled.answer.items() if not inputs.per_particle(n)}
    counted = errors(target.operation, spoiled.inputs, before, after, answer=whole)
    values: dict[str, np.ndarray] = {}
    visible, message = False, ""
    for output, (right, _) in spoiled.answer.items():
        got, free = in_rows(~np.isfinite(after[output])), spoiled.free[output]
        if output in whole:  # what the oracle can still say must be right
            off = counted[output]
            values[output] = np.where(free, 0.0, off.max(tuple(range(1, off.ndim))))
            visible |= bool(got.any() or (after[output] != before[output]).any())
        elif output not in target.operation.exact:
            lost = in_rows(np.isnan(right))
            hidden, spread = lost & ~got, ~lost & ~free & got & (not over_all)
            values[output] = np.where(hidden | spread, np.inf, 0.0)
            visible |= bool(lost.any())
            if hidden.any():
                message = f"a NaN in {name} does not show in {output}, which depends on it"
            elif spread.any():
                message = f"a NaN in {name} of one particle spreads to {output} of particles far away"
    error = worst(values) if visible or not spoiled.used else np.inf
    return target.outcome(error, message or named_worst(values))
