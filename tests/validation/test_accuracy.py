"""Panels in the repository: the page that their points make, their runs without a packaged scene, and readings."""

import math

import numpy as np
import pytest

from refsim import Simulation
from refsim.scene.plan import make_plan
from refsim.study.panels import OWN, abouts, panel
from refsim.study.panels.making import DENSITY, GRAVITY, MADE, implicit_pressure
from refsim.study.panels.scenes import packaged
from validation import accuracy, accuracy_page, panel_peers
from validation.__main__ import main
from validation.experiments.dam_break.runs import TRUTH_RADIUS
from validation.experiments.dam_break.scene import load_state
from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface
from validation.panel_runs import drops
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


def test_the_coarsest_drop_is_measured():
    """Its error is finite and no larger than what the method keeps there; steps and seconds are counted."""
    point = panel("surface_tension_jump").points["akinci_r8"]
    found = drops.drop(Context(threads=1), {"knobs": point.knobs, **point.setting}, 0)
    assert not found.stopped
    assert 0 < abs(found.value - 1.0) < 0.3
    assert found.steps > 10
    assert found.seconds > 0
    assert found.particles == point.particles


def test_implicit_pressure_is_larger_at_walls():
    """The particles at the floor, away from the sides, have two to three times the pressure of the water above them."""
    given = {"cells": 20, "dtype": "float64", "tolerance": 1e-3, "step": 1.0}
    run, found = Simulation(implicit_pressure(given), threads=1), []
    while run.time < 1.5:
        run.step()
        if run.time > 1.0:
            place, pressure = run.field("position"), run.field("pressure")
            first = (place[:, 1] < 0.5 / 20) & (np.abs(place[:, 0] - 0.5) < 0.15)
            found.append(float((pressure[first] / (DENSITY * GRAVITY * (1 - place[first, 1]))).mean()))
    assert 2 < np.mean(found) < 3


@pytest.mark.parametrize(("name", "cover"), [("2d", arc_cover_surface), ("3d", cap_cover_surface)])
def test_detectors_are_held_against_the_exact_cover(name, cover):
    """Of some particles of the stored clouds."""
    cloud = load_state(f"dam_break_{name}")
    plan = make_plan(MADE[f"detection_{name}"]({"effect": {}, "dtype": "float32"}, 0))
    some = np.random.default_rng(1).choice(len(cloud.position), 300, replace=False)
    truth = cover(cloud.position, TRUTH_RADIUS * plan.grid.spacing, plan.walls.position, some)
    assert (truth == cloud.surface[some]).all()


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
