"""`Simulation.field`: every field belongs to the present state, and reading changes nothing of the run."""

import numpy as np
import pytest

import refsim as rs
from refsim import simulate
from refsim.core.errors import InputError
from refsim.engine import launching
from refsim.engine.checkpoints import load_checkpoint
from refsim.engine.launching import refresh
from tests.running import advanced

D = 0.05


def dam(*effects, **changes):
    walls = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(2.0, 2.0, 0.0))
    liquid = rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=2.0, density="summation")
    own = (liquid, rs.Gravity(acceleration=(0.0, -9.81, 0.0)), walls, rs.SurfaceDetection(), *effects)
    values = {"fluid": (rs.Box(cells=(8, 10, 1)),), "effects": own}
    return rs.Scene(dim=2, spacing=D, support_radius=2.6 * D, end_time=1.0, **values | changes)


def begun(backend, steps, **changes):
    made = rs.Simulation(dam(**changes), backend)
    advanced(made, steps)
    return made


def launches(run, call):
    """Operations that a call launches."""
    seen = []
    original = run.timings.run
    run.timings.run = lambda name, launch: (seen.append(name), original(name, launch))
    call()
    del run.timings.run
    return seen


def test_a_reading_launches_what_its_field_needs_and_once():
    run = begun("cpu", 2)
    for name, field in run.plan.fields.items():
        if field.state:
            assert launches(run, lambda name=name: run.field(name)) == [], name
    assert launches(run, lambda: run.field("density")) == ["sph.density"]
    assert launches(run, lambda: run.field("density")) == []
    scan = ["sph.density", "surface_detection.candidates", "surface_normal.color_gradient"]
    assert launches(run, lambda: run.field("surface")) == [*scan, "surface_detection.fan_scan"]
    assert (launches(run, lambda: refresh(run)).count("sph.density"), launches(run, lambda: refresh(run))) == (1, [])
    assert launches(run, lambda: refresh(run, on_demand=True)) == []
    assert launches(run, run.evaluate).count("sph.density") == 1
    run.step()
    assert launches(run, lambda: run.field("density")) == ["sph.density"]


def test_a_frame_and_a_checkpoint_of_one_state_take_one_evaluation(tmp_path, monkeypatch):
    passes = []
    original = launching.launch

    def launch(run, only=None):
        passes.append(only)
        return original(run, only)

    monkeypatch.setattr(launching, "launch", launch)
    scene = dam(step=1e-3)
    simulate(scene, 2e-3, backend="numpy", output=tmp_path, every=1e-3, checkpoint_every=0.0)
    steps, evaluations = passes.count(None), len(passes) - passes.count(None)
    assert steps == 2
    assert evaluations == 1 + steps


def test_what_is_set_outdates_what_follows_from_it(tmp_path):
    run = begun("numpy", 3)
    before = run.field("density")
    run.set_field("position", 1.02 * run.field("position"))
    assert run.field("density").mean() < 0.99 * before.mean()
    run.set_field("mass", 1.2 * run.field("mass"))
    assert run.field("density").mean() > 1.1 * before.mean()
    run.checkpoint(tmp_path / "saved")
    resumed = rs.Simulation.resume(tmp_path / "saved")
    assert resumed.field("density").tobytes() == run.field("density").tobytes()
    assert load_checkpoint(tmp_path / "saved").clock.steps == 3


def test_what_only_a_step_computes_is_refused_before_the_first(tmp_path):
    effects = (rs.WeaklyCompressible(sound_speed=20.0, density="summation"), rs.ImplicitPressure())
    run = rs.Simulation(dam(effects=effects), "numpy")
    assert run.field("density").min() > 0
    for name in ("diagonal", "advected_density"):
        with pytest.raises(InputError, match=f"field: '{name}' is computed in a step, and there was none yet"):
            run.field(name)
    run.step()
    assert np.abs(run.field("diagonal")).max() > 0
    report = simulate(dam(effects=effects), 1e-3, backend="numpy", output=tmp_path, every=5e-4)
    assert report.reason is None
