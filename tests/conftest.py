"""How many processes share the tests, and the wheel that several of them install."""

import gc
import importlib.metadata
import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys
import zipfile

import pytest
from filelock import FileLock

ROOT = pathlib.Path(__file__).parents[1]
MOST = 4
CYCLES = (100_000, 50, 100)  # thresholds of `gc`
ENVIRONMENT = {  # of all test processes, and of those that they start
    "OPENBLAS_NUM_THREADS": "1",  # the tests fill the cores already
    "MALLOC_MMAP_THRESHOLD_": str(2**25), "MALLOC_TRIM_THRESHOLD_": str(2**28),  # keep freed pages for the next array
}  # fmt: skip
os.environ.update({name: value for name, value in ENVIRONMENT.items() if name not in os.environ})
SOURCES = ("setup.cfg", "pyproject.toml", "MANIFEST.in", "LICENSE", "docs/package.md")
BUILD = "from setuptools import setup; setup(script_args=['-q', 'build', '--build-lib', 'unpacking', 'egg_info'])"


def pytest_xdist_auto_num_workers(config):
    """One more than cores, since some tests wait, at most four; what is named on the command line runs in this one."""
    named = config.option.keyword or any("::" in path or path.endswith(".py") for path in config.args)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return 0 if named or cores == 1 else min(MOST, cores + 1)


def pytest_configure():
    """Have Python look for cycles more rarely: Numba makes many objects while it compiles, and pytest holds many."""
    gc.set_threshold(*CYCLES)
    compare_flags_quickly()
    if os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0"):
        from tests import simulator_threads

        simulator_threads.install()


def compare_flags_quickly():
    """Numba looks up a kernel's flags among those of each function that it has typed, by dictionaries of all flags.

    All flags have one hash there, and comparing takes a tenth of the time of compiling. What was set tells them apart.
    """
    from numba.core.targetconfig import TargetConfig

    of_all = TargetConfig.__eq__

    def equal(self, other):
        return (type(self) is type(other) and self._values == other._values) or of_all(self, other)

    def hashed(self):
        return hash(frozenset(name for name, value in self._values.items() if value != self.options[name].default))

    TargetConfig.__eq__, TargetConfig.__hash__ = equal, hashed


def pytest_sessionfinish():
    """Look for cycles once; pytest then looks ten times more, which takes long with all that Numba and pytest hold."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def recorded(request):
    """What the test's numbers were: `tests.recorded.Recorded`."""
    from tests.recorded import Recorded

    return Recorded(pathlib.Path(request.node.path).stem.removeprefix("test_"), request.node.name)


@pytest.fixture
def coarse_pictures(monkeypatch):
    """Experiments draw few dots, for tests that look at the data and the names of their pictures."""
    from validation import drawing

    monkeypatch.setattr(drawing, "DOTS_PER_INCH", 40)


def python(words, folder):
    subprocess.run([sys.executable, *words], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def makes_wheels():
    version = tuple(map(int, importlib.metadata.version("setuptools").split(".")[:2]))
    return importlib.util.find_spec("wheel") is not None or version >= (70, 1)


@pytest.fixture(scope="session")
def unpacked(tmp_path_factory):
    """The wheel of a copy of the sources, unpacked, one for all test processes; see `unpack`."""
    folder = tmp_path_factory.getbasetemp()
    shared = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    with FileLock(shared / "clone.lock"):
        copy = shared / "clone"
        if not (copy / "unpacked").exists():
            shutil.rmtree(copy, ignore_errors=True)  # of a process that failed
            unpack(copy)
    return copy / "unpacked"


def unpack(copy):
    """Copy the sources and unpack their wheel there; setuptools before 70.1 only lays out what it would hold."""
    (copy / "docs").mkdir(parents=True)
    for name in SOURCES:
        shutil.copy(ROOT / name, copy / name)
    for folder in ("refsim", "validation", "tests", "scripts"):
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    if makes_wheels():
        options = ("--no-deps", "--no-build-isolation", "--no-index", "--no-cache-dir", "--quiet")
        python(("-m", "pip", "wheel", *options, "--wheel-dir", "dist", "."), copy)
        (wheel,) = (copy / "dist").glob("refsim-*.whl")
        zipfile.ZipFile(wheel).extractall(copy / "unpacking")
    else:
        python(("-c", BUILD), copy)
        shutil.move(copy / "refsim.egg-info", copy / "unpacking")
    (copy / "unpacking").rename(copy / "unpacked")


@pytest.fixture
def disk():
    """A disk whose `space` and `error` a test sets: see `refused_writes.Disk`."""
    from tests.commands.refused_writes import Disk

    made = Disk()
    made.begin()
    with made.watching():
        yield made
