"""The case of melting: generated meshes, scenes, what is watched, tables filled as in figure 3, pictures from data."""

import itertools
import json

import numpy as np
import pytest

from refsim import SolidMesh
from refsim.scene.plan import make_plan
from refsim.scene.solids import body_cells
from validation.experiments.melting import pictures, scene
from validation.experiments.melting import runs as melting
from validation.experiments.melting.scene import scene_of
from validation.results import finite
from validation.running import Context


def test_animals_are_closed_meshes_of_their_own():
    import trimesh

    found = {animal: trimesh.Trimesh(*scene.mesh(animal, 0.1)) for animal in scene.ANIMALS}
    for mesh in found.values():
        assert mesh.is_watertight
        assert mesh.body_count == 1
        points = np.random.default_rng(1).uniform(-1.5, 1.5, (4000, 3))
    for animal, mesh in found.items():
        inside = (scene.field(scene.ANIMALS[animal], points) < 0).mean() * 27
        assert mesh.volume == pytest.approx(inside, rel=0.1)
    assert found["rabbit"].extents[2] > found["rabbit"].extents[0], "ears up"
    assert found["duck"].extents[2] < found["duck"].extents[0], "afloat"


@pytest.mark.parametrize(("figure", "liquid", "solid"), [("figure_4", 34_992, 4_913), ("figure_5", 48_576, 12_000)])
def test_scenes_have_the_counts_of_table_2(figure, liquid, solid):
    plan = make_plan(scene_of(figure))
    bodies = np.diff(plan.grid.solids.lattice.first)
    assert (plan.grid.count - bodies.sum(), bodies.sum()) == (liquid, pytest.approx(solid, rel=0.03))


def test_regions_fill_level_by_level():
    """Each pass keeps what the one before wrote; entries lie where arrayR wants them."""
    result = melting.filling(Context())
    passes, cells = result.arrays["passes"], result.arrays["cells"]
    assert (passes[0] >= 0).sum() == 1
    for before, after in itertools.pairwise(passes):
        assert (after[before >= 0] == before[before >= 0]).all()
        assert (after >= 0).sum() > (before >= 0).sum()
    own = cells[result.values["node"]]
    for i, j in np.argwhere(passes[-1] >= 0):
        assert (cells[passes[-1][i, j]] - own == (i - 2, j - 2, 0)).all()
    assert pictures.filling_picture(json.loads(json.dumps(finite(pictures.filling_data({"filling": result})))))


def test_columns_of_rays_find_the_cells_in_a_mesh(tmp_path):
    """The same cells as by a ray for each point; also where rays meet the diagonals of a box."""
    import trimesh

    file, _ = scene.write_mesh("duck", tmp_path)
    box = tmp_path / "box.stl"
    trimesh.creation.box((1.0, 0.6, 0.4)).export(box)
    for path, size in ((file, 2.0), (str(box), 2.0)):
        body = SolidMesh(file=path, center=(0.0, 0.0, 0.0), size=size)
        cells = body_cells(body, "a body", 0.2)
        grid = np.stack(np.meshgrid(*[np.arange(-8, 8)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        surface = body.mesh()
        mesh = trimesh.Trimesh(surface.vertices + surface.origin, surface.faces, process=False)
        wanted = grid[mesh.contains((grid + 0.5) * 0.2)]
        assert set(map(tuple, cells.tolist())) == set(map(tuple, wanted.tolist()))
    assert len(cells) == 10 * 6 * 4
