"""Words that do not return: each coined word or citation that a reader cannot follow, with what is written instead."""

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).parents[2]
NEVER = {
    r"\brestatement\b": "the equation or section of the paper itself",
    r"\bthe spec\b|\bspec's\b": "the paper",
    r"walls of section 9": "walls",
    r"\bhouses?\b": "package or module",
    r"\bways? \[m": "displacement [m]",
    r"\bnobody\b": "no particle, no thread, no program",
    r"\bhurts?\b": "changes no result",
    r"\bhangs? on\b": "depends on",
    r"\bfor people\b": "as text",
    r"\bout of nothing\b": "walls (or the scheme) add energy",
    r"memory read together": "neighbouring threads read contiguous memory",
    r"own note said": "as its note predicts",
    r"\bsomebody\b|\banybody\b|\bwhoever\b": "the user, the caller, or the thing itself",
    r"\bbears?\b": "has",
    r"\blent\b": "given",
    r"\basks? for\b|\basked for\b": "needs, requires or selects",
    r"\bleavings\b": "temporary files",
    r"\bYou want\b": "the reader's aim as a noun",
}
# Without limits of words, and in small letters: what a text is searched for first, which is twenty times as fast
ROUGH = {re.compile(pattern.replace(r"\b", "").lower()): pattern for pattern in NEVER}
PLACES = ["refsim", "validation", "docs", "scripts", "tests", "README.md", "CONTRIBUTING.md"]
KINDS = {".py", ".md", ".toml", ".json"}


def written(place):
    """Texts of a file or folder by path."""
    path = ROOT / place
    files = path.rglob("*") if path.is_dir() else [path]
    return {file.relative_to(ROOT).as_posix(): file.read_text() for file in files if file.suffix in KINDS}


def found(texts):
    for name, text in texts.items():
        small = text.lower()
        near = [pattern for rough, pattern in ROUGH.items() if rough.search(small)]
        for number, line in enumerate(text.splitlines() if near else (), 1):
            for pattern in near:
                if re.search(pattern, line, re.IGNORECASE):
                    yield f"{name}:{number}: {pattern!r}; write: {NEVER[pattern]}"


@pytest.mark.parametrize("place", PLACES)
def test_words_that_do_not_return(place):
    texts = written(place)
    texts.pop("tests/across/test_words.py", None)
    assert texts
    assert not list(found(texts))


@pytest.mark.parametrize(
    "line",
    ["The section 4.6 of the restatement", "its way [m]", "Nobody else", "each hangs on all", "a sentence for people"],
)
def test_each_of_them_is_found(line):
    assert len(list(found({"x.py": line}))) == 1
