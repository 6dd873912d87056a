"""Solids from meshes in scenes: volumes, what a scene pays, bad input, files, resuming."""

import pathlib

import numpy as np
import pytest
import trimesh

import refsim
from refsim import Box, InputError, MeshBoundary, Scene, Simulation, WeaklyCompressible, make_plan
from refsim.engine.checkpoints import load_checkpoint
from refsim.scene.files import load_scene, scene_to_toml
from tests.running import rows

SPACING, SUPPORT = 0.01, 0.027
LIQUID = WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=0.5, density="summation")


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    path = tmp_path_factory.mktemp("meshes") / "plate.obj"
    trimesh.creation.box((0.16, 0.16, 0.06)).export(path)
    return str(path)


def scene(*effects, gap=1.0, **changes):
    """A block on the plate, whose upper face is at z = 0.03 m."""
    fluid = Box(lower=(-0.035, -0.035, 0.03 + (gap - 0.5) * SPACING), cells=(7, 7, 5))
    given = {"dtype": "float64", **changes}
    return Scene(spacing=SPACING, support_radius=SUPPORT, fluid=(fluid,), effects=effects, **given)


def test_the_calibrated_factor_gives_the_first_layer_the_rest_density(plate):
    """One spacing from a flat wall; literal g = 1 is 12 to 17 % too dense there."""
    errors = {}
    for name, given in (("calibrated", {}), ("single", {"layers": 1}), ("printed", {"literal": ("E30",)})):
        simulation = Simulation(scene(LIQUID, MeshBoundary(file=plate, **given)), "numpy")
        simulation.evaluate()
        x = simulation.field("position")
        first = (x[:, 2] < 0.041) & (np.abs(x[:, :2]).max(1) < 0.006)
        errors[name] = simulation.field("density")[first].mean() / 1000 - 1
    assert abs(errors["calibrated"]) < 0.01
    assert abs(errors["single"]) < 0.02
    assert 0.12 < errors["printed"] < 0.20


def test_a_mesh_is_looked_for_beside_the_scene_file_and_in_the_folder_of_a_run(plate, tmp_path, monkeypatch):
    (tmp_path / "solid.obj").write_text(pathlib.Path(plate).read_text())
    text = scene_to_toml(scene(LIQUID, MeshBoundary(file="solid.obj")))
    (tmp_path / "scene.toml").write_text(text)
    loaded = load_scene(tmp_path / "scene.toml")
    assert loaded.effects[-1].file == str(tmp_path / "solid.obj")
    assert len(make_plan(loaded).walls.position) > 100
    (tmp_path / "solid.obj").write_text(pathlib.Path(plate).read_text())
    monkeypatch.chdir(tmp_path)
    refsim.simulate(scene(LIQUID, MeshBoundary(file="solid.obj")), until=1e-5, backend="numpy", output="run")
    assert refsim.open_run("run").scene.effects[-1].file == "solid.obj"
    monkeypatch.chdir("/")
    assert refsim.open_run(tmp_path / "run").scene.effects[-1].file == str(tmp_path / "solid.obj")
    load_checkpoint(tmp_path / "run")


@pytest.mark.parametrize("changes, words", rows(__file__, "bad_meshes"))
def test_bad_input_gets_one_sentence(plate, changes, words):
    with pytest.raises(InputError, match=words) as caught:
        make_plan(scene(LIQUID, MeshBoundary(**{"file": plate, **changes})))
    assert "\n" not in str(caught.value)


def test_a_mesh_needs_space(plate):
    flat = Scene(
        spacing=SPACING, support_radius=SUPPORT, dim=2, fluid=(Box(cells=(3, 3, 1)),),
        effects=(LIQUID, MeshBoundary(file=plate)),
    )  # fmt: skip
    with pytest.raises(InputError, match="body in space"):
        make_plan(flat)
