"""CONTRIBUTING.md adds a method from the first line to the last: its files are cut out of the page and must work.

The files are put beside the package, not into it, and run in processes of their own, so that no other test meets the
example's effect.
"""

import importlib.util
import pathlib
import re

import pytest

from tests.running import python

ROOT = pathlib.Path(__file__).parents[2]
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
import refsim.velocity_smoothing
from refsim import contract
operation, = (REGISTRY[name] for name in set(REGISTRY) - before)
"""

LADDER = """
for backend, dtype in (("numpy", "float64"), ("cpu", "float32")):
    found = contract.climb(contract.Target(operation, backend, dtype))
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

# an author of a tension follows the walk with a force along the pair
ALONG_THE_PAIR = (
    ("(j.velocity - i.velocity)", "-ij.x"),
)  # fmt: skip
COMPLAINT = """
sys.path.insert(0, sys.argv[2])
import test_registry
print(*test_registry.unbalanced_virials([operation], root))
"""
# the same force behind the door of forces with a virial
COHESIVE = '''
"""Attraction by W over the mean density."""

from typing import Any, ClassVar, NamedTuple

from refsim.core.checked import NotNegative
from refsim.core.effect import Pass
from refsim.smoothing import smoothing
from refsim.smoothing.reference import kernel_value
from refsim.surface_tension.cohesion import PairCohesion
from refsim.sph import liquid_of
from refsim.velocity_smoothing import operations as operations


class Mixing(NamedTuple):
    """Attraction as the kernels take it."""

    rate: float  # [1/s^2]


class VelocitySmoothing(PairCohesion, frozen=True, kw_only=True):
    """Attraction between all pairs."""

    name: ClassVar[str] = "velocity_smoothing"
    coefficient_name: ClassVar[str] = "rate"

    surface_tension: NotNegative | None = None
    rate: NotNegative | None = None

    def passes(self, others):
        return (Pass("velocity_smoothing.smooth", updates=("acceleration",)),) if self.coheres() else ()

    def prepare(self, grid, others):
        return {"mixing": Mixing(grid.real(self.coefficient(grid, others)))}

    def force_of(self, coefficient, r, grid, others):
        kernel = smoothing("wendland_c2", grid.support_radius, grid.dim)
        return -coefficient * r * kernel_value(r, kernel) / liquid_of(others).rest_density
'''
DOOR = """
import refsim as rs

def planned(sigma=1.0, **given):
    liquid = rs.WeaklyCompressible(sound_speed=10.0, density="summation")
    tension = refsim.velocity_smoothing.VelocitySmoothing(surface_tension=sigma, **given)
    fluid = (rs.Box(cells=(4, 4, 4)),)
    plan = rs.make_plan(rs.Scene(
        spacing=0.1, support_radius=0.2, fluid=fluid, effects=(liquid, tension), energy_audit=rs.EnergyAudit(),
    ))
    return plan, plan.effects["velocity_smoothing"]

plan, tension = planned()
assert plan.shared["fluid"].internal_pressure > 0
assert "capillary" in tension.step_limits(plan.grid, plan.effects)
assert "cohesion" in tension.energy(plan.grid, plan.effects).parts
try:
    planned(1e6, balance_pressure=False)
except rs.InputError as refusal:
    assert "would collapse the liquid" in str(refusal)
    print("balanced")
"""

SIMULATED = """
from validation.simulator_threads import install
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


def of_a_tension(example, folder, changed):
    """The walk's files in another folder, some with other text."""
    for path in example.rglob("*.py"):
        target = folder / path.relative_to(example)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(changed.get(path.name, lambda text: text)(path.read_text()))
    return folder


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
    assert "kept 7 rules" in said
    assert "slowed down" in said


def test_the_example_runs_in_the_cuda_simulator(example):
    if importlib.util.find_spec("numba_cuda") is None:
        pytest.skip('numba-cuda is not installed; pip install "refsim[cuda]" brings it')
    assert "simulated" in run(example, SIMULATED, NUMBA_ENABLE_CUDASIM="1", NUMBA_DISABLE_JIT="1")


def along_the_pair(text):
    for walk, tension in ALONG_THE_PAIR:
        assert text.count(walk) == 1
        text = text.replace(walk, tension)
    return text


def test_a_tension_model_is_sent_through_the_door(example, tmp_path):
    """A plain force with a virial breaks a rule; from PairCohesion it has balance, capillary limit, energy, refusal."""
    ladder = str(ROOT / "tests" / "ladder")
    assert run(example, COMPLAINT, ladder).strip() == ""
    plain = of_a_tension(example, tmp_path / "plain", {"reference.py": along_the_pair})
    assert "derive its effect from refsim.surface_tension.cohesion.PairCohesion" in run(plain, COMPLAINT, ladder)
    files = {"reference.py": along_the_pair, "__init__.py": lambda text: COHESIVE}
    door = of_a_tension(example, tmp_path / "door", files)
    assert run(door, COMPLAINT + DOOR, ladder).split() == ["balanced"]
