"""The wheel: which names it installs, and that its data is in it; test_journeys.py works with it alone."""

import configparser
import importlib.metadata
import json
import runpy
import shutil
import subprocess
import sys
import tarfile

import pytest

from tests.running import ROOT, python

SCRIPTS = sorted(file for file in (ROOT / "scripts").glob("*.py") if "__main__" in file.read_text())
HELP = """
import contextlib, os, runpy, sys
plain, scripts = sys.path[1:], sys.argv[1:]
for script in scripts:
    sys.path, sys.argv = [os.path.dirname(script), *plain], [script, "--help"]
    with contextlib.suppress(SystemExit):
        runpy.run_path(script, run_name="__main__")
    for name in [name for name in sys.modules if name.split(".")[0] in ("scripts", "validation")]:
        del sys.modules[name]
"""
IGNORED = (ROOT / ".gitignore").read_text().replace("/\n", "\n").split()  # names that git does not track


@pytest.fixture(scope="module")
def from_sdist(tmp_path_factory):
    """The source distribution of the tree, unpacked."""
    folder = tmp_path_factory.mktemp("sdist")
    command = "from setuptools import setup; setup(script_args=['-q', 'sdist', '-d', 'dist', 'egg_info', '-e', '.'])"
    copy = shutil.copytree(ROOT, folder / "tree", ignore=shutil.ignore_patterns("__pycache__", ".git", *IGNORED))
    python("-c", command, folder=copy)
    (archive,) = (copy / "dist").glob("refsim-*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    return next(folder.glob("refsim-*"))


def test_the_sdist_holds_what_its_tests_need(from_sdist):
    """Everything that git tracks, so that the tests are the same ones."""
    there = {p.relative_to(from_sdist).as_posix() for p in from_sdist.rglob("*") if p.is_file()}
    for folder in ("refsim", "tests", "validation", "scripts", "docs", "figures", ".ci"):
        for path in (ROOT / folder).rglob("*"):
            name = path.relative_to(ROOT).as_posix()
            if path.is_file() and "__pycache__" not in name and not name.startswith("figures/quick/"):
                assert name in there, name
    files = "README.md CONTRIBUTING.md CHANGELOG.md CITATION.cff codemeta.json LICENSE .gitignore"
    assert set(files.split()) <= there


def test_the_wheel_installs_no_other_name(unpacked):
    """A package `validation` exists on PyPI."""
    assert all(path.name.startswith("refsim") for path in unpacked.iterdir())
    (found,) = importlib.metadata.distributions(path=[str(unpacked)])
    assert found.read_text("top_level.txt").split() == ["refsim"]
    assert {(e.group, e.name, e.value) for e in found.entry_points} == {
        ("console_scripts", "refsim", "refsim.__main__:main"), ("pytest11", "refsim", "refsim.pytest_plugin"),
    }  # fmt: skip


def test_the_wheel_holds_every_source_and_its_data(unpacked):
    def files(folder):
        return {p.relative_to(folder) for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts}

    assert files(unpacked / "refsim") == files(ROOT / "refsim")
    data = {p.name for p in files(unpacked / "refsim") if p.suffix != ".py"}
    assert data >= {"scene.schema.json", "sigma_map.json", "drops.toml", "py.typed", "melting.toml", "pebble.obj"}
    assert any(p.name == "1_surface_particles.md" for p in files(unpacked / "refsim"))


def test_scripts_find_the_clone_from_any_folder(tmp_path):
    """One process runs all, each with the path that it begins with by itself, and without the clone's modules."""
    told = python("-c", HELP, *SCRIPTS, folder=tmp_path, PYTHONPATH="").stdout
    assert told.count("usage") == len(SCRIPTS)


def test_validation_outside_of_the_clone_says_what_to_do(tmp_path):
    command = [sys.executable, str(ROOT / "validation")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "Run this from the folder of the clone, as `python -m validation`.\n")


def test_a_release_fills_in_the_address_of_the_repository(tmp_path):
    release = runpy.run_path(str(ROOT / "scripts" / "release.py"))
    for name in release["ADDRESSED"]:
        shutil.copy(ROOT / name, tmp_path)
    release["fill_in"](tmp_path, "https://example.org/refsim/")
    settings = configparser.ConfigParser(interpolation=None)
    settings.read(tmp_path / "setup.cfg")
    assert "\nIssues = https://example.org/refsim/issues\n" in settings["metadata"]["project_urls"]
    described = json.loads((tmp_path / "codemeta.json").read_text())
    assert described["codeRepository"] == "https://example.org/refsim"
    assert "\nrepository-code: https://example.org/refsim\n" in (tmp_path / "CITATION.cff").read_text()
