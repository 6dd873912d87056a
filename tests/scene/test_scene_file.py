"""Scene files: what is read is what was written; what is refused in a sentence, and noted."""

import json
import pathlib
import re
import tomllib
import typing

import msgspec
import numpy as np
import pytest

import refsim as rs
from refsim.commands.plan import _text, describe_plan
from refsim.core.effect import EFFECTS
from refsim.scene import files
from tests import pairs
from tests.running import rows

PACKAGE = pathlib.Path(rs.__file__).parent
EXAMPLES = PACKAGE / "examples"
TABLES = pathlib.Path(__file__).with_name("refused_and_noted.toml").read_text(encoding="utf-8")
SCENES = tomllib.loads(TABLES.replace("EXAMPLES", str(EXAMPLES)))
PUBLISHED = {name: effect for name, effect in EFFECTS.items() if effect.__module__.startswith("refsim.")}


def test_toml_gives_the_same_scene_back_bit_for_bit():
    scene = rs.Scene(
        name='a "name" \\ with\nlines, é and \U0001f4a7 and \x7f', spacing=0.1 + 1e-17, support_radius=1 / 3, dim=2,
        dtype="float64", step=1e-300,
        fluid=(
            rs.Ball(radius=np.nextafter(1.0, 2.0), center=(1.0, -2.5, 0.0)),
            rs.Box(cells=(1, 2, 1), velocity=(1e-9, 0.0, 0.0)),
        ),
        effects=(
            rs.Gravity(acceleration=(0.1, 0.2, 0.0)),
            rs.WeaklyCompressible(sound_speed=3.0, clamp_pressure=False, density="summation"),
        ),
        gauge=(rs.Gauge(name="floor", kind="force", on="-y", every=0.02),),
        motion=(rs.Motion(of="gravity", kind="formula", direction=(0.0, 1.0, 0.0), formula="0.01*t**3"),),
    )  # fmt: skip
    text = files.scene_to_toml(scene)
    again = files.parse_scene(text, "scene")
    assert (again, [e.name for e in again.effects]) == (scene, ["gravity", "weakly_compressible"])
    assert files.scene_to_toml(again) == text
    cloud = rs.Cloud(position=np.array([[0.1, 0.2, 0.3], [1 / 3, 0.0, 1e-20]]), mass=np.array([1.0, 2.0]))
    again = files.parse_scene(files.scene_to_toml(scene.with_(fluid=(cloud,))), "scene").fluid[0]
    assert np.array_equal(again.position, cloud.position)
    assert again.mass == (1.0, 2.0)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_examples_load_and_plan_without_a_note(path):
    plan = rs.make_plan(files.load_scene(path))
    told, scene = _text(describe_plan(plan, "cpu")), plan.scene
    assert plan.notes == ()
    assert scene.name in told
    grows = {"mpm_liquid": "blocks that the background grid gains", "mesh_boundary": "distances in a band"}
    beside = [words for name, words in grows.items() if name in {effect.name for effect in scene.effects}]
    assert ("Not counted, since it follows the run: " in told) == bool(beside)
    assert all(f"Not counted, since it follows the run: {words}" in told for words in beside)


@pytest.mark.parametrize("adhesion, source", [(0.0, "measured drops"), (1e-9, "nominal")])
def test_a_plan_tells_the_numbers_of_a_tension(adhesion, source):
    """Of 10 mm of water: 0.25 sqrt(rho0 (h/2)^3/(2 pi sigma)) is 0.551 ms, sqrt(sigma/(rho0 g)) 2.71 mm."""
    liquid = rs.WeaklyCompressible(sound_speed=5.0, dynamic_viscosity=0.1)
    effects = (liquid, rs.Akinci2013(surface_tension=0.072, adhesion=adhesion))
    cube = rs.Scene(spacing=1e-3, support_radius=2.6e-3, fluid=(rs.Box(cells=(10, 10, 10)),), effects=effects)
    told = describe_plan(rs.make_plan(cube.with_(effects=(*cube.effects, rs.Gravity()))), "cpu")
    numbers = dict(told["effects"]["akinci_2013"]["tension"])
    assert numbers.pop("of") == source
    right = {"sigma [N/m]": 0.072, "R [m]": 6.204e-3, "jump [Pa]": 23.21, "Ohnesorge": 0.1496}
    assert numbers == pytest.approx(right | {"capillary length [m]": 2.709e-3, "Bond": 5.244}, rel=1e-3)
    assert told["step"]["limits"]["capillary"] == pytest.approx(5.509e-4, rel=1e-3)
    assert "akinci_2013  0.072        " + source in _text(told)
    floating = describe_plan(rs.make_plan(cube), "cpu")["effects"]["akinci_2013"]["tension"]
    assert "Bond" not in floating
    assert floating["jump [Pa]"] == numbers["jump [Pa]"]


def test_the_published_schema_is_current_and_every_field_says_what_it_is():
    committed = json.loads((PACKAGE / "scene" / "scene.schema.json").read_text())
    schema = files.scene_schema(PUBLISHED)
    assert committed == schema, "renew it: python -m refsim schema > refsim/scene/scene.schema.json"
    for owner in (rs.Scene, *files.SHAPES.values(), *PUBLISHED.values()):
        assert set(files.describe(owner)) == {f.name for f in msgspec.structs.fields(owner)}, owner.__name__
    assert schema["properties"]["spacing"]["x-unit"] == "m"
    assert schema["$defs"]["Gravity"]["properties"]["acceleration"]["x-unit"] == "m/s^2"
    assert files.unit_of('faces without wall, of "-x"') is None
    for entry in [schema, *schema["$defs"].values()]:
        assert entry["additionalProperties"] is False
        assert all("description" in field for field in entry["properties"].values())


WALLS = {"lower": (0, 0, 0), "upper": (1, 1, 1)}


def scene(**changes):
    values = {
        "spacing": 0.1, "support_radius": 0.2,
        "fluid": (rs.Box(cells=(2, 2, 2)), rs.Ball(radius=0.2, center=(1.0, 1.0, 1.0))),
        "effects": (
            rs.WeaklyCompressible(sound_speed=10.0, density="summation"), rs.Gravity(acceleration=(0.0, 0.0, -9.81)),
        ),
    }  # fmt: skip
    return rs.Scene(**values | changes)


BOUNDED = {**pairs.EFFECTS, "Scene": scene(), "Ball": scene().fluid[1]} | {
    "SolidBall": rs.SolidBall(center=(0, 0, 0), radius=1), "SolidBox": rs.SolidBox(**WALLS),
    "Gauge": rs.Gauge(name="a", kind="force", on="-x"),
    "Motion": rs.Motion(of="gravity", kind="sway", direction=(1, 0, 0), amplitude=0.1, period=1.0),
}  # fmt: skip


def bounds(hint):
    """The bounds that a type names anywhere within it."""
    own = [hint] if isinstance(hint, msgspec.Meta) else []
    return own + [found for part in typing.get_args(hint) for found in bounds(part)]


@pytest.mark.parametrize("name", BOUNDED)
def test_a_number_beyond_its_bound_is_refused_by_the_name_of_its_field(name):
    """Bounds stand in the schema, too, which another test compares with the stored one."""
    for field, hint in typing.get_type_hints(type(BOUNDED[name]), include_extras=True).items():
        for bound in bounds(hint):
            for limit, way in ((bound.gt, 0), (bound.ge, -1), (bound.le, 1)):
                if limit is not None:
                    value = (limit + way,) * 3 if field == "period" and name == "Scene" else limit + way
                    with pytest.raises(rs.InputError, match=rf"{field}\S* = "):
                        msgspec.structs.replace(BOUNDED[name], **{field: value})


@pytest.mark.parametrize("changes, sentence", rows(__file__, "impossible_changes"))
def test_a_change_that_is_not_possible_is_named(changes, sentence):
    with pytest.raises(rs.InputError, match=sentence):
        scene().with_(**changes)


def changed(tables, changes):
    """Tables with some of their values, or of those of tables within, changed."""
    inner = {k: changed(tables[k], v) for k, v in changes.items() if isinstance(v, dict) and k in tables}
    return tables | changes | inner


@pytest.mark.parametrize(
    "of, changes, words", [(of, *row) for of, table in SCENES.items() for row in table.get("refused", ())]
)
def test_what_a_scene_cannot_have_is_refused_in_one_sentence(of, changes, words):
    with pytest.raises(rs.InputError) as refused:
        rs.make_plan(files.scene_from_dict(changed(SCENES[of]["scene"], changes), "scene"))
    said = str(refused.value)
    assert any(each in said for each in words.split("|"))
    assert not re.search(r"\n|\. ", said)


@pytest.mark.parametrize("of, table", [(of, table) for of, table in SCENES.items() if "notes" in table])
def test_a_plan_has_the_notes_of_its_settings_and_no_others(of, table):
    for changes, words, count in table["notes"]:
        notes = rs.make_plan(files.scene_from_dict(changed(table["scene"], changes), "scene")).notes
        assert sum(words in note for note in notes) == count, (changes, words, notes)
