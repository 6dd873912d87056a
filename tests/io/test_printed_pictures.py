"""The printed pictures: the script runs and draws at tiny size, stored pictures and solids are its own."""

import dataclasses
import importlib.util
import json
import pathlib
import sys
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
import trimesh
from PIL import Image

from refsim import make_plan
from validation.experiments.dong import scene as dong

ROOT = pathlib.Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("printed_pictures", ROOT / "scripts" / "printed_pictures.py")
script = sys.modules.setdefault(spec.name, importlib.util.module_from_spec(spec))
spec.loader.exec_module(script)

STORED = ROOT / "figures" / "printed"


def test_stored_pictures_belong_to_names_and_have_their_numbers():
    names = {path.stem for path in STORED.glob("*.webp")}
    assert names
    assert names <= set(script.PICTURES)
    assert names == {path.stem for path in STORED.glob("*.json")}
    pages = "".join(path.read_text() for path in (ROOT / "docs").glob("*.md"))
    shown = {name for name in names if f"../figures/printed/{name}.webp" in pages}
    assert {name for name in names if not name.startswith("dong")} <= shown


def test_poured_water_has_at_least_100_000_particles_and_none_in_the_solid():
    for path in STORED.glob("pour_*.json"):
        data = json.loads(path.read_text())
        assert data["particles"] >= 100_000
        assert list(data["arms"]) == ["without tension", "with tension"]
        assert all(row["inside_solid"] == 0 for rows in data["arms"].values() for row in rows)


@pytest.fixture
def small(monkeypatch):
    """Small panels, short runs, and a sphere of few triangles."""
    monkeypatch.setattr(script, "PANEL", (150, 120))
    monkeypatch.setattr(script, "SQUARE", (120, 120))
    pour = script.POURS["pour_sphere"]
    changes = {"solid": lambda: trimesh.creation.icosphere(2, 5 * script.MM), "times": (0.001, 0.002)}
    monkeypatch.setitem(script.POURS, "pour_sphere", dataclasses.replace(pour, **changes))


def test_a_run_is_made_once_and_drawn_again(small, tmp_path, capsys):
    words = ["pour_sphere", "--size", "0.13", "--folder", str(tmp_path), "--runs", str(tmp_path / "runs")]
    assert script.main(words) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'pour_sphere.webp'}\n"
    first = (tmp_path / "pour_sphere.json").read_text()
    data = json.loads(first)
    assert data["arms"]["with tension"][-1]["time_s"] == pytest.approx(0.002, abs=2e-4)
    with Image.open(tmp_path / "pour_sphere.webp") as picture:
        assert (np.asarray(picture.convert("L")) < 200).mean() > 0.01
    before = (tmp_path / "runs" / "pour_sphere_with" / "checkpoint.h5").stat().st_mtime_ns
    assert script.main([*words, "--draw"]) == 0
    assert (tmp_path / "pour_sphere.json").read_text() == first
    assert (tmp_path / "runs" / "pour_sphere_with" / "checkpoint.h5").stat().st_mtime_ns == before


def test_an_unknown_name_and_a_missing_run_are_refused(tmp_path, capsys):
    assert script.main(["pour_spere"]) == 2
    assert "did you mean 'pour_sphere'?" in capsys.readouterr().err
    assert script.main(["pour_sphere", "--draw", "--runs", str(tmp_path), "--folder", str(tmp_path)]) == 2
    assert "leave --draw out" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["sphere", "funnel", "plate", "statue"])
def test_solids_are_closed_and_clear_of_the_jet(name, tmp_path):
    pour = script.POURS[f"pour_{name}"]
    mesh = pour.solid()
    assert mesh.is_watertight
    assert mesh.volume > 0
    scene = msgspec.structs.replace(pour.scene("with", 0.25, tmp_path))
    position = scene.fluid[0].position
    placed = next(e for e in scene.effects if e.name == "mesh_boundary").placed(make_plan(scene).grid)
    assert placed.distance(np.asarray(position, dtype=float)).min() > 0.9 * scene.spacing
    assert mesh.bounds[0, 2] >= pour.floor - 1e-9


def test_the_statue_is_one_body_20_mm_tall():
    mesh = script.statue()
    assert mesh.body_count == 1
    assert np.ptp(mesh.vertices[:, 2]) == pytest.approx(20e-3, abs=1e-3)


def test_levels_of_ice_and_water():
    grid = np.stack(np.meshgrid(*[np.arange(8.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5
    ice = (np.abs(grid[:, :2] - 4).max(1) < 1) & (grid[:, 2] > 4)
    position = np.concatenate([grid[~ice], grid[ice] + (0.0, 0.0, 0.25)])
    body = np.where(np.arange(len(position)) < (~ice).sum(), -1, 0)
    run = SimpleNamespace(spacing=1.0, solid_body=lambda frame: body)
    assert script.levels(SimpleNamespace(position=position), run) == pytest.approx((4.25, 8.25, 8.0))
    body[:] = -1
    low, _, level = script.levels(SimpleNamespace(position=position), run)
    assert np.isnan(low)
    assert level == pytest.approx(8.0, abs=0.3)


def test_the_finer_block_is_that_of_the_experiment():
    coarse, fine = dong.block_scene(1, True), script.dong_block(True, 0.6, 1.0)
    assert fine.effects == coarse.effects
    assert fine.spacing == pytest.approx(0.5 * coarse.spacing)
    x, y = (np.asarray(scene.fluid[0].position) for scene in (coarse, fine))
    assert len(y) == 8 * len(x)
    assert y.mean(0) == pytest.approx(x.mean(0), abs=1e-3)
    assert np.ptp(y, axis=0) + fine.spacing == pytest.approx(np.ptp(x, axis=0) + coarse.spacing, rel=5e-3)
