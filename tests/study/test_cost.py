"""The cost model against numbers worked out by hand, and its steps and list builds against a run."""

import dataclasses
import json
import math
import types

import msgspec
import pytest

from refsim import Box, BoxWalls, Gravity, Scene, Simulation, WeaklyCompressible, make_plan
from refsim.__main__ import main
from refsim.commands.plan import describe_plan
from refsim.scene.refine import refined
from refsim.study import cost
from refsim.study.waits import parts, waits
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


def made(backend="cpu", **more):
    """Constants as a machine could have given them: 1 s of a run whose particles move with 4 m/s in its second half."""
    course = cost.Course(
        spacing=0.02, particles=50, reached=0.1, history=[[0.05, 0.0, 0.0, 0.0], [0.1, 4.0, 0.0, 0.0]],
        steps=100, builds=20, seconds={"a": 2e-3, "neighbours": 3e-2, "seldom": 1e-5},
    )  # fmt: skip
    sizes = [(50, {"a": 1e-3, "neighbours": 1e-2}), (200, {"a": 3e-3, "neighbours": 4e-2})]
    return cost.Constants(backend, None, **({"course": course, "sizes": sizes, "measured_in": 1.0} | more))


def test_the_sum_by_hand():
    """800 particles: pass 'a' takes 3 ms + 600/150 of 2 ms, twice that over the course; lists 160 ms, three times."""
    plan = make_plan(tank(20))
    assert plan.grid.count == 800
    found = cost.estimate(plan, made())
    limits = plan.effects["weakly_compressible"].step_limits(plan.grid, plan.effects)
    acoustic = limits["acoustic"]
    assert (acoustic.speed, acoustic.speed_share) == (20.0, 1.0)
    steps = 0.05 * 20.0 / acoustic.length + 0.05 * 24.0 / acoustic.length
    assert found.steps == pytest.approx(steps, abs=1)
    assert found.builds == 1 + 19 * 4  # a quarter of the spacing
    assert found.stages["a"] == pytest.approx(steps * 2 * 11e-3)
    assert found.stages["neighbours"] == pytest.approx(77 * 3 * 160e-3)
    assert found.stages["seldom"] == pytest.approx(steps * 1e-5 * 800 / 50)
    assert found.seconds == pytest.approx(sum(found.stages.values()))
    assert found.bytes == describe_plan(plan, "cpu")["bytes"]["total"]
    assert found.note == ""


def test_an_iteration_whose_first_steps_differ_follows_the_course():
    """The procedure takes 8 ms a step over the course of 50 particles, whatever its first steps take."""
    plan = make_plan(tank(20))
    course = dataclasses.replace(made().course, seconds={"iisph.solve": 8e-3}, builds=0)
    for small, large, each in ((20e-3, 2e-3, 8e-3 * 16), (2e-3, 8e-3, 8e-3 * 16), (8e-3, 32e-3, 32e-3 + 24e-3 * 4)):
        sizes = [(50, {"iisph.solve": small}), (200, {"iisph.solve": large})]
        found = cost.estimate(plan, made(sizes=sizes, course=course))
        assert found.stages["iisph.solve"] / found.steps == pytest.approx(each, rel=1e-2)


def test_on_a_gpu_a_step_that_the_first_ones_do_not_tell_grows_as_they_do():
    """Steps of 50 and 200 particles take 3.0 and 3.2 ms: 800 take 4.0 ms, so that 30 ms of the course become 40 ms."""
    plan = make_plan(tank(20))
    course = dataclasses.replace(made().course, seconds={"step": 30e-3}, builds=0)
    sizes = [(50, {"step": 3.0e-3}), (200, {"step": 3.2e-3})]
    for backend, growth in (("cuda", 4.0 / 3.0), ("cpu", 16.0)):
        found = cost.estimate(plan, made(backend, sizes=sizes, course=course))
        assert found.stages["step"] / found.steps == pytest.approx(30e-3 * growth, rel=1e-2)


class Clocked:
    """A run on a GPU by its own clock: steps of 1 ms, 5 ms more with a list build; the first ones take longer.

    length  of a step [s]; first, more: number of the first ones, and how much longer they take [s]
    """

    def __init__(self, listed, length=1.0, first=2 * cost.FIRST, more=1e-3):
        self.search, self.now, self.new = (object() if listed else None), 0.0, False
        self.time, self.length, self.first, self.more = 0.0, length, first, more
        self.lists = types.SimpleNamespace(policy=types.SimpleNamespace(invalidate=lambda: setattr(self, "new", True)))

    def step(self):
        self.now += (6e-3 if self.new else 1e-3) + (self.more if self.time < self.first * self.length else 0.0)
        self.new = False
        self.time += self.length


@pytest.mark.parametrize("listed", (True, False))
def test_on_a_gpu_whole_steps_are_timed_with_and_without_a_list_build(monkeypatch, listed):
    """The median of so many steps that those which still record a graph do not count."""
    run = Clocked(listed)
    monkeypatch.setattr(cost.time, "perf_counter", lambda: run.now)
    monkeypatch.setattr(cost, "_iterates", lambda run: False)
    expected = {"step": 1e-3} | ({"neighbours": 5e-3} if listed else {})
    assert cost._whole_steps(run) == pytest.approx(expected)


def test_on_a_gpu_sizes_of_an_iteration_are_timed_over_the_same_flow(monkeypatch):
    """Steps of 7 ms until 8 s and of 1 ms later: their mean until 16 s is 4 ms, however many steps that takes."""
    monkeypatch.setattr(cost, "_iterates", lambda run: True)
    for finer in (1, 2, 4):
        run = Clocked(True, 1.0 / finer, 8 * finer, 6e-3)
        monkeypatch.setattr(cost.time, "perf_counter", lambda run=run: run.now)
        until = 0.0 if finer == 1 else 16.0
        assert (cost._whole_steps(run, until), run.time) == (pytest.approx({"step": 4e-3, "neighbours": 5e-3}), 16.0)
    long = Clocked(False)
    monkeypatch.setattr(cost.time, "perf_counter", lambda: long.now)
    cost._whole_steps(long, 16.0, budget=5e-3)
    assert long.time < 16.0  # such a size is left out


def test_limits_that_follow_the_spacing_otherwise():
    """Accelerations grow as 1/d, so that their step falls as d; diffusion's step falls as its square."""
    course = dataclasses.replace(made().course, history=[[0.05, 0.0, 1e5, 0.0], [0.1, 0.0, 1e5, 0.0]])
    few, many = (cost.estimate(make_plan(tank(n)), made(course=course)).steps for n in (10, 20))
    assert many == pytest.approx(2 * few, rel=0.01)
    thick = WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=2e5, density="summation")
    few, many = (cost.estimate(make_plan(tank(n, effects=(thick,))), made()).steps for n in (10, 20))
    assert many == pytest.approx(4 * few, rel=0.01)


def test_a_fixed_step_and_a_short_course():
    found = cost.estimate(make_plan(tank(20, step=1e-4)), made())
    assert found.steps == 1000
    short = dataclasses.replace(made().course, reached=0.05, history=[[0.025, 0.0, 0.0, 0.0], [0.05, 4.0, 0.0, 0.0]])
    found = cost.estimate(make_plan(tank(20)), made(course=short))
    assert found.builds == 1 + 19 * 4 * 2
    assert "was measured to 0.05 of 0.1 s" in found.note
    stopped = dataclasses.replace(made().course, stopped="In step 3 it diverged.")
    assert "In step 3" in cost.estimate(make_plan(tank(20)), made(course=stopped)).note


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setattr("refsim.backends.cache.cache_root", lambda: tmp_path)
    return tmp_path


def test_constants_are_kept_for_scene_backend_and_sources(cache):
    scene = tank()
    assert cost.load(scene, "cpu") is None
    cost.store(scene, made())
    assert cost.load(msgspec.structs.replace(scene, name="other"), "cpu") == made()
    assert cost.load(scene, "numpy") is None
    assert cost.load(scene, "cpu", threads=1) is None
    assert cost.load(tank(20), "cpu") is None
    (file,) = (cache / "cost").iterdir()
    file.write_text(file.read_text()[:100])
    assert cost.load(scene, "cpu") is None


def test_steps_and_builds_of_a_finer_scene():
    """Measured at 200 particles, predicted for 1,800, and held against that run."""
    scene = tank()
    constants = cost.calibrate(scene, "cpu", 1, budget=60.0)
    assert constants.course.reached >= scene.end_time
    fine = refined(scene, 3.0)
    found = cost.estimate(make_plan(fine), constants)
    simulation = Simulation(fine, "cpu", 1)
    while simulation.time < fine.end_time:
        simulation.step()
    assert found.steps == pytest.approx(simulation.steps, rel=0.05)
    assert (found.builds, found.particles) == (pytest.approx(simulation.search.log.rebuilds, rel=0.3), simulation.count)
    assert set(found.stages) >= {"sph.density", "sph.momentum", "neighbours", "other"}
    assert all(seconds >= 0 and math.isfinite(seconds) for seconds in found.stages.values())


SCENE = tank_file.tank(0.01, 6, 10)


def test_the_command_predicts_every_backend(cache, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.toml").write_text(SCENE)
    assert main(["plan", "tank.toml", "--time", "--json"]) == 0
    found = {each["backend"]: each for each in json.loads(capsys.readouterr().out)["time"]}
    assert set(found) == {"numpy", "cpu", "cuda"}
    for name in ("numpy", "cpu"):
        assert found[name]["seconds"] > 0
        assert found[name]["steps"] > 10
        assert found[name]["bytes"] > 0
        assert not found[name]["kept"]
    if found["cuda"]["seconds"] == "nan":
        assert found["cuda"]["note"]
    assert main(["plan", "tank.toml", "--time"]) == 0
    said = capsys.readouterr().out
    assert "Time of refsim run on this machine" in said
    assert main(["plan", "tank.toml", "--time", "--json"]) == 0
    assert all(each["kept"] for each in json.loads(capsys.readouterr().out)["time"] if each["backend"] != "cuda")


def test_a_run_says_beforehand_how_long_it_takes(cache, tmp_path, monkeypatch, capsys):
    """By the kept constants; a short run without any measures none."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.toml").write_text(SCENE)
    arguments = ["run", "tank.toml", "--backend", "numpy", "--overwrite"]
    assert main(arguments) == 0
    assert "the steps will take" not in capsys.readouterr().err
    assert (main(["plan", "tank.toml", "--time"]), main(arguments)) == (0, 0)
    assert "the steps will take about" in capsys.readouterr().err


def test_a_long_run_is_measured_before_it_begins(cache, monkeypatch):
    monkeypatch.setattr(cost, "LONG", 0.0)
    simulation = Simulation(tank(), "cpu", 1)
    whole = cost.seconds_left(simulation, 0.1, 1)
    assert whole > 0
    assert cost.load(tank(), "cpu", 1) is not None
    simulation.time = 0.075
    assert cost.seconds_left(simulation, 0.1, 1) == pytest.approx(whole / 4)
    assert cost.seconds_left(simulation, 0.05, 1) == 0.0


def test_what_is_waited_for_by_hand():
    """A process of 10 s on a processor that half worked for it: 5 s, of which 0.5 s load and 1 s step."""
    report = {"compiling": 1.0, "stages": {"a": 2.0, "frames": 0.4, "writing": 0.2, "checkpoints": 0.6}}
    found = parts(report, 6, used=5.0, took=10.0)
    assert found == pytest.approx({"start": 5 - 2.1, "loading": 0.5, "writing": 0.5 * (0.4 / 6 * 101 + 0.2 + 0.6)})
    each = cost.Prediction("cpu", 3.0, waits=found)
    assert each.whole == pytest.approx(3.0 + sum(found.values()))


def test_the_short_run_of_a_scene():
    """Its process starts, loads and writes; one that cannot run has no parts."""
    found = waits(make_plan(tank()), "cpu", 1)
    assert set(found) == {"start", "loading", "writing"}
    assert 0.1 < found["start"] < 60
    assert waits(make_plan(tank()), "no backend") == {}
