"""The commit that a result names: that of the checkout, that of a release, or none."""

import json
import pathlib
import shutil
import subprocess

import pytest

import refsim
from tests.running import python

PACKAGE = pathlib.Path(refsim.__file__).parent
HEAD = "0123456789abcdef0123456789abcdef01234567"


def told(folder):
    """(commit, version) of the module in a folder."""
    words = "import json, runpy; m = runpy.run_path('refsim/core/versions.py'); "
    words += "print(json.dumps([m['commit'](), m['version']()]))"
    return json.loads(python("-c", words, folder=folder).stdout)


@pytest.fixture
def copied(tmp_path):
    """A folder with the module alone."""
    (tmp_path / "refsim" / "core").mkdir(parents=True)
    shutil.copy(PACKAGE / "core" / "versions.py", tmp_path / "refsim" / "core")
    return tmp_path


def git(folder, *words):
    made = ("-c", "user.name=name", "-c", "user.email=name@example.org")
    return subprocess.run(["git", *made, *words], cwd=folder, capture_output=True, text=True, check=True).stdout.strip()


def test_a_checkout_names_its_commit_and_a_package_within_another_repository_none(copied):
    git(copied, "init", "-q")
    git(copied, "add", ".")
    git(copied, "commit", "-qm", "one")
    head = git(copied, "rev-parse", "HEAD")
    commit, version = told(copied)
    assert (commit, version.partition("+")[2]) == (head, f"g{head[:10]}")
    inside = copied / "site-packages"
    inside.mkdir()
    shutil.copytree(copied / "refsim", inside / "refsim")
    commit, version = told(inside)
    assert (commit, "+" in version) == (None, False)


def test_a_release_names_the_commit_that_it_was_built_from(copied):
    assert told(copied)[0] is None
    (copied / "refsim" / "commit.txt").write_text(f"{HEAD}\n")
    commit, version = told(copied)
    assert (commit, version.partition("+")[2]) == (HEAD, "g0123456789")
