"""Scenes of 50 to 3,000 particles, drawn by Hypothesis: every effect by its own schema, every length, time and mass."""

import random
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from hypothesis import strategies as st

from refsim import Cloud, Motion, Scene, SolidBall, SolidBox, SolidMesh
from refsim.core.capabilities import PullsParticles
from refsim.core.checked import Printed, Share
from refsim.core.effect import EFFECTS, Effect
from refsim.sph import DIFFUSION
from validation.laws.units import Unit, hexahedron, unit, units_of

Draw = Callable[[st.SearchStrategy[Any]], Any]
Effects = dict[str, Effect]
LIQUID = "weakly_compressible"
LIQUIDS = (LIQUID, LIQUID, LIQUID, LIQUID, "mpm_liquid")
# What a scene is built around is chosen with its shape; the other effects are drawn.
BUILT = {LIQUID, "mpm_liquid", "gravity", "box_walls", "mpm_walls", "mesh_boundary", "shape_matching",
         "two_way_coupling", "melting"}  # fmt: skip
OF_MPM = {"mpm_liquid", "mpm_walls", "surface_energy"}
OF_BODIES = {"shape_matching", "two_way_coupling", "melting"}
SURROUNDINGS = ("free", "free", "free", "box", "box", "box", "box", "mesh", "both", "period", "period")
BODY = ("", "", "", "", "one", "two")
SHAPES = ("block", "block", "block", "ball", "notched", "parted")
# Parameters that say which of the others count, or name files and parts
UNDRAWN = ("literal", "file", "latent_heat", "surface", "cell_size")
COSTLY = ("quadrature",)  # in space the NumPy backend takes seconds a step
SUPPORTS = (*(2.0, 2.13, 2.62, 3.0, 3.21) * 5, 1.02)  # spacings; in lattices h = 2 d and 3 d cut at pairs
LARGEST_SHIFT, FEW, MANY = 0.1, 300, 3000  # spacings off the lattice; particles for the NumPy backend, for the others


class Drawn(NamedTuple):
    """A scene with what a law needs to vary it."""

    scene: Scene
    seed: int  # of everything that a law draws by itself
    cells: tuple[int, ...]  # particles along each axis of the block that the liquid is cut out of
    filled: bool  # whether that block fills the bottom of a box
    steps: int = 8  # of a run whose answer does not depend on rounding

    def random(self) -> np.random.Generator:
        """A generator for what the law draws."""
        return np.random.default_rng(self.seed)


class Frame(NamedTuple):
    """What the effects of a scene are drawn for; lengths in spacings, `scale` is what the units become."""

    dim: int
    cells: tuple[int, ...]
    around: str
    scale: Unit
    deep: int  # cells that a mesh takes below the liquid
    asked: str | None  # the effect that is asked for, whose parameters are drawn more often

    def corners(self, lower: Any, upper: Any) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Two corners [m], z = 0 in the plane."""
        ends = (np.pad(np.asarray(end, float), (0, 3 - self.dim)) for end in (lower, upper))
        return tuple(tuple((self.scale.length * end).tolist()) for end in ends)  # type: ignore[return-value]


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    """10^x with x in steps of a tenth."""
    return st.integers(round(10 * low), round(10 * high)).map(lambda k: 10.0 ** (k / 10))


class Alike(NamedTuple):
    """Draws numbers anew, and what kernels are compiled for by a generator of its own: scenes of one combination."""

    draw: Draw
    chosen: random.Random

    def __call__(self, strategy: st.SearchStrategy[Any]) -> Any:
        return self.draw(strategy)


def choose(draw: Draw, options: Sequence[Any]) -> Any:
    """One of what kernels are compiled for."""
    return draw.chosen.choice(options) if isinstance(draw, Alike) else draw(st.sampled_from(options))


@st.composite
def drawn(draw: Draw, effect: str | None = None, most: int = FEW, alike: int | None = None) -> Drawn:
    """A scene of `most` particles at most; with `effect` that effect is in it; `alike` numbers a combination."""
    draw = draw if alike is None else Alike(draw, random.Random(alike))
    spacing, speed, density = draw(powers(-4, 1)), draw(powers(-1, 2)), draw(powers(0, 4))
    scale = Unit(spacing, spacing / speed, density * spacing**3, 1.0)
    kind: Any = EFFECTS.get(effect or "", Effect)
    wet = LIQUID in kind.needed or effect in BUILT
    liquid = "mpm_liquid" if effect in OF_MPM else LIQUID if wet else choose(draw, LIQUIDS)
    around = choose(draw, SURROUNDINGS)
    if liquid == "mpm_liquid":
        around = "box" if around != "free" or effect == "mpm_walls" else "free"
    elif effect in ("box_walls", "mesh_boundary") and around != "both":
        around = effect.split("_")[0]
    elif around not in ("free", "box") and effect in OF_BODIES:
        around = "box"
    elif around == "period" and effect and not kind.periodic:
        around = "free"
    bodies = "one" if effect in OF_BODIES else choose(draw, BODY)
    alone = issubclass(kind, PullsParticles) or (kind.replaced and effect not in OF_BODIES)
    bodies = "" if liquid != LIQUID or around in ("period", "mesh", "both") or alone else bodies
    dim = 3 if around in ("mesh", "both") else choose(draw, (2, 2, 3))
    largest = most if most > FEW and draw(st.integers(0, 4)) == 4 else min(most, 144)
    widest = [round(largest ** (1 / axes) - 0.2) for axes in (2, 3)]
    cells = tuple(draw(st.integers(7 if dim == 2 else 4, widest[dim - 2])) for _ in range(dim))
    if around == "period":
        cells = tuple(max(n, 8) if axis == 0 or dim == 2 else n for axis, n in enumerate(cells))
    frame = Frame(dim, cells, around, scale, 2 if around in ("mesh", "both") else 0, effect)
    effects: dict[str, Effect] = {liquid: _liquid(draw, liquid, frame, bool(bodies))}
    if choose(draw, (False, True)) or effect == "gravity":
        g = speed**2 / (400 * cells[dim - 1] * spacing)  # c = 10 sqrt(2 g H), H = the box's height
        effects["gravity"] = EFFECTS["gravity"](acceleration=tuple(-g * (axis == dim - 1) for axis in range(3)))
    motion = _walls(draw, effects, frame, liquid)
    solid, taken = _bodies(draw, effects, frame, bodies, effect)
    pool = [name for name in sorted(set(EFFECTS) - BUILT) if _fits(name, effects, around)]
    chosen = [choose(draw, pool) for _ in range(choose(draw, (0, 1, 1, 2)))]
    chosen = [effect, *chosen[:1]] if effect in pool else chosen
    for name in chosen:
        _add(draw, effects, name, frame)
    seed, shape = draw(st.integers(0, 2**16)), draw(st.sampled_from(SHAPES if around != "period" else SHAPES[:1]))
    scene = Scene(
        dim=dim, dtype="float64", spacing=spacing, support_radius=spacing * draw(st.sampled_from(SUPPORTS)),
        fluid=_clouds(seed, frame, shape, taken), solid=solid, effects=tuple(effects.values()), motion=motion,
        period=(spacing * cells[0], spacing * cells[1] * (3 - dim), 0.0) if around == "period" else (0.0, 0.0, 0.0),
        step_factor=draw(st.sampled_from((1.0, 1.0, 0.5))), skin=choose(draw, (None, None, 0.0, 0.3)),
    )  # fmt: skip
    filled = around == "box" and liquid == LIQUID and not bodies
    return Drawn(scene, seed, cells, filled, draw(st.sampled_from((8, 8, 20) if most <= FEW else (20, 100, 400))))


def _clouds(seed: int, frame: Frame, shape: str, taken: np.ndarray) -> tuple[Cloud, ...]:
    """The liquid: particles near a lattice, in a shape, without the cells that bodies take."""
    drawing, dim, d = np.random.default_rng(seed), frame.dim, frame.scale.length
    grid = np.stack(np.meshgrid(*map(np.arange, frame.cells), indexing="ij"), -1).reshape(-1, dim)
    x, v = np.zeros((2, len(grid), 3))
    x[:, :dim] = d * (grid + 0.5 + LARGEST_SHIFT * drawing.uniform(-1, 1, grid.shape))
    v[:, :dim] = 0.02 * d / frame.scale.time * drawing.uniform(-1, 1, grid.shape)
    middle = (np.array(frame.cells) - 1) / 2
    kept = np.ones(len(grid), bool)
    if shape == "ball":
        kept = ((grid - middle) ** 2).sum(1) <= (middle.max() + 0.3) ** 2
    elif shape == "notched":
        kept = ~(grid > middle).all(1)
    kept &= ~(grid[:, None] == taken[None]).all(-1).any(1) if len(taken) else True
    parts = [kept & (grid[:, 0] < middle[0]), kept & (grid[:, 0] > middle[0] + 1)] if shape == "parted" else [kept]
    return tuple(Cloud(position=x[part], velocity=v[part]) for part in parts if part.any())


def _walls(draw: Draw, effects: Effects, frame: Frame, liquid: str) -> tuple[Motion, ...]:
    """Walls of a box twice as high as the liquid, a flat or sloped mesh below it, and what moves."""
    dim, cells, d = frame.dim, np.array(frame.cells), frame.scale.length
    top = cells * np.where(np.arange(dim) == dim - 1, 2, 1)
    below = np.where(np.arange(dim) == dim - 1, -frame.deep, 0)
    moving: dict[str, Any] = {}
    if frame.around in ("box", "both") and liquid == "mpm_liquid":
        low, high = frame.corners(np.full(dim, -4), top + 4)
        held = choose(draw, ("sticky", "slip", "separating"))
        faces = {f"{held}_faces": ("-x",), "open_faces": choose(draw, ((), ("+x",)))}
        effects["mpm_walls"] = make_effect(draw, "mpm_walls", frame, lower=low, upper=high, **faces)
    elif frame.around in ("box", "both"):
        low, high = frame.corners(below, top)
        if choose(draw, (0, 0, 0, 1)):
            moving = {"moving_faces": ("+x",), "velocity": (0.0, 0.05 * d / frame.scale.time, 0.0)}
        if frame.around == "both":  # the friction of a box would act at the mesh, too
            moving = {"viscosity": 0.0, "no_slip": False, "model": None}
        opened = choose(draw, ((), (), (("+y", "+z")[dim - 2],)))
        effects["box_walls"] = make_effect(draw, "box_walls", frame, lower=low, upper=high, open_faces=opened, **moving)
    if frame.around in ("mesh", "both"):
        file = hexahedron(*cells[:2], frame.deep, slope=draw(st.sampled_from((0.0, 0.5))))
        middle = tuple(d * np.array([cells[0] / 2, cells[1] / 2, -frame.deep / 2]))
        size = d * float(cells[:2].max())
        given: dict[str, Any] = {"file": file, "center": middle, "size": size, "radius": 0.0, "field_spacing": 0.0}
        given |= {"model": None} if frame.around == "both" else {}
        effects["mesh_boundary"] = make_effect(draw, "mesh_boundary", frame, **given)
    if liquid == "mpm_liquid" or choose(draw, (1, 1, 1, 1, 0)):
        return ()
    of = "moving_faces" if "moving_faces" in moving else choose(draw, ("gravity", "turn"))
    if of != "moving_faces" and "gravity" not in effects:
        return ()
    time, size = frame.scale.time, 0.01 if of == "turn" else 0.1 * d
    table = {"times": tuple(time * t for t in (0.0, 0.3, 1.0, 3.0)), "values": (0.0, 0.01 * size, 0.1 * size, size)}
    sway = {"amplitude": size, "period": 40 * time, "ramp": choose(draw, (None, 0.5 * time))}
    turns = {"pivot": (d, d, 0.0), "direction": (0.0, 0.0, 1.0)} if of == "turn" else {"direction": (0.0, 1.0, 0.0)}
    kind = choose(draw, ("sway", "sway", "table"))
    return (Motion(of=of, kind=kind, **turns, **(sway if kind == "sway" else table)),)


def _bodies(draw: Draw, effects: Effects, frame: Frame, number: str, effect: str | None) -> tuple[Any, np.ndarray]:
    """Solid bodies anywhere in or near the liquid, and the cells that they take (k, 3)."""
    solid, taken = [], np.zeros((0, frame.dim), int)
    reach, up = 0 if frame.around == "box" else 5, np.arange(3) == frame.dim - 1
    for _ in range(("", "one", "two").index(number)):
        size, d, speed = draw(st.integers(2, 4)), frame.scale.length, frame.scale.length / frame.scale.time
        ends = [n * (2 if axis == frame.dim - 1 else 1) + reach for axis, n in enumerate(frame.cells)]
        at = np.array([draw(st.integers(-reach, end - size)) for end in ends])
        own = np.indices((size,) * frame.dim).reshape(frame.dim, -1).T + at
        if (own[:, None] == taken[None]).all(-1).any():
            continue
        taken = np.concatenate([taken, own])
        given: dict[str, Any] = {"density": unit("kg/m^3").of(frame.scale) * draw(powers(-0.5, 0.5))}
        if choose(draw, (False, True)):
            given |= {"spin": (0.0, 0.0, 0.01 * speed / d), "velocity": tuple(speed * np.where(up, 0.01, [0.02, 0, 0]))}
        low, center, high = (tuple(np.pad(d * x, (0, 3 - frame.dim))) for x in (at, at + size / 2, at + size))
        shape = choose(draw, ("box", "ball", "mesh"))
        if shape == "box":
            solid.append(SolidBox(lower=low, upper=high, **given))
        elif shape == "mesh":
            solid.append(SolidMesh(file=hexahedron(1, 1, 1), center=center, size=size * d, **given))
        else:
            solid.append(SolidBall(center=center, radius=0.51 * size * d, **given))
    if solid:
        effects["shape_matching"] = make_effect(draw, "shape_matching", frame)
        effects["two_way_coupling"] = make_effect(draw, "two_way_coupling", frame)
        if effect == "melting" or choose(draw, (0, 0, 0, 1)):
            point = choose(draw, (0.5, -0.5))  # of what begins at 0: all stays or all melts
            warmth = {"melting_point": point, "latent_heat": unit("J/kg").of(frame.scale) * draw(powers(-2, 1))}
            effects["heat_conduction"] = make_effect(draw, "heat_conduction", frame, **warmth)
            effects["melting"] = make_effect(draw, "melting", frame)
    return tuple(solid), taken


def _fits(name: str, effects: Mapping[str, Effect], around: str) -> bool:
    """Whether the scene has, or can be given, what the effect needs whatever its parameters are."""
    kind = EFFECTS[name]
    needed = kind.needed or (() if any(f.required for f in msgspec.structs.fields(kind)) else kind().needs())
    pulls = issubclass(kind, PullsParticles) and "two_way_coupling" in effects
    taken = {operation for effect in effects.values() for operation in effect.replaced}
    free = not (pulls or taken & {*kind.replaced}) and (around != "period" or kind.periodic)
    return free and all(n in effects or n not in BUILT for n in needed)


def _add(draw: Draw, effects: dict[str, Effect], name: str, frame: Frame) -> None:
    """The effect and what it needs; one tension at most."""
    pulls = issubclass(EFFECTS[name], PullsParticles) and any(isinstance(e, PullsParticles) for e in effects.values())
    if name in effects or pulls:
        return
    effects[name] = make_effect(draw, name, frame)
    for other in effects[name].needs():
        if other not in BUILT:
            _add(draw, effects, other, frame)


def _liquid(draw: Draw, name: str, frame: Frame, bodies: bool) -> Effect:
    """The liquid, with a viscosity at which it is known to behave."""
    density, speed = unit("kg/m^3").of(frame.scale), unit("m/s").of(frame.scale)
    if name == "mpm_liquid":
        return make_effect(draw, name, frame, rest_density=density, bulk_modulus=density * speed**2)
    given = {"rest_density": density, "sound_speed": speed, "tensile_control": "none"}
    given["dynamic_viscosity"] = density * speed * 3.0 * unit("m").of(frame.scale) / 60
    given["density"] = kind = choose(draw, (None, None, "summation", "continuity"))
    if bodies:
        given |= {"viscosity": None, "clamp_pressure": None}
    if kind != "continuity":  # what belongs to an advanced density
        given |= {"diffusion": DIFFUSION, "restoring": None}
    return make_effect(draw, name, frame, **given)


def make_effect(draw: Draw, name: str, frame: Frame, **given: Any) -> Effect:
    """An effect: what it must have, and a third of what it may have, by its schema; two thirds if it is asked for."""
    kind = EFFECTS[name]
    if {"no_slip", "viscosity"} <= {*kind.__struct_fields__} - {*given}:
        held = choose(draw, (False, False, True)) or bool(given.get("moving_faces"))
        given |= {"no_slip": held} | ({"viscosity": 0.0} if held else {})
    for field in msgspec.structs.fields(kind):
        needed = field.required or kind.scales[:1] == (field.name,)
        if field.name not in given and (needed or choose(draw, (0, 1, 1) if name == frame.asked else (0, 0, 1))):
            value = _value(draw, kind, field, frame)
            given |= {} if value is None else {field.name: value}
    return kind(**given)


def _value(draw: Draw, kind: type[Effect], field: Any, frame: Frame) -> Any:
    """A value of a parameter; None leaves it out."""
    united = typing.get_origin(field.type) in (typing.Union, types.UnionType)
    inside = [k for k in (typing.get_args(field.type) if united else (field.type,)) if k is not types.NoneType]
    own = units_of(kind, frame.dim).get(field.name)
    if field.type is Printed or field.name in UNDRAWN or (frame.dim == 3 and field.name in COSTLY):
        return None
    if field.name == "held" or field.type is int:
        return choose(draw, ((), (0,)) if field.name == "held" else (1, 2, 3))
    if choices := [c for k in inside if typing.get_origin(k) is typing.Literal for c in typing.get_args(k)]:
        return choose(draw, choices) if not isinstance(choices[0], tuple) else None
    if bool in inside:
        return choose(draw, (False, True))
    if field.type is Share:
        return draw(st.integers(0, 10)) / 10
    if not any(k is float or typing.get_origin(k) is typing.Annotated for k in inside) or int in inside:
        return None
    if field.name in kind.scales[1:] and field.name != "area_acceleration":
        return None  # other coefficients stand for the first one
    if own is None:  # without a unit: near the default
        usual = field.default
        return usual * draw(powers(0, 0.2)) if isinstance(usual, float) and usual else None
    if frame.dim == 2 and own.mass not in (0, 1):
        return None  # masses of the plane are those of a metre of depth
    return own.of(frame.scale) * draw(powers(-3, -1))
