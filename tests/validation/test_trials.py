"""Hard cases end as it stands on file; the command notices where they do not; maps are what they say."""

import math

import pytest

from refsim import InputError, RunStopped
from validation.running import Context
from validation.trials import Trial, largest_stable


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


# Measures
@pytest.mark.parametrize("truth", [0.013, 0.4, 3.0, 90.0])
def test_bisection_finds_the_limit_to_the_factor(truth):
    found = largest_stable(lambda x: "" if x <= truth else "tears", 1.0, 0.01, 100.0, factor=1.1)
    assert found.largest <= truth < found.failing <= 1.1 * found.largest
    assert (found.why, [value for value, _ in found.tried]) == ("tears", sorted(value for value, _ in found.tried))
