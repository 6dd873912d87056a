"""`refsim show`: what it prints of an operation stands in the sources, for every operation and program."""

import json

import pytest

from refsim.__main__ import main
from refsim.commands.show import describe
from refsim.core.operation import REGISTRY

PROGRAMS = [(name, p) for name, operation in REGISTRY.items() for p in operation.names() if p != "numpy"]


@pytest.mark.parametrize(("name", "program"), PROGRAMS)
def test_every_program_is_shown(name, program):
    found = describe(REGISTRY[name], program)
    assert [len(found[part]) for part in ("reference", "program")] == [1, 1]
    for sources in found.values():
        for source in sources:
            assert f"def {source.name}(" in source.text


def test_a_body_is_shown_with_the_loop_of_the_backend(capsys):
    assert main(["show", "sph.momentum", "--backend", "cuda"]) == 0
    shown = capsys.readouterr().out
    parts = ("J(10)", "def pressure_pair(", "def momentum(position, velocity, mass, density", "neighbour_sum(")
    assert all(part in shown for part in parts)
    assert "lanes = len(neighbours.lanes)" in shown
    assert shown.index("def pressure_pair(") < shown.index("## Reference") < shown.index("## The loop")
    assert main(["show", "sph.momentum", "--json"]) == 0
    (loop,) = json.loads(capsys.readouterr().out)["loop"]
    assert "over_rows(body, acceleration.shape[0], (None, position" in loop["text"]


@pytest.mark.parametrize(("arguments", "words"), [
    (["sph.momentu"], "did you mean sph.momentum?"),
    (["sph.state", "--backend", "cuda:fused"], "choose one of cpu, cuda"),
])  # fmt: skip
def test_what_does_not_exist_is_said(arguments, words, capsys):
    assert main(["show", *arguments]) == 2
    assert words in capsys.readouterr().err
