"""Studies whose answer is known, fail in part or go on; orders against published values; observables."""

import json
import math
import sys
import types

import numpy as np
import pytest

import refsim
import refsim as rs
from refsim import Box, Gravity, InputError, Scene, Simulation, WeaklyCompressible, make_plan
from refsim.engine.conserved_totals import conserved_totals
from refsim.scene.files import parse_scene
from refsim.study import runs
from refsim.study.convergence import CAUTIOUS, SAFE, converge
from refsim.study.observables import observable_of
from tests.running import answer_of, rows
from tests.tank_file import GRAVITY, tank
from validation.metrics.dam_break import front_position

SCENE = tank(0.001, 6, 12, GRAVITY)


def block(**more):
    return parse_scene(SCENE, "tank.toml").with_(**more)


def manufactured(order):
    """An observable of known order, 5 + h^order with h in units of the scene's spacing, without rounding."""

    def value(simulation):
        return 5.0 + (simulation.plan.grid.spacing / 0.01) ** order

    return value


def studied(observable, **more):
    given = {"backend": "numpy", "knobs": ("spacing",)}
    return refsim.study(given.pop("scene", more.pop("scene", block())), observable, **(given | more))


@pytest.mark.parametrize("order", [1, 2])
def test_a_known_order_gives_value_error_and_cheapest_setting(order):
    found = studied(manufactured(order), error=0.25)
    limit = found.convergence
    assert limit.asymptotic
    assert (limit.order, limit.value) == (pytest.approx(order), pytest.approx(5.0))
    assert limit.uncertainty == pytest.approx(1.25 * 1.5**-order)
    assert [row["change"] for row in found.rows()] == pytest.approx([1.5**order / 5, 1 / 5, 1.5**-order / 5])
    assert found.sources() == {"spacing": pytest.approx(0.25)}
    allowed = [s.scene.spacing for s, r in found.of("spacing") if 1.25 * (r.value - 5) / 5 <= 0.25 + 1e-9]
    advice = found.cheapest(0.25 + 1e-9)
    assert advice.measured
    assert advice.spacing in allowed
    assert advice.seconds == min(r.seconds for s, r in found.of("spacing") if s.scene.spacing in allowed)


def test_a_study_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    done = []
    own = runs.measure

    def counted(setting, *more):
        if len(done) == 2 and "stop" not in vars(counted):
            counted.stop = True
            raise KeyboardInterrupt
        done.append(setting.label)
        return own(setting, *more)

    monkeypatch.setattr(sys.modules["refsim.study"], "measure", counted)
    with pytest.raises(KeyboardInterrupt):
        studied("front", folder=tmp_path)
    assert len(done) == 2
    said = []
    first = studied("front", folder=tmp_path, say=said.append)
    assert len(done) == 3
    assert "2 are on file" in said[0]
    again = studied("front", folder=tmp_path, say=said.append)
    assert len(done) == 3
    assert again.rows() == first.rows()
    other = block(end_time=0.0005)
    studied("front", folder=tmp_path, scene=other, knobs=())
    assert len(done) == 4


def test_what_is_left_is_told_by_the_work_and_the_seconds_of_finished_runs(monkeypatch):
    """Runs of 1, 2 and 5 parts of work, of which the first take 3 and 9 s: 7 parts, then 5 at 4 s each."""
    study = sys.modules["refsim.study"]
    walls = iter((3.0, 9.0, 1.0))
    monkeypatch.setattr(study, "key_of", lambda *given: "")
    monkeypatch.setattr(study, "weighed", lambda setting: (setting.work,))
    monkeypatch.setattr(study, "kept_or_made", lambda *given: types.SimpleNamespace(wall=next(walls)))
    settings, said = [types.SimpleNamespace(work=work, label=f"run of {work}") for work in (5.0, 1.0, 2.0)], []
    study._measured(settings, None, None, 1, None, said.append, None, [])
    assert [line for line in said if " of 3: " in line] == [
        "1 of 3: run of 1.0",
        "2 of 3: run of 2.0; about 21 s of steps left",
        "3 of 3: run of 5.0; about 20 s of steps left",
    ]


@pytest.mark.parametrize("more, words", rows(__file__, "bad_studies"))
def test_bad_input_gets_a_sentence(more, words):
    with pytest.raises(rs.InputError, match=words):
        studied("front", **more)


# The command
@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.toml").write_text(SCENE)
    (tmp_path / "own.py").write_text("def grid(s):\n    return 5 + (s.plan.grid.spacing / 0.01) ** 2\n")
    return tmp_path


def run(capsys, *arguments, code=0):
    return answer_of(capsys, ["study", "tank.toml", "--backend", "numpy", *arguments], code)


def test_the_command_writes_table_and_picture(file, capsys):
    said = run(capsys, "--observable", "own.py:grid", "--knobs", "spacing,precision", "--error", "0.1")
    assert "own.grid = 5 ± 0.56" in said.out
    assert "4 runs to do, the cheapest first" in said.err
    assert "of steps left" in said.err.splitlines()[3]
    assert "cheapest for an error of 10 %" in said.out
    assert {"study.txt", "study.png"} < {path.name for path in (file / "tank_study").iterdir()}
    again = run(capsys, "--observable", "own.py:grid", "--knobs", "spacing,precision", "--error", "0.1", "--json")
    assert "runs to do" not in again.err
    found = json.loads(again.out)
    assert found["order"] == pytest.approx(2.0)
    assert [row["what"] for row in found["runs"]] == ["spacing"] * 3 + ["precision"]
    assert found["cheapest"]["error"]["spacing"] > found["cheapest"]["half_of_it"]["spacing"]


def test_bad_input_of_the_command(file, capsys):
    assert "did you mean front" in run(capsys, "--observable", "fornt", code=2).err
    cloud = SCENE.replace('shape = "box"\ncells = [6, 12, 1]', 'shape = "cloud"\nposition = [[0, 0], [0, 0.01]]')
    (file / "tank.toml").write_text(cloud)
    assert "it has no other spacing" in run(capsys, "--observable", "front", code=2).err
    assert run(capsys, "--observable", "front", "--knobs", "precision", "--quiet").err == ""


def test_seconds_that_do_not_settle_are_said(monkeypatch):
    """Runs are repeated until two agree within 5 %; where none do it is said."""
    spent = iter([0.5, 0.9, 0.51, *[0.1 * 2**k for k in range(6)]])
    setting = runs.Setting("spacing", "", 1.0, block(), "cpu")
    observable = observable_of("kinetic_energy", make_plan(setting.scene))
    monkeypatch.setattr(runs, "_run", lambda *given: runs.Reading(1.0, next(spent), 9.0, 0, 1, 1, 1.0))
    made = [runs.measure(setting, observable) for _ in range(2)]
    assert [reading.seconds for reading in made] == [0.5, 0.1]
    assert [reading.unsettled for reading in made] == ["", "its two fastest of 6 runs differ by 100 %"]


def celik(h, q):
    """Order and extrapolated value by the fixed-point iteration of Celik et al. 2008, J. Fluids Eng. 130, 078001."""
    r21, r32 = h[1] / h[0], h[2] / h[1]
    e21, e32 = q[1] - q[0], q[2] - q[1]
    s = math.copysign(1.0, e32 / e21)
    p = 1.0
    for _ in range(2000):
        p = abs(math.log(abs(e32 / e21)) + math.log((r21**p - s) / (r32**p - s))) / math.log(r21)
    return p, (r21**p * q[0] - q[1]) / (r21**p - 1)


def test_the_published_example():
    """Celik et al. 2008, table 1, first column: dimensionless reattachment length."""
    found = converge([1.0, 1.5, 1.5 * 1.333], [6.063, 5.972, 5.863])
    assert found.asymptotic
    assert (found.order, found.value) == (pytest.approx(1.53, abs=0.01), pytest.approx(6.1685, abs=5e-4))
    assert found.uncertainty / 6.063 == pytest.approx(0.022, abs=5e-4)  # GCI, 2.2 %
    assert found.error(6.063) == pytest.approx(0.017, abs=5e-4)  # extrapolated relative error, 1.7 %


@pytest.mark.parametrize("order", [0.55, 1.0, 1.4, 2.0, 2.9])
@pytest.mark.parametrize("ratios", [(2.0, 2.0), (1.5, 1.5), (1.3, 1.7), (1.9, 1.2)])
@pytest.mark.parametrize("limit, slope", [(1.0, 3.0), (-40.0, 0.2), (1e-6, -1e-6)])
def test_power_laws_are_found(order, ratios, limit, slope):
    h = np.array([0.1, 0.1 * ratios[0], 0.1 * ratios[0] * ratios[1]])
    q = limit + slope * h**order
    found = converge(h[[1, 2, 0]], q[[1, 2, 0]])
    p, extrapolated = celik(h, q)
    assert found.asymptotic
    assert (found.order, found.order) == (pytest.approx(order, rel=1e-6), pytest.approx(p, rel=1e-6))
    assert (found.value, found.value) == (pytest.approx(extrapolated, rel=1e-6), pytest.approx(limit, rel=1e-6))
    inside = 0.9 <= order <= 2.2
    assert found.safety == (SAFE if inside else CAUTIOUS)
    if inside:
        assert found.uncertainty == pytest.approx(1.25 * abs(q[0] - limit), rel=1e-6)
        assert found.bound(q[2]) == pytest.approx(1.25 * abs(q[2] - limit) / abs(limit), rel=1e-6)
    assert found.uncertainty >= (1 - 1e-6) * 1.25 * abs(q[0] - limit)


@pytest.fixture(scope="module")
def simulation():
    """A block that flies, and a piece apart from it."""
    scene = Scene(
        dim=2, dtype="float64", spacing=0.01, support_radius=0.026,
        fluid=(Box(cells=(8, 6, 1), velocity=(2.0, 1.0, 0.0)), Box(lower=(0.3, 0.0, 0.0), cells=(2, 2, 1))),
        effects=(WeaklyCompressible(sound_speed=20.0, density="summation"), Gravity(acceleration=(0.0, -9.81, 0.0))),
    )  # fmt: skip
    made = Simulation(scene, "numpy")
    made.step()
    return made


def value(simulation, name):
    return observable_of(name, simulation.plan)(simulation)


def test_front_and_energy_are_those_of_the_report_and_a_lonely_point_has_none(simulation):
    position = simulation.field("position")
    found = front_position(position, 0.01)
    assert found.detached
    assert value(simulation, "front") == pytest.approx(found.connected, rel=1e-12)
    assert value(simulation, "front:+x") < found.farthest
    assert value(simulation, "front:-y") == pytest.approx(-front_position(-position, 0.01, axis=1).connected, rel=1e-12)
    assert value(simulation, "kinetic_energy") == pytest.approx(
        conserved_totals(simulation)["kinetic_energy"], rel=1e-12
    )
    with pytest.raises(InputError, match="no particle is within the support radius"):
        value(simulation, "field:density@5,5")


@pytest.mark.parametrize("name, words", rows(__file__, "missing_observables"))
def test_what_is_not_there_gets_a_sentence(simulation, name, words):
    with pytest.raises(InputError, match=words):
        observable_of(name, make_plan(simulation.plan.scene))
