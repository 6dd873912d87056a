"""Runs of boundary sampling and of liquid at meshes."""

import dataclasses
import itertools
import math
import time
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

import refsim
from refsim.backends.arrays import choose
from refsim.boundary.sampling import MOST_ITERATIONS, relaxed, sample
from refsim.boundary.signed_distance import NarrowBand, signed_distance
from refsim.core.errors import RunStopped
from refsim.core.walls import WallParticles
from refsim.scene.plan import make_plan
from refsim.scene.surface_mesh import SurfaceMesh, surface_mesh
from validation.checks import Checks
from validation.experiment import Experiment, Measure, Options, Results, RunSpec, each, every
from validation.experiments.boundary import scene as meshes
from validation.experiments.boundary.scene import FLOW_SHAPES as SOLIDS
from validation.experiments.boundary.scene import SHAPES, SPACING, SUPPORT
from validation.metrics.sampling import evenness, radius_for, score
from validation.metrics.spread import groups, tunnels
from validation.peers.couplings import DirectForcing, DistanceForces
from validation.results import Result, real
from validation.running import Context, on_threads
from validation.trials import Trial, hard_case, unguarded


def meshed(shape: str, count: int) -> tuple[Any, SurfaceMesh, float]:
    """A shape, its mesh as refsim takes it, and the radius of about so many particles on it."""
    made = SHAPES[shape]()
    mesh = meshes.mesh_of(made, shape)
    return made, mesh, radius_for(mesh.area, count)


def scorecard(context: Context, shape: str, count: int, backend: str, threads: int | None, seed: int = 0) -> Result:
    """Particles on one shape: how even they are, and what it took."""
    made, mesh, radius = meshed(shape, count)
    with on_threads(backend, threads) as there:
        sample(mesh, 2 * radius, backend=there, seed=seed)  # compiles
        began = time.perf_counter()
        placed = sample(mesh, radius, backend=there, seed=seed)
        seconds = time.perf_counter() - began
    context.progress(0.6)
    values = score(placed.position, placed.normal, made, radius)
    values |= {
        "shape": shape, "radius": radius, "iterations": placed.iterations, "converged": placed.converged,
        "seconds": seconds, "triangles": len(mesh.faces), "notes": list(placed.notes),
    }  # fmt: skip
    return Result(values, {"position": placed.position, "normal": placed.normal})


def printed(context: Context, shape: str, count: int, backend: str, iterations: int) -> Result:
    """The adopted rule beside the printed one (patent E24): displacements over the iterations."""
    _, mesh, radius = meshed(shape, count)
    rows: dict[str, Any] = {}
    arrays = {}
    for name, literal in (("adopted", ()), ("printed", ("E24",))):
        placed = sample(mesh, radius, backend=backend, literal=literal, most_iterations=iterations)
        rows[name] = {
            "iterations": placed.iterations, "converged": placed.converged, "residual": placed.residual,
            **evenness(placed.position),
        }  # fmt: skip
        arrays[name] = placed.residuals
        context.progress(0.5 * len(rows))
    return Result({"rows": rows}, arrays)


# Runs of liquid at meshes: rain, resting tanks, pouring.


DENSITY, SOUND, GRAVITY = 1000.0, 20.0, 9.81
RAIN = 2560  # particles
INSIDE = 0.01  # of a spacing: depth from which on a particle counts as inside


def liquid(sound: float = SOUND, viscosity: float = 0.5, **changes: Any) -> refsim.WeaklyCompressible:
    """Water-like liquid."""
    return refsim.WeaklyCompressible(
        rest_density=DENSITY, sound_speed=sound, dynamic_viscosity=viscosity, density="summation", **changes
    )


def depth(band: NarrowBand, position: NDArray) -> NDArray:
    """How deep particles are inside the solid [m]; negative outside."""
    return -band.at(np.ascontiguousarray(position, dtype=float))[0]


def rain_drops(count: int = RAIN, seed: int = 1) -> NDArray:
    """Scattered particles over the solid, at least 1.2 spacings apart, in a column 18 wide."""
    random = np.random.default_rng(seed)
    half, gap = 9 * SPACING, 1.2 * SPACING
    height = 2.6 * count * gap**3 / (2 * half) ** 2
    kept, number = np.empty((count, 3)), 0
    while number < count:
        p = random.uniform((-half, -half, 0), (half, half, height))
        if (((p - kept[:number]) ** 2).sum(1) > gap * gap).all():
            kept[number] = p
            number += 1
    return kept


def rain(
    context: Context, shape: str, correction: str, share: float, backend: str, count: int = RAIN, seed: int = 1
) -> Result:
    """Rain at 2 m/s on a shape, at `share` of the runner's step: who is found inside the solid after a step.

    share 1 is the runner's own step; other shares are fixed steps, so many times the first one.
    """
    drops = rain_drops(count, seed) + np.array([0, 0, 10 * SPACING])
    floor = refsim.BoxWalls(lower=(-0.15, -0.15, -0.15), upper=(0.15, 0.15, 1.0), open_faces=("+z",))
    step = 0.0 if share == 1 else share * 0.4 * SUPPORT / (SOUND + 2)
    with meshes.mesh_file(SOLIDS[shape]()) as file:
        boundary = refsim.MeshBoundary(file=file, correction=correction)  # type: ignore[arg-type]
        scene = refsim.Scene(
            spacing=SPACING, support_radius=SUPPORT, fluid=(refsim.Cloud(position=drops, velocity=(0.0, 0.0, -2.0)),),
            effects=(liquid(), refsim.Gravity(), floor, boundary), step=step,
        )  # fmt: skip
        simulation = context.simulation(scene, backend)
        band = boundary.placed(simulation.plan.grid).band
    ever, deepest, reason = np.zeros(len(drops), dtype=bool), 0.0, ""
    try:
        while simulation.time < 0.17:
            simulation.step()
            depths = depth(band, simulation.field("position"))
            ever |= depths > INSIDE * SPACING
            deepest = max(deepest, float(depths.max()))
            if simulation.steps % 16 == 0:
                context.progress(simulation.time / 0.17)
    except RunStopped as stop:
        reason = stop.reason
    return Result({
        "ever_inside": int(ever.sum()), "deepest_spacings": deepest / SPACING, "reason": reason,
        "corrections": int(simulation.field("corrections").sum()) if correction != "none" else 0,
        "steps": simulation.steps,
    })  # fmt: skip


CELLS = (10, 10, 14)
GAP = 1.0  # between walls and first layer at the start, in spacings
TANK_SUPPORT = 3.0 * SPACING  # where sums over the lattice deliver 99.7 % of a pressure gradient; 97.8 % at 2.7


def resting_scene(file: str, cells: tuple[int, int, int] = CELLS, **changes: Any) -> refsim.Scene:
    """Liquid in a cup that is a mesh, a spacing from its walls."""
    tall = cells[2] * SPACING
    return refsim.Scene(
        spacing=SPACING, support_radius=TANK_SUPPORT, dtype="float64",
        fluid=(refsim.Box(lower=((GAP - 0.5) * SPACING,) * 3, cells=cells),),
        effects=(
            liquid(sound=10 * math.sqrt(2 * GRAVITY * tall), viscosity=2.0), refsim.Gravity(),
            refsim.MeshBoundary(file=file, **changes),
        ),
    )  # fmt: skip


def resting_cup(cells: tuple[int, int, int] = CELLS) -> Any:
    """The cup for it, six spacings higher than the liquid."""
    return meshes.cup(inside_of(cells), 4 * SPACING)


def inside_of(cells: tuple[int, int, int]) -> tuple[float, float, float]:
    """Lengths of the cup's inside [m]."""
    a, b = ((n - 1 + 2 * GAP) * SPACING for n in cells[:2])
    return a, b, (cells[2] + 6) * SPACING


# Pouring: three arms

ARMS = {"none": "no tension", "cohesion": "pairwise cohesion", "difference": "normal difference (patent P7)"}
POUR = {"sphere": 0.3, "torus": 0.3, "plate": 0.3, "funnel": 0.4, "pebble": 0.3}  # simulated seconds
GAMMA = 0.1  # of the normal difference [m/s^2]
TENSION = 1.0  # nominal, of the cohesion [N/m]


def tension(arm: str) -> tuple[Any, ...]:
    """The effect of an arm."""
    if arm == "cohesion":
        return (refsim.Akinci2013(surface_tension=TENSION, area_acceleration=0.0),)
    return (refsim.NormalDifference2014(area_acceleration=GAMMA),) if arm == "difference" else ()


def pour(context: Context, shape: str, arm: str, backend: str, seconds: float = 0.0) -> Result:
    """A column of liquid falls on a shape, or into it; components and holes of what it becomes, at several times."""
    until = seconds or POUR[shape]
    with meshes.mesh_file(SOLIDS[shape]()) as file:
        boundary = refsim.MeshBoundary(file=file, viscosity=0.2)
        wide = 8
        low = 5.5 * SPACING if shape == "funnel" else 6.5 * SPACING
        column = refsim.Box(
            lower=(-0.5 * wide * SPACING, -0.5 * wide * SPACING, low), cells=(wide, wide, 18), velocity=(0.0, 0.0, -0.8)
        )
        floor = refsim.BoxWalls(lower=(-0.16, -0.16, -0.12), upper=(0.16, 0.16, 0.6), open_faces=("+z",))
        scene = refsim.Scene(
            spacing=SPACING, support_radius=SUPPORT, fluid=(column,),
            effects=(liquid(), refsim.Gravity(), floor, boundary, *tension(arm)),
        )  # fmt: skip
        simulation = context.simulation(scene, backend)
        placed = boundary.placed(simulation.plan.grid)
        frames, values, inside = [], [], 0
        for at in np.linspace(0, until, 7)[1:]:
            while simulation.time < at:
                simulation.step()
            position = simulation.field("position").astype(float)
            inside = max(inside, int((depth(placed.band, position) > INSIDE * SPACING).sum()))
            frames.append(position)
            values.append({"time": float(at), **texture(position)})
            context.progress(at / until)
        speed = np.sqrt((simulation.field("velocity") ** 2).sum(1))
    return Result(
        {
            "frames": values, "inside": inside, "particles": simulation.count, "steps": simulation.steps,
            "corrections": int(simulation.field("corrections").sum()), "greatest_speed": float(speed.max()),
        },
        {"position": np.array(frames, dtype=np.float32), "solid": placed.position.astype(np.float32)},
    )  # fmt: skip


def texture(position: NDArray) -> dict[str, float]:
    """Components of a liquid, whose particles belong together within 1.5 spacings, and its holes.

    A hole is a ring in which the liquid's film has a gap: loops of the graph that no triangles fill, counted by the
    Euler characteristic of edges and triangles of its thin parts.
    """
    return {"components": len(np.unique(groups(position, 1.5 * SPACING))), "holes": tunnels(position, SPACING)}


# The coupling beside two others (`validation.peers.couplings`).

RIVAL_CELLS = (7, 7, 9)  # of the first tank in which they are compared
SHARES = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)  # of the runner's step
SECONDS = 0.6  # simulated
CALM = 0.15  # [m/s], root mean square speed at the end, of a tank that holds
COUPLINGS = {"own": "one-way coupling", "distance": "distance-based forces", "forcing": "direct forcing"}


def tank(coupling: str, file: str, cells: tuple[int, int, int], share: float) -> refsim.Scene:
    """The tank at rest with a fixed step; only the project's own coupling puts the solid into the scene."""
    scene = resting_scene(file, cells)
    if coupling != "own":
        scene = msgspec.structs.replace(scene, effects=scene.effects[:-1])
    sound = scene.effects[0].sound_speed  # type: ignore[attr-defined]
    return msgspec.structs.replace(scene, step=share * 0.4 * scene.support_radius / sound)


def stiffness_of(cells: tuple[int, int, int]) -> float:
    """k [m/s^2] for which a tenth of a spacing stops what has fallen from the liquid's height: g H/(d/10)."""
    return GRAVITY * cells[2] * SPACING / (0.1 * SPACING)


def coupled(coupling: str, simulation: refsim.Simulation, solid: Any, cells: tuple[int, int, int]) -> Any:
    """The simulation, or a rival around it."""
    if coupling == "distance":
        return DistanceForces(simulation, solid.position, solid.normal, stiffness_of(cells))
    return DirectForcing(simulation, solid.position, solid.normal) if coupling == "forcing" else simulation


def rest(
    context: Context, coupling: str, share: float, backend: str, seconds: float = SECONDS,
    cells: tuple[int, int, int] = RIVAL_CELLS,
) -> Result:  # fmt: skip
    """A tank at rest for a while: does it hold, and how much does the wall's force vary?

    The wall's force is the rate of the liquid's momentum, plus its weight.
    """
    with meshes.mesh_file(resting_cup(cells)) as file:
        scene = tank(coupling, file, cells, share)
        simulation = context.simulation(unguarded(scene, 0.0), backend)
        solid = refsim.MeshBoundary(file=file).placed(simulation.plan.grid)
        run = coupled(coupling, simulation, solid, cells)
        mass = simulation.field("mass")
        weight = float(mass.sum() * GRAVITY)
        momentum, forces, speed, reason = 0.0, [], math.nan, ""
        steps = round(seconds / scene.step)
        try:
            for k in range(steps):
                run.step()
                now = float(mass @ simulation.field("velocity")[:, 2])
                forces.append((now - momentum) / scene.step + weight)
                momentum = now
                if k % 20 == 0:
                    context.progress(k / steps)
        except RunStopped as stop:
            reason = stop.reason
        position = simulation.field("position")
        inner = inside_of(cells)
        outside = (position < 0) | (position > np.array(inner))
        lost = int((outside.any(1) | ~np.isfinite(position).all(1)).sum())
        speed = float(np.sqrt((simulation.field("velocity") ** 2).sum(1).mean()))
    last = np.array(forces[-len(forces) // 5 :])
    noise = float(last.std() / weight) if len(last) else math.inf
    searches = simulation.search.log.rebuilds + getattr(run, "queries", 0)  # type: ignore[union-attr]
    return Result({
        "step": scene.step, "share": share, "lost": lost, "speed": speed, "noise": noise, "reason": reason,
        "force": float(last.mean() / weight) if len(last) else math.nan,
        "searches": searches / max(simulation.steps, 1),
        "holds": bool(not reason and lost == 0 and speed < CALM),
    })  # fmt: skip


def cost(context: Context, cells: tuple[int, int, int], steps: int, backend: str) -> Result:
    """Milliseconds a step without a solid and with each coupling, in turn; what it adds, in fifths."""
    with meshes.mesh_file(resting_cup(cells)) as file:
        runs = {}
        for coupling in ("bare", *COUPLINGS):
            scene = tank(coupling, file, cells, 0.25)
            simulation = context.simulation(scene, backend)
            solid = refsim.MeshBoundary(file=file).placed(simulation.plan.grid)
            runs[coupling] = coupled(coupling, simulation, solid, cells)
            for _ in range(3):
                runs[coupling].step()
        spent: dict[str, list[float]] = {coupling: [] for coupling in runs}
        for k in range(steps):
            for coupling, run in runs.items():
                began = time.perf_counter()
                run.step()
                spent[coupling].append(time.perf_counter() - began)
            context.progress((k + 1) / steps)
    fifths = {c: [float(np.median(part)) for part in np.array_split(np.array(each), 5)] for c, each in spent.items()}
    shares = {c: [(t - b) / t for t, b in zip(fifths[c], fifths["bare"])] for c in COUPLINGS}
    milliseconds = {c: 1e3 * float(np.median(each)) for c, each in spent.items()}
    return Result({"milliseconds": milliseconds, "shares": shares, "particles": simulation.count})


# What the patent claims: how boundary particles spread; steps, noise and cost against the rivals of `rivals`.


TANKS = {
    "": RIVAL_CELLS, "_small": (6, 6, 8), "_wide": (8, 8, 6), "_flat": (9, 7, 5), "_narrow": (5, 6, 10),
}  # fmt: skip  # particles, in which largest steps are sought
STARTS = (0.8, 0.9, 1.0, 1.1, 1.2)  # shares of the runner's step at which noise is compared
CALMED = 2.0  # [s], by when the tanks rest
BLOCK = (20, 20, 16)  # particles of the tank that is timed


def _rests(*couplings: str) -> Callable[[Options], list[RunSpec]]:
    runs = {
        f"rival{tank}_{name}_{share:g}": {"coupling": name, "share": share, **({"cells": cells} if tank else {})}
        for tank, cells in TANKS.items() for name in couplings for share in SHARES
    }  # fmt: skip
    return every(rest, runs, 10.0)


def _calmed(*couplings: str) -> Callable[[Options], list[RunSpec]]:
    starts = itertools.product(couplings, STARTS)
    runs = {f"rival_noise_{name}_{share:g}": {"coupling": name, "share": share} for name, share in starts}
    return every(rest, runs, 15.0, seconds=CALMED)


def largest_share(results: Results, coupling: str, tank: str = "") -> float:
    """The largest step, as a share of the runner's, up to which all steps hold; 0 for none."""
    largest = 0.0
    for share in SHARES:
        result = results.get(f"rival{tank}_{coupling}_{share:g}")
        if result is None or not result.values["holds"]:
            break
        largest = share
    return largest


def _over(rival: str, runs: Callable[..., Callable[[Options], list[RunSpec]]], of: Callable[[Results, str], list[float]]
          ) -> Measure:  # fmt: skip
    """What `of` says of the coupling over what it says of a rival; infinite where that is 0."""

    def values(results: Results) -> list[float]:
        return [refsim / other if other else math.inf for refsim, other in zip(of(results, "own"), of(results, rival))]

    return Measure(runs("own", rival), values)


def _largest_steps(results: Results, coupling: str) -> list[float]:
    """The coupling's largest step, as a share of the runner's, tank by tank."""
    return [largest_share(results, coupling, tank) for tank in TANKS]


def _noises(results: Results, coupling: str) -> list[float]:
    return [real(results[f"rival_noise_{coupling}_{share:g}"].values["noise"]) for share in STARTS]


_cost = every(cost, {"rival_cost": {"cells": BLOCK, "steps": 40}}, 40.0)


def _share_over(rival: str) -> Measure:
    """Share of a step less the rival's: a rival may cost less than can be timed, and a ratio would divide by it."""

    def values(results: Results) -> list[float]:
        return [refsim - other for refsim, other in zip(_of_step(results, "own"), _of_step(results, rival))]

    return Measure(_cost, values, timed=True)


def _of_step(results: Results, coupling: str) -> list[float]:
    return [real(share) for share in results["rival_cost"].values["shares"][coupling]]


_arms = itertools.product(POUR, ("cohesion", "difference"))
_pours = every(pour, {f"flow_pour_{shape}_{arm}": {"shape": shape, "arm": arm} for shape, arm in _arms}, 8.0)


def _holes(results: Results) -> list[float]:
    """Holes half-way and at the end, of the normal difference over those of cohesion, shape by shape."""
    counts = {key: sum(real(results[key].values["frames"][k]["holes"]) for k in (2, 5)) for key in results}
    return [counts[f"flow_pour_{shape}_difference"] / max(counts[f"flow_pour_{shape}_cohesion"], 1.0) for shape in POUR]


# P3 and P4: the velocity along the normal keeps particles on the surface, that along the tangent spreads them.

CLAIM_SOLIDS = ("sphere", "torus", "cube", "needle", "plate")
PARTICLES = 1000


def distances(made: object, position: np.ndarray, radius: float) -> float:
    """Largest distance of a place from the trimesh mesh `made` [r]."""
    import trimesh

    return float(trimesh.proximity.closest_point(made, position)[1].max()) / radius


def spread(context: Context, shape: str, backend: str) -> Result:
    """Boundary particles of a solid before and after they have moved: unevenness of their distances, and how far off
    the surface they are [r]."""
    made, mesh, radius = meshed(shape, PARTICLES)
    placed, moved = (
        sample(mesh, radius, backend=backend, most_iterations=most).position for most in (0, MOST_ITERATIONS)
    )
    return Result({
        "before": evenness(placed)["variation"], "after": evenness(moved)["variation"],
        "off": distances(made, moved, radius),
    })  # fmt: skip


_spreads = every(spread, {f"claim_spread_{shape}": {"shape": shape} for shape in CLAIM_SOLIDS}, 5.0)


def _thrown_off(measure: Measure) -> list[float]:
    """The same measure on random places of a sphere, each moved by r along its normal."""
    place = np.random.default_rng(1).normal(size=(PARTICLES, 3))
    place /= np.linalg.norm(place, axis=1)[:, None]
    made = SHAPES["sphere"]()
    radius = radius_for(made.area, PARTICLES)
    reach = float(np.linalg.norm(np.asarray(made.vertices), axis=1).max())
    cv = evenness(place)["variation"]
    return measure.of({"": {"before": cv, "after": cv, "off": distances(made, place * (reach + radius), radius)}})


COUPLING_NO_NET = Measure(_pours, _holes, quick=False)
CLAIMS = {}
for _rival in ("distance", "forcing"):
    CLAIMS[f"coupling_step_over_{_rival}"] = _over(_rival, _rests, _largest_steps)
    CLAIMS[f"coupling_noise_over_{_rival}"] = _over(_rival, _calmed, _noises)
    CLAIMS[f"coupling_share_over_{_rival}"] = _share_over(_rival)
COUPLING_SHARE_OF_STEP = Measure(_cost, lambda found: _of_step(found, "own"), timed=True)
SAMPLING_STAYS_ON_SURFACE = Measure(_spreads, each("off"))
SAMPLING_SPREADS = Measure(_spreads, each("after", "before"))


# Hard cases of meshes, of sampling, and of liquid at meshes.


def _box(size: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    made = meshes.tilted(trimesh.creation.box(size))
    return np.array(made.vertices), np.array(made.faces)


@hard_case
def thin_plate(trial: Trial, thickness: float) -> None:
    """A plate thinner than the particles, tilted: the grid is made finer, and both sides get particles."""
    mesh = surface_mesh(*_box((1.0, 0.8, thickness)), "plate")
    placed = sample(mesh, 0.03, backend=trial.backend)
    trial.check("count off", abs(len(placed.position) - placed.expected), at_most=1.0)
    trial.check("values that are not finite", int((~np.isfinite(placed.position)).sum()), equals=0)
    trial.show("notes", list(placed.notes))


@hard_case
def piled(trial: Trial) -> None:
    """All particles at one place at the start."""
    there = choose(trial.backend)
    band = signed_distance(meshes.mesh_of(SHAPES["sphere"](3), "ball"), 0.1, backend=there)
    start = there.asarray(np.repeat(np.array([[0.0, 0.0, 0.99]], np.float32), 100, axis=0))
    end = there.host(relaxed(there, band.local.field, start, 0.1, 0, False, 200)[0])
    trial.check("least distance of two particles over r", evenness(end)["mean"] / 0.1, at_least=0.5)
    trial.check("furthest from the ball", float(np.abs(np.linalg.norm(end, axis=1) - 1).max()), at_most=0.02)


# Liquid at meshes

STEP, HARD_SOUND = 2e-4, 20.0  # [s], [m/s]
LIQUID = refsim.WeaklyCompressible(sound_speed=HARD_SOUND, dynamic_viscosity=0.5, density="summation")


@hard_case
def shots(trial: Trial, shape: str, spacings: float, begin: float) -> None:
    """Lone particles that fly down on a solid at `spacings` a step from `begin` [m] over its middle; none gets in."""
    x, y = np.meshgrid(np.arange(-3, 4), np.arange(-3, 4))
    at = np.stack([0.012 * x.ravel(), 0.012 * y.ravel(), np.full(x.size, begin)], axis=1)
    at[:, 2] += 0.1 * SPACING * np.arange(x.size) % SPACING
    fluid = refsim.Cloud(position=at, velocity=(0.0, 0.0, -spacings * SPACING / STEP))
    with meshes.mesh_file(SOLIDS[shape]()) as file:
        boundary = refsim.MeshBoundary(file=file, field_spacing=0.0025)
        scene = refsim.Scene(
            spacing=SPACING, support_radius=1.1 * SPACING, fluid=(fluid,), effects=(LIQUID, boundary), step=STEP
        )
        simulation = trial.start(scene)
        solid = boundary.placed(simulation.plan.grid)

        def watch(simulation: Any) -> None:
            depth = -solid.distance(simulation.field("position").astype(float)).min() / SPACING
            trial.check("greatest depth [d]", depth, at_most=0.02)

        trial.advance(simulation, steps=60, watch=watch)
        trial.check("corrections", simulation.field("corrections").sum(), at_least=1)


@hard_case
def coincident(trial: Trial) -> None:
    """Every boundary particle stands there twice, with half the volume each: liquid falls on them as on one."""
    with meshes.mesh_file(SOLIDS["plate"]()) as file:
        block = refsim.Box(lower=(-0.03, -0.03, 0.013), cells=(6, 6, 4))
        effects = (LIQUID, refsim.Gravity(), refsim.MeshBoundary(file=file))
        plan = make_plan(refsim.Scene(spacing=SPACING, support_radius=2.7 * SPACING, fluid=(block,), effects=effects))
        twice = WallParticles(np.repeat(plan.walls.position, 2, axis=0), 0.5 * np.repeat(plan.walls.volume, 2))
        places = []
        for walls in (plan.walls, twice):
            simulation = trial.start(dataclasses.replace(plan, walls=walls))
            trial.advance(simulation, steps=40)
            places.append(simulation.field("position"))
        trial.check("difference [d]", np.abs(places[0] - places[1]).max() / SPACING, at_most=1e-3)


# Solids given as meshes: distance, particles spread over them, and liquid that meets them (patent CN104318598A).


def sampling_planned(options: Options) -> list[RunSpec]:
    """Sampling."""
    backend, threads = {"backend": options.backend}, {"threads": options.threads}
    iterations = 200 if options.quick else 400
    return [
        *(RunSpec(f"sampling_{shape}", scorecard, {"shape": shape, "count": 5000, **backend, **threads}, 6.0)
          for shape in SHAPES),
        RunSpec("sampling_printed", printed,
            {"shape": "cube", "count": 2000, "iterations": iterations, **backend}, 5.0),
    ]  # fmt: skip


SCORES = {
    "sampling_count": "count_error", "sampling_least": "least", "sampling_variation": "variation",
    "sampling_off": "off", "sampling_holes": "holes", "sampling_blue": "blue", "sampling_force": "force_noise",
    "sampling_iterations": "iterations", "sampling_seconds": "seconds",
}  # fmt: skip


def sampling_checks(results: Results, check: Checks) -> None:
    """Sampling."""
    for shape in SHAPES:
        check.run(results, f"sampling_{shape}", SCORES, shape)
    residuals = {
        f"{name}_residual": lambda v, name=name: v["rows"][name]["residual"] for name in ("printed", "adopted")
    }
    check.run(results, "sampling_printed", residuals)


RAINED = ("sphere", "torus", "cube", "needle", "plate", "funnel", "pebble")
CORRECTIONS = {"none": "no correction", "point": "where the step ends", "swept": "swept"}
JUDGED_SHARES = (0.5, 1.0, 1.55)  # of the runner's step, which 1 stands for; it refuses fixed steps over 1.6
QUICK_RAIN, QUICK_POUR = 640, 0.1  # particles; simulated seconds


def _rains(options: Options) -> list[RunSpec]:
    """Rain at the runner's own step, tested at the end of a step, as the patent has it: the experiment's own runs."""
    given = {"correction": "point", "share": 1.0, "backend": options.backend}
    return [RunSpec(f"flow_rain_{shape}_point_1", rain, {"shape": shape, **given}, 5.0) for shape in RAINED]


COUPLING_KEEPS_OUT = Measure(_rains, each("ever_inside"), quick=False)


def flow_planned(options: Options) -> list[RunSpec]:
    """Liquid at meshes; the quick ones are one rain and one pour."""
    reason = "takes minutes; run without --quick" if options.quick else ""
    backend = {"backend": options.backend}
    fewer = {"count": QUICK_RAIN} if options.quick else {}
    shorter = {"seconds": QUICK_POUR} if options.quick else {}
    rains = [
        (shape, correction, share)
        for shape in RAINED
        for correction in CORRECTIONS
        for share in (JUDGED_SHARES if correction != "point" else JUDGED_SHARES[1:])
    ]
    return [
        *(RunSpec(f"flow_rain_{s}_{c}_{share:g}", rain,
              {"shape": s, "correction": c, "share": share, **backend, **fewer}, 5.0,
              "" if (s, c, share) == ("sphere", "swept", 1) else reason) for s, c, share in rains),
        *(RunSpec(f"flow_pour_{shape}_{arm}", pour, {"shape": shape, "arm": arm, **backend, **shorter}, 8.0,
              "" if (shape, arm) == ("sphere", "difference") else reason) for shape in POUR for arm in ARMS),
    ]  # fmt: skip


def flow_checks(results: Results, check: Checks) -> None:
    """No leaks at the runner's own step, and what is shown of the rest."""
    for shape in RAINED:
        check.run(results, f"flow_rain_{shape}_swept_1", {"rain_leaks": "ever_inside"}, shape)
        for correction in ("none", "swept"):
            runs = {share: results.get(f"flow_rain_{shape}_{correction}_{share:g}") for share in JUDGED_SHARES}
            if all(runs.values()):
                largest = max([s for s, r in runs.items() if r and not r.values["ever_inside"]], default=0.0)
                check(f"rain_step_{correction}", largest, shape)
    for shape, arm in itertools.product(POUR, ARMS):
        check.run(results, f"flow_pour_{shape}_{arm}", {"pour_leaks": "inside"}, f"{shape}_{arm}")


EXPERIMENT = Experiment(
    name="boundary",
    title="meshes as boundaries: particles, penetration, pouring by tension",
    runs=lambda options: [*sampling_planned(options), *flow_planned(options)],
    checks=lambda results, check: (sampling_checks(results, check), flow_checks(results, check)),
)  # fmt: skip
