"""Experiments: reuse of results, verdicts, exit codes, JSON, drawing; one is added; the main job."""

import dataclasses
import io
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from refsim.core.errors import InputError, RunStopped
from scripts import reproduce as script
from tests.running import ROOT, python, rows
from validation import __main__ as command
from validation import checks, experiments, judging, results
from validation import perform as performing
from validation.checks import Check
from validation.experiment import Experiment, Options, Picture, RunSpec, discover
from validation.experiments.dam_break import runs as dam_runs
from validation.experiments.droplet import runs as droplet_runs
from validation.experiments.heat import runs as heat_runs
from validation.report import report
from validation.results import Result
from validation.running import Context
from validation.tables import Table

pytestmark = pytest.mark.usefixtures("coarse_pictures")
CALLS = []


def doubled(context, value):
    CALLS.append(value)
    context.progress(0.5)
    return Result({"double": 2 * value, "odd": float("nan")}, {"line": np.arange(value)})


def stopping(context):
    raise RunStopped("collapsed", "It collapsed.")


def draw_line(data):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(2, 2))
    axes.plot(data["line"])
    return figure


def measurement(value=1.0, verdict="pass", name="double"):
    return Check(name, "twice the value", value, "m", "2", "at most 5", verdict)


def fake(value=2, judge=None, function=doubled, parameters=None):
    judge = judge or (lambda found: [measurement(found["one"].values["double"])] if "one" in found else [])
    return Experiment(
        name="fake", title="an experiment for tests",
        runs=lambda options: [
            RunSpec("one", function, {"value": value} if parameters is None else parameters),
            RunSpec("other", function, {"value": 9}, skip="quick" if options.quick else ""),
        ][: 1 if parameters is not None else 2],
        checks=lambda found, check: check.results.extend(judge(found)),
        pictures=(Picture("line", lambda found: {"line": found["one"].arrays["line"]}, draw_line, ("one",)),),
        tables=lambda found: [Table("A table", ["a", "b"], [["x", 1.5], ["y", None]])],
    )  # fmt: skip


@pytest.fixture
def options(tmp_path):
    CALLS.clear()
    return Options(quick=True, results=tmp_path / "results", figures=tmp_path / "figures")


def perform(experiment, options, **more):
    return performing.perform([experiment.part(options)], options, **more)


def test_results_are_kept_by_their_parameters_and_sources_and_reused(options, monkeypatch):
    (first,) = perform(fake(), options)
    (second,) = perform(fake(), options)
    assert (CALLS, second.reused) == ([2], ["one"])
    assert second.results["one"].values == first.results["one"].values == {"double": 4, "odd": None}
    assert second.results["one"].arrays["line"].tolist() == [0, 1]
    about = second.results["one"].about
    assert about["parameters"] == {"value": 2}
    assert {"date", "machine", "seconds"} <= set(about)
    perform(fake(value=3), options)
    assert (CALLS, len(list((options.results / "fake").iterdir()))) == ([2, 3], 2)
    perform(fake(), dataclasses.replace(options, fresh=True))
    monkeypatch.setattr(results, "sources_digest", lambda file: "another")
    perform(fake(), options)
    assert CALLS == [2, 3, 2, 2]


def test_a_damaged_result_is_said_set_aside_and_computed_anew(options, capsys):
    perform(fake(), options)
    (folder,) = (options.results / "fake").iterdir()
    about = json.loads((folder / "result.json").read_text())
    old = json.dumps({name: about[name] for name in ("about", "values")})
    for number, (name, damage) in enumerate([
        ("result.json", lambda content: b"{"),
        ("result.json", lambda content: content.replace(b'"double": 4', b'"double": 7')),
        ("result.json", lambda content: old.encode()),
        ("arrays.npz", lambda content: content[:-1] + b"\1"),
        ("arrays.npz", lambda content: b""),
        ("arrays.npz", None),
    ], 2):  # fmt: skip
        whole = (folder / name).read_bytes()
        (folder / name).unlink()
        if damage is not None:
            assert damage(whole) != whole
            (folder / name).write_bytes(damage(whole))
        perform(fake(), options)
        assert len(CALLS) == number
        assert f"{folder} is damaged" in capsys.readouterr().err
        assert len(list(folder.parent.glob("*.damaged*"))) == number - 1
    perform(fake(), options)
    assert len(CALLS) == 7


def test_a_stopped_run_is_reported_and_the_others_go_on(options):
    both = [fake(function=stopping, parameters={}), fake(judge=lambda found: [measurement(verdict="fail")])]
    outcomes = performing.perform([each.part(options) for each in both], options)
    assert performing.exit_code(outcomes) == 3
    assert "It collapsed." in outcomes[0].stopped["one"]
    assert outcomes[1].checks
    assert outcomes[0].drawn == {}
    text = io.StringIO()
    report(outcomes, text)
    assert "one stopped. It collapsed." in text.getvalue()


def test_command_prints_one_json_object(options, monkeypatch, capsys):
    monkeypatch.setattr(judging, "discover", lambda: {"fake": fake()})
    folders = ["--results", str(options.results), "--figures", str(options.figures)]
    assert command.main(["run", "fake", "--quick", "--json", *folders]) == 0
    printed = capsys.readouterr()
    entry = {"value": 4.0, "unit": "m", "paper": "2", "bar": "at most 5", "verdict": "pass"}
    assert json.loads(printed.out) == {"double": entry}
    assert "A table" in printed.err
    assert "verdict" in printed.err
    assert command.main(["run", "fake", "--quick", *folders]) == 0
    printed = capsys.readouterr()
    assert "twice the value" in printed.out
    assert "reused one" in printed.out


@pytest.mark.parametrize(("arguments", "said"), rows(__file__, "bad_input"))
def test_bad_input_gets_a_sentence_and_code_2(arguments, said, tmp_path, capsys):
    folders = ["--results", str(tmp_path / "r"), "--figures", str(tmp_path / "f")]
    given = folders if arguments[0] not in ("accuracy", "attack", "laws") else ()
    assert command.main([*arguments, *given]) == 2
    assert said in capsys.readouterr().err


def test_pictures_are_drawn_from_their_files_alone(options, monkeypatch):
    case = fake()
    perform(case, options)
    picture = options.figures / "line.png"
    before = picture.read_bytes()
    stored = json.loads((options.figures / "line.json").read_text())
    assert stored.pop("measured")["command"] == "python -m validation run fake"
    assert stored == {"line": [0, 1]}
    picture.unlink()
    monkeypatch.setattr(results, "load", None)
    CALLS.clear()
    performing.redraw(case.pictures[0], options.figures)
    assert (picture.read_bytes(), CALLS) == (before, [])
    with pytest.raises(InputError, match="run the experiment first"):
        performing.redraw(case.pictures[0], options.figures / "nowhere")


def test_ledger_finds_a_lost_particle_and_gained_energy():
    simulation = Context().simulation(dam_runs.column_scene(4), "numpy")
    simulation.evaluate()
    ledger = dam_runs.Ledger(simulation, (1.0, 4.0, 1.0))
    ledger.add(simulation)
    ledger.energy.append(1.5 * ledger.energy[0])
    simulation.fields["position"][0] = (-5.0, 0.0, 0.0)
    values = ledger.values(simulation)
    assert (values["lost_particles"], values["energy_rise"]) == (1, pytest.approx(0.5))


def test_the_main_job_needs_no_package_of_the_tests():
    """`pip install -e .` is all that scripts/reproduce.py has; an attack says what it lacks."""
    code = (
        "import sys; sys.modules['hypothesis'] = None; import scripts.reproduce; from validation.__main__ import main;"
        " sys.exit(main(['attack']))"
    )
    assert "Hypothesis is not installed" in python("-c", code, code=2).stderr


FILE = re.compile(r"^```\w+\n# file: validation/experiments/(\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture
def free_fall(tmp_path, monkeypatch):
    """The experiment of the page, in a folder of its own."""
    found: dict[str, str] = {}
    for name, text in FILE.findall((ROOT / "CONTRIBUTING.md").read_text()):  # a file may stand in two parts
        found[name] = f"{found[name]}\n\n{text}" if name in found else text
    assert {Path(name).name for name in found} == {"runs.py", "expected.toml", "pictures.py"}
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
    (performed,) = perform(free_fall, options)
    assert {check.name: check.verdict for check in performed.checks} == {"fallen.short": "pass", "fallen.long": "pass"}
    assert [path.name for path in performed.drawn.values()] == ["free_fall.png"]
    assert set(json.loads((options.figures / "free_fall.json").read_text())) == {"short", "long", "measured"}
    claim = checks.read("free_fall", checks.CLAIM)["parabola"]
    assert claim.judge(free_fall.claims["parabola"].values(performed.results)) == claim.verdict == "confirmed"


@pytest.fixture
def module(tmp_path):
    def write(text):
        path = tmp_path / "module.py"
        path.write_text(text)
        for remembered in (results.sources_digest, results._digest_of):
            remembered.cache_clear()
        return results.sources_digest(str(path))

    yield write
    for remembered in (results.sources_digest, results._digest_of):
        remembered.cache_clear()


def test_comments_docstrings_and_layout_do_not_count(module):
    plain = module("def f(x):\n    return x + 1\n")
    assert (
        module('"""Words."""\n\n\ndef f(x):  # more\n    """And more."""\n    return (x\n            + 1)\n') == plain
    )
    assert module("def f(x):\n    return x + 2\n") != plain
    assert module('def f(x):\n    return x + 1\n\n\nTEXT = """Words."""\n') != plain


def test_refsim_and_imports_of_validation_count_and_what_presents_does_not():
    behind = {file.relative_to(ROOT).as_posix() for file in results.modules_behind(Path(heat_runs.__file__))}
    scene = "validation/metrics/heat.py"
    assert {"refsim/heat/kernels.py", "refsim/core/effect.py", "validation/running.py", scene} <= behind
    assert not any(place.startswith(("refsim/contract/", "refsim/render/", "validation/report")) for place in behind)
    assert results.sources_digest(dam_runs.__file__) != results.sources_digest(droplet_runs.__file__)


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
    """Every module that is loaded only when a step is run is behind every run."""
    file = tmp_path / "run.py"
    file.write_text(PROGRAM)
    found = python(file, NUMBA_DISABLE_JIT="1", REFSIM_CACHE_DIR=str(tmp_path))
    loaded = {Path(line) for line in found.stdout.split("\n") if line and not line.startswith(str(tmp_path))}
    assert ROOT / "refsim" / "surface_tension" / "akinci_2013" / "kernels.py" in loaded
    assert loaded <= set(results.modules_behind(file))


def test_main_job_is_made_of_runs_that_are_there():
    known = discover()
    for group in script.MAIN:
        for name, keys in group.items():
            runs = {run.key: run for run in known[name].runs(Options(quick=True))}
            assert set(keys) <= set(runs)
            assert not [key for key in keys if runs[key].skip]
    first, second = script.planned(known, Options(quick=True))
    assert [(part.name, [run.key for run in part.runs]) for part in first + second] == [
        (name, list(keys)) for group in script.MAIN for name, keys in group.items()
    ]
    assert next(iter(script.MAIN[0].items()))[1][0] == "detection_2d"


def test_full_leaves_no_run_out():
    known, options = discover(), Options()
    groups = script.planned(known, options)
    assert [part.name for part in groups[0]] == list(script.MAIN[0])
    there = {part.name: [run.key for run in part.runs] for parts in groups for part in parts}
    assert there == {name: [run.key for run in each.runs(options)] for name, each in known.items()}
