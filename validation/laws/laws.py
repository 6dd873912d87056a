"""What must hold in every scene, each law one function of a drawn scene.

A law returns what it found, the bound and how the scene was varied, or None where it does not apply. Lengths are in
spacings unless said. A run of STEPS steps amplifies rounding by less than AMPLIFIED in scenes of so few particles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import msgspec
import numpy as np

from refsim.core.capabilities import BringsWalls, CorrectsPositions, effects_with, with_scene_defaults
from refsim.core.effect import EFFECTS
from refsim.core.operation import REGISTRY
from refsim.engine.simulation import Simulation
from refsim.heat import HeatConduction
from refsim.scene.scene import Scene
from refsim.scene.shapes import Box, Cloud
from refsim.scene.solids import SolidBox
from refsim.sph import Gravity, WeaklyCompressible
from validation.laws.scenes import Drawn
from validation.laws.units import Unit, scaled, units_of, with_effect, without
from validation.running import take_steps

STEPS = 8
AMPLIFIED = 1e8
EPSILON = float(np.finfo(float).eps)
ROUNDING = AMPLIFIED * EPSILON  # spacings


class Found(NamedTuple):
    """What a law found, what it allows, and how the scene was varied."""

    value: float
    bound: float
    how: str = ""
    scene: Scene | None = None  # where it is not the drawn one

    @property
    def held(self) -> bool:
        """Whether the law held."""
        return self.value <= self.bound


LAWS: dict[str, list[Callable[[Drawn, str], Found | None]]] = {}


def law(name: str) -> Callable[[Any], Any]:
    """Add a function (drawn scene, backend) -> Found to the laws of that name."""

    def add(function: Any) -> Any:
        LAWS.setdefault(name, []).append(function)
        return function

    return add


def run(scene: Scene, backend: str, steps: int = STEPS) -> Simulation:
    """The scene after some steps."""
    simulation = Simulation(scene, backend, threads=1 if backend == "cpu" else None)
    take_steps(simulation, steps)
    return simulation


def places(simulation: Simulation) -> np.ndarray:
    """Positions [spacings]."""
    return simulation.field("position").astype(float) / simulation.plan.grid.spacing


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference."""
    return float(np.abs(a - b).max()) if a.size else 0.0


def cloud(scene: Scene) -> Cloud:
    """The liquid of a drawn scene."""
    return scene.fluid[0]


def of_kind(scene: Scene, kind: type) -> Any:
    """The scene's effect of that kind."""
    return next((e for e in scene.effects if isinstance(e, kind)), None)


# Absence


@law("absence")
def zero_is_absence(drawn: Drawn, backend: str) -> Found | None:
    """An effect whose coefficients are zero leaves the others' run as it is, to the bit."""
    scene, random = drawn.scene, drawn.random()
    chosen = [e for e in scene.effects if e.scales]
    if not chosen:
        return None
    effect = chosen[random.integers(len(chosen))]
    nothing = {name: _zero(value) for name in effect.scales if (value := getattr(effect, name)) is not None}
    with_zero = with_effect(scene, msgspec.structs.replace(effect, **nothing))
    a, b = run(without(scene, effect.name), backend), run(with_zero, backend)
    return Found(apart(places(a), places(b)), 0.0, f"{effect.name}: {', '.join(nothing)} = 0")


def _zero(value: Any) -> Any:
    return (0.0,) * len(value) if isinstance(value, tuple) else 0.0


@law("absence")
def looking_changes_nothing(drawn: Drawn, backend: str) -> Found | None:
    """Fields computed on demand between steps, and checkpoints, leave the run as it is, to the bit."""
    plain = run(drawn.scene, backend)
    watched = Simulation(drawn.scene, backend)
    for _ in range(STEPS):
        watched.step()
        watched.evaluate()
        watched.snapshot()
    return Found(apart(places(plain), places(watched)), 0.0, "evaluated after each step")


# Units and frames


@law("units")
def other_units(drawn: Drawn, backend: str) -> Found:
    """The same scene in other units of length, time, mass and temperature: the same run."""
    factors = Unit(*(10.0 ** drawn.random().uniform(-2, 2, 4)))
    a, b = run(drawn.scene, backend), run(scaled(drawn.scene, factors), backend)
    late = abs(a.time * factors.time / b.time - 1) if b.time else 0.0
    return Found(max(apart(places(a), places(b)), late), ROUNDING, f"units {tuple(float(f'{f:.3g}') for f in factors)}")


def by_chance(scene: Scene) -> bool:
    """Whether an effect draws numbers, one particle after the other."""
    return any("seed" in e.__struct_fields__ and e.passes({o.name: o for o in scene.effects}) for e in scene.effects)


@law("frames")
def other_order(drawn: Drawn, backend: str) -> Found | None:
    """The same particles in another order."""
    if by_chance(drawn.scene):
        return None
    order = drawn.random().permutation(len(cloud(drawn.scene).position))
    a, b = run(drawn.scene, backend), run(_moved(drawn.scene, lambda x, v: (x[order], v[order])), backend)
    return Found(apart(places(a)[order], places(b)), ROUNDING, "order of the particles")


@law("frames")
def turned(drawn: Drawn, backend: str) -> Found | None:
    """Axes exchanged: a mirror image in the plane, a turn by 120 degrees or a mirror image in space."""
    if by_chance(drawn.scene):
        return None
    dim = drawn.scene.dim
    axes = [1, 0, 2] if dim == 2 else [[1, 2, 0], [2, 0, 1], [1, 0, 2]][drawn.random().integers(3)]
    scene = _moved(drawn.scene, lambda x, v: (x[:, axes], v[:, axes]))
    effects = []
    for effect in scene.effects:
        vectors = {
            name: tuple(np.array(getattr(effect, name))[axes])
            for name in units_of(type(effect), dim)
            if isinstance(getattr(effect, name), tuple) and len(getattr(effect, name)) == 3
        }
        effects.append(msgspec.structs.replace(effect, **vectors))
    a, b = run(drawn.scene, backend), run(msgspec.structs.replace(scene, effects=tuple(effects)), backend)
    return Found(apart(places(a)[:, axes], places(b)), ROUNDING, f"axes {axes}")


@law("frames")
def far_away(drawn: Drawn, backend: str) -> Found:
    """Moved by a whole number of spacings: as far as float64 carries it."""
    scene, dim = drawn.scene, drawn.scene.dim
    k = float(drawn.random().choice([-38.0, 1024.0]))  # cells of MPM are two spacings
    way = np.where(np.arange(3) < dim, k * scene.spacing, 0.0)
    moved = _moved(scene, lambda x, v: (x + way, v))
    effects = [
        msgspec.structs.replace(e, **{n: tuple(np.add(getattr(e, n), way)) for n in e.places}) if e.places else e
        for e in moved.effects
    ]
    a, b = run(scene, backend), run(msgspec.structs.replace(moved, effects=tuple(effects)), backend)
    return Found(apart(places(a)[:, :dim] + k, places(b)[:, :dim]), abs(k) * ROUNDING, f"moved by {k:g} spacings")


@law("frames")
def boosted(drawn: Drawn, backend: str) -> Found | None:
    """Without walls, a common velocity is added to all positions; with a fixed step, which speeds would shorten."""
    scene = drawn.scene
    liquid = of_kind(scene, WeaklyCompressible)
    if liquid is None or effects_with(scene.effects, BringsWalls) or corrected(scene):
        return None
    scene = msgspec.structs.replace(scene, step=0.05 * scene.support_radius / liquid.sound_speed)
    u = 0.1 * liquid.sound_speed
    boost = np.array([u, 0.0, 0.0])
    a, b = run(scene, backend), run(_moved(scene, lambda x, v: (x, v + boost)), backend)
    way = boost * a.time / scene.spacing
    return Found(apart(places(a) + way, places(b)), 10 * ROUNDING, f"boosted by {u:g} m/s")


@law("frames")
def given_otherwise(drawn: Drawn, backend: str) -> Found | None:
    """A block as one box, as two, and as a cloud of the same places."""
    scene, cells, dim = drawn.scene, drawn.cells, drawn.scene.dim
    full = (*cells, 1)[:3] if dim == 2 else cells
    at = int(drawn.random().integers(1, cells[0]))
    whole = Box(cells=full)
    two = (Box(cells=(at, *full[1:])), Box(lower=(at * scene.spacing, 0.0, 0.0), cells=(full[0] - at, *full[1:])))
    made = [run(msgspec.structs.replace(scene, fluid=parts), backend) for parts in ((whole,), two)]
    a, b = (places(each)[np.lexsort(_start(each).T)] for each in made)
    return Found(apart(a, b), ROUNDING, f"a box, and two that share a face at {at} cells")


def _start(simulation: Simulation) -> np.ndarray:
    return np.round(simulation.plan.state.position / simulation.plan.grid.spacing, 3)


def _moved(scene: Scene, change: Callable[[Any, Any], Any]) -> Scene:
    """The scene with other places and velocities of its liquid."""
    liquid = cloud(scene)
    x, v = change(liquid.position, liquid.velocity)
    return msgspec.structs.replace(scene, fluid=(msgspec.structs.replace(liquid, position=x, velocity=v),))


# Ledger


def claims(simulation: Simulation, what: str) -> bool:
    """Whether every operation of a step that adds to the acceleration claims to conserve it."""
    plan = simulation.plan
    adding = [p.operation for _, p in plan.passes if not p.on_demand and "acceleration" in p.written]
    by_particles = of_kind(plan.scene, WeaklyCompressible) and not corrected(plan.scene) and plan.walls is None
    return bool(by_particles) and all(what in REGISTRY[name].invariants for name in adding)


def corrected(scene: Scene) -> bool:
    """Whether an effect moves particles by other displacements than dt v, which follow the largest speed."""
    return any(
        effect.corrects_positions() for effect in effects_with(with_scene_defaults(scene.effects), CorrectsPositions)
    )


@law("ledger")
def linear_momentum(drawn: Drawn, backend: str) -> Found | None:
    """Momentum is kept where all forces are between particles; with gravity it grows by M g t."""
    return _momentum(drawn, backend, "linear_momentum", lambda x, u: u)


@law("ledger")
def angular_momentum(drawn: Drawn, backend: str) -> Found | None:
    """Angular momentum about the centre of mass, where all forces claim to keep it and nothing is shifted."""
    return _momentum(drawn, backend, "angular_momentum", np.cross)


def _momentum(drawn: Drawn, backend: str, what: str, of: Callable[[Any, Any], Any]) -> Found | None:
    scene = without(drawn.scene, "gravity")
    simulation = Simulation(scene, backend)
    if not claims(simulation, what):
        return None
    m = simulation.field("mass").astype(float)[:, None]

    def total() -> tuple[np.ndarray, float]:
        x, v = (simulation.field(name).astype(float) for name in ("position", "velocity"))
        x = x - (m * x).sum(0) / m.sum()
        each = m * of(x, v)
        return each.sum(0), float(np.abs(each).sum())

    before, size = total()
    take_steps(simulation, STEPS)
    after, later = total()
    return Found(float(np.abs(after - before).max()) / max(size, later), 1e-11, what.replace("_", " "))


@law("ledger")
def heat(drawn: Drawn, backend: str) -> Found | None:
    """Heat is kept where nothing is held."""
    conduction = of_kind(drawn.scene, HeatConduction)
    if conduction is None or conduction.held:
        return None
    simulation = Simulation(drawn.scene, backend)
    temperature = drawn.random().uniform(0, 100, simulation.count)
    simulation.set_field("temperature", temperature)
    before = conduction_sum(simulation)
    take_steps(simulation, STEPS)
    return Found(abs(conduction_sum(simulation) / before - 1), 1e-9, "temperatures at random")


def conduction_sum(simulation: Simulation) -> float:
    """Heat by mass, capacity and temperature [J], counted here; without latent heat."""
    effect = simulation.plan.effects["heat_conduction"]
    capacity = np.broadcast_to(np.asarray(effect.heat_capacity, dtype=float), ())
    return float((simulation.field("mass") * capacity * simulation.field("temperature")).sum())


# Told is counted


@law("told is counted")
def mass(drawn: Drawn, backend: str) -> Found:
    """The particles weigh what the liquid's density and their cells say, to the sum of a lattice (5 %)."""
    simulation = Simulation(drawn.scene, backend)
    liquid = next(e for e in drawn.scene.effects if hasattr(e, "rest_density"))
    volume = math.prod(drawn.cells) * drawn.scene.spacing**drawn.scene.dim
    return Found(abs(float(simulation.field("mass").sum()) / (liquid.rest_density * volume) - 1), 0.05, "total mass")


# Rest, Archimedes, shape, exact


@law("rest")
def full_tank(drawn: Drawn, backend: str) -> Found | None:
    """Liquid on a lattice that fills the bottom of a box: in the mean a quarter of the speed of a fall, at most.

    For a density that is advanced; the papers' summed one does not come to rest (docs/liquid.md).
    """
    pulling = ("surface_tension", "area_acceleration")
    calm = tuple(e for e in drawn.scene.effects if not any(name in e.scales for name in pulling))
    settled_liquid = with_scene_defaults(calm).get("weakly_compressible")
    if settled_liquid is None or not settled_liquid.advances():
        return None
    return _rest(drawn, backend, msgspec.structs.replace(drawn.scene, effects=calm), "a tank on its lattice")


@law("addition")
def weak_tension(drawn: Drawn, backend: str) -> Found | None:
    """A tension at a Bond number of 1e5 must not matter: the tank rests as without it."""
    tensions = [e for e in drawn.scene.effects if "surface_tension" in e.__struct_fields__]
    gravity = of_kind(drawn.scene, Gravity)
    if not tensions or gravity is None:
        return None
    liquid = next(e for e in drawn.scene.effects if hasattr(e, "rest_density"))
    depth = drawn.cells[-1] * drawn.scene.spacing
    g = float(np.linalg.norm(gravity.acceleration))
    given = {"surface_tension": liquid.rest_density * g * depth**2 / 1e5}
    scene = with_effect(drawn.scene, type(tensions[0])(**given))
    return _rest(drawn, backend, scene, f"{tensions[0].name} at a Bond number of 1e5")


def _rest(drawn: Drawn, backend: str, scene: Scene, how: str) -> Found | None:
    gravity = of_kind(scene, Gravity)
    if not drawn.filled or gravity is None:
        return None
    box = Box(cells=(*drawn.cells, 1)[:3])
    simulation = run(msgspec.structs.replace(scene, fluid=(box,)), backend)
    speed = np.linalg.norm(simulation.field("velocity").astype(float), axis=1).mean()
    return Found(float(speed / (np.linalg.norm(gravity.acceleration) * simulation.time)), 0.25, how)


@law("Archimedes")
def lift(drawn: Drawn, backend: str) -> Found | None:
    """A body held anywhere in a tank at rest is lifted by what it displaces and drawn to no side, to 3 %."""
    random, dim = drawn.random(), drawn.scene.dim
    size, high = 3, 9
    wide = 8 if dim == 2 else 6
    cells = (wide,) * (dim - 1) + (high,)
    d = 10.0 ** random.uniform(-3, 0)
    low = np.array([random.integers(0, wide - size + 1) for _ in range(dim - 1)] + [random.integers(0, 3)])
    g, rho = 9.81, 1000.0
    c = 10 * math.sqrt(2 * g * high * d)
    h = 2.62 * d
    grid = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), -1).reshape(-1, dim)
    inside = ((grid >= low) & (grid < low + size)).all(1)
    x = np.zeros((int((~inside).sum()), 3))
    x[:, :dim] = (grid[~inside] + 0.5) * d
    corners = np.zeros((2, 3))
    corners[:, :dim] = low * d, (low + size) * d
    if dim == 2:
        corners[1, 2] = d
    down, top = np.zeros((2, 3))
    down[dim - 1] = -g
    top[:dim] = np.array(cells) * d
    top[dim - 1] *= 2
    effects = [
        EFFECTS["weakly_compressible"](rest_density=rho, sound_speed=c, dynamic_viscosity=rho * c * h / 250),
        Gravity(acceleration=tuple(down)),
        EFFECTS["box_walls"](lower=(0.0, 0.0, 0.0), upper=tuple(top)),
        EFFECTS["shape_matching"](),
        EFFECTS["two_way_coupling"](),
    ]
    body = SolidBox(lower=tuple(corners[0]), upper=tuple(corners[1]), density=900.0)
    scene = Scene(
        dim=dim, dtype="float64", spacing=d, support_radius=h, solid=(body,), fluid=(Cloud(position=x),),
        effects=tuple(effects),
    )  # fmt: skip
    simulation = Simulation(scene, backend)
    simulation.evaluate()
    m = simulation.field("mass").astype(float)[: size**dim, None]
    force = (m * (simulation.field("acceleration").astype(float)[: size**dim] - down)).sum(0)
    weight = rho * g * (size * d) ** dim
    off = force / weight
    off[dim - 1] -= 1
    return Found(float(np.abs(off).max()), 0.03, f"a body at {low.tolist()} of {cells} cells", scene)


@law("shape does not matter")
def strip(drawn: Drawn, backend: str) -> Found:
    """A cosine along an insulated strip or rod of any thickness decays as it does along a line, to 1 %."""
    random, dim = drawn.random(), drawn.scene.dim
    across = tuple(int(random.integers(2, 6)) for _ in range(dim - 1))
    along = 24 if dim == 2 else 12
    d = 10.0 ** random.uniform(-3, 0)
    k, rho, capacity = (10.0 ** random.uniform(-1, 3) for _ in range(3))
    box = Box(cells=(along, *across, 1)[:3])
    h = d * float(random.choice([2.13, 2.62, 3.21]))
    diffusivity = k / (rho * capacity)
    rate = (2 / d * math.sin(math.pi / (2 * along))) ** 2 * diffusivity  # that of the chain of cells
    conduction = HeatConduction(conductivity=k, heat_capacity=capacity, density=rho, temperature=0.0)
    scene = Scene(
        dim=dim, dtype="float64", spacing=d, support_radius=h, fluid=(box,), step=0.002 / rate, effects=(conduction,)
    )
    simulation = Simulation(scene, backend)
    mode = np.cos(np.pi * simulation.field("position")[:, 0].astype(float) / (along * d))
    simulation.set_field("temperature", 50 + 40 * mode)

    def amplitude() -> float:
        return float((mode * (simulation.field("temperature").astype(float) - 50)).sum())

    start = amplitude()
    take_steps(simulation, 4)  # backward Euler is 0.1 % off in such steps
    found = -math.log(amplitude() / start) / simulation.time
    exact = (math.pi / (along * d)) ** 2 * diffusivity
    return Found(abs(found / exact - 1), 0.02, f"{along} x {across} cells, h = {h / d:.2f} d", scene)


@law("exact")
def free_fall(drawn: Drawn, backend: str) -> Found | None:
    """The centre of mass falls with g, whatever the forces between particles are, as long as they keep momentum."""
    gravity = of_kind(drawn.scene, Gravity)
    first = run(drawn.scene, backend, 1).time
    step = 0.2 * first
    simulation = Simulation(msgspec.structs.replace(drawn.scene, step=step), backend)
    if gravity is None or not claims(Simulation(without(drawn.scene, "gravity"), backend), "linear_momentum"):
        return None
    m = simulation.field("mass").astype(float)[:, None]
    start = (m * simulation.field("velocity").astype(float)).sum(0) / m.sum()
    take_steps(simulation, STEPS)
    end = (m * simulation.field("velocity").astype(float)).sum(0) / m.sum()
    exact = np.array(gravity.acceleration) * (simulation.time - step / 2)  # velocities are those of half a step before
    size = float(np.abs(simulation.field("velocity")).max())
    return Found(apart(end - start, exact) / size, 1e-9, "velocity of the centre of mass")


# The same run


@law("same run")
def resumed(drawn: Drawn, backend: str) -> Found:
    """Stopped after some steps, written, read and gone on: the same bits."""
    import tempfile
    from pathlib import Path

    first = int(drawn.random().integers(1, STEPS))
    whole, part = run(drawn.scene, backend), run(drawn.scene, backend, first)
    with tempfile.TemporaryDirectory() as folder:
        part.checkpoint(Path(folder) / "checkpoint.h5")
        resumed = Simulation.resume(Path(folder) / "checkpoint.h5", backend=backend)
    take_steps(resumed, STEPS - first)
    return Found(apart(places(whole), places(resumed)), 0.0, f"resumed after {first} steps")


@law("same run")
def single_precision(drawn: Drawn, backend: str) -> Found:
    """In float32 the same motion, to the rounding of float32."""
    a, b = run(drawn.scene, backend, 3), run(msgspec.structs.replace(drawn.scene, dtype="float32"), backend, 3)
    return Found(apart(places(a), places(b)), 1e-3, "float32")


@law("refinement")
def half_the_step(drawn: Drawn, backend: str) -> Found | None:
    """With half the step a run moves less than with the whole one: towards the solution in time."""
    scene = drawn.scene
    liquid = of_kind(scene, WeaklyCompressible)
    if liquid is None or corrected(scene) or any(e.host_in_step or e.replaces() for e in scene.effects):
        return None
    longest = run(scene, backend, 1).time
    made = [places(run(msgspec.structs.replace(scene, step=0.5 * longest / n), backend, 2 * n)) for n in (1, 2, 4)]
    coarse, fine = apart(made[0], made[1]), apart(made[1], made[2])
    return Found(fine, max(0.8 * coarse, ROUNDING), "half and a quarter of the step")
