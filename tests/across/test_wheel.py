"""The wheel: which names it installs, that its data is in it, and that it works without the clone."""

import importlib.metadata
import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys
import zipfile

import pytest

ROOT = pathlib.Path(__file__).parents[2]
SOURCES = ("setup.cfg", "pyproject.toml", "README.md", "LICENSE")
SCENE = """
spacing = 0.01
support_radius = 0.02
dim = 2
end_time = 0.001

[[fluid]]
shape = "box"
cells = [4, 4, 1]

[effects.weakly_compressible]
sound_speed = 20.0
"""
BUILD = "from setuptools import setup; setup(script_args=['-q', 'build', '--build-lib', 'unpacked', 'egg_info'])"


def run(command, folder, **environment):
    return subprocess.run(
        [sys.executable, *command], cwd=folder, env=os.environ | environment, capture_output=True, text=True, check=True
    ).stdout


def makes_wheels():
    version = importlib.metadata.version("setuptools").split(".")
    return importlib.util.find_spec("wheel") is not None or tuple(map(int, version[:2])) >= (70, 1)


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """The wheel of a copy of the sources, unpacked; setuptools before 70.1 only lays out what it would hold."""
    copy = tmp_path_factory.mktemp("clone")
    for name in SOURCES:
        shutil.copy(ROOT / name, copy)
    for folder in ("refsim", "validation", "tests", "scripts"):
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__"))
    if makes_wheels():
        options = ("--no-deps", "--no-build-isolation", "--no-index", "--no-cache-dir", "--quiet")
        run(("-m", "pip", "wheel", *options, "--wheel-dir", "dist", "."), copy)
        (wheel,) = (copy / "dist").glob("refsim-*.whl")
        zipfile.ZipFile(wheel).extractall(copy / "unpacked")
    else:
        run(("-c", BUILD), copy)
        shutil.move(copy / "refsim.egg-info", copy / "unpacked")
    return copy / "unpacked"


def test_the_wheel_installs_no_other_name(unpacked):
    """A package `validation` exists on PyPI."""
    assert all(path.name.startswith("refsim") for path in unpacked.iterdir())
    (found,) = importlib.metadata.distributions(path=[str(unpacked)])
    assert found.read_text("top_level.txt").split() == ["refsim"]
    assert [(e.name, e.value) for e in found.entry_points] == [("refsim", "refsim.__main__:main")]


def test_the_wheel_holds_every_source_and_its_data(unpacked):
    def files(folder):
        return {p.relative_to(folder) for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts}

    assert files(unpacked / "refsim") == files(ROOT / "refsim")
    data = {p.name for p in files(unpacked / "refsim") if p.suffix != ".py"}
    assert data >= {"scene.schema.json", "sigma_map.json", "wetting_map.json"}


def test_commands_work_with_the_wheel_alone(unpacked, tmp_path):
    """In a folder that holds a scene and nothing else; the path of modules begins with the unpacked wheel."""
    (tmp_path / "drop.toml").write_text(SCENE)

    def refsim(*arguments):
        return run(("-m", "refsim", *arguments), tmp_path, PYTHONPATH=str(unpacked))

    program = "from refsim.surface_tension import calibration as c; print(c.__file__, len(c.sigma_map()))"
    found = run(("-c", program), tmp_path, PYTHONPATH=str(unpacked))
    assert found.startswith(str(unpacked))
    assert refsim("--version").startswith("refsim ")
    assert "16 particles" in refsim("plan", "drop.toml")
    assert "scene: reached" in refsim("run", "drop.toml", "--backend", "numpy", "--quiet")
    assert refsim("schema")[0] == "{"


@pytest.mark.parametrize("script", sorted((ROOT / "scripts").glob("*.py")), ids=lambda path: path.name)
def test_scripts_find_the_clone_from_any_folder(script, tmp_path):
    assert run((str(script), "--help"), tmp_path, PYTHONPATH="").startswith("usage")


def test_validation_outside_of_the_clone_says_what_to_do(tmp_path):
    command = [sys.executable, str(ROOT / "validation")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "Run this from the folder of the clone, as `python -m validation`.\n")
