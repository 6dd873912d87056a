"""Lattice shape matching: rotations of collapsed regions, sums far away, coupling, bad input."""

import zlib

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.core.effect import Discretisation
from refsim.core.operation import REGISTRY
from refsim.scene.solids import lattice_of
from refsim.shape_matching import ShapeMatching, operations, reference
from refsim.shape_matching.boxes import boxes_of

COLLAPSES = {  # members' places from their node [d], from their cells and a direction u and another v
    "a point": lambda g, u, v: 0 * g,
    "a point, as far as positions tell": lambda g, u, v: 1e-16 * g,
    "a millionth": lambda g, u, v: 1e-6 * g,
    "a line": lambda g, u, v: np.outer(g @ [1.0, 0.3, -0.6], u),
    "a short line": lambda g, u, v: 1e-6 * np.outer(g @ [1.0, 0.3, -0.6], u),
    "two points": lambda g, u, v: np.outer(g[:, 0] > 0, u),
    "a plane": lambda g, u, v: np.outer(g[:, 0], u) + np.outer(g[:, 1], v),
    "a small plane": lambda g, u, v: 1e-6 * (np.outer(g[:, 0], u) + np.outer(g[:, 1], v)),
    "their mirror image": lambda g, u, v: g - 2 * np.outer(g @ u, u),
    "evenly folded": lambda g, u, v: np.outer((g**2).sum(1), u),
}


@pytest.mark.parametrize("name", COLLAPSES)
def test_collapsed_regions_turn_as_the_reference_says(name):
    """A corner of a body of 7 x 7 x 7 nodes collapses: 20 places and rotations before, within 0.01 degrees.

    Before, fast sums turned members in a point by up to 173 degrees, and in float32 all sums those on a line by 156.
    """
    made = lattice_of([np.stack(np.meshgrid(*[np.arange(7)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)])
    (s,) = np.flatnonzero((made.cell == 1).all(1))
    members = np.flatnonzero((made.cell <= 2).all(1))
    offset = (made.cell[members] - 1).astype(float)
    region, count = np.full((343, 27), -1, np.int32), np.zeros(343, np.int32)
    region[s, (made.cell[members]) @ [9, 3, 1]] = members
    count[s] = 27
    boxes, operation = boxes_of(made, 1), REGISTRY["shape_matching.match"]
    matching = ShapeMatching(half_width=1).matching(Discretisation(3, "float32", 1.0, 2.0, 343))
    random = np.random.default_rng(zlib.crc32(name.encode()))
    for trial in range(20):
        q = random.normal(size=4)
        q /= np.linalg.norm(q)
        x = made.cell @ reference.rotation_matrix(q).T + random.uniform(-5, 5, 3)
        frame = np.linalg.qr(random.normal(size=(3, 3)))[0]
        x[members] = x[s] + COLLAPSES[name](offset, frame[0], frame[1])
        given = {
            "solid_position": x.astype("float32"), "region": region, "region_count": count, "matching": matching,
            "region_share": random.uniform(0.2, 5.0, 343).astype("float32"), "boxes": boxes,
            "region_center": np.zeros((343, 3), "float32"), "region_anchor": np.zeros((343, 3), "float32"),
            "rotation": np.tile(q if trial % 2 else [0.5, 0.5, -0.5, 0.5], (343, 1)).astype("float32"),
        }  # fmt: skip
        expected = operations.match(*(given[k] for k in ("solid_position", "region_share", "region")), matching,
                                   given["rotation"])["rotation"][0][s]  # fmt: skip
        for program in ("cpu", "cpu:fast"):
            turned = given | {"rotation": given["rotation"].copy()}
            operation.program(program)(*(turned[k] for k in operation.arguments(program)))
            got = turned["rotation"][s].astype(float)
            half = np.linalg.norm(got / np.linalg.norm(got) - expected / np.linalg.norm(expected))
            assert np.degrees(2 * half) < 0.01, f"{program}, trial {trial}"
            if name.startswith("a point"):
                assert np.allclose(got, (q if trial % 2 else [0.5, 0.5, -0.5, 0.5]), atol=1e-6)


# Whole bodies
def test_fast_sums_are_exact_far_from_the_first_particle():
    """float32, two particles that spin 4 m from their body's first one: sums taken from there need float64.

    In float32 the pair's inertia would lose what the floor of its inertia holds, and its spin would explode.
    """
    random, pairs = np.random.default_rng(3), [[[20, 5 * k, 17], [21, 5 * k + 1, 17]] for k in range(8)]
    body = rs.SolidCells(cells=[[0, 0, 0], *(cell for pair in pairs for cell in pair)])
    effect = rs.ShapeMatching(summation="fast")
    simulation = rs.Simulation(
        rs.Scene(spacing=0.2, support_radius=0.5, fluid=(), solid=(body,), effects=(effect,), step=0.005)
    )
    kick = np.zeros((17, 3))
    kick[1::2] = random.normal(size=(8, 3)) * (4.0, 4.0, 8.0)
    kick[2::2] = -kick[1::2]
    simulation.backend.assign(simulation.fields["velocity"], kick.astype("float32"))
    fastest = []
    for _ in range(60):
        simulation.step()
        fastest.append(np.linalg.norm(simulation.field("velocity"), axis=1).max())
    assert max(fastest) < 1.05 * np.linalg.norm(kick, axis=1).max()


@pytest.mark.parametrize(("literal", "expected"), [((), 1.057), (("M4",), 1.165)], ids=["all solids", "as printed"])
def test_first_layer_of_liquid_on_a_solid(literal, expected):
    """Density over rest density next to a flat solid: V_k over all solids 1.057, over surfaces alone 1.165."""
    effects = (
        rs.WeaklyCompressible(sound_speed=40.0, state="tait", kernels="cubic_spline", density="summation"),
        rs.ShapeMatching(summation="gather"), rs.TwoWayCoupling(literal=literal),
    )  # fmt: skip
    scene = rs.Scene(
        spacing=0.2, support_radius=0.5, fluid=(rs.Box(lower=(0, 0, 0.8), cells=(14, 14, 5)),), dtype="float64",
        solid=(rs.SolidBox(lower=(0, 0, 0), upper=(2.8, 2.8, 0.8)),), effects=effects, step=1e-3,
    )  # fmt: skip
    simulation = rs.Simulation(scene, "numpy")
    simulation.evaluate()
    x, rho = simulation.field("position"), simulation.field("density")
    middle = (np.abs(x[:, :2] - 1.4).max(1) < 0.4) & (np.abs(x[:, 2] - 0.9) < 0.01)
    assert (middle.sum(), rho[middle] / 1000) == (16, pytest.approx(expected, abs=2e-3))


# Scenes
def test_the_body_that_is_off_the_most_is_named():
    """Pressed together or pulled apart; a body that is pulled by more than twice its size is lost."""
    cubes = tuple(rs.SolidBox(lower=(k, 0, 0), upper=(k + 0.8, 0.8, 0.8)) for k in (0.0, 1.0))
    scene = rs.Scene(spacing=0.2, support_radius=0.5, fluid=(), solid=cubes, effects=(rs.ShapeMatching(),))
    simulation = rs.Simulation(scene, "numpy")
    at, effect = simulation.field("position"), simulation.plan.effects["shape_matching"]
    for sizes, reason, words in (((1.2, 0.5), "", "2 are 0.5 "), ((2.5, 0.5), "shape_lost", "number 1 are 2.5 ")):
        place = {"position": at * np.repeat(sizes, 64)[:, None]}
        found = effect.inspected(simulation.plan.grid, lambda name, own=place: own.get(name, simulation.field(name)))
        assert found[0] == reason
        assert words in found[1]


def test_the_step_of_a_ball_is_the_same_elsewhere():
    """A ball is as wide along all axes: rounding of its place would turn those that its step is taken from."""
    d, steps = 0.1, []
    for cells in (0, 7, 38, 1024):
        ball = rs.SolidBall(center=((cells + 1.5) * d,) * 3, radius=1.53 * d, velocity=(1.0, 0.0, 0.0))
        scene = rs.Scene(
            dtype="float64", spacing=d, support_radius=2.6 * d, solid=(ball,), fluid=(), effects=(rs.ShapeMatching(),)
        )
        steps.append(make_plan(scene).effects["shape_matching"].step_limits(make_plan(scene).grid, {})["solids"].length)
    assert steps == pytest.approx([steps[0]] * 4, rel=1e-12)
