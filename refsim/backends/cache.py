"""The compile cache: compiled code on disk, under a digest of every source behind a kernel.

Numba's own cache looks at one file only, and would return old numbers after an edit in another.
"""

import contextlib
import functools
import hashlib
import io
import itertools
import os
import pathlib
import re
import shutil
import stat
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba

from refsim.backends.fast.private import names
from refsim.core.errors import InputError
from refsim.core.writing import in_turn

_REFSIM = pathlib.Path(__file__).parents[1]
_CACHES_KEPT = 200
_CACHE_NAME = re.compile("[0-9a-f]{16}")  # of the folders that `cache_folder` makes: it deletes no other
_IMPORT = re.compile(r"^(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([\w.]+))", re.MULTILINE)


def _package_of(path: pathlib.Path) -> pathlib.Path:
    """Top folder of the package that a source belongs to; the source's own folder if that is no package."""
    package = path.parent
    while (package.parent / "__init__.py").exists():
        package = package.parent
    return package


def sources_behind(path: pathlib.Path) -> list[pathlib.Path]:
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
def _groups_of(package: pathlib.Path) -> str:
    """Files and definitions of all parameter groups of a package.

    A kernel takes groups that it does not import. Its compiled code names their classes and reads members by number.
    """
    files = sorted(package.rglob("*.py")) if (package / "__init__.py").exists() else ()
    return "".join(
        f"{_place(file)} {group}" for file in files for group in _GROUP.findall(file.read_text(encoding="utf-8"))
    )


def _place(source: pathlib.Path) -> str:
    """Name of a source for the digest: within refsim, whose copies, in several environments say, share their kernels.

    Another package's folder counts, since it stands for what else the package imports.
    """
    return (source.relative_to(_REFSIM.parent) if source.is_relative_to(_REFSIM) else source).as_posix()


@functools.cache
def source_digest(path: pathlib.Path) -> str:
    """Digest of a kernel file, of the sources behind it (names and contents), and of its package's parameter groups."""
    digest = hashlib.sha256(f"{numba.__version__} {sys.version_info[:2]} {_groups_of(_package_of(path))}".encode())
    for source in sources_behind(path):
        digest.update(_place(source).encode())
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def cache_root() -> pathlib.Path:
    """Folder of all caches: $REFSIM_CACHE_DIR, else the user's cache folder."""
    chosen = os.environ.get("REFSIM_CACHE_DIR")
    if chosen:
        return pathlib.Path(chosen)
    import platformdirs  # where it is needed: it takes 20 ms

    return platformdirs.user_cache_path("refsim", appauthor=False)


def is_writable() -> bool:
    """Whether kernels can be kept for the next process: the folder of all caches is there, or can be made."""
    with contextlib.suppress(OSError):
        cache_root().mkdir(mode=0o700, parents=True, exist_ok=True)
    return os.access(cache_root(), os.W_OK)


@functools.cache
def cache_folder(path: pathlib.Path) -> str:
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
        refuse_foreign(root)
        refuse_foreign(folder)
    return str(folder)


def _folders(folder: pathlib.Path) -> list[pathlib.Path]:
    """A folder of the cache, that of all caches, and those that Numba has made inside."""
    return [folder.parent, folder, *(inside for inside in folder.iterdir() if inside.is_dir())]


def cached(dispatcher: Any, function: Callable) -> Any:
    """The dispatcher with refsim's cache."""
    if not hasattr(dispatcher, "enable_caching"):  # plain Python under NUMBA_DISABLE_JIT and in the simulator
        return dispatcher
    if names("cache") is None:
        return dispatcher
    path = pathlib.Path(function.__code__.co_filename)
    folder = str(path.parent) if path.parent.parent == cache_root() else cache_folder(path)  # a wrapper, or a source
    if not os.access(folder, os.W_OK) or any(map(is_shared, _folders(pathlib.Path(folder)))):
        return dispatcher
    before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, folder
    mask = os.umask(0o077)  # Numba makes a folder of its own inside
    try:
        dispatcher.enable_caching()
    finally:
        os.umask(mask)
        numba.config.CACHE_DIR = before
    refuse_foreign(pathlib.Path(dispatcher._cache.cache_path))
    check_files(dispatcher._cache)
    compile_here, lock = dispatcher.compile, pathlib.Path(folder, f"{function.__qualname__}.lock")

    def compile_or_load(signature: Any) -> Any:
        """Load the code, or compile and store it; of several processes one compiles, and the others load.

        Numba names what it saves by what stands in the cache already: two processes that save one kernel for two types
        at once take the same name, and one of them then loads what the other compiled.
        """
        with contextlib.nullcontext() if is_stored(dispatcher, signature) else in_turn(lock, stays=True):
            return compile_here(signature)

    dispatcher.compile = compile_or_load
    return dispatcher


# Files of the cache. Numba unpickles what it finds in its cache and runs it. Each file therefore ends with a SHA-256
# over its name and its content. A file that does not match is deleted and its kernel is compiled anew, with a warning
# once in a process. The digest detects damage; the check of the folder's owner and rights protects against other users.

DIGEST_BYTES = 32
_told: set[str] = set()  # kinds of warnings that this process has given


def refuse_foreign(folder: Path) -> None:
    """Raise InputError if another user owns a folder of the cache, or every user may write to it."""
    try:
        about = os.stat(folder)
    except OSError:
        return  # an absent folder holds no code
    if about.st_uid != os.geteuid():
        why = f"belongs to another user (number {about.st_uid})"
    elif about.st_mode & stat.S_IWOTH:
        why = "can be written to by every user"
    else:
        return
    raise InputError(
        f"the compile cache {folder} {why}, who could place code there that refsim would run; set REFSIM_CACHE_DIR to a"
        " folder that only you can write to, or correct the folder's owner and rights."
    )


def is_shared(folder: Path) -> bool:
    """Whether the group of a folder of the cache, but not every user, may write to it; a warning says so once."""
    try:
        mode = os.stat(folder).st_mode
    except OSError:
        return False
    shared = bool(mode & stat.S_IWGRP) and not mode & stat.S_IWOTH
    if shared:
        tell_once(
            "shared",
            f"the compile cache {folder} is not used, because its group can write to it and could place code there that"
            f" refsim would run; run `chmod g-w {folder}`, or set REFSIM_CACHE_DIR to a folder that only you can write"
            " to.",
        )
    return shared


def check_files(cache: Any) -> None:
    """Let Numba's `cache` of one kernel check what it reads, and go on without what it cannot write."""
    files = cache._cache_file
    files.__class__ = _checked_kind(files.__class__)
    save = cache.save_overload

    def save_if_possible(signature: Any, compiled: Any) -> None:
        try:
            save(signature, compiled)
        except OSError as error:
            tell_once(
                "unwritable",
                f"the compile cache {cache.cache_path} cannot be written ({error.strerror or error}); the next run"
                " compiles these kernels again.",
            )

    cache.save_overload = save_if_possible


def is_stored(dispatcher: Any, signature: Any) -> bool:
    """Whether the cache holds whole code of a kernel for a signature and this processor."""
    if names("cache") is None:
        return False
    cache = dispatcher._cache
    name = cache._cache_file._load_index().get(cache._index_key(signature, dispatcher.targetctx.codegen()))
    return name is not None and _is_whole(cache._cache_file._data_path(name))


class _Checked:
    """What differs from Numba's IndexDataCacheFile."""

    def save(self, key: Any, data: Any) -> None:
        """Store the code before the index names it, so that a kill between both leaves no index of other code."""
        index = self._load_index()
        taken = set(index.values())
        free = (name for name in map(self._data_name, itertools.count(1)) if name not in taken)
        name = index.get(key) or next(free)
        self._save_data(name, data)
        self._save_index({**index, key: name})

    def _load_index(self) -> dict[Any, str]:
        return super()._load_index() if _is_whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        if not _is_whole(path):
            raise FileNotFoundError(path)  # Numba then compiles
        return super()._load_data(name)

    @contextlib.contextmanager
    def _open_for_write(self, path: str) -> Iterator[io.BytesIO]:
        with super()._open_for_write(path) as file:
            content = io.BytesIO()
            yield content
            file.write(content.getvalue() + _digest(path, content.getvalue()))


@functools.cache
def _checked_kind(kind: type) -> type:
    """Numba's class for the files of a cache (the CPU's or CUDA's) with the checks."""
    return type(f"Checked{kind.__name__}", (_Checked, kind), {})


def _digest(path: str, content: bytes) -> bytes:
    return hashlib.sha256(os.path.basename(path).encode() + b"\0" + content).digest()


def _is_whole(path: str) -> bool:
    """Whether the file is there and matches its digest; a damaged one is deleted."""
    try:
        if stat.S_ISREG(os.stat(path).st_mode):
            content = Path(path).read_bytes()
            if _digest(path, content[:-DIGEST_BYTES]) == content[-DIGEST_BYTES:]:
                return True
    except FileNotFoundError:
        return False
    except OSError:
        pass  # an unreadable file is treated as damaged
    with contextlib.suppress(OSError):
        os.unlink(path)
    tell_once(
        "damaged", f"the compile cache was damaged ({path}); damaged files are deleted, their kernels compiled again."
    )
    return False


def tell_once(kind: str, sentence: str) -> None:
    """Warn once in a process of what is of this kind."""
    if kind not in _told:
        _told.add(kind)
        warnings.warn(sentence, stacklevel=2)
