"""What must hold in every scene: ledgers, what is told against a recount, and that silence is true."""

from __future__ import annotations

import math
import tempfile
from typing import Any

import msgspec
import numpy as np

from refsim.core.energy import EnergyAudit
from refsim.core.errors import RunStopped
from refsim.core.operation import REGISTRY
from refsim.engine.driver import simulate
from refsim.engine.simulation import Simulation
from refsim.gauges import Gauge
from refsim.heat import HeatConduction
from refsim.io.results import open_run
from refsim.scene.plan import make_plan
from refsim.scene.shapes import Box, Cloud
from refsim.sph import Gravity, WeaklyCompressible
from validation.laws.exact import tank
from validation.laws.laws import STEPS, Found, apart, claims, lattice, law, made, of_kind, own_scene, run
from validation.laws.scenes import Drawn
from validation.laws.units import without
from validation.running import take_steps


@law("ledger")
def momenta(drawn: Drawn, backend: str) -> Found | None:
    """Momentum, and angular momentum about the centre of mass, are kept where all forces claim to keep them."""
    scene = msgspec.structs.replace(without(drawn.scene, "gravity"), motion=())
    simulation = made(scene, backend)
    if "melting" in simulation.plan.effects:  # which gives bodies the liquid's mass
        return None
    kept: dict[str, Any] = {"linear_momentum": lambda x, u: u}
    if not (any(scene.period) or scene.solid):
        kept["angular_momentum"] = np.cross
    kept = {name: of for name, of in kept.items() if claims(simulation, name)}
    m, found = simulation.field("mass").astype(float)[:, None], []
    for steps in (0, STEPS):
        take_steps(simulation, steps)
        x, v = (simulation.field(name).astype(float) for name in ("position", "velocity"))
        found.append([m * of(x - (m * x).sum(0) / m.sum(), v) for of in kept.values()])
    off = [np.abs(b.sum(0) - a.sum(0)).max() / max(np.abs(a).sum(), np.abs(b).sum()) for a, b in zip(*found)]
    return Found(float(max(off)), 1e-11, ", ".join(kept)) if kept else None


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
    """Heat is kept where nothing is held, and what has one temperature keeps it."""
    conduction = of_kind(drawn.scene, HeatConduction)
    lost = conduction is None or conduction.held or conduction.scheme == "one_sided"  # by design
    if lost or any(e.name == "melting" for e in drawn.scene.effects):
        return None
    off = 0.0
    for spread in (100.0, 0.0):
        simulation = made(drawn.scene, backend)
        warm = 37 + drawn.random().uniform(0, spread, simulation.count)
        simulation.set_field("temperature", warm)
        take_steps(simulation, STEPS)
        m, found = (simulation.field(name).astype(float) for name in ("mass", "temperature"))  # of one capacity
        off = max(off, abs((m * found).sum() / (m * warm).sum() - 1), 0.0 if spread else apart(found, warm))
    return Found(off, 1e-9, "temperatures at random, and one")


@law("ledger")
def energy_falls(drawn: Drawn, backend: str) -> Found | None:
    """What nothing drives gains no energy where all is counted: 2 % of what was turned over, or less by half a step."""
    scene = msgspec.structs.replace(drawn.scene, energy_audit=EnergyAudit(every=1, bound=1e9))
    step, shares = run(scene, backend, 1).time, []
    for parts in (1, 2):
        simulation = made(msgspec.structs.replace(scene, step=step / parts), backend)
        if simulation.auditor is None or not all("diffusion" in word for word in simulation.auditor.uncounted()):
            return None
        take_steps(simulation, parts * drawn.steps)
        shares.append(simulation.auditor.report()["greatest_share"])
    return Found(shares[1], max(0.02, 0.7 * shares[0]), "greatest rise of the energy")


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
    """Number, mass, momenta and energies of the report against a recount; the frames that it wrote against the run."""
    simulation, off = made(drawn.scene, backend), 0.0
    start, until = _recount(simulation), 0.99 * run(drawn.scene, backend, 4).time
    with tempfile.TemporaryDirectory() as folder:
        told = simulate(simulation, until, output=folder, every=until / 2, progress=False)
        frames = open_run(folder)
        last = frames[-1].sorted().position.astype(float)
    whole = len(frames) == told.frames == 3 and told.steps == simulation.steps and told.time == simulation.time
    for own, ledger in zip((start, _recount(simulation)), (told.ledger["start"], told.ledger["end"])):
        for name, (value, size) in own.items():
            off = max(off, float(np.abs(np.subtract(value, ledger[name])).max()) / size if size > 0 else 0.0)
    period = np.where(np.array(drawn.scene.period) > 0, drawn.scene.period, 1e300)
    moved = last - simulation.field("position")
    off = max(off, apart(moved, np.round(moved / period) * period) / drawn.scene.spacing)
    return Found(off if whole else math.inf, 1e-9, "ledger and frames of the report")


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
def gauges(drawn: Drawn, backend: str) -> Found:
    """In a tank that slides along: pressure and level to 0.5 %, weight on the floor to 3 %, its torque, flux to 6 %."""
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
    part = Cloud(position=x, velocity=np.tile(u * along, (len(x), 1)))
    told = tuple(Gauge(name=kind, kind=kind, **words) for kind, words in given.items())  # type: ignore[arg-type]
    scene = own_scene(d, 2.62, (part,), tank(cells, d, g, rho, 1 / 250), dim=dim, gauge=told)
    simulation = run(scene, backend, 1)
    p, h, q, f = (simulation.gauge(kind).values[0] for kind in given)
    weight = rho * g * float(np.prod(size[:dim]))
    ratios = {
        "pressure": (p[0] / (rho * g * high * (1 - share)), 0.005), "level": (h[0] / high, 0.005),
        "flux": (q[0] / (u * np.prod(size[1:dim])), 0.06), "force": (-f[dim - 1] / weight, 0.03),
        "torque": (abs(f[(2, 4)[dim - 2]]) / (weight * d), 0.03),
    }  # fmt: skip
    off = {name: abs(value - 1) / bound for name, (value, bound) in ratios.items()}
    worst = max(off, key=lambda name: off[name])
    return Found(
        off[worst] if all(map(math.isfinite, off.values())) else math.inf, 1.0, f"{worst} of {cells} cells", scene
    )


@law("told is counted", own=True)
def too_light(drawn: Drawn, backend: str) -> Found | None:
    """Liquid whose particles have a share of their lattice's mass is told as that, to 2 %, with a note."""
    random, n = drawn.random(), 16
    share, given = float(random.uniform(0.5, 0.95)), float(random.choice([0.0, 0.3]))
    d, c = 10.0 ** random.uniform(-3, 0), 10.0 ** random.uniform(0, 2)
    liquid = WeaklyCompressible(sound_speed=c, dynamic_viscosity=10 * c * d, density="continuity", restoring=given)
    part = Cloud(position=lattice((n, n), d), mass=np.full(n * n, share * 1000.0 * d**2))
    scene = own_scene(d, 2.62, (part,), (liquid,), dim=2, period=(n * d, n * d, 0.0))
    simulation = run(scene, backend, 1)
    try:
        words = simulation.counting.judged(simulation)
    except RunStopped:
        words = "stopped"
    told = (simulation.counting.report() or {}).get("difference")
    off = abs(told - (share - 1)) if words and told is not None else math.inf
    return Found(off, 0.02, f"{share:.3f} of the mass: {words or 'without a word'}", scene)


@law("silence is truth", own=True)
def twice_in_one_place(drawn: Drawn, backend: str) -> Found:
    """Two blocks that overlap, without a note: nowhere half as many particles again as in a lattice."""
    random, dim = drawn.random(), drawn.scene.dim
    n, d = (9 if dim == 2 else 6,) * dim, 10.0 ** random.uniform(-3, 0)
    way = np.pad(d * random.uniform(0, n[0], dim), (0, 3 - dim))
    parts = (Box(cells=(*n, 1)[:3]), Box(lower=tuple(way), cells=(*n, 1)[:3]))
    liquid = WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=100 * d)
    scene = own_scene(d, 2.62, parts, (liquid,), dim=dim)
    plan = make_plan(scene)  # which may refuse it
    if any("lattice" in note for note in plan.notes):
        return Found(0.0, 1.5, "told")
    x = plan.state.position[:, :dim] / d
    near = (np.abs(x[:, None] - x[None]) < 1.5 - 1e-9).all(-1).sum(1) / 3**dim  # in cubes of three cells
    return Found(float(near.max()), 1.5, f"a second block at {np.round(way / d, 2).tolist()} spacings", scene)
