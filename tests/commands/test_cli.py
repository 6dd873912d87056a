"""The command line as a first-time user meets it: one sentence for each mistake, one object with --json."""

import json
import os
import pathlib
import re
import subprocess
import sys
from dataclasses import replace

import pytest

import refsim
from refsim.__main__ import main
from refsim.backends.arrays import unavailable
from refsim.commands import COMMANDS, discover, doctor
from refsim.core.effect import EFFECTS
from refsim.core.operation import BACKENDS, REGISTRY
from refsim.scene import solids
from tests.running import ROOT, answer_of, python, rows

SCENE = rows(__file__, "scene")


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A good scene file, in a folder of its own where the command stands."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "tank.toml"
    path.write_text(SCENE)
    return path


def one_sentence(err):
    """Exactly one sentence."""
    assert err.startswith("refsim: ")
    assert err.count("\n") == 1
    assert err.rstrip().endswith((".", "?"))
    assert "Traceback" not in err
    return err


# -- mistakes
BOX = 'shape = "box"\ncells = [6, 10, 1]'
BAD = rows(__file__, "bad_scenes") | {
    "effect that an effect needs": (SCENE[SCENE.index("[effects.w") : SCENE.index("[effects.g")], "", "needs effect"),
    "400 digits": ("spacing = 0.01", "spacing = 1" + "0" * 400, "spacing = 1000000000"),
    "400 digits of cells": ("cells = [6", "cells = [1" + "0" * 400, "cells along x = 100000000000..."),
    "5,000 digits": ("spacing = 0.01", "spacing = " + "1" * 5000, "is not TOML: exceeds the limit"),
    "lists in lists": ("spacing = 0.01", "spacing = " + "[" * 100000 + "]" * 100000, "nested too deeply"),
    "tables in tables": ("dim = 2", "dim = 2\n" + "a." * 3000 + "a = 1", "nested too deeply"),
    "tables in an effect": ("sound_speed = 20.0", "sound_speed." + "a." * 3000 + "a = 1", "nested too deeply"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_scenes_get_one_sentence(scene, capsys, name):
    old, new, words = BAD[name]
    assert old in SCENE
    scene.write_text(SCENE.replace(old, new, 1))
    told = answer_of(capsys, ["run", str(scene)], 2)
    assert told.out == ""
    assert words in one_sentence(told.err)
    assert "tank.toml" in told.err
    assert [path.name for path in scene.parent.iterdir()] == ["tank.toml"]  # nothing was begun


@pytest.mark.parametrize("arguments, words", [
    *rows(__file__, "bad_commands"),
    (["run", "tank.toml", "--output", "x" * 300, "--backend", "numpy"], "cannot be written"),
    (["run", "--resume", "x" * 300], "cannot be read"), (["plan", "x" * 300], "cannot be read"),
])  # fmt: skip
def test_bad_commands_get_one_sentence(scene, capsys, arguments, words):
    if "loop" in arguments:
        pathlib.Path("loop").symlink_to("loop")
    told = answer_of(capsys, ["--json" if a is None else a for a in arguments], 2)
    assert told.out == ""
    assert words in one_sentence(told.err)
    assert {path.name for path in scene.parent.iterdir()} <= {"tank.toml", "loop"}  # nothing was begun


ENDLESS = rows(__file__, "endless")
READER = """
import contextlib, io, json, pathlib, sys
from refsim.__main__ import main
for arguments, scene in json.load(sys.stdin):
    pathlib.Path("tank.toml").write_text(scene)
    with contextlib.redirect_stderr(io.StringIO()) as told:
        code = main(arguments)
    print(json.dumps([arguments, code, told.getvalue()]), flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="pipes and devices of POSIX")
@pytest.mark.parametrize("make", [os.mkfifo, lambda path: pathlib.Path(path).symlink_to("/dev/zero")])
def test_what_never_ends_is_not_read(tmp_path, make):
    """In a process of its own, which is ended where it waits."""
    for name in ("it", "it.npy", "it.obj"):
        make(tmp_path / name)
    head, liquid = "spacing = 0.1\nsupport_radius = 0.2\n", "\n[effects.weakly_compressible]\nsound_speed = 1.0\n"
    box = '[[fluid]]\nshape = "box"\ncells = [2, 2, 2]\n'
    given = [[words, head + ("" if "[[fluid]]" in part else box) + part + liquid] for words, part in ENDLESS]
    done = python("-c", READER, given=json.dumps(given), folder=tmp_path, seconds=60)
    told = list(map(json.loads, done.stdout.splitlines()))
    assert [words for words, _, _ in told] == [words for words, _ in ENDLESS], done.stderr
    for _, code, err in told:
        assert code == 2
        assert "it is a pipe or a device, and not a file" in one_sentence(err)


def array(kind, rows):
    """Bytes of an .npy file with the head of an array, and of no more numbers than six."""
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': ({rows}, 3), }}".encode().ljust(117)
    return b"\x93NUMPY\x01\x00v\x00" + head + b"\n" + bytes(48)


@pytest.mark.parametrize(
    "content, words",
    [
        (b"", "p.npy"), (b"\x93NUMPY", "p.npy"), (array("<f8", 99999999999), "p.npy"), (b"PK\x03\x04", "p.npy"),
        (b"\x80\x04K\x01.", "p.npy"), (array("<c16", 1), "list of coordinates"),
    ],
    ids=["none", "begun", "large", "zip", "pickle", "complex"],
)  # fmt: skip
def test_a_cloud_of_no_numbers_is_told(scene, capsys, content, words):
    pathlib.Path("p.npy").write_bytes(content)
    scene.write_text(SCENE.replace(BOX, 'shape = "cloud"\nfile = "p.npy"'))
    assert words in one_sentence(answer_of(capsys, ["plan", str(scene)], 2).err)


@pytest.mark.parametrize("cells, total, words", rows(__file__, "more_than_memory"))
@pytest.mark.parametrize("command", ["plan", "run"])
def test_more_than_memory_is_refused_with_the_spacing_that_fits(
    scene, capsys, monkeypatch, cells, total, words, command
):
    """Before particles are laid out, in the liquid and in walls, and where a run of them takes more than they do."""
    scene.write_text(SCENE.replace("6, 10, 1", cells))
    monkeypatch.setattr(solids, "host_memory", lambda: {"total": total, "free": total})
    sentence = one_sentence(answer_of(capsys, [command, str(scene)], 2).err)
    assert words in sentence
    fits = float(re.search(r"a spacing of (\S+) m fits", sentence)[1])
    assert 0.01 < fits < 0.03


@pytest.mark.skipif(unavailable("cuda") is None, reason="there is a GPU here")
def test_a_backend_that_is_not_there_is_told_with_its_reason(scene, capsys):
    err = one_sentence(answer_of(capsys, ["run", str(scene), "--backend", "cuda"], 2).err)
    assert unavailable("cuda") in err


def test_with_json_a_mistake_is_one_object_and_a_byte_order_mark_is_none(scene, capsys):
    told = answer_of(capsys, ["plan", "none.toml", "--json"], 2)
    found = json.loads(told.out)
    assert (found["exit_code"], found["reason"]) == (2, "bad_input")
    assert found["error"] in one_sentence(told.err)
    scene.write_bytes(b"\xef\xbb\xbf" + scene.read_bytes())
    assert answer_of(capsys, ["plan", str(scene)]).err == ""


# -- commands
def test_list_tells_the_registry(capsys):
    found = json.loads(answer_of(capsys, ["list", "--json"]).out)
    assert found["operations"].keys() == REGISTRY.keys()
    assert found["effects"].keys() == EFFECTS.keys()
    for name, operation in found["operations"].items():
        for backend in ("numpy", "cpu"):
            assert (backend in operation["programs"]) == callable(REGISTRY[name].program(backend))
    assert set(found["operations"]["sph.density"]["programs"]) == {*BACKENDS, "cuda:packed"}
    (speed,) = [p for p in found["effects"]["weakly_compressible"]["parameters"] if p["name"] == "sound_speed"]
    assert speed == {
        "name": "sound_speed", "default": None, "required": True, "meaning": "numerical sound speed c [m/s]",
    }  # fmt: skip
    assert "Jiang & Zhu 2023" in answer_of(capsys, ["list"]).out


def test_doctor_finds_the_backends_that_work(capsys):
    found = json.loads(answer_of(capsys, ["doctor", "--json"]).out)
    assert found["verdict"].startswith("pass")
    for name in ("numpy", "cpu"):
        test = found["self_test"][name]
        assert test["verdict"] == "pass"
        assert test["error_over_bound"] <= 1
    assert found["self_test"]["cpu"]["error_over_bound"] > 0
    assert found["backends"]["cuda"]["available"] == (unavailable("cuda") is None)
    assert {"numpy", "numba", "refsim"} <= found["versions"].keys()
    assert found["threads"]["most"] >= 1


def test_doctor_notices_wrong_numbers(capsys, monkeypatch):
    plain = doctor.run

    def wrong(operation, backend, *case):
        return replace(plain(operation, backend, *case), passed=backend != "cpu")

    monkeypatch.setattr(doctor, "run", wrong)
    out = answer_of(capsys, ["doctor"], 4).out
    assert "Verdict: fail: backend cpu computes wrong numbers" in out
    assert "WRONG" in out


def test_run_writes_a_folder_and_a_report(scene, capsys):
    wide = SCENE.replace("support_radius = 0.02", "support_radius = 0.026")
    scene.write_text(wide.replace("viscosity = 2.0", "viscosity = 3.0"))  # nothing is noted of it
    told = answer_of(capsys, ["run", str(scene), "--json"])
    found = json.loads(told.out)
    folder = scene.parent / "tank_run"
    names = ["checkpoint.h5", "checkpoint.previous.h5", "particles", "particles.pvd", "report.json"]
    assert sorted(p.name for p in folder.iterdir()) == names
    report = json.loads((folder / "report.json").read_text())
    for key in ("steps", "time", "backend", "versions", "step_limiters", "search", "ledger", "reason"):
        assert report[key] == found[key]
    assert report["reason"] is None
    assert report["time"] >= 0.04
    assert (sum(report["step_limiters"].values()), report["search"]["missed_neighbours"]) == (report["steps"], 0)
    assert report["search"]["audited_rows"] > 0
    start, end = report["ledger"]["start"], report["ledger"]["end"]
    assert end["particles"] == start["particles"] == 60
    assert (end["mass"], end["outside_walls"]) == (start["mass"], 0)
    assert end["momentum"][1] < 0
    assert end["kinetic_energy"] > 0 == start["kinetic_energy"]
    assert "60 particles" in told.err
    assert "100%" in told.err

    assert main(["run", str(scene), "--quiet"]) == 2  # an earlier run is not lost by a second command
    assert "--overwrite" in one_sentence(capsys.readouterr().err)
    told = answer_of(capsys, ["run", str(scene), "--quiet", "--overwrite"])
    assert told.err == ""
    assert "0 neighbours missed" in told.out
    assert "60 of 60" in told.out
    assert "nothing was left to do" in answer_of(capsys, ["run", "--resume", str(folder)]).err


def test_without_a_command_help_is_shown(capsys):
    out = answer_of(capsys, []).out
    discover()
    assert {"doctor", "list", "plan", "run", "schema"} <= COMMANDS.keys()
    assert all(name in out for name in COMMANDS)
    assert refsim.__version__ in answer_of(capsys, ["--version"]).out


def test_a_reader_that_goes_away_is_no_error():
    command = f"{sys.executable} -m refsim list | head -n 1; exit ${{PIPESTATUS[0]}}"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")


# Examples, a filtered list, and what the doctor says of errors
def test_example_replaces_no_file_unless_it_may(tmp_path, capsys):
    given = ["example", "droplet", "--output", str(tmp_path)]
    assert main(given) == 0
    (tmp_path / "droplet.toml").write_text("mine")
    assert "droplet.toml is there already" in answer_of(capsys, given, 2).err
    assert main([*given, "--overwrite"]) == 0
    assert "surface_tension" in (tmp_path / "droplet.toml").read_text()
    assert "did you mean droplet?" in answer_of(capsys, ["example", "dropplet"], 2).err
