"""`refsim show`: what it prints of an operation stands in the sources, for every operation and program."""

import inspect
import subprocess
import sys

import numba
import numpy as np
import pytest

from refsim.__main__ import main
from refsim.commands.show import describe, kernel_of, printed
from refsim.core import cases
from refsim.core.operation import REGISTRY
from tests.running import rows


def test_every_program_is_shown_with_formulas_before_the_reference(capsys):
    for name, operation in REGISTRY.items():
        for program in (program for program in operation.names() if program != "numpy"):
            found = describe(operation, program)
            assert [len(found[part]) for part in ("reference", "program")] == [1, 1], (name, program)
            for source in (source for sources in found.values() for source in sources):
                assert f"def {source.name}(" in source.text, (name, program)
    assert main(["show", "sph.momentum"]) == 0
    shown = capsys.readouterr().out
    assert all(part in shown for part in ("J(10)", "def pressure_pair(", "neighbour_sum("))
    assert shown.index("def pressure_pair(") < shown.index("## Reference") < shown.index("## Program cpu")


@pytest.mark.parametrize(("arguments", "words"), rows(__file__, "missing_operations"))
def test_what_does_not_exist_is_said(arguments, words, capsys):
    assert main(["show", *arguments]) == 2
    assert words in capsys.readouterr().err


# Random inputs miss what belongs together: a liquid's share of its volume is 1, moments are those of a rotation
TOGETHER = ("two_way_coupling.pressure", "two_way_coupling.forces", "shape_matching.match")
LARGEST = 101  # particles of the examples, each a neighbour of all others at most


@pytest.fixture(scope="module")
def files():
    """(operation, backend): the printed file."""
    cases.discover()
    texts = {(name, backend): printed(REGISTRY[name], backend) for name in REGISTRY for backend in ("cpu", "cuda")}
    return {key: text for key, text in texts.items() if text is not None}


def test_files_say_what_the_references_do(files, monkeypatch):
    monkeypatch.setattr(numba.config, "DISABLE_JIT", True)
    compared = 0
    for (name, backend), text in files.items():
        if backend == "cpu" and "def example(" in text and name not in TOGETHER:
            space = {"__name__": "copied"}
            exec(compile(text, name, "exec"), space)
            check(REGISTRY[name], space, space["example"]())
            compared += 1
    assert compared > 60


def check(operation, space, given):
    """Run a file's kernel on its example, and compare with the reference."""
    kernel = space[kernel_of(operation, "cpu").__name__]
    named = dict(zip(inspect.signature(kernel).parameters, given, strict=True))
    before = {name: value.copy() if isinstance(value, np.ndarray) else value for name, value in named.items()}
    kernel(*given)
    answer = operation.program("numpy")(*[before.get(name) for name in operation.arguments("numpy")])
    unit = operation.tolerance * np.finfo(np.float32).eps
    for output, (value, scale) in answer.items():
        if output in named and output in operation.exact:
            assert (named[output] == value)[np.asarray(scale) > unit].all(), operation.name
        elif output in named:
            beside = scale if np.ndim(scale) in (0, value.ndim) else np.asarray(scale)[:, None]
            assert (np.abs(named[output] - value) <= LARGEST * unit * beside).all(), operation.name


def test_a_copied_file_runs_alone(files, tmp_path):
    (tmp_path / "copied.py").write_text(files["sph.density", "cpu"])
    hidden = "import sys, runpy; sys.modules['refsim'] = None; runpy.run_path('copied.py', run_name='__main__')"
    run = subprocess.run([sys.executable, "-I", "-c", hidden], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert float(run.stdout.rpartition(":")[2]) > 1
