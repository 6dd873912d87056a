"""Hard cases end as it stands on file; the command notices where they do not; maps are what they say."""

import math

import pytest

from refsim import InputError, RunStopped
from validation import judging, perform
from validation.experiment import Experiment, Options
from validation.results import Result
from validation.running import Context
from validation.trials import Cell, StabilityMap, Trial, largest_stable


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


# Measures
@pytest.mark.parametrize("truth", [0.013, 0.4, 3.0, 90.0])
def test_bisection_finds_the_limit_to_the_factor(truth):
    found = largest_stable(lambda x: "" if x <= truth else "tears", 1.0, 0.01, 100.0, factor=1.1)
    assert found.largest <= truth < found.failing <= 1.1 * found.largest
    assert (found.why, [value for value, _ in found.tried]) == ("tears", sorted(value for value, _ in found.tried))
