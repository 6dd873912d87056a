"""Hard cases end as it stands on file; the command notices where they do not; maps are what they say."""

import math

import pytest

from refsim import Box, InputError, JiangZhu2023, RunStopped, Scene, WeaklyCompressible
from refsim.scene.plan import make_plan
from validation import judging, perform
from validation.__main__ import main
from validation.drawing import signs
from validation.experiment import Experiment, Options
from validation.results import Result
from validation.running import Context
from validation.trials import Cell, StabilityMap, Trial, largest_stable, silent_up_to


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
    assert (trial(0.5).outcome, trial(0.5, 1.5).outcome) == ("pass", "fails: size")
    assert (trial(math.nan).outcome, trial(ends=InputError("no.")).outcome) == ("fails: size", "refused")
    assert trial(0.5, ends=RunStopped("diverged", "too fast.")).outcome == "stopped: diverged"
    assert trial(1.5, ends=RunStopped("diverged", "too fast.")).outcome == "fails: size"
    with pytest.raises(ZeroDivisionError), Trial(Context(), "cpu").ending():
        raise ZeroDivisionError


def ends(context, backend, outcome):
    return Result({"outcome": outcome, "message": "", "checks": {}, "shown": {}})


def limit(context, backend, largest, runner):
    return Result(
        {"largest": largest, "failing": 2 * largest, "why": "tears", "tried": [[largest, ""]], "runner": runner}
    )


def fake(outcome="pass", largest=2.0, runner=1.0):
    cells = (Cell("a", "b", limit, {"largest": largest, "runner": runner}),)
    limits = StabilityMap("limits", "Limits", "x", "calm.", "Take 1.", cells)
    return outcome, Experiment("fake", "a thin thing", trials={"ends": ends}, maps=(limits,))


@pytest.mark.parametrize(("system", "on_file", "code"), [
    (fake(), 'verdict = "pass"', 0), (fake("stopped: diverged"), 'verdict = "stopped: diverged"\nreason = "thin"', 0),
    (fake("stopped: diverged"), 'verdict = "pass"', 4), (fake(largest=0.5), 'verdict = "pass"', 4),
])  # fmt: skip
def test_a_changed_outcome_or_a_limit_beyond_the_stable_fails(tmp_path, system, on_file, code):
    outcome, experiment = system
    (tmp_path / "fake").mkdir()
    (tmp_path / "fake" / "expected.toml").write_text(
        '[check.thin]\nkind = "hard case"\nwhat = "a thin thing"\nholds = "it holds"\ntrial = "ends"\n'
        f'given = {{ outcome = "{outcome}" }}\nshort = true\n{on_file}\n'
    )
    options = Options(results=tmp_path / "results", figures=tmp_path / "figures")
    part = judging.trial_part(experiment, options, folder=tmp_path)
    outcomes = perform.perform([part], options)
    assert perform.exit_code(outcomes) == code
    assert (tmp_path / "figures" / "limits.png").stat().st_size > 1000
    assert "a thin thing" in str(outcomes[0].tables[0])
    assert "tears" in str(outcomes[0].tables[1])


def test_the_command(capsys):
    assert main(["list", "hard case"]) == 0
    assert "tension_x100" in capsys.readouterr().out
    assert main(["stability", "no_such_case"]) == 2
    assert "There is no hard case 'no_such_case'" in capsys.readouterr().err
    assert main(["stability", "tension_x100", "--jobs", "0"]) == 2


# Measures
@pytest.mark.parametrize("truth", [0.013, 0.4, 3.0, 90.0])
def test_bisection_finds_the_limit_to_the_factor(truth):
    found = largest_stable(lambda x: "" if x <= truth else "tears", 1.0, 0.01, 100.0, factor=1.1)
    assert found.largest <= truth < found.failing <= 1.1 * found.largest
    assert (found.why, [value for value, _ in found.tried]) == ("tears", sorted(value for value, _ in found.tried))


def test_bisection_says_where_there_is_no_limit():
    assert largest_stable(lambda x: "tears", 1.0, 0.1, 10.0).largest == 0.0
    found = largest_stable(lambda x: "", 1.0, 0.1, 10.0)
    assert (found.largest, found.failing) == (10.0, math.inf)


def scene(**changes):
    fluid = {"rest_density": 1.0, "sound_speed": 10.0, "dynamic_viscosity": 1.0, "density": "summation"}
    fluid |= changes.pop("fluid", {})
    effects = (WeaklyCompressible(**fluid), *changes.pop("effects", ()))
    fluid = (changes.pop("cloud", Box(cells=(2, 2, 2))),)
    return Scene(spacing=0.1, support_radius=0.27, fluid=fluid, effects=effects)


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


def test_names_of_letters_become_letters_and_words_that_hold_them_do_not():
    assert signs("S = sigma/(rho0 c^2 d)") == "S = σ/(ρ₀ c² d)"
    assert signs("c h/nu, lambda rho0, minus a number, $rho$") == "c h/nu, lambda rho0, minus a number, $rho$"
    assert signs("nu and a number minus eps_r") == "ν and a number minus ε_r"
