"""Runs of melting: the figures' scenes stage by stage, what is conserved, what a step costs, how regions fill."""

import itertools
import math
import os
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.spatial.distance import pdist

import refsim
from refsim.backends.arrays import unavailable
from refsim.core.operation import REGISTRY
from refsim.scene.solids import lattice_of
from refsim.shape_matching.phases import EMPTY, FLUID, INTERIOR, SURFACE
from validation.checks import Checks
from validation.experiment import Experiment, Measure, Options, Results, RunSpec, each, every
from validation.experiments.melting import scene as tanks
from validation.experiments.melting.scene import FIGURES, HALF_WIDTH, LIQUID, SOUND, SPACING, STEP, SUPPORT
from validation.metrics.droplet import mesh_volume, surface_mesh
from validation.metrics.spread import fragments
from validation.results import Result
from validation.running import Context, momenta, note, search_log, stage_seconds, take_steps
from validation.timed import list_seconds, stages, steps
from validation.trials import Trial, hard_case

PAPER = {"figure_4": ("35k + 5k", 22.5), "figure_5": ("48.5k + 12k", 35.7), "figure_6": ("40.5k + 20k", 42.3)}  # ms
ON_GPU = (*PAPER, "million")
SOLID_SHARES = (0.0, 0.2, 0.4, 0.6)  # of the particles of one tank
WIDTHS = (1, 2, 3, 4)  # half-widths w of a region
EVERY = 10  # steps between two entries of a series
LARGEST_TEMPERATURE = 250  # as a byte in steps of half a degree, from -25 deg C


class Watch:
    """Counts what melts, and the greatest speed, from step to step."""

    def __init__(self, simulation: refsim.Simulation) -> None:
        self.simulation = simulation
        self.solid = self._phase() != FLUID
        self.phase = self._phase()
        self.inside_melted = 0  # particles that melted without having been at a surface
        self.fastest = 0.0  # [m/s] since the last entry of the series
        self.series: dict[str, list[float]] = {}

    def _phase(self) -> np.ndarray:
        return self.simulation.field("phase")

    def after_step(self) -> None:
        """Compare with the step before."""
        now = self._phase()
        melted = (self.phase != FLUID) & (now == FLUID)
        self.inside_melted += int((self.phase[melted] != SURFACE).sum())
        self.phase = now
        self.fastest = max(self.fastest, float(np.linalg.norm(self.simulation.field("velocity"), axis=1).max()))

    def note(self) -> None:
        """An entry of the series."""
        s = self.simulation
        mass, rest_density = (s.field(name).astype(float) for name in ("mass", "rest_density"))
        row = {
            "time": s.time, "solid": int((self.phase != FLUID).sum()),
            "inside": int((self.phase == INTERIOR).sum()), "fragments": fragments(s.field("direct")),
            "mass": float(mass.sum()), "rest_volume": float((mass / rest_density).sum()), "fastest": self.fastest,
        }  # fmt: skip
        note(self.series, row)
        self.fastest = 0.0


def melt(
    context: Context, figure: str, size: float, backend: str, shares: list[float], until: float, **options: Any
) -> Result:
    """A figure's scene until `until` [s]: frames at the start and when the share of solid has fallen to `shares`."""
    setting = FIGURES[figure](size)
    simulation = context.simulation(tanks.scene_of(figure, size, **options), backend)
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
        "inside_melted": watch.inside_melted, "search": search_log(simulation),
    }  # fmt: skip
    return Result(values, arrays)


def frame(simulation: refsim.Simulation, arrays: dict[str, np.ndarray], times: list[float]) -> None:
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
    body = refsim.SolidBox(lower=(0, 0, 0), upper=(0.8, 0.6, 0.6), velocity=(1.0, 0.0, 0.0), spin=(0.0, 1.0, 3.0))
    effects = (refsim.ShapeMatching(half_width=half_width, summation=summation),)
    scene = refsim.Scene(
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


def conserved(context: Context, backend: str, dtype: str, bookkeeping: str, steps: int) -> Result:
    """A warm block of water and an ice ball that flies into it, without gravity and walls: what is conserved.

    The conductivity is taken in W/(m K) (without Shao & Song M11), so that the scheme conserves sum m c T.
    """
    ball = refsim.SolidBall(center=(1.0, 1.0, 1.9), radius=0.6, density=917.0, velocity=(0.0, 0.0, -2.0))
    diffusivity = 0.3
    heat = refsim.HeatConduction(
        temperature=(-10.0, 40.0), conductivity=diffusivity * 1000 * 4186, heat_capacity=4186.0, melting_point=0.0,
        literal=("M26",),
    )  # fmt: skip
    bodies = (refsim.ShapeMatching(half_width=HALF_WIDTH), refsim.TwoWayCoupling())
    effects = (LIQUID, *bodies, heat, refsim.Melting(bookkeeping=bookkeeping))
    scene = refsim.Scene(
        spacing=SPACING, support_radius=SUPPORT, fluid=(refsim.Box(cells=(10, 10, 6)),), solid=(ball,), effects=effects,
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
    return Result({
        "heat_drift": drift, "momentum": moved, "melted": melted, "nodes": nodes, "steps": steps,
        "mass_change": (now["mass"] - start["mass"]) / start["mass"],
        "mass_unexplained": abs(now["mass"] - start["mass"] - expected) / start["mass"],
        "volume_change": abs(now["volume"] - start["volume"]) / start["volume"],
    })  # fmt: skip


# Time


def step_cost(
    context: Context, figure: str, size: float, backend: str, threads: int | None, warm: int, rounds: int, steps: int,
    solid_share: float = -1.0, **options: Any,
) -> Result:  # fmt: skip
    """Seconds a step of a figure's scene, stage by stage: `rounds` times `steps` steps after `warm` ones.

    solid_share  where not negative, a tank of as many particles with this share of solid instead of the figure
    """
    setting = tanks.shared_tank(figure, size, solid_share) if solid_share >= 0 else FIGURES[figure](size)
    scene = tanks.make_scene(setting, figure, **options)
    simulation = context.simulation(scene, backend, threads)
    take_steps(simulation, max(warm, 2))
    whole = []
    simulation.timings.stages.clear()
    for k in range(rounds):
        began = time.perf_counter()
        for _ in range(steps):
            simulation.step()
        whole.append((time.perf_counter() - began) / steps)
        context.progress((k + 1) / rounds)
    stages = {name: seconds / (rounds * steps) for name, seconds in stage_seconds(simulation).items()}
    bodies = int(np.diff(simulation.plan.grid.solids.lattice.first).sum())
    return Result({
        "figure": figure, "liquid": simulation.count - bodies, "solid": bodies, "seconds": float(np.median(whole)),
        "rounds": whole, "stages": stages, "step": scene.step, "threads": threads or os.cpu_count(),
    })  # fmt: skip


GROUPS = {
    "neighbour list": ("neighbours",), "liquid and coupling": ("two_way_coupling.", "sph."), "heat": ("heat.",),
    "melting": ("melting.", "shape_matching.regions", "shape_matching.classify"),
    "shape matching": ("shape_matching.",),
}  # fmt: skip


def grouped(stages: dict[str, float]) -> dict[str, float]:
    """Seconds of the paper's stages: every operation counts in the first group that names it."""
    total = dict.fromkeys(GROUPS, 0.0)
    for name, seconds in stages.items():
        group = next((group for group, marks in GROUPS.items() if name.startswith(marks)), None)
        if group:
            total[group] += seconds
    return total


# Summation


def summations(context: Context, backend: str, half_width: int, steps: int = 60) -> Result:
    """A bar bent by kicks at its ends and in its middle: for each summation the seconds of the four sums of a step."""
    rows = []
    for summation in ("gather", "reduction", "fast"):
        body = refsim.SolidBox(lower=(0, 0, 0), upper=(4.0, 1.6, 1.6))
        scene = refsim.Scene(
            spacing=SPACING, support_radius=SUPPORT, fluid=(), solid=(body,), step=STEP,
            effects=(refsim.ShapeMatching(half_width=half_width, summation=summation, damping=0.1),),
        )  # fmt: skip
        simulation = context.simulation(scene, backend)
        kick = np.zeros((simulation.count, 3), np.float32)
        kick[:, 2] = np.where(np.abs(simulation.field("position")[:, 0] - 2.0) > 1.0, 1.0, -1.0)
        simulation.backend.assign(simulation.fields["velocity"], kick)
        take_steps(simulation, 5)
        simulation.timings.stages.clear()
        take_steps(simulation, steps - 5)
        seconds = sum(
            s for name, s in stage_seconds(simulation).items()
            if name.rpartition(".")[2] in ("match", "pull", "region_motion", "damp")
        ) / (steps - 5)  # fmt: skip
        rows.append({"summation": summation, "seconds": seconds})
        context.progress(len(rows) / 3)
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
            inside = wide[half_width, half_width]
            wide[:] = EMPTY
            wide[half_width, half_width] = inside
        passes.append(wide)
    return Result(
        {"node": node, "cell": lattice.cell[node], "half_width": half_width, "gone": sorted(gone)},
        {"passes": np.array(passes), "cells": lattice.cell, "solid": (phase != FLUID).astype(np.uint8)},
    )


# What a melting step costs on a GPU: stage by stage, each stage as a CUDA graph of its own, and beside the CPU.


WARM, STEPS = 30, 200  # steps before the clock runs, and under it


def scene_named(name: str, size: float) -> refsim.Scene:
    """A figure's scene, or "million": a tank of 999,702 particles at size 1, a third of them solid."""
    if name == "million":
        return tanks.make_scene(tanks.shared_tank("figure_6", 2.55 * size, 1 / 3), name)
    return tanks.scene_of(name, size)


def on_gpu(context: Context, figure: str, size: float, warm: int = WARM, count: int = STEPS) -> Result:
    """Seconds a step on the GPU: all of it, as one graph, with a new neighbour list, and by the paper's stages."""
    simulation = context.simulation(scene_named(figure, size), "cuda")
    taken = steps(simulation, warm, count)
    context.progress(0.7)
    renewed = len(taken["step with a new list"]) / count
    stage = stages(simulation, renewed)
    stage["neighbours"] = list_seconds(taken, stage["neighbours"])
    bodies = int(np.diff(simulation.plan.grid.solids.lattice.first).sum())
    return Result({
        "figure": figure, "liquid": simulation.count - bodies, "solid": bodies,
        "seconds": sum(map(sum, taken.values())) / count, "renewed": renewed,
        "one_graph": float(np.median(taken["step"])) if taken["step"] else float("nan"),
        "with_list": float(np.median(taken["step with a new list"])) if renewed else float("nan"),
        "stages": grouped(stage), "operations": stage, "step": simulation.plan.scene.step,
        "solid_left": int((simulation.field("phase") != 0).sum()),
    })  # fmt: skip


def beside_cpu(context: Context, figure: str, size: float, threads: int) -> Result:
    """Seconds of each of the paper's stages on the GPU and on so many threads of the CPU."""
    scene = tanks.scene_of(figure, size)
    on_gpu = context.simulation(scene, "cuda")
    taken = steps(on_gpu, WARM, STEPS)
    stage = stages(on_gpu, len(taken["step with a new list"]) / STEPS)
    gpu = grouped(stage | {"neighbours": list_seconds(taken, stage["neighbours"])})
    on_cpu = context.simulation(scene, "cpu", threads)
    take_steps(on_cpu, WARM)
    on_cpu.timings.stages.clear()
    take_steps(on_cpu, 20)
    cpu = grouped({name: seconds / 20 for name, seconds in stage_seconds(on_cpu).items()})
    seconds = sum(map(sum, taken.values())) / STEPS
    return Result({"gpu": gpu, "cpu": cpu, "seconds": seconds, "step": scene.step, "particles": on_gpu.count})


# What the paper on melting claims of its scenes: order of melting, volume and mass, shares of solid, sums, time.


SMALL = 0.4  # size of the scenes that are followed to the end
CLAIM_FIGURES = ("figure_4", "figure_5", "figure_6")
RADII = (0.5, 0.55, 0.6, 0.65, 0.7)  # of the ice balls whose volume is measured [m]


def volume(place: np.ndarray) -> float:
    """Volume that the smoothed surface of a block of particles encloses [m^3]; place (n, 3) [m]."""
    return mesh_volume(*surface_mesh(place, SPACING))


def melted(context: Context, radius: float, bookkeeping: str, backend: str, seconds: float = 1.2) -> Result:
    """A ball of ice in a tank of warm water, with and without melting: volume and change of mass at the end.

    The volume is that within the smoothed surface; `left` is the share of the ball that has not melted.
    """
    wide = 12
    cells = np.stack(np.meshgrid(*[np.arange(wide)] * 3, indexing="ij"), -1).reshape(-1, 3)
    inside = np.linalg.norm(cells - 0.5 * (wide - 1), axis=1) * SPACING < radius
    heat = refsim.HeatConduction(
        temperature=(-10.0, 80.0), conductivity=0.3 * 1000 * 4186, heat_capacity=4186.0, melting_point=0.0,
        literal=("M26",),
    )  # fmt: skip
    walls = refsim.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(wide * SPACING, wide * SPACING, 2 * wide * SPACING))
    bodies = (refsim.ShapeMatching(half_width=HALF_WIDTH), refsim.TwoWayCoupling())
    effects = (LIQUID, refsim.Gravity(), walls, *bodies, heat)
    times = {}
    for name, more in (("kept", ()), ("melted", (refsim.Melting(bookkeeping=bookkeeping),))):
        scene = refsim.Scene(
            spacing=SPACING, support_radius=SUPPORT, fluid=(refsim.Cloud(position=SPACING * (cells[~inside] + 0.5)),),
            solid=(refsim.SolidCells(cells=cells[inside], density=917.0),), effects=(*effects, *more), step=0.004,
            dtype="float64",
        )  # fmt: skip
        simulation = context.simulation(scene, backend)
        solid, mass = int((simulation.field("phase") != FLUID).sum()), float(simulation.field("mass").sum())
        while simulation.time < seconds:
            simulation.step()
            context.progress(0.5 * len(times) + 0.5 * simulation.time / seconds)
        times[name] = {
            "volume": volume(simulation.field("position")),
            "left": int((simulation.field("phase") != FLUID).sum()) / solid,
            "mass_change": float(simulation.field("mass").sum()) / mass - 1,
        }
    return Result({
        "before": times["kept"]["volume"], "after": times["melted"]["volume"], "left": times["melted"]["left"],
        "mass_change": times["melted"]["mass_change"],
    })  # fmt: skip


def pools(bookkeeping: str) -> Callable[[Options], list[RunSpec]]:
    """Balls of five sizes."""
    balls = {f"claim_volume_{bookkeeping}_{radius:g}": {"radius": radius} for radius in RADII}
    return every(melted, balls, 10.0, bookkeeping=bookkeeping)


def shares(options: Options) -> list[RunSpec]:
    """Tanks of 60,840 particles (with --quick 3,900) of which more and more is solid."""
    size = SMALL if options.quick else 1.0
    shared = {"figure": "figure_6", "size": size, "backend": options.backend, "threads": options.threads}
    shared |= {"warm": 4, "rounds": 5, "steps": 3}
    return [
        RunSpec(f"share_{round(100 * share)}", step_cost, {**shared, "solid_share": share}, estimate=8.0)
        for share in SOLID_SHARES
    ]


def slower(results: Results) -> list[float]:
    """Time with 20, 40 and 60 % of solid over that with one layer."""
    seconds = {key: results[key].values["seconds"] for key in results}
    return [seconds[f"share_{share}"] / seconds["share_0"] for share in (20, 40, 60)]


def sums(options: Options) -> list[RunSpec]:
    """A bent bar with every summation, at half-widths 1 to 4."""
    parameters = {"backend": options.backend, "steps": 30 if options.quick else 60}
    return [RunSpec(f"width_{w}", summations, {"half_width": w, **parameters}, 3.0) for w in WIDTHS]


def by_members(results: Results) -> list[float]:
    """Seconds of the additions of a reduction over those of fast summation, float32, for each half-width."""
    seconds = [{row["summation"]: row["seconds"] for row in result.values["rows"]} for result in results.values()]
    return [each["reduction"] / each["fast"] for each in seconds]


def full(options: Options) -> list[RunSpec]:
    """The scenes of figures 4 to 6 on a GPU: the experiment's own runs."""
    missing = unavailable("cuda") or ""
    return [RunSpec(f"gpu_{f}", on_gpu, {"figure": f, "size": 1.0}, estimate=15.0, skip=missing) for f in CLAIM_FIGURES]


def on_both(options: Options) -> list[RunSpec]:
    """The scene of figure 6 on a GPU and on four threads of its host."""
    parameters = {"figure": "figure_6", "size": 1.0, "threads": 4}
    return [RunSpec("both", beside_cpu, parameters, estimate=60.0, skip=unavailable("cuda") or "")]


def faster(results: Results) -> list[float]:
    """Time on the CPU over that on the GPU, of each stage."""
    values = results["both"].values
    return [values["cpu"][stage] / values["gpu"][stage] for stage in values["gpu"]]


# The figures' scenes, small, until a tenth of the solid is left
SCENES = {f"melt_{figure}": {"figure": figure} for figure in CLAIM_FIGURES}
MELTING_OUTSIDE_IN = Measure(every(melt, SCENES, 10.0, size=SMALL, shares=[0.5, 0.1], until=4.0), each("inside_melted"))
GROWTH = each(lambda v: abs(v["after"] / v["before"] - 1))  # of the volume within the surface, by melting
MELTING_VOLUME_KEPT = Measure(pools("immiscible"), GROWTH)
MELTING_VOLUME_KEPT_AS_WATER = Measure(pools("water"), GROWTH)
MELTING_MASS_NOT_KEPT_AS_WATER = Measure(pools("water"), each(lambda v: abs(v["mass_change"])))
MELTING_SOLIDS_SLOWER = Measure(shares, slower, quick=False, timed=True)
MELTING_SUMS_IN_PARALLEL = Measure(sums, by_members, timed=True)
MELTING_GPU_PER_STAGE = Measure(on_both, faster, quick=False, timed=True)
MELTING_REAL_TIME = Measure(full, each("step", "seconds"), quick=False, timed=True)  # lists included


def costs(options: Options) -> list[RunSpec]:
    """The scenes of table 2 on the threads of a CPU: the experiment's own runs."""
    cost = {"size": 1.0, "backend": options.backend, "threads": options.threads, "warm": 40, "rounds": 5, "steps": 4}
    return [RunSpec(f"cost_{figure}", step_cost, {"figure": figure, **cost}, 12.0) for figure in PAPER]


def search(values: Mapping[str, Any]) -> float:
    """Seconds of the list of neighbours over those of all else that WCSPH and the coupling take."""
    stage = values["stages"] if "heat" in values["stages"] else grouped(values["stages"])
    return stage["neighbour list"] / stage["liquid and coupling"]


MELTING_SEARCH_COSTLIEST = Measure(full, each(search), quick=False, timed=True)
MELTING_SEARCH_COSTLIEST_ON_THREADS = Measure(costs, each(search), quick=False, timed=True)

# Null models


class _Anywhere:
    """A simulation of which the inner particles melt as often as the outer ones."""

    def __init__(self) -> None:
        self.phases = np.full(1000, INTERIOR, np.int32)

    def field(self, name: str) -> np.ndarray:
        """Phases, all of the interior at first; nothing moves."""
        return self.phases.copy() if name == "phase" else np.zeros((1000, 3))


def _melts_anywhere(measure: Measure) -> list[float]:
    """A tenth of the particles melts, chosen at random."""
    simulation = _Anywhere()
    watch = Watch(simulation)  # type: ignore[arg-type]
    simulation.phases[np.random.default_rng(1).random(1000) < 0.1] = FLUID
    watch.after_step()
    return measure.of({"": {"inside_melted": watch.inside_melted}})


def _shrinks(measure: Measure) -> list[float]:
    """A block of particles, and the same with a tenth of it gone; its mass stays."""
    axis = SPACING * np.arange(10.0)
    place = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return measure.of({"": {"before": volume(place), "after": volume(place[100:]), "mass_change": 0.0}})


def _twice_as_long(measure: Measure) -> list[float]:
    """The reduction takes twice as long."""
    rows = [{"summation": s, "seconds": t} for s, t in (("reduction", 0.02), ("fast", 0.01))]
    return measure.of({"": {"rows": rows}})


# Hard cases of solids, of what holds them together, of their coupling and of melting.


CUBE = refsim.SolidBox(lower=(0.4, 0.4, 0.8), upper=(1.4, 1.4, 1.8))
FASTEST = SOUND  # [m/s]: above it the liquid's equation of state means nothing


def pool(
    solid: tuple[Any, ...] = (CUBE,), temperature: Any = (-10.0, 40.0), conductivity: float = 0.3,
    bookkeeping: Any = "immiscible", **more: Any,
) -> refsim.Scene:  # fmt: skip
    """Bodies over a basin of 9 x 9 x 4 particles; K in m^2/s."""
    heat = refsim.HeatConduction(
        temperature=temperature, conductivity=conductivity, melting_point=0.0, mean="arithmetic", literal=("M11", "M26")
    )
    walls, melting = refsim.BoxWalls(lower=(0, 0, 0), upper=(1.8, 1.8, 3.0)), refsim.Melting(bookkeeping=bookkeeping)
    effects = (LIQUID, refsim.Gravity(), walls, refsim.ShapeMatching(), refsim.TwoWayCoupling(), heat, melting)
    options = {"spacing": SPACING, "support_radius": SUPPORT, "step": 0.004} | more
    return refsim.Scene(fluid=(refsim.Box(cells=(9, 9, 4)),), solid=solid, effects=effects, **options)


def _watched(trial: Trial, simulation: refsim.Simulation, steps: int) -> list[int]:
    """Step, and check that what melts lay at a surface and that speeds stay bounded; how many melted in each step."""
    watch = Watch(simulation)
    solid = [int(watch.solid.sum())]
    for _ in range(steps):
        simulation.step()
        watch.after_step()
        trial.check("melted from inside", watch.inside_melted, equals=0)
        solid.append(int((watch.phase != FLUID).sum()))
    trial.check("greatest speed [m/s]", watch.fastest, at_most=FASTEST)
    trial.account(simulation)
    return [before - left for before, left in itertools.pairwise(solid)]


@hard_case
def all_or_nothing(trial: Trial, temperature: float, layers: list[int]) -> None:
    """A cube that is as warm everywhere, and no conduction: whole layers melt, one a step, or nothing does."""
    simulation = trial.start(pool(temperature=temperature, conductivity=0.0))
    gone = _watched(trial, simulation, 60)
    for k, wanted in enumerate(layers):
        trial.check(f"melted in step {k + 1}", gone[k], equals=wanted)
    trial.check("melted in all", sum(gone), equals=sum(layers))


@hard_case
def melting_body(
    trial: Trial, body: str, density: float = 917.0, bookkeeping: str = "immiscible",
    steps: int = 300,
) -> None:  # fmt: skip
    """A body of BODIES falls into warm water and melts."""
    cells = BODIES[body]
    simulation = trial.start(pool((refsim.SolidCells(cells=cells, density=density),), (-10.0, 60.0), 0.5, bookkeeping))
    gone = _watched(trial, simulation, steps)
    trial.check("particles left solid", len(cells) - sum(gone), at_most=0.9 * len(cells))
    ratio = float((simulation.field("density") / simulation.field("rest_density")).max())
    trial.check("greatest density over rest density", ratio, at_most=1.6)
    mass, rho = simulation.field("mass").astype(float), simulation.field("rest_density").astype(float)
    trial.show("rest volume", float((mass / rho).sum()))


@hard_case
def refused_bookkeeping(trial: Trial) -> None:
    """To keep the mass of the melt and switch its rest density is refused."""
    with trial.ending():
        trial.start(pool(bookkeeping="keep_mass"))
    trial.check("the sentence says why", "Tait" in trial.message, equals=1)


DEFORMATIONS = {
    "inverted": np.diag([1.0, 1.0, -1.0]), "coplanar": np.diag([1.0, 1.0, 0.0]), "collinear": np.diag([1.0, 0.0, 0.0]),
    "point": np.zeros((3, 3)), "flipped": np.diag([1.0, -1.0, -1.0]),
}  # fmt: skip


@hard_case
def mapped(trial: Trial, kind: str, dtype: str = "float32") -> None:
    """A free cube whose particles are mapped through its middle, and let go: it comes back to its shape."""
    body = refsim.SolidBox(lower=(0, 0, 0), upper=(1.0, 1.0, 1.0))
    scene = refsim.Scene(
        spacing=SPACING, support_radius=SUPPORT, fluid=(), solid=(body,), step=0.005, dtype=dtype,
        effects=(refsim.ShapeMatching(half_width=1),),
    )  # fmt: skip
    simulation = trial.start(scene)
    x = simulation.field("position").astype(float)
    rest = np.linalg.norm(x[:, None] - x[None], axis=2)
    there = (x - x.mean(0)) @ DEFORMATIONS[kind].T + x.mean(0)
    simulation.backend.assign(simulation.fields["position"], there.astype(dtype))
    trial.advance(simulation, steps=800)
    now = simulation.field("position").astype(float)
    speed = float(np.linalg.norm(simulation.field("velocity").astype(float), axis=1).max())
    change = float(np.abs(np.linalg.norm(now[:, None] - now[None], axis=2) - rest).max()) / SPACING
    drift = float(np.abs(now.mean(0) - x.mean(0)).max()) / SPACING
    trial.check("greatest speed at the end [m/s]", speed, at_most=5.0)
    trial.check("drift of the center of mass [d]", drift, at_most=1e-3)
    trial.check("change of a distance [d]", change, at_most=0.01)


@hard_case
def one_voxel_apart(trial: Trial, gap: int) -> None:
    """Two boxes whose cells touch (gap 0) or are one cell apart melt in warm water; their tables never mix."""
    left = [[a, b, e] for a in range(1, 4) for b in range(3, 6) for e in range(5, 8)]
    right = [[a + 3 + gap, b, e] for a, b, e in left]
    simulation = trial.start(
        pool((refsim.SolidCells(cells=left), refsim.SolidCells(cells=right, density=500.0)), (-10.0, -10.0, 60.0), 0.5)
    )
    _watched(trial, simulation, 150)
    region = simulation.field("region")
    owner = np.repeat([0, 1], [len(left), len(right)])
    row, slot = np.nonzero(region >= 0)
    trial.check("members of the other body", int((owner[region[row, slot]] != owner[row]).sum()), equals=0)


def _box(low: tuple[int, int, int], edges: tuple[int, int, int]) -> list[list[int]]:
    return (np.stack(np.meshgrid(*map(np.arange, edges), indexing="ij"), -1).reshape(-1, 3) + low).tolist()


BODIES = {
    "plate": _box((1, 1, 6), (7, 7, 1)), "chain": _box((1, 4, 6), (7, 1, 1)), "single": [[4, 4, 6]],
    "bridge": [*_box((1, 3, 6), (2, 3, 3)), *_box((3, 4, 7), (3, 1, 1)), *_box((6, 3, 6), (2, 3, 3))],
    "cube": _box((2, 2, 5), (5, 5, 5)),
}  # fmt: skip


# Melting in fluid-solid interaction (Shao & Song 2017): scenes of figures 4 to 6, table 2, conservation, regions.


SHARES = {"figure_4": [0.9, 0.5, 0.1], "figure_5": [0.8, 0.5, 0.2], "figure_6": [0.8, 0.5, 0.2]}
UNTIL = 4.0  # [s]
KEPT = (("float64", "immiscible"), ("float32", "immiscible"), ("float64", "water"))  # dtype and bookkeeping
QUICK = 0.4  # size of the scenes with --quick
TITLES = {
    "figure_4": "Figure 4, an ice cube in warm water",
    "figure_5": "Figure 5, bodies of equal conductivity",
    "figure_6": "Figure 6, rabbits and ducks in two streams",
}


def planned(options: Options) -> list[RunSpec]:
    """The runs under the options."""
    quick, backend, threads = options.quick, {"backend": options.backend}, {"threads": options.threads}
    size = {"size": QUICK if quick else 1.0}
    shorter = {"step": 0.002} if not quick else {}  # of figure 5, see docs/melting.md
    scenes = {
        figure: {"figure": figure, "shares": shares, "until": UNTIL, **size, **backend}
        for figure, shares in SHARES.items()
    }
    scenes["figure_5"] |= shorter
    own = {**scenes["figure_5"], "weighted": False}  # every particle of a pair pushes by its own pressure
    printed = {**scenes["figure_4"], "size": QUICK, "shares": [0.5, 0.0], "scale": 1.0, "largest_number": 10.0}
    cost = {**size, **backend, **threads, "warm": 40, "rounds": 5, "steps": 4}
    return [
        *(RunSpec(figure, melt, scene, 8.0 if quick else 120.0) for figure, scene in scenes.items()),
        RunSpec("own_pressure", melt, own, 120.0, "takes as long as figure 5; run without --quick" if quick else ""),
        RunSpec("as_printed", melt, printed, 4.0),
        RunSpec("filling", filling, estimate=0.5),
        RunSpec("lattice", free_lattice, {"steps": 400 if quick else 10000, **backend}, 8.0),
        *(RunSpec(f"kept_{dtype}_{books}", conserved,
              {"dtype": dtype, "bookkeeping": books, "steps": 200 if quick else 1000, **backend}, 5.0)
          for dtype, books in KEPT),
        *(RunSpec(f"cost_{figure}", step_cost, {"figure": figure, **cost}, 1.0 if quick else 12.0) for figure in PAPER),
        *shares(options),
        *(RunSpec(f"gpu_{figure}", on_gpu, {"figure": figure, **size}, 10.0, unavailable("cuda") or "")
          for figure in ON_GPU),
    ]  # fmt: skip


def checks(results: Results, check: Checks) -> None:
    """Conservation, regions and bookkeeping are judged against their bars; times are shown."""
    for figure in SHARES:
        check.run(results, figure, {
            "from_inside": "inside_melted",
            "fragments": lambda v: max(v["series"]["fragments"]),
            "fastest": lambda v: max(v["series"]["fastest"]),
            "volume": lambda v: abs(v["series"]["rest_volume"][-1] / v["series"]["rest_volume"][0] - 1),
            "mass": lambda v: v["series"]["mass"][-1] / v["series"]["mass"][0] - 1,
        }, figure)  # fmt: skip
    check.run(results, "own_pressure", {"fastest_own_pressure": lambda v: max(v["series"]["fastest"])})
    check.run(results, "as_printed", {"printed_time": lambda v: v["times"][-1]})
    check.run(results, "lattice", {f"lattice_{name}": name for name in ("angular_momentum", "momentum", "shape")})
    for dtype, bookkeeping in KEPT:
        key = f"kept_{dtype}_{bookkeeping}"
        if bookkeeping == "immiscible":
            check.run(results, key, {f"heat_{dtype}": "heat_drift", f"momentum_{dtype}": "momentum"})
        own = {f"mass_unexplained_{dtype}": "mass_unexplained", f"volume_{dtype}": "volume_change"}
        check.run(results, key, own, bookkeeping, f"{dtype}, {bookkeeping}")
    for figure, (label, paper) in PAPER.items():
        own = {"step": lambda v: 1e3 * v["seconds"], "step_ratio": lambda v, paper=paper: 1e3 * v["seconds"] / paper}
        check.run(results, f"cost_{figure}", own, figure, label)


EXPERIMENT = Experiment(
    name="melting", title="melting in fluid-solid interaction: scenes, times, conservation, regions", runs=planned,
    checks=checks,
)  # fmt: skip
