"""How near the backend "cuda" comes to the limits of its device: docs/study.md.

`tests/times/bench_device.py` measures on a GPU; `validation.times` makes page and picture of what it gave.

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
from typing import Any, NamedTuple

import numpy as np

from refsim import Simulation, make_plan
from refsim.backends import runtime
from validation.peers import warp_sph
from validation.timed import begun, fixed_step, spinning, spinning_cube, started

TURNS = 3  # of refsim and Warp
WARP_STEPS = {39: 300, 100: 120, 200: 40}  # of refsim and of Warp in a turn by the cube's edge, after WARM others
BUSY = 0.3  # [s] that the device works before a reading
WARM = 60
STEP_KERNELS = ("density", "state", "forces", "extremes", "motion")  # of every step; the list is built now and then


class Work(NamedTuple):
    """What a kernel needs at least, for all particles."""

    bytes: float
    operations: float


def least(kernel: str, particles: float, neighbours: float, entries: float) -> Work:
    """The least work of a kernel; neighbours M and entries L of a particle. See the table above."""
    read_and_written, counted = {
        "density": (24 + 4 * entries, 8 * entries + 11 * neighbours), "state": (8, 6),
        "forces": (64 + 4 * entries, 8 * entries + 55 * neighbours + 9), "extremes": (24, 10), "motion": (72, 21),
        "list": (16 + 4 * entries, 8 * entries),
    }[kernel]  # fmt: skip
    return Work(particles * read_and_written, particles * counted)


def beside_warp(edge: int) -> dict[str, Any]:
    """Seconds of a step of refsim and of Warp in turns, list and grid included; both start anew in each turn.

    {"particles", "refsim": readings, "warp": readings by way, "serves": steps that a list serves, "speeds": difference
    of the mean speeds at the end, of refsim's, "accelerations": `disturbed_difference`, "version"}. Raises RuntimeError
    where Warp is not there.
    """
    small = runtime.simulated()
    device = "cpu" if small else "cuda:0"
    warm, steps = (2, 2) if small else (WARM, WARP_STEPS[edge])
    busy = 0.0 if small else BUSY
    refsim_seconds: list[float] = []
    theirs: dict[str, list[float]] = {}
    builds, summary, peer = 0, dict[str, Any](), dict[str, Any]()
    for _ in range(1 if small else TURNS):
        simulation = started(edge, warm=1 + warm)
        search = simulation.search
        assert search is not None
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
        peer = warp_sph.run(plan, fixed_step(edge), warm, steps, max(1, round(serves)), device, busy=busy)
        if "missing" in peer:
            raise RuntimeError(peer["missing"])
        for name, seconds in peer["seconds"].items():
            theirs.setdefault(name, []).append(seconds)
        summary |= {"serves": serves, "speeds": abs(peer["speed"] / speed - 1)}
    summary |= {"refsim": refsim_seconds, "warp": theirs, "version": peer["version"]}
    return summary | ({"accelerations": disturbed_difference(edge, device)} if edge <= min(WARP_STEPS) else {})


def disturbed_difference(edge: int, device: str, backend: str = "cuda") -> float:
    """Largest difference of the accelerations of refsim and Warp, of the largest one.

    The cube's particles are moved by up to 0.2 spacings along an axis; on the lattice pressures are rounding errors.
    Raises RuntimeError where Warp is not there.
    """
    plan = make_plan(spinning_cube(edge, step=fixed_step(edge)))
    moved = np.random.default_rng(1).uniform(-0.2, 0.2, plan.state.position.shape) * plan.grid.spacing
    position = (plan.state.position + moved).astype(np.float32).astype(float)
    plan = begun(plan, position=position, velocity=spinning(position).astype(np.float32).astype(float))
    peer = warp_sph.run(plan, fixed_step(edge), 1, 1, 1, device, accelerations=True)
    if "missing" in peer:
        raise RuntimeError(peer["missing"])
    simulation = Simulation(plan, backend)
    simulation.evaluate()
    acceleration = simulation.field("acceleration")
    return float(f"{np.abs(acceleration - peer['acceleration']).max() / np.abs(acceleration).max():.3g}")
