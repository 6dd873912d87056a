"""A trial's last call as a file: arguments, outputs before and after it, the right answer and its bound.

`REPLAY` (npz) holds an argument by its name, a member of a parameter group as GROUP.MEMBER, what stood in an output
before the call as before/OUTPUT, what stands there after it as got/OUTPUT and should as answer/OUTPUT, and the largest
error allowed in each row as bound/OUTPUT. An argument without an array is None.
"""

from typing import Any

import numpy as np

from refsim.contract.bounds import Bounds, oracle
from refsim.contract.inputs import arguments_of_others
from refsim.contract.target import Target
from refsim.core.writing import made_by, write_file

REPLAY = "replay.npz"  # in the current folder


def write_replay(target: Target) -> None:
    """Write the last call of a target."""
    if "launch" not in target.last:
        return
    inputs, before, after = target.last["launch"]
    operation = target.operation
    told = {key: value for name in arguments_of_others(operation, "numpy") for key, value in _flat(name, inputs[name])}
    with np.errstate(all="ignore"):
        bounds, right = Bounds(operation, inputs), oracle(operation, inputs)
        for name, (answer, scale) in right.items():
            start = bounds.rows_of(name, before[name])
            *_, bound = bounds.growing(name, answer, scale, start)
            told |= {f"before/{name}": before[name], f"got/{name}": after[name]}
            told[f"answer/{name}"] = answer + (start if name in operation.adds else 0.0)
            told[f"bound/{name}"] = bound.max(tuple(range(1, bound.ndim)))
    write_file(REPLAY, made_by(np.savez, allow_pickle=False, **told))


def _flat(name: str, value: Any) -> list[tuple[str, Any]]:
    """The array or number by its name; members of groups by "group.member", nothing for None."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return [pair for field, part in zip(value._fields, value) for pair in _flat(f"{name}.{field}", part)]
    return [] if value is None else [(name, value)]
