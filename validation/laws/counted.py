"""What must hold in every scene: ledgers, what is told against a recount, and that silence is true."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from refsim.core.energy import EnergyAudit
from refsim.core.errors import InputError, RunStopped
from refsim.core.operation import REGISTRY
from refsim.engine.driver import simulate
from refsim.engine.simulation import Simulation
from refsim.gauges import Gauge
from refsim.heat import HeatConduction
from refsim.scene.plan import Plan, make_plan
from refsim.scene.scene import Scene
from refsim.scene.shapes import Box, Cloud
from refsim.sph import Gravity, WeaklyCompressible
from validation.laws.laws import STEPS, Found, claims, lattice, law, made, of_kind, run
from validation.laws.scenes import Drawn
from validation.laws.units import without
from validation.running import take_steps


@law("ledger")
def linear_momentum(drawn: Drawn, backend: str) -> Found | None:
    """Momentum is kept where all forces are between particles; with gravity it grows by M g t."""
    return _momentum(drawn, backend, "linear_momentum", lambda x, u: u)


@law("ledger")
def angular_momentum(drawn: Drawn, backend: str) -> Found | None:
    """Angular momentum about the centre of mass, where all forces claim to keep it and nothing is shifted."""
    return None if any(drawn.scene.period) else _momentum(drawn, backend, "angular_momentum", np.cross)


def _momentum(drawn: Drawn, backend: str, what: str, of: Callable[[Any, Any], Any]) -> Found | None:
    scene = msgspec.structs.replace(without(drawn.scene, "gravity"), motion=())
    simulation = made(scene, backend)
    if not claims(simulation, what) or (scene.solid and what == "angular_momentum"):
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
def impulse_of_walls(drawn: Drawn, backend: str) -> Found | None:
    """What the liquid's momentum gains is its weight and the force that the gauges of walls tell, times the step."""
    scene, gravity = drawn.scene, of_kind(drawn.scene, Gravity)
    walls = [e for e in scene.effects if e.name in ("box_walls", "mesh_boundary")]
    if not walls or scene.solid or scene.motion or any(e.replaces() for e in scene.effects if e not in walls):
        return None
    gauges = tuple(Gauge(name=e.name, kind="force", on=e.name) for e in walls)
    step = 0.05 * scene.support_radius / of_kind(scene, WeaklyCompressible).sound_speed
    inner = make_plan(msgspec.structs.replace(scene, step=step))
    forces = [p.operation for _, p in inner.passes if not p.on_demand and "acceleration" in p.written]
    known = ("wall", "sph.gravity", "adami_2012")
    if any("linear_momentum" not in REGISTRY[f].invariants and not any(k in f for k in known) for f in forces):
        return None
    simulation = made(msgspec.structs.replace(scene, step=step, gauge=gauges), backend)
    m = simulation.field("mass").astype(float)[:, None]
    take_steps(simulation, 2)
    before = (m * simulation.field("velocity").astype(float)).sum(0)
    take_steps(simulation, 3)
    gained = (m * simulation.field("velocity").astype(float)).sum(0) - before
    dim = scene.dim  # behind the forces stands the torque
    told = [np.array(simulation.gauge(g.name).values)[:, :dim] for g in gauges]
    times = np.array(simulation.gauge(gauges[0].name).time)
    at = (times > 1.5 * step) & (times < 4.5 * step)  # forces of steps 3, 4 and 5
    pushed = -sum(each[at].sum(0) for each in told) * step
    weight = m.sum() * np.array(gravity.acceleration if gravity else np.zeros(3)) * 3 * step
    size = float(np.abs(m * simulation.field("acceleration")).sum()) * 3 * step
    return Found(float(np.abs((gained - weight)[:dim] - pushed).max()) / size, 1e-9, "impulse of the walls")


@law("ledger")
def heat(drawn: Drawn, backend: str) -> Found | None:
    """Heat is kept where nothing is held."""
    conduction = of_kind(drawn.scene, HeatConduction)
    if conduction is None or conduction.held or any(e.name == "melting" for e in drawn.scene.effects):
        return None
    simulation = made(drawn.scene, backend)
    simulation.set_field("temperature", drawn.random().uniform(0, 100, simulation.count))
    found = []
    for steps in (0, STEPS):
        take_steps(simulation, steps)
        found.append(float((simulation.field("mass") * simulation.field("temperature")).sum()))  # of one capacity
    return Found(abs(found[1] / found[0] - 1), 1e-9, "temperatures at random")


@law("ledger")
def energy_falls(drawn: Drawn, backend: str) -> Found | None:
    """What nothing drives gains no energy: 2 % of what was turned over at most, where all of it is counted."""
    scene = msgspec.structs.replace(drawn.scene, energy_audit=EnergyAudit(every=1, bound=1e9))
    try:
        simulation = made(scene, backend)
    except InputError:
        return None
    if simulation.auditor is None or not all("diffusion" in word for word in simulation.auditor.uncounted()):
        return None
    take_steps(simulation, drawn.steps)
    return Found(simulation.auditor.report()["greatest_share"], 0.02, "greatest rise of the energy")


@law("told is counted")
def mass(drawn: Drawn, backend: str) -> Found:
    """The particles weigh what density and cells say, to the sum of a lattice (5 %); bodies what their density says."""
    simulation = made(drawn.scene, backend)
    liquid: Any = next(e for e in drawn.scene.effects if hasattr(e, "rest_density"))
    number = sum(len(part.position) for part in drawn.scene.fluid)
    found, volume = simulation.field("mass").astype(float), drawn.scene.spacing**drawn.scene.dim
    off = abs(float(found[len(found) - number :].sum()) / (liquid.rest_density * volume * number) - 1)
    first = 0
    for body, size in zip(drawn.scene.solid, simulation.plan.state.sizes):
        off = max(off, abs(float(found[first : first + size].sum()) / (body.density * volume * size) - 1))
        first += size
    return Found(off, 0.05, "total mass")


@law("told is counted")
def report(drawn: Drawn, backend: str) -> Found:
    """Number, mass, momenta and energies of the report against a recount, at the end and at the start."""
    simulation, off = made(drawn.scene, backend), 0.0
    start = _recount(simulation)
    told = simulate(simulation, 0.99 * run(drawn.scene, backend, 4).time, backend=backend, progress=False).ledger
    for own, ledger in zip((start, _recount(simulation)), (told["start"], told["end"])):
        for name, (value, size) in own.items():
            off = max(off, float(np.abs(np.subtract(value, ledger[name])).max()) / size if size > 0 else 0.0)
    return Found(off, 1e-9, "ledger of the report")


def _recount(simulation: Simulation) -> dict[str, tuple[Any, float]]:
    """Quantities by name, each with the size that rounding refers to; particle by particle."""
    rows = list(zip(*(simulation.field(name).astype(float).tolist() for name in ("position", "velocity", "mass"))))
    p = [[m * u for u in v] for _, v, m in rows]
    turning = [[x[a] * q[b] - x[b] * q[a] for a, b in ((1, 2), (2, 0), (0, 1))] for (x, _, _), q in zip(rows, p)]
    energy, mass = sum(0.5 * m * sum(u * u for u in v) for _, v, m in rows), sum(m for _, _, m in rows)
    found = {"particles": (len(rows), 1.0), "mass": (mass, mass), "kinetic_energy": (energy, energy)}
    for name, each in (("momentum", p), ("angular_momentum", turning)):
        found[name] = ([sum(part) for part in zip(*each)], float(np.abs(each).sum()))
    return found


@law("told is counted", own=True)
def too_light(drawn: Drawn, backend: str) -> Found | None:
    """Liquid whose particles have a share of their lattice's mass is told as that, to 2 %, with a note."""
    random, n = drawn.random(), 16
    share, given = float(random.uniform(0.5, 0.95)), float(random.choice([0.0, 0.3]))
    d, c = 10.0 ** random.uniform(-3, 0), 10.0 ** random.uniform(0, 2)
    liquid = WeaklyCompressible(sound_speed=c, dynamic_viscosity=10 * c * d, density="continuity", restoring=given)
    part = Cloud(position=lattice((n, n), d), mass=np.full(n * n, share * 1000.0 * d**2))
    scene = Scene(
        dim=2, dtype="float64", spacing=d, support_radius=2.62 * d, fluid=(part,), effects=(liquid,),
        period=(n * d, n * d, 0.0),
    )  # fmt: skip
    simulation = run(scene, backend, 1)
    try:
        words = simulation.counting.judged(simulation)
    except RunStopped:
        words = "stopped"
    told = (simulation.counting.report() or {}).get("difference")
    off = abs(told - (share - 1)) if words and told is not None else math.inf
    return Found(off, 0.02, f"{share:.3f} of the mass: {words or 'without a word'}", scene)


def silent(scene: Scene, word: str) -> Plan | None:
    """The plan where it is neither refused nor has a note with this word."""
    try:
        plan = make_plan(scene)
    except InputError:
        return None
    return None if any(word in note for note in plan.notes) else plan


@law("silence is truth", own=True)
def twice_in_one_place(drawn: Drawn, backend: str) -> Found:
    """Two blocks that overlap, without a note: nowhere half as many particles again as in a lattice."""
    random, dim = drawn.random(), drawn.scene.dim
    n, d = (9 if dim == 2 else 6,) * dim, 10.0 ** random.uniform(-3, 0)
    way = np.pad(d * random.uniform(0, n[0], dim), (0, 3 - dim))
    parts = (Box(cells=(*n, 1)[:3]), Box(lower=tuple(way), cells=(*n, 1)[:3]))
    liquid = WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=100 * d)
    scene = Scene(dim=dim, dtype="float64", spacing=d, support_radius=2.62 * d, fluid=parts, effects=(liquid,))
    plan = silent(scene, "lattice")
    if plan is None:
        return Found(0.0, 1.5, "told")
    x = plan.state.position[:, :dim] / d
    near = (np.abs(x[:, None] - x[None]) < 1.5 - 1e-9).all(-1).sum(1) / 3**dim  # in cubes of three cells
    return Found(float(near.max()), 1.5, f"a second block at {np.round(way / d, 2).tolist()} spacings", scene)


@law("silence is truth", own=True)
def few_neighbours(drawn: Drawn, backend: str) -> Found:
    """A support that is not refused holds the next neighbours of a lattice; without a note those across, too."""
    random, dim = drawn.random(), drawn.scene.dim
    d, h = 10.0 ** random.uniform(-3, 0), float(random.choice([1.0, random.uniform(1.0, 1.8), 1.49999]))
    summing = (WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=100 * d), HeatConduction())
    box = Box(cells=(6, 6, 1) if dim == 2 else (4, 4, 4))
    scene = Scene(dim=dim, spacing=d, support_radius=h * d, fluid=(box,), effects=(summing[random.integers(2)],))
    try:
        make_plan(scene)
    except InputError:
        return Found(0.0, 0.0, "refused")
    shells = [math.sqrt(sum(k * k for k in steps)) for steps in itertools.product((-1, 0, 1), repeat=dim)]
    inside = sum(0 < r < h * (1 - 1e-6) for r in shells)
    least = 4 * (dim - 1) + dim if silent(scene, "neighbours") else 2 * dim
    return Found(max(0.0, least - inside), 0.0, f"a support of {h:.5g} d", scene)
