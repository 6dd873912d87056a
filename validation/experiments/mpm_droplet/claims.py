"""What the thesis claims of its transfers and its embedding (chapter 4)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import spsolve

from refsim import Box, MpmLiquid, MpmWalls, Scene
from refsim.core.operation import REGISTRY
from refsim.mpm import READINGS
from refsim.sparse_grid.reference import node_table
from validation.experiment import Family, Measure, Options, Results, Run, alike
from validation.experiments.mpm_droplet.stability import STEPS
from validation.metrics.mpm import CELL, DENSITY, MODULUS, Transfers, round_trip
from validation.results import Result, real
from validation.running import Context

SEEDS = (1, 2, 3, 4, 5)
SIZES = (6, 7, 8, 9, 10)  # cells along the edge of a block
LIQUIDS_COMPARED = ("square, lambda 1000, k 1", "square, lambda 10,000, k 1", "cube, lambda 1000, k 1")
ROOMS = (12, 14, 16, 20, 24)  # cells along the edge of a box full of liquid
STRIDE = 0.3 * CELL / math.sqrt(MODULUS / DENSITY)  # s: the runner's own step for a liquid at rest


def momentum(context: Context, seed: int) -> Result:
    """Momentum there and back, by the four readings of the embedding."""
    return Result({name: round_trip(name, seed=seed)["momentum"] for name in READINGS})


def vortices(context: Context, cells: int, affine: bool, backend: str, until: float = 0.4) -> Result:
    """Rate at which four vortices in a box full of liquid without viscosity lose their energy [1/s].

    With affine matrices (APIC), or without (PIC): then they are set to zero before every step.
    """
    h = 1 / cells
    scene = Scene(
        spacing=h / 2, support_radius=1.5 * h, dim=2, dtype="float64", fluid=(Box(cells=(2 * cells, 2 * cells, 1)),),
        effects=(
            MpmLiquid(rest_density=1.0, bulk_modulus=100.0),
            MpmWalls(lower=(0, 0, 0), upper=(1, 1, 0), rule="slip"),
        ),
    )  # fmt: skip
    run = context.simulation(scene, backend)
    x, mass = 2 * math.pi * run.field("position"), run.field("mass")
    velocity = np.zeros_like(x)
    velocity[:, 0] = np.sin(x[:, 0]) * np.cos(x[:, 1])
    velocity[:, 1] = -np.cos(x[:, 0]) * np.sin(x[:, 1])
    slope = np.zeros((len(x), 3, 3))
    slope[:, 0, 0] = 2 * math.pi * np.cos(x[:, 0]) * np.cos(x[:, 1])
    slope[:, 0, 1] = -2 * math.pi * np.sin(x[:, 0]) * np.sin(x[:, 1])
    slope[:, 1, 0], slope[:, 1, 1] = -slope[:, 0, 1], -slope[:, 0, 0]
    order = run._host("identity")
    run._set("velocity", velocity[order])
    run._set("affine", slope.reshape(-1, 9)[order])
    energy = [0.5 * float(mass @ (velocity**2).sum(1))]
    while run.time < until:
        if not affine:
            run.backend.assign(run.fields["affine"], 0.0)
        run.step()
        context.progress(run.time / until)
    energy.append(0.5 * float(mass @ (run.field("velocity") ** 2).sum(1)))
    return Result({"rate": math.log(energy[0] / energy[1]) / run.time, "steps": run.steps})


def breathing(context: Context, cells: int, implicit: bool, periods: float = 2.0) -> Result:
    """Energy that a square block, let go at 0.98 of its volume, has lost after its sound has gone back and forth twice.

    Both schemes have the same transfers and steps. Backward Euler: the grid's velocities minimise
    sum m_j |v_j - v*_j|^2/2 + sum V0 lambda (J (1 + dt tr A_p(v)) - 1)^2/2, which is quadratic in them.
    """
    axis = 0.5 * CELL * (np.arange(2 * cells) + 0.5)
    place = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2) + 0.03
    n = len(place)
    mass = np.full(n, DENSITY * (0.5 * CELL) ** 2)
    state: dict[str, Any] = {
        "position": np.pad(place, ((0, 0), (0, 1))), "velocity": np.zeros((n, 3)), "affine": np.zeros((n, 9)),
        "volume_ratio": np.full(n, 0.98),
    }  # fmt: skip

    def energy() -> float:
        bulk = 0.5 * MODULUS * (mass / DENSITY) @ (state["volume_ratio"] - 1) ** 2
        return float(0.5 * mass @ (state["velocity"] ** 2).sum(1) + bulk)

    start = energy()
    steps = round(periods * 2 * cells * CELL / math.sqrt(MODULUS / DENSITY) / STRIDE)
    for k in range(steps):
        ratio = state["volume_ratio"].copy()
        pressed = ratio if not implicit else np.ones(n)
        t = Transfers(
            state["position"], state["velocity"], state["affine"], ratio=pressed, mass=mass, step=STRIDE, dim=2
        )
        t.to_grid()
        if implicit:
            t.run("mpm.grid_update")
            v = t.values["node_velocity"]
            heavy = np.flatnonzero(t.values["node_mass"] > 1e-12 * mass[0])
            v[heavy, :2] = backward_euler(t, ratio, heavy)
            t.values["volume_ratio"][:] = ratio
            t.run("mpm.grid_to_particle")
        else:
            t.back()
        for name in state:
            state[name] = t.values[name]
        context.progress((k + 1) / steps)
    return Result({"lost": 1 - energy() / start, "steps": steps})


def backward_euler(t: Transfers, ratio: np.ndarray, heavy: np.ndarray) -> np.ndarray:
    """Velocities (m, 2) [m/s] of the nodes `heavy` after an implicit step; `t` holds those without pressure."""
    n, table = len(ratio), node_table(t.values["grid"].blocks)
    base, weight, slope = np.zeros((n, 3), np.int32), np.zeros((n, 9)), np.zeros((n, 9))
    REGISTRY["mpm.weights"].program("cpu")(t.values["position"], t.values["background"], base, weight, slope)
    number = {(int(x), int(y)): k for k, (x, y, _) in enumerate(table[heavy])}
    rows, columns, entries = [], [], []
    for i in range(3):
        for j in range(3):
            node = np.array([number.get((int(a) + i, int(b) + j), -1) for a, b, _ in base])
            there = node >= 0
            arm = CELL * (base[:, :2] + [i, j]) - t.values["position"][:, :2]
            for c in range(2):  # tr A_p = (4/h^2) sum_j B_j (x_j - x_p).v_j
                rows.append(np.flatnonzero(there))
                columns.append(2 * node[there] + c)
                entries.append((4 / CELL**2 * weight[:, i] * weight[:, 3 + j] * arm[:, c])[there])
    trace = csr_array(
        (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=(n, 2 * len(heavy))
    )
    inertia = np.repeat(t.values["node_mass"][heavy], 2)
    volume = t.mass / DENSITY
    stiffness = trace.T @ diags_array(t.step**2 * volume * MODULUS * ratio**2) @ trace
    push = t.step * trace.T @ (volume * MODULUS * (1 - ratio) * ratio)
    known = inertia * t.values["node_velocity"][heavy, :2].ravel() + push
    return spsolve((diags_array(inertia) + stiffness).tocsc(), known).reshape(-1, 2)


def _momenta(options: Options) -> list[Run]:
    return [Run(f"claim_momentum_{seed}", momentum, {"seed": seed}, estimate=3.0) for seed in SEEDS]


def _vortices(options: Options) -> list[Run]:
    return [
        Run(
            f"claim_vortices_{cells}_{'apic' if affine else 'pic'}", vortices,
            {"cells": cells, "affine": affine, "backend": options.backend}, estimate=4.0,
        )
        for cells in ROOMS
        for affine in (True, False)
    ]  # fmt: skip


def _blocks(options: Options) -> list[Run]:
    return [
        Run(
            f"claim_breathing_{cells}_{'implicit' if implicit else 'explicit'}", breathing,
            {"cells": cells, "implicit": implicit}, estimate=6.0,
        )
        for cells in SIZES
        for implicit in (False, True)
    ]  # fmt: skip


def _steps(row: str) -> Callable[[Options], list[Run]]:
    """Cells of the stability map, so that they are computed once: without embedding, and with it."""

    def runs(options: Options) -> list[Run]:
        cells = {(cell.row, cell.column): cell for cell in STEPS.cells}
        chosen = [cells[each, column] for column in LIQUIDS_COMPARED for each in ("none, no inset", row)]
        return [
            Run(f"{STEPS.name}.{c.key}", c.function, {**c.parameters, "backend": options.backend}, estimate=c.seconds)
            for c in chosen
        ]

    return runs


def _each(name: str) -> Callable[[Results], list[float]]:
    return lambda results: [real(result.values[name]) for result in results.values()]


def _pairs(name: str) -> Callable[[Results], list[float]]:
    """The second over the first of every two runs."""

    def values(results: Results) -> list[float]:
        found = [real(result.values[name]) for result in results.values()]
        return [b / a if a else math.inf for a, b in zip(found[::2], found[1::2], strict=True)]

    return values


MPM_MOMENTUM_NONE = Measure(_momenta, _each("none"))
MPM_MOMENTUM_CLUSTER = Measure(_momenta, _each("cluster"))
MPM_MOMENTUM_THESIS = Measure(_momenta, _each("thesis"))
MPM_MOMENTUM_GRADIENT_CORRECTED = Measure(_momenta, _each("gradient_corrected"))
MPM_PIC_IS_VISCOUS = Measure(_vortices, _pairs("rate"))
MPM_EXPLICIT_KEEPS_ENERGY = Measure(_blocks, _pairs("lost"))
MPM_CLUSTER_STEADIES = Measure(_steps("cluster, no inset"), _pairs("largest"), quick=False)
MPM_THESIS_STEADIES = Measure(_steps("thesis (4.14), no inset"), _pairs("largest"), quick=False)


def _fails(measure: Measure) -> list[float]:
    """The printed embedding, in the place of any other."""
    found = momentum(Context(), SEEDS[0]).values["thesis"]
    return measure.of({"": dict.fromkeys(READINGS, found)})


FAMILIES = (
    Family(
        tuple(f"mpm_momentum_{name}" for name in ("none", "cluster", "thesis", "gradient_corrected")),
        "Momentum could be lost between particles and grid.", "the embedding as printed, which loses it", _fails,
    ),
    Family(
        ("mpm_pic_is_viscous",), "Vortices could last as long without affine matrices.", "both lose energy alike",
        alike({"rate": 0.5}),
    ),
    Family(
        ("mpm_explicit_keeps_energy",), "An implicit step could lose as little energy.", "both lose energy alike",
        alike({"lost": 0.1}),
    ),
    Family(
        ("mpm_cluster_steadies", "mpm_thesis_steadies"),
        "Embedded points could leave the largest stable step as it is.",
        "the same largest step", alike({"largest": 0.01}),
    ),
)  # fmt: skip
