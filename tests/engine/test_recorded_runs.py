"""Lists, stops, post-mortems and reports of small runs, in numbers."""

import json
import types

import numpy as np
import pytest

from refsim import InputError, RunStopped, Simulation, make_plan
from refsim.backends.arrays import choose
from refsim.engine import counting, lists
from refsim.engine.counting import watch
from refsim.engine.driver import simulate
from refsim.engine.limits import StepOutcome
from refsim.engine.postmortem import examine
from refsim.scene.files import parse_scene
from tests.across.test_recorded_scenes import SCENES
from tests.running import advanced, python

SEARCH = ("squared_displacement", "margin", "step_displacement", "shifted", "length", "ahead", "gained", "rate")


def run_of(name, *changes, backend="numpy", steps=0):
    text = SCENES[name]
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return advanced(Simulation(make_plan(parse_scene(text, name)), backend, 1), steps)


def lists_of_a_tank():
    """Forty steps on the CPU, with a skin that is used up several times; the fields are those of all pairs."""
    thin = "end_time = 0.05", "end_time = 0.05\nskin = 0.03"
    run, other = (run_of("tank", thin, backend=backend) for backend in ("cpu", "numpy"))
    rows = []
    for _ in range(40):
        expected, kept = run.lists.expects_look(), run.search.log.rebuilds
        done = run.step()
        other.step()
        rows.append([getattr(run.lists, name) for name in SEARCH])
        rows[-1] += [expected, run.search.log.rebuilds - kept, done.length, run.lists.needs_no_look()]
        assert run.limiters[done.limiter] > 0
    assert sum(run.limiters.values()) == 40
    for name in ("position", "velocity", "density"):
        assert run.field(name) == pytest.approx(other.field(name), rel=1e-7, abs=1e-9)
    limiters = dict(sorted(run.limiters.items()))
    print(json.dumps({"steps": np.array(rows, float)[::4].tolist(), "log": vars(run.search.log), "limiters": limiters}))


def test_lists_of_a_tank_are_kept_and_built_as_ever(recorded):
    """Kernels run as Python: no other test needs them in double precision."""
    program = "from tests.engine import test_recorded_runs as t; t.lists_of_a_tank()"
    recorded(json.loads(python("-c", program, NUMBA_DISABLE_JIT="1").stdout))


class Known:
    """A search of which all that lists ask is drawn."""

    def __init__(self, rng, ahead):
        self.allowed_displacement, self.looks_ahead, self.rng = 0.3, ahead, rng
        self.skin, self.asked, self.radius = 0.1, [], 1.0

    def ahead(self, length):
        return 5.0 * length if self.looks_ahead else 0.0

    def margins(self, particles, ways, walls):
        self.asked.append((*ways, walls))
        edge = (1.004 if self.rng.random() < 0.5 else 0.996) * 0.2 * self.allowed_displacement
        first = edge if self.rng.random() < 0.3 else self.rng.uniform(-0.1, 0.4)
        return [first, self.rng.uniform(-0.1, 0.6)] if self.looks_ahead and ways[1] > 0.2 else [first]

    def reach_further(self, skin):
        self.skin = skin


@pytest.mark.parametrize("seed", range(6))
def test_lists_are_kept_as_the_margins_of_a_second_program_say(seed):
    """Through drawn steps, looks, builds and changes of velocities."""
    rng = np.random.default_rng(seed)
    of = lists.Lists(make_plan(parse_scene(SCENES["tank"], "tank")), choose("numpy"), {})
    assert (of.needs_no_look(), of.keeps(None), of.expects_look()) == (True, False, False)  # there is no list
    of.search, of.by_forces, of.skins = Known(np.random.default_rng(seed), seed % 2 > 0), seed % 3 > 0, (0.1, 0.2, 0.3)
    most, squared, margin, rate, ahead, gained, length, moved, shifted = 0.3, np.inf, 0.0, None, 0.0, 0.0, 0.0, 0.0, 0.0
    again = Known(np.random.default_rng(seed), seed % 2 > 0)

    def left(length, gained):
        if rate is None:
            return margin - 2 * moved
        return margin + length * rate - 2 * length * gained - 2 * shifted if length <= ahead else 0.0

    for number in range(300):
        what = rng.choice(["step"] * 9 + ["look", "look", "look", "build", "set", "lose"])
        if what == "step":
            length, moved, shifted, change = rng.uniform([0.01, 0, 0, 0], [0.05, 0.05, 0.01, 0.05])
            way, stopped = rng.uniform(0, 0.5) ** 2, int(rng.random() < 0.1)
            of.after_step(StepOutcome(length, "", {}, moved, shifted, change, way, stopped, 0))
            squared, gained = way, gained + change
            margin, ahead = max(left(length, gained), 0.0), ahead - length
            if rate is not None and (stopped or margin == 0):
                margin, rate = 0.0, None
        elif what == "look":
            told = of.keeps(None)
            if not np.isfinite(squared) or not (of.by_forces or of.search.looks_ahead):
                assert not told
            else:
                ahead, gained = again.ahead(length), 0.0
                way = squared**0.5
                found = again.margins(None, (way, way + moved * ahead / length if length else way), False)
                rate = (found[1] - found[0]) / ahead if len(found) > 1 and of.by_forces and ahead > 0 else None
                margin = found[0] if of.by_forces else 0.0
                assert told == (found[0] > (0.0 if of.search.looks_ahead else 0.2 * most))
                assert of.search.asked[-1] == pytest.approx(again.asked[-1])
        elif what == "build":
            before = of.built_at
            of.choose_skin(number)
            served = number - before
            skin = 0.3 if served < lists.FEW_STEPS else 0.1 if served > 2 * lists.FEW_STEPS else of.search.skin
            if served == 1 and 0.3 < squared**0.5 < 1 and number % lists.MANY_STEPS:
                skin = 0.1
            assert of.search.skin == skin
            of.after_build(number)
            assert of.built_at == number
            squared, margin, rate = 0.0, 0.0, None
        elif what == "set":
            of.velocities_changed()
            length, (margin, rate) = 0.0, (margin, None) if rate is None else (0.0, None)
        else:
            of.invalidate()
            squared, margin, rate = np.inf, 0.0, None
        assert (of.margin, of.ahead, of.gained, of.length) == pytest.approx((margin, ahead, gained, length), abs=1e-15)
        assert of.squared_displacement == squared
        assert of.rate == (None if rate is None else pytest.approx(rate))
        assert of.needs_no_look() == (squared <= most**2 or margin > 0)
        looks = np.isfinite(squared) and squared**0.5 + moved > most and left(length, gained) <= 0
        assert of.expects_look() == looks


@pytest.mark.parametrize("name", ["tank", "bodies", "material points", "a cloud far away"])
def test_post_mortems_name_the_worst_particle(name, recorded):
    run, found, worst, states = run_of(name, steps=1), {}, {}, {}
    stops = ["diverged", "step_too_small", "missed_neighbours", "compressed", "collapsed"]
    stops.append("miscounted")
    if "temperature" in run.fields:
        stops.append("temperature_out_of_range")
    random = np.random.default_rng(5)
    for reason in stops:
        if reason == "temperature_out_of_range":
            values = np.asarray(run.fields["temperature"])
            low, high = run.host("temperature_range")
            values[7], values[9] = low - 3, high + 0.5
        fields = ("velocity", "acceleration", "density", "volume_ratio")  # as the stop finds them
        states[reason] = {field: np.array(run.host(field), float) for field in fields if field in run.fields}
        told, near = examine(run, RunStopped(reason, "words."))
        found[reason] = {key: told[key] for key in ("cause", "bad_particles", "step", "time", "limits_now")}
        if told["particle"] is None:
            assert near == {}
            continue
        worst[reason], place = told["particle"], run.field("position").astype(float)
        apart = np.linalg.norm(place - worst[reason]["position"], axis=1)  # in scenes without a period
        around = np.flatnonzero(apart <= 2 * run.plan.grid.support_radius)
        assert sorted(near["identity"]) == around.tolist()
        assert (np.diff(np.linalg.norm(near["position"] - worst[reason]["position"], axis=1)) > -1e-9).all()
    for reason, field in (("diverged", "velocity"), ("step_too_small", "acceleration")):
        sizes = np.linalg.norm(states[reason][field], axis=1)
        assert np.linalg.norm(worst[reason][field]) == pytest.approx(sizes.max())
    field, most = ("density", np.max) if "density" in run.fields else ("volume_ratio", np.min)
    assert worst["compressed"][field] == most(states["compressed"][field])
    if "temperature" in run.fields:
        assert worst["temperature_out_of_range"]["identity"] == run.host("identity")[7]
    for field in ("mass", "velocity", "position"):
        values = np.asarray(run.fields[field])
        rows = random.permutation(len(values))[:3]
        values[rows] = np.nan
        told, near = examine(run, RunStopped("non_finite", "words."))
        found[f"{field} lost"] = told["cause"], told["bad_particles"], len(near["identity"])
        assert told["particle"]["identity"] == rows.min()
    recorded(found)


def test_passes_that_stop_again_are_the_cause_and_name_no_particle(monkeypatch):
    def replay(simulation):
        raise RunStopped("collapsed", "again.")
        yield

    monkeypatch.setattr("refsim.engine.postmortem.replay", replay)
    told, _ = examine(run_of("tank"), RunStopped("non_finite", "words."))
    assert (told["cause"], told["bad_particles"]) == ("the passes stop again: collapsed", 0)


def test_stops_at_walls_and_dense_particles_are_noted_at_their_bounds(recorded):
    """What a step did is looked at; by counts of particles that a plane stopped, and that are too dense."""
    found = {}
    large = [("cells = [8, 6, 1]", "cells = [16, 8, 1]"), ("upper = [0.8, 2.0", "upper = [1.6, 2.0")]
    run = run_of("tank", *large, steps=1)
    count = run.count
    assert count > 100
    for stopped, dense, steps in (
        (0, 0, 300), (0.0019, 0, 300), (0.0021, 0, 300), (0.0021, 0, 99), (0.31, 0, 100), (0.29, 0, 100), (0, 1, 5),
        (0, 30, 5), (0.31, 2, 99),
    ):  # fmt: skip
        run = run_of("tank", *large, steps=1)
        run.steps, run.stopped_at_walls, words = steps, round(stopped * steps * count), []
        done = types.SimpleNamespace(dense=dense, length=1e-3, squared_displacement=1.0)
        for _ in range(2):
            try:
                watch(run, done, run.host)
            except RunStopped as stop:
                words.append(str(stop))
        found[f"{stopped} {dense} {steps}"] = words, list(run.notes)
    with pytest.raises(RunStopped, match="not finite"):
        watch(run, types.SimpleNamespace(squared_displacement=float("nan")), run.host)
    recorded(found)


def test_a_report_and_frames_are_as_ever(tmp_path, recorded):
    run = run_of("tank")
    report = simulate(run, 0.02, output=tmp_path / "out", every=0.004, checkpoint_every=0.0, progress=False)
    told = json.loads((tmp_path / "out" / "report.json").read_text())
    left = ("seconds", "versions", "files", "message", "profile", "notes")
    frames = (tmp_path / "out" / "particles.pvd").read_text()
    assert report.checkpoints == report.steps + 2  # at the start, after every step, and at the end
    assert report.frames == 6
    times = [line.partition("timestep=")[2].split('"')[1] for line in frames.splitlines() if "timestep=" in line]
    recorded({key: value for key, value in told.items() if key not in left} | {"frames": times})
    again = Simulation.resume(tmp_path / "out", "numpy")
    assert again.steps == report.steps
    for bad in ({"until": -1.0}, {"until": float("nan")}, {"every": 0.0}, {"checkpoint_every": -1.0}):
        with pytest.raises(InputError, match="is not possible"):
            simulate(run_of("tank"), **{"progress": False} | bad)


@pytest.mark.parametrize("period", [0.0, 2.4])
def test_counted_densities_of_stretched_places_are_as_ever(period, recorded):
    if period:
        changes = [("period = [1.2", "period = [2.4"), ("upper = [0.9, 0.5", "upper = [2.1, 2.0")]
        run = run_of("a period", ("cells = [12, 5, 1]", "cells = [24, 20, 1]"), *changes)
    else:
        changes = [("upper = [0.8, 2.0", "upper = [2.4, 3.0"), ("center = [0.4, 1.0", "center = [1.2, 2.5")]
        run = run_of("tank", ("cells = [8, 6, 1]", "cells = [24, 20, 1]"), *changes)
    found = {"lattice": counting.counted(run)}
    place = np.asarray(run.fields["position"])
    middle = place.mean(0)
    for factor in (0.97, 1.04):
        kept = place.copy()
        place[:, 1] = middle[1] + factor * (place[:, 1] - middle[1])
        run.counting.before = None  # one look alone
        found[str(factor)] = counting.counted(run), run.counting.judged(run), run.counting.report()
        place[:] = kept
    place[:, 1] *= 0.6
    run.counting.before = None
    with pytest.raises(RunStopped) as caught:
        run.counting.judged(run)
    recorded(found | {"stops": str(caught.value)})


def test_a_velocity_that_is_set_acts_behind_the_step_that_led_to_the_positions():
    """A density that is advanced belongs to the positions, whatever is read and set then; at the start it stays."""
    found = []
    for steps, share in ((3, None), (3, 0.0), (3, 2.0), (0, None), (0, 5.0)):
        run = run_of("tank", steps=steps)
        if share == 2.0:
            run.evaluate()
            assert run.lists.ways_renewed  # no audit steps back by them
        if share is not None:
            run.set_field("velocity", share * run.field("velocity"))
        run.evaluate()
        found.append(run.field("density"))
    assert np.ptp(found[0]) > 1
    assert (found[0] == found[1]).all()
    assert (found[0] == found[2]).all()
    assert (found[3] == found[4]).all()
