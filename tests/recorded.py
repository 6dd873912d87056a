"""Numbers that were looked at once and are to stay: a test gives what a program says, a file holds what it said.

Words are left out, so that a sentence may be put better; its numbers stay. Of long arrays a few sums are held. Where an
answer is meant to change, `REFSIM_WRITE_RECORDED=1 pytest -n 0 TESTS` writes it anew; what differs is then looked at.
"""

import dataclasses
import json
import os
import pathlib
import re
from collections.abc import Mapping

import msgspec
import numpy as np

FOLDER = pathlib.Path(__file__).with_name("recorded_numbers")
NUMBER = re.compile(r"(?<![\w.])[-+]?\d[\d,]*(?:\.\d+)?(?:[eE][-+]?\d+)?")
FEW = 6  # values of an array that are held one by one
CLOSE = 1e-6  # share of the largest number of an entry by which numbers may differ: other processors round otherwise


def numbers(thing):
    """The numbers of a value, in order; of a text those in it, of an object those of its members."""
    if thing is None or isinstance(thing, (bool, int, float, np.bool_, np.number)):
        return ["none"] if thing is None else [float(thing)]
    if isinstance(thing, str):
        return [float(word.replace(",", "")) for word in NUMBER.findall(thing)]
    if isinstance(thing, np.ndarray) and thing.dtype.kind in "biuf":
        flat = thing.ravel().astype(float)
        finite = np.nan_to_num(flat, posinf=1e9, neginf=-1e9)
        weights = np.cos(np.arange(len(flat)))  # so that the order counts
        sums = [finite.sum(), np.abs(finite).sum(), weights @ finite]
        return [*map(float, thing.shape), *(flat.tolist() if len(flat) <= FEW else map(float, sums))]
    if isinstance(thing, Mapping):
        return [number for key in thing for number in numbers(thing[key])]
    if isinstance(thing, (list, tuple, set, frozenset, np.ndarray)):
        return [float(len(thing)), *(number for one in thing for number in numbers(one))]
    if isinstance(thing, msgspec.Struct):  # what has its default is left out, as a parameter that comes later is
        given = [(getattr(thing, field.name), field.default) for field in msgspec.structs.fields(thing)]
        return numbers([value for value, usual in given if usual is msgspec.NODEFAULT or repr(value) != repr(usual)])
    if dataclasses.is_dataclass(thing):
        return numbers({field.name: getattr(thing, field.name) for field in dataclasses.fields(thing)})
    return []


def short(values):
    """A list of numbers as it is held: to 9 digits, with words for what JSON has no number for."""
    return [v if isinstance(v, str) else repr(v) if not np.isfinite(v) else float(f"{v:.9g}") for v in values]


def differing(found, held):
    """Where numbers are not those that are held, or None."""
    size = max((abs(v) for v in held if not isinstance(v, str)), default=0.0)
    for k, (a, b) in enumerate(zip(found, held)):
        same = a == b if isinstance(a, str) or isinstance(b, str) else abs(a - b) <= CLOSE * (abs(b) + 1e-6 * size)
        if not same:
            return f"number {k} of {len(held)} is {a!r}, and was {b!r}"
    return None if len(found) == len(held) else f"{len(found)} numbers, and there were {len(held)}"


class Recorded:
    """What a test's numbers were, in the file of its module."""

    def __init__(self, module, test):
        self.path, self.test = FOLDER / f"{module}.json", test

    def __call__(self, found):
        """The numbers of each value of `found`, a mapping of words to values, are those of the file."""
        now = {f"{self.test}: {key}": short(numbers(value)) for key, value in found.items()}
        every = json.loads(self.path.read_text(encoding="utf-8")) if self.path.exists() else {}
        if os.environ.get("REFSIM_WRITE_RECORDED"):
            every = {key: row for key, row in every.items() if key.partition(": ")[0] != self.test} | now
            rows = ",\n".join(f"{json.dumps(key)}: {json.dumps(every[key])}" for key in sorted(every))
            self.path.write_text(f"{{\n{rows}\n}}\n", encoding="utf-8")
        held = {key: row for key, row in every.items() if key.partition(": ")[0] == self.test}
        wrong = {key: differing(now[key], held[key]) for key in now.keys() & held.keys()}
        lines = [f"{key}: {words}" for key, words in wrong.items() if words] + sorted(now.keys() ^ held.keys())
        assert not lines, f"{len(lines)} of {len(now)} entries of {self.path.name} differ: " + "; ".join(lines[:5])
