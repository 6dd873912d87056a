"""Numbers whose code has changed without changing a bit."""

import json
import sys
from pathlib import Path

import pytest

from refsim.core.errors import InputError
from validation import published, unchanged
from validation.experiment import Experiment, Run, discover
from validation.published import Item, Standing
from validation.unchanged import SAME, Compared, values

RUNNING = "class Context:\n    def __init__(self, threads):\n        self.threads = threads\n"
RUNS = """
import time
from types import SimpleNamespace
import numpy as np
from validation.running import Context  # of these sources

def fall(context, length):
    if length < 0:
        raise ValueError("no length")
    return SimpleNamespace(values={"error": %s * length, "seconds": time.perf_counter(), "words": ["a", None]},
                           arrays={"time": np.arange(3.0)})
"""


@pytest.fixture
def sources(tmp_path):
    """Makes a folder with one run function, in which a constant has the given text."""

    def make(name, constant):
        folder = tmp_path / name
        (folder / "validation").mkdir(parents=True)
        (folder / "validation" / "__init__.py").touch()
        (folder / "validation" / "running.py").write_text(RUNNING)
        (folder / "validation" / "falls.py").write_text(RUNS % constant)
        return folder

    return make


def fall(context, length):
    """Stands for the run function of the folders."""


fall.__module__ = "validation.falls"
ROWS = {"a": Run("a", fall, {"length": 0.1}), "b": Run("b", fall, {"length": -1.0}), "c": Run("c", fall, {"length": 3})}


def test_the_same_bits_are_found_and_seconds_do_not_count(sources):
    old, new = values(sources("old", "2.0"), ROWS, 2), values(sources("new", "4.0 / 2"), ROWS, 2)
    again = values(sources("again", "4.0 / 2"), ROWS, 1)
    assert old["a"] != new["a"]  # the seconds
    assert unchanged._outcome(old["a"], new["a"], again["a"]) == SAME
    assert unchanged._outcome(old["b"], new["b"], None) == "fails under the old sources: ValueError: no length"


def test_one_bit_is_a_difference_and_so_is_another_shape(sources):
    old, new = values(sources("old", "2.0"), ROWS, 1), values(sources("new", "2.0000000000000004"), ROWS, 1)
    assert unchanged._outcome(old["a"], new["a"], new["a"]) == "differs: /values/error, /values/seconds"
    fewer = {place: value for place, value in old["c"].items() if place != "/arrays/time"}
    assert unchanged._outcome(fewer, old["c"], old["c"]).startswith("differs")


def test_what_never_repeats_is_no_agreement():
    assert unchanged._outcome({"x": "1"}, {"x": "2"}, {"x": "3"}) == "no value repeats"


def test_a_process_that_ends_is_told(sources, monkeypatch):
    monkeypatch.setattr(unchanged, "WORKER", Path("nowhere.py"))
    assert values(sources("old", "2.0"), ROWS, 1)["a"] == "its process ended"


def test_only_what_held_and_is_no_time_is_compared(monkeypatch):
    items = {
        name: Item("picture", name, "f", "run f", [run])
        for name, run in {
            "stale": Run("r", fall, {"length": 1.0}, estimate=100.0),
            "timed": Run("r", fall, {"length": 1.0}, timed=True),
            "stale_before": Run("r", fall, {"length": 2.0}),
            "holds": Run("r", fall, {"length": 3.0}),
        }.items()
    }
    monkeypatch.setattr(Item, "digest", lambda item: "new")
    records = {"holds": {"digest": "new"}}
    monkeypatch.setattr(
        published, "standings", lambda names, known: [Standing(i, records.get(n, {})) for n, i in items.items()]
    )
    small = [Run("s", fall, {"length": 5.0}, estimate=1.0), Run("t", fall, {"length": 1.0}, estimate=2.0)]
    monkeypatch.setattr(unchanged, "_small_runs", lambda known: small)
    old = {f"picture {name}": {"state": "stale" if name == "stale_before" else "holds"} for name in items}
    found = unchanged.comparable({}, old)
    assert {key: run.key for key, (_, run) in found.items()} == {"picture stale": "t"}


def test_small_runs_are_those_of_the_quick_size():
    def planned(options):
        return [Run("small" if options.quick else "large", fall)]

    known = {**discover(), "e": Experiment("e", "an experiment", planned)}
    assert [run.key for run in unchanged._small_runs(known) if run.function is fall] == ["small"]


def test_a_record_that_is_renewed_says_where_it_was_compared(tmp_path, monkeypatch):
    monkeypatch.setattr(Item, "digest", lambda item: "new")
    path = tmp_path / "published.json"
    items = [Item("picture", name, "f", "run f", []) for name in ("same", "other")]
    path.write_text(json.dumps({i.key: {"digest": "old", "date": "2026-01-01", "commit": "abcdef0123"} for i in items}))
    found = [Compared(items[0], ROWS["a"], SAME), Compared(items[1], ROWS["a"], "differs: /values/error")]
    assert unchanged.renew(found, "0123456789", path) == 1
    records = published.read_records(path)
    assert records["picture other"]["digest"] == "old"
    assert published.words_of(Standing(items[0], records["picture same"])) == (
        "2026-01-01, abcdef0; same bits at 0123456"
    )
    assert str(unchanged.table(found)).startswith("1 of 2 stale numbers have the same bits")


def test_a_folder_without_sources_is_a_sentence(tmp_path):
    with pytest.raises(InputError, match="holds no sources"):
        unchanged.compare(tmp_path, {}, 1)
    with pytest.raises(InputError, match="holds these sources"):
        unchanged.compare(published.ROOT, {}, 1)
    (tmp_path / "validation").mkdir()
    (tmp_path / "validation" / "published.py").touch()
    with pytest.raises(InputError, match="stale --json` fails there"):
        unchanged.compare(tmp_path, {}, 1)


def test_the_worker_stands_alone():
    """It runs under sources of any age: it imports what Python, NumPy and these sources have had from the start."""
    text = unchanged.WORKER.read_text()
    assert "from validation.running import Context" in text
    imported = [line.split()[1].split(".")[0] for line in text.splitlines() if line.startswith(("import ", "from "))]
    assert set(imported) <= {*sys.stdlib_module_names, "numpy"}
