"""CONTRIBUTING.md adds a method from the first line to the last: its files are cut out of the page and must work.

The files are put beside the package, not into it, and run in processes of their own, so that no other test meets the
example's effect.
"""

import importlib.util
import pathlib
import re
import shutil

import pytest

from tests.running import ROOT, python

FILE = re.compile(r"^```python\n# file: (refsim/\S+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TOML = re.compile(r"^```toml\n(?!# file)(.*?)^```$", re.MULTILINE | re.DOTALL)
ORDER = ["reference.py", "operations.py", "kernels.py", "__init__.py", "cases.py"]

FOUND_BESIDE = """
import pathlib, sys
import refsim
root = pathlib.Path(sys.argv[1])
refsim.__path__.append(str(root / "refsim"))
from refsim.core.operation import REGISTRY
before = set(REGISTRY)
import refsim.velocity_smoothing.operations
from refsim import contract
operation, = (REGISTRY[name] for name in set(REGISTRY) - before)
"""

LADDER = """
for backend, dtype in (("numpy", "float64"), ("cpu", "float32")):
    found = list(contract.climb(contract.Target(operation, backend, dtype)))
    failed = [str(outcome) for outcome in found if not outcome.passed]
    assert not failed, failed
    print(backend, dtype, "climbed", *sorted({outcome.step for outcome in found}))
"""

RULES = """
sys.path.insert(0, sys.argv[2])
import test_registry
for rule in test_registry.RULES:
    problems = list(rule([operation], root / "refsim"))
    assert not problems, problems
test_registry.test_operation_has_hard_inputs_and_a_closed_form(operation.name)
print("kept", len(test_registry.RULES), "rules")
"""

SCENE = """
import numpy as np
from refsim.scene.plan import make_plan
from refsim.scene.files import parse_scene
from refsim.engine.simulation import Simulation

LIQUID = '''
spacing = 0.1
support_radius = 0.2
step = 1e-3
[[fluid]]
shape = "box"
cells = [4, 4, 4]
[[fluid]]
shape = "box"
lower = [0.4, 0.0, 0.0]
cells = [4, 4, 4]
velocity = [0.0, 0.5, 0.0]
[effects.weakly_compressible]
density = "summation"
sound_speed = 10.0
'''
energies = []
for effects in ("", sys.argv[3]):
    scene = parse_scene(LIQUID + effects, "the page")
    simulation = Simulation(make_plan(scene), "cpu")
    for _ in range(20):
        simulation.step()
    velocity = simulation.field("velocity").astype(float)
    assert abs(velocity.mean(0) - [0.0, 0.25, 0.0]).max() < 1e-6
    energies.append(((velocity - velocity.mean(0)) ** 2).sum())
assert "velocity_smoothing.smooth" in simulation.plan.launches()
assert energies[1] < 0.995 * energies[0], energies
print("slowed down")
"""

COMPLAINT = """
sys.path.insert(0, sys.argv[2])
import test_registry
print(*test_registry.unbalanced_virials([operation], root))
"""

SIMULATED = """
from tests.simulator_threads import install
install()
outcome = contract.run(operation, "cuda", "float32", "cloud_2d")
assert outcome.passed, str(outcome)
print("simulated")
"""


@pytest.fixture(scope="module")
def page():
    return (ROOT / "CONTRIBUTING.md").read_text()


@pytest.fixture(scope="module")
def example(page, tmp_path_factory):
    """Folder with the example's files as the page has them."""
    root = tmp_path_factory.mktemp("contributing")
    for name, text in FILE.findall(page):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def run(example, program, *arguments, **environment):
    return python("-c", FOUND_BESIDE + program, example, *arguments, folder=example, **environment).stdout


def test_the_page_has_every_file_of_a_method(page):
    assert [pathlib.Path(name).name for name, _ in FILE.findall(page)] == ORDER
    assert len({pathlib.Path(name).parent for name, _ in FILE.findall(page)}) == 1


def test_the_example_climbs_the_ladder_and_keeps_the_rules(page, example):
    (effect,) = TOML.findall(page)
    said = run(example, LADDER + RULES + SCENE, str(ROOT / "tests" / "ladder"), effect)
    assert "cpu float32 climbed T1 T10 T2 T3 T4 T5 T6 T7 T9" in said
    assert "numpy float64 climbed T1" in said
    assert "kept 6 rules" in said
    assert "slowed down" in said


def test_the_example_runs_in_the_cuda_simulator(example):
    if importlib.util.find_spec("numba_cuda") is None:
        pytest.skip('numba-cuda is not installed; pip install "refsim[cuda]" brings it')
    assert "simulated" in run(example, SIMULATED, NUMBA_ENABLE_CUDASIM="1", NUMBA_DISABLE_JIT="1")


def test_a_force_with_a_virial_is_sent_through_the_door(example, tmp_path):
    """The walk's own has none; along the pair instead of the velocities it breaks a rule."""
    ladder, changed = str(ROOT / "tests" / "ladder"), tmp_path / "changed"
    assert run(example, COMPLAINT, ladder).strip() == ""
    shutil.copytree(example, changed)
    (reference,) = changed.rglob("reference.py")
    walk = reference.read_text()
    assert walk.count("(j.velocity - i.velocity)") == 1
    reference.write_text(walk.replace("(j.velocity - i.velocity)", "-ij.x"))
    assert "derive its effect from refsim.surface_tension.cohesion.PairCohesion" in run(changed, COMPLAINT, ladder)
