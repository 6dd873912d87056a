"""What a stored result depends on, and which published number is stale."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest

from validation import published, results
from validation.experiment import Options, Picture, Run, discover
from validation.experiments.dam_break import claims as dam_claims
from validation.experiments.dam_break import runs as dam_runs
from validation.experiments.droplet import runs as droplet_runs
from validation.experiments.heat import runs as heat_runs
from validation.published import Item, Standing
from validation.results import Result

ROOT = Path(results.__file__).resolve().parent.parent


@pytest.fixture
def module(tmp_path):
    def write(text):
        path = tmp_path / "module.py"
        path.write_text(text)
        for remembered in (results.sources_digest, results._imported_by, results._tree, results._code_digest):
            remembered.cache_clear()
        return results.sources_digest(str(path))

    yield write
    for remembered in (results.sources_digest, results._imported_by, results._tree, results._code_digest):
        remembered.cache_clear()


def test_comments_docstrings_and_layout_do_not_count(module):
    plain = module("def f(x):\n    return x + 1\n")
    assert (
        module('"""Words."""\n\n\ndef f(x):  # more\n    """And more."""\n    return (x\n            + 1)\n') == plain
    )
    assert module("def f(x):\n    return x + 2\n") != plain
    assert module('def f(x):\n    return x + 1\n\n\nTEXT = """Words."""\n') != plain


def test_every_version_of_python_gives_the_same_digest(module):
    """The digest of a fixed text with f-strings, keyword arguments, classes and coroutines."""
    assert (
        module('''"""Words."""
def scaled(x, *, by=2.0):
    return [f"{a!r:>{by}}" for a in x if a is not None] and {"k": by * -1, **{}}
class Kept(dict):
    x: int = 0x10
async def later(): await None
''')
        == "43540ae886e92752"
    )


def test_another_method_does_not_count():
    behind = {file.relative_to(ROOT).as_posix() for file in results.modules_behind(Path(heat_runs.__file__))}
    assert {"refsim/heat/kernels.py", "refsim/heat/reference.py", "validation/running.py"} <= behind
    assert not any(place.startswith(("refsim/mpm/", "refsim/surface_tension/", "refsim/contract/")) for place in behind)
    assert results.sources_digest(dam_runs.__file__) != results.sources_digest(droplet_runs.__file__)


def test_what_draws_and_tells_does_not_count():
    """A claim's runs stand beside its verdicts; a picture that looks otherwise leaves all numbers as they are."""
    files = results.modules_behind(Path(dam_claims.__file__))
    behind = {file.name for file in files if file.parent.name == "validation"}
    assert "running.py" in behind
    assert not behind & {f"{name}.py" for name in results.PRESENTING}
    assert {f"{name}.py" for name in results.PRESENTING} <= {file.name for file in (ROOT / "validation").glob("*.py")}


PROGRAM = """
import sys
from refsim import Akinci2013, Box, BoxWalls, Gravity, Scene, Simulation, WeaklyCompressible
before = set(sys.modules)
scene = Scene(spacing=0.1, support_radius=0.2, dim=3, fluid=(Box(cells=(2, 2, 2)),), effects=(
    WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=0.1), Gravity(acceleration=(0.0, -9.81, 0.0)),
    Akinci2013(surface_tension=0.07), BoxWalls(lower=(0, 0, 0), upper=(1, 1, 1))))
Simulation(scene, "cpu").step()
print("\\n".join(sys.modules[name].__file__ for name in set(sys.modules) - before if name.startswith("refsim.")))
"""


def test_what_a_run_loads_counts(tmp_path):
    """Every module that is loaded only when a step is run is behind a file that imports the scene's effects."""
    file = tmp_path / "run.py"
    file.write_text(PROGRAM)
    found = subprocess.run(
        [sys.executable, file], capture_output=True, text=True, check=True, cwd=ROOT,
        env={"PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1", "REFSIM_CACHE_DIR": str(tmp_path)},
    )  # fmt: skip
    loaded = {Path(line) for line in found.stdout.split("\n") if line and not line.startswith(str(tmp_path))}
    assert ROOT / "refsim" / "surface_tension" / "akinci_2013" / "kernels.py" in loaded
    assert loaded <= set(results.modules_behind(file))


def run(context, value):
    return Result({"value": value})


ITEM = Item("picture", "one", "fake", "run fake", [Run("first", run, {"value": 1}, estimate=7.0)])


def test_a_record_holds_until_the_code_or_the_parameters_change(tmp_path, monkeypatch):
    path = tmp_path / "published.json"
    about = {"date": "2026-11-22", "commit": "abcdef1234", "seconds": 3.0, "machine": {"processor": "P", "cores": 2}}
    options = Options(figures=published.ROOT / "figures", results=published.ROOT / "results")
    published.record([(ITEM, [Result({}, {}, about), Result({}, {}, about)])], options, path)
    kept = published.read_records(path)["picture one"]
    assert (kept["seconds"], kept["commit"]) == (6.0, "abcdef1234")
    assert Standing(ITEM, kept).state == "holds"
    other = dataclasses.replace(ITEM, runs=[Run("first", run, {"value": 2}, estimate=7.0)])
    assert Standing(other, kept).state == "stale"
    assert (Standing(ITEM, {}).state, Standing(ITEM, {}).seconds) == ("stale", 7.0)
    monkeypatch.setattr(results, "sources_digest", lambda file: "another")
    assert Standing(ITEM, kept).state == "stale"


@pytest.mark.parametrize(
    "change", [{"quick": True}, {"backend": "cuda"}, {"figures": Path("elsewhere")}, {"results": Path("elsewhere")}]
)
def test_only_published_sizes_are_recorded(tmp_path, change):
    options = dataclasses.replace(
        Options(figures=published.ROOT / "figures", results=published.ROOT / "results"), **change
    )
    published.record([(ITEM, [Result({}, {}, {"seconds": 1.0})])], options, tmp_path / "published.json")
    assert not (tmp_path / "published.json").exists()


def test_pages_name_their_stale_pictures():
    page = "# A page\n\n![one](../figures/one.png) and ![two](../figures/two.webp)\n"
    once = published.marked(page, {"one", "three"})
    assert "last changed ([table](published.md)): `one`." in once
    assert published.marked(once, {"one", "three"}) == once
    assert published.marked(once, set()) == page


def test_every_picture_claim_and_hard_case_is_listed():
    items = published.everything(discover())
    pictures = {path.stem for path in (ROOT / "figures").glob("*.png")} | {
        path.stem for path in (ROOT / "figures").glob("*.webp")
    }
    # Studies are of scripts/study_examples.py; the others are drawn from the data of other pictures and checks.
    drawn = ("stability_matrix", "effects_cost", "device_limits", "cpu_scaling")
    pictures = {name for name in pictures if not name.startswith("study_") and not name.endswith("_parts")} - {*drawn}
    assert pictures <= {item.name for item in items.values() if item.kind == "picture"}
    assert {"claim mpm_momentum_none", "hard_case lost_particle"} & set(items)
    assert not set(published.read_records()) - set(items), "a record of what is no longer published"
    table = str(published.table([Standing(ITEM, {})]))
    assert "Stale: 1 of 1; renewing takes 7 s" in table
    assert "python -m validation run fake" in table


def test_a_part_gives_its_pictures():
    from validation.experiment import Part

    runs = [Run("a", run), Run("b", run)]
    pictures = (Picture("some", dict, dict, ("b",)), Picture("whole", dict, dict))
    made = published.items_of(Part("hard_case", "fake", "fake", runs, lambda results: (), pictures), "run fake")
    assert [(item.kind, item.name, [r.key for r in item.runs]) for item in made] == [
        ("picture", "some", ["b"]),
        ("picture", "whole", ["a", "b"]),
        ("hard_case", "a", ["a"]),
    ]
