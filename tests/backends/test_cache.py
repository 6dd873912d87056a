"""The compile cache: used again where nothing changed, and never after an edit, in whatever file it was made."""

import os
import pathlib
import shutil

import pytest

from refsim.backends import cache
from refsim.commands import doctor
from refsim.core.errors import InputError
from tests.backends.launched import launch
from tests.running import python

FILES = {
    "__init__.py": "",
    "numbers.py": "FACTOR = 2.0\n",
    "formulas.py": """from refsim.backends.compile import formula
from tiny.numbers import FACTOR


@formula
def scaled(x):
    return x * type(x)(FACTOR)
""",
    "particle.py": """from refsim.backends.compile import formula
from tiny import formulas


@formula
def twice(x):
    return formulas.scaled(x) + formulas.scaled(x)
""",
    "late.py": """import os, time
replace = os.replace
def late(draft, path):  # before the code gets its name
    if "DIES" in os.environ:
        os._exit(9)
    time.sleep(float(os.environ["LATE"]))
    replace(draft, path)
os.replace = late
""",
    "cpu.py": """from refsim.backends.compile import cpu_kernel
from tiny import late, particle


@cpu_kernel
def kernel(values):
    for i in range(values.shape[0]):
        values[i] = particle.twice(values[i])
""",
    "other.py": "UNRELATED = 1\n",
}
PROGRAM = """
import os, pathlib
import numpy as np
from tiny.cpu import kernel
def compiled():
    return len(list(pathlib.Path(os.environ["REFSIM_CACHE_DIR"]).glob("*/*.nbc")))
before = compiled()
values = np.ones(3, os.environ["KIND"])
kernel(values)
print(values[0], compiled() - before, sum(kernel.stats.cache_hits.values()))
"""
SUMS = """
import hashlib, sys
from refsim import contract
from refsim.core.operation import REGISTRY
name, output = sys.argv[1:]
program = REGISTRY[name].program("cpu")
values = contract.bindings(name, "cpu", "float64", "cloud_3d", lists="all_pairs")
program(*values.values())
print(hashlib.sha256(values[output].tobytes()).hexdigest(), sum(program.stats.cache_hits.values()))
"""


@pytest.fixture
def tiny(tmp_path):
    package = tmp_path / "tiny"
    package.mkdir()
    for name, text in FILES.items():
        (package / name).write_text(text)
    return package


def started(package, kind="float32", late="0"):
    """A process of its own that runs the kernel on numbers of a kind, and is late by some seconds in saving it."""
    return launched(package, PROGRAM, KIND=kind, LATE=late)


def launched(package, program, **variables):
    return launch(package.parent, program, **variables)


def ended(process):
    """(result, kernels compiled, cache hits) of the kernel in a process."""
    code, words, err = process.ended()
    assert code == 0, err
    return tuple(map(float, words.split()))


def run(package):
    return ended(started(package))


def edit(package, name, old, new):
    path = package / name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))


def test_edits_behind_a_kernel_are_seen_and_others_cost_nothing(tiny):
    assert (run(tiny), run(tiny)) == ((4, 1, 0), (4, 0, 1))
    edit(tiny, "other.py", "1", "2")  # a file that the kernel has nothing to do with
    assert run(tiny) == (4, 0, 1)
    edit(tiny, "formulas.py", "x * type(x)(FACTOR)", "x - type(x)(FACTOR)")  # called through a second file
    assert run(tiny) == (-2, 1, 0)
    edit(tiny, "numbers.py", "2.0", "3.0")  # a constant in a third
    assert run(tiny) == (-4, 1, 0)


GROUP = """from typing import NamedTuple


class Line(NamedTuple):
    slope: float
    height: float
"""
ON_GROUP = """from refsim.backends.compile import cpu_kernel


@cpu_kernel
def kernel(line, values):
    for i in range(values.shape[0]):
        values[i] = line.slope * values[i] + line.height
"""
WITH_GROUP = """
import numpy as np, tiny
from tiny.cpu import kernel
group = next(v for v in vars(tiny).values() if hasattr(v, "_fields"))
values = np.ones(3)
kernel(group(slope=5.0, height=1.0), values)
kernel(group(slope=5.0, height=1.0), values)
print(values[0], sum(kernel.stats.cache_hits.values()))
"""


def test_edits_of_a_parameter_group_are_seen_by_kernels_that_take_it_without_importing_it(tiny):
    """Old code would read members by their old numbers, and the old cache names a class that is gone."""
    (tiny / "__init__.py").write_text(GROUP)
    (tiny / "cpu.py").write_text(ON_GROUP)
    assert told(tiny, WITH_GROUP) == (0, "31.0 0\n", "")
    edit(tiny, "__init__.py", "slope: float\n    height: float", "height: float\n    slope: float")
    assert told(tiny, WITH_GROUP) == (0, "31.0 0\n", "")
    edit(tiny, "__init__.py", "class Line", "class Straight")
    assert told(tiny, WITH_GROUP) == (0, "31.0 0\n", "")
    (tiny / "turned.py").write_text(GROUP.replace("Line", "Straight"))  # Numba's names of types are those of the other
    for program in (WITH_GROUP, WITH_GROUP.replace("np, tiny", "np, tiny.turned as tiny")):
        assert told(tiny, program) == (0, "31.0 0\n", "")


def test_processes_that_compile_one_kernel_at_once_do_not_disturb_each_other(tiny):
    at_once = [started(tiny, "float32", late="1.2"), started(tiny, "float32"), started(tiny, "float64", late="0.6")]
    assert [ended(p)[0] for p in at_once] == [4, 4, 4]
    assert [ended(started(tiny, kind)) for kind in ("float32", "float64")] == [(4, 0, 1), (4, 0, 1)]


def test_copies_of_refsim_share_their_kernels(tmp_path, monkeypatch):
    """Copies of another package do not, since what else they import may differ; its kernels hold refsim's code."""
    copy, other, here = tmp_path / "refsim", tmp_path / "other.py", cache._REFSIM / "sph" / "kernels.py"
    there = shutil.copytree(cache._REFSIM, copy, ignore=shutil.ignore_patterns("__pycache__")) / "sph" / "kernels.py"
    assert cache.source_digest.__wrapped__(there) != cache.source_digest(here)
    monkeypatch.setattr(cache, "_REFSIM", copy)
    cache._groups_of.cache_clear()
    assert cache.source_digest.__wrapped__(there) == cache.source_digest(here)
    assert cache._CACHE_NAME.fullmatch(cache.source_digest(here)), "folders that are cleared away"
    other.write_text("from refsim.backends.compile import kernel\n")
    before = cache.source_digest.__wrapped__(other)
    edit(copy, "backends/fast/rows.py", "PARTS = 16", "PARTS = 32")
    assert cache.source_digest.__wrapped__(other) != before


def test_the_process_that_compiles_computes_the_same_bits(tmp_path):
    """Sums may be taken in any order, but in the same one before and after a resume; of a long formula."""
    name, output = "surface_energy.mls_normals", "sample_normal"
    (first, compiled), (second, loaded) = (
        python("-c", SUMS, name, output, REFSIM_CACHE_DIR=str(tmp_path)).stdout.split() for _ in range(2)
    )
    assert ((compiled, loaded), first) == (("0", "1"), second)


# Damage
def told(package, program=PROGRAM, kind="float32", **variables):
    """(exit code, standard output, standard error) of a process of its own that runs the kernel."""
    return launched(package, program, KIND=kind, LATE="0", **variables).ended()


def cached(package):
    (found,) = (package.parent / "cache").glob("*/*.nbc")
    return found


def flipped(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


DAMAGE = lambda content: content[: len(content) // 2], flipped


def test_a_damaged_cache_is_dropped_and_compiled_anew(tiny):
    assert run(tiny) == (4, 1, 0)
    for damage in DAMAGE:
        path = cached(tiny)
        path.write_bytes(damage(path.read_bytes()))
        code, out, err = told(tiny)
        assert (code, out.split()[0], out.split()[2]) == (0, "4.0", "0"), err
        assert err.count("UserWarning") == 1
        assert f"the compile cache was damaged ({path}" in err
        assert told(tiny) == (0, "4.0 0 1\n", "")


def test_a_kill_while_code_is_written_costs_that_code_alone(tiny):
    assert (told(tiny, DIES="1")[0], run(tiny), run(tiny)) == (9, (4, 1, 0), (4, 0, 1))


def test_a_full_disk_costs_the_cache_and_not_the_run(tiny):
    resource = pytest.importorskip("resource")
    limited = f"import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (1000, {resource.RLIM_INFINITY}))\n"
    code, out, err = told(tiny, limited + PROGRAM)
    assert ((code, out), err.count("UserWarning")) == ((0, "4.0 0 0\n"), 1)
    assert "cannot be written (File too large); the next run compiles these kernels again." in err


@pytest.mark.parametrize("mode, code, words", [
    (0o777, 1, "InputError: the compile cache {} can be written to"),
    (0o770, 0, "the compile cache {} is not used, because its group can write to it"),
])  # fmt: skip
def test_a_cache_that_others_can_write_to_is_refused_and_a_groups_is_not_used(tiny, mode, code, words):
    assert run(tiny) == (4, 1, 0)
    for folder in (tiny.parent / "cache", cached(tiny).parent):
        folder.chmod(mode)
        found, out, err = told(tiny)
        assert (found, out) == (code, "" if code else "4.0 0 0\n")
        assert words.format(folder) in err
        assert "REFSIM_CACHE_DIR" in err
        assert err.count("UserWarning") == 1 - code
        folder.chmod(0o700)
    assert run(tiny) == (4, 0, 1)


def test_a_cache_of_another_user_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: os.stat(tmp_path).st_uid + 1)
    with pytest.raises(InputError, match="belongs to another user"):
        cache.is_own(tmp_path)


def test_only_folders_of_the_cache_are_cleared_away(tmp_path, monkeypatch):
    monkeypatch.setenv("REFSIM_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(cache, "_CACHES_KEPT", 1)
    old, own = tmp_path / "0123456789abcdef", tmp_path / "photographs"
    for age, folder in enumerate((old, own)):
        folder.mkdir()
        os.utime(folder, (age, age))
    (source := tmp_path / "kernel.py").write_text("")
    made = cache.cache_folder(source)
    assert sorted(p.name for p in tmp_path.iterdir() if p.is_dir()) == sorted([pathlib.Path(made).name, "photographs"])


@pytest.mark.parametrize("inside", ["caches", "a_file"])
def test_a_cache_that_cannot_be_made_is_known(tmp_path, monkeypatch, inside):
    (tmp_path / "a_file").write_text("")
    monkeypatch.setenv("REFSIM_CACHE_DIR", str(tmp_path / inside / "refsim"))
    assert cache.is_writable() == (inside == "caches")
    assert doctor._cache()["writable"] == (inside == "caches")
