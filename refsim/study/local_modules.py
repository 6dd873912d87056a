"""Modules that a user's Python file imports from its own folder: what it computes follows from them, too."""

import ast
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path

import refsim.core

INSTALLED = ("site-packages", "dist-packages")
REFSIM = Path(refsim.core.__file__).resolve().parent.parent
BY_NAME = ("import_module", "__import__")


def local_modules(path: Path) -> dict[str, Path]:
    """Files by module that `path` imports, directly or through others, and that lie in its folder or below.

    Found in the text, without running it. What is installed, in a virtual environment below the folder say, and refsim
    itself do not count.
    """
    path = path.resolve()
    modules: dict[str, Path] = {}
    waiting = [] if path.is_relative_to(REFSIM) else [("", path)]
    while waiting:
        importer, text = waiting.pop()
        for name in _imported(text, importer):
            file = None if name in modules else _file_of(name, path.parent)
            if file is not None and file != path:
                modules[name] = file
                waiting.append((name, file))
    return modules


def forget(modules: dict[str, Path]) -> None:
    """Have these modules loaded anew when they are imported next: their text may have changed since."""
    for name, file in modules.items():
        loaded = getattr(sys.modules.get(name), "__file__", None)
        if loaded and file.suffix == ".py" and not _installed(Path(loaded).resolve(), file.parent):
            del sys.modules[name]
            parent, _, last = name.rpartition(".")
            if hasattr(sys.modules.get(parent), last):  # a folder without __init__.py keeps its modules by name
                delattr(sys.modules[parent], last)


def _imported(file: Path, importer: str) -> Iterator[str]:
    """Whole names of the modules that a file may import: `from a import b` may import a.b."""
    if file.suffix != ".py":
        return
    try:
        tree = ast.parse(file.read_bytes())
    except (OSError, ValueError, SyntaxError):  # running it reports it
        return
    package = importer if file.name == "__init__.py" else importer.rpartition(".")[0]
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            names = [".".join(filter(None, (*above, node.module, alias.name))) for alias in node.names]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in BY_NAME:
            names = [arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]
        for name in names:
            parts = name.split(".")
            yield from (".".join(parts[: k + 1]) for k in range(len(parts)))


def _file_of(name: str, folder: Path) -> Path | None:
    """The file of a module in this folder or below: where it is loaded from, or where it would be found."""
    loaded = getattr(sys.modules.get(name), "__file__", None)
    places = [Path(loaded)] if loaded else []
    for base in (folder, *map(Path, sys.path)):
        stem = base.joinpath(*name.split("."))
        places += [stem / "__init__.py", stem.with_name(f"{stem.name}.py")]
    for place in places:
        file = place.resolve()
        if file.is_relative_to(folder) and file.is_file() and not _installed(file, folder):
            return file
    return None


def _installed(file: Path, folder: Path) -> bool:
    """Whether a file belongs to Python, to an installed package or to refsim, and this folder does not."""
    inside = file.relative_to(folder).parts if file.is_relative_to(folder) else file.parts
    homes = [REFSIM, *(Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "platstdlib"))]
    return any(part in INSTALLED for part in inside) or any(
        file.is_relative_to(home) and not folder.is_relative_to(home) for home in homes
    )
