"""The case of melting: generated meshes, scenes, what is watched, tables filled as in figure 3, pictures from data."""

import itertools
import json

import numpy as np
import pytest

from refsim import SolidMesh
from refsim.core import cases
from refsim.core.operation import REGISTRY
from refsim.scene.plan import make_plan
from refsim.scene.solids import body_cells
from validation.checks import FAIL
from validation.drawing import unpacked
from validation.experiment import Options, discover
from validation.experiments.melting import pictures, scene
from validation.experiments.melting import runs as melting
from validation.experiments.melting.scene import FIGURES, made, scene_of, shared_tank
from validation.results import Result, finite
from validation.running import Context


def test_two_methods_cannot_make_one_argument():
    """One name for two arrays had given shape matching an array with the rows of another method's grid."""
    cases.discover()
    with pytest.raises(ValueError, match="'node_velocity' is made twice"):
        cases.groups("node_velocity")(lambda case, grid: {})
    with pytest.raises(ValueError, match="'solid_velocity' is made twice"):
        cases.derived("solid_velocity")(lambda inputs, name: None)


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
    assert plan.grid.count - bodies.sum() == liquid
    assert bodies.sum() == pytest.approx(solid, rel=0.03)


def test_streams_meet_four_animals():
    """40.5k and 20k at full size; here 0.064 of it, on the mesh path."""
    setting = FIGURES["figure_6"](0.4)
    plan = make_plan(made(setting))
    bodies = np.diff(plan.grid.solids.lattice.first)
    assert bodies.sum() == pytest.approx(20_000 * 0.4**3, rel=0.1)
    assert plan.grid.count - bodies.sum() == pytest.approx(40_656 * 0.4**3, rel=0.1)
    assert sorted(set(plan.state.velocity[:, 0])) == [-4.0, 0.0, 4.0]
    k = plan.state.values["conductivity"]
    assert sorted(set(np.round(k[: bodies.sum()], 6))) == [0.1, 0.3, 0.5, 0.7]


def test_a_share_of_the_tank_is_solid():
    for share in (0.0, 0.6):
        plan = make_plan(made(shared_tank("figure_6", 0.3, share)))
        nodes = len(plan.grid.solids.lattice.key)
        assert nodes / plan.grid.count == pytest.approx(max(share, 1 / 12), abs=0.05)


@pytest.fixture(scope="module")
def cube():
    """The ice cube of figure 4, small, until it is half molten."""
    return melting.melt(Context(threads=1), "figure_4", 0.3, "cpu", [0.9, 0.5], 2.0)


def test_a_run_keeps_frames_and_what_it_watched(cube):
    values = cube.values
    assert values["inside_melted"] == 0
    assert len(values["times"]) == 3
    assert values["series"]["solid"][0] == 125
    assert 0 < cube.arrays["solid_2"].sum() <= 63
    assert values["series"]["mass"][-1] > values["series"]["mass"][0], "ice becomes heavier as water"
    made_of = melting.EXPERIMENT.checked({"figure_4": cube})
    assert made_of
    assert not [m for m in made_of if m.verdict == FAIL], made_of


def test_stages_are_drawn_from_their_data(cube, tmp_path, monkeypatch):
    """Packed positions come back, and the picture needs nothing else."""
    data = json.loads(json.dumps(finite(pictures.stage_data("figure_4", "a cube")({"figure_4": cube}))))
    back = unpacked(data["frames"][1]["position_cm"], "int16", 3)
    assert (back == cube.arrays["position_1"]).all()
    monkeypatch.setattr(pictures, "PIXELS", pictures.PIXELS // 4)  # of a side: shading takes most of the time
    figure = pictures.stage_picture(-68.0, 16.0, False)(data)
    figure.savefig(tmp_path / "stages.png")
    assert (tmp_path / "stages.png").stat().st_size > 20_000


def test_surface_of_a_block_is_closed():
    import trimesh

    block = 0.2 * np.stack(np.meshgrid(*[np.arange(5)] * 3, indexing="ij"), -1).reshape(-1, 3)
    mesh = trimesh.Trimesh(*pictures.surface(block))
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(1.0, rel=0.25)


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


def test_regions_of_a_few_rounds_and_those_of_the_rival():
    assert melting.region_rounds(Context(), 2, rounds=20, side=4).values["wrong"] == 0
    plan = make_plan(scene_of("figure_4", 0.3))
    lattice = plan.grid.solids.lattice
    nodes = len(lattice.key)
    phase = (np.random.default_rng(3).random(nodes) < 0.7).astype(np.int32)
    direct, count = np.empty((nodes, 27), np.int32), np.empty(nodes, np.int32)
    REGISTRY["shape_matching.direct_neighbours"].program("cpu")(
        phase, np.arange(nodes, dtype=np.int32), lattice, direct
    )
    ours, theirs = np.empty((nodes, 125), np.int32), np.empty((nodes, 125), np.int32)
    REGISTRY["shape_matching.regions"].program("cpu")(direct, None, lattice, ours, count)
    melting.all_regions(direct, lattice.cell, np.int32(2), theirs, count)
    assert (ours == theirs).all()


def test_every_operation_counts_in_one_stage():
    stages = {"neighbours": 1.0, "heat.chebyshev": 2.0, "shape_matching.regions": 3.0, "shape_matching.gather": 4.0}
    total = melting.grouped({**stages, "two_way_coupling.forces": 5.0, "melting.melt": 6.0, "shape_matching.pull": 7.0})
    assert list(total.values()) == [1.0, 5.0, 2.0, 9.0, 11.0]


def test_quick_leaves_nothing_out():
    keys = {run.key for run in melting.planned(Options(quick=True))}
    assert keys == {run.key for run in melting.planned(Options())}
    needed = {name for picture in discover()["melting"].pictures for name in picture.needs}
    assert needed <= keys
    empty: dict[str, Result] = {}
    assert melting.EXPERIMENT.checked(empty) == []


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
