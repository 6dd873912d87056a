"""T11: inputs drawn at random, the same for the same seed; the smallest that fails is kept as a file.

Numbers of particles are those at which blocks, lanes and index types end. Extent, place, spacing, support radius,
masses, walls, periods, the order of the particles, ghosts and the capacity of rows of neighbours are drawn, too.
"""

import dataclasses
import functools
import json
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from refsim.contract.answers import many
from refsim.contract.bounds import oracle, takes_neighbours
from refsim.contract.causes import REFUSED, judgement
from refsim.contract.inputs import Inputs, all_pairs, period_of
from refsim.contract.properties import RANKS, Usual, by_ranks
from refsim.contract.target import MOST_SOUGHT, NotJudged, Outcome, Sought, Target, Trial
from refsim.core import cases
from refsim.core.errors import InputError
from refsim.core.period import period_group
from refsim.core.writing import write_file

FILE = "failing_{}.json"  # in the current folder, by the operation
DRAWN = 3  # inputs for each precision, variant and kernel
MOST_CALLS = 40  # of the program for a smaller input
EDGES = [2**k + d for k in range(3, 11) for d in (-1, 0, 1)]  # numbers of particles beside 0 to 70
BEYOND_16_BITS = (2**16 - 1, 2**16, 2**16 + 1)


@dataclasses.dataclass(frozen=True, eq=False)
class Drawn:
    """A case, and what else is drawn: lengths [m] of a periodic box, free entries behind each row of neighbours."""

    case: cases.Case
    lengths: tuple[float, ...] = (0.0, 0.0, 0.0)
    gap: int = 0


def drawn_inputs(target: Target) -> Iterator[Trial]:
    """T11: some drawn inputs; for the plain variant also one beyond 16 bits, and one that ranks share; or a file's."""
    if isinstance(target.seed, str):
        name, drawn = read(Path(target.seed))
        yield Trial(name.split(":", 5)[5], functools.partial(_judged, target, drawn))
        return
    for number in range(DRAWN) if target.seed is not None else ():
        name = f"drawn {target.seed}.{number}"
        yield Trial(name, functools.partial(_smallest, target, name))
    if target.seed is not None and target.variant == 0 and takes_neighbours(target.operation) and target.loader:
        if ("float32", "float64")[target.seed % 2] == target.dtype:
            yield Trial(f"drawn {target.seed}.many", functools.partial(_many, target))
        if target.by_ranks and target.operation.halo_depth == 1:
            name = f"drawn {target.seed}.ranks"
            usual = Usual(target, _inputs(target, draw(target, name)))
            yield Trial(name, functools.partial(by_ranks, usual, RANKS[target.seed % len(RANKS)]))


def draw(target: Target, name: str) -> Drawn:
    """The input of this name: another one for each operation, precision, variant and kernel."""
    where = f"{target.operation.name}:{target.dtype}:{target.variant}:{target.kernel}:{name}"
    random = np.random.default_rng(zlib.crc32(where.encode()))
    dim = int(random.choice(target.dims))
    few = int(random.integers(0, 71))
    count = few if random.random() < 0.7 else int(random.choice(EDGES))
    spacing = 10 ** random.uniform(-2, 1)
    aspect = random.choice([0.3, 1.0, 1.0, 3.0], 3)
    side = np.where(np.arange(3) < dim, spacing * max(count, 1) ** (1 / dim) * aspect, 0.0)
    position = random.uniform(-0.5, 0.5, (count, 3)) * side
    if random.random() < 0.2:
        position = np.round(position / spacing) * spacing
    position += np.where(np.arange(3) < dim, random.choice([0.0, 0.0, 30.0]) * spacing, 0.0)
    if random.random() < 0.3:
        position = position[np.argsort(position[:, 0])[:: random.choice([-1, 1])]]
    walls = random.uniform(-0.6, 0.6, (int(random.choice([0, 1, 7, 64])), 3)) * side
    heavy = 10 ** random.uniform(0, 2)
    case = cases.Case(
        f"{where} drawn", dim, position, spacing, spacing * random.uniform(1.2, 3.2), walls, (1 / heavy, heavy),
        float(random.choice([0.0, 0.1, 0.4])), state=str(random.choice(["linear", "tait"])),
        clamp=bool(random.random() < 0.3), ties=True,
    )  # fmt: skip
    step = cases.BOX_GRID * 2.0 ** np.floor(np.log2(spacing))
    width = np.ptp(position, axis=0) + spacing if count else np.zeros(3)
    least = np.maximum(width, random.choice([2.05, 2.5, 4.0]) * case.list_radius * (1 + case.skin))
    lengths = np.where((np.arange(3) < dim) & (random.random(3) < 0.7), np.ceil(least / step) * step, 0.0)
    return Drawn(case, tuple(map(float, lengths)), int(random.choice([0, 0, 1, 5])))


def _inputs(target: Target, drawn: Drawn) -> Inputs:
    inputs = target.varied(Inputs(drawn.case, target.dtype))
    if period_of(target.operation, inputs) is None:
        return inputs
    x, y, z = drawn.lengths
    return inputs.replaced(period=period_group((x, y, z), target.dtype))


def _judged(target: Target, drawn: Drawn) -> Outcome | None:
    """The outcome of one input; None where the operation's arguments cannot be made from it."""
    cases.CASES[drawn.case.name] = lambda: drawn.case  # where some arguments look for it
    try:
        try:
            inputs = _inputs(target, drawn)
            answer = oracle(target.operation, inputs)
        except REFUSED:
            return None
        neighbours = walls = None
        if target.listed and target.backend != "numpy":
            neighbours, walls = all_pairs(inputs, target.place, period_of(target.operation, inputs))
            neighbours = with_room(neighbours, drawn.gap)
        return judgement(target, target.judged(inputs, neighbours, walls, answer))
    finally:
        del cases.CASES[drawn.case.name]


def with_room(neighbours: Any, gap: int) -> Any:
    """The same rows of neighbours with `gap` free entries behind each, which hold some other particle's number."""
    if not gap or not hasattr(neighbours, "start"):
        return neighbours
    rows = len(neighbours.count)
    start = neighbours.start + gap * np.arange(rows, dtype=neighbours.start.dtype)
    entries = np.zeros(len(neighbours.entries) + gap * rows, neighbours.entries.dtype)
    row_of_entry = np.repeat(np.arange(rows), neighbours.count)
    place = np.arange(len(row_of_entry))
    entries[place + gap * row_of_entry] = neighbours.entries[: len(row_of_entry)]
    return neighbours._replace(start=start, entries=entries)


def _smallest(target: Target, name: str) -> Outcome | None:
    """The outcome of a drawn input; where it fails, a smaller one that fails is kept."""
    drawn = draw(target, name)
    outcome, kept = _judged(target, drawn), target.sought.smallest
    if not outcome or outcome.passed or outcome.not_judged:
        return outcome
    quiet = dataclasses.replace(target.quiet(), sought=Sought(answers=MOST_SOUGHT))
    calls, step = 0, drawn.case.count
    while step > 1 and calls < MOST_CALLS:
        step, place = (step + 1) // 2, 0
        while place < drawn.case.count and calls < MOST_CALLS:
            calls += 1
            keep = np.delete(drawn.case.position, slice(place, place + step), 0)
            fewer = dataclasses.replace(drawn.case, position=keep, name=f"{name} {calls}")
            other = _judged(quiet, dataclasses.replace(drawn, case=fewer))
            if other is None or other.passed:
                place += step
            else:
                drawn = dataclasses.replace(drawn, case=fewer)
    if kept is None or drawn.case.count < kept[1].case.count:
        target.sought.smallest = dataclasses.replace(outcome, step="T11", trial=name).replay, drawn
    return outcome


def _many(target: Target) -> Outcome | None:
    """As many particles as an index of 16 bits counts, one less, or one more; None where a call takes too long."""
    count = BEYOND_16_BITS[int(target.seed or 0) // 2 % 3]
    name = f"many_{count}"
    cases.CASES.setdefault(name, functools.cache(lambda: cases.Case(name, 3, cases.cloud(name, count, 3))))
    try:
        return many(target, name)
    except NotJudged:
        return None


# The smallest failing input


def write(target: Target) -> None:
    """Write the smallest drawn input that failed."""
    name, drawn = target.sought.smallest
    told = json.dumps({"trial": name} | dataclasses.asdict(drawn), indent=1, default=np.ndarray.tolist)
    write_file(FILE.format(target.operation.name), told.encode())


def read(path: Path) -> tuple[str, Drawn]:
    """(name of the trial, input) of such a file. Raises InputError for another one."""
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        case: dict[str, Any] = told["case"] | {"masses": tuple(told["case"]["masses"])}
        for name in ("position", "wall_position"):
            case[name] = np.array(case[name], float).reshape(-1, 3)
        return str(told["trial"]), Drawn(cases.Case(**case), tuple(told["lengths"]), int(told["gap"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"--replay {path} is no input of a failed trial; take a file that a report names.") from None
