"""`refsim advise`: rows as text and JSON, the scene it writes, sentences for what is not in the table."""

import json

import pytest

from refsim.__main__ import main
from refsim.core.tables import in_time
from refsim.scene.files import load_scene, parse_scene
from refsim.scene.plan import make_plan
from refsim.study import advice
from refsim.study.cost import Prediction

SCENES = [
    (name, cell["error"])
    for name, row in advice.table().items()
    for cell in row.get("answers", ())
    if advice.named(cell).get("scene")
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["frnt"], "there is no observable 'frnt'; did you mean front?"),
        (["nothing-like-it"], "choose from front, droplet"),
        (["front", "--error", "2"], "an error of 2 is not possible; give a share between 0 and 1"),
        (["front", "--error", "0"], "an error of 0 is not possible"),
        (["front", "--error", "1e-5"], "the table ends at an error of 0.001"),
        (["heat", "--output", "heat.toml"], "has no scene; leave --output out"),
    ],
)
def test_bad_input_gets_a_sentence_and_code_2(folder, capsys, words, said):
    assert main(["advise", *words, "--measured"]) == 2
    assert said in capsys.readouterr().err
    assert not list(folder.iterdir())


def test_a_row_and_its_scene(folder, capsys):
    assert main(["advise", "droplet", "--error", "0.007", "--measured"]) == 0
    text = capsys.readouterr().out
    found = advice.find("droplet", 0.007)
    assert found.error == 0.005  # the largest of the table that is no larger
    for word in (
        "an error of 0.5 %",
        advice.named(found.cell)["setting"],
        "best peer",
        "wrote",
    ):
        assert word in text
    assert (folder / "droplet.toml").read_text() == found.scene
    assert load_scene("droplet.toml").dtype == "float32"
    assert main(["advise", "droplet", "--error", "0.005", "--measured"]) == 0  # the same file
    (folder / "droplet.toml").write_text("mine")
    capsys.readouterr()
    assert main(["advise", "droplet", "--error", "0.005", "--measured"]) == 2
    assert "droplet.toml is there already" in capsys.readouterr().err
    assert (folder / "droplet.toml").read_text() == "mine"
    assert main(["advise", "droplet", "--error", "0.005", "--measured", "--overwrite"]) == 0
    assert (folder / "droplet.toml").read_text() == found.scene


def test_with_gpu_the_answer_is_that_of_a_gpu(folder, capsys):
    assert main(["advise", "droplet", "--error", "0.005", "--measured", "--gpu"]) == 0
    text = capsys.readouterr().out
    found = advice.find("droplet", 0.005, "gpu")
    assert f"setting    {advice.named(found.cell, 'gpu')['setting']}; keeps" in text
    assert f"on {found.observable['gpu']}" in text
    assert text.endswith("refsim run droplet.toml --backend cuda\n")
    assert "best peer" not in text  # which is measured on a CPU
    assert (folder / "droplet.toml").read_text() == found.scene
    lacking = advice.Advice(found.observable, 0.005, {**found.cell, "gpu": None}, "gpu")
    assert "not measured on a GPU" in advice.text_of(lacking)


def test_between_two_rows_the_setting_above_counts_where_the_one_below_has_no_meaning():
    """An angle within 3 degrees, given as 0.033 of a right angle."""
    found = advice.find("contact_angle", 0.033)
    assert found.error == 0.033
    assert advice.named(found.cell)["keeps"] < 0.033
    assert "no_meaning" in advice.find("contact_angle", 0.01).cell
    assert "no_meaning" in advice.find("contact_angle", 0.012).cell  # which no setting keeps


@pytest.mark.parametrize(("name", "error"), SCENES)
def test_scenes_are_those_of_the_settings(name, error):
    found = advice.find(name, error)
    plan = make_plan(parse_scene(found.scene, name))
    cpu = advice.named(found.cell)
    per_particle = sum(plan.field_bytes().values())
    assert cpu["bytes"] == pytest.approx(per_particle * plan.grid.count)
    assert f"{plan.scene.dtype}" in cpu["setting"]


@pytest.mark.parametrize(("gains", "taken", "words"), [(1, 1, "one CPU thread of"), (8, 2, "2 CPU threads of")])
def test_seconds_here_are_the_prediction_s_share(monkeypatch, gains, taken, words):
    """With the threads that a run takes, at most the table's two."""
    given = []

    def predict(scene, backend, *, threads):
        given.append((scene.name, backend, threads))
        return Prediction(backend, 10.0)

    monkeypatch.setattr(advice, "predict", predict)
    monkeypatch.setattr(advice, "threads_for", lambda rows: gains)
    found = advice.find("droplet", 0.05)
    cpu = advice.named(found.cell)
    assert 0 < cpu["seconds"] < cpu["whole"]
    here = advice.scaled(found)
    assert here.own == pytest.approx(10.0 * cpu["seconds"] / cpu["whole"])
    assert f"{words} this machine" in advice.text_of(here)
    assert given == [("droplet", "cpu", taken)]
    monkeypatch.setattr(advice, "unavailable", lambda backend: "no device was found")
    assert "not predicted: no device was found" in advice.text_of(advice.scaled(advice.find("droplet", 0.05, "gpu")))


def test_what_has_no_meaning_and_what_is_not_advised_is_said(folder, capsys, monkeypatch):
    assert main(["advise", "detection_2d", "--error", "0.001"]) == 0
    assert "no meaning: which particles are surface" in capsys.readouterr().out
    row = advice.table()["droplet"]
    (cell,) = (cell for cell in row["answers"] if cell["error"] == 0.05)
    why = "not advised: the first setting has not settled"
    open_cell = cell | {"cpu": {"why": why, "notes": [], "read": cell["cpu"] | {"fastest": 0.125, "slowest": 0.25}}}
    monkeypatch.setattr(advice, "table", lambda: {"droplet": row | {"answers": [open_cell]}})
    assert main(["advise", "droplet", "--error", "0.05", "--measured"]) == 0
    said = capsys.readouterr().out
    assert why in said
    assert f"setting    {cell['cpu']['setting']}" in said
    assert f"{in_time(0.125)} to {in_time(0.25)}, not settled" in said
    assert [path.name for path in folder.iterdir()] == ["droplet.toml"]


def test_the_list_and_json(folder, capsys):
    assert main(["advise"]) == 0
    text = capsys.readouterr().out
    assert "surge front of a 2D dam break" in text
    assert main(["advise", "droplet", "--error", "0.05", "--measured", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["answer"]["error"] == 0.05
    assert found["seconds_here"] is None
    assert found["scene"] == "droplet.toml"
