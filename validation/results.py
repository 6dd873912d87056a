"""Results on disk: `results/<experiment>/<run>-<digest>/` with result.json and arrays.npz.

The digest covers the run's parameters and the code of every module that its function imports, directly or through
others. Comments, docstrings and layout do not count, so that a result outlives their edits.

result.json begins with the digest of its content and has that of arrays.npz; a folder that does not match is renamed to
`*.damaged`, and so is one that was written before there were digests.
"""

from __future__ import annotations

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
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from refsim.io.store import read_stored, set_aside, write_stored

FORMAT = 1
# Modules of this package that name, judge, keep, draw and tell what runs give: no result depends on them.
PRESENTING = (
    "accuracy", "accuracy_page", "checks", "drawing", "experiment", "filling", "judging",
    "maps", "page", "perform", "report", "results", "tables",
)  # fmt: skip
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
def sources_digest(module_file: str, without: tuple[str, ...] = (), function: str = "") -> str:
    """Digest of the code in which a run's function stands, and of what this imports of refsim and validation.

    without   paths of modules and packages that the run imports and does not compute with
    function  of the module: what it does not reach does not count; all counts without
    """
    digest, own = hashlib.sha256(), Path(module_file).resolve()
    for file in modules_behind(own, tuple(_ROOT / path for path in without), function):
        place = file.relative_to(_ROOT) if file.is_relative_to(_ROOT) else Path(file.name)
        code = _digest_of(_reached(file, function)) if file == own and function else _code_digest(file)
        digest.update(f"{place.as_posix()}\0{code}\n".encode())
    return digest.hexdigest()[:16]


def modules_behind(file: Path, without: tuple[Path, ...] = (), function: str = "") -> list[Path]:
    """A module's file and those of all modules of this repository that it imports, directly or through others.

    A method's package counts with all of its modules but the contract's cases: its operations load their programs when
    they are first used. A name that refsim exports counts with the module that defines it, and not with all of refsim.
    Modules of PRESENTING and below `without` do not count, nor what `function` of the first module does not reach.
    """
    found = {file} if function else set[Path]()
    waiting = _imports(_reached(file, function)) if function else [file]
    while waiting:
        file = waiting.pop()
        left_out = (file.parent == _HERE and file.stem in PRESENTING) or any(map(file.is_relative_to, without))
        if file not in found and not left_out:
            found.add(file)
            waiting += _imported_by(file)
    return sorted(found)


def _reached(file: Path, name: str) -> list[ast.stmt]:
    """Statements at the top of a module that one of its names needs, directly or through others."""
    binding: dict[str, list[ast.stmt]] = {}
    for statement in _tree(file).body:
        nodes = [statement] if isinstance(statement, DOCUMENTED) else list(ast.walk(statement))
        names = {getattr(node, "name", "") for node in nodes if isinstance(node, DOCUMENTED)}
        names |= {node.id for node in nodes if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
        names |= {(node.asname or node.name).partition(".")[0] for node in nodes if isinstance(node, ast.alias)}
        for bound in names:
            binding.setdefault(bound, []).append(statement)
    waiting, found = [name], list[ast.stmt]()
    while waiting:
        for statement in binding.pop(waiting.pop(), ()):
            found.append(statement)
            waiting += [node.id for node in ast.walk(statement) if isinstance(node, ast.Name)]
    return [statement for statement in _tree(file).body if statement in found]


@functools.cache
def _imported_by(file: Path) -> list[Path]:
    found = _imports(_tree(file).body)
    if file.name == "__init__.py" and (file.parent / "cases.py").exists():
        found += [other for other in file.parent.glob("*.py") if other.name != "cases.py"]
    return found


def _imports(statements: Sequence[ast.stmt]) -> list[Path]:
    found: set[Path | None] = set()
    waiting: list[ast.AST] = list(statements)
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.ImportFrom):
            if node.module and not node.level:
                for name in (alias.name for alias in node.names):
                    module = _defined_in(node.module, name)
                    found.add(_file_of(f"{module}.{name}") or _file_of(module))
        elif isinstance(node, ast.Import):
            found |= {_file_of(alias.name) for alias in node.names}
        elif not isinstance(node, ast.If) or "TYPE_CHECKING" not in ast.dump(node.test):
            for part in ("body", "orelse", "handlers", "finalbody", "cases"):
                inside = getattr(node, part, [])
                waiting += inside if isinstance(inside, list) else []
    return [other for other in found if other is not None]


def _file_of(module: str) -> Path | None:
    """The file of a module of this repository; None for any other."""
    names = module.split(".")
    if names[0] not in ("refsim", "validation"):
        return None
    stem = _ROOT.joinpath(*names)
    places = (stem / "__init__.py", stem.with_suffix(".py"))
    return next((place for place in places if place.exists()), None)


def _defined_in(module: str, name: str) -> str:
    """The module behind a name that refsim exports; of other modules the module itself."""
    if module != "refsim":
        return module
    nodes = (node for node in _tree(_ROOT / "refsim" / "__init__.py").body if isinstance(node, ast.ImportFrom))
    exported = {alias.asname or alias.name: str(node.module) for node in nodes for alias in node.names}
    return exported.get(name, module)


@functools.cache
def _tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text())


@functools.cache
def _code_digest(file: Path) -> str:
    """Digest of a module's code without its comments, docstrings and layout."""
    return _digest_of(_tree(file))


def _digest_of(code: Any) -> str:
    return hashlib.sha256(_dumped(code).encode()).hexdigest()


def _dumped(node: Any) -> str:
    """A syntax tree without docstrings, in words that are the same for every version of Python.

    `ast.dump` writes fields that other versions have not, and Python 3.12 has empty texts in the formats of f-strings.
    """
    if isinstance(node, ast.AST):
        fields = []
        for name in node._fields:
            value = getattr(node, name, None)
            if name == "values" and isinstance(node, ast.JoinedStr):
                value = [part for part in value if not (isinstance(part, ast.Constant) and part.value == "")]
            elif name == "body" and isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
                value = node.body[1:] or [ast.Pass()]
            if value is not None and value != []:
                fields.append(f"{name}={_dumped(value)}")
        return f"{type(node).__name__}({', '.join(fields)})"
    return f"[{', '.join(map(_dumped, node))}]" if isinstance(node, list) else repr(node)


def result_folder(root: Path, experiment: str, key: str, function: Callable, parameters: Mapping[str, Any]) -> Path:
    """Where the result of `function(**parameters)` belongs; raises TypeError for parameters JSON does not know."""
    text = json.dumps(parameters, sort_keys=True, allow_nan=False)
    sources = sources_digest(inspect.getfile(inspect.unwrap(function)), function=function.__name__)
    digest = hashlib.sha256(f"{FORMAT} {function.__name__} {sources} {text}".encode()).hexdigest()[:12]
    return root / experiment / f"{key}-{digest}"


def save(folder: Path, result: Result) -> None:
    """Write a result; until it is whole, nothing stands in its place."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder.parent))
    try:
        np.savez_compressed(partial / "arrays.npz", **result.arrays)
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
