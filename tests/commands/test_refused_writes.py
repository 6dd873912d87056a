"""Commands on full disks and through links: one sentence, and nothing half-written."""

import importlib.util
import json
import os
import subprocess
import sys

import pytest

from refsim.__main__ import main
from refsim.core.errors import InputError
from refsim.scene.surface_mesh import load_mesh
from tests.commands import refused_writes
from tests.commands.test_cli import one_sentence
from tests.running import ROOT, answer_of
from tests.tank_file import tank

SCENE = tank(0.002) + refused_writes.GAUGE
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
    answer_of(capsys, ["run", "tank.toml", "--backend", "numpy", "--quiet", "--output", "run"])
    return folder


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


def every_call(name, faults=("interrupted", "vanished", "slow"), stride=1, errors=tuple(refused_writes.NUMBERS)):
    """What a command comes to whose 1st, 2nd, ... open, write, rename or fsync meets a fault, among files of before.

    A disk's errors, which differ in words, take turns; at night each is drawn.
    """
    disk = refused_writes.Disk()
    with disk.watching():
        for at in range(0, refused_writes.prepare((name,), disk)[name], stride):
            turn = at // stride // 2 % max(len(errors), 1)
            for fault in (*errors[turn : turn + 1], *faults):
                yield refused_writes.trial(name, disk, at, fault, lasting=at % 2 == 0, old=True)


FILM = pytest.param("film", marks=[
    pytest.mark.skipif(importlib.util.find_spec("imageio_ffmpeg") is None, reason="imageio-ffmpeg is not installed"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),  # its pipes are left open
])  # fmt: skip


@pytest.mark.parametrize("name", ["view", "picture", "gauges", "table", "example", FILM])
def test_files_are_the_old_or_the_new_ones_whatever_is_refused(folder, name):
    outcomes = list(every_call(name, stride=2 if name == "picture" else 1))
    assert len(outcomes) >= 4 * 4
    assert set(outcomes) == {f"{name}: {code}" for code in (0, 2, 3)}


def test_a_folder_that_vanishes_beneath_a_run_is_told(folder):
    outcomes = list(every_call("run", ("vanished",), stride=4, errors=()))
    assert outcomes.count("run: 2") > 20
    assert set(outcomes) <= {"run: 0", "run: 2"}


def test_a_campaign_finds_what_writes_by_halves(monkeypatch, capsys):
    def torn():
        with refused_writes.writing.open("out/table.csv", "wb", 0) as file:
            refused_writes.writing.write_all(file, b"a,b\n1,2\n")
        return 0

    monkeypatch.setitem(refused_writes.COMMANDS, "torn", torn)
    assert refused_writes.campaign(20, 1, names=("torn",)) > 0
    assert "20 trials, seed 1" in capsys.readouterr().out


@posix
@pytest.mark.parametrize("words", [
    ["view", "run", "--html", "loop/page.html"], ["view", "loop"], ["render", "run", "-o", "loop/p.png"],
    ["render", "loop"], ["sweep", "one.toml", "--output", "loop", "--quiet"], ["sweep", "loop"],
    [*STUDY, "front", "--output", "loop"], ["run", "tank.toml", "--output", "loop"], ["run", "loop"],
])  # fmt: skip
def test_a_link_to_itself_is_told(ran, capsys, words):
    os.symlink("loop", "loop")
    assert "loop" in one_sentence(answer_of(capsys, words, 2).err)


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


@pytest.mark.parametrize("suffix", ["zip", "ZIP", "tar.gz", "3mf", "vtu", "h5m"])
def test_a_mesh_of_a_format_that_may_be_compressed_is_not_opened(folder, monkeypatch, suffix):
    import trimesh

    monkeypatch.setattr(trimesh, "load", lambda *given, **options: pytest.fail("it was read"))
    (folder / f"m.{suffix}").write_bytes(b"PK\x03\x04")
    with pytest.raises(InputError, match="of no format that is read; give a mesh as"):
        load_mesh(f"m.{suffix}")
