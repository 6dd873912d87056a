"""Environments and nights: `nox -l` lists, `nox -s NAME` runs, `nox -s nightly` runs what takes longer than .ci/run.

A task of the night runs in the environment that nox itself runs in, and ends at its time limit with all processes that
it has started. `--report FILE` writes outcomes and durations; exit code 1 if a session failed.
"""

from __future__ import annotations

import configparser
import datetime
import os
import shutil
from pathlib import Path

import nox

CORES = str(min(4, os.cpu_count() or 1))
SEED = f"{datetime.date.today():%Y%m%d}"  # other attacks and checks every night
SLIPS = "tests/ladder/test_slips.py"
PYTHON, VALIDATION = ("python",), ("python", "-m", "validation")
PYTEST = (*PYTHON, "-m", "pytest", "-q")
NIGHT = {  # minutes, and the command
    "main_job": (10, (*PYTHON, "scripts/reproduce.py", "--quick")),
    "slow": (240, (*PYTEST, "-m", "slow", "--ignore", SLIPS)),
    "slips": (240, (*PYTEST, "-m", "slow", "-n", CORES, SLIPS)),
    "host_slips": (240, (*PYTHON, "tests/host_slips.py", "--count", "300", "--seed", SEED, "--jobs", CORES)),
    "writes": (60, (*PYTHON, "tests/commands/refused_writes.py", "--count", "2000", "--seed", SEED)),
    "laws": (130, (*VALIDATION, "laws", "--minutes", "110", "--seed", SEED)),
    "laws_cpu": (200, (*VALIDATION, "laws", "--backend", "cpu", "--minutes", "110", "--seed", SEED)),
    "attack": (75, (*VALIDATION, "attack", "--minutes", "60", "--seed", SEED)),
    "peers": (180, (*VALIDATION, "run", "boundary", "mpm_droplet", "timing", "--peers")),
    "plain": (90, ("env", "REFSIM_PLAIN=1", *PYTEST, "-m", "not gpu", "tests/ladder/test_pairing.py", "-k", "cpu")),
    "lessons": (30, (*PYTHON, "scripts/lessons.py", "--warm")),
    "checks": (960, (*VALIDATION, "check", "--jobs", CORES)),
    "verify": (40, (*VALIDATION, "verify", "--draw", "20")),
    "linkcheck": (20, (*PYTHON, "-m", "sphinx", "-q", "-b", "linkcheck", "docs", "build/linkcheck")),
}
TOOLS = ("pytest>=8", "pytest-xdist>=3.6", "pytest-benchmark>=4")  # configured in pyproject.toml
OF_TOOLS = (  # tests that need packages of the extra "test", beside OF_EXTRAS, or the repository
    "tests/across", "tests/io/test_output.py", "tests/isosurface", "tests/validation",
)  # fmt: skip
OF_EXTRAS = (
    "tests/contract/test_examples.py", "tests/contract/test_whole_runs.py", "tests/cluster", "tests/render",
    "tests/io/test_results.py", "tests/across/test_site.py",
)  # fmt: skip
EXAMPLES = ("cohesion", "dam_break_2d", "droplet", "melting", "mesh_boundary", "mpm_droplet", "water_drop")
BESIDE = ("tests", "validation", "scripts", "docs", "figures", "pyproject.toml", "setup.cfg", "README.md", ".gitignore")

PYTHONS = ("3.11", "3.12", "3.13", "3.14")  # the oldest is that of setup.cfg; the lowest NumPy is made for two of them

nox.options.sessions = ["nightly"]
nox.options.error_on_missing_interpreters = False


def task(name: str) -> None:
    """Make a session of a task of the night."""
    minutes, command = NIGHT[name]

    def run(session: nox.Session) -> None:
        session.run("timeout", "-k", "10", f"{minutes}m", *command, *session.posargs, external=True)

    run.__doc__ = " ".join(command)
    nox.session(run, name=name, venv_backend="none")


for _name in NIGHT:
    task(_name)


@nox.session(venv_backend="none")
def nightly(session: nox.Session) -> None:
    """Every task of the night, and the environments."""
    lowest_too = (f"lowest-{version}" for version in PYTHONS[:2])
    for name in (*NIGHT, *(f"environments-{version}" for version in PYTHONS), *lowest_too, "newest", "extras"):
        session.notify(name)


def settings() -> configparser.ConfigParser:
    """The content of setup.cfg."""
    read = configparser.ConfigParser(interpolation=None)
    read.read("setup.cfg", encoding="utf-8")
    return read


def installed(
    session: nox.Session, tests: tuple[str, ...], extras: str, *packages: str, newest: tuple[str, ...] = ()
) -> dict[str, str | None]:
    """Install the wheel with an extra, and test it from a copy of the repository without refsim/.

    newest  packages that are then replaced by their newest versions, whatever the wheel allows

    Returns the environment's variables.
    """
    folder = Path(session.create_tmp()).resolve()
    session.run("python", "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder), ".")
    (wheel,) = folder.glob("refsim-*.whl")
    session.install(f"{wheel}{extras}", *packages)
    if newest:
        session.install("--upgrade", "--no-deps", *newest)
    copy = folder / "without_package"
    shutil.rmtree(copy, ignore_errors=True)
    for name in BESIDE:
        if Path(name).is_dir():
            shutil.copytree(name, copy / name, ignore=shutil.ignore_patterns("__pycache__", "quick"))
        else:
            shutil.copy(name, copy / name)
    session.chdir(copy)
    around = {"REFSIM_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": None}
    session.run("python", "-m", "refsim", "doctor", env=around)
    session.run("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests, env=around)
    return around


def least(session: nox.Session, *versions: str) -> None:
    """Suite, lessons, examples and damaged meshes with the wheel and the packages alone that it requires."""
    left_out = (f"--ignore={path}" for path in (*OF_EXTRAS, *OF_TOOLS))
    older = ("-W", "ignore::DeprecationWarning") if versions else ()  # what they do is deprecated by newer ones
    around = installed(session, ("tests", *left_out, *older), "", *TOOLS, *versions)
    session.run("python", "scripts/lessons.py", env=around)
    made = str(Path(session.create_tmp()).resolve() / "examples")
    for name in EXAMPLES:
        session.run("python", "-m", "refsim", "example", name, "--output", made, "--overwrite", env=around)
        begin = ("-m", "refsim", "run", f"{made}/{name}.toml", "--output", f"{made}/{name}", "--overwrite", "--quiet")
        session.run("python", *begin, "--until", "1e-3", env=around)
    session.run("python", "tests/boundary/damaged_meshes.py", "--count", "5000", "--seed", SEED, env=around)


@nox.session(python=PYTHONS)
def environments(session: nox.Session) -> None:
    """What `least` does, with each Python and the newest versions."""
    least(session)


@nox.session(python=PYTHONS[:2])
def lowest(session: nox.Session) -> None:
    """What `least` does, with the lowest versions that setup.cfg allows."""
    lines = settings()["options"]["install_requires"].split()
    least(session, *(line.partition(",")[0].replace(">=", "==") for line in lines))


@nox.session(python=PYTHONS[-1])
def newest(session: nox.Session) -> None:
    """The wheel with the newest Numba, beyond the bound of setup.cfg, which is raised where this passes."""
    tests = (
        "tests/journeys", "tests/io/test_checkpoint.py", "tests/backends",
        "tests/ladder/test_pairing.py",
    )  # fmt: skip
    installed(session, tests, "", *TOOLS, newest=("numba", "llvmlite"))


@nox.session(python=PYTHONS[0])
def extras(session: nox.Session) -> None:
    """The wheel with every extra but that of a GPU, and Warp; the tests that need them, and the site."""
    names = [name for name in settings()["options.extras_require"] if name not in ("cuda", "dev")]
    installed(session, OF_EXTRAS, f"[{','.join(names)}]", "warp-lang")


@nox.session(python=PYTHONS[0])
def release(session: nox.Session) -> None:
    """All that a change must pass, the validators of the files about the project, and what a person publishes."""
    session.run("bash", ".ci/run", external=True)
    session.install("cffconvert>=2")
    session.run("cffconvert", "--validate")
    session.install("check-jsonschema>=0.29", "jsonschema>=4")
    workflows = (str(path) for path in Path(".github/workflows").glob("*.yml"))
    session.run("check-jsonschema", "--builtin-schema", "vendor.github-workflows", *workflows)
    session.install("-e", ".[docs]", "build")
    session.run("python", "scripts/release.py", *session.posargs)
