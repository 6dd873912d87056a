"""What must hold in every scene: rest, closed forms, ledgers, what is told against a recount, true silence."""

import contextlib
import math
import tempfile
from typing import Any

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from refsim.core.capabilities import PullsParticles, with_scene_defaults
from refsim.core.effect import EFFECTS, Effect
from refsim.core.errors import RunStopped
from refsim.engine.driver import simulate
from refsim.engine.simulation import Simulation
from refsim.gauges import Gauge
from refsim.heat import HeatConduction
from refsim.io.results import open_run
from refsim.scene.plan import make_plan
from refsim.scene.refine import refined
from refsim.scene.shapes import Ball, Box, Cloud, FluidMesh
from refsim.scene.solids import SolidBall, SolidBox, SolidMesh
from refsim.sph import Gravity, WeaklyCompressible
from refsim.surface_tension.cohesion import PairCohesion
from validation.laws.laws import STEPS, Found, apart, claims, keeps, lattice, law, made, of_kind, own_scene, run, warmed
from validation.laws.scenes import Drawn
from validation.laws.units import CORNERS, TRIANGLES, hexahedron, mesh_file, without
from validation.running import take_steps


@law("rest")
def full_tank(drawn: Drawn, backend: str, *more: Effect) -> Found | None:
    """An advanced density's lattice that fills the bottom of a box: in the mean 10 % of the speed of a fall at most."""
    if not drawn.filled:
        return None
    scene, down = drawn.scene, np.zeros(3)
    box, c = Box(cells=(*drawn.cells, 1)[:3]), of_kind(scene, WeaklyCompressible).sound_speed
    down[scene.dim - 1] = -(c**2) / (400 * drawn.cells[-1] * scene.spacing)
    pulling = {"surface_tension", "area_acceleration"}  # and what is given anew
    kept = [e for e in scene.effects if e.name not in ("gravity", "box_walls") and not pulling & {*e.scales}]
    walls: Any = next(e for e in scene.effects if e.name == "box_walls")
    still = (*kept, Gravity(acceleration=tuple(down)), *more)
    still += (msgspec.structs.replace(walls, moving_faces=(), velocity=(0.0, 0.0, 0.0)),)
    settled: Any = with_scene_defaults(still)["weakly_compressible"]
    if not settled.advances():
        return None
    simulation = run(tank := msgspec.structs.replace(scene, fluid=(box,), effects=still, motion=()), backend)
    speed = np.linalg.norm(simulation.field("velocity").astype(float), axis=1).mean()
    return Found(float(speed / (-down.sum() * simulation.time)), 0.1, ", ".join(e.name for e in more), tank)


@law("addition")
def weak_tension(drawn: Drawn, backend: str) -> Found | None:
    """A tension at a Bond number of 1e5 must not matter: the tank rests as without it."""
    kinds: list[Any] = [k for k in EFFECTS.values() if issubclass(k, PullsParticles) and "surface_tension" in k.scales]
    liquid, kind = of_kind(drawn.scene, WeaklyCompressible), kinds[drawn.random().integers(len(kinds))]
    pull = liquid.rest_density * liquid.sound_speed**2 / 400 if liquid else 0.0  # rho g H
    return full_tank(drawn, backend, kind(surface_tension=pull * drawn.cells[-1] * drawn.scene.spacing / 1e5))


def tank(cells: tuple[int, ...], d: float, g: float, rho: float, damping: float) -> tuple[Effect, ...]:
    """Liquid, gravity and walls of a tank twice as high as so many cells."""
    dim, c = len(cells), 10 * math.sqrt(2 * g * cells[-1] * d)
    up = np.arange(3) == dim - 1
    top = np.pad(d * np.array(cells), (0, 3 - dim)) * np.where(up, 2, 1)
    liquid = WeaklyCompressible(rest_density=rho, sound_speed=c, dynamic_viscosity=rho * c * 2.62 * d * damping)
    walls = EFFECTS["box_walls"](lower=(0.0, 0.0, 0.0), upper=tuple(top))  # type: ignore[call-arg]
    return (liquid, Gravity(acceleration=tuple(np.where(up, -g, 0.0))), walls)


@law("Archimedes", own=True)
def lift(drawn: Drawn, backend: str) -> Found | None:
    """Bodies held anywhere in a tank at rest are lifted by what they displace, to no side; one that floats, too."""
    random = drawn.random()
    size, wide, high, g, rho = int(random.integers(2, 4)), int(random.integers(6, 8)), 9, 9.81, 1000.0
    h, bound = ((2.62, 0.03), (3.0, 0.005))[random.integers(2)]
    d, cells = 10.0 ** random.uniform(-3, 0), (wide, wide, high)
    low = [np.array([*random.integers(0, wide - size + 1, 2), random.integers(0, 3)]) for _ in range(2)]
    low[1][2] = low[0][2] + (size if np.abs(low[1][:2] - low[0][:2]).max() < size else 0)
    low = low[: int(random.integers(1, 3))] if low[1][2] + size <= high - 2 else low[:1]
    share, shape = float(random.choice([1.0, *np.arange(1, size) / size])), np.full(3, size)  # below the surface
    if random.random() < 0.3:  # broader than two supports, where walls and bodies beneath see no liquid
        shape, cells, share = np.array([*random.integers(6, 9, 2), size]), (9, 9, high), 1.0
        low = [np.array([*random.integers(0, 10 - shape[:2]), z]) for z in (0, size)][: int(random.integers(1, 3))]
    elif share < 1:
        low = [np.array([*random.integers(0, wide - size + 1, 2), high - round(share * size)])]
    x = lattice(cells, d)
    inside = np.any([((x > d * at) & (x < d * (at + shape))).all(1) for at in low], axis=0)
    effects = (*tank(cells, d, g, rho, 1 / 250), EFFECTS["shape_matching"](), EFFECTS["two_way_coupling"]())
    solid: Any = [SolidBox(lower=tuple(at * d), upper=tuple((at + shape) * d), density=share * rho) for at in low]
    if random.random() < 0.5:
        center, file = tuple((low[0] + shape / 2) * d), hexahedron(*map(int, shape))
        solid[0] = SolidMesh(file=file, center=center, size=shape.max() * d, density=share * rho)
    told = tuple(Gauge(name=f"lift-{k}", kind="force", on=f"solid {k}") for k in range(1, len(low) + 1))
    scene = own_scene(d, h, (Cloud(position=x[~inside]),), effects, solid=tuple(solid), gauge=told)
    simulation, weight = run(scene, backend, 1), np.repeat([1.0, shape.max() * d], 3) * rho * g * shape.prod() * d**3
    force = np.array([simulation.gauge(gauge.name).values[0] for gauge in told]) / weight
    off = (force - [0, 0, share, 0, 0, 0]) / np.where((np.arange(6) == 2) & (share < 1), 0.1 / size, bound)
    how = f"bodies of {shape} at {[at.tolist() for at in low]} of {cells} cells"
    return Found(float(np.abs(off).max()), 1.0, how, scene)


@law("shape does not matter", own=True)
def strip(drawn: Drawn, backend: str) -> Found:
    """A cosine along an insulated strip, rod or closed ring of any thickness decays as along a line, to 1 %."""
    random, dim = drawn.random(), drawn.scene.dim
    across, d = tuple(int(random.integers(1, 6)) for _ in range(dim - 1)), 10.0 ** random.uniform(-3, 0)
    k, rho, capacity = (10.0 ** random.uniform(-1, 3) for _ in range(3))
    h, halves = float(random.choice([2.13, 2.62, 3.21])), int(random.integers(1, 3))  # of a wave; two close a ring
    along, diffusivity = 32 * halves, k / (rho * capacity)
    rate = (2 / d * math.sin(math.pi / 64)) ** 2 * diffusivity  # that of the chain of cells
    scheme = str(random.choice(["implicit", "runge_kutta_legendre", "explicit"]))
    conduction = HeatConduction(
        conductivity=k, heat_capacity=capacity, density=rho, temperature=0.0, scheme=scheme, tolerance=1e-4
    )  # fmt: skip
    share = 0.002 if scheme == "explicit" else float(random.choice([0.002, 0.02]))
    part, period = Box(cells=(along, *across, 1)[:3]), ((halves - 1) * along * d, 0.0, 0.0)
    scene = own_scene(d, h, (part,), (conduction,), dim=dim, step=share / rate, period=period)
    simulation = made(scene, backend)
    mode = np.cos(np.pi * simulation.field("position")[:, 0].astype(float) / (32 * d))
    simulation.set_field("temperature", 50 + 40 * mode)
    take_steps(simulation, 4)
    left = (mode * (simulation.field("temperature").astype(float) - 50)).sum() / (40 * (mode**2).sum())
    each = (math.pi / (32 * d)) ** 2 * diffusivity * simulation.time / 4
    exact = math.log1p(each) if scheme == "implicit" else each  # backward Euler's
    return Found(abs(-math.log(left) / 4 / exact - 1), 0.01, f"{scheme}, {along}, {across} cells, h = {h:.2f} d", scene)


@law("shape does not matter", own=True)
def column(drawn: Drawn, backend: str) -> Found:
    """Under liquid of any width and spacing the pressure is rho g times the depth, to 1 %, while it settles to 6 %."""
    random, dim = drawn.random(), drawn.scene.dim
    cells = (*(int(n) for n in random.integers(2, (9, 5)[dim - 2], dim - 1)), int(random.integers(6, 10)))
    d, g, rho = (10.0 ** random.uniform(*ends) for ends in ((-3, 0), (-1, 2), (0, 4)))
    whole = own_scene(d, 2.62, (Box(cells=(*cells, 1)[:3]),), tank(cells, d, g, rho, 1 / 60), dim=dim)
    scene, steps = refined(whole, float(random.choice([1, 4 - dim]))), int(random.choice([0, 10]))
    simulation, high = run(scene, backend, steps), cells[-1] * d
    p, x, m = (simulation.field(name).astype(float) for name in ("pressure", "position", "mass"))
    off = float(np.abs(p / (rho * g) - high + x[:, dim - 1]).max()) / high
    heavy = abs(m.sum() / (rho * np.prod(cells) * d**dim) - 1)
    return Found(off / (0.06 if steps else 0.01) + heavy / 0.05, 1.0, f"{cells} cells, {steps} steps", scene)


@law("exact", own=True)
def rigid_spin(drawn: Drawn, backend: str) -> Found:
    """A cube or a ball alone flies and turns as a rigid body: its particles are off by 1 % of its size at most."""
    random, d = drawn.random(), 10.0 ** drawn.random().uniform(-3, 0)
    size, w, v = int(random.integers(2, 5)), random.uniform(-10, 10, 3), d * random.uniform(-10, 10, 3)
    given, center = {"density": 10.0 ** random.uniform(1, 4), "spin": tuple(w), "velocity": tuple(v)}, size * d / 2
    box = SolidBox(lower=(0.0,) * 3, upper=(size * d,) * 3, **given)
    body = box if random.random() < 0.5 else SolidBall(center=(center,) * 3, radius=0.51 * size * d, **given)
    scene = own_scene(d, 2.62, (), (EFFECTS["shape_matching"](),), solid=(body,), end_time=0.1)
    simulation = made(scene, backend)
    x = simulation.field("position").astype(float) - center
    while simulation.time < 0.1 and simulation.steps < 20:
        simulation.step()
    turned = Rotation.from_rotvec(w * simulation.time).apply(x)
    off = simulation.field("position").astype(float) - center - v * simulation.time - turned
    return Found(float(np.abs(off).max()) / (size * d), 0.01, f"{len(x)} particles", scene)


@law("exact", own=True)
def halves(drawn: Drawn, backend: str) -> Found:
    """A tension pulls halves of a block together by sigma (15 %, in space 30 %), its pressure balances (8, 12 %)."""
    random, dim = drawn.random(), drawn.scene.dim
    named = sorted(name for name, k in EFFECTS.items() if issubclass(k, PairCohesion) and name != "he_2014")  # no pull
    kind: Any = EFFECTS[named[random.integers(len(named))]]
    d, c, rho = (10.0 ** random.uniform(*ends) for ends in ((-3, 0), (0, 2), (0, 4)))
    sigma, h = rho * c**2 * d * 10.0 ** random.uniform(-3, -2.3), (3.21, 2.62)[dim - 2]
    liquid = WeaklyCompressible(
        rest_density=rho, sound_speed=c, dynamic_viscosity=rho * c * d / 10, density="continuity", clamp_pressure=False
    )

    def force(n: int, *tension: Any) -> float:
        x = lattice((n,) * dim, d)
        simulation = made(own_scene(d, h, (Cloud(position=x),), (liquid, *tension), dim=dim), backend)
        simulation.evaluate()
        m, a = (simulation.field(name).astype(float) for name in ("mass", "acceleration"))
        return float((m * a[:, 0])[x[:, 0] < n * d / 2].sum()) / (sigma * d ** (dim - 2))

    sizes, found = ((12, 16), (6, 8))[dim - 2], []
    edges = [[n ** (dim - 1), -2 * (dim - 1) * n ** (dim - 2)] for n in sizes]
    for balanced in (False, True):
        tension = kind(surface_tension=sigma, balance_pressure=balanced)
        found.append(np.linalg.solve(edges, [force(n, tension) - force(n) for n in sizes]))
    off = abs(found[0][1] - 1) / (0.15, 0.3)[dim - 2], abs(found[1][0] / found[0][0]) / (0.08, 0.12)[dim - 2]
    return Found(float(max(off)), 1.0, f"{kind.name}: sigma {found[0][1]:.3f}, {found[1][0] / found[0][0]:.3f} is left")


@law("refinement", own=True)
def half_the_spacing(drawn: Drawn, backend: str) -> Found:
    """With half the spacing a wave of shear decays nearer to nu k^2: 0.6 of the error, 3 %, or a Laplacian's 8 %."""
    random, options = drawn.random(), {"viscosity": ["central", "laplacian"], "density": ["summation", "continuity"]}
    given: Any = {name: str(random.choice(values)) for name, values in options.items()}
    d, c, rho = (10.0 ** random.uniform(*ends) for ends in ((-3, 0), (0, 2), (0, 4)))
    h, mu = float(random.choice([2.13, 2.13, 2.62, 3.21])), random.uniform(0.01, 0.2) * rho * c * 2.62 * d
    h, slid = h if given["viscosity"] == "central" else max(h, 2.62), 0.618 * np.arange(24) ** 2 % 1  # of each layer
    liquid = WeaklyCompressible(rest_density=rho, sound_speed=c, dynamic_viscosity=mu, **given)

    def error(n: int) -> float:
        x, found = lattice((n, 8), d), []
        x[:, 1] = (x[:, 1] + d * np.repeat(slid[:n], 8)) % (8 * d)
        wave = np.sin(2 * np.pi * x[:, 0] / (n * d))
        part = Cloud(position=x, velocity=np.outer(1e-4 * c * wave, [0.0, 1.0, 0.0]))
        simulation = run(own_scene(d, h, (part,), (liquid,), dim=2, period=(n * d, 8 * d, 0.0)), backend, 1)
        for steps in (0, 6):
            take_steps(simulation, steps)
            found.append((simulation.time, (simulation.field("velocity")[:, 1].astype(float) * wave).sum()))
        (since, first), (until, last) = found
        return abs(math.log(first / last) / (until - since) / (mu / rho * (2 * np.pi / (n * d)) ** 2) - 1)

    least = 0.03 if given["viscosity"] == "central" else 0.08
    return Found(error(24), max(0.6 * error(12), least), f"12 and 24 particles along a wave, {given}")


@law("exact", own=True)
def plates(drawn: Drawn, backend: str) -> Found:
    """Liquid between plates that hold it keeps the linear profile of Couette, to 4 % of the plate's speed."""
    random, rows = drawn.random(), int(drawn.random().integers(6, 11))
    d, c, rho = (10.0 ** random.uniform(*ends) for ends in ((-3, 0), (0, 2), (0, 4)))
    u, x = 0.02 * c, lattice((10, rows), d)
    part = Cloud(position=x, velocity=np.outer(u * x[:, 1] / (rows * d), [1.0, 0.0, 0.0]))
    given: Any = {"open_faces": ("-x", "+x"), "moving_faces": ("+y",), "velocity": (u, 0.0, 0.0), "no_slip": True}
    walls = EFFECTS["box_walls"](lower=(0.0, 0.0, 0.0), upper=(10 * d, rows * d, 0.0), **given)
    liquid = WeaklyCompressible(rest_density=rho, sound_speed=c, dynamic_viscosity=0.3 * rho * c * 2.62 * d)
    scene = own_scene(d, 2.62, (part,), (liquid, walls), dim=2, period=(10 * d, 0.0, 0.0))
    simulation = run(scene, backend, 20)
    y, found = simulation.field("position").astype(float)[:, 1], simulation.field("velocity").astype(float)[:, 0]
    return Found(float(np.abs(found / u - y / (rows * d)).max()), 0.04, f"{rows} rows", scene)


@law("rest", own=True)
def carried(drawn: Drawn, backend: str) -> Found:
    """A block that flies and turns keeps its size, to 1 %, one that falls along walls to 0.2 %; 0.7 spacings apart."""
    random = drawn.random()
    d, c, free = 10.0 ** random.uniform(-3, 0), 10.0 ** random.uniform(0, 2), random.integers(2)
    h, x = float(random.choice([2.62, 3.21])), lattice((10, 10), d)
    x[:, :2] += 0.05 * d * random.uniform(-1, 1, (len(x), 2))
    liquid = WeaklyCompressible(sound_speed=c, dynamic_viscosity=1000 * c * h * d / 60)
    walls = EFFECTS["box_walls"](lower=(0.0, -40 * d, 0.0), upper=(10 * d, 20 * d, 0.0))
    around = () if free else (Gravity(acceleration=(0.0, -0.002 * c * c / d, 0.0)), walls)
    spin = [0.1 * c, 0.0, 0.0] + 0.002 * c / d * np.cross([0.0, 0.0, 1.0], x)
    part = Cloud(position=x, velocity=free * spin - [0.0, 0.1 * c, 0.0])
    scene = own_scene(d, h, (part,), (liquid, *around), dim=2)
    y = run(scene, backend, 30).field("position").astype(float)
    near = np.linalg.norm(y[:, None] - y[None], axis=-1) + 9 * d * np.eye(len(y))
    wide = float(np.abs(y.std(0)[:2] / x.std(0)[:2] - 1).max())
    return Found(max(wide, 0.7 - float(near.min()) / d), 0.01 if free else 0.002, "a block of 10 x 10", scene)


@law("ledger")
def momenta(drawn: Drawn, backend: str) -> Found | None:
    """Where all forces keep them, momentum grows by the weight alone, angular momentum about the centre by nothing."""
    scene, gravity = msgspec.structs.replace(drawn.scene, motion=()), of_kind(drawn.scene, Gravity)
    alone = without(scene, "gravity")
    claiming, pull = made(alone, backend), np.array(gravity.acceleration if gravity else (0.0,) * 3)
    kept: dict[str, Any] = {} if any(scene.period) or scene.solid else {"angular_momentum": np.cross}
    kept["linear_momentum"] = lambda x, u: u
    kept = {name: of for name, of in kept.items() if claims(claiming, name)}
    if not kept or getattr(claiming.plan.effects.get("melting"), "bookkeeping", "") == "water":  # which takes mass
        return None
    step = 0.2 * run(scene, backend, 1).time
    simulation = made(msgspec.structs.replace(alone if scene.solid else scene, step=step), backend)
    m, found = simulation.field("mass").astype(float)[:, None], []
    for steps in (0, STEPS):
        take_steps(simulation, steps)
        x, v = (simulation.field(name).astype(float) for name in ("position", "velocity"))
        late = 0 if "mpm_liquid" in claiming.plan.effects or not simulation.time else step / 2  # velocities of SPH
        v = v - (0 if scene.solid else pull) * (simulation.time - late)
        found.append([m * of(x - (m * x).sum(0) / m.sum(), v) for of in kept.values()])
    off = [np.abs(b.sum(0) - a.sum(0)).max() / max(np.abs(a).sum(), np.abs(b).sum()) for a, b in zip(*found)]
    rounded = np.finfo(float).eps * scene.spacing / step * m.sum() if scene.solid else 0.0  # places to which they go
    return Found(float(max(off)), 1e-11 + float(rounded / max(np.abs(found[1][0]).sum(), 1e-300)), ", ".join(kept))


@law("ledger")
def impulse_of_walls(drawn: Drawn, backend: str) -> Found | None:
    """What the liquid's momentum gains is its weight and the force that the gauges of walls tell, times the step."""
    scene, gravity = drawn.scene, of_kind(drawn.scene, Gravity)
    walls = [e for e in scene.effects if e.name in ("box_walls", "mesh_boundary")]
    if not walls or scene.solid or scene.motion or any(e.replaces() for e in scene.effects if e not in walls):
        return None
    gauges = tuple(Gauge(name=e.name, kind="force", on=e.name) for e in walls)
    step = 0.2 * run(scene, backend, 1).time  # which heat allows, too
    simulation = made(msgspec.structs.replace(scene, step=step, gauge=gauges), backend)
    forces = [p for _, p in simulation.plan.passes if not p.on_demand and "acceleration" in p.written]
    known = ("wall", "sph.gravity", "adami_2012")
    if not all(keeps(p, "linear_momentum") or any(word in p.operation for word in known) for p in forces):
        return None
    m = simulation.field("mass").astype(float)[:, None]
    take_steps(simulation, 2)
    before = (m * simulation.field("velocity").astype(float)).sum(0)
    take_steps(simulation, 3)
    gained = (m * simulation.field("velocity").astype(float)).sum(0) - before
    told = [np.array(simulation.gauge(g.name).values)[:, : scene.dim] for g in gauges]  # behind it stands the torque
    times = np.array(simulation.gauge(gauges[0].name).time)
    at = (times > 1.5 * step) & (times < 4.5 * step)  # forces of steps 3, 4 and 5
    pushed = -sum(each[at].sum(0) for each in told) * step
    weight = m.sum() * np.array(gravity.acceleration if gravity else np.zeros(3)) * 3 * step
    size = float(np.abs(m * simulation.field("acceleration")).sum()) * 3 * step
    return Found(float(np.abs((gained - weight)[: scene.dim] - pushed).max()) / size, 1e-9, "impulse of the walls")


@law("ledger")
def heat(drawn: Drawn, backend: str) -> Found | None:
    """Heat is kept where nothing is held, and what has one temperature keeps it."""
    conduction = of_kind(drawn.scene, HeatConduction)
    off, lost = 0.0, conduction is None or conduction.held or conduction.scheme == "one_sided"  # by design
    if lost or getattr(with_scene_defaults(drawn.scene.effects).get("melting"), "bookkeeping", "") == "water":
        return None
    for spread in (100.0, 0.0):
        simulation = made(drawn.scene, backend)
        warm = 37 + drawn.random().uniform(0, spread, simulation.count)
        warmed(simulation, warm - simulation.field("temperature"))
        take_steps(simulation, STEPS)
        m, found = (simulation.field(name).astype(float) for name in ("mass", "temperature"))  # of one capacity
        off = max(off, abs((m * found).sum() / (m * warm).sum() - 1), 0.0 if spread else apart(found, warm))
    return Found(off, 1e-9, "temperatures at random, and one")


@law("ledger")
def energy_falls(drawn: Drawn, backend: str) -> Found | None:
    """Liquid in walls at rest gains no energy in a quarter of the longest step: 2 % of what was turned over."""
    liquid, gravity, box = (of_kind(drawn.scene, k) for k in (WeaklyCompressible, Gravity, EFFECTS["box_walls"]))
    uncounted = liquid and box and (box.no_slip or box.model == "mirrored" or liquid.density == "summation")
    if liquid is None or drawn.scene.solid or liquid.gradient == "corrected" or uncounted:
        return None
    still = box and msgspec.structs.replace(box, moving_faces=(), velocity=(0.0,) * 3)
    kept = tuple(e for e in (liquid, gravity, still, EFFECTS["particle_shifting"](strength=0.0)) if e)
    scene = msgspec.structs.replace(drawn.scene, effects=kept, motion=())
    simulation = made(msgspec.structs.replace(scene, step=(step := run(scene, backend, 1).time / 4)), backend)
    states, names = [], ("mass", "position", "velocity", "acceleration", "pressure", "density")
    for n in range(4 * drawn.steps + 1):
        take_steps(simulation, min(n, 1))
        states.append([simulation.field(name).astype(float) for name in names])
    m, x, v, a, p, rho = map(np.array, zip(*states))
    v[1:] += step / 2 * a[1:]  # of the leap-frog, at the time of the positions
    pushed = np.pad((p[1:] / rho[1:] ** 2 + p[:-1] / rho[:-1] ** 2) / 2 * np.diff(rho, axis=0), ((1, 0), (0, 0)))
    lifted = (x[0] - x) @ (gravity.acceleration if gravity else (0.0,) * 3)
    parts = (m * [(v**2).sum(2) / 2, lifted, pushed.cumsum(0)]).sum(2)
    rise = parts.sum(0) - np.minimum.accumulate(parts.sum(0))
    return Found(float(rise.max() / np.abs(parts).sum(0).max()), 0.02, "rise of the energy", scene)


@law("told is counted")
def mass(drawn: Drawn, backend: str) -> Found:
    """The particles weigh what density and cells say, to the sum of a lattice (5 %); bodies what their density says."""
    scene, simulation = drawn.scene, made(drawn.scene, backend)
    liquid: Any = next(e for e in scene.effects if hasattr(e, "rest_density"))
    sizes = [*simulation.plan.state.sizes[: len(scene.solid)], sum(len(part.position) for part in scene.fluid)]
    said = np.array([*(body.density for body in scene.solid), liquid.rest_density]) * sizes * scene.spacing**scene.dim
    sums = np.append(0.0, np.cumsum(simulation.field("mass").astype(float)))
    off = np.abs(np.diff(sums[np.cumsum([0, *sizes])]) - said) / np.maximum(said, 1e-300)
    return Found(float(off.max()), 0.05, "total mass")


@law("told is counted", own=True)
def squeezed(drawn: Drawn, backend: str) -> Found:
    """A block that is closer or wider than it tells: its report counts that, to 0.2 %, and has a note from 2 % on."""
    d, share = 10.0 ** drawn.random().uniform(-3, 0), drawn.random().uniform(0.92, 1.08, 2)[1]
    liquid = WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=100 * d, density="continuity")
    scene = own_scene(d, 2.62, (Cloud(position=lattice((16, 16), d) / math.sqrt(share)),), (liquid,), dim=2)
    told = simulate(made(scene, backend), 1e-9 * d, progress=False)
    off, said = (told.density or {})["difference"], any("is counted inside" in note for note in told.notes)
    return Found(abs(off + 1 - share) + (said != (abs(off) > 0.02)), 0.002, f"{share:.3f} of what is told", scene)


@law("told is counted")
def report(drawn: Drawn, backend: str) -> Found:
    """Number, mass, momenta and energies of the report against a recount; the frames that it wrote against the run."""
    simulation, off = made(drawn.scene, backend), 0.0
    start, until = _recount(simulation), 0.99 * run(drawn.scene, backend, 4).time
    with tempfile.TemporaryDirectory() as folder:
        asked, given = iter((False, True)), {"output": folder, "every": until / 2, "progress": False}
        if drawn.seed % 2:  # stopped by its user, and gone on
            with contextlib.suppress(RunStopped):
                simulate(simulation, until, asked_to_stop=lambda: next(asked), **given)
            simulation = Simulation.resume(f"{folder}/checkpoint.h5", backend=backend)
        told = simulate(simulation, until, **given)
        frames = open_run(folder)
        last = frames[-1].sorted().position.astype(float)
    whole = len(frames) == 3 == told.frames + (drawn.seed % 2) * (3 - told.frames) and told.steps == simulation.steps
    for own, ledger in zip((start, _recount(simulation)), (told.ledger["start"], told.ledger["end"])):
        for name, (value, size) in own.items():
            off = max(off, float(np.abs(np.subtract(value, ledger[name])).max()) / size if size > 0 else 0.0)
    period = np.where(np.array(drawn.scene.period) > 0, drawn.scene.period, 1e300)
    moved = last - simulation.field("position")
    off = max(off, apart(moved, np.round(moved / period) * period) / drawn.scene.spacing)
    return Found(off if whole else math.inf, 1e-9, "ledger and frames of the report")


def _recount(simulation: Simulation) -> dict[str, tuple[Any, float]]:
    """Quantities by name, each with the size that rounding refers to."""
    x, v, m = (simulation.field(name).astype(float) for name in ("position", "velocity", "mass"))
    energy, both = float((m @ v**2).sum() / 2), {"momentum": (p := m[:, None] * v), "angular_momentum": np.cross(x, p)}
    found = {"particles": (len(m), 1.0), "mass": (m.sum(), m.sum()), "kinetic_energy": (energy, energy)}
    return found | {name: (each.sum(0), float(np.abs(each).sum())) for name, each in both.items()}


@law("told is counted", own=True)
def gauges(drawn: Drawn, backend: str) -> Found:
    """A tank that slides: pressure and level to 0.5 %, weight and torque on floor or mesh to 3 %, flux to 6 %."""
    random, dim = drawn.random(), drawn.scene.dim
    cells = (*(int(n) for n in random.integers(5, 8, dim - 1)), int(random.integers(6, 10)))
    d, g, rho = (10.0 ** random.uniform(*ends) for ends in ((-3, 0), (-1, 2), (0, 4)))
    x, up, size = lattice(cells, d), np.arange(3) == dim - 1, np.pad(d * np.array(cells), (0, 3 - dim))
    foot, high, u, share = np.where(up, 0, size / 2), size[dim - 1], 0.01 * math.sqrt(g * d), random.uniform(0.2, 0.8)
    across, along = np.array([0.0, 1.0, 1.0]), np.array([1.0, 0.0, 0.0])
    given: dict[str, dict[str, Any]] = {
        "pressure": {"at": tuple(foot + share * size * up)},
        "level": {"lower": tuple(foot), "upper": tuple(foot + 2 * size * up)},
        "flux": {"lower": tuple(foot * along), "upper": tuple(foot * along + size * across)},
        "force": {"on": "-" + "xyz"[dim - 1], "about": tuple(foot - d * along)},
    }
    part, effects = Cloud(position=x, velocity=np.tile(u * along, (len(x), 1))), tank(cells, d, g, rho, 1 / 250)
    if dim == 3 and random.random() < 0.5:  # on a mesh
        middle = (*foot[:2], -d)
        floor = EFFECTS["mesh_boundary"](file=hexahedron(*cells[:2], 2), center=middle, size=d * max(cells[:2]))
        effects = (*effects[:2], msgspec.structs.replace(effects[2], lower=(0.0, 0.0, -2 * d)), floor)
        given |= {f"force-{of.name}": {"on": of.name, "about": given["force"]["about"]} for of in effects[2:]}
        given.pop("force")
    told = tuple(Gauge(name=kind, kind=kind.split("-")[0], **words) for kind, words in given.items())  # type: ignore[arg-type]
    scene = own_scene(d, (2.62, 3.21)[len(effects) - 3], (part,), effects, dim=dim, gauge=told)
    simulation = run(scene, backend, 1)
    p, level, q, *forces = (simulation.gauge(kind).values[0] for kind in given)
    f, weight = sum(map(np.array, forces)), rho * g * float(np.prod(size[:dim]))
    ratios = {
        "pressure": (p[0] / (rho * g * high * (1 - share)), 0.005), "level": (level[0] / high, 0.005),
        "flux": (q[0] / (u * np.prod(size[1:dim])), 0.06), "force": (-f[dim - 1] / weight, 0.03),
        "torque": (abs(f[(2, 4)[dim - 2]]) / (weight * d), 0.03),
    }  # fmt: skip
    off = {name: float(np.nan_to_num(abs(value - 1) / bound, nan=np.inf)) for name, (value, bound) in ratios.items()}
    worst = max(off, key=lambda name: off[name])
    return Found(off[worst], 1.0, f"{worst} of {cells} cells", scene)


@law("told is counted", own=True)
def cells_of_a_mesh(drawn: Drawn, backend: str) -> Found:
    """A body of two blocks that cross, in a mesh of triangles in any order, turned, twice or apart: their union."""
    random, d = drawn.random(), 10.0 ** drawn.random().uniform(-3, 0)
    low = np.array([np.zeros(3), random.uniform(0.3, 2.5, 3)]) + random.uniform(-9, 9, 3)
    high = low + np.sort(random.uniform(2.6, 5, (2, 3)), 0)  # so that none lies inside the other, which plan refuses
    ends = np.stack([low, high], 1) * d  # of block, end, axis
    corners = np.array([[end[k][axis] for axis, k in enumerate(at)] for end in ends for at in CORNERS])
    faces = np.concatenate([np.array(TRIANGLES)[:, :: random.choice([-1, 1])] + 8 * k for k in range(2)])
    faces = faces[np.append(random.permutation(24), random.integers(0, 24, random.integers(0, 2)))]
    if random.random() < 0.5:  # each triangle has corners of its own
        corners, faces = corners[faces.ravel()], np.arange(faces.size).reshape(-1, 3)
    file = mesh_file(corners, faces.tolist())
    body = SolidMesh(file=file, center=tuple((corners.min(0) + corners.max(0)) / 2))
    scene = own_scene(d, 2.62, (), (EFFECTS["shape_matching"](),), solid=(body,))
    state, grid = make_plan(scene).state, made(scene, backend).plan.grid
    found = np.round(grid.absolute(state.position) / d - 0.5)
    cells = np.stack(np.meshgrid(*[np.arange(-12, 22)] * 3, indexing="ij"), -1).reshape(-1, 3)
    inside = ((cells[:, None] + 0.5 > low) & (cells[:, None] + 0.5 < high)).all(-1).any(1)
    other = {*map(tuple, found.tolist())} ^ {*map(tuple, cells[inside].tolist())}
    return Found(float(len(other)), 0.0, f"{len(found)} cells, {int(inside.sum())} in the blocks", scene)


@law("silence is truth", own=True)
def twice_in_one_place(drawn: Drawn, backend: str) -> Found:
    """Two shapes and a body, without a note: their volume, to 12 %, nowhere half as many again as in a lattice."""
    random, dim = drawn.random(), drawn.scene.dim
    n, d = (9, 6)[dim - 2], 10.0 ** random.uniform(-3, 0)
    way, radius, middle = random.uniform(0, n, dim), random.uniform(1, 2), random.uniform(0, n, dim)
    low, center, at = (tuple(d * np.pad(x, (0, 3 - dim))) for x in (way, way + n / 2, middle))
    ways: list[Any] = [
        Box(lower=low, cells=(n, n, n)[:dim] + (1,) * (3 - dim)), Ball(center=center, radius=n * d / 2),
        FluidMesh(file=hexahedron(1, 1, 1), center=center, size=n * d),
    ]  # fmt: skip
    second = ways[random.integers(3 if dim == 3 else 2)]
    effects: list[Any] = [WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=100 * d)]
    solid = (SolidBall(center=at, radius=radius * d),) if dim == 3 and random.random() < 0.5 else ()
    effects += [EFFECTS["shape_matching"](), EFFECTS["two_way_coupling"]()] if solid else []
    first = Box(cells=ways[0].cells, outside="bodies" if solid else None)
    plan = make_plan(scene := own_scene(d, 2.62, (first, second), tuple(effects), dim=dim, solid=solid))
    if any("press each other apart" in note for note in plan.notes):
        return Found(0.0, 1.0, "told")
    p, round_ = random.uniform(0, 2 * n, (40000, dim)), isinstance(second, Ball)
    other = ((p - way - n / 2) ** 2).sum(1) < n**2 / 4 if round_ else ((p > way) & (p < way + n)).all(1)
    both = ((p < n).all(1) * 1.0 + other) * (~(((p - middle) ** 2).sum(1) < radius**2) if solid else 1)
    x = plan.state.position[:, :dim] / d
    near = (np.abs(x[:, None] - x[None]) < 1.5 - 1e-9).all(-1).sum(1) / 3**dim  # in cubes of three cells
    share = float(sum(plan.state.sizes[len(solid) :])) / (both.mean() * (2 * n) ** dim)
    how = f"{type(second).__name__} at {np.round(way, 2).tolist()} spacings: {share:.3f} of the volume"
    return Found(max(float(near.max()) / 1.5, abs(share - 1) / 0.12), 1.0, how, scene)
