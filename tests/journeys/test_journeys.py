"""The three paths of paths.md, each in an empty folder with the wheel: files, commands and their output."""

import dataclasses
import doctest
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[2]
PAGE = pathlib.Path(__file__).with_name("paths.md").read_text()
PATHS = dict(re.findall(r"^## The (\w+): [^\n]*\n(.*?)(?=^## |\Z)", PAGE, re.MULTILINE | re.DOTALL))
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MADE = {"engineer": ["mine.py", "test_mine.py"], "researcher": ["front.png"], "teacher": ["dam.html"]}
needs_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="the commands are typed into bash")


@pytest.fixture(scope="module")
def installed(request):
    """Folder for PYTHONPATH with the wheel of the sources; None if these are absent and refsim is installed."""
    return request.getfixturevalue("unpacked") if (ROOT / "refsim").is_dir() else None


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """A folder for PATH with the commands of the pages, all by this interpreter."""
    folder = tmp_path_factory.mktemp("bin")
    for name, words in (("refsim", "-m refsim"), ("pytest", "-m pytest"), ("python", "")):
        (folder / name).write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} {words} "$@"\n')
        (folder / name).chmod(0o755)
    return folder


@pytest.fixture
def bash(installed, programs, tmp_path):
    """What a user types into, in an empty folder."""
    place = {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(installed or "")}
    place |= {"NUMBA_NUM_THREADS": "1", "PYTEST_ADDOPTS": ""}  # other tests run on the other cores
    return Bash(tmp_path, os.environ | place)


@dataclasses.dataclass
class Bash:
    """Lines of commands, carried out in a folder."""

    folder: pathlib.Path
    environment: dict

    def typed(self, line):
        """Output of one line, which ends with the exit code that its comment names, or 0."""
        command, _, comment = line.partition("    #")
        done = subprocess.run(
            ["bash", "-c", command], cwd=self.folder, env=self.environment, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        code = int((re.search(r"exit code (\d)", comment) or [0, 0])[1])
        assert done.returncode == code, f"{command}\n{done.stdout}"
        return done.stdout


def same(expected, output):
    """Whether the output is what the page shows, in which ... stands for any text and blanks do not count."""
    how = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    return doctest.OutputChecker().check_output(expected, output, how)


def walked(path, bash):
    """Carry out a path of the page."""
    output, compared = "", 0
    for language, text in BLOCK.findall(path):
        if language == "sh":
            output = "".join(bash.typed(line) for line in text.splitlines())
        elif language == "text":
            assert same(text, output), f"the page shows\n{text}\nthe output is\n{output}"
            compared += 1
        else:
            (bash.folder / re.match(r"# file: (\S+)\n", text)[1]).write_text(text)
    return compared


@needs_bash
@pytest.mark.parametrize("name", MADE)
def test_the_path(name, bash, tmp_path):
    assert walked(PATHS[name], bash) >= 2
    for file in MADE[name]:
        assert (tmp_path / file).stat().st_size > 0


def test_every_path_is_walked():
    assert list(PATHS) == list(MADE)


@needs_bash
def test_the_installed_package_is_the_one_that_runs(bash, installed):
    """Neither the sources in the current folder nor those of an editable installation."""
    where = bash.typed('python -c "import refsim; print(refsim.__file__)"').strip()
    assert not pathlib.Path(where).is_relative_to(ROOT)
    if installed is not None:
        assert pathlib.Path(where).is_relative_to(installed)
