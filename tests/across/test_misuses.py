"""What the Python interface cannot take is said in one sentence, with the near word where there is one."""

import re
from operator import attrgetter

import numpy as np
import pytest

import refsim as rs
from refsim.scene.surface_mesh import surface_mesh
from tests.running import rows

TANK = rs.Scene(
    spacing=0.1, support_radius=0.2, dim=2, fluid=(rs.Box(cells=(3, 3, 1)),),
    effects=(
        rs.WeaklyCompressible(sound_speed=10.0, density="summation"), rs.BoxWalls(lower=(0, 0, 0), upper=(1, 1, 1)),
    ),
)  # fmt: skip

TETRAHEDRON = surface_mesh(
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
)


@pytest.fixture(scope="module")
def simulation():
    return rs.Simulation(TANK, "numpy")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    rs.simulate(TANK, 1e-6, backend="numpy", output=folder, progress=False)
    return rs.open_run(folder)


OBJECTS = {
    "tank": TANK, "none": None, "Scene": rs.Scene, "plan": rs.make_plan(TANK), "box": TANK.fluid[0], "huge": 10**400,
    "tetrahedron": TETRAHEDRON, "pull": rs.Gravity(),
}  # fmt: skip


@pytest.mark.parametrize("name, given, named, sentence", rows(__file__, "misuses"))
def test_a_call_that_is_not_possible_is_said_in_a_sentence(name, given, named, sentence, simulation, run):
    objects = OBJECTS | {"simulation": simulation, "run": run}

    def of(value):
        value = tuple(value) if isinstance(value, list) else value
        return objects[value[1:]] if isinstance(value, str) and value.startswith(":") else value

    first, _, rest = name.partition(".")
    called = attrgetter(rest)(objects[first]) if first in objects and rest else attrgetter(name)(rs)
    with pytest.raises(rs.InputError, match=re.escape(sentence)) as said:
        called(*map(of, given), **{key: of(value) for key, value in named.items()}).printed()
    assert "\n" not in str(said.value)


def test_numbers_of_numpy_and_names_of_all_arguments_are_taken(run):
    viscous = rs.WeaklyCompressible(sound_speed=np.array(20.0), dynamic_viscosity=np.float64(1e-3))
    report = rs.simulate(
        scene=TANK.with_(effects=(viscous, *TANK.effects[1:])),
        until=np.float32(1e-6),
        backend="numpy",
        threads=np.int64(1),
        every=np.array(1.0),
        progress=False,
    )
    assert report.steps == 1
    assert run.at(np.float64(0.0)).position.shape == run[np.int64(0)].position.shape == (9, 3)


def changed(values, place, value):
    values = np.array(values, float)
    values[place] = value
    return values


@pytest.mark.parametrize("name, change, sentence", [
    ("position", lambda x: changed(x, (4, 2), 0.1), "set_field: particle 4 has z = 0.1 m in 2D; set z to 0."),
    ("velocity", lambda v: changed(v, (4, 2), 0.1), "set_field: particle 4 has v_z = 0.1 m/s in 2D; set v_z to 0."),
    ("mass", lambda m: changed(m, 2, -1.0), "set_field: the mass of particle 2 is -1.0 kg; give a positive mass."),
    ("mass", lambda m: changed(m, 2, 0.0), "set_field: the mass of particle 2 is 0.0 kg; give a positive mass."),
    ("position", lambda x: changed(x, 3, x[1]), "set_field: particles 1 and 3 are at the same place (1 such pairs in"),
    ("position", lambda x: changed(x, (5, 0), -0.01), r"box_walls: particle 5 at (-0.01, 0.25) m is behind a wall (1"),
    ("position", lambda x: changed(x, (5, 0), 1e31), "set_field: the position of particle 5 is not a finite number"),
    ("velocity", lambda v: v[:3], "set_field: velocity has shape (3, 3); give"),
    ("mass", lambda m: "heavy", "set_field: mass is no array of numbers; give (9,) numbers."),
    ("mass", lambda m: [[1.0], [1.0, 2.0]], "set_field: mass is no array of numbers; give (9,) numbers."),
    ("position", lambda x: x * 1j, "set_field: position is no array of numbers; give (9, 3) numbers."),
])  # fmt: skip
def test_a_state_that_no_scene_may_begin_with_is_not_set(name, change, sentence, simulation):
    before = simulation.field(name)
    with pytest.raises(rs.InputError, match=re.escape(sentence)):
        simulation.set_field(name, change(before))
    assert np.array_equal(simulation.field(name), before)
