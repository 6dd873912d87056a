"""Sweeps: what a file means, results that are computed once, runs that fail, and processes that are killed."""

import csv
import json

import pytest

from refsim import InputError
from refsim.__main__ import main
from refsim.cluster import perform
from refsim.io.store import write_stored
from refsim.study import runs, tasks
from refsim.sweep import TABLE, sweep
from tests.running import answer_of, rows
from tests.sweep.small_sweep import SCENE, SWEEP, files, killed_task, observable, points, same_bits, setting

VISCOSITY = "effects.weakly_compressible.dynamic_viscosity"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    return files(tmp_path, monkeypatch)


def test_a_grid_is_every_combination_and_a_list_what_it_says(folder):
    found = points(folder, SWEEP)
    set_to = [(p.scene.effects[0].dynamic_viscosity, p.scene.fluid[0].velocity[0]) for p in found]
    assert set_to == [(1.0, 0.0), (1.0, 0.1), (2.0, 0.0), (2.0, 0.1)]
    assert all(p.scene.effects[0].sound_speed == 20.0 for p in found)
    text = SWEEP.partition("[grid]")[0]
    found = points(folder, text + f'[[points]]\nspacing = 0.005\n[[points]]\n"{VISCOSITY}" = 3.0\nspacing = 0.02\n')
    assert [(p.scene.spacing, p.scene.effects[0].dynamic_viscosity) for p in found] == [(0.005, 2.0), (0.02, 3.0)]
    assert len(points(folder, text)) == 1


def test_seeds_are_set_wherever_the_scene_has_one(folder):
    text = SWEEP.partition("[grid]")[0] + "seeds = [3, 4]\n"
    text = text.replace('scene = "tank.toml"', 'scene = "mesh.toml"')
    (folder / "pebble.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    boundary = '\n[effects.mesh_boundary]\nfile = "pebble.obj"\nradius = 0.01\nfield_spacing = 0.01\n'
    (folder / "mesh.toml").write_text(SCENE.replace("dim = 2", "dim = 3") + boundary)
    found = points(folder, text)
    assert [p.scene.effects[-1].seed for p in found] == [3, 4]
    assert [p.values for p in found] == [{"seed": 3}, {"seed": 4}]
    with pytest.raises(InputError, match="no effect of the scene has a 'seed'"):
        points(folder, text.replace("mesh.toml", "tank.toml"))


@pytest.mark.parametrize("old, new, words", rows(__file__, "bad_sweeps"))
def test_a_bad_file_gets_a_sentence(folder, old, new, words):
    with pytest.raises(InputError, match=words) as told:
        points(folder, SWEEP.replace(old, new))
    assert "\n" not in str(told.value)


def test_what_was_computed_is_not_computed_again(folder, capsys):
    said = answer_of(capsys, ["sweep", "grid.toml", "--jobs", "2"])
    assert "4 runs, 4 of them computed now" in said.out
    assert "4 runs to do" in said.err
    assert "4 of 4, " in said.err
    rows = list(csv.DictReader((folder / "grid_sweep" / TABLE).read_text().splitlines()))
    alone = runs.measure(setting(folder, 3), observable(folder), threads=1)
    assert float(rows[3]["value"]) == alone.value
    (folder / "grid.toml").write_text(SWEEP.replace("[1.0, 2.0]", "[1.0, 2.0, 3.0]"))
    said = answer_of(capsys, ["sweep", "grid.toml", "--jobs", "2", "--json"])
    found = json.loads(said.out)
    assert found["computed"] == 2
    assert "2 runs to do, 4 are on file" in said.err
    assert [row["value"] for row in found["runs"]][:4] == [float(row["value"]) for row in rows]
    assert 0 < found["efficiency"] <= 1


FORGED = ["null", '"abc"', "1e999", '"nan"', "[1]"]


def test_a_result_that_holds_no_number_is_set_aside_and_computed_anew(folder, capsys):
    """Also one whose digest was made to fit; four files at a time."""
    before = sweep("grid.toml", folder="out", jobs=2)
    for part in (FORGED[:4], FORGED[4:]):
        files = sorted((folder / "out").glob("*.json"))[: len(part)]
        for file, changed in zip(files, part, strict=True):
            values = json.loads(file.read_text())
            del values["sha256"]
            values["reading"]["value"] = json.loads(changed)
            write_stored(file, values)
        assert main(["sweep", "grid.toml", "--output", "out", "--jobs", "1", "--quiet", "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["computed"] == len(found["notes"]) == len(part)
        assert [row["value"] for row in found["runs"]] == [reading.value for reading in before.readings]
        for file in files:
            assert any(f"{file.name} is damaged (it " in note for note in found["notes"])
            (folder / "out" / f"{file.name}.damaged").unlink()


def test_a_run_that_diverges_is_a_result_with_a_reason(folder, capsys):
    (folder / "grid.toml").write_text(SWEEP.replace("[0.1, 0.0", "[1e4, 0.0"))
    found = sweep("grid.toml", folder="out", jobs=2)
    assert [bool(r.failed) for r in found.readings] == [False, True, False, True]
    assert "a particle moves with 1e+04 m/s" in found.text()
    assert "4 runs, 4 of them computed now, 2 without a value" in found.text()
    assert sweep("grid.toml", folder="out").computed == 0
    (folder / "grid.toml").write_text(SWEEP.replace("[[0.0, 0.0, 0.0], [0.1, 0.0", "[[1e4, 0.0"))
    assert main(["sweep", "grid.toml", "--output", "out", "--quiet"]) == 3, "no run has a value"
    said = capsys.readouterr()
    assert "2 runs, 0 of them computed now, 2 without a value" in said.out
    assert said.err == ""


def test_a_killed_run_goes_on_from_its_checkpoint_with_the_same_bits(folder):
    (outcome,) = perform([killed_task(folder)], jobs=1)
    same_bits(folder, outcome)


def test_a_worker_with_other_sources_refuses(folder, monkeypatch):
    (work,) = tasks.task_of("key", setting(folder, 0), "kinetic_energy", folder).arguments
    monkeypatch.setattr(tasks, "source_digest", lambda: "other")
    with pytest.raises(InputError, match=r"the worker has another refsim.* than the caller \(sources"):
        tasks.compute(lambda share: None, work)
    assert not list(folder.glob("*.json"))


@pytest.mark.parametrize("name", ["own.py", "helper.py"])
def test_a_file_that_changes_before_its_run_leaves_no_result(folder, name):
    """The key is that of the file before."""
    (folder / "own.py").write_text("import helper\ndef f(simulation):\n    return 1.0\n")
    (folder / "helper.py").write_text("")
    (work,) = tasks.task_of("key", setting(folder, 0), "own.py:f", folder).arguments
    with open(folder / name, "a") as file:
        file.write("CHANGED = 1\n")
    with pytest.raises(InputError, match=r"a file that it reads has changed .* call it again"):
        tasks.compute(lambda share: None, work)
    assert not list(folder.glob("*.json"))


def test_a_run_that_was_not_computed_is_named(folder, monkeypatch, capsys):
    monkeypatch.setattr("refsim.cluster.pool.host_memory", lambda: {"total": 10, "free": 10})
    said = answer_of(capsys, ["sweep", "grid.toml", "--jobs", "2"], 3)
    assert "4 not computed" in said.out
    assert "of memory and 10 B are available" in said.out
    rows = list(csv.DictReader((folder / "grid_sweep" / TABLE).read_text().splitlines()))
    assert [row["value"] for row in rows] == [""] * 4
