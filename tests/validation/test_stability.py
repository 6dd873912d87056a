"""Hard cases end as it stands on file; the command notices where they do not; maps are what they say."""

import io
import json
import math
import pathlib

import numpy as np
import pytest

from refsim import Box, Cloud, InputError, JiangZhu2023, RunStopped, Scene, WeaklyCompressible
from refsim.scene.plan import make_plan
from validation import perform, stability, stability_page
from validation.__main__ import main
from validation.experiment import Experiment, Options, Part, Run, discover
from validation.experiments.droplet.stability import pieces
from validation.metrics.voids import find_voids
from validation.results import Result, finite
from validation.running import Context
from validation.trials import Cell, HardCase, StabilityMap, Trial, largest_stable, silent_up_to

ROOT = pathlib.Path(__file__).parents[2]
EXPERIMENTS = discover()
SHORT = [(name, case) for name, experiment in EXPERIMENTS.items() for case in experiment.hard_cases if case.short]


@pytest.mark.parametrize(("system", "case"), SHORT, ids=[case.name for _, case in SHORT])
def test_a_hard_case_ends_as_on_file(system, case):
    result = case.function(Context(threads=1), backend="cpu", **case.parameters)
    assert result.values["outcome"] == stability.outcomes(system)[case.name].outcome, result.values


# What is on file


def test_every_case_has_its_outcome_on_file_and_none_is_left_over():
    names = [part.name for e in EXPERIMENTS.values() for part in (*e.hard_cases, *e.maps)]
    assert len(set(names)) == len(names)
    for name, experiment in EXPERIMENTS.items():
        assert set(stability.outcomes(name)) == {case.name for case in experiment.hard_cases}


def test_an_outcome_that_is_no_pass_says_why(tmp_path):
    for k, text in enumerate(('outcome = "refused"', 'outcome = "pass"\nwhy = "x"', "", 'outcome = "pass"\nx = 1')):
        write_expected(tmp_path / str(k), f"[hard_case.a]\n{text}\n")
        with pytest.raises(ValueError, match="needs an outcome"):
            stability.outcomes(str(k), tmp_path)


def write_expected(folder, text):
    folder.mkdir()
    (folder / "expected.toml").write_text(text)


def test_every_case_of_the_anchors_is_there():
    names = " ".join(case.name for experiment in EXPERIMENTS.values() for case in experiment.hard_cases)
    words = (
        "coincident particles_1 apart_1e-12 film filament mass_ratio tension_x100 nothing step_x1 step_x2 step_x4"
        " step_x8 impact edge cell_borders far_away leaves overflow empty killed disk_full other_backend oh_ voids"
        " beside_walls spray"
    )
    for word in words.split():
        assert word in names, word


def test_the_page_is_what_the_command_writes():
    text = (ROOT / "docs" / "stability.md").read_text()
    assert stability_page.page(text, EXPERIMENTS) == text, "python -m validation stability --write"


def test_every_part_of_the_page_is_generated():
    marks = "".join(f"<!-- {name} -->\n@old@\n<!-- end of {name} -->\n" for name in stability_page.PARTS)
    text = stability_page.page(marks, EXPERIMENTS)
    assert "@old@" not in text
    for name, experiment in EXPERIMENTS.items():
        for row, case in zip(stability.markdown(experiment), experiment.hard_cases, strict=True):
            assert f"{row}\n" in text
            failed = stability.outcomes(name)[case.name].outcome.startswith("fails")
            assert (f"\n- `{case.name}`, " in text) == failed
    with pytest.raises(ValueError, match="lacks the lines"):
        stability_page.replaced("no marks", "totals", [])


def test_the_matrix_counts_and_crosses_every_case():
    found = stability_page.systems(EXPERIMENTS)
    assert sum(map(len, found.values())) == sum(len(e.hard_cases) for e in EXPERIMENTS.values())
    for system, cases in found.items():
        rows, alone = stability_page.crossed(system, cases)
        assert sum(map(len, rows.values())) + len(alone) == len(cases)
    rows, alone = stability_page.crossed("models", {"spin_akinci": "pass", "spin_akinci_iisph": "fails", "x": "warned"})
    assert rows == {"spin": {"akinci": "pass", "akinci_iisph": "fails"}}
    assert alone == {"x": "warned"}
    with pytest.raises(ValueError, match="none of pass"):
        stability_page.kind("unknown")
    tiles = [patch for axes in stability_page.matrix(EXPERIMENTS).axes for patch in axes.patches]
    assert len(tiles) == sum(map(len, found.values()))


# The outcomes


def trial(*checks, ends=None):
    made = Trial(Context(), "cpu")
    with made.ending():
        for value in checks:
            made.check("size", value, at_most=1.0)
        if ends is not None:
            raise ends
    return made


def test_outcomes_of_a_trial():
    assert trial(0.5).outcome == "pass"
    assert trial(0.5, 1.5).outcome == "fails: size"
    assert trial(math.nan).outcome == "fails: size"
    assert trial(ends=InputError("no.")).outcome == "refused"
    assert trial(0.5, ends=RunStopped("diverged", "too fast.")).outcome == "stopped: diverged"
    assert trial(1.5, ends=RunStopped("diverged", "too fast.")).outcome == "fails: size"
    with pytest.raises(ZeroDivisionError), Trial(Context(), "cpu").ending():
        raise ZeroDivisionError


def test_a_number_checked_again_keeps_its_worst_value():
    assert trial(0.5, 0.9, 0.7).checks["size"]["value"] == 0.9
    assert trial(0.5, 2.0, 3.0, 0.1).checks["size"]["value"] == 2.0


def ends(context, backend, outcome):
    return Result({"outcome": outcome, "message": "", "checks": {}, "shown": {}})


def limit(context, backend, largest, runner):
    return Result(
        {"largest": largest, "failing": 2 * largest, "why": "tears", "tried": [[largest, ""]], "runner": runner}
    )


def fake(outcome="pass", largest=2.0, runner=1.0):
    cells = (Cell("a", "b", limit, {"largest": largest, "runner": runner}),)
    case = HardCase("thin", "a thin thing", "it holds", ends, {"outcome": outcome}, short=True)
    limits = StabilityMap("limits", "Limits", "x", "calm.", "Take 1.", cells)
    return Experiment("fake", "a thin thing", hard_cases=(case,), maps=(limits,))


def judged(tmp_path, experiment, text):
    write_expected(tmp_path / "fake", text)
    options = Options(results=tmp_path / "results", figures=tmp_path / "figures")
    part = stability.part_of(experiment, options, folder=tmp_path)
    return perform.perform([part], options, stream=io.StringIO())


@pytest.mark.parametrize(
    ("system", "text", "code"),
    [
        (fake(), '[hard_case.thin]\noutcome = "pass"\n', 0),
        (fake("stopped: diverged"), '[hard_case.thin]\noutcome = "stopped: diverged"\nwhy = "thin"\n', 0),
        (fake("stopped: diverged"), '[hard_case.thin]\noutcome = "pass"\n', 4),
        (fake(), "", 4),
        (fake(largest=0.5), '[hard_case.thin]\noutcome = "pass"\n', 4),
    ],
)
def test_a_changed_outcome_or_a_limit_beyond_the_stable_fails(tmp_path, system, text, code):
    outcomes = judged(tmp_path, system, text)
    assert perform.exit_code(outcomes) == code
    assert (tmp_path / "figures" / "limits.png").stat().st_size > 1000
    assert "a thin thing" in str(outcomes[0].tables[0])
    assert "tears" in str(outcomes[0].tables[1])


def test_a_map_is_drawn_from_its_file_where_nothing_failed_and_where_all_did(tmp_path):
    cells = [
        {
            "row": row,
            "column": "c",
            "largest": a,
            "failing": b,
            "why": "",
            "runner": 1.0,
            "tried": [[1.0, ""], [4.0, "x"]],
        }
        for row, a, b in (("open", 4.0, math.inf), ("none", 0.0, 1.0))
    ]
    data = json.loads(json.dumps(finite({"title": "t", "quantity": "q", "cells": cells})))
    figure = stability.draw_map(data)
    said = {text.get_text() for axes in figure.axes for text in axes.texts}
    assert said == {"at least 4.0", "none", "runner: 1.0"}


def test_numbers_of_a_map_have_two_digits():
    said = [stability.two_digits(value) for value in (0.0371, 1.74, 25.2, 512.0, 15_870.0, 1.23e-5, math.inf)]
    assert said == ["0.037", "1.7", "25", "510", "16,000", "1.2e-05", "none"]


def test_the_command(tmp_path, capsys):
    assert main(["list", "hard_case"]) == 0
    assert "tension_x100" in capsys.readouterr().out
    assert main(["stability", "--markdown"]) == 0
    assert "| `tension_x100` |" in capsys.readouterr().out
    assert main(["stability", "no_such_case"]) == 2
    assert "There is no experiment, hard case or map 'no_such_case'" in capsys.readouterr().err
    folders = ["--results", str(tmp_path / "results"), "--figures", str(tmp_path / "figures")]
    assert main(["stability", "empty_scene", "--jobs", "0", *folders]) == 2
    assert main(["stability", "empty_scene", "empty_cloud", "--json", "--jobs", "2", *folders]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {name: entry["verdict"] for name, entry in found.items()} == {"empty_scene": "pass", "empty_cloud": "pass"}


def test_what_is_timed_waits_until_nothing_else_runs(tmp_path):
    options = Options(results=tmp_path / "results", figures=tmp_path / "figures")
    (own,) = stability.parts(["empty_scene", "empty_cloud"], EXPERIMENTS, options)
    timed = Run("timed", stored_before, {"folder": str(tmp_path / "results" / "foundation"), "threads": 2})
    others = Part("verdict", "others", "others", [timed], lambda results: ())
    (_, last) = perform.perform([own, others], options, jobs=2, stream=io.StringIO())
    assert last.results["timed"].values == {"stored": 2}


def stored_before(context, folder, threads):
    return Result({"stored": len(list(pathlib.Path(folder).iterdir()))})


@pytest.mark.parametrize(
    "outcome, expected, holds",
    [
        ("pass", "pass", True),
        ("fails: a", "fails: a, b", True),
        ("fails: a, c", "fails: a, b", False),
        ("fails: a", "pass", False),
        ("pass", "fails: a", False),
        ("warned: a", "fails: a", False),
        ("pass", "warned: a", True),
        ("fails: a", "warned: a", False),
        ("stopped: diverged", "stopped: collapsed", False),
    ],
)
def test_an_outcome_may_miss_no_other_checks_than_the_one_on_file(outcome, expected, holds):
    assert stability.foreseen(outcome, expected) is holds


# Measures


@pytest.mark.parametrize("truth", [0.013, 0.4, 3.0, 90.0])
def test_bisection_finds_the_limit_to_the_factor(truth):
    found = largest_stable(lambda x: "" if x <= truth else "tears", 1.0, 0.01, 100.0, factor=1.1)
    assert found.largest <= truth < found.failing <= 1.1 * found.largest
    assert found.why == "tears"
    assert [value for value, _ in found.tried] == sorted(value for value, _ in found.tried)


def test_bisection_says_where_there_is_no_limit():
    assert largest_stable(lambda x: "tears", 1.0, 0.1, 10.0).largest == 0.0
    found = largest_stable(lambda x: "", 1.0, 0.1, 10.0)
    assert (found.largest, found.failing) == (10.0, math.inf)


def scene(**changes):
    fluid = {"rest_density": 1.0, "sound_speed": 10.0, "dynamic_viscosity": 1.0, **changes.pop("fluid", {})}
    effects = (WeaklyCompressible(**fluid), *changes.pop("effects", ()))
    fluid = (changes.pop("cloud", Box(cells=(2, 2, 2))),)
    return Scene(spacing=0.1, support_radius=0.27, fluid=fluid, effects=effects)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fluid": {"dynamic_viscosity": 1e-3}}, "below rho0 c h/250"),
        ({"effects": (JiangZhu2023(surface_tension=1.0, area_ratio=0.02),)}, "area_ratio = 0.02 is above"),
        ({"effects": (JiangZhu2023(surface_tension=1.0, area_term="color", area_acceleration=99.0),)}, "is above"),
        ({"effects": (JiangZhu2023(surface_tension=1.0, pair_mode="either", area_ratio=0.0),)}, "boil or fall apart"),
        ({"cloud": Cloud(position=[[0, 0, 0], [1e5, 0, 0]])}, "use float64"),
    ],
)
def test_what_was_found_unstable_is_said_beforehand(changes, words):
    made = scene(**changes)
    assert any(words in note for note in make_plan(made).notes)


def braked_alone(notes):
    """Of a free liquid with J(11) nothing else is said than what that does to its rotation."""
    return len(notes) == 1 and "brakes free rotation" in notes[0]


def test_nothing_is_said_of_what_holds():
    quiet = JiangZhu2023(surface_tension=0.05, area_ratio=0.005)
    assert braked_alone(make_plan(scene(effects=(quiet,))).notes)
    off = JiangZhu2023(surface_tension=0.0, area_ratio=0.5, pair_mode="either")
    assert braked_alone(make_plan(scene(effects=(off,))).notes)
    made = silent_up_to(lambda x: scene(effects=(JiangZhu2023(surface_tension=0.05, area_ratio=x),)), 1e-3, 1.0)
    assert 0.0055 < made <= 0.006


def test_voids_are_holes_that_no_air_reaches():
    lattice = np.stack(np.meshgrid(np.arange(20.0), np.arange(20.0), indexing="ij"), -1).reshape(-1, 2)
    assert find_voids(lattice, 1.0, 1.0).count == 0
    inner = ~((np.abs(lattice - 9.0) <= 1).all(1) | (np.abs(lattice - [3.0, 15.0]) < 1).all(1))
    found = find_voids(lattice[inner], 1.0, 1.0)
    assert found.count == 1  # one missing particle leaves no place for a disc of one spacing
    # A square of side 4 less what is within 1 of the points on its border: 4, and 8 (1 - mean of sqrt(1 - u^2)).
    assert found.area == pytest.approx(4.35, abs=0.3)
    assert np.abs(found.place - 9.0).max() < 1.5
    notch = lattice[~((lattice[:, 1] > 12) & (np.abs(lattice[:, 0] - 9.0) <= 2))]
    assert find_voids(notch, 1.0, 1.0).count == 0
    lid = np.stack([np.arange(5.0, 14.0), np.full(9, 19.0)], axis=1)
    assert find_voids(notch, 1.0, 1.0, walls=lid).count == 1


def test_pieces_are_counted():
    line = np.zeros((10, 3))
    line[:, 0] = [0, 1, 2, 3, 10, 11, 12, 20, 21, 40]
    assert pieces(line, 1.5).tolist() == [4, 3, 2, 1]
