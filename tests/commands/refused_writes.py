"""Faults in the writes of every command, drawn by a seed: is each old file whole, or the new one?

`python tests/commands/refused_writes.py --count 2000` runs commands in one process. At a drawn open, write, rename or
fsync the disk is full, breaks or takes little at a time, the folder vanishes, or Ctrl-C comes, once or from then on.
Prints what went wrong with the trial's number, which `--only NUMBER` repeats; exit code 4 if there is any.
"""

import argparse
import collections
import contextlib
import csv
import errno
import importlib.util
import io
import json
import os
import pathlib
import random
import shutil
import sys
import tempfile
import tomllib
import traceback
import types
import xml.etree.ElementTree
from collections.abc import Callable, Iterable, Iterator
from unittest import mock

import h5py
import numpy as np
from PIL import Image

import refsim
from refsim.__main__ import main as refsim_main
from refsim.contract import Target
from refsim.contract.export import write_replay
from refsim.contract.programs import climb
from refsim.core import writing
from refsim.core.operation import REGISTRY
from refsim.io.frames import read_arrays, read_head

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
from tests.running import rows  # noqa: E402
from tests.tank_file import tank  # noqa: E402

GAUGE = rows(__file__, "gauge")
SWEEP = 'scene = "tank.toml"\nobservable = "kinetic_energy"\nbackend = "numpy"\n'


def table() -> int:
    refsim.open_run("run").gauge("middle").to_csv("out/table.csv")
    return 0


def replay() -> int:
    """The file of a trial, which a process of `contract` writes, in this one."""
    target = Target(REGISTRY["sph.gravity"], "cpu", "float64", 0)
    (outcome, *_) = climb(target, ("T1",))
    assert outcome.passed
    with contextlib.chdir("out"):
        write_replay(target)
    return 0


def words(line: str) -> Callable[[], int]:
    return lambda: refsim_main(line.split())


COMMANDS = {  # each writes into the folder "out", and what it left there before it does not mind
    "run": words("run tank.toml --backend numpy --quiet --output out --overwrite --checkpoint-every 0 --until 1e-3"),
    "resume": words("run --resume out --backend numpy --quiet --until 2e-3 --checkpoint-every 0"),
    "sweep": words("sweep one.toml --jobs 1 --quiet --output out"),
    "study": words(
        "study tank.toml --backend numpy --levels 1 --knobs spacing --quiet --observable kinetic_energy --output out"
    ),
    "view": words("view run --html out/page.html"),
    "picture": words("render run --output out/picture.png --size 160x120 --frames 0,1"),
    "film": words("render run --film out/film.mp4 --size 160x120"),
    "gauges": words("render run --gauges -o out/plots.png"),
    "table": table,
    "example": words("example droplet --output out --overwrite"),
    "export": words("contract sph.gravity --export out"),
    "replay": replay,
}
SLOW = ("sweep", "study", "film")  # drawn half as often
NUMBERS = {"full": errno.ENOSPC, "quota": errno.EDQUOT, "broken": errno.EIO, "read-only": errno.EROFS}


def vanish() -> None:
    shutil.rmtree("../out" if os.path.basename(os.getcwd()) == "out" else "out", ignore_errors=True)


FAULTS: dict[str, BaseException | Callable[[], None] | None]
FAULTS = {name: OSError(number, os.strerror(number)) for name, number in NUMBERS.items()}
FAULTS |= {"interrupted": KeyboardInterrupt(), "vanished": vanish, "slow": None}


class Disk:
    """Counts opens, writes, renames and fsyncs; after `space` further ones the next raises `error`, a write in its
    middle, or calls it if that is a function; and if `lasting` all later ones. With none, writes are small pieces."""

    def begin(
        self, space: int = 10**9, error: BaseException | Callable[[], None] | None = vanish, lasting: bool = True
    ) -> None:
        self.calls, self.space, self.error, self.lasting, self.met = 0, space, error, lasting, False

    def meet(self, half: Callable[[], object] = lambda: None) -> None:
        self.calls, self.space = self.calls + 1, self.space - 1
        if self.space >= 0 or (self.met and not self.lasting):
            return
        self.met = True
        if isinstance(self.error, BaseException):
            half()
            raise self.error
        if self.error is not None:
            self.error()

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Count the calls of `refsim.core.writing`, of the system and of the program that writes films."""

        def counted(real: Callable) -> Callable:
            def call(*given: object, **named: object) -> object:
                self.meet(lambda: real(given[0], bytes(given[1])[: len(given[1]) // 2]) if real is write_all else None)
                return real(*given, **named)

            return call

        def slowly(file: io.RawIOBase, data: bytes) -> None:
            small = types.SimpleNamespace(write=lambda view: file.write(view[:4097]))
            write_all(small, data) if self.error is None else whole(file, data)

        def film(*given: object, **named: object) -> Iterator[None]:
            inner = frames(*given, **named)
            try:
                inner.send(None)
                while True:
                    image = yield
                    self.meet()
                    inner.send(image)
            finally:
                inner.close()

        write_all = writing.write_all
        whole = counted(write_all)
        places = [(writing, "open", counted(open)), (writing, "write_all", slowly)]
        places += [(os, name, counted(getattr(os, name))) for name in ("replace", "fsync")]
        if importlib.util.find_spec("imageio_ffmpeg"):
            films = importlib.import_module("imageio_ffmpeg")
            frames = films.write_frames
            places.append((films, "write_frames", film))
        with contextlib.ExitStack() as stack:
            for place, name, made in places:
                stack.enter_context(mock.patch.object(place, name, made, create=True))
            yield


READERS: dict[str, Callable[[bytes], object]] = {
    ".json": json.loads, ".toml": lambda data: tomllib.loads(data.decode()),
    ".png": lambda data: Image.open(io.BytesIO(data)).load(), ".xml": xml.etree.ElementTree.fromstring,
    ".pvd": xml.etree.ElementTree.fromstring,
    ".h5": lambda data: h5py.File(io.BytesIO(data)).visititems(
        lambda _, item: item[()] if isinstance(item, h5py.Dataset) else None
    ),
}  # fmt: skip


def check_whole(path: pathlib.Path) -> None:
    """Raises where a file is not whole, as its suffix says."""
    data = path.read_bytes()
    assert data or path.suffix == ".lock", "empty"
    if path.suffix in READERS:
        READERS[path.suffix](data)
    elif path.suffix == ".csv":
        rows = list(csv.reader(io.StringIO(data.decode())))
        assert len({len(row) for row in rows}) == 1, "rows of several lengths"
        assert data.endswith(b"\n"), "cut in its last line"
    elif path.suffix == ".html":
        assert data.rstrip().endswith(b"</html>"), "cut"
    elif path.suffix == ".vtp":
        head = read_head(path)
        read_arrays(head, list(head.arrays), check=True)
    elif path.suffix == ".npz":
        with np.load(io.BytesIO(data)) as read:
            assert all(read[name] is not None for name in read)


def contents(folder: str = "out") -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(pathlib.Path(folder).rglob("*")) if path.is_file()}


def prepare(names: Iterable[str], disk: Disk) -> dict[str, int]:
    """A run, what commands take, and what they leave without a fault; the number of their calls."""
    pathlib.Path("tank.toml").write_text(tank(0.002) + GAUGE)
    pathlib.Path("one.toml").write_text(SWEEP)
    calls = {}
    disk.begin()
    with contextlib.redirect_stderr(said := io.StringIO()), contextlib.redirect_stdout(said):
        assert words("run tank.toml --backend numpy --quiet --output run --every 1e-3")() == 0
        for name in names:
            shutil.rmtree("out", ignore_errors=True)
            shutil.copytree("old_run", "out") if name == "resume" else os.mkdir("out")
            disk.begin()
            assert COMMANDS[name]() in (0, 4), said.getvalue()
            calls[name] = disk.calls
            shutil.copytree("out", f"old_{name}")
    if "resume" in names:
        shutil.rmtree("old_resume")
        shutil.copytree("old_run", "old_resume")
    return calls


def trial(name: str, disk: Disk, fault_at: int, fault: str, lasting: bool, old: bool) -> str:
    """What a command came to whose disk has the fault; AssertionError for what may not be."""
    shutil.rmtree("out", ignore_errors=True)
    if old:
        shutil.copytree(f"old_{name}", "out")
    else:
        os.mkdir("out")
    before, said, plain = contents(), io.StringIO(), io.StringIO()
    disk.begin(fault_at, FAULTS[fault], lasting)
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(plain):
        try:
            code = COMMANDS[name]()
        except (refsim.InputError, refsim.RunStopped, KeyboardInterrupt) as error:  # a call of Python raises
            code = 2 if isinstance(error, refsim.InputError) else 3
            print(f"refsim: {error}", file=said)
    disk.space = 10**9
    words_said = said.getvalue()
    assert code in (0, 2, 3), f"exit code {code}"
    assert "Traceback" not in words_said, words_said[-600:]
    lines = [line for line in words_said.splitlines() if line.startswith("refsim: ")]
    assert len(lines) == (code in (2, 3)) or (code == 4), words_said[-600:]
    assert fault != "slow" or code in (0, 4), "a slow disk gets all"
    for path, data in contents().items():
        assert not path.endswith(".tmp"), f"{path} is left"
        if data != before.get(path):
            try:
                check_whole(pathlib.Path(path))
            except Exception as error:
                raise AssertionError(f"{path} is torn: {error!r}") from None
    if fault != "vanished":
        lost = before.keys() - contents().keys()
        assert not lost or name == "run", f"lost: {sorted(lost)}"
    return f"{name}: {code}"


def campaign(count: int, seed: int, only: int | None = None, names: tuple[str, ...] = tuple(COMMANDS)) -> int:
    """Trials, what they came to, and how many went wrong."""
    outcomes: collections.Counter[str] = collections.Counter()
    disk, wrong = Disk(), 0
    chances = [1 if name in SLOW else 2 for name in names]
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), disk.watching():
        calls = prepare(names, disk)
        for number in range(count) if only is None else [only]:
            draw = random.Random(f"{seed} {number}")
            (name,) = draw.choices(names, chances)
            fault, lasting = draw.choice(list(FAULTS)), draw.random() < 0.5
            fault_at, old = (
                draw.randrange(calls[name] + 1),
                name == "resume" or (draw.random() < 0.6 and name != "export"),
            )
            given = fault_at, fault, lasting, old
            try:
                outcomes[trial(name, disk, *given)] += 1
            except Exception as error:
                wrong += 1
                at = traceback.extract_tb(error.__traceback__)[-1]
                print(f"{number}, {name} {given}: {type(error).__name__}: {error} [{at.name}]", flush=True)
    print(*(f"{n:5d} {k}" for k, n in sorted(outcomes.items())), sep="\n")
    print(f"{outcomes.total() + wrong} trials, seed {seed}, calls {calls}: {wrong} wrong", flush=True)
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, help="number of the one trial to repeat")
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    given = parser.parse_args()
    return 4 if campaign(given.count, given.seed, given.only, tuple(given.commands)) else 0


if __name__ == "__main__":
    sys.exit(main())
