"""Runs of melting: the figures' scenes stage by stage, what is conserved, what a step costs, how regions fill."""

from __future__ import annotations

import math
import os
import time
from typing import Any

import msgspec
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from refsim import (
    Box,
    HeatConduction,
    Melting,
    Scene,
    ShapeMatching,
    Simulation,
    SolidBall,
    SolidBox,
    TwoWayCoupling,
    WeaklyCompressible,
)
from refsim.core.operation import REGISTRY
from refsim.melting import MeltingRule
from refsim.scene.solids import lattice_of
from refsim.shape_matching.phases import EMPTY, FLUID, INTERIOR, SURFACE
from validation.experiments.melting import rival as rival_search
from validation.experiments.melting.scene import (
    FIGURES,
    HALF_WIDTH,
    SOUND,
    SPACING,
    STEP,
    SUPPORT,
    VISCOSITY,
    made,
    scene_of,
    shared_tank,
)
from validation.results import Result
from validation.running import Context, first_call_seconds, momenta, search_log, stage_seconds

PAPER = {"figure_4": ("35k + 5k", 22.5), "figure_5": ("48.5k + 12k", 35.7), "figure_6": ("40.5k + 20k", 42.3)}  # ms
ON_GPU = (*PAPER, "million")
SOLID_SHARES = (0.0, 0.2, 0.4, 0.6)  # of the particles of one tank
WIDTHS = (1, 2, 3, 4)  # half-widths w of a region
EVERY = 10  # steps between two entries of a series
LARGEST_TEMPERATURE = 250  # as a byte in steps of half a degree, from -25 deg C


class Watch:
    """Counts what melts, and the greatest speed, from step to step."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.solid = self._phase() != FLUID
        self.phase = self._phase()
        self.inside_melted = 0  # particles that melted without having been at a surface
        self.together = 0  # most that melted in one step
        self.fastest = 0.0  # [m/s] since the last entry of the series
        self.series: dict[str, list[float]] = {}

    def _phase(self) -> np.ndarray:
        return self.simulation.field("phase")

    def after_step(self) -> None:
        """Compare with the step before."""
        now = self._phase()
        melted = (self.phase != FLUID) & (now == FLUID)
        self.inside_melted += int((self.phase[melted] != SURFACE).sum())
        self.together = max(self.together, int(melted.sum()))
        self.phase = now
        self.fastest = max(self.fastest, float(np.linalg.norm(self.simulation.field("velocity"), axis=1).max()))

    def note(self) -> dict[str, float]:
        """An entry of the series."""
        s = self.simulation
        field = {name: s.field(name).astype(float) for name in ("mass", "rest_density", "density", "temperature")}
        row = {
            "time": s.time,
            "solid": int((self.phase != FLUID).sum()),
            "inside": int((self.phase == INTERIOR).sum()),
            "fragments": fragments(s.field("direct")),
            "mass": float(field["mass"].sum()),
            "rest_volume": float((field["mass"] / field["rest_density"]).sum()),
            "fastest": self.fastest,
            "densest": float((field["density"] / field["rest_density"]).max()),
            "coldest": float(field["temperature"].min()),
            "hottest": float(field["temperature"].max()),
        }
        for name, value in row.items():
            self.series.setdefault(name, []).append(value)
        self.fastest = 0.0
        return row


def fragments(direct: np.ndarray) -> int:
    """Pieces of solid that are connected over direct neighbours."""
    node, slot = np.nonzero(direct != EMPTY)
    if not len(node):
        return 0
    there = np.unique(node)
    graph = coo_array((np.ones(len(node)), (node, direct[node, slot])), shape=(len(direct),) * 2)
    _, label = connected_components(graph, directed=False)
    return len(np.unique(label[there]))


def melt(
    context: Context, figure: str, size: float, backend: str, shares: list[float], until: float, **options: Any
) -> Result:
    """A figure's scene until `until` [s]: frames at the start and when the share of solid has fallen to `shares`."""
    setting = FIGURES[figure](size)
    simulation = context.simulation(scene_of(figure, size, **options), backend)
    watch = Watch(simulation)
    arrays: dict[str, np.ndarray] = {}
    times: list[float] = []
    whole = int(watch.solid.sum())
    waiting = sorted(shares, reverse=True)
    frame(simulation, arrays, times)
    watch.note()
    while simulation.time < until - 1e-9:
        simulation.step()
        watch.after_step()
        left = int((watch.phase != FLUID).sum())
        if simulation.steps % EVERY == 0:
            watch.note()
            context.progress(max(simulation.time / until, 1 - left / whole))
        if waiting and left <= waiting[0] * whole:
            while waiting and left <= waiting[0] * whole:
                waiting.pop(0)
            frame(simulation, arrays, times)
            if not waiting:
                break
    watch.note()
    bodies = np.diff(simulation.plan.grid.solids.lattice.first)
    values = {
        "figure": figure, "size": size, "options": options, "particles": simulation.count, "solids": bodies,
        "tank": [SPACING * c for c in setting.tank], "colours": [colour for colour, *_ in setting.bodies],
        "densities": [density for _, density, *_ in setting.bodies],
        "temperatures": [setting.solid_temperature, setting.water_temperature],
        "bookkeeping": setting.bookkeeping, "times": times, "series": watch.series, "steps": simulation.steps,
        "inside_melted": watch.inside_melted, "together": watch.together,
        "stages": stage_seconds(simulation), "first_calls": first_call_seconds(simulation),
        "search": search_log(simulation),
    }  # fmt: skip
    return Result(values, arrays)


def frame(simulation: Simulation, arrays: dict[str, np.ndarray], times: list[float]) -> None:
    """Keep positions [cm], temperatures [half degrees from -25] and what is solid."""
    k = len(times)
    times.append(simulation.time)
    arrays[f"position_{k}"] = np.rint(100 * simulation.field("position")).astype(np.int16)
    degrees = np.rint(2 * (simulation.field("temperature") + 25))
    arrays[f"temperature_{k}"] = np.clip(degrees, 0, LARGEST_TEMPERATURE).astype(np.uint8)
    arrays[f"solid_{k}"] = (simulation.field("phase") != FLUID).astype(np.uint8)


# Numbers


def free_lattice(context: Context, backend: str, steps: int, summation: str = "gather", half_width: int = 2) -> Result:
    """A free lattice that flies and spins, in float64: how its momenta and its shape change over the steps."""
    body = SolidBox(lower=(0, 0, 0), upper=(0.8, 0.6, 0.6), velocity=(1.0, 0.0, 0.0), spin=(0.0, 1.0, 3.0))
    effects = (ShapeMatching(half_width=half_width, summation=summation),)
    scene = Scene(
        spacing=SPACING, support_radius=SUPPORT, fluid=(), solid=(body,), effects=effects, step=STEP, dtype="float64"
    )
    simulation = context.simulation(scene, backend)
    start, shape = momenta(simulation), pdist(simulation.field("position"))
    most = {"momentum": 0.0, "angular_momentum": 0.0}
    change = 0.0
    for k in range(steps):
        simulation.step()
        if (k + 1) % (steps // 20) == 0:
            now = momenta(simulation)
            for name in most:
                gap = np.linalg.norm(now[name] - start[name]) / np.linalg.norm(start[name])
                most[name] = max(most[name], float(gap))
            change = max(change, float(np.abs(pdist(simulation.field("position")) - shape).max()))
            context.progress((k + 1) / steps)
    turns = steps * STEP * float(np.linalg.norm(body.spin)) / (2 * np.pi)
    return Result({**most, "shape": change / SPACING, "steps": steps, "turns": turns, "nodes": simulation.count})


def region_rounds(context: Context, half_width: int, rounds: int = 200, side: int = 6) -> Result:
    """Random particles of two bodies that touch melt, round by round: regions against a search over their graph.

    SciPy's shortest paths on the graph of one body's cells nearer than 1.8 cells are the reference.
    """
    random = np.random.default_rng(half_width)
    cells = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cut = int(0.55 * len(cells))
    lattice = lattice_of([cells[:cut], cells[cut:]])
    nodes = len(cells)
    identity, phase = np.arange(nodes, dtype=np.int32), np.full(nodes, SURFACE, np.int32)
    direct, region = np.empty((nodes, 27), np.int32), np.empty((nodes, (2 * half_width + 1) ** 3), np.int32)
    count, melted, number, rebuild = (np.zeros(n, np.int32) for n in (nodes, nodes, 1, nodes))
    program = {name: REGISTRY[name].program("cpu") for name in (
        "shape_matching.direct_neighbours", "shape_matching.regions", "shape_matching.classify", "melting.melt",
        "melting.detach",
    )}  # fmt: skip
    program["shape_matching.direct_neighbours"](phase, identity, lattice, direct)
    program["shape_matching.regions"](direct, None, lattice, region, count)
    pairs = cKDTree(lattice.cell).query_pairs(1.8, output_type="ndarray")
    pairs = pairs[lattice.body[pairs[:, 0]] == lattice.body[pairs[:, 1]]]
    rule, ones = MeltingRule(np.int32(0), 1000.0, 1.0, 0.6, 4186.0), np.ones(nodes)
    wrong = compared = rebuilt = 0
    for k in range(rounds):
        solid = np.flatnonzero(phase != FLUID)
        chosen = random.choice(solid, min(len(solid), 1), replace=False)
        temperature = np.full(nodes, -1.0)
        temperature[chosen] = 1.0
        phase[solid] = SURFACE  # so that any may melt, not only what lies outside
        program["melting.melt"](
            identity, temperature, None, 0 * ones, None, rule, melted, number, ones, ones.copy(), None, None, phase
        )
        program["melting.detach"](melted, number, region, direct, rebuild)
        program["shape_matching.regions"](direct, rebuild, lattice, region, count)
        program["shape_matching.classify"](identity, direct, phase)
        there = phase != FLUID
        kept = pairs[there[pairs].all(1)]
        graph = coo_array((np.ones(len(kept)), kept.T), shape=(nodes, nodes))
        steps = dijkstra(graph.tocsr(), directed=False, unweighted=True, limit=half_width)
        wanted = np.isfinite(steps) & there[:, None] & there[None, :]
        found = np.zeros((nodes, nodes), bool)
        row, slot = np.nonzero(region != EMPTY)
        found[row, region[row, slot]] = True
        wrong += int((found != wanted).any(1).sum()) + int((count != wanted.sum(1)).sum())
        compared += int(there.sum())
        rebuilt += int(rebuild.sum())
        context.progress((k + 1) / rounds)
    values = {"wrong": wrong, "compared": compared, "rebuilt": rebuilt, "rounds": rounds, "half_width": half_width}
    return Result({**values, "left": int((phase != FLUID).sum())})


def conserved(context: Context, backend: str, dtype: str, bookkeeping: str, steps: int) -> Result:
    """A warm block of water and an ice ball that flies into it, without gravity and walls: what is conserved.

    The conductivity is taken in W/(m K) (without Shao & Song M11), so that the scheme conserves sum m c T.
    """
    ball = SolidBall(center=(1.0, 1.0, 1.9), radius=0.6, density=917.0, velocity=(0.0, 0.0, -2.0))
    diffusivity = 0.3
    heat = HeatConduction(
        temperature=(-10.0, 40.0), conductivity=diffusivity * 1000 * 4186, heat_capacity=4186.0, melting_point=0.0,
    )  # fmt: skip
    effects = (
        WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=VISCOSITY, state="tait", kernels="cubic_spline"),
        ShapeMatching(half_width=HALF_WIDTH),
        TwoWayCoupling(),
        heat,
        Melting(bookkeeping=bookkeeping),
    )
    scene = Scene(
        spacing=SPACING, support_radius=SUPPORT, fluid=(Box(cells=(10, 10, 6)),), solid=(ball,), effects=effects,
        step=0.004, dtype=dtype,
    )  # fmt: skip
    simulation = context.simulation(scene, backend)

    def ledger() -> dict[str, float]:
        mass, c, t, rho = (
            simulation.field(name).astype(float) for name in ("mass", "heat_capacity", "temperature", "rest_density")
        )
        return {
            "heat": math.fsum(mass * c * t), "heat_scale": math.fsum(mass * c * np.abs(t)), "mass": math.fsum(mass),
            "volume": math.fsum(mass / rho),
        }  # fmt: skip

    start, first = ledger(), momenta(simulation)
    nodes = int(np.diff(simulation.plan.grid.solids.lattice.first).sum())
    drift = moved = 0.0
    mass = simulation.field("mass").astype(float)
    one = {"ice": float(mass[0]), "water": float(mass[-1])}
    for k in range(steps):
        simulation.step()
        if k % 25 == 24:
            now, flow = ledger(), momenta(simulation)
            drift = max(drift, abs(now["heat"] - start["heat"]) / start["heat_scale"])
            scale = max(first["momentum_scale"], flow["momentum_scale"])
            moved = max(moved, float(np.linalg.norm(flow["momentum"] - first["momentum"])) / scale)
            context.progress((k + 1) / steps)
    melted = int((simulation.field("phase")[:nodes] == FLUID).sum())
    expected = melted * (one["water"] - one["ice"]) if bookkeeping == "water" else 0.0
    return Result(
        {
            "heat_drift": drift, "momentum": moved, "melted": melted, "nodes": nodes, "steps": steps,
            "mass_change": (now["mass"] - start["mass"]) / start["mass"],
            "mass_unexplained": abs(now["mass"] - start["mass"] - expected) / start["mass"],
            "volume_change": abs(now["volume"] - start["volume"]) / start["volume"],
        }
    )  # fmt: skip


# Time


def step_cost(
    context: Context, figure: str, size: float, backend: str, threads: int | None, warm: int, rounds: int, steps: int,
    rival: bool = False, solid_share: float = -1.0, **options: Any,
) -> Result:  # fmt: skip
    """Seconds a step of a figure's scene, stage by stage: `rounds` times `steps` steps after `warm` ones.

    rival        explicit heat, and every region searched anew in every step (see `rival`)
    solid_share  where not negative, a tank of as many particles with this share of solid instead of the figure
    """
    if rival:
        options = {"scheme": "explicit", **options}
    if solid_share >= 0:
        scene = made(shared_tank(figure, size, solid_share), figure, **options)
    else:
        scene = scene_of(figure, size, **options)
    simulation = context.simulation(scene, backend, threads)
    for _ in range(max(warm, 2)):
        simulation.step()
    if rival:
        search = rival_search.RegionSearch(simulation)
        search()  # compiles
    whole, searching = [], 0.0
    simulation.timings.stages.clear()
    for k in range(rounds):
        began = time.perf_counter()
        for _ in range(steps):
            simulation.step()
            if rival:
                at = time.perf_counter()
                search()
                searching += time.perf_counter() - at
        whole.append((time.perf_counter() - began) / steps)
        context.progress((k + 1) / rounds)
    stages = {name: seconds / (rounds * steps) for name, seconds in stage_seconds(simulation).items()}
    if rival:
        stages["rival.all_regions"] = searching / (rounds * steps)
        for name in ("shape_matching.regions", "melting.detach"):
            saved = stages.pop(name, 0.0)
            whole = [seconds - saved for seconds in whole]
    bodies = int(np.diff(simulation.plan.grid.solids.lattice.first).sum())
    return Result(
        {
            "figure": figure, "liquid": simulation.count - bodies, "solid": bodies, "seconds": float(np.median(whole)),
            "rounds": whole, "stages": stages, "step": scene.step, "half_width": options.get("half_width", HALF_WIDTH),
            "solid_left": int((simulation.field("phase") != FLUID).sum()), "search": search_log(simulation),
            "threads": threads or os.cpu_count(),
        }
    )  # fmt: skip


def savings(
    context: Context, backend: str, size: float, threads: int | None, warm: int = 100, rounds: int = 5, steps: int = 8
) -> Result:
    """Figure 4's scene with one effect after the other left out: seconds a step, by stage, and bytes of the arrays.

    `warm` steps pass first; from about the 80th on the cube melts.
    """
    whole = scene_of("figure_4", size)
    heat = next(effect for effect in whole.effects if isinstance(effect, HeatConduction))
    of_water = {name: getattr(heat, name)[-1] for name in ("temperature", "conductivity")}
    liquid = msgspec.structs.replace(heat, **of_water, melting_point=None)
    kinds: dict[str, Scene] = {"everything": whole}
    kinds["no melting"] = _without(whole, Melting)
    kinds["no melting, no heat"] = _without(whole, Melting, HeatConduction)
    solids = (Melting, TwoWayCoupling, ShapeMatching)
    bare = _without(msgspec.structs.replace(whole, solid=()), *solids, HeatConduction)
    kinds["no solids"] = msgspec.structs.replace(bare, effects=(*bare.effects, liquid))
    kinds["no solids, no heat"] = bare
    running = {words: context.simulation(scene, backend, threads) for words, scene in kinds.items()}
    taken: dict[str, list[float]] = {words: [] for words in kinds}
    for simulation in running.values():
        for _ in range(max(warm, 2)):
            simulation.step()
        simulation.timings.stages.clear()
    for k in range(rounds):  # in turns, so that a busy moment does not hit one of them alone
        for words, simulation in running.items():
            began = time.perf_counter()
            for _ in range(steps):
                simulation.step()
            taken[words].append((time.perf_counter() - began) / steps)
        context.progress((k + 1) / rounds)
    rows, nodes, ice = [], len(running["everything"].plan.grid.solids.lattice.key), whole.solid[0].density
    for words, simulation in running.items():
        size_of = sum(values.nbytes for values in simulation.fields.values())
        rows.append(
            {
                "scene": words, "particles": simulation.count, "seconds": float(np.median(taken[words])),
                "bytes": size_of, "operations": len(simulation.plan.passes) + len(simulation.plan.motion)
                + len(simulation.plan.begin),
                "stages": grouped({name: s / (rounds * steps) for name, s in stage_seconds(simulation).items()}),
                "melted": int((simulation.field("rest_density")[:nodes] != ice).sum()) if words == "everything" else 0,
            }
        )  # fmt: skip
    return Result({"rows": rows, "threads": threads or os.cpu_count()})


def _without(scene: Scene, *kinds: type) -> Scene:
    """The scene without effects of these kinds."""
    return msgspec.structs.replace(scene, effects=tuple(e for e in scene.effects if not isinstance(e, kinds)))


GROUPS = {
    "neighbour list": ("neighbours",),
    "liquid and coupling": ("two_way_coupling.", "sph."),
    "heat": ("heat.",),
    "melting": ("melting.", "shape_matching.regions", "shape_matching.classify", "rival."),
    "shape matching": ("shape_matching.",),
}


def grouped(stages: dict[str, float]) -> dict[str, float]:
    """Seconds of the paper's stages: every operation counts in the first group that names it."""
    total = dict.fromkeys(GROUPS, 0.0)
    for name, seconds in stages.items():
        for group, marks in GROUPS.items():
            if name.startswith(marks):
                total[group] += seconds
                break
    return total


# Half-width and summation


def stiffness(context: Context, backend: str, half_width: int, steps: int = 60) -> Result:
    """A bar that is bent by opposite kicks at its ends and in its middle: how far it bends, and what it costs.

    Stiffness is the kick over the largest bend [1/s]; for each summation the time of the four sums of a step, and
    how far positions end from those of plain gather, in float32 and, for gather, in float64.
    """
    rows, ends = [], {}
    for summation, dtype in (
        ("gather", "float64"),
        ("gather", "float32"),
        ("reduction", "float32"),
        ("fast", "float32"),
    ):
        body = SolidBox(lower=(0, 0, 0), upper=(4.0, 1.6, 1.6))
        scene = Scene(
            spacing=SPACING, support_radius=SUPPORT, fluid=(), solid=(body,), step=STEP, dtype=dtype,
            effects=(ShapeMatching(half_width=half_width, summation=summation, damping=0.1),),
        )  # fmt: skip
        simulation = context.simulation(scene, backend)
        x = simulation.field("position").astype(float)
        outer, inner = np.abs(x[:, 0] - 2.0) > 1.5, np.abs(x[:, 0] - 2.0) < 0.3
        kick = np.zeros_like(x)
        kick[:, 2] = np.where(np.abs(x[:, 0] - 2.0) > 1.0, 1.0, -1.0)
        simulation.backend.assign(simulation.fields["velocity"], kick.astype(dtype))
        bend = 0.0
        for k in range(steps):
            simulation.step()
            if k == 4:
                simulation.timings.stages.clear()
            z = simulation.field("position")[:, 2] - x[:, 2]
            bend = max(bend, abs(float(z[outer].mean() - z[inner].mean())))
        ends[summation, dtype] = simulation.field("position").astype(float)
        seconds = sum(
            s for name, s in stage_seconds(simulation).items()
            if name.rpartition(".")[2] in ("match", "pull", "region_motion", "damp")
        ) / (steps - 5)  # fmt: skip
        rows.append(
            {
                "summation": summation, "dtype": dtype, "bend": bend / SPACING, "stiffness": 2.0 / bend,
                "seconds": seconds, "nodes": simulation.count,
                "error": float(np.abs(ends[summation, dtype] - ends["gather", "float64"]).max()) / SPACING,
            }
        )  # fmt: skip
        context.progress(len(rows) / 4)
    return Result({"half_width": half_width, "rows": rows})


# Figure 3


def filling(context: Context, half_width: int = 2) -> Result:
    """arrayR of one node of a plate with a melted slit, pass by pass, as in figure 3: from the kernels' own tables."""
    cells = np.array([[a, b, 0] for b in range(7) for a in range(7)])
    gone = {(3, 2), (3, 3), (3, 4), (4, 4)}
    lattice = lattice_of([cells])
    nodes = len(cells)
    place = np.arange(nodes, dtype=np.int32)
    phase = np.array([FLUID if (int(a), int(b)) in gone else SURFACE for a, b, _ in lattice.cell], np.int32)
    direct = np.empty((nodes, 27), np.int32)
    REGISTRY["shape_matching.direct_neighbours"].program("cpu")(phase, place, lattice, direct)
    node = int(np.flatnonzero((lattice.cell == (2, 3, 0)).all(1))[0])
    passes = []
    for level in range(half_width + 1):  # pass p leaves the region of half-width p
        side = 2 * max(level, 1) + 1
        region, count = np.empty((nodes, side**3), np.int32), np.empty(nodes, np.int32)
        REGISTRY["shape_matching.regions"].program("cpu")(direct, None, lattice, region, count)
        plane = region[node].reshape(side, side, side)[:, :, side // 2]
        wide = np.full((2 * half_width + 1,) * 2, EMPTY)
        low = half_width - max(level, 1)
        wide[low : low + side, low : low + side] = plane
        if level == 0:
            own = wide[half_width, half_width]
            wide[:] = EMPTY
            wide[half_width, half_width] = own
        passes.append(wide)
    return Result(
        {"node": node, "cell": lattice.cell[node], "half_width": half_width, "gone": sorted(gone)},
        {"passes": np.array(passes), "cells": lattice.cell, "solid": (phase != FLUID).astype(np.uint8)},
    )
