"""Install the wheel with each Python there is, and with the lowest versions of all dependencies, and test it.

Pythons are those on the path (python3.11 and newer) and those that pyenv has installed. With each, a new virtual
environment gets the wheel and its newest dependencies; with the oldest Python that setup.cfg allows, a further one gets
the lowest versions that it allows, and another one every extra, Warp and Taichi. In each, the paths of docs/journeys.md
and a small part of the tests run against the installed package, from a copy of the repository without refsim/; with the
extras, the tests that need them and the site. Prints a table; the output of each is kept. Exit code: 0 if all passed,
2 for bad input, 4 if one failed.
"""

from __future__ import annotations

import argparse
import configparser
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim.core.tables import table  # noqa: E402

LOWEST, EXTRAS = "lowest", "extras"
TOOLS = ("pytest>=8", "pytest-xdist>=3.6", "pytest-benchmark>=4")  # configured in pyproject.toml
TESTS = (
    "tests/journeys",
    "tests/smoothing",
    "tests/io/test_checkpoint.py",
    "tests/io/test_results.py",
    "tests/scene/test_checked.py",
)
OF_EXTRAS = ("warp-lang", "taichi")  # beside the package's own extras but `cuda`
TESTS_OF_EXTRAS = (
    "-m",
    "not gpu",
    "tests/contract/test_examples.py",
    "tests/contract/test_whole_runs.py",
    "tests/cluster",
    "tests/render",
    "tests/io/test_results.py",
    "tests/across/test_site.py",
)
COPIED = (
    "tests", "validation", "scripts", "docs", "figures", "pyproject.toml", "setup.cfg", ".gitignore", "README.md",
    "CONTRIBUTING.md", "CHANGELOG.md",
)  # fmt: skip


@dataclass(frozen=True)
class Environment:
    """A Python, by its interpreter, and its dependencies: the newest, the lowest allowed, or with all extras."""

    version: tuple[int, ...]
    interpreter: Path
    kind: str = ""

    @property
    def name(self) -> str:
        """Such as 3.12 or 3.11-lowest."""
        return ".".join(map(str, self.version[:2])) + (f"-{self.kind}" if self.kind else "")


def settings() -> configparser.ConfigParser:
    """The content of setup.cfg."""
    read = configparser.ConfigParser(interpolation=None)
    read.read(ROOT / "setup.cfg", encoding="utf-8")
    return read


def constraints() -> list[str]:
    """The lowest version of each dependency, as a constraint of pip."""
    lines = settings()["options"]["install_requires"].split("\n")
    return [line.replace(">=", "==") for line in lines if line]


def extras() -> str:
    """The names of all extras but `cuda`, as pip wants them."""
    return ",".join(name for name in settings()["options.extras_require"] if name != "cuda")


def oldest() -> tuple[int, ...]:
    """The oldest Python that setup.cfg allows."""
    return tuple(map(int, settings()["options"]["python_requires"].removeprefix(">=").split(".")))


def environments() -> list[Environment]:
    """One for each minor version of Python that is found, and for the oldest allowed one of each further kind."""
    folders = [Path(folder) for folder in os.environ.get("PATH", "").split(os.pathsep) if folder]
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    candidates = [path for folder in folders for path in sorted(folder.glob("python3.*"))]
    candidates += sorted(pyenv.glob("3.*/bin/python3.*"))
    found: dict[tuple[int, ...], Environment] = {}
    for path in candidates:
        if not re.fullmatch(r"python3\.\d+", path.name):
            continue
        version = tuple(map(int, path.name.removeprefix("python").split(".")))
        if version >= oldest() and version not in found and _works(path):
            found[version] = Environment(version, path)
    each = [found[version] for version in sorted(found)]
    first = [e for e in each if e.version == oldest()]
    return [*each, *(Environment(e.version, e.interpreter, kind) for e in first for kind in (LOWEST, EXTRAS))]


def _works(interpreter: Path) -> bool:
    """Whether the interpreter makes environments; shims of pyenv exist for versions that are not selected."""
    command = [str(interpreter), "-c", "import venv, ensurepip"]
    return subprocess.run(command, capture_output=True).returncode == 0


def tried(environment: Environment, wheel: Path, copy: Path, folder: Path, logs: Path) -> str:
    """Outcome of one environment; the output of its commands is in `logs`."""
    place, log = folder / environment.name, logs / f"{environment.name}.log"
    python = place / ("Scripts" if os.name == "nt" else "bin") / "python"
    limits: list[str] = []
    packages, tests = [str(wheel), *TOOLS], [*TESTS]
    if environment.kind == EXTRAS:
        packages, tests = [f"{wheel}[{extras()}]", *OF_EXTRAS], [*TESTS_OF_EXTRAS]
    if environment.kind == LOWEST:
        (folder / "constraints.txt").write_text("\n".join(constraints()) + "\n")
        limits = ["--constraint", str(folder / "constraints.txt")]
    steps = {
        "making the environment": [str(environment.interpreter), "-m", "venv", str(place)],
        "installing": [str(python), "-m", "pip", "install", "--quiet", *limits, *packages],
        "doctor": [str(python), "-m", "refsim", "doctor"],
        "tests": [str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests],
    }
    around = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    around |= {"REFSIM_CACHE_DIR": str(place / "cache"), "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    with log.open("w", encoding="utf-8") as output:
        for name, command in steps.items():
            output.write(f"== {name}\n")
            output.flush()
            done = subprocess.run(command, cwd=copy, env=around, stdout=output, stderr=subprocess.STDOUT)
            if done.returncode:
                return f"failed: {name}, exit code {done.returncode}"
    last = log.read_text(encoding="utf-8").rstrip().splitlines()[-1]
    return last.strip("= ")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help="such as 3.12 or 3.11-lowest; all by default"
    )
    parser.add_argument("--list", action="store_true", help="print the environments and make none")
    parser.add_argument("--logs", type=Path, default=ROOT / "results" / "environments", help="folder of the outputs")
    given = parser.parse_args(arguments)
    known = {environment.name: environment for environment in environments()}
    unknown = [name for name in given.only if name not in known]
    if unknown or not known:
        what = f"There is no environment {unknown[0]!r}" if unknown else "There is no Python that refsim supports"
        print(f"{what}; found: {', '.join(known) or 'none'}.", file=sys.stderr)
        return 2
    if given.list:
        print(table([(name, str(environment.interpreter)) for name, environment in known.items()]))
        return 0
    given.logs.mkdir(parents=True, exist_ok=True)
    rows = []
    with tempfile.TemporaryDirectory(prefix="refsim_environments_") as made:
        folder = Path(made)
        wheel, copy = prepared(folder)
        for name in given.only or known:
            print(f"{name} ...", flush=True)
            began = time.monotonic()
            outcome = tried(known[name], wheel, copy, folder, given.logs.resolve())
            rows.append((name, outcome, f"{time.monotonic() - began:.0f} s"))
            shutil.rmtree(folder / name, ignore_errors=True)
    print(f"\n{table(rows)}\n\nOutput of each: {given.logs}")
    return 4 if any(outcome.startswith("failed") for _, outcome, _ in rows) else 0


def prepared(folder: Path) -> tuple[Path, Path]:
    """The wheel of this repository, and a copy of the repository without the package."""
    ignored = shutil.ignore_patterns("__pycache__", ".git", "*.egg-info", "build", "dist", "results", "quick")
    shutil.copytree(ROOT, folder / "sources", ignore=ignored)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder)]
    subprocess.run([*command, str(folder / "sources")], check=True)
    (wheel,) = folder.glob("refsim-*.whl")
    copy = folder / "without_package"
    copy.mkdir()
    for name in COPIED:
        (folder / "sources" / name).rename(copy / name)
    return wheel, copy


if __name__ == "__main__":
    sys.exit(main())
