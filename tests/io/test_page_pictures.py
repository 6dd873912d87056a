"""The pictures of pages about use: each stored one has its function and a page, and the quick ones are drawn."""

import importlib.util
import pathlib
import sys

import pytest
from PIL import Image

from refsim.commands import COMMANDS, discover

ROOT = pathlib.Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("page_pictures", ROOT / "scripts" / "page_pictures.py")
script = sys.modules.setdefault(spec.name, importlib.util.module_from_spec(spec))
spec.loader.exec_module(script)


def test_stored_pictures_have_a_function_and_a_page():
    assert {path.name for path in (ROOT / "figures" / "pages").iterdir()} == set(script.PICTURES)
    pages = "".join(path.read_text() for path in (ROOT / "docs").glob("*.md"))
    assert all(f"(../figures/pages/{name})" in pages for name in script.PICTURES)


OF_FILES = ("verdicts.png", "main_job.png", "commands.png", "public.png")


@pytest.mark.parametrize("name", OF_FILES)
def test_what_is_drawn_of_files_is_what_is_stored(name, tmp_path):
    """Those without a run, of words or of numbers on file: a stored picture that differs is out of date."""
    assert script.main([name, "--folder", str(tmp_path)]) == 0
    with Image.open(tmp_path / name) as drawn, Image.open(ROOT / "figures" / "pages" / name) as stored:
        assert drawn.size == stored.size
        ours, theirs = (picture.convert("L").tobytes() for picture in (drawn, stored))
    differing = sum(abs(a - b) > 60 for a, b in zip(ours, theirs))
    assert differing < 0.01 * len(ours)


def test_the_commands_that_are_drawn_are_there():
    discover()
    named = [words.split() for words in (*script.OF_A_SCENE, *script.OF_A_RUN)]
    assert {words[1] for words in named if words[0] == "refsim"} <= set(COMMANDS)


def test_an_unknown_name_is_refused(capsys):
    assert script.main(["style.webp"]) == 2
    assert "did you mean 'styles.webp'?" in capsys.readouterr().err
