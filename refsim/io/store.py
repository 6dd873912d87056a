"""Results on file as JSON with a digest: one reader and one writer.

The file begins with `sha256`, the digest of its name and of all that follows. A file that does not match is renamed to
`NAME.damaged`, so that what it held is computed anew and can still be looked at.
"""

import contextlib
import hashlib
import json
import os
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from refsim.core.errors import InputError
from refsim.core.reading import open_regular
from refsim.core.writing import replace_file

OLD = 3600.0  # s after which nobody still writes a temporary file
HEAD = re.compile(rb'\{\n "sha256": "([0-9a-f]{64})",')


def _digest(name: str, body: bytes) -> str:
    return hashlib.sha256(name.encode() + b"\0" + body).hexdigest()


def stored_bytes(name: str, values: Mapping[str, Any]) -> bytes:
    """A file of this name: the values as JSON, below their digest."""
    body = json.dumps(values, indent=1)[1:].encode()
    return f'{{\n "sha256": "{_digest(name, body)}",'.encode() + body


def write_stored(path: Path, values: Mapping[str, Any]) -> None:
    """Write values, one at least, for `read_stored`; the file is whole at every instant. Raises OSError."""
    replace_file(path, stored_bytes(path.name, values), tidy=False)


def tidy(folder: Path) -> None:
    """Remove what killed writers of results left in a folder and those in it, once it is an hour old."""
    for file in (*folder.glob(".*.tmp"), *folder.glob("*/.*.tmp")):
        with contextlib.suppress(OSError):
            if file.stat().st_mtime < time.time() - OLD:
                file.unlink()


def read_stored(path: Path, notes: list[str] | None = None, whole: Path | None = None) -> dict[str, Any] | None:
    """What `write_stored` wrote; None where there is no file, or a damaged one, which is set aside.

    notes  is given a sentence about a damaged file
    whole  the result's folder, which is then set aside instead of the file alone

    Raises InputError where the file cannot be read.
    """
    try:
        with open_regular(path) as file:
            content = file.read()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(
            f"the result {path} cannot be read ({error.strerror or error}); move it away, or correct its permissions."
        ) from error
    head = HEAD.match(content)
    if head is not None and head[1].decode() == _digest(path.name, content[head.end() :]):
        stored: dict[str, Any] = json.loads(b"{" + content[head.end() :])
        return stored
    why = "has no digest at its beginning" if head is None else "does not match its digest"
    set_aside(whole or path, why, notes)
    return None


def set_aside(path: Path, why: str, notes: list[str] | None = None) -> None:
    """Rename a damaged result, a file or a folder; `notes` is given the sentence that says so."""
    aside = path.with_name(f"{path.name}.damaged")
    number = 1
    while aside.exists():
        number += 1
        aside = path.with_name(f"{path.name}.damaged{number}")
    try:
        os.replace(path, aside)
        where = f"it is kept as {aside.name}"
    except OSError as error:
        where = f"it cannot be renamed ({error.strerror or error})"
    if notes is not None:
        notes.append(f"the result {path} is damaged (it {why}): {where}, and computed anew")
