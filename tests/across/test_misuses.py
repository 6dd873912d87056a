"""What the Python interface cannot take is said in one sentence, with the near word where there is one."""

import re

import numpy as np
import pytest

import refsim as rs
from refsim.boundary.mesh import surface_mesh
from refsim.boundary.sampling import sample

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


@pytest.mark.parametrize("call, sentence", [
    (lambda: rs.simulate(TANK, "out"), "simulate: until = 'out' is text; give a number or None."),
    (lambda: rs.simulate(TANK, outptu="out"), "simulate: there is no 'outptu'; did you mean output?"),
    (lambda: rs.simulate(TANK, None, "cpu"), "simulate: too many values are without a name; give by name backend, "),
    (lambda: rs.simulate(), "simulate: scene is missing; give scene = a value."),
    (lambda: rs.simulate(TANK, scene=TANK), "simulate: scene is given twice; give it once."),
    (lambda: rs.simulate(TANK, threads=1.5), "simulate: threads = 1.5 is a number with decimals; give a whole number"),
    (lambda: rs.simulate(TANK, asked_to_stop=True), "asked_to_stop = True is true or false; give a function."),
    (lambda: rs.Simulation("scene.toml"),
     "Simulation: scene = 'scene.toml' is text; give a Scene (load_scene reads a file) or a Plan."),
    (lambda: rs.Simulation(rs.Scene), "refsim.scene.scene.Scene'> is a class; give a Scene"),
    (lambda: rs.open_run(None), "open_run: folder = None is a NoneType; give a path."),
    (lambda: rs.open_run("a\0b"), r"open_run: folder = 'a\x00b' has a zero character; leave it out."),
    (lambda: rs.make_plan(rs.make_plan(TANK)), "is a Plan; give a Scene"),
    (lambda: rs.study(TANK, "front", knobs="spacing"), "study: knobs = 'spacing' is text; give a tuple or a list."),
    (lambda: rs.study(TANK, "front", reference=3.0), "study: reference = 3.0 is a number with decimals; give a Refer"),
    (lambda: rs.calibrate("s", spacing=1e-3, rest_density=1e3), "calibrate: sigma = 's' is text; give a number."),
    (lambda: rs.sampling.sample("mesh.stl", 0.1), "sample: mesh = 'mesh.stl' is text; give a SurfaceMesh"),
    (lambda: rs.Scene(spaceing=0.1), "Scene: there is no 'spaceing'; did you mean spacing?"),
    (lambda: rs.Scene(spacing=0.1), "Scene: support_radius is missing; give support_radius = a value."),
    (lambda: rs.Scene(0.1), "Scene takes no value without a name; its names are spacing, support_radius, fluid, "),
    (lambda: rs.Gravity((0, 0, -9.81)), "gravity takes no value without a name; its names are acceleration."),
    (lambda: TANK.with_("spacing"), "Scene.with_: too many values are without a name; give fewer."),
    (lambda: TANK.with_(spacing=None), "Scene: spacing = None is a NoneType; give a number."),
    (lambda: TANK.with_(dtype="float23"), "Scene: dtype = 'float23' is not possible; did you mean float32?"),
    (lambda: TANK.with_(fluid=rs.Box(cells=(1, 1, 1))), " is a Box; give a tuple or a list."),
    (lambda: TANK.with_(fluid=(3,)), "Scene: fluid[0] = 3 is a whole number; give Box or Ball or Cloud or FluidMesh."),
    (lambda: TANK.with_(effects=rs.Gravity()), " is a Gravity; give a tuple or a list."),
    (lambda: TANK.with_(spacing=10**400), " is not possible (number out of range)"),
    (lambda: rs.SolidBall(center=(0, 0, 0), radius="r"), "SolidBall: radius = 'r' is text; give a number."),
    (lambda: rs.SolidBall(center=(0, 0, 0), radius=1, density=-1.0), "; give a positive number"),
    (lambda: rs.Gravity(acceleration=9.81), "gravity: acceleration = 9.81 is a number with decimals; give a tup"),
    (lambda: rs.Gravity(acceleration=(0, "g", 0)), "gravity: acceleration[1] = 'g' is text; give a number."),
    (lambda: rs.MpmWalls(lower=(0, 0, 0), upper=(1, 1, 1), open_faces="+y"), "open_faces = '+y' is text; give a tuple"),
    (lambda: rs.SurfaceDetection(literal="Paper").printed(), "literal has Paper; only E5, E6, E10, E23, paper or all"),
    (lambda: rs.ShapeMatching(literal=("M25",)).printed(), "shape_matching: literal has M25; only paper or all can"),
    (lambda: rs.SurfaceDetection(literal=3), "literal = 3 is a whole number; give text or a tuple or a list"),
    (lambda: rs.SurfaceDetection(literal=("paper", 3)), "literal[1] = 3 is a whole number; give text"),
    (lambda: rs.JiangZhu2023(gamma=1.0, literal="paper", pair_mode="both"),
     "jiang_zhu_2023: literal 'paper' sets pair_mode = 'either', but pair_mode = 'both' is given; leave one of"),
    (lambda: rs.HeatConduction(literal=("M5", "paper"), scheme="explicit"), "sets scheme = 'one_sided', but scheme ="),
    (lambda: sample(TETRAHEDRON, 0.1, literal=("papers",)), "sampling: literal has papers; only E24, E25, paper or"),
])  # fmt: skip
def test_a_call_that_is_not_possible_is_said_in_a_sentence(call, sentence):
    with pytest.raises(rs.InputError, match=re.escape(sentence)) as said:
        call()
    assert "\n" not in str(said.value)


@pytest.mark.parametrize("call, sentence", [
    (lambda s, r: s.field(3), "Simulation.field: name = 3 is a whole number; give text."),
    (lambda s, r: s.set_field("mass"), "Simulation.set_field: values is missing; give values = a value."),
    (lambda s, r: s.gauge(None), "Simulation.gauge: name = None is a NoneType; give text."),
    (lambda s, r: s.checkpoint(None), "Simulation.checkpoint: path = None is a NoneType; give a path."),
    (lambda s, r: r.at("x"), "Run.at: time = 'x' is text; give a number."),
    (lambda s, r: r["1"], "Run: number = '1' is text; give a whole number or a slice."),
])  # fmt: skip
def test_so_is_a_call_of_a_method(call, sentence, simulation, run):
    with pytest.raises(rs.InputError, match=re.escape(sentence)):
        call(simulation, run)


def test_numbers_of_numpy_and_names_of_all_arguments_are_taken(run):
    report = rs.simulate(
        scene=TANK, until=np.float32(1e-6), backend="numpy", threads=np.int64(1), every=np.array(1.0), progress=False
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
