"""`refsim show`: what it prints of an operation stands in the sources, for every operation and program."""

import json

import pytest

from refsim.__main__ import main
from refsim.commands.show import describe
from refsim.core.operation import REGISTRY


def test_every_program_is_shown():
    for name, operation in REGISTRY.items():
        for program in (program for program in operation.names() if program != "numpy"):
            found = describe(operation, program)
            assert [len(found[part]) for part in ("reference", "program")] == [1, 1], (name, program)
            for source in (source for sources in found.values() for source in sources):
                assert f"def {source.name}(" in source.text, (name, program)


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
