"""Commands on streams of any encoding."""

import ast
import io
import json
import os
import pathlib
import sys

import pytest

import refsim
from refsim.__main__ import main
from refsim.core.streams import any_letter
from tests.running import python
from tests.tank_file import tank

ROOT = pathlib.Path(__file__).parents[2]
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
