"""A scene costs what its effects cost: an absent effect has no field, no launch, no byte, and changes no bit."""

import json
import pickle
import tracemalloc

import msgspec
import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.commands.plan import describe_plan
from refsim.core import cases
from refsim.core.effect import BASE, POSITION_RESIDUAL
from refsim.core.operation import REGISTRY
from refsim.mpm.grid import grid_bytes
from refsim.study.cost import bytes_of
from tests import pairs, running
from tests.running import python, rows
from validation import timed

LIQUID = rs.WeaklyCompressible(sound_speed=12.0, clamp_pressure=False, density="summation")  # pulled together: it moves
VISCOUS = msgspec.structs.replace(LIQUID, dynamic_viscosity=0.3)
CLAMPED = msgspec.structs.replace(LIQUID, clamp_pressure=True)
ADVANCED = rs.WeaklyCompressible(sound_speed=12.0, density="continuity")
GRAVITY, IMPLICIT = rs.Gravity(), rs.ImplicitPressure()
SHAPE, COUPLING, MELTING = rs.ShapeMatching(), rs.TwoWayCoupling(), rs.Melting()
WALLS = rs.BoxWalls(lower=(0, 0, 0), upper=(0.6, 0.6, 0.6))
HOLDING = rs.BoxWalls(lower=(0, 0, 0), upper=(0.6, 0.6, 0.6), model="extrapolated")
DETECTION, DETECTION_EACH_STEP = rs.SurfaceDetection(), rs.SurfaceDetection(each_step=True)
TENSION = rs.JiangZhu2023(surface_tension=0.5, pair_mode="soft", density_correction=False)
WARM = rs.HeatConduction(temperature=50.0, melting_point=0.0)
MESH = pairs.EFFECTS["mesh_boundary"]
MPM, MPM_FULL = rs.MpmLiquid(bulk_modulus=144e3), rs.MpmLiquid(bulk_modulus=144e3, volume="full_gradient")
SOLID = rs.SolidBox(lower=(0.1, 0.1, 0.4), upper=(0.4, 0.4, 0.6))


def scene(*effects, **options):
    """A box of liquid, and a solid above it where an effect holds one."""
    solid = (SOLID,) if any(isinstance(effect, rs.ShapeMatching) for effect in effects) else ()
    return rs.Scene(
        spacing=0.1, support_radius=0.21, fluid=(rs.Box(cells=(4, 4, 4)),), solid=solid, effects=effects, step=5e-4,
        **options,
    )  # fmt: skip


SCENES = {name: pairs.scene(name, name, "float32") for name in pairs.EFFECTS} | {  # and with options
    "whole volume": scene(MPM_FULL),
    "nothing embedded": scene(
        rs.SurfaceEnergy(surface_tension=0.5, embedding="none", iterations=2), MPM,
        rs.MpmWalls(lower=(-5.0, -0.2, 0.0), upper=(5.0, 5.0, 0.0)),
    ).with_(dim=2, fluid=(rs.Box(cells=(6, 6, 1)),)),  # whose surface in space takes Python seconds
    "shifting": scene(ADVANCED, GRAVITY, HOLDING, rs.ParticleShifting()),
    "advanced tension": scene(ADVANCED, TENSION),
    "advanced heat": scene(ADVANCED, WARM),
    "advanced coupling": scene(ADVANCED, GRAVITY, HOLDING, SHAPE, COUPLING),
    "central viscosity": scene(msgspec.structs.replace(VISCOUS, viscosity="central"), IMPLICIT),
    "each step": scene(LIQUID, DETECTION_EACH_STEP),
    "release": scene(LIQUID, rs.SurfaceDetection(release_pressure=True)),
    "mesh alone": scene(VISCOUS, GRAVITY, WALLS, msgspec.structs.replace(MESH, viscosity=0.0, adhesion=0.0)),
    "ice": scene(LIQUID, msgspec.structs.replace(WARM, latent_heat=3e5, held=(0,), scheme="explicit")),
    "stiff": scene(rs.ShapeMatching(damping=0.0, half_width=1), GRAVITY),
    "tension and detection": scene(VISCOUS, GRAVITY, WALLS, DETECTION, TENSION),
    "surface of coupled liquid": scene(CLAMPED, SHAPE, COUPLING, DETECTION_EACH_STEP),
    "melting in walls": scene(CLAMPED, GRAVITY, WALLS, SHAPE, COUPLING, WARM, MELTING),
}  # fmt: skip
CAPILLARY = set(rows(__file__, "capillary"))
by_scene = pytest.mark.parametrize("name", SCENES)


@by_scene
def test_a_plan_uses_each_field_and_launches_each_pass_once(name):
    """And writes before it reads; passes belong to effects of the scene."""
    plan = make_plan(SCENES[name])
    base = {f.name for f in (*BASE, POSITION_RESIDUAL)}
    touched = base | set(REGISTRY["sph.extremes"].arguments("cpu"))  # the runner's own look at the state
    written = {f.name for f in BASE} | {"place"} | {name for name, f in plan.fields.items() if f.state}
    for _, p in plan.all_passes():
        assert set(p.reads) <= written, p.operation
        written |= {*p.writes, *p.updates}
        touched |= {*p.reads, *p.writes, *p.updates}
    assert base <= set(plan.fields) <= touched
    launches = plan.launches(on_demand=True)
    assert len(set(launches)) == len(launches)
    brought = [effect for effect, _ in (*plan.passes, *plan.motion) if effect is not None]
    assert {effect.name for effect in brought} <= set(plan.effects)


def held_by_grid(simulation):
    """{what: (bytes held, bytes by the plan or by the numbers of nodes and points)} of MPM; {} without it."""
    plan, backend, real = simulation.plan, simulation.backend.name, simulation.plan.grid
    if "mpm_liquid" not in plan.effects:
        return {}
    grid, expected = simulation.parameters["mpm_liquid"]["grid"], bytes_of(plan, backend)["background_grid"]
    if "surface" in simulation.shared:
        sets = [len(cell) for name, cell in grid.cells.items() if name != "particles"]
        tension = plan.effects["mpm_liquid"].step(plan.effects).tension
        expected = grid_bytes(grid.nodes // 64, real.count, real.dim, real.dtype, backend, tension, sets)
    return {"background grid": (grid.bytes(), expected)}


def differences(name):
    """Where a run launches, holds or is limited by something else than its plan says."""
    simulation = rs.Simulation(SCENES[name])
    plan, limits = simulation.plan, simulation.step().limits
    effects = plan.effects.values()
    sound = any(isinstance(effect, (rs.WeaklyCompressible, rs.MpmLiquid)) for effect in effects)
    compared = {
        "fields": (set(simulation.fields), set(plan.fields)),
        "capillary limit": ("capillary" in limits, bool(CAPILLARY & set(plan.effects))),
        "viscous limit": ("viscous" in limits, any(getattr(effect, "dynamic_viscosity", 0) > 0 for effect in effects)),
        "acoustic limit": ("acoustic" in limits, sound and "iisph" not in plan.effects),
        "limits that are not positive": ([name for name, value in limits.items() if not value > 0], []),
    } | held_by_grid(simulation)  # fmt: skip
    faults = [f"{what}: {a}, not {b}" for what, (a, b) in compared.items() if a != b]
    return [f"{name}: {fault}" for fault in (*faults, *timed.differences(simulation, timed.launched(simulation)))]


def test_runs_hold_and_launch_what_the_plan_says():
    """Kernels run as Python in a process of its own: to compile each combination of optional terms takes minutes.

    Compiled kernels have placed the boundary particles of the mesh, which is the same in all scenes.
    """
    program = (
        "import json, pickle, sys, refsim; from tests.across import test_composition as t;"
        "placed = pickle.load(sys.stdin.buffer); refsim.MeshBoundary.placed = lambda effect, grid: placed;"
        "print(json.dumps([len(t.SCENES), [line for name in t.SCENES for line in t.differences(name)]]))"
    )
    placed = pickle.dumps(MESH.placed(make_plan(scene(LIQUID)).grid))
    done = python("-W", "ignore", "-c", program, given=placed, NUMBA_DISABLE_JIT="1")
    assert json.loads(done.stdout.splitlines()[-1]) == [len(SCENES), []]


@by_scene
def test_a_field_read_alone_is_that_of_all_passes(name):
    """The passes that it needs are all that it needs: what others compute is spoilt before."""
    simulation = rs.Simulation(SCENES[name], "numpy")
    simulation.step()
    simulation.evaluate()
    expected = {name: simulation.field(name) for name in simulation.plan.fields}
    derived = {name for _, p in simulation.force_passes for name in p.written if name in simulation.plan.fields}
    for name in simulation.plan.fields:
        for other in (n for n in derived if not simulation.plan.fields[n].state):
            values = simulation.fields[other]
            values[...] = np.nan if values.dtype.kind == "f" else 1
        simulation.outdate()
        assert simulation.field(name).tobytes() == expected[name].tobytes(), name


@pytest.mark.parametrize("name", pairs.EFFECTS)
def test_an_effect_brings_its_own_and_nothing_else(name):
    whole = pairs.scene(name, name)
    rest = tuple(effect for effect in whole.effects if effect.name != name)
    solid = () if name == "shape_matching" else whole.solid
    without, with_it = make_plan(msgspec.structs.replace(whole, effects=rest, solid=solid)), make_plan(whole)
    assert set(with_it.fields) - set(without.fields) == set(cases.EXAMPLES[name].brings.split())
    assert set(without.launches(True)) - set(with_it.launches(True)) <= set(pairs.EFFECTS[name].replaces())
    passes = (*with_it.begin, *with_it.passes, *with_it.motion)
    new = set(with_it.launches(True)) - set(without.launches(True))
    brought = {e.name for e, p in passes if e is not None and p.operation in new}
    assert brought <= {name, *pairs.EFFECTS[name].needs()}
    assert without.walls is None
    assert with_it.walls is None or name in ("box_walls", "mesh_boundary")


def test_a_run_takes_the_memory_that_its_plan_says():
    """Bytes of `refsim plan` against what the process allocates and holds; while a list is built it takes more."""
    effects = (msgspec.structs.replace(LIQUID, dynamic_viscosity=0.1, clamp_pressure=True), GRAVITY)
    box = (rs.Box(cells=(100, 100, 1)),)
    plan = make_plan(rs.Scene(dim=2, spacing=0.05, support_radius=0.13, fluid=box, effects=effects))
    rs.Simulation(plan).step()  # so that compiling is no part of it
    said = describe_plan(plan, "cpu")["bytes"]["total"]
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        simulation = rs.Simulation(plan)
        running.advanced(simulation, 3)
        held, peak = (b - before for b in tracemalloc.get_traced_memory())
    finally:
        tracemalloc.stop()
    assert 0.97 * said < held < 1.08 * said
    assert peak < 1.4 * said
