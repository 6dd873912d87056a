"""`refsim contract --run`: a trajectory of another code against refsim's, with the scene's chaos as the yardstick."""

import importlib.util
import json
import math
import pathlib

import numpy as np
import pytest

from refsim import Box, BoxWalls, Gravity, Scene, WeaklyCompressible
from refsim.__main__ import main
from refsim.contract.trajectories import trajectory
from refsim.contract.whole_runs import Comparison, untouched
from refsim.core.errors import InputError
from refsim.engine.simulation import Simulation
from refsim.io.frames import vtp_bytes
from refsim.scene.files import load_scene
from tests.running import answer_of, rows

SCENE = pathlib.Path(__file__).with_name("dam_break.toml").read_text()
STEPS = 40


def run_of(path):
    """Snapshots of a run of refsim's references, as of another code, from a third shaken start."""
    simulation = Simulation(load_scene(path), "numpy")
    position = simulation.field("position")
    shift = np.random.default_rng(7).uniform(-2e-8, 2e-8, position.shape) * [1, 1, 0]
    simulation.set_field("position", position + shift)
    found, length = [], 0.0
    for _ in range(STEPS):
        simulation.step()
        now = {name: simulation.field(name) for name in ("position", "velocity", "mass")}
        if found:  # the velocity is that of half a step before
            share = length / (length + simulation.previous_length)
            found[-1]["velocity"] += share * (now["velocity"] - found[-1]["velocity"])
        length = simulation.previous_length
        found.append({"time": simulation.time} | now)
    return found[:-1]


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """(scene file, snapshots)"""
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(SCENE)
    return path, run_of(path)


def written(folder, frames):
    folder.mkdir()
    for number, frame in enumerate(frames):
        np.savez(folder / f"frame_{number:04d}.npz", **frame)
    return str(folder)


def judged(capsys, scene, *arguments):
    code = main(["contract", "--run", str(scene), *arguments, "--backend", "numpy", "--json", "--without-sensitivity"])
    said = capsys.readouterr()
    assert said.err == ""
    found = json.loads(said.out)
    return code, found, {m["name"]: m for m in found["measures"]}


def test_a_run_of_the_same_equations_holds(other, tmp_path, capsys):
    scene, frames = other
    code, found, measures = judged(capsys, scene, written(tmp_path / "run", frames))
    assert found["time"] == frames[-1]["time"]
    assert {"centre x", "spread y", "largest x", "momentum y", "kinetic energy", "potential energy"} <= set(measures)
    assert code == 0, [m for m in measures.values() if not m["holds"]]
    centre = measures["centre y"]
    assert found["coarser"] == 0.04
    assert centre["chaos"] >= 3 * (max(centre["refsim"]) - min(centre["refsim"])) > 0
    assert centre["allowed"] == max(centre["chaos"], centre["resolution"])
    assert {m["verdict"] for m in measures.values()} == {"holds"}


def test_what_a_run_does_not_touch_is_named():
    """A box whose floor is reached, whose left wall just is, whose upper face is open; an effect beside another."""
    scene = Scene(
        dim=2, spacing=0.02, support_radius=0.05, fluid=(Box(cells=(6, 8, 1)),),
        effects=(
            WeaklyCompressible(sound_speed=15.0), Gravity(),
            BoxWalls(lower=(-0.05, 0.0, 0.0), upper=(1.0, 1.0, 0.0), open_faces=("+y",)),
        ),
    )  # fmt: skip
    curves = {"smallest x": [0.3, 0.0], "largest x": [0.5, 0.9], "smallest y": [0.5, 0.2], "largest y": [0.6, 0.5]}
    compared = Comparison(0.1, [], "", [0.0, 0.1], curves, {}, (0.1, ""), ["middle"])
    found = {"gravity.acceleration": 1e-3, "weakly_compressible.sound_speed": math.inf}
    told = untouched(scene, compared, found)
    assert told == ["effect weakly_compressible", "box_walls +x", "box_walls -y", "gauge middle"]
    known = found | {"weakly_compressible.viscosity": 0.1}
    near = compared._replace(curves={"largest x": [0.97], "smallest y": [0.01]}, still=[])
    assert untouched(scene, near, known) == []


def test_a_slip_is_found(other, tmp_path, capsys):
    """Gravity stronger by 1e-4 of itself moves the centre by much more than three starts differ; resolution by more."""
    scene, frames = other
    wrong = [dict(frame, position=frame["position"] - [0, 0.5e-4 * 9.81 * frame["time"] ** 2, 0]) for frame in frames]
    folder = written(tmp_path / "run", wrong)
    code, found, measures = judged(capsys, scene, folder, "--chaos-only")
    assert (code, found["coarser"]) == (4, "")
    assert not measures["centre y"]["holds"]
    assert measures["spread y"]["holds"]
    out = answer_of(capsys, ["contract", "--run", str(scene), folder, "--backend", "numpy", "--chaos-only"], 4).out
    least = {line.split()[0]: line.split()[1] for line in out.splitlines() if line.startswith(("gravity", "weakly"))}
    assert float(least["gravity.acceleration"]) < 1e-4  # which is the slip
    assert float(least["gravity.acceleration"]) < float(least["weakly_compressible.sound_speed"])
    assert "The chaos decides up to" in out
    (line,) = (line for line in out.splitlines() if line.startswith("centre y"))
    assert line.endswith("FAILS")
    code, _, measures = judged(capsys, scene, folder, "--within", "1e9", "--chaos-only")
    assert code == 0
    code, _, measures = judged(capsys, scene, folder)
    assert code == 0
    centre = measures["centre y"]
    assert (centre["verdict"], centre["chaos"] < centre["difference"] <= centre["resolution"]) == (
        "within resolution", True,
    )  # fmt: skip


def test_vtk_files_are_read(other, tmp_path):
    if importlib.util.find_spec("pyvista") is None:
        pytest.skip("pyvista is not installed")
    _, frames = other
    sets = ""
    for number, frame in enumerate(frames[:3]):
        content = vtp_bytes(frame["position"], {name: frame[name] for name in ("velocity", "mass")})
        (tmp_path / f"f{number}.vtp").write_bytes(content)
        sets += f'<DataSet timestep="{frame["time"]!r}" file="f{number}.vtp"/>'
    (tmp_path / "all.pvd").write_text(f'<VTKFile type="Collection"><Collection>{sets}</Collection></VTKFile>')
    found = trajectory(tmp_path)
    assert [snapshot.time for snapshot in found] == [frame["time"] for frame in frames[:3]]
    for snapshot, frame in zip(found, frames):
        for name in ("position", "velocity", "mass"):
            assert np.array_equal(getattr(snapshot, name), frame[name])
    (tmp_path / "all.pvd").unlink()
    with pytest.raises(InputError, match="has no time; write times"):
        trajectory(tmp_path)


BAD = rows(__file__, "bad_runs")


@pytest.mark.parametrize("name", BAD)
def test_bad_input_gets_one_sentence(name, other, tmp_path, capsys):
    options, files, said = BAD[name]
    folder = tmp_path / "run"
    if files:
        folder.mkdir()
    for file, given in files.items():
        arrays = {key: np.full(value[:2], value[2]) if key == "position" else value for key, value in given.items()}
        np.savez(folder / file, **arrays) if arrays else (folder / file).write_text("mine")
    err = answer_of(capsys, ["contract", "--run", str(other[0]), str(folder), *options], 2).err
    assert said in err
    assert err.count("\n") == 1
