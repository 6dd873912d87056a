"""`refsim show`: operations and numbered equations of the sources, with what stands for each."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from refsim.commands.equations import equations, page
from refsim.commands.show import describe, kernel_of, printed, shown
from refsim.core import cases
from refsim.core.operation import REGISTRY
from tests.running import answer_of, rows


def test_every_program_is_shown_with_formulas_before_the_reference(capsys):
    for name, operation in REGISTRY.items():
        for program in (program for program in operation.names() if program != "numpy"):
            found = describe(operation, program)
            assert [len(found[part]) for part in ("reference", "program")] == [1, 1], (name, program)
            for source in (source for sources in found.values() for source in sources):
                assert f"def {source.name}(" in source.text, (name, program)
    shown = answer_of(capsys, ["show", "sph.momentum"]).out
    assert all(part in shown for part in ("J(10)", "def pressure_pair(", "neighbour_sum("))
    assert shown.index("def pressure_pair(") < shown.index("## Reference") < shown.index("## Program cpu")


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
    (tmp_path / "copied.py").write_text(files["sph.gravity", "cpu"])
    hidden = "import sys, runpy; sys.modules['refsim'] = None; runpy.run_path('copied.py', run_name='__main__')"
    run = subprocess.run([sys.executable, "-I", "-c", hidden], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert float(run.stdout.rpartition(":")[2]) > 1


DOCS = Path(__file__).resolve().parents[2] / "docs"
NUMBERED = {
    "Jiang & Zhu 2023": [f"J({n})" for n in range(1, 22)],
    "Dong, Zhang & Chen 2016": [f"D({n})" for n in range(1, 12)],
    "thesis": [
        *(f"(2.{n})" for n in range(1, 14)), *(f"(3.{n})" for n in range(1, 20)), *(f"(4.{n})" for n in range(1, 20)),
        "Algorithm 1", "Algorithm 2",
    ],
    "Shao & Song 2017": [f"M({n})" for n in range(1, 5)],
    "patent CN104318598A": [f"P{n}" for n in range(1, 9)],
}  # fmt: skip
PAPERS = ("jiang_zhu", "dong", "mpm_thesis", "shao_song", "patent")  # pages of the sources, in their order


def test_each_has_functions_of_both_kinds_and_a_test_or_a_reason_and_can_be_shown():
    written = (DOCS / "equations.md").read_text(encoding="utf-8")
    assert written == page(), "run `refsim show equations > docs/equations.md`"
    for found in equations():
        stands = found.references and found.kernels and found.operations
        assert bool(stands) != bool(found.reason), found.name
        assert found.printed, found.name
    for found in equations():
        text = shown(found).text
        assert all(f"def {name}(" in text for _, name in (*found.references, *found.kernels)), found.name


@pytest.mark.parametrize("source", NUMBERED)
def test_every_number_of_a_source_is_there_in_its_order(source):
    numbers = [e.number for e in equations() if e.source == source]
    assert [number for number in numbers if number in NUMBERED[source]] == NUMBERED[source]


def test_the_errata_that_are_named_are_those_of_the_source():
    for source, name in zip(NUMBERED, PAPERS, strict=True):
        chapter = (DOCS / f"paper_{name}.md").read_text(encoding="utf-8").partition("\n## Errata\n")[2]
        for found in (e for e in equations() if e.source == source):
            for erratum in re.findall(r"\b[EMP]\d+\b", found.reading):
                assert re.search(rf"\b{erratum}\b", chapter), f"{found.name} names {erratum}"


@pytest.mark.parametrize(("name", "parts"), rows(__file__, "equations"))
def test_an_equation_is_shown_with_its_code(name, parts, capsys):
    text = answer_of(capsys, ["show", name]).out
    assert all(part in text for part in parts)
