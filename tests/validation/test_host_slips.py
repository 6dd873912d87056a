"""Slips in host code: places are found, a slip alters an answer, and quick tests come first."""

import types

import pytest

from tests import host_slips

MODULE = '''
def area(width, height):
    """Two numbers: 1 and 2."""
    if width < 0:
        raise ValueError(f"width {width - 1}")
    return width * height + 3


def rest(rows, flags):
    flags[rows > 2] = True
    flags.set(fontsize=9)
    return rows.reshape(-1, 3)
'''


@pytest.fixture
def area(tmp_path, monkeypatch):
    """A function of a module of its own."""
    (tmp_path / "small_module.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    import small_module

    return small_module.area


def test_what_is_as_good_as_before_is_no_slip(area):
    """A flag that is -1 or 1.01, a size of letters, and -2 for the rest of a shape."""
    import small_module

    slips = [host_slips.altered(small_module.rest, *change)[1] for change in host_slips.changes(small_module.rest)]
    assert sorted(words.partition("  ->  ")[2] for words in slips) == [
        "flags[rows <= 2] = True", "flags[rows > 0] = True", "return rows.reshape(+1, 3)", "return rows.reshape(-1, 4)",
    ]  # fmt: skip


def test_slips_are_found_outside_of_words_and_alter_the_answer(area):
    slips = [host_slips.altered(area, *change) for change in host_slips.changes(area)]
    assert sorted(words.partition("  ->  ")[2] for _, words in slips) == [
        "return width * height + 4", "return width * height - 3", "return width / height + 3", "width < 1",
        "width >= 0",
    ]  # fmt: skip
    answers = set()
    for code, _ in slips:
        try:
            answers.add(types.FunctionType(code, area.__globals__)(2.0, 3.0))
        except ValueError:
            answers.add(None)
    assert (area(2.0, 3.0), answers) == (9.0, {10.0, 3.0, 2 / 3 + 3, None, 9.0})  # 9: only a width of 0 tells
