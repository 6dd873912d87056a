"""Values of the wrong kind are refused when an object is made, by the name of their field."""

import copy
import pickle
import typing

import msgspec
import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
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


def test_numbers_of_numpy_are_taken_and_one_parameter_is_changed_by_one_call():
    made = scene(
        spacing=np.float32(0.1), support_radius=np.float64(0.2),
        fluid=[rs.Box(cells=np.array([2, 2, 2])), rs.Cloud(position=np.ones((1, 3)))],
        effects=[rs.Gravity(acceleration=np.array([0.0, 0.0, -9.81]))],
    )  # fmt: skip
    assert make_plan(made).grid.count == 9
    before = scene()
    after = before.with_(
        spacing=0.05, weakly_compressible__sound_speed=20.0, fluid__1__radius=0.3, fluid__1__velocity=(1.0, 0.0, 0.0),
        name="finer",
    )  # fmt: skip
    assert (after.spacing, after.name) == (0.05, "finer")
    assert after.effects[0] == rs.WeaklyCompressible(sound_speed=20.0, density="summation")
    assert after.effects[1] is before.effects[1]
    assert after.fluid == (before.fluid[0], rs.Ball(radius=0.3, center=(1.0, 1.0, 1.0), velocity=(1.0, 0.0, 0.0)))
    assert before == scene()


def test_a_scene_keeps_what_it_was_made_of_and_equal_ones_have_one_hash():
    """A later change of the caller's lists and arrays changes no scene; copies keep arrays that cannot be written."""
    place, cells, effects = np.ones((2, 3)), np.array([2, 2, 2]), [rs.Gravity(acceleration=(0, 0, -1))]
    rows = [[0.0, 0.0, 0.0]]

    def made():
        fluid = [rs.Cloud(position=place), rs.Box(cells=cells), rs.Cloud(position=rows)]
        return scene(fluid=fluid, effects=effects, solid=[rs.SolidCells(cells=cells[None])])

    first, second = made(), made()
    assert first == second
    assert len({first, second}) == 1
    place[0], cells[0], rows[0][0] = 5.0, 7, 9.0
    effects.append(None)
    assert first == second
    assert len(first.effects) == 1
    assert (first.fluid[0].position == 1.0).all()
    assert first.fluid[1].cells == (2, 2, 2)
    assert first.fluid[2].position == ((0.0, 0.0, 0.0),)
    assert (first.solid[0].cells == 2).all()
    effects.pop()
    assert first != made()

    class Other(rs.BoxWalls, frozen=True, kw_only=True):
        """Walls of the same values and another class."""

        name = ""

    assert scene(effects=(rs.BoxWalls(**WALLS),)) != scene(effects=(Other(**WALLS),))
    for copied in (copy.deepcopy(first), pickle.loads(pickle.dumps(first)), first.with_(name="scene")):
        assert copied == first
        assert hash(copied) == hash(first)
        with pytest.raises(ValueError, match="read-only"):
            copied.fluid[0].position[0] = 0.0


@pytest.mark.parametrize("changes, sentence", rows(__file__, "impossible_changes"))
def test_a_change_that_is_not_possible_is_named(changes, sentence):
    with pytest.raises(rs.InputError, match=sentence):
        scene().with_(**changes)
