"""Studies of made readings, their orders, pictures and clocks; seconds of a run; what observables and reports say."""

import importlib
import json
import math
import types
from dataclasses import replace

import msgspec
import numpy as np
import pytest

import refsim as rs
from refsim import Box, BoxWalls, Gravity, InputError, Scene, Simulation, WeaklyCompressible, make_plan
from refsim.commands.plan import describe_plan
from refsim.core import clock as clocks
from refsim.core import errors
from refsim.core.clock import Compiling
from refsim.engine import timings
from refsim.scene import solids
from refsim.scene.refine import refined
from refsim.study import cost, runs, tasks
from refsim.study.convergence import Convergence, Reference, converge
from refsim.study.observables import observable_of
from refsim.study.panels import measured, panel
from refsim.study.result import Study
from refsim.study.runs import Reading, Setting
from tests import tank_file
from tests.running import advanced, answer_of, rows

KINDS = ("spacing", "spacing", "spacing", "spacing", "support", "step", "precision", "tolerance", "backend", "effect")


def reading(random, value, seconds=None, **more):
    given = {
        "value": value, "seconds": float(random.uniform(0.5, 90)) if seconds is None else seconds,
        "wall": float(random.uniform(1, 200)), "bytes": int(random.integers(1e6, 1e9)),
        "particles": int(random.integers(100, 1e6)), "steps": int(random.integers(10, 1e5)), "time": 0.1,
        "mass": float(random.uniform(1, 1000)),
    }  # fmt: skip
    return Reading(**(given | more))


def study(seed):
    """A study of drawn readings: with and without an order, failures, a reference, other precisions."""
    random, scene = np.random.default_rng(seed), tank(dtype=("float32", "float64")[seed % 2])
    order, limit, made = (1.0, 1.7, 2.6, 0.2)[seed % 4], (4.0, -2.0, 0.5)[seed % 3], []
    for k, kind in enumerate(KINDS[seed % 5 == 4 :]):
        factor = (0.5, 1.0, 2.0, 3.0)[k] if kind == "spacing" else 1.0
        size = 1e-3 if seed % 7 == 3 else 0.1
        value = limit + size * factor**-order * (-1) ** (k * (seed % 6 == 5))
        value += 0.0 if kind == "spacing" else float(random.normal()) * size * 0.3
        at = refined(scene, factor) if factor != 1 else scene
        if kind == "precision":
            at = msgspec.structs.replace(scene, dtype=("float64", "float32")[seed % 2])
        of = reading(random, value, 3.0 * factor**3)
        if kind == "step" and seed % 3 == 1:
            of = replace(of, failed="In step 7 it stopped.", value=math.nan)
        if kind == "support" and seed % 2:
            of = replace(of, unsettled="its two fastest of 6 runs differ by 12 %")
        made.append((Setting(kind, f"{kind} {k}", factor, at, "cuda" if kind == "backend" else "cpu"), of))
    worked = [(s.scene.spacing, r.value) for s, r in made if s.kind == "spacing" and not r.failed]
    given = Reference(limit * 1.01, (abs(limit), 2.5)[seed % 2], (0.0, 0.02)[seed % 4 // 2], "a solution")
    reference = given if seed % 3 == 2 else None
    found = converge(*zip(*worked)) if worked else None
    found = replace(found, scale=reference.scale) if reference else found
    return Study(
        scene, "front", ("m", "")[seed % 2], tuple(made), found, (0.05, 0.3, 0.004)[seed % 3], ("a note",), "here",
        1 + seed % 2, ("one thing left out",), reference,
    )  # fmt: skip


def drawn(figure):
    """The numbers of a picture: of its lines, bars, texts, axes and legends."""
    figure.draw_without_rendering()
    found = {}
    for number, axes in enumerate(figure.axes):
        found[f"lines {number}"] = [np.array(line.get_xydata()) for line in axes.lines]
        found[f"bars {number}"] = [bar.get_bbox().bounds for bar in axes.patches]
        found[f"areas {number}"] = [path.vertices for area in axes.collections for path in area.get_paths()]
        found[f"texts {number}"] = [(text.get_text(), text.get_position()[1]) for text in axes.texts]
        legend = axes.get_legend()
        found[f"words {number}"] = [
            axes.get_title(), axes.get_xlabel(), axes.get_ylabel(), axes.get_xscale() == "linear",
            axes.get_yscale() == "log", axes.get_xlim(), axes.get_ylim(),
            [] if legend is None else [text.get_text() for text in legend.get_texts()],
        ]  # fmt: skip
    return found


@pytest.mark.parametrize("seed", range(12))
def test_a_study_of_made_readings_says_and_draws_as_ever(seed, recorded):
    made = study(seed)
    found = {"text": made.text(), "data": made.data(), "rows": made.rows(), "picture": drawn(made.plot())}
    found |= {f"cheapest for {error}": made.cheapest(error) for error in (1e-4, 0.01, 0.1, 0.5)}
    recorded(found)


def test_orders_of_drawn_values_are_as_ever(recorded):
    random, found = np.random.default_rng(2), {}
    for k in range(60):
        count, order = int(random.integers(1, 6)), random.uniform(0.2, 3.5)
        h = np.sort(random.uniform(0.5, 4.0, count))
        q = random.normal() + random.normal() * h**order + (k % 3 == 0) * 0.02 * random.normal(size=count)
        made = converge(h, q)
        made = replace(made, scale=float(k % 2) * 0.7)
        found[str(k)] = (made, made.bound(float(q[-1])), made.error(0.3), made.relative)
    assert Convergence(0.0, 1.0, 1.0, True, "").error(0.1) == math.inf
    assert Convergence(0.0, 1.0, 1.0, True, "").error(0.0) == 0
    recorded(found)


# Clocks, which a test sets
class Clock:
    """Time that passes only where it is told to."""

    def __init__(self):
        self.wall, self.processor = 100.0, 7.0

    def __call__(self, wall, processor=0.0):
        self.wall, self.processor = self.wall + wall, self.processor + processor

    def set_in(self, monkeypatch, *modules):
        own = types.SimpleNamespace(perf_counter=lambda: self.wall, process_time=lambda: self.processor)
        for module in modules:
            monkeypatch.setattr(module, "time", own)


@pytest.mark.parametrize("gpu", [False, True])
def test_seconds_of_a_study_are_those_of_steps_without_what_first_calls_take(tmp_path, monkeypatch, gpu):
    """Ten steps of 3 s of the clock and 2 s of the processor, of which the first spends a third of it on compiling."""
    clock, calls, done = Clock(), {"old": 50.0}, []

    def step():
        clock(3.0, 2.0)
        if not done:
            calls["new"] = 1.0
        done.append(run.time)
        run.time += 0.1
        run.steps += 1

    scene = types.SimpleNamespace(end_time=1.0)
    run = types.SimpleNamespace(
        step=step, steps=0, time=0.0, plan=types.SimpleNamespace(scene=scene),
        backend=types.SimpleNamespace(name="cuda" if gpu else "cpu"), timings=types.SimpleNamespace(first_calls=calls),
        checkpoint=lambda path: path.write_bytes(b""),
    )  # fmt: skip
    clock.set_in(monkeypatch, runs)
    seen, kept = [], tmp_path / "kept"
    timed = runs._Clock(run, seen.append, kept, 10.0)
    for k in range(10):
        timed.step()
        assert kept.is_dir() == (k >= 3)  # at 12 s, as the fourth step ends
    assert (timed.wall, timed.seconds) == pytest.approx((29.0, 29.0 if gpu else 20 - 2 / 3))
    assert seen == [run] * 10
    assert timed.kept_at == pytest.approx(100.0 + 24.0)  # nor at the end
    again = runs._Clock(run, None, kept, 10.0)
    assert (again.seconds, again.wall) == pytest.approx((23.0 if gpu else 16 - 2 / 3, 23.0))
    run.steps = 0
    assert runs._Clock(run, None, kept, 10.0).wall == 0  # of a run that begins anew
    run.step = lambda: None
    timed.step()
    assert timed.wall == pytest.approx(29.0)  # where the clock did not go on


def test_a_value_is_reached_between_two_looks():
    """Of a run of 0.3 s a step looks are 5 s apart at the least: by a straight line between those about the value."""
    for values, reaches, expected in (
        (lambda t: 2 + t**2, 40.0, (5.1, 10.2)), (lambda t: 2 - t**2, -40.0, (5.1, 10.2)), (lambda t: 7.0, 7.0, None),
        (lambda t: t, 9000.0, "only 2000"), (lambda t: -t, -9000.0, "only -2000"),
        (lambda t: 2.0 * (t > 1999.8), 1.0, (1999.2, 2000.1)),
    ):  # fmt: skip
        run = types.SimpleNamespace(time=0.0, plan=types.SimpleNamespace(scene=types.SimpleNamespace(end_time=2000.0)))
        looks, clock = [], types.SimpleNamespace(step=lambda run=run: setattr(run, "time", round(run.time + 0.3, 9)))
        observable = lambda run, v=values, looks=looks: (looks.append(run.time), v(run.time))[1]  # noqa: E731
        observable.name = "own"
        if isinstance(expected, str):
            with pytest.raises(errors.InputError, match=expected):
                runs._when(run, observable, reaches, clock)
            assert np.diff(looks[:-1]).min() >= 2000 / runs.SAMPLES * (1 - 1e-9)
        elif expected is None:
            assert runs._when(run, observable, reaches, clock) == 0.0
        else:
            a, b = expected
            line = a + (reaches - values(a)) / (values(b) - values(a)) * (b - a)
            assert runs._when(run, observable, reaches, clock) == pytest.approx(line)
            assert looks[-2:] == pytest.approx([a, b])


def test_tolerances_end_an_iteration_and_a_scene_that_cannot_be_planned_takes_no_seconds():
    settings = importlib.import_module("refsim.study")._settings  # refsim.study is a function, too
    heat = rs.HeatConduction(temperature=(1.0,), conductivity=1.0, heat_capacity=1.0, tolerance=0.1)
    effects = (*tank().effects[:2], rs.ImplicitPressure(tolerance=0.002), heat)
    expected = [(2, "tolerance", 0.002), (3, "tolerance", 0.1)]
    made = [settings(tank(effects=e), None, (), ("tolerance",), (), "numpy", []) for e in (effects, tank().effects)]
    labels = [f"{effects[k].name}: {name} {value / 10:g}" for k, name, value in expected]
    assert [[setting.label for setting in each] for each in made] == [labels, []]
    stored = panel("implicit_pressure")
    point = next(p for p in stored.points.values() if p.program == "refsim" and not p.gpu)
    scene = tank(support_radius=1e-9)
    found = measured.reading_of(stored, point, scene)
    assert found.failed
    assert [found.seconds, found.wall, found.bytes, found.particles, found.steps, found.time] == [0] * 6
    setting = Setting("spacing", "", 1.0, scene, "numpy")
    assert repr(runs._run(setting, None, None, None, None, None, 1.0)) == repr(found)  # NaN is not itself


@pytest.mark.parametrize("step, longest", [(0.0, {"step_factor": 0.4}), (1e-4, {"step": 5e-5})])
def test_a_setting_of_a_study_changes_one_thing(step, longest, monkeypatch):
    module = importlib.import_module("refsim.study")
    monkeypatch.setattr(module, "unavailable", {"cpu": None, "cuda": "no card"}.get)
    a, b, c = tank().effects
    solver = rs.ImplicitPressure(tolerance=0.002)
    scene, left_out = tank(step=step, step_factor=0.8, effects=(a, solver, b, c)), []
    plan, knobs = types.SimpleNamespace(list_radius=1), ("support", "step", "precision", "tolerance", "backend")
    made = module._settings(scene, plan, (1.0,), knobs, (), "numpy", left_out)
    tighter = msgspec.structs.replace(solver, tolerance=0.0002)
    expected = [
        ("spacing", {}), ("support", {"support_radius": 1.25 * scene.support_radius}), ("step", longest),
        ("precision", {"dtype": "float64"}), ("tolerance", {"effects": (a, tighter, b, c)}), ("backend", {}),
    ]  # fmt: skip
    assert made == [
        Setting(kind, own.label, 1.0, msgspec.structs.replace(scene, **other), "cpu" if kind == "backend" else "numpy")
        for own, (kind, other) in zip(made, expected, strict=True)
    ]
    plan.list_radius = 0
    assert not module._settings(scene, plan, (), ("support", "backend"), (), "cpu", left_out)
    assert [words.split()[-1] for words in left_out] == ["card", "neighbours", "card"]
    levels = [s.scene for s in module._settings(tank(), plan, (0.5, 1.0, 2.0), (), (), "cpu", [])]
    assert levels == [refined(tank(), 0.5), tank(), refined(tank(), 2.0)]
    less = module._settings(tank(), None, (), ("effects",), (), "cpu", [])
    assert {(s.kind, s.factor, len(s.scene.effects), s.backend) for s in less} == {("effect", 1.0, 2, "cpu")}


def test_what_a_scene_costs_leaves_out_what_first_calls_take(monkeypatch):
    """Of ten timed steps of 2 s of the processor, 4 s by the clock, one calls a stage first, for 4 s."""
    clock, plan, steps = Clock(), make_plan(tank()), []

    def some(simulation, count):
        steps.append(count)
        simulation.timings.first_calls[f"stage {len(steps)}"] = 4.0
        simulation.last = types.SimpleNamespace(length=0.0125)
        clock(4.0 * count, 2.0 * count)

    clock.set_in(monkeypatch, cost)
    monkeypatch.setattr(cost, "_steps", some)
    found = cost.measured(plan, "numpy")
    assert steps == [2, 10]
    assert (found.start, found.each, found.ratio) == pytest.approx((8.0, 2.0 * 0.9, 2.0))
    assert (found.steps, found.length) == (8, 0.0125)
    assert (found.processor, found.wall) == pytest.approx((14.4, 28.8))
    assert (found.bytes, found.particles) == (describe_plan(plan, "numpy")["bytes"]["total"], plan.grid.count)


def test_every_second_of_a_run_is_counted_once(monkeypatch):
    """Of stages that are called three times, 0.5 s are waited for each time; one of the host holds another one.

    The third call compiles, in one kernel another: what no first call does counts no more for the steps.
    """
    clock = Clock()

    def compiled():
        Compiling.begin()
        clock(0.5, 0.25)
        Compiling.begin()
        clock(1.0, 1.0)
        Compiling.end()
        Compiling.end()

    clock.set_in(monkeypatch, clocks, timings)
    of = timings.Timings()
    of.wait = lambda: clock(0.5, 0.1)
    clock(4.0, 1.0)
    of.begin_steps()
    for k in range(3):
        of.run("density", lambda k=k: (clock(10.0 if k == 0 else 2.0, 1.0), compiled() if k == 2 else None))
        with of.of_host("frames"):
            clock(1.0, 0.5)
            of.run("forces", lambda: clock(3.0, 2.0))
        clock(0.25, 0.25)
        of.begin_steps()
    assert of.stages == pytest.approx({"density": 5.0, "forces": 7.0, "frames": 3.0})
    assert of.first_calls == pytest.approx({"density": 12.0, "forces": 3.5})
    assert of.launches == {"density": 3, "frames": 3, "forces": 3}
    assert of.counted == pytest.approx(5.0 + 7.0 + 3.0 + 15.5)
    costs = of.costs(40.0)
    assert [cost.stage for cost in costs] == ["other", "forces", "density", "frames"]
    assert [cost.seconds for cost in costs] == pytest.approx([9.5, 7.0, 5.0, 3.0])
    assert [cost.share for cost in costs] == pytest.approx([x / 24.5 for x in (9.5, 7.0, 5.0, 3.0)])
    assert [(cost.launches, cost.first) for cost in costs] == [(0, 0.0), (3, 3.5), (3, 12.0), (3, 0.0)]
    assert of.costs(1.0)[-1][:2] == ("other", 0.0)
    found = of.account()
    wall, processor = (4.0, 15.5, 5.75, 10.0, 35.25), (1.0, 4.45, 2.95, 5.7, 14.1)
    names = ("start", "compiling", "steps", "writing", "total")
    assert {name: found[name] for name in names} == pytest.approx(dict(zip(names, wall)))
    assert found["processor"] == pytest.approx(dict(zip(names, processor)))


# Observables and panels
def test_observables_of_a_started_tank_are_as_ever(recorded):
    gauges = (rs.Gauge(name="floor", kind="force", on="-y"), rs.Gauge(name="at", kind="pressure", at=(0.05, 0.05, 0)))
    effects = (*tank().effects[:2], rs.BoxWalls(lower=(0, 0, 0), upper=(0.1, 0.4, 0)))
    scene = tank(6, gauge=gauges, dtype="float64", effects=effects)
    run, found = advanced(Simulation(scene, "numpy"), 3), {}
    for name in rows(__file__, "observables"):
        try:
            observable = observable_of(name, run.plan)
            found[name] = (observable(run), observable.unit)
        except errors.InputError as error:
            found[name] = str(error)
    recorded(found)


def test_panels_that_are_measured_anew_are_told_as_ever(recorded):
    stored, random = panel("implicit_pressure"), np.random.default_rng(3)
    own = [key for key, point in stored.points.items() if point.program == "refsim" and not point.gpu][:4]
    held = stored.reference()
    place = types.SimpleNamespace(words="here")

    def read(point, number):
        if point.key == own[1] and number == 1:
            return Reading(math.nan, 1.0, 1.0, 0, 5, 6, 0.1, failed="In step 7 it stopped.")
        if point.key == own[2]:
            return Reading(math.nan, 0.0, 0.0, 0, 0, 0, 0.0, failed="missing: a program")
        return reading(random, held.value + held.scale * 0.01 * float(random.normal()), particles=100, steps=7)

    said = []
    found = measured.measured(stored, own, readings=4, read=read, place=place, say=said.append)
    known = ("key", "setting", "failed", "value", "value_mad", "error", "seconds", "bytes", "particles", "steps")
    rows = [{name: row[name] for name in known} for row in measured.rows(stored, found)]
    points = [[getattr(p, name) for name in ("place", "error_mad", "value_mad")] for p in found.points.values()]
    both = measured.merged(stored, found)
    assert {key: p for key, p in both.points.items() if key not in found.points} == {
        key: p for key, p in stored.points.items() if key not in found.points
    }
    lines = measured.text(stored, found).splitlines()
    counts = {"count of lines": len(lines), "failed": lines[-1], "count of lines said": len(said)}
    recorded({"rows": rows, "points": points, **counts})


def test_kept_readings_are_those_that_were_kept_and_a_run_that_cannot_begin_has_none(tmp_path, monkeypatch):
    setting = Setting("spacing", "a", 1.0, tank(), "cpu")
    made = reading(np.random.default_rng(1), 3.25)
    assert runs.kept(None, "key") is None
    runs.keep(None, "key", setting, made)
    runs.keep(tmp_path / "there", "key", setting, made)
    assert runs.kept(tmp_path / "there", "key") == made
    failed = replace(made, value=math.nan, failed="It stopped.")
    runs.keep(tmp_path / "there", "other", setting, failed)
    assert repr(runs.kept(tmp_path / "there", "other")) == repr(failed)
    notes = []
    runs.keep(tmp_path / "there", "third", setting, replace(made, value=math.nan))
    assert runs.kept(tmp_path / "there", "third", notes) is None
    assert len(notes) == 1
    assert json.loads((tmp_path / "there" / "key.json").read_text())["label"] == "a"

    def refuse(*_):
        raise errors.InputError("no such observable")

    monkeypatch.setattr(runs, "observable_of", refuse)
    monkeypatch.setattr(tasks, "_read", lambda *_: "read")
    work = tasks.Work(
        "ab", Setting("spacing", "a", 1.0, tank(), "numpy"), "x", str(tmp_path), tasks.made_by(), "read", 9.0
    )
    found = tasks.compute(lambda share: None, work)
    assert math.isnan(found.value)
    assert found.failed == "no such observable"
    assert found.steps == found.particles == found.bytes == 0
    assert (found.seconds, found.wall, found.mass) == (0.0, 0.0, 0.0)
    seen = []
    half = types.SimpleNamespace(time=0.05)
    monkeypatch.setattr(runs, "measure", lambda *given: (given[4](half), seen.append(given[3:6:2])) and made)
    for end in (0.1, 0.0):
        at = Setting("spacing", "a", 1.0, tank(end_time=end), "numpy")
        tasks.compute(seen.append, replace(work, key=f"at {end}", setting=at))
    assert seen == [0.5, (1, 1), 1.0, (1, 1)]  # shares of the time that are done; on one thread, and once


@pytest.mark.parametrize("backend", ["cpu", "cuda"])
def test_boxes_of_many_particles_are_counted_before_they_are_laid_out(backend, monkeypatch):
    """What a particle takes in the plan of the scene itself decides, and that a plan lays it out in 280 bytes."""
    scene = tank(20)
    plan = make_plan(scene)
    found = describe_plan(plan, backend)["bytes"]
    of_walls = (f for f in plan.fields.values() if f.rows)
    held = found["fields"] - sum(f.rows * f.components * f.numpy_dtype("float32").itemsize for f in of_walls)
    held += found["positions_at_list_build"] if backend == "cpu" else 0
    held += found["neighbour_list"] if backend == "cpu" else 0
    least = max(held, 280 * plan.grid.count)
    monkeypatch.setattr(cost, "MANY", plan.grid.count)
    monkeypatch.setattr(cost, "FEW", plan.grid.count // 4)
    for total, fits in ((least * 1.001, True), (least * 0.999, False)):
        monkeypatch.setattr(solids, "host_memory", lambda total=total: {"total": total})
        if fits:
            cost.check_boxes(scene, backend)
        else:
            with pytest.raises(errors.InputError, match=r"a run of it makes 800 .* a spacing of 0.0053 m fits"):
                cost.check_boxes(scene, backend)
    monkeypatch.setattr(cost, "MANY", plan.grid.count + 1)
    cost.check_boxes(scene, backend)  # fewer are laid out at once


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
    found = json.loads(answer_of(capsys, [*given, "--json"]).out)["time"]
    assert found["processor"] == pytest.approx(found["steps"] * found["each"])
    assert found["wall"] == pytest.approx(found["ratio"] * found["processor"])
    assert "one CPU thread, from 10 steps; later list builds" in answer_of(capsys, given).out
    monkeypatch.setattr(Simulation, "__init__", lambda *given: (_ for _ in ()).throw(InputError("no such backend.")))
    assert "no such backend" in answer_of(capsys, given, 2).err
