"""On a GPU: its speeds, each kernel of a step alone, steps, and the surface and tables of MPM (docs/study.md).

Warp's steps take turns with refsim's, which pytest-benchmark cannot do: `beside_warp` does it within one reading.
"""

import functools
import time

import numpy as np
import pytest

from refsim import Cloud, MpmLiquid, Scene, Simulation, make_plan
from refsim.backends import device, runtime
from refsim.backends.arrays import choose
from refsim.backends.compile import cuda, cuda_kernel
from tests.running import advanced
from validation import limits, timed
from validation.peers import missing, warp_sph

SIZES = {"60k": 39, "1M": 100, "8M": 200}  # particles along the edge of a cube
WARM = 60
TURNS = 3  # of refsim and Warp
WARP_STEPS = {39: 300, 100: 120, 200: 40}  # of refsim and of Warp in a turn by the cube's edge, after WARM others
BUSY = 0.3  # [s] that the device works before a reading
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


def neighbourhood(simulation):
    """(particles, mean neighbours within h of sampled particles, mean entries of the list) on backend "cuda"."""
    n, h, listed = simulation.count, simulation.plan.grid.support_radius, simulation.shared["neighbours"]
    counts = simulation.backend.host(listed.count)
    rows = np.random.default_rng(0).choice(n, min(n, 2000), replace=False)
    position = simulation.backend.host(simulation.fields["position"]).astype(float)
    sampled = device.as_cupy(listed.entries).reshape(-1, n)[:, device.cupy_or_numpy().asarray(rows)]
    entries = np.asarray(sampled.get() if hasattr(sampled, "get") else sampled)
    within = 0
    for column, i in enumerate(rows):
        away = position[entries[: counts[i], column]] - position[i]
        within += int(((away**2).sum(1) < h * h).sum())
    return n, within / len(rows), float(counts.mean())


@functools.lru_cache(maxsize=1)
def cube(edge, warm):
    """The turning cube, whose next step has length zero, and (particles, neighbours, entries) of it."""
    simulation = timed.started(edge, warm=warm)
    simulation.backend.assign(simulation.timestep, 0.0)  # the motion then leaves the particles where they are
    return simulation, neighbourhood(simulation)


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
    steps = functools.partial(advanced, simulation, more["steps"])
    reading("device", backend, f"{size} {effects}", steps, warm=1, rounds=3, iterations=1, **more)
    assert simulation.search.log.missed_neighbours == 0


@cuda_alone
@pytest.mark.parametrize("figure", ["figure_4", "figure_5", "figure_6", "million"])
def test_melting(reading, tiny, figure, backend):
    from validation.experiments.melting.runs import STEPS, WARM, scene_named

    simulation = Simulation(scene_named(figure, 0.2 if tiny else 1.0), backend)
    more = {"particles": simulation.count, "steps": 1 if tiny else STEPS}
    advanced(simulation, 2 if tiny else WARM)
    steps = functools.partial(advanced, simulation, more["steps"])
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


def beside_warp(edge):
    """Seconds of a step of refsim and of Warp in turns, list and grid included; both start anew in each turn.

    {"particles", "refsim": readings, "warp": readings by way, "serves": steps that a list serves, "speeds": difference
    of the mean speeds at the end, of refsim's, "accelerations": `disturbed_difference`, "version"}.
    """
    small = runtime.simulated()
    where = "cpu" if small else "cuda:0"
    warm, steps = (2, 2) if small else (WARM, WARP_STEPS[edge])
    busy = 0.0 if small else BUSY
    refsim_seconds, theirs, builds, summary = [], {}, 0, {}
    for _ in range(1 if small else TURNS):
        simulation = timed.started(edge, warm=1 + warm)
        search = simulation.search
        until = time.perf_counter() + busy
        while time.perf_counter() < until:  # the device's clock rises; the fields are computed anew in the next step
            for _, _, call in simulation.force_calls:
                call()
            simulation.backend.synchronize()
        simulation.outdate()
        built, began = search.log.rebuilds, time.perf_counter()
        for _ in range(steps):
            simulation.step()  # waits for the device
        refsim_seconds.append((time.perf_counter() - began) / steps)
        builds += search.log.rebuilds - built
        serves = len(refsim_seconds) * steps / max(builds, 1)
        speed = float(np.sqrt((simulation.field("velocity").astype(float) ** 2).sum(1).mean()))
        plan, summary["particles"] = simulation.plan, simulation.count
        del simulation, search
        peer = warp_sph.run(plan, timed.fixed_step(edge), warm, steps, max(1, round(serves)), where, busy=busy)
        assert "missing" not in peer, peer
        for name, seconds in peer["seconds"].items():
            theirs.setdefault(name, []).append(seconds)
        summary |= {"serves": serves, "speeds": abs(peer["speed"] / speed - 1)}
    summary |= {"refsim": refsim_seconds, "warp": theirs, "version": peer["version"]}
    return summary | ({"accelerations": disturbed_difference(edge, where)} if edge <= min(WARP_STEPS) else {})


def disturbed_difference(edge, where):
    """Largest difference of the accelerations of refsim and Warp, of the largest one.

    The cube's particles are moved by up to 0.2 spacings along an axis; on the lattice pressures are rounding errors.
    """
    plan = make_plan(timed.spinning_cube(edge, step=timed.fixed_step(edge)))
    moved = np.random.default_rng(1).uniform(-0.2, 0.2, plan.state.position.shape) * plan.grid.spacing
    position = (plan.state.position + moved).astype(np.float32).astype(float)
    plan = timed.begun(plan, position=position, velocity=timed.spinning(position).astype(np.float32).astype(float))
    peer = warp_sph.run(plan, timed.fixed_step(edge), 1, 1, 1, where, accelerations=True)
    assert "missing" not in peer, peer
    simulation = Simulation(plan, "cuda")
    simulation.evaluate()
    acceleration = simulation.field("acceleration")
    return float(f"{np.abs(acceleration - peer['acceleration']).max() / np.abs(acceleration).max():.3g}")


@cuda_alone
@sizes
def test_beside_warp(reading, benchmark, tiny, size, backend):
    if reason := missing("warp_sph"):
        pytest.skip(reason)
    found = {}

    def in_turns():
        found.update(beside_warp(3 if tiny else SIZES[size]))

    reading("device", backend, f"{size} warp", in_turns, warm=0, rounds=1, iterations=1)
    benchmark.extra_info |= found
