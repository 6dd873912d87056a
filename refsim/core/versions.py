"""Which versions computed a result: for reports, checkpoints and `refsim doctor`."""

import functools
import platform

VERSION = "0.2.0"
PACKAGES = ("numpy", "numba", "llvmlite", "numba-cuda", "cupy-cuda13x")


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages that compute; nothing is imported for it."""
    import importlib.metadata  # here, because it takes a tenth of the time that importing refsim does

    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return {"refsim": VERSION} | found
