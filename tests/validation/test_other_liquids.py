"""Errors of flows of any program, and what is said of a program that is not there."""

from __future__ import annotations

import numpy as np
import pytest

from validation.experiment import Options
from validation.experiments.other_liquids.runs import SOUND, judged, planned
from validation.metrics.liquid import GHIA_U, GHIA_V, vortex


def lattice(cells):
    return (np.indices((cells, cells)).reshape(2, -1).T + 0.5) / cells


def test_a_known_error_is_found():
    x = lattice(20)
    exact = vortex(x, 0.7, 100.0)
    assert judged("vortices", 20, [(0.7, x, 1.03 * exact)])["error"] == pytest.approx(0.03)
    velocity = 0.002 * SOUND["tank"] * np.tile([0.6, -0.8], (len(x), 1))
    found = judged("tank", 20, [(3.5, x, velocity), (4.0, x + [0.0, 0.01], 3 * velocity)])
    assert found == pytest.approx({"error": 0.004, "level_off": 0.02})


def test_a_cube_that_lies_too_deep_is_found():
    cells, spacing = np.indices((20, 20, 12)).reshape(3, -1).T, 1 / 12
    water = (cells + 0.5) * spacing
    centre = [10 * spacing, 10 * spacing, 1.0 - (0.917 - 0.5 + 0.03) * 5 * spacing]
    assert judged("body", 12, [(4.0, np.vstack([centre, water]), water)])["error"] == pytest.approx(0.03)


def test_velocities_of_a_cavity_are_taken_at_its_centre_lines():
    x = lattice(200)
    u = np.interp(x[:, 1], *np.array([*GHIA_U, (1.0, 1.0)]).T)
    v = np.interp(x[:, 0], *np.array([(0.0, 0.0), *GHIA_V, (1.0, 0.0)]).T)
    right = np.column_stack([u, v])
    assert judged("cavity", 200, [(14.0, x, right), (15.0, x, right)])["error"] < 0.006
    assert judged("cavity", 200, [(14.0, x, right), (15.0, x, right + [0.1, 0.0])])["error"] == pytest.approx(
        0.05, abs=0.006
    )


def test_other_programs_run_where_they_are_asked_for():
    skipped = {run.key: run.skip for run in planned(Options())}
    assert all((not why) == ("_refsim_" in key) for key, why in skipped.items())
