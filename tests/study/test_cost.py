"""Seconds of a run from ten steps of its scene."""

import json

import pytest

from refsim import Box, BoxWalls, Gravity, InputError, Scene, Simulation, WeaklyCompressible, make_plan
from refsim.__main__ import main
from refsim.study import cost
from tests import tank_file


def tank(cells=10, **more):
    d = 0.1 / cells
    given = {
        "dim": 2, "spacing": d, "support_radius": 2.6 * d, "end_time": 0.1,
        "fluid": (Box(cells=(cells, 2 * cells, 1)),),
        "effects": (
            WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=1.1, state="tait", density="summation"),
            Gravity(acceleration=(0.0, -9.81, 0.0)), BoxWalls(lower=(0, 0, 0), upper=(0.4, 0.4, 0), open_faces=("+y",)),
        ),
    }  # fmt: skip
    return Scene(**(given | more))


def test_steps_are_those_of_the_run(monkeypatch):
    taken, own = [], Simulation.step
    monkeypatch.setattr(Simulation, "step", lambda self: taken.append(own(self)) or taken[-1])
    assert cost.measured(make_plan(tank(step=1e-4)), "numpy").steps == 1000
    assert len(taken) == cost.WARM + cost.STEPS
    scene = tank(end_time=0.01)
    run = Simulation(scene, "numpy")
    while run.time < scene.end_time:
        run.step()
    assert cost.measured(make_plan(scene), "numpy").steps == pytest.approx(run.steps, rel=0.05)


def test_the_command_times_the_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.toml").write_text(tank_file.tank(0.01, 6, 10))
    given = ["plan", "tank.toml", "--time", "--backend", "numpy"]
    assert main([*given, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["time"]
    assert found["processor"] == pytest.approx(found["steps"] * found["each"])
    assert found["wall"] == pytest.approx(found["ratio"] * found["processor"])
    assert main(given) == 0
    assert "one CPU thread, from 10 steps; later list builds" in capsys.readouterr().out
    monkeypatch.setattr(Simulation, "__init__", lambda *given: (_ for _ in ()).throw(InputError("no such backend.")))
    assert main(given) == 2
    assert "no such backend" in capsys.readouterr().err
