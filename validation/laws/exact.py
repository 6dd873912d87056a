"""What must hold in every scene: rest, Archimedes, shapes that do not matter, and values in closed form."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np

from refsim.core.capabilities import PullsParticles, with_scene_defaults
from refsim.core.effect import EFFECTS, Effect
from refsim.engine.simulation import Simulation
from refsim.heat import HeatConduction
from refsim.scene.scene import Scene
from refsim.scene.shapes import Box, Cloud
from refsim.scene.solids import SolidBall, SolidBox
from refsim.sph import Gravity, WeaklyCompressible
from validation.laws.laws import STEPS, Found, apart, claims, lattice, law, made, of_kind, own_scene, run
from validation.laws.scenes import Drawn
from validation.laws.units import without
from validation.running import take_steps


@law("rest")
def full_tank(drawn: Drawn, backend: str) -> Found | None:
    """An advanced density's lattice that fills the bottom of a box: in the mean 10 % of the speed of a fall at most."""
    return _rest(drawn, backend, _calm(drawn.scene), "a tank on its lattice")


@law("addition")
def weak_tension(drawn: Drawn, backend: str) -> Found | None:
    """A tension at a Bond number of 1e5 must not matter: the tank rests as without it."""
    kinds: list[Any] = [k for k in EFFECTS.values() if issubclass(k, PullsParticles) and "surface_tension" in k.scales]
    liquid, kind = of_kind(drawn.scene, WeaklyCompressible), kinds[drawn.random().integers(len(kinds))]
    if liquid is None:
        return None
    pull = liquid.rest_density * liquid.sound_speed**2 / 400  # rho g H
    tension = kind(surface_tension=pull * drawn.cells[-1] * drawn.scene.spacing / 1e5)
    return _rest(drawn, backend, (*_calm(drawn.scene), tension), f"{kind.name} at a Bond number of 1e5")


def _calm(scene: Scene) -> tuple[Effect, ...]:
    """The effects that pull no particles."""
    return tuple(e for e in scene.effects if not {"surface_tension", "area_acceleration"} & {*e.scales})


def _rest(drawn: Drawn, backend: str, effects: tuple[Effect, ...], how: str) -> Found | None:
    if not drawn.filled:
        return None
    scene, down = drawn.scene, np.zeros(3)
    box, c = Box(cells=(*drawn.cells, 1)[:3]), of_kind(scene, WeaklyCompressible).sound_speed
    down[scene.dim - 1] = -(c**2) / (400 * drawn.cells[-1] * scene.spacing)
    still = [e for e in effects if e.name not in ("gravity", "box_walls")] + [Gravity(acceleration=tuple(down))]
    walls = next(e for e in effects if e.name == "box_walls")
    still.append(msgspec.structs.replace(walls, moving_faces=(), velocity=(0.0, 0.0, 0.0)))
    settled: Any = with_scene_defaults(still)["weakly_compressible"]
    if not settled.advances():
        return None
    tank = msgspec.structs.replace(scene, fluid=(box,), effects=tuple(still), motion=())
    simulation = run(tank, backend)
    speed = np.linalg.norm(simulation.field("velocity").astype(float), axis=1).mean()
    return Found(float(speed / (-down.sum() * simulation.time)), 0.1, how, tank)


def tank(cells: tuple[int, ...], d: float, g: float, rho: float, damping: float) -> tuple[Effect, ...]:
    """Liquid, gravity and walls of a tank twice as high as so many cells."""
    dim, c = len(cells), 10 * math.sqrt(2 * g * cells[-1] * d)
    down, top = np.zeros(3), np.zeros(3)
    down[dim - 1], top[:dim] = -g, np.array(cells) * d
    top[dim - 1] *= 2
    liquid = WeaklyCompressible(rest_density=rho, sound_speed=c, dynamic_viscosity=rho * c * 2.62 * d * damping)
    walls = EFFECTS["box_walls"](lower=(0.0, 0.0, 0.0), upper=tuple(top))  # type: ignore[call-arg]
    return (liquid, Gravity(acceleration=tuple(down)), walls)


@law("Archimedes", own=True)
def lift(drawn: Drawn, backend: str) -> Found | None:
    """Bodies held anywhere in a tank at rest are lifted by what they displace, to no side; to 0.5 % at h = 3 d."""
    random = drawn.random()
    size, wide, high, g, rho = int(random.integers(2, 4)), int(random.integers(6, 8)), 9, 9.81, 1000.0
    h, bound = ((2.62, 0.03), (3.0, 0.005))[random.integers(2)]
    d, cells = 10.0 ** random.uniform(-3, 0), (wide, wide, high)
    low = [np.array([*random.integers(0, wide - size + 1, 2), random.integers(0, 3)]) for _ in range(2)]
    low[1][2] = low[0][2] + (size if np.abs(low[1][:2] - low[0][:2]).max() < size else 0)
    low = low[: int(random.integers(1, 3))] if low[1][2] + size <= high - 2 else low[:1]
    x = lattice(cells, d)
    inside = np.any([((x > d * at) & (x < d * (at + size))).all(1) for at in low], axis=0)
    effects = (*tank(cells, d, g, rho, 1 / 250), EFFECTS["shape_matching"](), EFFECTS["two_way_coupling"]())
    solid = tuple(SolidBox(lower=tuple(at * d), upper=tuple((at + size) * d), density=900.0) for at in low)
    scene = own_scene(d, h, (Cloud(position=x[~inside]),), effects, solid=solid)
    simulation = made(scene, backend)
    simulation.evaluate()
    m, a = (simulation.field(name).astype(float) for name in ("mass", "acceleration"))
    force = (m[:, None] * (a + [0.0, 0.0, g]))[: len(low) * size**3].reshape(len(low), size**3, 3).sum(1)
    off = force / (rho * g * (size * d) ** 3) - [0.0, 0.0, 1.0]
    return Found(
        float(np.abs(off).max()), bound, f"bodies of {size} at {[at.tolist() for at in low]} of {cells} cells", scene
    )


@law("shape does not matter", own=True)
def strip(drawn: Drawn, backend: str) -> Found:
    """A cosine along an insulated strip or rod of any thickness decays as it does along a line, to 1 %."""
    random, dim = drawn.random(), drawn.scene.dim
    across = tuple(int(random.integers(1, 6)) for _ in range(dim - 1))
    along = 24
    d = 10.0 ** random.uniform(-3, 0)
    k, rho, capacity = (10.0 ** random.uniform(-1, 3) for _ in range(3))
    h = float(random.choice([2.13, 2.62, 3.21]))
    diffusivity = k / (rho * capacity)
    rate = (2 / d * math.sin(math.pi / (2 * along))) ** 2 * diffusivity  # that of the chain of cells
    conduction = HeatConduction(conductivity=k, heat_capacity=capacity, density=rho, temperature=0.0)
    scene = own_scene(d, h, (Box(cells=(along, *across, 1)[:3]),), (conduction,), dim=dim, step=0.002 / rate)
    simulation = made(scene, backend)
    mode = np.cos(np.pi * simulation.field("position")[:, 0].astype(float) / (along * d))
    simulation.set_field("temperature", 50 + 40 * mode)
    take_steps(simulation, 4)  # backward Euler is 0.1 % off in such steps
    left = (mode * (simulation.field("temperature").astype(float) - 50)).sum() / (40 * (mode**2).sum())
    found = -math.log(left) / simulation.time
    exact = (math.pi / (along * d)) ** 2 * diffusivity
    return Found(abs(found / exact - 1), 0.01, f"{along} x {across} cells, h = {h:.2f} d", scene)


@law("shape does not matter", own=True)
def column(drawn: Drawn, backend: str) -> Found:
    """Under liquid of any width the pressure is rho g times the depth, to 1 % of the height's, while it settles 6 %."""
    random, dim = drawn.random(), drawn.scene.dim
    high = int(random.integers(6, 10))
    cells = (*(int(random.integers(2, 9 if dim == 2 else 5)) for _ in range(dim - 1)), high)
    d, g, rho = 10.0 ** random.uniform(-3, 0), 10.0 ** random.uniform(-1, 2), 10.0 ** random.uniform(0, 4)
    scene = own_scene(d, 2.62, (Box(cells=(*cells, 1)[:3]),), tank(cells, d, g, rho, 1 / 60), dim=dim)
    steps = int(random.choice([0, 10]))
    simulation = run(scene, backend, steps)
    p, x = (simulation.field(name).astype(float) for name in ("pressure", "position"))
    off = float(np.abs(p / (rho * g) - high * d + x[:, dim - 1]).max()) / (high * d)
    return Found(off, 0.06 if steps else 0.01, f"{cells} cells", scene)


@law("exact")
def free_fall(drawn: Drawn, backend: str) -> Found | None:
    """The centre of mass falls with g, whatever the forces between particles are, as long as they keep momentum."""
    gravity = of_kind(drawn.scene, Gravity)
    if gravity is None or drawn.scene.motion or drawn.scene.solid:
        return None
    step = 0.2 * run(drawn.scene, backend, 1).time
    simulation = made(msgspec.structs.replace(drawn.scene, step=step), backend)
    if not claims(made(without(drawn.scene, "gravity"), backend), "linear_momentum"):
        return None
    mean = []
    for steps in (0, STEPS):
        take_steps(simulation, steps)
        mean.append(np.average(simulation.field("velocity").astype(float), 0, simulation.field("mass")))
    exact = np.array(gravity.acceleration) * (simulation.time - step / 2)  # velocities are those of half a step before
    size = float(np.abs(simulation.field("velocity")).max())
    return Found(apart(mean[1] - mean[0], exact) / size, 1e-9, "velocity of the centre of mass")


@law("exact", own=True)
def rigid_spin(drawn: Drawn, backend: str) -> Found:
    """A cube or a ball alone flies and turns as a rigid body: its particles are off by 1 % of its size at most."""
    random, d = drawn.random(), 10.0 ** drawn.random().uniform(-3, 0)
    size, w, v = int(random.integers(2, 5)), random.uniform(-10, 10, 3), d * random.uniform(-10, 10, 3)
    center = np.full(3, size * d / 2)
    given = {"density": 10.0 ** random.uniform(1, 4), "spin": tuple(w), "velocity": tuple(v)}
    box = SolidBox(lower=(0.0,) * 3, upper=(size * d,) * 3, **given)
    body = box if random.random() < 0.5 else SolidBall(center=tuple(center), radius=0.51 * size * d, **given)
    scene = own_scene(d, 2.62, (), (EFFECTS["shape_matching"](),), solid=(body,), end_time=0.1)
    simulation = made(scene, backend)
    x = simulation.field("position").astype(float) - center
    while simulation.time < 0.1 and simulation.steps < 20:
        simulation.step()
    angle = np.linalg.norm(w) * simulation.time
    axis = w / np.linalg.norm(w)
    cos, sin = math.cos(angle), math.sin(angle)
    turned = x * cos + np.cross(axis, x) * sin + np.outer(x @ axis, axis) * (1 - cos)
    off = simulation.field("position").astype(float) - center - v * simulation.time - turned
    return Found(float(np.abs(off).max()) / (size * d), 0.01, f"{len(x)} particles, {angle:.2f} rad", scene)


def periodic(drawn: Drawn, n: int, velocity: Any, **liquid: Any) -> Scene:
    """A periodic lattice, n particles along x and 8 across; velocity(x / (n d)) [c] along x and y."""
    random = drawn.random()
    d, c, rho = (10.0 ** random.uniform(*ends) for ends in ((-3, 0), (0, 2), (0, 4)))
    h, x = float(random.choice([2.62, 3.21])), lattice((n, 8), d)
    v = np.zeros_like(x)
    v[:, 0], v[:, 1] = c * np.array(velocity(x[:, 0] / (n * d)))
    mu = liquid.pop("damping") * rho * c * h * d
    effect = WeaklyCompressible(rest_density=rho, sound_speed=c, dynamic_viscosity=mu, **liquid)
    return own_scene(d, h, (Cloud(position=x, velocity=v),), (effect,), dim=2, period=(n * d, 8 * d, 0.0))


def sine(simulation: Simulation, axis: int) -> float:
    """Amplitude of the sine along x in a velocity [m/s]."""
    x, v = (simulation.field(name).astype(float) for name in ("position", "velocity"))
    return float(2 * (v[:, axis] * np.sin(2 * np.pi * x[:, 0] / simulation.plan.grid.period[0])).mean())


def shear_decays(drawn: Drawn, backend: str, n: int, damping: float, **given: Any) -> tuple[float, Scene]:
    """Rate of a wave of shear over nu k^2, less 1."""
    scene = periodic(drawn, n, lambda s: (0 * s, 1e-4 * np.sin(2 * np.pi * s)), damping=damping, **given)
    simulation, liquid = run(scene, backend, 1), scene.effects[0]
    first, since = sine(simulation, 1), simulation.time
    take_steps(simulation, 6)
    rate = liquid.dynamic_viscosity / liquid.rest_density * (2 * np.pi / (n * scene.spacing)) ** 2
    return math.log(first / sine(simulation, 1)) / (simulation.time - since) / rate - 1, scene


@law("exact", own=True)
def shear(drawn: Drawn, backend: str) -> Found:
    """A wave of shear in a periodic lattice decays with nu k^2, to 8 %."""
    random = drawn.random()
    drawn_from = {"viscosity": ["central", "laplacian"], "density": ["summation", "continuity"]}
    given = {name: str(random.choice(values)) for name, values in drawn_from.items()}
    off, scene = shear_decays(drawn, backend, 16, float(random.uniform(0.01, 0.2)), **given)
    return Found(abs(off), 0.08, f"{given}, h = {scene.support_radius / scene.spacing:.2f} d", scene)


@law("refinement", own=True)
def half_the_spacing(drawn: Drawn, backend: str) -> Found:
    """With twice the particles along a wave of shear its rate is nearer to nu k^2: 0.6 of the error, or within 3 %."""
    (coarse, _), (fine, scene) = (shear_decays(drawn, backend, n, 0.1) for n in (12, 24))
    return Found(abs(fine), max(0.6 * abs(coarse), 0.03), "12 and 24 particles along a wave", scene)


@law("exact", own=True)
def sound(drawn: Drawn, backend: str) -> Found:
    """A standing wave of sound in a periodic lattice swings with c k, to 8 %: velocity after a sixth of a period."""
    random, n = drawn.random(), 20
    given: Any = {"clamp_pressure": False, "damping": 0.0, "state": str(random.choice(["linear", "tait"]))}
    given["density"] = str(random.choice(["summation", "continuity"]))
    scene = periodic(drawn, n, lambda s: (1e-4 * np.sin(2 * np.pi * s), 0 * s), **given)
    simulation, c = made(scene, backend), scene.effects[0].sound_speed
    first, k, last = sine(simulation, 0), 2 * np.pi / (n * scene.spacing), 0.0
    while c * k * simulation.time < 1.0:
        last = simulation.time
        simulation.step()
    phase = c * k * (simulation.time + last) / 2  # velocities are those of half a step before
    found = math.acos(min(1.0, sine(simulation, 0) / first))
    return Found(abs(found / phase - 1), 0.08, f"{given}, h = {scene.support_radius / scene.spacing:.2f} d", scene)


@law("exact", own=True)
def plates(drawn: Drawn, backend: str) -> Found:
    """Liquid between plates that hold it keeps the linear profile of Couette, to 4 % of the plate's speed."""
    random, rows = drawn.random(), int(drawn.random().integers(6, 11))
    d, c, rho = (10.0 ** random.uniform(*ends) for ends in ((-3, 0), (0, 2), (0, 4)))
    u, x = 0.02 * c, lattice((10, rows), d)
    v = np.zeros_like(x)
    v[:, 0] = u * x[:, 1] / (rows * d)
    walls: Any = EFFECTS["box_walls"](  # type: ignore[call-arg]
        lower=(0.0, 0.0, 0.0), upper=(10 * d, rows * d, 0.0), open_faces=("-x", "+x"), no_slip=True,
        moving_faces=("+y",), velocity=(u, 0.0, 0.0),
    )  # fmt: skip
    liquid = WeaklyCompressible(rest_density=rho, sound_speed=c, dynamic_viscosity=0.3 * rho * c * 2.62 * d)
    part = Cloud(position=x, velocity=v)
    scene = own_scene(d, 2.62, (part,), (liquid, walls), dim=2, period=(10 * d, 0.0, 0.0))
    simulation = run(scene, backend, 20)
    y, found = simulation.field("position").astype(float)[:, 1], simulation.field("velocity").astype(float)[:, 0]
    return Found(float(np.abs(found / u - y / (rows * d)).max()), 0.04, f"{rows} rows", scene)


@law("rest", own=True)
def carried(drawn: Drawn, backend: str) -> Found:
    """Shifting spreads no free block that flies: its width stays within 1 %, its particles 0.7 spacings apart."""
    random = drawn.random()
    d, c = 10.0 ** random.uniform(-3, 0), 10.0 ** random.uniform(0, 2)
    h, x = float(random.choice([2.62, 3.21])), lattice((10, 10), d)
    x[:, :2] += 0.05 * d * random.uniform(-1, 1, (len(x), 2))
    liquid = WeaklyCompressible(sound_speed=c, dynamic_viscosity=1000 * c * h * d / 60)
    part = Cloud(position=x, velocity=np.broadcast_to([0.1 * c, 0.05 * c, 0.0], x.shape).copy())
    scene = own_scene(d, h, (part,), (liquid, EFFECTS["particle_shifting"]()), dim=2)
    simulation = run(scene, backend, 30)
    y = simulation.field("position").astype(float)
    near = np.linalg.norm(y[:, None] - y[None], axis=-1) + 9 * d * np.eye(len(y))
    wide = float(y.std(0)[:2].sum() / x.std(0)[:2].sum())
    return Found(max(abs(wide - 1), max(0.0, 0.7 - float(near.min()) / d)), 0.01, "a block of 10 x 10", scene)
