"""Results on disk: `results/<experiment>/<run>-<digest>/` with result.json and arrays.npz.

The digest covers the run's parameters and every source that shapes its numbers, so that a stored result is reused
exactly as long as it would come out the same.
"""

from __future__ import annotations

import functools
import gzip
import hashlib
import inspect
import json
import math
import os
import shutil
import tempfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

FORMAT = 1
_ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Result:
    """What a run gave: `values` for JSON, `arrays` by name; `about` says when, where and with what parameters."""

    values: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)


@functools.cache
def sources_digest(module_file: str) -> str:
    """Digest of refsim, of the file in which a run's function stands, and of what this imports from here."""
    from refsim.backends.compile import sources_behind

    files = {*(_ROOT / "refsim").rglob("*.py"), *sources_behind(Path(module_file).resolve())}
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.name.encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]


def result_folder(root: Path, experiment: str, key: str, function: Callable, parameters: Mapping[str, Any]) -> Path:
    """Where the result of `function(**parameters)` belongs; raises TypeError for parameters JSON does not know."""
    text = json.dumps(parameters, sort_keys=True, allow_nan=False)
    sources = sources_digest(inspect.getfile(function))
    digest = hashlib.sha256(f"{FORMAT} {function.__name__} {sources} {text}".encode()).hexdigest()[:12]
    return root / experiment / f"{key}-{digest}"


def save(folder: Path, result: Result) -> None:
    """Write a result; until it is whole, nothing stands in its place."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder.parent))
    try:
        np.savez_compressed(partial / "arrays.npz", **result.arrays)
        document = {"about": result.about, "values": finite(result.values)}
        (partial / "result.json").write_text(json.dumps(document, indent=1, allow_nan=False))
        if folder.exists():
            shutil.rmtree(folder)
        os.replace(partial, folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def load(folder: Path) -> Result | None:
    """The result in `folder`, or None where there is none that can be read."""
    try:
        document = json.loads((folder / "result.json").read_text())
        with np.load(folder / "arrays.npz") as stored:
            arrays = {name: stored[name] for name in stored.files}
    except (OSError, ValueError):
        return None
    return Result(document["values"], arrays, document["about"])


def finite(value: Any) -> Any:
    """`value` with plain Python numbers, and None for what is not finite, as strict JSON wants it."""
    if isinstance(value, Mapping):
        return {str(k): finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [finite(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def floats(values: Any) -> np.ndarray:
    """Numbers from JSON as a float array; null is NaN."""
    return np.array(values, dtype=float)


def real(value: Any) -> float:
    """A number from JSON as a float; null is NaN."""
    return float("nan") if value is None else float(value)


def read_json(path: Path) -> Any:
    """What a JSON file holds, compressed by gzip or not. Raises OSError or ValueError where it cannot be read."""
    raw = path.read_bytes()
    try:
        return json.loads(gzip.decompress(raw) if raw.startswith(b"\x1f\x8b") else raw)
    except (EOFError, zlib.error) as error:
        raise ValueError(f"{path} is damaged ({error})") from None
