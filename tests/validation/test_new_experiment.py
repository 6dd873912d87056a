"""CONTRIBUTING.md adds an experiment: its files are cut out of the page, put beside the others and performed."""

import json
import pathlib
import re
import sys

import pytest

from validation import checks, experiments
from validation.experiment import Options, discover
from validation.perform import perform

ROOT = pathlib.Path(__file__).parents[2]
FILE = re.compile(r"^```\w+\n# file: validation/experiments/(\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture
def free_fall(tmp_path, monkeypatch):
    """The experiment of the page, in a folder of its own."""
    found: dict[str, str] = {}
    for name, text in FILE.findall((ROOT / "CONTRIBUTING.md").read_text()):  # a file may stand in two parts
        found[name] = f"{found[name]}\n\n{text}" if name in found else text
    assert {pathlib.Path(name).name for name in found} == {"runs.py", "expected.toml", "pictures.py"}
    for name, text in found.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(experiments, "__path__", [str(tmp_path)])
    monkeypatch.setattr(checks, "FOLDER", tmp_path)
    discover.cache_clear()
    yield discover()["free_fall"]
    discover.cache_clear()
    for name in [name for name in sys.modules if name.startswith("validation.experiments.free_fall")]:
        monkeypatch.delitem(sys.modules, name)


def test_the_experiment_of_the_page_is_found_and_holds(free_fall, tmp_path):
    assert list(discover()) == ["free_fall"]
    options = Options(results=tmp_path / "results", figures=tmp_path / "figures", backend="numpy")
    (performed,) = perform([free_fall.part(options)], options)
    assert {check.name: check.verdict for check in performed.checks} == {"fallen.short": "pass", "fallen.long": "pass"}
    assert [path.name for path in performed.drawn.values()] == ["free_fall.png"]
    assert set(json.loads((options.figures / "free_fall.json").read_text())) == {"short", "long", "measured"}
    claim = checks.read("free_fall", checks.CLAIM)["parabola"]
    assert claim.judge(free_fall.claims["parabola"].values(performed.results)) == claim.verdict == "confirmed"
