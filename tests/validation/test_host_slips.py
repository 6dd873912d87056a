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
'''


@pytest.fixture
def area(tmp_path, monkeypatch):
    """A function of a module of its own."""
    (tmp_path / "small_module.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    import small_module

    return small_module.area


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


def test_functions_of_a_package_are_found_with_their_methods():
    found = {host_slips.place(f) for f in host_slips.functions("study")}
    assert {"refsim.study.result.Study.base", "refsim.study.result.Advice.words"} <= found  # a property, a method
    assert not any(".formulas." in place or "_cuda" in place for place in found)


def test_quick_tests_come_first_until_half_of_the_time_is_gone():
    tests = [(1.0, "a"), (2.0, "b"), (4.0, "c")]
    assert host_slips.quick(tests, 8.0) == ["a", "b"]
    assert host_slips.quick(tests, 14.0) == ["a", "b", "c"]
    assert host_slips.quick(tests, 0.1) == ["a"]
    assert host_slips.quick(tests, 14.0, "c") == ["c", "a", "b"]
    assert host_slips.quick([], 8.0) == []


def test_tests_pass_without_a_slip_where_refsim_is_a_plugin_of_pytest():
    """pytest warns, which is an error here, of a plugin that was imported before it could rewrite its assertions."""
    quick = "tests/validation/test_host_slips.py::test_quick_tests_come_first_until_half_of_the_time_is_gone"
    job = {"module": "refsim.study.result", "name": "Study.base", "number": None, "tests": [quick], "seconds": 60.0}
    assert host_slips.asked(job) == ("refsim.study.result.Study.base: ", quick, 0)
