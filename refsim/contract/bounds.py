"""How far an answer may be from the oracle's: c * neighbours * eps * sum|terms|, for each particle by itself.

A sum of k terms, each rounded a few times, is off by at most (k + c) * eps * sum|terms| in whatever order it is
taken; c * (k + 1) * eps * sum|terms| is no smaller. The oracle gets the inputs as rounded, and a difference of two
coordinates is rounded relative to itself, so that a distance from the origin costs nothing more. What does is a
term that falls to zero at the edge of the support: a relative error of r changes it by r dT/dr, many times its own
size. That sum is measured on the oracle, by stretching all positions, wherever the plain bound does not suffice.
A pair within rounding of r = h counts or not, as its distance is rounded: a row that has one may differ by that term.
"""

import functools
import inspect
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from refsim.contract.inputs import Inputs, period_of
from refsim.core.cases import STAND_INS
from refsim.core.operation import Operation
from refsim.neighbours.reference import pair_blocks

STRETCH = 1e-6
EDGE = 8.0  # roundings of the distance in which r = h is undecided


def oracle(operation: Operation, inputs: Inputs, rows: np.ndarray | None = None) -> dict[str, tuple[Any, Any]]:
    """{output: (value, scale)} in float64, of all particles or of `rows`; outputs that are None are left out."""
    program = operation.program("numpy")
    takes_rows = "rows" in inspect.signature(program).parameters
    values = [inputs[name] for name in operation.arguments("numpy")]
    with np.errstate(all="ignore"):
        answer = program(*values, rows=rows) if takes_rows else program(*values)
    count = len(inputs["position"])
    result = {}
    for name in operation.outputs:
        if inputs.dropped(name):
            continue
        value, scale = (np.asarray(part, dtype=float) for part in answer[name])
        if inputs.per_particle(name):
            whole = len(rows) if takes_rows and rows is not None else count
            value, scale = (
                part if len(part) == whole else np.broadcast_to(part, (whole, *part.shape[1:]))
                for part in (value, scale)
            )
            if rows is not None and not takes_rows:
                value, scale = value[rows], scale[rows]
        result[name] = (value, scale)
    return result


def neighbour_counts(operation: Operation, inputs: Inputs, rows: np.ndarray | None = None) -> np.ndarray:
    """Fluid and wall particles in each particle's reach; 0 for operations without neighbours."""
    wanted = len(inputs["position"]) if rows is None else len(rows)
    count = np.zeros(wanted)
    if not takes_neighbours(operation):
        return count
    for place, _, distance in _all_distances(operation, inputs, rows):
        count[place] += (distance < inputs.case.list_radius).sum(1)
    return count


def _all_distances(operation: Operation, inputs: Inputs, rows: np.ndarray | None) -> Iterator[tuple[slice, Any, Any]]:
    """Blocks of particles, of all or of `rows`, with what parts them from all particles, then from walls' [m]."""
    sources = [inputs["position"]]
    if "walls" in operation.arguments("numpy") and inputs["walls"] is not None:
        sources.append(inputs["walls"].position)
    for source in sources:
        yield from pair_blocks(inputs["position"], source, rows, period_of(operation, inputs))


def takes_neighbours(operation: Operation) -> bool:
    """Whether the operation sums over neighbours (then its reference takes positions and no build positions)."""
    names = operation.arguments("numpy")
    return "position" in names and "position" not in operation.outputs


def size(values: np.ndarray) -> np.ndarray:
    """Length of each row, or absolute value of each entry."""
    values = np.abs(np.asarray(values, dtype=float))
    return np.sqrt((values**2).sum(-1)) if values.ndim == 2 else values


def errors(
    operation: Operation,
    inputs: Inputs,
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    rows: np.ndarray | None = None,
    answer: Mapping[str, tuple[Any, Any]] | None = None,
    share: float = 1.0,
) -> dict[str, np.ndarray]:
    """Error over bound for each particle (entry, for outputs of the whole set), by output; infinite for NaN.

    before, after  outputs on the host before and after the launch, of all particles
    answer         what to compare with, in the oracle's form; (value, None) for a closed form; the oracle's by default
    share          how many times the bound is allowed
    """
    answer = oracle(operation, inputs, rows) if answer is None else answer
    bounds = Bounds(operation, inputs, rows, share)
    ratios = {}
    for name, (value, scale) in answer.items():
        got, start = bounds.rows_of(name, after[name]), bounds.rows_of(name, before[name])
        growing = bounds.growing(name, value, scale, start)
        if name in operation.exact:
            ratios[name] = np.where(np.isfinite(next(growing)) & (got != value), np.inf, 0.0)
            continue
        # infinity less infinity is no number and no agreement; what was not written may be as large as a number can be
        with np.errstate(invalid="ignore", over="ignore"):
            error = size(got - (start if name in operation.adds else 0) - value)
            for bound in growing:
                ratios[name] = np.where(np.isfinite(error), error / bound, np.inf)
                if not (ratios[name] > 1).any():
                    break
    return ratios


class Bounds:
    """Largest errors allowed on inputs, `share` times, of all particles or of `rows`."""

    def __init__(
        self, operation: Operation, inputs: Inputs, rows: np.ndarray | None = None, share: float = 1.0
    ) -> None:
        self.operation, self.inputs, self.rows, self.share = operation, inputs, rows, share
        about = np.finfo(inputs.dtype)
        self.tiny, self.factor = float(about.tiny), operation.tolerance * float(about.eps)
        self.near = functools.cache(functools.partial(neighbour_counts, operation, inputs, rows))
        self.conditioned = functools.cache(functools.partial(conditioning, operation, inputs, rows))
        self.jumps = functools.cache(functools.partial(edge_terms, operation, inputs, rows))

    def rows_of(self, name: str, values: Any) -> np.ndarray:
        """The rows of an output that are compared, in float64."""
        values = np.asarray(values, dtype=float)
        return values if self.rows is None or not self.inputs.per_particle(name) else values[self.rows]

    def growing(self, name: str, value: np.ndarray, scale: Any, start: np.ndarray) -> Iterator[np.ndarray]:
        """Bounds of an output's rows, each with a term more that costs more to compute; the last is the bound.

        An output that agrees exactly has 0 for each entry, or infinity where a rounding may decide.

        value, scale  in the oracle's form; None is the scale of a closed form
        start         what stood there before
        """
        if name in self.operation.exact:
            yield np.zeros(np.shape(value)) if scale is None else np.where(scale <= self.factor, np.inf, 0.0)
        elif scale is None:
            largest = float(np.max(np.abs(value), initial=0))
            yield np.full(np.shape(value)[:1], self.share * (8 * self.factor * largest + self.tiny))
        else:  # c (neighbours + 1) eps sum|terms|, and the rounding of the sum with what stood there
            near = self.near()
            entries = 1 if name in self.operation.entrywise else 1 + len(near)
            bound = (near + 1 if self.inputs.per_particle(name) else entries) * size(scale)
            bound = self.factor * (bound + size(start) if name in self.operation.adds else bound)
            bound = self.share * (bound + self.tiny)
            yield bound
            if takes_neighbours(self.operation):
                bound = bound + self.share * self.factor * self.conditioned().get(name, 0.0)
                yield bound
                yield bound + self.share * self.jumps().get(name, 0.0)


def conditioning(operation: Operation, inputs: Inputs, rows: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Sum of |r dT/dr| over the terms T, from the oracle's sum of |T| where all positions are stretched.

    In a periodic box, whose lengths stay, r is the separation before the nearest image is taken. The stretch moves no
    particle by more than that of a neighbour.
    """
    stretch = STRETCH
    if period_of(operation, inputs) is not None:
        farthest = float(np.abs(inputs["position"]).max(initial=0.0))
        stretch *= min(1.0, inputs.case.support_radius / farthest) if farthest > 0 else 1.0
    more, less = (_stretched(operation, inputs, 1 + part, rows) for part in (stretch, -stretch))
    return {name: size(more[name] - less[name]) / (2 * stretch) for name in more}


def _stretched(operation: Operation, inputs: Inputs, factor: float, rows: np.ndarray | None) -> dict[str, np.ndarray]:
    """The oracle's sums of |terms| where all positions are multiplied by a factor, and the nodes of a grid stay."""
    changed: dict[str, Any] = {"position": factor * np.asarray(inputs["position"], dtype=float)}
    changed |= {name: inputs[name] for name in STAND_INS if name in operation.arguments("numpy")}
    if "walls" in operation.arguments("numpy") and inputs["walls"] is not None:
        walls = inputs["walls"]
        changed["walls"] = walls._replace(position=factor * np.asarray(walls.position, dtype=float))
    answer = oracle(operation, inputs.replaced(**changed), rows)
    return {name: scale for name, (_, scale) in answer.items()}


def edge_terms(operation: Operation, inputs: Inputs, rows: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Sum of |T| of the pairs at r = h within `EDGE` roundings, in rows that have such a pair; else 0."""
    edge, radius = EDGE * float(np.finfo(inputs.dtype).eps), inputs.case.list_radius
    near = np.zeros(len(inputs["position"]) if rows is None else len(rows), dtype=bool)
    for place, _, distance in _all_distances(operation, inputs, rows):
        near[place] |= (np.abs(distance / radius - 1) <= edge).any(1)
    if not near.any():
        return {}
    less, more = (_stretched(operation, inputs, 1 + part, rows) for part in (-2 * edge, 2 * edge))
    per_particle = [name for name in less if inputs.per_particle(name)]
    return {name: np.where(near, size(less[name] - more[name]), 0.0) for name in per_particle}
