"""The case of Dong's scenes: what it counts on shapes whose answer is known, and what it takes from the paper."""

import math

import numpy as np
import pytest

from refsim import make_plan
from validation.experiment import Options, discover
from validation.experiments.dong import runs, scene
from validation.experiments.dong.runs import EXPERIMENT
from validation.metrics.spread import layers, parts, seen_from_above
from validation.perform import redraw, write_data
from validation.results import Result
from validation.running import refusal


def sheet(n, hole=0):
    """A square layer of n x n particles with a square hole in its middle."""
    x, y = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    keep = (np.abs(x - n // 2) > hole) | (np.abs(y - n // 2) > hole) if hole else np.ones_like(x, dtype=bool)
    return np.column_stack([x[keep], y[keep], np.zeros(keep.sum())]).astype(float)


@pytest.mark.parametrize("spacing", [1.0, 0.028])
def test_parts_holes_and_layers_of_known_shapes(spacing):
    frame = sheet(9, hole=2)
    far = frame + np.array([20.0, 0.0, 0.0])
    lone = np.array([[40.0, 0.0, 0.0]])
    found = seen_from_above(spacing * np.concatenate([frame, far, lone]), spacing)
    assert (found["parts"], found["lone"], found["holes"]) == (2, 1, 2)
    assert found["largest"] == pytest.approx(len(frame) / (2 * len(frame) + 1))
    whole = seen_from_above(spacing * sheet(9), spacing)
    assert (whole["parts"], whole["lone"], whole["holes"]) == (1, 0, 0)
    stack = np.concatenate([sheet(9) + np.array([0.0, 0.0, k]) for k in range(3)])
    assert layers(spacing * sheet(9), spacing) == 1
    assert layers(spacing * stack, spacing) == 3
    assert seen_from_above(spacing * stack, spacing)["height"] == pytest.approx(3 * whole["height"])


def test_a_thread_is_stretched_and_a_disc_is_not():
    site = sheet(21) - np.array([10.0, 10.0, 0.0])
    disc = site[np.linalg.norm(site, axis=1) < 9]
    thread = np.column_stack([np.arange(60.0), np.zeros(60), np.zeros(60)])
    assert seen_from_above(disc, 1.0)["stretch"] < 1.2
    assert seen_from_above(thread, 1.0)["stretch"] > 10


def test_the_largest_part_comes_first():
    number = parts(np.array([[0.0, 0, 0], [9.0, 0, 0], [10.0, 0, 0], [11.0, 0, 0]]), 1.0)
    assert number.tolist() == [1, 0, 0, 0]


def test_the_fit_finds_period_and_decay():
    time = np.linspace(0, 4, 101)
    found = runs.oscillation(time, -0.1 * np.exp(-0.8 * time) * np.cos(6.0 * time))
    assert found["period"] == pytest.approx(2 * math.pi / 6.0, rel=1e-3)
    assert found["decay"] == pytest.approx(0.8, rel=1e-2)
    assert math.isnan(runs.oscillation(time, -np.exp(-time))["period"])


def test_rayleigh_period_of_the_fourth_mode():
    assert runs.rayleigh_period(1000 / 72, 1.0) == pytest.approx(2 * math.pi)


def test_printed_settings_are_the_papers():
    made = scene.printed_cube(17, cohesion=True, correction=True)
    tension = made.effects[1]
    assert (tension.stiffness, tension.correction, made.effects[0].dynamic_viscosity) == (1e-3, 1e-3, 1e-3)
    assert made.step == 5e-3
    assert made.support_radius / made.spacing == pytest.approx(1.5)
    assert len(made.fluid[0].position) == 4913
    assert len(scene.block()[0]) == 810
    assert abs(scene.TENSION - 17.03) < 0.01


def test_printed_step_is_refused_for_a_stiff_liquid_and_taken_for_a_soft_one():
    assert "times the stable one" in refusal(scene.printed_block(1, 10 * scene.impact_speed()))
    assert refusal(scene.printed_block(1, 1.67)) == ""


def test_dongs_own_solver_runs_beside_the_shared_liquid():
    """D(3) to D(5) take the place of density, pressure and viscosity, with and without tension."""
    for tension in (True, False):
        shared, own = (make_plan(scene.block_scene(1, tension, solver=name)) for name in ("shared", "hu_adams"))
        assert "dong_2016.momentum" in own.launches()
        assert "sph.momentum" not in own.launches()
        assert "sph.momentum" in shared.launches()
        assert ("dong_2016.tension" in own.launches()) == tension
    for quick in (False, True):
        found = {run.key: run.parameters for run in EXPERIMENT.runs(Options(quick=quick))}
        key = "fall" if quick else "rest"
        for arm in ("with", "without"):
            assert found[f"own_{key}_{arm}"] == found[f"{key}_{arm}"] | {"solver": "hu_adams"}
        assert found["own_cube_1331"]["changes"] == {"solver": "hu_adams"}


def test_every_picture_has_its_runs():
    planned = {run.key for quick in (False, True) for run in EXPERIMENT.runs(Options(quick=quick))}
    assert {name for picture in discover()["dong"].pictures for name in picture.needs} <= planned
    frames = next(run for run in EXPERIMENT.runs(Options()) if run.key == "rest_with").parameters["frames"]
    assert {*scene.FRAMES, *scene.LATER, *scene.MERGING, scene.REST} <= set(frames)


def test_table_1_takes_the_median_of_its_turns(tmp_path):
    runs_of = runs.TABLE_1_EXPERIMENT.runs(Options())
    assert {run.key for run in runs_of} == set(runs.NEEDS)
    seconds = {"dong": 0.004, "iif": 0.002, "csf": 0.005}
    found = {}
    for run in runs_of:
        model, case, turn = (run.parameters[name] for name in ("model", "case", "turn"))
        step = seconds[model] * (10 if turn == 3 else 1)  # a turn that was disturbed
        values = {"model": model, "case": case, "step": step, "steps": 40, "frames": 40, "particles": 7, "threads": 2}
        found[run.key] = Result(values)
    shares = {m.name: m.value for m in runs.TABLE_1_EXPERIMENT.checked(found)}
    assert shares["frame_over_iif.oil"] == pytest.approx(2.0)
    assert shares["frame_over_csf.droplet"] == pytest.approx(0.8)
    (picture,) = discover()["dong_table_1"].pictures
    write_data(picture, found, tmp_path)
    assert redraw(picture, tmp_path).stat().st_size > 10_000


@pytest.mark.parametrize("quick", [True, False])
def test_frames_of_the_block_come_in_order(quick):
    """A frame that stands after a later one would show that one."""
    falls = [run.parameters["frames"] for run in EXPERIMENT.runs(Options(quick=quick)) if "frames" in run.parameters]
    assert falls
    for frames in falls:
        assert list(frames) == sorted(set(frames))
