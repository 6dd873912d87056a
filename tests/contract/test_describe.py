"""What the command says of an operation, and the stub that it prints, for every operation."""

import dataclasses
import re
import types

from refsim import contract
from refsim.__main__ import main
from refsim.contract import describe
from refsim.contract.inputs import arguments_of_others
from refsim.core import cases
from refsim.core.operation import REGISTRY

cases.discover()
MISSING = re.compile(r"your program (does not write|adds nothing to|does not change) (\w+)")


def test_everything_that_an_operation_takes_is_described():
    """Arguments of all, variants of a fifth: each makes its inputs anew."""
    for number, (name, operation) in enumerate(REGISTRY.items()):
        found = describe.arguments(operation, "cpu")
        assert [a.name for a in found if a.role] == list(arguments_of_others(operation, "cpu")), name
        assert not [a.name for a in found if not a.meaning], name
        told = describe.variants(operation) if number % 5 == 0 else operation.variants
        assert len(told) == len(set(map(str, told))) == len(operation.variants), name


def test_integers_are_told_by_name(capsys):
    assert main(["contract", "jiang_zhu_2023.tension", "--arguments"]) == 0
    out = capsys.readouterr().out
    assert "0 poly6, 1 spiky, 2 cubic_spline, 3 wendland_c2" in out
    assert "of PAIR_MODES: 0 soft, 1 all, 2 one_sided, 3 either, 4 both" in out
    assert "variant 0: with cohesion; without surface_weight, surface, area_normal, area, axial; pairs.mode = 1" in out
    assert main(["contract", "sph.density", "--arguments"]) == 0
    assert "variant 0: without number_density, asymmetry, walls, period\n" in capsys.readouterr().out


def test_the_stub_runs_and_says_what_is_missing():
    for number, (name, operation) in enumerate(REGISTRY.items()):
        module = types.ModuleType("mine")
        exec(describe.template([name]), module.__dict__)
        programs = dataclasses.replace(module.PROGRAMS.checked(), kernels=("wendland_c2",))
        assert programs.operations() == (name,)
        if number % 5:
            continue
        outcomes = list(contract.trials(programs, name, ("float64",), steps=("T1", "T7")))
        failed = [o for o in outcomes if not o.passed and not o.not_judged]
        assert failed, name
        for o in failed:
            assert MISSING.search(o.words).group(2) in operation.outputs, (name, o.words)


def test_the_command_prints_the_stub(capsys):
    names = ["sph.density", "sph.momentum"]
    assert main(["contract", "--template", *names]) == 0
    assert capsys.readouterr().out.rstrip("\n") == describe.template(names).rstrip("\n")
    assert main(["contract", "--template", "sph.densty"]) == 2
    assert "did you mean sph.density?" in capsys.readouterr().err
    assert main(["contract", "--template"]) == 2
    assert "name an operation" in capsys.readouterr().err
