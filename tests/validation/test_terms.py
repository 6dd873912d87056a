"""Terms beside those of other programs: with the programs that are installed, and with stand-ins that slip."""

import pytest

from validation.experiments.solutions.runs import EXPERIMENT
from validation.peers import in_turns, missing
from validation.peers import terms as case
from validation.running import Context

SMALL = {"side": 6, "seed": 2}
DIFFER = {  # terms with other formulas, and the least difference that these make
    "splishsplash.pressure": 0.05, "splishsplash.viscous": 0.5, "splishsplash.cohesion": 0.1,
    "pysph.morris": 0.5, "warp.pressure": 1.49,
}  # fmt: skip


def _judged(program):
    result = case.COMPARED[program](Context(), **SMALL)
    made = EXPERIMENT.checked({f"terms_{program}": result})
    assert len(made) == 2 * len(case.TERMS[program])
    return result, {check.name for check in made if check.verdict == "fail"}


@pytest.mark.parametrize("program", case.COMPARED)
def test_terms_of_a_program(program):
    if reason := missing(case.PEERS[program]):
        pytest.skip(reason)
    result, failed = _judged(program)
    assert not failed
    for name in case.TERMS[program]:
        least = DIFFER.get(f"{program}.{name}", 0.0)
        assert (least > 0) == (name not in case.EQUAL[program])
        assert result.values[name] >= least


def test_programs_take_turns():
    """Ratios are those of a round; one program that is not there ends it."""
    theirs, ours, done = iter([2.0, 6.0, 4.0]), iter([1.0, 2.0, 4.0]), []
    found = in_turns(3, lambda: {"seconds": next(theirs), "version": "1"}, lambda: next(ours), done.append, 2)
    assert (found["ratios"], found["ratio"], found["missing"]) == ([2.0, 3.0, 1.0], 2.0, "")
    assert found["peer"] == {"median": 2.0, "low": 1.0, "high": 3.0}
    assert done == [1 / 3, 2 / 3, 1.0]
    assert in_turns(3, lambda: {"missing": "it is not there"}, float, print) == {"missing": "it is not there"}
