"""Liquid that fills what meshes and solids leave of a box or of a mesh's inside."""

import math

import msgspec
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

import refsim as rs

D, PULL, MIDDLE = 0.125, 9.81, 7 * 0.125
LONG, WIDE, DEEP = 16, 6, 8  # cells
LIQUID = rs.WeaklyCompressible(sound_speed=31.0)
BOX = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(LONG * D, WIDE * D, 2 * DEEP * D))


def scene(fluid, *effects):
    pull = rs.Gravity(acceleration=(0.0, 0.0, -PULL))
    return rs.Scene(spacing=D, support_radius=3 * D, dtype="float64", fluid=fluid, effects=(LIQUID, pull, *effects))


def slope(folder, degrees):
    """A wedge that rises from x = 3.2 spacings on; its height at x, both in spacings."""
    toe, rise, far, end = 3.2, math.tan(math.radians(degrees)), 8, LONG + 8
    outline = [(toe, 0.0), (end, (end - toe) * rise), (end, -far), (toe, -far)]
    mesh = trimesh.convex.convex_hull([(x * D, y * D, z * D) for x, z in outline for y in (-far, WIDE + far)])
    mesh.export(folder / "slope.obj")
    return rs.MeshBoundary(file=str(folder / "slope.obj")), lambda x: np.maximum(0.0, (x - toe) * rise)


def unrest(made):
    """(largest acceleration over g, below the surface and off the sides; places in spacings; distances in spacings)."""
    simulation = rs.Simulation(made, "numpy")
    simulation.evaluate()
    x = simulation.field("position") / D
    away = np.linalg.norm(simulation.field("acceleration"), axis=1) / PULL
    return float(away[x[:, 2] < DEEP - 3.5].max()), x, cKDTree(x).query(x, 2)[0][:, 1]


@pytest.mark.parametrize("degrees", [20, 45])
def test_liquid_on_a_slope_starts_at_rest(degrees, tmp_path):
    """Its particles have the volume above the slope, and accelerations of a tenth of g; cut from a lattice of g."""
    wedge, height = slope(tmp_path, degrees)
    pull, x, apart = unrest(scene((rs.Box(cells=(LONG, WIDE, DEEP), outside="bodies"),), BOX, wedge))
    fine = np.linspace(0, LONG, 10001)
    volume = WIDE * np.trapezoid(np.clip(DEEP - height(fine), 0, None), fine)
    assert abs(len(x) - volume) < 1 + 2e-3 * volume
    assert (x[:, 2] > height(x[:, 0])).all()
    assert apart.min() > 0.8
    assert pull < 0.12
    lattice = (np.indices((LONG, WIDE, DEEP)).reshape(3, -1).T + 0.5) * D
    cut = lattice[lattice[:, 2] / D > height(lattice[:, 0] / D) + 0.01]
    assert unrest(scene((rs.Cloud(position=cut),), BOX, wedge))[0] > 0.5


def vessel(folder):
    """A vessel whose inside is a box turned by 20 degrees: (wall, file of the inside)."""
    inside = trimesh.creation.box((10 * D, 6 * D, 10 * D))
    inside.apply_transform(trimesh.transformations.rotation_matrix(math.radians(20), (0, 1, 0)))
    inside.export(folder / "inside.obj")
    outer = trimesh.creation.box((24 * D,) * 3)
    hollow = inside.copy()
    hollow.invert()
    trimesh.util.concatenate([outer, hollow]).export(folder / "vessel.obj")
    return rs.MeshBoundary(file=str(folder / "vessel.obj")), str(folder / "inside.obj")


def test_a_vessel_is_filled_up_to_a_level(tmp_path):
    wall, file = vessel(tmp_path)
    with pytest.raises(rs.InputError, match="raise it"):
        rs.make_plan(scene((rs.FluidMesh(file=file, level=-1.0),), wall))
    made = scene((rs.FluidMesh(file=file),), wall)
    whole = rs.make_plan(made)
    assert abs(whole.grid.count - 600) <= 3
    trimesh.creation.box(D * np.array([9.64, 8.63, 11.83])).export(tmp_path / "uneven.obj")  # 984 cells, faces in cells
    uneven = rs.FluidMesh(file=str(tmp_path / "uneven.obj"), center=(0.13 * D, 0.31 * D, 0.27 * D))
    assert abs(len(rs.make_plan(scene((uneven,))).state.position) - 984) <= 5
    narrow = rs.make_plan(msgspec.structs.replace(made, support_radius=2.2 * D)).notes
    assert ["tilted" in str(notes) for notes in (narrow, whole.notes)] == [True, False]
    level = 0.1 * D
    simulation = rs.Simulation(scene((rs.FluidMesh(file=file, level=level),), wall), "numpy")
    simulation.evaluate()
    x, pull = simulation.field("position"), np.linalg.norm(simulation.field("acceleration"), axis=1) / PULL
    assert abs(len(x) - 306) <= 3  # half of it, and 0.1 of 10.6 x 6 cells in the middle
    assert x[:, 2].max() < level - 0.4 * D
    assert pull[x[:, 2] < level - 3.5 * D].max() < 0.15


def drawn_body(draw):
    """A block, on the lattice or not, or two that cross, on the lattice: turned or not."""
    edges = D * (draw.integers(3, 8, 3) if draw.random() < 0.5 else draw.uniform(3, 8, 3))
    parts = [trimesh.creation.box(edges)] + [trimesh.creation.box(edges[[1, 2, 0]])] * int(draw.random() < 0.4)
    meet = np.minimum(edges, edges[[1, 2, 0]]).prod() * (len(parts) - 1)
    angles = draw.uniform(-180, 180, 3) * (draw.random() < 0.5)
    middle = D * (7 + (draw.integers(0, 2, 3) / 2 if draw.random() < 0.5 else draw.random(3)))
    return trimesh.util.concatenate(parts), len(parts) * edges.prod() - meet, middle, angles


def test_bodies_take_their_volume(tmp_path):
    """Within a particle; none starts inside, also beside edges and corners. A mirrored scene has mirrored places."""
    draw, found, file = np.random.default_rng(60), [], str(tmp_path / "body.obj")
    walls = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(14 * D,) * 3)
    for k in range(6):
        (mesh, volume, middle, angles), places = drawn_body(draw), []
        for sign in (1.0, -1.0)[: 1 + (k < 3)]:
            mesh.apply_scale(sign).export(file, digits=17)
            body = rs.MeshBoundary(file=file, center=tuple(MIDDLE + sign * (middle - MIDDLE)), rotation=tuple(angles))
            made = rs.make_plan(scene((rs.Box(cells=(14, 14, 14), outside="bodies"),), walls, body))
            places.append(MIDDLE + sign * (made.state.position - MIDDLE))
        found.append(len(places[0]) - 14**3 + volume / D**3)
        assert cKDTree(places[0]).query(places[-1])[0].max() < 1e-7 * D
    assert np.abs(found).max() <= 1, found
    solid = (rs.SolidBox(lower=(5 * D,) * 3, upper=(9 * D, 8 * D, 10 * D)),)  # 60 particles, no cell of the block's
    block = rs.Box(lower=(0.3 * D, 0.6 * D, 0.5 * D), cells=(12, 12, 12), outside="bodies")
    made = rs.make_plan(msgspec.structs.replace(scene((block,), rs.ShapeMatching()), solid=solid))
    body, liquid = np.split(made.state.position, [60])
    assert abs(len(liquid) - 12**3 + 60) <= 1
    assert np.linalg.norm(liquid[:, None] - body, axis=2).min() > 0.7 * D
