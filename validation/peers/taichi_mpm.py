"""Plain MLS-MPM liquid in Taichi: in a process of its own.

Equal work to refsim's plain liquid: APIC with quadratic B-splines in space, float32, weakly compressible stress with
the factor J, J <- J (1 + dt tr A), gravity, separating walls. Written as Taichi's own examples are: a dense grid and a
parallel loop over particles with atomic additions. The state at the end is returned with the time, so that it can be
checked that both computed the same.
"""

import time
from typing import Any

import numpy as np

from validation.peers import launch


def run(block: dict[str, Any], threads: int, arch: str = "cpu") -> dict[str, Any]:
    """Time the steps of a block of liquid: {"particles", "seconds" (mean step), "centre", "speed", "ratio",
    "version"} or {"missing"}.

    block  "cells" (of the cube of liquid along an axis), "room" (cells of the box), "spacing" [m], "density",
           "bulk_modulus" [Pa], "gravity" [m/s^2, along y], "step" [s], "steps", "warm" (steps that are not counted),
           "order" (of the particles in memory, see `places`; "lattice" if left out)
    """
    given = {**block, "threads": threads, "arch": arch}
    return launch("taichi_mpm", given, {"TI_LOG_LEVEL": "error"})


def places(cells: int, spacing: float, order: str) -> np.ndarray:
    """Particles (n, 3) [m] of a cube of liquid with a corner at the origin, eight to a cell.

    order  in which they stand in memory: "lattice" (along rows of the lattice), "cells" (the eight of a cell together)
           or "random" (as in programs that draw their particles by lot and never sort them)
    """
    if order == "cells":
        cell = np.stack(np.meshgrid(*3 * [np.arange(cells)], indexing="ij"), axis=-1).reshape(-1, 1, 3)
        at = np.stack(np.meshgrid(*3 * [np.arange(2)], indexing="ij"), axis=-1).reshape(1, -1, 3)
        lattice = (2 * cell + at).reshape(-1, 3)
    else:
        lattice = np.stack(np.meshgrid(*3 * [np.arange(2 * cells)], indexing="ij"), axis=-1).reshape(-1, 3)
    if order == "random":
        lattice = np.random.default_rng(1).permutation(lattice)
    return (lattice + 0.5) * spacing


def work(**spec: Any) -> dict[str, Any]:
    """Time the steps in this process."""
    import taichi as ti

    ti.init(
        arch=getattr(ti, spec["arch"]), cpu_max_num_threads=spec["threads"], default_fp=ti.f32, log_level=ti.ERROR,
        random_seed=1, device_memory_GB=float(spec.get("memory", 8)),
    )  # fmt: skip
    cells, room, spacing = spec["cells"], spec["room"], spec["spacing"]
    h = 2 * spacing
    n, nodes = (2 * cells) ** 3, room + 6
    density, modulus, gravity, dt = spec["density"], spec["bulk_modulus"], spec["gravity"], spec["step"]
    mass, volume, low, high = density * spacing**3, spacing**3, 3, room + 3
    x, v = ti.Vector.field(3, ti.f32, n), ti.Vector.field(3, ti.f32, n)
    a, ratio = ti.Matrix.field(3, 3, ti.f32, n), ti.field(ti.f32, n)
    node_v, node_m = ti.Vector.field(3, ti.f32, (nodes,) * 3), ti.field(ti.f32, (nodes,) * 3)

    @ti.kernel
    def particle_to_grid():  # noqa: ANN202  (Taichi reads annotations)
        for p in x:
            place = x[p] / h
            base = (place - 0.5).cast(int)
            f = place - base
            w = [0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2]
            pressed = dt * 4.0 / (h * h) * volume * modulus * (ratio[p] - 1.0) * ratio[p]
            affine = mass * a[p] - pressed * ti.Matrix.identity(ti.f32, 3)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                offset = ti.Vector([i, j, k])
                arm = (offset.cast(float) - f) * h
                weight = w[i][0] * w[j][1] * w[k][2]
                node_v[base + offset] += weight * (mass * v[p] + affine @ arm)
                node_m[base + offset] += weight * mass

    @ti.kernel
    def clear():  # noqa: ANN202  (Taichi reads annotations)
        for j in ti.grouped(node_m):
            node_v[j] = ti.zero(node_v[j])
            node_m[j] = 0.0

    @ti.kernel
    def update():  # noqa: ANN202  (Taichi reads annotations)
        for j in ti.grouped(node_m):
            if node_m[j] > 0.0:
                new = node_v[j] / node_m[j]
                new[1] += dt * gravity
                for c in ti.static(range(3)):
                    if j[c] <= low and new[c] < 0.0:
                        new[c] = 0.0
                    if j[c] >= high and new[c] > 0.0:
                        new[c] = 0.0
                node_v[j] = new

    @ti.kernel
    def grid_to_particle():  # noqa: ANN202  (Taichi reads annotations)
        for p in x:
            place = x[p] / h
            base = (place - 0.5).cast(int)
            f = place - base
            w = [0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2]
            new, affine = ti.zero(v[p]), ti.zero(a[p])
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                offset = ti.Vector([i, j, k])
                arm = (offset.cast(float) - f) * h
                weight = w[i][0] * w[j][1] * w[k][2]
                node = node_v[base + offset]
                new += weight * node
                affine += 4.0 / (h * h) * weight * node.outer_product(arm)
            v[p], a[p] = new, affine
            ratio[p] *= 1.0 + dt * affine.trace()
            x[p] += dt * new

    start = places(cells, spacing, spec.get("order", "lattice")) + low * h
    x.from_numpy(start.astype(np.float32))
    ratio.fill(1.0)
    spent = []
    for _ in range(spec["warm"] + spec["steps"]):
        ti.sync()
        began = time.perf_counter()
        clear()
        particle_to_grid()
        update()
        grid_to_particle()
        ti.sync()
        spent.append(time.perf_counter() - began)
    place, velocity = x.to_numpy().astype(float) - low * h, v.to_numpy().astype(float)
    return {
        "particles": n, "seconds": float(np.mean(spent[spec["warm"] :])), "centre": place.mean(0).tolist(),
        "speed": float(np.sqrt((velocity**2).sum(1).mean())), "ratio": float(ratio.to_numpy().astype(float).std()),
    }  # fmt: skip
