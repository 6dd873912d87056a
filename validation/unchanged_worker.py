"""Computes runs under the sources of the current folder, whatever their age, and writes digests of what they give.

`python unchanged_worker.py RUNS.json ANSWER`: RUNS lists [name, module, function, parameters]; ANSWER gets a line
[name, digests by place, or why the run failed] for each. Imports nothing but what both sources have.
"""

import hashlib
import importlib
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np


def leaves(value: Any, place: str = "") -> Iterator[tuple[str, str]]:
    """(place, digest of the bits) of every number, text and array in nested mappings and sequences."""
    if isinstance(value, Mapping):
        for key in value:
            yield from leaves(value[key], f"{place}/{key}")
    elif isinstance(value, list | tuple):
        for k, each in enumerate(value):
            yield from leaves(each, f"{place}/{k}")
    elif isinstance(value, np.ndarray | np.generic):
        array = np.ascontiguousarray(value)
        yield place, f"{array.dtype} {array.shape} {hashlib.sha256(array.tobytes()).hexdigest()[:16]}"
    else:
        yield place, value.hex() if isinstance(value, float) else repr(value)


def main(runs: Path, answer: Path) -> None:
    """Compute the runs one after another."""
    from validation.running import Context

    with answer.open("w") as out:
        for name, module, function, parameters in json.loads(runs.read_text()):
            try:
                result = getattr(importlib.import_module(module), function)(Context(threads=1), **parameters)
                found: Any = dict(leaves({"values": result.values, "arrays": dict(result.arrays)}))
            except Exception as error:  # of any kind: it is the answer
                found = f"{type(error).__name__}: {error}"[:200]
            out.write(json.dumps([name, found]) + "\n")
            out.flush()


if __name__ == "__main__":
    sys.path[0] = str(Path.cwd())
    main(*map(Path, sys.argv[1:]))
