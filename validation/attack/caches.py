"""A damaged compile cache: the answer must stay right, and a warning must name the damage.

Each process compiles one small kernel of its own; a trial damages a copy of its cache, then loads and runs the kernel.
"""

from __future__ import annotations

import functools
import importlib
import os
import random
import shutil
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

from validation.attack.checkpoints import HOW, damage, drawn_damage

KERNEL = """from refsim.backends.compile import cpu_kernel


@cpu_kernel
def kernel(values):
    for i in range(values.shape[0]):
        values[i] = values[i] * 3 + 1
"""


def make(seed: int, number: int) -> dict[str, Any]:
    """Index or code, and a damage."""
    draw = random.Random(f"caches {seed} {number}")
    one = drawn_damage(draw, ("bit", *HOW))
    return {"file": draw.choice(("nbi", "nbc")), "damages": [one]}


def perform(trial: dict[str, Any], folder: Path) -> tuple[str, str]:
    """Damage the cache and run the kernel twice; the second time there is nothing left to say."""
    package, pristine = _compiled()
    root = package.parent / "cache"
    shutil.rmtree(root)
    shutil.copytree(pristine, root)
    (path,) = root.glob(f"*/*/*.{trial['file']}")
    before = path.read_bytes()
    damage(path, trial["damages"])
    changed = not path.is_file() or path.read_bytes() != before
    there = path.exists()
    value, said = _answer(package)
    if value != 4:
        return "lost", f"the kernel computed {value}, and not 4"
    if changed and there and not said:
        return "silent", "no message names the damage"
    value, again = _answer(package)
    if value != 4 or (again and path.is_file()):
        return "lost", f"the renewed cache gave {value} and said {again}"
    return "0", said


def _answer(package: Path) -> tuple[float, str]:
    """(what the kernel computes from 1, the warnings)."""
    import numpy as np

    from refsim.backends import cache, cache_files

    cache_files._told.clear()
    cache.cache_folder.cache_clear()
    chosen = os.environ.get("REFSIM_CACHE_DIR")
    os.environ["REFSIM_CACHE_DIR"] = str(package.parent / "cache")
    name = f"{package.name}.cpu"
    sys.modules.pop(name, None)
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            values = np.ones(3)
            importlib.import_module(name).kernel(values)
    finally:
        os.environ.pop("REFSIM_CACHE_DIR")
        if chosen is not None:
            os.environ["REFSIM_CACHE_DIR"] = chosen
        cache.cache_folder.cache_clear()
    return float(values[0]), " ".join(str(w.message) for w in said)


@functools.cache
def _compiled() -> tuple[Path, Path]:
    """(package with one kernel, its whole cache); once a process."""
    folder = Path(tempfile.mkdtemp(prefix="refsim-attack-"))
    package = folder / f"attacked_{os.getpid()}"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "cpu.py").write_text(KERNEL)
    sys.path.insert(0, str(folder))
    value, said = _answer(package)
    if value != 4 or said:
        raise RuntimeError(f"the kernel computed {value} and said {said}")
    shutil.copytree(folder / "cache", folder / "pristine")
    return package, folder / "pristine"
