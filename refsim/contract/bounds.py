"""How far an answer may be from the oracle's: c * neighbours * eps * sum|terms|, for each particle by itself.

A sum of k terms, each rounded a few times, is off by at most (k + c) * eps * sum|terms| in whatever order it is
taken; c * (k + 1) * eps * sum|terms| is no smaller. The oracle gets the inputs as rounded, and a difference of two
coordinates is rounded relative to itself, so that a distance from the origin costs nothing more. What does is a
term that falls to zero at the edge of the support: a relative error of r changes it by r dT/dr, many times its own
size. That sum is measured on the oracle, by stretching all positions, wherever the plain bound does not suffice.
A pair within rounding of r = h counts or not, as its distance is rounded: a row that has one may differ by that term.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.contract.inputs import Inputs, distances, period_of
from refsim.core.cases import STAND_INS
from refsim.core.operation import Operation

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
            value, scale = (np.broadcast_to(part, (whole, *part.shape[1:])) for part in (value, scale))
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
    sources = [inputs["position"]]
    if "walls" in operation.arguments("numpy") and inputs["walls"] is not None:
        sources.append(inputs["walls"].position)
    for source in sources:
        for place, distance in distances(inputs["position"], source, rows, period_of(operation, inputs)):
            count[place] += (distance < inputs.case.list_radius).sum(1)
    return count


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
    answer         what to compare with, in the oracle's form; the oracle's by default
    share          how many times the bound is allowed
    """
    answer = oracle(operation, inputs, rows) if answer is None else answer
    eps = float(np.finfo(inputs.dtype).eps)
    near = neighbour_counts(operation, inputs, rows)
    conditioned: dict[str, np.ndarray] | None = None
    jumps: dict[str, np.ndarray] | None = None
    found = {}
    for name, (value, scale) in answer.items():
        own = inputs.per_particle(name)
        got = np.asarray(after[name], dtype=float)
        start = np.asarray(before[name], dtype=float)
        if own and rows is not None:
            got, start = got[rows], start[rows]
        if name in operation.exact:
            decided = ~(scale <= operation.tolerance * eps)
            found[name] = np.where(decided & (got != value), np.inf, 0.0)
            continue
        with np.errstate(invalid="ignore"):  # of infinity less infinity, which is no number and no agreement
            error = size(got - (start if name in operation.adds else 0) - value)
        factor = share * operation.tolerance * eps
        bound = share * _bound(operation, inputs, name, scale, start, near)
        ratio = _ratio(error, bound)
        if takes_neighbours(operation) and (ratio > 1).any():
            if conditioned is None:
                conditioned = conditioning(operation, inputs, rows)
            bound = bound + factor * conditioned[name]
            ratio = _ratio(error, bound)
            if (ratio > 1).any():
                jumps = edge_terms(operation, inputs, rows) if jumps is None else jumps
                ratio = _ratio(error, bound + share * jumps.get(name, 0.0))
        found[name] = ratio
    return found


def _bound(
    operation: Operation, inputs: Inputs, name: str, scale: np.ndarray, start: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """c (neighbours + 1) eps sum|terms| of an output, and the rounding of the sum with what stood there."""
    factor = operation.tolerance * float(np.finfo(inputs.dtype).eps)
    terms = near + 1 if inputs.per_particle(name) else 1 if name in operation.entrywise else 1 + len(near)
    bound = factor * terms * size(scale)
    if name in operation.adds:
        bound = bound + factor * size(start)
    return bound + np.finfo(inputs.dtype).tiny


def exact_bound(operation: Operation, value: np.ndarray, dtype: str) -> float:
    """Largest error allowed against a closed form."""
    largest = float(np.max(np.abs(value), initial=0))
    return 8 * operation.tolerance * float(np.finfo(dtype).eps) * largest + float(np.finfo(dtype).tiny)


def allowed(
    operation: Operation, inputs: Inputs, before: Mapping[str, Any], answer: Mapping[str, tuple[Any, Any]]
) -> dict[str, np.ndarray]:
    """Largest error allowed in each row of each output, the conditioning included; 0 or infinite for exact outputs.

    answer  in the oracle's form; (value, None) for a closed form
    """
    near = neighbour_counts(operation, inputs)
    known = {name: part for name, part in answer.items() if name in before}
    summed = takes_neighbours(operation) and all(scale is not None for _, scale in known.values())
    summed = summed and not set(known) <= set(operation.exact)
    conditioned = conditioning(operation, inputs) if summed else {}
    jumps = edge_terms(operation, inputs) if summed else {}
    factor = operation.tolerance * float(np.finfo(inputs.dtype).eps)
    found = {}
    for name, (value, scale) in known.items():
        if name in operation.exact:
            found[name] = np.zeros(np.shape(value)) if scale is None else np.where(scale <= factor, np.inf, 0.0)
        elif scale is None:
            found[name] = np.full(np.shape(value)[:1], exact_bound(operation, value, inputs.dtype))
        else:
            start = np.asarray(before[name], dtype=float)
            found[name] = _bound(operation, inputs, name, scale, start, near) + factor * conditioned.get(name, 0.0)
            found[name] = found[name] + jumps.get(name, 0.0)
    return found


def _ratio(error: np.ndarray, bound: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(error), error / bound, np.inf)


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
    sources = [inputs["position"]]
    if "walls" in operation.arguments("numpy") and inputs["walls"] is not None:
        sources.append(inputs["walls"].position)
    for source in sources:
        for place, distance in distances(inputs["position"], source, rows, period_of(operation, inputs)):
            near[place] |= (np.abs(distance / radius - 1) <= edge).any(1)
    if not near.any():
        return {}
    less, more = (_stretched(operation, inputs, 1 + part, rows) for part in (-2 * edge, 2 * edge))
    own = [name for name in less if inputs.per_particle(name)]
    return {name: np.where(near, size(less[name] - more[name]), 0.0) for name in own}


def undecided(operation: Operation, inputs: Inputs, answer: Mapping[str, tuple[Any, Any]]) -> float:
    """Largest share of flags so near to flipping that they are not compared."""
    eps = float(np.finfo(inputs.dtype).eps)
    shares = [(answer[n][1] <= operation.tolerance * eps).mean() for n in operation.exact if len(answer[n][1])]
    return float(max(shares, default=0.0))
