"""Results of a run in Python: frames, units, report and scene come back as they were."""

import json
import pathlib
import shutil
from contextlib import closing

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan, open_run, simulate
from refsim.core.errors import EXTRAS, extra
from refsim.io.checkpoint import read_checkpoint
from refsim.io.frames import ORIGIN, Frame, ParticleWriter, heads_of, read_arrays

GRID = np.stack(np.meshgrid(np.arange(4) * 0.01, np.arange(5) * 0.01), -1).reshape(-1, 2)


SCENE = rs.Scene(
    name="cloud", dim=2, dtype="float64", spacing=0.01, support_radius=0.025, end_time=2e-3, step=2e-4,
    fluid=(
        rs.Cloud(position=GRID + 0.1, velocity=(0.1, 0.2, 0.0)), rs.Ball(center=(0.3, 0.1, 0.0), radius=0.02),
    ),
    effects=(rs.WeaklyCompressible(sound_speed=10.0, density="summation"), rs.Gravity(acceleration=(0.0, -9.81, 0.0))),
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "drop"
    simulate(SCENE, backend="numpy", output=folder, every=4e-4)
    return folder


def shuffled(path):
    """A file whose two frames hold the particles in different orders, then one particle fewer."""
    random = np.random.default_rng(3)
    with closing(ParticleWriter(path, {"identity": (1, "int32"), "mark": (2, "float64")})) as writer:
        for k, n in enumerate((6, 6, 5)):
            order = random.permutation(n).astype(np.int32)
            position = np.stack([order, order + k, 0 * order], 1).astype(float)
            fields = {"identity": order, "mark": np.stack([order, -order], 1).astype(float)}
            writer.append([Frame(0.1 * k, position, fields)])
    return open_run(path)


def test_frames_by_number_and_time_are_those_of_the_file(folder):
    run, heads = open_run(folder), heads_of(folder / "particles.pvd")
    assert len(run) == len(heads) == 6
    assert run.times.tolist() == [head.time for head in heads]
    for found, head in zip(run, heads):
        expected = read_arrays(head, list(head.arrays))
        assert (found.time, len(found)) == (head.time, len(expected["position"]))
        assert found.fields.keys() == expected.keys()
        for name, values in expected.items():
            assert np.array_equal(found[name], values), name
            assert found[name].dtype == values.dtype == run.fields[name].dtype
    assert (run[-1].number, [frame.number for frame in run[1:5:2]]) == (5, [1, 3])
    assert [run.at(time).number for time in (0.0, 1.9e-4, 2.1e-4, 4e-4, run.times[-1])] == [0, 0, 1, 1, 5]


def test_units_and_meanings_stand_in_the_file(folder):
    plan, run = make_plan(SCENE), open_run(folder)
    assert run.fields.keys() == plan.particle_fields.keys()
    for name, field in run.fields.items():
        expected = plan.particle_fields[name]
        found = (field.unit, field.meaning, field.components)
        assert found == (expected.unit_in(2), expected.meaning, expected.components)
    saved = read_checkpoint(folder / "particles" / "origin.h5", ORIGIN)
    assert json.loads(saved.attributes["units"])["density"] == "kg/m^2"
    assert "[effects.gravity]" in saved.attributes["scene"]


def test_the_report_is_that_of_the_run(folder):
    report = open_run(folder).report
    assert report == json.loads((folder / "report.json").read_text())
    assert report["steps"] == 10
    assert report["ledger"]["start"]["mass"] == report["ledger"]["end"]["mass"]


def test_sorted_rows_are_the_same_particle_in_every_frame(tmp_path):
    run = shuffled(tmp_path / "mixed.pvd")
    assert run[0]["identity"].tolist() != sorted(run[0]["identity"])
    for k, frame in enumerate(run):
        by_identity = frame.sorted()
        n = len(frame)
        assert by_identity["identity"].tolist() == list(range(n))
        assert by_identity["mark"].tolist() == [[i, -i] for i in range(n)]
        assert (by_identity.position.tolist(), by_identity.time) == ([[i, i + k, 0] for i in range(n)], frame.time)


def test_errors_say_what_and_where(folder, tmp_path):
    run = open_run(folder)
    with pytest.raises(rs.InputError, match="no field 'densty'; did you mean density"):
        run[0]["densty"]
    with pytest.raises(IndexError, match="no frame 6; give a number from 0 to 5"):
        run[6]
    with pytest.raises(rs.InputError, match=r"no frame at 1 s; give 0 to 0\.002 s"):
        run.at(1.0)
    with pytest.raises(rs.InputError, match="there are no frames"):
        open_run(tmp_path)
    shutil.copytree(folder / "particles", tmp_path / "particles")
    alone = open_run(tmp_path / "particles.pvd")
    with pytest.raises(rs.InputError, match=r"report .*report\.json cannot be read"):
        _ = alone.report
    with pytest.raises(rs.InputError, match="do not say their scene"):
        shuffled(tmp_path / "mixed.pvd").scene  # noqa: B018
    (tmp_path / "report.json").write_text("{")
    with pytest.raises(rs.InputError, match="is damaged"):
        _ = alone.report


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyvista", None)
    with pytest.raises(rs.InputError, match="needs the package pyvista, which is not installed; run pip install pyv"):
        extra("pyvista", "a picture")
    listed = (pathlib.Path(__file__).parents[2] / "setup.cfg").read_text().partition("[options.extras_require]")[2]
    for package, name in EXTRAS.items():
        section = listed.partition(f"\n{name} =\n")[2].partition(" =\n")[0]
        assert f"    {package}>=" in section
