"""The guide's effect, as a small installed distribution: found by scenes and commands, and judged on every backend."""

import importlib.util
import json
import re
import shutil
from importlib import resources

import pytest

from refsim.backends.arrays import unavailable
from tests.running import python, rows

GUIDE = resources.files("refsim.contract").joinpath("guide.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^```\w+\n# file: (\S+)\n(.*?)^```$", GUIDE, re.MULTILINE | re.DOTALL))
SCENE = rows(__file__, "drag")
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


def test_scenes_and_commands_find_it(installed):
    assert python("-W", "error", "-c", RUN, folder=installed).stdout == "Drag\n"
    for words, said in (("list drag", "refsim_drag.drag"), ("plan scene.toml", "refsim_drag.drag")):
        assert said in python("-m", "refsim", *words.split(), folder=installed).stdout


@pytest.mark.parametrize("backend", ["numpy", "cpu", "cuda"])
def test_its_programs_hold(backend, installed):
    more = {}
    if backend == "cuda" and unavailable("cuda") is not None:
        if importlib.util.find_spec("numba_cuda") is None:
            pytest.skip("numba-cuda is not installed")
        more = {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    words = ["contract", backend, "refsim_drag.drag", "--dtype", "float64", "--json"]
    done = python("-m", "refsim", *words, folder=installed, **more)
    (told,) = json.loads(done.stdout)["operations"].values()
    assert told["trials"] > (2 if backend == "numpy" else 20)


@pytest.mark.parametrize("packed", [False, True], ids=["folder", "archive"])
def test_a_package_that_cannot_be_imported_is_warned_of(packed, tmp_path):
    known = tmp_path / "site" / "broken-1.0.dist-info"
    known.mkdir(parents=True)
    (known / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1.0\n")
    (known / "entry_points.txt").write_text("[refsim.operations]\nbroken = no_such_module_of_anyone\n")
    folder = shutil.make_archive(tmp_path / "site", "zip", tmp_path / "site") if packed else tmp_path / "site"
    done = python("-c", f"import sys\nsys.path.append({str(folder)!r})\nimport refsim")
    assert "the entry point broken of refsim.operations cannot be imported" in done.stderr
