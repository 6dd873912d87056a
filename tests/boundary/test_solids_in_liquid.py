"""Solids and meshes in a liquid with an advanced density: films, tanks that sway, flow between blocks, refusals."""

import numpy as np
import pytest
import trimesh

import refsim as rs
from refsim import make_plan
from refsim.core.operation import REGISTRY
from tests.running import advanced
from validation.experiments.liquid import runs


def at_rest(bodies, cells, dtype="float64", density=2000.0):
    """Water of (x, y, z) cells in a tank with `bodies`, (lowest cell, cells) each, at the pressure of rest, h = 3 d."""
    lattice = np.indices(cells).reshape(3, -1).T
    water = np.all([((lattice < low) | (lattice >= np.add(low, size))).any(1) for low, size in bodies], axis=0)
    spacing, (width, depth, height) = 0.1, np.array(cells) * 0.1
    return rs.Scene(
        dtype=dtype, spacing=spacing, support_radius=3 * spacing,
        solid=tuple(
            rs.SolidBox(lower=tuple(np.array(low) * spacing), upper=tuple(np.add(low, size) * spacing), density=density)
            for low, size in bodies
        ),
        fluid=(rs.Cloud(position=(lattice[water] + 0.5) * spacing),),
        effects=(
            rs.WeaklyCompressible(sound_speed=50.0), rs.Gravity(acceleration=(0.0, 0.0, -runs.GRAVITY)),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(width, depth, 2 * height)),
            rs.ShapeMatching(), rs.TwoWayCoupling(),
        ),
    )  # fmt: skip


def lifts(bodies, simulation):
    """Force of all that is wet on each body over rho g V, (bodies, 3): (0, 0, 1) after Archimedes."""
    force = simulation.field("mass")[:, None] * (simulation.field("acceleration") + [0.0, 0.0, runs.GRAVITY])
    parts = np.split(force, np.cumsum([np.prod(size) for _, size in bodies]))[:-1]
    return [part.sum(0) / (runs.DENSITY * runs.GRAVITY * 1e-3 * len(part)) for part in parts]


def test_a_film_bears_the_tension_of_the_liquid_around_it():
    """10 kPa less, so that all pressures are below zero, do not lift a body off floor and wall."""
    bodies = [((0, 2, 0), (2, 2, 2))]
    simulation = rs.Simulation(at_rest(bodies, (6, 6, 7)), "numpy")
    excess = simulation.field("advanced_excess")
    simulation.set_field("advanced_excess", np.where(np.arange(len(excess)) < 8, excess, excess - 4))
    simulation.evaluate()
    assert simulation.field("pressure").max() < 0
    assert lifts(bodies, simulation)[0] == pytest.approx([0.0, 0.0, 1.0], abs=0.1)


@pytest.mark.parametrize("given", [{"dtype": "float32"}, {"dtype": "float64"}, {"floor": -2.0}])
def test_what_falls_feels_no_gravity(given):
    """A body in falling liquid, no wall near or none at all: 0 to 1e-4 g."""
    scene = at_rest([((2, 2, 2), (2, 2, 2))], (6, 6, 6), given.get("dtype", "float64"))
    lower, upper = (0.0, 0.0, given.get("floor", 0.0)), (1.0, 1.0, 2.0)
    walls = rs.BoxWalls(lower=lower, upper=upper, open_faces=("-x", "+x", "-y", "+y", "+z"))
    kept = (effect for effect in scene.effects if effect.name != "box_walls")
    simulation = rs.Simulation(scene.with_(effects=(*kept, *([walls] if "floor" in given else []))), "numpy")
    for steps in (0, 1, 6):
        advanced(simulation, steps)
        simulation.evaluate()
        pulled = np.average(simulation.field("acceleration")[:8], 0, simulation.field("mass")[:8])
        assert pulled == pytest.approx([0.0, 0.0, -runs.GRAVITY], abs=1e-4 * runs.GRAVITY)


def test_solids_feel_a_tank_that_sways():
    """Their pressure is that of the acceleration in the tank's frame, 1 m/s^2 along x here."""
    sway = rs.Motion(of="gravity", kind="formula", direction=(1.0, 0.0, 0.0), formula="-0.5*t**2")
    simulation = rs.Simulation(at_rest([((2, 2, 2), (2, 2, 2))], (6, 6, 6)).with_(motion=(sway,)), "cpu")
    advanced(simulation, 3)
    simulation.evaluate()
    plan, operation = simulation.plan, REGISTRY["two_way_coupling.extrapolation"]
    names = ("position", "velocity", "followed_velocity", "phase", "density", "pressure")
    given = {name: simulation.field(name) for name in names} | {"lean": (1.0, 0.0, -runs.GRAVITY), "turning": None}
    given |= {"smoothing": plan.shared["smoothing"], "delay": plan.parameters["two_way_coupling"]["delay"]}
    found, _ = operation.program("numpy")(*(given[name] for name in operation.arguments("numpy")))["pressure"]
    assert simulation.field("pressure") == pytest.approx(found, rel=1e-9, abs=1e-6)


def test_a_tank_that_turns_far_from_its_axis_rises():
    """Liquid and a body feel the centrifugal acceleration as that of a tank that rises, walls and films do, too."""
    far, pull, found = 1e7, 0.4 * runs.GRAVITY, []
    rise = rs.Motion(of="gravity", kind="formula", direction=(0, 0, 1), formula=f"{pull / 2!r}*t**2")
    given = {"direction": (0, 1, 0), "pivot": (0.3, 0.3, far), "formula": f"{(pull / far) ** 0.5!r}*t"}
    for motion in (rise, rs.Motion(of="turn", kind="formula", **given)):
        simulation = rs.Simulation(at_rest([((2, 2, 0), (2, 2, 2))], (6, 6, 6)).with_(motion=(motion,)), "numpy")
        advanced(simulation, 3)
        found.append({name: simulation.field(name) for name in ("acceleration", "pressure", "velocity")})
    for name, values in found[1].items():
        assert values == pytest.approx(found[0][name], rel=1e-4, abs=1e-4 * np.abs(found[0][name]).max())


def test_a_detected_surface_has_its_number_density():
    scene = at_rest([((2, 2, 2), (3, 3, 2))], (7, 7, 7))
    simulation = rs.Simulation(scene.with_(effects=(*scene.effects, rs.SurfaceDetection())), "numpy")
    inner = np.abs(simulation.field("position") - 0.35).max(1) < 0.15
    assert not simulation.field("surface")[inner].any()
    assert simulation.field("surface")[simulation.field("position")[:, 2] > 0.6].all()


@pytest.mark.parametrize(("held", "low", "high"), [(True, 0.99, 1.01), (False, 1.3, 1.5)])
@pytest.mark.parametrize("reach", [3.0, *(pytest.param(r, marks=pytest.mark.slow) for r in (2.6, 3.2))])
def test_liquid_between_blocks_flows_as_poiseuille_says(held, low, high, reach):
    """The steady flow through 10 cells over H^3/(12 nu), nu the viscosity of the lattice; without no_slip it slips.

    The force on a column of the liquid is linear in the velocity of each layer, whose balance with a uniform drive is
    solved for.
    """
    wide, deep, side = 10, 4, 7
    bodies = [rs.SolidBox(lower=(0, 0, z), upper=(side, side, z + deep)) for z in (0, deep + wide)]
    simulation = rs.Simulation(
        rs.Scene(
            spacing=1.0, support_radius=reach, dtype="float64", solid=tuple(bodies),
            fluid=(rs.Box(lower=(0, 0, deep), cells=(side, side, wide)),),
            effects=(
                rs.WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=1000.0), rs.ShapeMatching(),
                rs.TwoWayCoupling(no_slip=held),
            ),
        ),
        "numpy",
    )  # fmt: skip
    first, x = 2 * deep * side**2, simulation.field("position")
    layer = np.where(np.arange(len(x)) < first, -1, np.floor(x[:, 2] - deep))
    column = np.flatnonzero((layer >= 0) & (np.abs(x[:, :2] - 0.5 * side) < 0.1).all(1))
    drag = np.empty((wide, wide))
    for k in range(wide):
        simulation.set_field("velocity", (layer == k)[:, None] * np.array([1.0, 0.0, 0.0]))
        simulation.evaluate()
        drag[:, k] = simulation.field("acceleration")[column, 0]
    height = x[column, 2] - deep
    lattice = 0.5 * drag[wide // 2] @ (height - height[wide // 2]) ** 2
    flow = np.linalg.solve(drag, -np.ones(wide)).sum()
    assert low < flow * lattice / (0.5 * height @ (wide - height)) < high


def test_cells_of_a_mesh_and_of_the_box_fill_space_once(tmp_path):
    """The mesh's first layer is half a spacing below it; volumes beside the liquid are those of a column's cells."""
    spacing, wide = 1 / 6, np.array([8 / 6, 8 / 6, 0.0])  # water on a mesh, 0.3 spacings above a plane of the lattice
    block = trimesh.creation.box(bounds=[-8 * spacing * np.ones(3), wide + [8 * spacing, 8 * spacing, 0.3 * spacing]])
    block.export(tmp_path / "block.obj")
    scene = rs.Scene(
        dtype="float64", spacing=spacing, support_radius=3 * spacing,
        fluid=(rs.Box(lower=(0.0, 0.0, 0.3 * spacing), cells=(8, 8, 6)),),
        effects=(
            rs.WeaklyCompressible(sound_speed=runs.SOUND, density="continuity"), rs.Gravity(),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(*wide[:2], 2.0), open_faces=("-z",), model="extrapolated"),
            rs.MeshBoundary(file=str(tmp_path / "block.obj"), model="extrapolated"),
        ),
    )  # fmt: skip
    place, volume = make_plan(scene).walls[:2]
    below = np.array([3.0, 3.0, 0.3]) - place / spacing
    assert below[(np.abs(below) < [2, 2, 0.6]).all(1), 2] == pytest.approx(0.5)
    column = np.abs(place[:, :2] - [-0.5 * spacing, 2.5 * spacing]).max(1) < 0.1 * spacing
    low = column & (np.abs(place[:, 2] + 0.5 * spacing) < 3.5 * spacing)
    assert volume[low].sum() == pytest.approx((2.7 + 3 + 1.15) * spacing**3, rel=1e-2)


@pytest.mark.parametrize(
    ("side", "sizes"), ids=str, argvalues=[
        (2, [(3, 3, 2), (3, 3, 2)]), (2, [(4, 4, 1), (2, 2, 2)]), (2, [(4, 4, 1), (4, 4, 1)]), (2, [(3, 1, 1)]),
        (2, [(1, 1, 1)]), (0, [(3, 3, 2)]), (4, [(3, 3, 2)]),
    ],
)  # fmt: skip
def test_heavy_bodies_rest_on_the_floor_and_on_each_other(side, sizes):
    """Of twice the water's density: what is thin or an edge sank by half a spacing, where planes held it."""
    low = np.cumsum([0, *(size[2] for size in sizes)])
    bodies = [((side, side, below), size) for below, size in zip(low, sizes)]
    simulation = rs.Simulation(at_rest(bodies, (7, 7, 6), dtype="float32"), "cpu", threads=1)
    found = []
    while simulation.steps < 300:
        simulation.step()
        found.append(lifts(bodies, simulation))
    parts = np.split(simulation.field("position") / 0.1, np.cumsum([np.prod(size) for size in sizes]))[:-1]
    assert [part[:, 2].min() for part in parts] == pytest.approx(low[:-1] + 0.5, abs=0.06)
    assert parts[0].mean(0)[:2] == pytest.approx(np.array(sizes[0][:2]) / 2 + [side, side], abs=0.1)
    assert simulation.stopped_at_walls == 0
    assert np.std(found[200:], axis=0).max() < 0.2
    assert np.mean(found[150:], axis=0) == pytest.approx(np.tile([0.0, 0.0, 2.0], (len(sizes), 1)), abs=0.05)


@pytest.mark.parametrize("density", [100.0, 600.0])
def test_light_bodies_rest_on_a_dry_floor_and_on_each_other(density):
    """As stiff as the liquid's, contact threw them up for ever; they fall by a spacing each."""
    scene = at_rest([((2, 2, 1), (3, 3, 3)), ((2, 2, 5), (3, 3, 3))], (14, 7, 8), "float32", density)
    far = rs.Cloud(position=((1.35, 0.05, 0.05),))
    simulation = rs.Simulation(scene.with_(fluid=(far,)), "cpu", threads=1)
    advanced(simulation, 800)
    lower, upper = np.split(simulation.field("position")[:54] / 0.1, 2)
    assert [lower[:, 2].min(), upper[:, 2].min()] == pytest.approx([0.5, 3.5], abs=0.06)


@pytest.mark.parametrize(
    ("low", "size", "cells", "density", "least", "most"), ids=str, argvalues=[
        ((2, 2), (8, 8, 2), (12, 12, 8), 700.0, 1.0, 2.0), ((0.25, 2), (3, 3, 2), (7, 7, 7), 1000.0, -0.05, 0.05),
        ((1.6, 2), (3, 3, 2), (7, 7, 7), 1000.0, -0.05, 0.05),
    ],
)  # fmt: skip
def test_bodies_leave_the_floor_of_packed_liquid_if_they_are_lighter(low, size, cells, density, least, most):
    """Films too thin for particles held light ones [0.2 d], uneven liquid lifted neutral ones [0.2 to 0.5 d]."""
    scene = at_rest([((0, 0, 0), size)], cells, "float32", density)
    lower = 0.1 * np.array([*low, 0.0])
    body = rs.SolidBox(lower=tuple(lower), upper=tuple(lower + 0.1 * np.array(size)), density=density)
    packed = rs.Box(cells=cells, outside="bodies")
    simulation = rs.Simulation(scene.with_(solid=(body,), fluid=(packed,)), "cpu", threads=1)
    advanced(simulation, 200)
    lowest = simulation.field("position")[: np.prod(size), 2].min() / 0.1 - 0.5
    assert least < lowest < most


def test_bodies_in_2d_float_and_rest():
    """A plate of half the water's density stays half under, one of twice its density flat on the floor."""
    low, size, densities = [(3, 6), (5, 0)], [(10, 4), (6, 2)], (500.0, 2000.0)
    scene = at_rest([], (16, 8, 1), "float32")
    walls, pull = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(1.6, 1.6, 0.0)), (0.0, -runs.GRAVITY, 0.0)
    solid = tuple(
        rs.SolidBox(lower=(0.1 * x, 0.1 * y, 0.0), upper=(0.1 * (x + a), 0.1 * (y + b), 0.0), density=density)
        for (x, y), (a, b), density in zip(low, size, densities)
    )
    effects = (scene.effects[0], rs.Gravity(acceleration=pull), walls, *scene.effects[3:])
    scene = scene.with_(dim=2, solid=solid, fluid=(rs.Box(cells=(16, 8, 1), outside="bodies"),), effects=effects)
    simulation = rs.Simulation(scene, "cpu", threads=1)
    assert np.bincount(simulation.field("phase")).tolist() == [128 - 20 - 12, 24 + 12, 16]
    force = []
    while simulation.steps < 300:
        simulation.step()
        lift = simulation.field("acceleration")[:, 1] / runs.GRAVITY + 1
        force.append([0.5 * lift[:40].mean(), 2 * lift[40:52].mean()])
    floating, resting, _ = np.split(simulation.field("position") / 0.1, [40, 52])
    assert [floating.mean(0), resting.mean(0)] == pytest.approx(np.array([[8, 8, 0], [8, 1, 0]]), abs=0.15)
    assert [np.ptp(floating[:, 1]), np.ptp(resting[:, 1])] == pytest.approx([3, 1], abs=0.1)
    assert np.mean(force[100:], axis=0) == pytest.approx([0.5, 2.0], abs=0.02)
