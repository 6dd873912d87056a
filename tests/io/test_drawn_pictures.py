"""Pictures that scripts draw: each stored one has its function and a page, quick ones are drawn and hold."""

import numpy as np
import pytest
from PIL import Image

from scripts import page_pictures, pictures, schematics

FIGURES = pictures.ROOT / "figures"
LARGEST = 120_000  # bytes of a schematic


@pytest.mark.parametrize("name", schematics.SCHEMATICS)
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
