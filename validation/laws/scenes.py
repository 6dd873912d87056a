"""Scenes of 20 to 300 particles, drawn by Hypothesis: every effect by its own schema, every length, time and mass."""

from __future__ import annotations

import types
import typing
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np
from hypothesis import strategies as st

import refsim  # noqa: F401  (all effects are then known)
from refsim.core.capabilities import PullsParticles
from refsim.core.checked import Printed, Share
from refsim.core.effect import EFFECTS, Effect
from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud
from refsim.sph import DIFFUSION
from validation.laws.units import Unit, unit, units_of

Draw = Callable[[st.SearchStrategy[Any]], Any]
LIQUIDS = ("weakly_compressible", "weakly_compressible", "weakly_compressible", "mpm_liquid")
# What a scene is built around is chosen with its shape; the other effects are drawn.
BUILT = {"weakly_compressible", "mpm_liquid", "gravity", "box_walls", "mpm_walls", "mesh_boundary", "shape_matching",
         "two_way_coupling", "melting"}  # fmt: skip
# Parameters that say which of the others count, or name files and parts
UNDRAWN = ("literal", "held", "file", "latent_heat", "surface")
SUPPORTS = (2.13, 2.62, 3.21)  # spacings; no pair of a lattice is as far apart
LARGEST_SHIFT = 0.1  # spacings by which a particle stands off its lattice


class Drawn(NamedTuple):
    """A scene with what a law needs to vary it.

    seed    of everything that a law draws by itself
    cells   particles along each axis of the block of liquid; () where there is no block
    filled  whether the block fills the bottom of a box of walls
    """

    scene: Scene
    seed: int
    cells: tuple[int, ...]
    filled: bool

    def random(self) -> np.random.Generator:
        """A generator for what the law draws."""
        return np.random.default_rng(self.seed)


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    """10^x with x in steps of a tenth."""
    return st.integers(round(10 * low), round(10 * high)).map(lambda k: 10.0 ** (k / 10))


@st.composite
def drawn(draw: Draw, effect: str | None = None) -> Drawn:
    """A scene; with `effect` that effect is in it."""
    dim = draw(st.sampled_from((2, 3)))
    spacing, speed, density = draw(powers(-4, 1)), draw(powers(-1, 2)), draw(powers(0, 4))
    cells = tuple(draw(st.integers(3, 9 if dim == 2 else 5)) for _ in range(dim))
    walls = draw(st.booleans()) or effect in ("box_walls", "mpm_walls")
    pulled = draw(st.booleans()) or effect == "gravity"
    liquid = draw(st.sampled_from(LIQUIDS))
    if effect in ("mpm_liquid", "mpm_walls", "surface_energy"):
        liquid = "mpm_liquid"
    scale = Unit(spacing, spacing / speed, density * spacing**3, 1.0)
    top = np.array([n * spacing for n in cells] + [0.0] * (3 - dim))
    top[dim - 1] *= 2
    effects: dict[str, Effect] = {liquid: _liquid(draw, liquid, scale, dim)}
    if pulled:
        pull = [0.0, 0.0, 0.0]
        pull[dim - 1] = -(speed**2) / (400 * cells[dim - 1] * spacing)  # c = 10 sqrt(2 g H), H = the box's height
        effects["gravity"] = EFFECTS["gravity"](acceleration=tuple(pull))
    if walls:
        name = "box_walls" if liquid == "weakly_compressible" else "mpm_walls"
        low = np.zeros(3) if name == "box_walls" else np.where(np.arange(3) < dim, -4 * spacing, 0.0)
        effects[name] = EFFECTS[name](lower=tuple(low), upper=tuple(top - low))
    pool = [name for name in sorted(set(EFFECTS) - BUILT) if _fits(name, effects)]
    chosen = draw(st.lists(st.sampled_from(pool), max_size=2, unique=True))
    if effect in pool:
        chosen = [effect, *chosen[:1]]
    for name in chosen:
        _add(draw, effects, name, scale, dim)
    grid = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in cells), indexing="ij"), -1).reshape(-1, dim)
    seed = draw(st.integers(0, 2**16))
    random = np.random.default_rng(seed)
    x, v = np.zeros((2, len(grid), 3))
    x[:, :dim] = spacing * (grid + LARGEST_SHIFT * random.uniform(-1, 1, grid.shape))
    v[:, :dim] = 0.02 * speed * random.uniform(-1, 1, grid.shape)
    scene = Scene(
        dim=dim, dtype="float64", spacing=spacing, support_radius=spacing * draw(st.sampled_from(SUPPORTS)),
        fluid=(Cloud(position=x, velocity=v),), effects=tuple(effects.values()),
    )  # fmt: skip
    return Drawn(scene, seed, cells, walls and liquid == "weakly_compressible")


def _fits(name: str, effects: Mapping[str, Effect]) -> bool:
    """Whether the scene has, or can be given, what the effect needs whatever its parameters are."""
    kind = EFFECTS[name]
    needed = kind.needed or (() if any(f.required for f in msgspec.structs.fields(kind)) else kind().needs())
    return all(other in effects or other not in BUILT for other in needed)


def _add(draw: Draw, effects: dict[str, Effect], name: str, scale: Unit, dim: int) -> None:
    """The effect and what it needs; one tension at most."""
    kind = EFFECTS[name]
    if name in effects or (
        issubclass(kind, PullsParticles) and any(isinstance(e, PullsParticles) for e in effects.values())
    ):
        return
    effects[name] = make_effect(draw, kind, scale, dim)
    for other in effects[name].needs():
        if other not in BUILT:
            _add(draw, effects, other, scale, dim)


def _liquid(draw: Draw, name: str, scale: Unit, dim: int) -> Effect:
    """The liquid, with a viscosity at which it is known to behave."""
    density = unit("kg/m^3").of(scale)
    speed = unit("m/s").of(scale)
    if name == "mpm_liquid":
        return make_effect(draw, EFFECTS[name], scale, dim, rest_density=density, bulk_modulus=density * speed**2)
    given = {"rest_density": density, "sound_speed": speed, "tensile_control": "none", "gradient": "plain"}
    given["dynamic_viscosity"] = density * speed * 3.0 * unit("m").of(scale) / 60
    kind = draw(st.sampled_from((None, None, "summation", "continuity")))
    given["density"] = kind
    if kind != "continuity":  # what belongs to an advanced density
        given |= {"diffusion": DIFFUSION, "restoring": None}
    return make_effect(draw, EFFECTS[name], scale, dim, **given)


def make_effect(draw: Draw, kind: type[Effect], scale: Unit, dim: int, **given: Any) -> Effect:
    """An effect: what it must have, and a third of what it may have, by its schema."""
    for field in msgspec.structs.fields(kind):
        needed = field.required or kind.scales[:1] == (field.name,)
        if field.name not in given and (needed or draw(st.integers(0, 2)) == 0):
            value = _value(draw, kind, field, scale, dim)
            if value is not None:
                given[field.name] = value
    return kind(**given)


def _value(draw: Draw, kind: type[Effect], field: Any, scale: Unit, dim: int) -> Any:
    """A value of a parameter; None leaves it out."""
    inside = [k for k in _parts(field.type) if k is not types.NoneType]
    own = units_of(kind, dim).get(field.name)
    if field.type is Printed or field.name in UNDRAWN:
        return None
    if choices := [c for k in inside if typing.get_origin(k) is typing.Literal for c in typing.get_args(k)]:
        return draw(st.sampled_from(choices)) if not isinstance(choices[0], tuple) else None
    if bool in inside:
        return draw(st.booleans())
    if field.type is Share:
        return draw(st.integers(0, 10)) / 10
    if not any(k is float or typing.get_origin(k) is typing.Annotated for k in inside) or int in inside:
        return None
    if field.name in kind.scales[1:] or kind.name == "mpm_liquid":
        return None  # instead of the first one; cells and bounds of MPM follow from each other
    if own is None:  # without a unit: near the default
        usual = field.default
        return usual * draw(powers(0, 0.2)) if isinstance(usual, float) and usual else None
    if dim == 2 and own.mass not in (0, 1):
        return None  # masses of the plane are those of a metre of depth
    return own.of(scale) * draw(powers(-3, -1))


def _parts(kind: Any) -> tuple[Any, ...]:
    return typing.get_args(kind) if typing.get_origin(kind) in (typing.Union, types.UnionType) else (kind,)
