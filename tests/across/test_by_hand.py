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


@pytest.mark.parametrize(("columns", "rows", "spacing", "until", "viscosity", "bound"), [
    (14, 3, 0.1, 0.8, None, 1e-12), (4, 12, 0.06, 0.5, 0.0, 1e-3),
])  # fmt: skip
def test_no_energy_of_the_sph_liquid_rises(columns, rows, spacing, until, viscosity, bound):
    """As shares of the first energy: to rounding with viscosity; without, up to what a step of 0.2 h/c leaves."""
    sph = loaded("sph_by_hand")
    for name, value in {"SPACING": spacing, "SUPPORT": 2.6 * spacing, "STEP": 0.2 * 2.6 * spacing / sph.SOUND}.items():
        setattr(sph, name, value)
    sph.VISCOSITY = sph.VISCOSITY if viscosity is None else viscosity
    _, fronts, x, energies = sph.dam_break(columns, rows, until, report=lambda words: None, every=2)
    assert (fronts.max() > sph.TANK[0] - spacing) == (columns > 4)  # it has struck the wall opposite
    assert (x > 0).all()
    assert (x[:, 0] < sph.TANK[0]).all()
    total = energies.sum(axis=1)
    assert (total - np.minimum.accumulate(total)).max() < bound * total[0]


def test_no_energy_of_the_mpm_block_rises(mpm, monkeypatch):
    """Kinetic (with that of the affine velocities), potential and elastic; up to what a step of 0.2 h/c leaves."""
    energies, give = [], mpm.to_grid

    def recorded(x, v, affine, deformation, mass, volume):
        stretch, J = np.linalg.svd(deformation)[1], np.linalg.det(deformation)
        elastic = mpm.MU * ((stretch - 1) ** 2).sum() + 0.5 * mpm.LAMBDA * ((J - 1) ** 2).sum()
        kinetic = 0.5 * mass * ((v**2).sum() + mpm.WIDTH**2 / 4 * (affine**2).sum())
        above = x - mpm.WALL * mpm.WIDTH
        energies.append(kinetic - mass * (above @ mpm.GRAVITY).sum() + volume * elastic)
        return give(x, v, affine, deformation, mass, volume)

    monkeypatch.setattr(mpm, "to_grid", recorded)
    mpm.bounce(6, 0.6, 0.5, report=lambda words: None)
    total = np.array(energies)
    assert (total - np.minimum.accumulate(total)).max() < 3e-3 * total[0]


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
