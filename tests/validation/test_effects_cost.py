"""The page on what effects cost: stored launches and bytes are those of the plans; the command makes the page."""

import itertools
import json

import numpy as np
import pytest

from refsim import Simulation
from validation import effects_cost
from validation.drawing import style
from validation.effects_cost import ladders

RUNGS = [(name, k) for name, ladder in ladders().items() for k in range(len(ladder.rungs))]
AGAIN = "python -m validation effects"


@pytest.fixture(scope="module")
def stored():
    return effects_cost.stored()


@pytest.mark.parametrize(("name", "k"), RUNGS)
def test_stored_launches_and_bytes_are_those_of_the_plan(stored, name, k):
    kept, rung = stored["ladders"][name]["rungs"][k], ladders()[name].rungs[k]
    assert kept["words"] == rung.words, AGAIN
    for backend in ("cpu", "cuda"):
        assert kept[backend] == effects_cost.planned(rung.scene, backend), AGAIN


@pytest.mark.parametrize("name", list(ladders()))
def test_a_ladder_only_adds(name):
    """No rung launches less, or holds less, than the one before it."""
    rungs = [effects_cost.planned(rung.scene, "cuda") for rung in ladders()[name].rungs]
    for before, after in itertools.pairwise(rungs):
        assert len(after["operations"]) >= len(before["operations"])
        assert after["fields"] >= before["fields"]
    assert rungs[-1]["fields"] > rungs[0]["fields"]
    small = [effects_cost.planned(rung.scene, "cuda") for rung in ladders(True)[name].rungs]
    assert [r["operations"] for r in small] == [r["operations"] for r in rungs]
    assert [r["fields"] for r in small] == [r["fields"] for r in rungs]


def test_the_page_is_what_the_command_makes(stored):
    text = effects_cost.PAGE.read_text()
    assert effects_cost.page(text, stored) == text, f"{AGAIN} --draw"
    with style():
        figure = effects_cost.picture(stored)
    said = " ".join(text.get_text() for axes in figure.axes for text in axes.texts)
    device, _ = effects_cost.gpu_seconds()
    assert (effects_cost.NOT_YET in said) == (not device)
    import matplotlib.pyplot as plt

    plt.close(figure)


def test_a_run_that_is_not_its_plan_is_told(monkeypatch):
    scene = ladders(True)["sph"].rungs[0].scene
    simulation = Simulation(scene, "numpy")
    operations = effects_cost.launched(simulation)
    assert effects_cost.differences(simulation, operations) == []
    (said,) = effects_cost.differences(simulation, operations[1:])
    assert "the plan says" in said
    simulation.fields["spare"] = np.zeros(3)
    (said,) = effects_cost.differences(simulation, operations)
    assert said.startswith("the fields hold ")


def test_gpu_readings_come_from_the_newest_report(tmp_path):
    assert effects_cost.gpu_seconds(tmp_path) == ("", {})

    def report(name, date, value):
        rows = [{"name": "step: liquid", "value": value}, {"name": "kernels a step: liquid", "value": 9}]
        tasks = [
            {"task": "device", "rows": [{"name": "device", "value": name}], "error": None, "date": date},
            {"task": "effects sph", "rows": rows, "error": None, "date": date},
        ]
        (tmp_path / f"{name}.json").write_text(json.dumps({"whole check": {"tasks": tasks}}))

    report("newer", "2026-02-01 10:00 UTC", 50.0)
    report("older", "2026-01-01 10:00 UTC", 70.0)
    assert effects_cost.gpu_seconds(tmp_path) == ("newer, 2026-02-01", {("sph", "liquid"): pytest.approx(5e-5)})


def test_a_time_that_has_not_settled_is_a_range():
    assert effects_cost.microseconds([1e-3] * 5) == "1,000"
    assert effects_cost.microseconds([1e-3, 2e-3, 1e-3, 3e-3, 1e-3]) == "\u25cb 1,000 to 3,000"
