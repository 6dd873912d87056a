"""Words and values of a wrong answer: what is recognised, what no message says, and one trial run again."""

import json
import pathlib
import sys

import numpy as np
import pytest

from refsim.__main__ import main
from refsim.contract import Target
from refsim.contract.causes import conditions, first_cause
from refsim.contract.drawn import draw
from refsim.contract.target import Outcome
from refsim.core.operation import REGISTRY
from tests.contract import faulty

# Votes
TRAITS = ("with walls", "in float64", "in 3 dimensions", "with up to # neighbours", "up to row #", "sought")


def voter(rng, most):
    """An outcome with drawn traits: right up to a number of neighbours or rows, wrong from another on."""
    wrong = rng.random() < 0.6
    traits = {"sought": bool(rng.random() < 0.8)}
    for name in TRAITS[:-1]:
        if "#" in name:
            low, high = sorted(rng.integers(1, most, 2).tolist())
            traits[name] = (low if rng.random() < 0.9 else None, most // 2 + high if wrong else None)
        elif rng.random() < 0.9:
            traits[name] = (float(rng.choice([0.0, 0.25, 1.0])), float(rng.choice([0.5, 1.0, 1.0])) if wrong else None)
    sign = str(rng.choice(["", "gives 2.5 times", "gives 3 times", "misses 1 of 4"])) if wrong else ""
    usual = ("sph.density", "T2", "cloud", "numpy", "float64", 0)
    values = {"row": 1} if rng.random() < 0.8 else {}
    telling, words = bool(rng.random() < 0.8), "wrong" if wrong else ""
    return Outcome(
        *usual, not wrong, 9.0 if wrong else 0.1, words, telling=telling, sign=sign, values=values, traits=traits
    )


def test_votes_of_drawn_outcomes_are_as_ever(recorded):
    """Which of some signs, which traits and from which numbers on: of many wrong answers, and of one or two."""
    found = {}
    for number in range(150):
        rng = np.random.default_rng(number)
        words = first_cause([voter(rng, 12 + number) for _ in range(1 + number % 9)])
        known = ["2.5", "3 times", "misses", *TRAITS, *(name.replace("#", "") for name in TRAITS if "#" in name)]
        found[f"{number}"] = [word in words for word in known], words
    recorded(found)


def test_what_one_wrong_trial_lacks_is_no_condition_of_all():
    def outcome(passed, share):
        traits = {} if share is None else {"with walls": (share, None if passed else share)}
        return Outcome("sph.density", "T2", "cloud", "numpy", "float64", 0, passed, 1.0, telling=True, traits=traits)

    outcomes = [outcome(True, 0.0), outcome(True, 0.5), *3 * [outcome(False, 1.0)], outcome(False, None)]
    assert (conditions(outcomes, outcomes[2:5]), conditions(outcomes, outcomes[2:])) == (["wrong only with walls"], [])


LIBRARY = """
import sys
sys.path.insert(0, {root!r})
from tests.contract.faulty import programs
PROGRAMS = programs({fault!r})
"""


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A library in the current folder whose density has no self term."""
    root = str(pathlib.Path(faulty.__file__).parents[2])
    (tmp_path / "own.py").write_text(LIBRARY.format(root=root, fault="no self"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


def test_the_guide_is_printed_without_a_page(capsys):
    assert main(["contract", "--guide"]) == 0
    out = capsys.readouterr().out
    for word in ("PROGRAMS", "--template", "actions/setup-python", "add_test", "--replay"):
        assert word in out


def test_the_smallest_failing_input_is_kept_and_run_again(library, capsys):
    assert main(["contract", "own.py", "--step", "T11", "--dtype", "float64", "--variant", "0", "--seed", "3"]) == 4
    assert "sph.density fails: your program leaves out the particle itself" in capsys.readouterr().out
    kept = json.loads((library / "failing_sph.density.json").read_text())
    assert len(kept["case"]["position"]) == 1
    assert main(["contract", "own.py", "--replay", "failing_sph.density.json"]) == 4
    assert f"FAIL sph.density T11 {kept['trial'].split(':')[-1]}" in capsys.readouterr().out
    assert main(["contract", "own.py", "--replay", kept["trial"]]) == 4  # as it was drawn
    assert "expected" in capsys.readouterr().out
    with np.load("replay.npz") as arrays:
        assert arrays["got/density"] != pytest.approx(arrays["answer/density"])
        assert np.isnan(arrays["before/density"]).all()
        assert {"position", "mass", "smoothing.shape", "bound/density"} <= set(arrays.files)
    assert main(["contract", "own.py", "--replay", kept["trial"].replace("T11:", "T11:no_")]) == 2
    assert "has no such trial" in capsys.readouterr().err
    assert main(["contract", "own.py", "--replay", "T1"]) == 2
    (library / "own.py").write_text((library / "own.py").read_text().replace("no self", ""))
    assert main(["contract", "own.py", "--replay", "failing_sph.density.json"]) == 0
    (library / "failing_sph.density.json").write_text("{}")
    assert main(["contract", "own.py", "--replay", "failing_sph.density.json"]) == 2


def test_a_seed_draws_the_same_inputs_as_ever(recorded):
    """A report of an earlier version names trials by seed and number."""
    target = Target(REGISTRY["sph.density"], "numpy", "float64", seed=7, dims=(2, 3))
    found = [draw(target, f"drawn 7.{number}") for number in range(8)]
    recorded({f"{k}": (d.case.state == "tait", d.case, d.gap, d.lengths) for k, d in enumerate(found)})
