"""Scenes of panels: NAME.toml beside this module has that of the panel's base setting, and others follow from it.

Where no box or ball gives the particles, a function of `making` gives the scene of every setting, or NAME.zip holds it:
of drops that were stirred for seconds.
"""

import io
import zipfile
from collections.abc import Sequence
from fractions import Fraction

import msgspec
import numpy as np

from refsim.scene.files import parse_scene, scene_from_dict, scene_to_dict, set_parameter, tables_of
from refsim.scene.plan import make_plan
from refsim.scene.refine import refined
from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud
from refsim.study.panels import FOLDER, Panel, Point, panel
from refsim.study.panels.scene_factories import SCENE_FACTORIES

PACKED = frozenset(file.name.removesuffix(".zip") for file in FOLDER.iterdir() if file.name.endswith(".zip"))


def packaged(name: str) -> Scene:
    """The scene of a panel's base setting."""
    of = panel(name)
    return scene_of(of, of.points[of.about.base])


def written(of: Panel, point: Point) -> Scene:
    """The scene of a setting as its first reading was measured."""
    return scene_of(of, point, 0 if of.about.shaken else None)


def scene_of(of: Panel, point: Point, reading: int | None = None) -> Scene:
    """The scene of a setting of refsim's.

    reading  its number, where starts differ: of panels that are `shaken`, and of some of `MADE`

    Against the base the spacing is refined, steps are shortened in proportion to the knob `step`, and `point.setting`
    holds other parameters of the scene file by name, as in sweeps.
    """
    if of.name in PACKED:
        with zipfile.ZipFile(io.BytesIO((FOLDER / f"{of.name}.zip").read_bytes())) as scenes:
            return parse_scene(scenes.read(packed(point)).decode(), packed(point))
    if of.name in SCENE_FACTORIES:
        made = SCENE_FACTORIES[of.name]({**point.knobs, **point.setting}, reading or 0)
        return msgspec.structs.replace(made, name=of.name)
    tables = tables_of((FOLDER / f"{of.name}.toml").read_text(encoding="utf-8"), f"{of.name}.toml")
    scene = scene_from_dict({key: value for key, value in tables.items() if key != "panel"}, f"{of.name}.toml")
    base, knobs = of.points[of.about.base].knobs, point.knobs
    step = knobs.get("step", 1.0) / base.get("step", 1.0)
    if "spacing" in knobs:
        factor = Fraction(base["spacing"] / knobs["spacing"]).limit_denominator(100)
        scene = refined(scene, float(factor), of.about.with_spacing)
    name = "step" if scene.step > 0 else "step_factor"
    scene = msgspec.structs.replace(scene, dtype=knobs["dtype"], **{name: step * getattr(scene, name)})
    scene = changed(scene, tuple(point.setting.items()))
    return jittered(scene, reading) if of.about.shaken and reading is not None else scene


def packed(point: Point) -> str:
    """Name of a setting's scene in NAME.zip, whatever it ran on."""
    return f"{point.key.removeprefix('cuda_')}.toml"


def jittered(scene: Scene, seed: int, share: float = 0.01) -> Scene:
    """The scene with its liquid displaced at random along its axes, by `share` of the spacing (rms).

    From an exact lattice only rounding breaks the symmetry, later in float64 than in float32.
    """
    position = make_plan(scene).state.position.astype(float)
    moved = np.random.default_rng(seed).normal(0.0, share * scene.spacing, position.shape)
    cloud = Cloud(position=position + np.where(np.ptp(position, axis=0) > 0.0, moved, 0.0))
    return msgspec.structs.replace(scene, fluid=(cloud,))


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
