"""Equations are found by their numbers, and none of a source is missing."""

import json

import pytest

from refsim.__main__ import main
from refsim.commands.numbered import SOURCES, named, stated
from refsim.core.operation import REGISTRY


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.title)
def test_each_number_has_a_function_or_a_reason(source):
    assert [n for n in source.numbers if not stated().get((source.title, n)) and not source.reason(n)] == []
    known = {number for title, number in stated() if title == source.title}
    assert known <= set(source.numbers)
    assert {number for numbers, _ in source.absent for number in numbers.replace("Algorithm ", "").split()} <= set(
        source.numbers
    )


def test_labels_are_found_again():
    for source in SOURCES:
        for number in source.numbers:
            assert named(source.label(number)) == (source, number)
    assert named("j ( 10 )")[1] == "10"
    assert named("sph.momentum") is None


def test_an_equation_is_shown(capsys):
    assert main(["show", "J(17)"]) == 0
    shown = capsys.readouterr().out
    assert shown.index("def cohesion(") < shown.index("def force_shape(") < shown.index("def tension_pair(")
    assert main(["show", "J(5)", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["functions"], found["equation"]) == ([], "J(5)")
    assert "J(9)" in found["reason"]


def test_equations_of_an_operation_are_found_through_what_it_calls():
    names = {name: [f.__name__ for f in REGISTRY[name].equations()] for name in ("sph.momentum", "iisph.relax")}
    assert names["sph.momentum"] == ["pressure_force", "wall_pressure_force", "viscous_force"]
    assert {"moved", "moved_at_walls", "relaxed", "density_error"} <= {*names["iisph.relax"]}
