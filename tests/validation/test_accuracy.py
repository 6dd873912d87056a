"""Panels in the repository: the page that their points make, their runs without a packaged scene, and readings."""

import math

import numpy as np
import pytest

from refsim.study.panels import OWN, abouts, panel
from refsim.study.panels.scenes import packaged
from validation import accuracy, accuracy_page, panel_peers
from validation.__main__ import main
from validation.panel_runs import detection as detector_runs
from validation.panel_runs import drops_and_melting as panel_runs
from validation.panel_runs import implicit_pressure as pressure_runs
from validation.panel_runs import mpm as mpm_runs
from validation.panel_runs import tank as tank_runs
from validation.reading import environment
from validation.running import Context
from validation.turns import Outcome, Readings, measured
from validation.work_precision import order_from_errors, pareto


def test_the_page_is_what_the_stored_points_make():
    text = accuracy_page.PAGE.read_text()
    assert accuracy_page.page(text) == text, "python -m validation accuracy --draw"


@pytest.mark.parametrize("name", abouts())
def test_every_panel_can_be_measured_anew(name):
    """By its packaged scene or by a run that is there, with the settings on file; so can other programs' points."""
    assert (packaged(name) is not None) != (name in accuracy.RUNS)
    programs = {p.program for p in panel(name).points.values()} - {OWN}
    assert bool(programs) == (name in accuracy.PEERS)
    for where in (accuracy.RUNS.get(name), accuracy.PEERS.get(name)):
        assert where is None or callable(accuracy._run(where))


def test_unknown_panels_get_a_sentence(capsys):
    assert main(["accuracy", "dropplet"]) == 2
    assert "no panel 'dropplet'; did you mean 'droplet'?" in capsys.readouterr().err
    assert main(["accuracy", "heat", "--peers"]) == 2
    assert "has no points of other programs" in capsys.readouterr().err


def readings(**outcomes):
    first = Outcome(2.6, 1.0, 3, 200)
    found = {key: Readings([[outcome]] * 5, [1.0] * 5) for key, outcome in {"d10": first, **outcomes}.items()}
    return measured(found, 1, "cpu")


def test_a_reading_becomes_a_point_beside_the_stored_one():
    of = panel("front")
    gone = Outcome(seconds=2.0, steps=3, stopped="diverged in step 3")
    found = accuracy.beside(of, readings(d14=gone, peer_d10=Outcome(stopped="missing: it is not there")))
    point = found.here.points["d10"]
    value, scale, _ = of.reference()
    assert point.error == pytest.approx(abs(2.6 - value) / scale)
    assert (point.knobs, point.setting) == (of.points["d10"].knobs, of.points["d10"].setting)
    assert found.here.places[point.place].date == environment(1, "cpu")["date"]
    assert (found.here.points["d14"].failed, found.here.points["d14"].spent) == ("diverged in step 3", 2.0)
    assert found.left_out == ("SPlisHSPlasH, DFSPH, d = L/10 left out: it is not there",)
    assert "stored value" in found.text()


LIQUIDS = {  # panel: (the run's function of one setting, what it keeps at the coarsest, arguments that shorten it)
    "tank_pressure": ("n6", tank_runs.rested, 0.4, {}),
    "implicit_pressure": ("implicit_10", pressure_runs.rested, 0.1, {}),
    "surface_tension_jump": ("akinci_r8", panel_runs.drop, 0.3, {}),
    "mpm_frequency": ("r5.5", mpm_runs.swung, 0.1, {"periods": 0.6}),
}


@pytest.mark.parametrize("name", LIQUIDS)
def test_the_coarsest_point_of_a_liquid_is_measured(name):
    """Its error is finite and no larger than what the method keeps there; steps and seconds are counted."""
    key, once, bar, shorter = LIQUIDS[name]
    point = panel(name).points[key]
    found = once(Context(threads=1), {"knobs": point.knobs, **point.setting}, 0, **shorter)
    assert not found.stopped
    assert 0 < abs(found.value - panel(name).reference()[0]) < bar
    assert found.steps > 10
    assert found.seconds > 0
    assert found.particles == point.particles
    if not shorter and name != "surface_tension_jump":  # whose drops are of another seed
        assert found.value == pytest.approx(point.value, rel=0.02)


def test_implicit_pressure_is_larger_at_walls():
    """The particles at the floor, away from the sides, have two to three times the pressure of the water above them."""
    run = Context(threads=1).simulation(pressure_runs.tank(20, "float64", 1e-3, 1.0), "cpu")
    reach, found = 0.15 * pressure_runs.WIDTH, []
    while run.time < 1.5:
        run.step()
        if run.time > 1.0:
            place, pressure = run.field("position"), run.field("pressure")
            first = (place[:, 1] < 0.5 / 20) & (np.abs(place[:, 0] - 0.5 * pressure_runs.WIDTH) < reach)
            known = pressure_runs.DENSITY * pressure_runs.GRAVITY * (pressure_runs.HEIGHT - place[first, 1])
            found.append(float((pressure[first] / known).mean()))
    assert 2 < np.mean(found) < 3


def test_detectors_give_the_stored_value():
    points = panel("detection_2d").points
    steps = ("two_step_0.90_half_color_float32", "two_step_printed_0.90_half_color_float32")
    keys = ("number_density_0.90_float32", *steps)
    settings = {k: {"knobs": points[k].knobs, **points[k].setting} for k in keys}
    found = accuracy.beside(panel("detection_2d"), detector_runs.detectors_2d(Context(), settings, "cpu", 1, 2))
    for key in keys:
        assert found.here.points[key].value == pytest.approx(points[key].value, abs=2e-3)
    exact = found.here.points[keys[1]]
    assert sum(exact.parts.values()) == pytest.approx(np.mean(exact.seconds))
    assert exact.distribution["misplaced surface [spacings]"]["max"] < 10


def test_misplaced_surface_is_the_distance_between_both_sets():
    x = np.array([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [7, 0, 0]])
    flags, truth = np.array([1, 1, 0, 0], bool), np.array([1, 0, 1, 0], bool)
    assert sorted(detector_runs.misplaced(x, flags, truth)) == [0.0, 1.0, 2.0]
    assert detector_runs.misplaced(x, truth, truth).max() == 0.0
    assert np.isnan(detector_runs.misplaced(x, np.zeros(4, bool), truth)).all()


def test_peers_are_read_as_refsim_is(monkeypatch):
    """A front that moves evenly from 1 to 2 widths; a drop that keeps 0.02 from its second sample on."""
    settings = {"peer_d10": {"knobs": {}, "columns": 10}}
    times = np.linspace(0, 4.6, 93) * panel_peers.FALL
    column = {"time": times, "front": 0.5 * (1 + times / times[-1]), "wall": [0.0, 3.0], "steps": 7, "particles": 200}
    monkeypatch.setattr(panel_peers.splishsplash, "run_column", lambda given, threads: column)
    (read,) = panel_peers.fronts(Context(), settings, 1, 2).values["readings"]
    assert (read["value"], read["seconds"]) == (pytest.approx(1 + 2.0 / 4.6, abs=1e-3), [3.0, 3.0])
    drop = {"time": [0, 1, 2], "error": [0.2, 0.02, 0.02], "wall": [0.0, 1.5, 3.0], "steps": 2, "particles": 9}
    monkeypatch.setattr(panel_peers.splishsplash, "run_drop", lambda given, threads: drop)
    given = {"peer": {"knobs": {}, "settings": {}}}
    (read,) = panel_peers.drops(Context(), given, 1, 2).values["readings"]
    assert (read["value"], read["seconds"]) == (0.02, [1.5, 1.5])
    monkeypatch.setattr(panel_peers.splishsplash, "run_drop", lambda given, threads: {"missing": "it is not there"})
    (read,) = panel_peers.drops(Context(), given, 1, 2).values["readings"]
    assert read["stopped"] == "missing: it is not there"


# Statistics


def test_pareto_front_holds_what_nothing_beats():
    points = [(2.0, 1.0), (1.0, 2.0), (2.0, 2.0), (0.5, math.inf), (math.nan, 0.1), (1.0, 2.0)]
    assert pareto([{"error": e, "seconds": s} for e, s in points]) == [0, 1]


def test_order_from_errors():
    size = [0.1, 0.05, 0.025, 0.0125]
    exact = order_from_errors(size, [3 * s**2 for s in size], 2.0)
    assert exact.asymptotic
    assert exact.order == pytest.approx(2.0)
    assert not order_from_errors(size, [1.0, 0.5, 0.6, 0.1], 2.0).asymptotic
    assert "2 of 3 sizes" in order_from_errors(size[:2], [1.0, 0.5], 2.0).words
