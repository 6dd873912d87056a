"""What a stored result depends on, and where it says it comes from."""

from pathlib import Path

import pytest

from tests.running import python
from validation import results
from validation.experiments.dam_break import runs as dam_claims
from validation.experiments.droplet import runs as droplet_runs
from validation.experiments.heat import runs as heat_runs

ROOT = Path(results.__file__).resolve().parent.parent


@pytest.fixture
def module(tmp_path):
    def write(text):
        path = tmp_path / "module.py"
        path.write_text(text)
        for remembered in (results.sources_digest, results._digest_of):
            remembered.cache_clear()
        return results.sources_digest(str(path))

    yield write
    for remembered in (results.sources_digest, results._digest_of):
        remembered.cache_clear()


def test_comments_docstrings_and_layout_do_not_count(module):
    plain = module("def f(x):\n    return x + 1\n")
    assert (
        module('"""Words."""\n\n\ndef f(x):  # more\n    """And more."""\n    return (x\n            + 1)\n') == plain
    )
    assert module("def f(x):\n    return x + 2\n") != plain
    assert module('def f(x):\n    return x + 1\n\n\nTEXT = """Words."""\n') != plain


def test_refsim_and_imports_of_validation_count_and_what_presents_does_not():
    behind = {file.relative_to(ROOT).as_posix() for file in results.modules_behind(Path(heat_runs.__file__))}
    scene = "validation/metrics/heat.py"
    assert {"refsim/heat/kernels.py", "refsim/core/effect.py", "validation/running.py", scene} <= behind
    assert not any(place.startswith(("refsim/contract/", "refsim/render/", "validation/report")) for place in behind)
    assert results.sources_digest(dam_claims.__file__) != results.sources_digest(droplet_runs.__file__)


PROGRAM = """
import sys
from refsim import Akinci2013, Box, BoxWalls, Gravity, Scene, Simulation, WeaklyCompressible
before = set(sys.modules)
scene = Scene(spacing=0.1, support_radius=0.2, dim=3, fluid=(Box(cells=(2, 2, 2)),), effects=(
    WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=0.1), Gravity(acceleration=(0.0, -9.81, 0.0)),
    Akinci2013(surface_tension=0.07), BoxWalls(lower=(0, 0, 0), upper=(1, 1, 1))))
Simulation(scene, "cpu").step()
print("\\n".join(sys.modules[name].__file__ for name in set(sys.modules) - before if name.startswith("refsim.")))
"""


def test_what_a_run_loads_counts(tmp_path):
    """Every module that is loaded only when a step is run is behind every run."""
    file = tmp_path / "run.py"
    file.write_text(PROGRAM)
    found = python(file, NUMBA_DISABLE_JIT="1", REFSIM_CACHE_DIR=str(tmp_path))
    loaded = {Path(line) for line in found.stdout.split("\n") if line and not line.startswith(str(tmp_path))}
    assert ROOT / "refsim" / "surface_tension" / "akinci_2013" / "kernels.py" in loaded
    assert loaded <= set(results.modules_behind(file))
