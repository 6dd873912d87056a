"""The recipes of docs/cookbook.md: each is a packaged scene that takes a step and has a picture."""

import json
import pathlib
import re

import numpy as np
import pytest

import refsim
from refsim.__main__ import main
from scripts.cookbook import FOLDER, MADE, MEASURED, cards, page
from tests.across.test_docs import commands, understood
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
