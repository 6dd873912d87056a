"""Liquid beside walls that hold it: flows of layers that slide along each other."""

import math

import numpy as np
import pytest
import trimesh

import refsim as rs
from refsim.scene.plan import make_plan
from tests import layers
from tests.running import rows

MU, LAYERS, OFFSETS = 2.0, 10, 11


def channel(dim=2, reach=3.2, viscosity=None, model=None, **changes):
    """Ten layers between planes at y = 0 and 10, unit spacing, density and density of mass."""
    wide = 2 * math.ceil(reach) + 1
    cells, edge = (wide, LAYERS, wide if dim == 3 else 1), wide if dim == 3 else 0.0
    open_faces = ("-x", "+x", *(("-z", "+z") if dim == 3 else ()))
    walls = {"lower": (0, 0, 0), "upper": (wide, LAYERS, edge), "open_faces": open_faces, "model": model}
    water = {"rest_density": 1.0, "sound_speed": 20.0, "dynamic_viscosity": MU, "viscosity": viscosity}
    if model == "mirrored":
        water["density"] = "summation"
    return rs.Scene(
        dim=dim, dtype="float64", spacing=1.0, support_radius=reach, period=(wide, 0, edge),
        fluid=(rs.Box(cells=cells),),
        effects=(rs.WeaklyCompressible(**water), rs.BoxWalls(**walls, **{"no_slip": True} | changes)),
    )  # fmt: skip


def drags(scene):
    """Force per volume on each layer for the velocity of each, the mean over offsets of each along every other."""
    simulation = rs.Simulation(scene, "numpy")
    x = simulation.field("position")
    layer = np.floor(x[:, 1]).astype(int)
    wide, mean = scene.period[0], np.zeros((LAYERS, LAYERS))
    for s in range(OFFSETS):
        moved = x.copy()
        moved[:, 0] = (x[:, 0] + (layer + 1) * s / OFFSETS) % wide
        simulation.set_field("position", moved)
        found = []
        for k in range(-1, LAYERS):
            simulation.set_field("velocity", (layer == k)[:, None] * np.array([1.0, 0.0, 0.0]))
            simulation.evaluate()
            force = simulation.field("acceleration")[:, 0] * simulation.field("density")
            found.append(np.bincount(layer, force) / np.bincount(layer))
        mean += np.array(found[1:]).T - np.array(found[0])[:, None]
    return mean / OFFSETS


CHANNELS = rows(__file__, "channels")


@pytest.mark.parametrize("case", CHANNELS)
def test_ten_layers_flow_as_poiseuille_and_couette_say(case):
    """With mu as given; with J(11) that of the layers."""
    drag = drags(channel(**CHANNELS[case]))
    mu = 0.5 * drag[LAYERS // 2] @ (np.arange(LAYERS) - LAYERS // 2) ** 2
    assert case == "J(11)" or mu == pytest.approx(MU, rel=0.005)
    assert layers.judged(drag, mu) == pytest.approx((1, 1), rel=0.01)


def test_a_mesh_holds_liquid_as_planes_do(tmp_path):
    """On a floor of the lattice's cells; boundary particles have the volume for which mirrored walls are calibrated."""
    trimesh.creation.box(bounds=[[-3.0, -3.0, -5.0], [8.0, 8.0, 0.0]]).export(tmp_path / "floor.obj")
    water = rs.WeaklyCompressible(rest_density=1.0, sound_speed=20.0, dynamic_viscosity=MU)
    planes = rs.BoxWalls(
        lower=(-3.0, -3.0, 0.0), upper=(8.0, 8.0, 9.0), no_slip=True, open_faces=("-x", "+x", "-y", "+y", "+z")
    )
    mesh = rs.MeshBoundary(file=str(tmp_path / "floor.obj"), no_slip=True)
    block = rs.Box(cells=(5, 5, 2), velocity=(1.0, 0.0, 0.0))
    found = []
    for walls in (mesh, planes):
        scene = rs.Scene(dtype="float64", spacing=1.0, support_radius=2.3, effects=(water, walls), fluid=(block,))
        simulation = rs.Simulation(scene, "numpy")
        simulation.evaluate()
        found.append(simulation.field("acceleration")[:, 0])
    assert found[0] == pytest.approx(found[1], rel=1e-6)
    assert found[0].min() < -MU
    mirrored = make_plan(scene.with_(effects=(water, rs.MeshBoundary(file=mesh.file, model="mirrored", no_slip=True))))
    x, volume = mirrored.walls.position, mirrored.walls.volume
    inside = (np.abs(x - 2.5)[:, :2] < 3).all(1)
    volumes = mirrored.effects["mesh_boundary"].layer_volumes(mirrored.grid, mirrored.effects)
    for k, wanted in enumerate(volumes):
        assert volume[inside & np.isclose(x[:, 2], -k)].sum() / 36 == pytest.approx(wanted, rel=0.15)
