"""Attacks: what they once found does not come back, a campaign runs, and one that finds something says so."""

import pytest

from validation import attack
from validation.attack import Damage, plan, reached, resume

NOT_COUPLED = b"""spacing = 0.01
support_radius = 0.026
end_time = 0.01
fluid = []
[effects.two_way_coupling]
[effects.jiang_zhu_2023]
[effects.shape_matching]
[effects.weakly_compressible]
rest_density = 1000.0
sound_speed = 20.0
density = "summation"
"""
FAR_APART = b"""spacing = 0.01
support_radius = 0.026
fluid = [{shape = "box", cells = [2, 2, 2]}]
[effects.weakly_compressible]
density = "summation"
sound_speed = 1e29
rest_density = 1e29
[effects.gravity]
acceleration = [0.0, -1e29, 0.0]
"""
FOUND = {  # what was done, and a trial that once ended in a traceback
    "effects that need a solid": (plan, NOT_COUPLED),
    "header of zeros": (resume, ("cloud.npy", [Damage("zeros", 1330, 537)], True)),
    "swapped frames": (resume, ("particles/000003.vtp", [Damage("cut", 8637), Damage("swapped", 2168)], False)),
    "lost checkpoint": (resume, ("checkpoint.h5", [Damage("gone")], False)),
    "numbers that are far apart": (plan, FAR_APART),
    "endless stack": (plan, b"spacing = " + b"[" * 5000),
}


@pytest.mark.parametrize("name", FOUND)
def test_what_was_found_does_not_come_back(name, tmp_path):
    perform, trial = FOUND[name]
    assert perform(trial, tmp_path) in ("0", "2")


def test_a_lost_state_and_words_that_are_no_sentence_are_noticed(monkeypatch, tmp_path):
    half, whole = attack._half()
    assert reached(half) != whole
    monkeypatch.setattr("refsim.__main__.main", lambda arguments: 1)
    with pytest.raises(AssertionError, match="exit code 1"):
        attack.outcome_of(["plan"])
    monkeypatch.setattr("refsim.__main__.main", lambda arguments: 2)
    with pytest.raises(AssertionError, match="not one sentence"):
        attack.outcome_of(["plan"])
