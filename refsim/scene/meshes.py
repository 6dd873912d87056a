"""Reading triangle meshes from files."""

import contextlib
import functools
import io
import os
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from refsim.core.errors import InputError
from refsim.core.reading import LONGEST, open_regular

T = TypeVar("T")
READ = ("obj", "off", "ply", "stl")  # nothing in them is compressed: a few kB of others can unpack to all memory


def read_mesh(path: str | os.PathLike[str], what: str = "mesh") -> Any:
    """The mesh in a file as trimesh holds it, in numbers that are finite; `what` begins the messages.

    Raises InputError, in one sentence, for what cannot be read or holds no triangles.
    """
    import trimesh

    kind, name = Path(path).suffix[1:].lower(), f"{what}: {str(path)!r}"
    if kind not in READ:
        raise InputError(f"{name} is of no format that is read; give a mesh as .{', .'.join(READ)}.")
    options = {} if kind in ("stl", "off") else {"skip_materials": True}  # no texture has to be there
    try:
        with open_regular(path) as file:
            content = io.BytesIO(_plain(file.read(), kind, name))
        with _silent():
            read = trimesh.load(content, file_type=kind, force="mesh", process=False, **options)
        vertices, faces = np.array(read.vertices, dtype=float), np.array(read.faces, dtype=np.int64)
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError(f"{what}: there is no file {str(path)!r}; give the path of a mesh.") from None
    except Exception as error:  # trimesh raises whatever its readers do
        reason = getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{name} cannot be read ({reason}); give a mesh file.") from None
    check_triangles(vertices, faces, str(path), what)
    return read


def _plain(data: bytes, kind: str, name: str) -> bytes:
    """A mesh as its reader takes it: text in UTF-8, and of a binary STL the triangles that it counts."""
    if kind == "stl" and b"\0" in data[:134]:
        count = int.from_bytes(data[80:84], "little")
        if len(data) < 84 + 50 * count:
            held = max(0, len(data) - 84) // 50
            raise InputError(f"{name} is cut off: it counts {count} triangles and holds {held}; save it again.")
        return data[: 84 + 50 * count]
    head, mark, numbers = data.partition(b"end_header") if kind == "ply" else (data, b"", b"")
    if b"\0" in head:
        raise InputError(
            f"{name} cannot be read, because it is neither binary nor text of one byte a letter, as its suffix"
            " requires; save it again."
        )
    return head.decode("utf-8", "replace").encode() + mark + numbers


def while_unchanged(function: Callable[..., T]) -> Callable[..., T]:
    """The function of a mesh's file and more, whose last results are kept while that file is unchanged."""
    kept = functools.lru_cache(maxsize=8)(lambda written, *given: function(*given))

    def called(file: str, *given: Any) -> T:
        try:
            written = os.stat(file).st_mtime_ns
        except (OSError, ValueError):  # reading the mesh reports it
            written = 0
        return kept(written, file, *given)

    return functools.wraps(function)(called)


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Readers log tracebacks, print and warn about what they then raise, or about colours, which no method needs."""
    import logging

    log = logging.getLogger("trimesh")
    before, log.disabled = log.disabled, True
    try:
        with warnings.catch_warnings(), open(os.devnull, "w", encoding="utf-8") as nowhere:
            warnings.simplefilter("ignore")
            with contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
                yield
    finally:
        log.disabled = before


def check_triangles(vertices: np.ndarray, faces: np.ndarray, source: str, what: str = "mesh") -> None:
    """Raise InputError if vertices (n, 3) [m] and faces (m, 3) are no triangles with finite coordinates."""
    if vertices.ndim != 2 or faces.ndim != 2 or vertices.shape[1:] != (3,) or faces.shape[1:] != (3,) or not len(faces):
        raise InputError(f"{what}: {source!r} has no triangles; give a closed triangle mesh.")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{what}: {source!r} has faces with vertices that are not there; export it again.")
    if not (np.abs(vertices[np.unique(faces)]) <= LONGEST).all():
        raise InputError(f"{what}: {source!r} has vertices that are not finite or beyond {LONGEST:g} m; correct them.")
