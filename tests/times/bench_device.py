"""On a GPU: its speeds, each kernel of a step alone, steps, and the surface and tables of MPM (docs/study.md).

Warp's steps take turns with refsim's, which pytest-benchmark cannot do: `validation.limits.beside_warp` does it within
one reading.
"""

import functools

import numpy as np
import pytest

from refsim import Cloud, MpmLiquid, Scene, Simulation
from refsim.backends import device
from refsim.backends.arrays import choose
from refsim.backends.compile import cuda, cuda_kernel
from validation import limits, timed
from validation.peers import missing

SIZES = {"60k": 39, "1M": 100, "8M": 200}  # particles along the edge of a cube
WARM = 60
LAUNCHES = 20  # of a kernel in one graph
CHAINS = 8  # independent chains of a thread, so that no multiply-add waits for the one before
OF_STEP = {"sph.density": "density", "sph.state": "state", "jiang_zhu_2023.cohesion": "forces"}
cuda_alone = pytest.mark.parametrize("backend", ["cuda"])
sizes = pytest.mark.parametrize("size", SIZES)


@cuda_kernel
def multiply_add(factor, summand, rounds, out):
    """out[i] = sum of CHAINS numbers x after `rounds` times x <- factor x + summand, float32."""
    i = cuda.grid(1)
    if i < out.shape[0]:
        real = type(factor)
        x = real(i)
        a, b, c, d = x, x + real(1), x + real(2), x + real(3)
        e, f, g, h = x + real(4), x + real(5), x + real(6), x + real(7)
        for _ in range(rounds):
            a = a * factor + summand
            b = b * factor + summand
            c = c * factor + summand
            d = d * factor + summand
            e = e * factor + summand
            f = f * factor + summand
            g = g * factor + summand
            h = h * factor + summand
        out[i] = a + b + c + d + e + f + g + h


@pytest.fixture
def on_device(reading, tiny):
    """`reading` of a call that only launches: the host waits for the device after `repeats` of them."""

    def timed_call(name, call, repeats=10, calls=1, **more):
        wait = choose("cuda").synchronize
        repeats = 1 if tiny else repeats

        def run():
            for _ in range(repeats):
                call()
            wait()

        reading("device", "cuda", name, run, warm=2, rounds=5, iterations=1, calls=calls * repeats, **more)

    return timed_call


@cuda_alone
def test_copy(on_device, tiny, backend):
    xp = device.cupy_or_numpy()
    source = xp.ones(2**4 if tiny else 2**29, np.float32)
    target = xp.empty_like(source)

    def copy():
        target[...] = source

    on_device("copy", copy, bytes=2 * source.nbytes)


@cuda_alone
def test_arithmetic(on_device, tiny, backend):
    threads, rounds = (8, 2) if tiny else (2**22, 4096)
    out = device.empty(threads, np.float32)
    given = np.float32(0.9999), np.float32(1e-4), np.int32(rounds), out
    on_device("arithmetic", lambda: multiply_add(*given), operations=2 * CHAINS * threads * rounds)


@functools.lru_cache(maxsize=1)
def cube(edge, warm):
    """The turning cube, whose next step has length zero, and (particles, neighbours, entries) of it."""
    simulation = timed.started(edge, warm=warm)
    simulation.backend.assign(simulation.timestep, 0.0)  # the motion then leaves the particles where they are
    return simulation, timed.neighbourhood(simulation)


@cuda_alone
@pytest.mark.parametrize("kernel", [*limits.STEP_KERNELS, "list"])
@sizes
def test_kernel(on_device, tiny, size, kernel, backend):
    simulation, (particles, neighbours, entries) = cube(3 if tiny else SIZES[size], 2 if tiny else WARM)
    calls = {OF_STEP[name]: call for name, _, call in simulation.force_calls}
    ((_, move),) = simulation.motion_calls
    calls |= {"extremes": simulation.extremes_call, "motion": move}
    launches = 1 if tiny or kernel == "list" else LAUNCHES

    def several():
        for _ in range(launches):
            calls[kernel]()

    build = functools.partial(simulation.search.build, simulation.build_position)
    run = device.CudaGraph(several) if kernel in calls else build
    given = {"particles": particles, "neighbours": neighbours, "entries": entries}
    on_device(f"{size} {kernel}", run, calls=launches, **given)


@cuda_alone
@pytest.mark.parametrize(
    "size, effects",
    [*((size, "jiang_zhu") for size in SIZES), *(("8M", name) for name in timed.CUBES if name != "jiang_zhu")],
)
def test_step(reading, benchmark, tiny, size, effects, backend):
    simulation = Simulation(timed.spinning_cube(3 if tiny else SIZES[size], effects), backend)
    simulation.write_field("velocity", timed.spinning(simulation.plan.state.position))
    more = {"particles": simulation.count, "steps": 1 if tiny else 100}

    def steps():
        for _ in range(more["steps"]):
            simulation.step()

    reading("device", backend, f"{size} {effects}", steps, warm=1, rounds=3, iterations=1, **more)
    assert simulation.search.log.missed_neighbours == 0


@cuda_alone
@pytest.mark.parametrize("figure", ["figure_4", "figure_5", "figure_6", "million"])
def test_melting(reading, tiny, figure, backend):
    from validation.experiments.melting.runs import STEPS, WARM, scene_named

    simulation = Simulation(scene_named(figure, 0.2 if tiny else 1.0), backend)
    more = {"particles": simulation.count, "steps": 1 if tiny else STEPS}
    for _ in range(2 if tiny else WARM):
        simulation.step()

    def steps():
        for _ in range(more["steps"]):
            simulation.step()

    reading("device", backend, f"melting {figure}", steps, warm=0, rounds=1, iterations=1, **more)


@pytest.mark.parametrize("backend", ["cpu", "cuda"])
def test_surface(reading, benchmark, tiny, backend):
    """The surface of a million particles and its force over a plain step of as many, in turns."""
    from validation.experiments.surface_reconstruction.runs import beside_transfers
    from validation.running import Context

    if backend == "cpu" and not tiny:
        pytest.skip("shown for a GPU")
    cells, turns, repeats = (1, 1, 1) if tiny else (50, 3, 25)
    found = {}

    def in_turns():
        found.update(beside_transfers(Context(), backend, cells, turns, repeats).values)

    reading("device", backend, "surface in turns", in_turns, warm=0, rounds=1, iterations=1)
    benchmark.extra_info |= {name: found[name] for name in ("particles", "own", "plain", "ratio", "ratios")}


@cuda_alone
def test_table(on_device, tiny, backend):
    from validation.peers.taichi_mpm import places

    spacing = 0.01
    cloud = Cloud(position=places(1 if tiny else 64, spacing, "lattice"))
    effects = (MpmLiquid(bulk_modulus=1e5),)
    run = Simulation(Scene(spacing=spacing, support_radius=3 * spacing, fluid=(cloud,), effects=effects), backend)
    grid, position = run.parameters["mpm_liquid"]["grid"], run.fields["position"]
    renew = functools.partial(grid.attend, position, moved=True)
    on_device("table", renew, repeats=1, particles=run.count, blocks=grid.nodes // 64)


@cuda_alone
@sizes
def test_beside_warp(reading, benchmark, tiny, size, backend):
    if reason := missing("warp_sph"):
        pytest.skip(reason)
    found = {}

    def in_turns():
        found.update(limits.beside_warp(3 if tiny else SIZES[size]))

    reading("device", backend, f"{size} warp", in_turns, warm=0, rounds=1, iterations=1)
    benchmark.extra_info |= found
