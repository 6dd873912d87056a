"""Terms beside those of other programs: with the programs that are installed, and with stand-ins that slip."""

from validation.peers import in_turns


def test_programs_take_turns():
    """Ratios are those of a round; one program that is not there ends it."""
    theirs, ours, done = iter([2.0, 6.0, 4.0]), iter([1.0, 2.0, 4.0]), []
    found = in_turns(3, lambda: {"seconds": next(theirs), "version": "1"}, lambda: next(ours), done.append, 2)
    assert (found["ratios"], found["ratio"], found["missing"]) == ([2.0, 3.0, 1.0], 2.0, "")
    assert found["peer"] == {"median": 2.0, "low": 1.0, "high": 3.0}
    assert done == [1 / 3, 2 / 3, 1.0]
    assert in_turns(3, lambda: {"missing": "it is not there"}, float, print) == {"missing": "it is not there"}
