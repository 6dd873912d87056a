"""Results on disk: `results/<experiment>/<run>-<digest>/` with result.json and arrays.npz.

The digest covers the run's parameters, refsim, and the code of every module of validation that its own imports, without
comments, docstrings and layout.

result.json begins with the digest of its content and has that of arrays.npz; a folder that does not match is renamed to
`*.damaged`, and so is one that was written before there were digests.
"""

import ast
import functools
import gzip
import hashlib
import inspect
import io
import json
import math
import os
import shutil
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from refsim.core.writing import made_by, write_file
from refsim.io.store import read_stored, set_aside, write_stored

FORMAT = 1
# Modules of this package that name, judge, keep, draw and tell what runs give: no result depends on them.
PRESENTING = (
    "accuracy", "accuracy_page", "checks", "drawing", "experiment", "filling", "judging",
    "maps", "page", "perform", "report", "results", "tables",
)  # fmt: skip
AROUND = ("cluster", "commands", "contract", "examples", "render", "sweep")  # of refsim: they compute no run
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
_HERE = Path(__file__).resolve().parent
_ROOT = _HERE.parent


@dataclass(frozen=True)
class Result:
    """What a run gave: `values` for JSON, `arrays` by name; `about` says when, where and with what parameters."""

    values: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    about: Mapping[str, Any] = field(default_factory=dict)


@functools.cache
def sources_digest(module_file: str) -> str:
    """Digest of a run's module, of what this imports of validation, and of refsim."""
    digest = hashlib.sha256()
    for file in modules_behind(Path(module_file).resolve()):
        place = file.relative_to(_ROOT) if file.is_relative_to(_ROOT) else Path(file.name)
        digest.update(f"{place.as_posix()}\0{_digest_of(file)}\n".encode())
    return digest.hexdigest()[:16]


def modules_behind(file: Path) -> list[Path]:
    """A module's file, those of validation that it imports, directly or through others, and those of refsim.

    Modules of validation in PRESENTING, and packages of refsim in AROUND, do not count.
    """
    refsim = _ROOT / "refsim"
    files = {each for each in refsim.rglob("*.py") if each.relative_to(refsim).parts[0] not in AROUND}
    waiting = [file]
    while waiting:
        file = waiting.pop()
        if file in files or not file.exists() or (file.parent == _HERE and file.stem in PRESENTING):
            continue
        files.add(file)
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "validation":
                stem = _ROOT.joinpath(*str(node.module).split("."))
                names = ("__init__", *(alias.name for alias in node.names))
                waiting += [stem.with_suffix(".py"), *(stem / f"{name}.py" for name in names)]
    return sorted(files)


@functools.cache
def _digest_of(file: Path) -> str:
    """Digest of a module: of refsim its text, of others their code without comments, docstrings and layout."""
    text = file.read_text(encoding="utf-8")
    if not file.is_relative_to(_ROOT / "refsim"):
        tree = ast.parse(text)
        for node in ast.walk(tree):
            if isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
                node.body = node.body[1:] or [ast.Pass()]
        text = ast.dump(tree)
    return hashlib.sha256(text.encode()).hexdigest()


def result_folder(root: Path, experiment: str, key: str, function: Callable, parameters: Mapping[str, Any]) -> Path:
    """Where the result of `function(**parameters)` belongs; raises TypeError for parameters JSON does not know."""
    text = json.dumps(parameters, sort_keys=True, allow_nan=False)
    sources = sources_digest(inspect.getfile(inspect.unwrap(function)))
    digest = hashlib.sha256(f"{FORMAT} {function.__name__} {sources} {text}".encode()).hexdigest()[:12]
    return root / experiment / f"{key}-{digest}"


def save(folder: Path, result: Result) -> None:
    """Write a result; until it is whole, nothing stands in its place."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder.parent))
    try:
        write_file(partial / "arrays.npz", made_by(np.savez_compressed, **result.arrays))
        arrays = hashlib.sha256((partial / "arrays.npz").read_bytes()).hexdigest()
        write_stored(
            partial / "result.json", {"arrays": arrays} | finite({"about": result.about, "values": result.values})
        )
        if folder.exists():
            shutil.rmtree(folder)
        os.replace(partial, folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def load(folder: Path) -> Result | None:
    """The result in `folder`; None where there is none, or a damaged one, which is said and set aside.

    Raises InputError where it cannot be read.
    """
    notes: list[str] = []
    document = read_stored(folder / "result.json", notes, folder)
    result = None
    if document is not None:
        try:
            content = (folder / "arrays.npz").read_bytes()
            if hashlib.sha256(content).hexdigest() != document["arrays"]:
                raise ValueError("not the arrays of this result")
            with np.load(io.BytesIO(content)) as stored:
                arrays = {name: stored[name] for name in stored.files}
            result = Result(document["values"], arrays, document["about"])
        except (OSError, ValueError, KeyError):
            set_aside(folder, "holds other arrays than those of its digest", notes)
    for note in notes:
        print(note, file=sys.stderr)
    return result


def origin(results: Iterable[Result]) -> dict[str, Any]:
    """Date, commit, machine and command of the latest of some results, and the seconds of all; empty where unknown."""
    about = [result.about for result in results if result.about]
    if not about:
        return {}
    latest = max(about, key=lambda each: str(each.get("date")))
    seconds = round(sum(each.get("seconds", 0.0) for each in about), 1)
    return {**{name: latest.get(name) for name in ("date", "commit", "machine", "command")}, "seconds": seconds}


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
