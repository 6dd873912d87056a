"""What must hold in every scene, each law one function of a drawn scene: absence, units, frames, same run, refinement.

A law returns what it found, the bound and how the scene was varied, or None where it does not apply. Lengths are in
spacings unless said.
"""

import contextlib
import re
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numba import config

from refsim import Box, Cloud, Gravity, HeatConduction, Motion, Scene, Simulation, WeaklyCompressible
from refsim.core.capabilities import BringsWalls, CorrectsPositions, effects_with, with_scene_defaults
from refsim.core.errors import InputError, RunStopped
from refsim.core.operation import REGISTRY
from refsim.scene.files import parse_scene, scene_to_toml
from validation.laws.scenes import Drawn
from validation.laws.units import Unit, moved, scaled, turned, unit, with_effect, without
from validation.running import take_steps

STEPS = 8
AMPLIFIED = 1e8  # more than a run of STEPS amplifies rounding in scenes of so few particles
ROUNDING = AMPLIFIED * float(np.finfo(float).eps)  # spacings
ONE, EACH = Unit(1.0, 1.0, 1.0, 1.0), (slice(None),) * 2
NUMBER = re.compile(r"-?\d([\d.,]*\d)?(e[-+]?\d+)?")  # of a note, without the comma behind it


class Found(NamedTuple):
    """What a law found, what it allows, and how the scene was varied."""

    value: float
    bound: float
    how: str = ""
    scene: Scene | None = None  # where it is not the drawn one


LAWS: dict[str, list[Callable[[Drawn, str], Found | None]]] = {}
OWN: set[Callable[..., Any]] = set()  # laws that take a scene of their own in place of the drawn one


def law(name: str, own: bool = False) -> Callable[[Any], Any]:
    """Add a function (drawn scene, backend) -> Found to the laws of that name; `own`: it makes its scene itself."""

    def add(function: Any) -> Any:
        LAWS.setdefault(name, []).append(function)
        OWN.update([function] * own)
        return function

    return add


def made(scene: Scene, backend: str, profile: bool = False, threads: int = 1) -> Simulation:
    """The scene at its start; where heat is conducted, particles that move are warmer."""
    simulation = Simulation(scene, backend, threads=threads if backend == "cpu" else None, profile=profile)
    if (conduction := of_kind(scene, HeatConduction)) is not None:
        speed = (simulation.field("velocity").astype(float) ** 2).sum(1)
        warmed(simulation, conduction.temperature * speed / max(speed.max(initial=0.0), 1e-300))
    return simulation


def warmed(each: Simulation, by: np.ndarray) -> None:
    """Raise temperatures [K], if there are any."""
    if "temperature" in each.fields:
        each.set_field("temperature", each.field("temperature") + by)


def run(scene: Scene, backend: str, steps: int = STEPS) -> Simulation:
    """The scene after some steps."""
    simulation = made(scene, backend)
    take_steps(simulation, steps)
    return simulation


def stops(scene: Scene, backend: str, steps: int = STEPS) -> bool:
    """Whether the scene is refused or stops without a law."""
    with contextlib.suppress(InputError, RunStopped):
        return run(scene, backend, steps) is None
    return True


def places(simulation: Simulation) -> np.ndarray:
    """Positions [spacings]."""
    return simulation.field("position").astype(float) / simulation.plan.grid.spacing


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference, infinite where one is no number."""
    return float(np.nan_to_num(np.abs(a - b), nan=np.inf).max()) if a.size else 0.0


def fields_apart(
    a: Simulation, b: Simulation, rows: Any = EACH, axes: Any = None, factors: Unit = ONE, kept: bool = False
) -> float:
    """Largest difference of `rows` of two runs' fields [their sizes], or of `kept` ones; `axes`: lengths of vectors."""
    off, slow = 0.0, 1e-3 * a.plan.grid.spacing / max(a.time, 1e-300)  # what rests has velocities of rounding
    density = a.field("mass").max(initial=0.0) / a.plan.grid.spacing**a.plan.grid.dim
    rounded = {"m/s": slow, "m/s^2": slow / max(a.time, 1e-300), "Pa": density * slow**2}
    for name, field in a.plan.fields.items():
        counted = field.dtype == "real" and field.rows is None and (field.state or not kept)
        rounded_off = "position" in name or "compensation" in name  # places, and what rounding took
        if not counted or rounded_off or name not in a.fields or name not in b.fields:
            continue
        x, y = (each.field(name).astype(float)[own] for each, own in zip((a, b), rows))
        if axes and x.ndim > 1:
            x, y = np.linalg.norm(x, axis=1), np.linalg.norm(y, axis=1)
        y = y / unit(field.unit.replace(" (", "; "), a.plan.grid.dim).of(factors)
        size = max(float(np.abs(x).max(initial=0.0)), float(name == "temperature"), rounded.get(field.unit, 0.0))
        off = max(off, apart(x, y) / size if size > 0 and np.isfinite(size) else 0.0)
    return off


def runs_apart(a: Simulation, b: Simulation, steps: int = STEPS, **how: Any) -> float:
    """Largest difference of two runs: of all fields after a step, of places and what is kept after some."""
    off = 0.0
    for number in (1, steps - 1):
        for each in (a, b):
            take_steps(each, number)
        off = max(off, fields_apart(a, b, kept=number > 1, **how))
    rows, axes = how.get("rows", EACH), how.get("axes", [0, 1, 2])
    return max(off, apart(places(a)[rows[0]][:, axes], places(b)[rows[1]]))


def lattice(cells: tuple[int, ...], d: float) -> np.ndarray:
    """Places (n, 3) [m] in the middle of cells; z = 0 in the plane."""
    grid = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in cells), indexing="ij"), -1).reshape(-1, len(cells))
    return d * np.pad(grid, ((0, 0), (0, 3 - len(cells))))


def own_scene(d: float, h: float, parts: Any, effects: Any, **more: Any) -> Scene:
    """A scene that a law makes itself, with a support of h spacings."""
    return Scene(dtype="float64", spacing=d, support_radius=h * d, fluid=parts, effects=effects, **more)


def of_kind(scene: Scene, kind: type) -> Any:
    """The scene's effect of that kind."""
    return next((e for e in scene.effects if isinstance(e, kind)), None)


def corrected(scene: Scene) -> bool:
    """Whether an effect moves particles by other displacements than dt v."""
    return any(e.corrects_positions() for e in effects_with(with_scene_defaults(scene.effects), CorrectsPositions))


def keeps(one: Any, what: str) -> bool:
    """Whether a pass claims to conserve it with the fields that it reads, beside those of its plain variant."""
    o, names = REGISTRY[one.operation], one.names
    more = {k: {names.get(n, n) for n in {*o.variants[0]} - {*o.variants[k]}} & {*one.reads} for k in o.broken}
    return what in o.invariants and not any(what in o.broken[k] for k in more if more[k])


def claims(simulation: Simulation, what: str) -> bool:
    """Whether every operation of a step that adds to the acceleration claims to conserve it."""
    plan = simulation.plan
    if "mpm_liquid" in plan.effects:  # whose angular momentum stands also in its matrices
        embedded = getattr(plan.effects.get("surface_energy"), "embedding", "cluster") == "cluster"
        return what == "linear_momentum" and embedded and "mpm_walls" not in plan.effects
    adding = [p for _, p in plan.passes if not p.on_demand and "acceleration" in p.written]
    turns = what == "angular_momentum" and corrected(plan.scene)  # shifts leave velocities as they are
    by_particles = of_kind(plan.scene, WeaklyCompressible) and plan.walls is None and not turns
    return bool(by_particles) and all(keeps(p, what) for p in adding)


@law("absence")
def zero_is_absence(drawn: Drawn, backend: str) -> Found | None:
    """An effect whose coefficients are zero, and that solves nothing itself, leaves the others' run as it is."""
    scene, random = drawn.scene, drawn.random()
    chosen = [e for e in scene.effects if e.scales and not (e.replaces() or (e.name == "gravity" and scene.motion))]
    chosen = [e for e in chosen if e.name not in with_scene_defaults(without(scene, e.name).effects)]  # none that joins
    if not chosen:
        return None
    effect = chosen[random.integers(len(chosen))]
    given = {name: value for name in effect.scales if (value := getattr(effect, name)) is not None}
    nothing = {name: (0.0,) * 3 if isinstance(value, tuple) else type(value)(0) for name, value in given.items()}
    with_zero = with_effect(scene, msgspec.structs.replace(effect, **nothing))
    a, b = made(without(scene, effect.name), backend), made(with_zero, backend)
    return Found(runs_apart(a, b), 0.0, f"{effect.name}: {', '.join(nothing)} = 0")


@law("absence")
def looking_changes_nothing(drawn: Drawn, backend: str) -> Found | None:
    """Fields computed on demand, checkpoints and a profile leave the run as it is, to the bit."""
    plain, watched = run(drawn.scene, backend, drawn.steps), made(drawn.scene, backend, profile=True)
    for _ in range(drawn.steps):
        watched.step()
        watched.evaluate()
        watched.snapshot()
    return Found(apart(places(plain), places(watched)) + fields_apart(plain, watched, kept=True), 0.0, "looked at")


@law("units")
def other_units(drawn: Drawn, backend: str) -> Found:
    """The same scene in other units of length, time, mass and temperature: the same run, the same words in notes."""
    random, meshes = drawn.random(), any("file" in e.__struct_fields__ for e in drawn.scene.effects)
    exact = meshes or random.random() < 0.5  # a mesh's particles rest after many steps of float32: roundings stay
    factors = Unit(*(64.0 ** random.integers(-2, 2, 4) if exact else 10.0 ** random.uniform(-2, 2, 4)))
    a, b = made(drawn.scene, backend), made(scaled(drawn.scene, factors), backend)
    told, said = ([NUMBER.sub("#", note) for note in each.plan.notes] for each in (a, b))
    late = abs(a.time * factors.time / b.time - 1) if b.time else 0.0
    off = max(runs_apart(a, b, factors=factors), float(told != said), late)
    return Found(off, ROUNDING, f"units {tuple(float(f'{f:.3g}') for f in factors)}")


def in_turn(scene: Scene) -> bool:
    """Whether particles exchange heat one after the other."""
    return getattr(of_kind(scene, HeatConduction), "scheme", "") == "one_sided"


def by_chance(scene: Scene) -> bool:
    """Whether the order of particles counts: an effect draws numbers, or heat goes one by one."""
    drawing = [e for e in scene.effects if "seed" in e.__struct_fields__]
    return in_turn(scene) or any(e.passes({o.name: o for o in scene.effects}) for e in drawing)


@law("frames")
def other_order(drawn: Drawn, backend: str) -> Found | None:
    """The same particles in another order."""
    if by_chance(drawn.scene):
        return None
    scene, random, fluid = drawn.scene, drawn.random(), []
    for part in drawn.scene.fluid:
        o = random.permutation(len(part.position))
        fluid.append(msgspec.structs.replace(part, position=part.position[o], velocity=part.velocity[o]))
    a, b = made(scene, backend), made(msgspec.structs.replace(scene, fluid=tuple(fluid)), backend)
    return Found(runs_apart(a, b, rows=(order(a), order(b))), ROUNDING, "order of the particles")


@law("frames")
def other_axes(drawn: Drawn, backend: str) -> Found | None:
    """Axes exchanged: a mirror image in the plane, a turn by 120 degrees or a mirror image in space."""
    if by_chance(drawn.scene):
        return None
    axes = [1, 0, 2] if drawn.scene.dim == 2 else [[1, 2, 0], [2, 0, 1], [1, 0, 2]][drawn.random().integers(3)]
    a, b = made(drawn.scene, backend), made(turned(drawn.scene, axes), backend)
    return Found(runs_apart(a, b, rows=(order(a, axes), order(b)), axes=axes), ROUNDING, f"axes {axes}")


def order(each: Simulation, axes: Sequence[int] = (0, 1, 2)) -> np.ndarray:
    """Particles by where they started along such axes: bodies are sorted by cell."""
    start = np.round(each.plan.grid.absolute(each.plan.state.position) / each.plan.grid.spacing, 3)
    return np.lexsort(start[:, axes].T)


@law("frames")
def elsewhere(drawn: Drawn, backend: str) -> Found:
    """Moved by whole spacings, as far as float64 carries it, or along a period; what is free also flies."""
    scene, dim, random = drawn.scene, drawn.scene.dim, drawn.random()
    liquid, boost, period = of_kind(scene, WeaklyCompressible), np.zeros(3), np.array(scene.period)
    held = effects_with(scene.effects, BringsWalls) or scene.solid or period.any()
    if not (liquid is None or held or any(motion.of == "turn" for motion in scene.motion)):
        scene = msgspec.structs.replace(scene, step=0.2 * run(scene, backend, 1).time)  # which heat allows, too
        boost[0] = 0.1 * liquid.sound_speed
    samples = any(getattr(e, "quadrature", "") == "poisson" for e in scene.effects)  # drawn block after block
    k = float(random.choice([-64.0 if samples else -38.0, 1024.0]))  # cells of MPM are two spacings
    way = np.where(np.arange(3) < dim, k * scene.spacing, 0.0)
    other, round_it = moved(scene, way, boost), np.where(period > 0, period, np.inf)
    if period.any():  # where no place is special
        way = period * random.uniform(0, 1, 3)
        parts = (msgspec.structs.replace(p, position=np.mod(p.position + way, round_it)) for p in scene.fluid)
        other = msgspec.structs.replace(scene, fluid=tuple(parts))
    a, b = run(scene, backend), run(other, backend)
    off = (places(b) - places(a)) * scene.spacing - way - boost * a.time
    off -= np.where(period > 0, np.round(off / round_it) * period, 0.0)
    return Found(apart(off / scene.spacing, 0 * off), abs(k) * ROUNDING, f"moved by {way} m, boosted by {boost} m/s")


@law("frames")
def sway_as_formula(drawn: Drawn, backend: str) -> Found | None:
    """A tank that sways, its motion given by numbers and by a formula: the same run."""
    if of_kind(drawn.scene, Gravity) is None or (liquid := of_kind(drawn.scene, WeaklyCompressible)) is None:
        return None
    size, period = 0.1 * drawn.scene.spacing, 100 * drawn.scene.spacing / liquid.sound_speed
    way, formula = {"of": "gravity", "direction": (1.0, 1.0, 0.0)}, f"{size!r} * sin(2*pi*t/{period!r})"
    sways = Motion(kind="sway", amplitude=size, period=period, **way), Motion(kind="formula", formula=formula, **way)
    a, b = (made(msgspec.structs.replace(drawn.scene, motion=(sway,)), backend) for sway in sways)
    return Found(runs_apart(a, b), ROUNDING, "a sway by numbers and by a formula")


@law("frames")
def given_otherwise(drawn: Drawn, backend: str) -> Found | None:
    """A block as one box, as two, and as a cloud of the same places."""
    scene, cells, d = drawn.scene, drawn.cells, drawn.scene.spacing
    full, at = (*cells, 1)[:3], int(drawn.random().integers(1, cells[0]))
    if scene.solid or stops(msgspec.structs.replace(scene, fluid=(Box(cells=full),)), backend):
        return None
    two = (Box(cells=(at, *full[1:])), Box(lower=(at * d, 0.0, 0.0), cells=(full[0] - at, *full[1:])))
    given = ((Box(cells=full),), two, (Cloud(position=lattice(cells, d)),))
    a, b, c = (places(r)[order(r)] for r in (run(msgspec.structs.replace(scene, fluid=f), backend) for f in given))
    return Found(max(apart(a, b), apart(a, c)), ROUNDING, f"a box, two that share a face at {at} cells, a cloud")


@law("same run")
def other_backend(drawn: Drawn, backend: str) -> Found | None:
    """The kernels give the run of the equations summed over all pairs by NumPy; errata of a source are drawn, too."""
    random, scene = drawn.random(), drawn.scene
    if backend == "numpy" or sum(len(part.position) for part in scene.fluid) > 500:
        return None
    for effect in scene.effects:
        if (errata := getattr(effect, "errata", ())) and random.random() < 0.3:
            own, printed = of_kind(scene, type(effect)), (str(random.choice(errata)),)
            scene = with_effect(scene, msgspec.structs.replace(own, literal=printed))
    a, b = made(scene, "numpy"), made(scene, backend, threads=1 + int(random.integers(config.NUMBA_NUM_THREADS)) % 2)
    v, fast = a.field("velocity").astype(float), float(random.choice([1.0, 1.0, 20.0]))  # which then limits the step
    shaken = v + (v != 0).any(0) * fast * np.abs(v).max() * random.uniform(-1, 1, v.shape)  # bodies, too
    warm = random.uniform(-1, 1, a.count)
    for each in (a, b):
        each.set_field("velocity", shaken)
        warmed(each, warm)
        try:
            take_steps(each, 3)
        except RunStopped:
            if each is a:
                return None
            raise
    b.evaluate()
    if in_turn(scene) and (a.host("identity") != b.host("identity")).any():
        return None
    return Found(max(apart(places(a), places(b)), fields_apart(a, b)), 1e-9, f"numpy and {backend}, all fields", scene)


@law("same run")
def written(drawn: Drawn, backend: str) -> Found:
    """Written as TOML and read again: the same bits."""
    again = parse_scene(scene_to_toml(drawn.scene), "scene.toml")
    return Found(runs_apart(made(drawn.scene, backend), made(again, backend), 2), 0.0, "written and read")


@law("same run")
def resumed(drawn: Drawn, backend: str) -> Found:
    """Stopped after some steps, written, read and gone on: the same bits, in float64 and float32."""
    random = drawn.random()
    scene = msgspec.structs.replace(drawn.scene, dtype=str(random.choice(["float64", "float32"])))
    first = int(random.integers(1, drawn.steps))
    whole, part = run(scene, backend, drawn.steps), run(scene, backend, first)
    with tempfile.TemporaryDirectory() as folder:
        part.checkpoint(Path(folder) / "checkpoint.h5")
        again = Simulation.resume(Path(folder) / "checkpoint.h5", backend=backend)
    take_steps(again, drawn.steps - first)
    kept = ["position", "velocity", *(name for name, field in whole.plan.fields.items() if field.state)]
    other = [name for name in kept if whole.field(name).tobytes() != again.field(name).tobytes()]
    return Found(len(other), 0.0, f"{scene.dtype}, resumed after {first} steps: {', '.join(other)}", scene)


@law("same run")
def single_precision(drawn: Drawn, backend: str) -> Found:
    """In float32 the same motion, to the rounding of float32."""
    a, b = run(drawn.scene, backend, 3), run(msgspec.structs.replace(drawn.scene, dtype="float32"), backend, 3)
    return Found(apart(places(a), places(b)), 1e-3, "float32")


@law("refinement")
def half_the_step(drawn: Drawn, backend: str) -> Found | None:
    """With half the step a run moves less than with the whole one, in the mean: towards the solution in time."""
    scene, liquid = drawn.scene, of_kind(drawn.scene, WeaklyCompressible)
    if liquid is None or corrected(scene) or any(e.host_in_step or e.replaces() for e in scene.effects):
        return None
    longest = run(scene, backend, 1).time
    runs = [places(run(msgspec.structs.replace(scene, step=0.5 * longest / n), backend, 2 * n)) for n in (1, 2, 4)]
    coarse, fine = (float(np.nan_to_num(np.abs(a - b), nan=np.inf).mean()) for a, b in (runs[:2], runs[1:]))
    return Found(fine, max(0.8 * coarse, ROUNDING), "half and a quarter of the step")
