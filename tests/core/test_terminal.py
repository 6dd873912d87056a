"""What is printed on a terminal: no line wider than it, no word broken; in a pipe a row is a line."""

import functools
import math
import re
import sys

import pytest

from refsim.__main__ import main
from refsim.core import terminal
from refsim.core.tables import fitted, table
from tests.tank_file import GRAVITY, tank

HEAD = ("name", "bytes", "meaning", "where")
WORDS = "what rounding takes from the position: x lies at position + residual"
ROWS = [("position_residual", "9.4 KiB", WORDS, "a.kernel"), ("[b]mass[/b]", "19.4 KiB", "mass m", "")]
ROWS.append((":smile:", "1 B", "-", "refsim.boundary.adami_2012.kernels.strain"))


def words(text):
    return sorted(re.sub(r"-{3,}", "", text).split())


@pytest.mark.parametrize("width", [132, 80, 60, 45])
def test_a_table_is_as_wide_as_the_terminal_and_breaks_no_word(width):
    wide, narrow = (table(ROWS, HEAD, (1,), w) for w in (math.inf, width))
    assert len(wide.splitlines()) == 2 + len(ROWS)
    assert max(map(len, narrow.splitlines())) <= width
    assert words(narrow) == words(wide)
    assert " 9.4 KiB" in narrow  # a number stays with its unit
    assert (narrow == wide) == (max(map(len, wide.splitlines())) <= width)


def test_a_wrapped_line_goes_on_further_in():
    assert fitted("  one two three\nx", 10) == "  one two\n      three\nx"
    assert fitted("no-word/is.broken", 4) == "no-word/is.broken"


def on_a_terminal(monkeypatch):
    """80 columns, from here on: between a fixture and its test the streams are others."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr(terminal, "_console", functools.cache(terminal._console.__wrapped__))
    for stream in (sys.stdout, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: True)


@pytest.mark.parametrize(
    "command",
    [["plan", "tank.toml"], ["list"], ["list", "--all"], ["example"], ["contract", "--arguments", "sph.density"]],
)
def test_commands_fit_on_a_terminal(command, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.toml").write_text(tank(1e-3, 4, 4, GRAVITY))
    assert main(command) == 0
    wide = capfd.readouterr().out
    on_a_terminal(monkeypatch)
    assert main(command) == 0
    narrow = capfd.readouterr().out
    assert max(map(len, narrow.splitlines())) <= 80
    assert words(narrow) == words(wide)


def test_an_error_is_wrapped_between_words(capfd, monkeypatch):
    on_a_terminal(monkeypatch)
    assert main(["run", "a_scene_file_that_is_not_there.toml", "--backend", "numpy", "--quiet"]) == 2
    told = capfd.readouterr().err
    assert max(map(len, told.splitlines())) <= 80
    assert " ".join(told.split()).startswith("refsim: scene file a_scene_file_that_is_not_there.toml does not exist; ")


def test_a_bar_in_a_pipe_is_lines_of_text(capfd, monkeypatch):
    monkeypatch.setattr(terminal, "TOLD", 0.0)
    bar = terminal.Bar(2)
    bar.to(1, "half")
    bar.to(5, "whole")
    bar.close()
    hidden = terminal.Bar(2, shown=False)
    hidden.to(1, "x")
    hidden.close()
    told = capfd.readouterr().err.splitlines()
    assert [line.split()[0] for line in told] == ["50%", "100%", "100%"]
    assert [line.split(": ")[1] for line in told] == ["half", "whole", "whole"]
    assert all(re.fullmatch(r"[ \w%.,:-]+", line) for line in told)
