"""How near the backend "cuda" comes to the limits of its device: docs/device_limits.md.

`scripts/gpu_check.py --only limits` measures on a GPU and adds to the device's report; `python -m validation limits`
(`validation.limits_page`) makes page and picture from the newest report, without a GPU.

The work that a kernel needs at least, for each particle with M neighbours within h and L entries in its list, float32
(4 bytes a number, an index or a count). Bytes: every field is read once from memory and written once, the list is read
once by each kernel that walks it. Operations: additions, multiplications, divisions, square roots, each once; a
multiply-add is two; comparisons and indices count nothing, and what two formulas share counts once.

kernel       bytes                                                                   operations
density      24 + 4 L   x, m, count, entries; writes rho                             8 L + 11 M
state        8          rho; writes p                                                6
forces       64 + 4 L   x, v, m, rho, p, count, entries; adds to a (read, written)   8 L + 55 M + 9
extremes     24         v, a                                                         10
motion       72         a, v, x, place at the build; writes v, x                     21
list         16 + 4 L   x; writes count and entries                                  8 L

8 L are the squared distances of all listed pairs. 11 of the density are root, q, the six of Wendland's C2 shape, its
scale, and two for m W. 55 of the forces are 4 for root, r + tiny, V_j/r, 7 for the slope, 4 for the pressure pair, 13
for viscosity, 21 for J(16), and 6 for the vector of the pressure. The list's own search tests more pairs than it keeps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from refsim import Box, JiangZhu2023, Scene, Simulation, WeaklyCompressible, make_plan
from refsim.backends import runtime
from validation.peers import warp_sph

COHESION = JiangZhu2023(surface_tension=0.5, pair_mode="all", area_ratio=0.0, density_correction=False)
SOUND, SPIN = 20.0, 1.0  # [m/s], [rad/s]
TURNS = 3  # of refsim and Warp
SIZES = {"60k": 39, "1M": 100, "8M": 200}  # particles along the edge of a cube
WARP_STEPS = {"60k": 300, "1M": 120, "8M": 40}  # of refsim and of Warp in a turn, after WARM others
BUSY = 0.3  # [s] that the device works before a reading
WARM = 60
DIFFERENCE = "accelerations, largest difference"
LARGEST_DIFFERENCE = 1e-5  # of the largest: about 30 terms of either sign, float32, in two orders
STEP_KERNELS = ("density", "state", "forces", "extremes", "motion")  # of every step; the list is built now and then

Reading = tuple[str, Any, str, str]  # name, value, unit, words


class Work(NamedTuple):
    """What a kernel needs at least, for all particles."""

    bytes: float
    operations: float


def least(kernel: str, particles: float, neighbours: float, entries: float) -> Work:
    """The least work of a kernel; neighbours M and entries L of a particle. See the table above."""
    read_and_written, counted = {
        "density": (24 + 4 * entries, 8 * entries + 11 * neighbours),
        "state": (8, 6),
        "forces": (64 + 4 * entries, 8 * entries + 55 * neighbours + 9),
        "extremes": (24, 10),
        "motion": (72, 21),
        "list": (16 + 4 * entries, 8 * entries),
    }[kernel]
    return Work(particles * read_and_written, particles * counted)


def spinning_cube(edge: int, tension: Any = COHESION, **more: Any) -> Scene:
    """A cube of edge^3 particles of viscous liquid, side 1 m, h = 2 d, float32; `spinning` makes it turn."""
    spacing = 1.0 / edge
    return Scene(
        dtype="float32",
        spacing=spacing,
        support_radius=2 * spacing,
        fluid=(Box(cells=(edge,) * 3),),
        effects=(WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=1.0), tension),
        **more,
    )


def spinning(position: np.ndarray) -> np.ndarray:
    """Velocities (n, 3) [m/s] of the cube that turns about its axis along z."""
    return np.cross([0.0, 0.0, SPIN], position - 0.5)


def fixed_step(edge: int) -> float:
    """Length of a step [s]: 0.4 h/(c + v) with the greatest speed v = 1 m/s, which no corner of the cube reaches."""
    return 0.4 * (2 / edge) / (SOUND + 1.0)


def started(edge: int, backend: str = "cuda", warm: int = WARM) -> Simulation:
    """The turning cube with steps of fixed length, after `warm` steps."""
    plan = make_plan(spinning_cube(edge, step=fixed_step(edge)))
    plan.state.velocity[:] = spinning(plan.state.position)
    simulation = Simulation(plan, backend)
    for _ in range(warm):
        simulation.step()
    return simulation


def milliseconds(seconds: float) -> float:
    """Four digits of it."""
    return float(f"{1e3 * seconds:.4g}")


# Measured on a GPU, by scripts/gpu_check.py; in the simulator with tiny sizes


def speeds() -> list[Reading]:
    """How fast the device copies within its memory and multiplies and adds, medians of five readings."""
    from refsim.backends import device
    from validation.experiments.melting.device import clock
    from validation.limits_cuda import OPERATIONS, multiply_add

    small = runtime.simulated()
    mark, between = clock()
    xp = device.library()
    source = xp.ones(2**4 if small else 2**29, np.float32)
    target = xp.empty_like(source)
    threads, rounds = (8, 2) if small else (2**22, 4096)
    out = device.empty(threads, np.float32)

    def copy() -> None:
        target[...] = source

    def count() -> None:
        multiply_add(np.float32(0.9999), np.float32(1e-4), np.int32(rounds), out)

    def seconds(call: Callable[[], None]) -> list[float]:
        call()
        call()
        spans = []
        for _ in range(1 if small else 5):
            first = mark()
            for _ in range(1 if small else 5):
                call()
            spans.append(max(between(first, mark()), 1e-9) / (1 if small else 5))
        return spans

    copied, counted = 2.0 * source.nbytes, float(threads) * rounds * OPERATIONS
    made: list[Reading] = []
    for name, work, unit, spans, words in (
        ("copy speed", copied, "GB/s", seconds(copy), f"{source.nbytes / 2**20:.0f} MiB, bytes read and written"),
        ("arithmetic speed", counted, "GFLOP/s", seconds(count), "independent multiply-adds, float32, two each"),
    ):
        low, middle, high = (1e-9 * work / s for s in (max(spans), float(np.median(spans)), min(spans)))
        made.append((name, float(f"{middle:.5g}"), unit, f"{words}; readings {low:.5g} to {high:.5g}"))
    return made


def kernels(size: str) -> list[Reading]:
    """Device milliseconds of each kernel of a step, each replayed alone as a CUDA graph, and of building the list."""
    from refsim.backends import device
    from validation.experiments.melting.device import clock

    small = runtime.simulated()
    times, readings = (1, 1) if small else (20, 3)
    simulation = started(3 if small else SIZES[size], warm=2 if small else WARM)
    n, h = simulation.count, simulation.plan.grid.support_radius
    listed, search = simulation._shared["neighbours"], simulation.search
    assert search is not None
    counts = simulation.backend.host(listed.count)
    rows = np.random.default_rng(0).choice(n, min(n, 2000), replace=False)
    position = simulation.backend.host(simulation.fields["position"]).astype(float)
    columns = device.library().asarray(rows)
    entries = np.asarray(_on_host(device.seen(listed.entries).reshape(-1, n)[:, columns]))
    within = 0
    for column, i in enumerate(rows):
        away = position[entries[: counts[i], column]] - position[i]
        within += int(((away**2).sum(1) < h * h).sum())
    made: list[Reading] = [
        ("particles", n, "", ""),
        ("neighbours", round(within / len(rows), 3), "", f"within h, mean of {len(rows):,} rows"),
        ("entries", round(float(counts.mean()), 3), "", "of the list, mean"),
    ]
    names = {"sph.density": "density", "sph.state": "state", "jiang_zhu_2023.cohesion": "forces"}
    calls = {names[name]: call for name, _, call in simulation.force_calls}
    ((_, move),) = simulation.motion_calls
    calls |= {"extremes": simulation.extremes_call, "motion": move}
    simulation.backend.assign(simulation.timestep, 0.0)  # the motion then leaves the particles where they are
    mark, between = clock()
    for name, call in calls.items():

        def several(call: Callable[[], None] = call) -> None:
            for _ in range(times):
                call()

        replayed = device.Recorded(several)
        replayed()
        replayed()
        spans = []
        for _ in range(readings):
            first = mark()
            replayed()
            spans.append(between(first, mark()) / times)
        made.append((name, milliseconds(float(np.median(spans))), "ms", f"one graph of {times} launches"))
    spans = []
    for _ in range(1 if small else 5):
        first = mark()
        search.build(simulation.build_position)
        spans.append(between(first, mark()))
    made.append(("list", milliseconds(float(np.median(spans))), "ms", "a build, without sorting and audit"))
    return made


def _on_host(array: Any) -> Any:
    return array.get() if hasattr(array, "get") else array


def beside_warp(size: str) -> list[Reading]:
    """Milliseconds of a step of refsim and of Warp in turns, list and grid included; both start anew in each turn.

    Raises RuntimeError where Warp is not there.
    """
    small = runtime.simulated()
    edge, device = (3, "cpu") if small else (SIZES[size], "cuda:0")
    warm, steps = (2, 2) if small else (WARM, WARP_STEPS[size])
    busy = 0.0 if small else BUSY
    own: list[float] = []
    speeds: list[float] = []
    theirs: dict[str, list[float]] = {}
    builds, every, particles, peer = 0, 1, 0, dict[str, Any]()
    for _ in range(1 if small else TURNS):
        simulation = started(edge, warm=1 + warm)
        search = simulation.search
        assert search is not None
        until = time.perf_counter() + busy
        while time.perf_counter() < until:  # the device's clock rises; the fields are computed anew in the next step
            for _, _, call in simulation.force_calls:
                call()
            simulation.backend.synchronize()
        built, began = search.log.rebuilds, time.perf_counter()
        for _ in range(steps):
            simulation.step()  # waits for the device
        own.append((time.perf_counter() - began) / steps)
        builds += search.log.rebuilds - built
        every = max(1, round(len(own) * steps / max(builds, 1)))
        speeds.append(float(np.sqrt((simulation.field("velocity").astype(float) ** 2).sum(1).mean())))
        plan, particles = simulation.plan, simulation.count
        del simulation, search
        peer = warp_sph.run(plan, fixed_step(edge), warm, steps, every, device, busy=busy)
        if "missing" in peer:
            raise RuntimeError(peer["missing"])
        for name, seconds in peer["seconds"].items():
            theirs.setdefault(name, []).append(seconds)
    made: list[Reading] = [
        ("particles", particles, "", ""),
        ("refsim", milliseconds(float(np.median(own))), "ms", _span(own)),
        ("steps a list serves", float(f"{len(own) * steps / max(builds, 1):.3g}"), "", f"Warp's grid: {every}"),
    ]
    made += [(f"Warp, {name}", milliseconds(float(np.median(s))), "ms", _span(s)) for name, s in theirs.items()]
    best = min(theirs, key=lambda name: float(np.median(theirs[name])))
    ratios = [a / b for a, b in zip(theirs[best], own, strict=True)]
    words = f"{best}; {min(ratios):.3g} to {max(ratios):.3g}"
    made.append(("Warp over refsim", float(f"{np.median(ratios):.4g}"), "", words))
    off = abs(peer["speed"] / speeds[-1] - 1)
    made.append(
        ("mean speeds at the end, difference", float(f"{off:.2g}"), "of refsim's", f"after {1 + warm + steps} steps")
    )
    if size == "60k":
        made.append((DIFFERENCE, disturbed_difference(edge, device), "of largest", "of a disturbed cube"))
    made.append(("Warp", peer["version"], "", f"{peer['device']}; {peer['graph'] or 'steps recorded as CUDA graphs'}"))
    return made


def disturbed_difference(edge: int, device: str, backend: str = "cuda") -> float:
    """Largest difference of the accelerations of refsim and Warp, of the largest one.

    The cube's particles are moved by up to 0.2 spacings along an axis; on the lattice pressures are rounding errors.
    Raises RuntimeError where Warp is not there.
    """
    plan = make_plan(spinning_cube(edge, step=fixed_step(edge)))
    moved = np.random.default_rng(1).uniform(-0.2, 0.2, plan.state.position.shape) * plan.grid.spacing
    plan.state.position[:] = (plan.state.position + moved).astype(np.float32)
    plan.state.velocity[:] = spinning(plan.state.position).astype(np.float32)
    peer = warp_sph.run(plan, fixed_step(edge), 1, 1, 1, device, accelerations=True)
    if "missing" in peer:
        raise RuntimeError(peer["missing"])
    simulation = Simulation(plan, backend)
    simulation.evaluate()
    own = simulation.field("acceleration")
    return float(f"{np.abs(own - peer['acceleration']).max() / np.abs(own).max():.3g}")


def _span(seconds: Sequence[float]) -> str:
    return f"median of {len(seconds)} turns, {1e3 * min(seconds):.4g} to {1e3 * max(seconds):.4g}"


def mpm_surface(backend: str = "cuda") -> list[Reading]:
    """The surface of a million particles and its force over a plain step of as many, in turns."""
    from validation.experiments.surface_reconstruction.runs import beside_transfers
    from validation.running import Context

    cells, turns, repeats = (50, 3, 25) if backend == "cuda" and not runtime.simulated() else (1, 1, 1)
    values = beside_transfers(Context(), backend, cells, turns, repeats).values
    ratios = ", ".join(f"{ratio:.3g}" for ratio in values["ratios"])
    return [
        ("particles", values["particles"], "", ""),
        ("surface and force", milliseconds(float(np.median(values["own"]))), "ms", ""),
        ("plain step", milliseconds(float(np.median(values["plain"]))), "ms", ""),
        ("surface over plain step", float(f"{values['ratio']:.4g}"), "", f"turns {ratios}"),
    ]


def mpm_table() -> list[Reading]:
    """Milliseconds of a new table of blocks of the background grid, the device waited for."""
    from refsim import Cloud, MpmLiquid
    from validation.peers.taichi_mpm import places

    small, spacing = runtime.simulated(), 0.01
    cloud = Cloud(position=places(1 if small else 64, spacing, "lattice"))
    scene = Scene(
        dtype="float32", spacing=spacing, support_radius=3 * spacing, fluid=(cloud,),
        effects=(MpmLiquid(bulk_modulus=1e5),),
    )  # fmt: skip
    run = Simulation(scene, "cuda")
    grid, position = run._parameters["mpm_liquid"]["grid"], run.fields["position"]
    spans = []
    for _ in range(2 if small else 12):
        run.backend.synchronize()
        began = time.perf_counter()
        grid.attend(position, moved=True)
        run.backend.synchronize()
        spans.append(time.perf_counter() - began)
    words = f"median of {len(spans) - 1}, {1e3 * min(spans[1:]):.3g} to {1e3 * max(spans[1:]):.3g}"
    return [
        ("particles", run.count, "", ""),
        ("blocks", grid.nodes // 64, "", ""),
        ("new table", milliseconds(float(np.median(spans[1:]))), "ms", words),
    ]


MEASURES: dict[str, Callable[..., list[Reading]]] = {
    "speeds": speeds, "kernels": kernels, "warp": beside_warp, "surface": mpm_surface, "table": mpm_table,
}  # fmt: skip


def tasks() -> list[str]:
    """Names of all measurements, as `scripts/gpu_check.py` takes them."""
    several = [f"limits {kind} {size}" for size in SIZES for kind in ("kernels", "warp")]
    return ["limits speeds", *several, "limits surface", "limits table"]


def left_out(task: str) -> str:
    """Why a measurement cannot be made here, or ""."""
    return warp_sph.missing() if task.startswith("limits warp") else ""
