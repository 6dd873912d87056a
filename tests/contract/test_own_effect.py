"""The guide's effect, as a small installed distribution: found by scenes and commands, and judged on every backend."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from importlib import resources

import pytest

from refsim.backends.arrays import unavailable

GUIDE = resources.files("refsim.contract").joinpath("guide.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```\w+\n# file: (\S+)\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL))
SCENE = """
name = "one falls"
spacing = 0.1
support_radius = 0.26
dtype = "float64"
step = 1e-3
[[fluid]]
shape = "box"
lower = [0.0, 0.0, 0.0]
cells = [1, 1, 1]
[effects.drag]
rate = 2.0
wind = [1.0, 0.0, 0.0]
"""
RUN = """
import math
from refsim import Drag, Simulation, load_scene
simulation = Simulation(load_scene("scene.toml"), "numpy")
while simulation.time < 0.5:
    simulation.step()
v = simulation.field("velocity")[0, 0]
assert abs(v - (1 - math.exp(-2 * simulation.time))) < 2e-3, v
print(Drag.__name__)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the package and its metadata, as pip leaves them."""
    folder = tmp_path_factory.mktemp("site")
    assert [name for name in FILES if name.endswith(".py")] == [
        f"refsim_drag/{name}.py" for name in ("__init__", "operations", "kernels")
    ]
    (folder / "refsim_drag").mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    known = folder / "refsim_drag-1.0.dist-info"
    known.mkdir()
    (known / "METADATA").write_text("Metadata-Version: 2.1\nName: refsim-drag\nVersion: 1.0\n")
    ((group, entry),) = re.findall(r'entry-points."(.*?)"\]\n(.*)', FILES["pyproject.toml"])
    (known / "entry_points.txt").write_text(f"[{group}]\n{entry.replace(chr(34), '')}\n")
    (folder / "scene.toml").write_text(SCENE)
    return folder


def python(folder, *arguments, **more):
    path = os.pathsep.join([str(folder), *filter(None, sys.path)])
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, cwd=folder, env=os.environ | {"PYTHONPATH": path} | more, capture_output=True, text=True
    )


def test_scenes_and_commands_find_it(installed):
    done = python(installed, "-W", "error", "-c", RUN)
    assert done.stdout == "Drag\n", done.stderr
    for words, said in (("list drag", "refsim_drag.drag"), ("plan scene.toml", "refsim_drag.drag")):
        done = python(installed, "-m", "refsim", *words.split())
        assert done.returncode == 0, done.stderr
        assert said in done.stdout


@pytest.mark.parametrize("backend", ["numpy", "cpu", "cuda"])
def test_its_programs_hold(backend, installed):
    more = {}
    if backend == "cuda" and unavailable("cuda") is not None:
        if importlib.util.find_spec("numba_cuda") is None:
            pytest.skip("numba-cuda is not installed")
        more = {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    done = python(
        installed, "-m", "refsim", "contract", backend, "refsim_drag.drag", "--dtype", "float64", "--json", **more
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (told,) = json.loads(done.stdout)["operations"].values()
    assert told["trials"] > (2 if backend == "numpy" else 20)


def test_a_package_that_cannot_be_imported_is_warned_of(installed, tmp_path):
    known = tmp_path / "broken-1.0.dist-info"
    known.mkdir()
    (known / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (known / "entry_points.txt").write_text("[refsim.operations]\nbroken = no_such_module_of_anyone\n")
    done = python(tmp_path, "-c", "import refsim")
    assert done.returncode == 0
    assert "the entry point broken of refsim.operations cannot be imported" in done.stderr
