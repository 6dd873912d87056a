"""The step of Jiang & Zhu's cohesion in Warp: in a process of its own.

Equal to refsim's scene of weakly compressible liquid with `JiangZhu2023(pair_mode="all", area_ratio=0.0,
density_correction=False)`: the particles at the start, float32, a mass for each particle, density J(7) with the
Wendland C2 kernel, equation of state J(9) with the balanced cohesion and the clamp, pressure J(10) and viscosity J(11)
with the inter-particle force J(16) and J(17) in one pass over the neighbours, and the step v += dt a, x += dt v of
fixed length. All coefficients are those of refsim's kernels.

Not equal: neighbours come from Warp's `wp.HashGrid`, whose cells each pass walks anew; refsim keeps a list. The cells
are as wide as the search reaches. Two ways are timed. "each step" builds the grid in every step and searches within h,
as Warp's own example does; "with skin" builds it once in `every` steps, as often as refsim builds its list, and
searches within h + skin. Threads take the particles in the order of the grid, positions stay in the order of the
lattice; refsim sorts its particles. refsim also finds the largest speed, acceleration and displacement in each step,
tests them, and audits its list; Warp's program does not.

Written as Warp's own examples are. On a GPU steps are launched one by one and, for up to RECORDED particles and if that
can be recorded, as CUDA graphs.
"""

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from refsim.smoothing.shapes import WENDLAND_C2
from validation.peers import launch

RECORDED = 200_000  # particles at most whose steps are recorded: more take milliseconds, launches tens of microseconds


def coefficients(plan: Any) -> dict[str, float]:
    """What the kernels of a plan with weakly compressible liquid and Jiang & Zhu's cohesion take, by name.

    Raises ValueError where the scene computes something else than `work`.
    """
    fluid, smoothing = plan.shared["fluid"], plan.shared["smoothing"]
    operations = [p.operation for _, p in plan.passes]
    same = ["sph.density", "sph.state", "sph.momentum", "jiang_zhu_2023.cohesion"]
    if operations != same or (fluid.exponent, plan.grid.dim, plan.shared["walls"]) != (1, 3, None):
        raise ValueError(f"the scene launches {', '.join(operations)}; Warp's program computes {', '.join(same)}")
    if smoothing.shape != WENDLAND_C2:
        raise ValueError("Warp's program has the Wendland C2 kernel alone")
    tension = plan.parameters["jiang_zhu_2023"]
    made = {
        "h": smoothing.support_radius, "inverse": smoothing.inverse_radius, "value": smoothing.value_scale,
        "slope": smoothing.slope_scale, "laplacian": smoothing.laplacian_scale, "density": fluid.rest_density,
        "stiffness": fluid.stiffness, "balance": fluid.internal_pressure, "share": fluid.gradient_share,
        "lowest": 0.0 if fluid.clamp else -math.inf,
        "viscosity": plan.parameters["weakly_compressible"]["viscosity"].coefficient,
        "amplitude": tension["cohesion"].amplitude, "stretch": tension["cohesion"].inner_stretch,
        "repulsion": tension["cohesion"].alpha * tension["cohesion"].inner_share,
        "attraction": tension["cohesion"].beta,
    }  # fmt: skip
    return {name: float(value) for name, value in made.items()}


def run(
    plan: Any, step: float, warm: int, steps: int, every: int, device: str = "cpu", accelerations: bool = False,
    busy: float = 0.0,
) -> dict[str, Any]:  # fmt: skip
    """Time steps of a plan's particles in a process of its own.

    step   length [s]; warm: steps that are not counted. every: steps that a grid serves "with skin"
    accelerations  whether those of the start (n, 3) [m/s^2] are returned
    busy   seconds in which the device computes forces before the steps, so that its clock rises

    {"particles", "seconds" (mean step by way of working), "speed" (root of the mean square at the end [m/s]),
    "centre" [m], "graph" (why no CUDA graph was recorded; "" if it was), "version", "device"} or {"missing"}.
    """
    state, skin = plan.state, plan.scene.skins[0] * plan.grid.support_radius
    given = {
        "position": state.position.astype(np.float32), "velocity": state.velocity.astype(np.float32),
        "mass": state.mass.astype(np.float32), "coefficients": coefficients(plan), "spacing": plan.grid.spacing,
        "step": step, "skin": skin, "warm": warm, "steps": steps, "every": every, "device": device,
        "accelerations": accelerations, "busy": busy,
    }  # fmt: skip
    return launch("warp_sph", given, limit=200.0)


def programs() -> tuple[Any, ...]:
    """(structure of the coefficients, kernels of density, acceleration and motion)."""
    import warp as wp

    @wp.struct
    class Coefficients:
        h: float
        inverse: float
        value: float
        slope: float
        laplacian: float
        density: float
        stiffness: float
        balance: float
        share: float
        lowest: float
        viscosity: float
        amplitude: float
        stretch: float
        repulsion: float
        attraction: float

    @wp.func
    def poly6(q: float) -> float:
        a = wp.max(1.0 - q * q, 0.0)
        return a * a * a

    @wp.kernel
    def density_and_pressure(
        grid: wp.uint64, position: wp.array(dtype=wp.vec3), mass: wp.array(dtype=float), c: Coefficients, reach: float,
        density: wp.array(dtype=float), pressure: wp.array(dtype=float),
    ) -> None:  # fmt: skip
        i = wp.hash_grid_point_id(grid, wp.tid())
        x = position[i]
        rho = wp.float32(0.0)
        for j in wp.hash_grid_query(grid, x, reach):
            away = x - position[j]
            r2 = wp.dot(away, away)
            if r2 < c.h * c.h:
                q = wp.sqrt(r2) * c.inverse
                a = 1.0 - q
                a = a * a
                rho += mass[j] * c.value * (a * a * (1.0 + 4.0 * q))
        density[i] = rho
        ratio = rho / c.density
        pressure[i] = wp.max(c.stiffness * (ratio - 1.0) + c.balance * ratio * ratio, c.lowest)

    @wp.kernel
    def accelerate(
        grid: wp.uint64, position: wp.array(dtype=wp.vec3), velocity: wp.array(dtype=wp.vec3),
        mass: wp.array(dtype=float), density: wp.array(dtype=float), pressure: wp.array(dtype=float), c: Coefficients,
        reach: float, acceleration: wp.array(dtype=wp.vec3),
    ) -> None:  # fmt: skip
        i = wp.hash_grid_point_id(grid, wp.tid())
        x = position[i]
        v = velocity[i]
        pressure_i = pressure[i]
        force = wp.vec3(0.0, 0.0, 0.0)
        cohesion = wp.vec3(0.0, 0.0, 0.0)
        for j in wp.hash_grid_query(grid, x, reach):
            away = x - position[j]
            r2 = wp.dot(away, away)
            if r2 < c.h * c.h and j != i:
                r = wp.sqrt(r2)
                apart = r + 1.0e-9 * c.h
                q = r * c.inverse
                a = 1.0 - q
                m = mass[j]
                volume = m / (density[j] * apart)
                push = c.share * volume * (pressure_i + pressure[j]) * (c.slope * (20.0 * q * a * a * a))
                force += push * away
                force += (c.viscosity * volume * apart * (c.laplacian * a)) * (velocity[j] - v)
                shape = c.repulsion * poly6(q * c.stretch) - c.attraction * poly6(q)
                cohesion += (m * (c.amplitude * shape) / apart) * away
        acceleration[i] = force / density[i] + cohesion

    @wp.kernel
    def move(
        acceleration: wp.array(dtype=wp.vec3), kick: float, step: float, velocity: wp.array(dtype=wp.vec3),
        position: wp.array(dtype=wp.vec3),
    ) -> None:  # fmt: skip
        i = wp.tid()
        v = velocity[i] + kick * acceleration[i]
        velocity[i] = v
        position[i] = position[i] + step * v

    return Coefficients, density_and_pressure, accelerate, move


def work(
    position: np.ndarray, velocity: np.ndarray, mass: np.ndarray, coefficients: Mapping[str, float], spacing: float,
    step: float, skin: float, warm: int, steps: int, every: int, device: str, accelerations: bool,
    busy: float,
) -> dict[str, Any]:  # fmt: skip
    """Time the steps in this process."""
    import warp as wp

    wp.config.quiet = True
    wp.init()
    structure, density_and_pressure, accelerate, move = programs()
    wp.set_device(device)
    on_gpu = wp.get_device(device).is_cuda
    c = structure()
    for name, value in coefficients.items():
        setattr(c, name, value)
    n, h = len(position), coefficients["h"]
    x, v = wp.array(position, dtype=wp.vec3), wp.array(velocity, dtype=wp.vec3)
    m, rho, p = wp.array(mass, dtype=float), wp.zeros(n, dtype=float), wp.zeros(n, dtype=float)
    a = wp.zeros(n, dtype=wp.vec3)
    cells = math.ceil(1.8 * np.ptp(position, axis=0).max() / h) + 2  # a cube fits that turns about an axis
    grid = wp.HashGrid(cells, cells, cells)
    grid.reserve(n)

    def forces(reach: float) -> None:
        wp.launch(density_and_pressure, n, inputs=[grid.id, x, m, c, reach], outputs=[rho, p])
        wp.launch(accelerate, n, inputs=[grid.id, x, v, m, rho, p, c, reach], outputs=[a])

    def one(build: bool, reach: float, kick: float = step) -> None:
        if build:
            grid.build(x, reach)
        forces(reach)
        wp.launch(move, n, inputs=[a, kick, step], outputs=[v, x])

    def start() -> None:
        x.assign(position)
        v.assign(velocity)
        grid.build(x, h)
        forces(h)

    def timed(renew: Callable[[], None], keep: Callable[[], None], serves: int) -> float:
        """Mean seconds of a step; the state is that of the start before."""
        start()
        until = time.perf_counter() + busy
        while time.perf_counter() < until:
            forces(h)
            wp.synchronize()
        one(True, h, 0.5 * step)
        for k in range(warm + steps):
            if k == warm:
                wp.synchronize()
                began = time.perf_counter()
            (keep if k % serves else renew)()
        wp.synchronize()
        return (time.perf_counter() - began) / steps

    start()
    answer = {"acceleration": a.numpy().copy()} if accelerations else {}
    wide = h + skin
    ways = {"each step": (h, 1), "with skin": (wide, every)}
    seconds = {
        name: timed(lambda r=reach: one(True, r), lambda r=reach: one(False, r), serves)
        for name, (reach, serves) in reversed(ways.items())
    }  # "each step" last: its state is compared with refsim's
    speed = float(np.sqrt((v.numpy().astype(float) ** 2).sum(1).mean()))
    centre = x.numpy().astype(float).mean(0).tolist()
    recorded = on_gpu and n <= RECORDED
    why = "" if recorded else f"steps recorded for at most {RECORDED:,} particles" if on_gpu else "not on a GPU"
    if recorded:
        try:
            for name, (reach, serves) in ways.items():
                graphs = []
                for build in (True, False):
                    with wp.ScopedCapture() as capture:
                        one(build, reach)
                    graphs.append(capture.graph)
                renew, keep = (lambda g=graph: wp.capture_launch(g) for graph in graphs)
                seconds[f"{name}, graph"] = timed(renew, keep, serves)
        except Exception as error:  # of any kind: what cannot be recorded is launched one by one
            why = f"{type(error).__name__}: {error}".splitlines()[0][:200]
    return {
        **answer, "particles": n, "seconds": seconds, "speed": speed, "centre": centre, "graph": why,
        "device": str(wp.get_device(device).name),
    }  # fmt: skip
