"""Numbers on the pages, and those with a command that gives them: `python scripts/page_numbers.py [--without] [PAGE]`.

A number stands in the prose, a table or a caption: not in code, a formula, a heading or a link, and no name (figure 7,
E13, J(10), 2D, float32, exit code 3, a version, a date, a year of a source), and is no whole number below 10 without a
unit, which counts or defines. It has a command if its section names one in code, or if a section that contains this one
says "Measured by" and names one; a mark of `validation.filling` has one anywhere. Prints page, numbers, those with a
command, their share, and the words that no program wrote; `--without` the lines of the other numbers, too.
"""

import argparse
import itertools
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from refsim.core.streams import any_letter  # noqa: E402

WRITTEN = {"docs/checks.md", "docs/equations.md"}  # whole, by programs that the pages name
COMMAND = r"`(?:python\s+-m\s+(?:validation|tests)\b|python\s+(?:scripts|tests)/|pytest\s|refsim\s|nox\s+-s\s)[^`]*`"
MEASURED = re.compile(r"Measured\s+by\s+" + COMMAND)
LINE = re.compile(r"^(?:python|pytest|refsim|nox) ", re.MULTILINE)
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FORMULA = re.compile(r"\$\$.*?\$\$", re.DOTALL)
MARKED = re.compile(r"<!-- \{[^{}]*\} -->(.*?)<!-- \. -->")
PART = re.compile(r"<!-- (\w+) -->\n(.*?)<!-- end of \1 -->", re.DOTALL)  # that a program writes
HEADING = re.compile(r"^(#+) .*$", re.MULTILINE)
NAMED = r"figures?|tables?|sections?|chapters?|lessons?|formulas?|Algorithm|claims?|Python|Warp|Taichi|step|line"
NAMED += r"|exit codes?|kill"
NO_NUMBER = re.compile(
    r"\$[^$\n]*\$|`[^`]*`|\]\([^)]*\)|<[^>]*>|https?://\S+|10\.\d{4,}/\S+"  # formulas, code, links, DOIs
    r"|\b\d{4}-\d\d-\d\d\b|\bcommits? [0-9a-f]{8}\b|\b\d+\.\d+\.\d+\b|\b[123]D\b|\bfloat(?:32|64)\b"
    r"|\b[A-Z]+\d+[a-z]?\b|\b[A-Z]\(\d+[a-z]?\)|\((?:Algorithm )?\d+(?:\.\d+)?(?:, [\d., a-z]+)?\)|\[\d+\]"
    rf"|\b(?:{NAMED}) -?\d[\d.]*(?:(?:, | and | to |-)\d[\d.]*)*"
    r"|\b(?:19|20)\d\d\b|\b\d+ \((?:19|20)?\d*\) \d+|\b\d+\(\d+\)(?:, \d+)?"  # years, volume (year) page
)
NUMBER = re.compile(r"(?<![\w.,/^-])[-+\u00b1]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?(?![\w/]|\.\d)")
UNIT = r" ?(?:%|(?:d|h|s|ms|us|ns|m|mm|cm|kg|N|Pa|K|J|W|Hz|rad|[KMG]i?B|degrees|times|spacings)\b)"
CODE_LINE = "\0"


def plain(text: str) -> str:
    """The page without code blocks and formulas of their own lines; a block with a command leaves a sign."""
    text = FENCED.sub(lambda block: CODE_LINE if block[1] == "sh" and LINE.search(block[2]) else "", text)
    return FORMULA.sub("", text)


def sections(text: str) -> Iterator[tuple[str, bool]]:
    """The text of each section, and whether its numbers have a command."""
    heads = [(0, 0), *((found.start(), len(found[1])) for found in HEADING.finditer(text)), (len(text), 0)]
    above: list[tuple[int, bool]] = []
    for (begin, level), (end, _) in itertools.pairwise(heads):
        own = text[begin:end]
        above = [*(pair for pair in above if pair[0] < level), (level, bool(MEASURED.search(own)))]
        yield own, any(measured for _, measured in above) or bool(re.search(COMMAND, own)) or CODE_LINE in own


def numbers(words: str) -> list[str]:
    """The numbers of a line."""
    text = NO_NUMBER.sub(" ", HEADING.sub(" ", words))
    found = ((number[0], text[number.end() :]) for number in NUMBER.finditer(text))
    return [number for number, after in found if len(number.lstrip("-+\u00b1")) > 1 or re.match(UNIT, after)]


def counted(text: str, written: bool = False) -> tuple[int, int, list[str]]:
    """(numbers, those with a command, lines of the others) of a page; `written`: by a program."""
    every, having, without = 0, 0, []
    for own, named in sections(plain(text)):
        for line in own.splitlines():
            marked = sum(len(numbers(found[1])) for found in MARKED.finditer(line))
            others = len(numbers(MARKED.sub(" ", line)))
            every, having = every + marked + others, having + marked
            if named or written:
                having += others
            elif others:
                without.append(line)
    return every, having, without


def pages() -> list[Path]:
    """The pages of the repository."""
    return [*sorted((ROOT / "docs").rglob("*.md")), *(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING"))]


@any_letter()
def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="how many numbers on the pages have a command that gives them")
    parser.add_argument("--without", action="store_true", help="print the lines whose numbers have no command")
    parser.add_argument("pages", nargs="*", metavar="PAGE", help="docs/liquid.md, for example; default: all")
    given = parser.parse_args(words)
    total = [0, 0, 0]
    for path in [ROOT / page for page in given.pages] or [*pages(), ROOT / "CHANGELOG.md"]:
        name, text = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        every, having, without = counted(text, name in WRITTEN)
        hand = 0 if name in WRITTEN else len(PART.sub("", text).split())
        total = [a + b for a, b in zip(total, (every, having, hand), strict=True)]
        print(f"{name:44} {every:5} {having:5} {having / max(every, 1):6.0%} {hand:6}")
        for line in without if given.without else ():
            print(f"    {' '.join(numbers(MARKED.sub(' ', line)))}  |  {line[:150]}")
    print(f"{'all':44} {total[0]:5} {total[1]:5} {total[1] / max(total[0], 1):6.1%} {total[2]:6}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
