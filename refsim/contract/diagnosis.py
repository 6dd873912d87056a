"""What is wrong with a program, in words: an output that it does not write, a factor, a sign, some of the particles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from refsim.core.operation import Operation

SAME = 1e-3  # relative spread of a factor that is the same for all particles
SMALL = 1e-3  # share of the largest value below which a value says nothing about a factor


def unset(dtype: np.dtype) -> Any:
    """The value that stands in outputs which no program has written: NaN, or the largest integer."""
    return np.nan if dtype.kind == "f" else np.iinfo(dtype).max


def unwritten(before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray], given: Any = ()) -> Iterator[str]:
    """Names of outputs in which every entry is as unset as it was; those of `given` were set by the trial."""
    for name, values in before.items():
        if name not in given and values.size and _unset(values).all() and _unset(after[name]).all():
            yield name


def _unset(values: np.ndarray) -> np.ndarray:
    return np.isnan(values) if values.dtype.kind == "f" else values == unset(values.dtype)


def diagnosis(
    operation: Operation,
    before: Mapping[str, Any],
    after: Mapping[str, Any],
    answer: Mapping[str, tuple[Any, Any]],
    found: Mapping[str, np.ndarray],
    rows: np.ndarray | None = None,
) -> str:
    """One clause about the worst output; where no error exceeds its bound, only where the largest error is.

    before, after  outputs of all particles before and after the launch
    answer, found  the oracle's answer, and error over bound, by output; of `rows` if these are given
    """
    peaks = {name: float(np.max(ratio, initial=0.0)) for name, ratio in found.items()}
    name = max(peaks, key=lambda n: peaks[n], default="")
    if not name or not peaks[name] > 0:
        return ""
    worst = int(np.argmax(found[name]))
    if rows is not None and len(rows) != len(found[name]):
        rows = None  # an output of the whole set is compared whole
    place = f"{name} of particle {worst if rows is None else rows[worst]}"
    if peaks[name] <= 1:
        return place
    wrong = ~(np.asarray(found[name]) <= 1)
    start, got = (np.asarray(values[name], dtype=float) for values in (before, after))
    if rows is not None and len(got) != len(wrong):
        start, got = start[rows], got[rows]
    value = np.asarray(answer[name][0], dtype=float)
    share = f"{int(wrong.sum())} of {wrong.size}"
    if np.array_equal(start, got, equal_nan=True):
        return f"your program {'adds nothing to' if name in operation.adds else 'does not change'} {name}"
    broken = ~np.isfinite(got)
    if broken.any():
        return f"your program gives {name} that is NaN or infinite ({int(broken.sum())} of {broken.size} values)"
    change = got - start if name in operation.adds else got
    if change.shape == value.shape and name not in operation.exact:
        if name in operation.adds and np.any(start) and _factor(got, value) == 1:
            return f"your program overwrites {name}; it must add to what stands there"
        factor = _factor(change, value)
        if factor == 0:
            return f"your program gives 0 for {name} everywhere"
        if factor == -1:
            return f"your program gives {name} with the opposite sign"
        if factor is not None and factor != 1:
            return f"your program gives {factor:.4g} times the right {name}, everywhere"
    return f"your program gives a wrong {name} in {share} rows, the worst in row {place.rpartition(' ')[2]}"


def _factor(got: np.ndarray, value: np.ndarray) -> float | None:
    """The factor between two arrays, if one serves all entries of at least two; 1, 0 and -1 up to SAME."""
    if value.size < 2 or not np.any(value):
        return None
    large = np.abs(value) > SMALL * np.abs(value).max()
    ratios = got[large] / value[large]
    factor = float(np.median(ratios))
    if len(ratios) < 2 or np.abs(ratios - factor).max() > SAME * max(abs(factor), SMALL):
        return None
    for plain in (0.0, 1.0, -1.0):
        if abs(factor - plain) <= SAME:
            return plain
    return factor
