"""Runs of the MPM droplet: transfers by themselves, a square that becomes a disc, and the same work in Taichi."""

import itertools
import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim import Box, Cloud, Gravity, MpmLiquid, MpmWalls, Scene, Simulation, SurfaceEnergy
from refsim.core.errors import InputError, RunStopped
from refsim.mpm import READINGS
from refsim.mpm.limits import FARTHEST
from refsim.surface_energy import Tension
from validation.checks import Checks, Quantities
from validation.experiment import Experiment, Measure, Options, Results, RunSpec, each, every
from validation.experiments.mpm_droplet import scene as drops
from validation.experiments.mpm_droplet.scene import CELLS, MODULUS, TENSION, box, pair
from validation.metrics.bodies import (
    FreeLedger,
    Ledger,
    Turning,
    late,
    surface_of,
)
from validation.metrics.mpm import CELL, DENSITY, Transfers, backward_euler, round_trip, splines
from validation.metrics.mpm import MODULUS as BULK_MODULUS
from validation.peers import in_turns, taichi_mpm
from validation.results import Result, real
from validation.running import Context
from validation.trials import Cell, Trial, hard_case, largest_stable, unguarded

FRAMES = (0.016, 0.033)  # s, beside the start and the end: half of an oscillation and a whole one
BLOCK = {"spacing": 0.01, "density": 1000.0, "bulk_modulus": 1e5, "gravity": -9.81, "step": 1e-4, "warm": 3}


def transfers(context: Context) -> Result:
    """Round trips of an affine field in the four readings."""
    readings = {}
    for k, name in enumerate(READINGS):
        readings[name] = round_trip(name)
        context.progress((k + 1) / len(READINGS))
    return Result({"readings": readings})


def against_taichi(
    context: Context, cells: int, steps: int, rounds: int, threads: int, backend: str, order: str = "lattice"
) -> Result:
    """Plain MLS-MPM liquid here and in Taichi, in turns: mean seconds of a step, and that both computed the same.

    order  in which the particles stand in memory, see `taichi_mpm.places`
    """
    block = {**BLOCK, "cells": cells, "room": cells + 24, "steps": steps, "order": order}
    said: dict[str, Any] = {}

    def peer() -> dict[str, Any]:
        said.update(taichi_mpm.run(block, threads, "cuda" if backend == "cuda" else "cpu"))
        return said

    def own() -> float:
        said["run"], seconds = plain_block(context, block, threads, backend)
        return seconds

    comparison = in_turns(rounds, peer, own, context.progress)
    if comparison["missing"]:
        return Result(comparison)
    run = said["run"]
    position, velocity = (run.field(name).astype(float) for name in ("position", "velocity"))
    speed, ratio = float(np.sqrt((velocity**2).sum(1).mean())), float(run.field("volume_ratio").astype(float).std())
    difference = max(
        float(np.abs(position.mean(0) - said["centre"]).max() / BLOCK["spacing"]),
        abs(speed / said["speed"] - 1), abs(ratio / said["ratio"] - 1),
    )  # fmt: skip
    return Result({**comparison, "particles": run.count, "threads": threads, "order": order, "difference": difference})


def plain_block(context: Context, block: dict[str, Any], threads: int, backend: str) -> tuple[Simulation, float]:
    """(the run at its end, mean seconds of a step) of the block of liquid that the peer gets."""
    spacing, room = block["spacing"], block["room"] * 2 * block["spacing"]
    scene = Scene(
        spacing=spacing, support_radius=3 * spacing, step=block["step"], dtype="float32",
        fluid=(Cloud(position=taichi_mpm.places(block["cells"], spacing, block.get("order", "lattice"))),),
        effects=(
            MpmLiquid(rest_density=block["density"], bulk_modulus=block["bulk_modulus"]),
            Gravity(acceleration=(0.0, block["gravity"], 0.0)), MpmWalls(lower=(0, 0, 0), upper=(room, room, room)),
        ),
    )  # fmt: skip
    run = context.simulation(scene, backend, threads if backend == "cpu" else None)
    spent = []
    for _ in range(block["warm"] + block["steps"]):
        run.backend.synchronize()
        began = time.perf_counter()
        run.step()
        run.backend.synchronize()
        spent.append(time.perf_counter() - began)
    return run, statistics.fmean(spent[block["warm"] :])  # sorting, in every few steps on a GPU, counts


# Runs of bodies of liquid under surface tension: at rest, rounding off, swinging, colliding, on a floor, a sheet.


THESIS = "M9, M10"  # the embedding as printed
DROP_SPIN = 20.0  # rad/s, of the disc that turns
SIDES = (1.3, 1.0, 0.8)  # of the box that becomes a sphere


def follow(
    context: Context, run: Simulation, until: float, rows: int, shown: Sequence[float] = (),
    each: Callable[[Simulation], None] | None = None,
) -> tuple[Ledger, dict[str, np.ndarray], str]:  # fmt: skip
    """Step to `until` [s]: (ledger of `rows` rows, surfaces nearest after the times `shown`, why it stopped or "").

    each  called after every step
    """
    ledger, kept, stopped = Ledger(run), {}, ""
    noted, waiting = 0, sorted(shown)
    try:
        while run.time < until - 1e-9:
            run.step()
            if each is not None:
                each(run)
            if run.time >= noted * until / rows or run.time >= until - 1e-9:
                noted += 1
                ledger.note()
                context.progress(run.time / until)
            while waiting and run.time >= waiting[0] - 1e-9:
                mesh = surface_of(run).inset_mesh
                place = f"{len(shown) - len(waiting)}"
                kept[f"vertices_{place}"] = run.backend.host(mesh.vertices) / ledger.h
                kept[f"facets_{place}"] = run.backend.host(mesh.facets)
                if ledger.dim == 2:
                    kept[f"position_{place}"] = run.field("position")[:, :2] / ledger.h
                waiting.pop(0)
    except RunStopped as stop:
        stopped = f"{stop.reason} in step {run.steps}"
        if not ledger.series:
            raise
    return ledger, kept, stopped


def result_of(
    run: Simulation, followed: tuple[Ledger, dict[str, np.ndarray], str], shown: Sequence[float] = (), **more: Any
) -> Result:
    """What a run that was followed gave, and more values."""
    ledger, kept, stopped = followed
    values = {"stopped": stopped, "dim": ledger.dim, "shown": list(shown), "series": ledger.series, "steps": run.steps}
    return Result({**values, **ledger.summary(), **more}, kept)


def rounding(
    context: Context, backend: str, shape: str, size: float, until: float, shown: Sequence[float] = (),
    tension: Mapping[str, Any] | None = None, liquid: Mapping[str, Any] | None = None, rows: int = 120, seed: int = 3,
    per: int = 2, cell: float | None = None,
) -> Result:  # fmt: skip
    """A box of 1.3 : 1 : 0.8, or a cube (square), whose surface draws it to a ball.

    shape  "box" (turned off the axes by `seed`), "cube" or "square"; size  side of the cube of the same volume [cells]
    per    particles along a cell; cell  h [m]
    """
    dim = 2 if shape == "square" else 3
    if shape == "box":
        scale = size / math.prod(SIDES) ** (1 / 3)
        place = box([round(per * scale * side) / per for side in SIDES], seed=seed, per=per)
    else:
        place = box([size] * dim, per=per)
    scene = drops.drop_scene(place, dim, tension=dict(tension or {}), liquid=dict(liquid or {}), cell=cell, per=per)
    run = context.simulation(scene, backend)
    followed = follow(context, run, until, rows, shown)
    return result_of(run, followed, shown, last=late(followed[0].series))


def erratum(context: Context, backend: str, printed: str, dim: int, size: float, until: float) -> Result:
    """A square or a cube becomes round with one erratum of the thesis as printed, or none (""), all else as adopted."""
    literal: dict[str, Any] = {"literal": (printed,)} if printed else {}
    surface = literal if printed in Tension.errata else {"embedding": "thesis"} if printed == THESIS else {}
    liquid = literal if printed and printed != THESIS and printed not in Tension.errata else {}
    run = context.simulation(drops.drop_scene(box([size] * dim), dim, tension=surface, liquid=liquid), backend)
    nothing = {"stopped": "", "dim": dim, "printed": printed, "steps": 0}
    try:
        ledger, _, stopped = follow(context, run, until, 60)
    except RunStopped as stop:
        return Result({**nothing, "stopped": f"{stop.reason} in step {run.steps}", "steps": run.steps})
    return Result({**nothing, **ledger.summary(), "stopped": stopped, "steps": run.steps})


def at_rest(
    context: Context, backend: str, dim: int, radius: float, until: float, seed: int = 0,
    tension: Mapping[str, Any] | None = None, shown: Sequence[float] = (),
) -> Result:  # fmt: skip
    """A disc or a ball cut from a turned lattice, with the J that holds its pressure: the pressure it settles at."""
    place = drops.ellipsoid(radius, dim, seed=seed)
    scene = drops.drop_scene(place, dim, tension=dict(tension or {}), balanced=True)
    run = context.simulation(scene, backend)
    return result_of(run, follow(context, run, until, 60, shown), shown)


def collision(
    context: Context, backend: str, dim: int, radius: float, speed: float, until: float, shown: Sequence[float],
    step: float | None = None,
) -> Result:  # fmt: skip
    """Two drops meet off their axis, each at `speed` [m/s]: ledgers until they are one."""
    place, velocity = pair(radius, dim, speed)
    scene = drops.drop_scene(place, dim, velocity=velocity, step=step)
    run = context.simulation(scene, backend)
    followed = follow(context, run, until, 120, shown)
    # both drops turn about the common centre: L is not zero here, its drift is
    ledger, turning = followed[0], followed[0].series["angular"]
    scale = float(ledger.mass.sum()) * ledger.fastest * ledger.radius
    return result_of(run, followed, shown, angular=max(abs(a - turning[0]) for a in turning) / scale)


def sheet(
    context: Context, backend: str, length: float, thick: float, tension: float, until: float, shown: Sequence[float]
) -> Result:
    """A sheet of liquid in the plane draws back from its ends: their speed against Taylor and Culick's."""
    place = box([length, thick])
    scene = drops.drop_scene(place, 2, tension={"surface_tension": tension}, step=0.0)
    run = context.simulation(scene, backend)
    times, width = [], []

    def look(run: Simulation) -> None:
        x = run.field("position")[:, 0]
        times.append(run.time)
        width.append(float(x.max() - x.min()) / CELLS[2])

    followed = follow(context, run, until, 60, shown, look)
    culick = math.sqrt(2 * tension / (thick * CELLS[2]))
    t, w = np.array(times), np.array(width)
    held = (w < 0.9 * length) & (w > 0.5 * length)
    speed = -0.5 * float(np.polyfit(t[held], w[held], 1)[0]) * CELLS[2] if held.sum() > 5 else float("nan")
    seen = {"time": times[::5], "value": width[::5]}
    return result_of(run, followed, shown, speed=speed, culick=culick, width=seen)


# What the thesis claims of its transfers and its embedding (chapter 4).


SEEDS = (1, 2, 3, 4, 5)
SIZES = (6, 7, 8, 9, 10)  # cells along the edge of a block
LIQUIDS_COMPARED = ("square, lambda 1000, k 1", "square, lambda 10,000, k 1", "cube, lambda 1000, k 1")
ROOMS = (12, 14, 16, 20, 24)  # cells along the edge of a box full of liquid
STRIDE = 0.3 * CELL / math.sqrt(BULK_MODULUS / DENSITY)  # s: the runner's own step for a liquid at rest


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
    order = run.host("identity")
    run.write_field("velocity", velocity[order])
    run.write_field("affine", slope.reshape(-1, 9)[order])
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
        bulk = 0.5 * BULK_MODULUS * (mass / DENSITY) @ (state["volume_ratio"] - 1) ** 2
        return float(0.5 * mass @ (state["velocity"] ** 2).sum(1) + bulk)

    start = energy()
    steps = round(periods * 2 * cells * CELL / math.sqrt(BULK_MODULUS / DENSITY) / STRIDE)
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


def _steps(row: str) -> Callable[[Options], list[RunSpec]]:
    """Cells of the stability map, so that they are computed once: without embedding, and with it."""

    def runs(options: Options) -> list[RunSpec]:
        cells = {(cell.row, cell.column): cell for cell in STEPS}
        chosen = [cells[name, column] for column in LIQUIDS_COMPARED for name in ("none, no inset", row)]
        given = {"backend": options.backend}
        return [
            RunSpec(f"stability_mpm_step.{c.key}", c.function, {**c.parameters, **given}, c.seconds) for c in chosen
        ]

    return runs


def _pairs(name: str) -> Callable[[Results], list[float]]:
    """The second over the first of every two runs."""

    def values(results: Results) -> list[float]:
        numbers = [real(result.values[name]) for result in results.values()]
        return [b / a if a else math.inf for a, b in zip(numbers[::2], numbers[1::2], strict=True)]

    return values


MOMENTA = every(momentum, {f"claim_momentum_{seed}": {"seed": seed} for seed in SEEDS}, 3.0)
CLAIMS = {f"mpm_momentum_{reading}": Measure(MOMENTA, each(reading)) for reading in READINGS}
VORTICES = {
    f"claim_vortices_{cells}_{'apic' if affine else 'pic'}": {"cells": cells, "affine": affine}
    for cells in ROOMS for affine in (True, False)
}  # fmt: skip
BLOCKS = {
    f"claim_breathing_{cells}_{'implicit' if implicit else 'explicit'}": {"cells": cells, "implicit": implicit}
    for cells in SIZES for implicit in (False, True)
}  # fmt: skip
MPM_PIC_IS_VISCOUS = Measure(every(vortices, VORTICES, 4.0), _pairs("rate"))
MPM_EXPLICIT_KEEPS_ENERGY = Measure(every(breathing, BLOCKS, 6.0), _pairs("lost"))
MPM_CLUSTER_STEADIES = Measure(_steps("cluster, no inset"), _pairs("largest"), quick=False)
MPM_THESIS_STEADIES = Measure(_steps("thesis (4.14), no inset"), _pairs("largest"), quick=False)


def lost_beyond(context: Context, seed: int, distance: float = math.sqrt(3), tries: int = 200) -> Result:
    """Share of a sample's force (4.18) on nodes without mass, and the same where the sample itself carries mass, mean
    over places of the grid; lengths in cells.

    The sample lies at `distance` from the nearest particle, over a plane surface of a lattice of half a cell, which is
    turned at random.
    """
    random, shares = np.random.default_rng(seed), []
    outward = np.linalg.qr(random.normal(size=(3, 3)))[0][:, 0]
    axis = 0.5 * np.arange(-7, 8)
    lattice = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    corner = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for _ in range(tries):
        particle = lattice + random.uniform(0, 0.5, 3)
        particle = particle[particle @ outward <= 0]
        low, high = 0.0, 2 * distance
        for _ in range(40):  # the height at which the nearest particle is so far away
            middle = 0.5 * (low + high)
            near = np.linalg.norm(particle - middle * outward, axis=1).min()
            low, high = (middle, high) if near < distance else (low, middle)
        place = random.uniform(0, 1, 3)
        sample, particle = high * outward + place, particle + place
        node = np.floor(sample - 0.5) + corner
        value, slope = splines(sample - node)
        rows = [np.prod(np.where(np.arange(3) == k, slope, value), axis=1) for k in range(3)]
        along = np.stack(rows, axis=-1)
        force = np.linalg.norm(along - (along @ outward)[:, None] * outward, axis=1)
        mass = np.prod(splines(particle[:, None] - node)[0], axis=-1).sum(0)
        embedded = mass + np.prod(splines(sample - node)[0], axis=-1)
        shares.append([force[of < 1e-12].sum() / force.sum() for of in (mass, embedded)])
    lost, embedded = np.mean(shares, axis=0)
    return Result({"lost": float(lost), "embedded": float(embedded)})


REACH = every(lost_beyond, {f"claim_reach_{seed}": {"seed": seed} for seed in SEEDS}, 5.0)
MPM_TENSION_BEYOND_REACH = Measure(REACH, each("lost"))
MPM_TENSION_CONDUCTED = Measure(REACH, each("embedded", "lost"))


def _fails(measure: Measure) -> list[float]:
    """The printed embedding, in the place of any other."""
    thesis = momentum(Context(), SEEDS[0]).values["thesis"]
    return measure.of({"": dict.fromkeys(READINGS, thesis)})


# Hard cases of MPM with surface tension, outcomes of the printed readings, largest stable step of each embedding.
#
# Units: rho0 = k = 1, lambda = 1000, cells of 1/64 m in the plane and 1/32 m in space.


MOMENTUM = 1e-10  # of m v_max: the project's bar in float64
ANGULAR = 1e-4  # of m v_max R: the project's bar
REMADE = 1e-3  # of m v_max R: what surfaces made anew may change, see `Turning`


def block(cells: tuple[int, ...], shift: tuple[float, float, float] = (0.13, -0.21, 0.37)) -> NDArray:
    """A block of 2^dim particles to a cell (n, 3), in cells, off the nodes by `shift`."""
    axes = [np.arange(2 * n) * 0.5 + 0.25 for n in cells]
    place = np.array(list(itertools.product(*axes)))
    return np.pad(place, ((0, 0), (0, 3 - len(cells)))) + np.array(shift) * (np.arange(3) < len(cells))


def disc(radius: float, dim: int = 2) -> NDArray:
    """Particles of a lattice within `radius` cells of the origin (n, 3), in cells."""
    place = block((2 * math.ceil(radius) + 2,) * dim, (-math.ceil(radius) - 1.13,) * 3)
    return place[np.linalg.norm(place, axis=1) < radius]


def liquid(
    place: NDArray, dim: int = 2, velocity: Any = None, modulus: float = MODULUS, tension: float = TENSION,
    step: float = 0.0, printed: tuple[str, ...] = (), extra: tuple[Any, ...] = (), **surface: Any,
) -> Scene:  # fmt: skip
    """Particles at `place` [cells] under surface tension; `printed` readings of the liquid, no surface where k < 0."""
    h = CELLS[dim]
    effects = (MpmLiquid(rest_density=1.0, bulk_modulus=modulus, literal=printed),)
    effects += (SurfaceEnergy(surface_tension=tension, **surface),) if tension >= 0 else ()
    cloud = Cloud(position=h * place, **({} if velocity is None else {"velocity": velocity}))
    return Scene(
        spacing=h / 2, support_radius=1.5 * h, dim=dim, dtype="float64", step=step, fluid=(cloud,),
        effects=(*effects, *extra),
    )  # fmt: skip


def free_body(
    trial: Trial, scene: Scene, until: float, momentum: float = MOMENTUM, angular: float = ANGULAR, every: int = 10,
    in_steps: float = MOMENTUM,
) -> FreeLedger:  # fmt: skip
    """Run a body that nothing holds: no particle is lost, momenta stay, and J stays possible.

    angular   bound of the whole drift of angular momentum, over m v_max R; in_steps: of what steps change of it
    """
    ledger, turning = FreeLedger(), Turning()

    def watch(run: Simulation) -> None:
        turning(run)
        if run.steps % every == 0 or run.time >= until:
            ledger(run)

    trial.advance(trial.start(scene), until=until, watch=watch)
    scale = ledger.scale("angular")
    trial.check("linear momentum over m v_max", ledger.drift(), at_most=momentum)
    trial.check("angular momentum over m v_max R", ledger.drift("angular"), at_most=angular)
    trial.check("angular momentum that steps change, over m v_max R", turning.greatest["in_steps"] / scale,
                at_most=in_steps)  # fmt: skip
    trial.show("angular momentum that surfaces made anew change, over m v_max R", turning.greatest["remade"] / scale)
    trial.check("least J", min(row["ratio"] for row in ledger.rows), at_least=0.2)
    trial.show("steps", ledger.last("steps"))
    return ledger


@hard_case
def isolated(trial: Trial, smallest: int) -> None:
    """Sixty particles without neighbours fly apart; with smallest = 1 surface tension acts on each."""
    random = np.random.default_rng(7)
    place = 8.0 * np.array(list(itertools.product(range(10), range(6), [0.0]))) + [0.3, 0.1, 0.0]
    velocity = np.pad(random.normal(size=(60, 2)), ((0, 0), (0, 1)))
    run = trial.start(liquid(place, velocity=velocity, smallest=smallest))
    start = run.field("position")
    trial.advance(run, until=0.01)
    displacement = np.abs(run.field("position") - start - run.time * velocity).max()
    trial.check("displacement less v t [h]", displacement / CELLS[2], at_most=1e-9)
    trial.check("area under tension", float(run.shared["surface"].sample_area.sum()), equals=0)


@hard_case
def filament(trial: Trial, tension: float = TENSION) -> None:
    """A row of particles one particle wide."""
    place = np.zeros((80, 3))
    place[:, 0] = 0.5 * np.arange(80) + 0.13
    place[:, 1] = 0.41
    run = trial.start(liquid(place, tension=tension))
    trial.advance(run, until=0.5)


@hard_case
def hard_sheet(trial: Trial) -> None:
    """A sheet of 40 by 1 cells, two particles thick, draws in."""
    ledger = free_body(trial, liquid(block((40, 1)), tension=0.1), 0.3)
    trial.check("extent over the start's", ledger.last("extent") / ledger.rows[0]["extent"], at_most=0.95)


@hard_case
def close_drops(trial: Trial, gap: float) -> None:
    """Two drops nearer than 2 r share one surface, and run together."""
    one = disc(6.0)
    place = np.vstack([one, one + [12.0 + gap, 0.37, 0.0]])
    ledger = free_body(trial, liquid(place), 0.2, angular=REMADE)
    size = trial.context.started[-1].shared["surface"].latest.component_size
    trial.check("particles in one component", float(np.asarray(size).min()), equals=len(place))
    trial.check("extent over the start's", ledger.last("extent") / ledger.rows[0]["extent"], at_most=0.98)


@hard_case
def cavity(trial: Trial) -> None:
    """A hole narrower than 2 r has no surface: without tension it closes only as the liquid around it moves."""
    place = disc(9.0)
    place = place[np.linalg.norm(place, axis=1) > 1.1]
    free_body(trial, liquid(place), 0.1)
    sample = trial.context.started[-1].shared["surface"].sample_position / CELLS[2]
    trial.check("samples in the hole", int((np.linalg.norm(sample, axis=1) < 3).sum()), equals=0)


@hard_case
def far_end(trial: Trial, cells: float, velocity: float) -> None:
    """A drop `cells` before the last cell of the grid; with a velocity [m/s] it flies over it."""
    place = disc(3.0) + [FARTHEST - cells, -FARTHEST + cells, 0.0]
    free_body(trial, liquid(place, velocity=(velocity, 0.0, 0.0)), 0.02)


@hard_case
def on_nodes(trial: Trial) -> None:
    """A square whose particles stand on nodes and in the middle between them: every floor is a tie."""
    place = block((8, 8), (-0.25, -0.25, 0.0))
    assert not np.any((2 * place) % 1)
    free_body(trial, liquid(place), 0.1)


@hard_case
def spin(trial: Trial) -> None:
    """A disc of radius 8 h turns with 20 rad/s."""
    place = disc(8.0)
    centre = place.mean(0)
    velocity = DROP_SPIN * CELLS[2] * np.cross([0, 0, 1], place - centre)
    ledger = free_body(trial, liquid(place, velocity=velocity), 0.2, angular=REMADE)
    share = min(row["kinetic"] for row in ledger.rows) / ledger.rows[0]["kinetic"]
    trial.check("least kinetic energy over the start's", share, at_least=0.9)


@hard_case
def hard_square(trial: Trial, tension: float, modulus: float, cells: int = 10) -> None:
    """A square becomes a disc under another tension or stiffness."""
    free_body(trial, liquid(block((cells, cells)), tension=tension, modulus=modulus), 0.1, angular=REMADE)


@hard_case
def many_samples(trial: Trial) -> None:
    """A ball whose surface stays at r: some particles are the nearest of more than ten samples."""
    ledger = free_body(trial, liquid(block((4, 4, 4)), 3, inset=-1.0), 0.01, every=1, angular=REMADE)
    trial.check("largest C_p", max(row["samples"] for row in ledger.rows), at_least=11)


@hard_case
def as_printed(
    trial: Trial, dim: int, embedding: str, step: float, sign: bool, within: int, cells: int,
    halved_within: int = 0,
) -> None:  # fmt: skip
    """The source's scheme, with its own sign or with the sign alone corrected, until it ends.

    halved_within  steps within which a J falls below 1/2; a run is then taken for
                   failed; its block then stands on the grid's nodes, and samples are the source's, Poisson disks
    """
    place = block((cells,) * dim, *([(0.0, 0.0, 0.0)] if halved_within else []))
    made = liquid(
        place, dim, step=step, embedding=embedding, literal=("M31",) if sign else ("M1", "M31"),
        **({"quadrature": "poisson"} if halved_within else {}),
    )  # fmt: skip
    run, halved = None, 0
    with trial.ending():
        run = trial.context.simulation(unguarded(msgspec.structs.replace(made, step=step)), trial.backend)
        while run.steps < within:
            run.step()
            if not halved and run.field("volume_ratio").min() < 0.5:
                halved = run.steps
    trial.check("ended by itself", trial.ended.startswith("stopped"), equals=1)
    if halved_within:
        trial.check("a J falls below 1/2", halved, at_least=1)
        trial.check("step in which it first does", halved, at_most=halved_within)
    trial.show("step in which J first falls below 1/2", halved)
    if run is not None:
        trial.check("steps", run.steps, at_most=within)
        trial.check("places that are finite", int(np.isfinite(run.field("position")).all()), equals=1)


# The largest stable step


def natural(dim: int, modulus: float, tension: float) -> float:
    """min(h/c, sqrt(rho0 h^3/(2 pi k))) [s], rho0 = 1 kg/m^3."""
    h = CELLS[dim]
    return min(h / math.sqrt(modulus), math.sqrt(h**3 / (2 * math.pi * tension)))


def step_cell(
    context: Context, backend: str, dim: int, cells: int, until: float, modulus: float, tension: float,
    embedding: str, inset: float,
) -> Result:  # fmt: skip
    """The largest step, over min(acoustic, capillary), with which a square or a cube rounds off."""
    made = liquid(
        block((cells,) * dim), dim, modulus=modulus, tension=tension, embedding=embedding, inset=inset,
    )  # fmt: skip
    unit = natural(dim, modulus, tension)
    try:
        bound, refused = context.simulation(made, backend).step().length / unit, False
    except InputError:
        bound, refused = 0.0, True

    def trouble(number: float) -> str:
        run = context.simulation(unguarded(msgspec.structs.replace(made, step=number * unit)), backend)
        context.started[:-1] = []
        ledger = FreeLedger()
        try:
            run.step()
            ledger(run)
            while run.time < until:
                run.step()
                if run.steps % 25 == 0:
                    ledger(run)
            ledger(run)
        except RunStopped as stop:
            return f"stopped: {stop.reason} in step {run.steps}"
        most = max(row["energy"] for row in ledger.rows) / ledger.rows[0]["energy"]
        return f"{most:.2f} times the energy" if most > ENERGY else ""

    return largest_stable(trouble, 0.5, LEAST, 4.0, factor=1.15).result(bound, refused=refused)


LEAST = 0.01  # of the natural step: the smallest that is tried
ENERGY = 1.02  # times the energy after the first step, which a stable run never exceeds
HARD_READINGS = {
    "cluster": ("cluster", 0.25), "cluster, no inset": ("cluster", -1.0),
    "none": ("none", 0.25), "none, no inset": ("none", -1.0),
    "gradient-corrected": ("gradient_corrected", 0.25),
    "gradient-corrected, no inset": ("gradient_corrected", -1.0),
    "thesis (4.14)": ("thesis", 0.25), "thesis (4.14), no inset": ("thesis", -1.0),
}  # fmt: skip
LIQUIDS: Mapping[str, dict[str, Any]] = {
    "square, lambda 1000, k 1": {"modulus": 1000.0, "tension": 1.0},
    "square, lambda 100, k 1": {"modulus": 100.0, "tension": 1.0},
    "square, lambda 10,000, k 1": {"modulus": 10000.0, "tension": 1.0},
    "square, lambda 1000, k 0.1": {"modulus": 1000.0, "tension": 0.1},
    # as many capillary times sqrt(rho0 R^3/k) as 0.1 s at k = 1
    "square, lambda 1000, k 10": {"modulus": 1000.0, "tension": 10.0, "until": 0.03},
    "cube, lambda 1000, k 1": {"modulus": 1000.0, "tension": 1.0, "dim": 3, "cells": 10, "until": 0.04},
}
PLANE = {"dim": 2, "cells": 20, "until": 0.1}
STEPS = tuple(
    Cell(
        row, column, step_cell, {**PLANE, **given, "embedding": reading, "inset": inset},
        100.0 if inset < 0 and given["tension"] / given["modulus"] >= 0.01 else 25.0,
    )
    for row, (reading, inset) in HARD_READINGS.items()
    for column, given in LIQUIDS.items()
)  # fmt: skip
MAPS = {"stability_mpm_step": STEPS}


# The material point method with surface tension: transfers, drops that round off, rest, swing, meet and stand on
# floors, and its speed beside Taichi.


COLUMNS = {
    "grid_mass": "mass on the grid", "grid_momentum": "momentum on the grid", "momentum": "momentum there and back",
    "velocity": "v", "gradient": "A at the surface", "power": "power balance",
}  # fmt: skip


ENCLOSING = {"enclose_volume": True}
# What brings the box to rest: no liquid comes to rest without viscosity, and soonest with about the one that damps mode
# 2 critically, rho w R^2/5 = 0.25. lambda is twice that of the other drops, so that the surface's pressure takes half a
# per cent of the volume.
RESTFUL = {"dynamic_viscosity": 0.3, "bulk_modulus": 2000.0}
# The box again, in other cells and turns, fuller, and less viscous: (side of its cube [cells], particles along a cell,
# seed of its turn, viscosity)
BOXES = {
    "turn_5": (10.0, 2, 5, 0.3), "turn_7": (10.0, 2, 7, 0.3), "coarse": (6.5, 2, 3, 0.3), "fine": (15.0, 2, 3, 0.3),
    "full": (10.0, 3, 3, 0.3), "thin": (10.0, 2, 3, 0.12),
}  # fmt: skip
DAMPED = {"dynamic_viscosity": 0.05}
RESTS = (  # dim, radius [cells], inset; panels hold other discs, and those that swing
    (2, 5.5, "default"), (2, 11.0, "default"), (3, 6.0, "default"), (3, 6.0, "enclosing"),
)  # fmt: skip
# Blocks beside Taichi on a GPU: cells along an axis, order of the particles in memory, turns
PEER_BLOCKS = ((64, "lattice", 3), (64, "cells", 3), (64, "random", 3), (128, "lattice", 2), (128, "random", 1),
               (128, "cells", 1))  # fmt: skip
# Errata whose printed reading a run can take; docs/errata.md says what each does
ERRATA = ("", "M1", "M3", "M4", "M5", "M6", "M7", THESIS, "M13", "M14", "M27", "M31", "M32")


def bodies(options: Options) -> list[RunSpec]:
    """Drops under surface tension."""
    backend, quick = options.backend, options.quick
    made: list[RunSpec] = []

    def add(key: str, function: Any, estimate: float, small: bool = False, **parameters: Any) -> None:
        if small == quick:
            slow = estimate > 500 and backend != "cuda"
            skip = "takes more than ten minutes on two threads; run with --backend cuda" if slow else ""
            made.append(RunSpec(key, function, {"backend": backend, **parameters}, estimate, skip))

    shown = [0.0, 0.02, 0.04, 0.08, 0.16, 0.5]
    settled = {"shape": "box", "until": 0.55, "tension": ENCLOSING}
    add("box", rounding, 110.0, size=10.0, shown=shown, liquid=RESTFUL, **settled)
    for name, (size, per, seed, viscosity) in BOXES.items():
        liquid = {**RESTFUL, "dynamic_viscosity": viscosity}
        seconds = 110.0 * (size / 10) ** 5 * (per / 2) ** 3
        add(f"box_{name}", rounding, seconds, size=size, cell=CELLS[3] * 10 / size, per=per, seed=seed,
            liquid=liquid, **settled)  # fmt: skip
    add("box_default", rounding, 40.0, shape="box", size=10.0, until=0.3, shown=[0.3])
    add("cube", rounding, 35.0, shape="cube", size=10.0, until=0.28, shown=[0.0, 0.02, 0.04, 0.28])
    for dim, radius, inset in RESTS:
        until = 0.4 if dim == 2 else 0.12
        add(f"rest_{dim}d_{radius:g}_{inset}", at_rest, 1e-3 * radius**3 * (20 if dim == 3 else 2), dim=dim,
            radius=radius, until=until, tension=ENCLOSING if inset == "enclosing" else {},
            shown=[0.0, until / 4, until / 2, until])  # fmt: skip
    add("collision_2d", collision, 15.0, dim=2, radius=8.0, speed=1.0, until=0.3, shown=[0.0, 0.05, 0.15, 0.3])
    add("collision_3d", collision, 60.0, dim=3, radius=5.0, speed=1.0, until=0.2, step=2e-4,
        shown=[0.0, 0.02, 0.05, 0.1, 0.15, 0.2])  # fmt: skip
    add("sheet", sheet, 10.0, length=40.0, thick=1.0, tension=0.1, until=0.07, shown=[0.0, 0.02, 0.04, 0.06])
    for printed in ERRATA:
        for dim, size, until in ((2, 12.0, 0.15), (3, 6.0, 0.06)):
            key = f"erratum_{dim}d_{printed.replace(', ', '_') or 'none'}"
            add(key, erratum, 6.0, printed=printed, dim=dim, size=size, until=until)
    add("small_box", rounding, 4.0, True, shape="box", size=5.0, until=0.02, tension=ENCLOSING, liquid=RESTFUL)
    add("small_rest", at_rest, 1.0, True, dim=2, radius=5.5, until=0.05)
    return made


def planned(options: Options) -> list[RunSpec]:
    """The runs under the options."""
    quick, backend = options.quick, {"backend": options.backend}
    reason = "takes minutes with the others; run without --quick" if quick else ""
    asked = "" if options.peers else "measured with --peers"
    until = 0.2 if quick else 0.6
    body = {"shape": "square", "size": 20.0, "until": until, "shown": [0.0, *FRAMES, until], **backend}
    peer = {"cells": 24 if quick else 40, "steps": 10, "rounds": 3 if quick else 5, "threads": options.threads or 2}
    beside = [RunSpec("peer_taichi", against_taichi, peer | backend, 60.0, asked)]
    if options.backend == "cuda":
        beside = [
            RunSpec(f"peer_taichi_{cells}_{order}", against_taichi,
                peer | backend | {"cells": cells, "order": order, "rounds": rounds, "steps": 100},
                0.1 * cells * rounds, asked)
            for cells, order, rounds in PEER_BLOCKS[: 1 if quick else None]
        ]  # fmt: skip
    return [
        RunSpec("transfers", transfers, {}, 5.0),
        *(RunSpec(f"square_{name}", rounding, {"tension": {"embedding": name}, **body}, 10.0 if quick else 40.0,
              reason if name != "cluster" else "") for name in READINGS),
        *bodies(options),
        *beside,
    ]  # fmt: skip


def checks(results: Results, check: Checks) -> None:
    """The cluster's errors and ledgers are judged, the printed readings' shown."""
    kept: Quantities = {f"cluster_{name}": lambda v, n=name: v["readings"]["cluster"][n] for name in COLUMNS}
    kept = {**kept, "cluster_power": lambda v: abs(v["readings"]["cluster"]["power"] - 1)}
    check.run(results, "transfers", kept)
    for reading in ("thesis", "gradient_corrected"):
        gradient: Quantities = {"reading_gradient": lambda v, r=reading: v["readings"][r]["gradient"]}
        check.run(results, "transfers", gradient, reading)
    for reading in READINGS:
        rule = "square" if reading == "cluster" else "reading"
        names = ("momentum", "angular", "centre", "least_ratio", "energy_rise")
        check.run(results, f"square_{reading}", {f"{rule}_{name}": name for name in names}, reading)
    check_bodies(results, check)
    for key, values in peers(results).items():
        if not values["missing"]:
            label = "Taichi" if key == "peer_taichi" else f"Taichi, {values['particles']:,} ({values['order']})"
            rule = "peer_ratio" if key == "peer_taichi" else "peer_ratio_gpu"
            check(rule, values["ratio"], key.removeprefix("peer_"), label)
            check("peer_difference", values["difference"], key.removeprefix("peer_"), label)


def peers(results: Results) -> dict[str, Mapping[str, Any]]:
    """What the runs beside Taichi found."""
    return {key: result.values for key, result in results.items() if key.startswith("peer_taichi")}


JUDGED = ("box", "box_turn_5", "box_turn_7", "box_fine", "box_full")
ROUNDED = ("box", *(f"box_{name}" for name in BOXES), "box_default", "cube")


def check_bodies(results: Results, check: Checks) -> None:
    """Shapes, pressures, frequencies, angles and ledgers of the drops."""
    for key in (*ROUNDED, "small_box"):
        rule = "box" if key in JUDGED else "shape"
        check.run(results, key, {
            f"{rule}_sphericity": lambda v: v["last"]["sphericity"]["least"],
            f"{rule}_sphericity_most": lambda v: v["last"]["sphericity"]["largest"],
            f"{rule}_volume": lambda v: max(abs(v["last"]["volume"][name] - 1) for name in ("least", "largest")),
            f"{rule}_anisotropy": lambda v: v["last"]["anisotropy"]["largest"],
            f"{rule}_particle_anisotropy": lambda v: v["last"]["particle_anisotropy"]["largest"],
        }, key)  # fmt: skip
    for key in (*ROUNDED, "small_box", "collision_2d", "collision_3d", "sheet"):
        rules = {f"drop_{name}": name for name in ("momentum", "angular", "centre", "energy_rise")}
        shown = {"energy_rise": key not in JUDGED, "angular": key not in ROUNDED}
        check.run(results, key, {name if shown.get(name) else rule: name for rule, name in rules.items()}, key)
    for inset in ("default", "enclosing"):
        check.run(results, f"rest_3d_6_{inset}", {"laplace_3d": lambda v: abs(v["pressure"] - 1)}, inset)
    check.run(results, "sheet", {"sheet_speed": lambda v: abs(v["speed"] / v["culick"] - 1)})


EXPERIMENT = Experiment(
    name="mpm_droplet",
    title="transfers of MPM, drops that round off, rest and meet, speed beside Taichi",
    runs=planned, checks=checks,
)  # fmt: skip
