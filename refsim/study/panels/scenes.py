"""Scenes of panels: NAME.toml beside this module has that of the panel's base setting, and others follow from it.

NAME.zip holds those of drops that were stirred for seconds. A function of `STARTS` gives particles that no box or ball
gives, or that differ from reading to reading.
"""

import io
import math
import zipfile
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from refsim.core.effect import Discretisation
from refsim.scene.files import parse_scene, scene_from_dict, scene_to_dict, set_parameter, tables_of
from refsim.scene.refine import refined
from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud
from refsim.study.panels import FOLDER, Panel, Point, panel

PACKED = frozenset(file.name.removesuffix(".zip") for file in FOLDER.iterdir() if file.name.endswith(".zip"))
MODULUS = 1000.0  # of MPM discs [N/m]


def packaged(name: str) -> Scene:
    """The scene of a panel's base setting."""
    of = panel(name)
    return scene_of(of, of.points[of.about.base])


def scene_of(of: Panel, point: Point, reading: int | None = None) -> Scene:
    """The scene of a setting of refsim's.

    reading  its number, where starts differ; None for an undisturbed lattice in place of a shaken one

    Against the base the spacing is refined, steps are shortened in proportion to the knob `step`, and `point.setting`
    holds other parameters of the scene file by name, as in sweeps.
    """
    if of.name in PACKED:
        with zipfile.ZipFile(io.BytesIO((FOLDER / f"{of.name}.zip").read_bytes())) as scenes:
            return parse_scene(scenes.read(packed(point)).decode(), packed(point))
    tables = tables_of((FOLDER / f"{of.name}.toml").read_text(encoding="utf-8"), f"{of.name}.toml")
    tables.pop("panel")
    scene = scene_from_dict(tables, f"{of.name}.toml", Path(str(FOLDER)))
    base, knobs = of.points[of.about.base].knobs, point.knobs
    step = knobs.get("step", 1.0) / base.get("step", 1.0)
    if "spacing" in knobs:
        factor = Fraction(base["spacing"] / knobs["spacing"]).limit_denominator(100)
        scene = refined(scene, float(factor), of.about.with_spacing)
    name = "step" if scene.step > 0 else "step_factor"
    scene = msgspec.structs.replace(scene, dtype=knobs["dtype"], **{name: step * getattr(scene, name)})
    scene = changed(scene, tuple(point.setting.items()))
    start = of.about.start
    return STARTS[start](scene, reading or 0) if start and (start, reading) != ("shaken", None) else scene


def packed(point: Point) -> str:
    """Name of a setting's scene in NAME.zip, whatever it ran on."""
    return f"{point.key.removeprefix('cuda_')}.toml"


def changed(scene: Scene, values: Sequence[tuple[str, object]]) -> Scene:
    """The scene with other values of parameters, by name."""
    if not values:
        return scene
    tables = scene_to_dict(scene)
    for name, value in values:
        set_parameter(tables, name, value, scene.name)
        if name.endswith(".cells"):  # which give the edges, then
            set_parameter(tables, name.replace(".cells", ".size"), None, scene.name)
    return scene_from_dict(tables, scene.name)


def lattice(*axes: np.ndarray) -> np.ndarray:
    """All points of the axes (n, 3), with z = 0 of two."""
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    return np.pad(place, ((0, 0), (0, 3 - len(axes))))


# Starts: a scene's particles, by its spacing and the number of the reading


def shaken(scene: Scene, seed: int, share: float = 0.01) -> Scene:
    """The scene with its liquid displaced at random along its axes, by `share` of the spacing (rms).

    From an exact lattice only rounding breaks the symmetry, later in float64 than in float32.
    """
    position = places(scene)
    moved = np.random.default_rng(seed).normal(0.0, share * scene.spacing, position.shape)
    return started(scene, position + np.where(np.ptp(position, axis=0) > 0.0, moved, 0.0))


def vortices(scene: Scene, _: int) -> Scene:
    """Four Taylor-Green vortices of 1 m/s in a box of 1 m."""
    position = places(scene)
    x, y, _z = 2 * math.pi * position.T
    velocity = np.column_stack([np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y), 0 * x])
    return msgspec.structs.replace(scene, fluid=(Cloud(position=position, velocity=velocity),))


def ball_of_ice(scene: Scene, _: int) -> Scene:
    """What surrounds a ball of 1 m up to the support radius, and the ball, less half a spacing."""
    cells, support = 1 / scene.spacing - 0.5, scene.support_radius / scene.spacing
    reach = math.ceil(cells + support - 1e-9)
    axis = np.arange(-reach, reach) + 0.5
    place = lattice(axis, axis, axis)
    away = np.linalg.norm(place, axis=1)
    around = (away >= cells) & (away < cells + support)
    return started(scene, *(scene.spacing * place[of] for of in (around, away < cells)))


def disc(scene: Scene, seed: int, stretch: float = 0.0) -> Scene:
    """A disc of 11/64 m or an ellipse longer by `stretch`, with the pressure of a round drop, k = rho = 1.

    Cut from a lattice of four particles to a cell that is moved and turned at random, by `seed`.
    """
    h = 2 * scene.spacing
    semi = 11 / 64 / h * np.array([1.0 + stretch, 1.0 / (1.0 + stretch)])
    n = math.ceil(4 * semi.max()) + 2
    axis = 0.5 * (np.arange(-n, n) + 0.5)
    angle = np.random.default_rng(seed).uniform(0, 2 * math.pi)
    place = lattice(axis, axis)[:, :2] + np.random.default_rng(seed).uniform(-0.25, 0.25, 3)[:2]
    place = place @ np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]).T
    place = place[((place / semi) ** 2).sum(1) < 1]
    ratio = 1 - 1.0 / (h * math.sqrt(len(place) / (4 * math.pi))) / MODULUS
    scene = changed(scene, [("effects.mpm_liquid.initial_ratio", ratio)])
    return started(scene, np.pad(h * math.sqrt(ratio) * place, ((0, 0), (0, 1))))


def ellipse(scene: Scene, seed: int) -> Scene:
    """An ellipse, longer by 5 %, that swings for two periods."""
    scene = disc(scene, seed, 0.05)
    return msgspec.structs.replace(scene, end_time=2 * 2 * math.pi / frequency(scene))


def stored(scene: Scene, _: int) -> Scene:
    """Places and masses of NAME.npz."""
    with np.load(str(FOLDER / f"{scene.name}.npz")) as held:
        return msgspec.structs.replace(scene, fluid=(Cloud(position=held["position"], mass=held["mass"]),))


def places(scene: Scene) -> np.ndarray:
    """Positions (n, 3) [m] of the scene's only part."""
    part: Any = scene.fluid[0]
    at: np.ndarray = part.positions(Discretisation(scene.dim, scene.dtype, scene.spacing, scene.support_radius, 0))
    return at


def started(scene: Scene, *parts: np.ndarray) -> Scene:
    """The scene with particles at these positions, each part's."""
    return msgspec.structs.replace(scene, fluid=tuple(Cloud(position=position) for position in parts))


def frequency(scene: Scene) -> float:
    """Rayleigh's frequency of mode 2 of a disc [rad/s], sqrt(6 k/(rho R^3)) (Rayleigh 1879)."""
    return math.sqrt(6 / radius(scene) ** 3)


def radius(scene: Scene) -> float:
    """Radius of the disc of the volume of a scene's particles [m]."""
    cloud: Any = scene.fluid[0]
    return scene.spacing * math.sqrt(len(cloud.position) / math.pi)


STARTS: Mapping[str, Callable[[Scene, int], Scene]] = {
    each.__name__: each for each in (shaken, vortices, ball_of_ice, disc, ellipse, stored)
}
