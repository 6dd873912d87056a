"""What is printed: tables on a terminal, lines in a pipe, and other letters on streams of any encoding."""

import ast
import functools
import io
import json
import math
import os
import pathlib
import re
import sys

import pytest

import refsim
from refsim.__main__ import main
from refsim.core import terminal
from refsim.core.streams import any_letter
from refsim.core.tables import table
from tests.running import ROOT, answer_of, python
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
    wide = answer_of(capfd, command).out
    on_a_terminal(monkeypatch)
    narrow = answer_of(capfd, command).out
    assert max(map(len, narrow.splitlines())) <= 80
    assert words(narrow) == words(wide)


def test_an_error_is_wrapped_between_words(capfd, monkeypatch):
    on_a_terminal(monkeypatch)
    told = answer_of(capfd, ["run", "a_scene_file_that_is_not_there.toml", "--backend", "numpy", "--quiet"], 2).err
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


NAME = "Tänk ρ 水 \udcff"  # the last is a byte of a file's name that is no letter
TOML = tank(0.001).replace("\n", '\nname = "Tänk ρ 水"\n', 1)


ENCODINGS = pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])


def written(encoding, call):
    """What a command that is called writes to a strict pipe of that encoding; it ends well."""
    raw = io.BytesIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdout", pipe := io.TextIOWrapper(raw, encoding=encoding, errors="strict"))
        assert call() == 0
    assert pipe.errors == "strict"
    return raw.getvalue().decode(encoding)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a scene file whose name has other letters."""
    monkeypatch.chdir(tmp_path)
    pathlib.Path(f"{NAME}.toml").write_text(TOML, encoding="utf-8")
    return tmp_path


@ENCODINGS
@pytest.mark.parametrize("words", [
    ["plan", f"{NAME}.toml"],
    ["run", f"{NAME}.toml", "--backend", "numpy", "--quiet"],
    ["example", "droplet", "--output", NAME],
], ids=lambda words: words[0])  # fmt: skip
def test_a_command_writes_other_letters_into_any_pipe(words, encoding, folder):
    text = written(encoding, lambda: main(words))
    assert {"ascii": "T\\xe4nk \\u03c1", "cp1252": "Tänk \\u03c1", "utf-8": "Tänk ρ 水"}[encoding] in text
    if words[0] == "run":
        assert json.loads((folder / f"{NAME}_run" / "report.json").read_bytes())["reason"] is None


@pytest.mark.skipif(os.name != "posix", reason="the locale is chosen by POSIX's variables")
def test_a_run_in_a_process_without_other_letters(folder):
    """Without Python's UTF-8 mode the C locale has names of files and streams in ASCII."""
    environment = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    words = ["-m", "refsim", "run", f"{NAME}.toml", "--backend", "numpy", "--output", f"{NAME} out"]
    done = python(*words, **environment)
    assert done.stdout.isascii()
    assert done.stderr.isascii()
    assert (folder / f"{NAME} out" / "particles.pvd").exists()


def test_every_command_line_takes_any_stream():
    """The main function of each program stands under the decorator, or calls one that does."""
    decorator = f"{any_letter.__name__}()"
    own = pathlib.Path(refsim.__file__).with_name("__main__.py")
    for file in (own, ROOT / "validation/__main__.py", *(ROOT / "scripts").glob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        mains = [f for f in tree.body if isinstance(f, ast.FunctionDef) and f.name in ("main", "command")]
        decorated = [ast.unparse(d) for f in mains for d in f.decorator_list]
        assert decorated == [decorator] or "command(__doc__" in file.read_text(encoding="utf-8"), file
