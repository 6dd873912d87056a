"""`refsim contract --run`: a trajectory of another code against refsim's, with the scene's chaos as the yardstick."""

import importlib.util
import json

import numpy as np
import pytest

from refsim.__main__ import main
from refsim.contract import whole_runs
from refsim.engine.simulation import Simulation
from refsim.io.vtp import write_vtp
from refsim.scene.files import load_scene

SCENE = """
name = "small dam break"
dim = 2
dtype = "float64"
spacing = 0.02
support_radius = 0.052
end_time = 1.0
[[fluid]]
shape = "box"
lower = [0.0, 0.0, 0.0]
cells = [6, 8, 1]
[effects.weakly_compressible]
sound_speed = 15.0
dynamic_viscosity = 1.0
[effects.gravity]
acceleration = [0.0, -9.81, 0.0]
"""
STEPS = 40


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """(scene file, snapshots): refsim's references as the other code, from a third shaken start."""
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(SCENE)
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
    return path, found[:-1]


def written(folder, frames):
    folder.mkdir()
    for number, frame in enumerate(frames):
        np.savez(folder / f"frame_{number:04d}.npz", **frame)
    return str(folder)


def judged(capsys, scene, *arguments):
    code = main(["contract", "--run", str(scene), *arguments, "--backend", "numpy", "--json"])
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
    assert max(centre["refsim"]) - min(centre["refsim"]) > 0
    assert centre["allowed"] == pytest.approx(3 * (max(centre["refsim"]) - min(centre["refsim"])))


def test_a_slip_is_found(other, tmp_path, capsys):
    """Gravity stronger by 1e-4 of itself moves the centre by much more than three starts differ."""
    scene, frames = other
    wrong = [dict(frame, position=frame["position"] - [0, 0.5e-4 * 9.81 * frame["time"] ** 2, 0]) for frame in frames]
    folder = written(tmp_path / "run", wrong)
    code, _, measures = judged(capsys, scene, folder)
    assert code == 4
    assert not measures["centre y"]["holds"]
    assert measures["spread y"]["holds"]
    assert main(["contract", "--run", str(scene), folder, "--backend", "numpy"]) == 4
    out = capsys.readouterr().out
    (line,) = (line for line in out.splitlines() if line.startswith("centre y"))
    assert line.endswith("FAILS")
    code, _, measures = judged(capsys, scene, folder, "--within", "1e9")
    assert code == 0


def test_vtk_files_are_read(other, tmp_path):
    if importlib.util.find_spec("vtkmodules") is None:
        pytest.skip("vtk is not installed")
    _, frames = other
    sets = ""
    for number, frame in enumerate(frames[:3]):
        write_vtp(tmp_path / f"f{number}.vtp", frame["position"], velocity=frame["velocity"], mass=frame["mass"])
        sets += f'<DataSet timestep="{frame["time"]!r}" file="f{number}.vtp"/>'
    (tmp_path / "all.pvd").write_text(f'<VTKFile type="Collection"><Collection>{sets}</Collection></VTKFile>')
    found = whole_runs.trajectory(tmp_path)
    assert [snapshot.time for snapshot in found] == [frame["time"] for frame in frames[:3]]
    for snapshot, frame in zip(found, frames):
        for name in ("position", "velocity", "mass"):
            assert np.array_equal(getattr(snapshot, name), frame[name])
    (tmp_path / "all.pvd").unlink()
    with pytest.raises(whole_runs.InputError, match="has no time; give the field data TimeValue"):
        whole_runs.trajectory(tmp_path)


def test_frames_without_velocity_and_mass_are_judged_by_position(other, tmp_path, capsys):
    scene, frames = other
    folder = written(tmp_path / "run", [{k: f[k] for k in ("time", "position")} for f in frames])
    code, _, measures = judged(capsys, scene, folder, "--at", f"{frames[20]['time']!r}")
    assert code == 0, measures
    assert "potential energy" in measures
    assert "kinetic energy" not in measures


@pytest.mark.parametrize("asked", ["0.0300172", "0.030017216"])
def test_a_time_as_printed_finds_the_only_frame(asked, other, tmp_path, capsys):
    """Of a frame at 0.03001722 s; a time that lies farther away is told with all its digits."""
    scene, frames = other
    folder = written(tmp_path / "run", [{"time": 0.03001722, "position": frames[-1]["position"]}])
    judged(capsys, scene, folder, "--at", asked)
    assert main(["contract", "--run", str(scene), folder, "--at", "0.0300175"]) == 2
    assert "has no frame at 0.0300175 s; the nearest is at 0.03001722 s" in capsys.readouterr().err


BAD = {
    "no folder": ((), {}, "there is no folder"),
    "no frames": ((), {"mine.txt": None}, "has no frames; give npz, vtp, vtu or vtk files"),
    "no position": ((), {"a.npz": {"time": 1.0}}, "has no array 'position'"),
    "shape": ((), {"a.npz": {"time": 1.0, "position": np.zeros((4, 2))}}, "position has shape (4, 2); it needs (4, 3)"),
    "not finite": ((), {"a.npz": {"time": 1.0, "position": np.full((4, 3), np.nan)}}, "that are not finite"),
    "start": ((), {"a.npz": {"time": 0.0, "position": np.zeros((4, 3))}}, "is the start; give a later time"),
    "time": (("--at", "3"), {"a.npz": {"time": 1.0, "position": np.zeros((4, 3))}}, "has no frame at 3 s"),
    "at": (("--at", "-1"), {}, "--at = -1 is not possible"),
    "within": (("--within", "0"), {}, "--within = 0 is not possible"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_gets_one_sentence(name, other, tmp_path, capsys):
    options, files, said = BAD[name]
    folder = tmp_path / "run"
    if files:
        folder.mkdir()
    for file, arrays in files.items():
        (folder / file).write_text("mine") if arrays is None else np.savez(folder / file, **arrays)
    assert main(["contract", "--run", str(other[0]), str(folder), *options]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1
