"""The compile cache: compiled code on disk, under a digest of every source behind a kernel.

Numba's own cache looks at one file only, and would return old numbers after an edit in another.
"""

import contextlib
import functools
import hashlib
import os
import pickle
import re
import shutil
import stat
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

from refsim.backends.fast.private import names
from refsim.core.errors import InputError
from refsim.core.reading import open_regular
from refsim.core.writing import in_turn, write_once

_REFSIM = Path(__file__).parents[1]
_CACHES_KEPT = 200
_CACHE_NAME = re.compile("[0-9a-f]{16}")  # of the folders that `cache_folder` makes: it deletes no other
_IMPORT = re.compile(r"^(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([\w.]+))", re.MULTILINE)


def _package_of(path: Path) -> Path:
    """Top folder of the package that a source belongs to; the source's own folder if that is no package."""
    package = path.parent
    while (package.parent / "__init__.py").exists():
        package = package.parent
    return package


def sources_behind(path: Path) -> list[Path]:
    """The file and every source of its own package and of refsim that it imports, directly or through others."""
    package = _package_of(path)
    tops = {_REFSIM.name: _REFSIM.parent, package.name: package.parent}
    sources, waiting = set(), [path]
    while waiting:
        file = waiting.pop()
        if file in sources or not file.exists():
            continue
        sources.add(file)
        for module, listed, plain in _IMPORT.findall(file.read_text(encoding="utf-8")):
            target = (module or plain).split(".")
            if target[0] not in tops:
                continue
            stem = tops[target[0]].joinpath(*target)
            inside = [stem / f"{name}.py" for name in re.findall(r"\w+", listed)]
            only_modules = bool(inside) and all(p.exists() for p in inside)
            waiting += inside if only_modules else [*inside, stem.with_suffix(".py"), stem / "__init__.py"]
    return sorted(sources)


_GROUP = re.compile(r"^class \w+\(NamedTuple\):\n(?:[ \t].*\n|\n)+", re.MULTILINE)


@functools.cache
def _groups_of(package: Path) -> str:
    """Files and definitions of all parameter groups of a package.

    A kernel takes groups that it does not import. Its compiled code names their classes and reads members by number.
    """
    files = sorted(package.rglob("*.py")) if (package / "__init__.py").exists() else ()
    return "".join(
        f"{_place(file)} {group}" for file in files for group in _GROUP.findall(file.read_text(encoding="utf-8"))
    )


def _place(source: Path) -> str:
    """Name of a source for the digest: within refsim, whose copies, in several environments say, share their kernels.

    Another package's folder counts, since it stands for what else the package imports.
    """
    return (source.relative_to(_REFSIM.parent) if source.is_relative_to(_REFSIM) else source).as_posix()


@functools.cache
def source_digest(path: Path) -> str:
    """Digest of a kernel file, of the sources behind it (names and contents), and of its package's parameter groups."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]} {_groups_of(_package_of(path))}".encode())
    for source in sources_behind(path):
        digest.update(_place(source).encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def cache_root() -> Path:
    """Folder of all caches: $REFSIM_CACHE_DIR, else the user's cache folder."""
    chosen = os.environ.get("REFSIM_CACHE_DIR")
    if chosen:
        return Path(chosen)
    import platformdirs  # where it is needed: it takes 20 ms

    return platformdirs.user_cache_path("refsim", appauthor=False)


def is_writable() -> bool:
    """Whether kernels can be kept for the next process: the folder of all caches is there, or can be made."""
    with contextlib.suppress(OSError):
        cache_root().mkdir(mode=0o700, parents=True, exist_ok=True)
    return os.access(cache_root(), os.W_OK)


@functools.cache
def cache_folder(path: Path) -> str:
    """Cache folder for the kernels of a source file; the folders longest unused are cleared away.

    Raises InputError if a folder that can be written to belongs to another user or is open to all.
    """
    root = cache_root()
    folder = root / source_digest(path)
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        os.utime(folder)
        named = (p for p in root.iterdir() if _CACHE_NAME.fullmatch(p.name) and p.is_dir())
        for stale in sorted(named, key=lambda p: p.stat().st_mtime)[:-_CACHES_KEPT]:
            shutil.rmtree(stale, ignore_errors=True)
    except OSError:  # a read-only home still works: Numba then compiles in every process
        pass
    if os.access(folder, os.W_OK):
        for each in (root, folder):
            is_own(each)  # raises where it is another user's
    return str(folder)


def cached(dispatcher: Any, function: Callable) -> Any:
    """The dispatcher with refsim's cache."""
    if not hasattr(dispatcher, "enable_caching") or names("cache") is None:  # plain Python, as in the simulator
        return dispatcher
    path = Path(function.__code__.co_filename)
    wrapper = path.parent.parent == cache_root()
    folder = path.parent if wrapper else Path(cache_folder(path))
    if not os.access(folder, os.W_OK) or not (is_own(folder.parent) and is_own(folder)):
        return dispatcher
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(folder)
    try:
        dispatcher.enable_caching()
    finally:
        numba.config.CACHE_DIR = before
    cache, compile_here = dispatcher._cache, dispatcher.compile
    place = folder / f"{path.stem}-{function.__code__.co_firstlineno}-{function.__qualname__}"
    cache._cache_file = files = CodeFiles(str(place), cache._cache_file._dump)

    def compile_or_load(signature: Any) -> Any:
        """Load the code, or compile and store it; of several processes one compiles, and the others load."""
        stored = os.path.exists(files.path(cache._index_key(signature, dispatcher.targetctx.codegen())))
        with contextlib.nullcontext() if stored else in_turn(Path(f"{place}.lock"), stays=True):
            return compile_here(signature)

    dispatcher.compile = compile_or_load
    return dispatcher


# Files of the cache. Numba unpickles what stands in them and runs it. Each ends with a SHA-256 over its content, which
# detects damage; the check of the folder's owner and rights protects against other users.

DIGEST_BYTES = 32
_told: set[str] = set()  # kinds of warnings that this process has given


def is_own(folder: Path) -> bool:
    """Whether nobody else may write to a folder of the cache; where its group may, a warning says so once.

    Raises InputError if another user owns it, or every user may write to it.
    """
    try:
        about = os.stat(folder)
    except OSError:
        return True  # an absent folder holds no code
    foreign = f"belongs to another user (number {about.st_uid})" if about.st_uid != os.geteuid() else ""
    if foreign or about.st_mode & stat.S_IWOTH:
        raise InputError(
            f"the compile cache {folder} {foreign or 'can be written to by every user'}, who could place code there"
            " that refsim would run; set REFSIM_CACHE_DIR to a folder that only you can write to, or correct the"
            " folder's owner and rights."
        )
    if shared := bool(about.st_mode & stat.S_IWGRP):
        tell_once(
            "shared",
            f"the compile cache {folder} is not used, because its group can write to it and could place code there that"
            f" refsim would run; run `chmod g-w {folder}`, or set REFSIM_CACHE_DIR to a folder that only you can write"
            " to.",
        )
    return not shared


class CodeFiles:
    """Compiled code of one kernel, in place of Numba's index and numbered files: a file for each key.

    A key stands for types of arguments, processor and function. A damaged file is deleted and its kernel compiled anew.

    place  of the files, to which the key adds its digest; `dump` pickles what Numba hands over
    """

    def __init__(self, place: str, dump: Callable[[Any], bytes]) -> None:
        self.place, self.dump = place, dump

    def path(self, key: Any) -> str:
        """The file of a key."""
        return f"{self.place}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc"

    def load(self, key: Any) -> Any:
        """The code of this key; None where there is none."""
        path = self.path(key)
        try:
            with open_regular(path) as file:
                content = file.read()
        except FileNotFoundError:
            return None
        except OSError:  # an unreadable file is treated as damaged
            content = b""
        if hashlib.sha256(content[:-DIGEST_BYTES]).digest() == content[-DIGEST_BYTES:]:
            stored, code = pickle.loads(content)
            return code if stored == key else None  # of a class that is written like another
        with contextlib.suppress(OSError):
            os.unlink(path)
        tell_once(
            "damaged",
            f"the compile cache was damaged ({path}); damaged files are deleted, their kernels compiled again.",
        )
        return None

    def save(self, key: Any, code: Any) -> None:
        """Keep the code of this key; a warning says so where the file cannot be written."""
        content = self.dump((key, code))
        try:
            write_once(Path(self.path(key)), content + hashlib.sha256(content).digest())
        except OSError as error:
            tell_once(
                "unwritable",
                f"the compile cache {os.path.dirname(self.place)} cannot be written ({error.strerror or error}); the"
                " next run compiles these kernels again.",
            )


def tell_once(kind: str, sentence: str) -> None:
    """Warn once in a process of what is of this kind."""
    if kind not in _told:
        _told.add(kind)
        warnings.warn(sentence, stacklevel=2)
