"""How far an answer may be from the oracle's: c * neighbours * eps * sum|terms|, for each particle by itself.

A sum of k terms, each rounded a few times, is off by at most (k + c) * eps * sum|terms| in whatever order it is
taken; c * (k + 1) * eps * sum|terms| is no smaller. The oracle gets the inputs as rounded, and a difference of two
coordinates is rounded relative to itself, so that a distance from the origin costs nothing more. What does is a
term that falls to zero at the edge of the support: a relative error of r changes it by r dT/dr, many times its own
size. That sum is measured on the oracle, by stretching all positions, wherever the plain bound does not suffice.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.contract.inputs import Inputs
from refsim.core.operation import Operation
from refsim.neighbours.reference import pair_blocks

STRETCH = 1e-6


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
        for place, _, distance in pair_blocks(inputs["position"], source, rows):
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
        terms = near + 1 if own else 1 if name in operation.entrywise else 1 + len(near)
        bound = factor * terms * size(scale)
        if name in operation.adds:
            bound = bound + factor * size(start)
        bound = bound + np.finfo(inputs.dtype).tiny
        ratio = _ratio(error, bound)
        if takes_neighbours(operation) and (ratio > 1).any():
            if conditioned is None:
                conditioned = conditioning(operation, inputs, rows)
            ratio = _ratio(error, bound + factor * conditioned[name])
        found[name] = ratio
    return found


def _ratio(error: np.ndarray, bound: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(error), error / bound, np.inf)


def conditioning(operation: Operation, inputs: Inputs, rows: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Sum of |r dT/dr| over the terms T, from the oracle's sum of |T| where all positions are stretched."""

    def stretched(factor: float) -> dict[str, np.ndarray]:
        changed: dict[str, Any] = {"position": factor * np.asarray(inputs["position"], dtype=float)}
        if "walls" in operation.arguments("numpy") and inputs["walls"] is not None:
            walls = inputs["walls"]
            changed["walls"] = walls._replace(position=factor * np.asarray(walls.position, dtype=float))
        answer = oracle(operation, inputs.replaced(**changed), rows)
        return {name: scale for name, (_, scale) in answer.items()}

    more, less = stretched(1 + STRETCH), stretched(1 - STRETCH)
    return {name: size(more[name] - less[name]) / (2 * STRETCH) for name in more}


def undecided(operation: Operation, inputs: Inputs, answer: Mapping[str, tuple[Any, Any]]) -> float:
    """Largest share of flags so near to flipping that they are not compared."""
    eps = float(np.finfo(inputs.dtype).eps)
    shares = [(answer[n][1] <= operation.tolerance * eps).mean() for n in operation.exact if len(answer[n][1])]
    return float(max(shares, default=0.0))
