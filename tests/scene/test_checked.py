"""Values of the wrong kind are refused when an object is made, by the name of their field."""

import typing

import msgspec
import pytest

import refsim as rs
from tests import pairs
from tests.running import rows

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


@pytest.mark.parametrize("made, sentence", [
    (lambda: scene(spacing=None), r"Scene: spacing = None is a NoneType; give a number\."),
    (lambda: scene(dtype="float23"), r"Scene: dtype = 'float23' is not possible; did you mean float32\?"),
    (lambda: scene(fluid=rs.Box(cells=(1, 1, 1))), r"Scene: fluid = Box\(.* is a Box; give a tuple or a list\."),
    (lambda: scene(fluid=(3,)), r"Scene: fluid\[0\] = 3 is a whole number; give Box or Ball or Cloud or FluidMesh\."),
    (lambda: scene(effects=rs.Gravity(acceleration=(0, 0, 0))), r"Scene: effects = .* give a tuple or a list\."),
    (lambda: rs.SolidBall(center=(0, 0, 0), radius="r"), r"SolidBall: radius = 'r' is text; give a number\."),
    (lambda: rs.SolidBall(center=(0, 0, 0), radius=1, density=-1.0), "density = -1.0 .*; give a positive number"),
    (lambda: rs.Gravity(acceleration=9.81), r"gravity: acceleration = 9\.81 is a number with decimals; give a tup"),
    (lambda: rs.Gravity(acceleration=(0, "g", 0)), r"gravity: acceleration\[1\] = 'g' is text; give a number\."),
    (lambda: rs.BoxWalls(**WALLS, open_faces="+y"), r"box_walls: open_faces = .\+y. is text; give a tuple"),
    (lambda: scene(spacing=10**400), r"Scene: spacing = 1000.* is not possible \(number out of range\)"),
])  # fmt: skip
def test_an_error_names_class_field_and_value(made, sentence):
    with pytest.raises(rs.InputError, match=sentence):
        made()


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
