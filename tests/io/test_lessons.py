"""The lessons: what each needs, its notebook, lesson 1 with its answers; pictures that scripts draw."""

import ast
import configparser
import importlib
import json
import os
import pathlib
import shlex

import numpy as np
import pytest
from PIL import Image

from refsim.__main__ import main
from refsim.io.exercises import cells, lessons, notebook
from scripts import lessons as runner
from scripts import page_pictures, pictures, schematics

ROOT = pathlib.Path(__file__).parents[2]
LESSONS = lessons()
FIRST = "1_surface_particles"
TOY = (
    "---\na: 1\n---\n# T\n\n```{code-cell} python\na = 1\n```\n\n<details><summary>Answer</summary>\n\n```python\n"
    "b = a + 1\n```\n\n</details>\n"
)
every = pytest.mark.parametrize("name", LESSONS)


@every
def test_a_lesson_is_a_notebook(name):
    made = json.loads(notebook(LESSONS[name]))
    assert (made["nbformat"], made["nbformat_minor"]) == (4, 5)
    assert len({cell["id"] for cell in made["cells"]}) == len(made["cells"])
    kinds = {"markdown": {"cell_type", "id", "metadata", "source"}}
    kinds["code"] = kinds["markdown"] | {"execution_count", "outputs"}
    for cell in made["cells"]:
        assert set(cell) == kinds[cell["cell_type"]]
    code = [cell["source"] for cell in made["cells"] if cell["cell_type"] == "code" and not cell["metadata"]]
    assert code == [cell.text.strip() for cell in cells(LESSONS[name]) if cell.kind == "code"]
    ast.parse("\n".join(code))


def test_pieces_of_a_lesson_are_executed_and_held_to_their_judges():
    assert [cell.kind for cell in cells(TOY)] == ["markdown", "code", "markdown", "answer", "markdown"]
    made = json.loads(notebook(TOY))["cells"]
    assert [cell["cell_type"] for cell in made] == ["code", "markdown", "code", "code"]
    assert made[3]["source"] == "# @title Worked answer: run it, or unfold and read it\nb = a + 1"
    assert runner.run_lesson("toy", TOY)["b"] == 2
    with pytest.raises(NameError):
        runner.run_lesson("toy", TOY.replace("a + 1", "c"))
    asked = f"{TOY}\n```{{judge}} 1\nright = 'yes'\n```\n\n"
    begin = "from refsim.io.exercises import Verdict\nclass check:\n    verdicts = {1: Verdict(%s, 'because')}\n"
    assert runner.run_lesson("toy", asked.replace("a = 1\n", begin % True + "a = 1\n"))["b"] == 2
    with pytest.raises(ValueError, match="exercise 1 of toy: because"):
        runner.run_lesson("toy", asked.replace("a = 1\n", begin % False + "a = 1\n"))


def test_a_lesson_is_held_to_the_words_that_it_has_printed(monkeypatch, tmp_path):
    (tmp_path / "docs" / "lessons").mkdir(parents=True)
    (tmp_path / "docs" / "lessons" / "toy.ipynb").write_text(notebook(TOY, ["", "cost [s]\n--------\n  0.0283\n", ""]))
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    runner.hold_to_stored("toy", ["", "cost [s]\n----\n0.3\n", ""])  # a number of another width
    runner.hold_to_stored("toy", ["", "cost [s]\n----\n0.3*\nnote: * seconds of 1 run have not settled\n", ""])
    with pytest.raises(ValueError, match="write the notebooks anew"):
        runner.hold_to_stored("toy", ["", "price [s]\n--------\n  0.0283\n", ""])


def test_binder_starts_each_lesson_in_an_environment_that_has_refsim(monkeypatch, tmp_path):
    """The links of the site, the notebooks, and the files by which Binder makes the environment."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    pages, release = importlib.import_module("site_pages"), importlib.import_module("scripts.release")
    listed = pages.lessons_with_binder((ROOT / "docs" / "lessons.md").read_text(), "https://github.com/a/refsim/")
    settings = configparser.ConfigParser(interpolation=None)
    settings.read(ROOT / "setup.cfg")
    for name in LESSONS:
        notebook = f"docs/lessons/{name}.ipynb"
        link = f"(https://mybinder.org/v2/gh/a/refsim/v{settings['metadata']['version']}?urlpath=lab/tree/{notebook})"
        assert (ROOT / notebook).is_file()
        page = pages._linked(pages.lesson(name, "https://github.com/a/refsim"))
        assert listed.count(link) == page.count(link) == 1
        assert "mybinder" not in pages.lesson(name)
    assert "/v2/gl/a%2Fb%2Frefsim/" in release.binder("https://gitlab.com/a/b/refsim", "x")
    assert "/v2/git/https%3A%2F%2Fexample.org%2Frefsim/" in release.binder("https://example.org/refsim", "x")
    version = (ROOT / "binder" / "runtime.txt").read_text().strip().removeprefix("python-")
    assert f"Programming Language :: Python :: {version}" in settings["metadata"]["classifiers"]
    required = (ROOT / "binder" / "requirements.txt").read_text()
    assert [line for line in required.splitlines() if not line.startswith("#")] == ["."]  # this repository
    assert len(required) > 40  # repo2docker guesses a shorter file's encoding wrongly, and installs before it copies
    script = ROOT / "binder" / "postBuild"
    assert os.access(script, os.X_OK)
    words = shlex.split(script.read_text().splitlines()[-1])
    assert words[:3] == ["python", "scripts/lessons.py", "--notebooks"]
    monkeypatch.setattr(runner, "run_lesson", lambda *given: given[3].extend([""] * 99))
    assert runner.main([words[2], str(tmp_path), FIRST]) == 0
    assert (tmp_path / f"{FIRST}.ipynb").is_file()


def test_example_writes_the_lessons(tmp_path, capsys):
    given = ["example", "--lessons", str(tmp_path / "mine")]
    assert main(given) == 0
    said = capsys.readouterr().out
    assert f"jupyter lab {tmp_path / 'mine' / next(iter(LESSONS))}.ipynb" in said
    written = {path.name for path in (tmp_path / "mine").iterdir()}
    assert written == {f"{name}.ipynb" for name in LESSONS}
    assert "{judge}" not in (tmp_path / "mine" / f"{FIRST}.ipynb").read_text()


FIGURES = pictures.ROOT / "figures"
LARGEST = 120_000  # bytes of a schematic
SLOW = dict.fromkeys(("level_set.png", "marching_cases.png"), pytest.mark.slow)  # two thirds of the time of all


@pytest.mark.parametrize("name", [pytest.param(n, marks=SLOW.get(n, ())) for n in schematics.SCHEMATICS])
def test_each_schematic_is_drawn(name, tmp_path, capsys):
    assert pictures.command("", schematics.SCHEMATICS, tmp_path, [name]) == 0
    assert capsys.readouterr().out == f"{tmp_path / name}\n"
    assert (tmp_path / name).stat().st_size <= LARGEST
    with Image.open(tmp_path / name) as picture:
        assert picture.mode == "P"
        seen = np.asarray(picture.convert("L"))
    assert 0.02 < (seen < 250).mean() < 0.9


def test_what_is_drawn_of_files_is_what_is_stored(tmp_path):
    """A stored picture that differs is out of date."""
    assert pictures.command("", page_pictures.PICTURES, tmp_path, ["verdicts.png"]) == 0
    with Image.open(tmp_path / "verdicts.png") as drawn, Image.open(FIGURES / "pages" / "verdicts.png") as stored:
        assert drawn.size == stored.size
        ours, theirs = (picture.convert("L").tobytes() for picture in (drawn, stored))
    assert sum(abs(a - b) > 60 for a, b in zip(ours, theirs)) < 0.01 * len(ours)


def test_an_unknown_name_is_refused(tmp_path, capsys):
    assert pictures.command("", schematics.SCHEMATICS, tmp_path, ["fan_scam.png"]) == 2
    assert "did you mean 'fan_scan.png'?" in capsys.readouterr().err
