"""The two programs of about a hundred lines: each method alone, with NumPy."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from refsim.__main__ import main

EXAMPLES = Path(__file__).parents[2] / "refsim" / "examples"


def loaded(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def sph():
    return loaded("sph_by_hand")


@pytest.fixture(scope="module")
def mpm():
    return loaded("mpm_by_hand")


def test_the_sph_front_is_that_of_the_experiment(sph):
    """Martin & Moyce 1952, n^2 = 2: Z = x/a at T = t sqrt(2 g/a); within 12 %."""
    said = []
    times, fronts, x, _ = sph.dam_break(until=0.25, report=said.append)
    assert (len(said), len(x)) == (3, 200)
    T, Z = times * np.sqrt(2 * 9.81 / 0.5), fronts / 0.5
    for at, expected in ((0.832, 1.217), (1.219, 1.474)):
        assert np.interp(at, T, Z) == pytest.approx(expected, rel=0.12)


def test_the_mpm_block_falls_and_bounces(mpm):
    said = []
    times, heights, x = mpm.bounce(side=12, until=0.4, report=said.append)
    falling = times < 0.15
    np.testing.assert_allclose(heights[falling], 0.425 - 0.5 * 9.81 * times[falling] ** 2, atol=2e-3)
    lowest = heights.argmin()
    assert heights[lowest] < 0.24
    assert heights[-1] > heights[lowest] + 0.1
    assert x[:, 1].min() > mpm.WALL * mpm.WIDTH
    assert said


@pytest.mark.parametrize("name", ["sph_by_hand", "mpm_by_hand"])
def test_a_program_is_written_and_runs_with_numpy_alone(name, tmp_path, capsys):
    assert main(["example", name, "--output", str(tmp_path)]) == 0
    assert f"python {tmp_path / name}.py" in capsys.readouterr().out
    text = (tmp_path / f"{name}.py").read_text()
    assert len(text.splitlines()) <= 100
    short = f"import {name} as p, sys; p.STEP *= 1; p.dam_break(4, 4, 0.02) if 'sph' in '{name}' else p.bounce(4, 0.02)"
    blocked = "import sys; sys.modules |= dict.fromkeys(('scipy', 'numba', 'matplotlib', 'refsim'));"
    subprocess.run([sys.executable, "-W", "error", "-c", blocked + short], cwd=tmp_path, check=True)
