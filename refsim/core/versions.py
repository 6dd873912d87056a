"""Which versions computed a result: for reports, checkpoints and `refsim doctor`."""

import functools
import platform
from pathlib import Path

VERSION = "0.2.0"
PACKAGES = ("numpy", "numba", "llvmlite", "numba-cuda", "cupy-cuda13x")


@functools.cache
def commit() -> str | None:
    """Git commit of the sources that run, or of those that a release was built from; None where neither is known."""
    import subprocess

    package = Path(__file__).resolve().parents[1]
    command = ("git", "-C", str(package), "rev-parse", "--show-toplevel", "HEAD")
    try:
        root, head = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True).stdout.splitlines()
        if Path(root).resolve() == package.parent:
            return head
    except (OSError, subprocess.SubprocessError, ValueError):
        pass
    written = package / "commit.txt"  # by `nox -s release`
    return written.read_text(encoding="utf-8").strip() if written.is_file() else None


def version() -> str:
    """The version and, where it is known, the commit: 0.2.0+g followed by ten digits (PEP 440, a local version)."""
    return VERSION if (revision := commit()) is None else f"{VERSION}+g{revision[:10]}"


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages that compute; nothing is imported for it."""
    import importlib.metadata  # here, because it takes a tenth of the time that importing refsim does

    numbers = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            numbers[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {"refsim": version()} | numbers
