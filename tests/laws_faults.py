"""Planted faults: which of a lot, drawn by a seed, do the laws of `validation/laws` find?

Half of the lot are slips in kernels, half in host code of the packages that a scene runs, drawn as by `slips.py` and
`host_slips.py`, without those that are known to change no answer. One stream of scenes, which knows no fault, gives
laws and effects their turns; kernels run as Python. Each scene runs without a fault first, and tells which functions it
calls. If its law holds, it runs with each fault of these functions, each time in a process of its own, until the law
breaks or the scene does not end. So each fault is given the whole stream: so many minutes of one core. With `--mends`
the faults are mends of a file, each taken back in the NumPy reference, and no scene compares backends. Prints each
fault with the scene that finds it, as small as it could be made.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import inspect
import itertools
import multiprocessing.connection
import os
import pathlib
import pkgutil
import random
import resource
import signal
import sys
import textwrap
import time
import tomllib
import types
from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import Any, NamedTuple

os.environ["NUMBA_DISABLE_JIT"] = "1"  # before Numba is imported
from host_slips import CALLED, HARMLESS, MEMORY, altered, changes, functions, noting, place
from slips import code_of, functions_behind, harmless

from refsim.core.effect import EFFECTS
from refsim.core.operation import REGISTRY
from validation.laws import command
from validation.laws.laws import LAWS, OWN, other_backend

LEFT_OUT = {"backends", "cluster", "commands", "contract", "io", "isosurface", "render", "study", "sweep"}
COMPARED = 24  # scenes of a turn that compare backends: only these run kernels
MOST, SMALLER = 81, 6  # particles of a scene, trials that make a found one smaller
PATIENCE, LONGEST = 25, 120.0  # times the seconds without the fault, after which a scene does not end; without one
FORK = multiprocessing.get_context("fork")


class Fault(NamedTuple):
    """A function, its code with the fault, and the fault in words."""

    function: types.FunctionType
    code: types.CodeType
    words: str


FAULTS: list[Fault] = []
Trial = tuple[str, str, str | None, int, str]  # law and its function, effect, seed, backend
Told = tuple[str, set[str], float]  # how the law breaks or "", functions that were called, processor seconds


def drawn(seed: int, count: int) -> Iterator[Fault]:
    """The lot of a seed: half of it in kernels, half in host code."""
    packages = sorted(p.name for p in pkgutil.iter_modules([str(pathlib.Path(command.__file__).parents[2] / "refsim")]))
    kernels = {place(f): f for o in REGISTRY.values() for f in functions_behind(o) if f.__code__.co_filename[0] != "<"}
    host = {place(f): f for package in packages if package not in LEFT_OUT for f in functions(package)}
    for pool in (kernels, {name: f for name, f in host.items() if name not in kernels}):
        places = [(pool[name], slip) for name in sorted(pool) for slip in changes(pool[name])]
        random.Random(seed).shuffle(places)
        yield from itertools.islice((fault for at in places for fault in slipped(*at)), count // 2)


def slipped(function: types.FunctionType, slip: Any) -> Iterator[Fault]:
    """The fault, if Python compiles it and no list says that it changes no answer."""
    try:
        code, line = altered(function, *slip)
    except SyntaxError:
        return
    words = f"{place(function)}: {line}"
    if not harmless(f"{function.__name__}: {line}") and not words.startswith(tuple(HARMLESS)):
        yield Fault(function, code, words)


def taken_back(path: pathlib.Path) -> Iterator[Fault]:
    """The mends of a file: in a function `of` the text `now` becomes `then`."""
    for words, mend in tomllib.loads(path.read_text(encoding="utf-8")).items():
        function = inspect.unwrap(pkgutil.resolve_name(mend["of"]))
        source = textwrap.dedent(inspect.getsource(function))
        assert source.count(mend["now"]) == 1, f"{words}: {mend['of']} does not have this text once"
        yield Fault(function, code_of(function, ast.parse(source.replace(mend["now"], mend["then"]))), words)


def stream(seed: int, compared: int) -> Iterator[Trial]:
    """Laws in turn, each with any effect; so many scenes of a turn compare backends."""
    rng = random.Random(seed)
    every = [(name, law) for name in LAWS for law in LAWS[name] for _ in range(compared if law is other_backend else 1)]
    while True:
        for name, law in rng.sample(every, len(every)):
            effect = None if law in OWN else rng.choice([*sorted(EFFECTS), None])
            yield name, law.__name__, effect, rng.getrandbits(32), "cpu" if law is other_backend else "numpy"


def judged(number: int | None, trial: Trial, limit: float) -> Told:
    """A trial in this process, with a fault or none."""
    for function in {fault.function for fault in FAULTS} if number is None else ():
        function.__code__ = noting(function)
    for fault in () if number is None else (FAULTS[number],):
        fault.function.__code__ = fault.code
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGVTALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_VIRTUAL, limit)
    began, (name, law_name, effect, seed, backend) = time.process_time(), trial
    law = next(each for each in LAWS[name] if each.__name__ == law_name)
    tally = command.Tally(defaultdict(Counter), defaultdict(Counter), Counter(), {})
    broken: list[tuple[int, str]] = []
    try:
        command._trial(name, law, command.drawn(None if law in OWN else effect, MOST), seed, backend, tally, broken)
    except KeyboardInterrupt:
        broken.append((0, "does not end"))
    except Exception as error:  # where scenes are drawn
        broken.append((0, f"no scene is drawn: {error!r}"))
    signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    return min(broken, default=(0, ""))[1], set(CALLED), time.process_time() - began


def asked(tries: list[tuple[int | None, Trial, float]], jobs: int) -> list[Told]:
    """What `judged` says of each, in a process of its own, in which nothing ran before; so many at a time."""
    told: dict[int, Told] = {}
    waiting, running = list(enumerate(tries))[::-1], {}
    while waiting or running:
        while waiting and len(running) < jobs:
            k, job = waiting.pop()
            ours, theirs = FORK.Pipe(duplex=False)
            process = FORK.Process(target=lambda pipe=theirs, job=job: pipe.send(judged(*job)), daemon=True)
            process.start()
            theirs.close()
            running[ours] = k, process, time.monotonic() + 3 * job[2] + 60
        ready = multiprocessing.connection.wait(list(running), timeout=1)
        for ours in [pipe for pipe, row in running.items() if pipe in ready or time.monotonic() > row[2]]:
            k, process, _ = running.pop(ours)
            told[k] = "does not end", set(), tries[k][2]
            if ours in ready:
                with contextlib.suppress(EOFError):  # it has ended
                    told[k] = ours.recv()
            process.kill()
            process.join()
            process.close()
            ours.close()
    return [told[k] for k in range(len(tries))]


def hunt(scenes: Iterator[Trial], seconds: float, jobs: int) -> int:
    """How many faults the stream finds, each printed with its scene."""
    left, spent, count, calls = dict(enumerate(FAULTS)), 0.0, 0, Counter[int]()
    while left and spent < seconds:
        tries, block = [], list(itertools.islice(scenes, 2 * jobs))
        for trial, (text, called, own) in zip(block, asked([(None, each, LONGEST) for each in block], jobs)):
            if text:
                print(f"without a fault: {trial}: {text.splitlines()[0]}", flush=True)
            calling = [n for n, fault in left.items() if place(fault.function) in called and not text]
            tries += [(n, trial, max(20.0, PATIENCE * own), (spent, count)) for n in calling]
            spent, count = spent + own, count + 1
            calls.update(calling)
        for (n, trial, _, before), (text, _, own) in zip(tries, asked([each[:3] for each in tries], jobs)):
            if text and n in left:
                print(f"found {n}: {left.pop(n).words}\n  {trial}, {(before[0] + own) / 60:.1f} minutes,", end=" ")
                print(f"{before[1] + 1} scenes\n{textwrap.indent(text, '  ')}", flush=True)
    for n, fault in left.items():
        print(f"missed {n}: {fault.words}; {calls[n]} of {count} scenes in {spent / 60:.1f} minutes call it")
    return len(FAULTS) - len(left)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True, help="of the lot and of the stream")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--minutes", type=float, default=20.0, help="processor minutes of the stream (20)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--mends", type=pathlib.Path, help="mends that are taken back, such as taken_back.toml")
    given = parser.parse_args()
    FAULTS[:] = taken_back(given.mends) if given.mends else drawn(given.seed, given.count)
    command.SMALLER = SMALLER
    found = hunt(stream(given.seed, 0 if given.mends else COMPARED), 60 * given.minutes, given.jobs)
    print(f"{found} of {len(FAULTS)} faults found, seed {given.seed}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
