"""The case of Dong's scenes: what it counts on shapes whose answer is known, and what it takes from the paper."""

import math

import numpy as np
import pytest

from validation.experiments.dong import runs, scene
from validation.metrics.spread import layers, seen_from_above


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
    assert (layers(spacing * sheet(9), spacing), layers(spacing * stack, spacing)) == (1, 3)
    assert seen_from_above(spacing * stack, spacing)["height"] == pytest.approx(3 * whole["height"])


def test_a_thread_is_stretched_and_a_disc_is_not():
    site = sheet(21) - np.array([10.0, 10.0, 0.0])
    disc = site[np.linalg.norm(site, axis=1) < 9]
    thread = np.column_stack([np.arange(60.0), np.zeros(60), np.zeros(60)])
    assert seen_from_above(disc, 1.0)["stretch"] < 1.2
    assert seen_from_above(thread, 1.0)["stretch"] > 10


def test_the_fit_finds_period_and_decay():
    time = np.linspace(0, 4, 101)
    found = runs.oscillation(time, -0.1 * np.exp(-0.8 * time) * np.cos(6.0 * time))
    assert found["period"] == pytest.approx(2 * math.pi / 6.0, rel=1e-3)
    assert found["decay"] == pytest.approx(0.8, rel=1e-2)
    assert math.isnan(runs.oscillation(time, -np.exp(-time))["period"])


def test_printed_settings_are_the_papers():
    made = scene.printed_cube(17, cohesion=True, correction=True)
    tension = made.effects[1]
    assert (tension.stiffness, tension.correction, made.effects[0].dynamic_viscosity) == (1e-3, 1e-3, 1e-3)
    assert (made.step, made.support_radius / made.spacing) == (5e-3, pytest.approx(1.5))
    assert (len(made.fluid[0].position), len(scene.block()[0])) == (4913, 810)
    assert abs(scene.TENSION - 17.03) < 0.01
