"""The CUDA backend in Numba's CUDA simulator: kernels, search and whole runs, with tens of particles.

Run it as `NUMBA_ENABLE_CUDASIM=1 NUMBA_DISABLE_JIT=1 pytest tests/ladder/test_cuda_simulator.py`; without the simulator
everything here is skipped, because compiled kernels would need a GPU (`pytest -m gpu`).
"""

import math

import numpy as np
import pytest

import refsim as rs
from refsim import contract, neighbours, sparse_grid
from refsim.backends import arrays as backend
from refsim.backends import runtime
from refsim.commands.show import printed
from refsim.core.operation import REGISTRY, backend_of
from refsim.neighbours.reference import neighbour_list
from refsim.study.cost import bytes_of
from tests import pairs
from tests.across import test_composition as composition
from tests.running import advanced
from validation import timed

pytestmark = pytest.mark.skipif(
    not runtime.simulated(), reason="runs in the CUDA simulator only: set NUMBA_ENABLE_CUDASIM=1 NUMBA_DISABLE_JIT=1"
)
RADIUS = 0.2
SKIN = 0.25


@pytest.fixture(scope="module")
def cuda():
    return backend.choose("cuda")


def cloud(count, dim, seed=1, spacing=0.1):
    position = np.random.default_rng(seed).uniform(0, spacing * count ** (1 / dim), (count, 3))
    position[:, dim:] = 0
    return position


def built(cuda, position, dim):
    """(search, positions in cell order on the host, its list)."""
    search, there = neighbours.NeighbourSearch(cuda, dim, "float64", RADIUS, SKIN), cuda.asarray(position)
    there = search.reorder(there, search.order(there))
    return search, cuda.host(there), search.build(there)


def columns(cuda, listed):
    """Neighbours of each particle, in the list's own order."""
    count, entries = cuda.host(listed.count), cuda.host(listed.entries)
    return [entries[i :: len(count)][: count[i]] for i in range(len(count))]


def assert_alike(run, oracle, *names):
    """Fields differ by at most 1e-12 of their largest value."""
    for name in names:
        expected = oracle.field(name)
        assert np.abs(run.field(name) - expected).max() <= 1e-12 * np.abs(expected).max(), name


def both(scene, steps=0):
    """(run of the references, run in the simulator) after some steps."""
    return [advanced(rs.Simulation(scene, name), steps) for name in ("numpy", "cuda")]


def assert_all_pairs(cuda, position, listed):
    expected = neighbour_list(position, RADIUS * (1 + SKIN))
    for own, true in zip(columns(cuda, listed), expected, strict=True):
        assert list(own) == list(true)  # in the order of the particles, so that sums repeat


HARD = {
    "cloud_2d": (cloud(60, 2), 2), "cloud_3d": (cloud(60, 3), 3),
    "lattice on cell borders": (
        RADIUS * (1 + SKIN) * np.stack(np.meshgrid(*[np.arange(4) - 2.0] * 3), axis=-1).reshape(-1, 3), 3,
    ),
    "flung particle": (np.vstack([cloud(30, 3), [[1e5, -1e5, 3e4]]]), 3),
    "beyond the cells": (np.vstack([cloud(20, 3), [[1e15, 0, 0], [1e15, 0.1, 0], [-1e30, 0, 1e30]]]), 3),
    "coincident": (np.vstack([cloud(20, 2), cloud(20, 2)[:3], cloud(20, 2)[:1]]), 2), "one": (np.zeros((1, 3)), 3),
    "none": (np.zeros((0, 3)), 2),
}  # fmt: skip


@pytest.mark.parametrize("name", HARD)
def test_list_equals_all_pairs(cuda, name):
    position, dim = HARD[name]
    search, ordered, listed = built(cuda, position, dim)
    assert sorted(map(tuple, ordered)) == sorted(map(tuple, position))
    assert_all_pairs(cuda, ordered, listed)
    assert search.log.most_neighbours == max((len(own) for own in columns(cuda, listed)), default=0)


@pytest.mark.parametrize("name", HARD)
def test_particles_are_sorted_stably_by_cell(cuda, name):
    """By counting; where the box of cells is too large for that, or a cell too full, by a sort of the keys."""
    position, dim = HARD[name]
    search = neighbours.NeighbourSearch(cuda, dim, "float64", RADIUS, SKIN)
    expected = cuda.host(search.order(cuda.asarray(position)))
    there, number = cuda.asarray(position), cuda.asarray(np.arange(len(position), dtype=np.int32))
    other, before = cuda.asarray(2 * position), cuda.asarray(np.zeros_like(position))
    moved = search.sort(there, [there, number, other], before)
    assert list(cuda.host(moved[1])) == list(expected)
    assert (cuda.host(moved[0]) == position[expected]).all()
    assert (cuda.host(moved[2]) == 2 * position[expected]).all()
    assert (cuda.host(before) == position[expected]).all()
    sorter = search.programs.sorter
    flung = name in ("flung particle", "beyond the cells")
    assert not len(position) or bool(sorter.mirror.read()[6]) == flung


@pytest.mark.parametrize("most", [3, 1024])
def test_running_sums_of_tiles_of_one_turn_and_of_more(cuda, monkeypatch, most):
    from refsim.backends import device

    monkeypatch.setattr(device, "MOST_TILES", most)
    for count in (1, 63, 65, 1000):
        values, out = np.random.default_rng(count).integers(0, 9, count, dtype=np.int32), cuda.zeros(count, "int32")
        device.RunningSum(cuda.asarray(values), out)()
        assert (cuda.host(out) == np.cumsum(values)).all()


def test_particle_at_no_place_has_no_neighbours_and_hides_none(cuda):
    position = cloud(30, 3)
    position[11, 1] = np.nan
    _, ordered, listed = built(cuda, position, 3)
    lost = int(np.flatnonzero(np.isnan(ordered[:, 1]))[0])
    assert not len(columns(cuda, listed)[lost])
    assert_all_pairs(cuda, ordered, listed)


def test_capacity_grows_until_everything_fits(cuda):
    search, ordered, listed = built(cuda, cloud(40, 3, spacing=0.15), 3)
    capacity = listed.entries.shape[0] // 40
    for squeeze in (0.7, 0.2):
        position = squeeze * ordered
        listed = search.build(search.reorder(cuda.asarray(position), search.order(cuda.asarray(position))))
        order = cuda.host(search.order(cuda.asarray(position)))
        assert_all_pairs(cuda, position[order], listed)
    assert listed.entries.shape[0] // 40 >= search.log.most_neighbours == 39 > capacity


def test_collapsed_clump_stops_the_run_before_memory_does(cuda, monkeypatch):
    from refsim.neighbours import cell_order_cuda, columns_cuda

    for module in (neighbours, cell_order_cuda, columns_cuda):
        monkeypatch.setattr(module, "MOST_NEIGHBOURS", 8)
    with pytest.raises(rs.RunStopped, match="collapsed into a clump"):
        built(cuda, 0.1 * cloud(20, 3), 3)


def test_list_larger_than_the_device_stops_the_run(cuda, monkeypatch):
    from refsim.backends import device

    monkeypatch.setattr(device, "free_bytes", lambda: 100)
    with pytest.raises(rs.RunStopped, match="neighbour list needs") as stopped:
        built(cuda, cloud(20, 3), 3)
    assert stopped.value.reason == "out_of_memory"


@pytest.mark.parametrize("dim", [2, 3])
def test_sparse_grid_is_the_cpus(cuda, dim):
    position = np.vstack([cloud(40, dim), [[1e5, -1e5, 0.0]], [[np.nan, 0.1, 0.0]]])
    for where in (position, position[:0]):
        host, there = (sparse_grid.SparseGrid(b, dim, "float64", 0.2) for b in (backend.choose("cpu"), cuda))
        blocks, covered = host.cover(where, 3, 4), there.cover(cuda.asarray(where), 3, 4)
        lists = [host.by_cell(where, blocks, s) for s in (0, 0.5)]
        listed = [there.by_cell(cuda.asarray(where), covered, s) for s in (0, 0.5)]
        for own, other in zip((blocks, *lists), (covered, *listed), strict=True):
            for a, b in zip(own, other, strict=True):
                assert np.array_equal(a, cuda.host(b)[: len(a)])
                assert a.dtype == b.dtype


def test_particles_of_mpm_are_sorted_without_the_host(cuda):
    """The bins are those that CuPy's sort makes; blocks are made anew only where a particle nears their edge."""
    from refsim.mpm import sorting_cuda as programs
    from refsim.mpm.grid import MpmGrid

    place = 0.2 * cloud(60, 2)
    grid, cell = MpmGrid(2, "float64", 0.2, cuda), cuda.zeros(len(place), np.int32)
    changes = []
    for step in range(25):  # half a cell each
        position = cuda.asarray(place + [0.1 * step, 0.0, 0.0])
        changes.append(grid.attend(position))
        if step % 8 == 7:  # the last for which the blocks were looked at
            seen = position
            programs.cells(seen, None, None, grid, cell)
            expected = programs.sorted_bins(cell, grid.nodes // 64)
            for own, other in zip(grid.bins["particles"], expected, strict=True):
                assert np.array_equal(cuda.host(own), cuda.host(other))
            assert cuda.host(cell).min() >= 0
    assert changes[0]
    assert 1 <= sum(changes[1:]) <= 2
    assert np.array_equal(cuda.host(grid.order(seen)), cuda.host(expected[1]))
    assert grid.attend(position, moved=True)  # positions may have been set anywhere
    lost = cuda.asarray(np.full_like(place, np.nan))
    for _ in range(7):
        grid.attend(lost)
    programs.cells(lost, None, None, grid, cell)
    with pytest.raises(rs.RunStopped) as stopped:
        grid.attend(lost)
    assert stopped.value.reason == "out_of_grid"


def test_poisson_disk_samples_are_refused_on_a_gpu(cuda):
    from refsim.surface_energy import Tension
    from refsim.surface_energy.effect import reconstruction_on

    with pytest.raises(rs.InputError, match="runs on backends cpu and numpy only; take quadrature = 'facets'"):
        reconstruction_on(cuda, 2, "float64", 0.1, Tension(surface_tension=1.0, quadrature="poisson"))


@pytest.mark.parametrize("dim", [2, 3])
def test_blocks_with_a_margin_suffice_a_block_farther(cuda, dim):
    from refsim.sparse_grid import SparseGrid

    grid = SparseGrid(cuda, dim, "float64", 0.1)
    position = np.array([[0.05, 0.05, 0.0]])
    blocks, sure = grid.programs.with_margin(cuda.asarray(position), 1, 2, grid.programs.width)
    way = np.array([0.1 * grid.programs.width, 0.0, 0.0])
    for steps, suffice in ((0, True), (1, True), (-1, True), (2, False)):
        block = cuda.host(grid.programs.cell_of(cuda.asarray(position + steps * way), blocks, 0.0))[0] // 64
        assert (block >= 0 and bool(cuda.host(sure)[block])) == suffice
        assert np.isin(cuda.host(grid.cover(cuda.asarray(position + steps * way), 1, 2).keys),
                       cuda.host(blocks.keys)).all() == suffice  # fmt: skip


def test_audit_counts_what_a_list_misses(cuda):
    search, ordered, listed = built(cuda, cloud(40, 3), 3)
    velocity = np.random.default_rng(3).normal(size=ordered.shape)
    drift = cuda.asarray(np.array([0.0, 0.01]))
    moved = cuda.asarray(ordered + 0.01 * velocity)
    search.audit(moved, cuda.asarray(velocity), drift, listed)
    assert search.log.audited_rows == 8
    search.build(search.programs.lists["own"].position)
    assert search.log.missed_neighbours == 0
    rows = neighbours.AuditedRows(1, 40)
    wide = 1.5 * search.reach
    expected = sum(map(len, neighbour_list(ordered, wide))) - sum(map(len, columns(cuda, listed)))
    assert expected > 0
    search.programs.audit(moved, cuda.asarray(velocity), drift, listed, rows, wide)
    search.build(search.programs.lists["own"].position)
    assert search.log.missed_neighbours == expected


@pytest.mark.parametrize("walls", [False, True])
@pytest.mark.parametrize("dim", [2, 3])
def test_ways_are_compared_in_cells_up_to_two_apart(cuda, dim, walls):
    position = cloud(60, dim, seed=7)
    search, ordered, _ = built(cuda, position, dim)
    way = 0.1 * np.random.default_rng(8).normal(size=ordered.shape)
    way[:, dim:] = 0
    there = cuda.asarray(ordered)
    search.build(there)
    cell = np.floor(ordered / search.reach).astype(int)
    at_wall = np.zeros(60, bool)
    if walls:
        wall = np.array([[ordered[:, 0].max() + 2.0 * search.reach, *ordered[0, 1:]], ordered[0] + 40.0])
        wall[:, dim:] = 0
        search.build_against(there, search.static_set(wall))
        at_wall = np.abs(np.floor(wall[0] / search.reach).astype(int) - cell).max(1) <= 2
        assert 0 < sum(at_wall) < 60

    def bounds(moved):
        low, high = ([end(moved[(cell == c).all(1)], axis=0) for c in cell] for end in (np.min, np.max))
        near = [np.linalg.norm(np.maximum(high[a], -low[a])) for a in np.flatnonzero(at_wall)]
        for a in range(60):
            for b in range(60):
                apart = np.abs(cell[a] - cell[b])
                if apart.max() <= 2:
                    gap = max(math.sqrt((np.maximum(apart - 1, 0) ** 2).sum()), 1.0) - 1.0
                    far = np.linalg.norm(np.maximum(high[a] - low[b], high[b] - low[a]))
                    near.append(far - gap * search.reach)
        return max(near), math.sqrt(((moved.max(0) - moved.min(0)) ** 2).sum())

    velocity = np.random.default_rng(9).normal(size=ordered.shape)
    velocity[:, dim:] = 0
    moved, steps = cuda.asarray(ordered + way), cuda.asarray(np.array([9.0, 0.01]))
    particles = neighbours.Particles(moved, there, cuda.asarray(velocity), steps)
    for wanted in (False, True, False):
        search.look_ahead(particles, wanted)
        found = search.programs.relative_displacements(*particles)
        assert np.array(found) == pytest.approx(
            np.array([bounds(way), bounds(way + search.ahead(0.01) * velocity)]), rel=1e-12
        )


@pytest.mark.parametrize(("name", "program", "variant"), [
    (name, program, k)
    for name, operation in REGISTRY.items()
    for program in operation.names()
    if backend_of(program) == "cuda"
    for k in range(len(operation.as_computed_by(program).variants))
])  # fmt: skip
def test_operation_agrees_with_its_reference(name, program, variant):
    """One hard input of the contract; all of them run on a GPU (`pytest -m gpu`)."""
    outcome = contract.run(name, program, "float32", "cloud_2d", variant)
    assert outcome.passed, str(outcome)


STAGES = [  # of the reconstruction of a surface
    (name, program) for name, operation in REGISTRY.items() for program, entry in operation.programs.items()
    if entry.module == "kernels_cuda"
]  # fmt: skip


@pytest.mark.parametrize(("name", "program"), STAGES)
def test_stage_of_a_reconstruction_gives_its_closed_forms(name, program):
    """In double precision, in the plane and in space, where the hard inputs have too many blocks for Python."""
    outcomes = list(contract.climb(contract.Target(REGISTRY[name], program, "float64"), ("T1",)))
    assert outcomes
    assert all(outcome.passed for outcome in outcomes), "\n".join(map(str, outcomes))


@pytest.mark.parametrize("variant", [0, 2])
def test_fit_on_a_gpu_finds_the_weights_that_it_is_not_given(variant):
    """In a case with points on the border of two cells, whose splines and weights must be those of one cell."""
    outcome = contract.run("surface_energy.fit", "cuda", "float64", "very_far_away", variant)
    assert outcome.passed, str(outcome)


@pytest.mark.parametrize(("tension", "last", "fused"), [
    (rs.JiangZhu2023(surface_tension=0.5, area_ratio=0.0), "jiang_zhu_2023.cohesion", True),
    (rs.JiangZhu2023(surface_tension=0.5, pair_mode="soft"), "jiang_zhu_2023.tension", False),  # its pairs have weights
    (rs.He2014(surface_tension=0.5), "he_2014.tension", True),
    (rs.Dong2016(surface_tension=0.5), "dong_2016.tension", True),
])  # fmt: skip
def test_pair_forces_and_pressure_share_a_loop_where_one_exists(tension, last, fused):
    liquid = rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=1.0, density="summation")
    scene = rs.Scene(
        dtype="float64", spacing=0.25, support_radius=0.5, fluid=(rs.Box(cells=(2, 2, 2)),), effects=(liquid, tension)
    )
    apart, joined = both(scene, 1)
    launched = [name for name, _, _ in joined.force_calls]
    assert launched[-1] == last
    assert ("sph.momentum" in launched) == (not fused)
    assert_alike(joined, apart, "velocity")


def paired(first, second):
    """Shaken particles between walls, or under tension, whose lists are soon used up."""
    return lambda dtype: pairs.scene(first, second, dtype).with_(step=0.0, skin=0.05)


def spray(dtype):
    """Two blocks that pass each other by more than a skin in a step, which the narrowest lists then serve alone."""
    blocks = (rs.Box(lower=(0.1 * k, 0.061 * k, 0.0), cells=(4, 3, 1), velocity=(5 - 10 * k, 0, 0)) for k in (0, 1))
    liquid = rs.WeaklyCompressible(sound_speed=8.0, dynamic_viscosity=0.2, density="summation")
    return rs.Scene(
        dim=2, dtype=dtype, spacing=0.02, support_radius=0.04, step=0.001, fluid=tuple(blocks), effects=(liquid,)
    )


# Steps are few because rounding differences grow with every one of them; the tolerances allow for that growth.
@pytest.mark.parametrize(("scene", "dtype", "steps", "tolerance"), [
    (paired("box_walls", "surface_detection"), "float64", 8, 1e-9),
    (paired("box_walls", "surface_detection"), "float32", 3, 1e-4),
    (paired("box_walls", "particle_shifting"), "float64", 5, 1e-9),
    (paired("jiang_zhu_2023", "weakly_compressible"), "float64", 4, 1e-9), (spray, "float64", 8, 1e-9),
])  # fmt: skip
def test_run_follows_the_references_and_repeats_bit_for_bit(scene, dtype, steps, tolerance):
    """Also where forces are launched before the host looks, a field is read or set, or forces evaluated in between."""
    oracle, run, again = each = [rs.Simulation(scene(dtype), name) for name in ("numpy", "cuda", "cuda")]
    again.stepper.foresees = False
    known = []
    for step in range(steps):
        expected, result, repeated = (s.step() for s in each)
        for s in each if step == 1 else ():
            s.evaluate()
        for s in each if step == 3 else ():
            s.set_field("velocity", s.field("velocity"))
        known.append(run.foreseen)
        assert result.limiter == expected.limiter
        assert result == repeated
        again.field("density")  # reading between two steps changes nothing
        again.field("acceleration")
        assert abs(result.length - expected.length) <= tolerance * expected.length
    assert {True, False} <= set(known) or steps < 4
    for s in each:
        s.evaluate()
    assert run.search.log.missed_neighbours == 0
    assert run.search.skin == (run.lists.skins[-1] if scene is spray else run.lists.skins[0])
    for name, f in run.plan.fields.items():
        values = run.field(name)
        assert np.array_equal(values, again.field(name)), name
        if f.numpy_dtype(dtype).kind in "iub":
            assert np.array_equal(values, oracle.field(name)), name
        else:
            whole = {"position_residual": "position"}.get(name, name)  # digits that are rounding, of another field
            largest = np.abs(oracle.field(whole)).max()
            assert np.abs(values - oracle.field(name)).max() <= tolerance * largest, name


def test_run_of_mpm_sorts_its_particles_and_finds_those_that_were_moved(monkeypatch):
    monkeypatch.setattr("refsim.engine.neighbour_lists.SORT_EVERY", 2)
    effects = rs.MpmLiquid(bulk_modulus=100.0, initial_ratio=0.9), rs.Gravity(acceleration=(0.0, -9.81, 0.0))
    scene = rs.Scene(
        dim=2, spacing=0.1, support_radius=0.3, dtype="float64", fluid=(rs.Box(cells=(5, 4, 1)),), effects=effects
    )
    oracle, run = both(scene, 2)
    for s in (oracle, run):
        s.set_field("position", s.field("position") + [5.0, 0.0, 0.0])  # far from all blocks
        s.step()
    assert list(run.backend.host(run.fields["identity"])) != list(range(20))
    assert_alike(run, oracle, "position", "velocity", "affine", "volume_ratio", "step_extremes")


@pytest.mark.parametrize("parameters", [
    {}, {"literal": ("M31",), "embedding": "thesis"}, {"enclose_volume": True},
], ids=str)  # fmt: skip
def test_run_of_mpm_under_tension_in_every_way_is_the_cpus(monkeypatch, parameters):
    """A surface at r, and one that encloses the liquid's volume.

    What a step records as a graph takes no memory: arrays that a recorded pass makes are gone when the graph runs.
    """
    from refsim.backends import device
    from refsim.engine.stepping import DeviceStepper

    launch, empty, recorded = DeviceStepper._launch, device.empty, []

    def launched(stepper, *part):
        recorded.append(stepper.state.steps > 0)
        launch(stepper, *part)
        recorded.pop()

    def made(*shape):
        assert not any(recorded), "a recorded pass makes an array"
        return empty(*shape)

    monkeypatch.setattr(DeviceStepper, "_launch", launched)
    monkeypatch.setattr(device, "empty", made)
    place = np.stack(np.meshgrid(range(5), range(4), [0.0]), axis=-1).reshape(-1, 3) + [0.5, 0.4, 0.0]
    place[:, :2] += np.random.default_rng(4).uniform(-0.1, 0.1, (20, 2))
    effects = (
        rs.MpmLiquid(bulk_modulus=1e3), rs.SurfaceEnergy(surface_tension=1.0, iterations=2, **parameters),
        rs.MpmWalls(lower=(-2.0, 0.0, 0.0), upper=(2.0, 2.0, 0.0)),
    )  # fmt: skip
    scene = rs.Scene(
        dim=2, spacing=0.1, support_radius=0.3, dtype="float64", step=1e-3, fluid=(rs.Cloud(position=0.1 * place),),
        effects=effects,
    )  # fmt: skip
    oracle, run = both(scene, 2)
    assert_alike(run, oracle, "position", "volume_ratio", "crowding")


def test_device_chooses_the_step_as_the_host_does(cuda):
    """Every limit in turn, a fixed step, and all reasons to stop."""
    from refsim.backends import device
    from refsim.core.effect import Extremes, StepLimit
    from refsim.engine.limits import stable_steps

    limits = {
        "a": StepLimit.constant(0.5), "b": StepLimit.crossing(2.0, speed=3.0),
        "c": StepLimit(1.0, acceleration_share=1.0), "d": StepLimit(3.0, rate_share=1.0),
    }  # fmt: skip
    table = cuda.asarray(np.array(list(limits.values())))

    def chosen(speed, acceleration, rate=0.0, excess=0.0, broken=0, fixed=0.0, previous=0.25, first=0.0, crushed=0):
        values = np.zeros(device.CLOCK_ROWS)
        values[[device.TIME, device.PREVIOUS, device.FIRST]] = 7.0, previous, first
        clock, steps = cuda.asarray(values), cuda.zeros(2, np.float64)
        extremes = cuda.asarray(np.array([speed**2, acceleration**2, broken, rate, excess, 9.0, crushed]))
        device.choose_step(extremes, table, 0.5, fixed, 1e-6, 100.0, 2.0, steps, clock)
        return cuda.host(clock), list(cuda.host(steps))

    for now in ((0.0, 0.0), (5.0, 0.0), (1.0, 100.0), (1.0, 100.0, 40.0)):
        expected = stable_steps(limits, Extremes(*now))
        limiter = min(expected, key=expected.get)
        clock, steps = chosen(*now)
        length = 0.5 * expected[limiter]
        assert clock[device.LENGTH] == pytest.approx(length, rel=1e-15)
        assert list(limits)[int(clock[device.LIMITER])] == limiter
        assert steps == [0.5 * (0.25 + clock[device.LENGTH]), clock[device.LENGTH]]
        assert list(clock[[device.TIME, device.PREVIOUS]]) == [7.0 + clock[device.LENGTH], clock[device.LENGTH]]
        assert clock[device.FIRST] == clock[device.LENGTH]
    clock, steps = chosen(1.0, 1.0, fixed=0.125)
    assert (clock[device.LIMITER], steps[1]) == (-1, 0.125)
    clock, steps = chosen(1.0, 1.0, crushed=2)
    assert (clock[device.REASON], *clock[[device.DENSE, device.CRUSHED]]) == (0, 9, 2)
    for reason, given in (
        (device.NON_FINITE, {"broken": 2}), (device.DIVERGED, {"speed": 101.0}),
        (device.STEP_TOO_SMALL, {"first": 1e9}), (device.OUT_OF_RANGE, {"excess": 0.5}),
        (device.COMPRESSED, {"crushed": 3}),
    ):  # fmt: skip
        clock, steps = chosen(**({"speed": 1.0, "acceleration": 1.0} | given))
        assert clock[device.REASON] == reason
        assert steps == [0.0, 0.0]
        assert list(clock[[device.TIME, device.PREVIOUS]]) == [7.0, 0.25]


PLANE = {"dim": 2, "spacing": 0.1, "support_radius": 0.3}
STEPPED = {
    "liquid": composition.scene(composition.LIQUID),
    "liquid between walls": composition.scene(composition.VISCOUS, composition.GRAVITY, composition.WALLS),
    "tension and detection": composition.scene(composition.VISCOUS, composition.TENSION,
        composition.DETECTION_EACH_STEP),
    "implicit pressure": composition.scene(composition.VISCOUS, composition.IMPLICIT),
    "melting": composition.scene(composition.CLAMPED, composition.SHAPE, composition.COUPLING, composition.WARM,
        composition.MELTING),
    "material points": rs.Scene(fluid=(rs.Box(cells=(3, 3, 1)),), effects=(composition.MPM_FULL,), step=5e-4, **PLANE),
    "their surface": rs.Scene(fluid=(rs.Box(cells=(3, 3, 1)),), step=5e-4, **PLANE,
        effects=(composition.MPM, rs.SurfaceEnergy(surface_tension=0.5, iterations=2))),
}  # fmt: skip


@pytest.mark.parametrize("name", STEPPED)
def test_a_recorded_step_launches_and_holds_what_the_plan_says(name):
    """The calls of the step that a GPU records, in order, and the bytes of the arrays that they work on."""
    run = rs.Simulation(STEPPED[name], "cuda")
    run.step()
    assert timed.differences(run, timed.launched(run)) == []
    assert {f: (a.shape, a.dtype) for f, a in run.fields.items()} == {
        f: (kind.shape(run.count), kind.numpy_dtype(run.plan.grid.dtype)) for f, kind in run.plan.fields.items()
    }
    assert run.build_position.nbytes == bytes_of(run.plan, "cuda")["positions_at_list_build"]
    for what, (found, expected) in composition.held_by_grid(run).items():
        assert found == expected, what


@pytest.mark.parametrize("name", ["tension and detection", "melting", "material points"])
def test_passes_that_need_nothing_of_each_other_may_come_in_any_order(monkeypatch, name):
    """Branches of a step's graph: of the calls that may come next, the last one comes first."""
    from refsim.backends import device

    turned = []

    def last_first(calls, after):
        waiting, done = list(range(len(calls))), set()
        while waiting:
            k = max(k for k in waiting if done.issuperset(after[k]))
            turned.append(k != waiting[0])
            waiting.remove(k)
            done.add(k)
            calls[k]()

    runs = []
    for order in (device.launch_after, last_first):
        monkeypatch.setattr(device, "launch_after", order)
        runs.append(advanced(rs.Simulation(STEPPED[name], "cuda"), 3))  # the first launches calls one by one
    assert any(turned)
    for field in runs[0].plan.fields:
        np.testing.assert_array_equal(runs[1].field(field), runs[0].field(field), err_msg=field)


def test_printed_files_run_as_they_stand():
    for name in ("sph.density", "sph.momentum", "surface_normal.color_gradient"):
        spaces = {}
        for target in ("cpu", "cuda"):
            space = spaces[target] = {"__name__": "copied"}
            exec(compile(printed(REGISTRY[name], target), name, "exec"), space)
        kernel, given = spaces["cpu"][REGISTRY[name].function], spaces["cpu"]["example"]()
        other, there = spaces["cuda"][REGISTRY[name].function], spaces["cuda"]["example"]()
        kernel(*given)
        other[1, 128](*there)
        np.testing.assert_allclose(there[-1], given[-1], rtol=1e-5, atol=1e-5 * np.abs(given[-1]).max(), err_msg=name)


def test_a_force_in_python_gets_the_devices_arrays():
    """The same run as on the references; the arrays are those of the run, with `__cuda_array_interface__` on a GPU."""
    box = rs.Box(lower=(0.0, 0.0, 0.0), cells=(2, 2, 2))
    scene = rs.Scene(
        spacing=0.1, support_radius=0.26, dtype="float64", step=1e-3, fluid=(box,), effects=(rs.Gravity(),)
    )
    oracle, run = both(scene)

    def push(time, fields):
        fields["acceleration"][...] = fields["acceleration"][...] + 1.5 + time

    def push_device(time, fields):
        array = fields["acceleration"]
        array.copy_to_device(array.copy_to_host() + 1.5 + time)
        assert array is run.fields["acceleration"]

    oracle.add_force(push)
    run.add_force(push_device)
    assert_alike(advanced(run, 3), advanced(oracle, 3), "position", "velocity", "acceleration")
