"""The script for the night: outcomes and time limits of its tasks, the record, and the page that shows it."""

import importlib.util
import json
import os
import pathlib
import platform
import re
import sys
import time

import pytest

pytestmark = pytest.mark.usefixtures("coarse_pictures")
ROOT = pathlib.Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("nightly", ROOT / "scripts" / "nightly.py")
nightly = sys.modules.setdefault(spec.name, importlib.util.module_from_spec(spec))
spec.loader.exec_module(nightly)

# It starts a process that outlives it unless both are ended.
HANGING = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print(child.pid, flush=True)
time.sleep(600)
"""


def task(program, minutes=1.0):
    return nightly.Task("a program", ("-c", program), minutes)


@pytest.fixture
def place(tmp_path):
    (tmp_path / "page.md").write_text(f"before\n{nightly.BEGIN}{nightly.END}\nafter\n")
    return nightly.Place(tmp_path / "record.json", tmp_path / "page.md", tmp_path / "logs", tmp_path / "picture.png")


def outcomes(place):
    return {name: entry["outcome"] for name, entry in json.loads(place.record.read_text()).items()}


def alive(process):
    """Whether a process runs; one that has ended may still wait for its parent."""
    try:
        return "State:\tZ" not in pathlib.Path(f"/proc/{process}/status").read_text()
    except OSError:
        return False


def test_outcomes_are_told_and_kept(place, capsys):
    tasks = {"good": task("print('words')"), "bad": task("raise SystemExit(3)")}
    assert nightly.main([], tasks, place) == 4
    assert outcomes(place) == {"good": "passed", "bad": "failed with exit code 3"}
    assert (place.logs / "good.log").read_text() == "words\n"
    assert re.search(r"^bad +failed with exit code 3 +\d+$", capsys.readouterr().out, re.MULTILINE)
    tasks["bad"] = task("pass")
    assert nightly.main(["--only", "bad"], tasks, place) == 0
    assert outcomes(place) == {"good": "passed", "bad": "passed"}


@pytest.mark.skipif(not pathlib.Path("/proc").exists(), reason="processes are looked for in /proc")
def test_a_task_ends_at_its_limit_with_what_it_has_started(place):
    began = time.monotonic()
    assert nightly.main([], {"hanging": task(HANGING, 0.1)}, place) == 4
    assert outcomes(place) == {"hanging": "exceeded its limit of 0.1 min"}
    child = int((place.logs / "hanging.log").read_text())
    while alive(child) and time.monotonic() - began < 60:  # the signal is sent; the process may still be ending
        time.sleep(0.05)
    assert not alive(child)


def test_an_unknown_task_is_bad_input(place, capsys):
    assert nightly.main(["--only", "goood"], {"good": task("pass")}, place) == 2
    assert capsys.readouterr().err == "There is no task 'goood'; did you mean 'good'?\n"
    assert not place.record.exists()


def test_tasks_are_listed_and_none_is_run(place, capsys):
    assert nightly.main(["--list"], place=place) == 0
    told = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in told] == list(nightly.TASKS)
    assert {"slow", "slips", "attack", "peers", "claims", "stability"} <= set(nightly.TASKS)
    assert not place.logs.exists()


def test_the_record_names_the_machine_by_its_words_only(place):
    nightly.main([], {"good": task("pass")}, place)
    text = place.record.read_text() + (ROOT / "validation" / "nightly.json").read_text()
    (entry,) = json.loads(place.record.read_text()).values()
    assert set(entry) == {"date", "commit", "machine", "words", "command", "seconds", "outcome"}
    assert {"processor", "cores", "python", "numba"} <= set(entry["machine"])
    assert str(ROOT) not in text
    assert platform.node() not in text
    assert os.path.expanduser("~") not in text


def test_the_page_shows_the_record(place):
    nightly.main([], {"good": task("pass")}, place)
    stored = json.loads(place.record.read_text())
    page = place.page.read_text()
    assert page == f"before\n{nightly.BEGIN}\n{nightly.page_table(stored)}\n{nightly.END}\nafter\n"
    words = [text.get_text() for axes in nightly.drawing(stored).axes for text in axes.texts]
    assert words == ["passed, 0 min", *["not run yet"] * len(nightly.TASKS)]
    assert place.picture.stat().st_size > 1000
    assert f"| good | a program | passed | {stored['good']['date'][:10]} | {stored['good']['commit'][:10]}" in page
    published = nightly.Place()
    _, _, rest = published.page.read_text().partition(nightly.BEGIN)
    assert (
        rest.partition(nightly.END)[0].strip() == nightly.page_table(json.loads(published.record.read_text())).strip()
    )


def test_tests_that_are_slow_are_part_of_the_night():
    """Both tasks together select every test that is marked slow: what one leaves out is what the other runs."""
    slow, slips = (nightly.TASKS[name].command for name in ("slow", "slips"))
    assert slow[:4] == slips[:4] == ("-m", "pytest", "-q", "-m")
    assert slow[4] == slips[4] == "slow"
    assert slow[5:] == tuple(word for file in nightly.SLIPS for word in ("--ignore", file))
    assert slips[-2:] == nightly.SLIPS
