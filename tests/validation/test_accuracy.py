"""Panels in the repository: the page that their points make, their runs without a packaged scene, and readings."""

import numpy as np
import pytest

from refsim import Simulation
from refsim.study.panels import FOLDER, OWN, Point, abouts, panel
from refsim.study.panels.making import DENSITY, GRAVITY, MADE, implicit_pressure
from refsim.study.panels.measured import measured
from refsim.study.panels.observables import FALL
from validation import accuracy, accuracy_page
from validation import panel_runs as accuracy_runs
from validation.__main__ import main
from validation.reading import reading


def test_the_page_is_what_the_stored_points_make():
    text = accuracy_page.PAGE.read_text()
    assert accuracy_page.page(text) == text, "python -m validation accuracy --draw"


@pytest.mark.parametrize("name", abouts())
def test_every_panel_can_be_measured_anew(name):
    """By its packaged scene; other programs' points by a run that is there."""
    assert name in MADE or (FOLDER / f"{name}.toml").is_file()
    programs = {p.program for p in panel(name).points.values()} - {OWN}
    assert bool(programs) == (name in accuracy.PEERS)
    assert name not in accuracy.PEERS or callable(accuracy.reader(accuracy.PEERS[name]))


def test_unknown_panels_get_a_sentence(capsys):
    assert main(["accuracy", "dropplet"]) == 2
    assert "no panel 'dropplet'; did you mean 'droplet'?" in capsys.readouterr().err
    assert main(["accuracy", "heat", "--peers"]) == 2
    assert "has no points of other programs" in capsys.readouterr().err


def test_a_reading_becomes_a_point_beside_the_stored_one(monkeypatch):
    given = {
        "d10": reading(2.6, 1.0, 3, 200), "d14": reading(seconds=2.0, steps=3, failed="diverged in step 3"),
        "peer_d10": reading(failed="missing: it is not there"),
    }  # fmt: skip
    of, first = panel("front"), []

    def once(point, number, threads):
        first.append(point.key)
        return given[point.key]

    monkeypatch.setattr(accuracy_runs, "front_by_splishsplash", once)
    found = measured(of, given, read=accuracy.reader(accuracy.PEERS["front"]), readings=2)
    assert [first.count(key) for key in given] == [3, 2, 1], "refsim's first one compiles"
    point = found.here.points["d10"]
    value, scale, _ = of.reference()
    assert point.error == pytest.approx(abs(2.6 - value) / scale)
    assert (point.knobs, point.setting) == (of.points["d10"].knobs, of.points["d10"].setting)
    assert (found.here.points["d14"].failed, found.here.points["d14"].spent) == ("diverged in step 3", 2.0)
    assert found.left_out == ("SPlisHSPlasH, DFSPH, d = L/10 left out: it is not there",)
    assert "stored value" in found.text()


def test_starts_of_unequal_cost_settle_where_each_repeats():
    """The second round tells what differs between starts from what disturbs the machine."""
    starts, spent = (1.0, 1.3, 1.6, 1.1, 2.0), []

    def once(point, number, threads):
        spent.append(starts[number])
        return reading(2.6, starts[number], 3, 200)

    point = measured(panel("front"), ["d10"], read=once).here.points["d10"]
    assert (len(spent), point.noise, point.seconds) == (10, pytest.approx([1.0] * 10), spent)


@pytest.mark.slow
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


def test_peers_are_read_as_refsim_is(monkeypatch):
    """A front that moves evenly from 1 to 2 widths; a drop that keeps 0.02 from its second sample on."""
    times = np.linspace(0, 4.6, 93) * FALL
    column = {"time": times, "front": 0.5 * (1 + times / times[-1]), "wall": [0.0, 3.0], "steps": 7, "particles": 200}
    monkeypatch.setattr(accuracy_runs.splishsplash, "run_column", lambda given, threads: column)
    read = accuracy_runs.front_by_splishsplash(Point("", "", 0, {}, setting={"columns": 10}), 0, 1)
    assert (read.value, read.seconds) == (pytest.approx(1 + 2.0 / 4.6, abs=1e-3), 3.0)
    drop = {"time": [0, 1, 2], "error": [0.2, 0.02, 0.02], "wall": [0.0, 1.5, 3.0], "steps": 2, "particles": 9}
    monkeypatch.setattr(accuracy_runs.splishsplash, "run_drop", lambda given, threads: drop)
    given = Point("", "", 0, {}, setting={"settings": {}})
    read = accuracy_runs.drop_by_splishsplash(given, 0, 1)
    assert (read.value, read.seconds) == (0.02, 1.5)
    monkeypatch.setattr(accuracy_runs.splishsplash, "run_drop", lambda given, threads: {"missing": "it is not there"})
    assert accuracy_runs.drop_by_splishsplash(given, 0, 1).failed == "missing: it is not there"
