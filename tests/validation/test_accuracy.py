"""Panels in the repository: the page that their points make, their runs without a packaged scene, and readings."""

import re
import sys
import tomllib
from dataclasses import replace

import msgspec
import pytest

from refsim.study.panels import FOLDER, OWN, abouts, panel, parse
from refsim.study.panels.scenes import PACKED, SCENE_FACTORIES
from validation import accuracy, accuracy_page
from validation.peers import in_turns
from validation.reading import reading


def test_the_page_is_what_the_stored_points_make():
    assert accuracy_page.page() == accuracy_page.PAGE.read_text(), "python -m validation accuracy --draw"


def test_a_column_of_seconds_has_one_machine():
    """Panels of two processors have two tables, two GPUs have two columns; a panel of two processors is refused."""
    known = [panel("front"), panel("vortex_decay"), panel("melt_front")]
    text = "\n".join(accuracy_page.tables(known))
    assert text.count("| observable |") == len(re.findall("^CPU: (.*)", text, re.MULTILINE)) == 2
    assert text.count("| NVIDIA H100 80GB HBM3 | NVIDIA H200 |") == 1
    row = next(line for line in text.splitlines() if "80 spacings" in line)
    assert [cell.strip() for cell in row.split("|")][-5:-1] == ["1.21 s", "", "307 ms", ""]
    other = [msgspec.structs.replace(place, machine=f"machine {k}") for k, place in enumerate(known[0].places)]
    with pytest.raises(ValueError, match="front was not timed on one processor"):
        accuracy_page.tables([replace(known[0], places=tuple(other))])


@pytest.mark.parametrize("name", abouts())
def test_every_panel_can_be_measured_anew(name):
    """By its packaged scene, or by one that a function makes; other programs' points by a run that is there."""
    written = "fluid" in tomllib.loads((FOLDER / f"{name}.toml").read_text()) or name == "spinning_body"
    assert [written, name in SCENE_FACTORIES, name in PACKED].count(True) == 1
    programs = {p.program for p in panel(name).points.values()} - {OWN}
    assert bool(programs) == (name in accuracy.PEERS)
    assert name not in accuracy.PEERS or callable(accuracy.reader(accuracy.PEERS[name]))


def test_a_panel_is_measured_and_stored(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(accuracy, "STORED", tmp_path)
    monkeypatch.setattr(accuracy.accuracy_page, "write", lambda: None)
    keys = ("n6_w2_s200", "n4_w2_s200")
    few = replace(panel("spinning_body"), points={key: panel("spinning_body").points[key] for key in keys})
    one = type("One", (), {"cache_clear": lambda self: None, "__call__": lambda self, name: few})()
    monkeypatch.setattr(accuracy, "panel", one)
    monkeypatch.setattr(accuracy, "broken", lambda judged: [])
    value, scale, _ = few.reference()
    read = lambda of, point, scene: reading(value + scale * point.error, 1.0, 3, 200)  # noqa: E731
    monkeypatch.setattr(sys.modules["refsim.study.panels.measured"], "reading_of", read)
    assert accuracy.perform(["spinning_body"], readings=2, write=True) == 0
    stored = parse((tmp_path / "spinning_body.json").read_text())
    found = {key: point for key, point in stored.points.items() if point.place >= 0}
    assert found.keys() == set(keys)
    for key, point in found.items():
        assert point.error == pytest.approx(few.points[key].error)
        assert len(point.seconds) == 2
        assert stored.places[point.place].commit


def test_programs_take_turns():
    """Ratios are those of a round; one program that is not there ends it."""
    theirs, ours, done = iter([2.0, 6.0, 4.0]), iter([1.0, 2.0, 4.0]), []
    found = in_turns(3, lambda: {"seconds": next(theirs), "version": "1"}, lambda: next(ours), done.append, 2)
    assert (found["ratios"], found["ratio"], found["missing"]) == ([2.0, 3.0, 1.0], 2.0, "")
    assert found["peer"] == {"median": 2.0, "low": 1.0, "high": 3.0}
    assert done == [1 / 3, 2 / 3, 1.0]
    assert in_turns(3, lambda: {"missing": "it is not there"}, float, print) == {"missing": "it is not there"}
