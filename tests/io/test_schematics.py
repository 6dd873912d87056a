"""The schematics: the script draws each, the stored pictures are those, and what they show holds."""

import importlib.util
import pathlib
import sys

import numpy as np
import pytest
from PIL import Image

ROOT = pathlib.Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("schematics", ROOT / "scripts" / "schematics.py")
script = sys.modules.setdefault(spec.name, importlib.util.module_from_spec(spec))
spec.loader.exec_module(script)

STORED = ROOT / "figures" / "schematics"
LARGEST = 120_000  # bytes of a picture


def test_stored_pictures_belong_to_names_and_are_shown():
    assert {path.name for path in STORED.iterdir()} == {f"{name}.png" for name in script.SCHEMATICS}
    page = (ROOT / "docs" / "lessons.md").read_text()
    for name in script.SCHEMATICS:
        assert f"(../figures/schematics/{name}.png)" in page
        assert (STORED / f"{name}.png").stat().st_size <= LARGEST


@pytest.mark.parametrize("name", script.SCHEMATICS)
def test_each_is_drawn(name, tmp_path, capsys):
    assert script.main([name, "--folder", str(tmp_path)]) == 0
    path = tmp_path / f"{name}.png"
    assert capsys.readouterr().out == f"{path}\n"
    assert path.stat().st_size <= LARGEST
    with Image.open(path) as picture:
        assert picture.mode == "P"
        seen = np.asarray(picture.convert("L"))
    assert 0.02 < (seen < 250).mean() < 0.9


def test_an_unknown_name_is_refused(capsys):
    assert script.main(["fan_scam"]) == 2
    assert "did you mean 'fan_scan'?" in capsys.readouterr().err


def test_the_cases_of_marching_cubes_are_the_fifteen_of_lorensen_and_cline():
    assert len(script.cases()) == 15
    assert len(set(script.rotations())) == 24


def test_a_region_does_not_cross_what_has_melted():
    whole = script.cut_body((7, 5, 5), set())
    slit = script.cut_body((7, 5, 5), {(4, b) for b in range(5)})
    for (cell, _, region, _), farthest in ((whole, 5), (slit, 3)):
        here = np.flatnonzero((cell == (3, 2, 2)).all(1))[0]
        assert cell[region[here][region[here] >= 0], 0].max() == farthest
