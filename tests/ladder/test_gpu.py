"""A real GPU beside the CPU: neighbour lists, whole runs, every two effects, what a step launches and holds.

`pytest -m gpu -n 6` runs these and the operations of test_pairing.py by six processes; an illegal access ends CUDA for
the one that makes it, whose later tests then fail, too. In the CUDA simulator the scenes are tiny.
"""

import gc

import msgspec
import numpy as np
import pytest

import refsim as rs
from refsim import neighbours
from refsim.backends import arrays, runtime
from refsim.commands.plan import describe_plan
from refsim.study.cost import bytes_of
from tests import pairs
from validation import timed
from validation.experiments.melting.scene import scene_of
from validation.running import take_steps

TINY = runtime.simulated()
SUPPORT = 0.2  # m, twice the mean spacing of the searched cloud
COMPARED = {"float32": 5, "float64": 20}  # steps before two backends are compared: rounding grows with each
# Share of the largest value. On the CPU, float32 and float64 already differ by 2 % in the pressure of the dam break
# after five steps, because a liquid at rest has almost none. The pairing tests accuracy; this tests whole runs.
TOLERANCE = {"float32": 0.1, "float64": 1e-8}
# Fields that are rounding errors before any deformation, by the scale of their errors: a length, a rate.
OF_SPACING, OF_SHAKING = ("region_anchor", "region_center", "position_residual"), ("region_spin",)
FLAGS = {"float32": 2e-3, "float64": 0.0}  # share of flags that may differ
LIQUID = rs.WeaklyCompressible(sound_speed=3.0, dynamic_viscosity=0.05, density="summation")
BOTH = pytest.mark.parametrize("dtype", TOLERANCE)


@pytest.fixture(autouse=True)
def there():
    if reason := arrays.unavailable("cuda"):
        pytest.skip(reason)


def dam_break():
    """A 2D column with walls and surface detection."""
    cells = (4, 6, 1) if TINY else (40, 80, 1)
    spacing = 1.0 / cells[1]
    liquid = rs.WeaklyCompressible(sound_speed=45.0, dynamic_viscosity=0.5, state="tait", density="summation")
    walls = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(2.0, 2.0, 0.0))
    effects = (liquid, rs.Gravity(acceleration=(0.0, -9.81, 0.0)), walls, rs.SurfaceDetection())
    return rs.Scene(dim=2, spacing=spacing, support_radius=2 * spacing, fluid=(rs.Box(cells=cells),), effects=effects)


def drop_of(*effects, cube=False):
    """A ball, or a cube of 17^3 particles, of liquid under these effects."""
    spacing = 1e-3
    liquid = rs.Box(cells=((3 if TINY else 17),) * 3) if cube else rs.Ball(radius=(2 if TINY else 6) * spacing)
    return lambda: rs.Scene(spacing=spacing, support_radius=2 * spacing, fluid=(liquid,), effects=(LIQUID, *effects))


def pebble():
    """The packaged example from first contact on: before, pressures are rounding errors."""
    scene = rs.load_scene("refsim/examples/mesh_boundary.toml")
    column = msgspec.structs.replace(scene.fluid[0], lower=(-0.05, -0.05, 0.056), velocity=(0.0, 0.0, -1.0))
    return msgspec.structs.replace(scene, fluid=(column,))


SCENES = {
    "dam_break": dam_break,
    "droplet": drop_of(rs.JiangZhu2023(surface_tension=0.07, density_correction=True), cube=True),
    "akinci": drop_of(rs.Akinci2013(surface_tension=0.07)),
    "dong": drop_of(rs.Dong2016(surface_tension=0.07)),
    "implicit": drop_of(rs.ImplicitPressure(), rs.Akinci2013(surface_tension=0.07)),
    "pebble": pebble,
    "melting": lambda: scene_of("figure_4", 0.2 if TINY else 0.4),
    "energy": timed.systems(4 if TINY else 12)["MPM with surface tension"],
}


@pytest.mark.gpu
@pytest.mark.parametrize("dim", [2, 3])
@BOTH
def test_the_list_of_a_cloud_is_that_of_the_cpu_and_of_all_pairs(dim, dtype):
    """One particle is far from all others. Products are fused differently on a GPU, so that in float32 a pair on the
    very edge may fall on either side.
    """
    count = 60 if TINY else 20_000
    position = np.random.default_rng(dim).uniform(0, SUPPORT / 2 * count ** (1 / dim), (count, 3))
    position[:, dim:] = 0
    position[5] = [1e5, -1e5, 3e4 * (dim == 3)]
    position = position.astype(dtype)
    cuda = arrays.choose("cuda")
    searches = []
    for _ in range(2):
        search = neighbours.NeighbourSearch(cuda, dim, dtype, SUPPORT)
        on_device = cuda.asarray(position)
        order = search.order(on_device)
        on_device = search.reorder(on_device, order)
        listed = search.build(on_device)
        counts, entries = cuda.host(listed.count), cuda.host(listed.entries).reshape(-1, count)
        searches.append((cuda.host(order), [entries[:n, i] for i, n in enumerate(counts)]))
    order, lists = searches[0]
    assert np.array_equal(order, searches[1][0])
    assert all(np.array_equal(a, b) for a, b in zip(lists, searches[1][1]))
    search.audit(on_device, cuda.zeros(position.shape, dtype), cuda.zeros(2, dtype), listed)
    search.build(on_device)  # the audit's result is read here
    assert search.log.missed_neighbours == 0
    if not TINY:  # the CPU's search would run as Python there
        cpu = neighbours.NeighbourSearch(arrays.choose("cpu"), dim, dtype, SUPPORT)
        theirs = cpu.build(np.ascontiguousarray(position[cpu.order(position)]))
        rows = zip(lists, theirs.start, theirs.count)
        assert np.array_equal(order, cpu.order(position))
        other = sum(not np.array_equal(own, theirs.entries[s : s + n]) for own, s, n in rows)
        assert other <= (10 if dtype == "float32" else 0)


@pytest.mark.gpu
@pytest.mark.parametrize("name", SCENES)
@BOTH
def test_a_run_is_that_of_the_cpu_and_the_same_again(name, dtype):
    compared = 2 if TINY else COMPARED[dtype]
    scene = msgspec.structs.replace(SCENES[name](), dtype=dtype)
    oracle, *runs = (rs.Simulation(scene, each) for each in ("numpy" if TINY else "cpu", "cuda", "cuda"))
    for simulation in (oracle, *runs):
        take_steps(simulation, compared)
        simulation.evaluate()
    spacing, shaking = scene.spacing, float(np.abs(oracle.field("velocity")).max()) / scene.spacing
    for field, kind in oracle.plan.fields.items():
        if field in pairs.OF_ORDER:
            continue
        true, values = oracle.field(field), runs[0].field(field)
        if kind.numpy_dtype(dtype).kind in "iub":
            assert (true != values).mean() <= FLAGS[dtype], field
        else:
            least = spacing if field in OF_SPACING else shaking if field in OF_SHAKING else 1e-30
            assert np.abs(true - values).max() <= TOLERANCE[dtype] * max(np.abs(true).max(), least), field
    for simulation in runs:
        take_steps(simulation, 1 if TINY else 1000 - compared)
    assert [f for f in oracle.plan.fields if not np.array_equal(runs[0].field(f), runs[1].field(f))] == []
    assert np.isfinite(runs[0].field("velocity")).all()
    assert runs[0].search is None or runs[0].search.log.missed_neighbours == 0


@pytest.mark.gpu
@pytest.mark.parametrize("pair", list(pairs.pairs()), ids=" ".join)
def test_two_effects_are_those_of_the_references(pair):
    assert [part for part in pairs.compare(*pair, "cuda") if part.error > part.allowed] == []


@pytest.mark.gpu
@pytest.mark.parametrize("ladder", timed.ladders())
def test_a_step_launches_and_holds_what_the_plan_says(ladder):
    for rung in timed.ladders(TINY)[ladder].rungs:
        simulation = rs.Simulation(rung.scene, "cuda")
        simulation.step()
        assert timed.differences(simulation, timed.launched(simulation)) == [], rung.words
        liquid = simulation.parameters.get("mpm_liquid")
        if liquid is not None and "surface_energy" not in simulation.plan.effects:
            assert liquid["grid"].bytes() == bytes_of(simulation.plan, "cuda")["background_grid"], rung.words


@pytest.mark.gpu
@pytest.mark.parametrize("effects", timed.CUBES)
def test_a_large_cube_holds_the_memory_that_its_plan_says(effects):
    plan = rs.make_plan(timed.spinning_cube(4 if TINY else 100, effects))
    before = 0 if TINY else cupy_bytes()
    simulation = rs.Simulation(plan, "cuda")
    simulation.step()  # the list then holds the lattice that the plan counts
    if not TINY:
        held, said = cupy_bytes() - before, describe_plan(simulation.plan, "cuda")["bytes"]["total"]
        assert held == pytest.approx(said, rel=0.1)


def cupy_bytes():
    """Bytes of the device's arrays that are alive."""
    import cupy

    gc.collect()
    return cupy.get_default_memory_pool().used_bytes()
