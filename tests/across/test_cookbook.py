"""Recipes of docs/cookbook.md, the scene of docs/first_scene.md, and two programs by hand, each run and looked at."""

import json
import pathlib
import re

import numpy as np
import pytest

import refsim
from refsim.__main__ import main
from refsim.examples import mpm_by_hand, sph_by_hand
from scripts.cookbook import FOLDER, MADE, MEASURED, cards, page
from tests.across.test_docs import commands, understood
from tests.running import answer_of, python
from validation.drawing import LARGEST_PICTURE

LONG = ("dam_obstacle", "funnel", "mpm_droplet")  # 4 to 15 s each
RECIPES = pytest.mark.parametrize(
    "recipe", [pytest.param(r, id=r.scene, marks=[pytest.mark.slow] * (r.scene in LONG)) for r in MADE]
)


@RECIPES
def test_a_recipe_is_written_and_takes_a_step(recipe, tmp_path, monkeypatch):
    """By the NumPy references; that examples plan without a note is tested in tests/scene/test_scene_file.py."""
    monkeypatch.chdir(tmp_path)
    assert main(["example", recipe.scene]) == 0
    scene = refsim.load_scene(pathlib.Path(f"{recipe.scene}.toml"))
    assert recipe.at <= scene.end_time
    assert recipe.until < scene.end_time
    simulation = refsim.Simulation(scene, backend="numpy")
    simulation.step()
    assert np.isfinite(simulation.field("position")).all()
    assert json.loads(MEASURED.read_text())[recipe.scene]["particles"] == len(simulation.field("position"))


def test_the_page_has_every_recipe_with_commands_that_are_understood():
    text = "\n".join(page())
    assert len(MADE) == len(re.findall("^## ", text, re.M)) == len(re.findall("^```toml$", text, re.M)) == 15
    said = list(commands(text))
    assert len(said) == 3 * 15 + 1  # one is stopped and resumed
    assert [words for words in said if not understood(words)] == []
    anchors = {re.sub(r"[^\w-]", "", line.lower().replace(" ", "-")) for line in re.findall("^## (.*)$", text, re.M)}
    assert set(re.findall(r"cookbook\.md#([\w-]+)", "\n".join(cards()))) == anchors
    for recipe in MADE:
        assert 0 < (FOLDER / f"{recipe.scene}.webp").stat().st_size < LARGEST_PICTURE


PAGE = (pathlib.Path(__file__).parents[2] / "docs" / "first_scene.md").read_text(encoding="utf-8")


def test_each_edit_is_planned_and_the_scene_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    scene = pathlib.Path("pool.toml")
    scene.touch()
    codes = [main(["plan", "pool.toml"])]
    assert "'spacing'" in capsys.readouterr().err  # the first key that a scene must have
    for kind, text in re.findall(r"^```(toml|text)\n(.*?)^```$", PAGE, re.M | re.S):
        if kind == "text":
            pathlib.Path("column.obj").write_text(text)
            continue
        with scene.open("a") as file:
            file.write(f"{text}\n")
        codes.append(main(["plan", "pool.toml"]))
    assert codes == [2, 0, 0, 0, 0, 0, 0, 0]
    said = capsys.readouterr().out
    assert "640 particles" in said
    assert "Note: weakly_compressible: a flow" not in said
    assert main(["run", "pool.toml", "--backend", "numpy", "--until", "1e-3", "--every", "1e-3", "--quiet"]) == 0
    assert capsys.readouterr().out.endswith("next: refsim view pool_run\n")
    assert main(["render", "pool_run", "--gauges"]) == 0
    assert pathlib.Path("pool_run_gauges.png").stat().st_size > 5000
    assert main(["view", "pool_run", "--html", "pool.html"]) == 0


@pytest.mark.slow
def test_the_sph_front_is_that_of_the_experiment():
    """Martin & Moyce 1952, n^2 = 2: Z = x/a at T = t sqrt(2 g/a); within 12 %."""
    said = []
    times, fronts, x, _ = sph_by_hand.dam_break(until=0.25, report=said.append)
    assert (len(said), len(x)) == (3, 200)
    T, Z = times * np.sqrt(2 * 9.81 / 0.5), fronts / 0.5
    for at, expected in ((0.832, 1.217), (1.219, 1.474)):
        assert np.interp(at, T, Z) == pytest.approx(expected, rel=0.12)


def test_the_mpm_block_falls_and_bounces():
    said = []
    times, heights, x = mpm_by_hand.bounce(side=12, until=0.4, report=said.append)
    falling = times < 0.15
    np.testing.assert_allclose(heights[falling], 0.425 - 0.5 * 9.81 * times[falling] ** 2, atol=2e-3)
    lowest = heights.argmin()
    assert heights[lowest] < 0.24
    assert heights[-1] > heights[lowest] + 0.1
    assert x[:, 1].min() > mpm_by_hand.WALL * mpm_by_hand.WIDTH
    assert said


@pytest.mark.parametrize("name", ["sph_by_hand", "mpm_by_hand"])
def test_a_program_is_written_and_runs_with_numpy_alone(name, tmp_path, capsys):
    assert f"python {tmp_path / name}.py" in answer_of(capsys, ["example", name, "--output", str(tmp_path)]).out
    text = (tmp_path / f"{name}.py").read_text()
    assert len(text.splitlines()) <= 100
    short = f"import {name} as p, sys; p.STEP *= 1; p.dam_break(4, 4, 0.02) if 'sph' in '{name}' else p.bounce(4, 0.02)"
    blocked = "import sys; sys.modules |= dict.fromkeys(('scipy', 'numba', 'matplotlib', 'refsim'));"
    python("-W", "error", "-c", blocked + short, folder=tmp_path)
