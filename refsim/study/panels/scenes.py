"""Scenes of panels: NAME.toml beside this module is that of the panel's base setting, and others follow from it.

Where no box or ball gives the particles, a function of `making` gives the scene of every setting.
"""

from collections.abc import Sequence
from fractions import Fraction

import msgspec
import numpy as np

from refsim.scene.files import parse_scene, put, scene_from_dict, scene_to_dict
from refsim.scene.plan import make_plan
from refsim.scene.refine import refined
from refsim.scene.scene import Scene
from refsim.scene.shapes import Cloud
from refsim.study.panels import FOLDER, OWN, Panel, Point, panel
from refsim.study.panels.making import MADE


def packaged(name: str) -> Scene | None:
    """The scene of a panel's base setting."""
    if name in MADE:
        of = panel(name)
        return scene_of(of, of.points[of.about.base])
    return parse_scene((FOLDER / f"{name}.toml").read_text(encoding="utf-8"), f"{name}.toml")


def scene_of(panel: Panel, point: Point, reading: int | None = None) -> Scene | None:
    """The scene of a setting; None without a packaged one and for other programs.

    reading  its number, where starts differ: of panels that are `shaken`, and of some of `MADE`

    Against the base the spacing is refined, steps are shortened in proportion to the knob `step`, and `point.setting`
    holds other parameters of the scene file by name, as in sweeps.
    """
    if panel.name in MADE:
        if point.program != OWN:
            return None
        made = MADE[panel.name]({**point.knobs, **point.setting}, reading or 0)
        return msgspec.structs.replace(made, name=panel.name)
    scene = packaged(panel.name)
    base = panel.points[panel.about.base].knobs
    knobs = point.knobs
    step = knobs.get("step", 1.0) / base.get("step", 1.0)
    if scene is None or point.program != OWN:
        return None
    if "spacing" in knobs:
        factor = Fraction(base["spacing"] / knobs["spacing"]).limit_denominator(100)
        scene = refined(scene, float(factor), panel.about.with_spacing)
    scene = msgspec.structs.replace(scene, dtype=knobs.get("dtype", scene.dtype))
    if step != 1 and scene.step > 0:
        scene = msgspec.structs.replace(scene, step=step * scene.step)
    elif step != 1:
        scene = msgspec.structs.replace(scene, step_factor=step * scene.step_factor)
    scene = changed(scene, tuple(point.setting.items()))
    return shaken(scene, reading) if panel.about.shaken and reading is not None else scene


def shaken(scene: Scene, seed: int, share: float = 0.01) -> Scene:
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
        put(tables, name, value, scene.name)
        if name.endswith(".cells"):  # which give the edges, then
            put(tables, name.replace(".cells", ".size"), None, scene.name)
    return scene_from_dict(tables, scene.name)
