"""The comparison of predicted and measured seconds: its scenes, its rows and its table."""

import argparse
import json

import pytest

from refsim import Box, Gravity, Scene, WeaklyCompressible, make_plan
from validation.measure import run_time

SYSTEMS = ("jiang_zhu_2023", "dong_2016", "mpm_liquid", "melting", "mesh_boundary")


def small(**more):
    given = {
        "dim": 2,
        "spacing": 0.01,
        "support_radius": 0.02,
        "end_time": 0.003,
        "fluid": (Box(cells=(6, 12, 1)),),
        "effects": (
            WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=2.0, density="summation"),
            Gravity(acceleration=(0.0, -9.81, 0.0)),
        ),
    }
    return Scene(**(given | more))


def test_twelve_scenes_of_all_systems():
    """The million is planned where it is run: its lattice alone takes seconds."""
    assert len(run_time.SCENES) == 12
    effects = {effect.name for make in run_time.SCENES.values() for effect in make().effects}
    assert set(SYSTEMS) <= effects
    small_ones = {name: make() for name, make in run_time.SCENES.items() if name != "column, 3D, a million"}
    counts = {name: make_plan(scene).grid.count for name, scene in small_ones.items()}
    assert 1000 < min(counts.values()) < 2000
    (million,) = run_time.SCENES["column, 3D, a million"]().fluid
    assert million.cells[0] * million.cells[1] * million.cells[2] > 1e6


def given(tmp_path, **more):
    options = {"threads": None, "largest": 10**6, "fresh": False, "only": [], "budget": 0.5, "write": False}
    return argparse.Namespace(**(options | more))


@pytest.fixture
def scenes(monkeypatch, tmp_path):
    monkeypatch.setattr("refsim.backends.cache.cache_root", lambda: tmp_path / "cache")
    monkeypatch.setattr(
        run_time,
        "SCENES",
        {
            "block": small,
            "wild": lambda: small(fluid=(Box(cells=(6, 12, 1), velocity=(1e4, 0.0, 0.0)),)),
            "large": lambda: small(fluid=(Box(cells=(20, 20, 1)),)),
        },
    )


def test_rows_are_kept_and_their_summary_is_written(scenes, tmp_path, monkeypatch, capsys):
    path, page = tmp_path / "run_time.json", tmp_path / "page.md"
    parts = [f"<!-- run_time {name} -->\nformer {name}\n<!-- end of run_time {name} -->" for name in ("numpy", "cuda")]
    page.write_text("\n".join(["before", *parts, "after\n"]))
    monkeypatch.setattr(run_time, "PAGE", page)
    assert run_time.perform(path, "numpy", given(tmp_path, largest=100)) == 0
    rows = json.loads(path.read_text())["numpy"]["rows"]
    assert set(rows) == {"block", "wild"}
    row = rows["block"]
    assert row["ratio"] == pytest.approx(row["predicted"] / row["measured"])
    assert row["predicted_steps"] == pytest.approx(row["steps"], abs=1)
    assert "1e+04 m/s" in rows["wild"]["stopped"]
    assert "of 1 scenes within 50 %" in capsys.readouterr().out
    run_time.perform(path, "numpy", given(tmp_path, largest=100))
    assert json.loads(path.read_text())["numpy"]["rows"]["block"] == row
    run_time.write_page(path, page)
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "former numpy" not in text
    assert "former cuda" in text  # which is not on file
    assert "Backend numpy, " in text


def test_the_summary_by_hand():
    rows = [{"ratio": 1.1}, {"ratio": 0.4}, {"ratio": 1.3}, {"stopped": "x"}]
    said = run_time.summary(rows)
    assert said.startswith("median error 30 % (aim 25 %), largest 60 %; 2 of 3 scenes within 50 %")
    assert run_time.summary([]) == "no scene was measured"
