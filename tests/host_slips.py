"""Slips in host code: which of a sample, drawn by a seed, does no test notice?

First the suite runs once under a profile that says which tests call which function. Then each slip, another sign,
number, condition or name in one function, is put in by giving the function the code of its altered source, in a process
of its own; there the tests that call the function run, quick ones first, until one fails that passes without the slip.
Slips that change no answer stand in `harmless_host.toml` with reasons. Prints each slip with its outcome; exit code 4
if no test noticed one.
"""

import argparse
import ast
import contextlib
import datetime
import importlib
import inspect
import json
import multiprocessing.pool
import os
import pathlib
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import types
from collections.abc import Iterator
from typing import Any

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "ladder")]
from slips import altered, code_of, parsed, sites  # noqa: E402

PACKAGES = ("engine", "gauges", "motion", "scene", "study", "boundary", "contract")
HARMLESS = tomllib.loads(pathlib.Path(__file__).with_name("harmless_host.toml").read_text(encoding="utf-8"))
CALLS = "REFSIM_CALLS_FOLDER"
CALLED: set[str] = set()  # by the test that runs
STYLE = ("alpha", "dpi", "figsize", "fontsize", "indent", "lw", "ms")  # of pictures and files, which say the same
MEMORY = 6 << 30  # bytes that a slip may make a test take
MOST_TESTS = 400  # that a slip is tried with
ALARM = -signal.SIGALRM  # exit code of a process that its alarm ended
COMPILED = ("formulas", "kernels", "reference", "cases", "operations")  # judged by the contract, or its own inputs


def functions(package: str) -> Iterator[types.FunctionType]:
    """The functions and methods of a package's host code, each once."""
    found: set[types.CodeType] = set()
    for path in sorted((ROOT / "refsim" / package).rglob("*.py")):
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        if path.stem.startswith(COMPILED) or path.stem.endswith("_cuda"):
            continue
        module = importlib.import_module(name.removesuffix(".__init__"))
        for owner in (module, *(v for v in vars(module).values() if inspect.isclass(v))):
            for value in vars(owner).values():
                value = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
                value = inspect.unwrap(value) if callable(value) else value
                own = isinstance(value, types.FunctionType) and value.__code__.co_filename == str(path)
                if own and value.__code__ not in found:
                    found.add(value.__code__)
                    yield value


def place(function: types.FunctionType) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def changes(function: types.FunctionType) -> list[tuple[int, Any]]:
    """(node, change) of every place of a function where something can slip."""
    tree = parsed(function)
    definition = tree.body[0]
    if not isinstance(definition, ast.FunctionDef) or function.__closure__:
        return []
    words = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in ast.walk(node)}
    outside = {id(part) for node in (*definition.decorator_list, definition.args) for part in ast.walk(node)}
    nodes = list(ast.walk(tree))
    given = [part for node in nodes if isinstance(node, ast.Call) and ast.unparse(node.func).endswith(".reshape")
             for argument in node.args for part in ast.walk(argument)]  # fmt: skip
    alike = {id(part.operand) for part in given if isinstance(part, ast.UnaryOp)}  # -2 is as good as -1 there
    alike |= {id(part) for n in nodes if isinstance(n, ast.keyword) and n.arg in STYLE for part in ast.walk(n.value)}
    alike |= {id(n) for n in nodes if isinstance(n, ast.Assign) and ast.unparse(n.value) in ("True", "False")}
    return [(n, change) for n, change in sites(tree) if id(nodes[n]) not in words | outside | alike]


def pytest_configure() -> None:
    """As a plugin of a worker of pytest: the packages' functions note that they were called."""
    if "PYTEST_XDIST_WORKER" not in os.environ or CALLS not in os.environ:
        return
    for function in [f for package in PACKAGES for f in functions(package) if changes(f)]:
        with contextlib.suppress(NameError):  # in an annotation
            function.__code__ = noting(function)


def noting(function: types.FunctionType) -> types.CodeType:
    """Code of the function that notes that it was called."""
    tree = parsed(function)
    tree.body[0].body[:0] = ast.parse(f"__import__('host_slips').CALLED.add({place(function)!r})").body
    return code_of(function, tree)


def pytest_runtest_protocol(item: Any) -> None:
    CALLED.clear()
    item.began = time.process_time()


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Iterator[Any]:
    """What a fixture calls is called by each test that takes it."""
    before = CALLED.copy()
    CALLED.clear()
    try:
        return (yield)
    finally:
        fixturedef.called = CALLED.copy()
        CALLED.update(before)


def pytest_runtest_makereport(item: Any, call: Any) -> None:
    """Write which functions a test has called that passed, and its seconds."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker and call.when == "call" and call.excinfo is None:
        for fixtures in item._fixtureinfo.name2fixturedefs.values():
            CALLED.update(getattr(fixtures[-1], "called", ()))
        row = {"test": item.nodeid, "seconds": time.process_time() - item.began, "calls": sorted(CALLED)}
        with pathlib.Path(os.environ[CALLS], f"{worker}.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def callers(jobs: int) -> dict[str, list[tuple[float, str]]]:
    """Tests that call each function, quick ones first."""
    found: dict[str, list[tuple[float, str]]] = {}
    with tempfile.TemporaryDirectory() as into:
        path = os.pathsep.join(filter(None, (str(ROOT / "tests"), os.environ.get("PYTHONPATH"))))
        environment = {CALLS: into, "PYTHONPATH": path}
        command = [sys.executable, "-m", "pytest", "-q", "-n", str(jobs), "-p", "host_slips", "--tb=line", "tests"]
        done = subprocess.run(command, cwd=ROOT, env=os.environ | environment, capture_output=True, text=True)
        print(*done.stdout.splitlines()[-12:], sep="\n", flush=True)
        for file in pathlib.Path(into).iterdir():
            for row in map(json.loads, file.read_text(encoding="utf-8").splitlines()):
                for name in row["calls"]:
                    found.setdefault(name, []).append((row["seconds"], row["test"]))
    return {name: sorted(rows) for name, rows in found.items()}


class Chosen:
    """A plugin of pytest that runs tests in the order given, and tells which one begins."""

    def __init__(self, tests: list[str]) -> None:
        self.place = {test: k for k, test in enumerate(tests)}
        self.file = os.fdopen(os.dup(1), "w", encoding="utf-8")

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = sorted((i for i in items if i.nodeid in self.place), key=lambda i: self.place[i.nodeid])

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        print(nodeid, file=self.file, flush=True)


def one(module: str, name: str, number: int | None, tests: list[str], seconds: float) -> int:
    """Print the slip, none for number None, and each test that begins in this process, which an alarm may end.

    Returns the exit code of pytest.
    """
    same = (f for f in functions(module.split(".")[1]) if (f.__module__, f.__qualname__) == (module, name))
    slip, function = f"{module}.{name}: ", next(same)
    if number is not None:
        code, line = altered(function, *changes(function)[number])
        slip, function.__code__ = slip + line, code
    print(slip, flush=True)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.alarm(int(seconds))  # whose default is the end of the process
    chosen, files = Chosen(tests), {test.partition("::")[0]: None for test in tests}
    options = ["-q", "-x", "-n", "0", "-p", "no:cacheprovider", "--tb=no"]
    options.append("--assert=plain")  # else pytest warns of refsim, a plugin that was imported before
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere), contextlib.redirect_stderr(nowhere):
        return int(pytest.main([*options, *filter(os.path.exists, files)], [chosen]))


def tried(job: dict[str, Any]) -> tuple[str, str]:
    """(the slip in words, its outcome): `one` in a process of its own, and what fails once more without the slip."""
    words, tests, unjudged = f"{job['module']}.{job['name']} number {job['number']}", job["tests"], ""
    while tests:
        words, last, code = asked(job | {"tests": tests})
        if code == 0:
            return words, "survived"
        if not words:
            return f"{job['module']}.{job['name']}: {last}", "no slip"  # one that Python cannot compile
        again = [last] if last and code != ALARM else tests  # all of them may be too slow, without the slip as well
        without = asked(job | {"tests": again, "number": None})[2]
        if without in (0, ALARM):
            found = "noticed" if without == 0 else "not judged in time"
            return f"{words}   [{last or 'collection'}]", found
        tests, unjudged = [test for test in tests if last and test != last], "fails without the slip, too"
    return words, unjudged or "called by no test"


def asked(job: dict[str, Any]) -> tuple[str, str, int]:
    """(slip in words, last test that began, exit code) of `one` in a process of its own."""
    command = [sys.executable, __file__, "--one"]
    done = subprocess.run(command, input=json.dumps(job), capture_output=True, text=True, cwd=ROOT)
    words, *begun = done.stdout.splitlines() or [""]
    return words, begun[-1] if begun else "" if words else done.stderr.strip()[-200:], done.returncode


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=int(f"{datetime.date.today():%Y%m%d}"))
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seconds", type=float, default=120.0, help="after which the tests of a slip end")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        return one(**json.load(sys.stdin))
    code = {f.__code__: f for package in PACKAGES for f in functions(package)}
    places = [(f, number) for f in code.values() for number in range(len(changes(f)))]
    drawn = random.Random(given.seed).sample(places, min(given.count, len(places)))
    called = callers(given.jobs)
    jobs = [
        {
            "module": f.__module__, "name": f.__qualname__, "number": number, "seconds": given.seconds,
            "tests": quick(called.get(place(f), []), given.seconds, f"tests/{f.__module__.split('.')[1]}/"),
        }
        for f, number in drawn
    ]  # fmt: skip
    found: dict[str, list[str]] = {}
    with multiprocessing.pool.ThreadPool(given.jobs) as pool:
        for words, outcome in pool.imap_unordered(tried, jobs):
            known = next((why for slip, why in HARMLESS.items() if words.startswith(slip)), None)
            outcome = "harmless" if outcome == "survived" and known else outcome
            print(f"{outcome}: {words}", flush=True)
            found.setdefault(outcome, []).append(words)
    counts = (f"{len(rows)} {outcome}," for outcome, rows in found.items())
    print(f"{len(jobs)} slips of {len(places)} places, seed {given.seed}:", *counts)
    return 0 if set(found) <= {"noticed", "harmless", "no slip"} else 4


def quick(tests: list[tuple[float, str]], seconds: float, first: str = "") -> list[str]:
    """Tests, of the folder `first` before others and quick ones first, until half of their time is gone."""
    total, chosen = 0.0, []
    for each, test in sorted(tests, key=lambda row: (not row[1].startswith(first), *row)):
        total += each
        if (total > seconds / 2 and chosen) or len(chosen) == MOST_TESTS:
            break
        chosen.append(test)
    return chosen


if __name__ == "__main__":
    sys.exit(main())
