"""`refsim show "J(10)"` and docs/equations.md: each numbered equation of the sources, and what stands for it."""

import re
from pathlib import Path

import pytest

from refsim.__main__ import main
from refsim.commands.equations import equations, page
from refsim.commands.show import shown
from tests.running import rows

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
    assert main(["show", name]) == 0
    text = capsys.readouterr().out
    assert all(part in text for part in parts)
