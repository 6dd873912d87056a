"""Scene files: what is read is what was written, and every mistake is named with its place."""

import json
import pathlib

import msgspec
import numpy as np
import pytest

import refsim
from refsim import Ball, Box, Cloud, Gauge, Gravity, Motion, Scene, WeaklyCompressible, make_plan
from refsim.commands.plan import _text, describe_plan
from refsim.core.effect import EFFECTS
from refsim.scene.files import SHAPES, describe, load_scene, parse_scene, scene_schema, scene_to_toml, unit_of

PACKAGE = pathlib.Path(refsim.__file__).parent
EXAMPLES = sorted((PACKAGE / "examples").glob("*.toml"))
PUBLISHED = {name: effect for name, effect in EFFECTS.items() if effect.__module__.startswith("refsim.")}


def test_toml_gives_the_same_scene_back_bit_for_bit():
    scene = Scene(
        name='a "name" \\ with\nlines, é and \U0001f4a7 and \x7f', spacing=0.1 + 1e-17, support_radius=1 / 3, dim=2,
        dtype="float64", step=1e-300,
        fluid=(
            Ball(radius=np.nextafter(1.0, 2.0), center=(1.0, -2.5, 0.0)),
            Box(cells=(1, 2, 1), velocity=(1e-9, 0.0, 0.0)),
        ),
        effects=(
            Gravity(acceleration=(0.1, 0.2, 0.0)),
            WeaklyCompressible(sound_speed=3.0, clamp_pressure=False, density="summation"),
        ),
        gauge=(Gauge(name="floor", kind="force", on="-y", every=0.02),),
        motion=(Motion(of="gravity", kind="formula", direction=(0.0, 1.0, 0.0), formula="0.01*t**3"),),
    )  # fmt: skip
    text = scene_to_toml(scene)
    again = parse_scene(text, "scene")
    assert (again, [e.name for e in again.effects]) == (scene, ["gravity", "weakly_compressible"])
    assert scene_to_toml(again) == text
    cloud = Cloud(position=np.array([[0.1, 0.2, 0.3], [1 / 3, 0.0, 1e-20]]), mass=np.array([1.0, 2.0]))
    again = parse_scene(scene_to_toml(scene.with_(fluid=(cloud,))), "scene").fluid[0]
    assert np.array_equal(again.position, cloud.position)
    assert again.mass == (1.0, 2.0)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_load_and_plan_without_a_note(path):
    plan = make_plan(load_scene(path))
    told, scene = _text(describe_plan(plan, "cpu")), plan.scene
    assert plan.notes == ()
    assert scene.name in told
    grows = {"mpm_liquid": "blocks that the background grid gains", "mesh_boundary": "distances in a band"}
    beside = [words for name, words in grows.items() if name in {effect.name for effect in scene.effects}]
    assert ("Not counted, since it follows the run: " in told) == bool(beside)
    assert all(f"Not counted, since it follows the run: {words}" in told for words in beside)


def test_the_published_schema_is_current_and_every_field_says_what_it_is():
    committed = json.loads((PACKAGE / "scene" / "scene.schema.json").read_text())
    assert committed == scene_schema(PUBLISHED), "renew it: python -m refsim schema > refsim/scene/scene.schema.json"
    for owner in (Scene, *SHAPES.values(), *PUBLISHED.values()):
        assert set(describe(owner)) == {f.name for f in msgspec.structs.fields(owner)}, owner.__name__
    schema = scene_schema(PUBLISHED)
    assert schema["properties"]["spacing"]["x-unit"] == "m"
    assert schema["$defs"]["Gravity"]["properties"]["acceleration"]["x-unit"] == "m/s^2"
    assert unit_of('faces without wall, of "-x"') is None
    for entry in [schema, *schema["$defs"].values()]:
        assert entry["additionalProperties"] is False
        assert all("description" in field for field in entry["properties"].values())
