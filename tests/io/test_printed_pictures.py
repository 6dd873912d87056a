"""The printed pictures: the script runs and draws at tiny size, stored pictures and solids are its own."""

import dataclasses
import importlib.util
import json
import pathlib
import sys

import msgspec
import numpy as np
import pytest
import trimesh
from PIL import Image

from refsim import make_plan

ROOT = pathlib.Path(__file__).parents[2]
spec = importlib.util.spec_from_file_location("printed_pictures", ROOT / "scripts" / "printed_pictures.py")
script = sys.modules.setdefault(spec.name, importlib.util.module_from_spec(spec))
spec.loader.exec_module(script)


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
