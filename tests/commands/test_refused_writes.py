"""Commands on full disks and through links: one sentence, and nothing half-written."""

import errno
import io
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import pytest

import refsim
from refsim.__main__ import main
from refsim.core import writing
from tests.commands.test_cli import one_sentence
from tests.tank_file import tank

ROOT = pathlib.Path(__file__).parents[2]
GAUGE = """
[[gauge]]
name = "middle"
kind = "level"
lower = [0.02, -0.1, 0.0]
upper = [0.02, 0.3, 0.0]
every = 0.0005
"""
SCENE = tank(0.002) + GAUGE
SWEEP = 'scene = "tank.toml"\nobservable = "{}"\nbackend = "numpy"\n'
STUDY = ["study", "tank.toml", "--backend", "numpy", "--levels", "1", "--knobs", "spacing", "--quiet", "--observable"]
posix = pytest.mark.skipif(os.name != "posix", reason="links and limits of POSIX")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder, where the command stands, with a scene and a sweep of one run."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.toml").write_text(SCENE)
    (tmp_path / "one.toml").write_text(SWEEP.format("kinetic_energy"))
    return tmp_path


@pytest.fixture
def ran(folder, capsys):
    """The same with a run."""
    assert main(["run", "tank.toml", "--backend", "numpy", "--quiet", "--output", "run"]) == 0
    capsys.readouterr()
    return folder


@pytest.fixture
def full(monkeypatch):
    """A disk that takes 1000 bytes of a file and no more."""

    def write_some(file, content):
        file.write(content[:1000])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(writing, "write_all", write_some)


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
@pytest.mark.parametrize("words", [["list", "--json"], ["run", "tank.toml", "--backend", "numpy", "--quiet"]])
def test_standard_output_on_a_full_disk(folder, words):
    with open("/dev/full", "w") as full_disk:
        done = subprocess.run(
            [sys.executable, "-m", "refsim", *words], stdout=full_disk, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
    assert done.returncode == 3
    assert "Traceback" not in done.stderr
    last = done.stderr.splitlines(keepends=True)[-1]
    assert last.startswith("refsim: standard output")
    assert "[disk_full]" in last
    one_sentence(last.replace(" [disk_full]", ""))
    if words[0] == "run":
        assert json.loads((folder / "tank_run" / "report.json").read_text())["reason"] is None


@pytest.mark.parametrize(
    "words", [["view", "run", "--html", "new/page.html"], ["render", "run", "-o", "new/p.png", "--size", "320x240"]],
    ids=["view", "render"],
)  # fmt: skip
def test_nothing_half_written_is_left_on_a_full_disk(ran, full, capsys, words):
    (ran / "new").mkdir()
    assert main(words) == 3
    err = capsys.readouterr().err
    assert "[disk_full]" in err
    one_sentence(err.replace(" [disk_full]", ""))
    assert not list((ran / "new").iterdir())


def table():
    refsim.open_run("run").gauge("middle").to_csv("table.csv")
    return 0


WRITERS = {  # what writes the file of that name
    "page.html": lambda: main(["view", "run", "--html", "page.html"]),
    "plots.png": lambda: main(["render", "run", "--gauges", "-o", "plots.png"]),
    "droplet.toml": lambda: main(["example", "droplet", "--output", ".", "--overwrite"]),
    "table.csv": table,
}


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "full"), OSError(errno.EIO, "broken"), KeyboardInterrupt()])
@pytest.mark.parametrize("name", WRITERS)
def test_an_older_file_stays_whole_whatever_is_refused(ran, capsys, disk, name, error):
    """The first, second, ... write, rename or fsync fails: one sentence, and the old file or the new one."""
    target, perform, old, disk.error = ran / name, WRITERS[name], b"an older file", error
    assert perform() == 0
    whole = len(target.read_bytes())
    target.unlink()
    (ran / "precious").write_bytes(old)
    allowed, outcome = -1, 3
    while outcome == 3:
        allowed += 1
        target.unlink(missing_ok=True)
        target.symlink_to(ran / "precious")
        before = set(ran.iterdir())
        capsys.readouterr()
        disk.space = allowed
        try:
            outcome = perform()
        except (KeyboardInterrupt, refsim.RunStopped):
            outcome = 3
        else:
            if outcome:
                one_sentence(capsys.readouterr().err.partition(" [")[0] + "\n")
        disk.space = 10**9
        assert target.read_bytes() == old or len(target.read_bytes()) == whole
        assert set(ran.iterdir()) == before
        assert (ran / "precious").read_bytes() == old  # the link was not followed
    assert outcome == 0
    assert allowed > 2


INTO = {  # words of commands that write into the folder "out", which is there
    "view": ["view", "run", "--html", "out/page.html"],
    "render": ["render", "run", "--gauges", "-o", "out/plots.png"],
    "example": ["example", "droplet", "--output", "out", "--overwrite"],
    "run": ["run", "tank.toml", "--backend", "numpy", "--quiet", "--until", "5e-4", "--output", "out"],
}


@pytest.mark.parametrize("name", INTO)
def test_a_folder_that_vanishes_is_told(ran, capsys, disk, name):
    """Before the first, second, ... open, write, rename or fsync it is removed: one sentence that says so, or all
    is written already."""
    allowed, unharmed, outcomes = 0, False, set()
    while not unharmed:
        shutil.rmtree("out", ignore_errors=True)
        os.mkdir("out")
        disk.space, disk.error = allowed, lambda: shutil.rmtree("out", ignore_errors=True)
        outcomes.add(outcome := main(INTO[name]))
        unharmed, disk.space = disk.space >= 0, 10**9
        err = re.sub("^note: .*\n", "", capsys.readouterr().err, flags=re.MULTILINE)
        assert not list(ran.rglob("*.tmp"))
        assert outcome == 2 or (outcome, "Traceback" in err) == (0, False)
        if outcome:
            assert "(No such file or directory); give a" in one_sentence(err)
        allowed += 1
    assert (outcome, outcomes, allowed > 5) == (0, {0, 2}, True)


def test_a_disk_that_takes_a_little_at_a_time_gets_all(ran, monkeypatch):
    class Slow(io.FileIO):
        def write(self, data):
            return super().write(data[:4097])

    assert main(INTO["view"][:-1] + ["page.html"]) == 0
    monkeypatch.setattr(writing, "open", lambda path, mode, buffering: Slow(path, mode.replace("b", "")), raising=False)
    assert main(INTO["view"][:-1] + ["slow.html"]) == 0
    assert (ran / "slow.html").read_bytes() == (ran / "page.html").read_bytes()
    assert (ran / "page.html").stat().st_size > 2 * 4097


@posix
@pytest.mark.parametrize("words", [
    ["view", "run", "--html", "loop/page.html"], ["view", "loop"], ["render", "run", "-o", "loop/p.png"],
    ["render", "loop"], ["sweep", "one.toml", "--output", "loop", "--quiet"], ["sweep", "loop"],
    [*STUDY, "front", "--output", "loop"], ["run", "tank.toml", "--output", "loop"], ["run", "loop"],
])  # fmt: skip
def test_a_link_to_itself_is_told(ran, capsys, words):
    os.symlink("loop", "loop")
    assert main(words) == 2
    assert "loop" in one_sentence(capsys.readouterr().err)


@pytest.mark.parametrize("words", [[*STUDY], ["sweep", "own.toml", "--jobs", "1", "--quiet"]], ids=["study", "sweep"])
def test_an_observable_that_ends_the_program_is_told(folder, capsys, words):
    (folder / "own.py").write_text("import sys\nsys.exit(0)\n")
    (folder / "own.toml").write_text(SWEEP.format("own.py:f"))
    assert main([*words, "own.py:f"] if words[0] == "study" else words) == 2
    assert "own.py cannot be run (SystemExit: 0); correct it." in one_sentence(capsys.readouterr().err)


@posix
def test_a_link_in_the_place_of_a_result_is_replaced_and_not_followed(ran, capsys):
    precious = ran / "precious.txt"
    precious.write_text("precious")
    (ran / "tank_study").mkdir()
    links = [ran / name for name in ("tank_study/study.txt", "tank_study/study.png", "page.html", "picture.png")]
    for link in links:
        link.symlink_to(precious)
    assert main([*STUDY, "kinetic_energy"]) == 0
    assert main(["view", "run", "--html", "page.html"]) == 0
    assert (main(["render", "run", "-o", "picture.png", "--size", "320x240"]), precious.read_text()) == (0, "precious")
    assert not any(link.is_symlink() for link in links)


@pytest.mark.parametrize("suffix", ["zip", "ZIP", "tar.gz", "tar.bz2", "bz2", "3mf"])
def test_a_mesh_that_is_an_archive_is_not_unpacked(folder, capsys, monkeypatch, suffix):
    import trimesh

    monkeypatch.setattr(trimesh, "load", lambda *given, **options: pytest.fail("it was read"))
    (folder / f"m.{suffix}").write_bytes(b"PK\x03\x04")
    assert main(["sample", f"m.{suffix}", "--radius", "0.1"]) == 2
    assert "is an archive; give the mesh in it" in one_sentence(capsys.readouterr().err)
