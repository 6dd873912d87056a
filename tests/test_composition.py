"""A scene pays for what it uses: of an effect that is not there no field, no launch, no byte, no bit of difference."""

import os
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

import refsim
from refsim import (
    Box,
    BoxWalls,
    Gravity,
    InputError,
    JiangZhu2023,
    Scene,
    Simulation,
    SurfaceDetection,
    WeaklyCompressible,
    make_plan,
)
from refsim.effect import EFFECTS
from refsim.particles import BASE

LIQUID = WeaklyCompressible(sound_speed=12.0, clamp_pressure=False)  # its surface pulls it together: it moves
VISCOUS = WeaklyCompressible(sound_speed=12.0, clamp_pressure=False, dynamic_viscosity=0.3)
GRAVITY = Gravity()
WALLS = BoxWalls(lower=(0, 0, 0), upper=(0.6, 0.6, 0.6))
DETECTION = SurfaceDetection()
DETECTION_EACH_STEP = SurfaceDetection(each_step=True)
TENSION = JiangZhu2023(surface_tension=0.5, pair_mode="soft", density_correction=False)
SETS = [
    (LIQUID,),
    (VISCOUS,),
    (LIQUID, GRAVITY),
    (LIQUID, GRAVITY, WALLS),
    (LIQUID, DETECTION),
    (LIQUID, DETECTION_EACH_STEP),
    (LIQUID, TENSION),
    (VISCOUS, GRAVITY, WALLS, DETECTION, TENSION),
]


def scene(*effects, **options):
    return Scene(spacing=0.1, support_radius=0.21, fluid=(Box(cells=(4, 4, 4)),), effects=effects, step=5e-4, **options)


def names(effects):
    return "+".join(effect.name + ("_each_step" if getattr(effect, "each_step", False) else "") for effect in effects)


@pytest.mark.parametrize("effects", SETS, ids=names)
class TestPlan:
    def test_fields_are_those_that_were_asked_for(self, effects):
        plan = make_plan(scene(*effects))
        asked = {f.name for f in BASE}
        for effect in plan.effects.values():
            asked |= {f.name for f in effect.fields(plan.effects)}
        assert set(plan.fields) == asked

    def test_every_field_is_used(self, effects):
        plan = make_plan(scene(*effects))
        touched = {f.name for f in BASE}
        for _, p in plan.passes:
            touched |= {*p.reads, *p.writes, *p.updates}
        assert set(plan.fields) <= touched

    def test_fields_are_written_before_they_are_read(self, effects):
        plan = make_plan(scene(*effects))
        written = {f.name for f in BASE}
        for _, p in plan.passes:
            assert set(p.reads) <= written, p.operation
            written |= {*p.writes, *p.updates}

    def test_nothing_is_launched_twice(self, effects):
        launches = make_plan(scene(*effects)).launches(on_demand=True)
        assert len(set(launches)) == len(launches)

    def test_passes_belong_to_effects_of_the_scene(self, effects):
        plan = make_plan(scene(*effects))
        assert {effect.name for effect, _ in plan.passes} <= {effect.name for effect in effects}

    def test_a_run_holds_and_launches_what_the_plan_says(self, effects):
        simulation = Simulation(scene(*effects))
        plan = simulation.plan
        simulation.step()
        assert set(simulation.fields) == set(plan.fields)
        held = sum(array.nbytes for array in simulation.fields.values())
        assert held == simulation.count * sum(plan.field_bytes().values())
        assert set(simulation.timings.first_calls) == {*plan.launches(), "neighbours", "sph.kick_drift"}
        simulation.evaluate()
        assert set(simulation.timings.first_calls) == {*plan.launches(True), "neighbours", "sph.kick_drift"}

    def test_limits_of_the_step_are_those_of_the_effects(self, effects):
        found = Simulation(scene(*effects)).step().limits
        assert ("capillary" in found) == (TENSION in effects)
        assert ("viscous" in found) == (VISCOUS in effects)
        assert "acoustic" in found
        assert all(value > 0 for value in found.values())


FOOTPRINTS = {
    DETECTION: {"near_surface", "surface", "surface_normal", "number_density"},
    TENSION: {"surface_normal", "surface_weight", "corrected_normal", "number_density"},
    GRAVITY: set(),
    WALLS: set(),
}


@pytest.mark.parametrize("effect", FOOTPRINTS, ids=lambda effect: effect.name)
def test_an_effect_brings_its_own_and_nothing_else(effect):
    without, with_it = make_plan(scene(LIQUID)), make_plan(scene(LIQUID, effect))
    assert set(with_it.fields) - set(without.fields) == FOOTPRINTS[effect]
    assert set(without.launches(True)) <= set(with_it.launches(True))
    own = {p.operation for e, p in with_it.passes if e.name == effect.name}
    assert set(with_it.launches(True)) - set(without.launches(True)) == own
    assert without.walls is None
    assert with_it.walls is None or effect is WALLS


def test_shared_passes_run_once():
    """Detection and tension both want the colour-gradient normal: one field, one launch, in every step."""
    plan = make_plan(scene(LIQUID, DETECTION, TENSION))
    assert plan.launches().count("surface_normal.color_gradient") == 1
    assert make_plan(scene(LIQUID, DETECTION)).launches() == make_plan(scene(LIQUID)).launches()


def test_every_effect_is_looked_at_here():
    assert {type(effect) for effects in SETS for effect in effects} == set(EFFECTS.values())


def state(simulation):
    return {name: simulation.field(name).tobytes() for name in ("position", "velocity", "mass")}


def advanced(*effects, steps=15):
    simulation = Simulation(scene(*effects))
    for _ in range(steps):
        simulation.step()
    return simulation


@pytest.mark.parametrize(
    "with_it, without",
    [
        ((LIQUID, DETECTION), (LIQUID,)),
        ((LIQUID, DETECTION_EACH_STEP), (LIQUID,)),
        ((LIQUID, JiangZhu2023(surface_tension=0.0)), (LIQUID,)),
        ((DETECTION, LIQUID), (LIQUID, DETECTION)),
    ],
    ids=["looks on demand", "looks in each step", "zero tension", "order of the list"],
)
def test_effects_that_exert_nothing_leave_every_bit(with_it, without):
    assert state(advanced(*with_it)) == state(advanced(*without))


def test_effects_that_act_are_seen():
    """So that the comparison of bits above can fail."""
    plain = state(advanced(LIQUID))
    assert plain != state(advanced(LIQUID, steps=14))
    for effect in (GRAVITY, TENSION, BoxWalls(lower=(0, 0, 0), upper=(0.4, 0.4, 0.4))):
        assert state(advanced(LIQUID, effect)) != plain


PROGRAM = """
import hashlib, sys
from refsim import Box, Gravity, Scene, Simulation, WeaklyCompressible
simulation = Simulation(Scene(spacing=0.1, support_radius=0.21, dim=2, fluid=(Box(cells=(4, 5, 1)),), step=1e-3,
    effects=(WeaklyCompressible(sound_speed=12.0, dynamic_viscosity=0.2), Gravity(acceleration=(0.0, -9.81, 0.0)))))
for _ in range(4):
    simulation.step()
print([hashlib.sha256(simulation.field(name).tobytes()).hexdigest() for name in ("position", "velocity")])
print(sorted(m for m in sys.modules if m.startswith("refsim.surface")))
"""


def printed(folder):
    environment = dict(os.environ, PYTHONPATH=str(folder), NUMBA_DISABLE_JIT="1")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, env=environment, cwd=folder, check=True
    )
    return done.stdout.splitlines()


def test_where_an_effect_does_not_exist_the_bits_are_the_same(tmp_path):
    """A copy of the package from which the surface folders were torn out, kernels run as Python in both."""
    source = pathlib.Path(refsim.__file__).parent
    shutil.copytree(source, tmp_path / "refsim", ignore=shutil.ignore_patterns("__pycache__", "surface_*"))
    contents = tmp_path / "refsim" / "__init__.py"
    text = contents.read_text()
    torn = re.sub(r".*(?:surface_|SurfaceDetection|JiangZhu).*\n", "", text)
    assert torn != text
    contents.write_text(torn)
    bits, modules = printed(tmp_path)
    whole_bits, whole_modules = printed(source.parent)
    assert modules == "[]" != whole_modules
    assert bits == whole_bits


def test_forces_add_up():
    """The acceleration of all effects together is the sum of what each adds to the liquid's own."""
    small = Gravity(acceleration=(0.3, 0.0, -1.0))

    def pull(*effects):
        simulation = Simulation(scene(LIQUID, *effects, dtype="float64"), "numpy")
        simulation.evaluate()
        return simulation.field("acceleration")

    own = pull()
    parts = [pull(effect) - own for effect in (small, TENSION)]
    together = pull(small, TENSION) - own
    assert min(np.abs(part).max() for part in parts) > 1e-4
    assert np.abs(together - sum(parts)).max() < 1e-12 * np.abs(own).max()


def test_what_an_effect_needs_must_be_there():
    for effect in (WALLS, DETECTION, TENSION):
        with pytest.raises(InputError, match=f"'{effect.name}' needs effect 'weakly_compressible'"):
            make_plan(scene(effect))


def test_without_neighbours_there_is_no_search():
    simulation = Simulation(scene(GRAVITY))
    simulation.step()
    assert simulation.plan.list_radius == 0
    assert simulation.search is None
    assert set(simulation.fields) == {f.name for f in BASE}
