"""Terms beside those of other programs: with the programs that are installed, and with stand-ins that slip."""

import pytest

from validation.experiments.solutions import runs as case
from validation.peers import missing
from validation.running import Context

SMALL = {"side": 6, "seed": 2}
DIFFER = {  # terms with other formulas, and the least difference that these make
    "splishsplash.pressure": 0.05, "splishsplash.viscous": 0.5, "splishsplash.cohesion": 0.1,
    "pysph.morris": 0.5, "warp.pressure": 1.49,
}  # fmt: skip


def _judged(program):
    result = case.COMPARED[program](Context(), **SMALL)
    made = case.EXPERIMENT.checked({f"terms_{program}": result})
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
